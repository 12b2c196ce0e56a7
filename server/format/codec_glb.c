/**
 * codec_glb.c: glTF: a header, a part of JSON and a part of bytes, or the JSON alone, with its bytes in base64 (the
 * text form, .gltf). The JSON part becomes plain arrays first (gltf.h). Then the tree of the scene is traversed from its
 * roots; each mesh is added in the coordinates of the scene, so a mesh of two nodes is added twice. Files are written in
 * single precision, as one mesh of triangles, with quads marked by FB_ngon_encoding.
 * Source: glTF 2.0 specification, sections 3.5 to 3.7 and 4; the extensions KHR_draco_mesh_compression,
 * EXT_meshopt_compression and FB_ngon_encoding.
 */
#include <math.h>

#include "base/json.h"
#include "encoder_internal.h"
#include "gltf.h"
#include "meshopt.h"

#define HEADER_SIZE 12
#define CHUNK_HEADER_SIZE 8
#define MAGIC 0x46546c67u
#define CHUNK_JSON 0x4e4f534au
#define CHUNK_BINARY 0x004e4942u
#define TYPE_UINT32 5125
#define TYPE_FLOAT 5126
#define ARRAY_BUFFER 34962
#define ELEMENT_BUFFER 34963
#define MAX_DRACO_WARNINGS 3   /* there are others to come */
#define ELEMENTS_TOGETHER 1024 /* positions or triangles of the usual types, in one block */
#define MAX_ZEROS 0x100000u    /* elements without data: a file may claim them at no cost */

typedef enum primitive_mode {
    POINTS = 0,
    TRIANGLES = 4,
    TRIANGLE_STRIP = 5,
    TRIANGLE_FAN = 6
} primitive_mode;

/* ---- the file ---- */

typedef struct byte_range {
    const uint8_t *bytes;
    size_t offset, size; /* within the file */
} byte_range;

/** The mesh of a primitive that is compressed with Draco; its counts only for a builder that counts. */
typedef struct draco_mesh {
    bool is_known;
    qm_mesh mesh;
    qm_codec_counts counts;
} draco_mesh;

typedef struct glb_reader {
    qm_builder *builder;
    qm_codec_report *report;
    byte_range json, binary;
    qm_gltf_scene gltf;
    size_t *vertex_bases; /* for each accessor: where its vertices begin, if the mesh in hand has them */
    size_t *base_owners;  /* for each accessor: the number of the mesh that set vertex_bases, from 1 */
    size_t visit_count;   /* meshes added */
    draco_mesh *draco;    /* for each primitive: its mesh, once it is decoded; NULL: none has been */
    size_t line_count;    /* primitives of lines, left out */
    size_t hidden_count;  /* warnings about Draco data beyond MAX_DRACO_WARNINGS */
} glb_reader;

static qm_status fail_file(glb_reader *reader, qm_status status, const char *detail)
{
    return qm_codec_fail(reader->report, status, "%s", detail);
}

/** Where the text form begins, after a byte-order mark and blanks; size for other files. */
static size_t find_text(const uint8_t *bytes, size_t size)
{
    size_t i = size >= 3 && memcmp(bytes, "\xef\xbb\xbf", 3) == 0 ? 3 : 0;
    while (i < size && (bytes[i] == ' ' || bytes[i] == '\t' || bytes[i] == '\r' || bytes[i] == '\n'))
        ++i;
    return i < size && bytes[i] == '{' ? i : size;
}

bool qm_codec_is_gltf_text(const uint8_t *bytes, size_t size)
{
    return find_text(bytes, size) < size;
}

/* Chunks */

