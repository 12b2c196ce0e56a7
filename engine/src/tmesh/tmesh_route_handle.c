/**
 * tmesh_route_handle.c: a path for a curve that must not divide what is free of curves.
 *
 * What is free of curves is a surface K with a boundary, whose copies of vertices are told apart by their sectors. A path from one place of a
 * boundary to another of the same boundary leaves K connected if and only if some closed curve in K crosses it an odd number of times; one
 * between two boundaries always does. All such paths with the same ends are alike: a map of K takes one to the other, by the classification of
 * surfaces. So whichever is taken, the curves that follow find their paths as they do in the layout.
 *
 * Random closed curves of edges, 64 at once, tell the paths apart: the code of an edge has a bit for each that runs along it, and that of a
 * path is the sum of the codes of the edges that it crosses. They keep off both ends of the path, so the code does not depend on the triangles
 * there that it starts and ends in. A path with a code other than 0 divides nothing; that one that divides nothing has the code 0 is
 * of a chance of 2^-64.
 *
 * The shortest of these passes no triangle more than twice. Two arrivals of different codes at each triangle are kept: if a third were part
 * of the shortest path, then one of the two would give a shorter one that is not 0 either. Where the path comes to a triangle again, as at
 * the end of a loop that hangs on a stem, it is laid up to there, and goes on beside itself in what is free then.
 *
 * Source: Erickson, Nayyeri, Minimum cuts and shortest non-separating cycles via homology covers, 2011; Cabello, Mohar, Finding shortest
 * non-separating and non-contractible cycles for topologically embedded graphs, 2007.
 */
#include <math.h>
#include <string.h>

#include "core/union_find.h"
#include "tmesh/tmesh_router.h"

enum { MOST_PIECES = 16, ARRIVALS = 2 };

typedef struct handle_finder {
    qm_router *r;
    qm_arena arena;
    const qm_route_guide *guide;
    qm_route_disc k;
    uint32_t *start, *end; /* triangles of K at the ends */
    size_t start_count, end_count;
    uint32_t ends[2]; /* vertices of K */
    bool divides;     /* a path may, as both ends are on one boundary */
    uint64_t *code;   /* by half-edge of K */
    /* by arrival: ARRIVALS a triangle of K */
    double *cost;
    uint64_t *sum;
    uint32_t *from, *over; /* the arrival before, and the half-edge of K that was crossed; QM_NO_INDEX */
} handle_finder;

/** Lists the triangles at an end of the path: round the vertex that it has come to, where that is no node. */
static size_t list_end(const qm_router *r, uint32_t dart, uint32_t tip, uint32_t *out)
{
    if (tip == QM_NO_INDEX) return qm_router_list_sector(r, dart, out);
    size_t count = 0;
    uint32_t first = qm_router_labelled_edge(r, tip, dart / 2), h = first;
    do {
        out[count++] = h / 3;
        h = qm_trimesh_around(&r->m, h);
    } while (h != first);
    return count;
}

/** Divides the edges at an end that are inside its sector: closed curves pass beside it then, between it and whatever is near. */
static bool divide_edges(handle_finder *f, uint32_t vertex, const uint32_t *sector, size_t count)
{
    qm_router *r = f->r;
    uint32_t *to = qm_arena_alloc(&f->arena, count + 1, sizeof *to), added;
    if (!to) return false;
    for (size_t i = 1; i < count; i++) {
        uint32_t h = 3 * sector[i];
        while (r->m.from[h] != vertex)
            h++;
        to[i] = qm_trimesh_to(&r->m, h);
    }
    for (size_t i = 1; i < count; i++) {
        uint32_t h = qm_router_edge_between(r, vertex, to[i]);
        qm_vec middle = qm_vec_mix(r->m.position[vertex], r->m.position[to[i]], 0.5);
        if (qm_router_label(r, h) == 0 && !qm_router_split_edge(r, h, middle, &added)) return false;
    }
    return true;
}

