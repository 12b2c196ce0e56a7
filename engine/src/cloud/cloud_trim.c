/**
 * cloud_trim.c: the zeros of the function go on where there are no points. What of that is small and bounded by triangles at points on
 * all sides fills a hole; the rest goes, and the surface ends there.
 */
#include "cloud_trim.h"

#include <string.h>

#include "core/union_find.h"

#define LEAN                                                                                                 \
    0.42 /* of `lean`: triangles beside such that go, and that lean more, are beyond the end of the points */
#define MIN_SUPPORT 20 /* points of a sheet: fewer are outliers */
#define SMOOTHING 6    /* rounds of averaging along the ends of the surface, which run in steps */

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a surface of points");
}

typedef struct trimmer {
    qm_cloud_triangles *all;
    const qm_cloud_place *place;
    bool *is_dropped; /* of each triangle */
    uint32_t *next;   /* of each side 3 t + k, from corner k: the other side of its edge, or QM_NO_INDEX */
    uint32_t *class;  /* of each triangle or vertex: union-find, used by one stage after the other */
    size_t class_capacity;
} trimmer;

/** True if a triangle lies beyond the points at all corners. */
static bool is_beyond(const trimmer *t, size_t triangle)
{
    for (int k = 0; k < 3; k++)
        if (!((double)t->place[t->all->corner[triangle][k]].lean > LEAN)) return false;
    return true;
}

qm_status qm_cloud_link_sides(qm_context *ctx, const qm_cloud_triangles *triangles, uint32_t *next)
{
    size_t sides = 3 * triangles->count, vertices = triangles->vertex_count;
    uint32_t *first = qm_context_alloc(ctx, vertices, sizeof *first),
             *list = qm_context_alloc(ctx, sides, sizeof *list);
    qm_status status = first && list ? QM_OK : no_memory(ctx);
    if (status == QM_OK) {
        for (size_t v = 0; v < vertices; v++)
            first[v] = QM_NO_INDEX;
        for (uint32_t s = 0; s < sides; s++) {
            uint32_t from = triangles->corner[s / 3][s % 3];
            list[s] = first[from];
            first[from] = s;
        }
        for (uint32_t s = 0; s < sides; s++) {
            uint32_t from = triangles->corner[s / 3][s % 3], to = triangles->corner[s / 3][(s + 1) % 3],
                     other = first[to];
            while (other != QM_NO_INDEX && triangles->corner[other / 3][(other + 1) % 3] != from)
                other = list[other];
            next[s] = other;
        }
    }
    qm_context_free(ctx, first, vertices, sizeof *first);
    qm_context_free(ctx, list, sides, sizeof *list);
    return status;
}

/** Puts neighbours that are both chosen into one class. */
static void join(trimmer *t, bool (*chosen)(const trimmer *t, size_t triangle))
{
    for (uint32_t i = 0; i < t->all->count; i++)
        t->class[i] = i;
    for (uint32_t i = 0; i < t->all->count; i++)
        for (uint32_t k = 0; k < 3 && chosen(t, i); k++) {
            uint32_t other = t->next[3 * i + k];
            if (other != QM_NO_INDEX && chosen(t, other / 3)) qm_union_find_join(t->class, i, other / 3);
        }
}

static bool is_in_gap(const trimmer *t, size_t triangle)
{
    for (int k = 0; k < 3; k++)
        if (!((double)t->place[t->all->corner[triangle][k]].away > QM_CLOUD_GAP)) return false;
    return true;
}

static bool is_kept(const trimmer *t, size_t triangle)
{
    return !t->is_dropped[triangle];
}

/** A part of the surface without points. */
typedef struct gap {
    qm_vec low, high;
    bool is_open; /* it reaches the end of the grid */
} gap;

static void extend(gap *g, qm_vec p)
{
    g->low = (qm_vec){fmin(g->low.x, p.x), fmin(g->low.y, p.y), fmin(g->low.z, p.z)};
    g->high = (qm_vec){fmax(g->high.x, p.x), fmax(g->high.y, p.y), fmax(g->high.z, p.z)};
}

