/**
 * tmesh_route.c: curves as paths on the surface that cannot meet.
 *
 * The mesh is a copy of the surface's triangles. A half-edge of the path of curve c has step[0] c + 1, any other 0. A dart is a curve in one
 * of its directions, 2 c from its first node and 2 c + 1 from its last; the patches tell which darts follow each other round a node.
 */
#include "tmesh/tmesh_route.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/union_find.h"
#include "core/vec.h"

#define ON_CORNER 1e-6     /* of a weight: a node this near a corner or a side of a triangle is on it */
#define INSIDE 1e-3        /* of a weight: how far a node stays off a boundary that it is not on */
#define LEAST_SHARE 0.05   /* of an edge on each side of a curve */
#define GUIDE_PULL 8.0     /* how much longer a way is that is off its guide by a quarter of its length */
#define BEND 0.2           /* of the way to the middle of a triangle: a curve within it is no side of it */
#define FINE 0.5           /* of the median curve: triangles are made no larger, */
#define MOST_TIMES 4       /* if there are no more than so many times as many, */
#define MOST_BESIDES 20000 /* and so many besides */
#define REFINES 12
#define MOST_GROWTH 12    /* times as many triangles as the surface has, */
#define MOST_GROWN 100000 /* and so many besides: ways that wind round each other grow without end */
#define ROUNDS 2          /* of straight curves; nodes move before the last */
#define NODE_STEP 0.7     /* of the way to the middle of the faces round it */
#define GRADE 0.4         /* of the way to the nearer end of a curve: segments there are no longer, */
#define SHORTEST 1e-4     /* or than this share of it */
#define LEAST_STEP 1e-5   /* of a curve: points nearer than that are one */
#define EVEN 0.1          /* share of equal steps along the boundary of a chart; the rest goes by length */

enum {
    MOST_DARTS = 32,
    MOST_GRADES = 200,
    GUIDE_POINTS = 9
}; /* of a node that moves; points beside those of a path */

typedef struct router {
    qm_arena *arena;
    qm_context *ctx;
    const qm_tmesh_triangles *triangles;
    const qm_layout *layout;
    const qm_tmesh_guides *guides;
    qm_trimesh m;
    qm_heap heap;
    /* darts */
    uint32_t *left; /* by dart: the patch to its left; QM_NO_INDEX */
    uint32_t *next,
        *before;         /* by dart: round its first node, counterclockwise; QM_NO_INDEX beyond a boundary */
    int8_t *turn;        /* by patch: 1 if it runs as the triangles do, -1 against */
    qm_vec *wanted;      /* by node: where it shall be */
    uint32_t *vertex;    /* by node */
    bool *is_laid;       /* by curve */
    uint32_t *at_vertex; /* by vertex of the mesh when nodes are placed: its node; QM_NO_INDEX */
    /* by triangle of the mesh */
    size_t capacity;
    double *cost;
    uint32_t *back, *stamp, *local, *queue; /* back: the half-edge that led here, of the triangle before */
    uint32_t stamp_value;
    /* the way of a curve: edges that it passes, in order */
    uint32_t (*edge)[2];
    double *share;
    size_t edge_count, edge_capacity;
    size_t most_faces;
    bool is_lost; /* a curve has found no way, or ways have become too long */
} router;

static uint32_t start_node(const router *r, uint32_t dart)
{
    const qm_curve *curve = &r->layout->curves[dart / 2];
    return dart % 2 == 0 ? curve->from : curve->to;
}

static uint32_t label(const router *r, uint32_t h)
{
    return (uint32_t)r->m.step[h][0];
}

static void set_label(router *r, uint32_t h, uint32_t value)
{
    r->m.step[h][0] = (int32_t)value;
    if (r->m.twin[h] != QM_NO_INDEX) r->m.step[r->m.twin[h]][0] = (int32_t)value;
}

static const qm_vec *guide_points(const router *r, uint32_t curve, size_t *count)
{
    *count = r->guides->first[curve + 1] - r->guides->first[curve];
    return r->guides->points + r->guides->first[curve];
}

/* ---- darts ---- */

/** The darts of a patch, in the order that has it on their left. */
static void patch_darts(const router *r, uint32_t patch, uint32_t out[4])
{
    const qm_layout_patch *at = &r->layout->patches[patch];
    for (int k = 0; k < 4; k++) {
        int side = r->turn[patch] > 0 ? k : 3 - k;
        out[k] = 2 * at->side[side] + ((r->turn[patch] > 0) == at->against[side]);
    }
}

/** By curve: its patches, and in which direction these run along it. */
typedef struct curve_faces {
    uint32_t patch[2];
    bool against[2];
    uint32_t count;
} curve_faces;

/** How much a patch runs as the triangles under it do. */
static double measure_turn(const router *r, const double *grid)
{
    const int corner[4] = {0, QM_LAYOUT_GRID, QM_LAYOUT_GRID_POINTS - 1,
                           QM_LAYOUT_GRID_POINTS - 1 - QM_LAYOUT_GRID};
    double sum = 0;
    for (int cell = 0; cell < QM_LAYOUT_GRID * QM_LAYOUT_GRID; cell++) {
        const double *at = grid + 3 * (cell / QM_LAYOUT_GRID * (QM_LAYOUT_GRID + 1) + cell % QM_LAYOUT_GRID);
        qm_vec p[4];
        for (int k = 0; k < 4; k++)
            p[k] = qm_vec_load(at + 3 * (corner[k] / QM_LAYOUT_GRID > 0 && k > 1 ? QM_LAYOUT_GRID + 1 : 0) +
                               3 * (k == 1 || k == 2));
        qm_tmesh_spot spot;
        if (!qm_tmesh_triangles_find(r->triangles, qm_vec_centroid(p, 4), &spot)) continue;
        sum += qm_vec_dot(qm_vec_cross(qm_vec_sub(p[2], p[0]), qm_vec_sub(p[3], p[1])),
                          qm_trimesh_normal(&r->triangles->mesh, spot.triangle));
    }
    return sum;
}

