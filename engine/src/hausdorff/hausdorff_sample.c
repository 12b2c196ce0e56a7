/**
 * hausdorff_sample.c: the lower bound. The distance of any point of the source bounds the Hausdorff
 * distance from below, when no point of the target is nearer: so a sample that may raise the lower bound is
 * certified by a complete search of the target.
 *
 * Seeds. All stages of the search cost the less, the nearer the lower bound is to the distance, and distances
 * vary little from face to face: so a sparse sample of the source shows where to sample more densely.
 */
#include <string.h>

#include "hausdorff_sample.h"
#include "prim/bilinear.h"

#define SEED_COUNT 1024 /* packs measured at their centres, spread along the Hilbert curve */
#define SHARED_SEEDS 32 /* seeds that one of several workers takes at once */
#define PEAK_COUNT 16   /* the farthest seeds, around which more points are measured */
#define CLOSER_COUNT 16 /* packs round a peak measured at their centres */

#define CERTIFY_SHARE 0.25     /* of the tolerance: a smaller rise of the lower bound needs no certificate */
#define FLOAT_FLOOR 0x1p-21    /* of the reach: a lower bound below it is lost in the margins of floats */
#define PATCH_ERROR_SHARE 0.02 /* of the tolerance: certified error of a patch distance */

/* --- One point --- */

double qm_sample_pack_upper(const qm_kernel *kernel, const qm_side *side, uint32_t pack, qm_vec p)
{
    QM_ASSERT(pack < side->target->pack_count);
    return kernel->float_upper(qm_bvh_float_pack(side->target, pack), qm_side_twists(side, pack), p);
}

/** Raises the shared lower bound, and keeps the point as this worker's witness when it did. */
static void raise_lower(qm_worker *worker, const qm_side *side, qm_vec p, double slack, uint32_t face,
                        uint32_t hint, double distance)
{
    QM_ASSERT(distance >= 0.0);
    qm_search *search = worker->search;
    double world = distance * side->inverse_scale;
    if (qm_search_raise_lower(search, world) || worker->witness < 0.0) {
        worker->witness = world;
        worker->witness_side = (int)(side - search->side);
        worker->witness_face = face;
        worker->witness_hint = hint;
        worker->witness_point = p;
        worker->witness_slack = slack;
    }
}

/** The slot of a point among the known ones. */
static qm_known_point *slot_of(qm_worker *worker, qm_vec p)
{
    uint64_t bits[3], mixed = 0;
    memcpy(bits, &p, sizeof bits);
    for (int k = 0; k < 3; k++)
        mixed = (mixed ^ bits[k]) * UINT64_C(0x9e3779b97f4a7c15);
    return &worker->known[mixed >> 32 & (QM_KNOWN_POINTS - 1)];
}

/** True when known answers the request: the same point, searched for as closely or more. */
static bool is_known(const qm_known_point *known, const qm_known_point *query)
{
    return known->side == query->side && qm_vec_equal(known->p, query->p) && known->slack <= query->slack &&
           known->enough <= query->enough && known->is_sample >= query->is_sample;
}

double qm_sample_upper(const qm_kernel *kernel, const qm_side *side, qm_vec p, double enough, double reach,
                       uint32_t *hint)
{
    qm_float_hit hit = {.pack = *hint};
    kernel->float_closest(side->target, p, enough, &hit);
    *hint = hit.pack;
    double twist = qm_side_twist(side, hit.pack, hit.lane), upper = hit.upper + twist;
    if (upper <= reach || hit.upper - twist >= reach) return upper;
    qm_bilinear patch = qm_bvh_load_patch(side->target, side->target->lanes[hit.pack].face[hit.lane]);
    return fmin(upper, qm_bilinear_minimise(&patch, p, reach).distance);
}

double qm_sample_known_upper(qm_worker *worker, const qm_side *side, qm_vec p, double enough, double reach,
                             uint32_t *hint)
{
    qm_known_point *known = slot_of(worker, p), query = {.side = side, .p = p, .enough = enough};
    if (!is_known(known, &query)) {
        query.upper = qm_sample_upper(worker->search->kernel, side, p, enough, reach, hint);
        query.hint = *hint;
        *known = query;
    }
    *hint = known->hint;
    return known->upper;
}

/** Upper bound of the distance of p by the nearest facet of a pack. */
static double pack_distance(const qm_search *search, const qm_side *side, uint32_t pack, qm_vec p,
                            double enough)
{
    double d2[QM_PACK_LANES];
    qm_pack spare;
    search->kernel->pack_distances(qm_bvh_pack(side->target, pack, &spare), p, d2);
    uint32_t nearest = 0;
    for (uint32_t lane = 1; lane < side->target->lanes[pack].lane_count; lane++)
        if (d2[lane] < d2[nearest]) nearest = lane;
    double twist = qm_side_twist(side, pack, nearest), distance = sqrt(d2[nearest]);
    if (!(twist > 0.0) || distance + twist <= enough || distance - twist > enough) return distance + twist;
    qm_bilinear patch = qm_bvh_load_patch(side->target, side->target->lanes[pack].face[nearest]);
    return qm_min(distance + twist, qm_bilinear_minimise(&patch, p, enough).distance);
}

