/**
 * layout_creases.c: lines that run along the creases and boundaries of a mesh are put on them, exactly.
 *
 * The parts of a line that stay within a reach of the features are found by projection; each is replaced by the shortest way
 * over the edges of the features from its first place on them to its last, where edges off the line count more. A way that
 * is much longer than the part, as where the line only crosses a crease, is not taken.
 */
#include "layout_creases.h"

#include <string.h>

#include "core/heap.h"
#include "layout_internal.h"
#include "qm/layout_edit.h"
#include "qm/project.h"

#define CREASE_ANGLE 15.0   /* degrees: lines tell which of the fine creases are meant */
#define SHORTEST 1e-9       /* of the diagonal: no feature is too short to be meant */
#define FOLLOW_REACH 0.01   /* of the diagonal, from a sharp curve */
#define MOST_OF_LENGTH 0.25 /* of a curve's length: the reach is no more */
#define STEPS_A_REACH 2.0   /* places of a line in one reach */
#define MOST_PLACES 4096    /* of a line */
#define MIN_RUN 3.0         /* reaches: a shorter part of a line only crosses */
#define MOST_DETOUR 1.25    /* of the length of a part, and one reach */
#define OFF_COST 2.0        /* of an edge one reach off the line, beside its length */
#define MOST_OFF 1.5        /* reaches: edges farther off are not taken */
#define CLOSED_PARTS 4      /* a way round a closed line is found in so many parts */

#define BENT_COSINE -0.7 /* of the angle between two sharp curves: with more their node is a corner */

#define INSIDE 0.01    /* of the way from an end of a line to its next point */
#define ON_CREASE 1e-6 /* of the diagonal */

enum { POINT_SIZE = 3 * sizeof(double) };

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the creases");
}

/** A tree of the edges, as triangles that repeat a corner: face i is edge i. */
static qm_status build_tree(qm_context *ctx, qm_creases *c)
{
    size_t edges = c->features.edge_count;
    c->segments = (qm_mesh){.vertex_count = c->features.point_count, .face_count = edges};
    c->segments.positions = qm_context_alloc(ctx, c->features.point_count, POINT_SIZE);
    c->segments.faces = qm_context_alloc(ctx, edges, 4 * sizeof *c->segments.faces);
    if (!c->segments.positions || !c->segments.faces) return no_memory(ctx);
    memcpy(c->segments.positions, c->features.points, c->features.point_count * POINT_SIZE);
    for (size_t i = 0; i < edges; i++) {
        const uint32_t *end = c->features.edges[i];
        const uint32_t face[4] = {end[0], end[1], end[1], QM_NO_INDEX};
        memcpy(c->segments.faces + 4 * i, face, sizeof face);
    }
    return qm_bvh_build(ctx, &c->segments, QM_BVH_TARGET, 1, &c->tree);
}

static qm_status list_links(qm_context *ctx, qm_creases *c)
{
    size_t points = c->features.point_count, edges = c->features.edge_count;
    c->start = qm_context_alloc(ctx, points + 1, sizeof *c->start);
    c->edge = qm_context_alloc(ctx, 2 * edges, sizeof *c->edge);
    if (!c->start || !c->edge) return no_memory(ctx);
    memset(c->start, 0, (points + 1) * sizeof *c->start);
    for (size_t i = 0; i < edges; i++)
        for (int k = 0; k < 2; k++)
            c->start[c->features.edges[i][k]]++;
    for (size_t v = 0; v < points; v++)
        c->start[v + 1] += c->start[v];
    for (size_t i = edges; i-- > 0;)
        for (int k = 0; k < 2; k++)
            c->edge[--c->start[c->features.edges[i][k]]] = (uint32_t)i;
    return QM_OK;
}

qm_status qm_creases_find(qm_context *ctx, const qm_ref_surface *surface, double angle, const double *box,
                          qm_creases *out)
{
    QM_ASSERT(ctx && surface && out);
    *out = (qm_creases){0};
    if (surface->is_cloud) return QM_OK;
    const qm_features_options options = {
        .angle = angle > 0.0 ? angle : CREASE_ANGLE, .shortest = SHORTEST * surface->diagonal, .box = box};
    qm_status status = qm_features_find(ctx, qm_bvh_mesh(surface->bvh), &options, &out->features);
    if (status == QM_OK && out->features.edge_count > 0) {
        status = build_tree(ctx, out);
        if (status == QM_OK) status = list_links(ctx, out);
    }
    if (status != QM_OK) qm_creases_reset(ctx, out);
    return status;
}

