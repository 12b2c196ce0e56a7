/**
 * layout.h: a quad layout: boundary curves over a surface, the nodes where they meet, and the four-sided
 * patches that they bound.
 *
 * A curve is a polyline that starts at its node `from` and ends at its node `to`; its first and last points
 * equal the nodes' positions, bit for bit. Curves keep their ids through every edit; nodes are numbered from
 * 0 without gaps. A patch lists its sides in cyclic order; side k runs from corner k to corner k + 1.
 *
 *     corner 3 ---- side 2 ---- corner 2         side 0 is the bottom, c0 -> c1
 *        |                         |             side 1 the right,     c1 -> c2
 *      side 3                    side 1          side 2 the top,       c2 -> c3
 *        |                         |             side 3 the left,      c3 -> c0
 *     corner 0 ---- side 0 ---- corner 1
 *
 * Source: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh, sections 6.1 and 6.2.
 */
#ifndef QM_LAYOUT_H
#define QM_LAYOUT_H

#include "qm/source.h"

/** Cells along a side of the grid of a patch, where one is known: (QM_LAYOUT_GRID + 1)^2 points of the surface, rows of x y z, row by
 * row from corner 0, columns along side 0. */
#define QM_LAYOUT_GRID 4
#define QM_LAYOUT_GRID_POINTS ((QM_LAYOUT_GRID + 1) * (QM_LAYOUT_GRID + 1))

/** What is kept of a curve. Parts of a curve that is cut have its mark. */
typedef enum qm_curve_mark {
    QM_CURVE_SMOOTH, /* the surface runs on across it */
    QM_CURVE_SHARP, /* the surface may bend across it: it lies on the crease or boundary that it runs along */
    QM_CURVE_FIXED, /* it stays as it was drawn, off the surface too */
    QM_CURVE_MARK_COUNT
} qm_curve_mark;

typedef struct qm_curve {
    uint32_t id;
    uint32_t from, to;
    qm_curve_mark mark;
    size_t point_count; /* 2 at least */
    double *points;     /* rows of x y z */
} qm_curve;

/** A patch by indices of its curves in the layout; against[k] is true when curve k runs against its side. */
typedef struct qm_layout_patch {
    uint32_t side[4];
    bool against[4];
} qm_layout_patch;

/** A layout, allocated through the context that resets it. All zero is an empty layout. */
typedef struct qm_layout {
    double *nodes; /* rows of x y z */
    size_t node_count;
    uint32_t *corners; /* nodes that stay where they are, in increasing order */
    size_t corner_count;
    qm_curve *curves;
    size_t curve_count;
    qm_layout_patch *patches;
    size_t patch_count;
    uint32_t next_id; /* of the next curve */
} qm_layout;

void qm_layout_reset(qm_context *ctx, qm_layout *layout);

/** Copies a layout. Returns QM_OK or QM_E_NO_MEMORY; after an error *out is empty. */
qm_status qm_layout_copy(qm_context *ctx, const qm_layout *layout, qm_layout *out);

/** Appends a node or a curve. A curve's id is next_id; its ends become the nodes' positions. The arrays are
 * copied. The node is no corner, the curve smooth. Neither changes the patches. Returns QM_OK, QM_E_NO_MEMORY, or QM_E_ARGUMENT for a curve of fewer
 * than two points or with a node that does not exist. */
qm_status qm_layout_add_node(qm_context *ctx, qm_layout *layout, const double position[3]);
qm_status qm_layout_add_curve(qm_context *ctx, qm_layout *layout, uint32_t from, uint32_t to,
                              const double *points, size_t point_count);

/**
 * Adds a patch by its four curves' ids, in cyclic order. Each must start where the previous one ends;
 * QM_E_ARGUMENT names the curve that does not.
 */
qm_status qm_layout_add_patch(qm_context *ctx, qm_layout *layout, const uint32_t id[4]);

/** Removes all patches. */
void qm_layout_clear_patches(qm_context *ctx, qm_layout *layout);

/** Makes a node a corner, or none. Returns QM_OK or QM_E_NO_MEMORY. */
qm_status qm_layout_set_corner(qm_context *ctx, qm_layout *layout, uint32_t node, bool is_corner);
bool qm_layout_is_corner(const qm_layout *layout, uint32_t node);

/** "smooth", "sharp" or "fixed". */
const char *qm_layout_mark_name(qm_curve_mark mark);

/** Index of the curve with this id, or QM_NO_INDEX. */
uint32_t qm_layout_find_curve(const qm_layout *layout, uint32_t id);

/** The node that a side starts at. */
static inline uint32_t qm_layout_corner(const qm_layout *layout, const qm_layout_patch *patch, int side)
{
    const qm_curve *curve = &layout->curves[patch->side[side]];
    return patch->against[side] ? curve->to : curve->from;
}

/** Length of a polyline. */
double qm_layout_curve_length(const qm_curve *curve);

/**
 * Checks the preconditions of a reconstruction: finite points, ends at their nodes, sides of positive length,
 * closed patches, curves with at most two patches, and no curves that cross without a node.
 *
 * diagonal  of the surface's box: a length below 1e-9 of it counts as zero
 * surface   as for qm_layout_find_crossings
 *
 * Returns: QM_OK; QM_E_NOT_FINITE, QM_E_LAYOUT (ctx->message names the curve id or patch index).
 */
qm_status qm_layout_validate(qm_context *ctx, const qm_layout *layout, double diagonal,
                             const qm_ref_surface *surface);

/** As qm_layout_validate, but for crossings. */
qm_status qm_layout_validate_patches(qm_context *ctx, const qm_layout *layout, double diagonal);

/** Faults of a layout: where its curves do not bound four-sided patches. */
typedef enum qm_layout_fault {
    QM_LAYOUT_DANGLING_END, /* curve[0] ends at node, where no other curve begins */
    QM_LAYOUT_CELL_SIDES,   /* the face of the curve arrangement left of curve[0] has not four sides */
    QM_LAYOUT_APART, /* no curves connect curve[0] at node with what is drawn elsewhere on the same component of a mesh */
    QM_LAYOUT_CROSSING, /* curve[0] and curve[1] cross at position without a node */
    QM_LAYOUT_FAULT_COUNT
} qm_layout_fault;

typedef struct qm_layout_issue {
    qm_layout_fault fault;
    uint32_t curve[2]; /* ids; QM_NO_INDEX where there is none */
    uint32_t node;
    uint32_t sides;
    double position[3]; /* of the fault */
} qm_layout_issue;

typedef struct qm_layout_issues {
    qm_layout_issue *items;
    size_t count;
} qm_layout_issues;

void qm_layout_issues_reset(qm_context *ctx, qm_layout_issues *issues);

/**
 * Replaces the patches of a layout by those that its curves bound on a surface: sorts the curves around each
 * node in the surface's tangent plane, traces the faces of the arrangement, and takes the four-sided ones.
 * Faces that enclose a drawing from outside (with three quarters of the curvature of a closed surface), or lie beyond the boundary of
 * an open mesh, are neither patches nor faults. out lists the faults; it is the caller's.
 *
 * Returns: QM_OK, also when there are faults; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_layout_find_patches(qm_context *ctx, const qm_ref_surface *source, qm_layout *layout,
                                 qm_layout_issues *out);

/** Adds an issue for each pair of curves that cross, and each curve that crosses itself. Curves on opposite walls of
 * the surface do not cross, however near these are; surface may be NULL, and then nearness alone decides. */
qm_status qm_layout_find_crossings(qm_context *ctx, const qm_layout *layout, const qm_ref_surface *surface,
                                   qm_layout_issues *out);

#endif
