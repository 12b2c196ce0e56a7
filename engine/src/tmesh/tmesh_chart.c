/**
 * tmesh_chart.c: discs of a surface, and their maps to the plane.
 */
#include "tmesh/tmesh_chart.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "qm/project.h"
#include "quads/quads_internal.h"

#define REACH_TIMES                                                                                          \
    4.0 /* a path between two places is no longer than so many times their distance, and a few sides */
#define MENDS 6           /* of a disc that touches itself at a vertex */
#define LEAST_WEIGHT 0.02 /* of a side from one triangle; the inverse of it is the greatest */
#define LEAST_MERGED 1e-4 /* of a side from both */
#define TOLERANCE 1e-13   /* of the residual of the map, relative */
#define MOST_STEPS 4000   /* of its solution */
#define SPREADS 20        /* rounds of dividing weights by the stretch */
#define SPREAD_TOLERANCE 1e-5
#define SPREAD_FALL 0.98 /* times the mean stretch before: another round is worth it */

/* Rings of triangles round the disc, for each square root of the number of these, or fewer where it is no disc with them: the map turns
 * corners near the boundary into parts of a circle. */
static const double margins[] = {0.5, 0.1, 0};

/* ---- triangles ---- */

static bool allocate(qm_tmesh_triangles *t)
{
    qm_context *ctx = t->ctx;
    size_t faces = t->mesh.face_count, vertices = t->mesh.vertex_count;
    t->in_disc = qm_context_alloc(ctx, faces, sizeof *t->in_disc);
    t->seen = qm_context_alloc(ctx, faces, sizeof *t->seen);
    t->label = qm_context_alloc(ctx, faces, sizeof *t->label);
    t->before = qm_context_alloc(ctx, faces, sizeof *t->before);
    t->disc = qm_context_alloc(ctx, faces, sizeof *t->disc);
    t->cost = qm_context_alloc(ctx, faces, sizeof *t->cost);
    t->number = qm_context_alloc(ctx, vertices, sizeof *t->number);
    t->number_stamp = qm_context_alloc(ctx, vertices, sizeof *t->number_stamp);
    if (!t->in_disc || !t->seen || !t->label || !t->before || !t->disc || !t->cost || !t->number ||
        !t->number_stamp)
        return false;
    memset(t->in_disc, 0, faces * sizeof *t->in_disc);
    memset(t->seen, 0, faces * sizeof *t->seen);
    memset(t->number_stamp, 0, vertices * sizeof *t->number_stamp);
    return true;
}

/** Lists the triangles of a mesh in the order of its faces. */
static qm_status list_triangles(qm_tmesh_triangles *t, const qm_mesh *mesh, qm_quads_triangles *list)
{
    *list = (qm_quads_triangles){.count = 0};
    size_t count = 0;
    for (size_t f = 0; f < mesh->face_count; f++)
        count += mesh->faces[4 * f + 3] == QM_NO_INDEX ? 1 : 2;
    list->corner = qm_context_alloc(t->ctx, count, sizeof *list->corner);
    if (!list->corner) return QM_E_NO_MEMORY;
    list->count = count;
    count = 0;
    for (size_t f = 0; f < mesh->face_count; f++) {
        const uint32_t *c = mesh->faces + 4 * f;
        memcpy(list->corner[count++], c, 3 * sizeof *c);
        if (c[3] == QM_NO_INDEX) continue;
        const uint32_t second[3] = {c[0], c[2], c[3]};
        memcpy(list->corner[count++], second, sizeof second);
    }
    return qm_quads_close_seams(t->ctx, mesh, list);
}

/** Numbers the first triangle of each face, as qm_trimesh_build does, which leaves out those that repeat a corner. */
static void number_triangles(qm_tmesh_triangles *t, const qm_mesh *mesh, const qm_quads_triangles *list)
{
    size_t at = 0;
    uint32_t count = 0;
    for (size_t f = 0; f < mesh->face_count; f++) {
        t->first[f] = count;
        for (int k = mesh->faces[4 * f + 3] == QM_NO_INDEX ? 1 : 0; k < 2; k++) {
            const uint32_t *c = list->corner[at++];
            count += c[0] != c[1] && c[1] != c[2] && c[2] != c[0];
        }
    }
    t->first[mesh->face_count] = count;
}

qm_status qm_tmesh_triangles_make(qm_context *ctx, const qm_ref_surface *surface, qm_tmesh_triangles *out)
{
    const qm_mesh *mesh = qm_bvh_mesh(surface->bvh);
    *out = (qm_tmesh_triangles){.ctx = ctx, .surface = surface, .surface_faces = mesh->face_count};
    qm_quads_triangles list;
    qm_status status = list_triangles(out, mesh, &list);
    if (status == QM_OK) {
        out->first = qm_context_alloc(ctx, mesh->face_count + 1, sizeof *out->first);
        status = out->first ? QM_OK : QM_E_NO_MEMORY;
    }
    if (status == QM_OK) {
        number_triangles(out, mesh, &list);
        status = qm_trimesh_build(ctx, mesh->positions, mesh->vertex_count, (const uint32_t(*)[3])list.corner,
                                  list.count, &out->mesh);
    }
    qm_quads_triangles_reset(ctx, &list);
    if (status == QM_OK && !allocate(out)) status = QM_E_NO_MEMORY;
    return status;
}

