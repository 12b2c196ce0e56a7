/**
 * codec_drc_join.c: Triangles that were cut from quads and polygons are joined again along the edges marked as added.
 */
#include <stdlib.h>

#include "codec_drc.h"

/** Half-edge 3 * t + c of triangle t runs opposite to corner c. */
typedef struct edge_side {
    uint32_t low, high; /* its two vertices */
    uint32_t half_edge;
} edge_side;

typedef struct joining {
    qm_builder *builder;
    qm_draco_facts facts;
    qm_draco_arrays arrays;
    uint32_t *twins; /* for each half-edge: the one beyond an added edge, or QM_NO_INDEX */
    uint8_t *done;   /* for each triangle: its polygon is stored */
} joining;

static uint32_t next_half_edge(uint32_t half_edge)
{
    return half_edge % 3 == 2 ? half_edge - 2 : half_edge + 1;
}

/** The vertex where the half-edge begins: the corner after the one opposite. */
static uint32_t start_of(const joining *join, uint32_t half_edge)
{
    return join->arrays.triangles[next_half_edge(half_edge)];
}

static uint32_t end_of(const joining *join, uint32_t half_edge)
{
    return join->arrays.triangles[next_half_edge(next_half_edge(half_edge))];
}

static int compare_sides(const void *left, const void *right)
{
    const edge_side *a = left, *b = right;
    if (a->low != b->low) return a->low < b->low ? -1 : 1;
    if (a->high != b->high) return a->high < b->high ? -1 : 1;
    return a->half_edge < b->half_edge ? -1 : 1;
}

static void list_sides(const joining *join, edge_side *sides)
{
    for (uint32_t h = 0; h < 3 * join->facts.triangle_count; ++h) {
        uint32_t start = start_of(join, h), end = end_of(join, h);
        sides[h] = (edge_side){start < end ? start : end, start < end ? end : start, h};
    }
}

/**
 * Pairs the two sides of each added edge, of which one or both carry the mark. Where an edge has not exactly
 * two sides in opposite directions the marks mean nothing; returns how many do.
 */
static size_t pair_sides(joining *join, edge_side *sides)
{
    size_t count = 3 * join->facts.triangle_count, meaningless = 0;
    list_sides(join, sides);
    qsort(sides, count, sizeof *sides, compare_sides);
    for (size_t i = 0, next; i < count; i = next) {
        size_t marks = 0;
        for (next = i; next < count; ++next) {
            if (sides[next].low != sides[i].low || sides[next].high != sides[i].high) break;
            marks += join->arrays.added[sides[next].half_edge] == 1;
        }
        if (marks == 0) continue;
        uint32_t first = sides[i].half_edge, second = sides[next - 1].half_edge;
        if (next - i != 2 || first / 3 == second / 3 || start_of(join, first) != end_of(join, second)) {
            meaningless += marks;
            continue;
        }
        join->twins[first] = second;
        join->twins[second] = first;
    }
    return meaningless;
}

/** Walks round the polygon from an edge that was not added, adding corners; counts the edges met. */
static qm_status walk_outline(joining *join, uint32_t first, size_t *edge_count)
{
    uint32_t half_edge = first;
    *edge_count = 0;
    do {
        qm_status status = qm_builder_add_corner(join->builder, start_of(join, half_edge));
        if (status != QM_OK) return status;
        ++*edge_count;
        half_edge = next_half_edge(half_edge);
        while (join->twins[half_edge] != QM_NO_INDEX)
            half_edge = next_half_edge(join->twins[half_edge]);
    } while (half_edge != first);
    return QM_OK;
}

/** Marks the triangles joined to one, listing them; returns their number and counts their outer edges. */
static size_t gather_triangles(joining *join, uint32_t triangle, uint32_t *list, size_t *outer_count)
{
    size_t count = 0;
    *outer_count = 0;
    list[count++] = triangle;
    join->done[triangle] = 1;
    for (size_t i = 0; i < count; ++i)
        for (uint32_t h = 3 * list[i]; h < 3 * list[i] + 3; ++h) {
            uint32_t twin = join->twins[h];
            *outer_count += twin == QM_NO_INDEX;
            if (twin == QM_NO_INDEX || join->done[twin / 3]) continue;
            join->done[twin / 3] = 1;
            list[count++] = twin / 3;
        }
    return count;
}

