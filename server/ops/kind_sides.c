/**
 * kind_sides.c: sign, bands and regions of a deviation, for the kinds of job that measure one: fields of requests, and members of
 * results.
 */
#include "job_kinds_internal.h"

#include <math.h>

#include <cjson/cJSON.h>

#include "json_request.h"

const char *const qm_sign_names[] = {"none", "outside", "inside", "normal", NULL};

/* ---- the request ---- */

/** An end of a band: a number, or null for none. */
static bool read_end(const cJSON *value, double none, double *out)
{
    *out = none;
    return cJSON_IsNull(value) || qm_json_read_number(value, out);
}

bool qm_sides_read_bands(const cJSON *value, qm_job_request *out, qm_json_location *at)
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

void qm_sides_check(const qm_job_request *request, qm_problem *problem)
{
    if (request->band_count > 0 && request->sign == QM_SIGN_NONE)
        qm_json_report(problem, "bands", "are of signed distances: sign is needed");
    if (request->regions && isnan(request->threshold))
        qm_json_report(problem, "regions", "are those beyond a limit: limit is needed");
}

/** Adds an end of a band; one that is not finite becomes null. */
static void add_ends(qm_text *out, qm_interval band)
{
    const double ends[2] = {band.lower, band.upper};
    qm_json_add_array(out, ends, 2);
}

void qm_sides_add_request(qm_text *out, const qm_job_request *request)
{
    if (request->sign != QM_SIGN_NONE) qm_json_add_string(out, "sign", qm_sign_names[request->sign]);
    if (!isnan(request->threshold)) qm_json_add_number(out, "limit", request->threshold);
    if (request->regions) qm_json_add_bool(out, "regions", true);
    if (request->band_count == 0) return;
    qm_json_open(out, "bands", "[");
    for (size_t i = 0; i < request->band_count; i++)
        add_ends(out, request->bands[i]);
    qm_text_add_string(out, "]");
}

/* ---- the call ---- */

qm_status qm_sides_find_solid(const qm_job_call *call, const qm_loaded_mesh *mesh, qm_solid *solid,
                              const qm_solid **out)
{
    const qm_job_request *request = call->request;
    *out = NULL;
    if (request->sign == QM_SIGN_NONE || request->sign == QM_SIGN_NORMAL) return QM_OK;
    qm_status status =
        qm_solids_check(mesh->solids, call->ctx, mesh->bvh, request->quads, call->threads, solid);
    if (status == QM_OK) *out = solid;
    return status == QM_E_CANCELED ? QM_OK : status;
}

qm_status qm_sides_set_options(const qm_job_call *call, qm_deviation_options *options, qm_solid *solid)
{
    const qm_job_request *request = call->request;
    options->quads = request->quads;
    options->accuracy = request->accuracy;
    options->tolerance = qm_job_tolerance(call);
    options->piece_limit = request->pieces;
    options->percentile = request->percentiles;
    options->percentile_count = request->percentile_count;
    options->thread_count = call->threads;
    options->sign = request->sign;
    options->band = request->bands;
    options->band_count = request->band_count;
    options->region_limit = request->regions ? request->threshold : NAN;
    options->face_limit = QM_JOB_LISTED_FACES;
    return qm_sides_find_solid(call, call->b, solid, &options->solid);
}

static void name_faces(qm_surface_point *from, qm_surface_point *to, const qm_loaded_mesh *source,
                       const qm_loaded_mesh *target)
{
    from->face = qm_mesh_input_face(&source->mesh, from->face);
    to->face = qm_mesh_input_face(&target->mesh, to->face);
}

void qm_sides_name_faces(qm_deviation *deviation, const qm_loaded_mesh *source, const qm_loaded_mesh *target)
{
    qm_deviation_side *const part[2] = {&deviation->sides.front, &deviation->sides.behind};
    for (int i = 0; i < 2; i++)
        if (part[i]->has_witness) name_faces(&part[i]->from, &part[i]->to, source, target);
    for (size_t i = 0; i < deviation->worst_count; i++)
        name_faces(&deviation->worst[i].from, &deviation->worst[i].to, source, target);
    for (size_t i = 0; i < deviation->region_count; i++)
        name_faces(&deviation->region[i].from, &deviation->region[i].to, source, target);
}