/** Turns the patches of a component alike, and as the triangles. False if it has one side only. */
static bool turn_component(router *r, const curve_faces *faces, const double *grids, uint32_t first,
                           uint32_t *queue)
{
    const qm_layout *layout = r->layout;
    size_t head = 0, tail = 0;
    double sum = 0;
    r->turn[first] = 1;
    queue[tail++] = first;
    while (head < tail) {
        uint32_t patch = queue[head++];
        sum += r->turn[patch] * measure_turn(r, grids + (size_t)3 * QM_LAYOUT_GRID_POINTS * patch);
        for (int k = 0; k < 4; k++) {
            const curve_faces *at = &faces[layout->patches[patch].side[k]];
            if (at->count != 2) continue;
            uint32_t other = at->patch[0] == patch ? at->patch[1] : at->patch[0];
            int8_t turn = at->against[0] != at->against[1] ? r->turn[patch] : (int8_t)-r->turn[patch];
            if (r->turn[other] == 0) {
                r->turn[other] = turn;
                queue[tail++] = other;
            }
            if (r->turn[other] != turn) return false;
        }
    }
    for (size_t i = 0; i < tail && sum < 0; i++)
        r->turn[queue[i]] = (int8_t)-r->turn[queue[i]];
    return true;
}

/** Orders the darts round the nodes. *is_ordered is false if the patches do not tell. */
static bool order_darts(router *r, const double *grids, bool *is_ordered)
{
    const qm_layout *layout = r->layout;
    size_t darts = 2 * layout->curve_count;
    curve_faces *faces = qm_arena_zeroed(r->arena, layout->curve_count, sizeof *faces);
    uint32_t *queue = qm_arena_alloc(r->arena, layout->patch_count, sizeof *queue);
    r->left = qm_arena_alloc(r->arena, darts, sizeof *r->left);
    r->next = qm_arena_alloc(r->arena, darts, sizeof *r->next);
    r->before = qm_arena_alloc(r->arena, darts, sizeof *r->before);
    r->turn = qm_arena_zeroed(r->arena, layout->patch_count, sizeof *r->turn);
    *is_ordered = false;
    if (!faces || !queue || !r->left || !r->next || !r->before || !r->turn) return false;
    memset(r->left, 0xff, darts * sizeof *r->left);
    memset(r->next, 0xff, darts * sizeof *r->next);
    memset(r->before, 0xff, darts * sizeof *r->before);
    for (uint32_t p = 0; p < layout->patch_count; p++)
        for (int k = 0; k < 4; k++) {
            curve_faces *at = &faces[layout->patches[p].side[k]];
            if (at->count == 2) return true;
            at->patch[at->count] = p;
            at->against[at->count++] = layout->patches[p].against[k];
        }
    for (uint32_t p = 0; p < layout->patch_count; p++)
        if (r->turn[p] == 0 && !turn_component(r, faces, grids, p, queue)) return true;
    for (uint32_t p = 0; p < layout->patch_count; p++) {
        uint32_t dart[4];
        patch_darts(r, p, dart);
        for (int k = 0; k < 4; k++) {
            uint32_t reversed = dart[(k + 3) & 3] ^ 1;
            if (r->left[dart[k]] != QM_NO_INDEX || r->before[reversed] != QM_NO_INDEX) return true;
            r->left[dart[k]] = p;
            r->next[dart[k]] = reversed;
            r->before[reversed] = dart[k];
        }
    }
    *is_ordered = true;
    return true;
}

static bool is_boundary(const router *r, uint32_t curve)
{
    return r->left[2 * curve] == QM_NO_INDEX || r->left[2 * curve + 1] == QM_NO_INDEX;
}

/* ---- the mesh ---- */

/** Makes room for what is known of triangles. */
static bool reserve(router *r)
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

/** Divides an edge that no curve runs along, or one of a boundary. */
static bool split_edge(router *r, uint32_t h, qm_vec at, uint32_t *vertex)
{
    uint32_t twin = r->m.twin[h];
    if (qm_trimesh_split(r->ctx, &r->m, h, at, vertex) != QM_OK) return false;
    r->m.step[qm_trimesh_next(h)][0] = 0;
    if (twin != QM_NO_INDEX) r->m.step[qm_trimesh_next(twin)][0] = 0;
    return true;
}

static bool split_face(router *r, uint32_t face, qm_vec at, uint32_t *vertex)
{
    const uint32_t part[3] = {face, (uint32_t)r->m.face_count, (uint32_t)r->m.face_count + 1};
    uint32_t old[3];
    for (uint32_t k = 0; k < 3; k++)
        old[k] = label(r, 3 * face + k);
    if (qm_trimesh_split_face(r->ctx, &r->m, face, vertex) != QM_OK) return false;
    r->m.position[*vertex] = at;
    for (uint32_t k = 0; k < 3; k++)
        r->m.step[3 * part[k]][0] = (int32_t)old[k];
    return true;
}

/** The half-edge from u to w of a triangle at a vertex; QM_NO_INDEX. */
static uint32_t opposite_edge(const router *r, uint32_t vertex, uint32_t u, uint32_t w)
{
    uint32_t first = qm_trimesh_first(&r->m, vertex), h = first;
    do {
        uint32_t next = qm_trimesh_next(h), a = r->m.from[next], b = qm_trimesh_to(&r->m, next);
        if ((a == u && b == w) || (a == w && b == u)) return next;
        h = qm_trimesh_around(&r->m, h);
    } while (h != QM_NO_INDEX && h != first);
    return QM_NO_INDEX;
}

/** A half-edge between two vertices, of either direction; QM_NO_INDEX. */
static uint32_t edge_between(const router *r, uint32_t a, uint32_t b)
{
    uint32_t first = qm_trimesh_first(&r->m, a), h = first;
    do {
        if (qm_trimesh_to(&r->m, h) == b) return h;
        if (r->m.from[qm_trimesh_prev(h)] == b) return qm_trimesh_prev(h);
        h = qm_trimesh_around(&r->m, h);
    } while (h != QM_NO_INDEX && h != first);
    return QM_NO_INDEX;
}

/** The half-edge of a curve out of a vertex; QM_NO_INDEX where there is none, or its path only comes in along a boundary. */
static uint32_t labelled_edge(const router *r, uint32_t vertex, uint32_t curve)
{
    uint32_t first = qm_trimesh_first(&r->m, vertex), h = first;
    do {
        if (label(r, h) == curve + 1) return h;
        h = qm_trimesh_around(&r->m, h);
    } while (h != QM_NO_INDEX && h != first);
    return QM_NO_INDEX;
}

/* ---- nodes ---- */

