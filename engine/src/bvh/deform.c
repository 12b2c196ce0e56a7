/**
 * deform.c: which faces a vertex has, and where each face lies in its tree.
 */
#include "deform.h"

#include "bvh_order.h"
#include "core/bits.h"
#include "core/face_ring.h"

#define AHEAD 16 /* vertices ahead of the one at hand whose faces are fetched */

static void lay_out_faces(qm_deformer *deformer, const qm_mesh *mesh)
{
    memset(deformer->start, 0, (mesh->vertex_count + 1) * sizeof *deformer->start);
    for (size_t f = 0; f < mesh->face_count; f++)
        for (int i = 0; i < qm_face_corners(mesh->faces + 4 * f); i++)
            deformer->start[mesh->faces[4 * f + (size_t)i]]++;
    uint32_t end = 0;
    for (size_t v = 0; v <= mesh->vertex_count; v++) {
        end += deformer->start[v];
        deformer->start[v] = end;
    }
    /* Filling from the end moves each mark from the end of its vertex's faces to their start. */
    for (size_t f = mesh->face_count; f-- > 0;)
        for (int i = 0; i < qm_face_corners(mesh->faces + 4 * f); i++)
            deformer->faces[--deformer->start[mesh->faces[4 * f + (size_t)i]]] = (uint32_t)f;
}

static void map_packs(qm_deformer *deformer, const qm_bvh *bvh)
{
    uint32_t end = 0;
    for (size_t pack = 0; pack < bvh->pack_count; pack++) {
        const qm_pack_lanes *lanes = &bvh->lanes[pack];
        for (int lane = 0; lane < lanes->lane_count; lane++)
            deformer->face_pack[lanes->face[lane]] = (uint32_t)pack;
        deformer->pack_start[pack] = end;
        for (int i = 0; i < lanes->vertex_count; i++)
            deformer->pack_vertices[end++] = lanes->vertex[i];
    }
    deformer->pack_start[bvh->pack_count] = end;
}

static size_t count_pack_vertices(const qm_bvh *bvh)
{
    size_t count = 0;
    for (size_t pack = 0; pack < bvh->pack_count; pack++)
        count += bvh->lanes[pack].vertex_count;
    return count;
}

static size_t count_corners(const qm_mesh *mesh)
{
    size_t corners = 0;
    for (size_t f = 0; f < mesh->face_count; f++)
        corners += (size_t)qm_face_corners(mesh->faces + 4 * f);
    return corners;
}

qm_status qm_deformer_build(qm_context *ctx, const qm_bvh *bvh, qm_deformer **out)
{
    const qm_mesh *mesh = &bvh->mesh;
    *out = NULL;
    qm_deformer *deformer = qm_context_alloc(ctx, 1, sizeof *deformer);
    if (!deformer) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a deformation");
    *deformer = (qm_deformer){.vertex_count = mesh->vertex_count,
                              .face_count = qm_mesh_facet_count(mesh),
                              .corner_count = count_corners(mesh),
                              .pack_count = bvh->pack_count,
                              .pack_vertex_count = count_pack_vertices(bvh)};
    deformer->start = qm_context_alloc(ctx, deformer->vertex_count + 1, sizeof *deformer->start);
    deformer->faces = qm_context_alloc(ctx, deformer->corner_count, sizeof *deformer->faces);
    deformer->face_pack = qm_context_alloc(ctx, deformer->face_count, sizeof *deformer->face_pack);
    deformer->pack_start = qm_context_alloc(ctx, deformer->pack_count + 1, sizeof *deformer->pack_start);
    deformer->pack_vertices =
        qm_context_alloc(ctx, deformer->pack_vertex_count, sizeof *deformer->pack_vertices);
    bool has_faces = deformer->faces || deformer->corner_count == 0;
    bool has_packs = deformer->face_pack && deformer->pack_start && deformer->pack_vertices;
    if (!deformer->start || !has_faces || !has_packs) {
        qm_deformer_destroy(ctx, deformer);
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a deformation");
    }
    lay_out_faces(deformer, mesh);
    map_packs(deformer, bvh);
    *out = deformer;
    return QM_OK;
}

void qm_deformer_destroy(qm_context *ctx, qm_deformer *deformer)
{
    if (!deformer) return;
    qm_context_free(ctx, deformer->start, deformer->vertex_count + 1, sizeof *deformer->start);
    qm_context_free(ctx, deformer->faces, deformer->corner_count, sizeof *deformer->faces);
    qm_context_free(ctx, deformer->face_pack, deformer->face_count, sizeof *deformer->face_pack);
    qm_context_free(ctx, deformer->pack_start, deformer->pack_count + 1, sizeof *deformer->pack_start);
    qm_context_free(ctx, deformer->pack_vertices, deformer->pack_vertex_count,
                    sizeof *deformer->pack_vertices);
    qm_context_free(ctx, deformer, 1, sizeof *deformer);
}

size_t qm_deformer_memory_size(const qm_deformer *deformer)
{
    return sizeof *deformer + (deformer->vertex_count + 1) * sizeof *deformer->start +
           deformer->corner_count * sizeof *deformer->faces +
           deformer->face_count * sizeof *deformer->face_pack +
           (deformer->pack_count + 1) * sizeof *deformer->pack_start +
           deformer->pack_vertex_count * sizeof *deformer->pack_vertices;
}

/** Fetches the faces of a vertex that comes soon, and where those of a later one begin. */
static void fetch_faces(const qm_deformer *deformer, uint32_t soon, uint32_t later)
{
    if (soon < deformer->vertex_count) __builtin_prefetch(deformer->faces + deformer->start[soon]);
    if (later < deformer->vertex_count) __builtin_prefetch(deformer->start + later);
}

static qm_status mark_faces(qm_context *ctx, const qm_deformer *deformer, const uint32_t *vertices,
                            size_t vertex_count, uint64_t *marks)
{
    bool is_point_set = deformer->corner_count == 0;
    for (size_t i = 0; i < vertex_count; i++) {
        if (i + 2 * AHEAD < vertex_count) fetch_faces(deformer, vertices[i + AHEAD], vertices[i + 2 * AHEAD]);
        uint32_t v = vertices[i];
        if (v >= deformer->vertex_count)
            return qm_context_fail(ctx, QM_E_INDEX, "entry %zu names vertex %u, the mesh has %zu", i, v,
                                   deformer->vertex_count);
        if (is_point_set) qm_bits_add(marks, v);
        for (uint32_t k = deformer->start[v]; k < deformer->start[v + 1]; k++)
            qm_bits_add(marks, deformer->faces[k]);
    }
    return QM_OK;
}

qm_status qm_deformer_find_faces(qm_context *ctx, const qm_deformer *deformer, const uint32_t *vertices,
                                 size_t vertex_count, uint32_t **faces, size_t *face_count)
{
    *faces = NULL;
    *face_count = 0;
    uint64_t *marks = qm_bits_create(ctx, deformer->face_count);
    if (!marks) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a deformation");
    qm_status status = mark_faces(ctx, deformer, vertices, vertex_count, marks);
    size_t count = status == QM_OK ? qm_bits_count(marks, deformer->face_count) : 0;
    if (count > 0) {
        *faces = qm_context_alloc(ctx, count, sizeof **faces);
        if (*faces)
            *face_count = qm_bits_list(marks, deformer->face_count, *faces);
        else
            status = qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a deformation");
    }
    qm_bits_free(ctx, marks, deformer->face_count);
    return status;
}
