/**
 * quads_extract.c: from steps to quads.
 *
 * Edges without a step are contracted. A triangle with consistent steps of at most 1 and an edge without one has no area
 * on the grid and goes with it; any other is half a cell: two of its edges are sides of the cell, one is a diagonal. The
 * two triangles at a diagonal are a quad.
 *
 * Between features that lie apart the flow may have taken all rows away. Edges from one to the other stay, or both would become
 * one line in the middle.
 *
 * Nor can every other edge be contracted: round a thin part the surface may have no step at all. Where what is left beyond such an edge
 * is shallow, it is cut off. Triangles without a partner by
 * their steps are matched by augmenting paths in the dual graph; what is a cubic graph without bridges always has a
 * perfect matching (Petersen 1891). Where there is none, every face is cut by its midpoints.
 *
 * Source: J. Edmonds, Paths, trees, and flowers, 1965.
 */
#include "quads/quads_internal.h"

#include <stdlib.h>
#include <string.h>

#define MOST_POCKET 64   /* faces */
#define MOST_COMMON 16   /* neighbours of both ends of an edge that are tried */
#define POCKET_DEPTH 0.5 /* in sides of a quad: of deeper ones horns are made */
#define MOST_PINCH 1.75  /* between features that become one, in sides of a quad */

typedef struct pairing {
    qm_context *ctx;
    qm_trimesh *m;
    uint32_t *mate;   /* of each face: the half-edge to its partner; QM_NO_INDEX: none */
    uint32_t *before; /* of faces that a search reached: the half-edge by which, from an outer face */
    uint32_t *base;   /* of each face: the face that its contracted odd cycle hangs on, or itself */
    uint8_t *state;   /* of each face: the bits below */
    uint32_t *queue;  /* outer faces: those at even distance */
    uint32_t *touched;
    size_t queued, touched_count;
} pairing;

static bool has_step(const qm_trimesh *m, uint32_t h)
{
    return m->step[h][0] != 0 || m->step[h][1] != 0;
}

/** The most bound vertex stays where it is; equal ones meet at the mean by their number of corners. */
typedef struct gathered {
    qm_vec sum;
    double count;
    int kind;
} gathered;

static void contract(qm_trimesh *m, gathered *g, uint32_t h)
{
    gathered *gone = &g[m->from[h]], *kept = &g[qm_trimesh_to(m, h)];
    if (gone->kind > kept->kind) {
        *kept = *gone;
    } else if (gone->kind == kept->kind && kept->kind != QM_TRIMESH_CORNER) {
        kept->sum = qm_vec_add(kept->sum, gone->sum);
        kept->count += gone->count;
    }
    qm_trimesh_collapse(m, h);
}

static qm_vec gathered_at(const gathered *g)
{
    return qm_vec_scale(1.0 / g->count, g->sum);
}

/** True if an edge leads from one feature to another that is too far away to become one with it. */
static bool is_pinch(const qm_trimesh *m, const gathered *g, uint32_t h, double most)
{
    const gathered *a = &g[m->from[h]], *b = &g[qm_trimesh_to(m, h)];
    if (m->is_feature[h] || a->kind == QM_TRIMESH_FREE || b->kind == QM_TRIMESH_FREE) return false;
    return qm_vec_distance(gathered_at(a), gathered_at(b)) > most;
}

/*
 * Pockets: three edges of a cycle that is no face close round a piece of the surface that has no room on the grid. An edge without a
 * step cannot be contracted then, and quads a twentieth as long as the others would be left of the piece.
 */

typedef struct pocket {
    uint32_t vertex[3], side[3]; /* the cycle, and the half-edges along it, inside */
    uint32_t face[MOST_POCKET];
    size_t count;
} pocket;

static bool is_in_pocket(const pocket *p, uint32_t face)
{
    for (size_t i = 0; i < p->count; i++)
        if (p->face[i] == face) return true;
    return false;
}

/** Which edge of the cycle a half-edge runs along; 3: none. */
static uint32_t cycle_side(const qm_trimesh *m, const pocket *p, uint32_t h)
{
    for (uint32_t k = 0; k < 3; k++)
        if (m->from[h] == p->vertex[k] && qm_trimesh_to(m, h) == p->vertex[(k + 1) % 3]) return k;
    return 3;
}

