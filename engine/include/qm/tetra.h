/**
 * tetra.h: a hierarchy of offset tetrahedra over the regular patches of a quad mesh, as another accelerator
 * for nearest-point searches. A refit after a deformation is cheap: only the offsets change.
 *
 * The bounding volume of a part of a patch is the solid tetrahedron of its four corners, grown by an offset
 * radius. Parts of more than QM_TETRA_LEAF quads are cut in two across their longer side, so that the halves
 * differ by at most one row or column; smaller ones are leaves, which list the packs of the box tree that
 * contain their quads. A part stores its radius only: the corners are vertices of the mesh. Above the patches
 * is a tree of boxes, eight to a node.
 *
 * The radius of a leaf is the maximum distance of its vertices to the tetrahedron's faces, which bounds all
 * quads in either reading, since the tetrahedron is convex. For a part with halves a and b that meet in v1
 * v2,
 *
 *     r = max(r_a, r_b) + max(d(v1, T), d(v2, T)).
 *
 * Source: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh, sections 4.1 and 4.2;
 * but distances of vertices are taken to the faces of T, never as 0 inside, so that no rounding on a flat T
 * makes a radius too small.
 */
#ifndef QM_TETRA_H
#define QM_TETRA_H

#include "qm/bvh.h"
#include "qm/patch.h"

#define QM_TETRA_LEAF 8 /* quads: two packs of the box tree */

typedef struct qm_tetra qm_tetra;

/**
 * Builds the hierarchy over the faces of a tree that was built with QM_BVH_TARGET, from the patches of its
 * mesh; it serves the readings that the tree serves.
 *
 * Ownership: borrows tree and patches, which must outlive it; *out is the caller's, for qm_tetra_destroy.
 * Threads:   the finished hierarchy is only read, so any number of calls may use it at once.
 * Returns:   QM_OK; QM_E_ARGUMENT (the tree is no target; the patches are of another mesh); QM_E_UNSUPPORTED
 *            (a point set); QM_E_NO_MEMORY; QM_E_CANCELED. After an error *out is NULL.
 */
qm_status qm_tetra_build(qm_context *ctx, const qm_bvh *bvh, const qm_patch_set *patches, qm_tetra **out);

/** Frees a hierarchy with the allocator that built it. NULL is allowed. */
void qm_tetra_destroy(qm_context *ctx, qm_tetra *tetra);

/**
 * Refits the radii of a hierarchy, after a refit of its tree (deform.h): takes the same faces, or NULL for all;
 * recomputes all when the tree has a new frame. *updated is the number of recomputed radii.
 *
 * Returns: QM_OK; QM_E_NO_MEMORY, and then nothing has changed.
 */
qm_status qm_tetra_refit(qm_context *ctx, qm_tetra *tetra, const uint32_t *faces, size_t face_count,
                         size_t *updated);

/** The tree below the hierarchy. */
const qm_bvh *qm_tetra_bvh(const qm_tetra *tetra);

/** Index in the patch set of the patch that contains a face. */
size_t qm_tetra_find_patch(const qm_tetra *tetra, uint32_t face);

/** Bytes that the hierarchy holds, without tree and patches. */
size_t qm_tetra_memory_size(const qm_tetra *tetra);

#endif
