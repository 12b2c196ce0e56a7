/**
 * tri_distance.h: the least distance between two triangles, in doubles.
 *
 * Triangles that do not meet are nearest at a corner of one and some point of the other, or inside an edge of
 * each. What is computed is off by a few roundings of the largest coordinate, whatever the triangles' shape:
 * corners are measured in the frame of the longest edge (tri_point.h), edges by the cross product of their
 * directions, which loses nothing where they are nearly parallel. Of triangles that meet the distance is not
 * seen to be 0: tri_tri.h decides that.
 */
#ifndef QM_TRI_DISTANCE_H
#define QM_TRI_DISTANCE_H

#include "core/vec.h"

/**
 * A computed distance is within this of the true one when no coordinate exceeds 1; it scales with them. With
 * u = 2^-53 it is 256 u. A corner and a triangle: 120 u s with s = 2 (nearest_face.h). Two edges: the three
 * ways u, v, r are off by 3.5 u each, the way to the other edge by 10 u, the place on it by 35 u and the rest
 * of the way by 14 u, the length by 17 u; and the first place by 20 |r| u / h at an angle h (5.2 for each
 * cross product over |n|, the rest for the dot product), which moves the second one along and so costs 20 |r|
 * u < 70 u: 157 u. Where the first place lies so near to an end that the clamps decide, a corner is as near
 * to within these 70 u.
 */
#define QM_TRI_DISTANCE_ERROR 0x1p-45

/** Two nearest points by the weights of the corners. */
typedef struct qm_tri_gap {
    double distance;
    double weight[2][3];
} qm_tri_gap;

qm_tri_gap qm_tri_tri_distance(const qm_vec a[3], const qm_vec b[3]);

/** The point of a triangle with these weights. */
static inline qm_vec qm_tri_at(const qm_vec corner[3], const double weight[3])
{
    qm_vec p = qm_vec_scale(weight[0], corner[0]);
    return qm_vec_axpy(qm_vec_axpy(p, weight[1], corner[1]), weight[2], corner[2]);
}

#endif
