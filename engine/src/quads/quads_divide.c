/**
 * quads_divide.c: each quad is cut into four.
 */
#include <string.h>

#include "mesh/patch_work.h"
#include "quads/quads_internal.h"

static qm_vec mean_of(const qm_mesh *mesh, const uint32_t *corner, int count)
{
    qm_vec sum = {0, 0, 0};
    for (int k = 0; k < count; k++)
        sum = qm_vec_axpy(sum, 1.0 / count, qm_vec_load(mesh->positions + 3 * (size_t)corner[k]));
    return sum;
}

/** Numbers the middle of each side, linked ones alike. Returns the next number. */
static uint32_t number_middles(const qm_patch_links *links, uint32_t next, uint32_t *middle)
{
    for (uint32_t s = 0; s < 4 * links->face_count; s++) {
        const qm_patch_side at = {s / 4, s % 4};
        bool same_way;
        middle[s] = next;
        if (qm_patch_links_has(links, at)) {
            const qm_patch_side across = qm_patch_links_across(links, at, &same_way);
            uint32_t twin = 4 * across.face + across.side;
            if (twin < s) middle[s] = middle[twin];
        }
        next += middle[s] == next;
    }
    return next;
}

/** The part of a face at its corner k: corner, next middle, centre, last middle. */
static void write_part(const uint32_t *corner, const uint32_t *middle, uint32_t centre, int k, uint32_t *out)
{
    out[k] = corner[k];
    out[(k + 1) & 3] = middle[k];
    out[(k + 2) & 3] = centre;
    out[(k + 3) & 3] = middle[(k + 3) & 3];
}

static qm_status write_mesh(qm_context *ctx, const qm_mesh *mesh, const uint32_t *middle,
                            uint32_t first_centre, qm_mesh *out)
{
    out->vertex_count = first_centre + mesh->face_count;
    out->face_count = 4 * mesh->face_count;
    out->positions = qm_context_alloc(ctx, out->vertex_count, 3 * sizeof *out->positions);
    out->faces = qm_context_alloc(ctx, out->face_count, 4 * sizeof *out->faces);
    if (!out->positions || !out->faces) {
        qm_mesh_reset(ctx, out);
        return QM_E_NO_MEMORY;
    }
    memcpy(out->positions, mesh->positions, 3 * mesh->vertex_count * sizeof *mesh->positions);
    for (size_t f = 0; f < mesh->face_count; f++) {
        const uint32_t *corner = mesh->faces + 4 * f, *at = middle + 4 * f;
        uint32_t centre = first_centre + (uint32_t)f;
        qm_vec_store(out->positions + 3 * (size_t)centre, mean_of(mesh, corner, 4));
        for (int k = 0; k < 4; k++) {
            const uint32_t side[2] = {corner[k], corner[(k + 1) & 3]};
            qm_vec_store(out->positions + 3 * (size_t)at[k], mean_of(mesh, side, 2));
            write_part(corner, at, centre, k, out->faces + 4 * (4 * f + (size_t)k));
        }
    }
    return QM_OK;
}

qm_status qm_quads_divide(qm_context *ctx, const qm_mesh *mesh, qm_mesh *out)
{
    QM_ASSERT(ctx && mesh && out);
    qm_patch_links links = {0};
    size_t sides = 4 * mesh->face_count;
    uint32_t *middle = qm_context_alloc(ctx, sides, sizeof *middle);
    *out = (qm_mesh){0};
    qm_status status = middle ? qm_patch_links_find(ctx, mesh, &links) : QM_E_NO_MEMORY;
    if (status == QM_OK) {
        uint32_t centre = number_middles(&links, (uint32_t)mesh->vertex_count, middle);
        status = write_mesh(ctx, mesh, middle, centre, out);
    }
    qm_patch_links_reset(ctx, &links);
    qm_context_free(ctx, middle, sides, sizeof *middle);
    return status == QM_E_NO_MEMORY ? qm_context_fail(ctx, status, "out of memory for quads in four parts")
                                    : status;
}
