/**
 * layout_cells.c: patches from how the curves lie on the surface.
 *
 * Each curve is two darts, 2 c along it and 2 c + 1 against it. Round every node the darts that leave it are
 * ordered anticlockwise; a cell lies to the left of its darts, and at the end of a dart goes on with the one
 * that comes next clockwise from where it came from.
 */
#include "layout_work.h"

#include <string.h>

#define LOOK_AHEAD 0.25 /* of the shortest curve at a node: where the directions of its curves are read */
#define CARRY_STOPS 4   /* places on each piece of a curve where a normal is looked at on its way */

enum { ROW = 3 * sizeof(double) };

typedef struct cells {
    qm_context *ctx;
    const qm_source *source;
    qm_layout *layout;
    size_t dart_count;
    qm_vec *normal;  /* of each node, agreeing along the curves; 0 before it is known */
    double *angle;   /* of each dart round the node it leaves */
    uint32_t *next;  /* the dart that follows in the same cell */
    uint32_t *queue; /* nodes */
    bool *is_walked; /* darts */
} cells;

static uint32_t start_node(const qm_layout *layout, uint32_t dart)
{
    const qm_curve *curve = &layout->curves[dart / 2];
    return dart % 2 ? curve->to : curve->from;
}

static qm_vec surface_normal(const qm_source *source, const double p[3])
{
    qm_foothold foot;
    qm_source_pull(source, p, &foot);
    return qm_vec_load(foot.normal);
}

/** The point k of a curve as its dart meets them. */
static const double *dart_point(const qm_curve *curve, uint32_t dart, size_t k)
{
    return curve->points + 3 * (dart % 2 ? curve->point_count - 1 - k : k);
}

/**
 * The normal at the other end of a curve that agrees with the one at its start. A mesh tells the side itself;
 * on a point set the fitted normals are turned to agree from point to point.
 */
static qm_vec carry_normal(const cells *c, uint32_t dart, qm_vec normal)
{
    const qm_curve *curve = &c->layout->curves[dart / 2];
    if (!c->source->is_cloud) {
        qm_vec own = surface_normal(c->source, dart_point(curve, dart, curve->point_count - 1));
        return qm_vec_norm2(own) > 0.0 ? own : normal;
    }
    for (size_t k = 1; k < curve->point_count; k++) {
        qm_vec before = qm_vec_load(dart_point(curve, dart, k - 1));
        qm_vec after = qm_vec_load(dart_point(curve, dart, k));
        for (int stop = 1; stop <= CARRY_STOPS; stop++) {
            double at[3];
            qm_vec_store(at, qm_vec_mix(before, after, (double)stop / CARRY_STOPS));
            qm_vec here = surface_normal(c->source, at);
            if (qm_vec_norm2(here) == 0.0) continue;
            normal = qm_vec_dot(here, normal) < 0.0 ? qm_vec_scale(-1.0, here) : here;
        }
    }
    return normal;
}

static void spread_normals(cells *c, uint32_t start)
{
    size_t queued = 0;
    c->normal[start] = surface_normal(c->source, c->layout->nodes + 3 * (size_t)start);
    if (qm_vec_norm2(c->normal[start]) == 0.0) c->normal[start] = (qm_vec){0, 0, 1};
    c->queue[queued++] = start;
    for (size_t at = 0; at < queued; at++) {
        for (uint32_t dart = 0; dart < c->dart_count; dart++) {
            uint32_t end = start_node(c->layout, dart ^ 1);
            if (start_node(c->layout, dart) != c->queue[at] || qm_vec_norm2(c->normal[end]) > 0.0) continue;
            c->normal[end] = carry_normal(c, dart, c->normal[c->queue[at]]);
            c->queue[queued++] = end;
        }
    }
}

/** The direction in which a dart leaves: to its point at some length. */
static qm_vec dart_direction(const qm_layout *layout, uint32_t dart, double length)
{
    const qm_curve *curve = &layout->curves[dart / 2];
    qm_vec start = qm_vec_load(dart_point(curve, dart, 0)), here = start;
    for (size_t k = 1; k < curve->point_count; k++) {
        qm_vec next = qm_vec_load(dart_point(curve, dart, k));
        double piece = qm_vec_distance(here, next);
        if (piece >= length)
            return qm_vec_sub(qm_vec_mix(here, next, piece > 0.0 ? length / piece : 0.0), start);
        length -= piece;
        here = next;
    }
    return qm_vec_sub(here, start);
}

