/**
 * quads_polish.c: vertices of quads are centred among their neighbours and projected, those of features onto the features.
 *
 * Spreading them gives neighbours weights: the height of the surface over the side to them, which goes as its length times the angle
 * between the normals at its ends, and terms that are the same for all sides and in the square of its length, so that flat parts get vertices
 * too, in even rows. Heights become more equal, and vertices are drawn to tips, off which equal weights draw them. Moves go on with a part of the
 * last one (Polyak 1964), and vertices stay for a round where a quad would become poor.
 */
#include "quads/quads_internal.h"

#include <string.h>

#include "mesh/quad_shape.h"

#define ROUNDS 5 /* more would draw vertices off tips */
#define LINE_ROUNDS                                                                                          \
    20 /* before that, of vertices of features alone, whose sides may be twice as long as others */
/* Where weights go as squares of lengths, a vertex that comes nearer to one neighbour is drawn back three times as much as with
 * equal ones: moves of more than a third of the way to the mean would not settle. With MOMENTUM of the last move they settle in a tenth of the
 * rounds. */
#define SPREAD_ROUNDS 120
#define SPREAD_STEP 0.3
#define MOMENTUM 0.9
#define HEIGHT_ROUNDS 30 /* after which heights over quads are found again */
#define BEND_OF_HEIGHT                                                                                       \
    4.0 /* of an arc: length times turn; a quad bends both ways, each of which gives it an eighth of that as height */
#define MOST_MOVED                                                                                           \
    0.1 /* of a side, before a vertex is projected: moves along the surface leave it by their squares only */
#define FLAT_TURN 40.0 /* curvature that flat parts are given: radians along the diagonal */
#define EVEN 4.0       /* squares of the side of a quad, to which the square of a length is added for that */

typedef struct polish {
    qm_context *ctx;
    qm_quads_result *r;
    qm_quads_target surface, features;
    uint32_t *start, *corner; /* the corners (4 * face + k) at each vertex */
    uint8_t *kind;            /* of each vertex, QM_TRIMESH_FREE ... */
    uint32_t (*line)[2];      /* of vertices on features: the two neighbours along them */
    double *target, *nearest;
    double *moved;                  /* of each vertex: how far since it was projected */
    qm_vec *goal, *normal, *toward; /* of each vertex */
    qm_vec *last;                   /* move of each vertex, where they are spread */
    uint8_t *is_sure;               /* its normal tells which wall it is on */
    uint8_t *stays;                 /* for this round */
    const uint8_t *is_free;         /* it never stays */
    uint32_t *active;               /* the vertices that may move */
    size_t active_count;
    int line_rounds, rounds;
    bool spreads;
    double flat;    /* curvature that is added everywhere */
    double even;    /* squared length that is added to those of sides for it */
    double *height; /* of each vertex: of the surface over the middles of its quads, at most */
    double side;    /* of a quad */
    int thread_count;
} polish;

static qm_vec at(const polish *p, uint32_t vertex)
{
    return qm_vec_load(p->r->mesh.positions + 3 * (size_t)vertex);
}

static uint32_t corner_vertex(const polish *p, uint32_t face, uint32_t k)
{
    return p->r->mesh.faces[4 * (size_t)face + (k & 3)];
}

static void face_corners(const polish *p, uint32_t face, qm_vec out[4])
{
    for (uint32_t k = 0; k < 4; k++)
        out[k] = at(p, corner_vertex(p, face, k));
}

static void list_corners(polish *p)
{
    const qm_mesh *m = &p->r->mesh;
    memset(p->start, 0, (m->vertex_count + 1) * sizeof *p->start);
    for (size_t c = 0; c < 4 * m->face_count; c++)
        p->start[m->faces[c] + 1]++;
    for (size_t v = 0; v < m->vertex_count; v++)
        p->start[v + 1] += p->start[v];
    for (size_t c = 4 * m->face_count; c-- > 0;)
        p->corner[--p->start[m->faces[c] + 1]] = (uint32_t)c;
    /* start[v + 1] is now where v begins: shift back */
    for (size_t v = 0; v < m->vertex_count; v++)
        p->start[v] = p->start[v + 1];
    p->start[m->vertex_count] = (uint32_t)(4 * m->face_count);
}

