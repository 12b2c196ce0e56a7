/**
 * codec_build.h: what the decoders share: a mesh that grows as a file is read, words for faults and warnings,
 * and bytes read in either order. For server/codec*.c only; others use codec.h.
 *
 * A decoder adds vertices and faces; the builder checks limits, cuts polygons in fans, counts what deserves a
 * warning and trims the arrays at the end. Corner indices may refer to vertices that come later.
 */
#ifndef QM_CODEC_BUILD_H
#define QM_CODEC_BUILD_H

#include <string.h>

#include "codec.h"

typedef struct qm_builder {
    qm_context *ctx;
    const qm_codec_limits *limits;
    qm_codec_report *report;
    double *positions;
    size_t vertex_count, vertex_capacity;
    float *normals; /* NULL until the first one; then one for each vertex */
    size_t normal_capacity;
    uint32_t *faces;
    size_t face_count, face_capacity;
    uint32_t *face_origin; /* NULL until the first polygon; capacity follows face_capacity from then on */
    size_t origin_capacity;
    qm_mesh_grid *grids; /* that the file tells of */
    size_t grid_count, grid_capacity;
    uint32_t *corners; /* of the face that is being read */
    size_t corner_count, corner_capacity;
    size_t input_face_count, polygon_count, repeated_count, bad_normal_count;
} qm_builder;

/** Reads the whole file into the builder. In the report it sets the place where it stopped, whatever the
 * outcome. */
typedef qm_status qm_decoder(qm_builder *builder, const uint8_t *bytes, size_t size);

qm_decoder qm_codec_decode_obj, qm_codec_decode_ply, qm_codec_decode_stl, qm_codec_decode_off,
    qm_codec_decode_glb, qm_codec_decode_drc, qm_codec_decode_xyz;

/** True for the bytes of a binary STL, told by the size that follows from its count, as text may begin
 * alike. */
bool qm_codec_is_binary_stl(const uint8_t *bytes, size_t size);