/** Length along which the directions at a node are read. */
static double look_ahead(const cells *c, uint32_t node)
{
    double shortest = INFINITY;
    for (size_t i = 0; i < c->layout->curve_count; i++) {
        const qm_curve *curve = &c->layout->curves[i];
        if (curve->from == node || curve->to == node) shortest = fmin(shortest, qm_curve_length(curve));
    }
    return LOOK_AHEAD * shortest;
}

/**
 * The mean normal between the darts of a node. At a corner of a box the face that happens to be taken at the
 * node itself would have one of the edges run along its normal.
 */
static qm_vec mean_normal(const cells *c, uint32_t node, double length)
{
    qm_vec at_node = c->normal[node], start = qm_vec_load(c->layout->nodes + 3 * (size_t)node), sum = at_node;
    for (uint32_t a = 0; a < c->dart_count; a++) {
        if (start_node(c->layout, a) != node) continue;
        for (uint32_t b = a + 1; b < c->dart_count; b++) {
            if (start_node(c->layout, b) != node) continue;
            qm_vec between =
                qm_vec_add(dart_direction(c->layout, a, length), dart_direction(c->layout, b, length));
            double at[3];
            qm_vec_store(at, qm_vec_axpy(start, 0.5, between));
            qm_vec here = surface_normal(c->source, at);
            bool is_turned = c->source->is_cloud && qm_vec_dot(here, at_node) < 0.0;
            sum = qm_vec_axpy(sum, is_turned ? -1.0 : 1.0, here);
        }
    }
    double norm = qm_vec_norm(sum);
    return norm > 1e-3 ? qm_vec_scale(1.0 / norm, sum) : at_node;
}

static void measure_angles(cells *c, uint32_t node)
{
    double length = look_ahead(c, node);
    qm_vec normal = mean_normal(c, node, length);
    qm_vec x = fabs(normal.x) < 0.6 ? (qm_vec){1, 0, 0} : (qm_vec){0, 1, 0};
    x = qm_vec_axpy(x, -qm_vec_dot(x, normal), normal);
    x = qm_vec_scale(1.0 / qm_vec_norm(x), x);
    qm_vec y = qm_vec_cross(normal, x);
    for (uint32_t dart = 0; dart < c->dart_count; dart++) {
        if (start_node(c->layout, dart) != node) continue;
        qm_vec d = dart_direction(c->layout, dart, length);
        c->angle[dart] = atan2(qm_vec_dot(d, y), qm_vec_dot(d, x));
    }
}

/** How far to turn anticlockwise from one dart of a node to another: above 0, a whole turn for the same
 * one. */
static double turn(const cells *c, uint32_t from, uint32_t to)
{
    const double whole = 6.283185307179586;
    double angle = c->angle[to] - c->angle[from];
    if (angle < 0.0 || (angle == 0.0 && to <= from)) angle += whole;
    return angle;
}

/** The order of darts round a node, of equal angles by their numbers: one order, however the angles are
 * rounded. */
static bool is_before(const cells *c, uint32_t dart, uint32_t other)
{
    return c->angle[dart] < c->angle[other] || (c->angle[dart] == c->angle[other] && dart < other);
}

/**
 * The dart that comes next clockwise: the last one before this in their order, else the last of all. No two
 * darts have the same next one, without which the walk round a cell would not come back to its start.
 */
static uint32_t clockwise(const cells *c, uint32_t dart)
{
    uint32_t before = dart, last = dart, node = start_node(c->layout, dart);
    for (uint32_t other = 0; other < c->dart_count; other++) {
        if (start_node(c->layout, other) != node) continue;
        if (is_before(c, last, other)) last = other;
        if (is_before(c, other, dart) && (before == dart || is_before(c, before, other))) before = other;
    }
    return before != dart ? before : last;
}

/** A cell as it is walked. */
typedef struct cell {
    uint32_t first, sides;
    uint32_t dart[4]; /* the first four */
    double angle;     /* sum over the corners */
    bool has_bridge;  /* it lies on both sides of some curve */
} cell;

static bool same_cell(const cells *c, uint32_t first, uint32_t wanted)
{
    uint32_t dart = first;
    do {
        if (dart == wanted) return true;
        dart = c->next[dart];
    } while (dart != first);
    return false;
}

static cell walk_cell(cells *c, uint32_t first)
{
    cell out = {.first = first};
    uint32_t dart = first;
    do {
        if (out.sides < 4) out.dart[out.sides] = dart;
        out.sides++;
        c->is_walked[dart] = true;
        out.angle += turn(c, c->next[dart], dart ^ 1);
        out.has_bridge |= same_cell(c, first, dart ^ 1);
        dart = c->next[dart];
    } while (dart != first);
    return out;
}

