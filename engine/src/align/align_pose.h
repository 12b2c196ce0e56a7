/**
 * align_pose.h: motions as scale, turn and shift, in a frame of each mesh.
 *
 * The frame of a mesh has its origin at the center of the mesh's box; the unit of both is a power of two about the diagonal of
 * B. So a turn is about the middle of A, lengths are about 1, and meshes far from their origin lose nothing more than their
 * coordinates have lost already.
 */
#ifndef QM_ALIGN_POSE_H
#define QM_ALIGN_POSE_H

#include "core/vec.h"
#include "qm/align.h"

/** The image of x is scale * turn(x) + shift; with is_mirrored, the first coordinate of x changes its sign before. */
typedef struct qm_align_pose {
    double scale;
    double turn[4]; /* unit quaternion w x y z */
    qm_vec shift;
    bool is_mirrored;
} qm_align_pose;

/** The frames of A and B. */
typedef struct qm_align_frames {
    double center[2][3];
    double unit;
} qm_align_frames;

/** A 3 x 3 matrix by its columns. */
typedef struct qm_align_matrix {
    qm_vec column[3];
} qm_align_matrix;

static inline qm_vec qm_align_multiply(const qm_align_matrix *m, qm_vec x)
{
    return qm_vec_axpy(qm_vec_axpy(qm_vec_scale(x.x, m->column[0]), x.y, m->column[1]), x.z, m->column[2]);
}

/** The product with the transposed matrix. */
static inline qm_vec qm_align_multiply_back(const qm_align_matrix *m, qm_vec x)
{
    return (qm_vec){qm_vec_dot(m->column[0], x), qm_vec_dot(m->column[1], x), qm_vec_dot(m->column[2], x)};
}

/** The orthogonal part of a pose: turn and mirror. */
qm_align_matrix qm_align_pose_matrix(const qm_align_pose *pose);

/** The quaternion of a rotation, whose columns are orthonormal and of determinant 1. */
void qm_align_turn_of(const qm_align_matrix *m, double turn[4]);

/** The product of two quaternions, of length 1 anew. */
void qm_align_turn_multiply(const double p[4], const double q[4], double out[4]);

/** The change of a pose that is a small turn (a vector whose length is the angle), a shift, and the logarithm of a scale, about a
 * center in B's frame. */
typedef struct qm_align_step {
    qm_vec turn, shift;
    double scale;
} qm_align_step;

qm_align_pose qm_align_pose_change(const qm_align_pose *pose, qm_vec center, const qm_align_step *step);

/** A point of a mesh (0: A, 1: B) in its frame, and back. */
static inline qm_vec qm_align_local(const qm_align_frames *frames, int side, const double p[3])
{
    const double *c = frames->center[side], f = 1.0 / frames->unit;
    return (qm_vec){(p[0] - c[0]) * f, (p[1] - c[1]) * f, (p[2] - c[2]) * f};
}

static inline void qm_align_global(const qm_align_frames *frames, int side, qm_vec x, double p[3])
{
    const double *c = frames->center[side];
    p[0] = c[0] + frames->unit * x.x;
    p[1] = c[1] + frames->unit * x.y;
    p[2] = c[2] + frames->unit * x.z;
}

/** The transform of coordinates of A to those of B. */
void qm_align_pose_transform(const qm_align_frames *frames, const qm_align_pose *pose,
                             double m[QM_TRANSFORM_SIZE]);

#endif
