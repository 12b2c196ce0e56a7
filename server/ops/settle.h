/**
 * settle.h: the vertices of a semi-regular mesh move all at once at its end, where that does not spoil it.
 */
#ifndef QM_SETTLE_H
#define QM_SETTLE_H

#include "qm/quads.h"
#include "qm/quality.h"
#include "qm/reconstruct.h"
#include "qm/source.h"

typedef struct qm_settle_goal {
    qm_quads_options quads; /* as qm_quads_settle takes them */
    double distance;        /* that was wanted, in the unit of the surface; 0: none */
    bool
        is_quick; /* vertices move once, without the last fit if quads stay poor, and go back if that is not kept */
    const qm_quads_marks *marks; /* what is kept of the mesh that is settled; NULL: nothing */
} qm_settle_goal;

/** How far a mesh and a surface are from each other, in the surface's unit. */
typedef struct qm_settle_distance {
    qm_interval from_surface; /* greatest distance of a point of the surface from the quads */
    qm_interval from_quads;   /* and of a point of the quads, read as two triangles, from the surface */
} qm_settle_distance;

/** The two-sided Hausdorff distance: the greater of both. */
qm_interval qm_settle_two_sided(const qm_settle_distance *distance);

/**
 * Measures both, to within 1e-6 of the diagonal or a twentieth of the wanted distance.
 *
 * Returns: QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED: nobody wants bounds of a search that was stopped.
 */
qm_status qm_settle_measure(qm_context *ctx, const qm_ref_surface *surface, const qm_settle_goal *goal,
                            const qm_mesh *mesh, qm_settle_distance *out);

/** What came of it. */
typedef struct qm_settled {
    bool is_kept;                /* the vertices have moved: else the mesh is as it was */
    qm_settle_distance distance; /* of the mesh as it is now */
    qm_quality quality;
} qm_settled;

/**
 * Settles a mesh of quads (qm_quads_settle), and keeps the result if it is within the wanted distance, or the distance grows by no more
 * than a quarter, and no more quads are folded: else only bad quads are opened, and if that is not kept either, the mesh is as it was.
 *
 * surface  of a mesh, its tree with QM_BVH_TARGET
 *
 * Returns: QM_OK; QM_E_ARGUMENT; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_settle(qm_context *ctx, const qm_ref_surface *surface, const qm_settle_goal *goal, qm_mesh *mesh,
                    qm_settled *out);

/**
 * Settles the mesh of a reconstruction, over a mesh and without noise. Where it can be made anew for that, it is; if poor quads stay then, or the distance is
 * more than a quarter greater than that of the mesh of the steps, or not the wanted one, that mesh is settled as well, and the better one is kept:
 * near enough, without folds, with fewer poor quads up to twice the distance, or else nearer.
 *
 * goal  its marks are not used: those of the reconstruction are kept
 * mesh  the caller's; empty after an error
 *
 * Returns: QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_settle_reconstruction(qm_context *ctx, const qm_ref_surface *surface, const qm_settle_goal *goal,
                                   qm_reconstruction *reconstruction, qm_mesh *mesh, qm_settled *out);

#endif
