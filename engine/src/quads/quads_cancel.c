/**
 * quads_cancel.c: fewer singular vertices of a field of crosses. Smoothing from coarse to fine puts them where a coarse level
 * has them, for which a pair of opposites costs little: the ring of a torus gets eight on its outside and eight on its inside.
 *
 * From a face to that across an edge the cross turns by some angle and some quarters. Round a singular vertex the quarters do not sum
 * up to 0. Two opposite vertices are joined by a path of edges, across which the quarters change by one; the crosses round the path turn
 * such that the squares of all angles have the least sum. Both vertices are regular then. That is kept where the sum hardly rises.
 *
 * With j the change of angles across the path and d that by crosses which turn, j + d has no divergence, whether the field was smooth
 * before or not; so does what the sum changes by not depend on how smooth it was, and one system of equations, for d, is enough.
 *
 * Source: K. Crane, M. Desbrun, P. Schroeder, Trivial connections on discrete surfaces, 2010 (angles of least squares for given
 * singular vertices); D. Bommes, H. Zimmer, L. Kobbelt, Mixed-integer quadrangulation, 2009 (angles and quarters).
 */
#include "quads/quads_internal.h"

#include <string.h>

#define BLOCKED 8
#define RINGS 2 /* of vertices next to features that no path runs through */
#define QUARTER (90.0 * QM_DEGREE)
#define MOST_ANGLE                                                                                           \
    (42.0 * QM_DEGREE) /* between faces: beyond half a quarter another direction would be nearer */
/* What the sum of squares has to fall by, for paths as long as the root of the area: sizes of quads differ more then. */
#define LENGTH_COST 4.0
#define FIRST_LENGTH 4 /* of paths, in edges: short ones first */
#define LONGEST 400
#define PARTNERS 3     /* nearest opposites that are tried */
#define MARGIN 1.0     /* of the faces that may turn, in lengths of the path */
#define LEAST_MARGIN 6 /* in edges */
#define TOLERANCE                                                                                            \
    1e-3 /* of the norm of what has to vanish: 1e-2 leaves turns crowded along long paths, which no grid follows */
#define WORK 800.0 /* visits of a face, in the mean over all */
#define MOST_LOOPS 8
#define LOOP_WORK 500.0
#define MOST_ROUNDS 8

typedef struct cancelling {
    qm_context *ctx;
    const qm_trimesh *m;
    const uint8_t *is_set; /* of each face: its cross stays */
    float *angle;          /* of each half-edge: from its cross to that across it, less than half a quarter */
    int8_t *quarters;      /* as well: the rest of the turn */
    int8_t *index;         /* of each vertex: sum of the quarters round it; 0 on features */
    uint8_t *is_blocked;   /* of each vertex: BLOCKED on a feature, less near one */
    uint32_t *before;      /* of each vertex: half-edge of the search that came to it */
    uint32_t *vertex_stamp, *face_stamp, stamp;
    uint32_t *queue;  /* of vertices */
    uint32_t *region; /* faces that may turn */
    uint32_t *place;  /* of each face in the region */
    size_t region_count;
    uint32_t *neighbour;                         /* 3 of each face of the region */
    double *turn, *residual, *direction, *image; /* of each face of the region */
    float *change;                               /* of each half-edge of the region: across the path */
    double work;
} cancelling;

/** The angle from a cross, laid into the plane of another one by the least rotation, to that. */
static double angle_between(qm_vec qa, qm_vec na, qm_vec qb, qm_vec nb)
{
    double scale = 1.0 + qm_vec_dot(na, nb);
    if (scale > 1e-3) qa = qm_vec_axpy(qa, -qm_vec_dot(qa, nb) / scale, qm_vec_add(na, nb));
    return atan2(qm_vec_dot(qa, qm_vec_cross(nb, qb)), qm_vec_dot(qa, qb));
}

