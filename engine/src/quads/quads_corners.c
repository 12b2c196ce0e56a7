/**
 * quads_corners.c: acute corners between features: the crosses at both sides are turned against each other by less than half
 * a quarter turn there, so that the grid would have no corner, and all its rows would end in one vertex. The grid is turned
 * along a path from the corner inwards: the corner then has a quad, and the end of the path is an irregular vertex of
 * valence 3.
 */
#include "quads/quads_internal.h"

/* Between the ends of both sides, in sides of a quad: else there is no room for two rows. */
#define MIN_WIDTH 1.0
#define MAX_ANGLE                                                                                            \
    60.0          /* degrees: the crosses of the sides of wider corners have a quarter turn between them */
#define REACH 0.5 /* of a path, in shares of half the width between the ends of both sides */
#define MAX_REACH 0.5   /* in lengths of the shorter side */
#define MIN_BEND 0.5    /* cosine of the bend of a feature at which a side of a corner ends */
#define MIN_SPLIT 0.2   /* of an edge: its parts are no shorter */
#define MAX_STEPS 10000 /* of a path */

void qm_quads_corners_reset(qm_context *ctx, qm_quads_corners *c)
{
    qm_context_free(ctx, c->vertex, c->capacity, sizeof *c->vertex);
    *c = (qm_quads_corners){0};
}

static bool add_vertex(qm_context *ctx, qm_quads_corners *c, uint32_t vertex)
{
    if (c->count == c->capacity) {
        size_t capacity = c->capacity ? 2 * c->capacity : 64;
        uint32_t *grown = qm_context_resize(ctx, c->vertex, c->capacity, capacity, sizeof *grown);
        if (!grown) return false;
        c->vertex = grown;
        c->capacity = capacity;
    }
    c->vertex[c->count++] = vertex;
    return true;
}

/** A corner between two features that run from it: the second lies to the left of the first. */
typedef struct corner {
    uint32_t vertex, end[2]; /* the ends of the first edges of both sides */
    double angle;
} corner;

/** How far a side goes from the corner without a sharp bend. */
static double side_length(const qm_trimesh *m, uint32_t from, uint32_t to)
{
    qm_vec start = m->position[from], along = qm_vec_sub(m->position[to], start);
    uint32_t line[2], origin = from;
    for (size_t k = 0; k < m->vertex_count && to != origin; k++) {
        if (m->is_fixed[to] || qm_trimesh_kind(m, to, line) != QM_TRIMESH_ON_LINE) break;
        uint32_t next = line[0] == from ? line[1] : line[0];
        qm_vec edge = qm_vec_sub(m->position[next], m->position[to]);
        if (qm_vec_dot(edge, along) < MIN_BEND * qm_vec_norm(edge) * qm_vec_norm(along)) break;
        from = to, to = next;
    }
    return qm_vec_distance(m->position[to], start);
}

/** The angle between two edges from a vertex. */
static double angle_at(const qm_trimesh *m, uint32_t vertex, uint32_t a, uint32_t b)
{
    qm_vec u = qm_vec_sub(m->position[a], m->position[vertex]),
           v = qm_vec_sub(m->position[b], m->position[vertex]);
    return qm_vec_angle(u, v);
}

/** True if h leads to a vertex that nothing holds. */
static bool is_free(const qm_trimesh *m, uint32_t h)
{
    uint32_t line[2];
    return !m->is_feature[h] && qm_trimesh_kind(m, qm_trimesh_to(m, h), line) == QM_TRIMESH_FREE;
}

/** The axes of a path: from the corner inwards, and from the first side to the second. */
typedef struct axes {
    qm_vec origin, inward, across;
} axes;

