/**
 * codec_builder.c: the growing arrays of a mesh that is being decoded.
 */
#include "codec_builder.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>

qm_status qm_codec_fail(qm_codec_report *report, qm_status status, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(report->detail, sizeof report->detail, format, arguments);
    va_end(arguments);
    return status;
}

void qm_codec_warn(qm_codec_report *report, const char *format, ...)
{
    if (report->warning_count == QM_CODEC_WARNING_COUNT) return;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(report->warnings[report->warning_count++], sizeof report->warnings[0], format, arguments);
    va_end(arguments);
}

/** Grows an array as qm_codec_reserve does, to at most most elements. */
static bool reserve_up_to(qm_context *ctx, void **block, size_t *capacity, size_t needed, size_t most,
                          size_t width)
{
    QM_ASSERT(needed <= most);
    if (needed <= *capacity) return true;
    size_t grown = *capacity < 8 ? 16 : 2 * *capacity;
    if (grown > most) grown = most;
    if (grown < needed) grown = needed;
    void *moved = qm_context_resize(ctx, *block, *capacity, grown, width);
    if (!moved) return false;
    *block = moved;
    *capacity = grown;
    return true;
}

bool qm_codec_reserve(qm_context *ctx, void **block, size_t *capacity, size_t needed, size_t width)
{
    return reserve_up_to(ctx, block, capacity, needed, SIZE_MAX, width);
}

qm_status qm_builder_reserve_vertices(qm_builder *builder, uint64_t count)
{
    if (count > builder->limits->max_vertices - builder->vertex_count)
        return qm_codec_fail(builder->report, QM_E_TOO_LARGE, "the file has more than %zu vertices",
                             builder->limits->max_vertices);
    if (builder->only_counts) return QM_OK;
    void *block = builder->positions;
    if (!reserve_up_to(builder->ctx, &block, &builder->vertex_capacity, builder->vertex_count + (size_t)count,
                       builder->limits->max_vertices, 3 * sizeof *builder->positions))
        return QM_E_NO_MEMORY;
    builder->positions = block;
    return QM_OK;
}

qm_status qm_builder_reserve_faces(qm_builder *builder, uint64_t count)
{
    if (count > builder->limits->max_faces - builder->face_count)
        return qm_codec_fail(builder->report, QM_E_TOO_LARGE, "the file has more than %zu faces",
                             builder->limits->max_faces);
    if (builder->only_counts) return QM_OK;
    void *block = builder->faces;
    if (!reserve_up_to(builder->ctx, &block, &builder->face_capacity, builder->face_count + (size_t)count,
                       builder->limits->max_faces, 4 * sizeof *builder->faces))
        return QM_E_NO_MEMORY;
    builder->faces = block;
    return QM_OK;
}

qm_status qm_builder_add_grid(qm_builder *builder, qm_mesh_grid grid)
{
    void *block = builder->grids;
    if (!qm_codec_reserve(builder->ctx, &block, &builder->grid_capacity, builder->grid_count + 1,
                          sizeof grid))
        return QM_E_NO_MEMORY;
    builder->grids = block;
    builder->grids[builder->grid_count++] = grid;
    return QM_OK;
}

qm_status qm_builder_grow_vertices(qm_builder *builder)
{
    if (qm_context_canceled(builder->ctx)) return QM_E_CANCELED;
    return qm_builder_reserve_vertices(builder, 1);
}

qm_status qm_builder_add_vertices(qm_builder *builder, const double *positions, size_t count)
{
    if (qm_context_canceled(builder->ctx)) return QM_E_CANCELED;
    qm_status status = qm_builder_reserve_vertices(builder, count);
    if (status != QM_OK) return status;
    if (builder->only_counts) {
        qm_builder_count(builder, count, 0, 0);
        return QM_OK;
    }
    memcpy(builder->positions + 3 * builder->vertex_count, positions, 3 * count * sizeof *positions);
    builder->vertex_count += count;
    return QM_OK;
}

qm_status qm_builder_set_normal(qm_builder *builder, const double normal[3])
{
    if (builder->only_counts) return QM_OK;
    void *block = builder->normals;
    if (!qm_codec_reserve(builder->ctx, &block, &builder->normal_capacity, builder->vertex_count,
                          3 * sizeof *builder->normals))
        return QM_E_NO_MEMORY;
    builder->normals = block;
    float *row = builder->normals + 3 * (builder->vertex_count - 1);
    bool is_finite = true;
    for (int k = 0; k < 3; k++) {
        row[k] = (float)normal[k];
        is_finite &= isfinite(row[k]) != 0;
    }
    if (!is_finite) row[0] = row[1] = row[2] = 0.0f;
    builder->bad_normal_count += !is_finite;
    return QM_OK;
}