void qm_tmesh_triangles_reset(qm_tmesh_triangles *t)
{
    if (!t->ctx) return;
    size_t faces = t->mesh.face_count, vertices = t->mesh.vertex_count;
    qm_context_free(t->ctx, t->in_disc, faces, sizeof *t->in_disc);
    qm_context_free(t->ctx, t->seen, faces, sizeof *t->seen);
    qm_context_free(t->ctx, t->label, faces, sizeof *t->label);
    qm_context_free(t->ctx, t->before, faces, sizeof *t->before);
    qm_context_free(t->ctx, t->disc, faces, sizeof *t->disc);
    qm_context_free(t->ctx, t->cost, faces, sizeof *t->cost);
    qm_context_free(t->ctx, t->number, vertices, sizeof *t->number);
    qm_context_free(t->ctx, t->number_stamp, vertices, sizeof *t->number_stamp);
    qm_context_free(t->ctx, t->first, t->surface_faces + 1, sizeof *t->first);
    qm_trimesh_reset(t->ctx, &t->mesh);
    qm_heap_reset(t->ctx, &t->heap);
    *t = (qm_tmesh_triangles){0};
}

static void triangle_corners(const qm_tmesh_triangles *t, uint32_t triangle, qm_vec out[3])
{
    for (uint32_t k = 0; k < 3; k++)
        out[k] = t->mesh.position[t->mesh.from[3 * triangle + k]];
}

/** Weights of the corners of a triangle at the foot of a point on its plane; false if it has no area. */
static bool find_weights(const qm_vec corner[3], qm_vec p, double weight[3])
{
    qm_vec a = qm_vec_sub(corner[1], corner[0]), b = qm_vec_sub(corner[2], corner[0]),
           to = qm_vec_sub(p, corner[0]), normal = qm_vec_cross(a, b);
    double area2 = qm_vec_norm2(normal);
    if (!(area2 > 0)) return false;
    weight[1] = qm_vec_dot(qm_vec_cross(to, b), normal) / area2;
    weight[2] = qm_vec_dot(qm_vec_cross(a, to), normal) / area2;
    weight[0] = 1 - weight[1] - weight[2];
    return isfinite(weight[0]);
}

bool qm_tmesh_triangles_find(const qm_tmesh_triangles *t, qm_vec point, qm_tmesh_spot *spot)
{
    double p[3], near[3], best = -INFINITY;
    uint32_t face;
    qm_vec_store(p, point);
    const qm_projection out = {.position = near, .face = &face};
    if (qm_project_points(t->ctx, t->surface->bvh, QM_QUADS_TRIANGLES, p, 1, 1, &out) != QM_OK) return false;
    for (uint32_t i = t->first[face]; i < t->first[face + 1]; i++) {
        qm_vec corner[3];
        double weight[3];
        triangle_corners(t, i, corner);
        if (!find_weights(corner, qm_vec_load(near), weight)) continue;
        double least = fmin(weight[0], fmin(weight[1], weight[2]));
        if (least <= best) continue;
        best = least;
        spot->triangle = i;
        memcpy(spot->weight, weight, sizeof weight);
    }
    double sum = 0;
    for (int k = 0; k < 3 && best > -INFINITY; k++)
        sum += spot->weight[k] = fmax(0, spot->weight[k]);
    for (int k = 0; k < 3 && best > -INFINITY; k++)
        spot->weight[k] /= sum;
    return best > -INFINITY;
}

/* ---- the disc ---- */

typedef struct chart_maker {
    qm_arena *arena;
    qm_tmesh_triangles *t;
    size_t most;
    uint32_t disc; /* the stamp of its triangles */
    uint32_t *triangle;
    size_t count;
    bool no_memory, is_full;
} chart_maker;

static void add_triangle(chart_maker *maker, uint32_t triangle)
{
    if (maker->t->in_disc[triangle] == maker->disc) return;
    if (maker->count == maker->most) {
        maker->is_full = true;
        return;
    }
    maker->t->in_disc[triangle] = maker->disc;
    maker->triangle[maker->count++] = triangle;
}

static uint32_t beyond(const qm_tmesh_triangles *t, uint32_t triangle, uint32_t side)
{
    uint32_t twin = t->mesh.twin[3 * triangle + side];
    return twin == QM_NO_INDEX ? QM_NO_INDEX : twin / 3;
}

static qm_vec middle_of(const qm_tmesh_triangles *t, uint32_t triangle)
{
    qm_vec corner[3];
    triangle_corners(t, triangle, corner);
    return qm_vec_centroid(corner, 3);
}