static void read_angles(cancelling *c, const qm_vec *normal, const qm_vec *cross)
{
    const qm_trimesh *m = c->m;
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        uint32_t t = m->twin[h];
        if (m->is_feature[h]) {
            c->angle[h] = 0.0F, c->quarters[h] = 0;
            c->is_blocked[m->from[h]] = c->is_blocked[qm_trimesh_to(m, h)] = BLOCKED;
            continue;
        }
        if (t < h) continue;
        double angle = angle_between(cross[h / 3], normal[h / 3], cross[t / 3], normal[t / 3]);
        int quarters = (int)lrint(angle / QUARTER);
        c->angle[h] = (float)(angle - quarters * QUARTER), c->quarters[h] = (int8_t)quarters;
        c->angle[t] = -c->angle[h], c->quarters[t] = (int8_t)-quarters;
    }
    for (uint32_t v = 0; v < m->vertex_count; v++) {
        if (c->is_blocked[v] == BLOCKED) continue;
        uint32_t first = qm_trimesh_first(m, v), h = first;
        int sum = 0;
        do {
            sum += c->quarters[qm_trimesh_prev(h)];
            h = qm_trimesh_around(m, h);
        } while (h != first);
        static const int8_t nearest[4] = {0, 1, 2, -1};
        c->index[v] = nearest[sum & 3];
    }
}

/** Paths keep away from features: round holes of a few quads there is no room for crosses that turn. */
static void block_rings(const cancelling *c)
{
    const qm_trimesh *m = c->m;
    for (uint8_t ring = BLOCKED; ring > BLOCKED - RINGS; ring--)
        for (uint32_t h = 0; h < 3 * m->face_count; h++) {
            uint32_t to = qm_trimesh_to(m, h);
            if (c->is_blocked[m->from[h]] == ring && !c->is_blocked[to])
                c->is_blocked[to] = (uint8_t)(ring - 1);
        }
}

/** Lists the faces within a margin of the path that ends in a vertex, in edges, and notes what changes across it. */
static void list_region(cancelling *c, uint32_t start, uint32_t end, int margin)
{
    const qm_trimesh *m = c->m;
    size_t count = 0, next = 0;
    c->stamp++;
    c->region_count = 0;
    for (uint32_t v = end;; v = m->from[c->before[v]]) {
        c->vertex_stamp[v] = c->stamp;
        c->queue[count++] = v;
        if (v == start) break;
    }
    for (int ring = 0; ring < margin && next < count; ring++) {
        for (size_t last = count; next < last; next++) {
            uint32_t v = c->queue[next], first = qm_trimesh_first(m, v), h = first;
            if (c->is_blocked[v] == BLOCKED) continue;
            do {
                uint32_t f = h / 3, to = qm_trimesh_to(m, h);
                if (c->face_stamp[f] != c->stamp && !c->is_set[f]) {
                    c->face_stamp[f] = c->stamp;
                    c->place[f] = (uint32_t)c->region_count;
                    c->region[c->region_count++] = f;
                }
                if (c->vertex_stamp[to] != c->stamp) {
                    c->vertex_stamp[to] = c->stamp;
                    c->queue[count++] = to;
                }
                h = qm_trimesh_around(m, h);
            } while (h != first);
        }
    }
}

static bool is_in_region(const cancelling *c, uint32_t f)
{
    return c->face_stamp[f] == c->stamp;
}

/** What turns of faces change the angle across a half-edge of a face in the region by. */
static double turn_across(const cancelling *c, const double *turn, uint32_t h)
{
    uint32_t f = h / 3, t = c->m->twin[h];
    double out = turn[c->place[f]];
    if (is_in_region(c, t / 3)) out -= turn[c->place[t / 3]];
    return out;
}

/** Lists the neighbours of the faces of the region by their places: a place more for all beyond, and the face itself across a feature. */
static void list_neighbours(cancelling *c)
{
    const qm_trimesh *m = c->m;
    for (uint32_t i = 0; i < c->region_count; i++)
        for (uint32_t k = 0; k < 3; k++) {
            uint32_t h = 3 * c->region[i] + k;
            uint32_t f = m->is_feature[h] ? c->region[i] : m->twin[h] / 3;
            c->neighbour[3 * (size_t)i + k] = is_in_region(c, f) ? c->place[f] : (uint32_t)c->region_count;
        }
}

