/**
 * tmesh_route_boundary.c: the curves of a layout along the boundaries of the surface.
 *
 * The curves between a patch and no patch form rings, and so do the edges of a boundary. Each ring of curves gets the boundary that it is
 * nearest to, and its nodes get places there in the order of the ring: of all such places those with the least sum of squared distances, also of
 * points between the nodes. The nearest place of each node alone would not keep the order where two parts of a boundary lie on each other, as at a
 * cut without a width.
 */
#include <math.h>
#include <string.h>

#include "tmesh/tmesh_router.h"

#define ON_CORNER 1e-6 /* of an edge: a node this near its end is on it */
#define APART 1e-3     /* of an edge: how far nodes on it are apart, where there is room */

enum {
    BETWEEN = 2,           /* points of a curve between its nodes */
    STARTS = 4,            /* places of the first node that are tried */
    MATCHED = 32,          /* points of a ring that choose its boundary */
    MOST_PLACES = 20000000 /* points of a ring times edges of its boundary */
};

/** A point of a ring of curves. */
typedef struct ring_point {
    qm_vec at;
    uint32_t node; /* QM_NO_INDEX between nodes */
    uint32_t edge; /* its place on the boundary */
} ring_point;

typedef struct boundary_finder {
    qm_router *r;
    /* rings of curves: points[ring_first[i]] to points[ring_first[i + 1] - 1] */
    ring_point *points;
    size_t *ring_first, ring_count;
    /* boundaries: each edge by its first vertex */
    uint32_t *vertex;
    size_t *loop_first, loop_count;
} boundary_finder;

/** The dart along the boundary after one, both with their patch on the left. */
static uint32_t next_along(const qm_router *r, uint32_t dart)
{
    uint32_t at = dart ^ 1;
    while (r->before[at] != QM_NO_INDEX)
        at = r->before[at];
    return at;
}

static bool list_rings(boundary_finder *f)
{
    const qm_router *r = f->r;
    size_t darts = 2 * r->layout->curve_count, count = 0;
    f->points = qm_arena_alloc(r->arena, (BETWEEN + 1) * darts / 2, sizeof *f->points);
    f->ring_first = qm_arena_alloc(r->arena, darts + 1, sizeof *f->ring_first);
    bool *is_listed = qm_arena_zeroed(r->arena, darts, sizeof *is_listed);
    if (!f->points || !f->ring_first || !is_listed) return false;
    for (uint32_t first = 0; first < darts; first++) {
        if (r->left[first] == QM_NO_INDEX || r->left[first ^ 1] != QM_NO_INDEX) continue;
        if (is_listed[first]) continue;
        f->ring_first[f->ring_count++] = count;
        for (uint32_t d = first; !is_listed[d]; d = next_along(r, d)) {
            size_t all;
            const qm_vec *at = qm_router_guide_points(r, d / 2, &all);
            is_listed[d] = true;
            for (size_t k = 0; k <= BETWEEN; k++) {
                size_t i = k * (all - 1) / (BETWEEN + 1);
                f->points[count++] = (ring_point){.at = at[d % 2 == 0 ? i : all - 1 - i],
                                                  .node = k == 0 ? qm_router_start(r, d) : QM_NO_INDEX};
            }
        }
    }
    f->ring_first[f->ring_count] = count;
    return true;
}

static bool list_loops(boundary_finder *f)
{
    const qm_trimesh *m = &f->r->m;
    size_t edges = 0, count = 0;
    for (uint32_t h = 0; h < 3 * m->face_count; h++)
        edges += m->twin[h] == QM_NO_INDEX;
    f->vertex = qm_arena_alloc(f->r->arena, edges, sizeof *f->vertex);
    f->loop_first = qm_arena_alloc(f->r->arena, edges + 1, sizeof *f->loop_first);
    bool *is_listed = qm_arena_zeroed(f->r->arena, m->vertex_count, sizeof *is_listed);
    if (!f->vertex || !f->loop_first || !is_listed) return false;
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        if (m->twin[h] != QM_NO_INDEX || is_listed[m->from[h]]) continue;
        f->loop_first[f->loop_count++] = count;
        for (uint32_t v = m->from[h]; !is_listed[v]; v = qm_trimesh_to(m, qm_trimesh_first(m, v))) {
            is_listed[v] = true;
            f->vertex[count++] = v;
        }
    }
    f->loop_first[f->loop_count] = count;
    return true;
}

/** The squared distance of a point to an edge of a boundary; *share tells where on it. */
static double edge_distance2(const boundary_finder *f, size_t loop, size_t edge, qm_vec p, double *share)
{
    const qm_trimesh *m = &f->r->m;
    size_t first = f->loop_first[loop], count = f->loop_first[loop + 1] - first;
    qm_vec from = m->position[f->vertex[first + edge % count]],
           along = qm_vec_sub(m->position[f->vertex[first + (edge + 1) % count]], from);
    double length2 = qm_vec_norm2(along);
    *share = length2 > 0 ? qm_clamp(qm_vec_dot(qm_vec_sub(p, from), along) / length2, 0, 1) : 0;
    return qm_vec_norm2(qm_vec_sub(p, qm_vec_axpy(from, *share, along)));
}

