/**
 * kind_heatmap.c: A cut into triangles with the distance at their corners.
 */
#include <math.h>

#include "job_kinds_internal.h"

#define DEFAULT_ERROR 1e-3 /* of A's diagonal */

static qm_status run(const qm_job_call *call, qm_job_result *out)
{
    const qm_job_request *request = call->request;
    double diagonal = call->a->diagonal > 0.0 ? call->a->diagonal : 1.0;
    qm_heatmap_options options = {.quads = request->quads,
                                  .error = request->error > 0.0 ? request->error : DEFAULT_ERROR * diagonal,
                                  .piece_limit = request->pieces,
                                  .thread_count = call->threads};
    out->tolerance = options.error;
    return qm_heatmap_make(call->ctx, call->a->bvh, call->b->bvh, &options, &out->heatmap);
}

static const double *find_triangles(const qm_job_result *result, size_t *count)
{
    *count = QM_HEATMAP_COLUMNS * result->heatmap.count;
    return result->heatmap.row;
}

static void reset(qm_context *ctx, qm_job_result *result)
{
    qm_heatmap_reset(ctx, &result->heatmap);
}

static void write_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    if (request->error > 0.0) qm_json_add_number(out, "error", request->error);
}

static void write_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    const qm_heatmap *map = &result->heatmap;
    qm_json_add_count(out, "count", map->count);
    qm_json_add_number(out, "error", map->error);
    qm_json_add_number(out, "requested_error", result->tolerance);
    qm_json_add_bool(out, "accurate", map->is_accurate);
    qm_json_add_string(out, "quads", qm_quads_names[request->quads]);
    qm_json_add_prepare_ms(out, result);
    qm_json_add_ms(out, "elapsed_ms", map->elapsed_ms);
}

static const qm_job_array triangles = {
    "triangles", "x0,y0,z0,distance0,x1,y1,z1,distance1,x2,y2,z2,distance2,face,error", QM_HEATMAP_COLUMNS};

static const qm_job_field fields[] = {QM_JOB_FIELD_PAIR,   QM_JOB_FIELD_QUADS,
                                      QM_JOB_FIELD_BOXES,  {"error", QM_FIELD_POSITIVE, QM_FIELD_AT(error)},
                                      QM_JOB_FIELD_PIECES, {0}};

const qm_job_hooks qm_job_kind_heatmap = {
    .type = {.name = "heatmap", .mesh_field = {"a", "b"}, .is_pure = true},
    .fields = fields,
    .run = run,
    .write_request = write_request,
    .write_result = write_result,
    .array = &triangles,
    .find_array = find_triangles,
    .reset = reset};
