/**
 * bilinear_hull.h: how near a part of a bilinear patch can be to a point, by its four corners alone.
 */
#ifndef QM_BILINEAR_HULL_H
#define QM_BILINEAR_HULL_H

#include "core/vec.h"

/** Range of the corners' heights along a direction of length 1, rounded up. */
double qm_hull_width(const qm_vec corner[4], qm_vec direction);

/**
 * Lower bound of the distance from p to a bilinear patch with corners in turn: that to its two triangles,
 * less twist, which is what the patch can leave them by; or, where that is not enough and the hull of the
 * corners is much thinner than twist (flat, folded and collapsed patches), that to the hull.
 *
 * share   parameters from 0 to 1 of a point that is near to the nearest one, the nearer the smaller the
 * patch; the middle when the bound is enough
 */
double qm_hull_lower(const qm_vec corner[4], qm_vec p, double twist, double enough, double share[2]);

#endif
