/**
 * kind_deviation.c: mean, percentiles and histogram of the distance of one surface from another.
 */
#include "job_kinds_internal.h"

#include <math.h>

static qm_status run(const qm_job_call *call, qm_job_result *out)
{
    const qm_job_request *request = call->request;
    qm_deviation_options options = qm_deviation_options_default();
    options.bin_count = request->bins;
    /* So that a greatest distance of exactly the limit is told from one above it. */
    options.limit = &request->threshold;
    options.limit_count = isnan(request->threshold) ? 0u : 1u;
    options.progress = call->progress;
    options.progress_user = call->progress_user;
    qm_solid solid;
    qm_status status = qm_sides_set_options(call, &options, &solid);
    out->tolerance = options.tolerance;
    if (status == QM_OK)
        status = qm_deviation_measure(call->ctx, call->a->bvh, call->b->bvh, &options, &out->deviation);
    if (status == QM_OK) qm_sides_name_faces(&out->deviation, call->a, call->b);
    out->is_canceled = status == QM_OK && out->deviation.is_canceled;
    return status;
}

static const double *find_distances(const qm_job_result *result, size_t *count)
{
    *count = result->deviation.vertex_count;
    return result->deviation.vertex_distance;
}

static void reset(qm_context *ctx, qm_job_result *result)
{
    qm_deviation_reset(ctx, &result->deviation);
}

static void write_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    qm_job_add_gap(out, request);
    qm_json_add_number(out, "accuracy", request->accuracy);
    qm_json_add_count(out, "bins", request->bins);
    qm_json_add_numbers(out, "percentiles", request->percentiles, (int)request->percentile_count);
    qm_sides_add_request(out, request);
}

/** Bins as pairs [lower, upper], because they are many. */
static void add_histogram(qm_text *out, const qm_deviation *deviation)
{
    qm_json_open(out, "histogram", "{");
    qm_json_add_number(out, "bin_width", deviation->bin_width);
    qm_json_open(out, "shares", "[");
    for (size_t i = 0; i < deviation->bin_count; i++) {
        const double fraction[2] = {deviation->bin[i].lower, deviation->bin[i].upper};
        qm_json_add_array(out, fraction, 2);
    }
    qm_text_add_string(out, "]}");
}

static void write_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    const qm_deviation *deviation = &result->deviation;
    qm_averages_add_measure(out, deviation);
    qm_averages_add_figure(out, "mean", deviation->mean, result, 0);
    qm_averages_add_figure(out, "rms", deviation->rms, result, 0);
    qm_averages_add_greatest(out, "max", deviation->max, result);
    qm_averages_add_percentiles(out, request->percentiles, deviation->percentile, deviation->percentile_count,
                                result, 0);
    add_histogram(out, deviation);
    if (request->sign != QM_SIGN_NONE) qm_sides_add_signed(out, request, result, deviation, 0);
    if (!isnan(request->threshold)) qm_sides_add_limit(out, request, result, deviation, 0);
    qm_json_add_count(out, "vertex_count", deviation->vertex_count);
    qm_json_add_string(out, "quads", qm_quads_names[request->quads]);
    qm_json_add_number(out, "accuracy", request->accuracy);
    qm_json_add_number(out, "gap", result->tolerance);
    qm_json_add_bool(out, "accurate", deviation->is_accurate);
    qm_json_add_count(out, "pieces", deviation->pieces);
    qm_json_add_count(out, "projections", deviation->projections);
    qm_json_add_prepare_ms(out, result);
    qm_json_add_ms(out, "elapsed_ms", result->elapsed_ms);
}

static const qm_job_array distances = {"vertex_distances", "vertex,distance", 1};

static const qm_job_field fields[] = {
    QM_JOB_FIELD_PAIR,      QM_JOB_FIELD_QUADS,
    QM_JOB_FIELDS_GAP,      QM_JOB_FIELD_BOXES,
    QM_JOB_FIELDS_AVERAGES, {"bins", QM_FIELD_COUNT, QM_FIELD_AT(bins), .max = QM_JOB_MAX_BINS},
    QM_JOB_FIELDS_SIDES,    {0}};

const qm_job_hooks qm_job_kind_deviation = {
    .type = {.name = "deviation", .mesh_field = {"a", "b"}, .is_pure = true, .is_anytime = true},
    .fields = fields,
    .check = qm_sides_check,
    .run = run,
    .write_request = write_request,
    .write_result = write_result,
    .array = &distances,
    .find_array = find_distances,
    .reset = reset};