static double weight_in(const router *r, uint32_t face, qm_vec at, int k)
{
    const uint32_t *c = r->m.from + 3 * (size_t)face;
    qm_vec normal = qm_trimesh_normal(&r->m, face), a = r->m.position[c[(k + 1) % 3]],
           b = r->m.position[c[(k + 2) % 3]];
    double area2 = qm_vec_norm2(normal);
    if (!(area2 > 0)) return 1.0 / 3;
    return qm_vec_dot(qm_vec_cross(qm_vec_sub(a, at), qm_vec_sub(b, at)), normal) / area2;
}

static bool take_vertex(router *r, uint32_t node, uint32_t vertex)
{
    if (r->at_vertex[vertex] != QM_NO_INDEX) return false;
    r->at_vertex[vertex] = node;
    r->vertex[node] = vertex;
    return true;
}

/** Puts a node into the triangle that it is in, of the parts that nodes before have left of it. */
static bool place_node(router *r, uint32_t node, const qm_tmesh_spot *spot)
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
    if (weight[high] > 1 - ON_CORNER && is_inner && take_vertex(r, node, vertex)) return true;
    uint32_t side = 3 * face + (low + 1) % 3;
    if (weight[low] < ON_CORNER && r->m.twin[side] != QM_NO_INDEX) {
        double a = fmax(weight[(low + 1) % 3], INSIDE), b = fmax(weight[(low + 2) % 3], INSIDE);
        at = qm_vec_mix(r->m.position[r->m.from[side]], r->m.position[qm_trimesh_to(&r->m, side)],
                        b / (a + b));
        return split_edge(r, side, at, &vertex) &&
               (r->at_vertex[vertex] = node, r->vertex[node] = vertex, true);
    }
    at = (qm_vec){0};
    for (int k = 0; k < 3; k++)
        sum += weight[k] = fmax(weight[k], INSIDE);
    for (uint32_t k = 0; k < 3; k++)
        at = qm_vec_axpy(at, weight[k] / sum, r->m.position[r->m.from[3 * face + k]]);
    if (!split_face(r, face, at, &vertex)) return false;
    r->at_vertex[vertex] = node;
    r->vertex[node] = vertex;
    return true;
}

/** Puts a node onto the nearest boundary edge. */
static bool place_on_boundary(router *r, uint32_t node)
{
    qm_vec p = r->wanted[node];
    double best = INFINITY, share = 0;
    uint32_t nearest = QM_NO_INDEX, vertex;
    for (uint32_t h = 0; h < 3 * r->m.face_count; h++) {
        if (r->m.twin[h] != QM_NO_INDEX) continue;
        qm_vec from = r->m.position[r->m.from[h]], along = qm_trimesh_edge(&r->m, h);
        double length2 = qm_vec_norm2(along),
               at = length2 > 0 ? qm_clamp(qm_vec_dot(qm_vec_sub(p, from), along) / length2, 0, 1) : 0,
               far = qm_vec_distance(p, qm_vec_axpy(from, at, along));
        if (far < best) best = far, share = at, nearest = h;
    }
    if (nearest == QM_NO_INDEX) {
        r->is_lost = true;
        return true;
    }
    uint32_t end = share < 0.5 ? r->m.from[nearest] : qm_trimesh_to(&r->m, nearest);
    if ((share < ON_CORNER || share > 1 - ON_CORNER) && take_vertex(r, node, end)) return true;
    share = qm_clamp(share, INSIDE, 1 - INSIDE);
    qm_vec at = qm_vec_axpy(r->m.position[r->m.from[nearest]], share, qm_trimesh_edge(&r->m, nearest));
    if (!split_edge(r, nearest, at, &vertex)) return false;
    r->at_vertex[vertex] = node;
    r->vertex[node] = vertex;
    return true;
}

static bool place_nodes(router *r)
{
    size_t nodes = r->layout->node_count, vertices = r->m.vertex_count + nodes;
    bool *on_boundary = qm_arena_zeroed(r->arena, nodes, sizeof *on_boundary);
    r->vertex = qm_arena_alloc(r->arena, nodes, sizeof *r->vertex);
    r->at_vertex = qm_arena_alloc(r->arena, vertices, sizeof *r->at_vertex);
    r->wanted = qm_arena_alloc(r->arena, nodes, sizeof *r->wanted);
    if (!on_boundary || !r->vertex || !r->at_vertex || !r->wanted) return false;
    for (uint32_t d = 0; d < 2 * r->layout->curve_count; d++) {
        size_t count;
        const qm_vec *points = guide_points(r, d / 2, &count);
        r->wanted[start_node(r, d)] = points[d % 2 == 0 ? 0 : count - 1];
    }
    memset(r->at_vertex, 0xff, vertices * sizeof *r->at_vertex);
    for (uint32_t c = 0; c < r->layout->curve_count; c++)
        if (is_boundary(r, c))
            on_boundary[r->layout->curves[c].from] = on_boundary[r->layout->curves[c].to] = true;
    for (uint32_t n = 0; n < nodes && !r->is_lost; n++)
        if (on_boundary[n] && !place_on_boundary(r, n)) return false;
    for (uint32_t n = 0; n < nodes && !r->is_lost; n++) {
        qm_tmesh_spot spot;
        if (on_boundary[n]) continue;
        if (!qm_tmesh_triangles_find(r->triangles, r->wanted[n], &spot))
            r->is_lost = true;
        else if (!place_node(r, n, &spot))
            return false;
    }
    return true;
}

/* ---- ways ---- */

/** Points along a curve, by which its way is chosen. */
typedef struct guide {
    const qm_vec *at;
    size_t count;
    double length;
} guide;

static guide make_guide(const qm_vec *at, size_t count)
{
    guide out = {.at = at, .count = count};
    for (size_t k = 1; k < count; k++)
        out.length += qm_vec_distance(at[k], at[k - 1]);
    return out;
}

static guide curve_guide(const router *r, uint32_t curve)
{
    size_t count;
    const qm_vec *at = guide_points(r, curve, &count);
    return make_guide(at, count);
}

static double guide_distance(const guide *g, qm_vec p)
{
    double best = INFINITY;
    for (size_t k = 0; k + 1 < g->count; k++) {
        qm_vec along = qm_vec_sub(g->at[k + 1], g->at[k]);
        double length2 = qm_vec_norm2(along),
               at = length2 > 0 ? qm_clamp(qm_vec_dot(qm_vec_sub(p, g->at[k]), along) / length2, 0, 1) : 0;
        best = fmin(best, qm_vec_distance(p, qm_vec_axpy(g->at[k], at, along)));
    }
    return best;
}

