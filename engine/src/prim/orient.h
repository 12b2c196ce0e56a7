/**
 * orient.h: on which side of a line or plane a point lies, decided exactly: the sign never depends on
 * rounding, on the order of the arguments (but for the parity of a permutation) or on a common translation
 * that is exact in doubles.
 *
 * A filter computes the determinant in doubles with a bound of its error; when the bound leaves the sign
 * open, the determinant is computed again in integers of as many bits as it takes.
 *
 * Source: the error bounds of the filter are those of J. R. Shewchuk, Adaptive precision
 * floating-point arithmetic and fast robust geometric predicates, 1997, section 4.
 */
#ifndef QM_ORIENT_H
#define QM_ORIENT_H

#include "bigint.h"
#include "core/vec.h"

/** Coordinates must not be larger, so that no product overflows. There is no limit below. */
#define QM_ORIENT_LIMIT 0x1p300

/** The sign, 1, 0 or -1, of (b - a) x (c - a) . (d - a): 1 when a, b, c turn left as seen from d. */
int qm_orient3d(qm_vec a, qm_vec b, qm_vec c, qm_vec d);

/** The signs for count points against one plane: side[i] is qm_orient3d(plane[0], plane[1], plane[2],
 * point[i]). */
void qm_orient3d_sides(const qm_vec plane[3], const qm_vec *point, int count, int *side);

/** The determinant itself of p[1] - p[0], p[2] - p[0], p[3] - p[0], in units of 2^low[k] along each axis k, of which all
 * coordinates are multiples. */
void qm_orient3d_value(const double p[4][3], const int low[3], qm_bigint *out);

/** The sign of (b - a) x (c - a) in the plane of the two other axes: the cyclic next two axes are its x and
 * y. */
int qm_orient2d(qm_vec a, qm_vec b, qm_vec c, int dropped_axis);

/**
 * As qm_orient3d for the point d + (e, e^2, e^3) in place of d, e > 0 as small as one likes. It lies in no plane, so the
 * sign is 0 only of a triangle without area.
 *
 * Source: H. Edelsbrunner, E. Mucke, Simulation of simplicity, 1990.
 */
int qm_orient3d_nudged(qm_vec a, qm_vec b, qm_vec c, qm_vec d);

/** As qm_orient2d in the plane of x and y for c + (e, e^2) in place of c. 0 when a and b have the same x and y. */
int qm_orient2d_nudged(qm_vec a, qm_vec b, qm_vec c);

#endif