static qm_vec spot_at(const qm_tmesh_triangles *t, const qm_tmesh_spot *spot)
{
    qm_vec corner[3], sum = {0};
    triangle_corners(t, spot->triangle, corner);
    for (int k = 0; k < 3; k++)
        sum = qm_vec_axpy(sum, spot->weight[k], corner[k]);
    return sum;
}

static void reach_triangle(chart_maker *maker, uint32_t triangle, double cost, uint32_t before)
{
    qm_tmesh_triangles *t = maker->t;
    if (t->seen[triangle] == t->stamp && t->cost[triangle] <= cost) return;
    t->seen[triangle] = t->stamp;
    t->cost[triangle] = cost;
    t->before[triangle] = before;
    if (qm_heap_push(t->ctx, &t->heap, (qm_heap_item){cost, triangle, 0}) != QM_OK) maker->no_memory = true;
}

/** Adds the triangles of a short path between two places. False if there is none. */
static bool add_path(chart_maker *maker, const qm_tmesh_spot *from, const qm_tmesh_spot *to)
{
    qm_tmesh_triangles *t = maker->t;
    qm_vec start = spot_at(t, from), end = spot_at(t, to), corner[3];
    triangle_corners(t, from->triangle, corner);
    double sides = qm_vec_distance(corner[0], corner[1]) + qm_vec_distance(corner[1], corner[2]);
    triangle_corners(t, to->triangle, corner);
    sides += qm_vec_distance(corner[0], corner[1]) + qm_vec_distance(corner[1], corner[2]);
    double most = REACH_TIMES * (qm_vec_distance(start, end) + sides);
    t->stamp++;
    t->heap.count = 0;
    reach_triangle(maker, from->triangle, 0, from->triangle);
    while (t->heap.count > 0 && !maker->no_memory) {
        qm_heap_item item = qm_heap_pop(&t->heap);
        if (item.key > t->cost[item.number]) continue;
        if (item.number == to->triangle) {
            for (uint32_t at = to->triangle;; at = t->before[at]) {
                add_triangle(maker, at);
                if (at == from->triangle) return true;
            }
        }
        qm_vec here = item.number == from->triangle ? start : middle_of(t, item.number);
        for (uint32_t k = 0; k < 3; k++) {
            uint32_t next = beyond(t, item.number, k);
            if (next == QM_NO_INDEX) continue;
            double cost = item.key + qm_vec_distance(here, next == to->triangle ? end : middle_of(t, next));
            if (cost <= most) reach_triangle(maker, next, cost, item.number);
        }
    }
    return false;
}

/** Adds all triangles at a vertex. */
static void add_fan(chart_maker *maker, uint32_t vertex)
{
    const qm_trimesh *m = &maker->t->mesh;
    uint32_t first = qm_trimesh_first(m, vertex), h = first;
    do {
        add_triangle(maker, h / 3);
        h = qm_trimesh_around(m, h);
    } while (h != QM_NO_INDEX && h != first);
}

/** Adds a ring of triangles round those from a number on, which the last ring has added: returns that of the next one. */
static size_t widen(chart_maker *maker, size_t begin)
{
    qm_tmesh_triangles *t = maker->t;
    size_t end = maker->count;
    t->stamp++;
    for (size_t i = begin; i < end; i++)
        for (uint32_t k = 0; k < 3; k++) {
            uint32_t vertex = t->mesh.from[3 * maker->triangle[i] + k];
            if (t->number_stamp[vertex] == t->stamp) continue;
            t->number_stamp[vertex] = t->stamp;
            add_fan(maker, vertex);
        }
    return end;
}

/** Floods the part outside the disc that a triangle is in: its size, or limit + 1. */
static size_t flood(chart_maker *maker, uint32_t first, uint32_t label, size_t limit, bool *meets_outside,
                    uint32_t outside)
{
    qm_tmesh_triangles *t = maker->t;
    size_t count = 0;
    uint32_t tail = first; /* a queue, as a list through before */
    t->seen[first] = t->stamp;
    t->label[first] = label;
    t->before[first] = QM_NO_INDEX;
    for (uint32_t at = first; at != QM_NO_INDEX; at = t->before[at]) {
        if (++count > limit) return count;
        for (uint32_t k = 0; k < 3; k++) {
            uint32_t next = beyond(t, at, k);
            if (next == QM_NO_INDEX || t->in_disc[next] == maker->disc) continue;
            if (t->seen[next] == t->stamp) {
                *meets_outside |= outside != QM_NO_INDEX && t->label[next] == outside;
                continue;
            }
            t->seen[next] = t->stamp;
            t->label[next] = label;
            t->before[next] = QM_NO_INDEX;
            t->before[tail] = next;
            tail = next;
        }
    }
    return count;
}

static void add_part(chart_maker *maker, uint32_t first)
{
    size_t at = maker->count;
    add_triangle(maker, first);
    for (; at < maker->count && !maker->is_full; at++)
        for (uint32_t k = 0; k < 3; k++) {
            uint32_t next = beyond(maker->t, maker->triangle[at], k);
            if (next != QM_NO_INDEX) add_triangle(maker, next);
        }
}

