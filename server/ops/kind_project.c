/**
 * kind_project.c: nearest points of a mesh.
 */
#include "job_kinds_internal.h"

#include "json_request.h"

static qm_status run(const qm_job_call *call, qm_job_result *out)
{
    const qm_job_request *request = call->request;
    qm_locator locator;
    qm_status status =
        qm_locator_build(call->ctx, call->a->bvh, call->a->tetra, request->accelerator, &locator);
    if (status == QM_OK)
        status = qm_projections_find(call->ctx, call->a, &locator, request->quads, request->points,
                                     request->point_count, call->threads, &out->projections);
    qm_locator_reset(call->ctx, &locator);
    return status;
}

static void reset(qm_context *ctx, qm_job_result *result)
{
    qm_projections_reset(ctx, &result->projections);
}

static bool read_points(const struct cJSON *value, qm_job_request *out, qm_json_location *at)
{
    return qm_json_read_points(value, &out->points, &out->point_count, at);
}

static void write_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    if (is_brief) {
        qm_json_add_count(out, "point_count", request->point_count);
        return;
    }
    qm_json_open(out, "points", "[");
    for (size_t i = 0; i < request->point_count; i++)
        qm_json_add_array(out, request->points + 3 * i, 3);
    qm_text_add_string(out, "]");
}

static void write_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    const qm_projections *projections = &result->projections;
    qm_json_add_string(out, "quads", qm_quads_names[request->quads]);
    qm_json_add_count(out, "point_count", projections->count);
    qm_json_open(out, "points", "[");
    for (size_t i = 0; i < projections->count; i++)
        qm_json_write_projection(out, projections, i, result->diagonal);
    qm_text_add_string(out, "]");
    qm_json_add_ms(out, "prepare_ms", result->prepare_a_ms);
    qm_json_add_ms(out, "elapsed_ms", result->elapsed_ms);
}

static const qm_job_field fields[] = {
    QM_JOB_FIELD_MESH,
    QM_JOB_FIELD_QUADS,
    QM_JOB_FIELD_ACCELERATOR,
    {"points", QM_FIELD_OTHER, .is_required = true, .read = read_points,
     .expected = "must be an array of points, each an array of three finite numbers"},
    {0}};

const qm_job_hooks qm_job_kind_project = {
    .type = {.name = "project", .mesh_field = {"mesh", NULL}, .is_pure = true},
    .fields = fields,
    .run = run,
    .write_request = write_request,
    .write_result = write_result,
    .reset = reset};
