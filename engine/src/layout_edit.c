#include "qm/layout_edit.h"

#include <string.h>

#include "layout_work.h"

#define OBTUSE (-0.85)   /* cosine of the angle at which a stroke goes on from another */
#define MIN_SHARE 1e-6   /* of a curve's length: nearer to an end is no place inside */
#define MOST_CROSSED 256 /* by one stroke; what it crosses beyond that stays as it is */

enum { ROW = 3 * sizeof(double) };

static qm_status no_curve(qm_context *ctx, uint32_t id)
{
    return qm_context_fail(ctx, QM_E_ARGUMENT, "there is no curve %u", id);
}

/** Puts the edited copy in place of the layout, or drops it after an error. */
static qm_status settle(qm_context *ctx, qm_layout *layout, qm_layout *copy, qm_status status)
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

/** Takes a curve out of the array, which keeps its size until the next one is added or dropped. */
static qm_status drop_curve(qm_context *ctx, qm_layout *layout, uint32_t place)
{
    size_t count = layout->curve_count;
    qm_curve *curves = NULL;
    if (count > 1) {
        curves = qm_context_alloc(ctx, count - 1, sizeof *curves);
        if (!curves) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the layout");
        memcpy(curves, layout->curves, place * sizeof *curves);
        memcpy(curves + place, layout->curves + place + 1, (count - 1 - place) * sizeof *curves);
    }
    qm_context_free(ctx, layout->curves[place].points, layout->curves[place].point_count, ROW);
    qm_context_free(ctx, layout->curves, count, sizeof *curves);
    layout->curves = curves;
    layout->curve_count = count - 1;
    return QM_OK;
}

static bool has_curve(const qm_layout *layout, uint32_t node)
{
    for (size_t i = 0; i < layout->curve_count; i++)
        if (layout->curves[i].from == node || layout->curves[i].to == node) return true;
    return false;
}

/** Closes the ranks of the nodes over those without a curve. */
static qm_status drop_lone_nodes(qm_context *ctx, qm_layout *layout)
{
    for (uint32_t node = (uint32_t)layout->node_count; node-- > 0;) {
        if (has_curve(layout, node)) continue;
        size_t rest = layout->node_count - 1;
        double *nodes = rest > 0 ? qm_context_alloc(ctx, rest, ROW) : NULL;
        if (rest > 0 && !nodes) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the layout");
        if (rest > 0) {
            memcpy(nodes, layout->nodes, node * (size_t)ROW);
            memcpy(nodes + 3 * (size_t)node, layout->nodes + 3 * ((size_t)node + 1), (rest - node) * ROW);
        }
        qm_context_free(ctx, layout->nodes, layout->node_count, ROW);
        layout->nodes = nodes;
        layout->node_count = rest;
        for (size_t i = 0; i < layout->curve_count; i++) {
            layout->curves[i].from -= layout->curves[i].from > node;
            layout->curves[i].to -= layout->curves[i].to > node;
        }
    }
    return QM_OK;
}

/** Gives a curve other points; they are copied. */
static qm_status set_points(qm_context *ctx, qm_curve *curve, const double *points, size_t point_count)
{
    double *copy = qm_context_alloc(ctx, point_count, ROW);
    if (!copy) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the layout");
    memcpy(copy, points, point_count * ROW);
    qm_context_free(ctx, curve->points, curve->point_count, ROW);
    curve->points = copy;
    curve->point_count = point_count;
    return QM_OK;
}

/** A place on a curve: on the piece that starts at point `piece`. */
typedef struct place_on {
    size_t piece;
    double distance, along; /* from the point asked about; length from the start */
    double position[3];
} place_on;

