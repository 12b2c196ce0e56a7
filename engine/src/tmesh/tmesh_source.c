/**
 * tmesh_source.c: the quads as what a drawing starts from.
 *
 * Near a thin wall or in a narrow gap the nearest point of the surface may be on another wall. So each point has the normal of
 * its quads, turned as the surface is: by the sides of most of a component's quads.
 */
#include <math.h>
#include <string.h>

#include "tmesh/tmesh.h"

#define LEAST_AGREEMENT 0.6 /* of the mean sign: below it the surface, or the quads, are not oriented */

typedef struct source_maker {
    qm_arena *arena;
    const qm_tmesh_quads *quads;
    const qm_ref_surface *surface;
    int8_t *sign; /* by face: of its normal, 0: not reached */
    uint32_t *queue;
} source_maker;

static qm_vec corner(const source_maker *maker, size_t face, int k)
{
    return qm_vec_load(maker->quads->mesh.positions +
                       3 * (size_t)maker->quads->mesh.faces[4 * face + (size_t)k]);
}

/** Twice the area of a quad, along its normal. */
static qm_vec face_normal(const source_maker *maker, size_t face)
{
    qm_vec one = qm_vec_sub(corner(maker, face, 2), corner(maker, face, 0)),
           other = qm_vec_sub(corner(maker, face, 3), corner(maker, face, 1));
    return qm_vec_cross(one, other);
}

/** True when a face runs along an edge from its lower vertex. */
static bool runs_up(const source_maker *maker, uint32_t face, uint32_t edge)
{
    const qm_tmesh_quads *quads = maker->quads;
    for (size_t k = 0; k < 4; k++)
        if (quads->side_edge[4 * (size_t)face + k] == edge)
            return quads->mesh.faces[4 * (size_t)face + k] == quads->edges[edge].vertex[0];
    return false;
}

/** Turns the faces that edges connect alike, from one on. Returns their number in the queue, or 0 when they have one side only. */
static size_t turn_alike(source_maker *maker, uint32_t first)
{
    size_t head = 0, tail = 0;
    bool has_sides = true;
    maker->sign[first] = 1;
    maker->queue[tail++] = first;
    while (head < tail) {
        uint32_t face = maker->queue[head++];
        for (size_t k = 0; k < 4; k++) {
            uint32_t edge = maker->quads->side_edge[4 * (size_t)face + k];
            const uint32_t *pair = maker->quads->edges[edge].face;
            uint32_t next = pair[0] == face ? pair[1] : pair[0];
            if (next == QM_NO_INDEX) continue;
            bool is_alike = runs_up(maker, face, edge) != runs_up(maker, next, edge);
            int8_t sign = is_alike ? maker->sign[face] : (int8_t)-maker->sign[face];
            if (maker->sign[next] == 0) {
                maker->sign[next] = sign;
                maker->queue[tail++] = next;
            }
            has_sides &= maker->sign[next] == sign;
        }
    }
    return has_sides ? tail : 0;
}

/** Turns a component as most of its faces lie on the surface. False when there is no telling. */
static bool turn_to_surface(source_maker *maker, size_t count)
{
    double sum = 0, total = 0;
    for (size_t i = 0; i < count; i++) {
        uint32_t face = maker->queue[i];
        qm_vec ring[4];
        for (int k = 0; k < 4; k++)
            ring[k] = corner(maker, face, k);
        double at[3];
        qm_vec_store(at, qm_vec_centroid(ring, 4));
        qm_ref_surface_point on;
        qm_ref_surface_project(maker->surface, at, &on);
        double along = maker->sign[face] * qm_vec_dot(face_normal(maker, face), qm_vec_load(on.normal));
        sum += along;
        total += fabs(along);
    }
    for (size_t i = 0; i < count && sum < 0; i++)
        maker->sign[maker->queue[i]] = (int8_t)-maker->sign[maker->queue[i]];
    return fabs(sum) >= LEAST_AGREEMENT * total;
}

