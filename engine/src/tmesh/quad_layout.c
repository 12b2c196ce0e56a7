#include "qm/quad_layout.h"

#include "tmesh/tmesh.h"

qm_quad_layout_options qm_quad_layout_options_default(void)
{
    return (qm_quad_layout_options){.effort = 4000};
}

static qm_status check(qm_context *ctx, const qm_mesh *mesh, const qm_quad_layout_options *options)
{
    if (!(options->crease_angle >= 0 && options->crease_angle <= 180))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the crease angle must be from 0 to 180 degrees");
    if (mesh->face_count == 0) return qm_context_fail(ctx, QM_E_EMPTY, "a point set has no quads");
    size_t triangles = 0;
    for (size_t f = 0; f < mesh->face_count; f++)
        triangles += mesh->faces[4 * f + 3] == QM_NO_INDEX;
    if (2 * triangles > mesh->face_count)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "a layout needs a mesh of quads; %zu of %zu faces are triangles",
                               triangles, mesh->face_count);
    return QM_OK;
}

static qm_status make(qm_context *ctx, qm_arena *arena, const qm_mesh *mesh, const qm_ref_surface *surface,
                      const qm_quad_layout_options *options, qm_patch_set *set, qm_layout *out,
                      qm_layout_issues *issues, qm_quad_layout_facts *facts)
{
    qm_tmesh_quads quads;
    qm_tmesh tmesh;
    qm_tmesh_classes classes;
    qm_status status = qm_tmesh_quads_make(arena, mesh, options->crease_angle, &quads);
    if (status == QM_OK) status = qm_patch_set_trace(ctx, &quads.mesh, quads.creases, set);
    if (status == QM_OK) status = qm_tmesh_make(arena, &quads, set, &tmesh);
    if (status != QM_OK) return status;
    uint32_t *length = qm_arena_alloc(arena, tmesh.arc_count, sizeof *length);
    if (!length) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the lengths of arcs");
    status = qm_tmesh_find_lengths(ctx, &quads, &tmesh, options->patches, options->effort, length);
    if (status == QM_OK) status = qm_tmesh_classes_find(arena, &quads, &tmesh, length, 1, &classes);
    if (status == QM_OK)
        status = qm_tmesh_draw_curves(arena, &quads, set, &tmesh, length, &classes, surface, out, issues);
    if (status == QM_OK && facts)
        *facts = (qm_quad_layout_facts){quads.mesh.face_count, quads.special_count, tmesh.patch_count,
                                        out->patch_count};
    return status;
}

qm_status qm_quad_layout_make(qm_context *ctx, const qm_mesh *quads, const qm_ref_surface *surface,
                              const qm_quad_layout_options *options, qm_layout *out, qm_layout_issues *issues,
                              qm_quad_layout_facts *facts)
{
    QM_ASSERT(ctx && quads && surface && options && out && issues);
    *out = (qm_layout){0};
    *issues = (qm_layout_issues){0};
    qm_status status = check(ctx, quads, options);
    if (status != QM_OK) return status;
    qm_arena arena = qm_arena_make(ctx);
    qm_patch_set set = {0};
    status = make(ctx, &arena, quads, surface, options, &set, out, issues, facts);
    qm_patch_set_reset(ctx, &set);
    qm_arena_reset(&arena);
    if (status == QM_OK) return QM_OK;
    qm_layout_reset(ctx, out);
    qm_layout_issues_reset(ctx, issues);
    return status;
}
