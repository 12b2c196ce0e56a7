/**
 * quads_sides.c: the sides of the quads of a mesh, and its local changes.
 */
#include "quads/quads_sides.h"

#include <string.h>

#include "mesh/quad_shape.h"

#define QUARTER 1.57079632679489661923
#define LEAST_REFLEX                                                                                         \
    (2.0 / 3.0 *                                                                                             \
     QUARTER) /* between features: less is an acute corner rather than one of 300 degrees and more */

uint32_t qm_quads_first_side(const qm_quads_sides *t, uint32_t vertex)
{
    uint32_t start = t->out[vertex], s = start;
    while (t->twin[s] != QM_NO_INDEX) {
        s = qm_quads_next(t->twin[s]);
        if (s == start) break;
    }
    return s;
}

static qm_vec normal_of(const qm_quads_sides *t, uint32_t face)
{
    qm_vec corner[4];
    for (uint32_t k = 0; k < 4; k++)
        corner[k] = qm_quads_at(t, qm_quads_from(t, 4 * face + k));
    return qm_quad_normal(corner);
}

static qm_vec along(const qm_quads_sides *t, uint32_t from, uint32_t to)
{
    return qm_vec_sub(qm_quads_at(t, to), qm_quads_at(t, from));
}

/** The angle from a side of a vertex to the one before another, on the left of the first: sum is that of the corners between them, which
 * is short of it where quads are folded over a reflex corner. */
static double sector_angle(const qm_quads_sides *t, uint32_t first, uint32_t last, double sum)
{
    uint32_t v = qm_quads_from(t, first);
    qm_vec normal = {0, 0, 0}, a = along(t, v, qm_quads_from(t, qm_quads_next(first))),
           b = along(t, v, qm_quads_from(t, qm_quads_prev(last)));
    double between = qm_vec_angle(a, b);
    if (between < LEAST_REFLEX || sum > 2.0 * QUARTER) return sum;
    for (uint32_t s = first, end = false; !end; s = t->twin[qm_quads_prev(s)]) {
        normal = qm_vec_add(normal, normal_of(t, s / 4));
        for (uint32_t k = 4 * (s / 4); k < 4 * (s / 4) + 4; k++)
            if (t->twin[k] != QM_NO_INDEX && !t->r->is_feature[k])
                normal = qm_vec_add(normal, normal_of(t, t->twin[k] / 4));
        end = s == last;
    }
    return qm_vec_dot(qm_vec_cross(a, b), normal) < 0.0 ? 4.0 * QUARTER - between : sum;
}

qm_quads_sector qm_quads_sector_at(const qm_quads_sides *t, uint32_t side)
{
    const uint8_t *is_feature = t->r->is_feature;
    uint32_t first = side, s, last;
    while (!is_feature[first] && t->twin[first] != QM_NO_INDEX) {
        first = qm_quads_next(t->twin[first]);
        if (first == side) break;
    }
    qm_quads_sector found = {0, 4};
    double angle = 0.0;
    bool is_whole = true;
    s = last = first;
    do {
        uint32_t back = qm_quads_prev(s), v = qm_quads_from(t, s);
        angle += qm_vec_angle(along(t, v, qm_quads_from(t, qm_quads_next(s))),
                              along(t, v, qm_quads_from(t, back)));
        found.quads++;
        is_whole = !is_feature[back];
        last = s;
        s = t->twin[back];
    } while (is_whole && s != QM_NO_INDEX && s != first);
    if (!is_whole || s == QM_NO_INDEX) {
        if (t->kind[qm_quads_from(t, side)] == QM_TRIMESH_CORNER) angle = sector_angle(t, first, last, angle);
        found.wanted = angle < 1.5 * QUARTER ? 1 : (int)lrint(angle / QUARTER);
    }
    return found;
}

static void stamp_ring(qm_quads_sides *t, uint32_t vertex)
{
    t->stamp_value++;
    uint32_t first = qm_quads_first_side(t, vertex), s = first;
    do {
        for (uint32_t k = qm_quads_next(s); k != s; k = qm_quads_next(k))
            t->stamp[qm_quads_from(t, k)] = t->stamp_value;
        s = qm_quads_around(t, s);
    } while (s != QM_NO_INDEX && s != first);
}

