/**
 * tmesh_route_chart.c: curves as straight lines in charts of the faces beside them.
 */
#include "tmesh/tmesh_router.h"

#include <math.h>
#include <string.h>

#define ROUNDS 2      /* of straight curves; nodes move before the last */
#define NODE_STEP 0.7 /* of the distance to the middle of the faces round it */
#define EVEN 0.1      /* share of equal steps along the boundary of a chart; the rest goes by length */

enum {
    MOST_DARTS = 32, /* of a node that moves */
    GUIDE_POINTS = 9
};

/** True where a disc goes on beyond a half-edge: over no curve but those that are open. */
static bool is_open(const qm_router *r, uint32_t h, const bool *is_open_curve)
{
    uint32_t at = qm_router_label(r, h);
    return r->m.twin[h] != QM_NO_INDEX && (at == 0 || (is_open_curve && is_open_curve[at - 1]));
}

static void number_corners(const qm_router *r, const uint32_t *list, size_t count, const bool *open,
                           qm_route_disc *out)
{
    qm_tmesh_chart *chart = &out->chart;
    memset(out->number, 0xff, 3 * count * sizeof *out->number);
    for (size_t i = 0; i < 3 * count; i++) {
        if (out->number[i] != QM_NO_INDEX) continue;
        uint32_t first = 3 * list[i / 3] + (uint32_t)(i % 3), h = first,
                 vertex = (uint32_t)chart->vertex_count++;
        chart->at[vertex] = r->m.position[r->m.from[h]];
        while (is_open(r, h, open)) { /* clockwise to the first of the fan */
            h = qm_trimesh_next(r->m.twin[h]);
            if (h == first) break;
        }
        for (uint32_t start = h;;) {
            out->number[3 * (size_t)r->local[h / 3] + h % 3] = vertex;
            uint32_t prev = qm_trimesh_prev(h);
            if (!is_open(r, prev, open)) break;
            h = r->m.twin[prev];
            if (h == start) break;
        }
    }
    for (size_t i = 0; i < count; i++)
        for (uint32_t k = 0; k < 3; k++) {
            uint32_t h = 3 * list[i] + k;
            chart->corner[i][k] = out->number[3 * i + k];
            out->beyond[3 * i + k] =
                is_open(r, h, open) ? 3 * r->local[r->m.twin[h] / 3] + r->m.twin[h] % 3 : QM_NO_INDEX;
            chart->twin[3 * i + k] = is_open(r, h, open) ? r->local[r->m.twin[h] / 3] : QM_NO_INDEX;
        }
}

