/**
 * layout_creases.h: lines that run along the creases and boundaries of a mesh are put on them, exactly.
 */
#ifndef QM_LAYOUT_CREASES_H
#define QM_LAYOUT_CREASES_H

#include "layout/layout_section.h"
#include "qm/features.h"
#include "qm/layout.h"

/** The features of a mesh, with a tree of their edges and the edges at each point. All zero is none. */
typedef struct qm_creases {
    qm_features features;
    qm_mesh segments;
    qm_bvh *tree;
    uint32_t *start, *edge; /* those at point i are edge[start[i]] ... edge[start[i + 1] - 1] */
} qm_creases;

/**
 * Finds features near which lines may run, however short these are; of a point set none.
 *
 * angle  degrees, of creases; 0: 15
 * box    as for qm_features_find
 *
 * Returns: QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. *out is the caller's, for qm_creases_reset.
 */
qm_status qm_creases_find(qm_context *ctx, const qm_ref_surface *surface, double angle, const double *box,
                          qm_creases *out);
void qm_creases_reset(qm_context *ctx, qm_creases *creases);

/**
 * Puts the parts of a line that run along features, no farther off than the reach, onto these.
 *
 * out       the whole line with these parts; empty where no part runs along any
 * is_whole  whether nothing else is left of it; may be NULL
 */
qm_status qm_creases_snap_line(qm_context *ctx, const qm_creases *creases, const double *points, size_t count,
                               double reach, qm_section *out, bool *is_whole);

/** Puts the sharp curves of a layout, and their nodes but for corners, onto the features that they run along within 1 % of the
 * diagonal. Other curves keep their points but for the ends. *out receives the features, none if no curve is sharp; it is the
 * caller's, for qm_creases_reset. */
qm_status qm_creases_follow(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                            qm_creases *out);

/**
 * Puts the sharp curves of a layout onto the features, as qm_creases_follow, and makes their nodes corners where they end, bend or more
 * than two meet. Those that would cross other curves there become smooth instead, and stay as they are.
 *
 * issues  the crossings of the layout, before and after
 *
 * Returns: QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. After an error the layout is as it was, and issues may be empty.
 */
qm_status qm_creases_settle_curves(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                                   qm_layout_issues *issues);

/**
 * Finds, for points of a line in order, the normal of the surface on the left of the line less that on its right, of length
 * up to 2: 0 where the line is on no crease, by 1e-6 of the diagonal.
 *
 * across  count rows of x y z
 */
qm_status qm_creases_step_across(qm_context *ctx, const qm_creases *creases, double diagonal,
                                 const double *points, size_t count, double *across);

#endif