/** How many vertices round a vertex, also across its quads, are stamped; each counts once. Their stamps go. */
static int count_stamped(qm_quads_sides *t, uint32_t vertex)
{
    int count = 0;
    uint32_t first = qm_quads_first_side(t, vertex), s = first;
    do {
        for (uint32_t k = qm_quads_next(s); k != s; k = qm_quads_next(k)) {
            count += t->stamp[qm_quads_from(t, k)] == t->stamp_value;
            t->stamp[qm_quads_from(t, k)] = 0;
        }
        s = qm_quads_around(t, s);
    } while (s != QM_NO_INDEX && s != first);
    return count;
}

static void link_sides(qm_quads_sides *t, uint32_t a, uint32_t b)
{
    if (a != QM_NO_INDEX) t->twin[a] = b;
    if (b != QM_NO_INDEX) t->twin[b] = a;
}

/*
 * Contraction: the corner of a side goes to the opposite one.
 */

/** The two sides at corner b, on both sides of which the face closes, must have neighbours, that are not one quad. */
static bool closes_well(const qm_quads_sides *t, uint32_t side)
{
    uint32_t a = t->twin[side], b = t->twin[qm_quads_prev(side)];
    return a != QM_NO_INDEX && b != QM_NO_INDEX && a / 4 != b / 4;
}

bool qm_quads_can_contract(qm_quads_sides *t, uint32_t side)
{
    uint32_t s1 = qm_quads_next(side), s2 = qm_quads_next(s1), s3 = qm_quads_next(s2);
    uint32_t gone = qm_quads_from(t, side), kept = qm_quads_from(t, s2);
    if (t->kind[gone] != QM_TRIMESH_FREE || !closes_well(t, s1) || !closes_well(t, s3)) return false;
    qm_quads_sector g = qm_quads_sector_at(t, side);
    stamp_ring(t, gone);
    /* what both have round them: the two other corners and, since each is across the face, themselves. A vertex of two quads
       has only these, and is across the other one too. */
    t->stamp[gone] = t->stamp[kept] = 0;
    int common = count_stamped(t, kept);
    return g.quads == 2 ? common <= 3 : common == 2;
}

void qm_quads_contract(qm_quads_sides *t, uint32_t side)
{
    uint32_t s1 = qm_quads_next(side), s2 = qm_quads_next(s1), s3 = qm_quads_next(s2);
    uint32_t gone = qm_quads_from(t, side), kept = qm_quads_from(t, s2), b = qm_quads_from(t, s1),
             d = qm_quads_from(t, s3);
    uint32_t *faces = t->r->mesh.faces;
    uint8_t *feature = t->r->is_feature;
    uint32_t first = qm_quads_first_side(t, gone), s = first;
    do {
        faces[s] = kept;
        s = qm_quads_around(t, s);
    } while (s != QM_NO_INDEX && s != first);
    for (int k = 0; k < 2; k++) {
        uint32_t e = k == 0 ? side : s2, f = qm_quads_next(e); /* e ends and f begins at b, then at d */
        uint32_t x = t->twin[e], y = t->twin[f];
        link_sides(t, x, y);
        feature[x] = feature[y] = feature[x] || feature[y];
        uint32_t corner = k == 0 ? b : d;
        t->out[corner] = x; /* the twin of e begins where e ends */
        t->out[kept] = y;
    }
    t->is_gone[side / 4] = true;
    t->out[gone] = QM_NO_INDEX;
}

/*
 * Turning an edge.
 */

bool qm_quads_find_hexagon(const qm_quads_sides *t, uint32_t side, qm_quads_hexagon *out)
{
    uint32_t other = t->twin[side];
    if (other == QM_NO_INDEX || t->r->is_feature[side]) return false;
    uint32_t s[6]; /* side runs from corner 3 to corner 0 */
    s[0] = qm_quads_next(side), s[1] = qm_quads_next(s[0]), s[2] = qm_quads_next(s[1]);
    s[3] = qm_quads_next(other), s[4] = qm_quads_next(s[3]), s[5] = qm_quads_next(s[4]);
    out->side = side;
    for (int k = 0; k < 6; k++) {
        out->vertex[k] = qm_quads_from(t, s[k]);
        out->outer[k] = t->twin[s[k]];
        out->is_feature[k] = t->r->is_feature[s[k]];
        out->sector[k] = qm_quads_sector_at(t, s[k]);
        for (int j = 0; j < k; j++)
            if (out->vertex[j] == out->vertex[k] || s[j] / 4 == out->outer[k] / 4 ||
                s[k] / 4 == out->outer[j] / 4)
                return false;
    }
    return true;
}

