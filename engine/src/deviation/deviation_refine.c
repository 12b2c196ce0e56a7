/**
 * deviation_refine.c: the rounds. Each chooses the pieces that leave most of mean, rms, area and distribution
 * open, cuts them in batches on all threads, and writes their parts into the list in the order of the pieces,
 * so that the result does not depend on threads.
 */
#include "deviation_refine.h"

#include <stdlib.h>
#include <string.h>

#include "core/rounding.h"

#define MAX_ROUNDS 64
#define PATCH_SHARE 0.25    /* of the accuracy: may be lost to uncut patches of the target, */
#define FLAT_SHARE 0x1p-4   /* to triangles in place of the source's patches, for an accuracy of at most 1, */
#define SPREAD_SHARE 0x1p-6 /* and to their areas */
#define COARSE_SHARE 0.5    /* of the accuracy: triangles that cost more are given up */
#define MARGIN_SHARE 0.25   /* of the accuracy: base_margin */
#define BEND_SHARE 4.0      /* of the accuracy: the linear error in the cells of a piece */
#define GAP_SHARE 0.05      /* of the width of the mean: smaller gains are left to later rounds */
#define ROOM_A_CUT 4        /* pieces that there must be room for, for each that is cut in a round */
#define MIN_CUT_SHARE 1024  /* pieces: a round, which visits all, must have room to cut one of this many */
#define ROOM_A_PART 2       /* of the room for parts that each of them has on average: most need less */
#define KEPT_SHARE 0.7      /* of the accuracy: pieces that together leave no more open are not cut */
#define EXPONENTS 4096      /* of doubles */
#define EXPONENT_BIAS 2100
#define BLUR_ROOM 8.0 /* the mean blur may be this many accuracies of the mean */
#define CHUNK 64      /* pieces that a worker takes at a time to bound */
#define BATCH 256     /* pieces that are cut before their parts are stored */
#define BATCH_CHUNK 4

struct qm_batch_part {
    int count;
    double leak;
    qm_deviation_piece piece[QM_DEVIATION_PARTS];
    qm_deviation_bounds bounds[QM_DEVIATION_PARTS];
};

/* ---- pieces ---- */

/** Enlarges an array that has room for less than count, by half at least. *array is moved, and as large as
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
    const qm_bvh *a = work->setup.source;
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
            work->piece[work->count++] = qm_deviation_piece_first(&work->setup, a->lanes[i].face[lane],
                                                                  qm_lane_is_second(&a->lanes[i], lane));
    return QM_OK;
}

/** Takes the next few indices below limit, which all workers share; false when there are no more. */
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
    qm_deviation_workspace workspace;
    workspace.searches = 0;
    for (size_t i, end; take_chunk(work, CHUNK, work->count, &i, &end);)
        for (workspace.hint = 0; i < end; i++)
            qm_deviation_piece_bound(&work->setup, &work->piece[i], &workspace, &work->bounds[i]);
    atomic_fetch_add(&work->searches, workspace.searches);
}