/** How far points of a ring are from a boundary: their mean squared distance. */
static double ring_distance2(const boundary_finder *f, size_t ring, size_t loop)
{
    size_t first = f->ring_first[ring], count = f->ring_first[ring + 1] - first,
           step = (count + MATCHED - 1) / MATCHED, used = 0;
    double sum = 0, share;
    for (size_t i = 0; i < count; i += step, used++) {
        double best = INFINITY;
        for (size_t e = 0; e < f->loop_first[loop + 1] - f->loop_first[loop]; e++)
            best = fmin(best, edge_distance2(f, loop, e, f->points[first + i].at, &share));
        sum += best;
    }
    return sum / (double)used;
}

/** Gives each ring a boundary of its own, the nearest pairs first. *is_made is false where there are too few, or it is canceled. */
static bool match_rings(const boundary_finder *f, uint32_t *loop_of, bool *is_made)
{
    double *far = qm_arena_alloc(f->r->arena, f->ring_count * f->loop_count, sizeof *far);
    bool *is_taken = qm_arena_zeroed(f->r->arena, f->loop_count, sizeof *is_taken);
    *is_made = false;
    if (!far || !is_taken) return false;
    for (size_t i = 0; i < f->ring_count; i++) {
        loop_of[i] = QM_NO_INDEX;
        if (qm_context_canceled(f->r->ctx)) return true;
        for (size_t k = 0; k < f->loop_count; k++)
            far[i * f->loop_count + k] = ring_distance2(f, i, k);
    }
    *is_made = true;
    for (size_t round = 0; round < f->ring_count && *is_made; round++) {
        double best = INFINITY;
        size_t ring = 0, loop = 0;
        for (size_t i = 0; i < f->ring_count; i++)
            for (size_t k = 0; k < f->loop_count && loop_of[i] == QM_NO_INDEX; k++)
                if (!is_taken[k] && far[i * f->loop_count + k] < best)
                    best = far[i * f->loop_count + k], ring = i, loop = k;
        *is_made = best < INFINITY;
        if (!*is_made) break;
        loop_of[ring] = (uint32_t)loop;
        is_taken[loop] = true;
    }
    return true;
}

/** The edges that a first node is nearest to, and nearer than to their neighbours; their number. */
static size_t list_starts(const boundary_finder *f, size_t loop, qm_vec p, size_t out[STARTS])
{
    size_t edges = f->loop_first[loop + 1] - f->loop_first[loop], count = 0;
    double best[STARTS], share;
    for (size_t e = 0; e < edges; e++) {
        double here = edge_distance2(f, loop, e, p, &share);
        if (edge_distance2(f, loop, e + 1, p, &share) < here ||
            edge_distance2(f, loop, e + edges - 1, p, &share) <= here)
            continue;
        size_t at = count < STARTS ? count++ : STARTS;
        for (; at > 0 && here < best[at - 1]; at--)
            if (at < STARTS) best[at] = best[at - 1], out[at] = out[at - 1];
        if (at < STARTS) best[at] = here, out[at] = e;
    }
    if (count == 0) out[count++] = 0;
    return count;
}

/** Finds the edges of the points of a ring, in order from one that its first point is on; returns the sum of squared distances.
 * came: of points times edges + 1, which edge the point before is on. */
static double place_ring(const boundary_finder *f, size_t ring, size_t loop, size_t start, double *cost,
                         uint32_t *came, uint32_t *edge)
{
    size_t first = f->ring_first[ring], count = f->ring_first[ring + 1] - first,
           edges = f->loop_first[loop + 1] - f->loop_first[loop];
    double share;
    for (size_t e = 0; e <= edges; e++)
        cost[e] = e == 0 ? edge_distance2(f, loop, start, f->points[first].at, &share) : INFINITY;
    for (size_t i = 1; i < count; i++) {
        double best = INFINITY;
        uint32_t from = 0;
        for (size_t e = 0; e <= edges; e++) {
            if (cost[e] < best) best = cost[e], from = (uint32_t)e;
            came[i * (edges + 1) + e] = from;
            cost[e] = best + edge_distance2(f, loop, start + e, f->points[first + i].at, &share);
        }
    }
    size_t last = 0;
    for (size_t e = 0; e <= edges; e++)
        if (cost[e] < cost[last]) last = e;
    double sum = cost[last];
    for (size_t i = count; i-- > 0;) {
        edge[i] = (uint32_t)((start + last) % edges);
        if (i > 0) last = came[i * (edges + 1) + last];
    }
    return sum;
}

