/**
 * transform.h: moves a mesh by an affine map: a pose.
 *
 * A transform is a matrix of 4 x 4, column by column: the image of (x, y, z) is
 *     m[0] x + m[4] y + m[8] z + m[12], m[1] x + m[5] y + m[9] z + m[13], m[2] x + m[6] y + m[10] z + m[14].
 */
#ifndef QM_TRANSFORM_H
#define QM_TRANSFORM_H

#include "qm/mesh.h"

#define QM_TRANSFORM_SIZE 16

/** Writes the map that moves nothing. */
void qm_transform_identity(double m[QM_TRANSFORM_SIZE]);

bool qm_transform_is_identity(const double m[QM_TRANSFORM_SIZE]);

/**
 * Checks that a matrix moves meshes: all its numbers are finite, its last row is 0 0 0 1, and it is not singular: with its
 * columns scaled to length 1, its determinant is not below 2^-40, at which a surface would be flat but for roundings.
 *
 * Returns: QM_OK; QM_E_NOT_FINITE or QM_E_ARGUMENT (ctx->message names the number, counted from 0, or what is wrong).
 */
qm_status qm_transform_check(qm_context *ctx, const double m[QM_TRANSFORM_SIZE]);

/** True when the determinant of the map is below 0: it makes a mirror image. m passes qm_transform_check. */
bool qm_transform_mirrors(const double m[QM_TRANSFORM_SIZE]);

/**
 * The moved positions of a mesh: x y z of each of its vertices, rounded. Let S be the largest of the four terms of a sum
 * above; each coordinate is off by at most 2^-49 S, where S is at least 2^-1000. With u = 2^-53 the three products are off by
 * u S each, and the three sums by 2 u S, 3 u S and 4 u S: 12 u S to the first order, below 16 u S. The map that moves nothing
 * gives the positions as they are.
 *
 * positions  vertex_count rows of x y z; may be the mesh's own
 *
 * Returns: QM_OK; QM_E_NOT_FINITE (ctx->message names the vertex that overflows).
 */
qm_status qm_transform_positions(qm_context *ctx, const double m[QM_TRANSFORM_SIZE], const qm_mesh *mesh,
                                 double *positions);

/** By how much a move changes distances: points that are d apart are at most norm d + rounding apart when the one is moved
 * exactly, and the other is of a mesh with its positions moved and rounded. {1, 0} without a move. */
typedef struct qm_transform_change {
    double norm, rounding;
} qm_transform_change;

/** The change for a mesh whose positions are not moved yet. */
qm_transform_change qm_transform_find_change(const double m[QM_TRANSFORM_SIZE], const qm_mesh *mesh);

#endif