static void split_chunks(void *data, int worker)
{
    (void)worker;
    qm_refinement *work = data;
    qm_deviation_workspace workspace;
    workspace.searches = 0;
    for (size_t i, end; take_chunk(work, BATCH_CHUNK, work->end - work->begin, &i, &end);)
        for (workspace.hint = 0; i < end; i++) {
            qm_batch_part *parts = &work->parts[i];
            parts->count =
                qm_deviation_piece_split(&work->setup, &work->piece[work->todo[work->begin + i].index],
                                         &workspace, parts->piece, parts->bounds, &parts->leak);
        }
    atomic_fetch_add(&work->searches, workspace.searches);
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

/* ---- which pieces are cut ---- */

/** Which pieces are cut: those that leave more open than an exponent of two says, and of those at it the
 * first few; count of them in all. */
typedef struct cut_choice {
    int exponent;
    size_t count, at_exponent;
} cut_choice;

/** The width that a piece adds to mean, rms, area and distribution, as a share of them. */
static double uncertainty(const qm_deviation_bounds *piece, const qm_deviation_totals *totals)
{
    double mean = 0.5 * (totals->mean.lower + totals->mean.upper);
    double square = 0.5 * (totals->rms.lower * totals->rms.lower + totals->rms.upper * totals->rms.upper);
    double open = 2.0 * (piece->area_high - piece->area_low);
    if (mean > 0.0) open += (piece->mean_high - piece->mean_low + piece->blur / BLUR_ROOM) / mean;
    if (square > 0.0) open += 0.5 * (piece->square_high - piece->square_low) / square;
    return open / totals->area.upper;
}

static int exponent_of(double open)
{
    int exponent = 0;
    if (open > 0.0) frexp(open, &exponent);
    return open > 0.0 ? (int)qm_clamp(exponent + EXPONENT_BIAS, 0, EXPONENTS - 1) : 0;
}

/**
 * Chooses the pieces that leave most open of mean, rms, area and distribution: the others together leave no
 * more than a share of the accuracy, or there is no room for more. Pieces at their last depth are
 * never chosen.
 */
static cut_choice choose_cuts(const qm_deviation_piece *piece, qm_deviation_piece_list pieces,
                              const qm_deviation_totals *totals, double accuracy, size_t room)
{
    double open[EXPONENTS] = {0}, sum = 0.0;
    size_t count[EXPONENTS] = {0};
    for (size_t i = 0; i < pieces.count; i++) {
        double here = uncertainty(&pieces.bounds[i], totals);
        int exponent = exponent_of(here);
        sum += here;
        open[exponent] += here;
        count[exponent] += piece[i].depth < QM_DEVIATION_DEPTH;
    }
    double kept = KEPT_SHARE * fmin(accuracy, sum), rest = sum;
    cut_choice choice = {.exponent = EXPONENTS};
    while (choice.exponent > 1 && rest > kept && choice.count < room) {
        size_t here = count[--choice.exponent], left = room - choice.count;
        choice.at_exponent = here < left ? here : left;
        choice.count += choice.at_exponent;
        rest -= open[choice.exponent];
    }
    return choice;
}

static int compare_uncertainty(const void *a, const void *b)
{
    const qm_open_piece *one = a, *two = b;
    if (one->open != two->open) return one->open > two->open ? -1 : 1;
    return (one->index > two->index) - (one->index < two->index);
}

/** Lists the chosen pieces, those first that leave most open; todo has room for choice.count. */
static void list_cuts(const qm_deviation_piece *piece, qm_deviation_piece_list pieces,
                      const qm_deviation_totals *totals, cut_choice choice, qm_open_piece *todo)
{
    size_t listed = 0;
    for (size_t i = 0; i < pieces.count; i++) {
        if (piece[i].depth >= QM_DEVIATION_DEPTH) continue;
        double open = uncertainty(&pieces.bounds[i], totals);
        int exponent = exponent_of(open);
        if (exponent < choice.exponent || (exponent == choice.exponent && choice.at_exponent == 0)) continue;
        if (exponent == choice.exponent) choice.at_exponent--;
        todo[listed++] = (qm_open_piece){i, open};
    }
    qsort(todo, listed, sizeof *todo, compare_uncertainty);
}

/* ---- rounds ---- */

static bool is_narrow(const qm_refinement *work, qm_interval value)
{
    return value.upper - value.lower <= work->accuracy * value.lower + 8.0 * work->setup.eta;
}

/** Stores the parts of a batch, in the slots of their pieces and at the end, while there is room. */
static void store_parts(qm_refinement *work)
{
    for (size_t i = work->begin; i < work->end; i++) {
        const qm_batch_part *parts = &work->parts[i - work->begin];
        if (work->count + (size_t)parts->count - 1 > work->limit) continue;
        size_t index = work->todo[i].index;
        QM_ASSERT(parts->count >= 1 && parts->count <= QM_DEVIATION_PARTS && !(parts->leak < 0.0));
        work->leak += parts->leak;
        QM_ASSERT(work->count + (size_t)parts->count - 1 <= work->piece_capacity);
        work->piece[index] = parts->piece[0];
        work->bounds[index] = parts->bounds[0];
        for (int k = 1; k < parts->count; k++) {
            work->piece[work->count] = parts->piece[k];
            work->bounds[work->count++] = parts->bounds[k];
        }
    }
}

/** Splits the pieces of todo, batch by batch. */
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
        if (status == QM_OK) store_parts(work);
    }
    return status;
}

/** Sets the errors that the next round may leave, for a mean distance of about typical. */
static void set_errors(qm_refinement *work, double typical, double gap)
{
    double open = work->accuracy * typical, min = 4.0 * work->setup.eta;
    work->setup.patch_error = fmax(min, PATCH_SHARE * open);
    work->setup.base_margin = fmax(min, MARGIN_SHARE * open);
    work->setup.bend_error = fmax(min, BEND_SHARE * open);
    work->setup.worth = fmax(min, fmax(open, GAP_SHARE * gap));
}

static qm_status run_round(qm_refinement *work, const qm_deviation_totals *totals, cut_choice choice)
{
    double facets =
        (double)QM_PACK_LANES * (double)(work->setup.source->pack_count + work->setup.target->pack_count);
    size_t parts = 1 + ROOM_A_PART * (work->limit - work->count) / choice.count;
    work->setup.part_limit = parts < QM_DEVIATION_PARTS ? (int)parts : QM_DEVIATION_PARTS;
    work->setup.cell_area = totals->area.upper / facets;
    set_errors(work, qm_clamp(work->typical, totals->mean.lower, totals->mean.upper),
               totals->mean.upper - totals->mean.lower);
    if (!grow(work->ctx, &work->todo, &work->todo_capacity, choice.count, sizeof *work->todo))
        return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the pieces");
    list_cuts(work->piece, qm_refinement_list(work), totals, choice, work->todo);
    work->todo_count = choice.count;
    return split_pieces(work);
}