/** Gathers the faces on the left of a cycle from that of its first side on. False: it is no small disc without features. */
static bool gather_pocket(const qm_trimesh *m, pocket *p)
{
    p->face[0] = p->side[0] / 3, p->count = 1;
    uint32_t sides = 0;
    for (size_t i = 0; i < p->count; i++) {
        for (uint32_t h = 3 * p->face[i]; h < 3 * p->face[i] + 3; h++) {
            uint32_t k = cycle_side(m, p, h), t = m->twin[h];
            if (k < 3) {
                p->side[k] = h, sides++;
                continue;
            }
            if (t == QM_NO_INDEX || m->is_feature[h]) return false;
            if (is_in_pocket(p, t / 3)) continue;
            if (p->count == MOST_POCKET) return false;
            p->face[p->count++] = t / 3;
        }
    }
    if (sides != 3) return false;
    for (uint32_t k = 0; k < 3; k++)
        if (m->twin[p->side[k]] != QM_NO_INDEX && is_in_pocket(p, m->twin[p->side[k]] / 3)) return false;
    return true;
}

/** True if a pocket is a disc, all vertices of which lie near the segment from its edge without a step to the third vertex. */
static bool is_shallow(qm_trimesh *m, const pocket *p, double depth)
{
    size_t inner = 0;
    m->stamp_value++;
    qm_vec from = m->position[p->vertex[0]], way = qm_vec_sub(m->position[p->vertex[2]], from);
    double length2 = qm_max(qm_vec_norm2(way), QM_MIN_LENGTH);
    for (size_t i = 0; i < p->count; i++) {
        for (uint32_t h = 3 * p->face[i]; h < 3 * p->face[i] + 3; h++) {
            uint32_t v = m->from[h];
            if (v == p->vertex[0] || v == p->vertex[1] || v == p->vertex[2]) continue;
            qm_vec at = qm_vec_sub(m->position[v], from);
            double share = qm_min(qm_max(qm_vec_dot(at, way) / length2, 0.0), 1.0);
            if (m->stamp[v] != m->stamp_value) inner++;
            m->stamp[v] = m->stamp_value;
            if (m->is_fixed[v] || qm_vec_norm(qm_vec_axpy(at, -share, way)) > depth) return false;
        }
    }
    return p->count ==
           2 * inner + 1; /* as Euler's formula has it for a disc of triangles with a boundary of three */
}

/** Replaces the faces of a pocket by one. */
static void cut_pocket(qm_trimesh *m, const pocket *p)
{
    uint32_t twin[3];
    int32_t step[3][2];
    for (uint32_t k = 0; k < 3; k++) {
        twin[k] = m->twin[p->side[k]];
        memcpy(step[k], m->step[p->side[k]], sizeof step[k]);
    }
    for (size_t i = 0; i < p->count; i++)
        for (uint32_t h = 3 * p->face[i]; h < 3 * p->face[i] + 3; h++) {
            m->out[m->from[h]] = QM_NO_INDEX;
            m->from[h] = QM_NO_INDEX;
        }
    for (uint32_t k = 0; k < 3; k++) {
        uint32_t h = 3 * p->face[0] + k;
        m->from[h] = p->vertex[k];
        m->out[p->vertex[k]] = h;
        m->twin[h] = twin[k];
        m->is_feature[h] = twin[k] == QM_NO_INDEX || m->is_feature[twin[k]];
        if (twin[k] != QM_NO_INDEX) m->twin[twin[k]] = h;
        memcpy(m->step[h], step[k], sizeof step[k]);
    }
}

/** Cuts a shallow pocket on the left of a half-edge, if there is one. */
static bool cut_pocket_at(qm_trimesh *m, uint32_t h, double depth)
{
    uint32_t u = m->from[h], v = qm_trimesh_to(m, h), apex = m->from[qm_trimesh_prev(h)];
    uint32_t first = qm_trimesh_first(m, u), k = first, common[MOST_COMMON];
    size_t count = 0;
    m->stamp_value++;
    do {
        m->stamp[qm_trimesh_to(m, k)] = m->stamp_value;
        k = qm_trimesh_around(m, k);
    } while (k != QM_NO_INDEX && k != first);
    first = k = qm_trimesh_first(m, v);
    do {
        uint32_t w = qm_trimesh_to(m, k);
        if (w != u && w != apex && m->stamp[w] == m->stamp_value && count < MOST_COMMON) common[count++] = w;
        k = qm_trimesh_around(m, k);
    } while (k != QM_NO_INDEX && k != first);
    for (size_t i = 0; i < count; i++) {
        pocket p = {.vertex = {u, v, common[i]}, .side = {h}};
        if (!gather_pocket(m, &p) || !is_shallow(m, &p, depth)) continue;
        cut_pocket(m, &p);
        return true;
    }
    return false;
}

