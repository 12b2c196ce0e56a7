/**
 * winding.h: how often a closed surface winds round a point, exactly.
 *
 * The faces above the point are counted, each by the turn of its outline as seen from above. The point is moved by
 * (e, e^2, e^3), e as small as one likes, so that no edge and no corner is exactly above it, and all signs are exact: the
 * number does not depend on rounding.
 *
 * A patch and its two triangles have one outline. Between them lies a part of the tetrahedron of the corners; a point in
 * it counts once more, or less, than by the triangles. Which part that is, the sign of a product of weights tells
 * (qm_bilinear_side).
 */
#ifndef QM_WINDING_H
#define QM_WINDING_H

#include "bvh_tree.h"

/** The coordinates of a point: those of the mesh, or local ones of the tree. */
typedef enum qm_winding_space { QM_WINDING_WORLD, QM_WINDING_LOCAL } qm_winding_space;

/**
 * The winding number of a surface round a point that is not on it. Its outlines cancel (qm_solid_check); otherwise the number means
 * nothing. Coordinates are below QM_ORIENT_LIMIT.
 *
 * Local corners are rounded, by u in each coordinate, and a path from the rounded surface to the true one passes no
 * point that is farther than that from it: the number is that of the true one where the distance is proven to be larger.
 */
int qm_winding_number(const qm_bvh *bvh, qm_quad_reading reading, qm_winding_space space, qm_vec p);

#endif
