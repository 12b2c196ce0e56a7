/**
 * quads_fit.c: the quads come nearer to the surface. Vertices that lie on a curved surface leave all of it on one side of the quads:
 * least squares over points of the surface lift them by about two thirds of the sagitta, and draw them out to tips that
 * were cut off. Points that are farther away count for more, so that the greatest distance falls too.
 *
 * On the way vertices move along the surface, such that the angles of quads come nearer to right ones.
 *
 * Vertices of features stay where they are, and no vertex moves so far that a quad becomes bad.
 */
#include <string.h>

#include "mesh/quad_shape.h"
#include "qm/project.h"
#include "quads/quads_sides.h"

#define ROUNDS 12
#define SQUARE_ROUNDS 10 /* in which quads are made rectangular, too: afterwards vertices only come nearer */
#define PASSES 6         /* over the ways, in each round */
#define POINTS 4.0       /* of the surface, for each quad */
#define MOST_VERTICES 8  /* of the surface, for each quad: of more, every second and so on is taken */
#define LEAST_SINE 0.4   /* of quads after a move, unless they were worse before it */
#define CLEARLY 0.99     /* nearer is a diagonal whose distance is less by this factor */
/* Ways have FAR_WEIGHT more for each FAR_SHARE mean squares of the distances, up to MOST_SHARES of these. */
#define FAR_WEIGHT 4.0
#define FAR_SHARE 16.0
#define MOST_SHARES 8.0
#define NEAR_SHARE 1e-2 /* of the root mean square: a shorter way has no direction */
#define ROUNDING 1e-12  /* of the diagonal: a way that is no longer comes from rounding */
#define SEEK_ROUNDS                                                                                          \
    6 /* where nearest points are followed, they are sought in all quads once in so many rounds */
#define MOST_WALK 8       /* faces that a nearest point is followed over in a round */
#define FOLLOW_BLOCK 2048 /* points that a worker follows at once */

/** Along which the quads are wanted to move at a point of them, how far, and how much that counts. */
typedef struct fit_way {
    qm_vec direction;
    double length, weight;
} fit_way;

typedef struct fit {
    qm_context *ctx;
    qm_quads_sides sides;
    const qm_bvh *bvh;
    const qm_mesh *surface; /* its mesh */
    size_t count;           /* of points */
    double *point, *nearest, *uv;
    qm_vec *normal; /* of the surface, at each point; 0: none */
    qm_vec *facing; /* unit normals of the quads */
    uint32_t *face;
    double *foot; /* of each vertex, on the surface */
    double *from; /* of each vertex: where it was when its foot was sought */
    fit_way *way; /* of each point, then of each vertex */
    qm_vec *move; /* of each vertex */
    qm_vec *pull; /* of each vertex: sum of weights times what is left of its ways */
    double *weight;
    double rounding; /* the length of a way that comes from it */
    int thread_count;
} fit;

static void surface_corners(const qm_mesh *m, size_t face, int part, qm_vec out[3])
{
    const uint32_t *c = m->faces + 4 * face;
    const uint32_t corner[3] = {c[0], c[1 + part], c[2 + part]};
    for (int k = 0; k < 3; k++)
        out[k] = qm_vec_load(m->positions + 3 * (size_t)corner[k]);
}

