/**
 * encode_internal.h: the internal header of the encoders. A format writes a header, then vertices, then faces; encode.c
 * calls it for blocks of them.
 */
#ifndef QM_ENCODE_INTERNAL_H
#define QM_ENCODE_INTERNAL_H

#include "encode.h"

/** The functions of a format. */
typedef struct qm_encode_format {
    /* Rejects meshes that the format cannot hold, and sets losses and size; NULL: nothing to check. */
    qm_status (*prepare)(qm_encoder *encoder);
    void (*add_head)(const qm_encoder *encoder, qm_text *out);
    void (*add_vertex)(const qm_encoder *encoder, size_t vertex,
                       qm_text *out); /* NULL: the format has none */
    /* A face of the input, which is the faces first to end - 1 of the mesh. */
    void (*add_face)(const qm_encoder *encoder, uint32_t first, uint32_t end, qm_text *out);
} qm_encode_format;

extern const qm_encode_format qm_encode_obj, qm_encode_off, qm_encode_xyz, qm_encode_ply, qm_encode_stl,
    qm_encode_glb, qm_encode_drc;

struct qm_encoder {
    qm_context *ctx;
    const qm_mesh *mesh;
    const qm_mesh_facts *facts;
    const qm_encode_format *format;
    int bits;
    qm_encode_losses losses;
    uint64_t size; /* 0: unknown */
    size_t input_faces, triangles, max_corners;
    size_t vertex, face; /* written so far */
    bool has_head;
    qm_text file; /* of a format that is encoded at once */
};

/** The end of the range of faces that form one face of the input. */
static inline uint32_t qm_encode_face_end(const qm_mesh *mesh, uint32_t face)
{
    uint32_t end = face + 1;
    if (mesh->face_origin)
        while (end < mesh->face_count && mesh->face_origin[end] == mesh->face_origin[face])
            end++;
    return end;
}

/** Corners of such a range: a triangle, a quad, or the fan of a polygon. */
static inline size_t qm_encode_corner_count(const qm_mesh *mesh, uint32_t first, uint32_t end)
{
    return mesh->faces[4 * (size_t)first + 3] != QM_NO_INDEX ? 4 : 2 + (size_t)(end - first);
}

static inline uint32_t qm_encode_corner(const qm_mesh *mesh, uint32_t first, size_t corner)
{
    const uint32_t *face = mesh->faces + 4 * (size_t)first;
    bool is_stored = corner < 3 || face[3] != QM_NO_INDEX;
    return is_stored ? face[corner] : face[4 * (corner - 2) + 2];
}

/** Sets the displacement of a format in single precision. QM_E_SCALE for coordinates beyond it. */
qm_status qm_encode_round_to_floats(qm_encoder *encoder);

/** The triangle, or the two triangles of a quad, as three corners each; returns their number. */
static inline int qm_encode_list_triangles(const uint32_t face[4], uint32_t rows[2][3])
{
    for (int i = 0; i < 3; i++)
        rows[0][i] = face[i];
    rows[1][0] = face[0];
    rows[1][1] = face[2];
    rows[1][2] = face[3];
    return face[3] == QM_NO_INDEX ? 1 : 2;
}

#endif
