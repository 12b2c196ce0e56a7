/**
 * codec_gltf.c: glTF binary: a header, a part of JSON and a part of bytes. The tree of the scene is traversed from
 * its roots; each mesh is added in the coordinates of the scene, so a mesh of two nodes is added twice.
 * Source: glTF 2.0 specification, sections 3.5 to 3.7 and 4.
 */
#include <math.h>

#include "codec_gltf.h"

#define HEADER_SIZE 12
#define CHUNK_HEADER_SIZE 8
#define CHUNK_JSON 0x4e4f534a
#define CHUNK_BINARY 0x004e4942
#define TYPE_FLOAT 5126

typedef enum primitive_mode {
    POINTS = 0,
    TRIANGLES = 4,
    TRIANGLE_STRIP = 5,
    TRIANGLE_FAN = 6
} primitive_mode;

typedef struct byte_range {
    const uint8_t *bytes;
    size_t offset, size; /* within the file */
} byte_range;

typedef struct glb_reader {
    qm_builder *builder;
    qm_codec_report *report;
    byte_range json, binary;
    qm_gltf gltf;
    size_t *vertex_bases; /* for each accessor: where its vertices begin, if the mesh in hand has them */
    size_t *base_owners;  /* for each accessor: the number of the mesh that set vertex_bases, from 1 */
    size_t visit_count;   /* meshes added */
    size_t line_count;    /* primitives of lines, left out */
} glb_reader;

static qm_status fail_file(glb_reader *reader, qm_status status, const char *detail)
{
    return qm_codec_fail(reader->report, status, "%s", detail);
}

/* Chunks */

static void warn_about_rest(glb_reader *reader, size_t size, size_t announced)
{
    if (announced < size)
        qm_codec_warn(reader->report, "bytes after the specified end of the file: %zu (ignored)",
                      size - announced);
}

/** Finds the two parts; report->offset follows. */
static qm_status find_chunks(glb_reader *reader, const uint8_t *bytes, size_t size)
{
    size_t *at = &reader->report->offset;
    *at = 0;
    if (size < HEADER_SIZE || memcmp(bytes, "glTF", 4) != 0)
        return fail_file(reader, QM_E_FORMAT, "the file does not start like a glTF binary");
    *at = 4;
    if (qm_read_u32_le(bytes + 4) != 2)
        return fail_file(reader, QM_E_UNSUPPORTED, "only version 2 of glTF binary is supported");
    *at = 8;
    size_t announced = qm_read_u32_le(bytes + 8);
    if (announced > size)
        return qm_codec_fail(reader->report, QM_E_FORMAT,
                             "the header specifies %zu bytes, but the file has %zu", announced, size);
    warn_about_rest(reader, size, announced);
    for (*at = HEADER_SIZE; *at < announced;) {
        size_t left = announced - *at;
        if (left < CHUNK_HEADER_SIZE) return fail_file(reader, QM_E_FORMAT, "the file ends within a chunk");
        size_t length = qm_read_u32_le(bytes + *at);
        uint32_t type = qm_read_u32_le(bytes + *at + 4);
        if (length > left - CHUNK_HEADER_SIZE)
            return qm_codec_fail(reader->report, QM_E_FORMAT,
                                 "a chunk specifies %zu bytes, but the file has %zu left", length,
                                 left - CHUNK_HEADER_SIZE);
        *at += CHUNK_HEADER_SIZE;
        byte_range *part = type == CHUNK_JSON ? &reader->json : &reader->binary;
        if ((type == CHUNK_JSON || type == CHUNK_BINARY) && !part->bytes)
            *part = (byte_range){bytes + *at, *at, length};
        *at += length;
    }
    return reader->json.bytes ? QM_OK : fail_file(reader, QM_E_FORMAT, "the file has no JSON part");
}

/* Accessors */

static size_t component_size(int component_type)
{
    switch (component_type) {
    case 5120:
    case 5121:
        return 1;
    case 5122:
    case 5123:
        return 2;
    case 5125:
    case TYPE_FLOAT:
        return 4;
    default:
        return 0;
    }
}

/** The location of the elements of an accessor, all within the binary part. */
typedef struct element_range {
    const uint8_t *first;
    size_t offset; /* of first within the file */
    size_t count, stride;
} element_range;

