/**
 * quads_features.c: creases and corners of a triangle mesh.
 */
#include "quads/quads_internal.h"

#include <string.h>

#include "core/union_find.h"

#define SHORTEST 3.0 /* of connected creases and of branches with a loose end, in sides of a quad */
#define END_LENGTH                                                                                           \
    12.0 /* of connected creases, for each loose end: rough surfaces have many, machined ones few */
#define NODE_LENGTH 1.5 /* ... for each bend and each vertex where several meet */
/* An edge between faces that bend on to others, by this part of the crease angle, is a sample of a rounded surface: it counts as
 * one side at most, however long it is. */
#define ROUNDED_SHARE 0.25
#define BRANCH_ROUNDS 3 /* a branch that goes leaves another */
#define FINE_RADIUS 0.7 /* of the faces whose normals tell of a crease, in sides of a quad */
#define FINE_ROUNDS 3   /* a crease that goes opens the sides of the next one */
#define SHARP_BEND 0.5  /* cosine of the bend of a feature at which its vertex is a corner: 60 degrees */

static void mark(qm_trimesh *m, uint32_t h, uint8_t value)
{
    m->is_feature[h] = value;
    if (m->twin[h] != QM_NO_INDEX) m->is_feature[m->twin[h]] = value;
}

static void mark_creases(qm_trimesh *m, double angle)
{
    double cosine = cos(angle * QM_DEGREE);
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        uint32_t t = m->twin[h];
        if (t == QM_NO_INDEX || t < h) continue;
        qm_vec a = qm_trimesh_normal(m, h / 3), b = qm_trimesh_normal(m, t / 3);
        double scale = qm_vec_norm(a) * qm_vec_norm(b);
        if (scale > 0.0 && qm_vec_dot(a, b) < cosine * scale) mark(m, h, true);
    }
}

/** A search over faces. */
typedef struct face_search {
    qm_vec *centroid, *normal; /* of each face */
    uint32_t *seen;            /* the last search that met each face */
    uint32_t *queue;           /* faces */
    uint32_t search;           /* this one */
} face_search;

/** False: out of memory; *out is the caller's in any case. */
static bool prepare_search(qm_context *ctx, const qm_trimesh *m, face_search *out)
{
    size_t faces = m->face_count;
    *out = (face_search){0};
    out->centroid = qm_context_alloc(ctx, faces, sizeof *out->centroid);
    out->normal = qm_context_alloc(ctx, faces, sizeof *out->normal);
    out->seen = qm_context_alloc(ctx, faces, sizeof *out->seen);
    out->queue = qm_context_alloc(ctx, faces, sizeof *out->queue);
    if (!out->centroid || !out->normal || !out->seen || !out->queue) return false;
    memset(out->seen, 0, faces * sizeof *out->seen);
    for (uint32_t f = 0; f < faces; f++) {
        const uint32_t *c = m->from + 3 * (size_t)f;
        const qm_vec corner[3] = {m->position[c[0]], m->position[c[1]], m->position[c[2]]};
        out->centroid[f] = qm_vec_centroid(corner, 3);
        out->normal[f] = qm_trimesh_normal(m, f);
    }
    return true;
}

static void reset_search(qm_context *ctx, const qm_trimesh *m, face_search *s)
{
    qm_context_free(ctx, s->centroid, m->face_count, sizeof *s->centroid);
    qm_context_free(ctx, s->normal, m->face_count, sizeof *s->normal);
    qm_context_free(ctx, s->seen, m->face_count, sizeof *s->seen);
    qm_context_free(ctx, s->queue, m->face_count, sizeof *s->queue);
}

/**
 * Adds up the normals of the faces on one side of a crease, from the face at one of its edges on and without crossing features. False: these
 * faces meet the other one, if there is such, since the crease ends nearby.
 */
