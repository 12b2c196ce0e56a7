/**
 * deviation.c: the call: checks, the vertices, rounds that cut the pieces with the greatest share in what is
 * still open and bound their parts, then the maximum.
 *
 * The pieces bound the maximum too, if not closely; a search narrows it afterwards. It takes a share of the
 * work: steps for half of the vertices and pieces that there were, and a few thousand besides. Two spheres of
 * 2,400 packs take 5,784, and scans 1,000; a step costs about what a piece does, also where both are slow.
 * Work is counted, not timed, so that equal calls have equal results. Where the search ends before its
 * time the bracket is wider than the tolerance, and holds.
 */
#include "qm/deviation.h"

#include <float.h>
#include <string.h>

#include "core/clock.h"
#include "core/rounding.h"
#include "deviation_refine.h"

#define SEARCH_WORK 4096 /* steps of the search for the maximum */
#define SEARCH_SHARE 0.5 /* further steps for each vertex and each piece */

/** The state that the stages of a call share. */
typedef struct deviation_work {
    qm_context *ctx;
    const qm_bvh *a, *b;
    const qm_deviation_options *options;
    qm_deviation *out;
    double start_ms;
    qm_refinement refinement;
} deviation_work;

qm_deviation_options qm_deviation_options_default(void)
{
    return (qm_deviation_options){.accuracy = 1e-2, .piece_limit = 1u << 20, .thread_count = 1};
}

/* ---- checks ---- */

static qm_status check_options(qm_context *ctx, const qm_deviation_options *options)
{
    if (!(options->accuracy > 0.0) || !isfinite(options->accuracy))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "accuracy must be a positive number, got %g",
                               options->accuracy);
    if (!(options->tolerance > 0.0) || !isfinite(options->tolerance))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "tolerance must be a positive number, got %g",
                               options->tolerance);
    if (options->thread_count < 1)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "thread count must be 1 or more, got %d",
                               options->thread_count);
    for (size_t i = 0; i < options->percentile_count; i++)
        if (!(options->percentile[i] > 0.0 && options->percentile[i] <= 100.0))
            return qm_context_fail(ctx, QM_E_ARGUMENT, "a percentile lies above 0 and at 100 at most, got %g",
                                   options->percentile[i]);
    return QM_OK;
}

/* ---- the vertices ---- */

static qm_status find_vertex_distances(deviation_work *work)
{
    const qm_mesh *mesh = &work->a->mesh;
    qm_deviation *out = work->out;
    out->vertex_count = mesh->vertex_count;
    out->vertex_distance = qm_context_alloc(work->ctx, mesh->vertex_count, sizeof *out->vertex_distance);
    if (!out->vertex_distance)
        return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the vertices");
    qm_projection projection = {.distance = out->vertex_distance};
    out->projections += mesh->vertex_count;
    return qm_project_points(work->ctx, work->b, work->options->quads, mesh->positions, mesh->vertex_count,
                             work->options->thread_count, &projection);
}

/* ---- the surface ---- */

static qm_status refine(deviation_work *work)
{
    qm_refinement *pieces = &work->refinement;
    double sum = 0.0;
    for (size_t i = 0; i < work->out->vertex_count; i++)
        sum += work->out->vertex_distance[i];
    /* The mean over the vertices estimates that over the surface. */
    pieces->typical = sum / (double)work->out->vertex_count * work->b->frame.scale;
    pieces->accuracy = work->options->accuracy;
    pieces->piece_limit = work->options->piece_limit;
    pieces->thread_count = work->options->thread_count;
    qm_status status = qm_refinement_run(pieces);
    work->out->is_accurate = pieces->is_accurate;
    work->out->is_canceled = pieces->is_canceled;
    return status;
}

/* ---- points ---- */

/** Takes the points themselves instead of pieces: all of a point set, else the vertices that a face uses. The
 * projection of the vertices does not report its error
 * for patches, so that these are searched again. */
static qm_status take_points(deviation_work *work, qm_measure measure)
{
    const qm_mesh *mesh = &work->a->mesh;
    uint8_t *is_used = qm_context_alloc(work->ctx, mesh->vertex_count, 1);
    qm_refinement *pieces = &work->refinement;
    double scale = work->b->frame.scale;
    pieces->count = 0;
    pieces->leak = 0.0;
    pieces->setup.patch_error = 4.0 * pieces->setup.eta;
    qm_status status = is_used ? qm_refinement_reserve(pieces, mesh->vertex_count) : QM_E_NO_MEMORY;
    if (status == QM_OK) {
        memset(is_used, mesh->face_count == 0, mesh->vertex_count);
        for (size_t i = 0; i < 4 * mesh->face_count; i++)
            if (mesh->faces[i] != QM_NO_INDEX) is_used[mesh->faces[i]] = 1;
        for (size_t i = 0; i < mesh->vertex_count; i++)
            if (is_used[i])
                pieces->bounds[pieces->count++] = qm_deviation_point_bound(
                    &pieces->setup, mesh->positions + 3 * i, scale * work->out->vertex_distance[i]);
    }
    qm_context_free(work->ctx, is_used, mesh->vertex_count, 1);
    work->out->measure = measure;
    work->out->is_accurate = true;
    return status == QM_OK ? QM_OK : qm_context_fail(work->ctx, status, "out of memory for the points");
}