static bool cut_pockets(qm_trimesh *m, double depth)
{
    bool is_changing = false;
    for (uint32_t h = 0; h < 3 * m->face_count; h++)
        if (qm_trimesh_has_face(m, h / 3) && !has_step(m, h)) is_changing |= cut_pocket_at(m, h, depth);
    return is_changing;
}

static qm_status contract_all(qm_context *ctx, qm_trimesh *m, double size)
{
    size_t count = m->vertex_count;
    gathered *g = qm_context_alloc(ctx, count, sizeof *g);
    if (!g) return QM_E_NO_MEMORY;
    for (uint32_t v = 0; v < count; v++) {
        uint32_t line[2];
        g[v] = (gathered){m->position[v], 1.0, qm_trimesh_kind(m, v, line)};
    }
    bool is_changing = true;
    while (is_changing && !qm_context_canceled(ctx)) {
        is_changing = false;
        for (uint32_t h = 0; h < 3 * m->face_count; h++) {
            if (!qm_trimesh_has_face(m, h / 3) || has_step(m, h) || is_pinch(m, g, h, MOST_PINCH * size) ||
                !qm_trimesh_can_collapse(m, h))
                continue;
            contract(m, g, h);
            is_changing = true;
        }
        if (!is_changing) is_changing = cut_pockets(m, POCKET_DEPTH * size);
    }
    for (uint32_t v = 0; v < count; v++)
        if (m->out[v] != QM_NO_INDEX) m->position[v] = gathered_at(&g[v]);
    qm_context_free(ctx, g, count, sizeof *g);
    qm_trimesh_compact(m);
    return qm_context_canceled(ctx) ? QM_E_CANCELED : QM_OK;
}

/*
 * Matching.
 */

static void pair_at(pairing *p, uint32_t h)
{
    p->mate[h / 3] = h;
    p->mate[p->m->twin[h] / 3] = p->m->twin[h];
}

/** The triangles of a half-edge have a second edge in common: a pair of them would repeat a corner. */
static bool is_pillow(const qm_trimesh *m, uint32_t h)
{
    return m->from[qm_trimesh_prev(h)] == m->from[qm_trimesh_prev(m->twin[h])];
}

static bool is_diagonal(const qm_trimesh *m, uint32_t h)
{
    return abs(m->step[h][0]) == 1 && abs(m->step[h][1]) == 1 && !m->is_feature[h];
}

static bool has_area(const qm_trimesh *m, uint32_t f)
{
    return m->step[3 * f][0] * m->step[3 * f + 1][1] != m->step[3 * f][1] * m->step[3 * f + 1][0];
}

static void pair_by_steps(pairing *p)
{
    const qm_trimesh *m = p->m;
    for (uint32_t f = 0; f < m->face_count; f++)
        p->mate[f] = QM_NO_INDEX;
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        uint32_t t = m->twin[h];
        if (t == QM_NO_INDEX || p->mate[h / 3] != QM_NO_INDEX || p->mate[t / 3] != QM_NO_INDEX) continue;
        if (is_diagonal(m, h) && has_area(m, h / 3) && has_area(m, t / 3) && !is_pillow(m, h)) pair_at(p, h);
    }
}

static uint32_t boundary_of(const qm_trimesh *m, uint32_t face)
{
    for (uint32_t h = 3 * face; h < 3 * face + 3; h++)
        if (m->twin[h] == QM_NO_INDEX) return h;
    return QM_NO_INDEX;
}

enum { IS_TOUCHED = 1, IS_OUTER = 2, IS_IN_CYCLE = 4, IS_ON_WAY = 8 };

static uint32_t partner_of(const pairing *p, uint32_t face)
{
    return p->mate[face] == QM_NO_INDEX ? QM_NO_INDEX : p->m->twin[p->mate[face]] / 3;
}