static place_on nearest_on(const qm_curve *curve, const double near[3])
{
    place_on best = {.distance = INFINITY};
    qm_vec p = qm_vec_load(near);
    double done = 0.0;
    for (size_t i = 0; i + 1 < curve->point_count; i++) {
        qm_vec a = qm_vec_load(curve->points + 3 * i), b = qm_vec_load(curve->points + 3 * i + 3);
        qm_vec d = qm_vec_sub(b, a);
        double length2 = qm_vec_norm2(d);
        double t = length2 > 0.0 ? qm_clamp(qm_vec_dot(qm_vec_sub(p, a), d) / length2, 0.0, 1.0) : 0.0;
        qm_vec at = qm_vec_mix(a, b, t);
        double distance = qm_vec_distance(p, at);
        if (distance < best.distance) {
            best = (place_on){.piece = i, .distance = distance, .along = done + t * sqrt(length2)};
            qm_vec_store(best.position, at);
        }
        done += sqrt(length2);
    }
    return best;
}

static bool is_at(const qm_curve *curve, size_t point, const double position[3])
{
    return qm_vec_distance(qm_vec_load(curve->points + 3 * point), qm_vec_load(position)) == 0.0;
}

/** Cuts a curve at a place inside it, no point twice. The new node and the new curve are the last ones. */
static qm_status cut(qm_context *ctx, qm_layout *layout, uint32_t place, const place_on *at)
{
    qm_status status = qm_layout_add_node(ctx, layout, at->position);
    if (status != QM_OK) return status;
    uint32_t node = (uint32_t)layout->node_count - 1, to = layout->curves[place].to;
    const qm_curve *curve = &layout->curves[place];
    /* The point before the cut stands in for the node, which the call puts in its place. */
    size_t start = at->piece + is_at(curve, at->piece + 1, at->position);
    size_t kept = at->piece + 2 - is_at(curve, at->piece, at->position);
    status =
        qm_layout_add_curve(ctx, layout, node, to, curve->points + 3 * start, curve->point_count - start);
    if (status != QM_OK) return status;
    double *points = qm_context_alloc(ctx, kept, ROW);
    if (!points) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the layout");
    qm_curve *first = &layout->curves[place];
    memcpy(points, first->points, (kept - 1) * ROW);
    memcpy(points + 3 * (kept - 1), at->position, ROW);
    qm_context_free(ctx, first->points, first->point_count, ROW);
    first->points = points;
    first->point_count = kept;
    first->to = node;
    return QM_OK;
}

static bool lies_inside(const qm_curve *curve, const place_on *at)
{
    double length = qm_curve_length(curve), least = MIN_SHARE * length;
    return at->along > least && at->along < length - least;
}

qm_status qm_layout_delete_curve(qm_context *ctx, qm_layout *layout, uint32_t id)
{
    uint32_t place = qm_layout_find_curve(layout, id);
    if (place == QM_NO_INDEX) return no_curve(ctx, id);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    status = drop_curve(ctx, &copy, place);
    if (status == QM_OK) status = drop_lone_nodes(ctx, &copy);
    return settle(ctx, layout, &copy, status);
}

qm_status qm_layout_split_curve(qm_context *ctx, qm_layout *layout, uint32_t id, const double near[3])
{
    uint32_t place = qm_layout_find_curve(layout, id);
    if (place == QM_NO_INDEX) return no_curve(ctx, id);
    place_on at = nearest_on(&layout->curves[place], near);
    if (!lies_inside(&layout->curves[place], &at))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "curve %u cannot be split at its end", id);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    return settle(ctx, layout, &copy, cut(ctx, &copy, place, &at));
}

static size_t node_degree(const qm_layout *layout, uint32_t node)
{
    size_t degree = 0;
    for (size_t i = 0; i < layout->curve_count; i++)
        degree += (size_t)(layout->curves[i].from == node) + (size_t)(layout->curves[i].to == node);
    return degree;
}

/** The node at which two curves can be joined, or QM_NO_INDEX. */
static uint32_t joint(const qm_layout *layout, const qm_curve *a, const qm_curve *b)
{
    const uint32_t end[2] = {a->to, a->from};
    for (int k = 0; k < 2; k++)
        if ((b->from == end[k] || b->to == end[k]) && node_degree(layout, end[k]) == 2) return end[k];
    return QM_NO_INDEX;
}

