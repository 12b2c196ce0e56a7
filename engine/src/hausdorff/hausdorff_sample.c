#include <string.h>

#include "hausdorff_search.h"
#include "prim/bilinear_point.h"

/* Of the tolerance: the least rise of the lower bound that is worth a certificate */
#define CERTIFY_SHARE 0.25
#define FLOAT_FLOOR 0x1p-21    /* of the reach: a lower bound below it is lost in the margins of floats */
#define PATCH_ERROR_SHARE 0.02 /* of the tolerance: certified error of a patch distance */

double qm_side_pack_upper(const qm_search *search, const qm_side *side, uint32_t pack, qm_vec p)
{
    return search->kernel->float_upper(qm_bvh_floats(side->target, pack), qm_side_twists(side, pack), p);
}

/** Raises the shared lower bound, and keeps the point as this worker's witness when it did. */
static void raise_lower(qm_worker *worker, const qm_side *side, qm_vec p, double slack, uint32_t face,
                        uint32_t hint, double distance)
{
    qm_search *search = worker->search;
    double world = distance * side->inverse_scale;
    double lower = atomic_load_explicit(&search->lower, memory_order_relaxed);
    while (world > lower && !atomic_compare_exchange_weak(&search->lower, &lower, world))
        continue;
    if (world > lower || worker->witness < 0.0) {
        worker->witness = world;
        worker->witness_side = (int)(side - search->side);
        worker->witness_face = face;
        worker->witness_hint = hint;
        worker->witness_point = p;
        worker->witness_slack = slack;
    }
}

/** The place of a point among the known ones. */
static qm_known_point *place_of(qm_worker *worker, qm_vec p)
{
    uint64_t bits[3], mixed = 0;
    memcpy(bits, &p, sizeof bits);
    for (int k = 0; k < 3; k++)
        mixed = (mixed ^ bits[k]) * UINT64_C(0x9e3779b97f4a7c15);
    return &worker->known[mixed >> 32 & (QM_KNOWN_POINTS - 1)];
}

/** True when the same was asked before, or more. */
static bool is_known(const qm_known_point *known, const qm_known_point *asked)
{
    return known->side == asked->side && qm_vec_equal(known->p, asked->p) && known->slack <= asked->slack &&
           known->enough <= asked->enough && known->is_sample >= asked->is_sample;
}

double qm_side_nearly(const qm_search *search, const qm_side *side, qm_vec p, double enough, double reach,
                      uint32_t *hint)
{
    qm_float_hit hit = {.pack = *hint};
    search->kernel->float_closest(side->target, p, enough, &hit);
    *hint = hit.pack;
    double twist = qm_side_twist(side, hit.pack, hit.lane), upper = hit.upper + twist;
    if (upper <= reach || hit.upper - twist >= reach) return upper;
    qm_bilinear patch = qm_bvh_load_patch(side->target, side->target->lanes[hit.pack].face[hit.lane]);
    return fmin(upper, qm_bilinear_descend(&patch, p, reach).distance);
}

double qm_worker_nearly(qm_worker *worker, const qm_side *side, qm_vec p, double enough, double reach,
                        uint32_t *hint)
{
    qm_known_point *known = place_of(worker, p), asked = {.side = side, .p = p, .enough = enough};
    if (!is_known(known, &asked)) {
        asked.upper = qm_side_nearly(worker->search, side, p, enough, reach, hint);
        asked.hint = *hint;
        *known = asked;
    }
    *hint = known->hint;
    return known->upper;
}