static void add_line(polish *p, uint32_t vertex, uint32_t other)
{
    if (p->kind[vertex] > 0 && p->line[vertex][0] == other) return; /* the twin */
    if (p->kind[vertex] > 1 && p->line[vertex][1] == other) return;
    if (p->kind[vertex] < 2) p->line[vertex][p->kind[vertex]] = other;
    if (p->kind[vertex] < 3) p->kind[vertex]++;
}

static void find_kinds(polish *p)
{
    const qm_mesh *m = &p->r->mesh;
    memset(p->kind, 0, m->vertex_count);
    for (size_t c = 0; c < 4 * m->face_count; c++) {
        if (!p->r->is_feature[c]) continue;
        uint32_t a = m->faces[c], b = corner_vertex(p, (uint32_t)(c / 4), (uint32_t)(c % 4 + 1));
        add_line(p, a, b);
        add_line(p, b, a);
    }
    for (size_t v = 0; v < m->vertex_count; v++) {
        int count = p->kind[v];
        p->kind[v] = count == 0 ? QM_TRIMESH_FREE : count == 2 ? QM_TRIMESH_ON_LINE : QM_TRIMESH_CORNER;
        if (p->r->is_fixed[v]) p->kind[v] = QM_TRIMESH_CORNER;
    }
}

/** The normal of a vertex. It tells of a wall where those of its faces agree, but not at the tip of a horn. */
static qm_vec vertex_normal(const polish *p, uint32_t v, uint8_t *is_sure)
{
    qm_vec sum = {0, 0, 0}, corner[4];
    double lengths = 0.0;
    for (uint32_t k = p->start[v]; k < p->start[v + 1]; k++) {
        face_corners(p, p->corner[k] / 4, corner);
        qm_vec normal = qm_quad_normal(corner);
        sum = qm_vec_add(sum, normal);
        lengths += qm_vec_norm(normal);
    }
    double length = qm_vec_norm(sum);
    *is_sure = length > QM_QUADS_SURE * lengths;
    return length > QM_MIN_LENGTH ? qm_vec_scale(1.0 / length, sum) : (qm_vec){0, 0, 0};
}

/** The weight of a neighbour. */
static double weight_of(const polish *p, uint32_t v, uint32_t other)
{
    if (!p->spreads) return 1.0;
    double length2 = qm_vec_norm2(qm_vec_sub(at(p, other), at(p, v)));
    double bend = sqrt(length2 * qm_vec_norm2(qm_vec_sub(p->normal[other], p->normal[v])));
    return p->flat * (length2 + p->even) +
           qm_max(bend, BEND_OF_HEIGHT * qm_max(p->height[v], p->height[other]));
}

/** Where a vertex would lie best: the mean of its neighbours, without the part along the normal. */
static qm_vec centred(const polish *p, uint32_t v)
{
    qm_vec here = at(p, v), sum = {0, 0, 0};
    if (p->kind[v] == QM_TRIMESH_CORNER || p->start[v] == p->start[v + 1]) return here;
    if (p->kind[v] == QM_TRIMESH_ON_LINE) {
        /* parallel to the chord: round a hole of three or four quads the mean itself is nearest to the opposite side */
        qm_vec from = at(p, p->line[v][0]), chord = qm_vec_sub(at(p, p->line[v][1]), from);
        double length2 = qm_vec_norm2(chord);
        if (!(length2 > 0.0)) return here;
        double share = qm_vec_dot(qm_vec_sub(here, from), chord) / length2;
        return qm_vec_axpy(here, 0.5 - share, chord);
    }
    double weights = 0.0;
    for (uint32_t k = p->start[v]; k < p->start[v + 1]; k++) {
        uint32_t other = corner_vertex(p, p->corner[k] / 4, p->corner[k] + 1);
        double weight = weight_of(p, v, other);
        sum = qm_vec_axpy(sum, weight, at(p, other));
        weights += weight;
    }
    if (!(weights > 0.0)) return here;
    qm_vec move = qm_vec_sub(qm_vec_scale(1.0 / weights, sum), here);
    if (p->spreads) move = qm_vec_axpy(qm_vec_scale(SPREAD_STEP, move), MOMENTUM, p->last[v]);
    qm_vec normal = p->normal[v];
    return qm_vec_add(here, qm_vec_axpy(move, -qm_vec_dot(move, normal), normal));
}

