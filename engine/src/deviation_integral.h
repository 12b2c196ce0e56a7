/**
 * deviation_integral.h: integrals over a piece of the two linear functions that the distance lies between.
 */
#ifndef QM_DEVIATION_INTEGRAL_H
#define QM_DEVIATION_INTEGRAL_H

#include "deviation_shape.h"

/**
 * Fills area, density, mean and square of a piece whose functions low and high are set. Where low is negative
 * the distance is at least 0, and the root mean square is never below the mean.
 */
void qm_piece_integrate(const qm_piece_shape *shape, qm_piece_bounds *out);

#endif