/** The free neighbour of the last vertex that leads on best; QM_NO_INDEX if none does. */
static uint32_t next_vertex(const qm_trimesh *m, const axes *x, const corner *c, uint32_t last)
{
    uint32_t first = qm_trimesh_first(m, last), h = first, best = QM_NO_INDEX;
    double best_score = cos(0.25 * c->angle),
           at = qm_vec_dot(qm_vec_sub(m->position[last], x->origin), x->inward);
    do {
        qm_vec d = qm_vec_sub(m->position[qm_trimesh_to(m, h)], x->origin);
        double score = qm_vec_dot(qm_vec_unit(d), x->inward);
        if (is_free(m, h) && score > best_score && qm_vec_dot(d, x->inward) > at)
            best = qm_trimesh_to(m, h), best_score = score;
        h = qm_trimesh_around(m, h);
    } while (h != QM_NO_INDEX && h != first);
    return best;
}

/** The half-edge opposite to a vertex through which a path leads on, and where; QM_NO_INDEX: none, or a feature is there. */
static uint32_t edge_ahead(const qm_trimesh *m, const axes *x, uint32_t last, double *share)
{
    uint32_t first = qm_trimesh_first(m, last), h = first;
    double at = qm_vec_dot(qm_vec_sub(m->position[last], x->origin), x->inward);
    do {
        uint32_t o = qm_trimesh_next(h);
        qm_vec a = qm_vec_sub(m->position[m->from[o]], x->origin),
               b = qm_vec_sub(m->position[qm_trimesh_to(m, o)], x->origin);
        double wa = qm_vec_dot(a, x->across), wb = qm_vec_dot(b, x->across);
        if (wa <= 0.0 && wb > 0.0) {
            *share = qm_min(qm_max(wa / (wa - wb), MIN_SPLIT), 1.0 - MIN_SPLIT);
            if (qm_vec_dot(qm_vec_mix(a, b, *share), x->inward) > at)
                return m->is_feature[o] ? QM_NO_INDEX : o;
        }
        h = qm_trimesh_around(m, h);
    } while (h != QM_NO_INDEX && h != first);
    return QM_NO_INDEX;
}

/** Writes the path of a corner; edges are split where it has no vertex to go to. */
static qm_status add_path(qm_context *ctx, qm_trimesh *m, const corner *c, double size, qm_quads_corners *out)
{
    qm_vec origin = m->position[c->vertex], a = qm_vec_unit(qm_vec_sub(m->position[c->end[0]], origin)),
           b = qm_vec_unit(qm_vec_sub(m->position[c->end[1]], origin));
    const axes x = {origin, qm_vec_unit(qm_vec_add(a, b)), qm_vec_unit(qm_vec_sub(b, a))};
    double side = qm_min(side_length(m, c->vertex, c->end[0]), side_length(m, c->vertex, c->end[1]));
    double reach = qm_min(REACH * sin(0.5 * c->angle), MAX_REACH) * side;
    if (2.0 * side * sin(0.5 * c->angle) < MIN_WIDTH * size) return QM_OK;
    bool has_memory =
        add_vertex(ctx, out, c->vertex) && add_vertex(ctx, out, c->end[0]) && add_vertex(ctx, out, c->end[1]);
    uint32_t last = c->vertex;
    for (int k = 0; k < MAX_STEPS && has_memory; k++) {
        if (k > 0 && qm_vec_distance(m->position[last], origin) >= reach) break;
        uint32_t next = next_vertex(m, &x, c, last);
        if (next == QM_NO_INDEX) {
            double share;
            uint32_t ahead = edge_ahead(m, &x, last, &share);
            if (ahead == QM_NO_INDEX) break;
            qm_vec position =
                qm_vec_mix(m->position[m->from[ahead]], m->position[qm_trimesh_to(m, ahead)], share);
            if (qm_trimesh_split(ctx, m, ahead, position, &next) != QM_OK) return QM_E_NO_MEMORY;
        }
        has_memory = add_vertex(ctx, out, next);
        last = next;
    }
    return has_memory && add_vertex(ctx, out, QM_NO_INDEX) ? QM_OK : QM_E_NO_MEMORY;
}

