/**
 * codec_drc.c: Draco: the library does the decoding behind codec_draco.h. Before that codec_drc_head.c looks at the counts
 * that the file announces; after it codec_drc_join.c makes polygons of triangles again.
 */
#include <math.h>

#include "codec_drc.h"

typedef struct drc_reader {
    qm_builder *builder;
    qm_draco_facts facts;
    qm_draco_arrays arrays;
    qm_status status;
} drc_reader;

static qm_draco_decode_fn *decode_draco = qm_draco_decode;

void qm_codec_drc_set_decoder(qm_draco_decode_fn *decode)
{
    decode_draco = decode;
}

static bool prepare_arrays(void *user, const qm_draco_facts *facts, qm_draco_arrays *arrays)
{
    drc_reader *reader = user;
    qm_context *ctx = reader->builder->ctx;
    reader->facts = *facts;
    reader->status = qm_builder_reserve_vertices(reader->builder, facts->vertex_count);
    if (reader->status == QM_OK)
        reader->status = qm_builder_reserve_faces(reader->builder, facts->triangle_count);
    if (reader->status != QM_OK) return false;
    reader->status = QM_E_NO_MEMORY;
    size_t corner_count = 3 * facts->triangle_count;
    reader->arrays.positions = qm_context_alloc(ctx, facts->vertex_count, 3 * sizeof(double));
    if (!reader->arrays.positions && facts->vertex_count > 0) return false;
    reader->arrays.triangles = qm_context_alloc(ctx, corner_count, sizeof(uint32_t));
    if (!reader->arrays.triangles && corner_count > 0) return false;
    if (facts->has_added_edges) reader->arrays.added = qm_context_alloc(ctx, corner_count, 1);
    if (!reader->arrays.added && facts->has_added_edges && corner_count > 0) return false;
    *arrays = reader->arrays;
    reader->status = QM_OK;
    return true;
}

static void free_arrays(drc_reader *reader)
{
    qm_context *ctx = reader->builder->ctx;
    size_t corner_count = 3 * reader->facts.triangle_count;
    qm_context_free(ctx, reader->arrays.positions, reader->facts.vertex_count, 3 * sizeof(double));
    qm_context_free(ctx, reader->arrays.triangles, corner_count, sizeof(uint32_t));
    qm_context_free(ctx, reader->arrays.added, corner_count, 1);
}

static qm_status explain_outcome(const drc_reader *reader, qm_draco_outcome outcome)
{
    qm_codec_report *report = reader->builder->report;
    switch (outcome) {
    case QM_DRACO_DONE:
        return QM_OK;
    case QM_DRACO_STOPPED:
        return reader->status;
    case QM_DRACO_NO_MEMORY:
        return QM_E_NO_MEMORY;
    case QM_DRACO_UNSUPPORTED:
        return qm_codec_fail(report, QM_E_UNSUPPORTED,
                             "positions other than three floats or integers are not supported");
    default:
        return qm_codec_fail(report, QM_E_FORMAT, "the Draco data is invalid or truncated");
    }
}

/** Where the file splits vertices for their attributes, equal positions are one vertex again. */
static qm_status weld_vertices(drc_reader *reader)
{
    qm_welder welder;
    qm_builder *builder = reader->builder;
    size_t vertex_count = reader->facts.vertex_count;
    uint32_t *vertices = qm_context_alloc(builder->ctx, vertex_count, sizeof *vertices);
    if (!vertices) return QM_E_NO_MEMORY;
    size_t done;
    qm_status status = qm_welder_create(builder, vertex_count, &welder);
    if (status == QM_OK) {
        status = qm_welder_find(&welder, reader->arrays.positions, vertex_count, vertices, &done);
        qm_welder_destroy(&welder);
    }
    for (size_t i = 0; status == QM_OK && i < 3 * reader->facts.triangle_count; ++i)
        reader->arrays.triangles[i] = vertices[reader->arrays.triangles[i]];
    qm_context_free(builder->ctx, vertices, vertex_count, sizeof *vertices);
    if (status == QM_OK && builder->vertex_count < vertex_count)
        qm_codec_warn(builder->report, "vertices with the same coordinates as others: %zu (merged)",
                      vertex_count - builder->vertex_count);
    return status;
}

static qm_status add_vertices(drc_reader *reader)
{
    for (size_t i = 0; i < 3 * reader->facts.vertex_count; ++i)
        if (!isfinite(reader->arrays.positions[i]))
            return qm_codec_fail(reader->builder->report, QM_E_NOT_FINITE,
                                 "a coordinate is not a finite number");
    if (reader->facts.has_split_points && reader->facts.vertex_count > 0) return weld_vertices(reader);
    qm_status status = QM_OK;
    for (size_t i = 0; status == QM_OK && i < reader->facts.vertex_count; ++i)
        status = qm_builder_add_vertex(reader->builder, reader->arrays.positions + 3 * i);
    return status;
}

static qm_status add_faces(drc_reader *reader)
{
    if (reader->facts.triangle_count == 0) return QM_OK;
    if (reader->facts.has_added_edges)
        return qm_drc_join_triangles(reader->builder, &reader->facts, &reader->arrays);
    const uint32_t *corners = reader->arrays.triangles;
    qm_status status = QM_OK;
    for (size_t i = 0; status == QM_OK && i < reader->facts.triangle_count; ++i, corners += 3)
        status = qm_builder_add_triangle(reader->builder, corners[0], corners[1], corners[2]);
    return status;
}

/**
 * Half a step along each axis moves a vertex by no more than half the diagonal of a cell; the rest covers the
 * library's single precision, where a step has a relative rounding of 2^-24 and so has the sum.
 */
static void warn_about_quantization(const drc_reader *reader)
{
    const qm_draco_facts *facts = &reader->facts;
    if (facts->quantization_bits == 0) return;
    double half_cell = sqrt(3) / 2 * facts->range / ((1u << facts->quantization_bits) - 1);
    double rounding = sqrt(3) * 0x1p-23 * (facts->range + facts->magnitude);
    qm_codec_warn(
        reader->builder->report,
        "positions were quantised to %d bits; a vertex may be up to %.4g from its original position",
        facts->quantization_bits, 1.001 * (half_cell + rounding));
}

static qm_status read_file(drc_reader *reader, const uint8_t *bytes, size_t size)
{
    qm_codec_report *report = reader->builder->report;
    qm_status status = qm_drc_check_head(reader->builder, bytes, size);
    if (status != QM_OK) return status;
    qm_draco_outcome outcome = decode_draco(bytes, size, prepare_arrays, reader, &report->offset);
    status = explain_outcome(reader, outcome);
    if (status == QM_OK) status = add_vertices(reader);
    if (status == QM_OK) status = add_faces(reader);
    if (status != QM_OK) return status;
    warn_about_quantization(reader);
    if (report->offset < size)
        qm_codec_warn(report, "bytes after the end of the data: %zu (ignored)", size - report->offset);
    return QM_OK;
}

qm_status qm_codec_decode_drc(qm_builder *builder, const uint8_t *bytes, size_t size)
{
    drc_reader reader = {.builder = builder};
    qm_status status = read_file(&reader, bytes, size);
    free_arrays(&reader);
    return status;
}
