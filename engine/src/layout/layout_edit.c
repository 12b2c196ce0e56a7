/**
 * layout_edit.c: edits of a layout. Each edit works on a copy of the layout; finish_edit replaces the layout
 * by the copy, or frees the copy after an error.
 *
 * The file has three parts: operations on curves by index, of which edits are made; one function for each
 * edit; the stroke, whose ends snap, which continues curves and splits the curves that it crosses.
 */
#include "qm/layout_edit.h"

#include <string.h>

#include "layout_internal.h"

#define MIN_END_GAP 1e-6 /* of a curve's length: a position nearer to an end counts as the end */
#define OBTUSE (-0.85)   /* cosine of the angle between two curves below which one continues the other */
#define MAX_CROSSED 256  /* splits of one stroke; further crossings stay without a node */

enum { POINT_SIZE = 3 * sizeof(double) };

/** A position on a curve, in the segment that starts at point `segment`. */
typedef struct curve_position {
    size_t segment;
    double distance, along; /* distance from the query point; arc length from the curve's start */
    double position[3];
} curve_position;

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the layout");
}

/** Replaces the layout by the edited copy if status is QM_OK, else frees the copy. Returns status. */
static qm_status finish_edit(qm_context *ctx, qm_layout *layout, qm_layout *copy, qm_status status)
{
    if (status == QM_OK) {
        qm_layout_clear_patches(ctx, copy);
        qm_layout_reset(ctx, layout);
        *layout = *copy;
    } else {
        qm_layout_reset(ctx, copy);
    }
    return status;
}

static qm_status remove_curve(qm_context *ctx, qm_layout *layout, uint32_t index)
{
    QM_ASSERT(index < layout->curve_count);
    size_t count = layout->curve_count;
    qm_curve *curves = NULL;
    if (count > 1) {
        curves = qm_context_alloc(ctx, count - 1, sizeof *curves);
        if (!curves) return no_memory(ctx);
        memcpy(curves, layout->curves, index * sizeof *curves);
        memcpy(curves + index, layout->curves + index + 1, (count - 1 - index) * sizeof *curves);
    }
    qm_context_free(ctx, layout->curves[index].points, layout->curves[index].point_count, POINT_SIZE);
    qm_context_free(ctx, layout->curves, count, sizeof *curves);
    layout->curves = curves;
    layout->curve_count = count - 1;
    return QM_OK;
}

/** True if a curve starts or ends at the node. */
static bool has_curve(const qm_layout *layout, uint32_t node)
{
    for (size_t i = 0; i < layout->curve_count; i++)
        if (layout->curves[i].from == node || layout->curves[i].to == node) return true;
    return false;
}

/** Removes the nodes without a curve and renumbers the others in their order. */
static qm_status remove_isolated_nodes(qm_context *ctx, qm_layout *layout)
{
    for (uint32_t node = (uint32_t)layout->node_count; node-- > 0;) {
        if (has_curve(layout, node)) continue;
        size_t remaining = layout->node_count - 1;
        double *nodes = remaining > 0 ? qm_context_alloc(ctx, remaining, POINT_SIZE) : NULL;
        if (remaining > 0 && !nodes) return no_memory(ctx);
        if (remaining > 0) {
            memcpy(nodes, layout->nodes, node * (size_t)POINT_SIZE);
            memcpy(nodes + 3 * (size_t)node, layout->nodes + 3 * ((size_t)node + 1),
                   (remaining - node) * POINT_SIZE);
        }
        qm_context_free(ctx, layout->nodes, layout->node_count, POINT_SIZE);
        layout->nodes = nodes;
        layout->node_count = remaining;
        for (size_t i = 0; i < layout->curve_count; i++) {
            layout->curves[i].from -= layout->curves[i].from > node;
            layout->curves[i].to -= layout->curves[i].to > node;
        }
    }
    return QM_OK;
}

/** Gives a curve a copy of these points, which may be its own. */
static qm_status set_points(qm_context *ctx, qm_curve *curve, const double *points, size_t point_count)
{
    QM_ASSERT(point_count >= 2);
    double *copy = qm_context_alloc(ctx, point_count, POINT_SIZE);
    if (!copy) return no_memory(ctx);
    memcpy(copy, points, point_count * POINT_SIZE);
    qm_context_free(ctx, curve->points, curve->point_count, POINT_SIZE);
    curve->points = copy;
    curve->point_count = point_count;
    return QM_OK;
}

