/**
 * max_min.h: a max-min linear program: the highest point (x, t) below several planes, where x lies in a
 * convex region of two dimensions.
 */
#ifndef QM_MAX_MIN_H
#define QM_MAX_MIN_H

#include <stdbool.h>

/** The constraint t <= height + slope . x, or 0 <= height + slope . x when it bounds the region. */
typedef struct qm_max_min_plane {
    double slope[2], height;
    bool is_bound;
} qm_max_min_plane;

/**
 * Maximum of t over all points x of a triangle around 0, whose sides are at the distance radius, within all
 * bounds. The first plane is no bound; bounds contain 0: their heights are not negative. at gets the
 * maximizing x. Returns the first plane's height, at 0, when rounding ends the iteration early.
 */
double qm_max_min(const qm_max_min_plane *planes, int count, double radius, double at[2]);

#endif
