/**
 * bvh.h: the bounding volume hierarchy over a mesh: a tree of boxes, built once and searched by projection,
 * distance and collision.
 *
 * Faces are sorted in Hilbert order and grouped into packs, the leaves: blocks of eight triangles (a quad's
 * two are in one pack), above which lies an implicit tree of eight children a node. The tree has a frame of
 * its own: origin at the center of the box, lengths divided by a power of two so that the mesh measures about
 * 1. Both readings of quads share one tree.
 */
#ifndef QM_BVH_H
#define QM_BVH_H

#include "qm/mesh.h"

typedef struct qm_bvh qm_bvh;

/** Purposes of a tree, as flags. A purpose that is not requested costs neither time nor memory. */
typedef enum qm_bvh_parts {
    QM_BVH_SOURCE = 0,  /* its points are measured to another mesh */
    QM_BVH_TARGET = 1,  /* it is searched for nearest points */
    QM_BVH_PATCHES = 2, /* its quads may be read as bilinear patches */
    QM_BVH_ALL = QM_BVH_TARGET | QM_BVH_PATCHES
} qm_bvh_parts;

/**
 * Builds the tree.
 *
 * mesh          passes qm_mesh_validate; each point of a point set becomes a triangle without size
 * parts         flags of qm_bvh_parts
 * thread_count  1 or more; more than one only with ctx->parallel; any number gives the same tree
 *
 * Ownership: borrows the mesh, which must outlive the tree unchanged; *out is the caller's, for
 * qm_bvh_destroy.
 * Threads:   the finished tree is only read, so any number of calls may use it at once.
 * Returns:   QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. After an error *out is NULL.
 * Source:    Hilbert order and implicit trees: Kamel, Faloutsos, On packing R-trees, 1993.
 */
qm_status qm_bvh_build(qm_context *ctx, const qm_mesh *mesh, qm_bvh_parts parts, int thread_count,
                       qm_bvh **out);

/** Frees a tree with the allocator that built it. NULL is allowed. */
void qm_bvh_destroy(qm_context *ctx, qm_bvh *bvh);

/** The mesh that the tree was built over; lives as long as the tree. */
const qm_mesh *qm_bvh_mesh(const qm_bvh *bvh);

/**
 * A number that trees of equal arrays, built alike, have in common, also in other processes: what is known of a node or pack of
 * one (qm_hausdorff_part) holds for that of the other. Other trees have another number but by a chance of 2^-64: that of moved
 * vertices, that of a refitted tree, whose packs are not as a new one's. Reads all arrays once.
 */
uint64_t qm_bvh_fingerprint(const qm_bvh *bvh);

/** Bytes that the tree holds, without the mesh. */
size_t qm_bvh_memory_size(const qm_bvh *bvh);

/** Bytes that qm_bvh_build allocates at least for a mesh of so many triangles (or points) and quads. */
size_t qm_bvh_memory_needed(size_t triangles, size_t quads, qm_bvh_parts parts);

/** The instruction set of the kernels: "avx512", "avx2" or "portable". All give the same bits. */
const char *qm_kernel_name(void);

#endif