/** Adds a point for each share of area; returns the number of points. Nothing is written where point is NULL. */
static size_t sample_faces(const qm_mesh *m, double share, double *point, qm_vec *normal)
{
    size_t count = 0;
    double sum = 0.5 * share;
    for (size_t f = 0; f < m->face_count; f++) {
        int parts = m->faces[4 * f + 3] == QM_NO_INDEX ? 1 : 2;
        for (int part = 0; part < parts; part++) {
            qm_vec p[3];
            surface_corners(m, f, part, p);
            qm_vec n = qm_vec_cross(qm_vec_sub(p[1], p[0]), qm_vec_sub(p[2], p[0]));
            double length = qm_vec_norm(n);
            for (sum += 0.5 * length; sum >= share; sum -= share, count++) {
                if (!point) continue;
                /* an additive recurrence of low discrepancy in the unit square, folded onto the triangle */
                double a = fmod(0.5 + 0.7548776662466927 * (double)count, 1.0),
                       b = fmod(0.5 + 0.5698402909980532 * (double)count, 1.0);
                if (a + b > 1.0) a = 1.0 - a, b = 1.0 - b;
                qm_vec at =
                    qm_vec_axpy(qm_vec_axpy(p[0], a, qm_vec_sub(p[1], p[0])), b, qm_vec_sub(p[2], p[0]));
                qm_vec_store(point + 3 * count, at);
                normal[count] = qm_vec_scale(1.0 / length, n);
            }
        }
    }
    return count;
}

static double area_of(const qm_mesh *m)
{
    double sum = 0.0;
    for (size_t f = 0; f < m->face_count; f++) {
        for (int part = 0; part < (m->faces[4 * f + 3] == QM_NO_INDEX ? 1 : 2); part++) {
            qm_vec p[3];
            surface_corners(m, f, part, p);
            sum += 0.5 * qm_vec_norm(qm_vec_cross(qm_vec_sub(p[1], p[0]), qm_vec_sub(p[2], p[0])));
        }
    }
    return sum;
}

/** Points of the faces by area, then vertices: a tip is one of these. */
static qm_status choose_points(fit *w)
{
    const qm_mesh *m = w->surface;
    double quads = (double)w->sides.face_count, share = area_of(m) / (POINTS * quads);
    size_t inner = sample_faces(m, share, NULL, NULL), most = MOST_VERTICES * w->sides.face_count;
    size_t stride = 1 + m->vertex_count / (most + 1), corners = (m->vertex_count + stride - 1) / stride;
    w->count = inner + corners;
    w->point = qm_context_alloc(w->ctx, w->count, 3 * sizeof *w->point);
    w->nearest = qm_context_alloc(w->ctx, w->count, 3 * sizeof *w->nearest);
    w->uv = qm_context_alloc(w->ctx, w->count, 2 * sizeof *w->uv);
    w->normal = qm_context_alloc(w->ctx, w->count, sizeof *w->normal);
    w->face = qm_context_alloc(w->ctx, w->count, sizeof *w->face);
    w->pull = qm_context_alloc(w->ctx, w->sides.vertex_count, sizeof *w->pull);
    w->foot = qm_context_alloc(w->ctx, w->sides.vertex_count, 3 * sizeof *w->foot);
    w->facing = qm_context_alloc(w->ctx, w->sides.face_count, sizeof *w->facing);
    w->from = qm_context_alloc(w->ctx, w->sides.vertex_count, 3 * sizeof *w->from);
    w->way = qm_context_alloc(w->ctx, w->count + w->sides.vertex_count, sizeof *w->way);
    w->move = qm_context_alloc(w->ctx, w->sides.vertex_count, sizeof *w->move);
    w->weight = qm_context_alloc(w->ctx, w->sides.vertex_count, sizeof *w->weight);
    if (!(w->point && w->nearest && w->uv && w->normal && w->face && w->pull && w->weight && w->foot &&
          w->from && w->facing && w->way && w->move))
        return QM_E_NO_MEMORY;
    sample_faces(m, share, w->point, w->normal);
    for (size_t i = 0; i < corners; i++) {
        memcpy(w->point + 3 * (inner + i), m->positions + 3 * (i * stride), 3 * sizeof *w->point);
        w->normal[inner + i] = (qm_vec){0, 0, 0};
    }
    return QM_OK;
}

static qm_vec step_from(const double *a, const double *b)
{
    return qm_vec_sub(qm_vec_load(b), qm_vec_load(a));
}

/** The nearest point of a face. */
typedef struct fit_foot {
    qm_vec position;
    double distance2, uv[2];
} fit_foot;

