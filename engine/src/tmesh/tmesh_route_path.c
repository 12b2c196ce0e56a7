/**
 * tmesh_route_path.c: the path of a curve between those that lie already.
 */
#include "tmesh/tmesh_router.h"

#include <math.h>
#include <string.h>

#define GUIDE_PULL 8.0 /* how much longer a path is that is off its guide by a quarter of its length */
#define ON_LINE 1e-7   /* of the diagonal: a vertex this near a line is on it */
#define BEND 0.2       /* of the distance to the middle of a triangle: a curve within it is no side of it */

qm_route_guide qm_route_guide_make(const qm_vec *at, size_t count)
{
    qm_route_guide out = {.at = at, .count = count};
    for (size_t k = 1; k < count; k++)
        out.length += qm_vec_distance(at[k], at[k - 1]);
    return out;
}

qm_route_guide qm_router_curve_guide(const qm_router *r, uint32_t curve)
{
    size_t count;
    const qm_vec *at = qm_router_guide_points(r, curve, &count);
    return qm_route_guide_make(at, count);
}

double qm_route_guide_distance(const qm_route_guide *g, qm_vec p, double *passed)
{
    double best = INFINITY, length = 0;
    for (size_t k = 0; k + 1 < g->count; k++) {
        qm_vec along = qm_vec_sub(g->at[k + 1], g->at[k]);
        double length2 = qm_vec_norm2(along),
               at = length2 > 0 ? qm_clamp(qm_vec_dot(qm_vec_sub(p, g->at[k]), along) / length2, 0, 1) : 0,
               far = qm_vec_distance(p, qm_vec_axpy(g->at[k], at, along)), step = sqrt(length2);
        if (far < best) *passed = length + at * step;
        best = fmin(best, far);
        length += step;
    }
    return best;
}

static double guide_distance(const qm_route_guide *g, qm_vec p)
{
    double passed;
    return qm_route_guide_distance(g, p, &passed);
}

/** Where the guide is nearest to an edge. */
static double guide_share(const qm_route_guide *g, qm_vec a, qm_vec b)
{
    double low = 0, high = 1;
    for (int i = 0; i < 12; i++) { /* the distance has one valley, nearly */
        double one = low + (high - low) / 3, other = high - (high - low) / 3;
        if (guide_distance(g, qm_vec_mix(a, b, one)) < guide_distance(g, qm_vec_mix(a, b, other)))
            high = other;
        else
            low = one;
    }
    return qm_clamp(0.5 * (low + high), QM_ROUTE_LEAST_SHARE, 1 - QM_ROUTE_LEAST_SHARE);
}

bool qm_router_add_edge(qm_router *r, uint32_t h, double share)
{
    if (r->edge_count == r->edge_capacity) {
        size_t capacity = 2 * r->edge_capacity + 256;
        uint32_t(*edge)[2] = qm_arena_alloc(r->arena, capacity, sizeof *edge);
        double *shares = qm_arena_alloc(r->arena, capacity, sizeof *shares);
        if (!edge || !shares) return false;
        if (r->edge_count > 0) {
            memcpy(edge, r->edge, r->edge_count * sizeof *edge);
            memcpy(shares, r->share, r->edge_count * sizeof *shares);
        }
        r->edge = edge;
        r->share = shares;
        r->edge_capacity = capacity;
    }
    r->edge[r->edge_count][0] = r->m.from[h];
    r->edge[r->edge_count][1] = qm_trimesh_to(&r->m, h);
    r->share[r->edge_count++] = share;
    return true;
}

size_t qm_router_list_sector(const qm_router *r, uint32_t dart, uint32_t *out)
{
    uint32_t vertex = r->vertex[qm_router_start(r, dart)], before = r->before[dart], first = QM_NO_INDEX;
    while (before != QM_NO_INDEX && before != dart && !r->is_laid[before / 2])
        before = r->before[before];
    if (before != QM_NO_INDEX && before != dart) {
        first = qm_router_labelled_edge(r, vertex, before / 2);
        if (first == QM_NO_INDEX) return 0;
    } else if (before == dart) {
        first = qm_trimesh_first(&r->m, vertex);
    }
    if (first == QM_NO_INDEX) return 0;
    size_t count = 0;
    uint32_t h = first;
    do {
        out[count++] = h / 3;
        h = qm_trimesh_around(&r->m, h);
    } while (h != QM_NO_INDEX && h != first && qm_router_label(r, h) == 0);
    return count;
}