/** Where the guide is nearest to an edge. */
static double guide_share(const guide *g, qm_vec a, qm_vec b)
{
    double low = 0, high = 1;
    for (int i = 0; i < 12; i++) { /* the distance has one valley, nearly */
        double one = low + (high - low) / 3, other = high - (high - low) / 3;
        if (guide_distance(g, qm_vec_mix(a, b, one)) < guide_distance(g, qm_vec_mix(a, b, other)))
            high = other;
        else
            low = one;
    }
    return qm_clamp(0.5 * (low + high), LEAST_SHARE, 1 - LEAST_SHARE);
}

static bool add_edge(router *r, uint32_t h, double share)
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

/** Lists the triangles at the first node of a dart, between the curves beside it that lie. */
static size_t list_sector(const router *r, uint32_t dart, uint32_t *out)
{
    uint32_t vertex = r->vertex[start_node(r, dart)], before = r->before[dart], first = QM_NO_INDEX;
    while (before != QM_NO_INDEX && before != dart && !r->is_laid[before / 2])
        before = r->before[before];
    if (before != QM_NO_INDEX && before != dart) {
        first = labelled_edge(r, vertex, before / 2);
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
    } while (h != QM_NO_INDEX && h != first && label(r, h) == 0);
    return count;
}

static qm_vec middle_of(const router *r, uint32_t face)
{
    const uint32_t *c = r->m.from + 3 * (size_t)face;
    qm_vec corner[3] = {r->m.position[c[0]], r->m.position[c[1]], r->m.position[c[2]]};
    return qm_vec_centroid(corner, 3);
}

static bool reach(router *r, uint32_t face, double cost, uint32_t back, uint32_t stamp)
{
    if (r->stamp[face] == stamp && r->cost[face] <= cost) return true;
    r->stamp[face] = stamp;
    r->cost[face] = cost;
    r->back[face] = back;
    return qm_heap_push(r->ctx, &r->heap, (qm_heap_item){cost, face, 0}) == QM_OK;
}

/** Finds the edges that a curve passes; *middle is the only triangle of it, where it passes none. False when out of memory. */
static bool find_way(router *r, uint32_t curve, const guide *g, uint32_t *middle, bool *is_found)
{
    *middle = QM_NO_INDEX;
    *is_found = false;
    r->edge_count = 0;
    if (!reserve(r)) return false;
    uint32_t *sector = r->queue, stamp, ends = ++r->stamp_value;
    size_t count = list_sector(r, 2 * curve + 1, sector);
    memset(r->local, 0, r->m.face_count * sizeof *r->local);
    for (size_t i = 0; i < count; i++)
        r->local[sector[i]] = ends;
    stamp = ++r->stamp_value;
    r->heap.count = 0;
    count = list_sector(r, 2 * curve, sector);
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
        qm_vec here = middle_of(r, item.number);
        for (uint32_t k = 0; k < 3; k++) {
            uint32_t h = 3 * item.number + k, twin = r->m.twin[h];
            if (twin == QM_NO_INDEX || label(r, h) != 0) continue;
            qm_vec there = middle_of(r, twin / 3);
            double off = g->length > 0 ? guide_distance(g, there) / (0.25 * g->length) : 0,
                   cost = item.key + qm_vec_distance(here, there) * (1 + GUIDE_PULL * off);
            if (!reach(r, twin / 3, cost, h, stamp)) return false;
        }
    }
    if (at == QM_NO_INDEX) return true;
    *is_found = true;
    *middle = at;
    for (; r->back[at] != QM_NO_INDEX; at = r->back[at] / 3) {
        uint32_t h = r->back[at];
        if (!add_edge(r, h,
                      guide_share(g, r->m.position[r->m.from[h]], r->m.position[qm_trimesh_to(&r->m, h)])))
            return false;
    }
    for (size_t i = 0, j = r->edge_count; i + 1 < j; i++) {
        j--;
        uint32_t pair[2] = {r->edge[i][0], r->edge[i][1]};
        double share = r->share[i];
        memcpy(r->edge[i], r->edge[j], sizeof pair);
        memcpy(r->edge[j], pair, sizeof pair);
        r->share[i] = r->share[j];
        r->share[j] = share;
    }
    return true;
}

static bool label_between(router *r, uint32_t a, uint32_t b, uint32_t curve)
{
    uint32_t h = edge_between(r, a, b);
    if (h == QM_NO_INDEX || label(r, h) != 0) r->is_lost = true;
    if (!r->is_lost) set_label(r, h, curve + 1);
    return true;
}

/** Lays a curve over the edges of its way, or through a triangle alone. False when out of memory. */
static bool lay(router *r, uint32_t curve, uint32_t middle)
{
    const qm_curve *at = &r->layout->curves[curve];
    uint32_t last = r->vertex[at->from], end = r->vertex[at->to], vertex;
    r->is_laid[curve] = true;
    if (r->edge_count == 0) {
        qm_vec between = qm_vec_mix(r->m.position[last], r->m.position[end], 0.5);
        if (!split_face(r, middle, qm_vec_mix(between, middle_of(r, middle), BEND), &vertex)) return false;
        return label_between(r, last, vertex, curve) && label_between(r, vertex, end, curve);
    }
    for (size_t i = 0; i < r->edge_count && !r->is_lost; i++) {
        uint32_t h = opposite_edge(r, last, r->edge[i][0], r->edge[i][1]);
        if (h == QM_NO_INDEX || label(r, h) != 0) {
            r->is_lost = true;
            return true;
        }
        double share = r->m.from[h] == r->edge[i][0] ? r->share[i] : 1 - r->share[i];
        qm_vec to = qm_vec_mix(r->m.position[r->m.from[h]], r->m.position[qm_trimesh_to(&r->m, h)], share);
        if (!split_edge(r, h, to, &vertex)) return false;
        label_between(r, last, vertex, curve);
        last = vertex;
    }
    return r->is_lost || label_between(r, last, end, curve);
}

static bool route_curve(router *r, uint32_t curve, const guide *g)
{
    uint32_t middle;
    bool is_found;
    if (!find_way(r, curve, g, &middle, &is_found)) return false;
    if (!is_found || r->m.face_count > r->most_faces) {
        r->is_lost = true;
        return true;
    }
    return lay(r, curve, middle);
}

