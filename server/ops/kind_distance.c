/**
 * kind_distance.c: the least distance of two meshes.
 */
#include "job_kinds_internal.h"

#include <math.h>

static qm_status run(const qm_job_call *call, qm_job_result *out)
{
    qm_distance_options options = {.quads = call->request->quads,
                                   .tolerance = qm_job_tolerance(call),
                                   .limit = call->request->threshold};
    out->tolerance = options.tolerance;
    qm_status status = qm_distance_measure(call->ctx, call->a->bvh, call->b->bvh, &options, &out->distance);
    out->from_face = qm_mesh_input_face(&call->a->mesh, out->distance.from.face);
    out->to_face = qm_mesh_input_face(&call->b->mesh, out->distance.to.face);
    return status;
}

static void write_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    qm_job_add_gap(out, request);
    if (!isnan(request->threshold)) qm_json_add_number(out, "limit", request->threshold);
}

static void write_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    const qm_distance *distance = &result->distance;
    qm_json_add_lower_upper(out, distance->lower, distance->upper, result->diagonal);
    qm_job_add_of_true(out, result, (qm_interval){distance->lower, distance->upper});
    qm_json_open(out, "witness", "{");
    qm_json_add_surface_point(out, "from", "a", request->a, result->from_face, &distance->from);
    qm_json_add_surface_point(out, "to", "b", request->b, result->to_face, &distance->to);
    qm_text_add_string(out, "}");
    qm_json_add_bool(out, "collides", distance->upper == 0.0);
    if (distance->verdict == QM_VERDICT_OPEN)
        qm_json_add_word(out, "verdict", "null");
    else
        qm_json_add_string(out, "verdict", distance->verdict == QM_VERDICT_ABOVE ? "above" : "below");
    qm_json_add_string(out, "quads", qm_quads_names[request->quads]);
    qm_json_add_number(out, "gap", result->tolerance);
    qm_json_add_bool(out, "converged", distance->is_converged);
    qm_json_add_count(out, "face_pairs", distance->pairs);
    qm_json_add_prepare_ms(out, result);
    qm_json_add_ms(out, "elapsed_ms", distance->elapsed_ms);
}

/* threshold is the former name of limit. */
static const qm_job_field fields[] = {QM_JOB_FIELD_PAIR,
                                      QM_JOB_FIELD_QUADS,
                                      QM_JOB_FIELDS_GAP,
                                      QM_JOB_FIELD_BOXES,
                                      {"limit", QM_FIELD_LIMIT, QM_FIELD_AT(threshold)},
                                      {"threshold", QM_FIELD_LIMIT, QM_FIELD_AT(threshold)},
                                      {0}};

const qm_job_hooks qm_job_kind_distance = {
    .type = {.name = "distance", .mesh_field = {"a", "b"}, .is_pure = true},
    .fields = fields,
    .run = run,
    .write_request = write_request,
    .write_result = write_result};