qm_vec qm_router_middle(const qm_router *r, uint32_t face)
{
    const uint32_t *c = r->m.from + 3 * (size_t)face;
    qm_vec corner[3] = {r->m.position[c[0]], r->m.position[c[1]], r->m.position[c[2]]};
    return qm_vec_centroid(corner, 3);
}

double qm_router_step_cost(const qm_router *r, const qm_route_guide *g, uint32_t face, uint32_t next)
{
    qm_vec there = qm_router_middle(r, next);
    double off = g->length > 0 ? guide_distance(g, there) / (0.25 * g->length) : 0;
    return qm_vec_distance(qm_router_middle(r, face), there) * (1 + GUIDE_PULL * off);
}

bool qm_router_add_guided_edge(qm_router *r, uint32_t h, const qm_route_guide *g)
{
    return qm_router_add_edge(
        r, h, guide_share(g, r->m.position[r->m.from[h]], r->m.position[qm_trimesh_to(&r->m, h)]));
}

void qm_router_reverse_edges(qm_router *r)
{
    for (size_t i = 0, j = r->edge_count; i + 1 < j; i++) {
        j--;
        uint32_t pair[2] = {r->edge[i][0], r->edge[i][1]};
        double share = r->share[i];
        memcpy(r->edge[i], r->edge[j], sizeof pair);
        memcpy(r->edge[j], pair, sizeof pair);
        r->share[i] = r->share[j];
        r->share[j] = share;
    }
}

static bool reach(qm_router *r, uint32_t face, double cost, uint32_t back, uint32_t stamp)
{
    if (r->stamp[face] == stamp && r->cost[face] <= cost) return true;
    r->stamp[face] = stamp;
    r->cost[face] = cost;
    r->back[face] = back;
    return qm_heap_push(r->ctx, &r->heap, (qm_heap_item){cost, face, 0}) == QM_OK;
}

/** Finds the edges that a curve passes; *middle is the only triangle of it, where it passes none. False when out of memory. */
static bool find_path(qm_router *r, uint32_t curve, const qm_route_guide *g, uint32_t *middle, bool *is_found)
{
    *middle = QM_NO_INDEX;
    *is_found = false;
    r->edge_count = 0;
    if (!qm_router_reserve(r)) return false;
    uint32_t *sector = r->queue, stamp, ends = ++r->stamp_value;
    size_t count = qm_router_list_sector(r, 2 * curve + 1, sector);
    memset(r->local, 0, r->m.face_count * sizeof *r->local);
    for (size_t i = 0; i < count; i++)
        r->local[sector[i]] = ends;
    stamp = ++r->stamp_value;
    r->heap.count = 0;
    count = qm_router_list_sector(r, 2 * curve, sector);
    for (size_t i = 0; i < count; i++)
        if (!reach(r, sector[i], 0, QM_NO_INDEX, stamp)) return false;
    uint32_t at = QM_NO_INDEX;
    while (r->heap.count > 0) {
        qm_heap_item item = qm_heap_pop(&r->heap);
        if (item.key > r->cost[item.number]) continue;
        if (r->local[item.number] == ends) {
            at = item.number;
            break;
        }
        for (uint32_t k = 0; k < 3; k++) {
            uint32_t h = 3 * item.number + k, twin = r->m.twin[h];
            if (twin == QM_NO_INDEX || qm_router_label(r, h) != 0) continue;
            double cost = item.key + qm_router_step_cost(r, g, item.number, twin / 3);
            if (!reach(r, twin / 3, cost, h, stamp)) return false;
        }
    }
    if (at == QM_NO_INDEX) return true;
    *is_found = true;
    *middle = at;
    for (; r->back[at] != QM_NO_INDEX; at = r->back[at] / 3)
        if (!qm_router_add_guided_edge(r, r->back[at], g)) return false;
    qm_router_reverse_edges(r);
    return true;
}

bool qm_router_label_between(qm_router *r, uint32_t a, uint32_t b, uint32_t curve)
{
    uint32_t h = qm_router_edge_between(r, a, b);
    if (h == QM_NO_INDEX || qm_router_label(r, h) != 0) r->is_lost = true;
    if (!r->is_lost) qm_router_set_label(r, h, curve + 1);
    return true;
}