static bool are_neighbours(qm_quads_sides *t, uint32_t a, uint32_t b)
{
    stamp_ring(t, a);
    return t->stamp[b] == t->stamp_value;
}

bool qm_quads_can_turn(qm_quads_sides *t, const qm_quads_hexagon *x, int k)
{
    for (int end = 0; end < 6; end += 3) {
        int least = t->kind[x->vertex[end]] == QM_TRIMESH_FREE ? 3 : 2;
        if (x->sector[end].quads < least) return false;
    }
    return !are_neighbours(t, x->vertex[k], x->vertex[k + 3]);
}

void qm_quads_turn(qm_quads_sides *t, const qm_quads_hexagon *x, int k)
{
    /* the quads (k, k + 1, k + 2, k + 3) and (k + 3, k + 4, k + 5, k): their last sides are the edge */
    const uint32_t face[2] = {x->side / 4, t->twin[x->side] / 4};
    for (int f = 0; f < 2; f++) {
        for (uint32_t i = 0; i < 4; i++) {
            uint32_t to = 4 * face[f] + i, c = ((uint32_t)k + 3 * (uint32_t)f + i) % 6;
            t->r->mesh.faces[to] = x->vertex[c];
            t->out[x->vertex[c]] = to;
            if (i == 3) continue;
            link_sides(t, to, x->outer[c]);
            t->r->is_feature[to] = x->is_feature[c];
        }
    }
    link_sides(t, 4 * face[0] + 3, 4 * face[1] + 3);
    t->r->is_feature[4 * face[0] + 3] = t->r->is_feature[4 * face[1] + 3] = false;
}

/*
 * The whole mesh.
 */

/** The sides from a vertex: of v those from start[v + 1] on. *last receives the last that leads to another, if any does; returns how many do. */
static int count_sides(const qm_quads_sides *t, const uint32_t *start, const uint32_t *list, uint32_t from,
                       uint32_t to, uint32_t *last)
{
    const qm_mesh *m = &t->r->mesh;
    uint32_t end = from + 2 <= m->vertex_count ? start[from + 2] : (uint32_t)(4 * m->face_count);
    int count = 0;
    for (uint32_t k = start[from + 1]; k < end; k++)
        if (m->faces[qm_quads_next(list[k])] == to) *last = list[k], count++;
    return count;
}

/** Pairs the sides between the same vertices: in each vertex's list of sides the one to that of the other is searched. Where there
 * are several, none have a twin, and the vertices stay: going round them does not come to all of their quads. */
static bool pair_sides(qm_quads_sides *t)
{
    const qm_mesh *m = &t->r->mesh;
    size_t sides = 4 * m->face_count;
    uint32_t *start = qm_context_alloc(t->ctx, m->vertex_count + 1, sizeof *start);
    uint32_t *list = qm_context_alloc(t->ctx, sides, sizeof *list);
    if (start && list) {
        memset(start, 0, (m->vertex_count + 1) * sizeof *start);
        for (size_t s = 0; s < sides; s++)
            start[m->faces[s] + 1]++;
        for (size_t v = 0; v < m->vertex_count; v++)
            start[v + 1] += start[v];
        for (uint32_t s = (uint32_t)sides; s-- > 0;)
            list[--start[m->faces[s] + 1]] = s;
        for (uint32_t s = 0; s < sides; s++) {
            uint32_t a = m->faces[s], b = m->faces[qm_quads_next(s)], own = s, twin = QM_NO_INDEX;
            int there = count_sides(t, start, list, a, b, &own),
                back = count_sides(t, start, list, b, a, &twin);
            t->twin[s] = there == 1 && back == 1 ? twin : QM_NO_INDEX;
            if (there > 1 || back > 1) t->r->is_fixed[a] = t->r->is_fixed[b] = QM_QUADS_HELD;
            t->out[a] = s;
        }
    }
    bool has_memory = start && list;
    qm_context_free(t->ctx, start, m->vertex_count + 1, sizeof *start);
    qm_context_free(t->ctx, list, sides, sizeof *list);
    return has_memory;
}

