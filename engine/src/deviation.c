/**
 * deviation.c: the call: checks, the maximum, the vertices, then rounds that cut the pieces with the greatest
 * share in what is still open and bound their parts.
 */
#include "qm/deviation.h"

#include <stdlib.h>
#include <string.h>

#include "deviation_sum.h"
#include "hausdorff_search.h"

#define PATCH_ROUNDINGS 2e-13  /* what a certified distance to a patch may be off by, local (project.c) */
#define SEARCH_WORK (1u << 18) /* steps of the search for the maximum, which is one figure among others */
#define SEARCH_WORK_PER_PACK 512
#define MAX_ROUNDS 64
#define KEPT_SHARE 0.7   /* of the accuracy: pieces that together leave no more open are not cut */
#define PATCH_SHARE 0.25 /* of the accuracy: what cutting the target's patches may cost */
#define GAP_SHARE 0.05   /* of what is open: what cutting a piece along facets need not bring yet */
#define CUT_ROOM 4       /* pieces that there must be room for, for each that is cut in a round */
#define PARTS_ROOM 2     /* of the room for parts that each of them has on average: most need less */
#define CHUNK 64         /* pieces that a worker takes at a time to bound */
#define BATCH 256        /* pieces that are split before their parts are put in place */
#define BATCH_CHUNK 4
#define EXPONENTS 4096 /* of doubles */
#define EXPONENT_BIAS 2100

qm_deviation_options qm_deviation_options_default(void)
{
    return (qm_deviation_options){.accuracy = 1e-2, .piece_limit = 1u << 20, .thread_count = 1};
}

/** A piece to split, and what it leaves open. */
typedef struct open_piece {
    size_t place;
    double open;
} open_piece;

/** Parts of one piece. */
typedef struct batch_part {
    int count;
    qm_source_piece piece[QM_PIECE_PARTS];
    qm_piece_bounds bounds[QM_PIECE_PARTS];
} batch_part;

/** What the stages of a call share. */
typedef struct deviation_work {
    qm_context *ctx;
    const qm_bvh *a, *b;
    const qm_deviation_options *options;
    qm_deviation *out;
    qm_piece_maker maker;
    qm_source_piece *piece;
    qm_piece_bounds *bounds;
    size_t count, limit;
    size_t piece_capacity, bounds_capacity; /* allocated */
    open_piece *todo;                       /* places of the pieces to split, todo_capacity allocated */
    size_t todo_count, todo_capacity;
    size_t begin, end;  /* the batch: todo[begin] to todo[end - 1] */
    batch_part *parts;  /* of each piece of the batch */
    atomic_size_t next; /* piece to bound, or place of todo */
    _Atomic uint64_t searches;
} deviation_work;

/* ---- checks ---- */

static qm_status check_options(qm_context *ctx, const qm_deviation_options *options)
{
    if (!(options->accuracy > 0.0) || !isfinite(options->accuracy))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "accuracy must be a positive number, got %g",
                               options->accuracy);
    for (size_t i = 0; i < options->percentile_count; i++)
        if (!(options->percentile[i] > 0.0 && options->percentile[i] <= 100.0))
            return qm_context_fail(ctx, QM_E_ARGUMENT, "a percentile lies above 0 and at 100 at most, got %g",
                                   options->percentile[i]);
    return QM_OK;
}

/* ---- the maximum and the vertices ---- */

static qm_status find_maximum(deviation_work *work)
{
    const qm_deviation_options *options = work->options;
    qm_hausdorff_options search = qm_hausdorff_options_default();
    search.direction = QM_A_TO_B;
    search.quads = options->quads;
    search.tolerance = options->tolerance;
    search.thread_count = options->thread_count;
    search.work_limit =
        SEARCH_WORK + SEARCH_WORK_PER_PACK * (uint64_t)(work->a->pack_count + work->b->pack_count);
    search.progress = options->progress;
    search.progress_user = options->progress_user;
    qm_hausdorff_result found;
    qm_status status = qm_hausdorff_measure(work->ctx, work->a, work->b, &search, &found);
    if (status != QM_OK) return status;
    if (found.stop == QM_STOP_CANCELED)
        return qm_context_fail(work->ctx, QM_E_CANCELED, "deviation canceled");
    work->out->max = (qm_interval){found.lower, found.upper};
    atomic_fetch_add(&work->searches, found.projections);
    return QM_OK;
}