/** The position on a curve that is nearest to a point. */
static curve_position nearest_position(const qm_curve *curve, const double near[3])
{
    curve_position best = {.distance = INFINITY};
    qm_vec p = qm_vec_load(near);
    double length_before = 0.0;
    for (size_t i = 0; i + 1 < curve->point_count; i++) {
        qm_vec a = qm_vec_load(curve->points + 3 * i), b = qm_vec_load(curve->points + 3 * i + 3);
        qm_vec d = qm_vec_sub(b, a);
        double length2 = qm_vec_norm2(d);
        double t = length2 > 0.0 ? qm_clamp(qm_vec_dot(qm_vec_sub(p, a), d) / length2, 0.0, 1.0) : 0.0;
        qm_vec at = qm_vec_mix(a, b, t);
        double distance = qm_vec_distance(p, at);
        if (distance < best.distance) {
            best = (curve_position){
                .segment = i, .distance = distance, .along = length_before + t * sqrt(length2)};
            qm_vec_store(best.position, at);
        }
        length_before += sqrt(length2);
    }
    return best;
}

static bool is_at(const qm_curve *curve, size_t point, const double position[3])
{
    return qm_vec_distance(qm_vec_load(curve->points + 3 * point), qm_vec_load(position)) == 0.0;
}

/**
 * Splits a curve at a position inside it without repeating a point. The new node and the new curve, which
 * runs from it to the old end, become the last ones.
 */
static qm_status split_curve(qm_context *ctx, qm_layout *layout, uint32_t index, const curve_position *at)
{
    QM_ASSERT(index < layout->curve_count && at->segment + 1 < layout->curves[index].point_count);
    qm_status status = qm_layout_add_node(ctx, layout, at->position);
    if (status != QM_OK) return status;
    uint32_t node = (uint32_t)layout->node_count - 1, to = layout->curves[index].to;
    const qm_curve *curve = &layout->curves[index];
    /* qm_layout_add_curve replaces the first point, which is the one before the split, by the node. */
    size_t start = at->segment + is_at(curve, at->segment + 1, at->position);
    size_t kept = at->segment + 2 - is_at(curve, at->segment, at->position);
    status =
        qm_layout_add_curve(ctx, layout, node, to, curve->points + 3 * start, curve->point_count - start);
    if (status != QM_OK) return status;
    double *points = qm_context_alloc(ctx, kept, POINT_SIZE);
    if (!points) return no_memory(ctx);
    qm_curve *first = &layout->curves[index];
    memcpy(points, first->points, (kept - 1) * POINT_SIZE);
    memcpy(points + 3 * (kept - 1), at->position, POINT_SIZE);
    qm_context_free(ctx, first->points, first->point_count, POINT_SIZE);
    first->points = points;
    first->point_count = kept;
    first->to = node;
    return QM_OK;
}

/** True if a position is not at an end of its curve. */
static bool is_inside(const qm_curve *curve, const curve_position *at)
{
    double length = qm_layout_curve_length(curve), min_gap = MIN_END_GAP * length;
    return at->along > min_gap && at->along < length - min_gap;
}

/** The number of curve ends at a node. */
static size_t node_degree(const qm_layout *layout, uint32_t node)
{
    size_t degree = 0;
    for (size_t i = 0; i < layout->curve_count; i++)
        degree += (size_t)(layout->curves[i].from == node) + (size_t)(layout->curves[i].to == node);
    return degree;
}

/** Copies the points of a curve forward or backward. */
static void copy_directed(const qm_curve *curve, bool forward, double *out)
{
    for (size_t i = 0; i < curve->point_count; i++)
        memcpy(out + 3 * i, curve->points + 3 * (forward ? i : curve->point_count - 1 - i), POINT_SIZE);
}

/** Appends the second curve to the first at a node where both end, and removes the second. */
static qm_status join_curves(qm_context *ctx, qm_layout *layout, uint32_t first, uint32_t second,
                             uint32_t node)
{
    QM_ASSERT(first != second);
    qm_curve *a = &layout->curves[first];
    const qm_curve *b = &layout->curves[second];
    size_t count = a->point_count + b->point_count - 1;
    double *points = qm_context_alloc(ctx, count, POINT_SIZE);
    if (!points) return no_memory(ctx);
    bool at_end = a->to == node, b_starts = b->from == node;
    uint32_t far = b_starts ? b->to : b->from;
    if (at_end) { /* a, then b away from the node */
        copy_directed(a, true, points);
        copy_directed(b, b_starts, points + 3 * (a->point_count - 1));
    } else { /* b towards the node, then a */
        copy_directed(b, !b_starts, points);
        copy_directed(a, true, points + 3 * (b->point_count - 1));
    }
    qm_context_free(ctx, a->points, a->point_count, POINT_SIZE);
    a->points = points;
    a->point_count = count;
    *(at_end ? &a->to : &a->from) = far;
    qm_status status = remove_curve(ctx, layout, second);
    return status == QM_OK ? remove_isolated_nodes(ctx, layout) : status;
}