/** Samples a point that is not known; see qm_sample_point. */
static double search_sample(qm_worker *worker, const qm_side *side, qm_vec p, double slack, uint32_t face,
                            double enough, uint32_t *hint)
{
    const qm_search *search = worker->search;
    double known = qm_search_local_lower(search, side);
    worker->projections++;
    bool by_boxes = !side->nearest.grid && !side->nearest.tetra;
    if (by_boxes && known > FLOAT_FLOOR * side->reach && worker->witness >= 0.0) {
        double nearly = qm_sample_upper(search->kernel, side, p, enough, known + slack, hint);
        if (nearly - slack <= known) return nearly;
    }
    /* Where surfaces coincide the hint mostly shows that the point cannot raise the lower bound; among many
     * facets at one location a search finds no box to prune. */
    double at_hint = pack_distance(search, side, *hint, p, known + slack);
    if (at_hint - slack <= known + CERTIFY_SHARE * search->tolerance * side->scale && worker->witness >= 0.0)
        return at_hint;
    qm_hit hit = {.d2 = INFINITY, .pack = *hint};
    qm_nearest_triangle(search->kernel, &side->nearest, p, &hit);
    *hint = hit.pack;
    double upper = sqrt(hit.d2) + qm_side_twist(side, hit.pack, hit.lane), lower = upper;
    if (side->target_patches && upper - slack > known) {
        /* To find a near point of a patch costs little; to certify that none is nearer costs much more, and
         * is worth it only when the lower bound would rise by CERTIFY_SHARE of the tolerance. Any patch will
         * do that shows that it cannot: among many at one location a search has none to prune. */
        qm_bilinear_hit patch;
        double worthwhile = known + CERTIFY_SHARE * search->tolerance * side->scale;
        if (by_boxes)
            search->kernel->near_patch(side->target, p, hit.pack, worthwhile + slack, &patch);
        else
            qm_nearest_patch(search->kernel, &side->nearest, p, hit.pack, INFINITY, &patch);
        double error =
            fmax(PATCH_ERROR_SHARE * search->tolerance * side->scale, QM_BILINEAR_MIN_ERROR * side->reach);
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

double qm_sample_point(qm_worker *worker, const qm_side *side, qm_vec p, double slack, uint32_t face,
                       double enough, uint32_t *hint)
{
    QM_ASSERT(worker && side && hint);
    QM_ASSERT(!(slack < 0.0));
    QM_ASSERT(*hint < side->target->pack_count);
    qm_known_point *known = slot_of(worker, p),
                   query = {.side = side, .p = p, .slack = slack, .enough = enough, .is_sample = true};
    if (!is_known(known, &query)) {
        query.upper = search_sample(worker, side, p, slack, face, enough, hint);
        query.hint = *hint;
        *known = query;
    }
    *hint = known->hint;
    return known->upper;
}

/* --- Seeds --- */

/** A pack of the source whose centre was measured. */
typedef struct seed {
    double distance;
    uint32_t pack, hint;
} seed;

typedef struct seed_list {
    int count;
    seed at[PEAK_COUNT]; /* farthest first */
} seed_list;

/** The state that the workers share while they measure the seeds, block by block, and then the peaks. */
typedef struct seed_task {
    qm_search *search;
    const qm_side *side;
    size_t block_seeds;
    mtx_t lock;
    seed_list peaks; /* guarded by lock while seeds are measured */
    uint32_t hint;   /* of the last seed */
} seed_task;

/** Inserts a seed in the list of the farthest. */
static void keep_farthest(seed_list *list, seed s)
{
    QM_ASSERT(list->count >= 0 && list->count <= PEAK_COUNT);
    if (list->count == PEAK_COUNT && s.distance <= list->at[PEAK_COUNT - 1].distance) return;
    int index = list->count < PEAK_COUNT ? list->count++ : PEAK_COUNT - 1;
    for (; index > 0 && list->at[index - 1].distance < s.distance; index--)
        list->at[index] = list->at[index - 1];
    list->at[index] = s;
}

/** The point of a face of the source that is measured for all of it: of a triangle the midpoint of the longest
 * edge, where a flat face is farthest from a curved surface that its corners touch. */
static qm_vec face_centre(const qm_vec *corner, int count)
{
    if (count == 4) {
        qm_bilinear patch = qm_bilinear_make(corner);
        return qm_bilinear_at(&patch, 0.5, 0.5);
    }
    double longest2 = -1.0;
    qm_vec midpoint = corner[0];
    for (int i = 0; i < 3; i++) {
        qm_vec from = corner[i], to = corner[(i + 1) % 3];
        double length2 = qm_vec_norm2(qm_vec_sub(to, from));
        if (length2 <= longest2) continue;
        longest2 = length2;
        midpoint = qm_vec_mix(from, to, 0.5);
    }
    return midpoint;
}

qm_vec qm_sample_pack_centre(const qm_side *side, uint32_t pack, uint32_t *face)
{
    QM_ASSERT(pack < side->source->pack_count);
    const qm_pack_lanes *lanes = &side->source->lanes[pack];
    uint32_t lane = lanes->lane_count / 2u;
    if (side->source_patches && qm_lane_is_second(lanes, lane)) lane--;
    *face = lanes->face[lane];
    qm_vec corner[4];
    return face_centre(corner, qm_side_corners(side, lanes, lane, corner));
}

static seed measure_centre(qm_worker *worker, const qm_side *side, uint32_t pack, uint32_t hint)
{
    uint32_t face;
    qm_vec p = qm_sample_pack_centre(side, pack, &face);
    double lower = qm_search_local_lower(worker->search, side);
    double distance = qm_sample_point(worker, side, p, 0.0, face, QM_CLOSE_SHARE * lower, &hint);
    return (seed){distance, pack, hint};
}

/** Measures a point unless the pack of the hint shows that it is below the lower bound. */
static void measure_point(qm_worker *worker, const qm_side *side, qm_vec p, uint32_t face, uint32_t *hint)
{
    double lower = qm_search_local_lower(worker->search, side);
    if (qm_sample_pack_upper(worker->search->kernel, side, *hint, p) > lower)
        qm_sample_point(worker, side, p, 0.0, face, 0.0, hint);
}

static void measure_seeds(void *data, int worker, size_t block)
{
    seed_task *shared = data;
    const qm_side *side = shared->side;
    size_t first = block * shared->block_seeds, end = first + shared->block_seeds;
    end = end < side->seed_count ? end : side->seed_count;
    seed_list own = {0};
    /* A guess: two surfaces that are compared mostly run alike along their curves. */
    seed s = {.hint =
                  (uint32_t)(first * side->seed_step * side->target->pack_count / side->source->pack_count)};
    for (size_t i = first; i < end; i++) {
        qm_seed measured = {INFINITY, s.hint};
        if (!qm_worker_must_stop(&shared->search->workers[worker])) {
            s = measure_centre(&shared->search->workers[worker], side, (uint32_t)(i * side->seed_step),
                               s.hint);
            keep_farthest(&own, s);
            measured = (qm_seed){s.distance, s.hint};
        }
        if (side->seeds) side->seeds[i] = measured;
    }
    mtx_lock(&shared->lock);
    for (int i = 0; i < own.count; i++)
        keep_farthest(&shared->peaks, own.at[i]);
    if (end == side->seed_count) shared->hint = s.hint;
    mtx_unlock(&shared->lock);
}

/** Finds the farthest pack near a peak of the sparse sample, along the curve, and measures the vertices and
 * the centres of all its faces. */
static void measure_peak(void *data, int index, size_t peak_index)
{
    const seed_task *shared = data;
    const qm_side *side = shared->side;
    qm_worker *worker = &shared->search->workers[index];
    seed peak = shared->peaks.at[peak_index], best = peak;
    if (side->seed_step > 1) {
        size_t count = side->source->pack_count, half = side->seed_step / 2;
        size_t begin = peak.pack > half ? peak.pack - half : 0;
        size_t end = peak.pack + half < count ? peak.pack + half : count;
        size_t stride = (end - begin) / CLOSER_COUNT + 1;
        for (size_t i = begin; i < end && !qm_worker_must_stop(worker); i += stride) {
            seed s = measure_centre(worker, side, (uint32_t)i, best.hint);
            if (s.distance > best.distance) best = s;
        }
    }
    const qm_pack_lanes *lanes = &side->source->lanes[best.pack];
    for (int lane = 0, count; lane < lanes->lane_count && !qm_worker_must_stop(worker); lane += count - 2) {
        qm_vec corner[4];
        uint32_t face = lanes->face[lane];
        count = qm_side_corners(side, lanes, (uint32_t)lane, corner);
        measure_point(worker, side, face_centre(corner, count), face, &best.hint);
        for (int i = 0; i < count; i++)
            measure_point(worker, side, corner[i], face, &best.hint);
    }
}

uint32_t qm_sample_seeds(qm_context *ctx, qm_search *search, qm_side *side)
{
    size_t packs = side->source->pack_count;
    int workers = search->worker_count;
    side->seed_step = packs > SEED_COUNT ? packs / SEED_COUNT : 1;
    side->seed_count = (packs + side->seed_step - 1) / side->seed_step;
    side->seeds = qm_context_alloc(ctx, side->seed_count, sizeof *side->seeds);
    seed_task shared = {.search = search, .side = side};
    shared.block_seeds = workers > 1 ? SHARED_SEEDS : side->seed_count;
    mtx_init(&shared.lock, mtx_plain);
    size_t blocks = (side->seed_count + shared.block_seeds - 1) / shared.block_seeds;
    qm_context_parallel_for(ctx, workers, blocks, measure_seeds, &shared);
    qm_context_parallel_for(ctx, workers, (size_t)shared.peaks.count, measure_peak, &shared);
    mtx_destroy(&shared.lock);
    return shared.hint;
}

void qm_sample_free_seeds(qm_context *ctx, qm_side *side)
{
    qm_context_free(ctx, side->seeds, side->seed_count, sizeof *side->seeds);
    side->seeds = NULL;
}
