/**
 * kind_reconstruction_step.c: refinement of a reconstruction.
 */
#include "job_kinds_internal.h"

#include <cjson/cJSON.h>
#include <string.h>

#include "json_request.h"

/** Settles the mesh after the steps. What is canceled then has its steps, but is not settled. */
static qm_status settle(const qm_job_call *call, const qm_refine_goal *goal, qm_job_result *out)
{
    const qm_job_refinement *refining = call->request->refining;
    qm_settle_goal how = {.quads = qm_quads_options_default(), .distance = goal->hausdorff};
    how.quads.thread_count = call->threads;
    qm_status status = qm_settle_reconstruction(call->ctx, refining->source, &how, refining->reconstruction,
                                                &out->settled_mesh, &out->settled);
    if (status != QM_E_CANCELED) return status;
    out->refine_stop = QM_REFINE_CANCELED;
    return QM_OK;
}

static qm_status run(const qm_job_call *call, qm_job_result *out)
{
    const qm_job_refinement *refining = call->request->refining;
    if (call->request->settles && refining->source->is_cloud)
        return qm_context_fail(
            call->ctx, QM_E_ARGUMENT,
            "settle moves vertices along the faces of a mesh, and the source is a point set");
    qm_refine_goal goal = call->request->goal;
    goal.hausdorff = call->request->hausdorff_relative * refining->source->diagonal;
    goal.thread_count = call->threads;
    qm_status status = qm_refine(call->ctx, refining->reconstruction, refining->source, &goal,
                                 refining->on_step, refining->user, &out->refine_stop);
    bool has_noise =
        qm_reconstruction_noise(refining->reconstruction) > 0.0; /* settled quads would follow it */
    if (status == QM_OK && call->request->settles && !has_noise && out->refine_stop != QM_REFINE_CANCELED)
        status = settle(call, &goal, out);
    out->is_canceled = status == QM_OK && out->refine_stop == QM_REFINE_CANCELED;
    return status;
}

static bool read_until(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    (void)at;
    if (!cJSON_IsObject(value)) return false;
    for (const cJSON *member = value->child; member; member = member->next) {
        bool good = false;
        if (strcmp(member->string, "hausdorff_relative") == 0) {
            good = qm_json_read_number(member, &out->hausdorff_relative) && out->hausdorff_relative > 0.0;
        } else if (strcmp(member->string, "edge_length") == 0) {
            good = qm_json_read_number(member, &out->goal.edge) && out->goal.edge > 0.0;
        } else if (strcmp(member->string, "max_quads") == 0) {
            good = qm_json_read_count(member, 1, QM_REFINE_MAX_QUADS, &out->goal.max_quads);
        }
        if (!good) return false;
    }
    return true;
}

static void write_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    const qm_refine_goal *goal = &request->goal;
    if (goal->steps > 0) qm_json_add_count(out, "steps", goal->steps);
    qm_json_open(out, "until", "{");
    if (request->hausdorff_relative > 0.0)
        qm_json_add_number(out, "hausdorff_relative", request->hausdorff_relative);
    if (goal->max_quads > 0) qm_json_add_count(out, "max_quads", goal->max_quads);
    if (goal->edge > 0.0) qm_json_add_number(out, "edge_length", goal->edge);
    qm_text_add_string(out, "}");
    qm_json_add_bool(out, "measure", goal->measures);
    if (request->settles) qm_json_add_bool(out, "settle", true);
}

static void reset(qm_context *ctx, qm_job_result *result)
{
    qm_mesh_reset(ctx, &result->settled_mesh);
}

static void write_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    qm_json_add_string(out, "reconstruction", request->a);
    qm_json_add_string(out, "mesh", result->mesh);
    qm_json_add_count(out, "quads", result->quads);
    qm_json_add_count(out, "step_count", result->step_count);
    qm_json_add_string(out, "stopped_by", qm_refine_stop_name(result->refine_stop));
    qm_json_open(out, "steps", "[");
    qm_text_add_string(out, result->records);
    qm_text_add_string(out, "]");
    if (result->settled_mesh.face_count > 0) qm_json_add_settled(out, &result->settled, result->diagonal);
    qm_json_add_ms(out, "prepare_ms", result->prepare_a_ms);
    qm_json_add_ms(out, "elapsed_ms", result->elapsed_ms);
}

static const qm_job_field fields[] = {
    QM_JOB_FIELD_ID("reconstruction", a, "must be the id of a reconstruction"),
    {"steps", QM_FIELD_COUNT, QM_FIELD_AT(goal.steps), .min = 1, .max = QM_JOB_MAX_STEPS},
    {"until", QM_FIELD_OTHER, .read = read_until,
     .expected =
         "must be an object with one or more of hausdorff_relative, max_quads and edge_length, each above 0"},
    {"measure", QM_FIELD_FLAG, QM_FIELD_AT(goal.measures)},
    {"settle", QM_FIELD_FLAG, QM_FIELD_AT(settles)},
    {0}};

const qm_job_hooks qm_job_kind_reconstruction_step = {
    .type = {.name = "reconstruction_step", .mesh_field = {"reconstruction", NULL}},
    .fields = fields,
    .run = run,
    .write_request = write_request,
    .write_result = write_result,
    .reset = reset};