static void touch(pairing *p, uint32_t face)
{
    if (p->state[face] & IS_TOUCHED) return;
    p->state[face] = IS_TOUCHED;
    p->before[face] = QM_NO_INDEX;
    p->base[face] = face;
    p->touched[p->touched_count++] = face;
}

static void make_outer(pairing *p, uint32_t face)
{
    touch(p, face);
    p->state[face] |= IS_OUTER;
    p->queue[p->queued++] = face;
}

/** The outer face before an inner one. */
static uint32_t outer_before(const pairing *p, uint32_t face)
{
    return p->before[face] / 3;
}

/** Where the ways of two outer faces back to the root meet. */
static uint32_t common_base(pairing *p, uint32_t a, uint32_t b, uint32_t root)
{
    uint32_t f = a, found;
    for (;;) {
        f = p->base[f];
        p->state[f] |= IS_ON_WAY;
        if (f == p->base[root]) break;
        f = outer_before(p, partner_of(p, f));
    }
    for (found = p->base[b]; !(p->state[found] & IS_ON_WAY);)
        found = p->base[outer_before(p, partner_of(p, found))];
    for (f = a;;) {
        f = p->base[f];
        p->state[f] &= (uint8_t)~IS_ON_WAY;
        if (f == p->base[root]) break;
        f = outer_before(p, partner_of(p, f));
    }
    return found;
}

/** Marks the bases from an outer face back to one; entry is the half-edge that comes to it from the other side of the cycle. */
static void mark_cycle(pairing *p, uint32_t face, uint32_t base, uint32_t entry)
{
    while (p->base[face] != base) {
        uint32_t partner = partner_of(p, face);
        p->state[p->base[face]] |= IS_IN_CYCLE;
        p->state[p->base[partner]] |= IS_IN_CYCLE;
        p->before[face] = entry;
        face = outer_before(p, partner);
        entry = p->m->twin[p->before[partner]];
    }
}

/** Contracts the odd cycle that a half-edge between two outer faces closes: all its faces become outer ones. */
static void contract_cycle(pairing *p, uint32_t h, uint32_t root)
{
    uint32_t a = h / 3, b = p->m->twin[h] / 3, base = common_base(p, a, b, root);
    size_t count = p->touched_count;
    mark_cycle(p, a, base, p->m->twin[h]);
    mark_cycle(p, b, base, h);
    for (size_t i = 0; i < count; i++) {
        uint32_t f = p->touched[i];
        if (!(p->state[p->base[f]] & IS_IN_CYCLE)) continue;
        p->base[f] = base;
        if (!(p->state[f] & IS_OUTER)) make_outer(p, f);
    }
    for (size_t i = 0; i < count; i++)
        p->state[p->touched[i]] &= (uint8_t)~IS_IN_CYCLE;
}

/** Turns the way back from an inner face without a partner round: all on it get new partners. */
static void augment(pairing *p, uint32_t face)
{
    while (face != QM_NO_INDEX) {
        uint32_t h = p->before[face], next = partner_of(p, h / 3);
        pair_at(p, h);
        face = next;
    }
}

static bool search_partner(pairing *p, uint32_t root, bool crosses_features)
{
    const qm_trimesh *m = p->m;
    uint32_t at_boundary = QM_NO_INDEX;
    make_outer(p, root);
    for (size_t head = 0; head < p->queued; head++) {
        uint32_t outer = p->queue[head];
        if (at_boundary == QM_NO_INDEX && boundary_of(m, outer) != QM_NO_INDEX) at_boundary = outer;
        for (uint32_t h = 3 * outer; h < 3 * outer + 3; h++) {
            if (m->twin[h] == QM_NO_INDEX || (m->is_feature[h] && !crosses_features) || is_pillow(m, h))
                continue;
            uint32_t other = m->twin[h] / 3;
            touch(p, other);
            if (h == p->mate[outer] || p->base[outer] == p->base[other]) continue;
            if (p->state[other] & IS_OUTER) {
                contract_cycle(p, h, root);
            } else if (p->before[other] == QM_NO_INDEX) {
                p->before[other] = h;
                if (p->mate[other] == QM_NO_INDEX) {
                    augment(p, other);
                    return true;
                }
                make_outer(p, partner_of(p, other));
            }
        }
    }
    if (at_boundary == QM_NO_INDEX) return false;
    uint32_t partner = partner_of(p, at_boundary);
    p->mate[at_boundary] = QM_NO_INDEX;
    augment(p, partner);
    return true;
}