bool qm_router_gather(qm_router *r, qm_arena *arena, uint32_t first, const bool *open, qm_route_disc *out,
                      bool *is_made)
{
    *is_made = false;
    *out = (qm_route_disc){0};
    if (!qm_router_reserve(r)) return false;
    uint32_t stamp = ++r->stamp_value;
    size_t count = 0, sides = 0;
    r->stamp[first] = stamp;
    r->queue[count++] = first;
    for (size_t i = 0; i < count; i++) {
        r->local[r->queue[i]] = (uint32_t)i;
        for (uint32_t k = 0; k < 3; k++) {
            uint32_t h = 3 * r->queue[i] + k;
            if (!is_open(r, h, open)) {
                sides++;
                continue;
            }
            uint32_t next = r->m.twin[h] / 3;
            if (r->stamp[next] == stamp) continue;
            r->stamp[next] = stamp;
            r->queue[count++] = next;
        }
    }
    qm_tmesh_chart *chart = &out->chart;
    chart->triangle_count = count;
    chart->corner = qm_arena_alloc(arena, count, sizeof *chart->corner);
    chart->twin = qm_arena_alloc(arena, 3 * count, sizeof *chart->twin);
    chart->triangle = qm_arena_alloc(arena, count, sizeof *chart->triangle);
    chart->at = qm_arena_alloc(arena, 3 * count, sizeof *chart->at);
    out->number = qm_arena_alloc(arena, 3 * count, sizeof *out->number);
    out->beyond = qm_arena_alloc(arena, 3 * count, sizeof *out->beyond);
    uint32_t *next = qm_arena_alloc(arena, 3 * count, sizeof *next);
    out->ring = qm_arena_alloc(arena, sides + 1, sizeof *out->ring);
    if (!chart->corner || !chart->twin || !chart->triangle || !chart->at || !out->number || !out->beyond ||
        !next || !out->ring)
        return false;
    memcpy(chart->triangle, r->queue, count * sizeof *r->queue);
    number_corners(r, chart->triangle, count, open, out);
    chart->flat = qm_arena_zeroed(arena, chart->vertex_count, sizeof *chart->flat);
    out->is_fixed = qm_arena_zeroed(arena, chart->vertex_count, sizeof *out->is_fixed);
    if (!chart->flat || !out->is_fixed) return false;
    if (sides < 3 || 2 * chart->vertex_count != count + sides + 2) return true;
    memset(next, 0xff, 3 * count * sizeof *next);
    uint32_t start = QM_NO_INDEX;
    for (size_t i = 0; i < 3 * count; i++) {
        if (chart->twin[i] != QM_NO_INDEX) continue;
        start = chart->corner[i / 3][i % 3];
        next[start] = chart->corner[i / 3][(i + 1) % 3];
    }
    for (uint32_t at = start; out->ring_count < sides; at = next[at]) {
        if (at == QM_NO_INDEX || (out->ring_count > 0 && at == start)) return true;
        out->ring[out->ring_count++] = at;
    }
    *is_made = next[out->ring[sides - 1]] == start;
    return true;
}

uint32_t qm_router_corner_at(const qm_router *r, const qm_route_disc *d, uint32_t h)
{
    return d->number[3 * (size_t)r->local[h / 3] + h % 3];
}

void qm_route_disc_place_arc(qm_route_disc *d, size_t from, size_t count, double start, double angle)
{
    qm_tmesh_chart *chart = &d->chart;
    double length = 0, at = 0;
    for (size_t pass = 0; pass < 2; pass++) {
        for (size_t i = 0; i < count; i++) {
            uint32_t a = d->ring[(from + i) % d->ring_count], b = d->ring[(from + i + 1) % d->ring_count];
            double step = qm_vec_distance(chart->at[a], chart->at[b]);
            if (pass == 0) {
                length += step;
                continue;
            }
            double along = length > 0 ? at / length : 0, even = (double)i / (double)count,
                   turn = start + angle * ((1 - EVEN) * along + EVEN * even);
            chart->flat[a] = (qm_tmesh_flat){cos(turn), sin(turn)};
            d->is_fixed[a] = true;
            at += step;
        }
    }
}

static bool flatten_round(qm_router *r, qm_route_disc *d, bool *is_made)
{
    qm_route_disc_place_arc(d, 0, d->ring_count, 0, 360.0 * QM_DEGREE);
    return qm_tmesh_chart_flatten(r->arena, &d->chart, d->is_fixed, is_made);
}

/* ---- straight curves ---- */

/** Lists the edges that the straight line between two vertices of a chart passes; *middle is a triangle that it is in, where it passes none.
 * *is_found is false where rounding leads it out. Returns false when out of memory. */
