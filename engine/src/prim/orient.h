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

#include "core/vec.h"

/** Coordinates must not be larger, so that no product overflows. There is no limit below. */
#define QM_ORIENT_LIMIT 0x1p300

/** The sign, 1, 0 or -1, of (b - a) x (c - a) . (d - a): 1 when a, b, c turn left as seen from d. */
int qm_orient3d(qm_vec a, qm_vec b, qm_vec c, qm_vec d);

/** The signs for count points against one plane: side[i] is qm_orient3d(plane[0], plane[1], plane[2],
 * point[i]). */
void qm_orient3d_sides(const qm_vec plane[3], const qm_vec *point, int count, int *side);

/** The sign of (b - a) x (c - a) in the plane of the two other axes: the cyclic next two axes are its x and
 * y. */
int qm_orient2d(qm_vec a, qm_vec b, qm_vec c, int dropped_axis);

#endif