/** Distance to the nearest facet of a pack, or something greater. */
static double pack_distance(const qm_search *search, const qm_side *side, uint32_t pack, qm_vec p,
                            double enough)
{
    double d2[QM_PACK_LANES];
    qm_pack spare;
    search->kernel->pack_distances(qm_bvh_rows(side->target, pack, &spare), p, d2);
    uint32_t nearest = 0;
    for (uint32_t lane = 1; lane < side->target->lanes[pack].lane_count; lane++)
        if (d2[lane] < d2[nearest]) nearest = lane;
    double twist = qm_side_twist(side, pack, nearest), distance = sqrt(d2[nearest]);
    if (!(twist > 0.0) || distance + twist <= enough || distance - twist > enough) return distance + twist;
    qm_bilinear patch = qm_bvh_load_patch(side->target, side->target->lanes[pack].face[nearest]);
    return qm_min(distance + twist, qm_bilinear_descend(&patch, p, enough).distance);
}

static double search_sample(qm_worker *worker, const qm_side *side, qm_vec p, double slack, uint32_t face,
                            double enough, uint32_t *hint)
{
    const qm_search *search = worker->search;
    double known = qm_side_lower(search, side);
    worker->projections++;
    bool by_boxes = !side->nearest.grid && !side->nearest.tetra;
    if (by_boxes && known > FLOAT_FLOOR * side->reach && worker->witness >= 0.0) {
        double nearly = qm_side_nearly(search, side, p, enough, known + slack, hint);
        if (nearly - slack <= known) return nearly;
    }
    /* Where surfaces coincide the hint mostly shows that the point is of no use; among many facets in one
     * place a search finds no box to leave out. */
    double at_hint = pack_distance(search, side, *hint, p, known + slack);
    if (at_hint - slack <= known + CERTIFY_SHARE * search->tolerance * side->scale && worker->witness >= 0.0)
        return at_hint;
    qm_hit hit = {.d2 = INFINITY, .pack = *hint};
    qm_nearest_triangle(search->kernel, &side->nearest, p, &hit);
    *hint = hit.pack;
    double upper = sqrt(hit.d2) + qm_side_twist(side, hit.pack, hit.lane), lower = upper;
    if (side->target_patches && upper - slack > known) {
        /* A point of a patch that is near enough costs little to find; to certify that none is nearer costs
         * much more, and is due only when the lower bound would rise by more than a crumb. */
        qm_bilinear_hit patch;
        qm_nearest_patch(search->kernel, &side->nearest, p, hit.pack, INFINITY, &patch);
        double error =
            fmax(PATCH_ERROR_SHARE * search->tolerance * side->scale, QM_BILINEAR_MIN_ERROR * side->reach);
        double worthwhile = known + CERTIFY_SHARE * search->tolerance * side->scale;
        if (patch.distance - slack > worthwhile)
            qm_nearest_patch(search->kernel, &side->nearest, p, patch.pack, error, &patch);
        *hint = patch.pack;
        upper = patch.distance;
        lower = patch.lower;
    }
    if (lower - slack > known || worker->witness < 0.0)
        raise_lower(worker, side, p, slack, face, *hint, fmax(0.0, lower - slack));
    return upper;
}

double qm_worker_sample(qm_worker *worker, const qm_side *side, qm_vec p, double slack, uint32_t face,
                        double enough, uint32_t *hint)
{
    qm_known_point *known = place_of(worker, p),
                   asked = {.side = side, .p = p, .slack = slack, .enough = enough, .is_sample = true};
    if (!is_known(known, &asked)) {
        asked.upper = search_sample(worker, side, p, slack, face, enough, hint);
        asked.hint = *hint;
        *known = asked;
    }
    *hint = known->hint;
    return known->upper;
}

void qm_candidates_fill(qm_candidates *candidates, const qm_side *side, const uint32_t *packs, int count,
                        double cutoff)
{
    candidates->count = count;
    for (int k = 0; k < count; k++) {
        candidates->pack[k] = qm_bvh_rows(side->target, packs[k], &candidates->spare[k]);
        for (uint32_t lane = 0; lane < QM_PACK_LANES; lane++)
            qm_candidates_set_cutoff(candidates, k, lane, qm_side_twist(side, packs[k], lane), cutoff);
    }
}