/** A partner for a face without one: true if there is, or if a face at a boundary is alone instead. */
static bool find_partner(pairing *p, uint32_t face, bool crosses_features)
{
    p->queued = p->touched_count = 0;
    bool is_found = search_partner(p, face, crosses_features);
    for (size_t i = 0; i < p->touched_count; i++)
        p->state[p->touched[i]] = 0;
    return is_found;
}

static size_t pair_rest(pairing *p, qm_quads_record *record)
{
    const qm_trimesh *m = p->m;
    size_t alone = 0;
    for (uint32_t f = 0; f < m->face_count; f++)
        record->unmatched += p->mate[f] == QM_NO_INDEX;
    for (int crosses = 0; crosses < 2; crosses++)
        for (uint32_t f = 0; f < m->face_count; f++)
            if (p->mate[f] == QM_NO_INDEX) find_partner(p, f, crosses);
    for (uint32_t f = 0; f < m->face_count; f++)
        alone += p->mate[f] == QM_NO_INDEX && boundary_of(m, f) == QM_NO_INDEX;
    return alone;
}

/*
 * Quads.
 */

static void add_quad(qm_mesh *out, uint8_t *is_feature, const uint32_t corner[4], const uint8_t feature[4])
{
    size_t f = out->face_count++;
    memcpy(out->faces + 4 * f, corner, 4 * sizeof *corner);
    memcpy(is_feature + 4 * f, feature, 4);
}

/** Faces of the result by pairs; a face that is alone at a boundary has a vertex in its boundary edge. */
static void write_pairs(const pairing *p, qm_mesh *out, uint8_t *is_feature)
{
    const qm_trimesh *m = p->m;
    for (uint32_t f = 0; f < m->face_count; f++) {
        uint32_t h = p->mate[f];
        if (h != QM_NO_INDEX) {
            uint32_t t = m->twin[h];
            if (t < h) continue;
            uint32_t tn = qm_trimesh_next(t), tp = qm_trimesh_prev(t), hn = qm_trimesh_next(h),
                     hp = qm_trimesh_prev(h);
            const uint32_t corner[4] = {m->from[tn], m->from[tp], m->from[hn], m->from[hp]};
            const uint8_t feature[4] = {m->is_feature[tn], m->is_feature[tp], m->is_feature[hn],
                                        m->is_feature[hp]};
            add_quad(out, is_feature, corner, feature);
        } else {
            h = boundary_of(m, f);
            uint32_t hn = qm_trimesh_next(h), hp = qm_trimesh_prev(h), middle = (uint32_t)out->vertex_count++;
            qm_vec_store(out->positions + 3 * (size_t)middle,
                         qm_vec_mix(m->position[m->from[h]], m->position[m->from[hn]], 0.5));
            const uint32_t corner[4] = {m->from[h], middle, m->from[hn], m->from[hp]};
            const uint8_t feature[4] = {true, true, m->is_feature[hn], m->is_feature[hp]};
            add_quad(out, is_feature, corner, feature);
        }
    }
}

/** Faces of the result by midpoints: three for each face. Vertices of edges come after those of the mesh, then the centroids. */
static void write_thirds(const pairing *p, qm_mesh *out, uint8_t *is_feature)
{
    const qm_trimesh *m = p->m;
    uint32_t *middle = p->queue; /* of each half-edge */
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        uint32_t t = m->twin[h];
        if (t != QM_NO_INDEX && t < h) {
            middle[h] = middle[t];
            continue;
        }
        middle[h] = (uint32_t)out->vertex_count++;
        qm_vec_store(out->positions + 3 * (size_t)middle[h],
                     qm_vec_mix(m->position[m->from[h]], m->position[qm_trimesh_to(m, h)], 0.5));
    }
    for (uint32_t f = 0; f < m->face_count; f++) {
        uint32_t centre = (uint32_t)out->vertex_count++;
        const uint32_t *c = m->from + 3 * f;
        const qm_vec corners[3] = {m->position[c[0]], m->position[c[1]], m->position[c[2]]};
        qm_vec_store(out->positions + 3 * (size_t)centre, qm_vec_centroid(corners, 3));
        for (uint32_t h = 3 * f; h < 3 * f + 3; h++) {
            uint32_t back = qm_trimesh_prev(h);
            const uint32_t corner[4] = {m->from[h], middle[h], centre, middle[back]};
            const uint8_t feature[4] = {m->is_feature[h], false, false, m->is_feature[back]};
            add_quad(out, is_feature, corner, feature);
        }
    }
}