/** Finds the turns of the region by conjugate gradients. */
static void solve(cancelling *c)
{
    double left = 0.0;
    for (size_t i = 0; i < c->region_count; i++) {
        const float *change = c->change + 3 * (size_t)c->region[i];
        double sum = (double)change[0] + (double)change[1] + (double)change[2];
        c->turn[i] = 0.0;
        c->residual[i] = c->direction[i] = -sum;
        left += sum * sum;
    }
    c->direction[c->region_count] = 0.0;
    double enough = TOLERANCE * TOLERANCE * left;
    while (left > enough && c->work > 0.0) {
        double bend = 0.0, next = 0.0;
        for (size_t i = 0; i < c->region_count; i++) {
            const uint32_t *n = c->neighbour + 3 * i;
            double sum = 3.0 * c->direction[i] - c->direction[n[0]] - c->direction[n[1]] - c->direction[n[2]];
            c->image[i] = sum;
            bend += sum * c->direction[i];
        }
        c->work -= (double)c->region_count;
        if (qm_context_canceled(c->ctx)) c->work = 0.0;
        if (!(bend > 0.0)) break;
        double length = left / bend;
        for (size_t i = 0; i < c->region_count; i++) {
            c->turn[i] += length * c->direction[i];
            c->residual[i] -= length * c->image[i];
            next += c->residual[i] * c->residual[i];
        }
        double share = next / left;
        left = next;
        for (size_t i = 0; i < c->region_count; i++)
            c->direction[i] = c->residual[i] + share * c->direction[i];
    }
}

/** What the sum of squares of angles rises by. */
static double find_rise(const cancelling *c)
{
    const qm_trimesh *m = c->m;
    double sum = 0.0;
    for (size_t i = 0; i < c->region_count; i++)
        for (uint32_t h = 3 * c->region[i]; h < 3 * c->region[i] + 3; h++) {
            if (m->is_feature[h]) continue;
            double change = (double)c->change[h] + turn_across(c, c->turn, h);
            double share = is_in_region(c, m->twin[h] / 3) ? 0.5 : 1.0; /* of the edge */
            sum += share * change * (change + 2.0 * (double)c->angle[h]);
        }
    return sum;
}

/** True if no angle would come near half a quarter that is not there now: another direction would be nearer. */
static bool is_small(const cancelling *c)
{
    const qm_trimesh *m = c->m;
    for (size_t i = 0; i < c->region_count; i++)
        for (uint32_t h = 3 * c->region[i]; h < 3 * c->region[i] + 3; h++) {
            if (m->is_feature[h]) continue;
            double angle = fabs((double)c->angle[h] + (double)c->change[h] + turn_across(c, c->turn, h));
            if (angle > MOST_ANGLE && angle > fabs((double)c->angle[h])) return false;
        }
    return true;
}

static void turn_cross(double angle, qm_vec normal, qm_vec *cross)
{
    *cross = qm_vec_axpy(qm_vec_scale(cos(angle), *cross), sin(angle), qm_vec_cross(normal, *cross));
}

static void apply(const cancelling *c, const qm_vec *normal, qm_vec *cross)
{
    const qm_trimesh *m = c->m;
    for (size_t i = 0; i < c->region_count; i++) {
        uint32_t f = c->region[i];
        for (uint32_t h = 3 * f; h < 3 * f + 3; h++) {
            if (m->is_feature[h]) continue;
            uint32_t t = m->twin[h];
            c->angle[h] += (float)((double)c->change[h] + turn_across(c, c->turn, h));
            if (!is_in_region(c, t / 3)) c->angle[t] = -c->angle[h];
        }
        turn_cross(c->turn[i], normal[f], &cross[f]);
    }
}

