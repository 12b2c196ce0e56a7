/**
 * tmesh_route_mesh.c: the mesh that curves are laid in, and the nodes in it.
 */
#include "tmesh/tmesh_router.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define ON_CORNER 1e-6     /* of a weight: a node this near a corner or a side of a triangle is on it */
#define INSIDE 1e-3        /* of a weight: how far a node stays off a boundary that it is not on */
#define FINE 0.5           /* of the median curve: triangles are made no larger, */
#define MOST_TIMES 4       /* if there are no more than so many times as many, */
#define MOST_BESIDES 20000 /* and so many besides */
#define REFINES 12
#define MOST_GROWTH 12    /* times as many triangles as the surface has, */
#define MOST_GROWN 100000 /* and so many besides: paths that wind round each other grow without end */

bool qm_router_reserve(qm_router *r)
{
    if (r->m.face_count <= r->capacity) return true;
    size_t capacity = r->m.face_count + r->m.face_count / 2 + 64;
    r->cost = qm_arena_alloc(r->arena, capacity, sizeof *r->cost);
    r->back = qm_arena_alloc(r->arena, capacity, sizeof *r->back);
    r->local = qm_arena_alloc(r->arena, capacity, sizeof *r->local);
    r->queue = qm_arena_alloc(r->arena, capacity, sizeof *r->queue);
    r->stamp = qm_arena_zeroed(r->arena, capacity, sizeof *r->stamp);
    r->stamp_value = 0;
    r->capacity = capacity;
    return r->cost && r->back && r->local && r->queue && r->stamp;
}

bool qm_router_split_edge(qm_router *r, uint32_t h, qm_vec at, uint32_t *vertex)
{
    uint32_t twin = r->m.twin[h];
    if (qm_trimesh_split(r->ctx, &r->m, h, at, vertex) != QM_OK) return false;
    r->m.step[qm_trimesh_next(h)][0] = 0;
    if (twin != QM_NO_INDEX) r->m.step[qm_trimesh_next(twin)][0] = 0;
    return true;
}

bool qm_router_split_face(qm_router *r, uint32_t face, qm_vec at, uint32_t *vertex)
{
    const uint32_t part[3] = {face, (uint32_t)r->m.face_count, (uint32_t)r->m.face_count + 1};
    uint32_t old[3];
    for (uint32_t k = 0; k < 3; k++)
        old[k] = qm_router_label(r, 3 * face + k);
    if (qm_trimesh_split_face(r->ctx, &r->m, face, vertex) != QM_OK) return false;
    r->m.position[*vertex] = at;
    for (uint32_t k = 0; k < 3; k++)
        r->m.step[3 * part[k]][0] = (int32_t)old[k];
    return true;
}

uint32_t qm_router_opposite_edge(const qm_router *r, uint32_t vertex, uint32_t u, uint32_t w)
{
    uint32_t first = qm_trimesh_first(&r->m, vertex), h = first;
    do {
        uint32_t next = qm_trimesh_next(h), a = r->m.from[next], b = qm_trimesh_to(&r->m, next);
        if ((a == u && b == w) || (a == w && b == u)) return next;
        h = qm_trimesh_around(&r->m, h);
    } while (h != QM_NO_INDEX && h != first);
    return QM_NO_INDEX;
}

uint32_t qm_router_edge_between(const qm_router *r, uint32_t a, uint32_t b)
{
    uint32_t first = qm_trimesh_first(&r->m, a), h = first;
    do {
        if (qm_trimesh_to(&r->m, h) == b) return h;
        if (r->m.from[qm_trimesh_prev(h)] == b) return qm_trimesh_prev(h);
        h = qm_trimesh_around(&r->m, h);
    } while (h != QM_NO_INDEX && h != first);
    return QM_NO_INDEX;
}

uint32_t qm_router_labelled_edge(const qm_router *r, uint32_t vertex, uint32_t curve)
{
    uint32_t first = qm_trimesh_first(&r->m, vertex), h = first;
    do {
        if (qm_router_label(r, h) == curve + 1) return h;
        h = qm_trimesh_around(&r->m, h);
    } while (h != QM_NO_INDEX && h != first);
    return QM_NO_INDEX;
}

