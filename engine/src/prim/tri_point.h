/**
 * tri_point.h: one triangle and one point, in scalar code: the frame that packs are filled from, the
 * distance, and the footpoint with its parameters.
 */
#ifndef QM_TRI_POINT_H
#define QM_TRI_POINT_H

#include "core/vec.h"

/**
 * A triangle in the frame of its longest edge: corners (0, 0), (length, 0), (cx, cy), cy >= 0; first is the
 * corner (0, 1 or 2 of the input) at the origin, the others follow in turn. See bvh_tree.h for why.
 */
typedef struct qm_triangle {
    qm_vec origin, x, y, z;
    double length, cx, cy, inverse_c2, inverse_d2;
    int first;
} qm_triangle;

/** The frame of a triangle; slivers, segments and points are fine. */
qm_triangle qm_triangle_make(qm_vec a, qm_vec b, qm_vec c);

/** Squared distance from p, by the same operations as the packs. */
double qm_triangle_distance2(const qm_triangle *triangle, qm_vec p);

/** Weights of the corners a, b, c (>= 0, summing to 1) of the footpoint of p. */
void qm_triangle_footpoint(const qm_triangle *triangle, qm_vec p, double weight[3]);

#endif
