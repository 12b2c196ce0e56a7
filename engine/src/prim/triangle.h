/**
 * triangle.h: a triangle in doubles: its distance from a point and from another triangle, with the nearest
 * points. Slivers, segments and points are allowed. tri_tri.h decides exactly whether two triangles meet.
 */
#ifndef QM_TRIANGLE_H
#define QM_TRIANGLE_H

#include "core/vec.h"

/**
 * A triangle in the frame of its longest edge: corners (0, 0), (length, 0), (cx, cy), cy >= 0; first is the
 * corner (0, 1 or 2 of the input) at the origin, the others follow in cyclic order. bvh_tree.h says why.
 */
typedef struct qm_triangle {
    qm_vec origin, x, y, z;
    double length, cx, cy, inverse_c2, inverse_d2;
    int first;
} qm_triangle;

qm_triangle qm_triangle_make(qm_vec a, qm_vec b, qm_vec c);

/** Squared distance from p, by the same operations as the kernels'. */
double qm_triangle_distance2(const qm_triangle *triangle, qm_vec p);

/** Weights of the corners a, b, c (>= 0, summing to 1) of the footpoint of p. */
void qm_triangle_footpoint(const qm_triangle *triangle, qm_vec p, double weight[3]);

/**
 * A computed distance of two triangles is within this of the true one when no coordinate exceeds 1; it scales
 * with them. With u = 2^-53 it is 256 u. A corner and a triangle: 120 u s with s = 2 (nearest.h). Two
 * edges: the three vectors u, v, r are off by 3.5 u each, the vector to the other edge by 10 u, the parameter
 * on it by 35 u and the remaining vector by 14 u, its length by 17 u; and the first parameter by 20 |r| u / h
 * at an angle h (5.2 for each cross product over |n|, the remainder for the dot product), which moves the
 * second one along and so costs 20 |r| u < 70 u: 157 u. Where the first parameter lies so near to an end that
 * the clamps decide, a corner is as near to within these 70 u.
 */
#define QM_TRIANGLE_GAP_ERROR 0x1p-45

/** The distance of two triangles, and two nearest points by the weights of the corners. */
typedef struct qm_triangle_gap {
    double distance;
    double weight[2][3];
} qm_triangle_gap;

/**
 * Triangles that do not meet are nearest at a corner of one and some point of the other, or inside an edge of
 * each. The error is a few roundings of the largest coordinate, whatever the triangles' shape: corners are
 * measured in the frame of the longest edge, edges by the cross product of their directions, which loses
 * nothing where they are nearly parallel. Of triangles that meet the computed distance need not be 0.
 */
qm_triangle_gap qm_triangle_find_gap(const qm_vec a[3], const qm_vec b[3]);

/** The corners a, b, c from the frame of a triangle: b and c within a few roundings. */
static inline void qm_triangle_corners(const qm_triangle *t, qm_vec corner[3])
{
    corner[0] = t->origin;
    corner[1] = qm_vec_axpy(t->origin, t->length, t->x);
    corner[2] = qm_vec_axpy(qm_vec_axpy(t->origin, t->cx, t->x), t->cy, t->y);
}

/** The point of a triangle with these weights. */
static inline qm_vec qm_triangle_at(const qm_vec corner[3], const double weight[3])
{
    qm_vec p = qm_vec_scale(weight[0], corner[0]);
    return qm_vec_axpy(qm_vec_axpy(p, weight[1], corner[1]), weight[2], corner[2]);
}

#endif
