/**
 * layout_edit.h: changing a layout. Each call is one edit: it does all or, after an error, nothing. Patches
 * are dropped by every edit, to be found again (qm_layout_find_patches). A curve that is changed keeps its
 * id; nodes without a curve go.
 *
 * All return QM_OK; QM_E_ARGUMENT with words when the edit does not fit the layout; QM_E_NO_MEMORY.
 *
 * Source: Y. Kang, section 6.1.3.
 */
#ifndef QM_LAYOUT_EDIT_H
#define QM_LAYOUT_EDIT_H

#include "qm/layout.h"

qm_status qm_layout_delete_curve(qm_context *ctx, qm_layout *layout, uint32_t id);

/** Cuts a curve at its point nearest to near, which lies inside it; the part from there on gets a new id. */
qm_status qm_layout_split_curve(qm_context *ctx, qm_layout *layout, uint32_t id, const double near[3]);

/** Joins two curves at a node that they share and no other curve has; first keeps its id, second goes. */
qm_status qm_layout_merge_curves(qm_context *ctx, qm_layout *layout, uint32_t first, uint32_t second);

/** Draws a curve anew between its two nodes; the first and last of the points are replaced by these, the
 * other way round when that moves them less. */
qm_status qm_layout_redraw_curve(qm_context *ctx, qm_layout *layout, uint32_t id, const double *points,
                                 size_t point_count);

/** Puts an end of a curve (0: from, 1: to) on the nearest node within radius of near, else on the nearest
 * curve there, which is split; QM_E_ARGUMENT when there is neither. */
qm_status qm_layout_snap_end(qm_context *ctx, qm_layout *layout, uint32_t id, int end, const double near[3],
                             double radius);

/**
 * Adds a drawn curve. Each end snaps to a node within radius, else splits a curve within radius, else makes a
 * node. Where the new curve then meets one other alone, at an obtuse angle (cosine below -0.85), the two are
 * joined, and the other one's id stays. Curves that it crosses are cut there, and so is it: at a node that
 * such a curve has within radius, else at a new one.
 *
 * id   the curve that the stroke became or joined, up to the first cut
 */
qm_status qm_layout_add_stroke(qm_context *ctx, qm_layout *layout, const double *points, size_t point_count,
                               double radius, uint32_t *id);

#endif
