/**
 * bvh_part.h: a tree over some faces of a mesh, for which an order is known already.
 */
#ifndef QM_BVH_PART_H
#define QM_BVH_PART_H

#include "bvh_tree.h"

/** Some faces of a mesh, one at least. */
typedef struct qm_bvh_part {
    uint64_t *entries; /* of radix.h: by a key that leads along a curve; put in order by the build */
    size_t count, quad_count;
    int key_bits;
    qm_box box; /* holds all of them */
} qm_bvh_part;

/**
 * Builds a source (bvh.h) over these faces alone; what is told of them is told in the numbering of the mesh.
 * Returns and ownership are those of qm_bvh_build.
 */
qm_status qm_bvh_build_part(qm_context *ctx, const qm_mesh *mesh, const qm_bvh_part *part, int thread_count,
                            qm_bvh **out);

#endif
