/**
 * encode_internal.h: what the files of the encoders share. A format writes a head, then rows of vertices,
 * then rows of faces; encode.c counts the rows out in blocks.
 */
#ifndef QM_ENCODE_INTERNAL_H
#define QM_ENCODE_INTERNAL_H

#include "encode.h"

/** Writes one of the parts that follow each other in a file. */
typedef struct qm_encode_format {
    /* Checks what the format cannot hold and sets losses and size; NULL: nothing to check. */
    qm_status (*prepare)(qm_encoder *encoder);
    void (*add_head)(const qm_encoder *encoder, qm_text *out);
    void (*add_vertex)(const qm_encoder *encoder, size_t vertex, qm_text *out); /* NULL: no such rows */
    /* One face of the input: its parts are faces first to end - 1 of the mesh. */
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
    uint64_t size; /* 0: not known */
    size_t input_faces, triangles, most_corners;
    size_t vertex, face; /* written so far */
    bool has_head;
    qm_text whole; /* of a file that is made at once */
};

/** The end of the run of faces that are one face of the input. */
static inline uint32_t qm_encode_face_end(const qm_mesh *mesh, uint32_t face)
{
    uint32_t end = face + 1;
    if (mesh->face_origin)
        while (end < mesh->face_count && mesh->face_origin[end] == mesh->face_origin[face])
            end++;
    return end;
}

/** Corners of such a run: a triangle, a quad, or the fan of a polygon. */
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

/** For formats of single precision: the displacement by it. QM_E_SCALE when a coordinate does not fit. */
qm_status qm_encode_round_to_floats(qm_encoder *encoder);

/** A triangle, or the two triangles of a quad, as rows of three corners; returns how many. */
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