/** Finds the two parts; report->offset follows. The text form is its JSON part. */
static qm_status find_chunks(glb_reader *reader, const uint8_t *bytes, size_t size)
{
    size_t *at = &reader->report->offset;
    *at = 0;
    size_t text = find_text(bytes, size);
    if (text < size) {
        reader->json = (byte_range){bytes + text, text, size - text};
        return QM_OK;
    }
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
    if (announced < size)
        qm_codec_warn(reader->report, "bytes after the specified end of the file: %zu (ignored)",
                      size - announced);
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

/** The bytes of a buffer; without any for one that is in another file. */
static byte_range buffer_bytes(const glb_reader *reader, const qm_gltf_buffer *buffer)
{
    if (buffer && buffer->is_binary_part) return reader->binary;
    if (buffer && buffer->bytes) return (byte_range){buffer->bytes, reader->json.offset, buffer->size};
    return (byte_range){.offset = reader->json.offset};
}

/** Finds the bytes of a view in its buffer, still encoded if they are. */
static qm_status locate_view(glb_reader *reader, size_t index, byte_range *out)
{
    const qm_gltf_view *view = &reader->gltf.views[index];
    const qm_gltf_buffer *buffer = view->buffer != QM_GLTF_NONE ? &reader->gltf.buffers[view->buffer] : NULL;
    byte_range part = buffer_bytes(reader, buffer);
    if (!buffer || !(buffer->is_binary_part || buffer->bytes))
        return qm_codec_fail(reader->report, QM_E_UNSUPPORTED,
                             "buffer view %zu is in another file (%s): only data within the file is read",
                             index, buffer ? buffer->uri : "");
    if (view->size > part.size || view->offset > part.size - view->size)
        return qm_codec_fail(reader->report, QM_E_FORMAT, "buffer view %zu reaches past %s", index,
                             buffer->is_binary_part ? "the binary part" : "its buffer");
    /* Within base64 there is no place to name. Nothing needs no binary part. */
    *out = (byte_range){.offset = part.offset + (buffer->is_binary_part ? (size_t)view->offset : 0),
                        .size = (size_t)view->size};
    if (out->size > 0) out->bytes = part.bytes + view->offset;
    return QM_OK;
}

/** Decodes a view of EXT_meshopt_compression, the first time that it is needed; bytes is encoded, and then decoded. */
static qm_status decode_view(glb_reader *reader, size_t index, byte_range *bytes)
{
    qm_gltf_view *view = &reader->gltf.views[index];
    const qm_codec_limits *limits = reader->builder->limits;
    size_t max_count = view->coding == QM_GLTF_ATTRIBUTES ? limits->max_vertices : 3 * limits->max_faces;
    reader->report->offset = bytes->offset;
    if (view->filter == QM_GLTF_OTHER_FILTER)
        return qm_codec_fail(reader->report, QM_E_UNSUPPORTED,
                             "buffer view %zu has a filter for normals or rotations, but holds positions",
                             index);
    if (view->count > max_count)
        return qm_codec_fail(reader->report, QM_E_TOO_LARGE, "buffer view %zu has more than %zu elements",
                             index, max_count);
    if (!qm_meshopt_is_possible(view))
        return qm_codec_fail(reader->report, QM_E_FORMAT,
                             "buffer view %zu: %llu bytes cannot be %llu elements of %llu", index,
                             (unsigned long long)view->size, (unsigned long long)view->count,
                             (unsigned long long)view->stride);
    if (!view->decoded && view->count > 0) {
        view->decoded = qm_context_alloc(reader->builder->ctx, (size_t)view->count, (size_t)view->stride);
        if (!view->decoded) return QM_E_NO_MEMORY;
        qm_meshopt_outcome outcome =
            bytes->size > 0 ? qm_meshopt_decode(view, bytes->bytes, view->decoded) : QM_MESHOPT_MALFORMED;
        if (outcome == QM_MESHOPT_UNAVAILABLE)
            return fail_file(
                reader, QM_E_UNSUPPORTED,
                "EXT_meshopt_compression is read by the library meshoptimizer, which is not installed");
        if (outcome != QM_MESHOPT_DONE)
            return qm_codec_fail(reader->report, QM_E_FORMAT,
                                 "the encoded data of buffer view %zu is invalid", index);
    }
    bytes->bytes = view->decoded;
    bytes->size = (size_t)(view->count * view->stride);
    return QM_OK;
}

/** Finds count elements of a width in a view, tightly packed when stride is 0. what and index name them. */
static qm_status locate_range(glb_reader *reader, size_t view_index, uint64_t offset, size_t width,
                              uint64_t stride, uint64_t count, const char *what, size_t index,
                              element_range *range)
{
    byte_range view = {0};
    qm_status status = locate_view(reader, view_index, &view);
    const qm_gltf_view *listed = &reader->gltf.views[view_index];
    if (status == QM_OK && listed->is_encoded) status = decode_view(reader, view_index, &view);
    if (status != QM_OK) return status;
    if (stride == 0) stride = width;
    /* The last element may be followed by less than a stride. */
    uint64_t room = offset <= view.size ? view.size - offset : 0;
    uint64_t most = width > 0 && room >= width && stride >= width ? (room - width) / stride + 1 : 0;
    if (count > most)
        return qm_codec_fail(reader->report, QM_E_FORMAT,
                             "%s %zu reaches past its buffer view: it has room for %llu elements of %llu",
                             what, index, (unsigned long long)most, (unsigned long long)count);
    *range = (element_range){.count = (size_t)count, .stride = (size_t)stride, .offset = view.offset};
    if (range->count > 0) range->first = view.bytes + offset;
    if (reader->gltf.buffers[listed->buffer].is_binary_part && !listed->is_encoded)
        range->offset += (size_t)offset;
    return QM_OK;
}

static size_t element_size(const qm_gltf_accessor *accessor)
{
    return component_size(accessor->component_type) * (size_t)accessor->component_count;
}

static qm_status locate_elements(glb_reader *reader, size_t index, element_range *range)
{
    const qm_gltf_accessor *accessor = &reader->gltf.accessors[index];
    QM_ASSERT(accessor->view != QM_GLTF_NONE);
    reader->report->offset = reader->json.offset;
    return locate_range(reader, accessor->view, accessor->offset, element_size(accessor),
                        reader->gltf.views[accessor->view].stride, accessor->count, "accessor", index, range);
}

/** An unsigned integer of one of three types. */
static size_t read_unsigned(const uint8_t *at, int component_type)
{
    return component_type == 5125   ? qm_read_u32_le(at)
           : component_type == 5123 ? (size_t)at[0] | (size_t)at[1] << 8
                                    : at[0];
}

/* Vertices */

static inline bool transform_point(const double matrix[16], const double point[3], double out[3])
{
    for (int row = 0; row < 3; ++row)
        out[row] = matrix[row] * point[0] + matrix[4 + row] * point[1] + matrix[8 + row] * point[2] +
                   matrix[12 + row];
    return isfinite(out[0]) && isfinite(out[1]) && isfinite(out[2]);
}

/** A component as a number; of integers that stand for fractions the fraction (section 3.11). */
static float read_component(const uint8_t *at, const qm_gltf_accessor *accessor)
{
    int type = accessor->component_type;
    if (type == TYPE_FLOAT) return qm_read_f32_le(at);
    bool is_signed = type == 5120 || type == 5122, is_short = type == 5122 || type == 5123;
    int value = is_short ? at[0] | at[1] << 8 : at[0], bits = is_short ? 16 : 8;
    if (is_signed && value >> (bits - 1)) value -= 1 << bits;
    if (!accessor->is_normalized) return (float)value;
    float fraction = (float)value / (float)((1 << (bits - is_signed)) - 1);
    return fraction < -1.0f ? -1.0f : fraction;
}

static qm_status read_position(glb_reader *reader, const qm_gltf_accessor *accessor,
                               const element_range *range, size_t i, const double matrix[16], double out[3])
{
    const uint8_t *at = range->first + i * range->stride;
    size_t size = component_size(accessor->component_type);
    const double point[3] = {(double)read_component(at, accessor), read_component(at + size, accessor),
                             read_component(at + 2 * size, accessor)};
    reader->report->offset = range->offset + i * range->stride;
    return transform_point(matrix, point, out)
               ? QM_OK
               : fail_file(reader, QM_E_NOT_FINITE, "a coordinate is not a finite number");
}

/** Adds positions of floats up to a block with one that is not finite, which the general loop reports; *done counts
 * them. */
static qm_status add_float_positions(glb_reader *reader, const element_range *range, const double matrix[16],
                                     size_t *done)
{
    qm_status status = QM_OK;
    while (*done < range->count && status == QM_OK) {
        double positions[ELEMENTS_TOGETHER][3];
        size_t left = range->count - *done, count = left < ELEMENTS_TOGETHER ? left : ELEMENTS_TOGETHER;
        bool is_finite = true;
        for (size_t i = 0; i < count; ++i) {
            const uint8_t *at = range->first + (*done + i) * range->stride;
            const double point[3] = {(double)qm_read_f32_le(at), (double)qm_read_f32_le(at + 4),
                                     (double)qm_read_f32_le(at + 8)};
            is_finite &= transform_point(matrix, point, positions[i]);
        }
        if (!is_finite) break;
        reader->report->offset = range->offset + *done * range->stride;
        status = qm_builder_add_vertices(reader->builder, positions[0], count);
        *done += count;
    }
    return status;
}

/** Replaces vertices that were added last, from number base on, by those of a sparse accessor. */
static qm_status replace_vertices(glb_reader *reader, size_t index, size_t base, const double matrix[16])
{
    const qm_gltf_accessor *accessor = &reader->gltf.accessors[index];
    const qm_gltf_sparse *sparse = &accessor->sparse;
    element_range indices, values;
    reader->report->offset = reader->json.offset;
    qm_status status =
        locate_range(reader, sparse->index_view, sparse->index_offset, component_size(sparse->index_type), 0,
                     sparse->count, "the list of sparse indices of accessor", index, &indices);
    if (status == QM_OK)
        status = locate_range(reader, sparse->value_view, sparse->value_offset, element_size(accessor), 0,
                              sparse->count, "the list of sparse values of accessor", index, &values);
    for (size_t i = 0; status == QM_OK && i < indices.count; ++i) {
        size_t vertex = read_unsigned(indices.first + i * indices.stride, sparse->index_type);
        reader->report->offset = indices.offset + i * indices.stride;
        if (vertex >= accessor->count)
            return qm_codec_fail(reader->report, QM_E_INDEX,
                                 "a sparse accessor replaces element %zu, but has %llu, counted from 0",
                                 vertex, (unsigned long long)accessor->count);
        double position[3];
        status = read_position(reader, accessor, &values, i, matrix, position);
        if (status == QM_OK) qm_builder_set_vertex(reader->builder, base + vertex, position);
    }
    return status;
}

static qm_status add_vertices(glb_reader *reader, size_t index, const double matrix[16])
{
    const qm_gltf_accessor *accessor = &reader->gltf.accessors[index];
    int type = accessor->component_type;
    bool is_position =
        accessor->component_count == 3 && (type == TYPE_FLOAT || (type >= 5120 && type <= 5123));
    if (!is_position)
        return qm_codec_fail(reader->report, QM_E_UNSUPPORTED,
                             "accessor %zu is not one of positions: three floats, bytes or shorts", index);
    size_t base = reader->builder->vertex_count;
    element_range range = {.count = (size_t)accessor->count};
    qm_status status = QM_OK;
    if (accessor->view != QM_GLTF_NONE)
        status = locate_elements(reader, index, &range);
    else if (accessor->sparse.count == 0)
        return qm_codec_fail(reader->report, QM_E_UNSUPPORTED, "accessor %zu has no data", index);
    else if (accessor->count > MAX_ZEROS)
        return qm_codec_fail(reader->report, QM_E_TOO_LARGE,
                             "accessor %zu has %llu elements without data; at most %u may be", index,
                             (unsigned long long)accessor->count, MAX_ZEROS);
    if (status == QM_OK) status = qm_builder_reserve_vertices(reader->builder, range.count);
    size_t done = 0;
    if (status == QM_OK && range.first && type == TYPE_FLOAT)
        status = add_float_positions(reader, &range, matrix, &done);
    for (size_t i = done; status == QM_OK && i < range.count; ++i) {
        double position[3] = {matrix[12], matrix[13], matrix[14]};
        if (range.first) status = read_position(reader, accessor, &range, i, matrix, position);
        if (status == QM_OK) status = qm_builder_add_vertex(reader->builder, position);
    }
    if (status != QM_OK || accessor->sparse.count == 0) return status;
    return replace_vertices(reader, index, base, matrix);
}

/* Faces */

typedef struct index_list {
    element_range range; /* first is NULL where the vertices are used in their order */
    int component_type;
    size_t base, vertex_count;
} index_list;

static qm_status read_index(glb_reader *reader, const index_list *list, size_t i, uint32_t *vertex)
{
    size_t index = i;
    if (list->range.first) {
        const uint8_t *at = list->range.first + i * list->range.stride;
        index = read_unsigned(at, list->component_type);
        reader->report->offset = list->range.offset + i * list->range.stride;
    }
    if (index >= list->vertex_count)
        return qm_codec_fail(reader->report, QM_E_INDEX,
                             "face refers to vertex %zu, but its primitive has %zu vertices, counted from 0",
                             index, list->vertex_count);
    *vertex = (uint32_t)(list->base + index);
    return QM_OK;
}

/** Adds triangles of packed 32-bit indices up to a block with one that names no vertex, which the general loop reports;
 * *done counts them. */
static qm_status add_packed_triangles(glb_reader *reader, const index_list *list, size_t triangle_count,
                                      bool mirrored, size_t *done)
{
    qm_status status = QM_OK;
    while (*done < triangle_count && status == QM_OK) {
        uint32_t faces[ELEMENTS_TOGETHER][4];
        size_t left = triangle_count - *done, count = left < ELEMENTS_TOGETHER ? left : ELEMENTS_TOGETHER;
        const uint8_t *at = list->range.first + *done * 3 * sizeof(uint32_t);
        uint32_t max = 0;
        for (size_t i = 0; i < count; ++i, at += 3 * sizeof(uint32_t)) {
            const uint32_t corners[3] = {qm_read_u32_le(at), qm_read_u32_le(at + 4), qm_read_u32_le(at + 8)};
            for (int k = 0; k < 3; ++k)
                max = corners[k] > max ? corners[k] : max;
            const uint32_t base = (uint32_t)list->base,
                           face[4] = {base + corners[0], base + corners[1 + mirrored],
                                      base + corners[2 - mirrored], QM_NO_INDEX};
            memcpy(faces[i], face, sizeof face);
        }
        if (max >= list->vertex_count) break;
        reader->report->offset = list->range.offset + *done * 3 * sizeof(uint32_t);
        status = qm_builder_add_faces(reader->builder, faces, count);
        *done += count;
    }
    return status;
}

static double determinant(const double m[16])
{
    return m[0] * (m[5] * m[10] - m[6] * m[9]) - m[4] * (m[1] * m[10] - m[2] * m[9]) +
           m[8] * (m[1] * m[6] - m[2] * m[5]);
}

/** Ends the polygon in hand, if there is one. */
static qm_status end_polygon(qm_builder *builder, bool mirrored)
{
    size_t count = builder->corner_count;
    if (count == 0) return QM_OK;
    for (size_t i = 1; mirrored && i < count - i; ++i) {
        uint32_t corner = builder->corners[i];
        builder->corners[i] = builder->corners[count - i];
        builder->corners[count - i] = corner;
    }
    return qm_builder_end_face(builder);
}

/** FB_ngon_encoding: triangles in a row that fan out from one corner are one polygon. */
static qm_status add_polygons(glb_reader *reader, const index_list *list, bool mirrored)
{
    qm_builder *builder = reader->builder;
    qm_status status = QM_OK;
    for (size_t i = 0; status == QM_OK && i + 2 < list->range.count; i += 3) {
        uint32_t corners[3];
        for (size_t k = 0; status == QM_OK && k < 3; ++k)
            status = read_index(reader, list, i + k, &corners[k]);
        if (status != QM_OK) return status;
        size_t count = builder->corner_count;
        bool goes_on =
            count > 0 && corners[0] == builder->corners[0] && corners[1] == builder->corners[count - 1];
        if (!goes_on) status = end_polygon(builder, mirrored);
        for (size_t k = goes_on ? 2 : 0; status == QM_OK && k < 3; ++k)
            status = qm_builder_add_corner(builder, corners[k]);
    }
    return status == QM_OK ? end_polygon(builder, mirrored) : status;
}

/** A mirroring transform flips the faces, so their corners are stored in reverse order. */
static qm_status add_faces(glb_reader *reader, const index_list *list, const qm_gltf_primitive *primitive,
                           bool mirrored)
{
    int mode = primitive->mode;
    size_t index_count = list->range.count, triangle_count = mode == TRIANGLES ? index_count / 3
                                                             : index_count > 2 ? index_count - 2
                                                                               : 0;
    reader->report->offset = reader->json.offset;
    if (triangle_count == 0 || (mode == TRIANGLES && index_count % 3 != 0))
        return qm_codec_fail(reader->report, QM_E_FORMAT, "%zu indices are not a multiple of 3", index_count);
    if (mode == TRIANGLES && primitive->has_polygons) return add_polygons(reader, list, mirrored);
    qm_status status = qm_builder_reserve_faces(reader->builder, triangle_count);
    size_t done = 0;
    if (status == QM_OK && mode == TRIANGLES && list->range.first && list->component_type == TYPE_UINT32 &&
        list->range.stride == sizeof(uint32_t))
        status = add_packed_triangles(reader, list, triangle_count, mirrored, &done);
    for (size_t i = done; status == QM_OK && i < triangle_count; ++i) {
        size_t places[3];
        uint32_t corners[3];
        /* The positions in the index list of the corners of triangle i, in the order of the mode. */
        size_t odd = i & 1;
        if (mode == TRIANGLES)
            memcpy(places, (const size_t[3]){3 * i, 3 * i + 1, 3 * i + 2}, 3 * sizeof *places);
        else if (mode == TRIANGLE_STRIP)
            memcpy(places, (const size_t[3]){i, i + 1 + odd, i + 2 - odd}, 3 * sizeof *places);
        else
            memcpy(places, (const size_t[3]){0, i + 1, i + 2}, 3 * sizeof *places);
        for (int k = 0; status == QM_OK && k < 3; ++k)
            status = read_index(reader, list, places[k], &corners[k]);
        if (status == QM_OK)
            status = qm_builder_add_triangle(reader->builder, corners[0], corners[1 + mirrored],
                                             corners[2 - mirrored]);
    }
    return status;
}

/* Draco */

/** Decodes a primitive as a Draco file, once for all nodes that have it; only counts it in a builder that does. */
static qm_status decode_draco(glb_reader *reader, const qm_gltf_primitive *primitive, draco_mesh *out)
{
    byte_range bytes = {0};
    if (primitive->draco == QM_GLTF_NONE)
        return fail_file(reader, QM_E_FORMAT, "KHR_draco_mesh_compression must name a buffer view");
    qm_status status = locate_view(reader, primitive->draco, &bytes);
    if (status != QM_OK) return status;
    qm_codec_report *report = reader->report, inner;
    qm_codec_limits limits = *reader->builder->limits;
    limits.max_vertices -= reader->builder->vertex_count;
    limits.max_faces -= reader->builder->face_count;
    qm_context *ctx = reader->builder->ctx;
    status = reader->builder->only_counts
                 ? qm_codec_count(ctx, QM_FORMAT_DRC, bytes.bytes, bytes.size, &limits, &out->counts, &inner)
                 : qm_codec_decode(ctx, QM_FORMAT_DRC, bytes.bytes, bytes.size, &limits, &out->mesh, &inner);
    out->is_known = status == QM_OK;
    report->offset = bytes.offset + (inner.offset != QM_NO_LOCATION ? inner.offset : 0);
    if (status == QM_E_NO_MEMORY || status == QM_E_CANCELED) return status;
    if (status != QM_OK)
        return qm_codec_fail(report, status, "buffer view %zu: %s", primitive->draco, inner.detail);
    for (size_t i = 0; i < inner.warning_count; ++i)
        if (report->warning_count < MAX_DRACO_WARNINGS)
            qm_codec_warn(report, "buffer view %zu: %s", primitive->draco, inner.warnings[i]);
        else
            ++reader->hidden_count;
    return QM_OK;
}

/** Adds a face of the input, which is the faces first to end - 1 of mesh. */
static qm_status add_whole_face(qm_builder *builder, const qm_mesh *mesh, uint32_t first, uint32_t end,
                                size_t base, bool mirrored)
{
    size_t count = qm_encoder_corner_count(mesh, first, end);
    qm_status status = QM_OK;
    for (size_t i = 0; status == QM_OK && i < count; ++i) {
        uint32_t corner = qm_encoder_corner(mesh, first, mirrored && i > 0 ? count - i : i);
        status = qm_builder_add_corner(builder, (uint32_t)(base + corner));
    }
    return status == QM_OK ? qm_builder_end_face(builder) : status;
}

static qm_status add_draco(glb_reader *reader, const qm_gltf_primitive *primitive, const double matrix[16])
{
    qm_builder *builder = reader->builder;
    const qm_gltf_scene *gltf = &reader->gltf;
    if (!reader->draco) {
        reader->draco = qm_context_alloc(builder->ctx, gltf->primitive_count, sizeof *reader->draco);
        if (!reader->draco) return QM_E_NO_MEMORY;
        memset(reader->draco, 0, gltf->primitive_count * sizeof *reader->draco);
    }
    draco_mesh *decoded = &reader->draco[primitive - gltf->primitives];
    qm_status status = decoded->is_known ? QM_OK : decode_draco(reader, primitive, decoded);
    const qm_mesh *mesh = &decoded->mesh;
    const qm_codec_counts *counts = &decoded->counts;
    size_t base = builder->vertex_count;
    if (status == QM_OK && builder->only_counts) {
        status = qm_builder_reserve_vertices(builder, counts->vertices);
        if (status == QM_OK) status = qm_builder_reserve_faces(builder, counts->faces);
        if (status != QM_OK) return status;
        qm_builder_count(builder, counts->vertices, counts->faces, counts->quads);
        builder->counts_are_low |= !counts->is_exact;
        return QM_OK;
    }
    if (status == QM_OK) status = qm_builder_reserve_vertices(builder, mesh->vertex_count);
    for (size_t i = 0; status == QM_OK && i < mesh->vertex_count; ++i) {
        double position[3];
        if (!transform_point(matrix, mesh->positions + 3 * i, position))
            return fail_file(reader, QM_E_NOT_FINITE, "a coordinate is not a finite number");
        status = qm_builder_add_vertex(builder, position);
    }
    if (status == QM_OK) status = qm_builder_reserve_faces(builder, mesh->face_count);
    bool mirrored = determinant(matrix) < 0;
    for (uint32_t face = 0, end; status == QM_OK && face < mesh->face_count; face = end) {
        end = qm_encoder_face_end(mesh, face);
        status = add_whole_face(builder, mesh, face, end, base, mirrored);
    }
    return status;
}

static qm_status add_primitive(glb_reader *reader, const qm_gltf_primitive *primitive,
                               const double matrix[16])
{
    reader->report->offset = reader->json.offset;
    if (primitive->is_draco) return add_draco(reader, primitive, matrix);
    if (primitive->mode != POINTS && primitive->mode < TRIANGLES) {
        ++reader->line_count;
        return QM_OK;
    }
    if (primitive->positions == QM_GLTF_NONE)
        return fail_file(reader, QM_E_FORMAT, "a primitive has no positions");
    index_list list = {.vertex_count = (size_t)reader->gltf.accessors[primitive->positions].count};
    qm_status status = QM_OK;
    /* Primitives of a mesh often share their positions, which are then added once. */
    if (reader->base_owners[primitive->positions] != reader->visit_count) {
        reader->vertex_bases[primitive->positions] = reader->builder->vertex_count;
        status = add_vertices(reader, primitive->positions, matrix);
        if (status != QM_OK) return status;
        reader->base_owners[primitive->positions] = reader->visit_count;
    }
    if (primitive->mode == POINTS) return QM_OK;
    list.base = reader->vertex_bases[primitive->positions];
    list.range.count = list.vertex_count;
    if (primitive->indices != QM_GLTF_NONE) {
        const qm_gltf_accessor *indices = &reader->gltf.accessors[primitive->indices];
        list.component_type = indices->component_type;
        bool is_unsigned =
            list.component_type == 5121 || list.component_type == 5123 || list.component_type == 5125;
        if (!is_unsigned || indices->component_count != 1)
            return fail_file(reader, QM_E_FORMAT, "indices must be of an unsigned type");
        if (indices->view == QM_GLTF_NONE || indices->sparse.count > 0)
            return qm_codec_fail(reader->report, QM_E_UNSUPPORTED,
                                 "accessor %zu has sparse indices or none: they are not supported",
                                 primitive->indices);
        status = locate_elements(reader, primitive->indices, &list.range);
    }
    return status == QM_OK ? add_faces(reader, &list, primitive, determinant(matrix) < 0) : status;
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

/** Depth-first traversal with a stack; a node has at most one parent, and is therefore visited at most once. */
static qm_status walk_nodes(glb_reader *reader, size_t *stack)
{
    qm_gltf_scene *gltf = &reader->gltf;
    size_t depth = 0;
    for (size_t i = gltf->link_count; i > gltf->first_root; --i)
        stack[depth++] = gltf->links[i - 1];
    while (depth > 0) {
        const qm_gltf_node *node = &gltf->nodes[stack[--depth]];
        const qm_gltf_mesh *mesh = node->mesh != QM_GLTF_NONE ? &gltf->meshes[node->mesh] : NULL;
        if (mesh) ++reader->visit_count;
        for (size_t i = 0; mesh && i < mesh->primitive_count; ++i) {
            qm_status status =
                add_primitive(reader, &gltf->primitives[mesh->first_primitive + i], node->matrix);
            if (status != QM_OK) return status;
        }
        for (size_t i = node->child_count; i > 0; --i) {
            size_t child = gltf->links[node->first_child + i - 1];
            multiply(node->matrix, gltf->nodes[child].matrix);
            stack[depth++] = child;
        }
    }
    return QM_OK;
}

static qm_status read_scene(glb_reader *reader)
{
    qm_gltf_scene *gltf = &reader->gltf;
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
    if (status == QM_OK) {
        if (reader->hidden_count > 0)
            qm_codec_warn(reader->report, "warnings about other Draco data: %zu", reader->hidden_count);
        if (reader->line_count > 0)
            qm_codec_warn(reader->report, "primitives of lines: %zu (ignored)", reader->line_count);
        if (reader->gltf.has_poses) qm_codec_warn(reader->report, "skins and morph targets were not applied");
    }
    qm_context_free(ctx, stack, gltf->node_count, sizeof *stack);
    for (size_t i = 0; reader->draco && i < gltf->primitive_count; ++i)
        qm_mesh_reset(ctx, &reader->draco[i].mesh);
    if (reader->draco) qm_context_free(ctx, reader->draco, gltf->primitive_count, sizeof *reader->draco);
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
    /* By the format, all lengths are metres. */
    memcpy(builder->report->unit, "m", sizeof "m");
    qm_gltf_free(builder->ctx, &reader.gltf);
    return status;
}

/* ---- encoding ---- */

static uint64_t positions_size(const qm_encoder *encoder)
{
    return 12 * (uint64_t)encoder->mesh->vertex_count;
}

static uint64_t coordinates_size(const qm_encoder *encoder)
{
    return encoder->uv ? 8 * (uint64_t)encoder->mesh->vertex_count : 0;
}

static uint64_t indices_size(const qm_encoder *encoder)
{
    return 12 * (uint64_t)encoder->triangles;
}

/** All of the binary part. */
static uint64_t data_size(const qm_encoder *encoder)
{
    return positions_size(encoder) + coordinates_size(encoder) + indices_size(encoder);
}

static void add_view(qm_text *json, uint64_t offset, uint64_t size, int target)
{
    qm_json_add_comma(json);
    qm_text_add_string(json, "{");
    qm_json_add_count(json, "buffer", 0);
    qm_json_add_count(json, "byteOffset", offset);
    qm_json_add_count(json, "byteLength", size);
    qm_json_add_count(json, "target", (uint64_t)target);
    qm_text_add_string(json, "}");
}

static void open_accessor(qm_text *json, int view, int type, uint64_t count, const char *shape)
{
    qm_json_add_comma(json);
    qm_text_add_string(json, "{");
    qm_json_add_count(json, "bufferView", (uint64_t)view);
    qm_json_add_count(json, "componentType", (uint64_t)type);
    qm_json_add_count(json, "count", count);
    qm_json_add_string(json, "type", shape);
}

/* Readers look for texture coordinates where there is a material; the one of the standard, without any, is of metal. */
#define MATERIALS                                                                                            \
    "\"materials\":[{\"name\":\"patches\",\"pbrMetallicRoughness\":"                                         \
    "{\"metallicFactor\":0,\"roughnessFactor\":1}}],"

/** The JSON part, padded with blanks to a multiple of four bytes. */
static void write_glb_json(const qm_encoder *encoder, qm_text *json)
{
    uint64_t positions = positions_size(encoder), coordinates = coordinates_size(encoder),
             indices = indices_size(encoder);
    bool has_faces = indices > 0, has_quads = encoder->facts->quads > 0;
    qm_text_printf(
        json,
        "{\"asset\":{\"version\":\"2.0\",\"generator\":\"quadmeshd\"},%s%s\"scene\":0,\"scenes\":[{"
        "\"nodes\":[0]}],"
        "\"nodes\":[{\"mesh\":0}],\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0%s},%s%s"
        "\"mode\":%d%s}]}],\"buffers\":[{\"byteLength\":%llu}],\"bufferViews\":[",
        has_quads ? "\"extensionsUsed\":[\"FB_ngon_encoding\"]," : "", encoder->uv ? MATERIALS : "",
        encoder->uv ? ",\"TEXCOORD_0\":2" : "", has_quads ? "\"extensions\":{\"FB_ngon_encoding\":{}}," : "",
        has_faces ? "\"indices\":1," : "", has_faces ? TRIANGLES : POINTS,
        encoder->uv ? ",\"material\":0" : "", (unsigned long long)data_size(encoder));
    add_view(json, 0, positions, ARRAY_BUFFER);
    if (has_faces) add_view(json, positions + coordinates, indices, ELEMENT_BUFFER);
    if (encoder->uv) add_view(json, positions, coordinates, ARRAY_BUFFER);
    qm_text_add_string(json, "],\"accessors\":[");
    open_accessor(json, 0, TYPE_FLOAT, encoder->mesh->vertex_count, "VEC3");
    /* The bounding box of the vertices in single precision. */
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    const double *p = encoder->mesh->positions;
    for (size_t i = 0; i < 3 * encoder->mesh->vertex_count; i++) {
        double value = (double)(float)p[i];
        low[i % 3] = fmin(low[i % 3], value);
        high[i % 3] = fmax(high[i % 3], value);
    }
    qm_json_add_numbers(json, "min", low, 3);
    qm_json_add_numbers(json, "max", high, 3);
    qm_text_add_string(json, "}");
    if (has_faces) {
        open_accessor(json, 1, TYPE_UINT32, indices / 4, "SCALAR");
        qm_text_add_string(json, "}");
    }
    if (encoder->uv) {
        open_accessor(json, 2, TYPE_FLOAT, encoder->mesh->vertex_count, "VEC2");
        qm_text_add_string(json, "}");
    }
    qm_text_add_string(json, "]}");
    while (json->size % 4 != 0 && !json->failed)
        qm_text_add_string(json, " ");
}

static qm_status prepare_glb(qm_encoder *encoder)
{
    qm_status status = qm_encoder_round_to_floats(encoder);
    if (status != QM_OK) return status;
    qm_encoder_take_apart(encoder);
    if (encoder->uv) encoder->row_count *= 2;
    write_glb_json(encoder, &encoder->file);
    if (encoder->file.failed) return QM_E_NO_MEMORY;
    encoder->size = 12 + 8 + encoder->file.size + 8 + data_size(encoder);
    encoder->losses.cut_faces = encoder->facts->polygons;
    return encoder->size <= UINT32_MAX ? QM_OK : qm_encoder_fail_size(encoder);
}

static void add_glb_head(const qm_encoder *encoder, qm_text *out)
{
    qm_encoder_add_u32(out, MAGIC);
    qm_encoder_add_u32(out, 2);
    qm_encoder_add_u32(out, (uint32_t)encoder->size);
    qm_encoder_add_u32(out, (uint32_t)encoder->file.size);
    qm_encoder_add_u32(out, CHUNK_JSON);
    qm_text_add(out, encoder->file.data, encoder->file.size);
    qm_encoder_add_u32(out, (uint32_t)data_size(encoder));
    qm_encoder_add_u32(out, CHUNK_BINARY);
}

/** A vertex, or, after them all, a texture coordinate: here v runs downward. */
static void add_glb_vertex(const qm_encoder *encoder, size_t row, qm_text *out)
{
    size_t count = encoder->mesh->vertex_count;
    for (size_t axis = 0; axis < 3 && row < count; axis++)
        qm_encoder_add_f32(out, encoder->mesh->positions[3 * row + axis]);
    if (row < count) return;
    const double *uv = encoder->uv->uv + 2 * (row - count);
    qm_encoder_add_f32(out, uv[0]);
    qm_encoder_add_f32(out, 1.0 - uv[1]);
}

/** FB_ngon_encoding: both triangles of a quad begin at one corner, and no face at that of the face before. A quad is
 * divided along the same diagonal from its first and from its third corner. */
static void add_glb_face(qm_encoder *encoder, uint32_t first, uint32_t end, qm_text *out)
{
    for (uint32_t face = first; face < end; face++) {
        const uint32_t *corner = encoder->mesh->faces + 4 * (size_t)face;
        bool is_quad = corner[3] != QM_NO_INDEX;
        uint32_t count = is_quad ? 4 : 3, start = 0;
        while (corner[start] == encoder->last_first && start + (is_quad ? 2 : 1) < count)
            start += is_quad ? 2 : 1;
        encoder->last_first = corner[start];
        for (uint32_t k = 1; k + 1 < count; k++) {
            qm_encoder_add_u32(out, corner[start]);
            qm_encoder_add_u32(out, corner[(start + k) % count]);
            qm_encoder_add_u32(out, corner[(start + k + 1) % count]);
        }
    }
}

const qm_encoder_format qm_encoder_glb = {prepare_glb, add_glb_head, add_glb_vertex, add_glb_face, true};