/* ---- the maximum ---- */

/** Bounds the maximum by the pieces. Points, and pieces that have not been cut, are exact but for eta, which
 * is in their bounds; a part may be a little beside the face, and a point of the face beside all parts. */
static void bound_maximum(deviation_work *work)
{
    const qm_refinement *pieces = &work->refinement;
    double inverse_scale = work->b->frame.inverse_scale;
    double crack = QM_CRACK_ROUNDINGS * QM_UNIT_ROUNDING * pieces->setup.extent;
    qm_interval greatest = qm_deviation_max(qm_refinement_list(pieces));
    work->out->max = (qm_interval){fmax(0.0, greatest.lower - crack) * inverse_scale,
                                   (greatest.upper + crack) * inverse_scale};
}

/** Narrows the maximum by a search. */
static qm_status search_maximum(deviation_work *work)
{
    const qm_deviation_options *options = work->options;
    qm_deviation *out = work->out;
    qm_hausdorff_options search = qm_hausdorff_options_default();
    search.direction = QM_A_TO_B;
    search.quads = options->quads;
    search.tolerance = options->tolerance;
    search.thread_count = options->thread_count;
    double others = (double)out->vertex_count + (double)work->refinement.count;
    search.work_limit = SEARCH_WORK + (uint64_t)(SEARCH_SHARE * others);
    search.progress = options->progress;
    search.progress_user = options->progress_user;
    qm_hausdorff_result found;
    qm_status status = qm_hausdorff_measure(work->ctx, work->a, work->b, &search, &found);
    if (status != QM_OK) return status;
    out->is_canceled |= found.stop == QM_STOP_CANCELED;
    out->max.lower = fmax(out->max.lower, found.lower);
    out->max.upper = fmin(out->max.upper, found.upper);
    out->projections += found.projections;
    return QM_OK;
}

/* ---- the result ---- */

/** By a power of two, which is exact but below the least normal number, where the interval is opened. */
static void scale_interval(qm_interval *interval, double scale)
{
    interval->lower = fmin(fmax(0.0, interval->lower) * scale, DBL_MAX);
    interval->upper *= scale;
    if (interval->lower < DBL_MIN) interval->lower = fmax(0.0, nextafter(interval->lower, -1.0));
    if (interval->upper < DBL_MIN) interval->upper = nextafter(interval->upper, 1.0);
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
    qm_status status = qm_deviation_percentiles(ctx, qm_refinement_list(&work->refinement), greatest,
                                                options->percentile, out->percentile_count, out->percentile);
    if (status == QM_OK)
        status = qm_deviation_histogram(ctx, qm_refinement_list(&work->refinement), greatest, out->bin_count,
                                        out->bin);
    for (size_t i = 0; status == QM_OK && i < out->percentile_count; i++)
        scale_interval(&out->percentile[i], inverse_scale);
    if (out->bin_count > 0) out->bin_width = out->max.upper / (double)out->bin_count;
    return status;
}

static void set_totals(deviation_work *work)
{
    qm_deviation *out = work->out;
    double inverse_scale = work->b->frame.inverse_scale;
    qm_deviation_totals totals = qm_deviation_sum(qm_refinement_list(&work->refinement));
    out->mean = totals.mean;
    out->rms = totals.rms;
    out->size = totals.area;
    scale_interval(&out->mean, inverse_scale);
    scale_interval(&out->rms, inverse_scale);
    out->mean.upper = fmin(out->mean.upper, out->max.upper);
    out->rms.upper = fmin(out->rms.upper, out->max.upper);
    if (out->measure == QM_OVER_AREA) {
        scale_interval(&out->size, inverse_scale / work->refinement.setup.area_unit);
        scale_interval(&out->size, inverse_scale);
    } else {
        out->size.lower = out->size.upper = (double)work->refinement.count;
    }
    out->pieces = work->refinement.count;
    out->projections += atomic_load(&work->refinement.searches);
}

static qm_status run(deviation_work *work)
{
    qm_status status =
        qm_deviation_setup_init(work->ctx, work->a, work->b, work->options->quads, &work->refinement.setup);
    if (status == QM_OK) status = find_vertex_distances(work);
    bool has_faces = work->a->mesh.face_count > 0;
    if (status == QM_OK) status = has_faces ? refine(work) : take_points(work, QM_OVER_POINTS);
    if (status == QM_OK) bound_maximum(work);
    if (status == QM_OK && has_faces && !work->refinement.has_area)
        status = take_points(work, QM_OVER_VERTICES);
    if (status == QM_OK) status = search_maximum(work);
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
    deviation_work work = {.ctx = ctx,
                           .a = a,
                           .b = b,
                           .options = options,
                           .out = out,
                           .start_ms = qm_clock_ms(),
                           .refinement.ctx = ctx};
    status = run(&work);
    qm_refinement_reset(&work.refinement);
    out->elapsed_ms = qm_clock_ms() - work.start_ms;
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
