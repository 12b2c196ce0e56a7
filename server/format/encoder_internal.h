/**
 * encoder_internal.h: the internal header of the encoders. A format writes a header, then vertices, then faces; encoder.c
 * calls it for blocks of them.
 */
#ifndef QM_ENCODER_INTERNAL_H
#define QM_ENCODER_INTERNAL_H

#include <endian.h>
#include <string.h>

#include "encoder.h"

/** The functions of a format. */
typedef struct qm_encoder_format {
    /* Rejects meshes that the format cannot hold, and sets losses and size; NULL: nothing to check. */
    qm_status (*prepare)(qm_encoder *encoder);
    void (*add_head)(const qm_encoder *encoder, qm_text *out);
    void (*add_vertex)(const qm_encoder *encoder, size_t row,
                       qm_text *out); /* of row_count; NULL: the format has none */
    /* A face of the input, which is the faces first to end - 1 of the mesh. */
    void (*add_face)(qm_encoder *encoder, uint32_t first, uint32_t end, qm_text *out);
    bool has_uv; /* it holds texture coordinates */
} qm_encoder_format;

/** The encoder of each format, in the file codec_FORMAT.c. */
#define XX(number, suffix, name, media, magic) extern const qm_encoder_format qm_encoder_##name;
QM_FORMAT_MAP(XX)
#undef XX

struct qm_encoder {
    qm_context *ctx;
    const qm_mesh *mesh;
    const qm_mesh_facts *facts;
    const qm_encoder_format *format;
    int bits;
    qm_encode_losses losses;
    uint64_t size; /* 0: unknown */
    size_t input_faces, triangles, max_corners;
    const qm_uv_atlas *uv; /* NULL: none */
    size_t row_count; /* rows of add_vertex: one for each vertex, unless prepare says that there are more */
    size_t vertex, face; /* rows and faces that are written */
    uint32_t last_first; /* the corner that the last face was written from, in a format where that counts */
    bool has_head;
    qm_text file; /* of a format that is encoded at once */
};

/** The end of the range of faces that form one face of the input. */
static inline uint32_t qm_encoder_face_end(const qm_mesh *mesh, uint32_t face)
{
    uint32_t end = face + 1;
    if (mesh->face_origin)
        while (end < mesh->face_count && mesh->face_origin[end] == mesh->face_origin[face])
            end++;
    return end;
}

/** Corners of such a range: a triangle, a quad, or the fan of a polygon. */
static inline size_t qm_encoder_corner_count(const qm_mesh *mesh, uint32_t first, uint32_t end)
{
    return mesh->faces[4 * (size_t)first + 3] != QM_NO_INDEX ? 4 : 2 + (size_t)(end - first);
}

static inline uint32_t qm_encoder_corner(const qm_mesh *mesh, uint32_t first, size_t corner)
{
    const uint32_t *face = mesh->faces + 4 * (size_t)first;
    bool is_stored = corner < 3 || face[3] != QM_NO_INDEX;
    return is_stored ? face[corner] : face[4 * (corner - 2) + 2];
}

/** Sets the displacement of a format in single precision. QM_E_SCALE for coordinates beyond it. */
qm_status qm_encoder_round_to_floats(qm_encoder *encoder);

/** The triangle, or the two triangles of a quad, as three corners each; returns their number. */
static inline int qm_encoder_list_triangles(const uint32_t face[4], uint32_t rows[2][3])
{
    for (int i = 0; i < 3; i++)
        rows[0][i] = face[i];
    rows[1][0] = face[0];
    rows[1][1] = face[2];
    rows[1][2] = face[3];
    return face[3] == QM_NO_INDEX ? 1 : 2;
}

/** With texture coordinates: writes the mesh whose patches are apart, in a format that has one of them for each vertex. */
void qm_encoder_take_apart(qm_encoder *encoder);

/** Fails with QM_E_TOO_LARGE. */
qm_status qm_encoder_fail_size(const qm_encoder *encoder);

/** Rows of text: numbers have the shortest decimals that read back to the same double. */
void qm_encoder_add_position(const qm_encoder *encoder, size_t vertex, const char *start, qm_text *out);
void qm_encoder_add_vertex_row(const qm_encoder *encoder, size_t vertex, qm_text *out);

/** Appends the corners, each after a blank; base is the index of the first vertex in the format. */
void qm_encoder_add_corners(const qm_encoder *encoder, uint32_t first, uint32_t end, uint32_t base,
                            qm_text *out);

/* Numbers of binary formats, little-endian. */

static inline void qm_encoder_add_u32(qm_text *out, uint32_t value)
{
    uint32_t bits = htole32(value);
    qm_text_add(out, (const char *)&bits, sizeof bits);
}

static inline void qm_encoder_add_f32(qm_text *out, double value)
{
    float single = (float)value;
    uint32_t bits;
    memcpy(&bits, &single, sizeof bits);
    qm_encoder_add_u32(out, bits);
}

static inline void qm_encoder_add_f64(qm_text *out, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    bits = htole64(bits);
    qm_text_add(out, (const char *)&bits, sizeof bits);
}

#endif
