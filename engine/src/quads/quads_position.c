/**
 * quads_position.c: a grid at each vertex: where the corners of quads are to lie. A grid is told by its phase: the vertex's coordinates
 * on it, from the nearest corner, along the axes of the vertex's frame, which is that of the first face of its fan. Grids of
 * neighbours should have corners in common: along an edge the phase changes by its step (quads_map.c) and whole numbers.
 *
 * Phases are smoothed from coarse to fine. A node of a coarser level stands for one of the vertices that it has come from, and
 * its links for paths along edges.
 *
 * Source: W. Jakob, M. Tarini, D. Panozzo, O. Sorkine-Hornung, Instant field-aligned meshes, 2015, section 3.2; with steps in place
 * of vectors in space.
 */
#include "quads/quads_internal.h"

#include <string.h>

#define SWEEPS 12
#define HELD_WEIGHT 2.0 /* of a neighbour on a feature; others have 1 */
#define BOTH_AXES 3

/** The transition from one node to another: the step in the frame of the first, and quarter turns of pairs of the second's frame to the first's. */
typedef struct transition {
    float step[2];
    int turned;
} transition;

/** A graph with the transitions along its links. */
typedef struct phase_level {
    const qm_quads_graph *graph;
    transition *transition;
    double (*phase)[2];
    uint8_t *held; /* of each node: bit k for axis k: its phase is 0 */
    uint32_t (*children)
        [2]; /* of each node, of the finer level: the one that it stands for, and the other or QM_NO_INDEX */
} phase_level;

static transition join(transition a, transition b)
{
    double step[2] = {b.step[0], b.step[1]};
    qm_quads_turn_pair(step, a.turned);
    return (transition){{(float)(a.step[0] + step[0]), (float)(a.step[1] + step[1])}, a.turned + b.turned};
}

static transition reverse(transition a)
{
    double step[2] = {-a.step[0], -a.step[1]};
    qm_quads_turn_pair(step, -a.turned);
    return (transition){{(float)step[0], (float)step[1]}, -a.turned};
}

/** The transition between neighbours. */
static transition transition_between(const phase_level *l, uint32_t from, uint32_t to)
{
    uint32_t k = l->graph->start[from];
    while (l->graph->link[k] != to)
        k++;
    return l->transition[k];
}

/*
 * The finest level.
 */

/** Of each half-edge: quarter turns of pairs of its face's frame to that of its first vertex. */
static void find_fans(const qm_trimesh *m, const qm_quads_map *map, uint8_t *turned)
{
    for (uint32_t v = 0; v < m->vertex_count; v++) {
        uint32_t first = qm_trimesh_first(m, v), h = first;
        int quarters = 0;
        do {
            turned[h] = (uint8_t)(quarters & 3);
            h = qm_trimesh_around(m, h);
            if (h != QM_NO_INDEX) quarters += map->turned[h];
        } while (h != QM_NO_INDEX && h != first);
    }
}

static transition transition_along(const float step[2], double sign, int here, int there)
{
    double turned[2] = {sign * step[0], sign * step[1]};
    qm_quads_turn_pair(turned, here);
    return (transition){{(float)turned[0], (float)turned[1]}, here - there};
}

/** Notes that a phase of a vertex is 0 across a feature at it. */
static void hold(const qm_trimesh *m, const qm_quads_map *map, uint32_t feature, int turned, uint8_t *held)
{
    if (m->is_feature[feature])
        *held |= (uint8_t)(1 << ((1 - qm_quads_feature_axis(map, feature) + turned) & 1));
}

