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
#include "deviation_limits.h"
#include "deviation_regions.h"
#include "deviation_sides.h"
#include "deviation_worst.h"
#include "hausdorff/hausdorff_exact.h"

#define SEARCH_WORK 4096 /* steps of the search for the maximum */
#define SEARCH_SHARE 0.5 /* further steps for each vertex and each piece */
#define CANCEL_STRIDE 0x400
#define TELL_MS 100.0 /* between reports of bounds that have hardly changed */

/** The state that the stages of a call share. */
typedef struct deviation_work {
    qm_context *ctx;
    const qm_bvh *a, *b;
    const qm_deviation_options *options;
    qm_deviation *out;
    double start_ms;
    qm_refinement refinement;
    uint32_t *points;  /* the vertices that are measured in place of pieces, or NULL */
    qm_interval known; /* bounds of the maximum from all surveys and searches so far */
    qm_interval told;  /* those that were reported last */
    double told_ms;    /* when; of none, 0 */
} deviation_work;

qm_deviation_options qm_deviation_options_default(void)
{
    return (qm_deviation_options){
        .accuracy = 1e-2, .piece_limit = 1u << 20, .thread_count = 1, .region_limit = NAN};
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
    if (options->region_limit < 0.0)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "limit must be 0 or more, got %g", options->region_limit);
    if (options->band_count > 0 && options->sign == QM_SIGN_NONE)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "bands are of signed distances: a sign is needed");
    for (size_t i = 0; i < options->band_count; i++)
        if (!(options->band[i].lower <= options->band[i].upper))
            return qm_context_fail(ctx, QM_E_ARGUMENT,
                                   "a band goes from a number to one no less, got %g to %g",
                                   options->band[i].lower, options->band[i].upper);
    for (size_t i = 0; i < options->limit_count; i++)
        if (!(options->limit[i] >= 0.0) || !isfinite(options->limit[i]))
            return qm_context_fail(ctx, QM_E_ARGUMENT, "a limit must be 0 or more, got %g",
                                   options->limit[i]);
    if (!(options->worst_radius >= 0.0) || !isfinite(options->worst_radius))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the radius between places must be 0 or more, got %g",
                               options->worst_radius);
    return QM_OK;
}

/* ---- bounds of the maximum so far ---- */

/** Bounds the maximum by the last survey. Points, and pieces that have not been cut, are exact but for eta, which
 * is in their bounds; a part may be a little beside the face, and a point of the face beside all parts. */
static void bound_maximum(deviation_work *work)
{
    const qm_refinement *pieces = &work->refinement;
    double inverse_scale = work->b->frame.inverse_scale;
    double crack = QM_CRACK_ROUNDINGS * QM_UNIT_ROUNDING * pieces->setup.extent;
    qm_interval greatest = pieces->survey.max;
    work->out->max = (qm_interval){fmax(0.0, greatest.lower - crack) * inverse_scale,
                                   (greatest.upper + crack) * inverse_scale};
    /* As for the maximum: a point beside all pieces may be nearer by the crack. */
    double least = fmax(0.0, pieces->survey.least - crack) * inverse_scale;
    work->out->least = least < DBL_MIN ? 0.0 : least;
}

/** Takes note of bounds of the maximum. */
static void learn(deviation_work *work, qm_interval max)
{
    work->known.lower = fmax(work->known.lower, max.lower);
    work->known.upper = fmin(work->known.upper, max.upper);
}

/** Reports what is known of the maximum; counts has those of its search. */
static void tell(deviation_work *work, qm_hausdorff_progress counts)
{
    const qm_deviation_options *options = work->options;
    counts.lower = work->known.lower;
    counts.upper = work->known.upper;
    work->told = work->known;
    work->told_ms = qm_clock_ms();
    counts.elapsed_ms = work->told_ms - work->start_ms;
    counts.projections += work->out->projections + atomic_load(&work->refinement.searches);
    counts.iterations += work->refinement.count;
    options->progress(options->progress_user, &counts);
}

/** Takes note of what the pieces tell, and reports it unless that was just done; user is the work. */
static void take_survey(void *user)
{
    deviation_work *work = user;
    bound_maximum(work);
    learn(work, work->out->max);
    if (!work->options->progress) return;
    bool is_half = work->known.upper - work->known.lower <= 0.5 * (work->told.upper - work->told.lower);
    if (is_half || qm_clock_ms() - work->told_ms >= TELL_MS)
        tell(work, (qm_hausdorff_progress){.queue_count = work->refinement.todo_count});
}