void qm_creases_reset(qm_context *ctx, qm_creases *c)
{
    size_t points = c->features.point_count, edges = c->features.edge_count;
    qm_bvh_destroy(ctx, c->tree);
    qm_mesh_reset(ctx, &c->segments);
    qm_context_free(ctx, c->start, points + 1, sizeof *c->start);
    qm_context_free(ctx, c->edge, 2 * edges, sizeof *c->edge);
    qm_features_reset(ctx, &c->features);
    *c = (qm_creases){0};
}

static qm_vec feature_point(const qm_creases *c, uint32_t point)
{
    return qm_vec_load(c->features.points + 3 * (size_t)point);
}

/* ---- places of a line ---- */

/** Places along a line, each with the nearest one of the features. */
typedef struct places {
    size_t count;
    double *at;       /* rows of x y z */
    double *on;       /* rows of x y z */
    double *distance; /* between both */
    uint32_t *edge;
} places;

static void reset_places(qm_context *ctx, places *p)
{
    qm_context_free(ctx, p->at, p->count, POINT_SIZE);
    qm_context_free(ctx, p->on, p->count, POINT_SIZE);
    qm_context_free(ctx, p->distance, p->count, sizeof *p->distance);
    qm_context_free(ctx, p->edge, p->count, sizeof *p->edge);
    *p = (places){0};
}

/** Projects the points of a line onto the features, and places between them. */
static qm_status find_places(qm_context *ctx, const qm_creases *c, const double *points, size_t count,
                             double reach, places *p)
{
    double length = qm_layout_points_length(points, count), step = reach / STEPS_A_REACH;
    double longest = fmax(step, length / (double)MOST_PLACES);
    *p = (places){.count = 1};
    for (int round = 0; round < 2; round++) {
        size_t n = 0;
        if (round == 1) {
            p->at = qm_context_alloc(ctx, p->count, POINT_SIZE);
            p->on = qm_context_alloc(ctx, p->count, POINT_SIZE);
            p->distance = qm_context_alloc(ctx, p->count, sizeof *p->distance);
            p->edge = qm_context_alloc(ctx, p->count, sizeof *p->edge);
            if (!p->at || !p->on || !p->distance || !p->edge) return no_memory(ctx);
            memcpy(p->at, points, POINT_SIZE);
        }
        for (size_t i = 1; i < count; i++) {
            qm_vec a = qm_vec_load(points + 3 * i - 3), b = qm_vec_load(points + 3 * i);
            size_t parts = (size_t)qm_clamp(ceil(qm_vec_distance(a, b) / longest), 1.0, MOST_PLACES);
            for (size_t k = 1; k <= parts; k++) {
                n++;
                if (round == 1) qm_vec_store(p->at + 3 * n, qm_vec_mix(a, b, (double)k / (double)parts));
            }
        }
        p->count = n + 1;
    }
    const qm_projection into = {.distance = p->distance, .position = p->on, .face = p->edge};
    return qm_project_points(ctx, c->tree, QM_QUADS_TRIANGLES, p->at, p->count, 1, &into);
}

/** The distance from a feature's point to the nearest place of a part of a line. */
static double distance_to_part(const places *p, size_t first, size_t last, qm_vec point)
{
    double nearest = INFINITY;
    for (size_t i = first; i <= last; i++)
        nearest = fmin(nearest, qm_vec_norm2(qm_vec_sub(qm_vec_load(p->at + 3 * i), point)));
    return sqrt(nearest);
}

/* ---- ways ---- */

typedef struct way_search {
    qm_context *ctx;
    const qm_creases *creases;
    double *cost;       /* of the way to each point */
    uint32_t *previous; /* the point before it, QM_NO_INDEX at the start */
    double *off;        /* from the part of the line, in reaches; below 0: not known */
    uint32_t *touched;  /* points whose entries are not as at the start */
    size_t touched_count;
} way_search;