static qm_status add_triangles(joining *join, const uint32_t *list, size_t count)
{
    const uint32_t *corners = join->arrays.triangles;
    qm_status status = QM_OK;
    for (size_t i = 0; status == QM_OK && i < count; ++i) {
        const uint32_t *c = corners + 3 * (size_t)list[i];
        status = qm_builder_add_triangle(join->builder, c[0], c[1], c[2]);
    }
    return status;
}

/**
 * An outer edge from which to walk: the one after an added edge, so that a quad starts on its diagonal and is
 * split again where it was split.
 */
static uint32_t find_first_edge(const joining *join, const uint32_t *list, size_t count)
{
    uint32_t outer = QM_NO_INDEX;
    for (size_t i = 0; i < count; ++i)
        for (uint32_t h = 3 * list[i]; h < 3 * list[i] + 3; ++h) {
            if (join->twins[h] != QM_NO_INDEX) continue;
            outer = h;
            if (join->twins[next_half_edge(next_half_edge(h))] != QM_NO_INDEX) return h;
        }
    return outer;
}

/** Adds the face that a triangle is part of; *whole is false if its triangles do not form one polygon. */
static qm_status add_polygon(joining *join, uint32_t triangle, uint32_t *list, bool *whole)
{
    size_t outer_count, edge_count = 0;
    size_t count = gather_triangles(join, triangle, list, &outer_count);
    *whole = true;
    if (count == 1) return add_triangles(join, list, 1);
    uint32_t first = find_first_edge(join, list, count);
    qm_status status = first == QM_NO_INDEX ? QM_OK : walk_outline(join, first, &edge_count);
    if (status != QM_OK) return status;
    *whole = edge_count == outer_count && outer_count == count + 2;
    if (*whole) return qm_builder_end_face(join->builder);
    join->builder->corner_count = 0;
    return add_triangles(join, list, count);
}

static qm_status add_polygons(joining *join, uint32_t *list, size_t meaningless)
{
    size_t broken = 0;
    for (uint32_t t = 0; t < join->facts.triangle_count; ++t) {
        bool whole;
        if (join->done[t]) continue;
        qm_status status = add_polygon(join, t, list, &whole);
        if (status != QM_OK) return status;
        broken += !whole;
    }
    if (meaningless + broken > 0)
        qm_codec_warn(join->builder->report,
                      "inconsistent marks of edges that cut polygons: %zu (the triangles there were kept)",
                      meaningless + broken);
    return QM_OK;
}

qm_status qm_drc_join_triangles(qm_builder *builder, const qm_draco_facts *facts,
                                const qm_draco_arrays *arrays)
{
    qm_context *ctx = builder->ctx;
    size_t triangle_count = facts->triangle_count, corner_count = 3 * triangle_count;
    joining join = {.builder = builder, .facts = *facts, .arrays = *arrays};
    edge_side *sides = qm_context_alloc(ctx, corner_count, sizeof *sides);
    uint32_t *list = qm_context_alloc(ctx, triangle_count, sizeof *list);
    join.twins = qm_context_alloc(ctx, corner_count, sizeof *join.twins);
    join.done = qm_context_alloc(ctx, triangle_count, sizeof *join.done);
    qm_status status = QM_E_NO_MEMORY;
    if (sides && list && join.twins && join.done) {
        memset(join.twins, 0xff, corner_count * sizeof *join.twins);
        memset(join.done, 0, triangle_count * sizeof *join.done);
        status = add_polygons(&join, list, pair_sides(&join, sides));
    }
    qm_context_free(ctx, sides, corner_count, sizeof *sides);
    qm_context_free(ctx, list, triangle_count, sizeof *list);
    qm_context_free(ctx, join.twins, corner_count, sizeof *join.twins);
    qm_context_free(ctx, join.done, triangle_count, sizeof *join.done);
    return status;
}
