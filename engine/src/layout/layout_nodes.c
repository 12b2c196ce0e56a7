/**
 * layout_nodes.c: edits that move nodes and curves over the surface: what is moved takes its curves along.
 */
#include "qm/layout_edit.h"

#include <string.h>

#include "layout_internal.h"

#define MAX_SEGMENT 0.02 /* of the diagonal: longer segments get points before a curve is bent */

enum { POINT_SIZE = 3 * sizeof(double) };

static qm_status report_missing_node(qm_context *ctx, const qm_layout *layout, uint32_t node)
{
    return qm_context_fail(ctx, QM_E_ARGUMENT, "there is no node %u: the layout has %zu", node,
                           layout->node_count);
}

static void project(const qm_ref_surface *surface, const double p[3], double out[3])
{
    qm_ref_surface_point point;
    qm_ref_surface_project(surface, p, &point);
    memcpy(out, point.position, sizeof point.position);
}

/** Puts points between those of a curve, so that it can be bent along the surface. */
static qm_status refine_curve(qm_context *ctx, qm_curve *curve, double longest)
{
    size_t count = curve->point_count, made = 1;
    for (size_t i = 1; i < count; i++) {
        double length =
            qm_vec_distance(qm_vec_load(curve->points + 3 * i), qm_vec_load(curve->points + 3 * i - 3));
        made += (size_t)qm_clamp(ceil(length / longest), 1.0, 1024.0);
    }
    if (made == count) return QM_OK;
    double *points = qm_context_alloc(ctx, made, POINT_SIZE);
    if (!points) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a curve");
    size_t at = 0;
    memcpy(points, curve->points, POINT_SIZE);
    for (size_t i = 1; i < count; i++) {
        qm_vec a = qm_vec_load(curve->points + 3 * i - 3), b = qm_vec_load(curve->points + 3 * i);
        size_t pieces = (size_t)qm_clamp(ceil(qm_vec_distance(a, b) / longest), 1.0, 1024.0);
        for (size_t k = 1; k <= pieces; k++)
            qm_vec_store(points + 3 * ++at, qm_vec_mix(a, b, (double)k / (double)pieces));
    }
    QM_ASSERT(at + 1 == made);
    qm_context_free(ctx, curve->points, count, POINT_SIZE);
    curve->points = points;
    curve->point_count = made;
    return QM_OK;
}

/** How much of a move a point takes, by its share of the curve's length. */
typedef double bend_fn(double share, const void *data);

/** Moves the inner points of a curve, each by its weight, and puts them back on the wall of the surface that they were on. */
static qm_status bend_curve(qm_context *ctx, const qm_ref_surface *surface, qm_curve *curve, qm_vec move,
                            bend_fn *weight, const void *data)
{
    qm_status status = refine_curve(ctx, curve, MAX_SEGMENT * surface->diagonal);
    if (status != QM_OK) return status;
    double length = qm_layout_curve_length(curve), along = 0.0, reach = 2.0 * qm_vec_norm(move);
    qm_vec before = qm_vec_load(curve->points);
    for (size_t i = 1; i + 1 < curve->point_count; i++) {
        double *point = curve->points + 3 * i, moved[3];
        qm_vec here = qm_vec_load(point);
        along += qm_vec_distance(before, here);
        before = here;
        qm_ref_surface_point at;
        qm_ref_surface_project(surface, point, &at);
        const double normal[3] = {at.normal[0], at.normal[1], at.normal[2]};
        qm_vec_store(moved, qm_vec_axpy(here, length > 0.0 ? weight(along / length, data) : 0.0, move));
        if (reach > 0.0 && qm_vec_norm2(qm_vec_load(normal)) > 0.0)
            qm_ref_surface_project_toward(surface, moved, normal, reach, &at);
        else
            qm_ref_surface_project(surface, moved, &at);
        memcpy(point, at.position, POINT_SIZE);
    }
    return QM_OK;
}

/** QM_OK if a node may be moved: it is no corner, and none of its curves is fixed. */
static qm_status check_movable(qm_context *ctx, const qm_layout *layout, uint32_t node)
{
    if (qm_layout_is_corner(layout, node)) return qm_layout_report_corner(ctx, node);
    for (size_t i = 0; i < layout->curve_count; i++) {
        const qm_curve *curve = &layout->curves[i];
        if (curve->mark == QM_CURVE_FIXED && (curve->from == node || curve->to == node))
            return qm_layout_report_fixed(ctx, curve->id);
    }
    return QM_OK;
}

/** Of a curve whose ends move or not: {from, to}. */
static double weight_of_ends(double share, const void *data)
{
    const bool *ends = data;
    return (ends[0] ? (1.0 - share) * (1.0 - share) : 0.0) + (ends[1] ? share * share : 0.0);
}

/** Moves a node to a place of the surface, and bends its curves. */
static qm_status move_node(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface, uint32_t node,
                           const double to[3])
{
    double *at = layout->nodes + 3 * (size_t)node;
    qm_vec move = qm_vec_sub(qm_vec_load(to), qm_vec_load(at));
    memcpy(at, to, POINT_SIZE);
    for (size_t i = 0; i < layout->curve_count; i++) {
        qm_curve *curve = &layout->curves[i];
        const bool ends[2] = {curve->from == node, curve->to == node};
        if (!ends[0] && !ends[1]) continue;
        qm_status status = bend_curve(ctx, surface, curve, move, weight_of_ends, ends);
        if (status != QM_OK) return status;
        if (ends[0]) memcpy(curve->points, at, POINT_SIZE);
        if (ends[1]) memcpy(curve->points + 3 * (curve->point_count - 1), at, POINT_SIZE);
    }
    return QM_OK;
}