static qm_status open_search(qm_context *ctx, const qm_creases *c, way_search *s)
{
    size_t points = c->features.point_count;
    *s = (way_search){.ctx = ctx,
                      .creases = c,
                      .cost = qm_context_alloc(ctx, points, sizeof *s->cost),
                      .previous = qm_context_alloc(ctx, points, sizeof *s->previous),
                      .off = qm_context_alloc(ctx, points, sizeof *s->off),
                      .touched = qm_context_alloc(ctx, points, sizeof *s->touched)};
    if (!s->cost || !s->previous || !s->off || !s->touched) return no_memory(ctx);
    for (size_t i = 0; i < points; i++) {
        s->cost[i] = INFINITY;
        s->off[i] = -1.0;
    }
    return QM_OK;
}

static void close_search(way_search *s)
{
    size_t points = s->creases->features.point_count;
    qm_context_free(s->ctx, s->cost, points, sizeof *s->cost);
    qm_context_free(s->ctx, s->previous, points, sizeof *s->previous);
    qm_context_free(s->ctx, s->off, points, sizeof *s->off);
    qm_context_free(s->ctx, s->touched, points, sizeof *s->touched);
}

static void restart(way_search *s)
{
    for (size_t i = 0; i < s->touched_count; i++) {
        s->cost[s->touched[i]] = INFINITY;
        s->off[s->touched[i]] = -1.0;
    }
    s->touched_count = 0;
}

/** Offers a way to a point by another one. */
static qm_status reach_point(way_search *s, qm_heap *heap, const places *p, size_t first, size_t last,
                             double reach, uint32_t point, uint32_t previous, double before, double length)
{
    if (s->off[point] < 0.0) {
        s->off[point] = distance_to_part(p, first, last, feature_point(s->creases, point)) / reach;
        s->touched[s->touched_count++] = point;
    }
    double off = s->off[point], cost = before + length * (1.0 + OFF_COST * off * off);
    if (off > MOST_OFF || cost >= s->cost[point]) return QM_OK;
    s->cost[point] = cost;
    s->previous[point] = previous;
    return qm_heap_push(s->ctx, heap, (qm_heap_item){.key = cost, .number = point});
}

/** Finds the way between two places on features; its end is the point before the second, QM_NO_INDEX: there is none, or
 * both are on one edge. */
static qm_status find_way(way_search *s, const places *p, size_t from, size_t to, double reach, uint32_t *end)
{
    const uint32_t(*edges)[2] = (const uint32_t(*)[2])s->creases->features.edges;
    qm_heap heap = {0};
    qm_vec start = qm_vec_load(p->on + 3 * from), goal = qm_vec_load(p->on + 3 * to);
    double best = INFINITY;
    qm_status status = QM_OK;
    restart(s);
    *end = QM_NO_INDEX;
    for (int k = 0; k < 2 && status == QM_OK; k++) {
        uint32_t point = edges[p->edge[from]][k];
        status = reach_point(s, &heap, p, from, to, reach, point, QM_NO_INDEX, 0.0,
                             qm_vec_distance(start, feature_point(s->creases, point)));
    }
    while (status == QM_OK && heap.count > 0) {
        qm_heap_item item = qm_heap_pop(&heap);
        uint32_t at = item.number;
        if (item.key >= best) break;
        if (item.key > s->cost[at]) continue;
        const uint32_t *last = edges[p->edge[to]];
        double rest = qm_vec_distance(feature_point(s->creases, at), goal);
        if ((at == last[0] || at == last[1]) && item.key + rest < best) {
            best = item.key + rest;
            *end = at;
        }
        for (uint32_t k = s->creases->start[at]; k < s->creases->start[at + 1] && status == QM_OK; k++) {
            const uint32_t *edge = edges[s->creases->edge[k]];
            uint32_t next = edge[edge[0] == at];
            status =
                reach_point(s, &heap, p, from, to, reach, next, at, item.key,
                            qm_vec_distance(feature_point(s->creases, at), feature_point(s->creases, next)));
        }
    }
    qm_heap_reset(s->ctx, &heap);
    return status;
}

