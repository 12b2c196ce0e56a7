/**
 * quads_seams.c: turns triangles that look the other way than their neighbours, and closes the seams of a surface.
 *
 * Formats that give a vertex one normal or one place in a picture have it twice where these jump, and modellers' patches that
 * meet often share no vertex: two boundaries then run through the same places, of which each would be a boundary of the
 * quads. Where just two sides without a partner lead from one place to another and back, they become one edge. What only
 * touches stays apart.
 *
 * Where just two lead the same way, one of their triangles looks the wrong way. Each triangle is a pair of nodes, as it is and turned: sides with a
 * partner join the nodes of one kind, sides that lead the same way those of different kinds, unless that would join both nodes of
 * a triangle, as on a Moebius strip: such an edge stays a boundary. Of each surface the part of the smaller area is turned.
 */
#include <stdlib.h>
#include <string.h>

#include "core/union_find.h"
#include "quads/quads_internal.h"

/** A side of a triangle without a partner. */
typedef struct seam_side {
    uint32_t from, to; /* vertices */
    uint32_t triangle;
    uint32_t place[2]; /* the lowest vertices at their positions, the lower first */
    bool is_up;        /* it leads from the lower place to the higher */
} seam_side;

/** A side from a vertex: where it leads, and of which triangle it is. Those of v are way[start[v]] ... way[start[v + 1] - 1]. */
typedef struct seam_way {
    uint32_t to, triangle;
} seam_way;

/** A vertex of a side without a partner. */
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
    if (one->to != other->to) return one->to < other->to ? -1 : 1;
    return (one->triangle > other->triangle) - (one->triangle < other->triangle);
}

/** The triangle with a side from one vertex to another; QM_NO_INDEX: there is none. */
static uint32_t triangle_between(const uint32_t *start, const seam_way *way, uint32_t from, uint32_t to)
{
    for (uint32_t s = start[from]; s < start[from + 1]; s++)
        if (way[s].to == to) return way[s].triangle;
    return QM_NO_INDEX;
}

/** Lists the sides without a partner. */
static size_t list_open_sides(const qm_quads_triangles *t, const uint32_t *start, const seam_way *way,
                              seam_side *out)
{
    size_t count = 0;
    for (size_t i = 0; i < t->count; i++)
        for (int k = 0; k < 3; k++) {
            uint32_t a = t->corner[i][k], b = t->corner[i][(k + 1) % 3];
            if (a == b || triangle_between(start, way, b, a) != QM_NO_INDEX) continue;
            if (out) out[count] = (seam_side){.from = a, .to = b, .triangle = (uint32_t)i};
            count++;
        }
    return count;
}