static qm_status find_vertex_distances(deviation_work *work)
{
    const qm_mesh *mesh = &work->a->mesh;
    qm_deviation *out = work->out;
    out->vertex_count = mesh->vertex_count;
    out->vertex_distance = qm_context_alloc(work->ctx, mesh->vertex_count, sizeof *out->vertex_distance);
    if (!out->vertex_distance)
        return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the vertices");
    qm_projection projection = {.distance = out->vertex_distance};
    atomic_fetch_add(&work->searches, mesh->vertex_count);
    return qm_project_points(work->ctx, work->b, work->options->quads, mesh->positions, mesh->vertex_count,
                             work->options->thread_count, &projection);
}

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
static qm_status reserve(deviation_work *work, size_t count)
{
    qm_context *ctx = work->ctx;
    bool has_room = grow(ctx, &work->piece, &work->piece_capacity, count, sizeof *work->piece) &&
                    grow(ctx, &work->bounds, &work->bounds_capacity, count, sizeof *work->bounds);
    return has_room ? QM_OK : qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the pieces");
}

/** A piece for every triangle of the source, in the order of its tree, in which neighbours follow one
 * another. */
static qm_status make_pieces(deviation_work *work)
{
    const qm_bvh *a = work->a;
    size_t lanes = 0;
    for (size_t i = 0; i < a->pack_count; i++)
        lanes += a->lanes[i].lane_count;
    work->limit = lanes + work->options->piece_limit;
    qm_status status = reserve(work, lanes);
    if (status != QM_OK) return status;
    for (size_t i = 0; i < a->pack_count; i++)
        for (uint32_t lane = 0; lane < a->lanes[i].lane_count; lane++)
            work->piece[work->count++] =
                qm_piece_first(&work->maker, a->lanes[i].face[lane], a->lanes[i].second >> lane & 1);
    return QM_OK;
}

/** Takes the next few of what all workers share; false when there are no more. */
static bool take_chunk(deviation_work *work, size_t size, size_t limit, size_t *begin, size_t *end)
{
    *begin = atomic_fetch_add(&work->next, size);
    if (*begin >= limit || qm_context_canceled(work->ctx)) return false;
    *end = limit - *begin < size ? limit : *begin + size;
    return true;
}

static void bound_chunks(void *data, int worker)
{
    (void)worker;
    deviation_work *work = data;
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
    deviation_work *work = data;
    qm_piece_desk desk;
    desk.searches = 0;
    for (size_t i, end; take_chunk(work, BATCH_CHUNK, work->end - work->begin, &i, &end);)
        for (desk.hint = 0; i < end; i++) {
            batch_part *parts = &work->parts[i];
            parts->count = qm_piece_split(&work->maker, &work->piece[work->todo[work->begin + i].place],
                                          &desk, parts->piece, parts->bounds);
        }
    atomic_fetch_add(&work->searches, desk.searches);
}

static qm_status run_workers(deviation_work *work, void (*task)(void *data, int worker))
{
    qm_context *ctx = work->ctx;
    atomic_store(&work->next, 0);
    if (ctx->parallel && work->options->thread_count > 1)
        ctx->parallel(ctx->parallel_user, work->options->thread_count, task, work);
    else
        task(work, 0);
    return qm_context_canceled(ctx) ? qm_context_fail(ctx, QM_E_CANCELED, "deviation canceled") : QM_OK;
}

static qm_piece_list list_pieces(const deviation_work *work)
{
    return (qm_piece_list){work->bounds, work->count};
}

/* ---- rounds ---- */

static bool is_narrow(const deviation_work *work, qm_interval value)
{
    return value.upper - value.lower <= work->options->accuracy * value.lower + 8.0 * work->maker.eta;
}

/** What a piece leaves open of mean, rms and area, as shares of them. */
static double openness(const qm_piece_bounds *piece, const qm_piece_totals *totals)
{
    double mean = 0.5 * (totals->mean.lower + totals->mean.upper);
    double square = 0.5 * (totals->rms.lower * totals->rms.lower + totals->rms.upper * totals->rms.upper);
    double open = 2.0 * (piece->area_high - piece->area_low);
    if (mean > 0.0) open += (piece->mean_high - piece->mean_low) / mean;
    if (square > 0.0) open += 0.5 * (piece->square_high - piece->square_low) / square;
    return open / totals->area.upper;
}

