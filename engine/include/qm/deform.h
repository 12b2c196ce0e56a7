/**
 * deform.h: refits the trees of a mesh whose vertices move while its faces stay. The order of the faces, the
 * patches and the structure of the trees are kept; boxes and radii are recomputed from the leaves up, all of
 * them or only the ancestors of changed faces.
 *
 * The frames of triangles, which distances need, are many times larger than the bounds; a search recomputes
 * them when it first needs them. Collisions need the bounds alone.
 *
 * Source: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh, section 4.1.2.
 */
#ifndef QM_DEFORM_H
#define QM_DEFORM_H

#include "qm/tetra.h"

/** Maps a mesh's vertices to faces, and faces to slots of its trees. Read-only once built; serves every
 * deformation of the mesh. */
typedef struct qm_deformer qm_deformer;

/**
 * Builds the maps of a tree's mesh.
 *
 * Ownership: borrows nothing; *out is the caller's, for qm_deformer_destroy.
 * Returns:   QM_OK; QM_E_NO_MEMORY. After an error *out is NULL.
 */
qm_status qm_deformer_build(qm_context *ctx, const qm_bvh *bvh, qm_deformer **out);
void qm_deformer_destroy(qm_context *ctx, qm_deformer *deformer);

/** Bytes that the maps hold. */
size_t qm_deformer_memory_size(const qm_deformer *deformer);

/**
 * Finds the faces that have one of these vertices (of a point set: the vertices themselves), ascending and
 * distinct.
 *
 * faces   *face_count entries, the caller's, for qm_context_free with that count
 *
 * Returns: QM_OK; QM_E_INDEX (ctx->message names the entry); QM_E_NO_MEMORY.
 */
qm_status qm_deformer_find_faces(qm_context *ctx, const qm_deformer *deformer, const uint32_t *vertices,
                                 size_t vertex_count, uint32_t **faces, size_t *face_count);

/**
 * Refits the boxes of a tree to new positions. When the mesh has left the frame of the tree, or has become
 * much smaller than it, the tree gets a new frame and all boxes are recomputed.
 *
 * mesh     has the faces of the tree's mesh, and passes qm_mesh_validate; the tree borrows it from now on
 * faces    the faces with a moved vertex, ascending, or NULL for all
 * updated  number of recomputed boxes
 *
 * Threads: exclusive: no other call may use the tree meanwhile.
 * Returns: QM_OK; QM_E_NO_MEMORY, and then nothing has changed.
 */
qm_status qm_bvh_refit(qm_context *ctx, qm_bvh *bvh, const qm_deformer *deformer, const qm_mesh *mesh,
                       const uint32_t *faces, size_t face_count, int thread_count, size_t *updated);

/** Number of boxes of a tree: of its packs and of the nodes above them. */
size_t qm_bvh_box_count(const qm_bvh *bvh);

#endif