static void list_vertices(const qm_trimesh *m, const qm_quads_map *map, const uint8_t *turned,
                          qm_quads_graph *g, const phase_level *l)
{
    uint32_t links = 0;
    for (uint32_t v = 0; v < m->vertex_count; v++) {
        uint32_t first = qm_trimesh_first(m, v), h = first;
        double area = 0.0;
        g->start[v] = links;
        l->held[v] = m->is_fixed[v] ? BOTH_AXES : 0;
        do {
            uint32_t back = qm_trimesh_prev(h), next = qm_trimesh_next(h);
            area += qm_vec_norm(qm_trimesh_normal(m, h / 3));
            l->transition[links] = transition_along(map->step[h], 1.0, turned[h], turned[next]);
            g->link[links++] = m->from[next];
            if (m->twin[back] == QM_NO_INDEX) {
                l->transition[links] = transition_along(map->step[back], -1.0, turned[h], turned[back]);
                g->link[links++] = m->from[back];
            }
            hold(m, map, h, turned[h], &l->held[v]);
            hold(m, map, back, turned[h], &l->held[v]);
            h = qm_trimesh_around(m, h);
        } while (h != QM_NO_INDEX && h != first);
        g->weight[v] = area > 0.0 ? area : 1e-300;
        g->normal[v] = qm_trimesh_vertex_normal(m, v);
        if (qm_vec_norm2(g->normal[v]) == 0.0) g->normal[v] = (qm_vec){0, 0, 1};
    }
    g->start[m->vertex_count] = links;
}

/*
 * Coarser levels.
 */

static bool alloc_level(qm_context *ctx, size_t nodes, size_t links, phase_level *l)
{
    l->transition = qm_context_alloc(ctx, links + 1, sizeof *l->transition);
    l->phase = qm_context_alloc(ctx, nodes, sizeof *l->phase);
    l->held = qm_context_alloc(ctx, nodes, 1);
    l->children = qm_context_alloc(ctx, nodes, sizeof *l->children);
    return l->transition && l->phase && l->held && l->children;
}

static void free_level(qm_context *ctx, size_t nodes, size_t links, phase_level *l)
{
    qm_context_free(ctx, l->transition, links + 1, sizeof *l->transition);
    qm_context_free(ctx, l->phase, nodes, sizeof *l->phase);
    qm_context_free(ctx, l->held, nodes, 1);
    qm_context_free(ctx, l->children, nodes, sizeof *l->children);
}

/** A node stands for that of its children that is held along more axes. */
static void choose_children(const phase_level *fine, const phase_level *coarse)
{
    memset(coarse->children, 0xff, coarse->graph->count * sizeof *coarse->children);
    for (uint32_t i = 0; i < fine->graph->count; i++) {
        uint32_t *child = coarse->children[fine->graph->parent[i]];
        if (child[0] == QM_NO_INDEX) {
            child[0] = i;
        } else if (fine->held[i] == BOTH_AXES || !fine->held[child[0]]) {
            child[1] = child[0], child[0] = i;
        } else {
            child[1] = i;
        }
    }
    for (uint32_t p = 0; p < coarse->graph->count; p++)
        coarse->held[p] = fine->held[coarse->children[p][0]];
}

/** A transition between nodes of a coarser level, through a link of the finer one. */
static transition transition_through(const phase_level *fine, const phase_level *coarse, uint32_t from,
                                     uint32_t to)
{
    for (int side = 0; side < 2; side++) {
        uint32_t a = coarse->children[from][side];
        for (uint32_t k = fine->graph->start[a]; k < fine->graph->start[a + 1]; k++) {
            uint32_t b = fine->graph->link[k];
            if (fine->graph->parent[b] != to) continue;
            transition way = fine->transition[k];
            if (side == 1) way = join(transition_between(fine, coarse->children[from][0], a), way);
            if (b != coarse->children[to][0])
                way = join(way, reverse(transition_between(fine, coarse->children[to][0], b)));
            return way;
        }
    }
    QM_ASSERT(false); /* there would be no link */
    return (transition){{0, 0}, 0};
}

static void list_nodes(const phase_level *fine, const phase_level *coarse)
{
    choose_children(fine, coarse);
    for (uint32_t p = 0; p < coarse->graph->count; p++)
        for (uint32_t k = coarse->graph->start[p]; k < coarse->graph->start[p + 1]; k++)
            coarse->transition[k] = transition_through(fine, coarse, p, coarse->graph->link[k]);
}

/*
 * Smoothing.
 */