/** The same for the search for the maximum. */
static void take_progress(void *user, const qm_hausdorff_progress *progress)
{
    deviation_work *work = user;
    learn(work, (qm_interval){progress->lower, progress->upper});
    tell(work, *progress);
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
    qm_status status = qm_project_points(work->ctx, work->b, work->options->quads, mesh->positions,
                                         mesh->vertex_count, work->options->thread_count, &projection);
    if (status == QM_OK) {
        out->projections += mesh->vertex_count;
    } else { /* those that were not found are undefined */
        qm_context_free(work->ctx, out->vertex_distance, mesh->vertex_count, sizeof *out->vertex_distance);
        out->vertex_distance = NULL;
        out->vertex_count = 0;
    }
    return status;
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
    /* Not of points: those of a mesh with faces are not all of it. */
    pieces->on_survey = take_survey;
    pieces->user = work;
    qm_status status = qm_refinement_run(pieces, work->out->vertex_distance);
    work->out->is_accurate = status == QM_OK && pieces->is_accurate;
    return status;
}

/* ---- points ---- */

/** Marks the points that are measured: all of a point set, else the vertices that a face uses; returns how
 * many. */
static size_t mark_points(const qm_mesh *mesh, uint8_t *is_used)
{
    size_t count = 0;
    memset(is_used, mesh->face_count == 0, mesh->vertex_count);
    for (size_t i = 0; i < 4 * mesh->face_count; i++)
        if (mesh->faces[i] != QM_NO_INDEX) is_used[mesh->faces[i]] = 1;
    for (size_t i = 0; i < mesh->vertex_count; i++)
        count += is_used[i];
    return count;
}

/** Takes the points themselves instead of pieces, and surveys them. The projection of the vertices does not
 * report its error for patches, so that these are searched again. */
static qm_status take_points(deviation_work *work, qm_measure measure)
{
    const qm_mesh *mesh = &work->a->mesh;
    qm_deviation *out = work->out;
    qm_refinement *pieces = &work->refinement;
    double scale = work->b->frame.scale;
    uint8_t *is_used = qm_context_alloc(work->ctx, mesh->vertex_count, 1);
    if (!is_used) return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the points");
    pieces->count = 0;
    pieces->leak = 0.0;
    pieces->setup.patch_error = 4.0 * pieces->setup.eta;
    size_t count = mark_points(mesh, is_used);
    out->measure = measure;
    out->size = (qm_interval){(double)count, (double)count};
    work->points = qm_context_alloc(work->ctx, mesh->vertex_count, sizeof *work->points);
    qm_status status = work->points
                           ? qm_refinement_reserve(pieces, count)
                           : qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the points");
    for (size_t i = 0; status == QM_OK && i < mesh->vertex_count; i++) {
        if (is_used[i]) {
            work->points[pieces->count] = (uint32_t)i;
            pieces->bounds[pieces->count++] = qm_deviation_point_bound(
                &pieces->setup, mesh->positions + 3 * i, scale * out->vertex_distance[i]);
        }
        if (i % CANCEL_STRIDE == 0 && qm_context_canceled(work->ctx))
            status = qm_context_fail(work->ctx, QM_E_CANCELED, "deviation canceled");
    }
    qm_context_free(work->ctx, is_used, mesh->vertex_count, 1);
    if (status == QM_OK) status = qm_refinement_survey(pieces);
    out->is_accurate = status == QM_OK;
    return status;
}

/* ---- the maximum ---- */

/** Lists the worst places from the witness of the maximum on. */
static qm_status find_worst(deviation_work *work, const qm_hausdorff_result *found)
{
    const qm_deviation_options *options = work->options;
    qm_deviation *out = work->out;
    const qm_mesh *mesh = &work->a->mesh;
    if (options->worst_count == 0 || !found->has_witness) return QM_OK;
    if (out->measure == QM_OVER_AREA)
        return qm_deviation_find_worst(&work->refinement, options, NULL, found, out);
    uint8_t *is_used = qm_context_alloc(work->ctx, mesh->vertex_count, 1);
    if (!is_used) return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the points");
    mark_points(mesh, is_used);
    qm_status status = qm_deviation_find_worst(&work->refinement, options, is_used, found, out);
    qm_context_free(work->ctx, is_used, mesh->vertex_count, 1);
    return status;
}

/** Takes a number for the upper bound of the maximum if no point is farther, by a proof without rounding. */
static qm_status prove_maximum(deviation_work *work, double x)
{
    qm_interval *max = &work->out->max;
    bool is_proven = false;
    if (!(max->lower <= x && x < max->upper)) return QM_OK;
    qm_status status =
        qm_hausdorff_prove_within(work->ctx, work->a, work->b, work->options->quads, x, INFINITY, &is_proven);
    if (is_proven) max->upper = x;
    return status;
}