/** The vertices of quads that would become poor, or worse, stay. */
static void hold_poor(polish *p)
{
    const qm_mesh *m = &p->r->mesh;
    memset(p->stays, 0, m->vertex_count);
    for (uint32_t f = 0; f < m->face_count; f++) {
        qm_vec before[4], after[4];
        face_corners(p, f, before);
        for (uint32_t k = 0; k < 4; k++)
            after[k] = p->goal[corner_vertex(p, f, k)];
        double sine = qm_quad_min_sine(after);
        if (sine >= QM_QUADS_POOR_SINE || sine >= qm_quad_min_sine(before)) continue;
        for (uint32_t k = 0; k < 4; k++)
            p->stays[corner_vertex(p, f, k)] = 1;
    }
    for (uint32_t v = 0; v < m->vertex_count; v++) {
        if (p->stays[v] && !p->is_free[v]) p->goal[v] = at(p, v);
        p->last[v] = qm_vec_sub(p->goal[v], at(p, v));
    }
}

/** Moves the active vertices of a kind to their goals, and projects those that have moved by limit or more since they were. */
static qm_status move_kind(polish *p, uint8_t kind, const qm_quads_target *on, double limit)
{
    size_t count = 0;
    if (!on->bvh) return QM_OK;
    for (size_t k = 0; k < p->active_count; k++) {
        uint32_t v = p->active[k];
        if (p->kind[v] != kind) continue;
        p->moved[v] += qm_vec_distance(p->goal[v], at(p, v));
        qm_vec_store(p->r->mesh.positions + 3 * (size_t)v, p->goal[v]);
        if (p->moved[v] < limit) continue;
        qm_vec_store(p->target + 3 * count, p->goal[v]);
        p->toward[count++] = p->is_sure[v] ? p->normal[v] : (qm_vec){0, 0, 0};
    }
    qm_status status =
        qm_quads_project(p->ctx, on, p->target, p->toward, p->side, count, p->thread_count, p->nearest);
    count = 0;
    for (size_t k = 0; k < p->active_count && status == QM_OK; k++) {
        uint32_t v = p->active[k];
        if (p->kind[v] != kind || p->moved[v] < limit) continue;
        memcpy(p->r->mesh.positions + 3 * (size_t)v, p->nearest + 3 * count++, 3 * sizeof(double));
        p->moved[v] = 0.0;
    }
    return status;
}

/** Finds how far the surface is from the middles of the quads at each vertex: normals at corners do not tell of a crevice under a quad. */
static qm_status find_heights(polish *p)
{
    const qm_mesh *m = &p->r->mesh;
    qm_status status = QM_OK;
    memset(p->height, 0, m->vertex_count * sizeof *p->height);
    for (size_t first = 0; first < m->face_count && status == QM_OK; first += m->vertex_count) {
        size_t count = m->face_count - first < m->vertex_count ? m->face_count - first : m->vertex_count;
        for (size_t i = 0; i < count; i++) {
            qm_vec c[4];
            face_corners(p, (uint32_t)(first + i), c);
            qm_vec_store(p->target + 3 * i,
                         qm_vec_scale(0.25, qm_vec_add(qm_vec_add(c[0], c[1]), qm_vec_add(c[2], c[3]))));
            p->toward[i] = (qm_vec){0, 0, 0};
        }
        status = qm_quads_project(p->ctx, &p->surface, p->target, p->toward, p->side, count, p->thread_count,
                                  p->nearest);
        for (size_t i = 0; i < 4 * count && status == QM_OK; i++) {
            double *height = &p->height[m->faces[4 * first + i]];
            const double *a = p->target + 3 * (i / 4), *b = p->nearest + 3 * (i / 4);
            *height = qm_max(*height, qm_vec_distance(qm_vec_load(a), qm_vec_load(b)));
        }
    }
    return status;
}

