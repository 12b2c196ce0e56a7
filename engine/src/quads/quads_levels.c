/**
 * quads_levels.c: a graph and its coarser versions.
 */
#include "quads/quads_internal.h"

#include <string.h>

#define COARSEST 12 /* nodes: a graph that small is not made coarser */

bool qm_quads_graph_alloc(qm_context *ctx, qm_quads_graph *g, size_t count, size_t links)
{
    *g = (qm_quads_graph){.count = count, .link_capacity = links};
    g->normal = qm_context_alloc(ctx, count, sizeof *g->normal);
    g->weight = qm_context_alloc(ctx, count, sizeof *g->weight);
    g->start = qm_context_alloc(ctx, count + 1, sizeof *g->start);
    g->link = qm_context_alloc(ctx, links + 1, sizeof *g->link);
    return g->normal && g->weight && g->start && g->link;
}

static void reset_graph(qm_context *ctx, qm_quads_graph *g)
{
    qm_context_free(ctx, g->normal, g->count, sizeof *g->normal);
    qm_context_free(ctx, g->weight, g->count, sizeof *g->weight);
    qm_context_free(ctx, g->start, g->count + 1, sizeof *g->start);
    qm_context_free(ctx, g->link, g->link_capacity + 1, sizeof *g->link);
    qm_context_free(ctx, g->parent, g->count, sizeof *g->parent);
    *g = (qm_quads_graph){0};
}

void qm_quads_levels_reset(qm_context *ctx, qm_quads_levels *levels)
{
    for (int k = 0; k < levels->count; k++)
        reset_graph(ctx, &levels->graph[k]);
    levels->count = 0;
}

/** Numbers the nodes of the coarser level; returns their count. */
static size_t match_neighbours(qm_quads_graph *g)
{
    size_t count = 0;
    for (size_t i = 0; i < g->count; i++)
        g->parent[i] = QM_NO_INDEX;
    for (uint32_t i = 0; i < g->count; i++) {
        if (g->parent[i] != QM_NO_INDEX) continue;
        uint32_t best = QM_NO_INDEX;
        double best_score = -2.0;
        for (uint32_t k = g->start[i]; k < g->start[i + 1]; k++) {
            uint32_t j = g->link[k];
            if (j == i || g->parent[j] != QM_NO_INDEX) continue;
            /* small ones first: nodes of a level should be of one size */
            double lighter = qm_min(g->weight[i], g->weight[j]) / qm_max(g->weight[i], g->weight[j]);
            double score = qm_vec_dot(g->normal[i], g->normal[j]) + 0.25 * lighter;
            if (score > best_score) best = j, best_score = score;
        }
        g->parent[i] = (uint32_t)count;
        if (best != QM_NO_INDEX) g->parent[best] = (uint32_t)count;
        count++;
    }
    return count;
}

/** The links of the coarser graph, each once; children lists its nodes' children in order. */
static void join_links(const qm_quads_graph *fine, qm_quads_graph *coarse, const uint32_t (*child)[2],
                       uint32_t *seen)
{
    uint32_t links = 0;
    for (size_t i = 0; i < coarse->count; i++)
        seen[i] = QM_NO_INDEX;
    for (uint32_t i = 0; i < coarse->count; i++) {
        coarse->start[i] = links;
        seen[i] = i;
        for (int side = 0; side < 2 && child[i][side] != QM_NO_INDEX; side++) {
            uint32_t c = child[i][side];
            for (uint32_t k = fine->start[c]; k < fine->start[c + 1]; k++) {
                uint32_t j = fine->parent[fine->link[k]];
                if (seen[j] == i) continue;
                seen[j] = i;
                coarse->link[links++] = j;
            }
        }
    }
    coarse->start[coarse->count] = links;
}

static bool coarsen(qm_context *ctx, qm_quads_graph *fine, qm_quads_graph *coarse)
{
    fine->parent = qm_context_alloc(ctx, fine->count, sizeof *fine->parent);
    if (!fine->parent) return false;
    size_t count = match_neighbours(fine);
    uint32_t(*child)[2] = qm_context_alloc(ctx, count, sizeof *child);
    uint32_t *seen = qm_context_alloc(ctx, count, sizeof *seen);
    bool has_memory = qm_quads_graph_alloc(ctx, coarse, count, fine->start[fine->count]) && child && seen;
    if (has_memory) {
        memset(child, 0xff, count * sizeof *child);
        memset(coarse->weight, 0, count * sizeof *coarse->weight);
        memset(coarse->normal, 0, count * sizeof *coarse->normal);
        for (uint32_t i = 0; i < fine->count; i++) {
            uint32_t p = fine->parent[i];
            child[p][child[p][0] != QM_NO_INDEX] = i;
            coarse->weight[p] += fine->weight[i];
            coarse->normal[p] = qm_vec_axpy(coarse->normal[p], fine->weight[i], fine->normal[i]);
        }
        for (uint32_t i = 0; i < count; i++) {
            double length = qm_vec_norm(coarse->normal[i]);
            coarse->normal[i] = length > 1e-9 * coarse->weight[i]
                                    ? qm_vec_scale(1.0 / length, coarse->normal[i])
                                    : fine->normal[child[i][0]];
        }
        join_links(fine, coarse, (const uint32_t(*)[2])child, seen);
    }
    qm_context_free(ctx, child, count, sizeof *child);
    qm_context_free(ctx, seen, count, sizeof *seen);
    return has_memory;
}

qm_status qm_quads_levels_build(qm_context *ctx, qm_quads_levels *levels)
{
    QM_ASSERT(levels->count == 1);
    while (levels->count < QM_QUADS_MAX_LEVELS) {
        qm_quads_graph *fine = &levels->graph[levels->count - 1];
        if (fine->count <= COARSEST) break;
        bool has_memory = coarsen(ctx, fine, &levels->graph[levels->count]);
        levels->count++;
        if (!has_memory) return QM_E_NO_MEMORY;
        if (qm_context_canceled(ctx)) return QM_E_CANCELED;
        if (levels->graph[levels->count - 1].count > 0.95 * (double)fine->count) break; /* unlinked nodes */
    }
    return QM_OK;
}
