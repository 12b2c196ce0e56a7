/**
 * uv_atlas.h: texture coordinates of a mesh of quads, patch by patch: each patch is a rectangle of as many square cells as it
 * has rows and columns, all cells have one size, and no two rectangles overlap or touch.
 */
#ifndef QM_UV_ATLAS_H
#define QM_UV_ATLAS_H

#include "qm/patch.h"

/** The mesh with the vertices of each patch apart from those of the others, and a place in the unit square for each. */
typedef struct qm_uv_atlas {
    qm_mesh
        mesh; /* of the same faces in the same order; a vertex on a border is there once for each of its patches */
    double *
        uv; /* mesh.vertex_count rows of u v, from 0 to 1: u grows with the columns, v upward with the rows */
} qm_uv_atlas;

/**
 * Lays the patches of a mesh out. A patch that lies mirrored in the mesh is turned over, so that where faces are seen from
 * their front no rectangle is a mirror image.
 *
 * patches  of the mesh
 *
 * Ownership: *out is the caller's, for qm_uv_atlas_reset in the same context; empty after an error.
 * Returns:   QM_OK; QM_E_UNSUPPORTED (no quads, or a face of five corners or more); QM_E_NO_MEMORY.
 */
qm_status qm_uv_atlas_make(qm_context *ctx, const qm_mesh *mesh, const qm_patch_set *patches,
                           qm_uv_atlas *out);

/** Frees its arrays; one that is all zero has none. */
void qm_uv_atlas_reset(qm_context *ctx, qm_uv_atlas *atlas);

#endif
