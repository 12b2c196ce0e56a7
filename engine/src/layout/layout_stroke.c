/**
 * layout_stroke.c: a stroke into a layout: its ends snap, it goes on from curves that it continues, and cuts
 * what it crosses.
 */
#include <string.h>

#include "layout_change.h"
#include "qm/layout_edit.h"

#define OBTUSE (-0.85)   /* cosine of the angle at which a stroke goes on from another */
#define MOST_CROSSED 256 /* by one stroke; what it crosses beyond that stays as it is */

/** Direction in which a curve leaves a node: to its first point that is not the node itself. */
static qm_vec leaving(const qm_curve *curve, bool from_end)
{
    size_t last = curve->point_count - 1;
    qm_vec start = qm_vec_load(curve->points + 3 * (from_end ? last : 0)), d = {0, 0, 0};
    for (size_t k = 1; k <= last && qm_vec_norm2(d) == 0.0; k++)
        d = qm_vec_sub(qm_vec_load(curve->points + 3 * (from_end ? last - k : k)), start);
    double length = qm_vec_norm(d);
    return length > 0.0 ? qm_vec_scale(1.0 / length, d) : d;
}

/** Joins a curve to the only other one at a node, if it goes on from it; tells which one it is then. */
static qm_status smart_merge(qm_context *ctx, qm_layout *layout, uint32_t *id, uint32_t node)
{
    uint32_t own = qm_layout_find_curve(layout, *id);
    const qm_curve *curve = &layout->curves[own];
    if (qm_layout_degree(layout, node) != 2 || curve->from == curve->to) return QM_OK;
    for (uint32_t i = 0; i < layout->curve_count; i++) {
        const qm_curve *other = &layout->curves[i];
        if (i == own || (other->from != node && other->to != node)) continue;
        double cosine = qm_vec_dot(leaving(curve, curve->to == node), leaving(other, other->to == node));
        if (cosine >= OBTUSE) return QM_OK;
        *id = other->id;
        return qm_layout_join(ctx, layout, i, own, node);
    }
    return QM_OK;
}

/** Drops the points within radius of an end: what a hand draws there may cross what the end was put on. */
static qm_status clear_end(qm_context *ctx, qm_curve *curve, bool at_to, double radius)
{
    size_t count = curve->point_count, gone = 0;
    double *end = curve->points + 3 * (at_to ? count - 1 : 0);
    for (; gone + 2 < count; gone++) {
        const double *next = curve->points + 3 * (at_to ? count - 2 - gone : 1 + gone);
        if (qm_vec_distance(qm_vec_load(next), qm_vec_load(end)) > radius) break;
    }
    if (gone == 0) return QM_OK;
    if (at_to)
        memcpy(end - 3 * gone, end, QM_LAYOUT_ROW);
    else
        memmove(end + 3, end + 3 + 3 * gone, (count - 1 - gone) * QM_LAYOUT_ROW);
    return qm_curve_set_points(ctx, curve, curve->points, count - gone);
}

static qm_status end_node(qm_context *ctx, qm_layout *layout, const double near[3], double radius,
                          uint32_t *node)
{
    qm_status status = qm_layout_find_target(ctx, layout, near, radius, QM_NO_INDEX, QM_NO_INDEX, node);
    if (status != QM_OK || *node != QM_NO_INDEX) return status;
    *node = (uint32_t)layout->node_count;
    return qm_layout_add_node(ctx, layout, near);
}

/** The end of a curve that lies within radius of a place; QM_NO_INDEX for neither. */
static uint32_t end_near(const qm_layout *layout, const qm_curve *curve, const double near[3], double radius)
{
    double least = radius;
    uint32_t best = QM_NO_INDEX;
    for (int end = 0; end < 2; end++) {
        uint32_t node = end == 0 ? curve->from : curve->to;
        double distance = qm_vec_distance(qm_vec_load(near), qm_vec_load(layout->nodes + 3 * (size_t)node));
        if (distance > least) continue;
        least = distance;
        best = node;
    }
    return best;
}