/**
 * The node that an end at `near` snaps to: the nearest node within radius, else a new node on the nearest
 * curve within radius, which is split there; QM_NO_INDEX if there is neither.
 */
static qm_status find_snap_node(qm_context *ctx, qm_layout *layout, const double near[3], double radius,
                                uint32_t except_node, uint32_t except_curve, uint32_t *node)
{
    double min_distance = radius;
    *node = QM_NO_INDEX;
    for (uint32_t i = 0; i < layout->node_count; i++) {
        if (i == except_node) continue;
        double distance = qm_vec_distance(qm_vec_load(near), qm_vec_load(layout->nodes + 3 * (size_t)i));
        if (distance > min_distance || (distance == min_distance && *node != QM_NO_INDEX)) continue;
        min_distance = distance;
        *node = i;
    }
    if (*node != QM_NO_INDEX) return QM_OK;
    curve_position best = {.distance = INFINITY};
    uint32_t curve = QM_NO_INDEX;
    for (uint32_t i = 0; i < layout->curve_count; i++) {
        curve_position at = nearest_position(&layout->curves[i], near);
        if (i == except_curve || at.distance > radius || at.distance >= best.distance) continue;
        if (!is_inside(&layout->curves[i], &at)) continue;
        best = at;
        curve = i;
    }
    if (curve == QM_NO_INDEX) return QM_OK;
    *node = (uint32_t)layout->node_count;
    return split_curve(ctx, layout, curve, &best);
}

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
    status = remove_curve(ctx, &copy, index);
    if (status == QM_OK) status = remove_isolated_nodes(ctx, &copy);
    return finish_edit(ctx, layout, &copy, status);
}

qm_status qm_layout_split_curve(qm_context *ctx, qm_layout *layout, uint32_t id, const double near[3])
{
    uint32_t index = qm_layout_find_curve(layout, id);
    if (index == QM_NO_INDEX) return report_missing_curve(ctx, id);
    curve_position at = nearest_position(&layout->curves[index], near);
    if (!is_inside(&layout->curves[index], &at))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "curve %u cannot be split at its end", id);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    return finish_edit(ctx, layout, &copy, split_curve(ctx, &copy, index, &at));
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
        if (is_common && node_degree(layout, end[k]) == 2) node = end[k];
    }
    if (node == QM_NO_INDEX)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "curves %u and %u share no node that is theirs alone",
                               first, second);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    return finish_edit(ctx, layout, &copy, join_curves(ctx, &copy, a, b, node));
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
    status = set_points(ctx, curve, points, point_count);
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
    return finish_edit(ctx, layout, &copy, status);
}

static qm_status snap(qm_context *ctx, qm_layout *layout, uint32_t index, int end, const double near[3],
                      double radius)
{
    uint32_t own = end == 0 ? layout->curves[index].from : layout->curves[index].to, node;
    qm_status status = find_snap_node(ctx, layout, near, radius, own, index, &node);
    if (status != QM_OK) return status;
    if (node == QM_NO_INDEX)
        return qm_context_fail(ctx, QM_E_ARGUMENT,
                               "there is no other node or curve within %g of the position", radius);
    qm_curve *curve = &layout->curves[index];
    *(end == 0 ? &curve->from : &curve->to) = node;
    memcpy(curve->points + 3 * (end == 0 ? 0 : curve->point_count - 1), layout->nodes + 3 * (size_t)node,
           POINT_SIZE);
    return remove_isolated_nodes(ctx, layout);
}

qm_status qm_layout_snap_end(qm_context *ctx, qm_layout *layout, uint32_t id, int end, const double near[3],
                             double radius)
{
    uint32_t index = qm_layout_find_curve(layout, id);
    if (index == QM_NO_INDEX) return report_missing_curve(ctx, id);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    return finish_edit(ctx, layout, &copy, snap(ctx, &copy, index, end, near, radius));
}

/** Unit vector in which a curve leaves a node: to its first point that differs from the node. */
static qm_vec leaving_direction(const qm_curve *curve, bool from_end)
{
    size_t last = curve->point_count - 1;
    qm_vec start = qm_vec_load(curve->points + 3 * (from_end ? last : 0)), d = {0, 0, 0};
    for (size_t k = 1; k <= last && qm_vec_norm2(d) == 0.0; k++)
        d = qm_vec_sub(qm_vec_load(curve->points + 3 * (from_end ? last - k : k)), start);
    double length = qm_vec_norm(d);
    return length > 0.0 ? qm_vec_scale(1.0 / length, d) : d;
}

/**
 * Joins a curve to the only other one at a node if it continues that one; *id becomes that of the joined
 * curve.
 */
