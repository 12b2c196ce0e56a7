/**
 * layout_change.h: the steps that edits of a layout are made of, by places in its arrays. Each changes the
 * layout that it is given: callers hand in a copy, and qm_layout_settle puts that in the place of the layout,
 * or drops it after an error. All return QM_OK or QM_E_NO_MEMORY with a message.
 */
#ifndef QM_LAYOUT_CHANGE_H
#define QM_LAYOUT_CHANGE_H

#include "layout_work.h"

enum { QM_LAYOUT_ROW = 3 * sizeof(double) };

/** A place on a curve: on the piece that starts at point `piece`. */
typedef struct qm_curve_place {
    size_t piece;
    double distance, along; /* from the point asked about; length from the start */
    double position[3];
} qm_curve_place;

/** Puts the edited copy in place of the layout, or drops it after an error. */
qm_status qm_layout_settle(qm_context *ctx, qm_layout *layout, qm_layout *copy, qm_status status);

/** Takes a curve out of the array, which keeps its size until the next one is added or dropped. */
qm_status qm_layout_drop_curve(qm_context *ctx, qm_layout *layout, uint32_t place);

/** True when a curve starts or ends at a node. */
bool qm_layout_has_curve(const qm_layout *layout, uint32_t node);

/** Closes the ranks of the nodes over those without a curve. */
qm_status qm_layout_drop_lone_nodes(qm_context *ctx, qm_layout *layout);

/** Gives a curve other points; they are copied. */
qm_status qm_curve_set_points(qm_context *ctx, qm_curve *curve, const double *points, size_t point_count);

/** The place on a curve that is nearest to a point. */
qm_curve_place qm_curve_nearest(const qm_curve *curve, const double near[3]);

/** Cuts a curve at a place inside it, no point twice. The new node and the new curve are the last ones. */
qm_status qm_layout_cut(qm_context *ctx, qm_layout *layout, uint32_t place, const qm_curve_place *at);

/** True for a place that is not at an end of its curve. */
bool qm_curve_holds(const qm_curve *curve, const qm_curve_place *at);

/** How many ends of curves a node has. */
size_t qm_layout_degree(const qm_layout *layout, uint32_t node);

/** Joins the second curve to the first at a node; both places are different. */
qm_status qm_layout_join(qm_context *ctx, qm_layout *layout, uint32_t first, uint32_t second, uint32_t node);

/** The node for an end: one that is there, or a new one on a curve within radius; QM_NO_INDEX for neither. */
qm_status qm_layout_find_target(qm_context *ctx, qm_layout *layout, const double near[3], double radius,
                                uint32_t except_node, uint32_t except_curve, uint32_t *node);

#endif