/** How many features meet at each vertex tells what may move it. */
static bool find_kinds(qm_quads_sides *t)
{
    uint8_t *count = qm_context_alloc(t->ctx, t->vertex_count, 1);
    if (!count) return false;
    memset(count, 0, t->vertex_count);
    for (uint32_t s = 0; s < 4 * t->face_count; s++) {
        if (!t->r->is_feature[s] || (t->twin[s] != QM_NO_INDEX && t->twin[s] < s)) continue;
        uint8_t *at_end[2] = {&count[qm_quads_from(t, s)], &count[qm_quads_from(t, qm_quads_next(s))]};
        for (int k = 0; k < 2; k++)
            if (*at_end[k] < 3) ++*at_end[k];
    }
    for (size_t v = 0; v < t->vertex_count; v++) {
        t->kind[v] = count[v] == 0 ? QM_TRIMESH_FREE : count[v] == 2 ? QM_TRIMESH_ON_LINE : QM_TRIMESH_CORNER;
        if (t->r->is_fixed[v]) t->kind[v] = QM_TRIMESH_CORNER;
    }
    qm_context_free(t->ctx, count, t->vertex_count, 1);
    return true;
}

qm_status qm_quads_sides_build(qm_context *ctx, qm_quads_result *r, qm_quads_sides *t)
{
    size_t faces = r->mesh.face_count, vertices = r->mesh.vertex_count;
    *t = (qm_quads_sides){.ctx = ctx, .r = r, .face_count = faces, .vertex_count = vertices};
    t->twin = qm_context_alloc(ctx, 4 * faces, sizeof *t->twin);
    t->is_gone = qm_context_alloc(ctx, faces, 1);
    t->out = qm_context_alloc(ctx, vertices, sizeof *t->out);
    t->stamp = qm_context_alloc(ctx, vertices, sizeof *t->stamp);
    t->kind = qm_context_alloc(ctx, vertices, 1);
    if (!(t->twin && t->is_gone && t->out && t->stamp && t->kind)) return QM_E_NO_MEMORY;
    memset(t->is_gone, 0, faces);
    memset(t->stamp, 0, vertices * sizeof *t->stamp);
    memset(t->out, 0xff, vertices * sizeof *t->out);
    return pair_sides(t) && find_kinds(t) ? QM_OK : QM_E_NO_MEMORY;
}

void qm_quads_sides_reset(qm_quads_sides *t)
{
    qm_context_free(t->ctx, t->twin, 4 * t->face_count, sizeof *t->twin);
    qm_context_free(t->ctx, t->is_gone, t->face_count, 1);
    qm_context_free(t->ctx, t->out, t->vertex_count, sizeof *t->out);
    qm_context_free(t->ctx, t->stamp, t->vertex_count, sizeof *t->stamp);
    qm_context_free(t->ctx, t->kind, t->vertex_count, 1);
    *t = (qm_quads_sides){0};
}

