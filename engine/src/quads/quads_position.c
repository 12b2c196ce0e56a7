/**
 * quads_position.c: a grid at each vertex: where the corners of quads are to lie. A grid is a point of it, its origin, and the
 * cross; those of neighbours should have corners in common.
 *
 * Source: W. Jakob, M. Tarini, D. Panozzo, O. Sorkine-Hornung, Instant field-aligned meshes, 2015, section 3.2.
 */
#include "quads/quads_internal.h"

#include <string.h>

#define SWEEPS 12

/** Of a level: what a node is fitted to. */
typedef struct grid_nodes {
    const qm_quads_graph *graph;
    qm_vec *position, *cross, *origin;
    qm_vec *anchor; /* of nodes with a kind: the grid has a line, or a corner, there */
    uint8_t *kind;  /* QM_TRIMESH_FREE ... */
} grid_nodes;

/** The corner of a grid that is nearest to a point. */
static qm_vec nearest_corner(qm_vec origin, qm_vec q, qm_vec n, qm_vec p, double size)
{
    qm_vec other = qm_vec_cross(n, q), d = qm_vec_sub(p, origin);
    double a = rint(qm_vec_dot(d, q) / size), b = rint(qm_vec_dot(d, other) / size);
    return qm_vec_axpy(qm_vec_axpy(origin, a * size, q), b * size, other);
}

/** The corners of the cell of a grid that a point lies in. */
static void cell_corners(qm_vec origin, qm_vec q, qm_vec n, qm_vec p, double size, qm_vec out[4])
{
    qm_vec other = qm_vec_cross(n, q), d = qm_vec_sub(p, origin);
    double a = floor(qm_vec_dot(d, q) / size), b = floor(qm_vec_dot(d, other) / size);
    for (int k = 0; k < 4; k++)
        out[k] = qm_vec_axpy(qm_vec_axpy(origin, (a + (k & 1)) * size, q), (b + (k >> 1)) * size, other);
}

static qm_vec hold(const grid_nodes *l, uint32_t i, qm_vec origin)
{
    if (l->kind[i] == QM_TRIMESH_FREE) {
        qm_vec n = l->graph->normal[i];
        return qm_vec_axpy(origin, -qm_vec_dot(n, qm_vec_sub(origin, l->position[i])), n);
    }
    qm_vec anchor = l->anchor[i];
    if (l->kind[i] == QM_TRIMESH_CORNER) return anchor;
    qm_vec q = l->cross[i];
    return qm_vec_axpy(anchor, qm_vec_dot(q, qm_vec_sub(origin, anchor)), q);
}

static void smooth(qm_context *ctx, const grid_nodes *l, double size)
{
    const qm_quads_graph *g = l->graph;
    for (int sweep = 0; sweep < SWEEPS && !qm_context_canceled(ctx); sweep++) {
        for (uint32_t i = 0; i < g->count; i++) {
            if (l->kind[i] == QM_TRIMESH_CORNER) continue;
            qm_vec sum = l->origin[i], p = l->position[i], q = l->cross[i], n = g->normal[i];
            double weight = 0.0;
            for (uint32_t k = g->start[i]; k < g->start[i + 1]; k++) {
                uint32_t j = g->link[k];
                qm_vec middle = qm_vec_mix(p, l->position[j], 0.5), a[4], own = sum, other = sum;
                cell_corners(sum, q, n, middle, size, a);
                double least = INFINITY;
                for (int c = 0; c < 4; c++) {
                    qm_vec b = nearest_corner(l->origin[j], l->cross[j], g->normal[j], a[c], size);
                    double d = qm_vec_norm2(qm_vec_sub(a[c], b));
                    if (d < least) least = d, own = a[c], other = b;
                }
                double link_weight = l->kind[j] == QM_TRIMESH_FREE ? 1.0 : 2.0;
                sum = qm_vec_mix(own, other, link_weight / (weight + link_weight));
                weight += link_weight;
                sum = hold(l, i, sum);
            }
            if (weight > 0.0) l->origin[i] = hold(l, i, nearest_corner(sum, q, n, p, size));
        }
    }
}

