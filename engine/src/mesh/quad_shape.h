/**
 * quad_shape.h: normal and scaled Jacobian of a quad.
 */
#ifndef QM_QUAD_SHAPE_H
#define QM_QUAD_SHAPE_H

#include "core/vec.h"

/** Cross product of the diagonals: a normal whose length is twice the largest projected area. */
static inline qm_vec qm_quad_normal(const qm_vec corner[4])
{
    return qm_vec_cross(qm_vec_sub(corner[2], corner[0]), qm_vec_sub(corner[3], corner[1]));
}

#define QM_QUAD_FLIPPED_COSINE (-0.2) /* between the normals of neighbours: below it one may be inverted */

/** True when neighbours with these normals face apart, which they may at a ridge. */
static inline bool qm_quad_faces_apart(qm_vec a, qm_vec b)
{
    return qm_vec_dot(a, b) < QM_QUAD_FLIPPED_COSINE * qm_vec_norm(a) * qm_vec_norm(b);
}

/** Scaled Jacobian: the smallest sine at a corner of a quad, seen along its normal. 1 for a rectangle, not
 * above 0 for a folded quad, -1 for one with two coincident corners. */
static inline double qm_quad_min_sine(const qm_vec corner[4])
{
    qm_vec normal = qm_quad_normal(corner);
    double length = qm_vec_norm(normal), smallest = 1.0;
    for (int k = 0; k < 4; k++) {
        qm_vec on = qm_vec_sub(corner[(k + 1) % 4], corner[k]);
        qm_vec back = qm_vec_sub(corner[(k + 3) % 4], corner[k]);
        double scale = length * qm_vec_norm(on) * qm_vec_norm(back);
        if (!(scale > 0.0)) return -1.0;
        smallest = fmin(smallest, qm_vec_dot(qm_vec_cross(on, back), normal) / scale);
    }
    return fmax(smallest, -1.0);
}

#endif
