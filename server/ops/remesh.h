/**
 * remesh.h: from a surface to a mesh of quads whose distance from it is known, until it is as near as is wanted.
 */
#ifndef QM_REMESH_H
#define QM_REMESH_H

#include "qm/layout.h"
#include "qm/quads.h"
#include "qm/source.h"

#define QM_REMESH_FIRST_QUADS 1000 /* that a search for a distance starts with */
#define QM_REMESH_MOST_QUADS 1000000

typedef struct qm_remesh_options {
    qm_quads_options
        quads;       /* their number: wanted; with a distance the first; of a semi-regular mesh the limit */
    double distance; /* at most so far from the surface, in its unit; 0: any */
    bool is_semi_regular; /* by way of a layout: blocks of quads in rows and columns */
} qm_remesh_options;

typedef struct qm_remesh_result {
    qm_mesh mesh;        /* for qm_mesh_reset */
    double lower, upper; /* of the two-sided Hausdorff distance to the surface, in its unit */
    size_t rounds;       /* meshes, or steps, that were made */
    size_t patches;      /* of the layout; 0 without */
} qm_remesh_result;

/**
 * Makes the mesh. With a distance more and more quads are tried until the upper bound is within it, or the next mesh would
 * have more than QM_REMESH_MOST_QUADS; the last one is the result then.
 *
 * surface  of a mesh, its tree with QM_BVH_TARGET
 *
 * Returns: QM_OK; what qm_quads_make, qm_quad_layout_make_of_surface and qm_refine return. *out is empty after an error.
 */
qm_status qm_remesh(qm_context *ctx, const qm_ref_surface *surface, const qm_remesh_options *options,
                    qm_remesh_result *out);

#endif