/** Puts nodes on one edge, in their order. */
static bool place_nodes_on(boundary_finder *f, size_t loop, size_t edge, const ring_point *const *points,
                           size_t count)
{
    qm_router *r = f->r;
    size_t first = f->loop_first[loop], edges = f->loop_first[loop + 1] - first;
    uint32_t from = f->vertex[first + edge], to = f->vertex[first + (edge + 1) % edges];
    qm_vec ends[2] = {r->m.position[from], r->m.position[to]};
    double gap = fmin(APART, 0.5 / (double)(count + 1)),
           *share = qm_arena_alloc(r->arena, count, sizeof *share);
    if (!share) return false;
    size_t low = 0, high = count;
    for (size_t i = 0; i < count; i++)
        edge_distance2(f, loop, edge, points[i]->at, &share[i]);
    if (low < high && share[low] < ON_CORNER && qm_router_take_vertex(r, points[low]->node, from)) low++;
    if (low < high && share[high - 1] > 1 - ON_CORNER && qm_router_take_vertex(r, points[high - 1]->node, to))
        high--;
    for (size_t i = low; i < high; i++) {
        double least = i == low ? gap : share[i - 1] + gap;
        share[i] = qm_clamp(share[i], least, 1 - gap * (double)(high - i));
    }
    for (size_t i = high; i-- > low;) {
        uint32_t vertex;
        if (!qm_router_split_edge(r, qm_trimesh_first(&r->m, from), qm_vec_mix(ends[0], ends[1], share[i]),
                                  &vertex))
            return false;
        r->at_vertex[vertex] = points[i]->node;
        r->vertex[points[i]->node] = vertex;
    }
    return true;
}

/** Places the nodes of a ring on its boundary. */
static bool settle_ring(boundary_finder *f, size_t ring, size_t loop)
{
    qm_router *r = f->r;
    ring_point *points = f->points + f->ring_first[ring];
    size_t count = f->ring_first[ring + 1] - f->ring_first[ring],
           edges = f->loop_first[loop + 1] - f->loop_first[loop], start[STARTS];
    if (count > MOST_PLACES / (edges + 1)) {
        r->is_lost = true;
        return true;
    }
    double *cost = qm_arena_alloc(r->arena, edges + 1, sizeof *cost), best = INFINITY;
    uint32_t *came = qm_arena_alloc(r->arena, count * (edges + 1), sizeof *came),
             *edge = qm_arena_alloc(r->arena, count, sizeof *edge);
    const ring_point **on = qm_arena_alloc(r->arena, count, sizeof(ring_point *));
    if (!cost || !came || !edge || !on) return false;
    size_t starts = list_starts(f, loop, points[0].at, start), from = start[0];
    for (size_t s = 0; s < starts; s++) {
        double sum = place_ring(f, ring, loop, start[s], cost, came, edge);
        if (sum >= best) continue;
        best = sum;
        from = start[s];
        for (size_t i = 0; i < count; i++)
            points[i].edge = edge[i];
    }
    /* A ring that comes round to the edge of its first point ends before that point. */
    for (size_t e = 0; e < edges; e++) {
        size_t at = (from + e) % edges, nodes = 0;
        for (int pass = 0; pass < 2; pass++) {
            bool is_late = false;
            for (size_t i = 0; i < count; i++) {
                is_late |= points[i].edge != from;
                if (points[i].edge != at || points[i].node == QM_NO_INDEX) continue;
                if (e == 0 && (pass == 0) != is_late) continue;
                if (e > 0 && pass > 0) continue;
                on[nodes++] = &points[i];
            }
        }
        if (nodes > 0 && !place_nodes_on(f, loop, at, on, nodes)) return false;
    }
    return true;
}

bool qm_router_place_on_boundaries(qm_router *r)
{
    boundary_finder f = {.r = r};
    bool is_made = true;
    if (!list_rings(&f)) return false;
    if (f.ring_count == 0) return true;
    if (!list_loops(&f)) return false;
    uint32_t *loop_of = qm_arena_alloc(r->arena, f.ring_count, sizeof *loop_of);
    if (!loop_of || !match_rings(&f, loop_of, &is_made)) return false;
    if (!is_made) r->is_lost = true;
    for (size_t i = 0; i < f.ring_count && !r->is_lost && !qm_context_canceled(r->ctx); i++)
        if (!settle_ring(&f, i, loop_of[i])) return false;
    return true;
}

bool qm_router_route_boundary(qm_router *r, uint32_t curve)
{
    uint32_t dart = 2 * curve + (r->left[2 * curve] == QM_NO_INDEX);
    uint32_t at = r->vertex[qm_router_start(r, dart)], end = r->vertex[qm_router_start(r, dart ^ 1)];
    r->is_laid[curve] = true;
    for (size_t step = 0; at != end && step < 3 * r->m.face_count; step++) {
        uint32_t h = qm_trimesh_first(&r->m, at);
        bool is_free = r->m.twin[h] == QM_NO_INDEX && qm_router_label(r, h) == 0;
        bool meets = step > 0 && r->at_vertex[at] != QM_NO_INDEX;
        if (!is_free || meets) {
            r->is_lost = true;
            return true;
        }
        qm_router_set_label(r, h, curve + 1);
        at = qm_trimesh_to(&r->m, h);
    }
    return true;
}