/** Drops the gaps that are no small holes. */
static qm_status drop_gaps(qm_context *ctx, trimmer *t, double hole)
{
    size_t count = t->all->count;
    gap *gaps = qm_context_alloc(ctx, count, sizeof *gaps);
    if (!gaps) return no_memory(ctx);
    join(t, is_in_gap);
    for (size_t i = 0; i < count; i++)
        gaps[i] = (gap){{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}, false};
    for (uint32_t i = 0; i < count; i++) {
        if (!is_in_gap(t, i)) continue;
        gap *g = &gaps[qm_union_find_root(t->class, i)];
        for (uint32_t k = 0; k < 3; k++) {
            extend(g, t->all->position[t->all->corner[i][k]]);
            g->is_open |= t->next[3 * i + k] == QM_NO_INDEX;
        }
    }
    for (uint32_t i = 0; i < count; i++) {
        if (!is_in_gap(t, i)) continue;
        const gap *g = &gaps[qm_union_find_root(t->class, i)];
        t->is_dropped[i] = g->is_open || qm_vec_distance(g->low, g->high) > hole;
    }
    qm_context_free(ctx, gaps, count, sizeof *gaps);
    return QM_OK;
}

/** Drops what lies between dropped triangles and the last points: the neighbours, again and again. */
static qm_status drop_edges(qm_context *ctx, trimmer *t)
{
    size_t count = t->all->count, filled = 0, done = 0;
    uint32_t *queue = qm_context_alloc(ctx, count, sizeof *queue);
    if (!queue) return no_memory(ctx);
    for (uint32_t i = 0; i < count; i++)
        if (t->is_dropped[i]) queue[filled++] = i;
    for (; done < filled; done++)
        for (uint32_t k = 0; k < 3; k++) {
            uint32_t other = t->next[3 * queue[done] + k];
            if (other == QM_NO_INDEX || t->is_dropped[other / 3] || !is_beyond(t, other / 3)) continue;
            t->is_dropped[other / 3] = true;
            queue[filled++] = other / 3;
        }
    qm_context_free(ctx, queue, count, sizeof *queue);
    return QM_OK;
}

/** Drops connected sheets that few points are nearest to. */
static qm_status drop_sheets(qm_context *ctx, trimmer *t, size_t point_count)
{
    size_t count = t->all->count;
    uint32_t *support = qm_context_alloc(ctx, count, sizeof *support);
    bool *is_counted = qm_context_alloc(ctx, point_count, sizeof *is_counted);
    qm_status status = support && is_counted ? QM_OK : no_memory(ctx);
    if (status == QM_OK) {
        join(t, is_kept);
        memset(support, 0, count * sizeof *support);
        memset(is_counted, 0, point_count * sizeof *is_counted);
        for (uint32_t i = 0; i < count; i++)
            for (int k = 0; k < 3 && !t->is_dropped[i]; k++) {
                const qm_cloud_place *place = &t->place[t->all->corner[i][k]];
                if ((double)place->away > QM_CLOUD_GAP || is_counted[place->point]) continue;
                is_counted[place->point] = true;
                support[qm_union_find_root(t->class, i)]++;
            }
        for (uint32_t i = 0; i < count; i++)
            t->is_dropped[i] |= support[qm_union_find_root(t->class, i)] < MIN_SUPPORT;
    }
    qm_context_free(ctx, support, count, sizeof *support);
    qm_context_free(ctx, is_counted, point_count, sizeof *is_counted);
    return status;
}

/** True if a side is at an end of the surface. */
static bool is_border(const trimmer *t, uint32_t side)
{
    if (t->is_dropped[side / 3]) return false;
    uint32_t other = t->next[side];
    return other == QM_NO_INDEX || t->is_dropped[other / 3];
}

/** Counts lines of borders that hang together, and evens them out. */
static qm_status smooth_borders(qm_context *ctx, trimmer *t, size_t *borders)
{
    size_t vertices = t->all->vertex_count;
    qm_vec *sum = qm_context_alloc(ctx, vertices, sizeof *sum);
    uint32_t *sides = qm_context_alloc(ctx, vertices, sizeof *sides);
    qm_status status = sum && sides ? QM_OK : no_memory(ctx);
    for (int round = 0; round < SMOOTHING && status == QM_OK; round++) {
        memset(sides, 0, vertices * sizeof *sides);
        for (size_t v = 0; v < vertices; v++)
            sum[v] = (qm_vec){0, 0, 0};
        for (uint32_t v = 0; v < vertices && round == 0; v++)
            t->class[v] = v;
        for (uint32_t s = 0; s < 3 * t->all->count; s++) {
            if (!is_border(t, s)) continue;
            uint32_t a = t->all->corner[s / 3][s % 3], b = t->all->corner[s / 3][(s + 1) % 3];
            sum[a] = qm_vec_add(sum[a], t->all->position[b]);
            sum[b] = qm_vec_add(sum[b], t->all->position[a]);
            sides[a]++, sides[b]++;
            if (round == 0) qm_union_find_join(t->class, a, b);
        }
        for (uint32_t v = 0; v < vertices; v++) {
            if (round == 0) *borders += sides[v] > 0 && qm_union_find_root(t->class, v) == v;
            if (sides[v] == 2)
                t->all->position[v] = qm_vec_mix(t->all->position[v], qm_vec_scale(0.5, sum[v]), 0.5);
        }
    }
    qm_context_free(ctx, sum, vertices, sizeof *sum);
    qm_context_free(ctx, sides, vertices, sizeof *sides);
    return status;
}