static qm_status continue_curve(qm_context *ctx, qm_layout *layout, uint32_t *id, uint32_t node)
{
    uint32_t own = qm_layout_find_curve(layout, *id);
    const qm_curve *curve = &layout->curves[own];
    if (node_degree(layout, node) != 2 || curve->from == curve->to) return QM_OK;
    for (uint32_t i = 0; i < layout->curve_count; i++) {
        const qm_curve *other = &layout->curves[i];
        if (i == own || (other->from != node && other->to != node)) continue;
        double cosine = qm_vec_dot(leaving_direction(curve, curve->to == node),
                                   leaving_direction(other, other->to == node));
        if (cosine >= OBTUSE) return QM_OK;
        *id = other->id;
        return join_curves(ctx, layout, i, own, node);
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
    return set_points(ctx, curve, curve->points, count - removed);
}

/** The node for an end of a stroke: the one that it snaps to, else a new one. */
static qm_status find_end_node(qm_context *ctx, qm_layout *layout, const double near[3], double radius,
                               uint32_t *node)
{
    qm_status status = find_snap_node(ctx, layout, near, radius, QM_NO_INDEX, QM_NO_INDEX, node);
    if (status != QM_OK || *node != QM_NO_INDEX) return status;
    *node = (uint32_t)layout->node_count;
    return qm_layout_add_node(ctx, layout, near);
}

/** Splits a curve where it is nearest to a node, and moves both new ends to that node. */
static qm_status split_at_node(qm_context *ctx, qm_layout *layout, uint32_t index, uint32_t node,
                               double radius, bool *was_split)
{
    curve_position at = nearest_position(&layout->curves[index], layout->nodes + 3 * (size_t)node);
    *was_split = is_inside(&layout->curves[index], &at);
    if (!*was_split) return QM_OK;
    qm_status status = split_curve(ctx, layout, index, &at);
    if (status != QM_OK) return status;
    qm_curve *first = &layout->curves[index], *second = &layout->curves[layout->curve_count - 1];
    first->to = second->from = node;
    memcpy(first->points + 3 * (first->point_count - 1), layout->nodes + 3 * (size_t)node, POINT_SIZE);
    memcpy(second->points, layout->nodes + 3 * (size_t)node, POINT_SIZE);
    status = clear_end(ctx, first, true, radius);
    if (status == QM_OK) status = clear_end(ctx, second, false, radius);
    return status == QM_OK ? remove_isolated_nodes(ctx, layout) : status;
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
        curve_position on = nearest_position(&layout->curves[other], at);
        if (!is_inside(&layout->curves[other], &on)) return QM_OK;
        node = (uint32_t)layout->node_count;
        qm_status status = split_curve(ctx, layout, other, &on);
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

/**
 * Splits a curve and the curves that it crosses, with a common node each. Its part up to the first keeps its
 * id.
 */
static qm_status split_crossings(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                                 uint32_t id, double radius)
{
    uint32_t own[MAX_CROSSED + 1] = {id};
    qm_status status = QM_OK;
    bool was_split = true;
    for (size_t count = 1; status == QM_OK && was_split && count <= MAX_CROSSED; count++) {
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

static qm_status add_stroke(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                            const double *points, size_t count, double radius, uint32_t *id)
{
    uint32_t from, to;
    qm_status status = find_end_node(ctx, layout, points, radius, &from);
    if (status == QM_OK) status = find_end_node(ctx, layout, points + 3 * (count - 1), radius, &to);
    if (status != QM_OK) return status;
    if (from == to && count < 3)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "both ends of the stroke snap to node %u", from);
    const bool is_snapped[2] = {has_curve(layout, from), has_curve(layout, to)};
    status = qm_layout_add_curve(ctx, layout, from, to, points, count);
    for (int end = 0; end < 2 && from != to && status == QM_OK; end++)
        if (is_snapped[end])
            status = clear_end(ctx, &layout->curves[layout->curve_count - 1], end == 1, radius);
    if (status != QM_OK) return status;
    *id = layout->next_id - 1;
    size_t nodes = layout->node_count;
    status = continue_curve(ctx, layout, id, from);
    /* Joining two curves removes their node, and the nodes after it move up. */
    if (layout->node_count < nodes && to > from) to--;
    if (status == QM_OK && from != to) status = continue_curve(ctx, layout, id, to);
    return status == QM_OK ? split_crossings(ctx, layout, surface, *id, radius) : status;
}

qm_status qm_layout_add_stroke(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                               const double *points, size_t point_count, double radius, uint32_t *id)
{
    if (point_count < 2)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "a stroke has two points or more, got %zu", point_count);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    return finish_edit(ctx, layout, &copy, add_stroke(ctx, &copy, surface, points, point_count, radius, id));
}