/**
 * Offers the nearest point of the triangle a b c, by the region of the plane that p is over; its weights, those of b and c, are exact on
 * sides. The vertices move in each round: the frames of prim/triangle.h, made anew each time, take a tenth longer for a semi-regular mesh.
 *
 * Source: C. Ericson, Real-time collision detection, 2005, section 5.1.5.
 */
static bool offer_triangle(qm_vec p, qm_vec a, qm_vec b, qm_vec c, double *distance2, qm_vec *position,
                           double weight[2])
{
    qm_vec ab = qm_vec_sub(b, a), ac = qm_vec_sub(c, a), ap = qm_vec_sub(p, a);
    double d1 = qm_vec_dot(ab, ap), d2 = qm_vec_dot(ac, ap), bb = qm_vec_norm2(ab), cc = qm_vec_norm2(ac),
           bc = qm_vec_dot(ab, ac), d3 = d1 - bb, d4 = d2 - bc, d5 = d1 - bc, d6 = d2 - cc;
    double va = d3 * d6 - d5 * d4, vb = d5 * d2 - d1 * d6, vc = d1 * d4 - d3 * d2, v, u;
    if (d1 <= 0.0 && d2 <= 0.0) {
        u = 0.0, v = 0.0;
    } else if (d3 >= 0.0 && d4 <= d3) {
        u = 1.0, v = 0.0;
    } else if (d6 >= 0.0 && d5 <= d6) {
        u = 0.0, v = 1.0;
    } else if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) {
        u = d1 / (d1 - d3), v = 0.0;
    } else if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) {
        u = 0.0, v = d2 / (d2 - d6);
    } else if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0) {
        v = (d4 - d3) / ((d4 - d3) + (d5 - d6)), u = 1.0 - v;
    } else {
        double sum = va + vb + vc;
        u = vb / sum, v = vc / sum;
    }
    qm_vec at = qm_vec_axpy(qm_vec_axpy(a, u, ab), v, ac);
    double own = qm_vec_norm2(qm_vec_sub(p, at));
    if (!(own < *distance2)) return false;
    *distance2 = own;
    *position = at;
    weight[0] = u, weight[1] = v;
    return true;
}

/** Offers the nearest point of a face, read as two triangles. */
static bool offer_face(const qm_quads_sides *t, uint32_t face, qm_vec p, fit_foot *best)
{
    qm_vec corner[4];
    double weight[2];
    bool is_nearer = false;
    for (uint32_t k = 0; k < 4; k++)
        corner[k] = qm_quads_at(t, qm_quads_from(t, 4 * face + k));
    if (offer_triangle(p, corner[0], corner[1], corner[2], &best->distance2, &best->position, weight)) {
        best->uv[0] = qm_min(weight[0] + weight[1], 1.0), best->uv[1] = weight[1];
        if (weight[1] > 0.0 && weight[0] + weight[1] >= 1.0) best->uv[0] = 1.0;
        is_nearer = true;
    }
    if (offer_triangle(p, corner[0], corner[2], corner[3], &best->distance2, &best->position, weight)) {
        best->uv[0] = weight[0], best->uv[1] = qm_min(weight[0] + weight[1], 1.0);
        is_nearer = true;
    }
    return is_nearer;
}

/** Offers the faces round the side or the corner of a face that its nearest point lies on; returns the nearest of them all. */
static uint32_t offer_neighbours(const qm_quads_sides *t, uint32_t face, qm_vec p, fit_foot *best)
{
    const double u = best->uv[0], v = best->uv[1];
    const bool is_on[4] = {v <= 0.0, u >= 1.0, v >= 1.0, u <= 0.0};
    uint32_t nearest = face;
    for (uint32_t k = 0; k < 4; k++) {
        if (!is_on[k]) continue;
        uint32_t side = 4 * face + k, twin = t->twin[side];
        if (twin != QM_NO_INDEX && offer_face(t, twin / 4, p, best)) nearest = twin / 4;
        if (!is_on[(k + 3) % 4]) continue;
        uint32_t first = qm_quads_first_side(t, qm_quads_from(t, side)), s = first;
        do {
            if (s / 4 != face && offer_face(t, s / 4, p, best)) nearest = s / 4;
            s = qm_quads_around(t, s);
        } while (s != QM_NO_INDEX && s != first);
    }
    return nearest;
}