static qm_status centre_all(polish *p, double limit)
{
    for (size_t k = 0; k < p->active_count; k++) {
        uint32_t v = p->active[k];
        p->normal[v] = vertex_normal(p, v, &p->is_sure[v]);
    }
    for (size_t k = 0; k < p->active_count; k++)
        p->goal[p->active[k]] = centred(p, p->active[k]);
    if (p->spreads) hold_poor(p);
    qm_status status = move_kind(p, QM_TRIMESH_FREE, &p->surface, limit);
    return status == QM_OK ? move_kind(p, QM_TRIMESH_ON_LINE, &p->features, 0.0) : status;
}

/** Centres vertices of features alone: these are few, and what they bound follows them. */
static qm_status centre_lines(polish *p)
{
    for (size_t k = 0; k < p->active_count; k++) {
        uint32_t v = p->active[k];
        if (p->kind[v] != QM_TRIMESH_ON_LINE) continue;
        p->normal[v] = vertex_normal(p, v, &p->is_sure[v]);
        p->goal[v] = centred(p, v);
    }
    return move_kind(p, QM_TRIMESH_ON_LINE, &p->features, 0.0);
}

/** The side of a square of the mean area. */
static double mean_side(const polish *p)
{
    const qm_mesh *m = &p->r->mesh;
    return sqrt(qm_quads_mesh_area(m) / qm_max((double)m->face_count, 1.0));
}

static qm_status run(polish *p, const uint8_t *moves)
{
    list_corners(p);
    p->side = mean_side(p);
    find_kinds(p);
    memset(p->moved, 0, p->r->mesh.vertex_count * sizeof *p->moved);
    memset(p->last, 0, p->r->mesh.vertex_count * sizeof *p->last);
    const qm_box box = qm_mesh_bounding_box(&p->r->mesh);
    p->even = EVEN * p->side * p->side;
    p->flat = FLAT_TURN / qm_max(qm_mesh_box_diagonal(&box), QM_MIN_LENGTH);
    for (uint32_t v = 0; v < p->r->mesh.vertex_count; v++)
        if (!moves || moves[v]) p->active[p->active_count++] = v;
    qm_status status = QM_OK;
    for (int round = 0; round < p->line_rounds && status == QM_OK; round++)
        status = centre_lines(p);
    for (int round = 0; round < p->rounds && status == QM_OK; round++) {
        if (p->spreads && round % HEIGHT_ROUNDS == 0) status = find_heights(p);
        if (status == QM_OK)
            status = centre_all(p, p->spreads && round + 1 < p->rounds ? MOST_MOVED * p->side : 0.0);
    }
    return status;
}