static bool add_side(const qm_trimesh *m, uint32_t start, uint32_t other, qm_vec centre, double radius,
                     face_search *s, qm_vec *normal)
{
    size_t head = 0, tail = 0;
    *normal = (qm_vec){0, 0, 0};
    s->search++;
    s->queue[tail++] = start;
    s->seen[start] = s->search;
    while (head < tail) {
        uint32_t f = s->queue[head++];
        if (f == other) return false;
        *normal = qm_vec_add(*normal, s->normal[f]);
        for (uint32_t h = 3 * f; h < 3 * f + 3; h++) {
            if (m->is_feature[h]) continue;
            uint32_t g = m->twin[h] / 3;
            if (s->seen[g] == s->search) continue;
            s->seen[g] = s->search;
            if (qm_vec_distance(s->centroid[g], centre) <= radius) s->queue[tail++] = g;
        }
    }
    return true;
}

/**
 * Unmarks creases that are none at the size of a quad: within the radius their sides meet, or have normals that differ by
 * less than the angle.
 */
static qm_status drop_fine(qm_context *ctx, qm_trimesh *m, double angle, double radius, face_search *search)
{
    size_t halves = 3 * m->face_count;
    uint8_t *is_kept = qm_context_alloc(ctx, halves, 1);
    qm_status status = is_kept ? QM_OK : QM_E_NO_MEMORY;
    double cosine = cos(angle * QM_DEGREE);
    if (status == QM_OK) {
        memcpy(is_kept, m->is_feature, halves);
        for (uint32_t h = 0; h < halves && status == QM_OK; h++) {
            uint32_t t = m->twin[h];
            if (!m->is_feature[h] || t == QM_NO_INDEX || t < h) continue;
            /* many faces of the surface may lie within the radius of one quad */
            if (qm_context_canceled(ctx)) status = QM_E_CANCELED;
            qm_vec middle = qm_vec_mix(m->position[m->from[h]], m->position[m->from[t]], 0.5);
            qm_vec a, b;
            is_kept[h] = is_kept[t] = add_side(m, h / 3, t / 3, middle, radius, search, &a) &&
                                      add_side(m, t / 3, QM_NO_INDEX, middle, radius, search, &b) &&
                                      qm_vec_dot(a, b) < cosine * qm_vec_norm(a) * qm_vec_norm(b);
        }
        memcpy(m->is_feature, is_kept, halves);
    }
    qm_context_free(ctx, is_kept, halves, 1);
    return status;
}

/** Creases by vertex: those of v are half[start[v]] ... half[start[v + 1] - 1], which run from it. */
typedef struct crease_graph {
    uint32_t *start, *half;
    uint32_t *degree; /* of each vertex: creases and boundary edges that are marked */
    size_t half_count;
} crease_graph;

static bool is_crease(const qm_trimesh *m, uint32_t h)
{
    return m->is_feature[h] && m->twin[h] != QM_NO_INDEX;
}

static qm_status list_creases(qm_context *ctx, const qm_trimesh *m, crease_graph *g)
{
    size_t count = m->vertex_count, halves = 3 * m->face_count;
    for (uint32_t h = 0; h < halves; h++)
        g->half_count += is_crease(m, h);
    g->start = qm_context_alloc(ctx, count + 1, sizeof *g->start);
    g->half = qm_context_alloc(ctx, g->half_count, sizeof *g->half);
    g->degree = qm_context_alloc(ctx, count, sizeof *g->degree);
    if (!g->start || (g->half_count > 0 && !g->half) || !g->degree) return QM_E_NO_MEMORY;
    memset(g->start, 0, (count + 1) * sizeof *g->start);
    memset(g->degree, 0, count * sizeof *g->degree);
    for (uint32_t h = 0; h < halves; h++) {
        if (!m->is_feature[h]) continue;
        g->degree[m->from[h]]++;
        if (is_crease(m, h))
            g->start[m->from[h]]++;
        else
            g->degree[qm_trimesh_to(m, h)]++;
    }
    for (size_t v = 0; v < count; v++)
        g->start[v + 1] += g->start[v];
    for (uint32_t h = 0; h < halves; h++)
        if (is_crease(m, h)) g->half[--g->start[m->from[h]]] = h;
    return QM_OK;
}