/** Follows the nearest points of a block from face to face. */
static void follow_block(void *data, int worker, size_t block)
{
    fit *w = data;
    (void)worker;
    size_t end = FOLLOW_BLOCK * (block + 1);
    for (size_t i = FOLLOW_BLOCK * block; i < end && i < w->count; i++) {
        qm_vec p = qm_vec_load(w->point + 3 * i);
        fit_foot best = {.distance2 = INFINITY};
        uint32_t face = w->face[i];
        offer_face(&w->sides, face, p, &best);
        for (int step = 0; step < MOST_WALK; step++) {
            uint32_t next = offer_neighbours(&w->sides, face, p, &best);
            if (next == face) break;
            face = next;
        }
        w->face[i] = face;
        qm_vec_store(w->nearest + 3 * i, best.position);
        w->uv[2 * i] = best.uv[0], w->uv[2 * i + 1] = best.uv[1];
    }
}

/** Seeks the nearest points in all quads. */
static qm_status seek_feet(fit *w)
{
    qm_bvh *bvh = NULL;
    const qm_projection out = {.position = w->nearest, .face = w->face, .uv = w->uv};
    qm_status status = qm_bvh_build(w->ctx, &w->sides.r->mesh, QM_BVH_TARGET, w->thread_count, &bvh);
    if (status == QM_OK)
        status =
            qm_project_points(w->ctx, bvh, QM_QUADS_TRIANGLES, w->point, w->count, w->thread_count, &out);
    qm_bvh_destroy(w->ctx, bvh);
    const qm_projection back = {.position = w->foot};
    size_t vertices = w->sides.vertex_count;
    const double *positions = w->sides.r->mesh.positions;
    memcpy(w->from, positions, 3 * vertices * sizeof *w->from);
    if (status == QM_OK)
        status = qm_project_points(w->ctx, w->bvh, QM_QUADS_TRIANGLES, positions, vertices, w->thread_count,
                                   &back);
    return status;
}

/** Follows the nearest points of the points; a vertex that has moved takes its foot along the plane that its way was normal to. */
static void follow_feet(fit *w)
{
    const double *positions = w->sides.r->mesh.positions;
    qm_context_parallel_for(w->ctx, w->thread_count, (w->count + FOLLOW_BLOCK - 1) / FOLLOW_BLOCK,
                            follow_block, w);
    for (size_t i = 0; i < 3 * w->sides.vertex_count; i += 3) {
        qm_vec way = step_from(w->from + i, w->foot + i), move = step_from(w->from + i, positions + i);
        double length2 = qm_vec_norm2(way);
        if (length2 > w->rounding * w->rounding)
            move = qm_vec_axpy(move, -qm_vec_dot(move, way) / length2, way);
        qm_vec_store(w->foot + i, qm_vec_add(qm_vec_load(w->foot + i), move));
        memcpy(w->from + i, positions + i, 3 * sizeof *positions);
    }
}

/** The unit normal of a quad; 0 without area. */
static qm_vec normal_of(const qm_quads_sides *t, uint32_t face)
{
    qm_vec corner[4];
    for (uint32_t k = 0; k < 4; k++)
        corner[k] = qm_quads_at(t, qm_quads_from(t, 4 * face + k));
    qm_vec normal = qm_quad_normal(corner);
    double length = qm_vec_norm(normal);
    return length > 0.0 ? qm_vec_scale(1.0 / length, normal) : normal;
}