static qm_status locate_elements(glb_reader *reader, size_t index, element_range *range)
{
    const qm_gltf_accessor *accessor = &reader->gltf.accessors[index];
    reader->report->offset = reader->json.offset;
    if (accessor->is_sparse || accessor->view == QM_GLTF_NONE)
        return fail_file(reader, QM_E_UNSUPPORTED,
                         "sparse accessors and ones without data are not supported");
    const qm_gltf_view *view = &reader->gltf.views[accessor->view];
    if (view->is_foreign)
        return fail_file(reader, QM_E_UNSUPPORTED, "buffers outside of the file are not supported");
    size_t width = component_size(accessor->component_type) * (size_t)accessor->component_count;
    uint64_t stride = view->stride ? view->stride : width;
    if (view->size > reader->binary.size || view->offset > reader->binary.size - view->size)
        return qm_codec_fail(reader->report, QM_E_FORMAT, "buffer view %zu reaches past the binary part",
                             accessor->view);
    /* The last element may be followed by less than a stride. */
    uint64_t room = accessor->offset <= view->size ? view->size - accessor->offset : 0;
    uint64_t most = room >= width && stride >= width ? (room - width) / stride + 1 : 0;
    if (accessor->count > most)
        return qm_codec_fail(
            reader->report, QM_E_FORMAT,
            "accessor %zu reaches past its buffer view: it has room for %llu elements of %llu", index,
            (unsigned long long)most, (unsigned long long)accessor->count);
    range->offset = (size_t)(view->offset + accessor->offset);
    range->count = (size_t)accessor->count;
    /* An accessor without elements needs no binary part. */
    range->first = range->count > 0 ? reader->binary.bytes + range->offset : NULL;
    range->offset += reader->binary.offset;
    range->stride = (size_t)stride;
    return QM_OK;
}

/* Vertices */

static bool transform_point(const double matrix[16], const float point[3], double out[3])
{
    for (int row = 0; row < 3; ++row)
        out[row] = matrix[row] * point[0] + matrix[4 + row] * point[1] + matrix[8 + row] * point[2] +
                   matrix[12 + row];
    return isfinite(out[0]) && isfinite(out[1]) && isfinite(out[2]);
}

static qm_status add_vertices(glb_reader *reader, size_t index, const double matrix[16])
{
    const qm_gltf_accessor *accessor = &reader->gltf.accessors[index];
    if (accessor->component_type != TYPE_FLOAT || accessor->component_count != 3)
        return fail_file(reader, QM_E_UNSUPPORTED, "positions other than three floats are not supported");
    element_range range;
    qm_status status = locate_elements(reader, index, &range);
    if (status == QM_OK) status = qm_builder_reserve_vertices(reader->builder, range.count);
    for (size_t i = 0; status == QM_OK && i < range.count; ++i) {
        const uint8_t *at = range.first + i * range.stride;
        const float point[3] = {qm_read_f32_le(at), qm_read_f32_le(at + 4), qm_read_f32_le(at + 8)};
        double position[3];
        reader->report->offset = range.offset + i * range.stride;
        if (!transform_point(matrix, point, position))
            return fail_file(reader, QM_E_NOT_FINITE, "a coordinate is not a finite number");
        status = qm_builder_add_vertex(reader->builder, position);
    }
    return status;
}

/** Primitives of a mesh often share their positions, which are then added once. */
static qm_status find_vertices(glb_reader *reader, size_t accessor, const double matrix[16], size_t *base)
{
    if (reader->base_owners[accessor] != reader->visit_count) {
        reader->vertex_bases[accessor] = reader->builder->vertex_count;
        qm_status status = add_vertices(reader, accessor, matrix);
        if (status != QM_OK) return status;
        reader->base_owners[accessor] = reader->visit_count;
    }
    *base = reader->vertex_bases[accessor];
    return QM_OK;
}

/* Faces */

typedef struct index_list {
    element_range range; /* first is NULL where the vertices are used in their order */
    int component_type;
    size_t base, vertex_count;
} index_list;

