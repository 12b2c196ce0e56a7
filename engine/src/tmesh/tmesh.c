/**
 * tmesh.c: nodes, arcs and sides of the patches between cuts.
 */
#include "tmesh/tmesh.h"

#include <string.h>

#include "core/vec.h"

typedef struct tmesh_maker {
    const qm_tmesh_quads *quads;
    const qm_patch_set *set;
    qm_tmesh *out;
    uint32_t *node_of; /* by vertex */
    uint32_t *arc_of;  /* by edge: that it is the first or last of */
    bool *is_cut;      /* by edge: a side of a patch */
} tmesh_maker;

/** The number of edges of a side. */
static uint32_t side_edges(const qm_regular_patch *patch, int side)
{
    return side & 1 ? patch->rows : patch->columns;
}

/** The edge of a side after so many others, and the vertex at its end. */
static uint32_t side_edge(const tmesh_maker *maker, size_t patch, int side, uint32_t step, uint32_t *start,
                          uint32_t *end)
{
    const qm_regular_patch *at = &maker->set->patches[patch];
    uint32_t row, column;
    switch (side) {
    case 0:
        row = 0, column = step;
        break;
    case 1:
        row = step, column = at->columns - 1;
        break;
    case 2:
        row = at->rows - 1, column = at->columns - 1 - step;
        break;
    default:
        row = at->rows - 1 - step, column = 0;
        break;
    }
    size_t index = at->first + (size_t)row * at->columns + column;
    uint32_t face = maker->set->faces[index];
    unsigned from = qm_patch_corner(maker->set->turns[index], (unsigned)side),
             to = qm_patch_corner(maker->set->turns[index], ((unsigned)side + 1) & 3);
    *start = maker->quads->mesh.faces[4 * (size_t)face + from];
    *end = maker->quads->mesh.faces[4 * (size_t)face + to];
    unsigned face_side = ((from + 1) & 3) == to ? from : to;
    return maker->quads->side_edge[4 * (size_t)face + face_side];
}

static void mark_cuts(tmesh_maker *maker)
{
    for (size_t p = 0; p < maker->set->patch_count; p++)
        for (int side = 0; side < 4; side++)
            for (uint32_t i = 0; i < side_edges(&maker->set->patches[p], side); i++) {
                uint32_t start, end;
                maker->is_cut[side_edge(maker, p, side, i, &start, &end)] = true;
            }
}

static void number_nodes(tmesh_maker *maker, uint32_t *cut_degree)
{
    const qm_tmesh_quads *quads = maker->quads;
    for (size_t e = 0; e < quads->edge_count; e++)
        if (maker->is_cut[e])
            for (int i = 0; i < 2; i++)
                cut_degree[quads->edges[e].vertex[i]]++;
    for (size_t p = 0; p < maker->set->patch_count; p++)
        for (int side = 0; side < 4; side++) { /* a corner is a node, whatever meets there */
            uint32_t start, end;
            side_edge(maker, p, side, 0, &start, &end);
            cut_degree[start] += 3;
        }
    size_t count = 0;
    for (size_t v = 0; v < quads->mesh.vertex_count; v++) {
        bool is_node = cut_degree[v] > 2 || (cut_degree[v] > 0 && quads->is_required[v]);
        maker->node_of[v] = is_node ? (uint32_t)count : QM_NO_INDEX;
        if (is_node) maker->out->node_vertex[count++] = (uint32_t)v;
    }
    maker->out->node_count = count;
}