/** Adds a change of a quarter, of a sign, across the path of the search from a vertex to another. */
static void add_path(const cancelling *c, uint32_t start, uint32_t end, double sign)
{
    const qm_trimesh *m = c->m;
    for (uint32_t v = end; v != start; v = m->from[c->before[v]]) {
        uint32_t h = c->before[v];
        c->change[h] -= (float)(sign * QUARTER);
        c->change[m->twin[h]] += (float)(sign * QUARTER);
    }
}

static void clear_path(const cancelling *c, uint32_t start, uint32_t end)
{
    const qm_trimesh *m = c->m;
    for (uint32_t v = end; v != start; v = m->from[c->before[v]])
        c->change[c->before[v]] = c->change[m->twin[c->before[v]]] = 0.0F;
}

/** Solves for the path between two vertices; returns what the sum rises by, INFINITY if it cannot be. */
static double try_path(cancelling *c, uint32_t start, uint32_t end, int length)
{
    list_region(c, start, end, (int)(MARGIN * length) + LEAST_MARGIN);
    list_neighbours(c);
    add_path(c, start, end, c->index[start]);
    solve(c);
    return c->work > 0.0 && is_small(c) ? find_rise(c) : INFINITY;
}

/** Adds the end of a half-edge to the queue of a search. False if it is blocked, or was reached before. */
static bool reach(cancelling *c, uint32_t h, size_t *count)
{
    uint32_t to = qm_trimesh_to(c->m, h);
    if (c->is_blocked[to] || c->vertex_stamp[to] == c->stamp) return false;
    c->vertex_stamp[to] = c->stamp;
    c->before[to] = h;
    c->queue[(*count)++] = to;
    return true;
}

/** Tries the nearest opposites of a singular vertex. */
static bool cancel_vertex(cancelling *c, uint32_t start, int least, int most, qm_vec *cross,
                          const qm_vec *normal)
{
    const qm_trimesh *m = c->m;
    uint32_t partner[PARTNERS];
    int length[PARTNERS], found = 0, ring = 0;
    size_t count = 0, next = 0;
    c->stamp++;
    c->vertex_stamp[start] = c->stamp;
    c->queue[count++] = start;
    while (next < count && found < PARTNERS && ring < most) {
        ring++;
        for (size_t last = count; next < last && found < PARTNERS; next++) {
            uint32_t v = c->queue[next], first = qm_trimesh_first(m, v), h = first;
            do {
                uint32_t to = qm_trimesh_to(m, h);
                if (reach(c, h, &count) && c->index[to] == -c->index[start] && ring > least &&
                    found < PARTNERS)
                    partner[found] = to, length[found++] = ring;
                h = qm_trimesh_around(m, h);
            } while (h != first);
        }
    }
    c->work -= (double)count;
    int best = -1, last = -1;
    double best_rise = INFINITY;
    for (int k = 0; k < found && c->work > 0.0; k++) {
        double sum = try_path(c, start, partner[k], length[k]);
        last = k;
        if (sum < best_rise) best = k, best_rise = sum;
        if (k + 1 < found) clear_path(c, start, partner[k]);
    }
    if (last < 0) return false;
    bool is_kept = best >= 0 && best_rise <= -LENGTH_COST * length[best] / sqrt(0.5 * (double)m->face_count);
    if (is_kept && best != last) {
        clear_path(c, start, partner[last]);
        (void)try_path(c, start, partner[best], length[best]);
        last = best;
    }
    if (is_kept) {
        apply(c, normal, cross);
        c->index[start] = c->index[partner[best]] = 0;
    }
    clear_path(c, start, partner[last]);
    return is_kept;
}

/*
 * Loops.
 */

