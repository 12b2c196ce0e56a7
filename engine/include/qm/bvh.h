/**
 * bvh.h: the box tree over a mesh, built once and used by projection and distance.
 *
 * Faces are put in Hilbert order and cut into packs of eight triangles (a quad's two stay in one pack), above
 * which lies an implicit tree of eight children a node. The tree keeps a frame of its own: origin at the
 * middle of the box, lengths divided by a power of two so that the mesh measures about 1. Both readings of
 * quads share one tree.
 */
#ifndef QM_BVH_H
#define QM_BVH_H

#include "qm/mesh.h"

typedef struct qm_bvh qm_bvh;

/** What a tree is for. Parts that are not asked for cost neither time nor memory. */
typedef enum qm_bvh_parts {
    QM_BVH_SOURCE = 0,  /* its points are measured to another mesh */
    QM_BVH_TARGET = 1,  /* it is searched for nearest points */
    QM_BVH_PATCHES = 2, /* its quads may be read as bilinear patches */
    QM_BVH_ALL = QM_BVH_TARGET | QM_BVH_PATCHES
} qm_bvh_parts;

/**
 * Builds the tree. The mesh passes qm_mesh_validate; a point set is taken as triangles of no size.
 * thread_count is 1 or more; more than one is used only with ctx->parallel, and gives the same tree.
 *
 * Ownership: borrows the mesh, which must outlive the tree unchanged; *out is the caller's, for
 * qm_bvh_destroy. Threads:   the finished tree is only read, so any number of calls may use it at once.
 * Returns:   QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. After an error *out is NULL.
 */
qm_status qm_bvh_build(qm_context *ctx, const qm_mesh *mesh, qm_bvh_parts parts, int thread_count,
                       qm_bvh **out);

/** Frees a tree with the allocator that built it. NULL is fine. */
void qm_bvh_destroy(qm_context *ctx, qm_bvh *bvh);

/** The mesh that the tree was built over; lives as long as the tree. */
const qm_mesh *qm_bvh_mesh(const qm_bvh *bvh);

/** Bytes that the tree holds, without the mesh. */
size_t qm_bvh_memory_size(const qm_bvh *bvh);

/** Which instruction set the kernels run on: "avx512", "avx2" or "portable". All give the same bits. */
const char *qm_kernel_name(void);

#endif