/** Moves the vertices that are marked, or all, by the rules of how. */
static qm_status polish_some(qm_context *ctx, qm_quads_result *r, const qm_bvh *surface, const uint8_t *moves,
                             const polish *how)
{
    size_t vertices = r->mesh.vertex_count, corners = 4 * r->mesh.face_count;
    qm_bvh *features = NULL;
    qm_status status = QM_OK;
    if (r->features.face_count > 0)
        status = qm_bvh_build(ctx, &r->features, QM_BVH_TARGET, how->thread_count, &features);
    polish p = *how;
    p.ctx = ctx;
    p.r = r;
    p.surface = (qm_quads_target){surface, NULL};
    p.features = (qm_quads_target){features, r->feature_normal};
    p.start = qm_context_alloc(ctx, vertices + 1, sizeof *p.start);
    p.corner = qm_context_alloc(ctx, corners, sizeof *p.corner);
    p.kind = qm_context_alloc(ctx, vertices, 1);
    p.line = qm_context_alloc(ctx, vertices, sizeof *p.line);
    p.target = qm_context_alloc(ctx, vertices, 3 * sizeof *p.target);
    p.nearest = qm_context_alloc(ctx, vertices, 3 * sizeof *p.nearest);
    p.moved = qm_context_alloc(ctx, vertices, sizeof *p.moved);
    p.goal = qm_context_alloc(ctx, vertices, sizeof *p.goal);
    p.last = qm_context_alloc(ctx, vertices, sizeof *p.last);
    p.height = qm_context_alloc(ctx, vertices, sizeof *p.height);
    p.normal = qm_context_alloc(ctx, vertices, sizeof *p.normal);
    p.toward = qm_context_alloc(ctx, vertices, sizeof *p.toward);
    p.is_sure = qm_context_alloc(ctx, vertices, 1);
    p.stays = qm_context_alloc(ctx, vertices, 1);
    p.active = qm_context_alloc(ctx, vertices, sizeof *p.active);
    bool has_memory = p.start && p.corner && p.kind && p.line && p.target && p.nearest && p.moved && p.goal &&
                      p.last && p.height && p.stays && p.normal && p.toward && p.is_sure && p.active;
    if (status == QM_OK) status = has_memory ? run(&p, moves) : QM_E_NO_MEMORY;
    qm_context_free(ctx, p.start, vertices + 1, sizeof *p.start);
    qm_context_free(ctx, p.corner, corners, sizeof *p.corner);
    qm_context_free(ctx, p.kind, vertices, 1);
    qm_context_free(ctx, p.line, vertices, sizeof *p.line);
    qm_context_free(ctx, p.target, vertices, 3 * sizeof *p.target);
    qm_context_free(ctx, p.nearest, vertices, 3 * sizeof *p.nearest);
    qm_context_free(ctx, p.moved, vertices, sizeof *p.moved);
    qm_context_free(ctx, p.goal, vertices, sizeof *p.goal);
    qm_context_free(ctx, p.last, vertices, sizeof *p.last);
    qm_context_free(ctx, p.height, vertices, sizeof *p.height);
    qm_context_free(ctx, p.normal, vertices, sizeof *p.normal);
    qm_context_free(ctx, p.toward, vertices, sizeof *p.toward);
    qm_context_free(ctx, p.is_sure, vertices, 1);
    qm_context_free(ctx, p.stays, vertices, 1);
    qm_context_free(ctx, p.active, vertices, sizeof *p.active);
    qm_bvh_destroy(ctx, features);
    return status;
}

qm_status qm_quads_polish(qm_context *ctx, qm_quads_result *r, const qm_bvh *surface, int thread_count)
{
    const polish how = {.rounds = ROUNDS, .line_rounds = LINE_ROUNDS, .thread_count = thread_count};
    return polish_some(ctx, r, surface, NULL, &how);
}

qm_status qm_quads_spread(qm_context *ctx, qm_quads_result *r, const qm_bvh *surface, const uint8_t *is_free,
                          int thread_count)
{
    const polish how = {
        .rounds = SPREAD_ROUNDS, .spreads = true, .is_free = is_free, .thread_count = thread_count};
    return polish_some(ctx, r, surface, NULL, &how);
}

qm_status qm_quads_centre(qm_context *ctx, qm_quads_result *r, const qm_bvh *surface, const uint8_t *moves,
                          int rounds, int thread_count)
{
    const polish how = {.rounds = rounds, .thread_count = thread_count};
    return polish_some(ctx, r, surface, moves, &how);
}