/** Writes the detail and returns status. */
qm_status qm_codec_fail(qm_codec_report *report, qm_status status, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/** Adds a warning. A decoder has fewer kinds of them than the report has room for. */
void qm_codec_warn(qm_codec_report *report, const char *format, ...) __attribute__((format(printf, 2, 3)));

/** Makes room for at least needed elements, doubling; false when out of memory. */
bool qm_array_reserve(qm_context *ctx, void **block, size_t *capacity, size_t needed, size_t width);

/** Makes room for so many more vertices or faces at once: QM_E_TOO_LARGE, QM_E_NO_MEMORY. The caller has
 * checked the count against the bytes of the file. */
qm_status qm_builder_reserve_vertices(qm_builder *builder, uint64_t count);
qm_status qm_builder_reserve_faces(qm_builder *builder, uint64_t count);

/** Notes a grid of quads that the file says its faces were made of. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_builder_add_grid(qm_builder *builder, qm_mesh_grid grid);

/** Slow halves of the calls below: room for one more; QM_E_TOO_LARGE, QM_E_NO_MEMORY, QM_E_CANCELED. */
qm_status qm_builder_grow_vertices(qm_builder *builder);
qm_status qm_builder_grow_corners(qm_builder *builder);
qm_status qm_builder_grow_faces(qm_builder *builder);

/** Adds a vertex. The coordinates are finite. */
static inline qm_status qm_builder_add_vertex(qm_builder *builder, const double position[3])
{
    size_t count = builder->vertex_count;
    if (count == builder->vertex_capacity || count == builder->limits->max_vertices ||
        (count & 0xffff) == 0) {
        qm_status status = qm_builder_grow_vertices(builder);
        if (status != QM_OK) return status;
    }
    memcpy(builder->positions + 3 * builder->vertex_count++, position, 3 * sizeof *position);
    return QM_OK;
}

/** Adds many. */
qm_status qm_builder_add_vertices(qm_builder *builder, const double *positions, size_t count);

/** Gives the last vertex a normal; a file gives one to every vertex or to none. QM_E_NO_MEMORY. */
qm_status qm_builder_set_normal(qm_builder *builder, const double normal[3]);

/** Adds a corner to the face that is being read. */
static inline qm_status qm_builder_add_corner(qm_builder *builder, uint32_t vertex)
{
    if (builder->corner_count == builder->corner_capacity) {
        qm_status status = qm_builder_grow_corners(builder);
        if (status != QM_OK) return status;
    }
    builder->corners[builder->corner_count++] = vertex;
    return QM_OK;
}

/** Ends the face: triangles and quads are stored as they are, polygons as fans. QM_E_FORMAT for fewer than
 * three corners. */
qm_status qm_builder_end_face(qm_builder *builder);

/** A polygon whose fan has no such triangle may still name a vertex twice: it then only touches itself. */
static inline bool qm_face_repeats_corner(const uint32_t face[4])
{
    uint32_t a = face[0], b = face[1], c = face[2], d = face[3];
    return (a == b) | (b == c) | (c == a) | (d == a) | (d == b) | (d == c);
}

/** Writes a face where there is room for it. */
static inline void qm_builder_store_face(qm_builder *builder, const uint32_t face[4])
{
    memcpy(builder->faces + 4 * builder->face_count, face, 4 * sizeof *face);
    if (builder->face_origin) builder->face_origin[builder->face_count] = (uint32_t)builder->input_face_count;
    ++builder->face_count;
}

/** The three calls above for a triangle or a quad at once; the fourth corner of a triangle is QM_NO_INDEX,
 * which no other corner is. */
static inline qm_status qm_builder_add_face(qm_builder *builder, const uint32_t corners[4])
{
    size_t count = builder->face_count;
    if (count == builder->face_capacity || count == builder->limits->max_faces || builder->face_origin ||
        (builder->input_face_count & 0xffff) == 0) {
        qm_status status = qm_builder_grow_faces(builder);
        if (status != QM_OK) return status;
    }
    builder->repeated_count += qm_face_repeats_corner(corners);
    qm_builder_store_face(builder, corners);
    ++builder->input_face_count;
    return QM_OK;
}

/** The same for many. */
qm_status qm_builder_add_faces(qm_builder *builder, const uint32_t (*faces)[4], size_t count);

static inline qm_status qm_builder_add_triangle(qm_builder *builder, uint32_t a, uint32_t b, uint32_t c)
{
    return qm_builder_add_face(builder, (const uint32_t[4]){a, b, c, QM_NO_INDEX});
}

/** Says which vertex a face asked for in vain; both count as the format does. */
qm_status qm_builder_fail_index(qm_builder *builder, uint64_t vertex);

/**
 * Ends the mesh: warns about polygons and repeated corners, trims the arrays, hands them to out and checks
 * the mesh. QM_E_EMPTY, QM_E_NOT_FINITE (span), QM_E_NO_MEMORY.
 */
qm_status qm_builder_finish(qm_builder *builder, qm_mesh *out);

/** Frees what finish did not hand over. */
void qm_builder_free(qm_builder *builder);

/** Vertices by position: the index of an equal vertex (-0 equals 0), or of a new one. */
typedef struct qm_welder {
    qm_builder *builder;
    uint32_t *slots; /* open addressing, slot_count a power of two; QM_NO_INDEX is free */
    size_t slot_count;
    uint64_t seed; /* drawn for each file, so that no file can be made whose vertices all collide */
} qm_welder;

#define QM_WELDED_TOGETHER 48 /* positions at most, of which the call below waits for the memory at once */

/** With room for so many vertices, a guess that the bytes of the file bear out. A failure leaves nothing to
 * free. */
qm_status qm_welder_create(qm_builder *builder, size_t vertex_count, qm_welder *welder);

/** For rows of x y z, one after the other; after a failure *done counts those before it. */
qm_status qm_welder_find(qm_welder *welder, const double *positions, size_t count, uint32_t *vertices,
                         size_t *done);
void qm_welder_destroy(qm_welder *welder);

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