bool qm_router_lay_edges(qm_router *r, uint32_t curve, uint32_t *last)
{
    uint32_t vertex;
    for (size_t i = 0; i < r->edge_count && !r->is_lost; i++) {
        uint32_t h = qm_router_opposite_edge(r, *last, r->edge[i][0], r->edge[i][1]);
        if (h == QM_NO_INDEX || qm_router_label(r, h) != 0) {
            r->is_lost = true;
            return true;
        }
        double share = r->m.from[h] == r->edge[i][0] ? r->share[i] : 1 - r->share[i];
        qm_vec to = qm_vec_mix(r->m.position[r->m.from[h]], r->m.position[qm_trimesh_to(&r->m, h)], share);
        if (!qm_router_split_edge(r, h, to, &vertex)) return false;
        qm_router_label_between(r, *last, vertex, curve);
        *last = vertex;
    }
    return true;
}

bool qm_router_lay(qm_router *r, uint32_t curve, uint32_t middle)
{
    const qm_curve *at = &r->layout->curves[curve];
    uint32_t last = r->vertex[at->from], end = r->vertex[at->to], vertex;
    r->is_laid[curve] = true;
    if (r->edge_count == 0) {
        qm_vec between = qm_vec_mix(r->m.position[last], r->m.position[end], 0.5);
        if (!qm_router_split_face(r, middle, qm_vec_mix(between, qm_router_middle(r, middle), BEND), &vertex))
            return false;
        return qm_router_label_between(r, last, vertex, curve) &&
               qm_router_label_between(r, vertex, end, curve);
    }
    return qm_router_lay_edges(r, curve, &last) &&
           (r->is_lost || qm_router_label_between(r, last, end, curve));
}

/** The next vertex of a line that runs along edges, after one at a place of its guide, which *passed becomes; QM_NO_INDEX. */
static uint32_t next_on_line(const qm_router *r, const qm_route_guide *g, uint32_t vertex, uint32_t end,
                             double *passed)
{
    uint32_t first = qm_trimesh_first(&r->m, vertex), h = first, next = QM_NO_INDEX;
    double nearest = INFINITY;
    do {
        const uint32_t pair[2] = {qm_trimesh_to(&r->m, h), r->m.from[qm_trimesh_prev(h)]};
        const uint32_t edge[2] = {h, qm_trimesh_prev(h)};
        for (int k = 0; k < 2; k++) {
            double place;
            bool is_free = qm_router_label(r, edge[k]) == 0 && r->m.twin[edge[k]] != QM_NO_INDEX &&
                           (pair[k] == end || r->at_vertex[pair[k]] == QM_NO_INDEX);
            double reach = ON_LINE * qm_vec_norm(qm_trimesh_edge(&r->m, edge[k]));
            if (!is_free || qm_route_guide_distance(g, r->m.position[pair[k]], &place) > reach) continue;
            if (place <= *passed || place >= nearest) continue;
            nearest = place;
            next = pair[k];
        }
        h = qm_trimesh_around(&r->m, h);
    } while (h != QM_NO_INDEX && h != first);
    *passed = nearest;
    return next;
}

/** True if a curve other than those that end at a vertex passes it. */
static bool is_passed(const qm_router *r, uint32_t vertex)
{
    uint32_t first = qm_trimesh_first(&r->m, vertex), h = first;
    do {
        if (qm_router_label(r, h) != 0 || qm_router_label(r, qm_trimesh_prev(h)) != 0) return true;
        h = qm_trimesh_around(&r->m, h);
    } while (h != QM_NO_INDEX && h != first);
    return false;
}

void qm_router_route_line(qm_router *r, uint32_t curve, const qm_route_guide *g)
{
    const qm_curve *at = &r->layout->curves[curve];
    const uint32_t start = r->vertex[at->from], end = r->vertex[at->to];
    for (int is_laying = 0; is_laying < 2; is_laying++) {
        double passed = 0;
        for (uint32_t here = start; here != end;) {
            uint32_t next = next_on_line(r, g, here, end, &passed);
            if (next == QM_NO_INDEX || (!is_laying && next != end && is_passed(r, next))) return;
            if (is_laying) qm_router_set_label(r, qm_router_edge_between(r, here, next), curve + 1);
            here = next;
        }
    }
    r->is_laid[curve] = true;
}

bool qm_router_route_curve(qm_router *r, uint32_t curve, const qm_route_guide *g)
{
    uint32_t middle;
    bool is_found;
    if (!find_path(r, curve, g, &middle, &is_found)) return false;
    if (!is_found || r->m.face_count > r->most_faces) {
        r->is_lost = true;
        return true;
    }
    return qm_router_lay(r, curve, middle);
}