static qm_status check_indices(glb_reader *reader, size_t accessor, index_list *list)
{
    const qm_gltf_accessor *facts = &reader->gltf.accessors[accessor];
    list->component_type = facts->component_type;
    bool is_unsigned =
        list->component_type == 5121 || list->component_type == 5123 || list->component_type == 5125;
    if (!is_unsigned || facts->component_count != 1)
        return fail_file(reader, QM_E_FORMAT, "indices must be of an unsigned type");
    return locate_elements(reader, accessor, &list->range);
}

static qm_status read_index(glb_reader *reader, const index_list *list, size_t i, uint32_t *vertex)
{
    size_t index = i;
    if (list->range.first) {
        const uint8_t *at = list->range.first + i * list->range.stride;
        index = at[0];
        if (list->component_type == 5123) index |= (size_t)at[1] << 8;
        if (list->component_type == 5125) index = qm_read_u32_le(at);
        reader->report->offset = list->range.offset + i * list->range.stride;
    }
    if (index >= list->vertex_count)
        return qm_codec_fail(reader->report, QM_E_INDEX,
                             "face refers to vertex %zu, but its primitive has %zu vertices, counted from 0",
                             index, list->vertex_count);
    *vertex = (uint32_t)(list->base + index);
    return QM_OK;
}

/** The positions in the index list of the corners of triangle i, in the order of the mode. */
static void list_triangle(int mode, size_t i, size_t places[3])
{
    size_t odd = i & 1;
    if (mode == TRIANGLES)
        memcpy(places, (const size_t[3]){3 * i, 3 * i + 1, 3 * i + 2}, 3 * sizeof *places);
    else if (mode == TRIANGLE_STRIP)
        memcpy(places, (const size_t[3]){i, i + 1 + odd, i + 2 - odd}, 3 * sizeof *places);
    else
        memcpy(places, (const size_t[3]){0, i + 1, i + 2}, 3 * sizeof *places);
}

static double determinant(const double m[16])
{
    return m[0] * (m[5] * m[10] - m[6] * m[9]) - m[4] * (m[1] * m[10] - m[2] * m[9]) +
           m[8] * (m[1] * m[6] - m[2] * m[5]);
}

/** A mirroring transform flips the triangles, so their corners are stored in reverse order. */
static qm_status add_faces(glb_reader *reader, const index_list *list, int mode, bool mirrored)
{
    size_t index_count = list->range.count, triangle_count = mode == TRIANGLES ? index_count / 3
                                                             : index_count > 2 ? index_count - 2
                                                                               : 0;
    reader->report->offset = reader->json.offset;
    if (triangle_count == 0 || (mode == TRIANGLES && index_count % 3 != 0))
        return qm_codec_fail(reader->report, QM_E_FORMAT, "%zu indices are not a multiple of 3", index_count);
    qm_status status = qm_builder_reserve_faces(reader->builder, triangle_count);
    for (size_t i = 0; status == QM_OK && i < triangle_count; ++i) {
        size_t places[3];
        uint32_t corners[3];
        list_triangle(mode, i, places);
        for (int k = 0; status == QM_OK && k < 3; ++k)
            status = read_index(reader, list, places[k], &corners[k]);
        if (status == QM_OK)
            status = qm_builder_add_triangle(reader->builder, corners[0], corners[1 + mirrored],
                                             corners[2 - mirrored]);
    }
    return status;
}

static qm_status add_primitive(glb_reader *reader, const qm_gltf_primitive *primitive,
                               const double matrix[16])
{
    reader->report->offset = reader->json.offset;
    if (primitive->is_draco)
        return fail_file(reader, QM_E_UNSUPPORTED,
                         "glTF with Draco compression is not supported; export it without, or as .drc");
    if (primitive->mode != POINTS && primitive->mode < TRIANGLES) {
        ++reader->line_count;
        return QM_OK;
    }
    if (primitive->positions == QM_GLTF_NONE)
        return fail_file(reader, QM_E_FORMAT, "a primitive has no positions");
    index_list list = {.vertex_count = (size_t)reader->gltf.accessors[primitive->positions].count};
    qm_status status = find_vertices(reader, primitive->positions, matrix, &list.base);
    if (status != QM_OK || primitive->mode == POINTS) return status;
    list.range.count = list.vertex_count;
    if (primitive->indices != QM_GLTF_NONE) status = check_indices(reader, primitive->indices, &list);
    return status == QM_OK ? add_faces(reader, &list, primitive->mode, determinant(matrix) < 0) : status;
}

