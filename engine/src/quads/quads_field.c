/**
 * quads_field.c: a cross in each face: the directions of the quads. Crosses are smoothed in space, not along the surface,
 * so that they turn with it where it bends.
 *
 * Source: W. Jakob, M. Tarini, D. Panozzo, O. Sorkine-Hornung, Instant field-aligned meshes, 2015, section 3.1.
 */
#include "quads/quads_internal.h"

#include <string.h>

#define SWEEPS 8 /* of each level */
#define FINEST_SWEEPS 6
#define LAST_SWEEPS 4 /* after singular vertices are cancelled */
#define NORMAL_SWEEPS                                                                                        \
    12 /* of the normals: crosses turn with the surface, not with what is finer than a few quads */

qm_quads_match qm_quads_match_crosses(qm_vec qa, qm_vec na, qm_vec qb, qm_vec nb)
{
    const qm_vec a[2] = {qa, qm_vec_cross(na, qa)}, b[2] = {qb, qm_vec_cross(nb, qb)};
    double best = -1.0;
    int best_a = 0, best_b = 0;
    for (int i = 0; i < 2; i++) {
        for (int j = 0; j < 2; j++) {
            double score = fabs(qm_vec_dot(a[i], b[j]));
            if (score > best + 1e-12) best = score, best_a = i, best_b = j;
        }
    }
    double sign = qm_vec_dot(a[best_a], b[best_b]) < 0.0 ? -1.0 : 1.0;
    return (qm_quads_match){a[best_a], qm_vec_scale(sign, b[best_b])};
}

/** The part of q in the plane of n, with length 1; a fixed direction if there is none. */
static qm_vec into_plane(qm_vec q, qm_vec n)
{
    qm_vec flat = qm_vec_axpy(q, -qm_vec_dot(q, n), n);
    double length = qm_vec_norm(flat);
    if (length > 1e-6) return qm_vec_scale(1.0 / length, flat);
    qm_vec axis = fabs(n.x) < 0.6 ? (qm_vec){1, 0, 0} : (qm_vec){0, 1, 0};
    flat = qm_vec_axpy(axis, -qm_vec_dot(axis, n), n);
    return qm_vec_scale(1.0 / qm_vec_norm(flat), flat);
}

static void smooth(qm_context *ctx, const qm_quads_graph *g, const uint8_t *is_set, qm_vec *cross, int sweeps)
{
    for (int sweep = 0; sweep < sweeps && !qm_context_canceled(ctx); sweep++) {
        for (uint32_t i = 0; i < g->count; i++) {
            if (is_set[i]) continue;
            qm_vec n = g->normal[i], sum = cross[i];
            double weight = 0.0;
            for (uint32_t k = g->start[i]; k < g->start[i + 1]; k++) {
                uint32_t j = g->link[k];
                qm_quads_match match = qm_quads_match_crosses(sum, n, cross[j], g->normal[j]);
                sum = qm_vec_add(qm_vec_scale(weight, match.a), match.b);
                weight += 1.0;
                sum = into_plane(sum, n);
            }
            cross[i] = sum;
        }
    }
}

/** From fine to coarse: a node follows a feature if one of its children does. */
static void restrict_features(const qm_quads_graph *fine, const qm_quads_graph *coarse, const uint8_t *is_set,
                              const qm_vec *cross, uint8_t *coarse_set, qm_vec *coarse_cross)
{
    memset(coarse_set, 0, coarse->count);
    for (uint32_t i = 0; i < fine->count; i++) {
        uint32_t p = fine->parent[i];
        if (!is_set[i]) continue;
        qm_vec q = cross[i];
        if (coarse_set[p]) {
            qm_quads_match match =
                qm_quads_match_crosses(coarse_cross[p], coarse->normal[p], q, fine->normal[i]);
            q = qm_vec_add(match.a, match.b);
        }
        coarse_cross[p] = into_plane(q, coarse->normal[p]);
        coarse_set[p] = true;
    }
}

static bool build_graph(qm_context *ctx, const qm_trimesh *m, qm_quads_graph *g, uint8_t *is_set,
                        qm_vec *cross)
{
    size_t count = m->face_count;
    if (!qm_quads_graph_alloc(ctx, g, count, 3 * count)) return false;
    uint32_t links = 0;
    for (uint32_t f = 0; f < count; f++) {
        qm_vec normal = qm_trimesh_normal(m, f);
        double area = qm_vec_norm(normal);
        g->normal[f] = area > 0.0 ? qm_vec_scale(1.0 / area, normal) : (qm_vec){0, 0, 1};
        g->weight[f] = area > 0.0 ? area : 1e-300;
        g->start[f] = links;
        is_set[f] = false;
        for (uint32_t h = 3 * f; h < 3 * f + 3; h++) {
            if (m->is_feature[h]) {
                is_set[f] = true;
                cross[f] = into_plane(qm_trimesh_edge(m, h), g->normal[f]);
            } else {
                g->link[links++] = m->twin[h] / 3;
            }
        }
    }
    g->start[count] = links;
    return true;
}