/** Lays a curve along the boundary, its patch on the left. */
static bool route_boundary(router *r, uint32_t curve)
{
    uint32_t dart = 2 * curve + (r->left[2 * curve] == QM_NO_INDEX);
    uint32_t at = r->vertex[start_node(r, dart)], end = r->vertex[start_node(r, dart ^ 1)];
    r->is_laid[curve] = true;
    for (size_t step = 0; at != end && step < 3 * r->m.face_count; step++) {
        uint32_t h = qm_trimesh_first(&r->m, at);
        bool is_free = r->m.twin[h] == QM_NO_INDEX && label(r, h) == 0;
        bool meets = step > 0 && r->at_vertex[at] != QM_NO_INDEX;
        if (!is_free || meets) {
            r->is_lost = true;
            return true;
        }
        set_label(r, h, curve + 1);
        at = qm_trimesh_to(&r->m, h);
    }
    return true;
}

/* ---- the order ---- */

typedef struct rank {
    double length;
    uint32_t curve;
} rank;

static int compare_ranks(const void *a, const void *b)
{
    const rank *one = a, *other = b;
    if (one->length != other->length) return one->length < other->length ? -1 : 1;
    return one->curve < other->curve ? -1 : one->curve > other->curve;
}

/** Joins the ends of a curve, or its faces. True if they were apart. */
static bool join(uint32_t *parent, uint32_t a, uint32_t b)
{
    if (qm_union_find_root(parent, a) == qm_union_find_root(parent, b)) return false;
    qm_union_find_join(parent, a, b);
    return true;
}

/** Lays all curves. False when out of memory. */
static bool route_all(router *r)
{
    const qm_layout *layout = r->layout;
    size_t curves = layout->curve_count;
    rank *order = qm_arena_alloc(r->arena, curves, sizeof *order);
    uint8_t *turn = qm_arena_zeroed(r->arena, curves, 1); /* when it is laid */
    uint32_t *node = qm_arena_alloc(r->arena, layout->node_count, sizeof *node);
    uint32_t *face = qm_arena_alloc(r->arena, layout->patch_count, sizeof *face);
    r->is_laid = qm_arena_zeroed(r->arena, curves, sizeof *r->is_laid);
    if (!order || !turn || !node || !face || !r->is_laid) return false;
    for (uint32_t i = 0; i < layout->node_count; i++)
        node[i] = i;
    for (uint32_t i = 0; i < layout->patch_count; i++)
        face[i] = i;
    for (uint32_t c = 0; c < curves; c++)
        order[c] = (rank){curve_guide(r, c).length, c};
    qsort(order, curves, sizeof *order, compare_ranks);
    enum { BOUNDARY, TREE, HANDLE, LAST };
    for (size_t i = 0; i < curves; i++) {
        uint32_t c = order[i].curve;
        turn[c] = HANDLE;
        if (!is_boundary(r, c)) continue;
        turn[c] = BOUNDARY;
        join(node, layout->curves[c].from, layout->curves[c].to);
    }
    for (size_t i = 0; i < curves; i++) {
        const qm_curve *curve = &layout->curves[order[i].curve];
        if (turn[order[i].curve] == HANDLE && join(node, curve->from, curve->to)) turn[order[i].curve] = TREE;
    }
    for (size_t i = curves; i-- > 0;) {
        uint32_t c = order[i].curve;
        if (turn[c] == HANDLE && join(face, r->left[2 * c], r->left[2 * c + 1])) turn[c] = LAST;
    }
    for (int phase = BOUNDARY; phase <= LAST; phase++)
        for (size_t i = 0; i < curves && !r->is_lost; i++) {
            uint32_t c = order[i].curve;
            if (turn[c] != phase) continue;
            if (qm_context_canceled(r->ctx)) return true;
            guide g = curve_guide(r, c);
            if (!(phase == BOUNDARY ? route_boundary(r, c) : route_curve(r, c, &g))) return false;
        }
    return true;
}

/* ---- charts of faces ---- */

/** A disc of the mesh, and how its triangles and corners are numbered in its chart. */
typedef struct disc {
    qm_tmesh_chart chart;
    uint32_t *number; /* 3 a triangle: the chart's vertex at each corner */
    uint32_t *beyond; /* 3 a triangle: the half-edge beyond each side; QM_NO_INDEX */
    uint32_t *ring;   /* of the boundary, in order */
    size_t ring_count;
    bool *is_fixed;
} disc;

/** True where a disc goes on beyond a half-edge: over no curve but those that are open. */
static bool is_open(const router *r, uint32_t h, const bool *is_open_curve)
{
    uint32_t at = label(r, h);
    return r->m.twin[h] != QM_NO_INDEX && (at == 0 || is_open_curve[at - 1]);
}

static void number_corners(const router *r, const uint32_t *list, size_t count, const bool *open, disc *out)
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

