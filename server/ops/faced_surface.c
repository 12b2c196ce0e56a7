/**
 * faced_surface.c: a mesh of triangles of a point set, with its tree.
 */
#include "faced_surface.h"

#include "base/json.h"
#include "json_out.h"

qm_status qm_faced_surface_make(qm_context *ctx, const qm_ref_surface *given, int thread_count,
                                qm_faced_surface *out)
{
    *out = (qm_faced_surface){.surface = *given, .is_made = given->is_cloud};
    if (!out->is_made) return QM_OK;
    qm_cloud_options options = qm_cloud_options_default();
    options.thread_count = thread_count;
    qm_status status = qm_cloud_make_surface(ctx, given, &options, &out->mesh, &out->record);
    if (status == QM_OK) status = qm_bvh_build(ctx, &out->mesh, QM_BVH_TARGET, thread_count, &out->tree);
    if (status == QM_OK) status = qm_ref_surface_init(ctx, out->tree, &out->surface);
    if (status != QM_OK) qm_faced_surface_reset(ctx, out);
    return status;
}

void qm_faced_surface_reset(qm_context *ctx, qm_faced_surface *surface)
{
    qm_bvh_destroy(ctx, surface->tree);
    qm_mesh_reset(ctx, &surface->mesh);
    *surface = (qm_faced_surface){0};
}

void qm_faced_surface_describe(qm_text *out, const qm_faced_points *points, double diagonal)
{
    const qm_cloud_record *record = &points->record;
    if (!points->is_made) return;
    qm_json_open(out, "points", "{");
    qm_json_add_count(out, "used", record->points);
    qm_json_add_count(out, "outliers", record->outliers);
    qm_json_add_number(out, "noise_relative", record->noise / diagonal);
    qm_json_add_number(out, "spacing_relative", record->spacing / diagonal);
    qm_json_add_string(out, "normals", record->has_own_normals ? "given" : "estimated");
    qm_json_add_count(out, "holes_filled", record->holes_filled);
    qm_json_add_number(out, "filled_share", record->filled_share);
    qm_json_add_number(out, "thin_share", record->thin_share);
    qm_json_add_count(out, "borders", record->borders);
    qm_json_add_interval(out, "hausdorff", points->hausdorff, diagonal);
    qm_text_add_string(out, "}");
}
