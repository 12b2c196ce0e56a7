#include "nearest_face.h"

#include "nearest.h"

static inline void start_ties(qm_ties *ties, qm_vec p, bool has_patches)
{
    double rounding = qm_distance_rounding(p);
    ties->error = has_patches ? qm_bilinear_error(p) : 0.0;
    ties->tau = 2.0 * ties->error + QM_TIE_ROUNDING * (1.0 + qm_greatest_coordinate(p));
    ties->margin = 2.0 * rounding; /* that of the bound and that of the distance */
    ties->least = ties->reach = ties->reach2 = INFINITY;
    ties->is_settled = ties->is_overfull = false;
    ties->count = 0;
}

/** The lowest face within reach, with the least distance of all. */
static qm_tie find_lowest(const qm_ties *ties)
{
    qm_tie lowest = {.face = QM_NO_INDEX};
    double least = INFINITY;
    for (int i = 0; i < ties->count; i++) {
        const qm_tie *tie = &ties->tie[i];
        least = qm_min(least, tie->distance);
        if (tie->distance <= ties->reach && tie->face < lowest.face) lowest = *tie;
    }
    lowest.distance = least;
    return lowest;
}

qm_tie qm_nearest_face(const qm_kernel *kernel, const qm_locator *locator, qm_quad_reading reading, qm_vec p,
                       uint32_t *hint)
{
    bool has_patches = reading == QM_QUADS_BILINEAR && qm_bvh_has_twists(locator->bvh);
    qm_ties ties;
    start_ties(&ties, p, has_patches);
    if (has_patches) {
        qm_hit hit = {.d2 = INFINITY, .pack = *hint};
        qm_nearest_triangle(kernel, locator, p, &hit);
        *hint = hit.pack;
    }
    qm_nearest_ties(kernel, locator, p, *hint, &ties);
    if (ties.is_overfull) {
        ties.is_settled = true;
        ties.count = 0;
        qm_nearest_ties(kernel, locator, p, *hint, &ties);
    }
    qm_tie lowest = find_lowest(&ties);
    *hint = lowest.pack;
    return lowest;
}