/** Adds what the disc encloses: the parts outside it but for the largest. */
static void fill(chart_maker *maker)
{
    qm_tmesh_triangles *t = maker->t;
    uint32_t outside = QM_NO_INDEX, largest = QM_NO_INDEX, label = 0;
    size_t largest_size = 0, end = maker->count;
    size_t limit = maker->most; /* what is larger is not enclosed */
    uint32_t *first = qm_arena_alloc(maker->arena, 3 * end, sizeof *first);
    size_t part_count = 0;
    if (!first) {
        maker->no_memory = true;
        return;
    }
    t->stamp++;
    for (size_t i = 0; i < end; i++)
        for (uint32_t k = 0; k < 3; k++) {
            uint32_t next = beyond(t, maker->triangle[i], k);
            if (next == QM_NO_INDEX || t->in_disc[next] == maker->disc || t->seen[next] == t->stamp) continue;
            bool meets_outside = false;
            size_t size = flood(maker, next, label, limit, &meets_outside, outside);
            bool is_outside = meets_outside || size > limit;
            if (is_outside) outside = outside == QM_NO_INDEX ? label : outside;
            if (!is_outside) {
                if (size > largest_size) largest_size = size, largest = (uint32_t)part_count;
                first[part_count++] = next;
            }
            label++;
        }
    for (size_t i = 0; i < part_count && !maker->is_full; i++)
        if (outside != QM_NO_INDEX || i != largest) add_part(maker, first[i]);
}

/** Finds the triangles of the disc. False if there is none. */
static bool find_disc(chart_maker *maker, const qm_tmesh_spot *line, size_t count, double margin)
{
    for (size_t i = 0; i < count; i++)
        if (!add_path(maker, &line[i], &line[(i + 1) % count])) return false;
    if (!maker->is_full) fill(maker);
    double rings = ceil(margin * sqrt((double)maker->count));
    size_t begin = 0;
    for (int ring = 0; ring < rings && !maker->is_full; ring++)
        begin = widen(maker, begin);
    if (!maker->is_full && rings > 0) fill(maker);
    return !maker->is_full && !maker->no_memory;
}

/* ---- vertices and boundary ---- */

static int compare_indices(const void *a, const void *b)
{
    uint32_t one = *(const uint32_t *)a, other = *(const uint32_t *)b;
    return (one > other) - (one < other);
}

static uint32_t place_of(const uint32_t *sorted, size_t count, uint32_t wanted)
{
    size_t low = 0, high = count;
    while (low < high) {
        size_t middle = (low + high) / 2;
        if (sorted[middle] < wanted)
            low = middle + 1;
        else
            high = middle;
    }
    return low < count && sorted[low] == wanted ? (uint32_t)low : QM_NO_INDEX;
}

static bool number_vertices(chart_maker *maker, qm_tmesh_chart *out)
{
    qm_tmesh_triangles *t = maker->t;
    size_t count = maker->count;
    qsort(maker->triangle, count, sizeof *maker->triangle, compare_indices);
    *out = (qm_tmesh_chart){.triangle_count = count};
    out->triangle = qm_arena_alloc(maker->arena, count, sizeof *out->triangle);
    out->corner = qm_arena_alloc(maker->arena, count, sizeof *out->corner);
    out->twin = qm_arena_alloc(maker->arena, 3 * count, sizeof *out->twin);
    out->at = qm_arena_alloc(maker->arena, 3 * count, sizeof *out->at);
    out->flat = qm_arena_alloc(maker->arena, 3 * count, sizeof *out->flat);
    if (!out->triangle || !out->corner || !out->twin || !out->at || !out->flat) return false;
    memcpy(out->triangle, maker->triangle, count * sizeof *out->triangle);
    t->stamp++;
    for (size_t i = 0; i < count; i++)
        for (uint32_t k = 0; k < 3; k++) {
            uint32_t vertex = t->mesh.from[3 * maker->triangle[i] + k];
            if (t->number_stamp[vertex] != t->stamp) {
                t->number_stamp[vertex] = t->stamp;
                out->at[out->vertex_count] = t->mesh.position[vertex];
                t->number[vertex] = (uint32_t)out->vertex_count++;
            }
            out->corner[i][k] = t->number[vertex];
            uint32_t next = beyond(t, maker->triangle[i], k);
            out->twin[3 * i + k] = next == QM_NO_INDEX || t->in_disc[next] != maker->disc
                                       ? QM_NO_INDEX
                                       : place_of(maker->triangle, count, next);
        }
    return true;
}

/** Follows the boundary of a disc. Its number of vertices; 0 if the triangles are none; *pinch is a vertex at which it touches
 * itself. */
