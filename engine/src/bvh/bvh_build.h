/**
 * bvh_build.h: building a tree over some faces of a mesh, and the local space of a box. qm/bvh.h has the
 * build over a whole mesh.
 */
#ifndef QM_BVH_BUILD_H
#define QM_BVH_BUILD_H

#include "bvh_tree.h"

/** The local space of a mesh whose surface has this box. */
qm_frame qm_bvh_frame_make(const qm_box *box);

/** Some faces of a mesh, one at least, that already have keys along a space-filling curve. */
typedef struct qm_bvh_subset {
    uint64_t *entries; /* of core/radix.h, by key; the build sorts them */
    size_t count, quad_count;
    int key_bits;
    qm_box box; /* holds all of the faces */
} qm_bvh_subset;

/**
 * Builds a source (qm/bvh.h) over these faces alone; face indices in results refer to the mesh. Returns and
 * ownership are those of qm_bvh_build.
 */
qm_status qm_bvh_build_subset(qm_context *ctx, const qm_mesh *mesh, const qm_bvh_subset *subset,
                              int thread_count, qm_bvh **out);

#endif