/** Normals become the means of their neighbours; what follows features turns with them. */
static bool smooth_normals(qm_context *ctx, qm_quads_graph *g, const uint8_t *is_set, qm_vec *cross)
{
    qm_vec *mean = qm_context_alloc(ctx, g->count, sizeof *mean);
    if (!mean) return false;
    for (int sweep = 0; sweep < NORMAL_SWEEPS; sweep++) {
        for (size_t i = 0; i < g->count; i++) {
            qm_vec sum = qm_vec_scale(2.0, g->normal[i]);
            for (uint32_t k = g->start[i]; k < g->start[i + 1]; k++)
                sum = qm_vec_add(sum, g->normal[g->link[k]]);
            double length = qm_vec_norm(sum);
            mean[i] = length > 1e-3 ? qm_vec_scale(1.0 / length, sum) : g->normal[i];
        }
        memcpy(g->normal, mean, g->count * sizeof *mean);
    }
    for (size_t i = 0; i < g->count; i++)
        if (is_set[i]) cross[i] = into_plane(cross[i], g->normal[i]);
    qm_context_free(ctx, mean, g->count, sizeof *mean);
    return true;
}

/** The arrays of all levels lie one after the other. */
static void solve(qm_context *ctx, const qm_quads_levels *levels, const size_t *offset, uint8_t *is_set,
                  qm_vec *cross)
{
    int top = levels->count - 1;
    for (int k = 0; k < top; k++)
        restrict_features(&levels->graph[k], &levels->graph[k + 1], is_set + offset[k], cross + offset[k],
                          is_set + offset[k + 1], cross + offset[k + 1]);
    const qm_quads_graph *g = &levels->graph[top];
    for (uint32_t i = 0; i < g->count; i++)
        if (!is_set[offset[top] + i]) cross[offset[top] + i] = into_plane((qm_vec){1, 0, 0}, g->normal[i]);
    for (int k = top; k >= 0; k--) {
        g = &levels->graph[k];
        if (k < top)
            for (uint32_t i = 0; i < g->count; i++)
                if (!is_set[offset[k] + i])
                    cross[offset[k] + i] = into_plane(cross[offset[k + 1] + g->parent[i]], g->normal[i]);
        smooth(ctx, g, is_set + offset[k], cross + offset[k], k == 0 ? FINEST_SWEEPS : SWEEPS);
    }
}

/** Crosses in the planes of their faces. */
static void lay_into_faces(const qm_trimesh *m, const qm_vec *from, qm_vec *cross)
{
    for (uint32_t f = 0; f < m->face_count; f++) {
        qm_vec normal = qm_trimesh_normal(m, f);
        double area = qm_vec_norm(normal);
        cross[f] = area > 0.0 ? into_plane(from[f], qm_vec_scale(1.0 / area, normal)) : from[f];
    }
}

qm_status qm_quads_find_crosses(qm_context *ctx, const qm_trimesh *m, bool cancels, qm_vec *cross)
{
    qm_quads_levels levels = {.count = 1};
    size_t total = 0, offset[QM_QUADS_MAX_LEVELS + 1];
    uint8_t *first_set = qm_context_alloc(ctx, m->face_count, sizeof *first_set);
    bool has_memory = first_set && build_graph(ctx, m, &levels.graph[0], first_set, cross) &&
                      smooth_normals(ctx, &levels.graph[0], first_set, cross);
    qm_status status = has_memory ? qm_quads_levels_build(ctx, &levels) : QM_E_NO_MEMORY;
    for (int k = 0; k < levels.count; k++) {
        offset[k] = total;
        total += levels.graph[k].count;
    }
    if (status == QM_OK) {
        uint8_t *is_set = qm_context_alloc(ctx, total, sizeof *is_set);
        qm_vec *all = qm_context_alloc(ctx, total, sizeof *all);
        if (is_set && all) {
            memcpy(is_set, first_set, m->face_count);
            memcpy(all, cross, m->face_count * sizeof *all);
            solve(ctx, &levels, offset, is_set, all);
            if (cancels) status = qm_quads_cancel_pairs(ctx, m, levels.graph[0].normal, is_set, all);
            if (cancels && status == QM_OK) smooth(ctx, &levels.graph[0], is_set, all, LAST_SWEEPS);
            if (qm_context_canceled(ctx)) status = QM_E_CANCELED;
            lay_into_faces(m, all, cross);
        } else {
            status = QM_E_NO_MEMORY;
        }
        qm_context_free(ctx, is_set, total, sizeof *is_set);
        qm_context_free(ctx, all, total, sizeof *all);
    }
    qm_context_free(ctx, first_set, m->face_count, sizeof *first_set);
    qm_quads_levels_reset(ctx, &levels);
    return status;
}