/** Cuts a curve where it passes a node, and leads it through that. */
static qm_status cut_at_node(qm_context *ctx, qm_layout *layout, uint32_t place, uint32_t node, double radius,
                             bool *was_cut)
{
    qm_curve_place at = qm_curve_nearest(&layout->curves[place], layout->nodes + 3 * (size_t)node);
    *was_cut = qm_curve_holds(&layout->curves[place], &at);
    if (!*was_cut) return QM_OK;
    qm_status status = qm_layout_cut(ctx, layout, place, &at);
    if (status != QM_OK) return status;
    qm_curve *first = &layout->curves[place], *second = &layout->curves[layout->curve_count - 1];
    first->to = second->from = node;
    memcpy(first->points + 3 * (first->point_count - 1), layout->nodes + 3 * (size_t)node, QM_LAYOUT_ROW);
    memcpy(second->points, layout->nodes + 3 * (size_t)node, QM_LAYOUT_ROW);
    status = clear_end(ctx, first, true, radius);
    if (status == QM_OK) status = clear_end(ctx, second, false, radius);
    return status == QM_OK ? qm_layout_drop_lone_nodes(ctx, layout) : status;
}

/** Gives two curves that cross a node there: the near end of the other one, else a new one. */
static qm_status cut_crossing(qm_context *ctx, qm_layout *layout, uint32_t own, uint32_t other,
                              const double at[3], double radius, bool *was_cut)
{
    uint32_t node = end_near(layout, &layout->curves[other], at, radius);
    if (node == QM_NO_INDEX) {
        qm_curve_place on = qm_curve_nearest(&layout->curves[other], at);
        if (!qm_curve_holds(&layout->curves[other], &on)) return QM_OK;
        node = (uint32_t)layout->node_count;
        qm_status status = qm_layout_cut(ctx, layout, other, &on);
        if (status != QM_OK) return status;
    } else if (node == layout->curves[own].from || node == layout->curves[own].to) {
        return QM_OK; /* they meet there already */
    }
    return cut_at_node(ctx, layout, own, node, radius, was_cut);
}

static bool is_one_of(const uint32_t *ids, size_t count, uint32_t id)
{
    for (size_t i = 0; i < count; i++)
        if (ids[i] == id) return true;
    return false;
}

/** Cuts a curve and those that it crosses, at a node each. It keeps its id up to the first of them. */
static qm_status cut_crossed(qm_context *ctx, qm_layout *layout, uint32_t id, double radius)
{
    uint32_t own[MOST_CROSSED + 1] = {id};
    qm_status status = QM_OK;
    bool was_cut = true;
    for (size_t count = 1; status == QM_OK && was_cut && count <= MOST_CROSSED; count++) {
        qm_layout_issues found = {0};
        was_cut = false;
        status = qm_layout_find_crossings(ctx, layout, &found);
        for (size_t i = 0; i < found.count && status == QM_OK && !was_cut; i++) {
            const qm_layout_issue *issue = &found.items[i];
            bool first = is_one_of(own, count, issue->curve[0]),
                 second = is_one_of(own, count, issue->curve[1]);
            if (first == second) continue;
            status = cut_crossing(ctx, layout, qm_layout_find_curve(layout, issue->curve[second]),
                                  qm_layout_find_curve(layout, issue->curve[first]), issue->position, radius,
                                  &was_cut);
        }
        own[count] = layout->next_id - 1;
        qm_layout_issues_reset(ctx, &found);
    }
    return status;
}

static qm_status add_stroke(qm_context *ctx, qm_layout *layout, const double *points, size_t count,
                            double radius, uint32_t *id)
{
    uint32_t from, to;
    qm_status status = end_node(ctx, layout, points, radius, &from);
    if (status == QM_OK) status = end_node(ctx, layout, points + 3 * (count - 1), radius, &to);
    if (status != QM_OK) return status;
    if (from == to && count < 3)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "both ends of the stroke snap to node %u", from);
    const bool snaps[2] = {qm_layout_has_curve(layout, from), qm_layout_has_curve(layout, to)};
    status = qm_layout_add_curve(ctx, layout, from, to, points, count);
    for (int end = 0; end < 2 && from != to && status == QM_OK; end++)
        if (snaps[end]) status = clear_end(ctx, &layout->curves[layout->curve_count - 1], end == 1, radius);
    if (status != QM_OK) return status;
    *id = layout->next_id - 1;
    size_t nodes = layout->node_count;
    status = smart_merge(ctx, layout, id, from);
    /* A merge takes its node away, and those after it move up. */
    if (layout->node_count < nodes && to > from) to--;
    if (status == QM_OK && from != to) status = smart_merge(ctx, layout, id, to);
    return status == QM_OK ? cut_crossed(ctx, layout, *id, radius) : status;
}

qm_status qm_layout_add_stroke(qm_context *ctx, qm_layout *layout, const double *points, size_t point_count,
                               double radius, uint32_t *id)
{
    if (point_count < 2)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "a stroke has two points or more, got %zu", point_count);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    return qm_layout_settle(ctx, layout, &copy, add_stroke(ctx, &copy, points, point_count, radius, id));
}
