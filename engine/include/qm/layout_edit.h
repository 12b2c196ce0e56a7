/**
 * layout_edit.h: edits of a layout. Each call is atomic: after an error nothing has changed. Every edit
 * removes the patches; qm_layout_find_patches finds them again. An edited curve keeps its id; nodes without a
 * curve are removed.
 *
 * All calls return QM_OK; QM_E_ARGUMENT with a message when the edit does not fit the layout; QM_E_NO_MEMORY.
 *
 * Source: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh, section 6.1.3.
 */
#ifndef QM_LAYOUT_EDIT_H
#define QM_LAYOUT_EDIT_H

#include "qm/layout.h"

qm_status qm_layout_delete_curve(qm_context *ctx, qm_layout *layout, uint32_t id);

/** Splits a curve at its point nearest to near, which must not be an end; the second part gets a new id. */
qm_status qm_layout_split_curve(qm_context *ctx, qm_layout *layout, uint32_t id, const double near[3]);

/** Joins two curves at a node that no other curve has; first keeps its id, second is removed. */
qm_status qm_layout_merge_curves(qm_context *ctx, qm_layout *layout, uint32_t first, uint32_t second);

/** Replaces the points of a curve between its two nodes. The first and last points become the nodes'
 * positions; the points are reversed when that moves these ends less. */
qm_status qm_layout_redraw_curve(qm_context *ctx, qm_layout *layout, uint32_t id, const double *points,
                                 size_t point_count);

/** Moves an end of a curve (0: from, 1: to) to the nearest node within radius of near, or else to the nearest
 * curve there, which it splits; QM_E_ARGUMENT when there is neither. */
qm_status qm_layout_snap_end(qm_context *ctx, qm_layout *layout, uint32_t id, int end, const double near[3],
                             double radius);

/**
 * Adds a drawn curve. Each end snaps to a node within radius, or else splits a curve within radius, or else
 * makes a node. Where the new curve then meets a single other curve at an obtuse angle (cosine below -0.85),
 * the two are joined under the other one's id. The stroke and every curve that it crosses are split at the
 * crossing: at a node of that curve within radius, or else at a new one.
 *
 * surface  as for qm_layout_find_crossings
 * id       of the curve that the stroke became or joined, up to the first split
 */
qm_status qm_layout_add_stroke(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                               const double *points, size_t point_count, double radius, uint32_t *id);

#endif