/** Appends a place if it differs from the last one. */
static qm_status append(qm_context *ctx, qm_section *line, qm_vec place)
{
    if (line->count > 0 && qm_vec_distance(qm_vec_load(line->points + 3 * (line->count - 1)), place) == 0.0)
        return QM_OK;
    return qm_section_add(ctx, line, place);
}

/** Appends the way between two places on features; *is_found is false if there is none that is about as long as the line. */
static qm_status append_way(way_search *s, const places *p, size_t from, size_t to, double reach,
                            qm_section *line, bool *is_found)
{
    uint32_t end = QM_NO_INDEX;
    size_t before = line->count, first;
    qm_vec start = qm_vec_load(p->on + 3 * from), goal = qm_vec_load(p->on + 3 * to);
    double drawn = 0.0, length = 0.0;
    for (size_t i = from + 1; i <= to; i++)
        drawn += qm_vec_distance(qm_vec_load(p->at + 3 * i), qm_vec_load(p->at + 3 * i - 3));
    qm_status status = p->edge[from] == p->edge[to] ? QM_OK : find_way(s, p, from, to, reach, &end);
    *is_found = status == QM_OK && (end != QM_NO_INDEX || p->edge[from] == p->edge[to]);
    if (!*is_found) return status;
    status = append(s->ctx, line, start);
    first = line->count;
    for (uint32_t at = end; at != QM_NO_INDEX && status == QM_OK; at = s->previous[at])
        status = qm_section_add(s->ctx, line, feature_point(s->creases, at));
    /* The way was followed backward. */
    for (size_t a = first, b = line->count; a + 1 < b; a++) {
        double swapped[3];
        b--;
        memcpy(swapped, line->points + 3 * a, POINT_SIZE);
        memcpy(line->points + 3 * a, line->points + 3 * b, POINT_SIZE);
        memcpy(line->points + 3 * b, swapped, POINT_SIZE);
    }
    if (status == QM_OK) status = append(s->ctx, line, goal);
    for (size_t i = before + 1; i < line->count; i++)
        length += qm_vec_distance(qm_vec_load(line->points + 3 * i), qm_vec_load(line->points + 3 * i - 3));
    *is_found = status == QM_OK && length <= MOST_DETOUR * drawn + reach;
    if (!*is_found) line->count = before;
    return status;
}

/** Appends a part of a line that is near features, on these if it runs along them, else as it is. */
static qm_status append_run(way_search *s, const places *p, size_t from, size_t to, double reach,
                            qm_section *line, bool *has_moved, bool *is_left)
{
    double length = 0.0;
    bool is_whole = from == 0 && to + 1 == p->count, is_found = true;
    bool is_closed = is_whole && memcmp(p->at, p->at + 3 * to, POINT_SIZE) == 0;
    size_t parts = is_closed ? CLOSED_PARTS : 1, before = line->count;
    qm_status status = QM_OK;
    for (size_t i = from + 1; i <= to; i++)
        length += qm_vec_distance(qm_vec_load(p->at + 3 * i), qm_vec_load(p->at + 3 * i - 3));
    if (!is_whole && length < MIN_RUN * reach) is_found = false;
    for (size_t k = 0; k < parts && is_found && status == QM_OK; k++)
        status = append_way(s, p, from + (to - from) * k / parts, from + (to - from) * (k + 1) / parts, reach,
                            line, &is_found);
    *has_moved |= is_found;
    *is_left |= !is_found;
    if (is_found || status != QM_OK) return status;
    line->count = before;
    for (size_t i = from; i <= to && status == QM_OK; i++)
        status = append(s->ctx, line, qm_vec_load(p->at + 3 * i));
    return status;
}

