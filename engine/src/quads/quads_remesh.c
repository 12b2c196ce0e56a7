/**
 * quads_remesh.c: isotropic remeshing: long edges are split, short ones contracted, edges turned towards six at each
 * vertex, vertices centred among their neighbours and projected onto the surface.
 *
 * Source: M. Botsch, L. Kobbelt, A remeshing approach to multiresolution modeling, 2004.
 */
#include "quads/quads_internal.h"

#include <string.h>

#include "qm/project.h"

#define LONG (4.0 / 3.0)
#define SHORT (4.0 / 5.0)
#define ROUNDS 4
#define MAX_PASSES 24
#define MIN_NORMAL_COSINE 0.5 /* between normals of a face before and after a contraction */
#define FLAT_COSINE 0.8       /* between faces whose common edge may be turned */
#define EDGES_A_POLL 4096

/** The longest edges come first: the halves of a needle are then no thinner than it was. */
static qm_status split_long(qm_context *ctx, qm_trimesh *m, double longest)
{
    double limit = 0.0;
    for (uint32_t h = 0; h < 3 * m->face_count; h++)
        if (qm_trimesh_has_face(m, h / 3)) limit = qm_max(limit, qm_vec_norm(qm_trimesh_edge(m, h)));
    while (limit > longest) {
        limit = qm_max(limit / 1.4, longest);
        for (uint32_t h = 0; h < 3 * m->face_count; h++) {
            if (h % EDGES_A_POLL == 0 && qm_context_canceled(ctx)) return QM_E_CANCELED;
            if (!qm_trimesh_has_face(m, h / 3)) continue;
            uint32_t u = m->from[h], v = qm_trimesh_to(m, h), vertex;
            if (qm_vec_distance(m->position[u], m->position[v]) <= limit) continue;
            qm_vec middle = qm_vec_mix(m->position[u < v ? u : v], m->position[u < v ? v : u], 0.5);
            if (qm_trimesh_split(ctx, m, h, middle, &vertex) != QM_OK) return QM_E_NO_MEMORY;
        }
    }
    return QM_OK;
}

/** True if the faces of u stay as they lie, and edges short, when u moves to v along h. */
static bool keeps_shape(const qm_trimesh *m, uint32_t h, double longest)
{
    uint32_t u = m->from[h], twin = m->twin[h];
    qm_vec target = m->position[qm_trimesh_to(m, h)];
    uint32_t first = qm_trimesh_first(m, u), k = first;
    do {
        qm_vec b = m->position[qm_trimesh_to(m, k)], c = m->position[m->from[qm_trimesh_prev(k)]];
        if (k != h && qm_vec_distance(b, target) > longest) return false;
        if (k / 3 != h / 3 && (twin == QM_NO_INDEX || k / 3 != twin / 3)) {
            qm_vec before = qm_trimesh_normal(m, k / 3);
            qm_vec after = qm_vec_cross(qm_vec_sub(b, target), qm_vec_sub(c, target));
            if (!(qm_vec_dot(before, after) >= MIN_NORMAL_COSINE * qm_vec_norm(before) * qm_vec_norm(after)))
                return false;
            if (qm_vec_norm(after) < 1e-3 * qm_vec_norm2(qm_vec_sub(b, c))) return false;
        }
        k = qm_trimesh_around(m, k);
    } while (k != QM_NO_INDEX && k != first);
    return true;
}

static bool may_move(const qm_trimesh *m, uint32_t h)
{
    uint32_t line[2];
    int kind = qm_trimesh_kind(m, m->from[h], line);
    return kind == QM_TRIMESH_FREE || (kind == QM_TRIMESH_ON_LINE && m->is_feature[h]);
}

/** The first vertex goes, or the other one of the edge if it may not. */
static bool collapse_edge(qm_trimesh *m, uint32_t h, double longest)
{
    for (int side = 0; side < 2 && h != QM_NO_INDEX; side++) {
        if (may_move(m, h) && keeps_shape(m, h, longest) && qm_trimesh_can_collapse(m, h)) {
            qm_trimesh_collapse(m, h);
            return true;
        }
        h = m->twin[h];
    }
    return false;
}

/** Ends early when canceled. */
static size_t collapse_short(qm_context *ctx, qm_trimesh *m, double shortest, double longest)
{
    size_t count = 0;
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        if (h % EDGES_A_POLL == 0 && qm_context_canceled(ctx)) break;
        if (!qm_trimesh_has_face(m, h / 3)) continue;
        if (qm_vec_norm2(qm_trimesh_edge(m, h)) >= shortest * shortest) continue;
        count += collapse_edge(m, h, longest);
    }
    return count;
}

static void count_valences(const qm_trimesh *m, int *valence)
{
    for (size_t v = 0; v < m->vertex_count; v++)
        valence[v] = 0;
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        valence[m->from[h]]++;
        if (m->twin[h] == QM_NO_INDEX) valence[qm_trimesh_to(m, h)] += 3; /* an edge, and 4 count as 6 */
    }
}

static qm_vec face_normal_of(const qm_trimesh *m, uint32_t a, uint32_t b, uint32_t c)
{
    return qm_vec_cross(qm_vec_sub(m->position[b], m->position[a]),
                        qm_vec_sub(m->position[c], m->position[a]));
}

static bool is_flat(qm_vec a, qm_vec b)
{
    return qm_vec_dot(a, b) > FLAT_COSINE * qm_vec_norm(a) * qm_vec_norm(b);
}