/** A tree over the vertices off features, and one over the faces, across other edges. Returns the edges of neither. */
static size_t list_loops(cancelling *c, uint32_t *root, uint32_t *loop, size_t most)
{
    const qm_trimesh *m = c->m;
    size_t loops = 0;
    c->stamp++;
    for (uint32_t v0 = 0; v0 < m->vertex_count; v0++) {
        if (c->is_blocked[v0] || c->vertex_stamp[v0] == c->stamp) continue;
        size_t count = 0, next = 0;
        c->vertex_stamp[v0] = c->stamp;
        c->before[v0] = QM_NO_INDEX;
        c->queue[count++] = v0;
        while (next < count) {
            uint32_t v = c->queue[next++], first = qm_trimesh_first(m, v), h = first;
            root[v] = v0;
            do {
                (void)reach(c, h, &count);
                h = qm_trimesh_around(m, h);
            } while (h != first);
        }
    }
    /* region and place serve as queue and half-edge of the tree of faces */
    for (uint32_t f0 = 0; f0 < m->face_count; f0++) {
        if (c->face_stamp[f0] == c->stamp) continue;
        size_t count = 0, next = 0;
        c->face_stamp[f0] = c->stamp;
        c->place[f0] = QM_NO_INDEX;
        c->region[count++] = f0;
        while (next < count) {
            uint32_t f = c->region[next++];
            for (uint32_t h = 3 * f; h < 3 * f + 3; h++) {
                uint32_t t = m->twin[h];
                if (m->is_feature[h] || c->face_stamp[t / 3] == c->stamp || c->before[m->from[h]] == t ||
                    c->before[m->from[t]] == h)
                    continue;
                c->face_stamp[t / 3] = c->stamp;
                c->place[t / 3] = h;
                c->region[count++] = t / 3;
            }
        }
    }
    for (uint32_t h = 0; h < 3 * m->face_count && loops < most; h++) {
        uint32_t t = m->twin[h], a = m->from[h], b = qm_trimesh_to(m, h);
        if (m->is_feature[h] || t < h || c->is_blocked[a] || c->is_blocked[b] || c->before[a] == t ||
            c->before[b] == h || c->place[h / 3] == t || c->place[t / 3] == h)
            continue;
        loop[loops++] = h;
    }
    return loops;
}

/** What changes by a quarter across each of some loops, with the turns of crosses: numbers without divergence, of half-edges, and turns, of faces. */
typedef struct loop_forms {
    size_t count;
    float *form, *turn; /* 3 of each face, and 1 */
} loop_forms;

static double product(const cancelling *c, const float *a, const float *b)
{
    double sum = 0.0;
    for (uint32_t h = 0; h < 3 * c->m->face_count; h++)
        sum += (double)a[h] * (double)b[h];
    return sum;
}

static void subtract(const cancelling *c, const loop_forms *l, size_t from, size_t other, double factor)
{
    size_t faces = c->m->face_count;
    for (size_t h = 0; h < 3 * faces; h++)
        l->form[3 * faces * from + h] -= (float)factor * l->form[3 * faces * other + h];
    for (size_t f = 0; f < faces; f++)
        l->turn[faces * from + f] -= (float)factor * l->turn[faces * other + f];
}

/** Finds the form of a loop of the tree and an edge. */
static void find_form(cancelling *c, const uint32_t *root, uint32_t h, float *form, float *turn)
{
    const qm_trimesh *m = c->m;
    uint32_t a = m->from[h], b = qm_trimesh_to(m, h);
    add_path(c, root[a], a, 1.0);
    c->change[h] -= (float)QUARTER, c->change[m->twin[h]] += (float)QUARTER;
    add_path(c, root[b], b, -1.0);
    solve(c);
    for (uint32_t f = 0; f < m->face_count; f++)
        turn[f] = is_in_region(c, f) ? (float)c->turn[c->place[f]] : 0.0F;
    for (uint32_t k = 0; k < 3 * m->face_count; k++)
        form[k] = m->is_feature[k] ? 0.0F : c->change[k] + turn[k / 3] - turn[m->twin[k] / 3];
    clear_path(c, root[a], a);
    c->change[h] = c->change[m->twin[h]] = 0.0F;
    clear_path(c, root[b], b);
}

