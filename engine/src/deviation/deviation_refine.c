/**
 * deviation_refine.c: the rounds. Each surveys the pieces, chooses those that leave most of mean, rms, area and
 * distribution open, cuts them in batches on all threads, and writes their parts into the list in the order of
 * the pieces, so that the result does not depend on threads. A call that is canceled ends at once with the last
 * survey: nothing that visits all pieces follows.
 */
#include "deviation_refine.h"

#include <string.h>

#include "core/rounding.h"

#define MAX_ROUNDS 64
#define MAX_OPEN_ROUNDS 40
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
#define KEPT_SHARE 0.95     /* of the accuracy: pieces that together leave no more open are not cut */
#define EXPONENTS 4096      /* of doubles */
#define EXPONENT_BIAS 2100
#define BLUR_ROOM 8.0 /* the mean blur may be this many accuracies of the mean */
#define CANCEL_STRIDE 0x1000
#define CHUNK 64  /* pieces that a worker takes at a time to bound */
#define BATCH 256 /* pieces that are cut before their parts are stored */
#define BATCH_CHUNK 4

struct qm_batch_part {
    int count;
    double leak;
    qm_deviation_piece piece[QM_DEVIATION_PARTS];
    qm_deviation_bounds bounds[QM_DEVIATION_PARTS];
};

static qm_status check_canceled(qm_context *ctx)
{
    return qm_context_canceled(ctx) ? qm_context_fail(ctx, QM_E_CANCELED, "deviation canceled") : QM_OK;
}

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
    for (size_t i = 0; status == QM_OK && i < a->pack_count; i++) {
        for (uint32_t lane = 0; lane < a->lanes[i].lane_count; lane++)
            work->piece[work->count++] = qm_deviation_piece_first(&work->setup, a->lanes[i].face[lane],
                                                                  qm_lane_is_second(&a->lanes[i], lane));
        if (i % (CANCEL_STRIDE / QM_PACK_LANES) == 0) status = check_canceled(work->ctx);
    }
    return status;
}