/** Lists the triangles of K at an end, and finds its vertex in K. *is_found is false where it is not in K. */
static bool find_end(handle_finder *f, uint32_t dart, uint32_t tip, uint32_t vertex, uint32_t **list,
                     size_t *count, uint32_t *end, bool *is_found)
{
    qm_router *r = f->r;
    size_t most = 0;
    uint32_t first = qm_trimesh_first(&r->m, vertex), h = first;
    do {
        most++;
        h = qm_trimesh_around(&r->m, h);
    } while (h != QM_NO_INDEX && h != first);
    *list = qm_arena_alloc(&f->arena, most, sizeof **list);
    if (!*list) return false;
    *count = list_end(r, dart, tip, *list);
    *is_found = *count > 0;
    for (size_t i = 0; i < *count && *is_found; i++) {
        h = 3 * (*list)[i];
        *is_found = r->stamp[h / 3] == r->stamp_value;
        if (!*is_found) break;
        while (r->m.from[h] != vertex)
            h++;
        *end = qm_router_corner_at(r, &f->k, h);
        (*list)[i] = r->local[h / 3];
    }
    return true;
}

/** Gathers K, and finds both ends in it. */
static bool find_ends(handle_finder *f, uint32_t curve, uint32_t tip, bool *is_found)
{
    qm_router *r = f->r;
    const uint32_t dart[2] = {2 * curve, 2 * curve + 1}, tips[2] = {tip, QM_NO_INDEX};
    uint32_t vertex[2], first = QM_NO_INDEX;
    bool is_disc;
    *is_found = false;
    for (int i = 0; i < 2; i++) {
        vertex[i] = tips[i] != QM_NO_INDEX ? tips[i] : r->vertex[qm_router_start(r, dart[i])];
        if (!qm_router_reserve(r)) return false;
        size_t count = list_end(r, dart[i], tips[i], r->queue);
        if (count == 0) return true;
        first = r->queue[0];
        if (!divide_edges(f, vertex[i], r->queue, count)) return false;
    }
    if (!qm_router_gather(r, &f->arena, first, NULL, &f->k, &is_disc)) return false;
    return find_end(f, dart[1], QM_NO_INDEX, vertex[1], &f->end, &f->end_count, &f->ends[1], is_found) &&
           (!*is_found ||
            find_end(f, dart[0], tip, vertex[0], &f->start, &f->start_count, &f->ends[0], is_found));
}

/** Finds whether both ends are on one boundary of K. */
static bool compare_boundaries(handle_finder *f)
{
    const qm_tmesh_chart *chart = &f->k.chart;
    uint32_t *parent = qm_arena_alloc(&f->arena, chart->vertex_count, sizeof *parent);
    if (!parent) return false;
    for (uint32_t v = 0; v < chart->vertex_count; v++)
        parent[v] = v;
    for (uint32_t h = 0; h < 3 * chart->triangle_count; h++)
        if (f->k.beyond[h] == QM_NO_INDEX)
            qm_union_find_join(parent, chart->corner[h / 3][h % 3], chart->corner[h / 3][(h + 1) % 3]);
    f->divides = qm_union_find_root(parent, f->ends[0]) == qm_union_find_root(parent, f->ends[1]);
    return true;
}

/** 64 random bits (Steele, Lea, Flood, Fast splittable pseudorandom number generators, 2014). */
static uint64_t random_bits(uint64_t seed)
{
    uint64_t z = (seed + 1) * UINT64_C(0x9e3779b97f4a7c15);
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    return z ^ (z >> 31);
}

/** Makes the closed curves: of a forest that keeps off both ends, with random other edges, each edge of it such that the sum round each
 * vertex is 0. */
