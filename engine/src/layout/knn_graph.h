/**
 * knn_graph.h: the graph of the k nearest neighbours of points on a surface, with normals that are oriented
 * consistently along it.
 */
#ifndef QM_KNN_GRAPH_H
#define QM_KNN_GRAPH_H

#include "bvh/nearest.h"

#define QM_KNN_MAX_LINKS 12 /* of a point */

typedef struct qm_knn_graph {
    size_t count;
    const double *positions;            /* rows of x y z, borrowed */
    qm_vec *normal;                     /* of length 1; 0 where the neighbours lie on a line */
    uint32_t (*link)[QM_KNN_MAX_LINKS]; /* neighbours, nearest first; QM_NO_INDEX after the last */
} qm_knn_graph;

/**
 * Links each point to its nearest neighbours. A link that rises steeply from the tangent plane is left out:
 * it leads to another layer of the surface.
 *
 * normal   rows of x y z, each of either sign, 0 where unknown; NULL: those of least-squares planes through
 *          the neighbours
 *
 * Ownership: borrows positions; *out is the caller's, for qm_knn_graph_reset.
 * Returns:   QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_knn_graph_build(qm_context *ctx, const double *positions, size_t count, const double *normal,
                             qm_knn_graph *out);
void qm_knn_graph_reset(qm_context *ctx, qm_knn_graph *graph);

/**
 * Flips normals so that they agree along a minimum spanning tree of each connected component, in which links
 * between normals that agree best weigh least. At the highest point of a component, the normal has z >= 0.
 *
 * Returns QM_OK or QM_E_NO_MEMORY. Source: H. Hoppe, T. DeRose, T. Duchamp, J. McDonald, W. Stuetzle, Surface
 * reconstruction from unorganized points, 1992, section 3.3; H. Xie, J. Wang, J. Hua, H. Qin, A. Kaufman, Piecewise C1 continuous
 * surface reconstruction of noisy point clouds via local implicit quadric regression, 2003 (which normals agree).
 */
qm_status qm_knn_graph_orient(qm_context *ctx, qm_knn_graph *graph);

#endif
