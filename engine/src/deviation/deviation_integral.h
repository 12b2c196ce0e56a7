/**
 * deviation_integral.h: integrals over a piece of the two linear functions that the distance lies between.
 */
#ifndef QM_DEVIATION_INTEGRAL_H
#define QM_DEVIATION_INTEGRAL_H

#include "deviation_piece.h"

/** Of the part of a triangle where a linear function f is positive: the means of f and f^2 there over the
 * whole triangle, and its share. */
typedef struct qm_positive_part {
    double mean, square, share;
} qm_positive_part;

/** That part itself: one or two triangles, by weights of the whole triangle's corners. */
typedef struct qm_positive_region {
    int count;
    double share[2], weight[2][3][3];
} qm_positive_region;

/** By how much the distance exceeds a height: at most, and its means over the piece. */
typedef struct qm_excess {
    double most;
    qm_positive_part part;
} qm_excess;

/** Where f is negative at one or two corners, its line of zeros cuts off a triangle. All terms are positive,
 * so that rounding is relative. */
qm_positive_part qm_integral_positive_part(const double f[3]);

qm_positive_region qm_integral_positive_region(const double f[3]);

/** Of another function, within a region. */
qm_positive_part qm_integral_positive_part_in(const qm_positive_region *region, const double f[3]);

/** Fills area, density, mean and square of a piece whose functions low and high are set. Where low is
 * negative the distance is at least 0. */
void qm_deviation_integrate(const qm_deviation_shape *shape, qm_deviation_bounds *out);

/** Takes the narrower bounds of each integral, and the functions over the base if these leave less open. */
void qm_deviation_bounds_combine(qm_deviation_bounds *bounds, const qm_deviation_bounds *over);

/**
 * Integrates a signed piece, with the loss of the distance against the lowest height, and its excess
 * outside of the base.
 * Then opens the functions by room: the share of lost is that of the points where the loss exceeds room. Both
 * sides are added: low and -high are nowhere positive both, and the greater of high and -low is no more than
 * the sum of their positive parts. A height l that loses x leaves (l - x)^2 >= l^2 - 2 l x; one with an
 * excess x makes (l + x)^2 = l^2 + (2 l + x) x.
 */
void qm_deviation_integrate_signed(const qm_deviation_shape *shape, qm_positive_part lost, qm_excess outside,
                                   double room, qm_deviation_bounds *out);

/** The same for a piece whose bend is set too: its height is integrated where it is of one sign, and where it
 * changes its sign in parts that are cut in four until they count for little. */
void qm_deviation_integrate_quadratic(const qm_deviation_shape *shape, qm_positive_part lost,
                                      qm_excess outside, double room, double little,
                                      qm_deviation_bounds *out);

#endif