static size_t follow_boundary(const qm_tmesh_chart *chart, uint32_t *next, uint32_t *ring, uint32_t *pinch)
{
    size_t sides = 0, inner = 0;
    uint32_t start = QM_NO_INDEX;
    *pinch = QM_NO_INDEX;
    memset(next, 0xff, chart->vertex_count * sizeof *next);
    for (size_t i = 0; i < chart->triangle_count; i++)
        for (uint32_t k = 0; k < 3; k++) {
            inner += chart->twin[3 * i + k] != QM_NO_INDEX;
            if (chart->twin[3 * i + k] != QM_NO_INDEX) continue;
            uint32_t from = chart->corner[i][k];
            if (next[from] != QM_NO_INDEX) *pinch = from;
            next[from] = chart->corner[i][(k + 1) % 3];
            start = from;
            sides++;
        }
    if (sides == 0 || *pinch != QM_NO_INDEX) return 0;
    size_t count = 0;
    for (uint32_t at = start; count == 0 || (at != start && count < sides); at = next[at])
        ring[count++] = at;
    bool is_disc = chart->vertex_count + chart->triangle_count == sides + inner / 2 + 1;
    return count == sides && is_disc ? count : 0;
}

/* ---- the map ---- */

/** The equations: for each inner vertex the sum of weight * (its point - a neighbour's) is 0. */
typedef struct flat_system {
    size_t count; /* vertices */
    uint32_t *start, *link;
    double *weight, *diagonal;
    const bool *is_fixed;
} flat_system;

static double weight_between(double weight, double least)
{
    return weight > least ? fmin(weight, 1 / least) : least;
}

/** Half of the cotangent of the angle opposite a side, with which the map is as conformal as it can be. */
static double opposite_weight(const qm_tmesh_chart *chart, size_t triangle, uint32_t side)
{
    const uint32_t *c = chart->corner[triangle];
    qm_vec a = qm_vec_sub(chart->at[c[side]], chart->at[c[(side + 2) % 3]]),
           b = qm_vec_sub(chart->at[c[(side + 1) % 3]], chart->at[c[(side + 2) % 3]]);
    double sine = qm_vec_norm(qm_vec_cross(a, b));
    return 0.5 * qm_vec_dot(a, b) / sine;
}

/** Adds up the weights of a side from both of its triangles. Where these are flat, such a map is flat as well, if no weight is below the least. */
static void merge_links(flat_system *s, double least)
{
    uint32_t kept = 0;
    for (size_t v = 0; v < s->count; v++) {
        uint32_t first = kept, from = s->start[v], end = s->start[v + 1];
        s->start[v] = first;
        for (uint32_t i = from; i < end; i++) {
            uint32_t k = first;
            while (k < kept && s->link[k] != s->link[i])
                k++;
            double weight = s->weight[i] + (k < kept ? s->weight[k] : 0);
            s->link[k] = s->link[i];
            s->weight[k] = weight;
            kept += k == kept;
        }
        s->diagonal[v] = 0;
        for (uint32_t k = first; k < kept; k++) {
            s->weight[k] = weight_between(s->weight[k], least);
            s->diagonal[v] += s->weight[k];
        }
    }
    s->start[s->count] = kept;
}

/** least: of a weight; merged: of the sum of both triangles, else of each of them. */
static bool make_system(qm_arena *arena, const qm_tmesh_chart *chart, const bool *is_fixed, double least,
                        bool is_merged, flat_system *out)
{
    size_t n = chart->vertex_count;
    *out = (flat_system){.count = n, .is_fixed = is_fixed};
    out->start = qm_arena_zeroed(arena, n + 2, sizeof *out->start);
    out->link = qm_arena_alloc(arena, 6 * chart->triangle_count, sizeof *out->link);
    out->weight = qm_arena_alloc(arena, 6 * chart->triangle_count, sizeof *out->weight);
    out->diagonal = qm_arena_zeroed(arena, n, sizeof *out->diagonal);
    if (!out->start || !out->link || !out->weight || !out->diagonal) return false;
    for (int pass = 0; pass < 2; pass++) {
        for (size_t i = 0; i < chart->triangle_count; i++)
            for (uint32_t k = 0; k < 3;
                 k++) { /* the sides from each vertex, of both triangles: alike for all */
                uint32_t a = chart->corner[i][k], b = chart->corner[i][(k + 1) % 3];
                if (pass == 0) {
                    out->start[a + 2]++;
                    out->start[b + 2]++;
                    continue;
                }
                double weight = opposite_weight(chart, i, k);
                weight = is_merged ? qm_clamp(isnan(weight) ? 0 : weight, -1 / least, 1 / least)
                                   : weight_between(weight, least);
                out->weight[out->start[a + 1]] = out->weight[out->start[b + 1]] = weight;
                out->link[out->start[a + 1]++] = b;
                out->link[out->start[b + 1]++] = a;
                out->diagonal[a] += weight;
                out->diagonal[b] += weight;
            }
        for (size_t v = 0; v < n && pass == 0; v++)
            out->start[v + 2] += out->start[v + 1];
    }
    if (is_merged) merge_links(out, least);
    return true;
}

