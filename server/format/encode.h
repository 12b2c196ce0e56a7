/**
 * encode.h: meshes to file bytes, a block at a time. Quads and polygons stay what they were in OBJ, PLY, OFF
 * and Draco; STL and glTF have triangles alone and cut them as mesh.h reads them.
 */
#ifndef QM_ENCODE_H
#define QM_ENCODE_H

#include "base/text.h"
#include "codec.h"

#define QM_ENCODE_MAX_BITS 24 /* beyond it single precision rounds more than the steps do */

/** What the file does not hold as the mesh does. */
typedef struct qm_encode_losses {
    double displacement;      /* no vertex lies farther from its place; 0 when each is where it was */
    size_t cut_faces;         /* quads and polygons that are triangles in the file */
    size_t left_out_vertices; /* used by no face */
} qm_encode_losses;

typedef struct qm_encoder qm_encoder;

/**
 * Looks at the whole mesh; Draco files are made at once, all others by qm_encoder_next.
 *
 * mesh   borrowed until the encoder is destroyed
 * facts  of the mesh
 * bits   of Draco's steps along the longest side of the box, 1 to QM_ENCODE_MAX_BITS; 0: single precision
 *
 * Returns QM_OK; QM_E_UNSUPPORTED for points in a format of faces or faces in one of points; QM_E_SCALE for
 * coordinates beyond single precision where the format has no better; QM_E_TOO_LARGE; QM_E_NO_MEMORY; with
 * ctx->message.
 */
qm_status qm_encoder_create(qm_context *ctx, const qm_mesh *mesh, const qm_mesh_facts *facts,
                            qm_format format, int bits, qm_encoder **out);
void qm_encoder_destroy(qm_encoder *encoder);

qm_encode_losses qm_encoder_losses(const qm_encoder *encoder);

/** Bytes of the whole file; false when only writing it would tell. */
bool qm_encoder_size(const qm_encoder *encoder, uint64_t *size);

/** Adds the next bytes of the file to out, some 100 kB. False when they were the last. */
bool qm_encoder_next(qm_encoder *encoder, qm_text *out);

#endif