static void reset_creases(qm_context *ctx, const qm_trimesh *m, crease_graph *g)
{
    qm_context_free(ctx, g->start, m->vertex_count + 1, sizeof *g->start);
    qm_context_free(ctx, g->half, g->half_count, sizeof *g->half);
    qm_context_free(ctx, g->degree, m->vertex_count, sizeof *g->degree);
    *g = (crease_graph){0};
}

/** A marked crease from a vertex, other than one; QM_NO_INDEX: there is none. */
static uint32_t crease_from(const qm_trimesh *m, const crease_graph *g, uint32_t vertex, uint32_t other)
{
    for (uint32_t k = g->start[vertex]; k < g->start[vertex + 1]; k++)
        if (m->is_feature[g->half[k]] && g->half[k] != other) return g->half[k];
    return QM_NO_INDEX;
}

/** Unmarks the creases from a loose end to where they meet others, or end again, if that is not far. */
static bool drop_branch(qm_trimesh *m, const crease_graph *g, uint32_t end, double shortest)
{
    double length = 0.0;
    uint32_t first = crease_from(m, g, end, QM_NO_INDEX), h = first;
    while (h != QM_NO_INDEX && length < shortest) {
        length += qm_vec_norm(qm_trimesh_edge(m, h));
        uint32_t vertex = qm_trimesh_to(m, h);
        h = g->degree[vertex] == 2 ? crease_from(m, g, vertex, m->twin[h]) : QM_NO_INDEX;
    }
    if (length >= shortest) return false;
    for (h = first; h != QM_NO_INDEX;) {
        uint32_t vertex = qm_trimesh_to(m, h), twin = m->twin[h];
        uint32_t next = g->degree[vertex] == 2 ? crease_from(m, g, vertex, twin) : QM_NO_INDEX;
        mark(m, h, false);
        g->degree[m->from[h]]--, g->degree[vertex]--;
        h = next;
    }
    return true;
}

/** True if a face bends on to another across an edge that is no crease, by at least the angle of a cosine. */
static bool bends_on(const qm_trimesh *m, uint32_t face, double cosine)
{
    qm_vec own = qm_trimesh_normal(m, face);
    for (uint32_t h = 3 * face; h < 3 * face + 3; h++) {
        if (m->is_feature[h] || m->twin[h] == QM_NO_INDEX) continue;
        qm_vec other = qm_trimesh_normal(m, m->twin[h] / 3);
        if (qm_vec_dot(own, other) < cosine * qm_vec_norm(own) * qm_vec_norm(other)) return true;
    }
    return false;
}

/** What a crease counts, in sides of a quad. */
static double crease_length(const qm_trimesh *m, uint32_t h, double cosine, double size)
{
    double length = qm_vec_norm(qm_trimesh_edge(m, h)) / size;
    bool is_rounded = bends_on(m, h / 3, cosine) || bends_on(m, m->twin[h] / 3, cosine);
    return is_rounded ? qm_min(length, 1.0) : length;
}

/** Unmarks creases of connected ones that are short for the number of their nodes. */
static bool drop_tangles(qm_context *ctx, qm_trimesh *m, const crease_graph *g, double cosine, double size)
{
    size_t count = m->vertex_count;
    uint32_t *parent = qm_context_alloc(ctx, count, sizeof *parent);
    double *length = qm_context_alloc(ctx, count, sizeof *length); /* less what the nodes ask for */
    if (parent && length) {
        for (uint32_t v = 0; v < count; v++)
            parent[v] = v, length[v] = -SHORTEST;
        for (uint32_t h = 0; h < 3 * m->face_count; h++)
            if (is_crease(m, h)) qm_union_find_join(parent, m->from[h], qm_trimesh_to(m, h));
        for (uint32_t h = 0; h < 3 * m->face_count; h++)
            if (is_crease(m, h) && m->twin[h] > h)
                length[qm_union_find_root(parent, m->from[h])] += crease_length(m, h, cosine, size);
        for (uint32_t v = 0; v < count; v++) {
            double *rest = &length[qm_union_find_root(parent, v)];
            if (g->degree[v] == 1)
                *rest -= END_LENGTH;
            else if (g->degree[v] > 0 && m->is_fixed[v])
                *rest -= NODE_LENGTH;
        }
        for (uint32_t h = 0; h < 3 * m->face_count; h++)
            if (is_crease(m, h) && length[qm_union_find_root(parent, m->from[h])] < 0.0) mark(m, h, false);
    }
    bool has_memory = parent && length;
    qm_context_free(ctx, parent, count, sizeof *parent);
    qm_context_free(ctx, length, count, sizeof *length);
    return has_memory;
}