qm_status qm_layout_move_node(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                              uint32_t node, const double to[3])
{
    QM_ASSERT(ctx && layout && surface && to);
    if (node >= layout->node_count) return report_missing_node(ctx, layout, node);
    qm_layout copy;
    qm_status status = check_movable(ctx, layout, node);
    if (status == QM_OK) status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    double at[3];
    project(surface, to, at);
    return qm_layout_finish_edit(ctx, layout, &copy, move_node(ctx, &copy, surface, node, at));
}

/** Of a curve that is held at a share of its length: smooth, and 0 at both ends. */
static double weight_of_hold(double share, const void *data)
{
    double held = *(const double *)data;
    double t = share < held ? share / held : (1.0 - share) / (1.0 - held);
    return t * t * (3.0 - 2.0 * t);
}

qm_status qm_layout_slide_curve(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                                uint32_t id, const double from[3], const double to[3])
{
    QM_ASSERT(ctx && layout && surface && from && to);
    uint32_t index = qm_layout_find_curve(layout, id);
    if (index == QM_NO_INDEX) return qm_context_fail(ctx, QM_E_ARGUMENT, "there is no curve %u", id);
    if (layout->curves[index].mark == QM_CURVE_FIXED) return qm_layout_report_fixed(ctx, id);
    qm_curve_position held = qm_layout_nearest_position(&layout->curves[index], from);
    if (!qm_layout_is_inside(&layout->curves[index], &held))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "curve %u cannot be slid by its end; move the node", id);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    double share = held.along / qm_layout_curve_length(&layout->curves[index]), target[3];
    project(surface, to, target);
    qm_vec move = qm_vec_sub(qm_vec_load(target), qm_vec_load(held.position));
    return qm_layout_finish_edit(ctx, layout, &copy,
                                 bend_curve(ctx, surface, &copy.curves[index], move, weight_of_hold, &share));
}

/** Marks the curves that merging two nodes leaves without a cell on one side: those between them; and of a patch that both
 * are opposite corners of the second one's sides, which fall onto the first one's. */
static void mark_collapsed(const qm_layout *layout, const qm_layout_cells *cells, uint32_t first,
                           uint32_t second, bool *is_collapsed)
{
    for (size_t i = 0; i < layout->curve_count; i++) {
        const qm_curve *curve = &layout->curves[i];
        is_collapsed[i] =
            (curve->from == first && curve->to == second) || (curve->from == second && curve->to == first);
    }
    for (size_t i = 0; i < cells->count; i++) {
        const uint32_t *dart = cells->dart + cells->cells[i].first;
        if (!qm_layout_cell_is_patch(&cells->cells[i])) continue;
        for (int k = 0; k < 4; k++)
            if (qm_layout_dart_start(layout, dart[k]) == second &&
                qm_layout_dart_start(layout, dart[(k + 2) % 4]) == first)
                is_collapsed[dart[k] / 2] = is_collapsed[dart[(k + 3) % 4] / 2] = true;
    }
}

static qm_status merge_nodes(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                             uint32_t first, uint32_t second, bool *is_collapsed)
{
    qm_layout_cells cells;
    double at[3];
    qm_status status = qm_layout_find_cells(ctx, surface, layout, &cells);
    if (status != QM_OK) return status;
    mark_collapsed(layout, &cells, first, second, is_collapsed);
    qm_layout_cells_reset(ctx, &cells);
    for (uint32_t i = (uint32_t)layout->curve_count; i-- > 0 && status == QM_OK;)
        if (is_collapsed[i]) status = qm_layout_remove_curve(ctx, layout, i);
    memcpy(at, layout->nodes + 3 * (size_t)first, sizeof at);
    if (status == QM_OK) status = move_node(ctx, layout, surface, second, at);
    for (size_t i = 0; i < layout->curve_count; i++) {
        qm_curve *curve = &layout->curves[i];
        if (curve->from == second) curve->from = first;
        if (curve->to == second) curve->to = first;
    }
    return status == QM_OK ? qm_layout_remove_isolated_nodes(ctx, layout) : status;
}

qm_status qm_layout_merge_nodes(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                                uint32_t first, uint32_t second)
{
    QM_ASSERT(ctx && layout && surface);
    if (first >= layout->node_count) return report_missing_node(ctx, layout, first);
    if (second >= layout->node_count) return report_missing_node(ctx, layout, second);
    if (first == second)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "node %u cannot be merged with itself", first);
    qm_status status = check_movable(ctx, layout, second);
    if (status != QM_OK) return status;
    size_t count = layout->curve_count;
    bool *is_collapsed = qm_context_alloc(ctx, count, sizeof *is_collapsed);
    if (!is_collapsed) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the layout");
    qm_layout copy;
    status = qm_layout_copy(ctx, layout, &copy);
    if (status == QM_OK)
        status = qm_layout_finish_edit(ctx, layout, &copy,
                                       merge_nodes(ctx, &copy, surface, first, second, is_collapsed));
    qm_context_free(ctx, is_collapsed, count, sizeof *is_collapsed);
    return status;
}