static bool find_normals(source_maker *maker, qm_tmesh_source *out)
{
    const qm_mesh *mesh = &maker->quads->mesh;
    maker->sign = qm_arena_zeroed(maker->arena, mesh->face_count, sizeof *maker->sign);
    maker->queue = qm_arena_alloc(maker->arena, mesh->face_count, sizeof *maker->queue);
    if (!maker->sign || !maker->queue) return false;
    out->is_oriented = !maker->surface->is_cloud;
    for (uint32_t f = 0; f < mesh->face_count && out->is_oriented; f++) {
        if (maker->sign[f] != 0) continue;
        size_t count = turn_alike(maker, f);
        out->is_oriented = count > 0 && turn_to_surface(maker, count);
    }
    for (size_t f = 0; f < mesh->face_count && out->is_oriented; f++) {
        qm_vec normal = qm_vec_scale(maker->sign[f], face_normal(maker, f));
        for (size_t k = 0; k < 4; k++) {
            qm_vec *at = &out->normal[mesh->faces[4 * f + k]];
            *at = qm_vec_add(*at, normal);
        }
    }
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        double length = qm_vec_norm(out->normal[v]);
        if (length > 0) out->normal[v] = qm_vec_scale(1 / length, out->normal[v]);
    }
    return true;
}

uint32_t qm_tmesh_arc_vertex(const qm_tmesh_quads *quads, const qm_patch_set *set, const qm_tmesh *tmesh,
                             uint32_t arc, uint32_t i)
{
    const qm_tmesh_slot *slot = &tmesh->slots[tmesh->arcs[arc].slot[0]];
    const qm_tmesh_patch *patch = &tmesh->patches[slot->patch];
    uint32_t at = slot->start + (slot->forward ? i : tmesh->arcs[arc].length - i), row, column;
    switch (slot->side) {
    case 0:
        row = 0, column = at;
        break;
    case 1:
        row = at, column = patch->columns;
        break;
    case 2:
        row = patch->rows, column = patch->columns - at;
        break;
    default:
        row = patch->rows - at, column = 0;
        break;
    }
    return qm_patch_vertex(set, &quads->mesh, slot->patch, row, column);
}

static bool copy_arcs(const source_maker *maker, const qm_patch_set *set, const qm_tmesh *tmesh,
                      qm_tmesh_source *out)
{
    size_t count = 0;
    for (size_t a = 0; a < tmesh->arc_count; a++) {
        out->first_arc_point[a] = count;
        out->arc_cells[a] = tmesh->arcs[a].length;
        count += (size_t)tmesh->arcs[a].length + 1;
    }
    out->arc_points = qm_arena_alloc(maker->arena, count, sizeof *out->arc_points);
    if (!out->arc_points) return false;
    for (uint32_t a = 0; a < tmesh->arc_count; a++)
        for (uint32_t i = 0; i <= out->arc_cells[a]; i++)
            out->arc_points[out->first_arc_point[a] + i] =
                qm_tmesh_arc_vertex(maker->quads, set, tmesh, a, i);
    memcpy(out->node_points, tmesh->node_vertex, tmesh->node_count * sizeof *out->node_points);
    return true;
}

static bool copy_grids(const source_maker *maker, const qm_patch_set *set, const qm_tmesh *tmesh,
                       qm_tmesh_source *out)
{
    size_t count = 0;
    for (size_t p = 0; p < tmesh->patch_count; p++) {
        out->first_cell[p] = count;
        count += ((size_t)tmesh->patches[p].rows + 1) * ((size_t)tmesh->patches[p].columns + 1);
    }
    out->grid = qm_arena_alloc(maker->arena, count, sizeof *out->grid);
    if (!out->grid) return false;
    for (size_t p = 0; p < tmesh->patch_count; p++) {
        uint32_t *to = out->grid + out->first_cell[p];
        for (uint32_t row = 0; row <= tmesh->patches[p].rows; row++)
            for (uint32_t column = 0; column <= tmesh->patches[p].columns; column++)
                *to++ = qm_patch_vertex(set, &maker->quads->mesh, p, row, column);
    }
    return true;
}

