/**
 * kind_deviation.c: mean, percentiles and histogram of the distance.
 */
#include "job_kinds_internal.h"

#include <cjson/cJSON.h>
#include <string.h>

#include "json_request.h"

static qm_status run(const qm_job_call *call, qm_job_result *out)
{
    const qm_job_request *request = call->request;
    qm_deviation_options options = qm_deviation_options_default();
    options.quads = request->quads;
    options.accuracy = request->accuracy;
    options.tolerance = qm_job_tolerance(call);
    options.piece_limit = request->pieces;
    options.percentile = request->percentiles;
    options.percentile_count = request->percentile_count;
    options.bin_count = request->bins;
    options.thread_count = call->threads;
    options.progress = call->progress;
    options.progress_user = call->progress_user;
    out->tolerance = options.tolerance;
    qm_status status = qm_deviation_measure(call->ctx, call->a->bvh, call->b->bvh, &options, &out->deviation);
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

static bool read_percentiles(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    if (!cJSON_IsArray(value) || cJSON_GetArraySize(value) > QM_JOB_MAX_PERCENTILES) return false;
    out->percentile_count = 0;
    at->depth = 1;
    for (const cJSON *number = value->child; number; number = number->next, at->index[0]++) {
        double *percentile = &out->percentiles[out->percentile_count];
        if (!qm_json_read_number(number, percentile) || !(*percentile > 0.0 && *percentile <= 100.0))
            return false;
        out->percentile_count++;
    }
    return true;
}
_Static_assert(QM_JOB_MAX_PERCENTILES == 64, "the text of percentiles names the limit");

static void write_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    qm_job_add_tolerance(out, request);
    qm_json_add_number(out, "accuracy", request->accuracy);
    qm_json_add_count(out, "pieces", request->pieces);
    qm_json_add_count(out, "bins", request->bins);
    qm_json_add_numbers(out, "percentiles", request->percentiles, (int)request->percentile_count);
}

/**
 * The maximum is a one-sided Hausdorff distance, and that of the true surfaces is near it. The others are over the area
 * of A: how near A is to its true surface says nothing of where that has its area, so they have such an interval only when A
 * is exact.
 */
static void add_figure(qm_text *out, const char *name, qm_interval interval, const qm_job_result *result)
{
    bool has_true = result->notes[0].uncertainty == 0.0 || strcmp(name, "max") == 0;
    qm_json_open(out, name, "{");
    qm_json_add_lower_upper(out, interval.lower, interval.upper, result->diagonal);
    if (has_true) qm_job_add_of_true(out, result, interval);
    qm_text_add_string(out, "}");
}

static void add_percentiles(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    qm_json_open(out, "percentiles", "[");
    for (size_t i = 0; i < result->deviation.percentile_count; i++) {
        qm_json_add_comma(out);
        qm_text_add_string(out, "{");
        qm_json_add_number(out, "percent", request->percentiles[i]);
        qm_json_add_lower_upper(out, result->deviation.percentile[i].lower,
                                result->deviation.percentile[i].upper, result->diagonal);
        if (result->notes[0].uncertainty == 0.0)
            qm_job_add_of_true(out, result, result->deviation.percentile[i]);
        qm_text_add_string(out, "}");
    }
    qm_text_add_string(out, "]");
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
    static const char *const measures[] = {"area", "vertices", "points"};
    const qm_deviation *deviation = &result->deviation;
    qm_json_add_string(out, "over", measures[deviation->measure]);
    qm_json_open(out, "size", "{");
    qm_json_add_number(out, "lower", deviation->size.lower);
    qm_json_add_number(out, "upper", deviation->size.upper);
    qm_text_add_string(out, "}");
    add_figure(out, "mean", deviation->mean, result);
    add_figure(out, "rms", deviation->rms, result);
    add_figure(out, "max", deviation->max, result);
    add_percentiles(out, request, result);
    add_histogram(out, deviation);
    qm_json_add_count(out, "vertex_count", deviation->vertex_count);
    qm_json_add_string(out, "quads", qm_quads_names[request->quads]);
    qm_json_add_number(out, "accuracy", request->accuracy);
    qm_json_add_number(out, "tolerance", result->tolerance);
    qm_json_add_bool(out, "accurate", deviation->is_accurate);
    qm_json_add_count(out, "pieces", deviation->pieces);
    qm_json_add_count(out, "projections", deviation->projections);
    qm_json_add_prepare_ms(out, result);
    qm_json_add_ms(out, "elapsed_ms", result->elapsed_ms);
}

static const qm_job_array distances = {"vertex_distances", "vertex,distance", 1};

static const qm_job_field fields[] = {
    QM_JOB_FIELD_PAIR,
    QM_JOB_FIELD_QUADS,
    QM_JOB_FIELDS_TOLERANCE,
    QM_JOB_FIELD_BOXES,
    {"accuracy", QM_FIELD_POSITIVE, QM_FIELD_AT(accuracy)},
    {"pieces", QM_FIELD_COUNT, QM_FIELD_AT(pieces), .max = QM_JOB_MAX_PIECES},
    {"bins", QM_FIELD_COUNT, QM_FIELD_AT(bins), .max = QM_JOB_MAX_BINS},
    {"percentiles", QM_FIELD_OTHER, .read = read_percentiles,
     .expected = "must be an array of at most 64 numbers above 0 and at most 100"},
    {0}};

const qm_job_hooks qm_job_kind_deviation = {
    .type = {.name = "deviation", .mesh_field = {"a", "b"}, .is_pure = true, .is_anytime = true},
    .fields = fields,
    .run = run,
    .write_request = write_request,
    .write_result = write_result,
    .array = &distances,
    .find_array = find_distances,
    .reset = reset};
