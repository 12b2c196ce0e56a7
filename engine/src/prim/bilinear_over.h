/**
 * bilinear_over.h: how far a triangle lies from a bilinear patch, as one bound.
 */
#ifndef QM_BILINEAR_OVER_H
#define QM_BILINEAR_OVER_H

#include "bilinear_point.h"

/**
 * Upper bound of the distance of all points of a triangle from the patch, from points uv of it under the
 * three corners: the nearest, or others. The parameters under all other points are interpolated, so that the
 * difference of the surfaces is quadratic. Its part along its middle direction is bounded exactly, what is
 * across by its Bezier points. Under the nearest points that part falls with the square of the triangle's
 * size and counts by its square: the bound is too great by the fourth power of the size.
 */
double qm_bilinear_under(const qm_bilinear *patch, const qm_vec corner[3], const double uv[3][2]);

#endif