/** Combines loops until none becomes shorter: of two that are nearly the same one becomes their difference. */
static void reduce(const cancelling *c, const loop_forms *l)
{
    size_t halves = 3 * c->m->face_count;
    bool is_changing = true;
    for (int round = 0; round < MOST_ROUNDS && is_changing; round++) {
        is_changing = false;
        for (size_t i = 0; i < l->count; i++)
            for (size_t k = 0; k < l->count; k++) {
                const float *a = l->form + halves * i, *b = l->form + halves * k;
                double square = product(c, b, b);
                double factor = i != k && square > 0.0 ? rint(product(c, a, b) / square) : 0.0;
                if (factor == 0.0) continue;
                subtract(c, l, i, k, factor);
                is_changing = true;
            }
    }
}

/** Turns crosses by quarters across loops where the sum falls. */
static void turn_loops(const cancelling *c, const loop_forms *l, const qm_vec *normal, qm_vec *cross)
{
    size_t faces = c->m->face_count, halves = 3 * faces;
    bool is_changing = true;
    for (int round = 0; round < MOST_ROUNDS && is_changing; round++) {
        is_changing = false;
        for (size_t k = 0; k < l->count; k++) {
            const float *form = l->form + halves * k, *turn = l->turn + faces * k;
            double square = product(c, form, form);
            double factor = square > 0.0 ? rint(-product(c, form, c->angle) / square) : 0.0;
            if (factor == 0.0) continue;
            for (size_t h = 0; h < halves; h++)
                c->angle[h] += (float)factor * form[h];
            for (size_t f = 0; f < faces; f++)
                turn_cross(factor * (double)turn[f], normal[f], &cross[f]);
            is_changing = true;
        }
    }
}

/** Takes back quarters by which crosses turn along loops round handles, where the sum falls. */
static qm_status unwind(cancelling *c, qm_vec *cross, const qm_vec *normal)
{
    const qm_trimesh *m = c->m;
    size_t faces = m->face_count;
    uint32_t loop[MOST_LOOPS], *root = qm_context_alloc(c->ctx, m->vertex_count, sizeof *root);
    if (!root) return QM_E_NO_MEMORY;
    loop_forms l = {.count = list_loops(c, root, loop, MOST_LOOPS)};
    size_t count = l.count;
    c->stamp++;
    c->region_count = 0;
    for (uint32_t f = 0; f < faces; f++)
        if (!c->is_set[f]) {
            c->face_stamp[f] = c->stamp;
            c->place[f] = (uint32_t)c->region_count;
            c->region[c->region_count++] = f;
        }
    list_neighbours(c);
    l.form = qm_context_alloc(c->ctx, 3 * faces * count, sizeof *l.form);
    l.turn = qm_context_alloc(c->ctx, faces * count, sizeof *l.turn);
    qm_status status = count == 0 || (l.form && l.turn) ? QM_OK : QM_E_NO_MEMORY;
    if (status == QM_OK) {
        c->work = LOOP_WORK * (double)faces * (double)count;
        for (size_t k = 0; k < count; k++)
            find_form(c, root, loop[k], l.form + 3 * faces * k, l.turn + faces * k);
        reduce(c, &l);
        turn_loops(c, &l, normal, cross);
    }
    qm_context_free(c->ctx, root, m->vertex_count, sizeof *root);
    qm_context_free(c->ctx, l.form, 3 * faces * count, sizeof *l.form);
    qm_context_free(c->ctx, l.turn, faces * count, sizeof *l.turn);
    return status;
}

