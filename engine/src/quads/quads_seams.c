/**
 * quads_seams.c: closes the seams of a surface. Formats that give a vertex one normal or one place in a picture have
 * it twice where these jump, and modellers' patches that meet often share no vertex: two boundaries then run through the
 * same places, of which each would be a boundary of the quads. Where just two sides without a partner lead from one place to another and
 * back, they become one edge. What only touches stays apart.
 */
#include <stdlib.h>
#include <string.h>

#include "core/union_find.h"
#include "quads/quads_internal.h"

/** A side of a triangle without a partner. */
typedef struct seam_side {
    uint32_t from, to; /* vertices */
    uint32_t place[2]; /* the lowest vertices at their positions, the lower first */
    bool is_up;        /* it leads from the lower place to the higher */
} seam_side;

/** A vertex of such a side. */
typedef struct seam_end {
    qm_vec at;
    uint32_t vertex;
} seam_end;

static int compare_ends(const void *a, const void *b)
{
    const seam_end *one = a, *other = b;
    int order = qm_vec_compare(one->at, other->at);
    return order != 0 ? order : (one->vertex > other->vertex) - (one->vertex < other->vertex);
}

static int compare_sides(const void *a, const void *b)
{
    const seam_side *one = a, *other = b;
    for (int k = 0; k < 2; k++)
        if (one->place[k] != other->place[k]) return one->place[k] < other->place[k] ? -1 : 1;
    if (one->from != other->from) return one->from < other->from ? -1 : 1;
    return (one->to > other->to) - (one->to < other->to);
}

/** Lists the sides without a partner: start and to hold where the sides from each vertex lead. */
static size_t list_open_sides(const qm_quads_triangles *t, const uint32_t *start, const uint32_t *to,
                              seam_side *out)
{
    size_t count = 0;
    for (size_t i = 0; i < t->count; i++)
        for (int k = 0; k < 3; k++) {
            uint32_t a = t->corner[i][k], b = t->corner[i][(k + 1) % 3];
            bool has_partner = a == b;
            for (uint32_t s = start[b]; s < start[b + 1] && !has_partner; s++)
                has_partner = to[s] == a;
            if (has_partner) continue;
            if (out) out[count] = (seam_side){.from = a, .to = b};
            count++;
        }
    return count;
}

static void list_ends(const qm_quads_triangles *t, size_t vertex_count, uint32_t *start, uint32_t *to)
{
    memset(start, 0, (vertex_count + 1) * sizeof *start);
    for (size_t i = 0; i < t->count; i++)
        for (int k = 0; k < 3; k++)
            start[t->corner[i][k]]++;
    for (size_t v = 0; v < vertex_count; v++)
        start[v + 1] += start[v];
    for (size_t i = t->count; i-- > 0;)
        for (int k = 0; k < 3; k++)
            to[--start[t->corner[i][k]]] = t->corner[i][(k + 1) % 3];
}

/** Finds the lowest vertex at the position of each end. */
static void find_places(const qm_mesh *mesh, seam_side *sides, size_t count, seam_end *ends, uint32_t *place)
{
    for (size_t i = 0; i < 2 * count; i++) {
        uint32_t v = i % 2 == 0 ? sides[i / 2].from : sides[i / 2].to;
        ends[i] = (seam_end){qm_vec_load(mesh->positions + 3 * (size_t)v), v};
    }
    qsort(ends, 2 * count, sizeof *ends, compare_ends);
    for (size_t i = 0, first = 0; i < 2 * count; i++) {
        if (qm_vec_compare(ends[i].at, ends[first].at) != 0) first = i;
        place[ends[i].vertex] = ends[first].vertex;
    }
    for (size_t i = 0; i < count; i++) {
        uint32_t a = place[sides[i].from], b = place[sides[i].to];
        sides[i].place[0] = a < b ? a : b;
        sides[i].place[1] = a < b ? b : a;
        sides[i].is_up = a < b;
    }
    qsort(sides, count, sizeof *sides, compare_sides);
}

static void join_sides(const seam_side *sides, size_t count, uint32_t *parent)
{
    for (size_t i = 0, end; i < count; i = end) {
        for (end = i + 1; end < count && sides[end].place[0] == sides[i].place[0] &&
                          sides[end].place[1] == sides[i].place[1];)
            end++;
        const seam_side *one = &sides[i], *other = &sides[i + 1];
        if (end - i != 2 || one->is_up == other->is_up || one->place[0] == one->place[1]) continue;
        qm_union_find_join(parent, one->from, other->to);
        qm_union_find_join(parent, one->to, other->from);
    }
}

/** Gives the triangles the lowest of the vertices that have become one. */
static void rename_corners(qm_quads_triangles *t, uint32_t *parent)
{
    for (size_t i = 0; i < t->count; i++)
        for (int k = 0; k < 3; k++)
            t->corner[i][k] = qm_union_find_root(parent, t->corner[i][k]);
}

qm_status qm_quads_close_seams(qm_context *ctx, const qm_mesh *mesh, qm_quads_triangles *t)
{
    size_t vertices = mesh->vertex_count, count = 0;
    uint32_t *start = qm_context_alloc(ctx, vertices + 1, sizeof *start);
    uint32_t *to = qm_context_alloc(ctx, 3 * t->count, sizeof *to);
    bool has_memory = start && to;
    if (has_memory) {
        list_ends(t, vertices, start, to);
        count = list_open_sides(t, start, to, NULL);
    }
    seam_side *sides = NULL;
    seam_end *ends = NULL;
    uint32_t *place = NULL;
    if (has_memory && count > 0) {
        sides = qm_context_alloc(ctx, count, sizeof *sides);
        ends = qm_context_alloc(ctx, 2 * count, sizeof *ends);
        place = qm_context_alloc(ctx, vertices, sizeof *place);
        has_memory = sides && ends && place;
        if (has_memory) {
            list_open_sides(t, start, to, sides);
            find_places(mesh, sides, count, ends, place);
            for (uint32_t v = 0; v < vertices; v++)
                place[v] = v; /* now of union-find */
            join_sides(sides, count, place);
            rename_corners(t, place);
        }
    }
    qm_context_free(ctx, start, vertices + 1, sizeof *start);
    qm_context_free(ctx, to, 3 * t->count, sizeof *to);
    qm_context_free(ctx, sides, count, sizeof *sides);
    qm_context_free(ctx, ends, 2 * count, sizeof *ends);
    qm_context_free(ctx, place, vertices, sizeof *place);
    return has_memory ? QM_OK : QM_E_NO_MEMORY;
}
