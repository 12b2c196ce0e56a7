/**
 * max_min.h: the highest point below several planes, over a convex part of the plane: a linear program in
 * three variables.
 */
#ifndef QM_MAX_MIN_H
#define QM_MAX_MIN_H

#include <stdbool.h>

/** height + slope . x, which t must not be above; 0 when it is a wall. */
typedef struct qm_slope {
    double slope[2], height;
    bool is_wall;
} qm_slope;

/**
 * Greatest t over the places x in a triangle round 0, whose sides are radius away, and inside all walls. The
 * first slope is no wall; walls hold 0: their heights are not negative. at is where.
 */
double qm_max_min(const qm_slope *slopes, int count, double radius, double at[2]);

#endif
