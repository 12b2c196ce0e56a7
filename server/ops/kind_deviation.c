/**
 * kind_deviation.c: mean, percentiles and histogram of the distance, and what a sign adds.
 */
#include "job_kinds_internal.h"

#include <math.h>

#include <cjson/cJSON.h>

#include "json_request.h"

const char *const qm_sign_names[] = {"none", "outside", "inside", "normal", NULL};

/** True for signs that B must prove. */
static bool needs_solid(qm_sign sign)
{
    return sign == QM_SIGN_OUTSIDE || sign == QM_SIGN_INSIDE;
}

/** Witnesses name faces of the input. */
static void name_faces(const qm_job_call *call, qm_deviation_side *side)
{
    side->from.face = qm_mesh_input_face(&call->a->mesh, side->from.face);
    side->to.face = qm_mesh_input_face(&call->b->mesh, side->to.face);
}

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
    options.sign = request->sign;
    options.band = request->bands;
    options.band_count = request->band_count;
    options.region_limit = request->regions ? request->threshold : NAN;
    options.face_limit = QM_JOB_LISTED_FACES;
    out->tolerance = options.tolerance;
    qm_solid solid;
    qm_status status = QM_OK;
    if (request->regions && isnan(request->threshold))
        return qm_context_fail(call->ctx, QM_E_ARGUMENT, "regions are those beyond a limit: limit is needed");
    if (needs_solid(request->sign)) {
        status =
            qm_solids_check(call->b->solids, call->ctx, call->b->bvh, request->quads, call->threads, &solid);
        /* A call that is stopped here has intervals all the same. */
        if (status == QM_OK) options.solid = &solid;
        if (status == QM_E_CANCELED) status = QM_OK;
    }
    if (status == QM_OK)
        status = qm_deviation_measure(call->ctx, call->a->bvh, call->b->bvh, &options, &out->deviation);
    if (status == QM_OK && request->sign != QM_SIGN_NONE) {
        name_faces(call, &out->deviation.sides.front);
        name_faces(call, &out->deviation.sides.behind);
    }
    for (size_t i = 0; status == QM_OK && i < out->deviation.region_count; i++) {
        out->deviation.region[i].from.face =
            qm_mesh_input_face(&call->a->mesh, out->deviation.region[i].from.face);
        out->deviation.region[i].to.face =
            qm_mesh_input_face(&call->b->mesh, out->deviation.region[i].to.face);
    }
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

/** An end of a band: a number, or null for none. */
static bool read_end(const cJSON *value, double none, double *out)
{
    *out = none;
    return cJSON_IsNull(value) || qm_json_read_number(value, out);
}

static bool read_bands(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    if (!cJSON_IsArray(value) || cJSON_GetArraySize(value) > QM_JOB_MAX_BANDS) return false;
    out->band_count = 0;
    at->depth = 1;
    for (const cJSON *ends = value->child; ends; ends = ends->next, at->index[0]++) {
        qm_interval *band = &out->bands[out->band_count];
        bool is_pair = cJSON_IsArray(ends) && cJSON_GetArraySize(ends) == 2;
        if (!is_pair || !read_end(ends->child, -INFINITY, &band->lower) ||
            !read_end(ends->child->next, INFINITY, &band->upper) || !(band->lower <= band->upper))
            return false;
        out->band_count++;
    }
    return true;
}
_Static_assert(QM_JOB_MAX_BANDS == 64, "the text of bands names the limit");

/** Adds an end of a band; one that is not finite becomes null. */
static void add_ends(qm_text *out, qm_interval band)
{
    const double ends[2] = {band.lower, band.upper};
    qm_json_add_array(out, ends, 2);
}

static void write_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    qm_job_add_tolerance(out, request);
    qm_json_add_number(out, "accuracy", request->accuracy);
    qm_json_add_count(out, "pieces", request->pieces);
    qm_json_add_count(out, "bins", request->bins);
    qm_json_add_numbers(out, "percentiles", request->percentiles, (int)request->percentile_count);
    if (request->sign != QM_SIGN_NONE) qm_json_add_string(out, "sign", qm_sign_names[request->sign]);
    if (!isnan(request->threshold)) qm_json_add_number(out, "limit", request->threshold);
    if (request->regions) qm_json_add_bool(out, "regions", true);
    if (request->band_count == 0) return;
    qm_json_open(out, "bands", "[");
    for (size_t i = 0; i < request->band_count; i++)
        add_ends(out, request->bands[i]);
    qm_text_add_string(out, "]");
}