/** True when triangles leave too much of the mean open, as they do where it was estimated too high. */
static bool is_too_coarse(const qm_refinement *work, const qm_deviation_totals *totals)
{
    return 2.0 * work->flat_slack > COARSE_SHARE * fmin(work->accuracy, 1.0) * totals->mean.upper &&
           work->flat_slack > 4.0 * work->setup.eta;
}

/** Cuts pieces until the accuracy is reached or the pieces run out, or the triangles are too coarse. */
static qm_status run_rounds(qm_refinement *work)
{
    qm_status status = QM_OK;
    double crack = QM_CRACK_ROUNDINGS * QM_UNIT_ROUNDING * work->setup.extent;
    for (int round = 0; status == QM_OK && round < MAX_ROUNDS; round++) {
        /* No distance is greater, cracks between the pieces included. */
        work->farthest = fmin(work->farthest, qm_deviation_max(qm_refinement_list(work)).upper + crack);
        qm_deviation_totals totals = qm_deviation_sum(qm_refinement_list(work));
        work->is_accurate = is_narrow(work, totals.mean) && is_narrow(work, totals.rms);
        double sharp = work->accuracy * BLUR_ROOM * totals.mean.lower + 8.0 * work->setup.eta;
        if (is_too_coarse(work, &totals) || (work->is_accurate && totals.blur <= sharp)) break;
        size_t room = (work->limit - work->count) / ROOM_A_CUT;
        cut_choice choice = choose_cuts(work->piece, qm_refinement_list(work), &totals, work->accuracy, room);
        if (choice.count == 0 || room < work->count / MIN_CUT_SHARE) break;
        status = run_round(work, &totals, choice);
    }
    return status;
}

/** An area that is most of its upper bound is certain. So is one of folded patches, whose normals cancel,
 * when rounding makes but a small part of that bound: a normal changes linearly, and is not short everywhere
 * when it is long in a corner. */
static bool has_area(const qm_refinement *work)
{
    qm_interval area = qm_deviation_sum(qm_refinement_list(work)).area;
    if (area.lower > 0.5 * area.upper) return true;
    double rounding = 0.0;
    for (size_t i = 0; i < work->count; i++)
        rounding += qm_deviation_piece_area_rounding(&work->setup, &work->piece[i]);
    return area.upper > 4.0 * rounding;
}

/** How much of the mean the triangles in place of patches leave open: the mean slack over the area. */
static double find_flat_slack(const qm_refinement *work)
{
    double sum = 0.0;
    for (size_t i = 0; work->setup.source_patches && i < work->count; i++)
        if (work->piece[i].is_flat)
            sum += qm_deviation_face_load(&work->setup, &work->piece[i]).slack * work->bounds[i].area_high;
    return sum > 0.0 ? sum / qm_deviation_sum(qm_refinement_list(work)).area.upper : 0.0;
}

/** Makes the first pieces and bounds them. */
static qm_status start(qm_refinement *work)
{
    double accuracy = fmin(work->accuracy, 1.0);
    set_errors(work, work->typical, 0.0);
    work->setup.flat_error = fmax(4.0 * work->setup.eta, FLAT_SHARE * accuracy * work->typical);
    work->setup.flat_spread = SPREAD_SHARE * accuracy;
    qm_status status = make_pieces(work);
    if (status == QM_OK) status = run_workers(work, bound_chunks);
    if (status != QM_OK) return status;
    work->farthest = qm_deviation_max(qm_refinement_list(work)).upper;
    work->has_area = has_area(work);
    work->flat_slack = find_flat_slack(work);
    return QM_OK;
}

/** Makes all pieces again for the typical mean; keeps the old ones if the call is canceled meanwhile. */
static qm_status restart(qm_refinement *work)
{
    qm_refinement old;
    memcpy(&old, work, sizeof old);
    work->piece = NULL;
    work->bounds = NULL;
    work->piece_capacity = work->bounds_capacity = 0;
    qm_status status = start(work);
    qm_refinement *discarded = status == QM_E_CANCELED ? work : &old;
    free_pieces(discarded);
    if (discarded == work) {
        atomic_store(&old.searches, atomic_load(&work->searches));
        memcpy(work, &old, sizeof old);
    }
    return status;
}

/** Cuts the pieces. If triangles are too coarse, makes all pieces again for the mean's lower bound. */
static qm_status cut_pieces(qm_refinement *work)
{
    qm_status status = run_rounds(work);
    qm_deviation_totals totals = qm_deviation_sum(qm_refinement_list(work));
    if (status != QM_OK || !is_too_coarse(work, &totals)) return status;
    work->typical = totals.mean.lower;
    status = restart(work);
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
    /* The pieces whose parts a canceled round has not stored yet are complete, and their bounds hold. */
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
