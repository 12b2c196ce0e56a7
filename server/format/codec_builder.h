/**
 * codec_builder.h: the internal header of the decoders: a mesh that grows while a file is read, errors and warnings, and
 * reads of little-endian values. Others include codec.h.
 *
 * A decoder adds vertices and faces; the builder checks limits, cuts polygons into fans, counts events for warnings and
 * trims the arrays at the end. Corners may refer to later vertices.
 */
#ifndef QM_CODEC_BUILDER_H
#define QM_CODEC_BUILDER_H

#include <string.h>

#include "codec.h"

typedef struct qm_builder {
    qm_context *ctx;
    const qm_codec_limits *limits;
    qm_codec_report *report;
    double *positions;
    size_t vertex_count, vertex_capacity;
    float *normals; /* NULL until the first one; then one per vertex */
    size_t normal_capacity;
    uint32_t *faces;
    size_t face_count, face_capacity;
    uint32_t *face_origin; /* NULL until the first polygon; capacity follows face_capacity from then on */
    size_t origin_capacity;
    qm_mesh_grid *grids; /* grids of quads that the file names */
    size_t grid_count, grid_capacity;
    uint32_t *corners; /* of the current face */
    size_t corner_count, corner_capacity;
    size_t input_face_count, polygon_count, repeated_count, bad_normal_count;
    /* Vertices and faces are counted and not stored: there are no arrays, and the capacities stay equal to the counts,
     * so that each addition takes the slow path. */
    bool only_counts, counts_are_low; /* low: there may be more than were counted */
    size_t quad_count;                /* with only_counts */
} qm_builder;

/** Decodes the whole file into the builder. In any case it sets the location in the report where it stopped. */
typedef qm_status qm_decoder(qm_builder *builder, const uint8_t *bytes, size_t size);

/** The decoder of each format, in the file codec_FORMAT.c. */
/** True for the text form of glTF: an object of JSON. */
bool qm_codec_is_gltf_text(const uint8_t *bytes, size_t size);

#define XX(number, suffix, name, media, magic) extern qm_decoder qm_codec_decode_##name;
QM_FORMAT_MAP(XX)
#undef XX

/** Whether a file is a binary STL, by the size that follows from its count: a text may start with the same bytes. */
bool qm_codec_is_binary_stl(const uint8_t *bytes, size_t size);

