/**
 * encoder.h: encodes meshes as files, a block at a time. OBJ, PLY, OFF and Draco keep quads and polygons; STL and glTF
 * have triangles only, into which faces are cut as mesh.h reads them.
 */
#ifndef QM_ENCODER_H
#define QM_ENCODER_H

#include "base/text.h"
#include "codec.h"
#include "uv_atlas.h"

#define QM_ENCODE_MAX_BITS 24 /* more bits are below the rounding of single precision */

/** Differences between the file and the mesh. */
typedef struct qm_encode_losses {
    double displacement;      /* max distance of a vertex from its position; 0 if all are exact */
    size_t cut_faces;         /* quads and polygons that are triangles in the file */
    size_t left_out_vertices; /* vertices that no face uses */
} qm_encode_losses;

typedef struct qm_encoder qm_encoder;

/**
 * Checks the whole mesh. Draco files are encoded here, all others by qm_encoder_next.
 *
 * mesh   borrowed until the encoder is destroyed
 * facts  of the mesh
 * bits   of Draco's quantisation along the longest side of the box, 1 to QM_ENCODE_MAX_BITS; 0: single precision
 * uv     texture coordinates of the mesh, borrowed as well, for OBJ (vt), PLY (s and t of vertices) and glTF (TEXCOORD_0, whose
 *        v runs downward); the vertices of patches are apart in PLY and glTF. NULL: none
 *
 * Returns QM_OK; QM_E_UNSUPPORTED for points in a format of faces, faces in one of points, or texture coordinates in another
 * format; QM_E_SCALE for coordinates beyond single precision in a format that has no other; QM_E_TOO_LARGE; QM_E_NO_MEMORY; with
 * ctx->message.
 */
qm_status qm_encoder_create(qm_context *ctx, const qm_mesh *mesh, const qm_mesh_facts *facts,
                            qm_format format, int bits, const qm_uv_atlas *uv, qm_encoder **out);
void qm_encoder_destroy(qm_encoder *encoder);

/** Whether a format holds texture coordinates: obj, ply and glb. */
bool qm_encoder_holds_uv(qm_format format);

qm_encode_losses qm_encoder_losses(const qm_encoder *encoder);

/** The size of the whole file; false if it is unknown before the end. */
bool qm_encoder_size(const qm_encoder *encoder, uint64_t *size);

/** Appends the next bytes of the file to out, some 100 kB. False after the last ones. */
bool qm_encoder_next(qm_encoder *encoder, qm_text *out);

#endif
