#include "layout_change.h"

#include <string.h>

#define MIN_SHARE 1e-6 /* of a curve's length: nearer to an end is no place inside */

qm_status qm_layout_settle(qm_context *ctx, qm_layout *layout, qm_layout *copy, qm_status status)
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

qm_status qm_layout_drop_curve(qm_context *ctx, qm_layout *layout, uint32_t place)
{
    size_t count = layout->curve_count;
    qm_curve *curves = NULL;
    if (count > 1) {
        curves = qm_context_alloc(ctx, count - 1, sizeof *curves);
        if (!curves) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the layout");
        memcpy(curves, layout->curves, place * sizeof *curves);
        memcpy(curves + place, layout->curves + place + 1, (count - 1 - place) * sizeof *curves);
    }
    qm_context_free(ctx, layout->curves[place].points, layout->curves[place].point_count, QM_LAYOUT_ROW);
    qm_context_free(ctx, layout->curves, count, sizeof *curves);
    layout->curves = curves;
    layout->curve_count = count - 1;
    return QM_OK;
}

bool qm_layout_has_curve(const qm_layout *layout, uint32_t node)
{
    for (size_t i = 0; i < layout->curve_count; i++)
        if (layout->curves[i].from == node || layout->curves[i].to == node) return true;
    return false;
}

qm_status qm_layout_drop_lone_nodes(qm_context *ctx, qm_layout *layout)
{
    for (uint32_t node = (uint32_t)layout->node_count; node-- > 0;) {
        if (qm_layout_has_curve(layout, node)) continue;
        size_t rest = layout->node_count - 1;
        double *nodes = rest > 0 ? qm_context_alloc(ctx, rest, QM_LAYOUT_ROW) : NULL;
        if (rest > 0 && !nodes) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the layout");
        if (rest > 0) {
            memcpy(nodes, layout->nodes, node * (size_t)QM_LAYOUT_ROW);
            memcpy(nodes + 3 * (size_t)node, layout->nodes + 3 * ((size_t)node + 1),
                   (rest - node) * QM_LAYOUT_ROW);
        }
        qm_context_free(ctx, layout->nodes, layout->node_count, QM_LAYOUT_ROW);
        layout->nodes = nodes;
        layout->node_count = rest;
        for (size_t i = 0; i < layout->curve_count; i++) {
            layout->curves[i].from -= layout->curves[i].from > node;
            layout->curves[i].to -= layout->curves[i].to > node;
        }
    }
    return QM_OK;
}

qm_status qm_curve_set_points(qm_context *ctx, qm_curve *curve, const double *points, size_t point_count)
{
    double *copy = qm_context_alloc(ctx, point_count, QM_LAYOUT_ROW);
    if (!copy) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the layout");
    memcpy(copy, points, point_count * QM_LAYOUT_ROW);
    qm_context_free(ctx, curve->points, curve->point_count, QM_LAYOUT_ROW);
    curve->points = copy;
    curve->point_count = point_count;
    return QM_OK;
}

qm_curve_place qm_curve_nearest(const qm_curve *curve, const double near[3])
{
    qm_curve_place best = {.distance = INFINITY};
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
            best = (qm_curve_place){.piece = i, .distance = distance, .along = done + t * sqrt(length2)};
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

qm_status qm_layout_cut(qm_context *ctx, qm_layout *layout, uint32_t place, const qm_curve_place *at)
{
    qm_status status = qm_layout_add_node(ctx, layout, at->position);
    if (status != QM_OK) return status;
    uint32_t node = (uint32_t)layout->node_count - 1, to = layout->curves[place].to;
    const qm_curve *curve = &layout->curves[place];
    /* The point before the qm_layout_cut stands in for the node, which the call puts in its place. */
    size_t start = at->piece + is_at(curve, at->piece + 1, at->position);
    size_t kept = at->piece + 2 - is_at(curve, at->piece, at->position);
    status =
        qm_layout_add_curve(ctx, layout, node, to, curve->points + 3 * start, curve->point_count - start);
    if (status != QM_OK) return status;
    double *points = qm_context_alloc(ctx, kept, QM_LAYOUT_ROW);
    if (!points) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the layout");
    qm_curve *first = &layout->curves[place];
    memcpy(points, first->points, (kept - 1) * QM_LAYOUT_ROW);
    memcpy(points + 3 * (kept - 1), at->position, QM_LAYOUT_ROW);
    qm_context_free(ctx, first->points, first->point_count, QM_LAYOUT_ROW);
    first->points = points;
    first->point_count = kept;
    first->to = node;
    return QM_OK;
}

bool qm_curve_holds(const qm_curve *curve, const qm_curve_place *at)
{
    double length = qm_curve_length(curve), least = MIN_SHARE * length;
    return at->along > least && at->along < length - least;
}

size_t qm_layout_degree(const qm_layout *layout, uint32_t node)
{
    size_t degree = 0;
    for (size_t i = 0; i < layout->curve_count; i++)
        degree += (size_t)(layout->curves[i].from == node) + (size_t)(layout->curves[i].to == node);
    return degree;
}

/** Copies the points of a curve so that it starts, or ends, at a node. */
static void copy_towards(const qm_curve *curve, bool forward, double *out)
{
    for (size_t i = 0; i < curve->point_count; i++)
        memcpy(out + 3 * i, curve->points + 3 * (forward ? i : curve->point_count - 1 - i), QM_LAYOUT_ROW);
}

qm_status qm_layout_join(qm_context *ctx, qm_layout *layout, uint32_t first, uint32_t second, uint32_t node)
{
    qm_curve *a = &layout->curves[first];
    const qm_curve *b = &layout->curves[second];
    size_t count = a->point_count + b->point_count - 1;
    double *points = qm_context_alloc(ctx, count, QM_LAYOUT_ROW);
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
    qm_context_free(ctx, a->points, a->point_count, QM_LAYOUT_ROW);
    a->points = points;
    a->point_count = count;
    *(at_end ? &a->to : &a->from) = far;
    qm_status status = qm_layout_drop_curve(ctx, layout, second);
    return status == QM_OK ? qm_layout_drop_lone_nodes(ctx, layout) : status;
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

qm_status qm_layout_find_target(qm_context *ctx, qm_layout *layout, const double near[3], double radius,
                                uint32_t except_node, uint32_t except_curve, uint32_t *node)
{
    *node = nearest_node(layout, near, radius, except_node);
    if (*node != QM_NO_INDEX) return QM_OK;
    qm_curve_place best = {.distance = INFINITY};
    uint32_t curve = QM_NO_INDEX;
    for (uint32_t i = 0; i < layout->curve_count; i++) {
        qm_curve_place at = qm_curve_nearest(&layout->curves[i], near);
        if (i == except_curve || at.distance > radius || at.distance >= best.distance) continue;
        if (!qm_curve_holds(&layout->curves[i], &at)) continue;
        best = at;
        curve = i;
    }
    if (curve == QM_NO_INDEX) return QM_OK;
    *node = (uint32_t)layout->node_count;
    return qm_layout_cut(ctx, layout, curve, &best);
}