/** Counts components and holes, and the share of the area that is in these. */
static void count_parts(trimmer *t, qm_cloud_record *record)
{
    double area = 0.0, filled = 0.0;
    join(t, is_kept);
    for (uint32_t i = 0; i < t->all->count; i++)
        record->components += !t->is_dropped[i] && qm_union_find_root(t->class, i) == i;
    join(t, is_in_gap);
    for (uint32_t i = 0; i < t->all->count; i++) {
        if (t->is_dropped[i]) continue;
        const uint32_t *c = t->all->corner[i];
        qm_vec a = qm_vec_sub(t->all->position[c[1]], t->all->position[c[0]]),
               b = qm_vec_sub(t->all->position[c[2]], t->all->position[c[0]]);
        double size = qm_vec_norm(qm_vec_cross(a, b));
        area += size;
        if (!is_in_gap(t, i)) continue;
        filled += size;
        record->holes_filled += qm_union_find_root(t->class, i) == i;
    }
    record->filled_share = area > 0.0 ? filled / area : 0.0;
}

/** Removes the dropped triangles, and the vertices that no other has. */
static void compact(trimmer *t)
{
    qm_cloud_triangles *all = t->all;
    size_t kept = 0, vertices = 0;
    for (size_t v = 0; v < all->vertex_count; v++)
        t->class[v] = QM_NO_INDEX;
    for (size_t i = 0; i < all->count; i++) {
        if (t->is_dropped[i]) continue;
        memmove(all->corner[kept++], all->corner[i], sizeof *all->corner);
    }
    all->count = kept;
    for (size_t i = 0; i < kept; i++)
        for (int k = 0; k < 3; k++)
            t->class[all->corner[i][k]] = 0;
    for (size_t v = 0; v < all->vertex_count; v++) {
        if (t->class[v] == QM_NO_INDEX) continue;
        t->class[v] = (uint32_t)vertices;
        all->position[vertices++] = all->position[v];
    }
    all->vertex_count = vertices;
    for (size_t i = 0; i < kept; i++)
        for (int k = 0; k < 3; k++)
            all->corner[i][k] = t->class[all->corner[i][k]];
}

qm_status qm_cloud_trim(qm_context *ctx, qm_cloud_triangles *triangles, const qm_cloud_place *place,
                        size_t point_count, double hole, qm_cloud_record *record)
{
    if (triangles->count == 0) return QM_OK;
    size_t count = triangles->count;
    trimmer t = {.all = triangles, .place = place};
    t.class_capacity = count > triangles->vertex_count ? count : triangles->vertex_count;
    t.is_dropped = qm_context_alloc(ctx, count, sizeof *t.is_dropped);
    t.next = qm_context_alloc(ctx, 3 * count, sizeof *t.next);
    t.class = qm_context_alloc(ctx, t.class_capacity, sizeof *t.class);
    qm_status status =
        t.is_dropped && t.next && t.class ? qm_cloud_link_sides(ctx, triangles, t.next) : no_memory(ctx);
    if (status == QM_OK) {
        memset(t.is_dropped, 0, count * sizeof *t.is_dropped);
        status = drop_gaps(ctx, &t, hole);
    }
    if (status == QM_OK) status = drop_edges(ctx, &t);
    if (status == QM_OK) status = drop_sheets(ctx, &t, point_count);
    if (status == QM_OK) status = smooth_borders(ctx, &t, &record->borders);
    if (status == QM_OK) {
        count_parts(&t, record);
        compact(&t);
    }
    qm_context_free(ctx, t.is_dropped, count, sizeof *t.is_dropped);
    qm_context_free(ctx, t.next, 3 * count, sizeof *t.next);
    qm_context_free(ctx, t.class, t.class_capacity, sizeof *t.class);
    return status;
}