/* Scene */

/** matrix = parent * matrix, both with a last row of 0 0 0 1. */
static void multiply(const double parent[16], double matrix[16])
{
    double product[16];
    for (int column = 0; column < 4; ++column)
        for (int row = 0; row < 4; ++row) {
            double sum = 0;
            for (int k = 0; k < 4; ++k)
                sum += parent[4 * k + row] * matrix[4 * column + k];
            product[4 * column + row] = sum;
        }
    memcpy(matrix, product, sizeof product);
}

static qm_status add_mesh(glb_reader *reader, const qm_gltf_node *node)
{
    if (node->mesh == QM_GLTF_NONE) return QM_OK;
    const qm_gltf_mesh *mesh = &reader->gltf.meshes[node->mesh];
    ++reader->visit_count;
    for (size_t i = 0; i < mesh->primitive_count; ++i) {
        qm_status status =
            add_primitive(reader, &reader->gltf.primitives[mesh->first_primitive + i], node->matrix);
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

/** Depth-first traversal with a stack; a node has at most one parent, and is therefore visited at most once. */
static qm_status walk_nodes(glb_reader *reader, size_t *stack)
{
    qm_gltf *gltf = &reader->gltf;
    size_t depth = 0;
    for (size_t i = gltf->link_count; i > gltf->first_root; --i)
        stack[depth++] = gltf->links[i - 1];
    while (depth > 0) {
        const qm_gltf_node *node = &gltf->nodes[stack[--depth]];
        qm_status status = add_mesh(reader, node);
        if (status != QM_OK) return status;
        for (size_t i = node->child_count; i > 0; --i) {
            size_t child = gltf->links[node->first_child + i - 1];
            multiply(node->matrix, gltf->nodes[child].matrix);
            stack[depth++] = child;
        }
    }
    return QM_OK;
}

static void warn_about_scene(glb_reader *reader)
{
    if (reader->line_count > 0)
        qm_codec_warn(reader->report, "primitives of lines: %zu (ignored)", reader->line_count);
    if (reader->gltf.has_poses) qm_codec_warn(reader->report, "skins and morph targets were not applied");
}

static qm_status read_scene(glb_reader *reader)
{
    qm_gltf *gltf = &reader->gltf;
    qm_context *ctx = reader->builder->ctx;
    reader->report->offset = reader->json.offset;
    if (gltf->accessor_count == 0 || gltf->node_count == 0)
        return fail_file(reader, QM_E_EMPTY, "the scene has no mesh");
    reader->vertex_bases = qm_context_alloc(ctx, gltf->accessor_count, sizeof *reader->vertex_bases);
    reader->base_owners = qm_context_alloc(ctx, gltf->accessor_count, sizeof *reader->base_owners);
    size_t *stack = qm_context_alloc(ctx, gltf->node_count, sizeof *stack);
    qm_status status = QM_E_NO_MEMORY;
    if (reader->vertex_bases && reader->base_owners && stack) {
        memset(reader->base_owners, 0, gltf->accessor_count * sizeof *reader->base_owners);
        status = walk_nodes(reader, stack);
    }
    if (status == QM_OK) warn_about_scene(reader);
    qm_context_free(ctx, stack, gltf->node_count, sizeof *stack);
    qm_context_free(ctx, reader->base_owners, gltf->accessor_count, sizeof *reader->base_owners);
    qm_context_free(ctx, reader->vertex_bases, gltf->accessor_count, sizeof *reader->vertex_bases);
    return status;
}

qm_status qm_codec_decode_glb(qm_builder *builder, const uint8_t *bytes, size_t size)
{
    glb_reader reader = {.builder = builder, .report = builder->report};
    qm_status status = find_chunks(&reader, bytes, size);
    if (status != QM_OK) return status;
    builder->report->offset = reader.json.offset;
    status = qm_gltf_parse(builder, reader.json.bytes, reader.json.size, &reader.gltf);
    if (status == QM_OK) status = read_scene(&reader);
    qm_gltf_free(builder->ctx, &reader.gltf);
    return status;
}