/** out = A x, with rows of fixed vertices 0. */
static void apply(const flat_system *s, const qm_tmesh_flat *x, qm_tmesh_flat *out)
{
    for (size_t v = 0; v < s->count; v++) {
        qm_tmesh_flat sum = {s->diagonal[v] * x[v].u, s->diagonal[v] * x[v].v};
        for (uint32_t i = s->start[v]; i < s->start[v + 1]; i++) {
            sum.u -= s->weight[i] * x[s->link[i]].u;
            sum.v -= s->weight[i] * x[s->link[i]].v;
        }
        out[v] = s->is_fixed[v] ? (qm_tmesh_flat){0, 0} : sum;
    }
}

/** Solves the equations by conjugate gradients with the diagonal as preconditioner (Hestenes, Stiefel 1952), u and v together. */
static bool solve(qm_arena *arena, const flat_system *s, double tolerance, qm_tmesh_flat *x)
{
    qm_tmesh_flat *r = qm_arena_alloc(arena, s->count, sizeof *r);
    qm_tmesh_flat *p = qm_arena_alloc(arena, s->count, sizeof *p);
    qm_tmesh_flat *q = qm_arena_alloc(arena, s->count, sizeof *q);
    if (!r || !p || !q) return false;
    apply(s, x, r);
    double rho = 0, first = 0;
    for (size_t v = 0; v < s->count; v++) {
        r[v] = (qm_tmesh_flat){-r[v].u, -r[v].v};
        p[v] = (qm_tmesh_flat){r[v].u / s->diagonal[v], r[v].v / s->diagonal[v]};
        rho += r[v].u * p[v].u + r[v].v * p[v].v;
    }
    first = rho;
    for (int step = 0; step < MOST_STEPS && rho > tolerance * tolerance * first; step++) {
        apply(s, p, q);
        double slope = 0;
        for (size_t v = 0; v < s->count; v++)
            slope += p[v].u * q[v].u + p[v].v * q[v].v;
        if (!(slope > 0)) break;
        double by = rho / slope, before = rho;
        rho = 0;
        for (size_t v = 0; v < s->count; v++) {
            x[v].u += by * p[v].u;
            x[v].v += by * p[v].v;
            r[v].u -= by * q[v].u;
            r[v].v -= by * q[v].v;
            rho += (r[v].u * r[v].u + r[v].v * r[v].v) / s->diagonal[v];
        }
        for (size_t v = 0; v < s->count; v++) {
            p[v].u = r[v].u / s->diagonal[v] + rho / before * p[v].u;
            p[v].v = r[v].v / s->diagonal[v] + rho / before * p[v].v;
        }
    }
    return true;
}

static void place_boundary(qm_tmesh_chart *chart, const uint32_t *ring, size_t count, bool *is_fixed)
{
    double length = 0, at = 0;
    for (size_t i = 0; i < count; i++)
        length += qm_vec_distance(chart->at[ring[i]], chart->at[ring[(i + 1) % count]]);
    for (size_t i = 0; i < count; i++) {
        double angle = 360.0 * QM_DEGREE * at / length;
        chart->flat[ring[i]] = (qm_tmesh_flat){cos(angle), sin(angle)};
        is_fixed[ring[i]] = true;
        at += qm_vec_distance(chart->at[ring[i]], chart->at[ring[(i + 1) % count]]);
    }
}

static bool is_unfolded(const qm_tmesh_chart *chart)
{
    for (size_t i = 0; i < chart->triangle_count; i++) {
        const uint32_t *c = chart->corner[i];
        if (!(qm_tmesh_flat_area(chart->flat[c[0]], chart->flat[c[1]], chart->flat[c[2]]) > 0)) return false;
    }
    return true;
}

bool qm_tmesh_chart_flatten(qm_arena *arena, qm_tmesh_chart *chart, const bool *is_fixed, bool *is_made)
{
    flat_system system;
    *is_made = false;
    if (!make_system(arena, chart, is_fixed, LEAST_WEIGHT, false, &system) ||
        !solve(arena, &system, TOLERANCE, chart->flat))
        return false;
    *is_made = is_unfolded(chart);
    return true;
}

/** The stretch of each vertex, the root of the mean over its triangles of the squared lengths that a step of the plane has on the surface;
 * returns the mean square of all. */