qm_status qm_tmesh_source_of_quads(qm_arena *arena, const qm_tmesh_quads *quads, const qm_patch_set *set,
                                   const qm_tmesh *tmesh, const qm_ref_surface *surface, qm_tmesh_source *out)
{
    source_maker maker = {.arena = arena, .quads = quads, .surface = surface};
    size_t vertices = quads->mesh.vertex_count;
    *out = (qm_tmesh_source){.is_oriented = false};
    out->arc_cells = qm_arena_alloc(arena, tmesh->arc_count, sizeof *out->arc_cells);
    out->first_arc_point = qm_arena_alloc(arena, tmesh->arc_count, sizeof *out->first_arc_point);
    out->node_points = qm_arena_alloc(arena, tmesh->node_count, sizeof *out->node_points);
    out->first_cell = qm_arena_alloc(arena, tmesh->patch_count, sizeof *out->first_cell);
    out->at = qm_arena_alloc(arena, vertices, sizeof *out->at);
    out->normal = qm_arena_zeroed(arena, vertices, sizeof *out->normal);
    bool has_memory = out->arc_cells && out->first_arc_point && out->node_points && out->first_cell &&
                      out->at && out->normal;
    for (size_t v = 0; v < vertices && has_memory; v++)
        out->at[v] = qm_vec_load(quads->mesh.positions + 3 * v);
    if (has_memory && copy_arcs(&maker, set, tmesh, out) && copy_grids(&maker, set, tmesh, out) &&
        find_normals(&maker, out))
        return QM_OK;
    return qm_context_fail(arena->ctx, QM_E_NO_MEMORY, "out of memory for the drawing of %zu quads",
                           quads->mesh.face_count);
}

/* ---- places ---- */

qm_tmesh_place qm_tmesh_source_point(const qm_tmesh_source *source, uint32_t point)
{
    return (qm_tmesh_place){source->at[point], source->normal[point]};
}

static qm_tmesh_place mix_places(qm_tmesh_place a, qm_tmesh_place b, double share)
{
    return (qm_tmesh_place){qm_vec_mix(a.at, b.at, share), qm_vec_mix(a.normal, b.normal, share)};
}

qm_tmesh_place qm_tmesh_source_on_arc(const qm_tmesh_source *source, uint32_t arc, double share)
{
    const uint32_t *points = source->arc_points + source->first_arc_point[arc];
    uint32_t cells = source->arc_cells[arc];
    if (cells == 0) return qm_tmesh_source_point(source, points[0]);
    double along = share * cells;
    uint32_t i = (uint32_t)qm_clamp(floor(along), 0, cells - 1);
    return mix_places(qm_tmesh_source_point(source, points[i]), qm_tmesh_source_point(source, points[i + 1]),
                      along - i);
}

double qm_tmesh_source_on_side(const qm_tmesh_source *source, const qm_tmesh *tmesh, const uint32_t *length,
                               size_t patch, int side, double place)
{
    const uint32_t *first = tmesh->patches[patch].first;
    double steps = 0, start = 0, sum = 0;
    uint32_t count = 0;
    for (uint32_t s = first[side]; s < first[side + 1]; s++) {
        const qm_tmesh_slot *slot = &tmesh->slots[s];
        double own = length[slot->arc], cells = source->arc_cells[slot->arc];
        if (place >= steps && place <= steps + own) {
            sum += start + (own > 0 ? (place - steps) / own : 0.5) * cells;
            count++;
        }
        steps += own;
        start += cells;
    }
    return count > 0 ? sum / count : 0;
}

qm_tmesh_place qm_tmesh_source_in_patch(const qm_tmesh_source *source, const qm_tmesh *tmesh, size_t patch,
                                        double column, double row)
{
    uint32_t columns = qm_tmesh_side_length(tmesh, source->arc_cells, patch, 0),
             rows = qm_tmesh_side_length(tmesh, source->arc_cells, patch, 1);
    uint32_t c = (uint32_t)qm_clamp(floor(column), 0, columns - 1),
             r = (uint32_t)qm_clamp(floor(row), 0, rows - 1);
    const uint32_t *cell = source->grid + source->first_cell[patch] + (size_t)r * (columns + 1) + c;
    qm_tmesh_place low = mix_places(qm_tmesh_source_point(source, cell[0]),
                                    qm_tmesh_source_point(source, cell[1]), column - c),
                   high = mix_places(qm_tmesh_source_point(source, cell[columns + 1]),
                                     qm_tmesh_source_point(source, cell[columns + 2]), column - c);
    return mix_places(low, high, row - r);
}
