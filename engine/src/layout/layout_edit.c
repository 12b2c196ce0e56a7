/**
 * layout_edit.c: edits of single curves. Each edit works on a copy of the layout; qm_layout_finish_edit replaces the
 * layout by the copy, or frees the copy after an error.
 *
 * The file has two parts: one function for each edit; the stroke, whose ends snap, which continues curves and splits
 * the curves that it crosses.
 */
#include "qm/layout_edit.h"

#include <string.h>

#include "layout_internal.h"

#define OBTUSE (-0.85) /* cosine of the angle between two curves below which one continues the other */
#define RING_PARTS 4
#define THROUGH 0.05    /* of the snap radius: a curve that is nearer to a node passes through it */
#define MAX_CROSSED 256 /* splits of one stroke; further crossings stay without a node */

enum { POINT_SIZE = 3 * sizeof(double) };

static qm_status report_missing_curve(qm_context *ctx, uint32_t id)
{
    return qm_context_fail(ctx, QM_E_ARGUMENT, "there is no curve %u", id);
}

qm_status qm_layout_delete_curve(qm_context *ctx, qm_layout *layout, uint32_t id)
{
    uint32_t index = qm_layout_find_curve(layout, id);
    if (index == QM_NO_INDEX) return report_missing_curve(ctx, id);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    status = qm_layout_remove_curve(ctx, &copy, index);
    if (status == QM_OK) status = qm_layout_remove_isolated_nodes(ctx, &copy);
    return qm_layout_finish_edit(ctx, layout, &copy, status);
}

qm_status qm_layout_split_curve(qm_context *ctx, qm_layout *layout, uint32_t id, const double near[3])
{
    uint32_t index = qm_layout_find_curve(layout, id);
    if (index == QM_NO_INDEX) return report_missing_curve(ctx, id);
    qm_curve_position at = qm_layout_nearest_position(&layout->curves[index], near);
    if (!qm_layout_is_inside(&layout->curves[index], &at))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "curve %u cannot be split at its end", id);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    return qm_layout_finish_edit(ctx, layout, &copy, qm_layout_split_at(ctx, &copy, index, &at));
}

qm_status qm_layout_merge_curves(qm_context *ctx, qm_layout *layout, uint32_t first, uint32_t second)
{
    uint32_t a = qm_layout_find_curve(layout, first), b = qm_layout_find_curve(layout, second);
    if (a == QM_NO_INDEX) return report_missing_curve(ctx, first);
    if (b == QM_NO_INDEX) return report_missing_curve(ctx, second);
    if (a == b) return qm_context_fail(ctx, QM_E_ARGUMENT, "curve %u cannot be merged with itself", first);
    const uint32_t end[2] = {layout->curves[a].to, layout->curves[a].from};
    uint32_t node = QM_NO_INDEX;
    for (int k = 0; k < 2 && node == QM_NO_INDEX; k++) {
        bool is_common = layout->curves[b].from == end[k] || layout->curves[b].to == end[k];
        if (is_common && qm_layout_node_degree(layout, end[k]) == 2) node = end[k];
    }
    if (node == QM_NO_INDEX)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "curves %u and %u share no node that is theirs alone",
                               first, second);
    if (qm_layout_is_corner(layout, node)) return qm_layout_report_corner(ctx, node);
    if (layout->curves[a].mark != layout->curves[b].mark)
        return qm_context_fail(
            ctx, QM_E_ARGUMENT, "curve %u is %s, but curve %u is %s: mark them alike first", first,
            qm_layout_mark_name(layout->curves[a].mark), second, qm_layout_mark_name(layout->curves[b].mark));
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    return qm_layout_finish_edit(ctx, layout, &copy, qm_layout_join_curves(ctx, &copy, a, b, node));
}

qm_status qm_layout_mark_curves(qm_context *ctx, qm_layout *layout, const uint32_t *ids, size_t count,
                                qm_curve_mark mark)
{
    QM_ASSERT(ctx && layout && mark < QM_CURVE_MARK_COUNT);
    for (size_t i = 0; i < count; i++)
        if (qm_layout_find_curve(layout, ids[i]) == QM_NO_INDEX) return report_missing_curve(ctx, ids[i]);
    for (size_t i = 0; i < count; i++)
        layout->curves[qm_layout_find_curve(layout, ids[i])].mark = mark;
    qm_layout_clear_patches(ctx, layout);
    return QM_OK;
}