static qm_status take_cell(cells *c, const cell *found, qm_layout_issues *out)
{
    const double straight = 3.141592653589793;
    if (found->angle > straight * found->sides) return QM_OK; /* the outside of a drawing */
    const qm_curve *curve = &c->layout->curves[found->first / 2];
    if (found->sides == 4 && !found->has_bridge) {
        qm_layout_patch patch;
        for (int k = 0; k < 4; k++) {
            patch.side[k] = found->dart[k] / 2;
            patch.against[k] = found->dart[k] % 2;
        }
        return qm_layout_append_patch(c->ctx, c->layout, &patch);
    }
    qm_layout_issue issue = {.fault = QM_LAYOUT_CELL_SIDES,
                             .curve = {curve->id, QM_NO_INDEX},
                             .node = start_node(c->layout, found->first),
                             .sides = found->sides};
    memcpy(issue.position, curve->points + 3 * (curve->point_count / 2), ROW);
    return qm_layout_add_issue(c->ctx, out, &issue);
}

static qm_status report_dangling(cells *c, qm_layout_issues *out)
{
    for (uint32_t dart = 0; dart < c->dart_count; dart++) {
        uint32_t node = start_node(c->layout, dart);
        if (clockwise(c, dart) != dart) continue;
        qm_layout_issue issue = {.fault = QM_LAYOUT_DANGLING_END,
                                 .curve = {c->layout->curves[dart / 2].id, QM_NO_INDEX},
                                 .node = node};
        memcpy(issue.position, c->layout->nodes + 3 * (size_t)node, ROW);
        qm_status status = qm_layout_add_issue(c->ctx, out, &issue);
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

static qm_status find_cells(cells *c, qm_layout_issues *out)
{
    for (uint32_t node = 0; node < c->layout->node_count; node++)
        c->normal[node] = (qm_vec){0, 0, 0};
    for (uint32_t node = 0; node < c->layout->node_count; node++)
        if (qm_vec_norm2(c->normal[node]) == 0.0) spread_normals(c, node);
    for (uint32_t node = 0; node < c->layout->node_count; node++)
        measure_angles(c, node);
    for (uint32_t dart = 0; dart < c->dart_count; dart++) {
        c->next[dart] = clockwise(c, dart ^ 1);
        c->is_walked[dart] = false;
    }
    qm_status status = report_dangling(c, out);
    for (uint32_t dart = 0; dart < c->dart_count && status == QM_OK; dart++) {
        if (c->is_walked[dart]) continue;
        cell found = walk_cell(c, dart);
        status = take_cell(c, &found, out);
    }
    return status == QM_OK ? qm_layout_find_crossings(c->ctx, c->layout, out) : status;
}

qm_status qm_layout_find_patches(qm_context *ctx, const qm_source *source, qm_layout *layout,
                                 qm_layout_issues *out)
{
    *out = (qm_layout_issues){0};
    qm_layout_clear_patches(ctx, layout);
    if (layout->curve_count == 0) return QM_OK;
    size_t nodes = layout->node_count, darts = 2 * layout->curve_count;
    cells c = {.ctx = ctx, .source = source, .layout = layout, .dart_count = darts};
    c.normal = qm_context_alloc(ctx, nodes, sizeof *c.normal);
    c.queue = qm_context_alloc(ctx, nodes, sizeof *c.queue);
    c.angle = qm_context_alloc(ctx, darts, sizeof *c.angle);
    c.next = qm_context_alloc(ctx, darts, sizeof *c.next);
    c.is_walked = qm_context_alloc(ctx, darts, sizeof *c.is_walked);
    qm_status status = QM_E_NO_MEMORY;
    if (c.normal && c.queue && c.angle && c.next && c.is_walked)
        status = find_cells(&c, out);
    else
        qm_context_fail(ctx, status, "out of memory for the cells of the layout");
    qm_context_free(ctx, c.normal, nodes, sizeof *c.normal);
    qm_context_free(ctx, c.queue, nodes, sizeof *c.queue);
    qm_context_free(ctx, c.angle, darts, sizeof *c.angle);
    qm_context_free(ctx, c.next, darts, sizeof *c.next);
    qm_context_free(ctx, c.is_walked, darts, sizeof *c.is_walked);
    if (status != QM_OK) qm_layout_issues_reset(ctx, out);
    return status;
}
