/**
 * hausdorff_scout.c: a good lower bound before the search starts. Everything that the search does is the
 * cheaper the nearer the lower bound is to the distance, and distances vary little from face to face: so a
 * sparse sample of the whole source tells where to look closer.
 */
#include "hausdorff_search.h"
#include "prim/bilinear_point.h"

#define SEED_COUNT 1024 /* packs measured at their middles, spread along the Hilbert curve */
#define SHARED_SEEDS 32 /* seeds that one of several workers takes at once */
#define PEAK_COUNT 16   /* of the seeds, the farthest, round which more is measured */
#define CLOSER_COUNT 16 /* packs round a peak measured at their middles */

/** A pack of the source whose middle was measured. */
typedef struct seed {
    double distance;
    uint32_t pack, hint;
} seed;

typedef struct seed_list {
    int count;
    seed at[PEAK_COUNT]; /* farthest first */
} seed_list;

/** What the workers share: they measure the seeds, block by block, and then the peaks of all. */
typedef struct scout {
    qm_search *search;
    const qm_side *side;
    size_t block_seeds;
    mtx_t lock;
    seed_list peaks; /* guarded by lock while seeds are measured */
    uint32_t hint;   /* of the last seed */
} scout;

static void keep_farthest(seed_list *list, seed s)
{
    if (list->count == PEAK_COUNT && s.distance <= list->at[PEAK_COUNT - 1].distance) return;
    int place = list->count < PEAK_COUNT ? list->count++ : PEAK_COUNT - 1;
    for (; place > 0 && list->at[place - 1].distance < s.distance; place--)
        list->at[place] = list->at[place - 1];
    list->at[place] = s;
}

/** Where a flat face lies farthest from a curved surface that its corners touch. */
static qm_vec longest_edge_middle(const qm_vec corner[3])
{
    double longest2 = -1.0;
    qm_vec middle = corner[0];
    for (int i = 0; i < 3; i++) {
        qm_vec from = corner[i], to = corner[(i + 1) % 3];
        double length2 = qm_vec_norm2(qm_vec_sub(to, from));
        if (length2 <= longest2) continue;
        longest2 = length2;
        middle = qm_vec_mix(from, to, 0.5);
    }
    return middle;
}

/** A point in the middle of a face of the source. */
static qm_vec middle_of(const qm_vec *corner, int count)
{
    if (count == 3) return longest_edge_middle(corner);
    qm_bilinear patch = qm_bilinear_make(corner);
    return qm_bilinear_at(&patch, 0.5, 0.5);
}

qm_vec qm_side_middle(const qm_side *side, uint32_t pack, uint32_t *face)
{
    const qm_pack_lanes *lanes = &side->source->lanes[pack];
    uint32_t lane = lanes->lane_count / 2u;
    if (side->source_patches && qm_lane_is_second(lanes, lane)) lane--;
    *face = lanes->face[lane];
    qm_vec corner[4];
    return middle_of(corner, qm_side_corners(side, lanes, lane, corner));
}

static seed measure_middle(qm_worker *worker, const qm_side *side, uint32_t pack, uint32_t hint)
{
    uint32_t face;
    qm_vec p = qm_side_middle(side, pack, &face);
    double lower = qm_side_lower(worker->search, side);
    double distance = qm_worker_sample(worker, side, p, 0.0, face, QM_NEAR_ENOUGH * lower, &hint);
    return (seed){distance, pack, hint};
}

/** Measures a point when the pack of the hint does not show that it lies below the lower bound. */
static void measure_point(qm_worker *worker, const qm_side *side, qm_vec p, uint32_t face, uint32_t *hint)
{
    double lower = qm_side_lower(worker->search, side);
    if (qm_side_pack_upper(worker->search, side, *hint, p) > lower)
        qm_worker_sample(worker, side, p, 0.0, face, 0.0, hint);
}

/** Measures the vertices and the middles of all faces of a pack. */
static void measure_pack(qm_worker *worker, const qm_side *side, seed s)
{
    const qm_pack_lanes *lanes = &side->source->lanes[s.pack];
    for (int lane = 0, count; lane < lanes->lane_count && !qm_worker_must_stop(worker); lane += count - 2) {
        qm_vec corner[4];
        uint32_t face = lanes->face[lane];
        count = qm_side_corners(side, lanes, (uint32_t)lane, corner);
        measure_point(worker, side, middle_of(corner, count), face, &s.hint);
        for (int i = 0; i < count; i++)
            measure_point(worker, side, corner[i], face, &s.hint);
    }
}

/** Goes from a peak of the sparse sample to the farthest pack near it on the curve. */
static seed look_closer(qm_worker *worker, const qm_side *side, seed peak, size_t step)
{
    size_t count = side->source->pack_count, half = step / 2;
    size_t begin = peak.pack > half ? peak.pack - half : 0;
    size_t end = peak.pack + half < count ? peak.pack + half : count;
    size_t stride = (end - begin) / CLOSER_COUNT + 1;
    seed best = peak;
    for (size_t i = begin; i < end && !qm_worker_must_stop(worker); i += stride) {
        seed s = measure_middle(worker, side, (uint32_t)i, best.hint);
        if (s.distance > best.distance) best = s;
    }
    return best;
}

static void measure_seeds(void *data, int worker, size_t block)
{
    scout *shared = data;
    const qm_side *side = shared->side;
    size_t first = block * shared->block_seeds, end = first + shared->block_seeds;
    end = end < side->seed_count ? end : side->seed_count;
    seed_list own = {0};
    /* Two surfaces that are compared mostly lie alike along their curves. */
    seed s = {.hint =
                  (uint32_t)(first * side->seed_step * side->target->pack_count / side->source->pack_count)};
    for (size_t i = first; i < end; i++) {
        qm_seed measured = {INFINITY, s.hint};
        if (!qm_worker_must_stop(&shared->search->workers[worker])) {
            s = measure_middle(&shared->search->workers[worker], side, (uint32_t)(i * side->seed_step),
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

static void measure_peak(void *data, int index, size_t place)
{
    const scout *shared = data;
    qm_worker *worker = &shared->search->workers[index];
    seed peak = shared->peaks.at[place];
    size_t step = shared->side->seed_step;
    if (step > 1) peak = look_closer(worker, shared->side, peak, step);
    measure_pack(worker, shared->side, peak);
}

uint32_t qm_search_seed_lower(qm_context *ctx, qm_search *search, qm_side *side)
{
    size_t packs = side->source->pack_count;
    int workers = search->worker_count;
    side->seed_step = packs > SEED_COUNT ? packs / SEED_COUNT : 1;
    side->seed_count = (packs + side->seed_step - 1) / side->seed_step;
    side->seeds = qm_context_alloc(ctx, side->seed_count, sizeof *side->seeds);
    scout shared = {.search = search, .side = side};
    shared.block_seeds = workers > 1 ? SHARED_SEEDS : side->seed_count;
    mtx_init(&shared.lock, mtx_plain);
    size_t blocks = (side->seed_count + shared.block_seeds - 1) / shared.block_seeds;
    qm_context_share(ctx, workers, blocks, measure_seeds, &shared);
    qm_context_share(ctx, workers, (size_t)shared.peaks.count, measure_peak, &shared);
    mtx_destroy(&shared.lock);
    return shared.hint;
}

void qm_side_reset_seeds(qm_context *ctx, qm_side *side)
{
    qm_context_free(ctx, side->seeds, side->seed_count, sizeof *side->seeds);
    side->seeds = NULL;
}
