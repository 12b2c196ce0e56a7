/**
 * align_work.h: what the steps of an alignment share: points of both meshes, their distances under a pose, and the search of
 * the best pose near a first one.
 */
#ifndef QM_ALIGN_WORK_H
#define QM_ALIGN_WORK_H

#include "align_pose.h"

/** Unknowns of a step: turn, shift, scale. */
#define QM_ALIGN_UNKNOWNS 7

/** Points on a mesh, in its frame. Any first ones of them lie evenly on it, too. */
typedef struct qm_align_points {
    qm_vec *point;
    size_t count, capacity;
} qm_align_points;

/** A point of one mesh and the nearest one of the other under a pose: x of A and y of B, each in its mesh's frame. */
typedef struct qm_align_pair {
    qm_vec x, y;
    qm_vec moved;     /* x under the pose */
    qm_vec direction; /* unit vector along which the distance grows as x moves; 0: unknown */
    double offset;    /* of moved from y along it; of an unknown one 0 */
    double distance;
    int side; /* the mesh whose point was projected */
} qm_align_pair;

typedef struct qm_align_work {
    qm_context *ctx;
    const qm_bvh *tree[2];
    const qm_align_options *options;
    qm_align_frames frames;
    qm_align_points points[2];
    bool counts[2]; /* the sides whose distances from the other one count */
    double noise;   /* a shorter distance, in the unit of the frames, has no direction of its own */
    qm_align_pair *pairs;
    size_t pair_count, pair_capacity;
    double *numbers; /* room for three numbers for each pair, and for its foot */
    double *feet, *distances, *uv;
    uint32_t *faces;
    uint32_t iterations;
} qm_align_work;

/** Points of the two meshes, evenly by area; false when memory runs out. Needs the frames. */
bool qm_align_points_make(qm_align_work *work, int side, size_t count);

/** The mean of the points of a side. */
qm_vec qm_align_points_center(const qm_align_points *points);

/** The pairs of the first `count` points of each side that counts, and, after them, of extra ones (as points of their
 * mesh: side and place), under a pose. */
typedef struct qm_align_extra {
    int side;
    qm_vec point;
} qm_align_extra;
qm_status qm_align_measure(qm_align_work *work, const qm_align_pose *pose, size_t count,
                           const qm_align_extra *extra, size_t extra_count);

/** The equation of a pair for a step about a center: row . step is the change of its distance. */
void qm_align_row(const qm_align_pair *pair, qm_vec center, double row[QM_ALIGN_UNKNOWNS]);

/** The step of a solution in the unknowns that a motion has, and their number. */
int qm_align_unknowns(qm_align_motion motion, int index[QM_ALIGN_UNKNOWNS]);
qm_align_step qm_align_step_of(const double x[QM_ALIGN_UNKNOWNS]);

/** What a search of the least squares found. */
typedef struct qm_align_found {
    qm_align_pose pose;
    double rms; /* unit of the frames */
    bool is_converged;
} qm_align_found;

/** How long a pose is improved. */
typedef struct qm_align_effort {
    size_t count; /* the first points of each mesh that are measured */
    int max_steps;
    bool is_last; /* the greatest distance that counts is that of the options */
    double
        rival; /* the root mean square of a better pose: the steps end once they are too short to reach it; 0: none */
} qm_align_effort;
qm_status qm_align_improve(qm_align_work *work, const qm_align_pose *start, const qm_align_effort *effort,
                           qm_align_found *out);

/** The best poses of several starts: best first, the second is another placement of A if has_second. */
typedef struct qm_align_ranking {
    qm_align_found best, second;
    bool has_second;
} qm_align_ranking;
qm_status qm_align_search_starts(qm_align_work *work, qm_align_ranking *out);

/** Lowers the Hausdorff distance from a pose on. */
qm_status qm_align_lower_maximum(qm_align_work *work, qm_align_pose *pose, qm_align_result *out);

#endif