static bool walk_line(qm_router *r, const qm_route_disc *d, uint32_t a, uint32_t b, uint32_t *middle,
                      bool *is_found)
{
    const qm_tmesh_chart *chart = &d->chart;
    qm_tmesh_flat from = chart->flat[a], to = chart->flat[b];
    uint32_t side = QM_NO_INDEX;
    *is_found = false;
    r->edge_count = 0;
    for (uint32_t i = 0; i < 3 * chart->triangle_count && side == QM_NO_INDEX; i++) {
        if (chart->corner[i / 3][i % 3] != a) continue;
        uint32_t p = chart->corner[i / 3][(i + 1) % 3], q = chart->corner[i / 3][(i + 2) % 3];
        if (p == b || q == b) {
            *middle = chart->triangle[i / 3];
            *is_found = true;
            return true;
        }
        if (qm_tmesh_flat_area(from, to, chart->flat[p]) <= 0 &&
            qm_tmesh_flat_area(from, to, chart->flat[q]) > 0 &&
            qm_tmesh_flat_area(from, chart->flat[p], chart->flat[q]) > 0)
            side = i / 3 * 3 + (i + 1) % 3;
    }
    for (size_t step = 0; side != QM_NO_INDEX && step < chart->triangle_count; step++) {
        uint32_t p = chart->corner[side / 3][side % 3], q = chart->corner[side / 3][(side + 1) % 3];
        double right = fmax(0, -qm_tmesh_flat_area(from, to, chart->flat[p])),
               left = fmax(0, qm_tmesh_flat_area(from, to, chart->flat[q]));
        double share = right + left > 0 ? right / (right + left) : 0.5;
        if (!qm_router_add_edge(r, 3 * chart->triangle[side / 3] + side % 3,
                                qm_clamp(share, QM_ROUTE_LEAST_SHARE, 1 - QM_ROUTE_LEAST_SHARE)))
            return false;
        uint32_t twin = d->beyond[side];
        if (twin == QM_NO_INDEX) return true;
        uint32_t apex = chart->corner[twin / 3][(twin + 2) % 3];
        if (apex == b) {
            *is_found = true;
            return true;
        }
        bool is_left = qm_tmesh_flat_area(from, to, chart->flat[apex]) > 0;
        side = twin / 3 * 3 + (twin + (is_left ? 1 : 2)) % 3;
    }
    return true;
}

static void take_up(qm_router *r, uint32_t curve)
{
    uint32_t at = r->vertex[r->layout->curves[curve].from];
    for (uint32_t h; (h = qm_router_labelled_edge(r, at, curve)) != QM_NO_INDEX;) {
        at = qm_trimesh_to(&r->m, h);
        qm_router_set_label(r, h, 0);
    }
    r->is_laid[curve] = false;
}

bool qm_router_straighten_curve(qm_router *r, uint32_t curve, bool *open)
{
    uint32_t one = r->left[2 * curve], other = r->left[2 * curve + 1];
    if (one == other || one == QM_NO_INDEX || other == QM_NO_INDEX) return true;
    const qm_curve *at = &r->layout->curves[curve];
    uint32_t start = qm_router_labelled_edge(r, r->vertex[at->from], curve),
             end = qm_router_labelled_edge(r, r->vertex[at->to], curve), middle = QM_NO_INDEX;
    qm_route_disc d;
    bool is_made;
    open[curve] = true;
    bool has_memory = qm_router_gather(r, r->arena, start / 3, open, &d, &is_made);
    open[curve] = false;
    if (!has_memory || !is_made) return has_memory;
    if (!flatten_round(r, &d, &is_made)) return false;
    if (!is_made) return true;
    if (!walk_line(r, &d, qm_router_corner_at(r, &d, start), qm_router_corner_at(r, &d, end), &middle,
                   &is_made))
        return false;
    if (!is_made) return true;
    take_up(r, curve);
    return qm_router_lay(r, curve, middle);
}

/* ---- nodes that move ---- */

static qm_route_guide lift_line(const qm_route_disc *d, qm_tmesh_flat from, uint32_t triangle,
                                uint32_t corner, qm_vec out[GUIDE_POINTS])
{
    qm_tmesh_flat to = d->chart.flat[corner];
    for (int k = 0; k < GUIDE_POINTS; k++) {
        double share = (double)k / (GUIDE_POINTS - 1);
        qm_tmesh_flat at = {from.u + share * (to.u - from.u), from.v + share * (to.v - from.v)};
        if (!qm_tmesh_chart_lift(&d->chart, at, &triangle, &out[k])) out[k] = d->chart.at[corner];
    }
    return qm_route_guide_make(out, GUIDE_POINTS);
}

