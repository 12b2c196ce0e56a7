/**
 * kind_comparison.c: two meshes compared both ways, with the figures that join both directions.
 */
#include "job_kinds_internal.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <string.h>

#include "json_request.h"

#define WORST_RADIUS 0.05 /* of the diagonal of A's box, unless it is given */

static qm_status run(const qm_job_call *call, qm_job_result *out)
{
    const qm_job_request *request = call->request;
    qm_comparison_options options = qm_deviation_options_default();
    options.limit = request->limits;
    options.limit_count = request->limit_count;
    options.progress = call->progress;
    options.progress_user = call->progress_user;
    /* The first place is the witness of the maximum. */
    options.worst_count = request->worst_count > 0 ? request->worst_count : 1;
    options.worst_radius =
        isnan(request->worst_radius) ? WORST_RADIUS * call->a->diagonal : request->worst_radius;
    qm_comparison *comparison = &out->comparison;
    qm_solid of_a, of_b;
    const qm_solid *solid_a = NULL;
    qm_status status = qm_sides_set_options(call, &options, &of_b);
    out->tolerance = options.tolerance;
    if (status == QM_OK) status = qm_sides_find_solid(call, call->a, &of_a, &solid_a);
    if (status == QM_OK)
        status = qm_comparison_measure(call->ctx, call->a->bvh, call->b->bvh, &options, solid_a, comparison);
    if (status != QM_OK) return status;
    qm_sides_name_faces(&comparison->side[0], call->a, call->b);
    qm_sides_name_faces(&comparison->side[1], call->b, call->a);
    out->is_canceled = comparison->is_canceled;
    return QM_OK;
}

static void reset(qm_context *ctx, qm_job_result *result)
{
    qm_comparison_reset(ctx, &result->comparison);
}

/* ---- the request ---- */

static bool read_limits(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    if (!cJSON_IsArray(value) || cJSON_GetArraySize(value) > QM_JOB_MAX_LIMITS) return false;
    out->limit_count = 0;
    at->depth = 1;
    for (const cJSON *number = value->child; number; number = number->next, at->index[0]++) {
        double *limit = &out->limits[out->limit_count];
        if (!qm_json_read_number(number, limit) || !(*limit >= 0.0)) return false;
        out->limit_count++;
    }
    return true;
}
_Static_assert(QM_JOB_MAX_LIMITS == 64 && QM_JOB_MAX_PLACES == 100, "the texts name the limits");

static bool read_worst(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    (void)at;
    if (cJSON_IsNull(value)) return true;
    if (!cJSON_IsObject(value)) return false;
    bool has_count = false;
    for (const cJSON *member = value->child; member; member = member->next) {
        if (qm_json_is_repeated(value, member)) return false;
        if (strcmp(member->string, "count") == 0)
            has_count = qm_json_read_count(member, 1.0, QM_JOB_MAX_PLACES, &out->worst_count);
        else if (strcmp(member->string, "radius") != 0 || !qm_json_read_number(member, &out->worst_radius) ||
                 !(out->worst_radius >= 0.0))
            return false;
    }
    return has_count;
}

static void write_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    qm_job_add_gap(out, request);
    qm_json_add_number(out, "accuracy", request->accuracy);
    qm_json_add_numbers(out, "percentiles", request->percentiles, (int)request->percentile_count);
    qm_json_add_numbers(out, "limits", request->limits, (int)request->limit_count);
    qm_sides_add_request(out, request);
    if (request->worst_count == 0) return;
    qm_json_open(out, "worst", "{");
    qm_json_add_count(out, "count", request->worst_count);
    if (!isnan(request->worst_radius)) qm_json_add_number(out, "radius", request->worst_radius);
    qm_text_add_string(out, "}");
}

/* ---- the result ---- */

static void add_shares(qm_text *out, const qm_job_request *request, const qm_deviation *deviation)
{
    qm_json_open(out, "shares", "[");
    for (size_t i = 0; i < deviation->limit_count; i++) {
        qm_json_add_comma(out);
        qm_text_add_string(out, "{");
        qm_json_add_number(out, "limit", request->limits[i]);
        qm_json_add_number(out, "lower", deviation->share[i].lower);
        qm_json_add_number(out, "upper", deviation->share[i].upper);
        qm_text_add_string(out, "}");
    }
    qm_text_add_string(out, "]");
}

static void add_worst(qm_text *out, const qm_job_request *request, const qm_job_result *result, int side)
{
    const qm_deviation *deviation = &result->comparison.side[side];
    qm_json_open(out, "worst", "[");
    for (size_t i = 0; i < deviation->worst_count; i++) {
        const qm_deviation_place *place = &deviation->worst[i];
        qm_json_add_comma(out);
        qm_text_add_string(out, "{");
        qm_json_add_lower_upper(out, place->lower, place->upper, result->diagonal);
        qm_job_add_of_true(out, result,
                           (qm_interval){place->lower, place->upper}); /* as of a region (kind_sides.c) */
        qm_sides_add_points(out, request, side, &place->from, &place->to);
        qm_text_add_string(out, "}");
    }
    qm_text_add_string(out, "]");
}

/** Why B has no sign against A: what is in the way, or A was not checked before the job was canceled. */
static const char *unsigned_reason(const qm_job_request *request, const qm_comparison *comparison)
{
    static const char *const reasons[] = {[QM_SOLID_PROVEN] = "canceled",
                                          [QM_SOLID_EMPTY] = "empty",
                                          [QM_SOLID_OPEN] = "open",
                                          [QM_SOLID_TURNED] = "turned",
                                          [QM_SOLID_CROSSING] = "crossing"};
    bool is_empty = request->sign == QM_SIGN_NORMAL;
    return reasons[is_empty ? QM_SOLID_EMPTY : comparison->solid_a.fault];
}

