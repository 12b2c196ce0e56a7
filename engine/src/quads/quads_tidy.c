/**
 * quads_tidy.c: fewer irregular vertices by local changes of a quad mesh that keep its topology: a quad is contracted along a
 * diagonal, or the edge between two quads is turned. The irregularity of a vertex is the difference between the number of its
 * quads and the number that its angle has room for: 4 inside, on each side of a feature what is nearest to its angle.
 *
 * Source: the changes: M. Tarini, N. Pietroni, P. Cignoni, D. Panozzo, E. Puppo, Practical quad mesh simplification, 2010.
 */
#include "quads/quads_internal.h"

#include <string.h>

#define ROUNDS 8
#define STRAIGHT_COST 6
#define QUARTER 1.57079632679489661923

typedef struct tidy {
    qm_context *ctx;
    qm_quads_result *r;
    uint32_t *twin;   /* of each side (4 * face + k); QM_NO_INDEX at a boundary */
    uint8_t *is_gone; /* of each face */
    uint32_t *out;    /* of each vertex: a side from it */
    uint32_t *stamp, stamp_value;
    uint8_t *is_bound; /* of each vertex: on a feature */
} tidy;

static uint32_t next_side(uint32_t s)
{
    return s % 4 == 3 ? s - 3 : s + 1;
}

static uint32_t prev_side(uint32_t s)
{
    return s % 4 == 0 ? s + 3 : s - 1;
}

static uint32_t from(const tidy *t, uint32_t side)
{
    return t->r->mesh.faces[side];
}

static qm_vec at(const tidy *t, uint32_t vertex)
{
    return qm_vec_load(t->r->mesh.positions + 3 * (size_t)vertex);
}

/** The first side of the fan of a vertex: at a boundary the one without a twin. */
static uint32_t first_side(const tidy *t, uint32_t vertex)
{
    uint32_t start = t->out[vertex], s = start;
    while (t->twin[s] != QM_NO_INDEX) {
        s = next_side(t->twin[s]);
        if (s == start) break;
    }
    return s;
}

static uint32_t around(const tidy *t, uint32_t s)
{
    return t->twin[prev_side(s)];
}

/** Quads between two features of a vertex. */
typedef struct sector {
    int quads, wanted;
} sector;

/** The sector of the vertex of a side that the face of the side is in. */
static sector sector_at(const tidy *t, uint32_t side)
{
    const uint8_t *is_feature = t->r->is_feature;
    uint32_t first = side, s;
    while (!is_feature[first] && t->twin[first] != QM_NO_INDEX) {
        first = next_side(t->twin[first]);
        if (first == side) break;
    }
    sector found = {0, 4};
    double angle = 0.0;
    bool is_whole = true;
    s = first;
    do {
        uint32_t back = prev_side(s);
        qm_vec p = at(t, from(t, s)), a = qm_vec_sub(at(t, from(t, next_side(s))), p),
               b = qm_vec_sub(at(t, from(t, back)), p);
        angle += atan2(qm_vec_norm(qm_vec_cross(a, b)), qm_vec_dot(a, b));
        found.quads++;
        is_whole = !is_feature[back];
        s = t->twin[back];
    } while (is_whole && s != QM_NO_INDEX && s != first);
    if (!is_whole || s == QM_NO_INDEX) found.wanted = angle < 1.5 * QUARTER ? 1 : (int)lrint(angle / QUARTER);
    return found;
}

/** Less is better; vertices of two quads inside and of seven are worse than two that are off by one. A corner that would have to
 * open to 180 degrees, such as one of two inside or a single one on a straight feature, has no shape at all. */
static int irregularity(sector s, int change)
{
    int quads = s.quads + change, off = quads - s.wanted;
    return off * off + (2 * quads <= s.wanted ? STRAIGHT_COST : 0);
}

static void stamp_ring(tidy *t, uint32_t vertex)
{
    t->stamp_value++;
    uint32_t first = first_side(t, vertex), s = first;
    do {
        for (uint32_t k = next_side(s); k != s; k = next_side(k))
            t->stamp[from(t, k)] = t->stamp_value;
        s = around(t, s);
    } while (s != QM_NO_INDEX && s != first);
}

/** How many vertices round a vertex, also across its quads, are stamped; each counts once. Their stamps go. */
static int count_stamped(tidy *t, uint32_t vertex)
{
    int count = 0;
    uint32_t first = first_side(t, vertex), s = first;
    do {
        for (uint32_t k = next_side(s); k != s; k = next_side(k)) {
            count += t->stamp[from(t, k)] == t->stamp_value;
            t->stamp[from(t, k)] = 0;
        }
        s = around(t, s);
    } while (s != QM_NO_INDEX && s != first);
    return count;
}

