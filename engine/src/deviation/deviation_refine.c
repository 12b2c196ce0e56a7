#include "deviation_refine.h"

#include <string.h>

#include "core/rounding.h"
#include "deviation_shape.h"

#define MAX_ROUNDS 64
#define PATCH_SHARE 0.25    /* of the accuracy: what cutting the target's patches may cost, */
#define FLAT_SHARE 0x1p-4   /* what triangles in place of the source's patches may, with 1 at most for it, */
#define SPREAD_SHARE 0x1p-6 /* and what their areas may differ */
#define COARSE_SHARE 0.5    /* of the accuracy: triangles that cost more are given up */
#define STRAY_SHARE 0.25    /* of the accuracy: what functions over a ground are opened by */
#define BEND_SHARE 4.0 /* of the accuracy: what linear functions over the cells of a piece may leave open */
#define GAP_SHARE 0.05 /* of what is open: what cutting a piece along facets need not bring yet */
#define CUT_ROOM 4     /* pieces that there must be room for, for each that is cut in a round */
#define LEAST_CUT 1024 /* a round looks at all pieces: of so many there must be room to cut one */
#define PARTS_ROOM 2   /* of the room for parts that each of them has on average: most need less */
#define CHUNK 64       /* pieces that a worker takes at a time to bound */
#define BATCH 256      /* pieces that are cut before their parts are put in place */
#define BATCH_CHUNK 4

struct qm_batch_part {
    int count;
    double leak;
    qm_source_piece piece[QM_PIECE_PARTS];
    qm_piece_bounds bounds[QM_PIECE_PARTS];
};

/* ---- pieces ---- */

/** Makes an array larger when it has too few places, by half at least. *array is moved, and as large as
 * *capacity in any case. */
static bool grow(qm_context *ctx, void *array, size_t *capacity, size_t count, size_t width)
{
    void *old;
    if (count <= *capacity) return true;
    if (count < *capacity + *capacity / 2) count = *capacity + *capacity / 2;
    memcpy(&old, array, sizeof old);
    void *larger = qm_context_resize(ctx, old, *capacity, count, width);
    if (!larger) return false;
    memcpy(array, &larger, sizeof larger);
    *capacity = count;
    return true;
}

/** Room for so many pieces. */
qm_status qm_refinement_reserve(qm_refinement *work, size_t count)
{
    qm_context *ctx = work->ctx;
    bool has_room = grow(ctx, &work->piece, &work->piece_capacity, count, sizeof *work->piece) &&
                    grow(ctx, &work->bounds, &work->bounds_capacity, count, sizeof *work->bounds);
    return has_room ? QM_OK : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the pieces");
}

static void free_pieces(qm_refinement *work)
{
    qm_context_free(work->ctx, work->piece, work->piece_capacity, sizeof *work->piece);
    qm_context_free(work->ctx, work->bounds, work->bounds_capacity, sizeof *work->bounds);
    work->piece = NULL;
    work->bounds = NULL;
    work->piece_capacity = work->bounds_capacity = 0;
}

/** A piece for every triangle of the source, in the order of its tree, in which neighbours follow one
 * another. */
static qm_status make_pieces(qm_refinement *work)
{
    const qm_bvh *a = work->maker.source;
    size_t lanes = 0;
    for (size_t i = 0; i < a->pack_count; i++)
        lanes += a->lanes[i].lane_count;
    work->limit = lanes + work->piece_limit;
    work->count = 0;
    work->leak = 0.0;
    qm_status status = qm_refinement_reserve(work, lanes);
    if (status != QM_OK) return status;
    for (size_t i = 0; i < a->pack_count; i++)
        for (uint32_t lane = 0; lane < a->lanes[i].lane_count; lane++)
            work->piece[work->count++] =
                qm_piece_first(&work->maker, a->lanes[i].face[lane], qm_lane_is_second(&a->lanes[i], lane));
    return QM_OK;
}

/** Takes the next few of what all workers share; false when there are no more. */
static bool take_chunk(qm_refinement *work, size_t size, size_t limit, size_t *begin, size_t *end)
{
    *begin = atomic_fetch_add(&work->next, size);
    if (*begin >= limit || qm_context_canceled(work->ctx)) return false;
    *end = limit - *begin < size ? limit : *begin + size;
    return true;
}

static void bound_chunks(void *data, int worker)
{
    (void)worker;
    qm_refinement *work = data;
    qm_piece_desk desk;
    desk.searches = 0;
    for (size_t i, end; take_chunk(work, CHUNK, work->count, &i, &end);)
        for (desk.hint = 0; i < end; i++)
            qm_piece_bound(&work->maker, &work->piece[i], &desk, &work->bounds[i]);
    atomic_fetch_add(&work->searches, desk.searches);
}