static int exponent_of(double open)
{
    int exponent = 0;
    if (open > 0.0) frexp(open, &exponent);
    return open > 0.0 ? (int)qm_clamp(exponent + EXPONENT_BIAS, 0, EXPONENTS - 1) : 0;
}

/** Which pieces are cut: those above an exponent, and of those at it the first few. */
typedef struct cut_choice {
    int exponent;
    size_t count, at_exponent;
} cut_choice;

/**
 * Chooses the pieces that leave most open: the others together leave no more than a share of the accuracy, or
 * there is no room for more parts.
 */
static cut_choice choose_cuts(const deviation_work *work, const qm_piece_totals *totals)
{
    double open[EXPONENTS] = {0}, sum = 0.0;
    size_t count[EXPONENTS] = {0};
    size_t room = (work->limit - work->count) / CUT_ROOM;
    for (size_t i = 0; i < work->count; i++) {
        double here = openness(&work->bounds[i], totals);
        int exponent = exponent_of(here);
        sum += here;
        open[exponent] += here;
        count[exponent] += work->piece[i].depth < QM_PIECE_DEPTH;
    }
    double kept = KEPT_SHARE * fmin(work->options->accuracy, sum), rest = sum;
    cut_choice choice = {.exponent = EXPONENTS};
    while (choice.exponent > 1 && rest > kept && choice.count < room) {
        size_t here = count[--choice.exponent], left = room - choice.count;
        choice.at_exponent = here < left ? here : left;
        choice.count += choice.at_exponent;
        rest -= open[choice.exponent];
    }
    return choice;
}

static int compare_openness(const void *a, const void *b)
{
    const open_piece *one = a, *two = b;
    if (one->open != two->open) return one->open > two->open ? -1 : 1;
    return (one->place > two->place) - (one->place < two->place);
}

/** Lists the chosen pieces, those first that leave most open. */
static qm_status list_cuts(deviation_work *work, const qm_piece_totals *totals, cut_choice choice)
{
    if (!grow(work->ctx, &work->todo, &work->todo_capacity, choice.count, sizeof *work->todo))
        return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the pieces");
    work->todo_count = 0;
    for (size_t i = 0; i < work->count; i++) {
        if (work->piece[i].depth >= QM_PIECE_DEPTH) continue;
        double open = openness(&work->bounds[i], totals);
        int exponent = exponent_of(open);
        if (exponent < choice.exponent || (exponent == choice.exponent && choice.at_exponent == 0)) continue;
        if (exponent == choice.exponent) choice.at_exponent--;
        work->todo[work->todo_count++] = (open_piece){i, open};
    }
    qsort(work->todo, work->todo_count, sizeof *work->todo, compare_openness);
    return QM_OK;
}

/** Puts the parts of a batch in the places of their pieces and at the end, as long as there is room. */
static void place_parts(deviation_work *work)
{
    for (size_t i = work->begin; i < work->end; i++) {
        const batch_part *parts = &work->parts[i - work->begin];
        if (work->count + (size_t)parts->count - 1 > work->limit) continue;
        size_t place = work->todo[i].place;
        work->piece[place] = parts->piece[0];
        work->bounds[place] = parts->bounds[0];
        for (int k = 1; k < parts->count; k++) {
            work->piece[work->count] = parts->piece[k];
            work->bounds[work->count++] = parts->bounds[k];
        }
    }
}

/** Splits what is listed. */
static qm_status split_pieces(deviation_work *work)
{
    qm_status status = QM_OK;
    for (work->begin = 0; status == QM_OK && work->begin < work->todo_count; work->begin = work->end) {
        size_t rest = work->todo_count - work->begin, needed = work->count;
        work->end = work->begin + (rest < BATCH ? rest : BATCH);
        status = run_workers(work, split_chunks);
        for (size_t i = 0; status == QM_OK && i < work->end - work->begin; i++)
            needed += (size_t)work->parts[i].count - 1;
        if (status == QM_OK) status = reserve(work, needed < work->limit ? needed : work->limit);
        if (status == QM_OK) place_parts(work);
    }
    return status;
}