/** A coarse node lies at the mean of its children; directions and anchors are those of the child that is most bound. */
static void restrict_nodes(const grid_nodes *fine, const grid_nodes *coarse)
{
    const qm_quads_graph *g = fine->graph;
    size_t count = coarse->graph->count;
    memset(coarse->position, 0, count * sizeof *coarse->position);
    memset(coarse->cross, 0, count * sizeof *coarse->cross);
    memset(coarse->kind, 0, count);
    for (uint32_t i = 0; i < g->count; i++) {
        uint32_t p = g->parent[i];
        qm_vec n = coarse->graph->normal[p];
        coarse->position[p] =
            qm_vec_axpy(coarse->position[p], g->weight[i] / coarse->graph->weight[p], fine->position[i]);
        bool is_first = qm_vec_norm2(coarse->cross[p]) == 0.0;
        if (!is_first && fine->kind[i] <= coarse->kind[p]) continue;
        qm_vec q = qm_vec_axpy(fine->cross[i], -qm_vec_dot(n, fine->cross[i]), n);
        double length = qm_vec_norm(q);
        if (length < 1e-6) continue;
        coarse->cross[p] = qm_vec_scale(1.0 / length, q);
        coarse->kind[p] = fine->kind[i];
        coarse->anchor[p] = fine->anchor[i];
    }
    for (uint32_t p = 0; p < count; p++) {
        if (qm_vec_norm2(coarse->cross[p]) > 0.0) continue;
        qm_vec q = qm_vec_perpendicular(coarse->graph->normal[p]);
        coarse->cross[p] = qm_vec_scale(1.0 / qm_vec_norm(q), q);
    }
}

static bool build_graph(qm_context *ctx, const qm_trimesh *m, qm_quads_graph *g)
{
    size_t count = m->vertex_count;
    if (!qm_quads_graph_alloc(ctx, g, count, 6 * m->face_count)) return false;
    uint32_t links = 0;
    for (uint32_t v = 0; v < count; v++) {
        uint32_t first = qm_trimesh_first(m, v), h = first;
        g->start[v] = links;
        double area = 0.0;
        do {
            area += qm_vec_norm(qm_trimesh_normal(m, h / 3));
            g->link[links++] = qm_trimesh_to(m, h);
            uint32_t back = qm_trimesh_prev(h);
            if (m->twin[back] == QM_NO_INDEX) g->link[links++] = m->from[back];
            h = qm_trimesh_around(m, h);
        } while (h != QM_NO_INDEX && h != first);
        g->weight[v] = area > 0.0 ? area : 1e-300;
        g->normal[v] = qm_trimesh_vertex_normal(m, v);
        if (qm_vec_norm2(g->normal[v]) == 0.0) g->normal[v] = (qm_vec){0, 0, 1};
    }
    g->start[count] = links;
    return true;
}