static void flip_edges(qm_trimesh *m, int *valence)
{
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        uint32_t t = m->twin[h];
        if (t == QM_NO_INDEX || t < h || m->is_feature[h]) continue;
        uint32_t u = m->from[h], v = m->from[t], w = m->from[qm_trimesh_prev(h)],
                 x = m->from[qm_trimesh_prev(t)];
        int du = valence[u] - 6, dv = valence[v] - 6, dw = valence[w] - 6, dx = valence[x] - 6;
        if (-2 * du - 2 * dv + 2 * dw + 2 * dx + 4 >= 0) continue;
        qm_vec before = qm_trimesh_normal(m, h / 3), other = qm_trimesh_normal(m, t / 3);
        if (!is_flat(before, other)) continue;
        qm_vec sum = qm_vec_add(before, other);
        if (!is_flat(sum, face_normal_of(m, x, w, u)) || !is_flat(sum, face_normal_of(m, w, x, v))) continue;
        if (!qm_trimesh_can_flip(m, h)) continue;
        qm_trimesh_flip(m, h);
        valence[u]--, valence[v]--, valence[w]++, valence[x]++;
    }
}

static qm_vec centre_of_neighbours(const qm_trimesh *m, uint32_t v)
{
    qm_vec sum = {0, 0, 0};
    double count = 0.0;
    uint32_t first = qm_trimesh_first(m, v), h = first;
    do {
        sum = qm_vec_add(sum, m->position[qm_trimesh_to(m, h)]);
        count += 1.0;
        h = qm_trimesh_around(m, h);
    } while (h != QM_NO_INDEX && h != first);
    return qm_vec_scale(1.0 / count, sum);
}

/** False if the move turns a face over. */
static bool try_move(qm_trimesh *m, uint32_t v, qm_vec target)
{
    uint32_t first = qm_trimesh_first(m, v), h = first;
    do {
        qm_vec b = m->position[qm_trimesh_to(m, h)], c = m->position[m->from[qm_trimesh_prev(h)]];
        qm_vec before = qm_trimesh_normal(m, h / 3);
        qm_vec after = qm_vec_cross(qm_vec_sub(b, target), qm_vec_sub(c, target));
        if (!(qm_vec_dot(before, after) > 0.5 * qm_vec_norm(before) * qm_vec_norm(after))) return false;
        h = qm_trimesh_around(m, h);
    } while (h != QM_NO_INDEX && h != first);
    m->position[v] = target;
    return true;
}

static qm_status centre_vertices(qm_context *ctx, qm_trimesh *m, const qm_bvh *bvh, int thread_count)
{
    size_t count = m->vertex_count;
    double *target = qm_context_alloc(ctx, count, 3 * sizeof *target);
    double *nearest = qm_context_alloc(ctx, count, 3 * sizeof *nearest);
    qm_status status = target && nearest ? QM_OK : QM_E_NO_MEMORY;
    for (uint32_t v = 0; v < count && status == QM_OK; v++) {
        uint32_t line[2];
        qm_vec p = m->position[v];
        if (qm_trimesh_kind(m, v, line) == QM_TRIMESH_FREE) {
            qm_vec move = qm_vec_sub(centre_of_neighbours(m, v), p), normal = qm_trimesh_vertex_normal(m, v);
            p = qm_vec_add(p, qm_vec_axpy(move, -qm_vec_dot(move, normal), normal));
        }
        qm_vec_store(target + 3 * (size_t)v, p);
    }
    const qm_projection projection = {.position = nearest};
    if (status == QM_OK)
        status = qm_project_points(ctx, bvh, QM_QUADS_TRIANGLES, target, count, thread_count, &projection);
    for (uint32_t v = 0; v < count && status == QM_OK; v++) {
        uint32_t line[2];
        if (qm_trimesh_kind(m, v, line) == QM_TRIMESH_FREE)
            try_move(m, v, qm_vec_load(nearest + 3 * (size_t)v));
    }
    qm_context_free(ctx, target, count, 3 * sizeof *target);
    qm_context_free(ctx, nearest, count, 3 * sizeof *nearest);
    return status;
}

static qm_status turn_edges(qm_context *ctx, qm_trimesh *m)
{
    int *valence = qm_context_alloc(ctx, m->vertex_count, sizeof *valence);
    if (!valence) return QM_E_NO_MEMORY;
    count_valences(m, valence);
    flip_edges(m, valence);
    qm_context_free(ctx, valence, m->vertex_count, sizeof *valence);
    return QM_OK;
}

qm_status qm_quads_remesh(qm_context *ctx, qm_trimesh *m, const qm_bvh *bvh, double length, int thread_count)
{
    qm_status status = QM_OK;
    for (int round = 0; round < ROUNDS && status == QM_OK; round++) {
        status = split_long(ctx, m, LONG * length);
        for (int pass = 0; pass < MAX_PASSES && status == QM_OK; pass++) {
            if (collapse_short(ctx, m, SHORT * length, LONG * length) * 100 <= m->face_count) break;
            if (qm_context_canceled(ctx)) status = QM_E_CANCELED;
        }
        qm_trimesh_compact(m);
        if (status == QM_OK) status = turn_edges(ctx, m);
        if (status == QM_OK) status = centre_vertices(ctx, m, bvh, thread_count);
        if (status == QM_OK && qm_context_canceled(ctx)) status = QM_E_CANCELED;
    }
    return status;
}
