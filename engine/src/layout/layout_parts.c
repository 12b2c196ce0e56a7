/**
 * layout_parts.c: operations on the curves and nodes of a layout, by index, of which edits are made.
 */
#include <string.h>

#include "layout_internal.h"
#include "layout_section.h"

#define DETOUR                                                                                               \
    1.6 /* of the straight distance: a curve that is shorter, and crosses nothing, is taken at once */
#define SAME_LINE 1e-6      /* of the diagonal: curves that are nearer run along each other */
#define ALONG_SAMPLES 12    /* of a curve; with a quarter of them on other curves it runs along these */
#define CROSSING_COST 100.0 /* of the length of a curve */
#define SAME_POINT 1e-9     /* of a curve's length */
#define MIN_END_GAP 1e-6    /* of a curve's length: a position nearer to an end counts as the end */

enum { POINT_SIZE = 3 * sizeof(double) };

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the layout");
}

/** Replaces the layout by the edited copy if status is QM_OK, else frees the copy. Returns status. */
qm_status qm_layout_finish_edit(qm_context *ctx, qm_layout *layout, qm_layout *copy, qm_status status)
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

qm_status qm_layout_report_corner(qm_context *ctx, uint32_t node)
{
    return qm_context_fail(ctx, QM_E_ARGUMENT, "node %u is a corner, which stays where it is", node);
}

qm_status qm_layout_report_fixed(qm_context *ctx, uint32_t id)
{
    return qm_context_fail(ctx, QM_E_ARGUMENT, "curve %u is fixed, and stays as it was drawn", id);
}

qm_status qm_layout_remove_curve(qm_context *ctx, qm_layout *layout, uint32_t index)
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
bool qm_layout_has_curve(const qm_layout *layout, uint32_t node)
{
    for (size_t i = 0; i < layout->curve_count; i++)
        if (layout->curves[i].from == node || layout->curves[i].to == node) return true;
    return false;
}

/** Removes the nodes without a curve and renumbers the others in their order. */
qm_status qm_layout_remove_isolated_nodes(qm_context *ctx, qm_layout *layout)
{
    for (uint32_t node = (uint32_t)layout->node_count; node-- > 0;) {
        if (qm_layout_has_curve(layout, node)) continue;
        qm_status status = qm_layout_set_corner(ctx, layout, node, false);
        if (status != QM_OK) return status;
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
        for (size_t i = 0; i < layout->corner_count; i++)
            layout->corners[i] -= layout->corners[i] > node;
    }
    return QM_OK;
}

/** Gives a curve a copy of these points, which may be its own. */
qm_status qm_layout_set_points(qm_context *ctx, qm_curve *curve, const double *points, size_t point_count)
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
qm_curve_position qm_layout_nearest_position(const qm_curve *curve, const double near[3])
{
    qm_curve_position best = {.distance = INFINITY};
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
            best = (qm_curve_position){
                .segment = i, .distance = distance, .along = length_before + t * sqrt(length2)};
            qm_vec_store(best.position, at);
        }
        length_before += sqrt(length2);
    }
    return best;
}

/** True if a position is that of a point, but for rounding: a segment between both would have no direction. */
static bool is_at(const qm_curve *curve, size_t point, const double position[3])
{
    return qm_vec_distance(qm_vec_load(curve->points + 3 * point), qm_vec_load(position)) <=
           SAME_POINT * qm_layout_curve_length(curve);
}

/**
 * Splits a curve at a position inside it without repeating a point. The new node and the new curve, which
 * runs from it to the old end, become the last ones.
 */
qm_status qm_layout_split_at(qm_context *ctx, qm_layout *layout, uint32_t index, const qm_curve_position *at)
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
    layout->curves[layout->curve_count - 1].mark = first->mark;
    return QM_OK;
}

/** True if a position is not at an end of its curve. */
bool qm_layout_is_inside(const qm_curve *curve, const qm_curve_position *at)
{
    double length = qm_layout_curve_length(curve), min_gap = MIN_END_GAP * length;
    return at->along > min_gap && at->along < length - min_gap;
}

/** The number of curve ends at a node. */
size_t qm_layout_node_degree(const qm_layout *layout, uint32_t node)
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
qm_status qm_layout_join_curves(qm_context *ctx, qm_layout *layout, uint32_t first, uint32_t second,
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
    qm_status status = qm_layout_remove_curve(ctx, layout, second);
    return status == QM_OK ? qm_layout_remove_isolated_nodes(ctx, layout) : status;
}

/**
 * The node that an end at `near` snaps to: the nearest node within radius, else a new node on the nearest
 * curve within radius, which is split there; QM_NO_INDEX if there is neither.
 */
qm_status qm_layout_find_snap_node(qm_context *ctx, qm_layout *layout, const double near[3], double radius,
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
    qm_curve_position best = {.distance = INFINITY};
    uint32_t curve = QM_NO_INDEX;
    for (uint32_t i = 0; i < layout->curve_count; i++) {
        qm_curve_position at = qm_layout_nearest_position(&layout->curves[i], near);
        if (i == except_curve || at.distance > radius || at.distance >= best.distance) continue;
        if (!qm_layout_is_inside(&layout->curves[i], &at)) continue;
        best = at;
        curve = i;
    }
    if (curve == QM_NO_INDEX) return QM_OK;
    *node = (uint32_t)layout->node_count;
    return qm_layout_split_at(ctx, layout, curve, &best);
}