/** As qm_creases_snap_line, with a search that is open. */
static qm_status snap_line(way_search *s, const double *points, size_t count, double reach, qm_section *out,
                           bool *is_whole)
{
    qm_context *ctx = s->ctx;
    places p = {0};
    bool has_moved = false, is_left = false;
    *out = (qm_section){0};
    if (is_whole) *is_whole = false;
    qm_status status = find_places(ctx, s->creases, points, count, reach, &p);
    for (size_t i = 0; i < p.count && status == QM_OK;) {
        size_t last = i;
        while (last + 1 < p.count && p.distance[i] <= reach && p.distance[last + 1] <= reach)
            last++;
        if (p.distance[i] <= reach) {
            status = append_run(s, &p, i, last, reach, out, &has_moved, &is_left);
        } else {
            is_left = true;
            status = append(ctx, out, qm_vec_load(p.at + 3 * i));
        }
        i = last + 1;
    }
    reset_places(ctx, &p);
    if (is_whole) *is_whole = status == QM_OK && has_moved && !is_left;
    if (status != QM_OK || !has_moved || out->count < 2) qm_section_reset(ctx, out);
    return status;
}

qm_status qm_creases_snap_line(qm_context *ctx, const qm_creases *c, const double *points, size_t count,
                               double reach, qm_section *out, bool *is_whole)
{
    QM_ASSERT(ctx && c && points && count >= 2 && reach > 0.0 && out);
    *out = (qm_section){0};
    if (is_whole) *is_whole = false;
    if (c->features.edge_count == 0) return QM_OK;
    way_search s;
    qm_status status = open_search(ctx, c, &s);
    if (status == QM_OK) status = snap_line(&s, points, count, reach, out, is_whole);
    close_search(&s);
    return status;
}

/* ---- sharp curves ---- */

/** The place of a node of sharp curves on the features: where more than two of these meet, or one ends, if that is near
 * and the node is such a place too. False if none is near. */
static qm_status place_node(qm_context *ctx, const qm_creases *c, const double node[3], size_t sharp,
                            double reach, double out[3], bool *is_near)
{
    double distance, nearest = reach;
    uint32_t edge;
    const qm_projection into = {.distance = &distance, .position = out, .face = &edge};
    qm_status status = qm_project_points(ctx, c->tree, QM_QUADS_TRIANGLES, node, 1, 1, &into);
    *is_near = status == QM_OK && distance <= reach;
    for (uint32_t i = 0; i < c->features.point_count && *is_near && sharp != 2; i++) {
        double away = qm_vec_distance(qm_vec_load(node), feature_point(c, i));
        if (c->start[i + 1] - c->start[i] == 2 || away > nearest) continue;
        nearest = away;
        memcpy(out, c->features.points + 3 * (size_t)i, POINT_SIZE);
    }
    return status;
}

/** How far nodes and points of a curve may be off a feature. */
static double reach_of(const qm_ref_surface *surface, const qm_curve *curve)
{
    return fmin(FOLLOW_REACH * surface->diagonal, MOST_OF_LENGTH * qm_layout_curve_length(curve));
}

/** What the curves of a node want of it. */
typedef struct node_wish {
    size_t sharp; /* curves */
    double reach; /* the least of theirs */
    bool is_held, has_moved;
} node_wish;

/** Puts the nodes of sharp curves onto the features, unless they are corners or belong to a fixed curve. */
static qm_status place_nodes(qm_context *ctx, const qm_creases *c, qm_layout *layout,
                             const qm_ref_surface *surface)
{
    size_t nodes = layout->node_count;
    node_wish *wish = qm_context_alloc(ctx, nodes, sizeof *wish);
    if (!wish) return no_memory(ctx);
    for (uint32_t node = 0; node < nodes; node++)
        wish[node] = (node_wish){.reach = INFINITY, .is_held = qm_layout_is_corner(layout, node)};
    for (size_t i = 0; i < layout->curve_count; i++) {
        const qm_curve *curve = &layout->curves[i];
        double reach = reach_of(surface, curve);
        for (int k = 0; k < 2; k++) {
            node_wish *own = &wish[k == 0 ? curve->from : curve->to];
            own->is_held |= curve->mark == QM_CURVE_FIXED;
            own->sharp += curve->mark == QM_CURVE_SHARP;
            if (curve->mark == QM_CURVE_SHARP) own->reach = fmin(own->reach, reach);
        }
    }
    qm_status status = QM_OK;
    for (uint32_t node = 0; node < nodes && status == QM_OK; node++) {
        double place[3], *at = layout->nodes + 3 * (size_t)node;
        node_wish *own = &wish[node];
        if (own->sharp == 0 || own->is_held || !(own->reach > 0.0)) continue;
        status = place_node(ctx, c, at, own->sharp, own->reach, place, &own->has_moved);
        if (status == QM_OK && own->has_moved) memcpy(at, place, POINT_SIZE);
    }
    for (size_t i = 0; i < layout->curve_count && status == QM_OK; i++) {
        qm_curve *curve = &layout->curves[i];
        if (wish[curve->from].has_moved)
            memcpy(curve->points, layout->nodes + 3 * (size_t)curve->from, POINT_SIZE);
        if (wish[curve->to].has_moved)
            memcpy(curve->points + 3 * (curve->point_count - 1), layout->nodes + 3 * (size_t)curve->to,
                   POINT_SIZE);
    }
    qm_context_free(ctx, wish, nodes, sizeof *wish);
    return status;
}