qm_status qm_builder_grow_corners(qm_builder *builder)
{
    void *block = builder->corners;
    if (!qm_codec_reserve(builder->ctx, &block, &builder->corner_capacity, builder->corner_count + 1,
                          sizeof *builder->corners))
        return QM_E_NO_MEMORY;
    builder->corners = block;
    return QM_OK;
}

/** Creates the origins at the first polygon; every face before it is its own origin. */
static qm_status reserve_origins(qm_builder *builder)
{
    bool first = builder->face_origin == NULL;
    void *block = builder->face_origin;
    if (!qm_codec_reserve(builder->ctx, &block, &builder->origin_capacity, builder->face_capacity,
                          sizeof *builder->face_origin))
        return QM_E_NO_MEMORY;
    builder->face_origin = block;
    for (size_t i = 0; first && i < builder->face_count; ++i)
        builder->face_origin[i] = (uint32_t)i;
    return QM_OK;
}

static qm_status reserve_for_face(qm_builder *builder, size_t triangle_count)
{
    size_t needed = builder->face_count + triangle_count;
    if ((builder->input_face_count & 0xffff) == 0 && qm_context_canceled(builder->ctx)) return QM_E_CANCELED;
    if (needed > builder->face_capacity || needed > builder->limits->max_faces) {
        qm_status status = qm_builder_reserve_faces(builder, triangle_count);
        if (status != QM_OK) return status;
    }
    bool wants_origins = !builder->only_counts && (builder->face_origin || triangle_count > 1);
    return wants_origins && needed > builder->origin_capacity ? reserve_origins(builder) : QM_OK;
}

qm_status qm_builder_end_face(qm_builder *builder)
{
    if (builder->corner_count < 3)
        return qm_codec_fail(builder->report, QM_E_FORMAT, "a face has %zu corners, but it needs three",
                             builder->corner_count);
    if (builder->corner_count > 4) {
        const uint32_t *corners = builder->corners;
        qm_status status = reserve_for_face(builder, builder->corner_count - 2);
        if (status != QM_OK) return status;
        bool repeats = false;
        if (builder->only_counts) qm_builder_count(builder, 0, builder->corner_count - 2, 0);
        for (size_t i = 2; !builder->only_counts && i < builder->corner_count; ++i) {
            const uint32_t part[4] = {corners[0], corners[i - 1], corners[i], QM_NO_INDEX};
            repeats |= qm_face_repeats_corner(part);
            qm_builder_store_face(builder, part);
        }
        builder->repeated_count += repeats;
        ++builder->polygon_count;
        ++builder->input_face_count;
        builder->corner_count = 0;
        return QM_OK;
    }
    const uint32_t *corners = builder->corners;
    const uint32_t face[4] = {corners[0], corners[1], corners[2],
                              builder->corner_count == 4 ? corners[3] : QM_NO_INDEX};
    builder->corner_count = 0;
    return qm_builder_add_face(builder, face);
}

qm_status qm_builder_grow_faces(qm_builder *builder)
{
    return reserve_for_face(builder, 1);
}

qm_status qm_builder_add_faces(qm_builder *builder, const uint32_t (*faces)[4], size_t count)
{
    if (qm_context_canceled(builder->ctx)) return QM_E_CANCELED;
    qm_status status = qm_builder_reserve_faces(builder, count);
    if (status == QM_OK && builder->face_origin) status = reserve_origins(builder);
    if (status != QM_OK || count == 0) return status;
    if (builder->only_counts) {
        size_t quads = 0;
        for (size_t i = 0; i < count; ++i)
            quads += faces[i][3] != QM_NO_INDEX;
        qm_builder_count(builder, 0, count, quads);
        builder->input_face_count += count;
        return QM_OK;
    }
    memcpy(builder->faces + 4 * builder->face_count, faces, count * sizeof *faces);
    for (size_t i = 0; i < count; ++i)
        builder->repeated_count += qm_face_repeats_corner(faces[i]);
    for (size_t i = 0; builder->face_origin && i < count; ++i)
        builder->face_origin[builder->face_count + i] = (uint32_t)(builder->input_face_count + i);
    builder->face_count += count;
    builder->input_face_count += count;
    return QM_OK;
}