static void add_direction(qm_text *out, const qm_job_request *request, const qm_job_result *result, int side)
{
    const qm_deviation *deviation = &result->comparison.side[side];
    qm_json_open(out, side == 0 ? "a_to_b" : "b_to_a", "{");
    qm_averages_add_measure(out, deviation);
    qm_averages_add_greatest(out, "hausdorff", deviation->max, result);
    qm_averages_add_figure(out, "mean", deviation->mean, result, side);
    qm_averages_add_figure(out, "rms", deviation->rms, result, side);
    qm_averages_add_figure(out, "std", result->comparison.spread[side], result, side);
    qm_averages_add_percentiles(out, request->percentiles, deviation->percentile, request->percentile_count,
                                result, side);
    add_shares(out, request, deviation);
    if (deviation->worst_count > 0) {
        qm_json_open(out, "witness", "{");
        qm_sides_add_points(out, request, side, &deviation->worst[0].from, &deviation->worst[0].to);
        qm_text_add_string(out, "}");
    }
    if (request->worst_count > 0) add_worst(out, request, result, side);
    if (result->comparison.is_signed[side])
        qm_sides_add_signed(out, request, result, deviation, side);
    else if (request->sign != QM_SIGN_NONE)
        qm_json_add_string(out, "unsigned", unsigned_reason(request, &result->comparison));
    if (!isnan(request->threshold)) qm_sides_add_limit(out, request, result, deviation, side);
    qm_json_add_bool(out, "accurate", deviation->is_accurate);
    qm_text_add_string(out, "}");
}

static void add_half(qm_text *out, const char *name, qm_interval whole)
{
    /* Exact, but for the last bit of numbers below the least normal one, which goes outward. */
    qm_interval half = {0.5 * whole.lower, 0.5 * whole.upper};
    if (2.0 * half.lower > whole.lower) half.lower = nextafter(half.lower, 0.0);
    if (2.0 * half.upper < whole.upper) half.upper = nextafter(half.upper, INFINITY);
    qm_json_add_range(out, name, half);
}

/** Averages over both surfaces are of the true ones only when both meshes are exact, and then they are the same (see
 * qm_averages_add_figure). A share within a limit t is of the true surfaces between those within t less and plus the uncertainty,
 * for which these limits can be asked. */
static void add_symmetric(qm_text *out, const qm_job_result *result)
{
    const qm_comparison *comparison = &result->comparison;
    double diagonal = result->diagonal;
    qm_json_open(out, "symmetric", "{");
    qm_averages_add_greatest(out, "hausdorff", comparison->hausdorff, result);
    qm_json_add_interval(out, "hd95", comparison->hd95, diagonal);
    qm_json_add_interval(out, "mean", comparison->mean, diagonal);
    qm_json_add_interval(out, "rms", comparison->rms, diagonal);
    qm_json_open(out, "chamfer", "{");
    qm_json_add_range(out, "l1", comparison->chamfer_l1);
    add_half(out, "l1_half", comparison->chamfer_l1);
    qm_json_add_range(out, "l2", comparison->chamfer_l2);
    add_half(out, "l2_half", comparison->chamfer_l2);
    qm_text_add_string(out, "}");
    qm_json_open(out, "f_score", "[");
    for (size_t i = 0; i < comparison->limit_count; i++) {
        const qm_f_score *score = &comparison->f_score[i];
        qm_json_add_comma(out);
        qm_text_add_string(out, "{");
        qm_json_add_number(out, "limit", score->limit);
        qm_json_add_range(out, "precision", score->precision);
        qm_json_add_range(out, "recall", score->recall);
        qm_json_add_range(out, "f", score->f);
        qm_text_add_string(out, "}");
    }
    qm_text_add_string(out, "]}");
}

static void write_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    const qm_comparison *comparison = &result->comparison;
    add_direction(out, request, result, 0);
    add_direction(out, request, result, 1);
    add_symmetric(out, result);
    qm_json_add_string(out, "quads", qm_quads_names[request->quads]);
    qm_json_add_number(out, "accuracy", request->accuracy);
    qm_json_add_number(out, "gap", result->tolerance);
    qm_json_add_bool(out, "accurate", comparison->is_accurate);
    qm_json_add_count(out, "pieces", comparison->side[0].pieces + comparison->side[1].pieces);
    qm_json_add_count(out, "projections", comparison->side[0].projections + comparison->side[1].projections);
    qm_json_add_prepare_ms(out, result);
    qm_json_add_ms(out, "elapsed_ms", result->elapsed_ms);
}

static const qm_job_field fields[] = {
    QM_JOB_FIELD_PAIR,
    QM_JOB_FIELD_QUADS,
    QM_JOB_FIELDS_GAP,
    QM_JOB_FIELD_BOXES,
    QM_JOB_FIELDS_AVERAGES,
    QM_JOB_FIELDS_SIDES,
    {"limits", QM_FIELD_OTHER, .read = read_limits,
     .expected = "must be an array of at most 64 numbers of 0 or more"},
    {"worst", QM_FIELD_OTHER, .read = read_worst,
     .expected = "must be {\"count\": 1 to 100, \"radius\": 0 or more}, or null"},
    {0}};

const qm_job_hooks qm_job_kind_comparison = {
    .type = {.name = "comparison", .mesh_field = {"a", "b"}, .is_pure = true, .is_anytime = true},
    .fields = fields,
    .check = qm_sides_check,
    .run = run,
    .write_request = write_request,
    .write_result = write_result,
    .reset = reset};