/** Lets a line begin and end at the nodes of its curve. Points that are nearly at these go: what is left of the line there would seem
 * to cross other curves of the node. */
static void join_nodes(const qm_layout *layout, const qm_curve *curve, double near, qm_section *line)
{
    const double *from = layout->nodes + 3 * (size_t)curve->from, *to = layout->nodes + 3 * (size_t)curve->to;
    size_t count = 1, last = line->count - 1;
    memcpy(line->points, from, POINT_SIZE);
    for (size_t i = 1; i < last; i++) {
        qm_vec p = qm_vec_load(line->points + 3 * i);
        if (qm_vec_distance(p, qm_vec_load(from)) > near && qm_vec_distance(p, qm_vec_load(to)) > near)
            qm_vec_store(line->points + 3 * count++, p);
    }
    memcpy(line->points + 3 * count, to, POINT_SIZE);
    line->count = count + 1;
}

qm_status qm_creases_follow(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                            qm_creases *out)
{
    QM_ASSERT(ctx && layout && surface && out);
    *out = (qm_creases){0};
    bool has_sharp = false;
    for (size_t i = 0; i < layout->curve_count; i++)
        has_sharp |= layout->curves[i].mark == QM_CURVE_SHARP;
    if (!has_sharp || surface->is_cloud) return QM_OK;
    qm_status status = qm_creases_find(ctx, surface, 0.0, NULL, out);
    if (status != QM_OK || out->features.edge_count == 0) return status;
    way_search search;
    status = open_search(ctx, out, &search);
    if (status == QM_OK) status = place_nodes(ctx, out, layout, surface);
    for (size_t i = 0; i < layout->curve_count && status == QM_OK; i++) {
        qm_curve *curve = &layout->curves[i];
        double reach = reach_of(surface, curve);
        qm_section line;
        if (curve->mark != QM_CURVE_SHARP || !(reach > 0.0)) continue;
        status = snap_line(&search, curve->points, curve->point_count, reach, &line, NULL);
        if (status != QM_OK || line.count < 2) continue;
        join_nodes(layout, curve, ON_CREASE * surface->diagonal, &line);
        status = qm_layout_set_points(ctx, curve, line.points, line.count);
        qm_section_reset(ctx, &line);
    }
    close_search(&search);
    if (status != QM_OK) qm_creases_reset(ctx, out);
    return status;
}

/** The sharp curves of a node, and the directions of the first two of them. */
typedef struct sharp_star {
    size_t count;
    qm_vec way[2];
} sharp_star;

static qm_status set_corners(qm_context *ctx, qm_layout *layout)
{
    sharp_star *stars = qm_context_alloc(ctx, layout->node_count, sizeof *stars);
    if (!stars) return no_memory(ctx);
    memset(stars, 0, layout->node_count * sizeof *stars);
    for (size_t i = 0; i < layout->curve_count; i++) {
        const qm_curve *curve = &layout->curves[i];
        for (int k = 0; k < 2 && curve->mark == QM_CURVE_SHARP; k++) {
            sharp_star *star = &stars[k == 0 ? curve->from : curve->to];
            const double *end = curve->points + (k == 0 ? 0 : 3 * (curve->point_count - 1));
            qm_vec next = qm_vec_load(k == 0 ? end + 3 : end - 3);
            if (star->count < 2) star->way[star->count] = qm_vec_sub(next, qm_vec_load(end));
            star->count++;
        }
    }
    qm_status status = QM_OK;
    for (uint32_t node = 0; node < layout->node_count && status == QM_OK; node++) {
        const sharp_star *star = &stars[node];
        double lengths = qm_vec_norm(star->way[0]) * qm_vec_norm(star->way[1]);
        bool is_bent = star->count == 2 && qm_vec_dot(star->way[0], star->way[1]) > BENT_COSINE * lengths;
        if (star->count > 0 && (star->count != 2 || is_bent))
            status = qm_layout_set_corner(ctx, layout, node, true);
    }
    qm_context_free(ctx, stars, layout->node_count, sizeof *stars);
    return status;
}