/** Gathers the triangles that are connected with one, over open curves too, and numbers them. *is_made is false where they are no disc. */
static bool gather(router *r, uint32_t first, const bool *open, disc *out, bool *is_made)
{
    *is_made = false;
    *out = (disc){0};
    if (!reserve(r)) return false;
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
    chart->corner = qm_arena_alloc(r->arena, count, sizeof *chart->corner);
    chart->twin = qm_arena_alloc(r->arena, 3 * count, sizeof *chart->twin);
    chart->triangle = qm_arena_alloc(r->arena, count, sizeof *chart->triangle);
    chart->at = qm_arena_alloc(r->arena, 3 * count, sizeof *chart->at);
    out->number = qm_arena_alloc(r->arena, 3 * count, sizeof *out->number);
    out->beyond = qm_arena_alloc(r->arena, 3 * count, sizeof *out->beyond);
    uint32_t *next = qm_arena_alloc(r->arena, 3 * count, sizeof *next);
    out->ring = qm_arena_alloc(r->arena, sides + 1, sizeof *out->ring);
    if (!chart->corner || !chart->twin || !chart->triangle || !chart->at || !out->number || !out->beyond ||
        !next || !out->ring)
        return false;
    memcpy(chart->triangle, r->queue, count * sizeof *r->queue);
    number_corners(r, chart->triangle, count, open, out);
    chart->flat = qm_arena_zeroed(r->arena, chart->vertex_count, sizeof *chart->flat);
    out->is_fixed = qm_arena_zeroed(r->arena, chart->vertex_count, sizeof *out->is_fixed);
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

static uint32_t corner_at(const router *r, const disc *d, uint32_t h)
{
    return d->number[3 * (size_t)r->local[h / 3] + h % 3];
}

/** Puts a part of the boundary onto an arc of the circle, from one place of the ring to another. */
static void place_arc(disc *d, size_t from, size_t count, double start, double angle)
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

static bool flatten_round(router *r, disc *d, bool *is_made)
{
    place_arc(d, 0, d->ring_count, 0, 360.0 * QM_DEGREE);
    return qm_tmesh_chart_flatten(r->arena, &d->chart, d->is_fixed, is_made);
}

/* ---- straight curves ---- */

/** Lists the edges that the straight line between two vertices of a chart passes; *middle is a triangle that it is in, where it passes none.
 * *is_found is false where rounding leads it out. Returns false when out of memory. */
static bool walk_line(router *r, const disc *d, uint32_t a, uint32_t b, uint32_t *middle, bool *is_found)
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
        if (!add_edge(r, 3 * chart->triangle[side / 3] + side % 3,
                      qm_clamp(share, LEAST_SHARE, 1 - LEAST_SHARE)))
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

static void take_up(router *r, uint32_t curve)
{
    uint32_t at = r->vertex[r->layout->curves[curve].from];
    for (uint32_t h; (h = labelled_edge(r, at, curve)) != QM_NO_INDEX;) {
        at = qm_trimesh_to(&r->m, h);
        set_label(r, h, 0);
    }
    r->is_laid[curve] = false;
}

/** Lays a curve straight within its two faces. False when out of memory. */
static bool straighten(router *r, uint32_t curve, bool *open)
{
    uint32_t one = r->left[2 * curve], other = r->left[2 * curve + 1];
    if (one == other || one == QM_NO_INDEX || other == QM_NO_INDEX) return true;
    const qm_curve *at = &r->layout->curves[curve];
    uint32_t start = labelled_edge(r, r->vertex[at->from], curve),
             end = labelled_edge(r, r->vertex[at->to], curve), middle = QM_NO_INDEX;
    disc d;
    bool is_made;
    open[curve] = true;
    bool has_memory = gather(r, start / 3, open, &d, &is_made);
    open[curve] = false;
    if (!has_memory || !is_made) return has_memory;
    if (!flatten_round(r, &d, &is_made)) return false;
    if (!is_made) return true;
    if (!walk_line(r, &d, corner_at(r, &d, start), corner_at(r, &d, end), &middle, &is_made)) return false;
    if (!is_made) return true;
    take_up(r, curve);
    return lay(r, curve, middle);
}

/* ---- nodes that move ---- */

static guide lift_line(const disc *d, qm_tmesh_flat from, uint32_t triangle, uint32_t corner,
                       qm_vec out[GUIDE_POINTS])
{
    qm_tmesh_flat to = d->chart.flat[corner];
    for (int k = 0; k < GUIDE_POINTS; k++) {
        double share = (double)k / (GUIDE_POINTS - 1);
        qm_tmesh_flat at = {from.u + share * (to.u - from.u), from.v + share * (to.v - from.v)};
        if (!qm_tmesh_chart_lift(&d->chart, at, &triangle, &out[k])) out[k] = d->chart.at[corner];
    }
    return make_guide(out, GUIDE_POINTS);
}

/** The inner vertex of a chart that is nearest to a point of the plane, and a triangle at it; QM_NO_INDEX. */
static uint32_t nearest_inner(const router *r, const disc *d, qm_tmesh_flat wanted, uint32_t *corner)
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
static bool move_node(router *r, uint32_t first, bool *open)
{
    uint32_t node = start_node(r, first), dart[MOST_DARTS], far[MOST_DARTS], count = 0, corner;
    qm_vec line[MOST_DARTS][GUIDE_POINTS];
    guide g[MOST_DARTS];
    for (uint32_t d = first; count == 0 || d != first; d = r->next[d]) {
        if (d == QM_NO_INDEX || count == MOST_DARTS) return true;
        dart[count++] = d;
    }
    for (uint32_t i = 0; i < count; i++)
        open[dart[i] / 2] = true;
    uint32_t start = labelled_edge(r, r->vertex[node], first / 2);
    disc d;
    bool is_made, has_memory = gather(r, start / 3, open, &d, &is_made);
    for (uint32_t i = 0; i < count; i++)
        open[dart[i] / 2] = false;
    if (!has_memory || !is_made) return has_memory;
    if (!flatten_round(r, &d, &is_made)) return false;
    uint32_t here = corner_at(r, &d, start);
    if (!is_made || d.is_fixed[here]) return true;
    for (uint32_t i = 0; i < count; i++)
        far[i] = corner_at(r, &d, labelled_edge(r, r->vertex[start_node(r, dart[i] ^ 1)], dart[i] / 2));
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
        if (!route_curve(r, dart[i] / 2, &g[i])) return false;
    return true;
}

static bool straighten_all(router *r, const bool *is_fixed, const bool *is_line)
{
    const qm_layout *layout = r->layout;
    bool *open = qm_arena_zeroed(r->arena, layout->curve_count, sizeof *open);
    bool *is_moved = qm_arena_zeroed(r->arena, layout->node_count, sizeof *is_moved);
    if (!open || !is_moved) return false;
    for (int round = 0; round < ROUNDS; round++) {
        for (uint32_t d = 0; d < 2 * layout->curve_count && round + 1 == ROUNDS; d++) {
            uint32_t node = start_node(r, d);
            if (is_fixed[node] || is_moved[node] || r->is_lost) continue;
            is_moved[node] = true;
            if (qm_context_canceled(r->ctx)) return true;
            if (!move_node(r, d, open)) return false;
        }
        for (uint32_t c = 0; c < layout->curve_count && !r->is_lost; c++) {
            if (qm_context_canceled(r->ctx)) return true;
            if (!is_line[c] && !straighten(r, c, open)) return false;
        }
    }
    return true;
}

/* ---- the layout ---- */

/** Writes the points of a curve's path; their number. *points is the arena's. */
static bool list_points(router *r, uint32_t curve, double **points, size_t *count)
{
    const qm_curve *at = &r->layout->curves[curve];
    uint32_t vertex = r->vertex[at->from], end = r->vertex[at->to], came = QM_NO_INDEX;
    size_t capacity = 64;
    *count = 0;
    *points = qm_arena_alloc(r->arena, 3 * capacity, sizeof **points);
    if (!*points) return false;
    for (;;) {
        if (*count == capacity) {
            double *grown = qm_arena_alloc(r->arena, 6 * capacity, sizeof *grown);
            if (!grown) return false;
            memcpy(grown, *points, 3 * capacity * sizeof *grown);
            *points = grown;
            capacity *= 2;
        }
        qm_vec_store(*points + 3 * (*count)++, r->m.position[vertex]);
        if (vertex == end) return true;
        uint32_t first = qm_trimesh_first(&r->m, vertex), h = first, next = QM_NO_INDEX;
        do { /* a boundary may run against the curve */
            uint32_t prev = qm_trimesh_prev(h);
            if (label(r, h) == curve + 1 && qm_trimesh_to(&r->m, h) != came) next = qm_trimesh_to(&r->m, h);
            if (label(r, prev) == curve + 1 && r->m.from[prev] != came) next = r->m.from[prev];
            h = qm_trimesh_around(&r->m, h);
        } while (h != QM_NO_INDEX && h != first);
        if (next == QM_NO_INDEX || *count > r->m.vertex_count) {
            r->is_lost = true;
            return true;
        }
        came = vertex;
        vertex = next;
    }
}

/** The points of a path, as the points of a curve: segments near its ends are short, since crossings are told by how near segments are for
 * their lengths, and curves are near each other at their node; points that are very near each other are left out. */
static bool grade_points(router *r, const double *path, size_t path_count, double **points, size_t *count)
{
    double length = 0, passed = 0;
    for (size_t i = 1; i < path_count; i++)
        length += qm_vec_distance(qm_vec_load(path + 3 * i - 3), qm_vec_load(path + 3 * i));
    size_t capacity = 2 * path_count + MOST_GRADES;
    *points = qm_arena_alloc(r->arena, 3 * capacity, sizeof **points);
    if (!*points) return false;
    memcpy(*points, path, 3 * sizeof *path);
    *count = 1;
    for (size_t i = 1; i < path_count; i++) {
        qm_vec from = qm_vec_load(path + 3 * i - 3), to = qm_vec_load(path + 3 * i);
        double step = qm_vec_distance(from, to), done = 0;
        while (step > 0 && *count + 1 < capacity) {
            double at = passed + done, most = fmax(GRADE * fmin(at, length - at), SHORTEST * length);
            if (done + most >= step) break;
            done += most;
            qm_vec_store(*points + 3 * (*count)++, qm_vec_mix(from, to, done / step));
        }
        passed += step;
        bool is_last = i + 1 == path_count;
        if (step - done<LEAST_STEP * length && * count> 1 && is_last) --*count;
        if (step - done < LEAST_STEP * length && !is_last) continue;
        qm_vec_store(*points + 3 * (*count)++, to);
    }
    return true;
}

/** The points of the grids on a curve, at equal lengths. */
static void mark_curve(const qm_curve *curve, qm_vec out[QM_LAYOUT_GRID + 1])
{
    double length = qm_layout_curve_length(curve), passed = 0;
    size_t i = 0;
    for (int k = 0; k <= QM_LAYOUT_GRID; k++)
        for (;; i++) {
            double wanted = length * k / QM_LAYOUT_GRID;
            qm_vec a = qm_vec_load(curve->points + 3 * i), b = qm_vec_load(curve->points + 3 * (i + 1));
            double step = qm_vec_distance(a, b);
            if (passed + step >= wanted || i + 2 == curve->point_count) {
                out[k] = qm_vec_mix(a, b, step > 0 ? qm_clamp((wanted - passed) / step, 0, 1) : 0);
                break;
            }
            passed += step;
        }
    out[0] = qm_vec_load(curve->points);
    out[QM_LAYOUT_GRID] = qm_vec_load(curve->points + 3 * (curve->point_count - 1));
}

/** The border of a patch's grid, from its curves. */
static void grid_border(const qm_layout *out, uint32_t patch, qm_vec grid[QM_LAYOUT_GRID_POINTS])
{
    const int n = QM_LAYOUT_GRID;
    for (int side = 0; side < 4; side++) {
        qm_vec at[QM_LAYOUT_GRID + 1];
        mark_curve(&out->curves[out->patches[patch].side[side]], at);
        for (int i = 0; i <= n; i++) {
            int column = side == 0   ? i
                         : side == 1 ? n
                         : side == 2 ? n - i
                                     : 0,
                row = side == 0   ? 0
                      : side == 1 ? i
                      : side == 2 ? n
                                  : n - i;
            grid[row * (n + 1) + column] = at[out->patches[patch].against[side] ? n - i : i];
        }
    }
}

/** The inner points of a grid as a Coons patch of its border. */
static void blend_grid(qm_vec grid[QM_LAYOUT_GRID_POINTS])
{
    const int n = QM_LAYOUT_GRID, w = n + 1;
    for (int row = 1; row < n; row++)
        for (int column = 1; column < n; column++) {
            double u = (double)column / n, v = (double)row / n;
            qm_vec across = qm_vec_mix(grid[row * w], grid[row * w + n], u),
                   along = qm_vec_mix(grid[column], grid[n * w + column], v),
                   corners = qm_vec_mix(qm_vec_mix(grid[0], grid[n], u),
                                        qm_vec_mix(grid[n * w], grid[n * w + n], u), v);
            grid[row * w + column] = qm_vec_sub(qm_vec_add(across, along), corners);
        }
}

/** The inner points of a grid in a chart of its patch, whose corners are at the diagonals. False when out of memory. */
static bool chart_grid(router *r, uint32_t patch, const bool *closed, qm_vec grid[QM_LAYOUT_GRID_POINTS])
{
    uint32_t dart[4], start[4];
    size_t place[5] = {0};
    patch_darts(r, patch, dart);
    for (int k = 0; k < 4; k++) {
        start[k] = labelled_edge(r, r->vertex[start_node(r, dart[k])], dart[k] / 2);
        if (start[k] == QM_NO_INDEX) return true;
    }
    disc d;
    bool is_made;
    if (!gather(r, start[0] / 3, closed, &d, &is_made)) return false;
    if (!is_made) return true;
    for (int k = 0; k < 4; k++) {
        if (r->stamp[start[k] / 3] != r->stamp_value) return true;
        uint32_t corner = corner_at(r, &d, start[k]);
        while (place[k] < d.ring_count && d.ring[place[k]] != corner)
            place[k]++;
    }
    for (int k = 0; k < 4; k++) {
        size_t end = place[(k + 1) & 3], count = (end + d.ring_count - place[k]) % d.ring_count;
        place_arc(&d, place[k], count, (225.0 + 90.0 * k) * QM_DEGREE, 90.0 * QM_DEGREE);
    }
    for (size_t i = 0; i < d.ring_count; i++)
        if (!d.is_fixed[d.ring[i]]) return true;
    if (!qm_tmesh_chart_flatten(r->arena, &d.chart, d.is_fixed, &is_made)) return false;
    const int n = QM_LAYOUT_GRID;
    uint32_t triangle = 0;
    for (int row = 1; row < n && is_made; row++)
        for (int column = 1; column < n; column++) {
            double x = 2.0 * column / n - 1, y = 2.0 * row / n - 1;
            qm_tmesh_flat at = {x * sqrt(1 - y * y / 2), y * sqrt(1 - x * x / 2)};
            if (r->turn[patch] < 0) at = (qm_tmesh_flat){at.v, at.u};
            qm_vec on;
            if (qm_tmesh_chart_lift(&d.chart, at, &triangle, &on)) grid[row * (n + 1) + column] = on;
        }
    return true;
}

static qm_status write_layout(router *r, double *grids, qm_layout *out)
{
    const qm_layout *layout = r->layout;
    qm_status status = QM_OK;
    for (uint32_t n = 0; n < layout->node_count && status == QM_OK; n++) {
        double at[3];
        qm_vec_store(at, r->m.position[r->vertex[n]]);
        status = qm_layout_add_node(r->ctx, out, at);
    }
    for (uint32_t c = 0; c < layout->curve_count && status == QM_OK && !r->is_lost; c++) {
        double *points;
        size_t count;
        if (!list_points(r, c, &points, &count)) return QM_E_NO_MEMORY;
        if (count < 2) r->is_lost = true;
        if (!r->is_lost && !grade_points(r, points, count, &points, &count)) return QM_E_NO_MEMORY;
        if (!r->is_lost)
            status =
                qm_layout_add_curve(r->ctx, out, layout->curves[c].from, layout->curves[c].to, points, count);
    }
    bool *closed = qm_arena_zeroed(r->arena, layout->curve_count, sizeof *closed);
    if (!closed) return QM_E_NO_MEMORY;
    for (uint32_t p = 0; p < layout->patch_count && status == QM_OK && !r->is_lost; p++) {
        uint32_t id[4];
        for (int k = 0; k < 4; k++)
            id[k] = layout->patches[p].side[k];
        status = qm_layout_add_patch(r->ctx, out, id);
    }
    for (uint32_t p = 0; p < layout->patch_count && status == QM_OK && !r->is_lost; p++) {
        qm_vec grid[QM_LAYOUT_GRID_POINTS];
        grid_border(out, p, grid);
        blend_grid(grid);
        if (!chart_grid(r, p, closed, grid)) return QM_E_NO_MEMORY;
        for (int i = 0; i < QM_LAYOUT_GRID_POINTS; i++)
            qm_vec_store(grids + 3 * ((size_t)QM_LAYOUT_GRID_POINTS * p + (size_t)i), grid[i]);
    }
    return status;
}

/** Fills the boundaries of the surface that the layout has not: all, or those shorter than the shortest that it has. */
static bool fill_holes(router *r)
{
    bool has_boundary = false;
    for (uint32_t c = 0; c < r->layout->curve_count; c++)
        has_boundary |= is_boundary(r, c);
    return has_boundary || qm_trimesh_fill_holes(r->ctx, &r->m, INFINITY) == QM_OK;
}

static int compare_lengths(const void *a, const void *b)
{
    double one = *(const double *)a, other = *(const double *)b;
    return (one > other) - (one < other);
}

/** Divides triangles that are large for the curves: ways lead through their middles. */
static bool refine(router *r)
{
    size_t curves = r->layout->curve_count, most = MOST_TIMES * r->m.face_count + MOST_BESIDES;
    double *length = qm_arena_alloc(r->arena, curves, sizeof *length);
    if (!length) return false;
    for (uint32_t c = 0; c < curves; c++)
        length[c] = curve_guide(r, c).length;
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
            if (!split_edge(r, longest, middle, &vertex)) return false;
            is_done = false;
        }
    }
    return true;
}