/** A way: along the normal where it is too short to have a direction of its own. */
static fit_way make_way(const fit *w, qm_vec step, qm_vec normal, double mean)
{
    double length = qm_vec_norm(step);
    if (length <= qm_max(NEAR_SHARE * sqrt(mean), w->rounding))
        return (fit_way){normal, qm_vec_dot(step, normal), 0.0};
    double far_weight = FAR_WEIGHT * qm_min(length * length / (FAR_SHARE * mean), MOST_SHARES);
    return (fit_way){qm_vec_scale(1.0 / length, step), length, far_weight};
}

/** The ways from the quads to the points, and those from the vertices back to the surface, which count where they are long. */
static void find_ways(fit *w)
{
    const qm_quads_sides *t = &w->sides;
    double mean = 0.0;
    for (size_t i = 0; i < w->count; i++)
        mean += qm_vec_norm2(step_from(w->nearest + 3 * i, w->point + 3 * i)) / (double)w->count;
    for (uint32_t f = 0; f < t->face_count; f++)
        w->facing[f] = normal_of(t, f);
    for (size_t i = 0; i < w->count; i++) {
        qm_vec normal = w->facing[w->face[i]];
        w->way[i] = make_way(w, step_from(w->nearest + 3 * i, w->point + 3 * i), normal, mean);
        w->way[i].weight += 1.0;
        if (qm_vec_dot(normal, w->normal[i]) < 0.0) w->way[i].weight = 0.0; /* other side of a thin part */
    }
    for (size_t v = 0; v < t->vertex_count; v++)
        w->way[w->count + v] =
            make_way(w, step_from(t->r->mesh.positions + 3 * v, w->foot + 3 * v), (qm_vec){0, 0, 0}, mean);
}

/** The vertices that a way moves, those of a triangle or one, and their shares; returns their number. */
static int vertices_of(const fit *w, size_t i, uint32_t vertex[3], double share[3])
{
    if (i >= w->count) {
        vertex[0] = (uint32_t)(i - w->count), share[0] = 1.0;
        return 1;
    }
    /* The triangles are c0 c1 c2 and c0 c2 c3. */
    const double u = w->uv[2 * i], v = w->uv[2 * i + 1];
    const uint32_t *corner = w->sides.r->mesh.faces + 4 * (size_t)w->face[i];
    const int diagonal = u > v ? 2 : 1;
    vertex[0] = corner[0], share[0] = 1.0 - qm_max(u, v);
    vertex[diagonal] = corner[2], share[diagonal] = qm_min(u, v);
    vertex[3 - diagonal] = corner[u > v ? 1 : 3], share[3 - diagonal] = fabs(u - v);
    return 3;
}

/** Moves of the vertices by least squares of the ways that are left along their directions: Jacobi's iteration with lumped weights. */
static void find_moves(fit *w)
{
    const qm_quads_sides *t = &w->sides;
    memset(w->move, 0, t->vertex_count * sizeof *w->move);
    memset(w->weight, 0, t->vertex_count * sizeof *w->weight);
    for (int pass = 0; pass < PASSES; pass++) {
        memset(w->pull, 0, t->vertex_count * sizeof *w->pull);
        for (size_t i = 0; i < w->count + t->vertex_count; i++) {
            const fit_way *way = &w->way[i];
            uint32_t vertex[3];
            double share[3], left = way->length;
            if (!(way->weight > 0.0)) continue; /* most of those of vertices */
            int corners = vertices_of(w, i, vertex, share);
            for (int k = 0; k < corners; k++)
                left -= share[k] * qm_vec_dot(w->move[vertex[k]], way->direction);
            for (int k = 0; k < corners; k++) {
                double weight = way->weight * share[k];
                w->pull[vertex[k]] = qm_vec_axpy(w->pull[vertex[k]], weight * left, way->direction);
                if (pass == 0) w->weight[vertex[k]] += weight;
            }
        }
        for (size_t v = 0; v < t->vertex_count; v++)
            if (w->weight[v] > 0.0 && t->kind[v] == QM_TRIMESH_FREE)
                w->move[v] = qm_vec_axpy(w->move[v], 1.0 / w->weight[v], w->pull[v]);
    }
}