/** The arrays keep their allocated size until they are copied. */
qm_status qm_quads_sides_compact(qm_quads_sides *t)
{
    qm_quads_result *r = t->r;
    size_t faces = 0, vertices = 0, old_faces = r->mesh.face_count, old_vertices = r->mesh.vertex_count;
    for (size_t f = 0; f < old_faces; f++) {
        if (t->is_gone[f]) continue;
        memmove(r->mesh.faces + 4 * faces, r->mesh.faces + 4 * f, 4 * sizeof(uint32_t));
        memmove(r->is_feature + 4 * faces, r->is_feature + 4 * f, 4);
        faces++;
    }
    for (size_t v = 0; v < old_vertices; v++) {
        if (t->out[v] == QM_NO_INDEX) continue;
        t->stamp[v] = (uint32_t)vertices;
        memmove(r->mesh.positions + 3 * vertices, r->mesh.positions + 3 * v, 3 * sizeof(double));
        r->is_fixed[vertices++] = r->is_fixed[v];
    }
    for (size_t s = 0; s < 4 * faces; s++)
        r->mesh.faces[s] = t->stamp[r->mesh.faces[s]];
    double *positions = qm_context_alloc(t->ctx, vertices, 3 * sizeof *positions);
    uint32_t *corners = qm_context_alloc(t->ctx, faces, 4 * sizeof *corners);
    uint8_t *fixed = qm_context_alloc(t->ctx, vertices, 1), *features = qm_context_alloc(t->ctx, faces, 4);
    bool has_memory = positions && corners && fixed && features;
    if (has_memory) {
        memcpy(positions, r->mesh.positions, 3 * vertices * sizeof *positions);
        memcpy(corners, r->mesh.faces, 4 * faces * sizeof *corners);
        memcpy(fixed, r->is_fixed, vertices);
        memcpy(features, r->is_feature, 4 * faces);
        qm_mesh_reset(t->ctx, &r->mesh);
        qm_context_free(t->ctx, r->is_fixed, old_vertices, 1);
        qm_context_free(t->ctx, r->is_feature, old_faces, 4);
        r->mesh = (qm_mesh){
            .positions = positions, .faces = corners, .vertex_count = vertices, .face_count = faces};
        r->is_fixed = fixed, r->is_feature = features;
        return QM_OK;
    }
    qm_context_free(t->ctx, positions, vertices, 3 * sizeof *positions);
    qm_context_free(t->ctx, corners, faces, 4 * sizeof *corners);
    qm_context_free(t->ctx, fixed, vertices, 1);
    qm_context_free(t->ctx, features, faces, 4);
    return QM_E_NO_MEMORY;
}

/*
 * Snapshots.
 */

qm_status qm_quads_snapshot_alloc(const qm_quads_sides *t, qm_quads_snapshot *s)
{
    size_t sides = 4 * t->face_count;
    s->corner = qm_context_alloc(t->ctx, sides, sizeof *s->corner);
    s->twin = qm_context_alloc(t->ctx, sides, sizeof *s->twin);
    s->out = qm_context_alloc(t->ctx, t->vertex_count, sizeof *s->out);
    s->is_gone = qm_context_alloc(t->ctx, t->face_count, 1);
    s->is_feature = qm_context_alloc(t->ctx, sides, 1);
    s->positions = qm_context_alloc(t->ctx, t->vertex_count, 3 * sizeof *s->positions);
    bool has_memory = s->corner && s->twin && s->out && s->is_gone && s->is_feature && s->positions;
    return has_memory ? QM_OK : QM_E_NO_MEMORY;
}

void qm_quads_snapshot_reset(const qm_quads_sides *t, qm_quads_snapshot *s)
{
    size_t sides = 4 * t->face_count;
    qm_context_free(t->ctx, s->corner, sides, sizeof *s->corner);
    qm_context_free(t->ctx, s->twin, sides, sizeof *s->twin);
    qm_context_free(t->ctx, s->out, t->vertex_count, sizeof *s->out);
    qm_context_free(t->ctx, s->is_gone, t->face_count, 1);
    qm_context_free(t->ctx, s->is_feature, sides, 1);
    qm_context_free(t->ctx, s->positions, t->vertex_count, 3 * sizeof *s->positions);
    *s = (qm_quads_snapshot){0};
}

void qm_quads_snapshot_take(const qm_quads_sides *t, qm_quads_snapshot *s)
{
    size_t sides = 4 * t->face_count;
    memcpy(s->corner, t->r->mesh.faces, sides * sizeof *s->corner);
    memcpy(s->twin, t->twin, sides * sizeof *s->twin);
    memcpy(s->out, t->out, t->vertex_count * sizeof *s->out);
    memcpy(s->is_gone, t->is_gone, t->face_count);
    memcpy(s->is_feature, t->r->is_feature, sides);
    memcpy(s->positions, t->r->mesh.positions, 3 * t->vertex_count * sizeof *s->positions);
}

void qm_quads_snapshot_restore(qm_quads_sides *t, const qm_quads_snapshot *s)
{
    size_t sides = 4 * t->face_count;
    memcpy(t->r->mesh.faces, s->corner, sides * sizeof *s->corner);
    memcpy(t->twin, s->twin, sides * sizeof *s->twin);
    memcpy(t->out, s->out, t->vertex_count * sizeof *s->out);
    memcpy(t->is_gone, s->is_gone, t->face_count);
    memcpy(t->r->is_feature, s->is_feature, sides);
    memcpy(t->r->mesh.positions, s->positions, 3 * t->vertex_count * sizeof *s->positions);
}