/** An interval without relative figures. */
static void add_range(qm_text *out, const char *name, qm_interval range)
{
    qm_json_open(out, name, "{");
    qm_json_add_number(out, "lower", range.lower);
    qm_json_add_number(out, "upper", range.upper);
    qm_text_add_string(out, "}");
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

static void add_witness(qm_text *out, const qm_job_request *request, const qm_surface_point *from,
                        const qm_surface_point *to)
{
    qm_json_open(out, "witness", "{");
    qm_json_add_surface_point(out, "from", "a", request->a, from->face, from);
    qm_json_add_surface_point(out, "to", "b", request->b, to->face, to);
    qm_text_add_string(out, "}");
}

static void add_side(qm_text *out, const char *name, const qm_job_request *request,
                     const qm_job_result *result, const qm_deviation_side *side)
{
    qm_json_open(out, name, "{");
    qm_json_add_interval(out, "max", side->max, result->diagonal);
    add_range(out, "size", side->size);
    if (side->has_witness) add_witness(out, request, &side->from, &side->to);
    qm_text_add_string(out, "}");
}

static void add_signed(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    const qm_signed_deviation *sides = &result->deviation.sides;
    qm_json_open(out, "signed", "{");
    qm_json_add_string(out, "sign", qm_sign_names[request->sign]);
    qm_json_add_bool(out, "proven", sides->is_proven);
    add_range(out, "mean", sides->mean);
    add_side(out, "outside", request, result, &sides->front);
    add_side(out, "inside", request, result, &sides->behind);
    qm_json_add_number(out, "open_size", sides->open_size);
    qm_json_open(out, "bands", "[");
    for (size_t i = 0; i < sides->band_count; i++) {
        qm_json_add_comma(out);
        qm_text_add_string(out, "{");
        qm_json_add_number(out, "from", request->bands[i].lower);
        qm_json_add_number(out, "to", request->bands[i].upper);
        qm_json_add_number(out, "lower", sides->band[i].lower);
        qm_json_add_number(out, "upper", sides->band[i].upper);
        qm_text_add_string(out, "}");
    }
    qm_text_add_string(out, "]}");
}

static void add_region(qm_text *out, const qm_job_request *request, const qm_job_result *result,
                       const qm_deviation_region *region)
{
    qm_json_add_comma(out);
    qm_text_add_string(out, "{");
    qm_json_add_bool(out, "surely", region->parts > 0 || region->max.lower > request->threshold);
    qm_json_add_count(out, "parts", region->parts);
    add_range(out, "area", region->area);
    qm_json_add_interval(out, "max", region->max, result->diagonal);
    if (region->has_witness) add_witness(out, request, &region->from, &region->to);
    qm_json_add_numbers(out, "centroid", region->centroid, 3);
    qm_json_open(out, "box", "{");
    qm_json_add_numbers(out, "min", region->box.min, 3);
    qm_json_add_numbers(out, "max", region->box.max, 3);
    qm_text_add_string(out, "}");
    qm_json_add_count(out, "face_count", region->face_count);
    qm_json_open(out, "faces", "[");
    for (size_t i = 0; i < region->listed_faces; i++) {
        qm_json_add_comma(out);
        qm_text_printf(out, "%u", result->deviation.region_face[region->first_face + i]);
    }
    qm_text_add_string(out, "]}");
}

/** The side of the limit on which the greatest distance is, and the regions beyond it. */
static void add_limit(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    const qm_deviation *deviation = &result->deviation;
    if (deviation->max.lower > request->threshold)
        qm_json_add_string(out, "verdict", "above");
    else if (deviation->max.upper <= request->threshold)
        qm_json_add_string(out, "verdict", "below");
    else
        qm_json_add_word(out, "verdict", "null");
    if (!deviation->has_regions) return;
    qm_json_add_count(out, "region_count", deviation->region_count);
    qm_json_open(out, "regions", "[");
    for (size_t i = 0; i < deviation->region_count && i < QM_JOB_LISTED_REGIONS; i++)
        add_region(out, request, result, &deviation->region[i]);
    qm_text_add_string(out, "]");
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
    if (request->sign != QM_SIGN_NONE) add_signed(out, request, result);
    if (!isnan(request->threshold)) add_limit(out, request, result);
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
    QM_JOB_FIELDS_AVERAGES,
    {"bins", QM_FIELD_COUNT, QM_FIELD_AT(bins), .max = QM_JOB_MAX_BINS},
    {"limit", QM_FIELD_LIMIT, QM_FIELD_AT(threshold)},
    {"regions", QM_FIELD_FLAG, QM_FIELD_AT(regions)},
    {"sign", QM_FIELD_CHOICE, QM_FIELD_AT(sign), .names = qm_sign_names},
    {"bands", QM_FIELD_OTHER, .read = read_bands,
     .expected = "must be an array of at most 64 pairs of numbers, ascending; null is no limit"},
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