/** The mean over the vertices, which tells about what the mean over the surface will be. */
static double mean_of_vertices(const deviation_work *work)
{
    double sum = 0.0;
    for (size_t i = 0; i < work->out->vertex_count; i++)
        sum += work->out->vertex_distance[i];
    return work->out->vertex_count > 0 ? sum / (double)work->out->vertex_count * work->b->frame.scale : 0.0;
}

/** What the next round need not care about, at a mean distance that is about typical. */
static void set_errors(deviation_work *work, double typical, double gap)
{
    double open = work->options->accuracy * typical, least = 4.0 * work->maker.eta;
    work->maker.patch_error = fmax(least, PATCH_SHARE * open);
    work->maker.worth = fmax(least, fmax(open, GAP_SHARE * gap));
}

static qm_status run_round(deviation_work *work, const qm_piece_totals *totals, cut_choice choice)
{
    double facets = (double)QM_PACK_LANES * (double)(work->a->pack_count + work->b->pack_count);
    size_t parts = 1 + PARTS_ROOM * (work->limit - work->count) / choice.count;
    work->maker.part_limit = parts < QM_PIECE_PARTS ? (int)parts : QM_PIECE_PARTS;
    work->maker.cell_area = totals->area.upper / facets;
    set_errors(work, qm_clamp(mean_of_vertices(work), totals->mean.lower, totals->mean.upper),
               totals->mean.upper - totals->mean.lower);
    qm_status status = list_cuts(work, totals, choice);
    return status == QM_OK ? split_pieces(work) : status;
}

static qm_status run_rounds(deviation_work *work)
{
    qm_status status = QM_OK;
    for (int round = 0; status == QM_OK && round < MAX_ROUNDS; round++) {
        qm_piece_totals totals = qm_piece_sum(list_pieces(work));
        if (!(totals.area.lower > 0.5 * totals.area.upper)) break;
        work->out->is_accurate = is_narrow(work, totals.mean) && is_narrow(work, totals.rms);
        if (work->out->is_accurate) break;
        cut_choice choice = choose_cuts(work, &totals);
        if (choice.count == 0) break;
        status = run_round(work, &totals, choice);
    }
    return status;
}

static qm_status refine(deviation_work *work)
{
    work->maker.greatest = work->out->max.upper * work->b->frame.scale;
    set_errors(work, work->maker.greatest, 0.0);
    qm_status status = make_pieces(work);
    if (status == QM_OK) status = run_workers(work, bound_chunks);
    if (status != QM_OK) return status;
    work->parts = qm_context_alloc(work->ctx, BATCH, sizeof *work->parts);
    if (!work->parts) return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the pieces");
    status = run_rounds(work);
    qm_context_free(work->ctx, work->parts, BATCH, sizeof *work->parts);
    return status;
}

/* ---- points ---- */

/** Marks the vertices that count: all of a point set, else those that a face uses. */
static void mark_vertices(const qm_mesh *mesh, uint8_t *is_used)
{
    memset(is_used, mesh->face_count == 0, mesh->vertex_count);
    for (size_t i = 0; i < 4 * mesh->face_count; i++)
        if (mesh->faces[i] != QM_NO_INDEX) is_used[mesh->faces[i]] = 1;
}

/** The points themselves in place of pieces. */
static qm_status take_points(deviation_work *work, qm_measure measure)
{
    const qm_mesh *mesh = &work->a->mesh;
    uint8_t *is_used = qm_context_alloc(work->ctx, mesh->vertex_count, 1);
    double scale = work->b->frame.scale,
           eta = work->maker.eta + (work->maker.target_patches ? PATCH_ROUNDINGS : 0.0);
    work->count = 0;
    qm_status status = is_used ? reserve(work, mesh->vertex_count) : QM_E_NO_MEMORY;
    if (status == QM_OK) {
        mark_vertices(mesh, is_used);
        for (size_t i = 0; i < mesh->vertex_count; i++)
            if (is_used[i])
                work->bounds[work->count++] =
                    qm_piece_bound_point(scale * work->out->vertex_distance[i], eta);
    }
    qm_context_free(work->ctx, is_used, mesh->vertex_count, 1);
    work->out->measure = measure;
    work->out->is_accurate = true;
    return status == QM_OK ? QM_OK : qm_context_fail(work->ctx, status, "out of memory for the points");
}