qm_status qm_layout_cut_curve(qm_context *ctx, qm_layout *layout, uint32_t index, uint32_t parts,
                              uint32_t *nodes)
{
    double length = qm_layout_curve_length(&layout->curves[index]) / parts;
    uint32_t rest = index;
    nodes[0] = layout->curves[index].from;
    nodes[parts] = layout->curves[index].to;
    for (uint32_t k = 1; k < parts; k++) {
        const qm_curve *curve = &layout->curves[rest];
        const qm_section line = {curve->points, curve->point_count, curve->point_count};
        double near[3];
        qm_curve_position at = {.along = 0.0};
        qm_vec_store(near, qm_section_at(&line, length));
        /* The first segment that reaches the length, as qm_section_at finds it: a curve may come near itself elsewhere. */
        for (double before = 0.0; at.segment + 2 < curve->point_count; at.segment++) {
            before += qm_vec_distance(qm_vec_load(curve->points + 3 * at.segment),
                                      qm_vec_load(curve->points + 3 * at.segment + 3));
            if (before >= length) break;
        }
        at.along = length;
        memcpy(at.position, near, sizeof near);
        if (!qm_layout_is_inside(curve, &at))
            return qm_context_fail(ctx, QM_E_ARGUMENT, "curve %u is too short to be cut", curve->id);
        qm_status status = qm_layout_split_at(ctx, layout, rest, &at);
        if (status != QM_OK) return status;
        nodes[k] = (uint32_t)layout->node_count - 1;
        rest = (uint32_t)layout->curve_count - 1;
    }
    return QM_OK;
}

qm_vec qm_layout_leaving_direction(const qm_curve *curve, bool from_end)
{
    size_t last = curve->point_count - 1;
    qm_vec start = qm_vec_load(curve->points + 3 * (from_end ? last : 0)), d = {0, 0, 0};
    for (size_t k = 1; k <= last && qm_vec_norm2(d) == 0.0; k++)
        d = qm_vec_sub(qm_vec_load(curve->points + 3 * (from_end ? last - k : k)), start);
    double length = qm_vec_norm(d);
    return length > 0.0 ? qm_vec_scale(1.0 / length, d) : d;
}

qm_status qm_layout_count_crossings(qm_context *ctx, const qm_layout *layout, const qm_ref_surface *surface,
                                    size_t *count)
{
    qm_layout_issues issues = {0};
    uint32_t own = layout->curves[layout->curve_count - 1].id;
    qm_status status = qm_layout_find_crossings(ctx, layout, surface, &issues);
    *count = 0;
    for (size_t i = 0; i < issues.count; i++)
        *count += issues.items[i].curve[0] == own || issues.items[i].curve[1] == own;
    qm_layout_issues_reset(ctx, &issues);
    return status;
}

bool qm_layout_runs_along(const qm_layout *layout, double distance)
{
    const qm_curve *own = &layout->curves[layout->curve_count - 1];
    const qm_section line = {own->points, own->point_count, own->point_count};
    double length = qm_section_length(&line);
    int along = 0;
    for (int k = 0; k < ALONG_SAMPLES; k++) {
        double at[3];
        bool is_along = false;
        qm_vec_store(at, qm_section_at(&line, length * (k + 1) / (ALONG_SAMPLES + 1)));
        for (size_t i = 0; i + 1 < layout->curve_count && !is_along; i++)
            is_along = qm_layout_nearest_position(&layout->curves[i], at).distance <= distance;
        along += is_along;
    }
    return 4 * along > ALONG_SAMPLES;
}

/** Gives the last curve the points of a line, and finds what it costs: its length, many times as much where it crosses. */
static qm_status try_line(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                          const qm_section *line, double *cost)
{
    size_t crossings = 0;
    qm_curve *curve = &layout->curves[layout->curve_count - 1];
    qm_status status = qm_layout_set_points(ctx, curve, line->points, line->count);
    if (status == QM_OK) status = qm_layout_count_crossings(ctx, layout, surface, &crossings);
    crossings += qm_layout_runs_along(layout, SAME_LINE * surface->diagonal);
    *cost = qm_section_length(line) * (1.0 + CROSSING_COST * (double)crossings);
    return status;
}

qm_status qm_layout_draw_curve(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                               uint32_t from, uint32_t to, qm_vec inward)
{
    static const double tilts[] = {0.0,  0.2, -0.2, 0.4, -0.4, 0.6, -0.6, 0.8,
                                   -0.8, 1.0, -1.0, 1.2, -1.2, 1.4, -1.4, 1.5707963};
    qm_vec start = qm_vec_load(layout->nodes + 3 * (size_t)from),
           end = qm_vec_load(layout->nodes + 3 * (size_t)to);
    double straight[6], best = INFINITY;
    qm_vec_store(straight, start);
    qm_vec_store(straight + 3, end);
    qm_section found = {0};
    qm_status status = qm_layout_add_curve(ctx, layout, from, to, straight, 2);
    for (size_t i = 0; i < sizeof tilts / sizeof *tilts && status == QM_OK; i++) {
        qm_section line;
        double cost = INFINITY;
        status = qm_section_between(ctx, surface, start, end, inward, tilts[i], &line);
        if (status == QM_OK && line.count >= 2) status = try_line(ctx, layout, surface, &line, &cost);
        bool is_better = status == QM_OK && cost < best;
        qm_section_reset(ctx, is_better ? &found : &line);
        if (is_better) {
            found = line;
            best = cost;
        }
        if (best <= DETOUR * qm_vec_distance(start, end)) break;
    }
    if (status == QM_OK && found.count < 2) { /* no plane through both connects them */
        qm_section_reset(ctx, &found);
        status = qm_section_project(ctx, surface, start, end, &found);
    }
    if (status == QM_OK)
        status =
            qm_layout_set_points(ctx, &layout->curves[layout->curve_count - 1], found.points, found.count);
    qm_section_reset(ctx, &found);
    return status;
}