qm_status qm_layout_mark_nodes(qm_context *ctx, qm_layout *layout, const uint32_t *nodes, size_t count,
                               bool is_corner)
{
    QM_ASSERT(ctx && layout);
    qm_layout copy;
    for (size_t i = 0; i < count; i++)
        if (nodes[i] >= layout->node_count)
            return qm_context_fail(ctx, QM_E_ARGUMENT, "there is no node %u: the layout has %zu", nodes[i],
                                   layout->node_count);
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    for (size_t i = 0; i < count && status == QM_OK; i++)
        status = qm_layout_set_corner(ctx, &copy, nodes[i], is_corner);
    return qm_layout_finish_edit(ctx, layout, &copy, status);
}

qm_status qm_layout_redraw_curve(qm_context *ctx, qm_layout *layout, uint32_t id, const double *points,
                                 size_t point_count)
{
    uint32_t index = qm_layout_find_curve(layout, id);
    if (index == QM_NO_INDEX) return report_missing_curve(ctx, id);
    if (point_count < 2)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "a curve has two points or more, got %zu", point_count);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    qm_curve *curve = &copy.curves[index];
    status = qm_layout_set_points(ctx, curve, points, point_count);
    if (status == QM_OK) {
        /* Reverse the points if their ends are nearer to the curve's nodes when they are exchanged. */
        qm_vec from = qm_vec_load(copy.nodes + 3 * (size_t)curve->from);
        qm_vec to = qm_vec_load(copy.nodes + 3 * (size_t)curve->to);
        qm_vec first = qm_vec_load(points), last = qm_vec_load(points + 3 * (point_count - 1));
        if (qm_vec_distance(first, to) + qm_vec_distance(last, from) <
            qm_vec_distance(first, from) + qm_vec_distance(last, to)) {
            for (size_t i = 0, j = curve->point_count - 1; i < j; i++, j--) {
                double swapped[3];
                memcpy(swapped, curve->points + 3 * i, POINT_SIZE);
                memcpy(curve->points + 3 * i, curve->points + 3 * j, POINT_SIZE);
                memcpy(curve->points + 3 * j, swapped, POINT_SIZE);
            }
        }
        memcpy(curve->points, copy.nodes + 3 * (size_t)curve->from, POINT_SIZE);
        memcpy(curve->points + 3 * (point_count - 1), copy.nodes + 3 * (size_t)curve->to, POINT_SIZE);
    }
    return qm_layout_finish_edit(ctx, layout, &copy, status);
}

static qm_status snap(qm_context *ctx, qm_layout *layout, uint32_t index, int end, const double near[3],
                      double radius)
{
    uint32_t own = end == 0 ? layout->curves[index].from : layout->curves[index].to, node;
    qm_status status = qm_layout_find_snap_node(ctx, layout, near, radius, own, index, &node);
    if (status != QM_OK) return status;
    if (node == QM_NO_INDEX)
        return qm_context_fail(ctx, QM_E_ARGUMENT,
                               "there is no other node or curve within %g of the position", radius);
    qm_curve *curve = &layout->curves[index];
    *(end == 0 ? &curve->from : &curve->to) = node;
    memcpy(curve->points + 3 * (end == 0 ? 0 : curve->point_count - 1), layout->nodes + 3 * (size_t)node,
           POINT_SIZE);
    return qm_layout_remove_isolated_nodes(ctx, layout);
}

qm_status qm_layout_snap_end(qm_context *ctx, qm_layout *layout, uint32_t id, int end, const double near[3],
                             double radius)
{
    uint32_t index = qm_layout_find_curve(layout, id);
    if (index == QM_NO_INDEX) return report_missing_curve(ctx, id);
    if (layout->curves[index].mark == QM_CURVE_FIXED) return qm_layout_report_fixed(ctx, id);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    return qm_layout_finish_edit(ctx, layout, &copy, snap(ctx, &copy, index, end, near, radius));
}

/**
 * Joins a curve to the only other one at a node if it continues that one, whose mark it takes; *id becomes that of the
 * joined curve.
 */
static qm_status continue_curve(qm_context *ctx, qm_layout *layout, uint32_t *id, uint32_t node)
{
    uint32_t own = qm_layout_find_curve(layout, *id);
    const qm_curve *curve = &layout->curves[own];
    if (qm_layout_node_degree(layout, node) != 2 || curve->from == curve->to ||
        qm_layout_is_corner(layout, node))
        return QM_OK;
    for (uint32_t i = 0; i < layout->curve_count; i++) {
        const qm_curve *other = &layout->curves[i];
        if (i == own || (other->from != node && other->to != node)) continue;
        double cosine = qm_vec_dot(qm_layout_leaving_direction(curve, curve->to == node),
                                   qm_layout_leaving_direction(other, other->to == node));
        bool is_marked_alike = curve->mark == QM_CURVE_SMOOTH || curve->mark == other->mark;
        if (cosine >= OBTUSE || !is_marked_alike) return QM_OK;
        *id = other->id;
        return qm_layout_join_curves(ctx, layout, i, own, node);
    }
    return QM_OK;
}

