/**
 * hausdorff_ground.h: the facets of the source that meet in a point, for a climb from there.
 */
#ifndef QM_HAUSDORFF_GROUND_H
#define QM_HAUSDORFF_GROUND_H

#include "core/max_min.h"
#include "hausdorff_search.h"

#define QM_MAX_INCIDENT 16 /* that meet in a point; more are not looked at */
#define QM_MAX_BOUNDS 4

/** A facet of the source, local to the target; w is 0 for triangles, whose parameters sum to 1 at most. */
typedef struct qm_incident_facet {
    qm_bilinear patch;
    bool is_triangle;
    uint32_t face;
    double uv[2]; /* of the place at hand */
} qm_incident_facet;

typedef struct qm_incident_facets {
    int count;
    qm_incident_facet at[QM_MAX_INCIDENT];
} qm_incident_facets;

/** Finds the facets that hold a point of the source. */
void qm_incident_find(const qm_search *search, const qm_side *side, qm_vec place, qm_incident_facets *out);

/** The sides of a ground as seen from its place, for steps in units of length along its parameters, whose
 * speeds are given. Returns how many. */
int qm_incident_bounds(const qm_incident_facet *ground, const double speed[2], qm_slope walls[QM_MAX_BOUNDS]);

/** Length of the longest side. */
double qm_incident_longest(const qm_incident_facets *grounds);

#endif