/** True when rounding hides whether A has an area at all. */
static bool has_no_area(const deviation_work *work)
{
    qm_interval area = qm_piece_sum(list_pieces(work)).area;
    return !(area.lower > 0.5 * area.upper);
}

/* ---- the result ---- */

static void scale_interval(qm_interval *interval, double scale)
{
    interval->lower = fmax(0.0, interval->lower) * scale;
    interval->upper *= scale;
}

static qm_status set_distribution(deviation_work *work)
{
    const qm_deviation_options *options = work->options;
    qm_deviation *out = work->out;
    qm_context *ctx = work->ctx;
    double inverse_scale = work->b->frame.inverse_scale, greatest = out->max.upper * work->b->frame.scale;
    out->percentile_count = options->percentile_count;
    out->bin_count = options->bin_count;
    out->percentile = qm_context_alloc(ctx, out->percentile_count, sizeof *out->percentile);
    out->bin = qm_context_alloc(ctx, out->bin_count, sizeof *out->bin);
    if ((out->percentile_count > 0 && !out->percentile) || (out->bin_count > 0 && !out->bin))
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the distribution");
    qm_status status = qm_piece_percentiles(ctx, list_pieces(work), greatest, options->percentile,
                                            out->percentile_count, out->percentile);
    if (status == QM_OK)
        status = qm_piece_histogram(ctx, list_pieces(work), greatest, out->bin_count, out->bin);
    for (size_t i = 0; status == QM_OK && i < out->percentile_count; i++)
        scale_interval(&out->percentile[i], inverse_scale);
    if (out->bin_count > 0) out->bin_width = out->max.upper / (double)out->bin_count;
    return status;
}

static void set_totals(deviation_work *work)
{
    qm_deviation *out = work->out;
    double inverse_scale = work->b->frame.inverse_scale;
    qm_piece_totals totals = qm_piece_sum(list_pieces(work));
    out->mean = totals.mean;
    out->rms = totals.rms;
    out->size = totals.area;
    scale_interval(&out->mean, inverse_scale);
    scale_interval(&out->rms, inverse_scale);
    if (out->measure == QM_OVER_AREA)
        scale_interval(&out->size, inverse_scale * inverse_scale);
    else
        out->size.lower = out->size.upper = (double)work->count;
    out->pieces = work->count;
    out->projections = atomic_load(&work->searches);
}

static qm_status run(deviation_work *work)
{
    qm_status status = qm_piece_maker_init(work->ctx, work->a, work->b, work->options->quads, &work->maker);
    if (status == QM_OK) status = find_maximum(work);
    if (status == QM_OK) status = find_vertex_distances(work);
    if (status != QM_OK) return status;
    if (work->a->mesh.face_count == 0) {
        status = take_points(work, QM_OVER_POINTS);
    } else {
        status = refine(work);
        if (status == QM_OK && has_no_area(work)) status = take_points(work, QM_OVER_VERTICES);
    }
    if (status == QM_OK) status = set_distribution(work);
    if (status == QM_OK) set_totals(work);
    return status;
}

qm_status qm_deviation_measure(qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                               const qm_deviation_options *options, qm_deviation *out)
{
    QM_ASSERT(ctx && a && b && options && out);
    *out = (qm_deviation){0};
    qm_status status = check_options(ctx, options);
    if (status != QM_OK) return status;
    double start_ms = qm_clock_ms();
    deviation_work work = {.ctx = ctx, .a = a, .b = b, .options = options, .out = out};
    status = run(&work);
    qm_context_free(ctx, work.piece, work.piece_capacity, sizeof *work.piece);
    qm_context_free(ctx, work.bounds, work.bounds_capacity, sizeof *work.bounds);
    qm_context_free(ctx, work.todo, work.todo_capacity, sizeof *work.todo);
    out->elapsed_ms = qm_clock_ms() - start_ms;
    if (status != QM_OK) qm_deviation_reset(ctx, out);
    return status;
}

void qm_deviation_reset(qm_context *ctx, qm_deviation *deviation)
{
    qm_context_free(ctx, deviation->percentile, deviation->percentile_count, sizeof *deviation->percentile);
    qm_context_free(ctx, deviation->bin, deviation->bin_count, sizeof *deviation->bin);
    qm_context_free(ctx, deviation->vertex_distance, deviation->vertex_count,
                    sizeof *deviation->vertex_distance);
    *deviation = (qm_deviation){0};
}