static void list_ways(const qm_quads_triangles *t, size_t vertex_count, uint32_t *start, seam_way *way)
{
    memset(start, 0, (vertex_count + 1) * sizeof *start);
    for (size_t i = 0; i < t->count; i++)
        for (int k = 0; k < 3; k++)
            start[t->corner[i][k]]++;
    for (size_t v = 0; v < vertex_count; v++)
        start[v + 1] += start[v];
    for (size_t i = t->count; i-- > 0;)
        for (int k = 0; k < 3; k++)
            way[--start[t->corner[i][k]]] = (seam_way){t->corner[i][(k + 1) % 3], (uint32_t)i};
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

/** The next pair of sides alone at their places, from *next on; NULL: there is none. */
static const seam_side *next_pair(const seam_side *sides, size_t count, size_t *next)
{
    for (size_t i = *next, end; i < count; i = end) {
        for (end = i + 1; end < count && sides[end].place[0] == sides[i].place[0] &&
                          sides[end].place[1] == sides[i].place[1];)
            end++;
        *next = end;
        if (end - i == 2 && sides[i].place[0] != sides[i].place[1]) return &sides[i];
    }
    return NULL;
}

static bool leads_back(const seam_side *pair)
{
    return pair[0].is_up != pair[1].is_up;
}

static void join_sides(const seam_side *sides, size_t count, uint32_t *parent)
{
    size_t next = 0;
    for (const seam_side *pair; (pair = next_pair(sides, count, &next));) {
        if (!leads_back(pair)) continue;
        qm_union_find_join(parent, pair[0].from, pair[1].to);
        qm_union_find_join(parent, pair[0].to, pair[1].from);
    }
}

/** Joins the nodes of two triangles, of which i is one as it is and i + count the same turned; not if they are joined the other way. */
static void join_nodes(uint32_t *parent, size_t count, uint32_t i, uint32_t j, bool is_same)
{
    uint32_t turned = (uint32_t)count, with = is_same ? j : j + turned, against = is_same ? j + turned : j;
    if (qm_union_find_root(parent, i) == qm_union_find_root(parent, against)) return;
    qm_union_find_join(parent, i, with);
    qm_union_find_join(parent, i + turned, against);
}

/** Joins triangles by the sides that have a partner. */
static void join_partners(const qm_quads_triangles *t, const uint32_t *start, const seam_way *way,
                          uint32_t *parent)
{
    for (uint32_t i = 0; i < t->count; i++)
        for (int k = 0; k < 3; k++) {
            uint32_t partner = triangle_between(start, way, t->corner[i][(k + 1) % 3], t->corner[i][k]);
            if (partner != QM_NO_INDEX) join_nodes(parent, t->count, i, partner, true);
        }
}

/** Turns the triangles of the smaller part of each surface. area has two entries for each class: of those as they are, and turned. */
static void turn_parts(const qm_mesh *mesh, const qm_quads_triangles *t, uint32_t *parent, double (*area)[2])
{
    memset(area, 0, 2 * t->count * sizeof *area);
    for (int pass = 0; pass < 2; pass++)
        for (uint32_t i = 0; i < t->count; i++) {
            uint32_t own = qm_union_find_root(parent, i),
                     other = qm_union_find_root(parent, i + (uint32_t)t->count);
            bool is_turned = own > other;
            double *sums = area[is_turned ? other : own];
            if (pass == 0)
                sums[is_turned] += qm_quads_area(mesh->positions, (const uint32_t(*)[3])t->corner + i, 1);
            else if ((sums[1] > sums[0]) != is_turned) {
                uint32_t corner = t->corner[i][1];
                t->corner[i][1] = t->corner[i][2];
                t->corner[i][2] = corner;
            }
        }
}

static void join_pairs(const qm_quads_triangles *t, const seam_side *sides, size_t count, bool lead_back,
                       uint32_t *parent)
{
    size_t next = 0;
    for (const seam_side *pair; (pair = next_pair(sides, count, &next));)
        if (leads_back(pair) == lead_back)
            join_nodes(parent, t->count, pair[0].triangle, pair[1].triangle, lead_back);
}

/** Turns triangles until neighbours look the same way, where that can be. */
static bool turn_triangles(qm_context *ctx, const qm_mesh *mesh, const qm_quads_triangles *t,
                           const uint32_t *start, const seam_way *way, const seam_side *sides, size_t count)
{
    size_t nodes = 2 * t->count;
    uint32_t *parent = qm_context_alloc(ctx, nodes, sizeof *parent);
    double(*area)[2] = qm_context_alloc(ctx, nodes, sizeof *area);
    bool has_memory = parent && area;
    if (has_memory) {
        for (uint32_t i = 0; i < nodes; i++)
            parent[i] = i;
        join_partners(t, start, way, parent);
        join_pairs(t, sides, count, true, parent);
        join_pairs(t, sides, count, false, parent);
        turn_parts(mesh, t, parent, area);
    }
    qm_context_free(ctx, parent, nodes, sizeof *parent);
    qm_context_free(ctx, area, nodes, sizeof *area);
    return has_memory;
}

static bool has_turned(const seam_side *sides, size_t count)
{
    size_t next = 0;
    for (const seam_side *pair; (pair = next_pair(sides, count, &next));)
        if (!leads_back(pair)) return true;
    return false;
}

/** Gives the triangles the lowest of the vertices that have become one. */
static void rename_corners(qm_quads_triangles *t, uint32_t *parent)
{
    for (size_t i = 0; i < t->count; i++)
        for (int k = 0; k < 3; k++)
            t->corner[i][k] = qm_union_find_root(parent, t->corner[i][k]);
}

/** Turns triangles, or closes seams if turns is false or none has to be turned; *is_turned tells. */
static qm_status mend(qm_context *ctx, const qm_mesh *mesh, qm_quads_triangles *t, bool turns,
                      bool *is_turned)
{
    size_t vertices = mesh->vertex_count, count = 0;
    uint32_t *start = qm_context_alloc(ctx, vertices + 1, sizeof *start);
    seam_way *way = qm_context_alloc(ctx, 3 * t->count, sizeof *way);
    bool has_memory = start && way;
    *is_turned = false;
    if (has_memory) {
        list_ways(t, vertices, start, way);
        count = list_open_sides(t, start, way, NULL);
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
            list_open_sides(t, start, way, sides);
            find_places(mesh, sides, count, ends, place);
            *is_turned = turns && has_turned(sides, count);
            if (*is_turned) {
                has_memory = turn_triangles(ctx, mesh, t, start, way, sides, count);
            } else {
                for (uint32_t v = 0; v < vertices; v++)
                    place[v] = v; /* now of union-find */
                join_sides(sides, count, place);
                rename_corners(t, place);
            }
        }
    }
    qm_context_free(ctx, start, vertices + 1, sizeof *start);
    qm_context_free(ctx, way, 3 * t->count, sizeof *way);
    qm_context_free(ctx, sides, count, sizeof *sides);
    qm_context_free(ctx, ends, 2 * count, sizeof *ends);
    qm_context_free(ctx, place, vertices, sizeof *place);
    return has_memory ? QM_OK : QM_E_NO_MEMORY;
}

qm_status qm_quads_close_seams(qm_context *ctx, const qm_mesh *mesh, qm_quads_triangles *t)
{
    bool is_turned;
    qm_status status = mend(ctx, mesh, t, true, &is_turned);
    return status == QM_OK && is_turned ? mend(ctx, mesh, t, false, &is_turned) : status;
}