static void split_chunks(void *data, int worker)
{
    (void)worker;
    qm_refinement *work = data;
    qm_piece_desk desk;
    desk.searches = 0;
    for (size_t i, end; take_chunk(work, BATCH_CHUNK, work->end - work->begin, &i, &end);)
        for (desk.hint = 0; i < end; i++) {
            qm_batch_part *parts = &work->parts[i];
            parts->count = qm_piece_split(&work->maker, &work->piece[work->todo[work->begin + i].place],
                                          &desk, parts->piece, parts->bounds, &parts->leak);
        }
    atomic_fetch_add(&work->searches, desk.searches);
}

static qm_status run_workers(qm_refinement *work, void (*task)(void *data, int worker))
{
    qm_context *ctx = work->ctx;
    atomic_store(&work->next, 0);
    if (ctx->parallel && work->thread_count > 1)
        ctx->parallel(ctx->parallel_user, work->thread_count, task, work);
    else
        task(work, 0);
    return qm_context_canceled(ctx) ? qm_context_fail(ctx, QM_E_CANCELED, "deviation canceled") : QM_OK;
}

/* ---- rounds ---- */

static bool is_narrow(const qm_refinement *work, qm_interval value)
{
    return value.upper - value.lower <= work->accuracy * value.lower + 8.0 * work->maker.eta;
}

/** Puts the parts of a batch in the places of their pieces and at the end, as long as there is room. */
static void place_parts(qm_refinement *work)
{
    for (size_t i = work->begin; i < work->end; i++) {
        const qm_batch_part *parts = &work->parts[i - work->begin];
        if (work->count + (size_t)parts->count - 1 > work->limit) continue;
        size_t place = work->todo[i].place;
        work->leak += parts->leak;
        work->piece[place] = parts->piece[0];
        work->bounds[place] = parts->bounds[0];
        for (int k = 1; k < parts->count; k++) {
            work->piece[work->count] = parts->piece[k];
            work->bounds[work->count++] = parts->bounds[k];
        }
    }
}

/** Splits what is listed. */
static qm_status split_pieces(qm_refinement *work)
{
    qm_status status = QM_OK;
    for (work->begin = 0; status == QM_OK && work->begin < work->todo_count; work->begin = work->end) {
        size_t rest = work->todo_count - work->begin, needed = work->count;
        work->end = work->begin + (rest < BATCH ? rest : BATCH);
        status = run_workers(work, split_chunks);
        for (size_t i = 0; status == QM_OK && i < work->end - work->begin; i++)
            needed += (size_t)work->parts[i].count - 1;
        if (status == QM_OK)
            status = qm_refinement_reserve(work, needed < work->limit ? needed : work->limit);
        if (status == QM_OK) place_parts(work);
    }
    return status;
}

/** What the next round need not care about, at a mean distance that is about typical. */
static void set_errors(qm_refinement *work, double typical, double gap)
{
    double open = work->accuracy * typical, least = 4.0 * work->maker.eta;
    work->maker.patch_error = fmax(least, PATCH_SHARE * open);
    work->maker.stray_error = fmax(least, STRAY_SHARE * open);
    work->maker.bend_error = fmax(least, BEND_SHARE * open);
    work->maker.worth = fmax(least, fmax(open, GAP_SHARE * gap));
}

static qm_status run_round(qm_refinement *work, const qm_piece_totals *totals, qm_cut_choice choice)
{
    double facets =
        (double)QM_PACK_LANES * (double)(work->maker.source->pack_count + work->maker.target->pack_count);
    size_t parts = 1 + PARTS_ROOM * (work->limit - work->count) / choice.count;
    work->maker.part_limit = parts < QM_PIECE_PARTS ? (int)parts : QM_PIECE_PARTS;
    work->maker.cell_area = totals->area.upper / facets;
    set_errors(work, qm_clamp(work->typical, totals->mean.lower, totals->mean.upper),
               totals->mean.upper - totals->mean.lower);
    if (!grow(work->ctx, &work->todo, &work->todo_capacity, choice.count, sizeof *work->todo))
        return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the pieces");
    qm_cuts_list(work->piece, qm_refinement_list(work), totals, choice, work->todo);
    work->todo_count = choice.count;
    return split_pieces(work);
}

/** What no distance is above, cracks between the pieces included. */
static void lower_farthest(qm_refinement *work)
{
    double crack = QM_CRACK_ROUNDINGS * QM_UNIT_ROUNDING * work->maker.reach;
    work->farthest = fmin(work->farthest, qm_piece_greatest(qm_refinement_list(work)).upper + crack);
}

/** True when triangles leave too much of the mean open, as they do where it was estimated too high. */
static bool is_too_coarse(const qm_refinement *work, const qm_piece_totals *totals)
{
    return 2.0 * work->flat_slack > COARSE_SHARE * fmin(work->accuracy, 1.0) * totals->mean.upper &&
           work->flat_slack > 4.0 * work->maker.eta;
}

