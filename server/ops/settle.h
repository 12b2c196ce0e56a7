/**
 * settle.h: the vertices of a semi-regular mesh move all at once at its end, where that does not spoil it.
 */
#ifndef QM_SETTLE_H
#define QM_SETTLE_H

#include "qm/quads.h"
#include "qm/source.h"

typedef struct qm_settle_goal {
    qm_quads_options quads; /* as qm_quads_settle takes them */
    double distance;        /* that was wanted, in the unit of the surface; 0: none */
} qm_settle_goal;

/**
 * Settles a mesh of quads (qm_quads_settle), and keeps the result if the distance is still within the wanted one, or grows by no more than a quarter: else the mesh is as it was.
 *
 * surface       of a mesh, its tree with QM_BVH_TARGET
 * lower, upper  receive bounds of the two-sided Hausdorff distance of the mesh as it is then
 *
 * Returns: QM_OK; QM_E_ARGUMENT; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_settle(qm_context *ctx, const qm_ref_surface *surface, const qm_settle_goal *goal, qm_mesh *mesh,
                    double *lower, double *upper);

#endif
