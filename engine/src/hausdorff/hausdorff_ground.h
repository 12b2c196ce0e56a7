/**
 * hausdorff_ground.h: the facets of the source that meet in a point, for a climb from there.
 */
#ifndef QM_HAUSDORFF_GROUND_H
#define QM_HAUSDORFF_GROUND_H

#include "core/max_min.h"
#include "hausdorff_search.h"

#define QM_MAX_GROUNDS 16 /* that meet in a point; more are not looked at */
#define QM_MAX_WALLS 4

/** A facet of the source, local to the target; w is 0 for triangles, whose parameters sum to 1 at most. */
typedef struct qm_ground {
    qm_bilinear patch;
    bool is_triangle;
    uint32_t face;
    double uv[2]; /* of the place at hand */
} qm_ground;

typedef struct qm_grounds {
    int count;
    qm_ground at[QM_MAX_GROUNDS];
} qm_grounds;

/** Finds the facets that hold a point of the source. */
void qm_grounds_find(const qm_search *search, const qm_side *side, qm_vec place, qm_grounds *out);

/** The sides of a ground as seen from its place, for steps in units of length along its parameters, whose
 * speeds are given. Returns how many. */
int qm_ground_walls(const qm_ground *ground, const double speed[2], qm_slope walls[QM_MAX_WALLS]);

/** Length of the longest side. */
double qm_grounds_largest(const qm_grounds *grounds);

#endif