/** Cuts pieces until the accuracy is reached or the pieces run out, or the triangles are too coarse. */
static qm_status run_rounds(qm_refinement *work)
{
    qm_status status = QM_OK;
    for (int round = 0; status == QM_OK && round < MAX_ROUNDS; round++) {
        lower_farthest(work);
        qm_piece_totals totals = qm_piece_sum(qm_refinement_list(work));
        work->is_accurate = is_narrow(work, totals.mean) && is_narrow(work, totals.rms);
        double sharp = work->accuracy * QM_BLUR_ROOM * totals.mean.lower + 8.0 * work->maker.eta;
        if (is_too_coarse(work, &totals) || (work->is_accurate && totals.blur <= sharp)) break;
        size_t room = (work->limit - work->count) / CUT_ROOM;
        qm_cut_choice choice =
            qm_cuts_choose(work->piece, qm_refinement_list(work), &totals, work->accuracy, room);
        if (choice.count == 0 || room < work->count / LEAST_CUT) break;
        status = run_round(work, &totals, choice);
    }
    return status;
}

/** An area that is most of its upper bound is certain. So is one of folded patches, whose normals cancel,
 * when rounding makes but a small part of that bound: a normal changes linearly, and is not short everywhere
 * when it is long in a corner. */
static bool has_area(const qm_refinement *work)
{
    qm_interval area = qm_piece_sum(qm_refinement_list(work)).area;
    if (area.lower > 0.5 * area.upper) return true;
    double rounding = 0.0;
    for (size_t i = 0; i < work->count; i++)
        rounding += qm_piece_area_rounding(&work->maker, &work->piece[i]);
    return area.upper > 4.0 * rounding;
}

/** How much of the mean the triangles in place of patches leave open: the mean slack over the area. */
static double find_flat_slack(const qm_refinement *work)
{
    double sum = 0.0;
    for (size_t i = 0; work->maker.source_patches && i < work->count; i++)
        if (work->piece[i].is_flat)
            sum += qm_piece_face_load(&work->maker, &work->piece[i]).slack * work->bounds[i].area_high;
    return sum > 0.0 ? sum / qm_piece_sum(qm_refinement_list(work)).area.upper : 0.0;
}

/** Makes the first pieces and bounds them. */
static qm_status start(qm_refinement *work)
{
    double accuracy = fmin(work->accuracy, 1.0);
    set_errors(work, work->typical, 0.0);
    work->maker.flat_error = fmax(4.0 * work->maker.eta, FLAT_SHARE * accuracy * work->typical);
    work->maker.flat_spread = SPREAD_SHARE * accuracy;
    qm_status status = make_pieces(work);
    if (status == QM_OK) status = run_workers(work, bound_chunks);
    if (status != QM_OK) return status;
    work->farthest = qm_piece_greatest(qm_refinement_list(work)).upper;
    work->has_area = has_area(work);
    work->flat_slack = find_flat_slack(work);
    return QM_OK;
}

/** Makes all pieces again for the typical mean; keeps the old ones if the call is canceled meanwhile. */
static qm_status start_anew(qm_refinement *work)
{
    qm_refinement old;
    memcpy(&old, work, sizeof old);
    work->piece = NULL;
    work->bounds = NULL;
    work->piece_capacity = work->bounds_capacity = 0;
    qm_status status = start(work);
    qm_refinement *given_up = status == QM_E_CANCELED ? work : &old;
    free_pieces(given_up);
    if (given_up == work) {
        atomic_store(&old.searches, atomic_load(&work->searches));
        memcpy(work, &old, sizeof old);
    }
    return status;
}

/** Cuts the pieces. If triangles are too coarse, makes all pieces again for the mean's lower bound. */
static qm_status cut_pieces(qm_refinement *work)
{
    qm_status status = run_rounds(work);
    qm_piece_totals totals = qm_piece_sum(qm_refinement_list(work));
    if (status != QM_OK || !is_too_coarse(work, &totals)) return status;
    work->typical = totals.mean.lower;
    status = start_anew(work);
    return status == QM_OK ? run_rounds(work) : status;
}

qm_status qm_refinement_run(qm_refinement *work)
{
    qm_status status = start(work);
    if (status != QM_OK || !work->has_area) return status;
    work->parts = qm_context_alloc(work->ctx, BATCH, sizeof *work->parts);
    if (!work->parts) return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the pieces");
    status = cut_pieces(work);
    qm_context_free(work->ctx, work->parts, BATCH, sizeof *work->parts);
    work->parts = NULL;
    /* The pieces that a canceled round had not put in place yet are whole, and their bounds hold. */
    work->is_canceled = status == QM_E_CANCELED;
    return work->is_canceled ? QM_OK : status;
}

void qm_refinement_reset(qm_refinement *work)
{
    free_pieces(work);
    qm_context_free(work->ctx, work->todo, work->todo_capacity, sizeof *work->todo);
    work->todo = NULL;
    work->todo_capacity = 0;
}