static bool alloc(cancelling *c)
{
    qm_context *ctx = c->ctx;
    size_t faces = c->m->face_count, vertices = c->m->vertex_count;
    c->angle = qm_context_alloc(ctx, 3 * faces, sizeof *c->angle);
    c->change = qm_context_alloc(ctx, 3 * faces, sizeof *c->change);
    c->quarters = qm_context_alloc(ctx, 3 * faces, sizeof *c->quarters);
    c->index = qm_context_alloc(ctx, vertices, sizeof *c->index);
    c->is_blocked = qm_context_alloc(ctx, vertices, sizeof *c->is_blocked);
    c->before = qm_context_alloc(ctx, vertices, sizeof *c->before);
    c->vertex_stamp = qm_context_alloc(ctx, vertices, sizeof *c->vertex_stamp);
    c->queue = qm_context_alloc(ctx, vertices, sizeof *c->queue);
    c->face_stamp = qm_context_alloc(ctx, faces, sizeof *c->face_stamp);
    c->region = qm_context_alloc(ctx, faces, sizeof *c->region);
    c->place = qm_context_alloc(ctx, faces, sizeof *c->place);
    c->neighbour = qm_context_alloc(ctx, 3 * faces, sizeof *c->neighbour);
    c->turn = qm_context_alloc(ctx, 4 * faces + 1, sizeof *c->turn);
    if (!c->angle || !c->change || !c->quarters || !c->index || !c->is_blocked || !c->before ||
        !c->vertex_stamp || !c->queue || !c->face_stamp || !c->region || !c->place || !c->neighbour ||
        !c->turn)
        return false;
    c->residual = c->turn + faces, c->image = c->turn + 2 * faces, c->direction = c->turn + 3 * faces;
    memset(c->change, 0, 3 * faces * sizeof *c->change);
    memset(c->index, 0, vertices * sizeof *c->index);
    memset(c->is_blocked, 0, vertices * sizeof *c->is_blocked);
    memset(c->vertex_stamp, 0, vertices * sizeof *c->vertex_stamp);
    memset(c->face_stamp, 0, faces * sizeof *c->face_stamp);
    return true;
}

static void release(cancelling *c)
{
    qm_context *ctx = c->ctx;
    size_t faces = c->m->face_count, vertices = c->m->vertex_count;
    qm_context_free(ctx, c->angle, 3 * faces, sizeof *c->angle);
    qm_context_free(ctx, c->change, 3 * faces, sizeof *c->change);
    qm_context_free(ctx, c->quarters, 3 * faces, sizeof *c->quarters);
    qm_context_free(ctx, c->index, vertices, sizeof *c->index);
    qm_context_free(ctx, c->is_blocked, vertices, sizeof *c->is_blocked);
    qm_context_free(ctx, c->before, vertices, sizeof *c->before);
    qm_context_free(ctx, c->vertex_stamp, vertices, sizeof *c->vertex_stamp);
    qm_context_free(ctx, c->queue, vertices, sizeof *c->queue);
    qm_context_free(ctx, c->face_stamp, faces, sizeof *c->face_stamp);
    qm_context_free(ctx, c->region, faces, sizeof *c->region);
    qm_context_free(ctx, c->place, faces, sizeof *c->place);
    qm_context_free(ctx, c->neighbour, 3 * faces, sizeof *c->neighbour);
    qm_context_free(ctx, c->turn, 4 * faces + 1, sizeof *c->turn);
}

qm_status qm_quads_cancel_pairs(qm_context *ctx, const qm_trimesh *m, const qm_vec *normal,
                                const uint8_t *is_set, qm_vec *cross)
{
    cancelling c = {.ctx = ctx, .m = m, .is_set = is_set, .work = WORK * (double)m->face_count};
    qm_status status = alloc(&c) ? QM_OK : QM_E_NO_MEMORY;
    if (status == QM_OK) {
        read_angles(&c, normal, cross);
        block_rings(&c);
        for (int least = 0, most = FIRST_LENGTH; most <= LONGEST && status == QM_OK;
             least = most, most += most / 2) {
            for (uint32_t v = 0; v < m->vertex_count && c.work > 0.0; v++)
                if (c.index[v] == -1 && !c.is_blocked[v])
                    (void)cancel_vertex(&c, v, least, most, cross, normal);
            if (qm_context_canceled(ctx)) status = QM_E_CANCELED;
        }
        bool is_held = memchr(is_set, true, m->face_count) != NULL;
        if (status == QM_OK && !is_held) status = unwind(&c, cross, normal);
        if (qm_context_canceled(ctx)) status = QM_E_CANCELED;
    }
    release(&c);
    return status;
}