static void count_quads(const pairing *p, bool by_thirds, size_t *faces, size_t *vertices)
{
    const qm_trimesh *m = p->m;
    size_t edges = 0, alone = 0;
    for (uint32_t h = 0; h < 3 * m->face_count; h++)
        edges += m->twin[h] == QM_NO_INDEX || m->twin[h] > h;
    for (uint32_t f = 0; f < m->face_count; f++)
        alone += p->mate[f] == QM_NO_INDEX;
    *faces = by_thirds ? 3 * m->face_count : (m->face_count + alone) / 2;
    *vertices = m->vertex_count + (by_thirds ? edges + m->face_count : alone);
}

static qm_status write_quads(const pairing *p, bool by_thirds, qm_mesh *out, uint8_t **is_fixed,
                             uint8_t **is_feature)
{
    qm_context *ctx = p->ctx;
    const qm_trimesh *m = p->m;
    size_t faces, vertices;
    count_quads(p, by_thirds, &faces, &vertices);
    *out = (qm_mesh){.positions = qm_context_alloc(ctx, vertices, 3 * sizeof *out->positions),
                     .faces = qm_context_alloc(ctx, faces, 4 * sizeof *out->faces)};
    *is_feature = qm_context_alloc(ctx, faces, 4);
    *is_fixed = qm_context_alloc(ctx, vertices, 1);
    bool has_memory = out->positions && out->faces && *is_feature && *is_fixed;
    if (has_memory) {
        out->vertex_count = m->vertex_count;
        memset(*is_fixed, 0, vertices);
        memcpy(*is_fixed, m->is_fixed, m->vertex_count);
        for (uint32_t v = 0; v < m->vertex_count; v++)
            qm_vec_store(out->positions + 3 * (size_t)v, m->position[v]);
        if (by_thirds)
            write_thirds(p, out, *is_feature);
        else
            write_pairs(p, out, *is_feature);
        QM_ASSERT(out->face_count == faces && out->vertex_count == vertices);
    }
    out->face_count = faces, out->vertex_count = vertices;
    return has_memory ? QM_OK : QM_E_NO_MEMORY;
}

qm_status qm_quads_extract(qm_context *ctx, qm_trimesh *m, double size, qm_mesh *out, uint8_t **is_fixed,
                           uint8_t **is_feature, qm_quads_record *record)
{
    qm_status status = contract_all(ctx, m, size);
    if (status != QM_OK) return status;
    size_t faces = m->face_count;
    pairing p = {ctx,
                 m,
                 qm_context_alloc(ctx, faces, sizeof *p.mate),
                 qm_context_alloc(ctx, faces, sizeof *p.before),
                 qm_context_alloc(ctx, faces, sizeof *p.base),
                 qm_context_alloc(ctx, faces, 1),
                 qm_context_alloc(ctx, 3 * faces, sizeof *p.queue),
                 qm_context_alloc(ctx, faces, sizeof *p.touched),
                 0,
                 0};
    bool has_memory = p.mate && p.before && p.base && p.state && p.queue && p.touched;
    status = has_memory ? QM_OK : QM_E_NO_MEMORY;
    if (status == QM_OK) {
        memset(p.state, 0, faces);
        pair_by_steps(&p);
        bool by_thirds = pair_rest(&p, record) > 0;
        record->halved += by_thirds;
        status = write_quads(&p, by_thirds, out, is_fixed, is_feature);
    }
    qm_context_free(ctx, p.mate, faces, sizeof *p.mate);
    qm_context_free(ctx, p.before, faces, sizeof *p.before);
    qm_context_free(ctx, p.base, faces, sizeof *p.base);
    qm_context_free(ctx, p.state, faces, 1);
    qm_context_free(ctx, p.queue, 3 * faces, sizeof *p.queue);
    qm_context_free(ctx, p.touched, faces, sizeof *p.touched);
    return status;
}