/** Adds a slot for a run of edges between two nodes. */
static void add_slot(tmesh_maker *maker, size_t patch, int side, const uint32_t run_edge[2],
                     const uint32_t run_vertex[2], uint32_t length, uint32_t begin)
{
    qm_tmesh *out = maker->out;
    uint32_t arc = maker->arc_of[run_edge[0]], slot = (uint32_t)out->slot_count++;
    if (arc == QM_NO_INDEX) {
        arc = (uint32_t)out->arc_count++;
        maker->arc_of[run_edge[0]] = maker->arc_of[run_edge[1]] = arc;
        out->arcs[arc] = (qm_tmesh_arc){maker->node_of[run_vertex[0]],
                                        maker->node_of[run_vertex[1]],
                                        length,
                                        run_edge[0],
                                        {slot, QM_NO_INDEX},
                                        maker->quads->edges[run_edge[0]].is_feature};
    } else {
        QM_ASSERT(out->arcs[arc].slot[1] == QM_NO_INDEX && out->arcs[arc].length == length);
        out->arcs[arc].slot[1] = slot;
    }
    const qm_tmesh_arc *at = &out->arcs[arc];
    bool forward = length > 1 ? at->first_edge == run_edge[0] : at->from == maker->node_of[run_vertex[0]];
    out->slots[slot] = (qm_tmesh_slot){arc, (uint32_t)patch, begin, (uint8_t)side, forward};
}

static void add_sides(tmesh_maker *maker, size_t p)
{
    const qm_regular_patch *patch = &maker->set->patches[p];
    qm_tmesh_patch *out = &maker->out->patches[p];
    out->rows = patch->rows;
    out->columns = patch->columns;
    for (int side = 0; side < 4; side++) {
        out->first[side] = (uint32_t)maker->out->slot_count;
        uint32_t run_edge[2] = {0, 0}, run_vertex[2] = {0, 0}, length = 0;
        for (uint32_t i = 0; i < side_edges(patch, side); i++) {
            uint32_t start, end, edge = side_edge(maker, p, side, i, &start, &end);
            if (length++ == 0) run_edge[0] = edge, run_vertex[0] = start;
            run_edge[1] = edge;
            run_vertex[1] = end;
            if (maker->node_of[end] == QM_NO_INDEX) continue;
            add_slot(maker, p, side, run_edge, run_vertex, length, i + 1 - length);
            length = 0;
        }
        QM_ASSERT(length == 0);
    }
    out->first[4] = (uint32_t)maker->out->slot_count;
}

qm_status qm_tmesh_make(qm_arena *arena, const qm_tmesh_quads *quads, const qm_patch_set *set, qm_tmesh *out)
{
    *out = (qm_tmesh){.patch_count = set->patch_count};
    tmesh_maker maker = {.quads = quads, .set = set, .out = out};
    size_t vertices = quads->mesh.vertex_count, side_sum = 0;
    for (size_t p = 0; p < set->patch_count; p++)
        side_sum += 2 * ((size_t)set->patches[p].rows + set->patches[p].columns);
    maker.node_of = qm_arena_alloc(arena, vertices, sizeof *maker.node_of);
    maker.arc_of = qm_arena_alloc(arena, quads->edge_count, sizeof *maker.arc_of);
    maker.is_cut = qm_arena_zeroed(arena, quads->edge_count, sizeof *maker.is_cut);
    uint32_t *cut_degree = qm_arena_zeroed(arena, vertices, sizeof *cut_degree);
    out->node_vertex = qm_arena_alloc(arena, vertices, sizeof *out->node_vertex);
    out->patches = qm_arena_alloc(arena, set->patch_count, sizeof *out->patches);
    out->slots = qm_arena_alloc(arena, side_sum, sizeof *out->slots);
    out->arcs = qm_arena_alloc(arena, side_sum, sizeof *out->arcs);
    if (!maker.node_of || !maker.arc_of || !maker.is_cut || !cut_degree || !out->node_vertex ||
        !out->patches || !out->slots || !out->arcs)
        return qm_context_fail(arena->ctx, QM_E_NO_MEMORY, "out of memory for the cuts of %zu quads",
                               quads->mesh.face_count);
    memset(maker.arc_of, 0xff, quads->edge_count * sizeof *maker.arc_of);
    mark_cuts(&maker);
    number_nodes(&maker, cut_degree);
    for (size_t p = 0; p < set->patch_count; p++)
        add_sides(&maker, p);
    return QM_OK;
}