/* ---- nodes ---- */

static double weight_in(const qm_router *r, uint32_t face, qm_vec at, int k)
{
    const uint32_t *c = r->m.from + 3 * (size_t)face;
    qm_vec normal = qm_trimesh_normal(&r->m, face), a = r->m.position[c[(k + 1) % 3]],
           b = r->m.position[c[(k + 2) % 3]];
    double area2 = qm_vec_norm2(normal);
    if (!(area2 > 0)) return 1.0 / 3;
    return qm_vec_dot(qm_vec_cross(qm_vec_sub(a, at), qm_vec_sub(b, at)), normal) / area2;
}

bool qm_router_take_vertex(qm_router *r, uint32_t node, uint32_t vertex)
{
    if (r->at_vertex[vertex] != QM_NO_INDEX) return false;
    r->at_vertex[vertex] = node;
    r->vertex[node] = vertex;
    return true;
}

/** Puts a node into the triangle that it is in, of the parts that nodes before have left of it. */
static bool place_node(qm_router *r, uint32_t node, const qm_tmesh_spot *spot)
{
    uint32_t face = spot->triangle, vertex;
    qm_vec at = {0};
    for (int k = 0; k < 3; k++)
        at = qm_vec_axpy(
            at, spot->weight[k],
            r->triangles->mesh.position[r->triangles->mesh.from[3 * spot->triangle + (uint32_t)k]]);
    double weight[3];
    for (size_t step = 0;; step++) {
        int least = 0;
        for (int k = 0; k < 3; k++) {
            weight[k] = weight_in(r, face, at, k);
            if (weight[k] < weight[least]) least = k;
        }
        uint32_t beyond = r->m.twin[3 * face + (uint32_t)(least + 1) % 3];
        if (weight[least] >= -ON_CORNER || beyond == QM_NO_INDEX || step > r->m.face_count) break;
        face = beyond / 3;
    }
    uint32_t low = 0, high = 0;
    double sum = 0;
    for (uint32_t k = 0; k < 3; k++) {
        if (weight[k] < weight[low]) low = k;
        if (weight[k] > weight[high]) high = k;
    }
    vertex = r->m.from[3 * face + high];
    bool is_inner = r->m.twin[qm_trimesh_first(&r->m, vertex)] != QM_NO_INDEX;
    if (weight[high] > 1 - ON_CORNER && is_inner && qm_router_take_vertex(r, node, vertex)) return true;
    uint32_t side = 3 * face + (low + 1) % 3;
    if (weight[low] < ON_CORNER && r->m.twin[side] != QM_NO_INDEX) {
        double a = fmax(weight[(low + 1) % 3], INSIDE), b = fmax(weight[(low + 2) % 3], INSIDE);
        at = qm_vec_mix(r->m.position[r->m.from[side]], r->m.position[qm_trimesh_to(&r->m, side)],
                        b / (a + b));
        return qm_router_split_edge(r, side, at, &vertex) &&
               (r->at_vertex[vertex] = node, r->vertex[node] = vertex, true);
    }
    at = (qm_vec){0};
    for (int k = 0; k < 3; k++)
        sum += weight[k] = fmax(weight[k], INSIDE);
    for (uint32_t k = 0; k < 3; k++)
        at = qm_vec_axpy(at, weight[k] / sum, r->m.position[r->m.from[3 * face + k]]);
    if (!qm_router_split_face(r, face, at, &vertex)) return false;
    r->at_vertex[vertex] = node;
    r->vertex[node] = vertex;
    return true;
}