/** Copies the points of a curve so that it starts, or ends, at a node. */
static void copy_towards(const qm_curve *curve, bool forward, double *out)
{
    for (size_t i = 0; i < curve->point_count; i++)
        memcpy(out + 3 * i, curve->points + 3 * (forward ? i : curve->point_count - 1 - i), ROW);
}

/** Joins the second curve to the first at a node; both places are different. */
static qm_status join(qm_context *ctx, qm_layout *layout, uint32_t first, uint32_t second, uint32_t node)
{
    qm_curve *a = &layout->curves[first];
    const qm_curve *b = &layout->curves[second];
    size_t count = a->point_count + b->point_count - 1;
    double *points = qm_context_alloc(ctx, count, ROW);
    if (!points) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the layout");
    bool at_end = a->to == node, b_starts = b->from == node;
    uint32_t far = b_starts ? b->to : b->from;
    if (at_end) { /* a, then b away from the node */
        copy_towards(a, true, points);
        copy_towards(b, b_starts, points + 3 * (a->point_count - 1));
    } else { /* b towards the node, then a */
        copy_towards(b, !b_starts, points);
        copy_towards(a, true, points + 3 * (b->point_count - 1));
    }
    qm_context_free(ctx, a->points, a->point_count, ROW);
    a->points = points;
    a->point_count = count;
    *(at_end ? &a->to : &a->from) = far;
    qm_status status = drop_curve(ctx, layout, second);
    return status == QM_OK ? drop_lone_nodes(ctx, layout) : status;
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
    return settle(ctx, layout, &copy, join(ctx, &copy, a, b, node));
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
        memcpy(swapped, curve->points + 3 * i, ROW);
        memcpy(curve->points + 3 * i, curve->points + 3 * j, ROW);
        memcpy(curve->points + 3 * j, swapped, ROW);
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
    status = set_points(ctx, curve, points, point_count);
    if (status == QM_OK) {
        if (runs_back(&copy, curve, points, point_count)) reverse_points(curve);
        memcpy(curve->points, copy.nodes + 3 * (size_t)curve->from, ROW);
        memcpy(curve->points + 3 * (point_count - 1), copy.nodes + 3 * (size_t)curve->to, ROW);
    }
    return settle(ctx, layout, &copy, status);
}

/** The node that lies nearest to a place, within radius; QM_NO_INDEX for none. */
static uint32_t nearest_node(const qm_layout *layout, const double near[3], double radius, uint32_t except)
{
    uint32_t best = QM_NO_INDEX;
    double least = radius;
    for (uint32_t i = 0; i < layout->node_count; i++) {
        if (i == except) continue;
        double distance = qm_vec_distance(qm_vec_load(near), qm_vec_load(layout->nodes + 3 * (size_t)i));
        if (distance > least || (distance == least && best != QM_NO_INDEX)) continue;
        least = distance;
        best = i;
    }
    return best;
}

/** The node for an end: one that is there, or a new one on a curve within radius; QM_NO_INDEX for neither. */
static qm_status find_target(qm_context *ctx, qm_layout *layout, const double near[3], double radius,
                             uint32_t except_node, uint32_t except_curve, uint32_t *node)
{
    *node = nearest_node(layout, near, radius, except_node);
    if (*node != QM_NO_INDEX) return QM_OK;
    place_on best = {.distance = INFINITY};
    uint32_t curve = QM_NO_INDEX;
    for (uint32_t i = 0; i < layout->curve_count; i++) {
        place_on at = nearest_on(&layout->curves[i], near);
        if (i == except_curve || at.distance > radius || at.distance >= best.distance) continue;
        if (!lies_inside(&layout->curves[i], &at)) continue;
        best = at;
        curve = i;
    }
    if (curve == QM_NO_INDEX) return QM_OK;
    *node = (uint32_t)layout->node_count;
    return cut(ctx, layout, curve, &best);
}