/** The inner vertex of a chart that is nearest to a point of the plane, and a triangle at it; QM_NO_INDEX. */
static uint32_t nearest_inner(const qm_router *r, const qm_route_disc *d, qm_tmesh_flat wanted,
                              uint32_t *corner)
{
    double best = INFINITY;
    uint32_t nearest = QM_NO_INDEX;
    for (uint32_t i = 0; i < 3 * d->chart.triangle_count; i++) {
        uint32_t v = d->chart.corner[i / 3][i % 3], vertex = r->m.from[3 * d->chart.triangle[i / 3] + i % 3];
        double u = d->chart.flat[v].u - wanted.u, w = d->chart.flat[v].v - wanted.v, far = u * u + w * w;
        if (d->is_fixed[v] || far >= best) continue;
        best = far;
        nearest = vertex;
        *corner = i;
    }
    return nearest;
}

/** Moves a node towards the middle of the faces round it, and lays its curves anew. False when out of memory. */
static bool move_node(qm_router *r, uint32_t first, bool *open)
{
    uint32_t node = qm_router_start(r, first), dart[MOST_DARTS], far[MOST_DARTS], count = 0, corner;
    qm_vec line[MOST_DARTS][GUIDE_POINTS];
    qm_route_guide g[MOST_DARTS];
    for (uint32_t d = first; count == 0 || d != first; d = r->next[d]) {
        if (d == QM_NO_INDEX || count == MOST_DARTS) return true;
        dart[count++] = d;
    }
    for (uint32_t i = 0; i < count; i++)
        open[dart[i] / 2] = true;
    uint32_t start = qm_router_labelled_edge(r, r->vertex[node], first / 2);
    qm_route_disc d;
    bool is_made, has_memory = qm_router_gather(r, r->arena, start / 3, open, &d, &is_made);
    for (uint32_t i = 0; i < count; i++)
        open[dart[i] / 2] = false;
    if (!has_memory || !is_made) return has_memory;
    if (!flatten_round(r, &d, &is_made)) return false;
    uint32_t here = qm_router_corner_at(r, &d, start);
    if (!is_made || d.is_fixed[here]) return true;
    for (uint32_t i = 0; i < count; i++)
        far[i] = qm_router_corner_at(
            r, &d, qm_router_labelled_edge(r, r->vertex[qm_router_start(r, dart[i] ^ 1)], dart[i] / 2));
    qm_tmesh_flat old = d.chart.flat[here], wanted = {(1 - NODE_STEP) * old.u, (1 - NODE_STEP) * old.v};
    uint32_t to = nearest_inner(r, &d, wanted, &corner);
    if (to == QM_NO_INDEX) return true;
    uint32_t at = d.chart.corner[corner / 3][corner % 3];
    for (uint32_t i = 0; i < count; i++) {
        g[i] = lift_line(&d, d.chart.flat[at], corner / 3, far[i], line[i]);
        take_up(r, dart[i] / 2);
    }
    r->vertex[node] = to;
    for (uint32_t i = 0; i < count && !r->is_lost; i++)
        if (!qm_router_route_curve(r, dart[i] / 2, &g[i])) return false;
    return true;
}

bool qm_router_straighten(qm_router *r, const bool *is_fixed, const bool *is_line)
{
    const qm_layout *layout = r->layout;
    bool *open = qm_arena_zeroed(r->arena, layout->curve_count, sizeof *open);
    bool *is_moved = qm_arena_zeroed(r->arena, layout->node_count, sizeof *is_moved);
    if (!open || !is_moved) return false;
    for (int round = 0; round < ROUNDS; round++) {
        for (uint32_t d = 0; d < 2 * layout->curve_count && round + 1 == ROUNDS; d++) {
            uint32_t node = qm_router_start(r, d);
            if (is_fixed[node] || is_moved[node] || r->is_lost) continue;
            is_moved[node] = true;
            if (qm_context_canceled(r->ctx)) return true;
            if (!move_node(r, d, open)) return false;
        }
        for (uint32_t c = 0; c < layout->curve_count && !r->is_lost; c++) {
            if (qm_context_canceled(r->ctx)) return true;
            if (!is_line[c] && !qm_router_straighten_curve(r, c, open)) return false;
        }
    }
    return true;
}