qm_status qm_builder_fail_index(qm_builder *builder, uint64_t vertex)
{
    return qm_codec_fail(builder->report, QM_E_INDEX,
                         "face refers to vertex %llu, but the file has %zu vertices",
                         (unsigned long long)vertex, builder->vertex_count);
}

/** Frees the unused capacity of an array; count may be 0. */
static bool trim(qm_context *ctx, void **block, size_t *capacity, size_t count, size_t width)
{
    if (count == *capacity) return true;
    if (count == 0) {
        qm_context_free(ctx, *block, *capacity, width);
        *block = NULL;
    } else {
        void *moved = qm_context_resize(ctx, *block, *capacity, count, width);
        if (!moved) return false;
        *block = moved;
    }
    *capacity = count;
    return true;
}

static qm_mesh mesh_of(const qm_builder *builder)
{
    return (qm_mesh){.positions = builder->positions,
                     .vertex_count = builder->vertex_count,
                     .faces = builder->faces,
                     .face_count = builder->face_count,
                     .face_origin = builder->face_origin,
                     .polygon_count = builder->polygon_count,
                     .grids = builder->grids,
                     .grid_count = builder->grid_count,
                     .normals = builder->normals};
}

qm_status qm_builder_finish(qm_builder *builder, qm_mesh *out)
{
    QM_ASSERT(builder->vertex_count <= builder->limits->max_vertices);
    QM_ASSERT(builder->face_count <= builder->face_capacity && builder->grid_count <= builder->grid_capacity);
    if (builder->vertex_count == 0)
        return qm_codec_fail(builder->report, QM_E_EMPTY, "the file has no vertex and no face");
    if (builder->polygon_count > 0)
        qm_codec_warn(
            builder->report,
            "polygons of five corners or more: %zu (stored as fans of triangles from their first corner)",
            builder->polygon_count);
    if (builder->repeated_count > 0)
        qm_codec_warn(builder->report, "faces that name a vertex twice: %zu (kept as they are)",
                      builder->repeated_count);
    if (builder->bad_normal_count > 0)
        qm_codec_warn(builder->report, "normals that are not finite: %zu (treated as missing)",
                      builder->bad_normal_count);
    qm_mesh mesh = mesh_of(builder);
    qm_status status = qm_mesh_validate(builder->ctx, &mesh);
    if (status != QM_OK) return qm_codec_fail(builder->report, status, "%s", builder->ctx->message);
    void *positions = builder->positions, *faces = builder->faces, *origins = builder->face_origin;
    bool trimmed = trim(builder->ctx, &positions, &builder->vertex_capacity, builder->vertex_count,
                        3 * sizeof *builder->positions);
    builder->positions = positions;
    trimmed = trimmed && trim(builder->ctx, &faces, &builder->face_capacity, builder->face_count,
                              4 * sizeof *builder->faces);
    builder->faces = faces;
    if (trimmed && origins)
        trimmed = trim(builder->ctx, &origins, &builder->origin_capacity, builder->face_count,
                       sizeof *builder->face_origin);
    builder->face_origin = origins;
    void *normals = builder->normals;
    if (trimmed && normals)
        trimmed = trim(builder->ctx, &normals, &builder->normal_capacity, builder->vertex_count,
                       3 * sizeof *builder->normals);
    builder->normals = normals;
    void *grids = builder->grids;
    if (trimmed && grids)
        trimmed =
            trim(builder->ctx, &grids, &builder->grid_capacity, builder->grid_count, sizeof *builder->grids);
    builder->grids = grids;
    if (!trimmed) return QM_E_NO_MEMORY;
    *out = mesh_of(builder);
    builder->positions = NULL;
    builder->normals = NULL;
    builder->grids = NULL;
    builder->faces = builder->face_origin = NULL;
    return QM_OK;
}

void qm_builder_free(qm_builder *builder)
{
    qm_context *ctx = builder->ctx;
    qm_context_free(ctx, builder->positions, builder->vertex_capacity, 3 * sizeof *builder->positions);
    qm_context_free(ctx, builder->normals, builder->normal_capacity, 3 * sizeof *builder->normals);
    qm_context_free(ctx, builder->grids, builder->grid_capacity, sizeof *builder->grids);
    qm_context_free(ctx, builder->faces, builder->face_capacity, 4 * sizeof *builder->faces);
    qm_context_free(ctx, builder->face_origin, builder->origin_capacity, sizeof *builder->face_origin);
    qm_context_free(ctx, builder->corners, builder->corner_capacity, sizeof *builder->corners);
}
