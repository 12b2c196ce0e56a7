/**
 * reach.h: whether a point is within a distance of a point or a triangle, decided exactly for the doubles that are given.
 *
 * All numbers are integers of one power of two, and the distance of the feature that is nearest, a corner, an edge or the
 * plane, is compared by polynomials of degree six at most, without a root or a quotient. A point is near a triangle when it
 * is near a corner; or near the line of an edge, and its foot is between the ends; or near the plane, and its foot is
 * inside. Where the doubles differ by more than about 2^600 in size the answer is false.
 */
#ifndef QM_REACH_H
#define QM_REACH_H

#include <stdbool.h>

/** |p - q| <= limit. */
bool qm_reach_point(const double p[3], const double q[3], double limit);

/** The distance of p from the triangle, which may be a segment or a point, is at most limit >= 0. */
bool qm_reach_triangle(const double p[3], const double *const corner[3], double limit);

/** The patch of a quad is a parallelogram, c0 - c1 + c2 - c3 = 0, and thus the same points as its two triangles. */
bool qm_reach_is_flat(const double *const corner[4]);

#endif