/** A maximum that is 0, or a limit itself, stays open by rounding alone. */
static qm_status prove_maxima(deviation_work *work)
{
    qm_status status = prove_maximum(work, 0.0);
    for (size_t i = 0; status == QM_OK && i < work->options->limit_count; i++)
        status = prove_maximum(work, work->options->limit[i]);
    return status;
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
    search.progress = options->progress ? take_progress : NULL;
    search.progress_user = work;
    qm_hausdorff_result found;
    qm_status status = qm_hausdorff_measure(work->ctx, work->a, work->b, &search, &found);
    if (status != QM_OK) return status;
    out->is_canceled |= found.stop == QM_STOP_CANCELED;
    learn(work, (qm_interval){found.lower, found.upper});
    out->max = work->known;
    out->projections += found.projections;
    status = out->is_canceled ? QM_OK : prove_maxima(work);
    if (status == QM_OK && !out->is_canceled) status = find_worst(work, &found);
    out->is_canceled |= status == QM_E_CANCELED;
    return status == QM_E_CANCELED ? QM_OK : status;
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

/** Percentiles and histogram: of the pieces, or of their last survey alone. */
static qm_status set_distribution(deviation_work *work, bool from_pieces)
{
    const qm_deviation_options *options = work->options;
    const qm_refinement *pieces = &work->refinement;
    qm_deviation *out = work->out;
    qm_context *ctx = work->ctx;
    double inverse_scale = work->b->frame.inverse_scale, greatest = out->max.upper * work->b->frame.scale;
    out->percentile_count = options->percentile_count;
    out->bin_count = options->bin_count;
    out->percentile = qm_context_alloc(ctx, out->percentile_count, sizeof *out->percentile);
    out->bin = qm_context_alloc(ctx, out->bin_count, sizeof *out->bin);
    if ((out->percentile_count > 0 && !out->percentile) || (out->bin_count > 0 && !out->bin))
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the distribution");
    const qm_deviation_piece_list list = qm_refinement_list(pieces), *used = from_pieces ? &list : NULL;
    qm_status status = qm_deviation_percentiles(ctx, used, &pieces->survey, greatest, options->percentile,
                                                out->percentile_count, out->percentile);
    if (status == QM_E_CANCELED) used = NULL;
    if (status != QM_E_NO_MEMORY) {
        qm_status bins =
            qm_deviation_histogram(ctx, used, &pieces->survey, greatest, out->bin_count, out->bin);
        if (status == QM_OK || bins == QM_E_NO_MEMORY) status = bins;
    }
    out->limit_count = options->limit_count;
    out->share = qm_context_alloc(ctx, out->limit_count, sizeof *out->share);
    if (out->limit_count > 0 && !out->share)
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the shares");
    if (status != QM_E_NO_MEMORY) {
        qm_status shares = qm_deviation_limit_shares(ctx, status == QM_OK ? used : NULL, &pieces->survey,
                                                     work->b->frame.scale, options->limit, out);
        if (status == QM_OK || shares == QM_E_NO_MEMORY) status = shares;
    }
    for (size_t i = 0; i < out->percentile_count; i++) {
        scale_interval(&out->percentile[i], inverse_scale);
        out->percentile[i].upper = fmin(out->percentile[i].upper, out->max.upper);
    }
    if (out->bin_count > 0) out->bin_width = out->max.upper / (double)out->bin_count;
    return status;
}

static void set_totals(deviation_work *work)
{
    qm_deviation *out = work->out;
    double inverse_scale = work->b->frame.inverse_scale;
    const qm_deviation_survey *survey = &work->refinement.survey;
    out->mean = survey->mean;
    out->rms = survey->rms;
    scale_interval(&out->mean, inverse_scale);
    scale_interval(&out->rms, inverse_scale);
    out->mean.upper = fmin(out->mean.upper, out->max.upper);
    out->rms.upper = fmin(out->rms.upper, out->max.upper);
    if (out->measure == QM_OVER_AREA) {
        out->size = survey->area;
        scale_interval(&out->size, inverse_scale / work->refinement.setup.area_unit);
        scale_interval(&out->size, inverse_scale);
    }
    out->pieces = work->refinement.count;
}

/* ---- signs ---- */

/** True for signs that B must prove. */
static bool needs_solid(qm_sign sign)
{
    return sign == QM_SIGN_OUTSIDE || sign == QM_SIGN_INSIDE;
}

static qm_status require_solid(deviation_work *work)
{
    const qm_deviation_options *options = work->options;
    qm_solid found;
    qm_status status = QM_OK;
    if (!options->solid)
        status = qm_solid_check(work->ctx, work->b, options->quads, options->thread_count, &found);
    if (status == QM_OK) status = qm_solid_require(work->ctx, options->solid ? options->solid : &found, "B");
    if (status != QM_E_NOT_CLOSED || work->b->mesh.face_count == 0) return status;
    char fault[QM_MESSAGE_SIZE];
    memcpy(fault, work->ctx->message, sizeof fault);
    return qm_context_fail(work->ctx, status, "%s; the sign \"normal\" needs no solid, but has no proof",
                           fault);
}

/** Sets the signed figures, by the pieces unless the call was canceled before. */
static qm_status measure_sides(deviation_work *work)
{
    qm_deviation_sides sides = {.pieces = &work->refinement,
                                .options = work->options,
                                .has_points = work->out->measure != QM_OVER_AREA,
                                .point = work->points};
    set_totals(work);
    qm_status status = qm_deviation_sides_init(work->ctx, work->options, work->out);
    if (status == QM_OK && !work->out->is_canceled) status = qm_deviation_sides_measure(&sides, work->out);
    qm_deviation_sides_reset(&sides);
    return status;
}

/* ---- regions ---- */

/** Finds the regions beyond the limit. Those of a call that was canceled before are not known: there are none, and has_regions is
 * not set. */
static qm_status find_regions(deviation_work *work)
{
    if (work->out->is_canceled) return QM_OK;
    if (work->out->measure != QM_OVER_AREA)
        return qm_context_fail(work->ctx, QM_E_UNSUPPORTED,
                               "regions are parts of a surface, and A has no area");
    return qm_deviation_regions_find(&work->refinement, work->options, work->out);
}

/* ---- the stages ---- */

static qm_status measure(deviation_work *work)
{
    const qm_mesh *mesh = &work->a->mesh;
    bool has_faces = mesh->face_count > 0;
    if (!has_faces) {
        work->out->measure = QM_OVER_POINTS;
        work->out->size = (qm_interval){(double)mesh->vertex_count, (double)mesh->vertex_count};
    }
    qm_status status = find_vertex_distances(work);
    if (status == QM_OK) status = has_faces ? refine(work) : take_points(work, QM_OVER_POINTS);
    if (status == QM_OK && has_faces && !work->refinement.has_area) {
        /* The maximum is that over the faces, which are more than their corners; so is the minimum. */
        qm_interval max = work->refinement.survey.max;
        double least = work->refinement.survey.least;
        status = take_points(work, QM_OVER_VERTICES);
        work->refinement.survey.max = max;
        work->refinement.survey.least = least;
    }
    return status;
}

/** The stages. One that is canceled leaves the survey of the stages before it. */
static qm_status run(deviation_work *work)
{
    qm_deviation *out = work->out;
    qm_status status = qm_refinement_init(&work->refinement, work->a, work->b, work->options->quads);
    if (status == QM_OK && needs_solid(work->options->sign)) status = require_solid(work);
    if (status == QM_OK) take_survey(work);
    if (status == QM_OK) status = measure(work);
    out->is_canceled = status == QM_E_CANCELED;
    if (status == QM_OK || out->is_canceled) {
        bound_maximum(work);
        learn(work, out->max);
        out->max = work->known;
        status = out->is_canceled ? QM_OK : search_maximum(work);
    }
    if (status == QM_OK && work->options->sign != QM_SIGN_NONE) status = measure_sides(work);
    out->is_canceled |= status == QM_E_CANCELED;
    if (status == QM_OK && !isnan(work->options->region_limit)) status = find_regions(work);
    out->is_canceled |= status == QM_E_CANCELED;
    if (status == QM_OK || status == QM_E_CANCELED) status = set_distribution(work, !out->is_canceled);
    out->is_canceled |= status == QM_E_CANCELED;
    if (status == QM_OK || status == QM_E_CANCELED) set_totals(work);
    out->projections += atomic_load(&work->refinement.searches);
    return status == QM_E_CANCELED ? QM_OK : status;
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
                           .known = {0.0, INFINITY},
                           .told = {0.0, INFINITY},
                           .refinement.ctx = ctx};
    status = run(&work);
    qm_refinement_reset(&work.refinement);
    qm_context_free(ctx, work.points, a->mesh.vertex_count, sizeof *work.points);
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
    qm_context_free(ctx, deviation->sides.band, deviation->sides.band_count, sizeof *deviation->sides.band);
    qm_context_free(ctx, deviation->region, deviation->region_count, sizeof *deviation->region);
    qm_context_free(ctx, deviation->region_face, deviation->region_face_count,
                    sizeof *deviation->region_face);
    qm_context_free(ctx, deviation->share, deviation->limit_count, sizeof *deviation->share);
    qm_context_free(ctx, deviation->worst, deviation->worst_count, sizeof *deviation->worst);
    *deviation = (qm_deviation){0};
}