static bool prepare(router *r)
{
    if (qm_trimesh_copy(r->ctx, &r->triangles->mesh, &r->m) != QM_OK) return false;
    memset(r->m.step, 0, 3 * r->m.face_count * sizeof *r->m.step);
    r->most_faces = MOST_GROWTH * r->m.face_count + MOST_GROWN;
    return fill_holes(r) && refine(r) && place_nodes(r);
}

qm_status qm_tmesh_route(qm_arena *arena, const qm_tmesh_triangles *triangles, const qm_layout *layout,
                         const bool *is_fixed, const bool *is_line, const qm_tmesh_guides *guides,
                         double *grids, qm_layout *out, bool *is_made)
{
    router r = {
        .arena = arena, .ctx = arena->ctx, .triangles = triangles, .layout = layout, .guides = guides};
    bool is_ordered = false;
    *is_made = false;
    bool has_memory = order_darts(&r, grids, &is_ordered);
    if (has_memory && is_ordered) {
        has_memory = prepare(&r) && (r.is_lost || route_all(&r)) &&
                     (r.is_lost || straighten_all(&r, is_fixed, is_line));
        bool is_canceled = qm_context_canceled(r.ctx);
        qm_status status = has_memory && !r.is_lost && !is_canceled ? write_layout(&r, grids, out) : QM_OK;
        *is_made = has_memory && status == QM_OK && !r.is_lost && !is_canceled;
        has_memory = has_memory && status == QM_OK;
    }
    qm_trimesh_reset(r.ctx, &r.m);
    qm_heap_reset(r.ctx, &r.heap);
    if (!*is_made) qm_layout_reset(r.ctx, out);
    if (!has_memory) return qm_context_fail(r.ctx, QM_E_NO_MEMORY, "out of memory for the ways of curves");
    return qm_context_canceled(r.ctx) ? qm_context_fail(r.ctx, QM_E_CANCELED, "canceled") : QM_OK;
}
