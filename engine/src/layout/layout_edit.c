#include "qm/layout_edit.h"

#include <string.h>

#include "layout_change.h"

static qm_status no_curve(qm_context *ctx, uint32_t id)
{
    return qm_context_fail(ctx, QM_E_ARGUMENT, "there is no curve %u", id);
}

qm_status qm_layout_delete_curve(qm_context *ctx, qm_layout *layout, uint32_t id)
{
    uint32_t place = qm_layout_find_curve(layout, id);
    if (place == QM_NO_INDEX) return no_curve(ctx, id);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    status = qm_layout_drop_curve(ctx, &copy, place);
    if (status == QM_OK) status = qm_layout_drop_lone_nodes(ctx, &copy);
    return qm_layout_settle(ctx, layout, &copy, status);
}

qm_status qm_layout_split_curve(qm_context *ctx, qm_layout *layout, uint32_t id, const double near[3])
{
    uint32_t place = qm_layout_find_curve(layout, id);
    if (place == QM_NO_INDEX) return no_curve(ctx, id);
    qm_curve_place at = qm_curve_nearest(&layout->curves[place], near);
    if (!qm_curve_holds(&layout->curves[place], &at))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "curve %u cannot be split at its end", id);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    return qm_layout_settle(ctx, layout, &copy, qm_layout_cut(ctx, &copy, place, &at));
}

/** The node at which two curves can be joined, or QM_NO_INDEX. */
static uint32_t joint(const qm_layout *layout, const qm_curve *a, const qm_curve *b)
{
    const uint32_t end[2] = {a->to, a->from};
    for (int k = 0; k < 2; k++)
        if ((b->from == end[k] || b->to == end[k]) && qm_layout_degree(layout, end[k]) == 2) return end[k];
    return QM_NO_INDEX;
}

qm_status qm_layout_merge_curves(qm_context *ctx, qm_layout *layout, uint32_t first, uint32_t second)
{
    uint32_t a = qm_layout_find_curve(layout, first), b = qm_layout_find_curve(layout, second);
    if (a == QM_NO_INDEX) return no_curve(ctx, first);
    if (b == QM_NO_INDEX) return no_curve(ctx, second);
    if (a == b) return qm_context_fail(ctx, QM_E_ARGUMENT, "curve %u cannot be merged with itself", first);
    uint32_t node = joint(layout, &layout->curves[a], &layout->curves[b]);
    if (node == QM_NO_INDEX)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "curves %u and %u share no node that is theirs alone",
                               first, second);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    return qm_layout_settle(ctx, layout, &copy, qm_layout_join(ctx, &copy, a, b, node));
}

/** Do points run from a curve's last node to its first rather than forth? */
static bool runs_back(const qm_layout *layout, const qm_curve *curve, const double *points, size_t count)
{
    qm_vec from = qm_vec_load(layout->nodes + 3 * (size_t)curve->from);
    qm_vec to = qm_vec_load(layout->nodes + 3 * (size_t)curve->to);
    qm_vec first = qm_vec_load(points), last = qm_vec_load(points + 3 * (count - 1));
    return qm_vec_distance(first, to) + qm_vec_distance(last, from) <
           qm_vec_distance(first, from) + qm_vec_distance(last, to);
}

static void reverse_points(qm_curve *curve)
{
    for (size_t i = 0, j = curve->point_count - 1; i < j; i++, j--) {
        double swapped[3];
        memcpy(swapped, curve->points + 3 * i, QM_LAYOUT_ROW);
        memcpy(curve->points + 3 * i, curve->points + 3 * j, QM_LAYOUT_ROW);
        memcpy(curve->points + 3 * j, swapped, QM_LAYOUT_ROW);
    }
}

qm_status qm_layout_redraw_curve(qm_context *ctx, qm_layout *layout, uint32_t id, const double *points,
                                 size_t point_count)
{
    uint32_t place = qm_layout_find_curve(layout, id);
    if (place == QM_NO_INDEX) return no_curve(ctx, id);
    if (point_count < 2)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "a curve has two points or more, got %zu", point_count);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    qm_curve *curve = &copy.curves[place];
    status = qm_curve_set_points(ctx, curve, points, point_count);
    if (status == QM_OK) {
        if (runs_back(&copy, curve, points, point_count)) reverse_points(curve);
        memcpy(curve->points, copy.nodes + 3 * (size_t)curve->from, QM_LAYOUT_ROW);
        memcpy(curve->points + 3 * (point_count - 1), copy.nodes + 3 * (size_t)curve->to, QM_LAYOUT_ROW);
    }
    return qm_layout_settle(ctx, layout, &copy, status);
}

static qm_status snap(qm_context *ctx, qm_layout *layout, uint32_t place, int end, const double near[3],
                      double radius)
{
    uint32_t own = end == 0 ? layout->curves[place].from : layout->curves[place].to, node;
    qm_status status = qm_layout_find_target(ctx, layout, near, radius, own, place, &node);
    if (status != QM_OK) return status;
    if (node == QM_NO_INDEX)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "there is no other node or curve within %g of the place",
                               radius);
    qm_curve *curve = &layout->curves[place];
    *(end == 0 ? &curve->from : &curve->to) = node;
    memcpy(curve->points + 3 * (end == 0 ? 0 : curve->point_count - 1), layout->nodes + 3 * (size_t)node,
           QM_LAYOUT_ROW);
    return qm_layout_drop_lone_nodes(ctx, layout);
}

qm_status qm_layout_snap_end(qm_context *ctx, qm_layout *layout, uint32_t id, int end, const double near[3],
                             double radius)
{
    uint32_t place = qm_layout_find_curve(layout, id);
    if (place == QM_NO_INDEX) return no_curve(ctx, id);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    return qm_layout_settle(ctx, layout, &copy, snap(ctx, &copy, place, end, near, radius));
}
