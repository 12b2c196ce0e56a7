/**
 * surface_graph.h: points of a surface joined to their nearest neighbours along it, with normals that agree
 * on a side.
 */
#ifndef QM_SURFACE_GRAPH_H
#define QM_SURFACE_GRAPH_H

#include "bvh/near_points.h"

#define QM_GRAPH_LINKS 12 /* neighbours a point */

typedef struct qm_surface_graph {
    size_t count;
    const double *positions; /* rows of x y z, borrowed */
    qm_vec *normal; /* of length 1, all of a connected part on the same side; 0 where there is none */
    uint32_t (*link)[QM_GRAPH_LINKS]; /* neighbours, nearest first; QM_NO_INDEX where there are fewer */
} qm_surface_graph;

/**
 * Joins points to their neighbours. Links that rise out of the surface more than they run along it are left
 * out: they lead to another sheet.
 *
 * normal   rows of x y z of known direction (0 for none; the side may be wrong), or NULL: then each is that
 *          of the plane through the neighbours
 *
 * Ownership: borrows positions; *out is the caller's, for qm_surface_graph_reset.
 * Returns:   QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_surface_graph_build(qm_context *ctx, const double *positions, size_t count, const double *normal,
                                 qm_surface_graph *out);
void qm_surface_graph_reset(qm_context *ctx, qm_surface_graph *graph);

/**
 * Turns normals to agree along the links, those first that are most nearly parallel. In each connected part
 * the point highest along z looks up.
 *
 * Returns QM_OK or QM_E_NO_MEMORY. Source: Hoppe, DeRose, Duchamp, McDonald, Stuetzle, Surface reconstruction
 * from unorganized points, 1992, section 3.3.
 */
qm_status qm_surface_graph_orient(qm_context *ctx, qm_surface_graph *graph);

#endif