/** Directions at vertices: along a feature, or the mean of the faces' crosses. */
static void spread_crosses(const qm_trimesh *m, const qm_vec *face_cross, const qm_quads_graph *g,
                           const grid_nodes *l)
{
    for (uint32_t v = 0; v < m->vertex_count; v++) {
        uint32_t line[2];
        int kind = qm_trimesh_kind(m, v, line);
        qm_vec n = g->normal[v], sum = {0, 0, 0};
        if (kind == QM_TRIMESH_ON_LINE) {
            sum = qm_vec_sub(m->position[line[1]], m->position[line[0]]);
        } else {
            uint32_t first = qm_trimesh_first(m, v), h = first;
            do {
                qm_vec normal = qm_trimesh_normal(m, h / 3);
                double length = qm_vec_norm(normal);
                if (length > 0.0) {
                    qm_vec q = face_cross[h / 3];
                    if (qm_vec_norm2(sum) == 0.0) {
                        sum = q;
                    } else {
                        qm_vec unit = qm_vec_scale(1.0 / qm_vec_norm(sum), sum);
                        qm_quads_match match =
                            qm_quads_match_crosses(unit, n, q, qm_vec_scale(1.0 / length, normal));
                        sum = qm_vec_axpy(match.b, qm_vec_norm(sum), match.a);
                    }
                    sum = qm_vec_axpy(sum, -qm_vec_dot(n, sum), n);
                }
                h = qm_trimesh_around(m, h);
            } while (h != QM_NO_INDEX && h != first);
        }
        sum = qm_vec_axpy(sum, -qm_vec_dot(n, sum), n);
        double length = qm_vec_norm(sum);
        if (!(length > 0.0)) {
            sum = qm_vec_perpendicular(n);
            length = qm_vec_norm(sum);
        }
        l->cross[v] = qm_vec_scale(1.0 / length, sum);
        l->kind[v] = (uint8_t)kind;
        l->position[v] = l->anchor[v] = m->position[v];
    }
}

static void solve(qm_context *ctx, const qm_quads_levels *levels, grid_nodes *nodes, double size)
{
    int top = levels->count - 1;
    for (int k = 0; k < top; k++)
        restrict_nodes(&nodes[k], &nodes[k + 1]);
    for (uint32_t i = 0; i < levels->graph[top].count; i++)
        nodes[top].origin[i] = nodes[top].position[i];
    for (int k = top; k >= 0; k--) {
        const grid_nodes *l = &nodes[k];
        for (uint32_t i = 0; i < l->graph->count; i++) {
            qm_vec origin = k < top ? nodes[k + 1].origin[l->graph->parent[i]] : l->position[i];
            qm_vec n = l->graph->normal[i];
            origin = qm_vec_axpy(origin, -qm_vec_dot(n, qm_vec_sub(origin, l->position[i])), n);
            l->origin[i] = hold(l, i, nearest_corner(origin, l->cross[i], n, l->position[i], size));
        }
        smooth(ctx, l, size);
    }
}

qm_status qm_quads_find_grids(qm_context *ctx, const qm_trimesh *m, const qm_vec *cross, double size,
                              qm_quads_grids *out)
{
    qm_quads_levels levels = {.count = 1};
    grid_nodes nodes[QM_QUADS_MAX_LEVELS] = {{0}};
    qm_status status =
        build_graph(ctx, m, &levels.graph[0]) ? qm_quads_levels_build(ctx, &levels) : QM_E_NO_MEMORY;
    size_t total = 0;
    for (int k = 0; k < levels.count; k++)
        total += levels.graph[k].count;
    qm_vec *vectors = qm_context_alloc(ctx, 4 * total, sizeof *vectors);
    uint8_t *kind = qm_context_alloc(ctx, total, sizeof *kind);
    if (status == QM_OK && !(vectors && kind)) status = QM_E_NO_MEMORY;
    if (status == QM_OK) {
        size_t done = 0;
        for (int k = 0; k < levels.count; k++) {
            qm_vec *v = vectors + done;
            nodes[k] =
                (grid_nodes){&levels.graph[k], v, v + total, v + 2 * total, v + 3 * total, kind + done};
            done += levels.graph[k].count;
        }
        spread_crosses(m, cross, &levels.graph[0], &nodes[0]);
        solve(ctx, &levels, nodes, size);
        if (qm_context_canceled(ctx)) status = QM_E_CANCELED;
        size_t bytes = m->vertex_count * sizeof(qm_vec);
        memcpy(out->normal, levels.graph[0].normal, bytes);
        memcpy(out->cross, nodes[0].cross, bytes);
        memcpy(out->origin, nodes[0].origin, bytes);
    }
    qm_context_free(ctx, vectors, 4 * total, sizeof *vectors);
    qm_context_free(ctx, kind, total, sizeof *kind);
    qm_quads_levels_reset(ctx, &levels);
    return status;
}