static double measure_stretch(const qm_tmesh_chart *chart, qm_tmesh_flat size, double *area, double *stretch)
{
    double sum = 0, all = 0;
    memset(area, 0, chart->vertex_count * sizeof *area);
    memset(stretch, 0, chart->vertex_count * sizeof *stretch);
    for (size_t i = 0; i < chart->triangle_count; i++) {
        const uint32_t *c = chart->corner[i];
        qm_vec along_u = {0}, along_v = {0};
        double flat = qm_tmesh_flat_area(chart->flat[c[0]], chart->flat[c[1]], chart->flat[c[2]]);
        for (int k = 0; k < 3; k++) {
            qm_tmesh_flat a = chart->flat[c[(k + 1) % 3]], b = chart->flat[c[(k + 2) % 3]];
            along_u = qm_vec_axpy(along_u, (a.v - b.v) / (flat * size.u), chart->at[c[k]]);
            along_v = qm_vec_axpy(along_v, (b.u - a.u) / (flat * size.v), chart->at[c[k]]);
        }
        double half = qm_vec_norm(qm_vec_cross(qm_vec_sub(chart->at[c[1]], chart->at[c[0]]),
                                               qm_vec_sub(chart->at[c[2]], chart->at[c[0]]))),
               square = half * 0.5 * (qm_vec_norm2(along_u) + qm_vec_norm2(along_v));
        sum += square;
        all += half;
        for (int k = 0; k < 3; k++) {
            area[c[k]] += half;
            stretch[c[k]] += square;
        }
    }
    for (size_t v = 0; v < chart->vertex_count; v++)
        stretch[v] = area[v] > 0 && stretch[v] > 0 ? sqrt(stretch[v] / area[v]) : 1;
    return all > 0 ? sum / all : 0;
}

/** Divides the weights by the stretch at both ends of their edges. */
static void divide_weights(flat_system *s, const double *stretch)
{
    for (size_t v = 0; v < s->count; v++) {
        s->diagonal[v] = 0;
        for (uint32_t i = s->start[v]; i < s->start[v + 1]; i++) {
            s->weight[i] *= 2 / (stretch[v] + stretch[s->link[i]]);
            s->diagonal[v] += s->weight[i];
        }
    }
}

/** Spreads the inner vertices of a chart that does not fold. */
static bool spread(qm_arena *arena, qm_tmesh_chart *chart, qm_tmesh_flat size, flat_system *system)
{
    double *area = qm_arena_alloc(arena, chart->vertex_count, sizeof *area),
           *stretch = qm_arena_alloc(arena, chart->vertex_count, sizeof *stretch);
    qm_tmesh_flat *best = qm_arena_alloc(arena, chart->vertex_count, sizeof *best);
    if (!area || !stretch || !best) return false;
    double least = measure_stretch(chart, size, area, stretch);
    memcpy(best, chart->flat, chart->vertex_count * sizeof *best);
    for (int round = 0; round < SPREADS; round++) {
        divide_weights(system, stretch);
        if (!solve(arena, system, SPREAD_TOLERANCE, chart->flat)) return false;
        double now = is_unfolded(chart) ? measure_stretch(chart, size, area, stretch) : INFINITY;
        if (!(now < SPREAD_FALL * least)) break;
        least = now;
        memcpy(best, chart->flat, chart->vertex_count * sizeof *best);
    }
    memcpy(chart->flat, best, chart->vertex_count * sizeof *best);
    return true;
}

bool qm_tmesh_chart_spread(qm_arena *arena, qm_tmesh_chart *chart, const bool *is_fixed, qm_tmesh_flat size)
{
    flat_system system;
    if (!make_system(arena, chart, is_fixed, LEAST_MERGED, true, &system) ||
        !solve(arena, &system, TOLERANCE, chart->flat))
        return false;
    if (is_unfolded(chart)) return spread(arena, chart, size, &system);
    bool is_made;
    if (!qm_tmesh_chart_flatten(arena, chart, is_fixed, &is_made)) return false;
    if (!is_made) return true;
    return make_system(arena, chart, is_fixed, LEAST_WEIGHT, false, &system) &&
           spread(arena, chart, size, &system);
}

/** Makes the chart of the triangles. False when out of memory; *is_made is false when they are no disc. */
static bool flatten(chart_maker *maker, qm_tmesh_chart *out, bool *is_made)
{
    uint32_t *ring = NULL;
    size_t count = 0;
    for (int mend = 0; mend < MENDS && count == 0; mend++) {
        uint32_t pinch;
        if (!number_vertices(maker, out)) return false;
        uint32_t *next = qm_arena_alloc(maker->arena, out->vertex_count, sizeof *next);
        ring = qm_arena_alloc(maker->arena, 3 * out->triangle_count, sizeof *ring);
        if (!next || !ring) return false;
        count = follow_boundary(out, next, ring, &pinch);
        if (count > 0) break;
        if (pinch == QM_NO_INDEX) return true;
        for (size_t i = 0, end = maker->count; i < end && !maker->is_full; i++)
            for (uint32_t k = 0; k < 3; k++)
                if (out->corner[i][k] == pinch)
                    add_fan(maker, maker->t->mesh.from[3 * maker->triangle[i] + k]);
        if (!maker->is_full) fill(maker);
        if (maker->is_full || maker->no_memory) return !maker->no_memory;
    }
    if (count == 0) return true;
    bool *is_fixed = qm_arena_zeroed(maker->arena, out->vertex_count, sizeof *is_fixed);
    if (!is_fixed) return false;
    memset(out->flat, 0, out->vertex_count * sizeof *out->flat);
    place_boundary(out, ring, count, is_fixed);
    return qm_tmesh_chart_flatten(maker->arena, out, is_fixed, is_made);
}

