/**
 * deform.h: meshes whose vertices move while their faces stay. The order of the faces, the patches and the
 * trees stay as they are; boxes and radii are found anew from the leaves up, all of them or only those above
 * the faces that changed.
 *
 * What a tree needs to measure distances (the frames of its triangles) is many times larger than its bounds;
 * what there was of it is made anew when a search asks for it. Collisions need the bounds alone.
 *
 * Source: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh, section 4.1.2.
 */
#ifndef QM_DEFORM_H
#define QM_DEFORM_H

#include "qm/tetra.h"

/** Where a mesh's vertices and faces are found in its trees. Only read once it is built; serves every
 * deformation of the mesh. */
typedef struct qm_deformer qm_deformer;

/**
 * Ownership: borrows nothing; *out is the caller's, for qm_deformer_destroy.
 * Returns:   QM_OK; QM_E_NO_MEMORY. After an error *out is NULL.
 */
qm_status qm_deformer_build(qm_context *ctx, const qm_bvh *bvh, qm_deformer **out);
void qm_deformer_destroy(qm_context *ctx, qm_deformer *deformer);
size_t qm_deformer_memory_size(const qm_deformer *deformer);

/**
 * Finds the faces that have one of these vertices (of a point set: those vertices), ascending, each once.
 * *faces has *face_count entries and is the caller's, for qm_context_free with that count.
 *
 * Returns QM_OK; QM_E_INDEX (ctx->message names the entry); QM_E_NO_MEMORY.
 */
qm_status qm_deformer_find_faces(qm_context *ctx, const qm_deformer *deformer, const uint32_t *vertices,
                                 size_t vertex_count, uint32_t **faces, size_t *face_count);

/**
 * Finds the boxes of a tree anew. mesh has the faces of the tree's and new positions, which pass
 * qm_mesh_validate; the tree borrows it from now on. faces are those with a moved vertex, ascending, or NULL
 * for all. When the mesh has left the frame of the tree, or has become much smaller than it, everything is
 * found anew in a new one.
 *
 * *updated counts the boxes that were found. Nobody else uses the tree meanwhile.
 * Returns QM_OK; QM_E_NO_MEMORY, and then nothing has changed.
 */
qm_status qm_bvh_refit(qm_context *ctx, qm_bvh *bvh, const qm_deformer *deformer, const qm_mesh *mesh,
                       const uint32_t *faces, size_t face_count, int thread_count, size_t *updated);

/** Boxes of a tree: those of its packs and of the groups above them. */
size_t qm_bvh_box_count(const qm_bvh *bvh);

/**
 * Finds the radii of a hierarchy anew, after the tree that it lies over: the same faces, or NULL for all; all
 * when the tree has a new frame. *updated counts the radii that were found.
 *
 * Returns QM_OK; QM_E_NO_MEMORY, and then nothing has changed.
 */
qm_status qm_tetra_refit(qm_context *ctx, qm_tetra *tetra, const uint32_t *faces, size_t face_count,
                         size_t *updated);

#endif