static void link_sides(tidy *t, uint32_t a, uint32_t b)
{
    if (a != QM_NO_INDEX) t->twin[a] = b;
    if (b != QM_NO_INDEX) t->twin[b] = a;
}

/*
 * Contraction: the corner of a side goes to the opposite one.
 */

/** The two sides at corner b, on both sides of which the face closes, must have neighbours, that are not one quad. */
static bool closes_well(const tidy *t, uint32_t side)
{
    uint32_t a = t->twin[side], b = t->twin[prev_side(side)];
    return a != QM_NO_INDEX && b != QM_NO_INDEX && a / 4 != b / 4;
}

static bool can_contract(tidy *t, uint32_t side)
{
    uint32_t s1 = next_side(side), s2 = next_side(s1), s3 = next_side(s2);
    uint32_t gone = from(t, side), kept = from(t, s2);
    if (t->is_bound[gone] || !closes_well(t, s1) || !closes_well(t, s3)) return false;
    sector g = sector_at(t, side);
    stamp_ring(t, gone);
    /* what both have round them: the two other corners and, since each is across the face, themselves. A vertex of two quads
       has only these, and is across the other one too. */
    t->stamp[gone] = t->stamp[kept] = 0;
    int common = count_stamped(t, kept);
    return g.quads == 2 ? common <= 3 : common == 2;
}

static int contraction_gain(tidy *t, uint32_t side)
{
    uint32_t s1 = next_side(side), s2 = next_side(s1), s3 = next_side(s2);
    sector a = sector_at(t, side), b = sector_at(t, s1), c = sector_at(t, s2), d = sector_at(t, s3);
    /* a vertex of one quad at a feature, or none at all, would be left */
    if (b.quads < 2 || d.quads < 2 || c.quads + a.quads - 2 < 1) return 0;
    if (b.wanted == 4 && b.quads == 2 && a.quads != 2) return 0;
    int before = irregularity(a, 0) + irregularity(b, 0) + irregularity(c, 0) + irregularity(d, 0);
    return before - irregularity(c, a.quads - 2) - irregularity(b, -1) - irregularity(d, -1);
}

static void contract(tidy *t, uint32_t side)
{
    uint32_t s1 = next_side(side), s2 = next_side(s1), s3 = next_side(s2);
    uint32_t gone = from(t, side), kept = from(t, s2), b = from(t, s1), d = from(t, s3);
    uint32_t *faces = t->r->mesh.faces;
    uint8_t *feature = t->r->is_feature;
    uint32_t first = first_side(t, gone), s = first;
    do {
        faces[s] = kept;
        s = around(t, s);
    } while (s != QM_NO_INDEX && s != first);
    for (int k = 0; k < 2; k++) {
        uint32_t e = k == 0 ? side : s2, f = next_side(e); /* e ends and f begins at b, then at d */
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

/** Of two quads round an edge, with corners 0 to 5 in order: the edge joins 0 and 3; it may join 1 and 4, or 2 and 5. */
static void hexagon_of(const tidy *t, uint32_t side, uint32_t out[6])
{
    uint32_t other = t->twin[side];
    /* side runs from 3 to 0 */
    out[0] = next_side(side), out[1] = next_side(out[0]), out[2] = next_side(out[1]);
    out[3] = next_side(other), out[4] = next_side(out[3]), out[5] = next_side(out[4]);
}

static bool are_neighbours(tidy *t, uint32_t a, uint32_t b)
{
    stamp_ring(t, a);
    return t->stamp[b] == t->stamp_value;
}

static bool try_turn(tidy *t, uint32_t side)
{
    if (t->twin[side] == QM_NO_INDEX || t->r->is_feature[side]) return false;
    uint32_t s[6], v[6], outer[6];
    uint8_t feature[6];
    hexagon_of(t, side, s);
    sector at_corner[6];
    for (int k = 0; k < 6; k++) {
        v[k] = from(t, s[k]);
        outer[k] = t->twin[s[k]];
        feature[k] = t->r->is_feature[s[k]];
        at_corner[k] = sector_at(t, s[k]);
        for (int j = 0; j < k; j++)
            if (v[j] == v[k] || s[j] / 4 == outer[k] / 4 || s[k] / 4 == outer[j] / 4) return false;
    }
    if (at_corner[0].quads < 3 || at_corner[3].quads < 3) return false;
    int best = 0, best_gain = 0;
    for (int k = 1; k < 3; k++) {
        int gain = 0;
        for (int end = 0; end < 6; end += 3) {
            gain += irregularity(at_corner[end], 0) - irregularity(at_corner[end], -1);
            gain += irregularity(at_corner[k + end], 0) - irregularity(at_corner[k + end], 1);
        }
        if (gain > best_gain && !are_neighbours(t, v[k], v[k + 3])) best = k, best_gain = gain;
    }
    if (best_gain == 0) return false;
    /* the quads (k, k + 1, k + 2, k + 3) and (k + 3, k + 4, k + 5, k): their last sides are the edge */
    uint32_t face[2] = {side / 4, t->twin[side] / 4};
    for (int f = 0; f < 2; f++) {
        for (uint32_t i = 0; i < 4; i++) {
            uint32_t to = 4 * face[f] + i, k = ((uint32_t)best + 3 * (uint32_t)f + i) % 6;
            t->r->mesh.faces[to] = v[k];
            t->out[v[k]] = to;
            if (i == 3) continue;
            link_sides(t, to, outer[k]);
            t->r->is_feature[to] = feature[k];
        }
    }
    link_sides(t, 4 * face[0] + 3, 4 * face[1] + 3);
    t->r->is_feature[4 * face[0] + 3] = t->r->is_feature[4 * face[1] + 3] = false;
    return true;
}

static bool try_contraction(tidy *t, uint32_t face)
{
    for (uint32_t side = 4 * face; side < 4 * face + 4; side++) {
        if (!can_contract(t, side) || contraction_gain(t, side) <= 0) continue;
        contract(t, side);
        return true;
    }
    return false;
}

/*
 * The whole mesh.
 */

/** Pairs the sides between the same vertices: in each vertex's list of sides the one to that of the other is searched. */
static bool pair_sides(tidy *t)
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
            uint32_t a = m->faces[s], b = m->faces[next_side(s)];
            uint32_t end = b + 2 <= m->vertex_count ? start[b + 2] : (uint32_t)sides;
            t->twin[s] = QM_NO_INDEX;
            for (uint32_t k = start[b + 1]; k < end; k++)
                if (m->faces[next_side(list[k])] == a) t->twin[s] = list[k];
            t->out[a] = s;
            if (t->r->is_feature[s]) t->is_bound[a] = t->is_bound[b] = true;
        }
    }
    bool has_memory = start && list;
    qm_context_free(t->ctx, start, m->vertex_count + 1, sizeof *start);
    qm_context_free(t->ctx, list, sides, sizeof *list);
    return has_memory;
}

