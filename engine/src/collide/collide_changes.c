#include "collide_changes.h"

#include <string.h>

#include "bvh/bvh_order.h"

static uint8_t *alloc_zero(qm_context *ctx, size_t count)
{
    uint8_t *block = qm_context_alloc(ctx, count, 1);
    if (block) memset(block, 0, count);
    return block;
}

static bool face_has_moved(const qm_mesh *mesh, const uint8_t *moved, size_t face)
{
    if (mesh->face_count == 0) return moved[face];
    const uint32_t *corner = mesh->faces + 4 * face;
    uint8_t any = moved[corner[0]] | moved[corner[1]] | moved[corner[2]];
    return any | moved[corner[3] == QM_NO_INDEX ? corner[0] : corner[3]];
}

/** Every face of an input face counts as moved when one of them has. */
static void mark_faces(const qm_mesh *mesh, qm_change_marks *marks)
{
    for (size_t i = 0; i < qm_mesh_facet_count(mesh); i++)
        if (face_has_moved(mesh, marks->vertex, i)) marks->face[qm_mesh_input_face(mesh, (uint32_t)i)] = 1;
}

static void mark_nodes(const qm_bvh *bvh, qm_change_marks *marks)
{
    for (size_t pack = 0; pack < bvh->pack_count; pack++) {
        const qm_pack_lanes *lanes = &bvh->lanes[pack];
        unsigned bits = 0;
        for (unsigned lane = 0; lane < lanes->lane_count; lane++)
            bits |= (unsigned)marks->face[qm_mesh_input_face(&bvh->mesh, lanes->face[lane])] << lane;
        marks->level[0][pack] = (uint8_t)bits;
    }
    for (int level = 1; level <= bvh->boxes.level_count; level++)
        for (size_t i = 0; i < bvh->boxes.group_count[level - 1]; i++)
            marks->level[level][i / 8] |= marks->level[level - 1][i] != 0;
}

qm_status qm_change_marks_set(qm_context *ctx, const qm_bvh *bvh, const qm_collide_changes *changes,
                              qm_change_marks *out)
{
    const qm_mesh *mesh = &bvh->mesh;
    *out = (qm_change_marks){.vertex = alloc_zero(ctx, mesh->vertex_count),
                             .face = alloc_zero(ctx, qm_mesh_facet_count(mesh))};
    if (!out->vertex || !out->face) return QM_E_NO_MEMORY;
    for (int level = 0; level <= bvh->boxes.level_count; level++)
        if (!(out->level[level] = alloc_zero(ctx, bvh->boxes.group_count[level]))) return QM_E_NO_MEMORY;
    for (size_t i = 0; i < changes->vertex_count; i++) {
        if (changes->vertices[i] >= mesh->vertex_count)
            return qm_context_fail(ctx, QM_E_INDEX, "entry %zu names vertex %u of a mesh of %zu", i,
                                   changes->vertices[i], mesh->vertex_count);
        out->vertex[changes->vertices[i]] = 1;
    }
    mark_faces(mesh, out);
    mark_nodes(bvh, out);
    return QM_OK;
}

void qm_change_marks_reset(qm_context *ctx, const qm_bvh *bvh, qm_change_marks *marks)
{
    qm_context_free(ctx, marks->vertex, bvh->mesh.vertex_count, 1);
    qm_context_free(ctx, marks->face, qm_mesh_facet_count(&bvh->mesh), 1);
    for (int level = 0; level <= bvh->boxes.level_count; level++)
        qm_context_free(ctx, marks->level[level], bvh->boxes.group_count[level], 1);
    *marks = (qm_change_marks){0};
}

qm_status qm_change_marks_keep(qm_context *ctx, const qm_bvh *bvh, const qm_change_marks *marks,
                               const qm_collide_changes *changes, qm_pair_list *list)
{
    size_t count = qm_mesh_facet_count(&bvh->mesh);
    for (size_t i = 0; i < changes->pair_count; i++) {
        qm_face_pair pair = changes->pairs[i];
        if (pair.a >= count || pair.b >= count)
            return qm_context_fail(ctx, QM_E_INDEX, "pair %zu of before names a face that is not there", i);
        if (marks->face[pair.a] || marks->face[pair.b]) continue;
        if (!qm_pair_list_add(ctx, list, pair)) return QM_E_NO_MEMORY;
    }
    return QM_OK;
}