static bool make_codes(handle_finder *f)
{
    const qm_tmesh_chart *chart = &f->k.chart;
    size_t halves = 3 * chart->triangle_count, vertices = chart->vertex_count, tail = 0;
    uint32_t *first = qm_arena_zeroed(&f->arena, vertices + 1, sizeof *first),
             *at = qm_arena_alloc(&f->arena, 2 * halves, sizeof *at),
             *parent = qm_arena_alloc(&f->arena, vertices, sizeof *parent),
             *queue = qm_arena_alloc(&f->arena, vertices, sizeof *queue);
    bool *is_reached = qm_arena_zeroed(&f->arena, vertices, sizeof *is_reached);
    f->code = qm_arena_zeroed(&f->arena, halves, sizeof *f->code);
    if (!first || !at || !parent || !queue || !is_reached || !f->code) return false;
    for (int pass = 0; pass < 2; pass++) { /* the edges at each vertex: counts, then the lists, backwards */
        for (uint32_t h = 0; h < halves; h++) {
            if (f->k.beyond[h] != QM_NO_INDEX && f->k.beyond[h] < h) continue;
            const uint32_t end[2] = {chart->corner[h / 3][h % 3], chart->corner[h / 3][(h + 1) % 3]};
            for (int i = 0; i < 2; i++)
                if (pass == 0)
                    first[end[i]]++;
                else
                    at[--first[end[i]]] = h;
            bool is_at_end =
                end[0] == f->ends[0] || end[0] == f->ends[1] || end[1] == f->ends[0] || end[1] == f->ends[1];
            if (pass == 0 && !is_at_end) f->code[h] = random_bits(h);
        }
        for (size_t v = 0; v < vertices && pass == 0; v++)
            first[v + 1] += first[v];
    }
    is_reached[f->ends[0]] = is_reached[f->ends[1]] = true;
    for (uint32_t root = 0; root < vertices; root++) {
        if (is_reached[root]) continue;
        size_t head = tail;
        parent[root] = QM_NO_INDEX;
        is_reached[root] = true;
        queue[tail++] = root;
        for (; head < tail; head++)
            for (uint32_t i = first[queue[head]]; i < first[queue[head] + 1]; i++) {
                uint32_t a = chart->corner[at[i] / 3][at[i] % 3],
                         b = chart->corner[at[i] / 3][(at[i] + 1) % 3], next = a == queue[head] ? b : a;
                if (is_reached[next]) continue;
                is_reached[next] = true;
                parent[next] = at[i];
                f->code[at[i]] = 0;
                queue[tail++] = next;
            }
    }
    while (tail-- > 0) {
        uint32_t v = queue[tail];
        uint64_t sum = 0;
        for (uint32_t i = first[v]; i < first[v + 1]; i++)
            sum ^= f->code[at[i]];
        if (parent[v] != QM_NO_INDEX) f->code[parent[v]] = sum;
    }
    for (uint32_t h = 0; h < halves; h++)
        if (f->k.beyond[h] != QM_NO_INDEX && f->k.beyond[h] < h) f->code[h] = f->code[f->k.beyond[h]];
    return true;
}

/** Notes an arrival at a triangle, unless there are better ones. */
static bool arrive(handle_finder *f, uint32_t triangle, double cost, uint64_t sum, uint32_t from,
                   uint32_t over)
{
    uint32_t one = ARRIVALS * triangle, other = one + 1, at = one;
    if (f->sum[one] != sum || f->cost[one] == INFINITY) {
        bool is_other = f->sum[other] == sum && f->cost[other] < INFINITY;
        at = is_other || f->cost[other] > f->cost[one] ? other : one;
    }
    if (cost >= f->cost[at]) return true;
    f->cost[at] = cost;
    f->sum[at] = sum;
    f->from[at] = from;
    f->over[at] = over;
    return qm_heap_push(f->r->ctx, &f->r->heap, (qm_heap_item){cost, at, 0}) == QM_OK;
}

/** Finds the shortest path that divides nothing: *last is its last arrival; QM_NO_INDEX where there is none. */
static bool search(handle_finder *f, uint32_t *last)
{
    qm_router *r = f->r;
    const qm_tmesh_chart *chart = &f->k.chart;
    size_t count = ARRIVALS * chart->triangle_count;
    bool *is_end = qm_arena_zeroed(&f->arena, chart->triangle_count, sizeof *is_end);
    f->cost = qm_arena_alloc(&f->arena, count, sizeof *f->cost);
    f->sum = qm_arena_zeroed(&f->arena, count, sizeof *f->sum);
    f->from = qm_arena_alloc(&f->arena, count, sizeof *f->from);
    f->over = qm_arena_alloc(&f->arena, count, sizeof *f->over);
    if (!is_end || !f->cost || !f->sum || !f->from || !f->over) return false;
    for (size_t i = 0; i < count; i++)
        f->cost[i] = INFINITY;
    for (size_t i = 0; i < f->end_count; i++)
        is_end[f->end[i]] = true;
    r->heap.count = 0;
    for (size_t i = 0; i < f->start_count; i++)
        if (!arrive(f, f->start[i], 0, 0, QM_NO_INDEX, QM_NO_INDEX)) return false;
    *last = QM_NO_INDEX;
    while (r->heap.count > 0) {
        qm_heap_item item = qm_heap_pop(&r->heap);
        uint32_t triangle = item.number / ARRIVALS;
        if (item.key > f->cost[item.number]) continue;
        if (is_end[triangle] && (!f->divides || f->sum[item.number] != 0)) {
            *last = item.number;
            return true;
        }
        for (uint32_t h = 3 * triangle; h < 3 * triangle + 3; h++) {
            uint32_t beyond = f->k.beyond[h];
            if (beyond == QM_NO_INDEX) continue;
            double step =
                qm_router_step_cost(r, f->guide, chart->triangle[triangle], chart->triangle[beyond / 3]);
            uint64_t sum = f->sum[item.number] ^ (f->divides ? f->code[h] : 0);
            if (!arrive(f, beyond / 3, item.key + step, sum, item.number, h)) return false;
        }
    }
    return true;
}

