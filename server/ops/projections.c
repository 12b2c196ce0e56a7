/**
 * projections.c: projections of points, and their records.
 */
#include "projections.h"

#include <endian.h>
#include <math.h>
#include <string.h>

#include "json_out.h"

void qm_projections_reset(qm_context *ctx, qm_projections *projections)
{
    qm_context_free(ctx, projections->distance, projections->count, sizeof *projections->distance);
    qm_context_free(ctx, projections->position, projections->count, 3 * sizeof *projections->position);
    qm_context_free(ctx, projections->uv, projections->count, 2 * sizeof *projections->uv);
    qm_context_free(ctx, projections->patch, projections->count, sizeof *projections->patch);
    qm_context_free(ctx, projections->face, projections->count, sizeof *projections->face);
    *projections = (qm_projections){0};
}

qm_status qm_projections_find(qm_context *ctx, const qm_loaded_mesh *mesh, const qm_locator *locator,
                              qm_quad_reading quads, const double *points, size_t count, int threads,
                              qm_projections *out)
{
    QM_ASSERT(count == 0 || points);
    *out = (qm_projections){.count = count};
    if (count == 0) return QM_OK;
    out->distance = qm_context_alloc(ctx, count, sizeof *out->distance);
    out->position = qm_context_alloc(ctx, count, 3 * sizeof *out->position);
    out->uv = qm_context_alloc(ctx, count, 2 * sizeof *out->uv);
    out->face = qm_context_alloc(ctx, count, sizeof *out->face);
    if (mesh->tetra) out->patch = qm_context_alloc(ctx, count, sizeof *out->patch);
    bool has_patches = out->patch || !mesh->tetra;
    qm_projection projection = {out->distance, out->position, out->face, out->uv};
    qm_status status;
    if (out->distance && out->position && out->uv && out->face && has_patches)
        status = qm_project_points_with(ctx, locator, quads, points, count, threads, &projection);
    else
        status = qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for %zu points", count);
    for (size_t i = 0; status == QM_OK && out->patch && i < count; i++)
        out->patch[i] = (uint32_t)qm_tetra_find_patch(mesh->tetra, out->face[i]);
    for (size_t i = 0; status == QM_OK && i < count; i++)
        out->face[i] = qm_mesh_input_face(&mesh->mesh, out->face[i]);
    if (status != QM_OK) qm_projections_reset(ctx, out);
    return status;
}

size_t qm_projections_find_invalid(const double *numbers, size_t count)
{
    size_t i = 0;
    while (i < count && isfinite(numbers[i]))
        i++;
    return i;
}

void qm_projections_widen(double *numbers, size_t count)
{
    const char *bytes = (const char *)numbers;
    for (size_t i = count; i-- > 0;) {
        uint32_t bits;
        float number;
        memcpy(&bits, bytes + i * sizeof bits, sizeof bits);
        bits = le32toh(bits);
        memcpy(&number, &bits, sizeof bits);
        numbers[i] = (double)number;
    }
}

void qm_projections_write_begin(qm_text *out, qm_array_format format)
{
    static const char *const starts[] = {"", "distance,x,y,z,face,u,v\n", "{\"points\":["};
    qm_text_add_string(out, starts[format]);
}

void qm_projections_write_end(qm_text *out, qm_array_format format)
{
    if (format == QM_ARRAY_JSON) qm_text_add_string(out, "]}\n");
}

void qm_projections_write(qm_text *out, qm_array_format format, const qm_projections *projections,
                          double diagonal, bool is_first)
{
    if (format == QM_ARRAY_JSON && !is_first && projections->count > 0) qm_text_add_string(out, ",");
    for (size_t i = 0; i < projections->count; i++) {
        const double *p = projections->position + 3 * i, *uv = projections->uv + 2 * i;
        double record[7] = {projections->distance[i],     p[0],  p[1], p[2],
                            (double)projections->face[i], uv[0], uv[1]};
        if (format == QM_ARRAY_JSON)
            qm_json_write_projection(out, projections, i, diagonal);
        else
            qm_text_add_array(out, format, 7, 0, record, 7);
    }
}