static void fix_corners(qm_trimesh *m)
{
    for (uint32_t v = 0; v < m->vertex_count; v++) {
        uint32_t line[2];
        m->is_fixed[v] = false;
        int kind = qm_trimesh_kind(m, v, line);
        if (kind == QM_TRIMESH_CORNER) m->is_fixed[v] = true;
        if (kind != QM_TRIMESH_ON_LINE) continue;
        qm_vec a = qm_vec_sub(m->position[v], m->position[line[0]]);
        qm_vec b = qm_vec_sub(m->position[line[1]], m->position[v]);
        m->is_fixed[v] = qm_vec_dot(a, b) < SHARP_BEND * qm_vec_norm(a) * qm_vec_norm(b);
    }
}

/** Unmarks what is no line at the size of a quad, but roughness: branches with a loose end, then what is tangled. */
static qm_status drop_rough(qm_context *ctx, qm_trimesh *m, double cosine, double size)
{
    crease_graph g = {0};
    qm_status status = list_creases(ctx, m, &g);
    bool is_changing = status == QM_OK;
    for (int round = 0; round < BRANCH_ROUNDS && is_changing; round++) {
        is_changing = false;
        for (uint32_t v = 0; v < m->vertex_count; v++)
            if (g.degree[v] == 1) is_changing |= drop_branch(m, &g, v, SHORTEST * size);
    }
    if (status == QM_OK) {
        fix_corners(m);
        if (!drop_tangles(ctx, m, &g, cosine, size)) status = QM_E_NO_MEMORY;
    }
    reset_creases(ctx, m, &g);
    return status;
}

qm_status qm_quads_find_features(qm_context *ctx, qm_trimesh *m, double crease_angle, double size,
                                 bool drops_facets)
{
    /* no angle has a cosine of -2 */
    double cosine = drops_facets ? cos(ROUNDED_SHARE * crease_angle * QM_DEGREE) : -2.0;
    qm_status status = QM_OK;
    if (crease_angle > 0.0) {
        face_search search;
        mark_creases(m, crease_angle);
        if (!prepare_search(ctx, m, &search)) status = QM_E_NO_MEMORY;
        for (int round = 0; round < FINE_ROUNDS && status == QM_OK; round++)
            status = drop_fine(ctx, m, crease_angle, FINE_RADIUS * size, &search);
        reset_search(ctx, m, &search);
        if (status == QM_OK) status = drop_rough(ctx, m, cosine, size);
    }
    if (status == QM_OK) fix_corners(m);
    return status;
}

/** A face with several features is cut from the middle of the edge, or of the first edge, that is none. */
qm_status qm_quads_separate_features(qm_context *ctx, qm_trimesh *m)
{
    qm_status status = QM_OK;
    size_t count = m->face_count;
    for (uint32_t f = 0; f < count && status == QM_OK; f++) {
        uint32_t features = 0, opposite = 3 * f, vertex;
        for (uint32_t h = 3 * f; h < 3 * f + 3; h++) {
            features += m->is_feature[h];
            if (!m->is_feature[h]) opposite = h;
        }
        if (features == 2) {
            qm_vec middle =
                qm_vec_mix(m->position[m->from[opposite]], m->position[qm_trimesh_to(m, opposite)], 0.5);
            status = qm_trimesh_split(ctx, m, opposite, middle, &vertex);
        } else if (features == 3) {
            /* a vertex inside: split an edge would put it on a feature, and two of the faces would still have two */
            status = qm_trimesh_split_face(ctx, m, f, &vertex);
        }
    }
    return status;
}