/** Takes the next few indices below limit, which all workers share; false when there are no more. */
static bool take_chunk(qm_refinement *work, size_t size, size_t limit, size_t *begin, size_t *end)
{
    *begin = atomic_fetch_add(&work->next, size);
    if (*begin >= limit) return false;
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
        for (workspace.hint = 0; i < end && !qm_context_canceled(work->ctx); i++)
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
        for (workspace.hint = 0; i < end && !qm_context_canceled(work->ctx); i++) {
            qm_batch_part *parts = &work->parts[i];
            parts->count = qm_deviation_piece_split(&work->setup, &work->piece[work->todo[work->begin + i]],
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
    return check_canceled(ctx);
}

/* ---- which pieces are cut ---- */

/** The width that a piece adds to mean, rms, area and distribution, as a share of them. */
static double uncertainty(const qm_deviation_bounds *piece, const qm_deviation_survey *survey)
{
    double mean = 0.5 * (survey->mean.lower + survey->mean.upper);
    double square = 0.5 * (survey->rms.lower * survey->rms.lower + survey->rms.upper * survey->rms.upper);
    double open = 2.0 * (piece->area_high - piece->area_low);
    if (mean > 0.0) open += (piece->mean_high - piece->mean_low + piece->blur / BLUR_ROOM) / mean;
    if (square > 0.0) open += 0.5 * (piece->square_high - piece->square_low) / square;
    return open / survey->area.upper;
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
 * never chosen. They are listed by exponents of two, the greatest first, and in their order for each of these, in
 * which neighbours follow one another. Returns as qm_refinement_run.
 */
static qm_status choose_cuts(qm_refinement *work, size_t room)
{
    double open[EXPONENTS] = {0}, sum = 0.0;
    size_t count[EXPONENTS] = {0}, begin[EXPONENTS], chosen = 0;
    for (size_t i = 0; i < work->count; i++) {
        if (i % CANCEL_STRIDE == 0 && qm_context_canceled(work->ctx)) return check_canceled(work->ctx);
        double here = uncertainty(&work->bounds[i], &work->survey);
        int exponent = exponent_of(here);
        sum += here;
        open[exponent] += here;
        count[exponent] += work->piece[i].depth < QM_DEVIATION_DEPTH;
    }
    double kept = KEPT_SHARE * fmin(work->accuracy, sum), rest = sum;
    int last = EXPONENTS; /* of two: the least one that is chosen */
    while (last > 1 && rest > kept && chosen < room) {
        begin[--last] = chosen;
        /* Of the least exponent no more than are needed. */
        double share = open[last] > rest - kept ? (rest - kept) / open[last] : 1.0;
        size_t most = (size_t)ceil(share * (double)count[last]);
        count[last] = most < room - chosen ? most : room - chosen;
        chosen += count[last];
        rest -= open[last];
    }
    work->todo_count = chosen;
    if (!grow(work->ctx, &work->todo, &work->todo_capacity, chosen, sizeof *work->todo))
        return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the pieces");
    for (size_t i = 0; i < work->count; i++) {
        if (i % CANCEL_STRIDE == 0 && qm_context_canceled(work->ctx)) return check_canceled(work->ctx);
        if (work->piece[i].depth >= QM_DEVIATION_DEPTH) continue;
        int exponent = exponent_of(uncertainty(&work->bounds[i], &work->survey));
        if (exponent < last || count[exponent] == 0) continue;
        work->todo[begin[exponent]++] = i;
        count[exponent]--;
    }
    return QM_OK;
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
        size_t index = work->todo[i];
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

/** Cuts the pieces that are chosen. */
static qm_status run_round(qm_refinement *work)
{
    const qm_deviation_survey *survey = &work->survey;
    double facets =
        (double)QM_PACK_LANES * (double)(work->setup.source->pack_count + work->setup.target->pack_count);
    size_t parts = 1 + ROOM_A_PART * (work->limit - work->count) / work->todo_count;
    work->setup.part_limit = parts < QM_DEVIATION_PARTS ? (int)parts : QM_DEVIATION_PARTS;
    work->setup.cell_area = survey->area.upper / facets;
    set_errors(work, qm_clamp(work->typical, survey->mean.lower, survey->mean.upper),
               survey->mean.upper - survey->mean.lower);
    return split_pieces(work);
}

/** True when triangles leave too much of the mean open, as they do where it was estimated too high. */
static bool is_too_coarse(const qm_refinement *work)
{
    return 2.0 * work->flat_slack > COARSE_SHARE * fmin(work->accuracy, 1.0) * work->survey.mean.upper &&
           work->flat_slack > 4.0 * work->setup.eta;
}

qm_status qm_refinement_survey(qm_refinement *work)
{
    double crack = QM_CRACK_ROUNDINGS * QM_UNIT_ROUNDING * work->setup.extent;
    qm_status status = qm_deviation_survey_pieces(work->ctx, qm_refinement_list(work), &work->survey);
    /* No distance is greater, cracks between the pieces included. */
    if (status == QM_OK) work->farthest = fmin(work->farthest, work->survey.max.upper + crack);
    return status;
}

/** Cuts pieces until the accuracy is reached or the pieces run out, or the triangles are too coarse. */
static qm_status run_rounds(qm_refinement *work)
{
    for (int round = 0;; round++) {
        qm_status status = qm_refinement_survey(work);
        if (status != QM_OK) return status;
        if (work->on_survey) work->on_survey(work->user);
        const qm_deviation_survey *survey = &work->survey;
        work->is_accurate = is_narrow(work, survey->mean) && is_narrow(work, survey->rms);
        double sharp = work->accuracy * BLUR_ROOM * survey->mean.lower + 8.0 * work->setup.eta;
        if (is_too_coarse(work) || (work->is_accurate && survey->blur <= sharp)) return QM_OK;
        size_t room = (work->limit - work->count) / ROOM_A_CUT;
        if (room < work->count / MIN_CUT_SHARE || round == MAX_ROUNDS) return QM_OK;
        status = choose_cuts(work, room);
        if (status != QM_OK || work->todo_count == 0) return status;
        status = run_round(work);
        if (status != QM_OK) return status;
    }
}

/** An area that is most of its upper bound is certain. So is one of folded patches, whose normals cancel,
 * when rounding makes but a small part of that bound: a normal changes linearly, and is not short everywhere
 * when it is long in a corner. */
static qm_status find_area(qm_refinement *work)
{
    qm_interval area = work->survey.area;
    double rounding = 0.0;
    work->has_area = area.lower > 0.5 * area.upper;
    for (size_t i = 0; !work->has_area && i < work->count; i++) {
        if (i % CANCEL_STRIDE == 0 && qm_context_canceled(work->ctx)) return check_canceled(work->ctx);
        rounding += qm_deviation_piece_area_rounding(&work->setup, &work->piece[i]);
    }
    work->has_area |= area.upper > 4.0 * rounding;
    return QM_OK;
}

/** How much of the mean the triangles in place of patches leave open: the mean slack over the area. */
static qm_status find_flat_slack(qm_refinement *work)
{
    double sum = 0.0;
    for (size_t i = 0; work->setup.source_patches && i < work->count; i++) {
        if (i % CANCEL_STRIDE == 0 && qm_context_canceled(work->ctx)) return check_canceled(work->ctx);
        if (work->piece[i].is_flat)
            sum += qm_deviation_face_load(&work->setup, &work->piece[i]).slack * work->bounds[i].area_high;
    }
    work->flat_slack = sum > 0.0 ? sum / work->survey.area.upper : 0.0;
    return QM_OK;
}

/** Makes the first pieces, bounds and surveys them. */
static qm_status start(qm_refinement *work)
{
    double accuracy = fmin(work->accuracy, 1.0);
    set_errors(work, work->typical, 0.0);
    work->setup.flat_error = fmax(4.0 * work->setup.eta, FLAT_SHARE * accuracy * work->typical);
    work->setup.flat_spread = SPREAD_SHARE * accuracy;
    qm_status status = make_pieces(work);
    if (status == QM_OK) status = run_workers(work, bound_chunks);
    if (status == QM_OK) status = qm_refinement_survey(work);
    /* Nothing has been cut: there are no cracks. */
    if (status == QM_OK) work->farthest = fmin(work->farthest, work->survey.max.upper);
    if (status == QM_OK) status = find_area(work);
    return status == QM_OK ? find_flat_slack(work) : status;
}

/** Cuts the pieces. If triangles are too coarse, makes all pieces again for the mean's lower bound. */
static qm_status cut_pieces(qm_refinement *work)
{
    qm_status status = run_rounds(work);
    if (status != QM_OK || !is_too_coarse(work)) return status;
    work->typical = work->survey.mean.lower;
    status = start(work);
    return status == QM_OK ? run_rounds(work) : status;
}

qm_status qm_refinement_init(qm_refinement *work, const qm_bvh *a, const qm_bvh *b, qm_quad_reading reading)
{
    qm_status status = qm_deviation_setup_init(work->ctx, a, b, reading, &work->setup);
    if (status != QM_OK) return status;
    /* Both surfaces are in a cube with edges of twice the extent. The normal Q_s x Q_t of a patch in it is no
     * longer than the square of its diagonal. */
    double extent = work->setup.extent, faces = (double)a->mesh.face_count;
    work->farthest = 4.0 * extent;
    qm_deviation_survey_init(&work->survey, work->farthest,
                             16.0 * faces * extent * extent * work->setup.area_unit);
    return QM_OK;
}

qm_status qm_refinement_run(qm_refinement *work, const double *vertex_distance)
{
    qm_status status = qm_deviation_survey_vertices(work->ctx, &work->setup, vertex_distance, &work->survey);
    if (status == QM_OK) status = start(work);
    if (status != QM_OK || !work->has_area) return status;
    work->parts = qm_context_alloc(work->ctx, BATCH, sizeof *work->parts);
    if (!work->parts) return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the pieces");
    status = cut_pieces(work);
    qm_context_free(work->ctx, work->parts, BATCH, sizeof *work->parts);
    work->parts = NULL;
    return status;
}

qm_status qm_refinement_cut(qm_refinement *work, const uint8_t *marks, size_t *count)
{
    size_t room = (work->limit - work->count) / ROOM_A_CUT, marked = 0;
    *count = 0;
    for (size_t i = 0; i < work->count; i++)
        marked += marks[i] != 0 && work->piece[i].depth < QM_DEVIATION_DEPTH;
    marked = marked < room ? marked : room;
    if (marked == 0) return QM_OK;
    if (!grow(work->ctx, &work->todo, &work->todo_capacity, marked, sizeof *work->todo))
        return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the pieces");
    work->todo_count = 0;
    for (size_t i = 0; work->todo_count < marked; i++)
        if (marks[i] && work->piece[i].depth < QM_DEVIATION_DEPTH) work->todo[work->todo_count++] = i;
    *count = marked;
    work->parts = qm_context_alloc(work->ctx, BATCH, sizeof *work->parts);
    if (!work->parts) return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the pieces");
    qm_status status = run_round(work);
    qm_context_free(work->ctx, work->parts, BATCH, sizeof *work->parts);
    work->parts = NULL;
    return status;
}

/** Marks the open pieces that leave more open than their part of what may be left. Returns how many. */
static size_t mark_open(const qm_refinement *work, qm_refinement_open_fn *find_open, const void *user,
                        uint8_t *marks)
{
    size_t open = 0, marked = 0;
    for (size_t i = 0; i < work->count; i++) {
        marks[i] = find_open(user, i) >= 0.0;
        open += marks[i];
    }
    double least = QM_OPEN_SHARE * fmin(work->accuracy, 1.0) / (double)(open > 0 ? open : 1);
    for (size_t i = 0; i < work->count; i++) {
        marks[i] = marks[i] && find_open(user, i) > least;
        marked += marks[i];
    }
    return marked;
}

qm_status qm_refinement_cut_open(qm_refinement *work, qm_refinement_open_fn *find_open,
                                 qm_refinement_after_fn *after, const void *user)
{
    qm_status status = QM_OK;
    for (int round = 0; status == QM_OK && round < MAX_OPEN_ROUNDS; round++) {
        size_t count = work->count, cut = 0;
        uint8_t *marks = qm_context_alloc(work->ctx, count, 1);
        if (!marks) return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the pieces");
        size_t marked = mark_open(work, find_open, user, marks);
        if (marked > 0) status = qm_refinement_cut(work, marks, &cut);
        qm_status then = after ? after(user, marks, count) : QM_OK;
        if (status == QM_OK) status = then;
        qm_context_free(work->ctx, marks, count, 1);
        if (cut < marked || marked == 0 || work->count == count) break;
    }
    return status;
}

void qm_refinement_reset(qm_refinement *work)
{
    qm_context_free(work->ctx, work->piece, work->piece_capacity, sizeof *work->piece);
    qm_context_free(work->ctx, work->bounds, work->bounds_capacity, sizeof *work->bounds);
    work->piece = NULL;
    work->bounds = NULL;
    work->piece_capacity = work->bounds_capacity = 0;
    qm_context_free(work->ctx, work->todo, work->todo_capacity, sizeof *work->todo);
    work->todo = NULL;
    work->todo_capacity = 0;
}