static qm_status snap(qm_context *ctx, qm_layout *layout, uint32_t place, int end, const double near[3],
                      double radius)
{
    uint32_t own = end == 0 ? layout->curves[place].from : layout->curves[place].to, node;
    qm_status status = find_target(ctx, layout, near, radius, own, place, &node);
    if (status != QM_OK) return status;
    if (node == QM_NO_INDEX)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "there is no other node or curve within %g of the place",
                               radius);
    qm_curve *curve = &layout->curves[place];
    *(end == 0 ? &curve->from : &curve->to) = node;
    memcpy(curve->points + 3 * (end == 0 ? 0 : curve->point_count - 1), layout->nodes + 3 * (size_t)node,
           ROW);
    return drop_lone_nodes(ctx, layout);
}

qm_status qm_layout_snap_end(qm_context *ctx, qm_layout *layout, uint32_t id, int end, const double near[3],
                             double radius)
{
    uint32_t place = qm_layout_find_curve(layout, id);
    if (place == QM_NO_INDEX) return no_curve(ctx, id);
    qm_layout copy;
    qm_status status = qm_layout_copy(ctx, layout, &copy);
    if (status != QM_OK) return status;
    return settle(ctx, layout, &copy, snap(ctx, &copy, place, end, near, radius));
}

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
    if (node_degree(layout, node) != 2 || curve->from == curve->to) return QM_OK;
    for (uint32_t i = 0; i < layout->curve_count; i++) {
        const qm_curve *other = &layout->curves[i];
        if (i == own || (other->from != node && other->to != node)) continue;
        double cosine = qm_vec_dot(leaving(curve, curve->to == node), leaving(other, other->to == node));
        if (cosine >= OBTUSE) return QM_OK;
        *id = other->id;
        return join(ctx, layout, i, own, node);
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
        memcpy(end - 3 * gone, end, ROW);
    else
        memmove(end + 3, end + 3 + 3 * gone, (count - 1 - gone) * ROW);
    return set_points(ctx, curve, curve->points, count - gone);
}

static qm_status end_node(qm_context *ctx, qm_layout *layout, const double near[3], double radius,
                          uint32_t *node)
{
    qm_status status = find_target(ctx, layout, near, radius, QM_NO_INDEX, QM_NO_INDEX, node);
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
    place_on at = nearest_on(&layout->curves[place], layout->nodes + 3 * (size_t)node);
    *was_cut = lies_inside(&layout->curves[place], &at);
    if (!*was_cut) return QM_OK;
    qm_status status = cut(ctx, layout, place, &at);
    if (status != QM_OK) return status;
    qm_curve *first = &layout->curves[place], *second = &layout->curves[layout->curve_count - 1];
    first->to = second->from = node;
    memcpy(first->points + 3 * (first->point_count - 1), layout->nodes + 3 * (size_t)node, ROW);
    memcpy(second->points, layout->nodes + 3 * (size_t)node, ROW);
    status = clear_end(ctx, first, true, radius);
    if (status == QM_OK) status = clear_end(ctx, second, false, radius);
    return status == QM_OK ? drop_lone_nodes(ctx, layout) : status;
}

/** Gives two curves that cross a node there: the near end of the other one, else a new one. */
static qm_status cut_crossing(qm_context *ctx, qm_layout *layout, uint32_t own, uint32_t other,
                              const double at[3], double radius, bool *was_cut)
{
    uint32_t node = end_near(layout, &layout->curves[other], at, radius);
    if (node == QM_NO_INDEX) {
        place_on on = nearest_on(&layout->curves[other], at);
        if (!lies_inside(&layout->curves[other], &on)) return QM_OK;
        node = (uint32_t)layout->node_count;
        qm_status status = cut(ctx, layout, other, &on);
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
    const bool snaps[2] = {has_curve(layout, from), has_curve(layout, to)};
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
    return settle(ctx, layout, &copy, add_stroke(ctx, &copy, points, point_count, radius, id));
}
