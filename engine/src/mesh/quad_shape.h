/**
 * quad_shape.h: how well a quad is shaped.
 */
#ifndef QM_QUAD_SHAPE_H
#define QM_QUAD_SHAPE_H

#include "core/vec.h"

/** Twice the quad's area seen from where it looks largest, as a normal. */
static inline qm_vec qm_quad_normal(const qm_vec corner[4])
{
    return qm_vec_cross(qm_vec_sub(corner[2], corner[0]), qm_vec_sub(corner[3], corner[1]));
}

#define QM_TURNED_COSINE (-0.2) /* between the normals of neighbours, below which one may lie upside down */

/** True when neighbours of these normals look apart. On both sides of a ridge they may. */
static inline bool qm_quads_look_apart(qm_vec a, qm_vec b)
{
    return qm_vec_dot(a, b) < QM_TURNED_COSINE * qm_vec_norm(a) * qm_vec_norm(b);
}

/** The least sine at a corner of a quad, seen along its normal: its scaled Jacobian, 1 for a rectangle, not
 * above 0 for a folded quad, -1 for one with two corners in one place. */
static inline double qm_quad_least_sine(const qm_vec corner[4])
{
    qm_vec normal = qm_quad_normal(corner);
    double length = qm_vec_norm(normal), least = 1.0;
    for (int k = 0; k < 4; k++) {
        qm_vec on = qm_vec_sub(corner[(k + 1) % 4], corner[k]);
        qm_vec back = qm_vec_sub(corner[(k + 3) % 4], corner[k]);
        double scale = length * qm_vec_norm(on) * qm_vec_norm(back);
        if (!(scale > 0.0)) return -1.0;
        least = fmin(least, qm_vec_dot(qm_vec_cross(on, back), normal) / scale);
    }
    return fmax(least, -1.0);
}

#endif