qm_status qm_tmesh_chart_make(qm_arena *arena, qm_tmesh_triangles *t, const qm_tmesh_spot *line, size_t count,
                              size_t most, qm_tmesh_chart *out, bool *is_made)
{
    *is_made = false;
    if (qm_context_canceled(t->ctx)) return qm_context_fail(t->ctx, QM_E_CANCELED, "canceled");
    bool has_memory = true;
    for (int k = 0; k < 3 && has_memory && !*is_made; k++) {
        chart_maker maker = {.arena = arena, .t = t, .most = most, .disc = ++t->stamp, .triangle = t->disc};
        if (find_disc(&maker, line, count, margins[k])) has_memory = flatten(&maker, out, is_made);
        has_memory = has_memory && !maker.no_memory;
    }
    if (has_memory) return QM_OK;
    return qm_context_fail(t->ctx, QM_E_NO_MEMORY, "out of memory for a chart of %zu triangles", most);
}

/* ---- between the surface and the plane ---- */

bool qm_tmesh_chart_place(const qm_tmesh_chart *chart, const qm_tmesh_spot *spot, qm_tmesh_flat *flat,
                          uint32_t *triangle)
{
    *triangle = place_of(chart->triangle, chart->triangle_count, spot->triangle);
    if (*triangle == QM_NO_INDEX) return false;
    *flat = (qm_tmesh_flat){0, 0};
    for (int k = 0; k < 3; k++) {
        flat->u += spot->weight[k] * chart->flat[chart->corner[*triangle][k]].u;
        flat->v += spot->weight[k] * chart->flat[chart->corner[*triangle][k]].v;
    }
    return true;
}

static void flat_weights(const qm_tmesh_chart *chart, uint32_t triangle, qm_tmesh_flat p, double weight[3])
{
    const uint32_t *c = chart->corner[triangle];
    qm_tmesh_flat at[3] = {chart->flat[c[0]], chart->flat[c[1]], chart->flat[c[2]]};
    double area = qm_tmesh_flat_area(at[0], at[1], at[2]);
    for (int k = 0; k < 3; k++)
        weight[k] = qm_tmesh_flat_area(p, at[(k + 1) % 3], at[(k + 2) % 3]) / area;
}

static qm_vec lift_in(const qm_tmesh_chart *chart, uint32_t triangle, const double weight[3])
{
    qm_vec sum = {0};
    for (int k = 0; k < 3; k++)
        sum = qm_vec_axpy(sum, weight[k], chart->at[chart->corner[triangle][k]]);
    return sum;
}

bool qm_tmesh_chart_lift(const qm_tmesh_chart *chart, qm_tmesh_flat flat, uint32_t *triangle, qm_vec *at)
{
    const double rounding = 1e-9;
    double weight[3];
    /* A walk towards the point, which may go round in circles; then all triangles are looked at. */
    for (size_t step = 0; step < 2 * chart->triangle_count; step++) {
        flat_weights(chart, *triangle, flat, weight);
        uint32_t least = weight[0] < weight[1] ? 0 : 1;
        if (weight[2] < weight[least]) least = 2;
        if (weight[least] >= -rounding) {
            *at = lift_in(chart, *triangle, weight);
            return true;
        }
        uint32_t next = chart->twin[3 * *triangle + (least + 1) % 3];
        if (next == QM_NO_INDEX) break;
        *triangle = next;
    }
    for (uint32_t i = 0; i < chart->triangle_count; i++) {
        flat_weights(chart, i, flat, weight);
        if (!(weight[0] >= -rounding && weight[1] >= -rounding && weight[2] >= -rounding)) continue;
        *triangle = i;
        *at = lift_in(chart, i, weight);
        return true;
    }
    return false;
}

qm_tmesh_flat qm_tmesh_chart_move(const qm_tmesh_chart *chart, uint32_t triangle, qm_vec by)
{
    const uint32_t *c = chart->corner[triangle];
    qm_vec corner[3] = {chart->at[c[0]], chart->at[c[1]], chart->at[c[2]]};
    double weight[3];
    if (!find_weights(corner, qm_vec_add(corner[0], by), weight)) return (qm_tmesh_flat){0, 0};
    qm_tmesh_flat sum = {0, 0};
    for (int k = 1; k < 3; k++) {
        sum.u += weight[k] * (chart->flat[c[k]].u - chart->flat[c[0]].u);
        sum.v += weight[k] * (chart->flat[c[k]].v - chart->flat[c[0]].v);
    }
    return sum;
}

qm_vec qm_tmesh_chart_normal(const qm_tmesh_chart *chart, uint32_t triangle)
{
    const uint32_t *c = chart->corner[triangle];
    qm_vec normal = qm_vec_cross(qm_vec_sub(chart->at[c[1]], chart->at[c[0]]),
                                 qm_vec_sub(chart->at[c[2]], chart->at[c[0]]));
    double length = qm_vec_norm(normal);
    return length > 0 ? qm_vec_scale(1 / length, normal) : normal;
}