/** Writes the detail and returns status. */
qm_status qm_codec_fail(qm_codec_report *report, qm_status status, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/** Adds a warning. Warnings after the first QM_CODEC_WARNING_COUNT are dropped. */
void qm_codec_warn(qm_codec_report *report, const char *format, ...) __attribute__((format(printf, 2, 3)));

/** Grows an array to at least needed elements, by doubling; false if memory runs out. */
bool qm_codec_reserve(qm_context *ctx, void **block, size_t *capacity, size_t needed, size_t width);

/** Reserve capacity for count more vertices or faces: QM_E_TOO_LARGE, QM_E_NO_MEMORY. The caller has checked the count
 * against the size of the file. */
qm_status qm_builder_reserve_vertices(qm_builder *builder, uint64_t count);
qm_status qm_builder_reserve_faces(qm_builder *builder, uint64_t count);

/** Adds a grid of quads that the file says its faces form. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_builder_add_grid(qm_builder *builder, qm_mesh_grid grid);

/** The slow paths of the calls below: capacity for one more; QM_E_TOO_LARGE, QM_E_NO_MEMORY, QM_E_CANCELED. */
qm_status qm_builder_grow_vertices(qm_builder *builder);
qm_status qm_builder_grow_corners(qm_builder *builder);
qm_status qm_builder_grow_faces(qm_builder *builder);

/** Counts vertices, and faces of which some are quads, in a builder that only counts. */
static inline void qm_builder_count(qm_builder *builder, size_t vertices, size_t faces, size_t quads)
{
    QM_ASSERT(builder->only_counts && quads <= faces);
    builder->vertex_capacity = builder->vertex_count += vertices;
    builder->face_capacity = builder->face_count += faces;
    builder->quad_count += quads;
}

/** Adds a vertex. The coordinates are finite. */
static inline qm_status qm_builder_add_vertex(qm_builder *builder, const double position[3])
{
    size_t count = builder->vertex_count;
    if (count == builder->vertex_capacity || count == builder->limits->max_vertices ||
        (count & 0xffff) == 0) {
        qm_status status = qm_builder_grow_vertices(builder);
        if (status != QM_OK) return status;
        if (builder->only_counts) {
            qm_builder_count(builder, 1, 0, 0);
            return QM_OK;
        }
    }
    memcpy(builder->positions + 3 * builder->vertex_count++, position, 3 * sizeof *position);
    return QM_OK;
}

/** Replaces the position of a vertex. The coordinates are finite. */
static inline void qm_builder_set_vertex(qm_builder *builder, size_t vertex, const double position[3])
{
    QM_ASSERT(vertex < builder->vertex_count);
    if (!builder->only_counts) memcpy(builder->positions + 3 * vertex, position, 3 * sizeof *position);
}

/** Adds count vertices. */
qm_status qm_builder_add_vertices(qm_builder *builder, const double *positions, size_t count);

/** Sets the normal of the last vertex. A file has normals of all vertices or of none. QM_E_NO_MEMORY. */
qm_status qm_builder_set_normal(qm_builder *builder, const double normal[3]);

/** Adds a corner to the current face. */
static inline qm_status qm_builder_add_corner(qm_builder *builder, uint32_t vertex)
{
    if (builder->corner_count == builder->corner_capacity) {
        qm_status status = qm_builder_grow_corners(builder);
        if (status != QM_OK) return status;
    }
    builder->corners[builder->corner_count++] = vertex;
    return QM_OK;
}

/** Ends the current face: stores triangles and quads, and polygons as fans. QM_E_FORMAT for fewer than three corners. */
qm_status qm_builder_end_face(qm_builder *builder);

/** Whether a triangle or quad names a vertex twice. A polygon may do so without such a triangle in its fan: it then only
 * touches itself. */
static inline bool qm_face_repeats_corner(const uint32_t face[4])
{
    uint32_t a = face[0], b = face[1], c = face[2], d = face[3];
    return (a == b) | (b == c) | (c == a) | (d == a) | (d == b) | (d == c);
}

/** Stores a face; the capacity is sufficient. */
static inline void qm_builder_store_face(qm_builder *builder, const uint32_t face[4])
{
    memcpy(builder->faces + 4 * builder->face_count, face, 4 * sizeof *face);
    if (builder->face_origin) builder->face_origin[builder->face_count] = (uint32_t)builder->input_face_count;
    ++builder->face_count;
}

/** Adds a triangle or quad in one call; the fourth corner of a triangle is QM_NO_INDEX, which no other corner is. */
static inline qm_status qm_builder_add_face(qm_builder *builder, const uint32_t corners[4])
{
    size_t count = builder->face_count;
    if (count == builder->face_capacity || count == builder->limits->max_faces || builder->face_origin ||
        (builder->input_face_count & 0xffff) == 0) {
        qm_status status = qm_builder_grow_faces(builder);
        if (status != QM_OK) return status;
        if (builder->only_counts) {
            qm_builder_count(builder, 0, 1, corners[3] != QM_NO_INDEX);
            ++builder->input_face_count;
            return QM_OK;
        }
    }
    builder->repeated_count += qm_face_repeats_corner(corners);
    qm_builder_store_face(builder, corners);
    ++builder->input_face_count;
    return QM_OK;
}

/** Adds count faces. */
qm_status qm_builder_add_faces(qm_builder *builder, const uint32_t (*faces)[4], size_t count);

static inline qm_status qm_builder_add_triangle(qm_builder *builder, uint32_t a, uint32_t b, uint32_t c)
{
    return qm_builder_add_face(builder, (const uint32_t[4]){a, b, c, QM_NO_INDEX});
}

/** Reports that a face refers to a missing vertex, numbered as in the format. */
qm_status qm_builder_fail_index(qm_builder *builder, uint64_t vertex);

/**
 * Ends the mesh: adds warnings about polygons and repeated corners, trims the arrays, moves them to out and validates the
 * mesh. QM_E_EMPTY, QM_E_NOT_FINITE (span), QM_E_NO_MEMORY.
 */
qm_status qm_builder_finish(qm_builder *builder, qm_mesh *out);

/** Frees what qm_builder_finish did not move. */
void qm_builder_free(qm_builder *builder);

static inline uint32_t qm_read_u32_le(const uint8_t *bytes)
{
    return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
}

static inline float qm_read_f32_le(const uint8_t *bytes)
{
    uint32_t bits = qm_read_u32_le(bytes);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

#endif