/* ---- the result ---- */

void qm_sides_add_points(qm_text *out, const qm_job_request *request, int side, const qm_surface_point *from,
                         const qm_surface_point *to)
{
    const char *const names[2] = {"a", "b"}, *const ids[2] = {request->a, request->b};
    qm_json_add_surface_point(out, "from", names[side], ids[side], from->face, from);
    qm_json_add_surface_point(out, "to", names[1 - side], ids[1 - side], to->face, to);
}

static void add_witness(qm_text *out, const qm_job_request *request, int side, const qm_surface_point *from,
                        const qm_surface_point *to)
{
    qm_json_open(out, "witness", "{");
    qm_sides_add_points(out, request, side, from, to);
    qm_text_add_string(out, "}");
}

/** Without an interval for the true surfaces: how near B is to its true surface says nothing of which side of that a point is
 * on, however far from B. The inside of a ball's surface is that of the ball, and that of a thin shell along it the shell. So it is with
 * the signed mean, bands and penetrations. */
static void add_part(qm_text *out, const char *name, const qm_job_request *request,
                     const qm_job_result *result, const qm_deviation_side *part, int side)
{
    qm_json_open(out, name, "{");
    qm_json_add_interval(out, "max", part->max, result->diagonal);
    qm_json_add_range(out, "size", part->size);
    if (part->has_witness) add_witness(out, request, side, &part->from, &part->to);
    qm_text_add_string(out, "}");
}

void qm_sides_add_signed(qm_text *out, const qm_job_request *request, const qm_job_result *result,
                         const qm_deviation *deviation, int side)
{
    const qm_signed_deviation *sides = &deviation->sides;
    qm_json_open(out, "signed", "{");
    qm_json_add_string(out, "sign", qm_sign_names[request->sign]);
    qm_json_add_bool(out, "proven", sides->is_proven);
    qm_json_add_range(out, "mean", sides->mean);
    add_part(out, "outside", request, result, &sides->front, side);
    add_part(out, "inside", request, result, &sides->behind, side);
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
                       const qm_deviation *deviation, const qm_deviation_region *region, int side)
{
    qm_json_add_comma(out);
    qm_text_add_string(out, "{");
    qm_json_add_bool(out, "surely", region->parts > 0 || region->max.lower > request->threshold);
    qm_json_add_count(out, "parts", region->parts);
    qm_json_add_range(out, "area", region->area);
    /* Each point of the true A that is within A's uncertainty eA of the region has a point of the region within eA, and so is
     * no farther from the true B than that from B, plus eA and eB; and the point of the region that is at least max.lower from B
     * has one of the true A within eA, which is no nearer than max.lower less eA and eB. */
    qm_averages_add_greatest(out, "max", region->max, result);
    if (region->has_witness) add_witness(out, request, side, &region->from, &region->to);
    qm_json_add_numbers(out, "centroid", region->centroid, 3);
    qm_json_open(out, "box", "{");
    qm_json_add_numbers(out, "min", region->box.min, 3);
    qm_json_add_numbers(out, "max", region->box.max, 3);
    qm_text_add_string(out, "}");
    qm_json_add_count(out, "face_count", region->face_count);
    qm_json_open(out, "faces", "[");
    for (size_t i = 0; i < region->listed_faces; i++) {
        qm_json_add_comma(out);
        qm_text_printf(out, "%u", deviation->region_face[region->first_face + i]);
    }
    qm_text_add_string(out, "]}");
}

void qm_sides_add_limit(qm_text *out, const qm_job_request *request, const qm_job_result *result,
                        const qm_deviation *deviation, int side)
{
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
        add_region(out, request, result, deviation, &deviation->region[i], side);
    qm_text_add_string(out, "]");
}