/** Lists the edges of the path that was found, up to where it comes to a triangle again: *is_whole is false then. */
static bool list_edges(handle_finder *f, uint32_t last, bool *is_whole)
{
    const qm_tmesh_chart *chart = &f->k.chart;
    size_t count = 0, kept = 0;
    for (uint32_t at = last; f->from[at] != QM_NO_INDEX; at = f->from[at])
        count++;
    uint32_t *over = qm_arena_alloc(&f->arena, count + 1, sizeof *over);
    bool *is_passed = qm_arena_zeroed(&f->arena, chart->triangle_count, sizeof *is_passed);
    if (!over || !is_passed) return false;
    size_t i = count;
    for (uint32_t at = last; f->from[at] != QM_NO_INDEX; at = f->from[at])
        over[--i] = f->over[at];
    *is_whole = true;
    for (; kept < count && *is_whole; kept++) {
        is_passed[over[kept] / 3] = true;
        *is_whole = !is_passed[f->k.beyond[over[kept]] / 3];
    }
    f->r->edge_count = 0;
    for (i = 0; i < kept; i++)
        if (!qm_router_add_guided_edge(f->r, 3 * chart->triangle[over[i] / 3] + over[i] % 3, f->guide))
            return false;
    return true;
}

/** Lays a piece of a curve, from its node or from the vertex that it has come to; *tip becomes the one that it comes to, QM_NO_INDEX at its end. */
static bool lay_piece(handle_finder *f, uint32_t curve, uint32_t *tip)
{
    qm_router *r = f->r;
    const qm_curve *at = &r->layout->curves[curve];
    bool is_found, is_whole;
    uint32_t last = QM_NO_INDEX;
    qm_arena_rewind(&f->arena);
    if (!find_ends(f, curve, *tip, &is_found)) return false;
    if (is_found && !(compare_boundaries(f) && (!f->divides || make_codes(f)) && search(f, &last)))
        return false;
    if (last == QM_NO_INDEX || r->m.face_count > r->most_faces) {
        r->is_lost = true;
        return true;
    }
    if (!list_edges(f, last, &is_whole)) return false;
    uint32_t from = *tip != QM_NO_INDEX ? *tip : r->vertex[at->from];
    if (r->edge_count == 0) {
        *tip = QM_NO_INDEX;
        return qm_router_lay(r, curve, f->k.chart.triangle[last / ARRIVALS]);
    }
    r->is_laid[curve] = true;
    if (!qm_router_lay_edges(r, curve, &from)) return false;
    *tip = is_whole ? QM_NO_INDEX : from;
    return r->is_lost || !is_whole || qm_router_label_between(r, from, r->vertex[at->to], curve);
}

bool qm_router_route_handle(qm_router *r, uint32_t curve, const qm_route_guide *g)
{
    handle_finder f = {.r = r, .arena = qm_arena_make(r->ctx), .guide = g};
    uint32_t tip = QM_NO_INDEX;
    bool has_memory = lay_piece(&f, curve, &tip);
    for (int piece = 1; piece < MOST_PIECES && tip != QM_NO_INDEX && !r->is_lost && has_memory; piece++)
        has_memory = lay_piece(&f, curve, &tip);
    if (tip != QM_NO_INDEX) r->is_lost = true;
    qm_arena_reset(&f.arena);
    return has_memory;
}
