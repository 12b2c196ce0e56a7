/**
 * layout_edit.h: edits of a layout. Each call is atomic: after an error nothing has changed. Every edit
 * removes the patches; qm_layout_find_patches finds them again. An edited curve keeps its id and its mark; nodes without a
 * curve are removed. What would move a corner, or bend a curve that is fixed, does not fit the layout.
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

/** Joins two curves of one mark at a node that no other curve has, and that is no corner; first keeps its id, second is
 * removed. */
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
 * makes a node. Where the new curve then meets a single other curve at an obtuse angle (cosine below -0.85), but not at a
 * corner, the two are joined under the other one's id and with its mark. The stroke and every curve that it crosses are split at the
 * crossing: at a node of that curve within radius, or else at a new one.
 *
 * surface  as for qm_layout_find_crossings
 * id       of the curve that the stroke became or joined, up to the first split
 */
qm_status qm_layout_add_stroke(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                               const double *points, size_t point_count, double radius, uint32_t *id);

/** Gives curves, by their ids, a mark. QM_E_ARGUMENT names one that the layout has not. */
qm_status qm_layout_mark_curves(qm_context *ctx, qm_layout *layout, const uint32_t *ids, size_t count,
                                qm_curve_mark mark);

/** Makes nodes corners, or none. QM_E_ARGUMENT names one that the layout has not. */
qm_status qm_layout_mark_nodes(qm_context *ctx, qm_layout *layout, const uint32_t *nodes, size_t count,
                               bool is_corner);

#define QM_FEATURES_SHORTEST 0.03 /* of the diagonal */
#define QM_FEATURES_RADIUS 0.005  /* of the diagonal */

typedef struct qm_layout_features_options {
    double angle;    /* degrees, above 0 up to 180, at which an edge is a crease (features.h) */
    double shortest; /* features that are shorter together are left out; 0: QM_FEATURES_SHORTEST */
    double radius;   /* as for qm_layout_add_stroke, where there are curves already; 0: QM_FEATURES_RADIUS */
} qm_layout_features_options;

/** 40 degrees, the rest 0. */
qm_layout_features_options qm_layout_features_options_default(void);

/**
 * Adds sharp curves along the creases and boundaries of a mesh, exactly on its edges. Nodes where features end, more than
 * two meet, or one turns by more than 60 degrees are corners; a closed feature with one of these or none is cut into four.
 * A feature along curves that are there already is not added; those curves become sharp.
 *
 * added  number of curves that were
 *
 * QM_E_ARGUMENT: the surface is a point set; an option; more than 100000 curves.
 */
qm_status qm_layout_add_features(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                                 const qm_layout_features_options *options, size_t *added);

/** As qm_layout_add_stroke, with a mark: a marked stroke is joined with curves of its own mark only. */
qm_status qm_layout_add_marked_stroke(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                                      const double *points, size_t point_count, double radius,
                                      qm_curve_mark mark, uint32_t *id);

/**
 * As qm_layout_add_stroke, for a stroke on a mesh: first its parts that run along creases and boundaries no farther off than reach
 * are put on these, exactly, and each end that is so near to one; parts shorter than three times the reach only cross. A stroke
 * that lies on them as a whole becomes sharp.
 *
 * angle  degrees, above 0 up to 180, at which an edge is a crease
 * reach  above 0
 */
qm_status qm_layout_add_snapped_stroke(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                                       const double *points, size_t point_count, double radius, double angle,
                                       double reach, uint32_t *id);

/**
 * Fills cells that have not four sides by patterns of curves, so that patches remain. Sides may be cut for that, and then
 * the whole chords of patches that they belong to: what a curve that ends inside another's side has begun goes on to
 * the opposite side, and so on.
 *
 * near    a place in the one cell to be filled; NULL: all
 * filled  number of cells that were
 *
 * QM_E_ARGUMENT: near is outside, in a patch, or in a cell in which a curve ends; there is nothing to fill.
 */
qm_status qm_layout_fill(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                         const double *near, size_t *filled);

#define QM_CHORD_PARTS_MAX 16

/** Cuts a curve into equal parts, and with it the opposite sides of its patches and so on: the whole chord; nodes along
 * it are joined by new curves. Cells of other than four sides at its ends get more sides. QM_E_ARGUMENT also for more than
 * 10000 curves. */
qm_status qm_layout_split_chord(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                                uint32_t id, uint32_t parts);

/** Moves a node to the place of the surface nearest to a point; its curves follow along the surface. */
qm_status qm_layout_move_node(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                              uint32_t node, const double to[3]);

/** Bends a curve between its nodes so that its place nearest to `from` comes to the place of the surface nearest to `to`. */
qm_status qm_layout_slide_curve(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                                uint32_t id, const double from[3], const double to[3]);

/** Moves the second node onto the first, with its curves. Curves between the two go; of a patch whose opposite corners they
 * are, which closes, two sides go. */
qm_status qm_layout_merge_nodes(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                                uint32_t first, uint32_t second);

/**
 * Adds the closed curve in which a plane through a place cuts the surface, as a stroke: it is cut where it meets other
 * curves, else into four.
 *
 * plane   normal of the plane; NULL: of the planes along the surface's normal the one with the shortest curve
 * radius  as for qm_layout_add_stroke
 * id      of its first curve
 *
 * QM_E_ARGUMENT: the cut does not close, as at the boundary of an open mesh.
 */
qm_status qm_layout_add_ring(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                             const double through[3], const double *plane, double radius, uint32_t *id);

/** Draws a curve along the surface from one node to another, round other curves where a plane through both allows. */
qm_status qm_layout_add_link(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface, uint32_t from,
                             uint32_t to);

/** Joins the nodes of two rings, given by a curve of each, by curves along the surface. A ring goes on straight along the
 * curve, or is the border of a cell beside it; of those with equally many nodes the nearest two are taken. */
qm_status qm_layout_add_tube(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                             uint32_t first, uint32_t second);

/** Replaces the curves behind a plane by the mirror images of those before it. Curves that pass through the plane are cut
 * there, and joined to their images; nodes within radius of the plane belong to both sides. */
qm_status qm_layout_mirror(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                           const double point[3], const double normal[3], double radius);

/** Replaces points of the surface by their mirror images, projected onto the wall that looks the mirrored way. normal is
 * not 0. */
void qm_layout_reflect(const qm_ref_surface *surface, const double point[3], const double normal[3],
                       double *points, size_t count);

/** The node nearest to the mirror image of another one, no farther than the radius from it; QM_NO_INDEX: none. A node near the plane is
 * its own image. */
uint32_t qm_layout_find_image_node(const qm_layout *layout, const qm_ref_surface *surface,
                                   const double point[3], const double normal[3], uint32_t node,
                                   double radius);

/** The id of the curve that lies within a radius along the mirror image of another one of the layout, as a whole, and whether it
 * runs the other way than the image; QM_NO_INDEX: none. */
uint32_t qm_layout_find_image_curve(const qm_layout *layout, const qm_ref_surface *surface,
                                    const double point[3], const double normal[3], uint32_t id, double radius,
                                    bool *is_reversed);

/** Replaces a direction by its mirror image. */
void qm_layout_reflect_direction(const double normal[3], double direction[3]);

#endif
