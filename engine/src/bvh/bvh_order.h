/**
 * bvh_order.h: building a tree in halves: the frame of a mesh and the order of its faces, then packs of them
 * and boxes.
 */
#ifndef QM_BVH_ORDER_H
#define QM_BVH_ORDER_H

#include "bvh_tree.h"
#include "core/radix.h"

/** Faces of a mesh, or the points of a point set. */
static inline size_t qm_mesh_facet_count(const qm_mesh *mesh)
{
    return mesh->face_count > 0 ? mesh->face_count : mesh->vertex_count;
}

/** The frame of a mesh whose surface has this box. */
qm_frame qm_frame_make(const qm_box *box);

/** Which vertices tell the frame: finding out which of them the faces use takes a pass over the faces. */
typedef enum qm_frame_of { QM_FRAME_OF_VERTICES, QM_FRAME_OF_SURFACE } qm_frame_of;

/** The faces that a tree is over: the index of each in the low QM_RADIX_INDEX_BITS of its entry. */
typedef struct qm_bvh_faces {
    uint64_t *order;
    size_t count, quad_count;
} qm_bvh_faces;

/**
 * Finds the frame, and puts the faces in the order of their middles along a Hilbert curve: faces->order has
 * room for the faces->count that the mesh has, and with faces->quad_count is filled in. The cells of the
 * curve are smaller for a tree that is to be a target.
 *
 * Returns QM_OK or QM_E_NO_MEMORY.
 */
qm_status qm_bvh_order(qm_context *ctx, const qm_mesh *mesh, qm_bvh_parts parts, qm_frame_of of,
                       int thread_count, qm_frame *frame, qm_bvh_faces *faces);

/** Makes the tree in a frame that is set; QM_OK, QM_E_NO_MEMORY or QM_E_CANCELED. */
qm_status qm_bvh_build_ordered(qm_context *ctx, qm_bvh *bvh, qm_bvh_parts parts, int thread_count,
                               const qm_bvh_faces *faces);

/** True when the surface has much less than half the size of its frame: far vertices without a face made
 * it. */
bool qm_bvh_frame_is_wide(const qm_bvh *bvh);

/** Frees all but the mesh and the tree itself. */
void qm_bvh_reset(qm_context *ctx, qm_bvh *bvh);

#endif
