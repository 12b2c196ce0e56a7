/**
 * layout_internal.h: what the files of this folder call of each other: the operations of which edits are made, and the
 * cells that curves bound.
 */
#ifndef QM_LAYOUT_INTERNAL_H
#define QM_LAYOUT_INTERNAL_H

#include "core/vec.h"
#include "qm/layout.h"

#define QM_STRAIGHT_ANGLE 3.141592653589793

/** The length of a polyline. */
double qm_layout_points_length(const double *points, size_t count);

/** Appends a copy of an issue. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_layout_add_issue(qm_context *ctx, qm_layout_issues *issues, const qm_layout_issue *issue);

/** Appends a copy of a patch, unchecked. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_layout_append_patch(qm_context *ctx, qm_layout *layout, const qm_layout_patch *patch);

/** Replaces the layout by the edited copy if status is QM_OK, else frees the copy. Returns status. */
qm_status qm_layout_finish_edit(qm_context *ctx, qm_layout *layout, qm_layout *copy, qm_status status);

/** Removes a curve, and keeps its nodes. */
qm_status qm_layout_remove_curve(qm_context *ctx, qm_layout *layout, uint32_t index);

/** Removes the nodes without a curve and renumbers the others in their order. */
qm_status qm_layout_remove_isolated_nodes(qm_context *ctx, qm_layout *layout);

/** Fails an edit that would move a corner, or the points of a curve that is fixed. Returns QM_E_ARGUMENT. */
qm_status qm_layout_report_corner(qm_context *ctx, uint32_t node);
qm_status qm_layout_report_fixed(qm_context *ctx, uint32_t id);

/** True if a curve starts or ends at the node. */
bool qm_layout_has_curve(const qm_layout *layout, uint32_t node);

/** The number of curve ends at a node. */
size_t qm_layout_node_degree(const qm_layout *layout, uint32_t node);

/** Gives a curve a copy of these points, which may be its own. */
qm_status qm_layout_set_points(qm_context *ctx, qm_curve *curve, const double *points, size_t point_count);

/** A position on a curve, in the segment that starts at point `segment`. */
typedef struct qm_curve_position {
    size_t segment;
    double distance, along; /* distance from the query point; arc length from the curve's start */
    double position[3];
} qm_curve_position;

/** The position on a curve that is nearest to a point. */
qm_curve_position qm_layout_nearest_position(const qm_curve *curve, const double near[3]);

/** True if a position is not at an end of its curve. */
bool qm_layout_is_inside(const qm_curve *curve, const qm_curve_position *at);

/**
 * Splits a curve at a position inside it without repeating a point. The new node and the new curve, which
 * runs from it to the old end, become the last ones.
 */
qm_status qm_layout_split_at(qm_context *ctx, qm_layout *layout, uint32_t index, const qm_curve_position *at);

/** Cuts a curve into parts of equal length. nodes gets those along it, parts + 1 of them. QM_E_ARGUMENT if it is too
 * short. */
qm_status qm_layout_cut_curve(qm_context *ctx, qm_layout *layout, uint32_t index, uint32_t parts,
                              uint32_t *nodes);

/** Unit vector in which a curve leaves a node: to its first point that differs from the node. */
qm_vec qm_layout_leaving_direction(const qm_curve *curve, bool from_end);

/** Appends the second curve to the first at a node where both end, and removes the second and the node. */
qm_status qm_layout_join_curves(qm_context *ctx, qm_layout *layout, uint32_t first, uint32_t second,
                                uint32_t node);

/**
 * The node that an end at `near` snaps to: the nearest node within radius, else a new node on the nearest
 * curve within radius, which is split there; QM_NO_INDEX if there is neither.
 */
qm_status qm_layout_find_snap_node(qm_context *ctx, qm_layout *layout, const double near[3], double radius,
                                   uint32_t except_node, uint32_t except_curve, uint32_t *node);

/** As qm_layout_add_stroke, with a mark, and no copy: after an error the layout is half edited. A marked stroke joins curves
 * of its own mark only. */
qm_status qm_layout_draw_stroke(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                                const double *points, size_t count, double radius, qm_curve_mark mark,
                                uint32_t *id);

/* ---- cells ---- */

/** A cell of the arrangement that the curves make on the surface: what lies left of a closed walk over darts. Dart 2 c
 * runs along the curve of index c, 2 c + 1 against it. */
typedef struct qm_layout_cell {
    size_t first; /* of its darts in qm_layout_cells.dart, in order round it */
    uint32_t sides;
    bool is_outside;       /* it encloses a drawing from outside */
    bool is_on_both_sides; /* of some curve */
} qm_layout_cell;

typedef struct qm_layout_cells {
    qm_layout_cell *cells;
    size_t count;
    uint32_t *dart;    /* dart_count: cell by cell */
    uint32_t *of_dart; /* dart_count: the cell left of each */
    double *corner;    /* dart_count: the cell's angle at the start of each, in radians */
    qm_vec *normal;    /* node_count: of the surface at each node, consistent along the curves */
    uint32_t *
        first_at; /* node_count + 1: the darts that leave node i are at[first_at[i]] ... at[first_at[i + 1] - 1], in order */
    uint32_t *at; /* dart_count */
    size_t dart_count, node_count;
} qm_layout_cells;

static inline bool qm_layout_cell_is_patch(const qm_layout_cell *cell)
{
    return cell->sides == 4 && !cell->is_outside && !cell->is_on_both_sides;
}

/** The node that a dart starts at. */
uint32_t qm_layout_dart_start(const qm_layout *layout, uint32_t dart);

/** Finds the cells of a layout with curves. QM_OK, and *out is the caller's; QM_E_NO_MEMORY; QM_E_CANCELED. */
qm_status qm_layout_find_cells(qm_context *ctx, const qm_ref_surface *surface, const qm_layout *layout,
                               qm_layout_cells *out);
void qm_layout_cells_reset(qm_context *ctx, qm_layout_cells *cells);

/** Adds a curve along the surface between two nodes, which crosses other curves as little as planes through both allow.
 * inward as for qm_section_between. */
qm_status qm_layout_draw_curve(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                               uint32_t from, uint32_t to, qm_vec inward);

/** True if a quarter of the last curve and more lies within a distance of other curves. */
bool qm_layout_runs_along(const qm_layout *layout, double distance);

/** How often the last curve crosses others, or itself. QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. */
qm_status qm_layout_count_crossings(qm_context *ctx, const qm_layout *layout, const qm_ref_surface *surface,
                                    size_t *count);

#endif