/** Closes the gaps of vertices and faces that are gone. The arrays keep their allocated size until they are copied. */
static qm_status close_gaps(tidy *t)
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

static size_t count_irregular(const tidy *t)
{
    size_t count = 0;
    for (uint32_t v = 0; v < t->r->mesh.vertex_count; v++)
        count += t->out[v] != QM_NO_INDEX && !t->is_bound[v] && sector_at(t, t->out[v]).quads != 4;
    return count;
}

static qm_status run(tidy *t, size_t *irregular)
{
    size_t faces = t->r->mesh.face_count, vertices = t->r->mesh.vertex_count;
    memset(t->is_gone, 0, faces);
    memset(t->is_bound, 0, vertices);
    memset(t->stamp, 0, vertices * sizeof *t->stamp);
    memset(t->out, 0xff, vertices * sizeof *t->out);
    if (!pair_sides(t)) return QM_E_NO_MEMORY;
    bool is_changing = true;
    for (int round = 0; round < ROUNDS && is_changing; round++) {
        is_changing = false;
        for (uint32_t f = 0; f < faces; f++) {
            if (t->is_gone[f]) continue;
            if (try_contraction(t, f)) {
                is_changing = true;
                continue;
            }
            for (uint32_t side = 4 * f; side < 4 * f + 4; side++)
                is_changing |= try_turn(t, side);
        }
        if (qm_context_canceled(t->ctx)) return QM_E_CANCELED;
    }
    *irregular = count_irregular(t);
    return close_gaps(t);
}

qm_status qm_quads_tidy(qm_context *ctx, qm_quads_result *r, size_t *irregular)
{
    size_t faces = r->mesh.face_count, vertices = r->mesh.vertex_count;
    tidy t = {.ctx = ctx, .r = r};
    t.twin = qm_context_alloc(ctx, 4 * faces, sizeof *t.twin);
    t.is_gone = qm_context_alloc(ctx, faces, 1);
    t.out = qm_context_alloc(ctx, vertices, sizeof *t.out);
    t.stamp = qm_context_alloc(ctx, vertices, sizeof *t.stamp);
    t.is_bound = qm_context_alloc(ctx, vertices, 1);
    bool has_memory = t.twin && t.is_gone && t.out && t.stamp && t.is_bound;
    qm_status status = has_memory ? run(&t, irregular) : QM_E_NO_MEMORY;
    qm_context_free(ctx, t.twin, 4 * faces, sizeof *t.twin);
    qm_context_free(ctx, t.is_gone, faces, 1);
    qm_context_free(ctx, t.out, vertices, sizeof *t.out);
    qm_context_free(ctx, t.stamp, vertices, sizeof *t.stamp);
    qm_context_free(ctx, t.is_bound, vertices, 1);
    return status;
}