/** Makes sharp curves smooth that cross others, or that end where curves do that cross. False if there are none. */
static bool let_go(qm_layout *layout, const qm_layout_issues *issues)
{
    bool has_changed = false;
    for (int at_nodes = 0; at_nodes < 2 && !has_changed; at_nodes++)
        for (size_t i = 0; i < 2 * issues->count; i++) {
            uint32_t index = qm_layout_find_curve(layout, issues->items[i / 2].curve[i % 2]);
            if (index == QM_NO_INDEX) continue;
            const qm_curve *crossed = &layout->curves[index];
            for (size_t k = 0; k < layout->curve_count; k++) {
                qm_curve *curve = &layout->curves[k];
                bool is_met = at_nodes && (curve->from == crossed->from || curve->from == crossed->to ||
                                           curve->to == crossed->from || curve->to == crossed->to);
                if (curve->mark != QM_CURVE_SHARP || (k != index && !is_met)) continue;
                curve->mark = QM_CURVE_SMOOTH;
                has_changed = true;
            }
        }
    return has_changed;
}

qm_status qm_creases_settle_curves(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                                   qm_layout_issues *issues)
{
    QM_ASSERT(ctx && layout && surface && issues);
    size_t before = issues->count;
    for (bool is_done = surface->is_cloud; !is_done;) {
        qm_layout moved;
        qm_layout_issues now = {0};
        qm_creases creases;
        qm_status status = qm_layout_copy(ctx, layout, &moved);
        if (status == QM_OK) status = qm_creases_follow(ctx, &moved, surface, &creases);
        if (status == QM_OK) {
            qm_creases_reset(ctx, &creases);
            status = set_corners(ctx, &moved);
        }
        if (status == QM_OK) status = qm_layout_find_crossings(ctx, &moved, surface, &now);
        is_done = status == QM_OK && (now.count <= before || !let_go(layout, &now));
        if (is_done && now.count <= before) {
            qm_layout_reset(ctx, layout);
            qm_layout_issues_reset(ctx, issues);
            *layout = moved;
            *issues = now;
        } else {
            qm_layout_reset(ctx, &moved);
            qm_layout_issues_reset(ctx, &now);
        }
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

qm_status qm_creases_step_across(qm_context *ctx, const qm_creases *c, double diagonal, const double *points,
                                 size_t count, double *across)
{
    QM_ASSERT(ctx && c && points && count >= 2 && across);
    memset(across, 0, count * POINT_SIZE);
    if (c->features.edge_count == 0) return QM_OK;
    /* Ends may lie where several creases meet: a little inside, the edge is the line's own. */
    double *inside = qm_context_alloc(ctx, count, POINT_SIZE);
    double *distance = qm_context_alloc(ctx, count, sizeof *distance);
    uint32_t *edge = qm_context_alloc(ctx, count, sizeof *edge);
    qm_status status = inside && distance && edge ? QM_OK : no_memory(ctx);
    if (status == QM_OK) {
        const qm_projection into = {.distance = distance, .face = edge};
        memcpy(inside, points, count * POINT_SIZE);
        qm_vec_store(inside, qm_vec_mix(qm_vec_load(points), qm_vec_load(points + 3), INSIDE));
        qm_vec_store(inside + 3 * (count - 1), qm_vec_mix(qm_vec_load(points + 3 * (count - 1)),
                                                          qm_vec_load(points + 3 * (count - 2)), INSIDE));
        status = qm_project_points(ctx, c->tree, QM_QUADS_TRIANGLES, inside, count, 1, &into);
    }
    for (size_t i = 0; i < count && status == QM_OK; i++) {
        if (distance[i] > ON_CREASE * diagonal) continue;
        const uint32_t *end = c->features.edges[edge[i]];
        size_t before = i > 0 ? i - 1 : 0, after = i + 1 < count ? i + 1 : i;
        qm_vec way = qm_vec_sub(qm_vec_load(points + 3 * after), qm_vec_load(points + 3 * before));
        double along = qm_vec_dot(way, qm_vec_sub(feature_point(c, end[1]), feature_point(c, end[0])));
        for (int k = 0; k < 3; k++)
            across[3 * i + (size_t)k] = (along < 0.0 ? -1.0 : 1.0) * c->features.across[edge[i]][k];
    }
    qm_context_free(ctx, inside, count, POINT_SIZE);
    qm_context_free(ctx, distance, count, sizeof *distance);
    qm_context_free(ctx, edge, count, sizeof *edge);
    return status;
}

/* ---- strokes ---- */

/** Moves an end of a line onto the nearest feature within the reach. */
static qm_status snap_end(qm_context *ctx, const qm_creases *c, double *end, double reach)
{
    double place[3], distance;
    const qm_projection into = {.distance = &distance, .position = place};
    qm_status status = qm_project_points(ctx, c->tree, QM_QUADS_TRIANGLES, end, 1, 1, &into);
    if (status == QM_OK && distance <= reach) memcpy(end, place, POINT_SIZE);
    return status;
}

/** Puts a stroke onto features; *line is empty where it is near none. */
static qm_status snap_stroke(qm_context *ctx, const qm_ref_surface *surface, const double *points,
                             size_t count, double angle, double reach, qm_section *line, bool *is_whole)
{
    double box[6];
    qm_creases c;
    for (size_t k = 0; k < 3; k++) {
        box[k] = INFINITY;
        box[3 + k] = -INFINITY;
        for (size_t i = 0; i < count; i++) {
            box[k] = fmin(box[k], points[3 * i + k]);
            box[3 + k] = fmax(box[3 + k], points[3 * i + k]);
        }
        box[k] -= MOST_OFF * reach;
        box[3 + k] += MOST_OFF * reach;
    }
    *line = (qm_section){0};
    *is_whole = false;
    qm_status status = qm_creases_find(ctx, surface, angle, box, &c);
    if (status != QM_OK || c.features.edge_count == 0) return status;
    status = qm_creases_snap_line(ctx, &c, points, count, reach, line, is_whole);
    bool is_off = line->count == 0;
    for (size_t i = 0; i < count && status == QM_OK && is_off; i++)
        status = qm_section_add(ctx, line, qm_vec_load(points + 3 * i));
    if (status == QM_OK) status = snap_end(ctx, &c, line->points, reach);
    if (status == QM_OK) status = snap_end(ctx, &c, line->points + 3 * (line->count - 1), reach);
    qm_creases_reset(ctx, &c);
    return status;
}

qm_status qm_layout_add_snapped_stroke(qm_context *ctx, qm_layout *layout, const qm_ref_surface *surface,
                                       const double *points, size_t count, double radius, double angle,
                                       double reach, uint32_t *id)
{
    QM_ASSERT(ctx && layout && surface && points && id);
    if (count < 2)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "a stroke has two points or more, got %zu", count);
    if (!(reach > 0.0) || !(angle > 0.0) || angle > 180.0)
        return qm_context_fail(
            ctx, QM_E_ARGUMENT,
            "the angle of creases must be above 0, and 180 at most, and their reach above 0");
    qm_section line;
    bool is_whole;
    qm_status status = snap_stroke(ctx, surface, points, count, angle, reach, &line, &is_whole);
    bool is_snapped = line.count >= 2;
    if (status == QM_OK)
        status = qm_layout_add_marked_stroke(ctx, layout, surface, is_snapped ? line.points : points,
                                             is_snapped ? line.count : count, radius,
                                             is_whole ? QM_CURVE_SHARP : QM_CURVE_SMOOTH, id);
    qm_section_reset(ctx, &line);
    return status;
}