/** Adds moves along the surface to where vertices would be corners of rectangles with the centres and diagonals of their quads, in the
 * mean: those diagonals would bisect each other, and be of equal lengths. */
static void square_up(fit *w)
{
    const qm_quads_sides *t = &w->sides;
    for (uint32_t v = 0; v < t->vertex_count; v++) {
        if (t->kind[v] != QM_TRIMESH_FREE) continue;
        qm_vec sum = {0, 0, 0}, normal = {0, 0, 0};
        double count = 0.0;
        uint32_t first = qm_quads_first_side(t, v), s = first;
        do {
            qm_vec corner[4];
            for (uint32_t k = 0; k < 4; k++)
                corner[k] = qm_quads_at(t, qm_quads_from(t, s / 4 * 4 + (s + k) % 4));
            qm_vec own = qm_vec_sub(corner[0], corner[2]), other = qm_vec_sub(corner[1], corner[3]);
            qm_vec centre =
                qm_vec_mix(qm_vec_mix(corner[0], corner[2], 0.5), qm_vec_mix(corner[1], corner[3], 0.5), 0.5);
            double length = qm_vec_norm(own);
            double half = length > 0.0 ? 0.25 * (1.0 + qm_vec_norm(other) / length) : 0.0;
            sum = qm_vec_add(sum, qm_vec_sub(qm_vec_axpy(centre, half, own), corner[0]));
            normal = qm_vec_add(normal, qm_quad_normal(corner));
            count += 1.0;
            s = qm_quads_around(t, s);
        } while (s != QM_NO_INDEX && s != first);
        double length2 = qm_vec_norm2(normal);
        if (length2 > 0.0) sum = qm_vec_axpy(sum, -qm_vec_dot(sum, normal) / length2, normal);
        w->move[v] = qm_vec_axpy(w->move[v], 1.0 / count, sum);
    }
}

/** Of the quads round a vertex. */
typedef struct ring_state {
    double sine;   /* the least scaled Jacobian */
    double facing; /* the least of those where one that looks away from the others counts as folded */
} ring_state;

static ring_state look_at_ring(const qm_quads_sides *t, uint32_t v)
{
    qm_vec sum = {0, 0, 0};
    uint32_t first = qm_quads_first_side(t, v), s;
    ring_state least = {1.0, 1.0};
    for (int pass = 0; pass < 2; pass++) {
        s = first;
        do {
            qm_vec corner[4];
            for (uint32_t k = 0; k < 4; k++)
                corner[k] = qm_quads_at(t, qm_quads_from(t, s / 4 * 4 + k));
            qm_vec normal = qm_quad_normal(corner);
            if (pass == 0) {
                sum = qm_vec_add(sum, normal);
            } else {
                double sine = qm_quad_min_sine(corner);
                least.sine = qm_min(least.sine, sine);
                least.facing = qm_min(least.facing, qm_vec_dot(normal, sum) < 0.0 ? -fabs(sine) : sine);
            }
            s = qm_quads_around(t, s);
        } while (s != QM_NO_INDEX && s != first);
    }
    return least;
}

static void move_vertices(fit *w)
{
    qm_quads_sides *t = &w->sides;
    for (uint32_t v = 0; v < t->vertex_count; v++) {
        if (t->kind[v] != QM_TRIMESH_FREE) continue;
        double *here = t->r->mesh.positions + 3 * (size_t)v;
        ring_state before = look_at_ring(t, v);
        qm_vec start = qm_vec_load(here);
        for (double share = 1.0; share > 0.2; share /= 2.0) {
            qm_vec_store(here, qm_vec_axpy(start, share, w->move[v]));
            ring_state after = look_at_ring(t, v);
            if (after.sine >= qm_min(before.sine, LEAST_SINE) &&
                after.facing >= qm_min(before.facing, LEAST_SINE))
                break;
            qm_vec_store(here, start);
        }
    }
}

