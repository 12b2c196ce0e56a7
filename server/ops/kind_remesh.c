/**
 * kind_remesh.c: a mesh of quads of a surface, whose distance from it is known.
 */
#include <cjson/cJSON.h>

#include "job_kinds_internal.h"
#include "json_request.h"
#include "settle.h"

/** Replaces the distance, which is that of the surface that was made of points, by that of the points themselves. */
static qm_status measure_points(const qm_job_call *call, const qm_ref_surface *points,
                                const qm_faced_surface *faced, const qm_remesh_options *options,
                                qm_job_result *out)
{
    qm_remesh_result *made = &out->remesh;
    const qm_settle_goal goal = {.quads = options->quads};
    qm_settle_distance distance;
    out->faced = (qm_faced_points){true, faced->record, {made->lower, made->upper}};
    qm_status status = qm_settle_measure(call->ctx, points, &goal, &made->mesh, &distance);
    if (status != QM_OK) return status;
    qm_interval both = qm_settle_two_sided(&distance);
    made->from_surface = distance.from_surface;
    made->from_quads = distance.from_quads;
    made->lower = both.lower;
    made->upper = both.upper;
    return QM_OK;
}

static qm_status run(const qm_job_call *call, qm_job_result *out)
{
    qm_remesh_options options = call->request->remesh;
    options.quads.thread_count = call->threads;
    qm_ref_surface given;
    qm_status status = qm_ref_surface_init(call->ctx, call->a->bvh, &given);
    if (status != QM_OK) return status;
    options.distance = call->request->distance_relative * given.diagonal;
    qm_faced_surface faced;
    const qm_remesh_stage stage = {.work = QM_REMESH_SURFACE};
    if (given.is_cloud && options.on_stage) options.on_stage(options.user, &stage);
    status = qm_faced_surface_make(call->ctx, &given, call->threads, &faced);
    if (status == QM_OK) status = qm_remesh(call->ctx, &faced.surface, &options, &out->remesh);
    if (status == QM_OK && faced.is_made) status = measure_points(call, &given, &faced, &options, out);
    qm_faced_surface_reset(call->ctx, &faced);
    if (status == QM_OK) status = qm_mesh_find_facts(call->ctx, &out->remesh.mesh, &out->made_facts);
    if (status == QM_OK) qm_quality_measure(&out->remesh.mesh, &out->made_quality);
    return status;
}

static const qm_mesh *find_mesh(const qm_job_result *result, const qm_mesh_facts **facts)
{
    *facts = &result->made_facts;
    return &result->remesh.mesh;
}

static void reset(qm_context *ctx, qm_job_result *result)
{
    qm_mesh_reset(ctx, &result->remesh.mesh);
}

static bool read_angle(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    (void)at;
    double *angle = &out->remesh.quads.crease_angle;
    return qm_json_read_number(value, angle) && *angle >= 0.0 && *angle <= 180.0;
}

static void write_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    const qm_remesh_options *options = &request->remesh;
    if (options->quads.quads > 0) qm_json_add_count(out, "quads", options->quads.quads);
    if (request->distance_relative > 0.0) qm_json_add_number(out, "distance", request->distance_relative);
    qm_json_add_bool(out, "semi_regular", options->is_semi_regular);
    qm_json_add_number(out, "crease_angle", options->quads.crease_angle);
}

static void write_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    const qm_remesh_result *made = &result->remesh;
    if (result->mesh[0]) qm_json_add_string(out, "mesh", result->mesh);
    qm_json_add_count(out, "quads", made->mesh.face_count);
    qm_json_add_count(out, "irregular_vertices", result->made_facts.irregular_vertices);
    qm_json_add_count(out, "components", result->made_facts.components);
    if (made->patches > 0) {
        qm_json_add_count(out, "patches", made->patches);
        qm_json_add_string(out, "patches_from", qm_remesh_origin_names[made->origin]);
    }
    qm_json_add_count(out, "folded", result->made_quality.folded);
    qm_json_add_number(out, "least_scaled_jacobian", result->made_quality.least_jacobian);
    qm_json_add_interval(out, "hausdorff", (qm_interval){made->lower, made->upper}, result->diagonal);
    qm_json_add_interval(out, "from_surface", made->from_surface, result->diagonal);
    qm_json_add_interval(out, "from_quads", made->from_quads, result->diagonal);
    double reached = result->faced.is_made ? result->faced.hausdorff.upper : made->upper;
    if (request->distance_relative > 0.0)
        qm_json_add_bool(out, "reached", reached <= request->distance_relative * result->diagonal);
    qm_faced_surface_describe(out, &result->faced, result->diagonal);
    qm_json_add_count(out, "rounds", made->rounds);
    qm_json_add_ms(out, "prepare_ms", result->prepare_a_ms);
    qm_json_add_ms(out, "elapsed_ms", result->elapsed_ms);
}

static const qm_job_field fields[] = {
    QM_JOB_FIELD_MESH,
    {"quads", QM_FIELD_COUNT, QM_FIELD_AT(remesh.quads.quads), .min = 1, .max = QM_REMESH_MOST_QUADS},
    {"distance", QM_FIELD_POSITIVE, QM_FIELD_AT(distance_relative)},
    {"semi_regular", QM_FIELD_FLAG, QM_FIELD_AT(remesh.is_semi_regular)},
    {"crease_angle", QM_FIELD_OTHER, .read = read_angle, .expected = "must be a number from 0 to 180"},
    {0}};

/* Not pure: the mesh that an earlier job has made may be deleted by now. */
const qm_job_hooks qm_job_kind_remesh = {.type = {.name = "remesh", .mesh_field = {"mesh", NULL}},
                                         .fields = fields,
                                         .run = run,
                                         .write_request = write_request,
                                         .write_result = write_result,
                                         .find_mesh = find_mesh,
                                         .reset = reset};