static void smooth(qm_context *ctx, const phase_level *l)
{
    const qm_quads_graph *g = l->graph;
    for (int sweep = 0; sweep < SWEEPS && !qm_context_canceled(ctx); sweep++)
        for (uint32_t i = 0; i < g->count; i++) {
            if (l->held[i] == BOTH_AXES) continue;
            double sum[2] = {l->phase[i][0], l->phase[i][1]}, weights = 0.0;
            for (uint32_t k = g->start[i]; k < g->start[i + 1]; k++) {
                uint32_t j = g->link[k];
                double own = l->held[j] ? HELD_WEIGHT : 1.0, other[2] = {l->phase[j][0], l->phase[j][1]};
                qm_quads_turn_pair(other, l->transition[k].turned);
                weights += own;
                for (int axis = 0; axis < 2; axis++) {
                    double away = other[axis] - (double)l->transition[k].step[axis] - sum[axis];
                    sum[axis] += (away - rint(away)) * own / weights;
                }
            }
            for (int axis = 0; axis < 2; axis++)
                if (!(l->held[i] >> axis & 1)) l->phase[i][axis] = sum[axis] - rint(sum[axis]);
        }
}

/** Phases of a level from those of the coarser one. */
static void refine(const phase_level *coarse, const phase_level *fine)
{
    for (uint32_t p = 0; p < coarse->graph->count; p++) {
        const uint32_t *child = coarse->children[p];
        memcpy(fine->phase[child[0]], coarse->phase[p], sizeof *coarse->phase);
        if (child[1] == QM_NO_INDEX) continue;
        transition way = transition_between(fine, child[0], child[1]);
        double phase[2] = {coarse->phase[p][0] + (double)way.step[0],
                           coarse->phase[p][1] + (double)way.step[1]};
        qm_quads_turn_pair(phase, -way.turned);
        for (int axis = 0; axis < 2; axis++)
            fine->phase[child[1]][axis] =
                fine->held[child[1]] >> axis & 1 ? 0.0 : phase[axis] - rint(phase[axis]);
    }
}

static void solve(qm_context *ctx, phase_level *level, int count)
{
    for (int k = 1; k < count; k++)
        list_nodes(&level[k - 1], &level[k]);
    memset(level[count - 1].phase, 0, level[count - 1].graph->count * sizeof *level->phase);
    smooth(ctx, &level[count - 1]);
    for (int k = count - 1; k > 0; k--) {
        refine(&level[k], &level[k - 1]);
        smooth(ctx, &level[k - 1]);
    }
}

qm_status qm_quads_find_phases(qm_context *ctx, const qm_trimesh *m, const qm_quads_map *map,
                               const qm_quads_phases *out)
{
    qm_quads_levels levels = {.count = 1};
    phase_level level[QM_QUADS_MAX_LEVELS] = {{0}};
    size_t links = 6 * m->face_count;
    bool has_memory = qm_quads_graph_alloc(ctx, &levels.graph[0], m->vertex_count, links) &&
                      alloc_level(ctx, m->vertex_count, links, &level[0]);
    qm_status status = has_memory ? QM_OK : QM_E_NO_MEMORY;
    if (status == QM_OK) {
        level[0].graph = &levels.graph[0];
        find_fans(m, map, out->turned);
        list_vertices(m, map, out->turned, &levels.graph[0], &level[0]);
        status = qm_quads_levels_build(ctx, &levels);
    }
    for (int k = 1; k < levels.count && status == QM_OK; k++) {
        const qm_quads_graph *g = level[k].graph = &levels.graph[k];
        if (!alloc_level(ctx, g->count, g->link_capacity, &level[k])) status = QM_E_NO_MEMORY;
    }
    if (status == QM_OK) {
        solve(ctx, level, levels.count);
        memcpy(out->phase, level[0].phase, m->vertex_count * sizeof *out->phase);
        if (qm_context_canceled(ctx)) status = QM_E_CANCELED;
    }
    free_level(ctx, m->vertex_count, links, &level[0]);
    for (int k = 1; k < levels.count; k++)
        free_level(ctx, levels.graph[k].count, levels.graph[k].link_capacity, &level[k]);
    qm_quads_levels_reset(ctx, &levels);
    return status;
}