static bool place_nodes(qm_router *r)
{
    size_t nodes = r->layout->node_count, vertices = r->m.vertex_count + nodes;
    bool *on_boundary = qm_arena_zeroed(r->arena, nodes, sizeof *on_boundary);
    r->vertex = qm_arena_alloc(r->arena, nodes, sizeof *r->vertex);
    r->at_vertex = qm_arena_alloc(r->arena, vertices, sizeof *r->at_vertex);
    r->wanted = qm_arena_alloc(r->arena, nodes, sizeof *r->wanted);
    if (!on_boundary || !r->vertex || !r->at_vertex || !r->wanted) return false;
    for (uint32_t d = 0; d < 2 * r->layout->curve_count; d++) {
        size_t count;
        const qm_vec *points = qm_router_guide_points(r, d / 2, &count);
        r->wanted[qm_router_start(r, d)] = points[d % 2 == 0 ? 0 : count - 1];
    }
    memset(r->at_vertex, 0xff, vertices * sizeof *r->at_vertex);
    memset(r->vertex, 0xff, nodes * sizeof *r->vertex);
    for (uint32_t c = 0; c < r->layout->curve_count; c++)
        if (qm_router_is_boundary(r, c))
            on_boundary[r->layout->curves[c].from] = on_boundary[r->layout->curves[c].to] = true;
    if (!qm_router_place_on_boundaries(r)) return false;
    for (uint32_t n = 0; n < nodes && !r->is_lost; n++) {
        qm_tmesh_spot spot;
        if (on_boundary[n]) {
            if (r->vertex[n] == QM_NO_INDEX) r->is_lost = true;
            continue;
        }
        if (!qm_tmesh_triangles_find(r->triangles, r->wanted[n], &spot))
            r->is_lost = true;
        else if (!place_node(r, n, &spot))
            return false;
    }
    return true;
}

/** Fills the boundaries of the surface that the layout has not: all, or those shorter than the shortest that it has. */
static bool fill_holes(qm_router *r)
{
    bool has_boundary = false;
    for (uint32_t c = 0; c < r->layout->curve_count; c++)
        has_boundary |= qm_router_is_boundary(r, c);
    return has_boundary || qm_trimesh_fill_holes(r->ctx, &r->m, INFINITY) == QM_OK;
}

static int compare_lengths(const void *a, const void *b)
{
    double one = *(const double *)a, other = *(const double *)b;
    return (one > other) - (one < other);
}

/** Divides triangles that are large for the curves: paths lead through their middles. */
static bool refine(qm_router *r)
{
    size_t curves = r->layout->curve_count, most = MOST_TIMES * r->m.face_count + MOST_BESIDES;
    double *length = qm_arena_alloc(r->arena, curves, sizeof *length);
    if (!length) return false;
    for (uint32_t c = 0; c < curves; c++)
        length[c] = qm_router_curve_guide(r, c).length;
    qsort(length, curves, sizeof *length, compare_lengths);
    double fine = FINE * length[curves / 2];
    bool is_done = !(fine > 0);
    for (int pass = 0; pass < REFINES && !is_done; pass++) {
        is_done = true;
        for (uint32_t f = 0, end = (uint32_t)r->m.face_count; f < end && r->m.face_count < most; f++) {
            uint32_t longest = 3 * f, vertex;
            for (uint32_t h = 3 * f; h < 3 * f + 3; h++)
                if (qm_vec_norm2(qm_trimesh_edge(&r->m, h)) > qm_vec_norm2(qm_trimesh_edge(&r->m, longest)))
                    longest = h;
            if (!(qm_vec_norm(qm_trimesh_edge(&r->m, longest)) > fine)) continue;
            qm_vec middle = qm_vec_mix(r->m.position[r->m.from[longest]],
                                       r->m.position[qm_trimesh_to(&r->m, longest)], 0.5);
            if (!qm_router_split_edge(r, longest, middle, &vertex)) return false;
            is_done = false;
        }
    }
    return true;
}

bool qm_router_prepare(qm_router *r)
{
    if (qm_trimesh_copy(r->ctx, &r->triangles->mesh, &r->m) != QM_OK) return false;
    memset(r->m.step, 0, 3 * r->m.face_count * sizeof *r->m.step);
    r->most_faces = MOST_GROWTH * r->m.face_count + MOST_GROWN;
    return fill_holes(r) && refine(r) && place_nodes(r);
}