/** The next acute corner of a vertex whose first side is h or comes after it. False if there is none. */
static bool next_corner(const qm_trimesh *m, uint32_t first, uint32_t *h, corner *out)
{
    for (;;) {
        uint32_t start = *h;
        double angle = 0.0;
        if (start == QM_NO_INDEX) return false;
        uint32_t k = start, back;
        do {
            back = qm_trimesh_prev(k);
            angle += angle_at(m, m->from[k], qm_trimesh_to(m, k), m->from[back]);
            k = qm_trimesh_around(m, k);
        } while (!m->is_feature[back]);
        *h = k == first ? QM_NO_INDEX : k;
        if (angle < MAX_ANGLE * QM_DEGREE) {
            *out = (corner){m->from[start], {qm_trimesh_to(m, start), m->from[back]}, angle};
            return true;
        }
    }
}

/** The first feature of a vertex's fan; QM_NO_INDEX if it has fewer than two. */
static uint32_t first_feature(const qm_trimesh *m, uint32_t vertex)
{
    uint32_t first = qm_trimesh_first(m, vertex), h = first, found = QM_NO_INDEX;
    size_t count = 0;
    do {
        if (m->is_feature[h] && count++ == 0) found = h;
        uint32_t back = qm_trimesh_prev(h);
        count += m->twin[back] == QM_NO_INDEX;
        h = qm_trimesh_around(m, h);
    } while (h != QM_NO_INDEX && h != first);
    return count < 2 ? QM_NO_INDEX : found;
}

qm_status qm_quads_open_corners(qm_context *ctx, qm_trimesh *m, double size, qm_quads_corners *out)
{
    *out = (qm_quads_corners){0};
    qm_status status = QM_OK;
    size_t count = m->vertex_count;
    for (uint32_t v = 0; v < count && status == QM_OK; v++) {
        corner found[8];
        int corners = 0;
        if (!m->is_fixed[v]) continue;
        uint32_t first = first_feature(m, v), h = first;
        while (corners < 8 && next_corner(m, first, &h, &found[corners]))
            corners++;
        for (int k = 0; k < corners && status == QM_OK; k++)
            status = add_path(ctx, m, &found[k], size, out);
    }
    return status;
}

static uint32_t half_between(const qm_trimesh *m, uint32_t from, uint32_t to)
{
    uint32_t first = qm_trimesh_first(m, from), h = first;
    do {
        if (qm_trimesh_to(m, h) == to) return h;
        h = qm_trimesh_around(m, h);
    } while (h != QM_NO_INDEX && h != first);
    return QM_NO_INDEX;
}

static int quarter_of(const float edge[2], double sign)
{
    return (int)lrint(atan2(sign * (double)edge[1], sign * (double)edge[0]) / (90.0 * QM_DEGREE));
}

/** Quarter turns from the first side of a corner to the second. */
static int quarters_between_sides(const qm_trimesh *m, const uint8_t *turned, const float (*edge)[2],
                                  uint32_t h)
{
    int quarters = -quarter_of(edge[h], 1.0);
    for (;;) {
        uint32_t back = qm_trimesh_prev(h);
        if (m->is_feature[back]) return (quarters + quarter_of(edge[back], -1.0)) & 3;
        quarters -= turned[back];
        h = m->twin[back];
    }
}

void qm_quads_turn_corners(const qm_trimesh *m, const qm_quads_corners *c, uint8_t *turned,
                           const float (*edge)[2])
{
    for (size_t i = 0; i < c->count; i++) {
        uint32_t vertex = c->vertex[i], side = half_between(m, vertex, c->vertex[i + 1]), from = vertex;
        bool is_turned =
            side != QM_NO_INDEX && m->is_feature[side] && quarters_between_sides(m, turned, edge, side) == 0;
        for (i += 3; c->vertex[i] != QM_NO_INDEX; i++) {
            uint32_t h = is_turned ? half_between(m, from, c->vertex[i]) : QM_NO_INDEX;
            is_turned = h != QM_NO_INDEX;
            if (!is_turned) continue;
            turned[h] = (turned[h] + 1) & 3;
            turned[m->twin[h]] = (turned[m->twin[h]] + 3) & 3;
            from = c->vertex[i];
        }
    }
}