/** The middles of both diagonals of each quad: that from corner 0 to 2 first. */
static void list_middles(const qm_mesh *m, double *out)
{
    for (size_t d = 0; d < 2 * m->face_count; d++) {
        const uint32_t *c = m->faces + 4 * (d / 2) + d % 2;
        qm_vec a = qm_vec_load(m->positions + 3 * (size_t)c[0]),
               b = qm_vec_load(m->positions + 3 * (size_t)c[2]);
        qm_vec_store(out + 3 * d, qm_vec_mix(a, b, 0.5));
    }
}

static void shift_corners(qm_quads_result *r, size_t face)
{
    uint32_t *c = r->mesh.faces + 4 * face, first = c[0];
    uint8_t *feature = r->is_feature + 4 * face, first_feature = feature[0];
    memmove(c, c + 1, 3 * sizeof *c);
    memmove(feature, feature + 1, 3 * sizeof *feature);
    c[3] = first, feature[3] = first_feature;
}

qm_status qm_quads_choose_diagonals(qm_context *ctx, qm_quads_result *r, const qm_bvh *surface,
                                    int thread_count)
{
    size_t count = 2 * r->mesh.face_count;
    double *middle = qm_context_alloc(ctx, count, 3 * sizeof *middle);
    double *distance = qm_context_alloc(ctx, count, sizeof *distance);
    qm_status status = middle && distance ? QM_OK : QM_E_NO_MEMORY;
    if (status == QM_OK) {
        const qm_projection out = {.distance = distance};
        list_middles(&r->mesh, middle);
        status = qm_project_points(ctx, surface, QM_QUADS_TRIANGLES, middle, count, thread_count, &out);
    }
    for (size_t f = 0; f < r->mesh.face_count && status == QM_OK; f++)
        if (distance[2 * f + 1] < CLEARLY * distance[2 * f]) shift_corners(r, f);
    qm_context_free(ctx, middle, count, 3 * sizeof *middle);
    qm_context_free(ctx, distance, count, sizeof *distance);
    return status;
}

qm_status qm_quads_fit(qm_context *ctx, qm_quads_result *r, const qm_bvh *surface, bool follows,
                       int thread_count)
{
    fit w = {.ctx = ctx, .bvh = surface, .surface = qm_bvh_mesh(surface), .thread_count = thread_count};
    const qm_box box = qm_mesh_bounding_box(w.surface);
    w.rounding = ROUNDING * qm_mesh_box_diagonal(&box);
    qm_status status = qm_quads_sides_build(ctx, r, &w.sides);
    size_t vertices = w.sides.vertex_count;
    if (status == QM_OK) status = choose_points(&w);
    for (int round = 0; round < ROUNDS && status == QM_OK; round++) {
        if (follows && round % SEEK_ROUNDS > 0)
            follow_feet(&w);
        else
            status = seek_feet(&w);
        if (status != QM_OK) break;
        find_ways(&w);
        find_moves(&w);
        if (round < SQUARE_ROUNDS) square_up(&w);
        move_vertices(&w);
    }
    qm_context_free(ctx, w.point, w.count, 3 * sizeof *w.point);
    qm_context_free(ctx, w.nearest, w.count, 3 * sizeof *w.nearest);
    qm_context_free(ctx, w.uv, w.count, 2 * sizeof *w.uv);
    qm_context_free(ctx, w.normal, w.count, sizeof *w.normal);
    qm_context_free(ctx, w.face, w.count, sizeof *w.face);
    qm_context_free(ctx, w.pull, vertices, sizeof *w.pull);
    qm_context_free(ctx, w.foot, vertices, 3 * sizeof *w.foot);
    qm_context_free(ctx, w.facing, w.sides.face_count, sizeof *w.facing);
    qm_context_free(ctx, w.from, vertices, 3 * sizeof *w.from);
    qm_context_free(ctx, w.way, w.count + vertices, sizeof *w.way);
    qm_context_free(ctx, w.move, vertices, sizeof *w.move);
    qm_context_free(ctx, w.weight, vertices, sizeof *w.weight);
    qm_quads_sides_reset(&w.sides);
    return status;
}