/**
 * Removes the points within radius of an end: hand-drawn points there may cross the curve that it snapped to.
 */
static qm_status clear_end(qm_context *ctx, qm_curve *curve, bool at_to, double radius)
{
    size_t count = curve->point_count, removed = 0;
    double *end = curve->points + 3 * (at_to ? count - 1 : 0);
    for (; removed + 2 < count; removed++) {
        const double *next = curve->points + 3 * (at_to ? count - 2 - removed : 1 + removed);
        if (qm_vec_distance(qm_vec_load(next), qm_vec_load(end)) > radius) break;
    }
    if (removed == 0) return QM_OK;
    if (at_to)
        memcpy(end - 3 * removed, end, POINT_SIZE);
    else
        memmove(end + 3, end + 3 + 3 * removed, (count - 1 - removed) * POINT_SIZE);
    return qm_layout_set_points(ctx, curve, curve->points, count - removed);
}

/** The node for an end of a stroke: the one that it snaps to, else a new one. */
static qm_status find_end_node(qm_context *ctx, qm_layout *layout, const double near[3], double radius,
                               uint32_t *node)
{
    qm_status status = qm_layout_find_snap_node(ctx, layout, near, radius, QM_NO_INDEX, QM_NO_INDEX, node);
    if (status != QM_OK || *node != QM_NO_INDEX) return status;
    *node = (uint32_t)layout->node_count;
    return qm_layout_add_node(ctx, layout, near);
}

/** Splits a curve where it is nearest to a node, and moves both new ends to that node. */
static qm_status split_at_node(qm_context *ctx, qm_layout *layout, uint32_t index, uint32_t node,
                               double radius, bool *was_split)
{
    qm_curve_position at =
        qm_layout_nearest_position(&layout->curves[index], layout->nodes + 3 * (size_t)node);
    *was_split = qm_layout_is_inside(&layout->curves[index], &at);
    if (!*was_split) return QM_OK;
    qm_status status = qm_layout_split_at(ctx, layout, index, &at);
    if (status != QM_OK) return status;
    qm_curve *first = &layout->curves[index], *second = &layout->curves[layout->curve_count - 1];
    first->to = second->from = node;
    memcpy(first->points + 3 * (first->point_count - 1), layout->nodes + 3 * (size_t)node, POINT_SIZE);
    memcpy(second->points, layout->nodes + 3 * (size_t)node, POINT_SIZE);
    status = clear_end(ctx, first, true, radius);
    if (status == QM_OK) status = clear_end(ctx, second, false, radius);
    return status == QM_OK ? qm_layout_remove_isolated_nodes(ctx, layout) : status;
}

/** Gives two crossing curves a common node: the other one's end if it is within radius, else a new node. */
static qm_status split_crossing(qm_context *ctx, qm_layout *layout, uint32_t own, uint32_t other,
                                const double at[3], double radius, bool *was_split)
{
    const uint32_t ends[2] = {layout->curves[other].from, layout->curves[other].to};
    double min_distance = radius;
    uint32_t node = QM_NO_INDEX;
    for (int end = 0; end < 2; end++) {
        double distance =
            qm_vec_distance(qm_vec_load(at), qm_vec_load(layout->nodes + 3 * (size_t)ends[end]));
        if (distance > min_distance) continue;
        min_distance = distance;
        node = ends[end];
    }
    if (node == QM_NO_INDEX) {
        qm_curve_position on = qm_layout_nearest_position(&layout->curves[other], at);
        if (!qm_layout_is_inside(&layout->curves[other], &on)) return QM_OK;
        node = (uint32_t)layout->node_count;
        qm_status status = qm_layout_split_at(ctx, layout, other, &on);
        if (status != QM_OK) return status;
    } else if (node == layout->curves[own].from || node == layout->curves[own].to) {
        return QM_OK; /* the curves have this node in common */
    }
    return split_at_node(ctx, layout, own, node, radius, was_split);
}

static bool contains(const uint32_t *ids, size_t count, uint32_t id)
{
    for (size_t i = 0; i < count; i++)
        if (ids[i] == id) return true;
    return false;
}

/** Splits a curve at the nodes that it passes through: other curves only end there, which is no crossing. */
static qm_status split_at_nodes(qm_context *ctx, qm_layout *layout, double radius, uint32_t *own,
                                size_t *count)
{
    for (uint32_t node = 0; node < layout->node_count; node++)
        for (size_t i = 0; i < *count && *count <= MAX_CROSSED; i++) {
            uint32_t index = qm_layout_find_curve(layout, own[i]);
            const qm_curve *curve = &layout->curves[index];
            qm_curve_position at = qm_layout_nearest_position(curve, layout->nodes + 3 * (size_t)node);
            if (curve->from == node || curve->to == node || at.distance > THROUGH * radius) continue;
            bool was_split;
            qm_status status = split_at_node(ctx, layout, index, node, radius, &was_split);
            if (status != QM_OK) return status;
            if (was_split) own[(*count)++] = layout->next_id - 1;
        }
    return QM_OK;
}

/**
 * Splits a curve and the curves that it crosses, with a common node each. Its part up to the first keeps its
 * id.
 */
static qm_status split_crossings(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                                 uint32_t id, double radius)
{
    uint32_t own[MAX_CROSSED + 1] = {id};
    size_t count = 1;
    qm_status status = split_at_nodes(ctx, layout, radius, own, &count);
    bool was_split = true;
    for (; status == QM_OK && was_split && count <= MAX_CROSSED; count++) {
        qm_layout_issues found = {0};
        was_split = false;
        status = qm_layout_find_crossings(ctx, layout, surface, &found);
        for (size_t i = 0; i < found.count && status == QM_OK && !was_split; i++) {
            const qm_layout_issue *issue = &found.items[i];
            bool first = contains(own, count, issue->curve[0]),
                 second = contains(own, count, issue->curve[1]);
            if (first == second) continue;
            status = split_crossing(ctx, layout, qm_layout_find_curve(layout, issue->curve[second]),
                                    qm_layout_find_curve(layout, issue->curve[first]), issue->position,
                                    radius, &was_split);
        }
        own[count] = layout->next_id - 1;
        qm_layout_issues_reset(ctx, &found);
    }
    return status;
}

/** A closed stroke that met nothing is cut into four; where it met something its first node goes, which nobody asked for. */
static qm_status finish_ring(qm_context *ctx, qm_layout *layout, uint32_t id, uint32_t node, double radius)
{
    uint32_t index = qm_layout_find_curve(layout, id), nodes[RING_PARTS + 1];
    if (qm_layout_node_degree(layout, node) != 2) return QM_OK;
    if (layout->curves[index].from == layout->curves[index].to)
        return qm_layout_curve_length(&layout->curves[index]) > RING_PARTS * radius
                   ? qm_layout_cut_curve(ctx, layout, index, RING_PARTS, nodes)
                   : QM_OK;
    for (uint32_t i = 0; i < layout->curve_count; i++)
        if (i != index && (layout->curves[i].from == node || layout->curves[i].to == node))
            return qm_layout_join_curves(ctx, layout, index, i, node);
    return QM_OK;
}

qm_status qm_layout_draw_stroke(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                                const double *points, size_t count, double radius, qm_curve_mark mark,
                                uint32_t *id)
{
    uint32_t from, to;
    qm_status status = find_end_node(ctx, layout, points, radius, &from);
    if (status == QM_OK) status = find_end_node(ctx, layout, points + 3 * (count - 1), radius, &to);
    if (status != QM_OK) return status;
    if (from == to && count < 3)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "both ends of the stroke snap to node %u", from);
    const bool is_snapped[2] = {qm_layout_has_curve(layout, from), qm_layout_has_curve(layout, to)};
    status = qm_layout_add_curve(ctx, layout, from, to, points, count);
    if (status == QM_OK) layout->curves[layout->curve_count - 1].mark = mark;
    for (int end = 0; end < 2 && from != to && status == QM_OK; end++)
        if (is_snapped[end])
            status = clear_end(ctx, &layout->curves[layout->curve_count - 1], end == 1, radius);
    if (status != QM_OK) return status;
    *id = layout->next_id - 1;
    bool is_closed = from == to;
    size_t nodes = layout->node_count;
    status = continue_curve(ctx, layout, id, from);
    /* Joining two curves removes their node, and the nodes after it move up. */
    if (layout->node_count < nodes && to > from) to--;
    if (status == QM_OK && !is_closed) status = continue_curve(ctx, layout, id, to);
    if (status == QM_OK) status = split_crossings(ctx, layout, surface, *id, radius);
    return status == QM_OK && is_closed ? finish_ring(ctx, layout, *id, from, radius) : status;
}

qm_status qm_layout_add_marked_stroke(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                                      const double *points, size_t point_count, double radius,
                                      qm_curve_mark mark, uint32_t *id)
{
    if (point_count < 2)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "a stroke has two points or more, got %zu", point_count);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    return qm_layout_finish_edit(
        ctx, layout, &copy,
        qm_layout_draw_stroke(ctx, &copy, surface, points, point_count, radius, mark, id));
}

qm_status qm_layout_add_stroke(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                               const double *points, size_t point_count, double radius, uint32_t *id)
{
    return qm_layout_add_marked_stroke(ctx, layout, surface, points, point_count, radius, QM_CURVE_SMOOTH,
                                       id);
}
