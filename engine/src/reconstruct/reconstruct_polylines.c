/**
 * reconstruct_polylines.c: layout curves as fine polylines on the surface, and the vertices that the lattices
 * of both sides share, at equal arc length, but nearer to one another where the curve turns.
 *
 * A drawn curve is resampled and each point is projected onto the surface. Two faults are repaired. A curve
 * that runs through a thin wall or over a gap between two protrusions jumps from one layer of the surface to
 * another: it is rerouted along a shortest path over samples. Where points are few or noisy, neighbours may
 * be projected past each other: such reversals are smoothed out.
 */
#include "reconstruct_internal.h"

#include <string.h>

#include "core/heap.h"

#define FINE_EDGES 64        /* segments of a fine polyline at least */
#define STRAIGHTEN_ROUNDS 30 /* of smoothing; reversals that are left then stay */
#define JUMP 2.5             /* a longer segment, in mean segments of its polyline, is a jump */
#define MAX_PATH 20.0        /* lengths of a jump: a longer path is not taken */
#define SMOOTH_ROUNDS 6      /* of a path over samples */
#define CREASE_REACH                                                                                         \
    0.0625              /* of a curve's length: how far it may have been drawn off a sharp edge of points */
#define MAX_REROUTES 4  /* of a curve */
#define HALF_EDGE 4     /* cells in which the turns of a curve are summed up: those of half an edge */
#define TURN_WEIGHT 1.5 /* of a turn by a radian: such a part counts as 2.5 times as long */

enum { POINT_SIZE = 3 * sizeof(double) };

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the curves");
}

/**
 * Projects a point of a curve of some length onto the surface, unless the surface is so far away that it may have a hole
 * there.
 */
static void project_point(const qm_reconstruction *r, qm_curve_mark mark, double length, double p[3])
{
    if (!r->options.pull_curves || mark == QM_CURVE_FIXED) return;
    qm_ref_surface_point projection;
    if (r->has_sides)
        qm_ref_surface_project_curve(&r->surface, p, CREASE_REACH * length, &projection);
    else
        qm_ref_surface_project(&r->surface, p, &projection);
    if (projection.distance <= qm_reconstruction_cover_distance(r))
        memcpy(p, projection.position, POINT_SIZE);
}

/**
 * The point of a polyline at an arc length in segment *at or a later one, which *at becomes. Ends are exact.
 */
static qm_vec point_along(const double *points, const double *arc, size_t count, double length, size_t *at)
{
    while (*at + 2 < count && arc[*at + 1] < length)
        ++*at;
    double segment = arc[*at + 1] - arc[*at];
    double t = segment > 0.0 ? qm_clamp((length - arc[*at]) / segment, 0.0, 1.0) : 0.0;
    return qm_vec_mix(qm_vec_load(points + 3 * *at), qm_vec_load(points + 3 * *at + 3), t);
}

/** Sets the arc length up to each point. */
static void set_arc(const double *points, size_t count, double *arc)
{
    arc[0] = 0.0;
    for (size_t i = 1; i < count; i++)
        arc[i] = arc[i - 1] + qm_vec_distance(qm_vec_load(points + 3 * i - 3), qm_vec_load(points + 3 * i));
}

/** The edge that ends at point i. */
static qm_vec edge_to(const double *points, size_t i)
{
    return qm_vec_sub(qm_vec_load(points + 3 * i), qm_vec_load(points + 3 * i - 3));
}

/** True if two edges enclose more than a right angle. */
static bool are_opposed(const double *points, size_t a, size_t b)
{
    return qm_vec_dot(edge_to(points, a), edge_to(points, b)) < 0.0;
}

/**
 * True if a polyline reverses at an inner point and soon runs on as before. A curve round the edge of a thin
 * sheet reverses too, but does not run on as before.
 */
static bool is_reversal(const double *points, size_t last, size_t i)
{
    if (!are_opposed(points, i, i + 1)) return false;
    bool has_before = i > 1, has_after = i + 2 <= last;
    return (has_before && !are_opposed(points, i - 1, i + 1)) ||
           (has_after && !are_opposed(points, i, i + 2)) ||
           (has_before && has_after && !are_opposed(points, i - 1, i + 2));
}

/**
 * Moves the inner points at reversals to the midpoint of their neighbours, on the surface or not: reversals
 * of a border would invert quads. True if a point has moved.
 */
static bool straighten(double *points, size_t last)
{
    bool changed = false, is_moving = true;
    for (int round = 0; round < STRAIGHTEN_ROUNDS && is_moving; round++) {
        is_moving = false;
        for (size_t i = 1; i < last; i++) {
            double *p = points + 3 * i;
            if (!is_reversal(points, last, i)) continue;
            qm_vec_store(p, qm_vec_mix(qm_vec_load(p - 3), qm_vec_load(p + 3), 0.5));
            changed = is_moving = true;
        }
    }
    return changed;
}

void qm_polylines_straighten(qm_reconstruction *r)
{
    for (size_t i = 0; i < r->layout.curve_count && r->options.pull_curves; i++) {
        qm_polyline *polyline = &r->polylines[i];
        if (r->layout.curves[i].mark == QM_CURVE_SMOOTH &&
            straighten(polyline->points, polyline->point_count - 1))
            set_arc(polyline->points, polyline->point_count, polyline->arc);
    }
}

/** Ends at corners stay where these are: all curves there share that place. */
static void hold_ends(const qm_reconstruction *r, const qm_curve *curve, qm_polyline *polyline)
{
    if (qm_layout_is_corner(&r->layout, curve->from))
        memcpy(polyline->points, r->layout.nodes + 3 * (size_t)curve->from, POINT_SIZE);
    if (qm_layout_is_corner(&r->layout, curve->to))
        memcpy(polyline->points + 3 * (polyline->point_count - 1), r->layout.nodes + 3 * (size_t)curve->to,
               POINT_SIZE);
}

/** Sets the fine points of a polyline: at equal arc length along given points, then projected. */
static qm_status resample(qm_context *ctx, const qm_reconstruction *r, const qm_curve *curve,
                          const double *points, size_t count, qm_polyline *out)
{
    QM_ASSERT(count >= 2 && out->point_count >= 2);
    double *arc = qm_context_alloc(ctx, count, sizeof *arc);
    if (!arc) return no_memory(ctx);
    set_arc(points, count, arc);
    size_t at = 0, last = out->point_count - 1;
    for (size_t i = 0; i <= last; i++) {
        double length = arc[count - 1] * ((double)i / (double)last);
        qm_vec_store(out->points + 3 * i, i == last ? qm_vec_load(points + 3 * (count - 1))
                                                    : point_along(points, arc, count, length, &at));
        project_point(r, QM_CURVE_SMOOTH, arc[count - 1], out->points + 3 * i);
    }
    hold_ends(r, curve, out);
    set_arc(out->points, out->point_count, out->arc);
    qm_context_free(ctx, arc, count, sizeof *arc);
    return QM_OK;
}

/** The segments that one of a curve becomes, so that it has fine ones throughout. */
static size_t count_parts(const qm_curve *curve, double length, size_t segment)
{
    double share = qm_vec_norm(edge_to(curve->points, segment + 1)) / length;
    return share > 0.0 ? (size_t)ceil(share * FINE_EDGES) : 1;
}

/** Makes the polyline of a marked curve: its own points, and places between them. */
static qm_status keep_points(qm_context *ctx, const qm_reconstruction *r, const qm_curve *curve,
                             qm_polyline *out)
{
    double length = qm_layout_curve_length(curve);
    out->point_count = 1;
    for (size_t i = 0; i + 1 < curve->point_count; i++)
        out->point_count += count_parts(curve, length, i);
    out->points = qm_context_alloc(ctx, out->point_count, POINT_SIZE);
    out->arc = qm_context_alloc(ctx, out->point_count, sizeof *out->arc);
    if (!out->points || !out->arc) return no_memory(ctx);
    size_t at = 0;
    qm_vec_store(out->points, qm_vec_load(curve->points));
    for (size_t i = 0; i + 1 < curve->point_count; i++) {
        qm_vec a = qm_vec_load(curve->points + 3 * i), b = qm_vec_load(curve->points + 3 * i + 3);
        size_t parts = count_parts(curve, length, i);
        for (size_t k = 1; k <= parts; k++)
            qm_vec_store(out->points + 3 * ++at,
                         k == parts ? b : qm_vec_mix(a, b, (double)k / (double)parts));
    }
    QM_ASSERT(at + 1 == out->point_count);
    for (size_t i = 0; i <= at; i++)
        project_point(r, curve->mark, length, out->points + 3 * i);
    hold_ends(r, curve, out);
    set_arc(out->points, out->point_count, out->arc);
    return QM_OK;
}

qm_status qm_polylines_create(qm_context *ctx, qm_reconstruction *r)
{
    for (size_t i = 0; i < r->layout.curve_count; i++) {
        const qm_curve *curve = &r->layout.curves[i];
        qm_polyline *polyline = &r->polylines[i];
        if (curve->mark != QM_CURVE_SMOOTH) {
            qm_status status = keep_points(ctx, r, curve, polyline);
            if (status != QM_OK) return status;
            continue;
        }
        size_t count = 2 * (curve->point_count - 1);
        polyline->point_count = (count < FINE_EDGES ? FINE_EDGES : count) + 1;
        polyline->points = qm_context_alloc(ctx, polyline->point_count, POINT_SIZE);
        polyline->arc = qm_context_alloc(ctx, polyline->point_count, sizeof *polyline->arc);
        if (!polyline->points || !polyline->arc) return no_memory(ctx);
        qm_status status = resample(ctx, r, curve, curve->points, curve->point_count, polyline);
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

void qm_polyline_at(const qm_polyline *polyline, double fraction, double position[3], qm_vec *tangent)
{
    size_t at = 0, last = polyline->point_count - 1;
    double length = fraction * polyline->arc[last];
    qm_vec_store(position, point_along(polyline->points, polyline->arc, polyline->point_count, length, &at));
    qm_vec edge =
        qm_vec_sub(qm_vec_load(polyline->points + 3 * at + 3), qm_vec_load(polyline->points + 3 * at));
    double norm = qm_vec_norm(edge);
    *tangent = norm > 0.0 ? qm_vec_scale(1.0 / norm, edge) : edge;
}

/** The angle between the chords of a reach before and after a length; at: the segments where the last places were. */
static double turn_at(const qm_polyline *polyline, double length, double reach, size_t at[3])
{
    qm_vec place[3];
    for (int k = 0; k < 3; k++) {
        double wanted = qm_clamp(length + (k - 1) * reach, 0.0, polyline->arc[polyline->point_count - 1]);
        place[k] = point_along(polyline->points, polyline->arc, polyline->point_count, wanted, &at[k]);
    }
    return qm_vec_angle(qm_vec_sub(place[1], place[0]), qm_vec_sub(place[2], place[1]));
}

/**
 * Sets lengths[0..edges] up to the vertices of a polyline: equally far apart, but nearer to one another where it turns within an
 * edge, by a weight. Edges of equal length would cut off the rim of an ear. Turns are means over an edge, or neighbours of a short edge
 * would be long.
 */
static qm_status divide(qm_context *ctx, const qm_polyline *polyline, uint32_t edges, double weight,
                        double *lengths)
{
    size_t cells = 2 * (size_t)HALF_EDGE * edges, at[3] = {0, 0, 0};
    double *density = qm_context_alloc(ctx, cells, sizeof *density);
    double *sum = qm_context_alloc(ctx, cells + 1, sizeof *sum);
    qm_status status = density && sum ? QM_OK : no_memory(ctx);
    double total = polyline->arc[polyline->point_count - 1];
    for (size_t c = 0; c < cells && status == QM_OK; c++) {
        double length = total * (((double)c + 0.5) / (double)cells);
        density[c] = 1.0 + weight * turn_at(polyline, length, 0.5 * total / edges, at);
    }
    for (size_t c = 0; c < cells && status == QM_OK; c++) {
        size_t low = c < HALF_EDGE ? 0 : c - HALF_EDGE,
               high = c + HALF_EDGE < cells ? c + HALF_EDGE : cells - 1;
        double mean = 0.0;
        for (size_t k = low; k <= high; k++)
            mean += density[k] / (double)(high - low + 1);
        sum[c + 1] = (c == 0 ? 0.0 : sum[c]) + mean;
    }
    if (status == QM_OK) sum[0] = 0.0;
    size_t c = 0;
    for (uint32_t i = 1; i < edges && status == QM_OK; i++) {
        double wanted = sum[cells] * ((double)i / edges);
        while (c + 1 < cells && sum[c + 1] < wanted)
            c++;
        lengths[i] = total * (((double)c + (wanted - sum[c]) / (sum[c + 1] - sum[c])) / (double)cells);
    }
    lengths[0] = 0.0;
    lengths[edges] = total;
    qm_context_free(ctx, density, cells, sizeof *density);
    qm_context_free(ctx, sum, cells + 1, sizeof *sum);
    return status;
}

/** Sets the vertices of a polyline. They are projected again, as there may be more of them than fine points. */
static qm_status set_vertices(qm_context *ctx, const qm_reconstruction *r, qm_curve_mark mark,
                              qm_polyline *polyline, uint32_t edges)
{
    double *vertices = qm_context_alloc(ctx, (size_t)edges + 1, POINT_SIZE);
    double *lengths = qm_context_alloc(ctx, (size_t)edges + 1, sizeof *lengths);
    /* Grids have their vertices at equal arc length; curves over noise, or over few points, turn everywhere. */
    bool has_turns = !r->options.grids && !r->surface.is_cloud && !r->guide;
    double weight = has_turns ? TURN_WEIGHT : 0.0;
    qm_status status = vertices && lengths ? divide(ctx, polyline, edges, weight, lengths) : no_memory(ctx);
    size_t at = 0, last = polyline->point_count - 1;
    for (uint32_t i = 1; i < edges && status == QM_OK; i++) {
        qm_vec_store(vertices + 3 * (size_t)i,
                     point_along(polyline->points, polyline->arc, polyline->point_count, lengths[i], &at));
        project_point(r, mark, polyline->arc[last], vertices + 3 * (size_t)i);
    }
    qm_context_free(ctx, lengths, (size_t)edges + 1, sizeof *lengths);
    if (status != QM_OK) {
        qm_context_free(ctx, vertices, (size_t)edges + 1, POINT_SIZE);
        return status;
    }
    memcpy(vertices, polyline->points, POINT_SIZE);
    memcpy(vertices + 3 * (size_t)edges, polyline->points + 3 * last, POINT_SIZE);
    if (r->options.pull_curves && mark == QM_CURVE_SMOOTH) straighten(vertices, edges);
    qm_context_free(ctx, polyline->vertices, (size_t)polyline->vertex_edges + 1, POINT_SIZE);
    qm_context_free(ctx, polyline->across, (size_t)polyline->vertex_edges + 1, POINT_SIZE);
    polyline->vertices = vertices;
    polyline->vertex_edges = edges;
    polyline->across = NULL;
    if (mark != QM_CURVE_SHARP || r->creases.features.edge_count == 0) return QM_OK;
    polyline->across = qm_context_alloc(ctx, (size_t)edges + 1, POINT_SIZE);
    if (!polyline->across) return no_memory(ctx);
    return qm_creases_step_across(ctx, &r->creases, r->surface.diagonal, vertices, (size_t)edges + 1,
                                  polyline->across);
}

qm_status qm_polylines_set_vertices(qm_context *ctx, qm_reconstruction *r)
{
    for (size_t i = 0; i < r->layout.curve_count; i++) {
        qm_polyline *polyline = &r->polylines[i];
        if (polyline->chord == QM_NO_INDEX ||
            r->chords[polyline->chord].lattice_edges == polyline->vertex_edges)
            continue;
        qm_status status = set_vertices(ctx, r, r->layout.curves[i].mark, polyline,
                                        r->chords[polyline->chord].lattice_edges);
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

/*
 * Rerouting of jumps.
 */

/** Samples of the surface, and shortest paths over them from one sample. */
typedef struct path_search {
    qm_context *ctx;
    qm_reconstruction *r;
    qm_samples samples;
    qm_knn_graph graph;
    double *length;     /* of the path to each sample */
    uint32_t *previous; /* the sample before it on that path */
} path_search;

static qm_vec point_at(const double *points, size_t i)
{
    return qm_vec_load(points + 3 * i);
}

/** The end of the longest segment if that is a jump, else 0. */
static size_t find_jump(const qm_polyline *polyline)
{
    size_t jump = 0, last = polyline->point_count - 1;
    double longest = JUMP * polyline->arc[last] / (double)last;
    for (size_t i = 1; i <= last; i++) {
        double length = polyline->arc[i] - polyline->arc[i - 1];
        if (length <= longest) continue;
        longest = length;
        jump = i;
    }
    return jump;
}

static uint32_t nearest_sample(const path_search *s, qm_vec p)
{
    uint32_t best = 0;
    double min_distance2 = INFINITY;
    for (size_t i = 0; i < s->samples.count; i++) {
        double distance2 = qm_vec_norm2(qm_vec_sub(point_at(s->samples.positions, i), p));
        if (distance2 >= min_distance2) continue;
        min_distance2 = distance2;
        best = (uint32_t)i;
    }
    return best;
}

/** Shortest paths from a sample (Dijkstra), up to a length or until `to` is reached. */
static qm_status find_paths(path_search *s, uint32_t from, uint32_t to, double max_length)
{
    qm_heap heap = {0};
    for (size_t i = 0; i < s->samples.count; i++)
        s->length[i] = INFINITY;
    s->length[from] = 0.0;
    qm_status status = qm_heap_push(s->ctx, &heap, (qm_heap_item){.number = from});
    while (status == QM_OK && heap.count > 0) {
        qm_heap_item item = qm_heap_pop(&heap);
        QM_ASSERT(item.number < s->samples.count);
        if (item.key > s->length[item.number]) continue;
        if (item.number == to || item.key > max_length) break;
        for (int k = 0; k < QM_KNN_MAX_LINKS && status == QM_OK; k++) {
            uint32_t next = s->graph.link[item.number][k];
            if (next == QM_NO_INDEX) break;
            double length = item.key + qm_vec_distance(point_at(s->samples.positions, item.number),
                                                       point_at(s->samples.positions, next));
            if (length >= s->length[next]) continue;
            s->length[next] = length;
            s->previous[next] = item.number;
            status = qm_heap_push(s->ctx, &heap, (qm_heap_item){.key = length, .number = next});
        }
    }
    qm_heap_reset(s->ctx, &heap);
    return status;
}

/** Smooths the inner points of a path within the surface. */
static void smooth(const qm_reconstruction *r, double *points, size_t count)
{
    for (int round = 0; round < SMOOTH_ROUNDS; round++) {
        for (size_t i = 1; i + 1 < count; i++) {
            qm_vec neighbours = qm_vec_add(point_at(points, i - 1), point_at(points, i + 1));
            double mean[3];
            qm_ref_surface_point projection;
            qm_vec_store(mean, qm_vec_scale(0.25, qm_vec_axpy(neighbours, 2.0, point_at(points, i))));
            qm_ref_surface_project(&r->surface, mean, &projection);
            memcpy(points + 3 * i, projection.position, POINT_SIZE);
        }
    }
}

/** Inserts the path between two samples before fine point `at`, and resamples the polyline. */
static qm_status insert_path(path_search *s, const qm_curve *curve, qm_polyline *polyline, size_t at,
                             uint32_t from, uint32_t to)
{
    QM_ASSERT(at > 0 && at < polyline->point_count);
    size_t path_count = 1;
    for (uint32_t i = to; i != from; i = s->previous[i])
        path_count++;
    size_t count = polyline->point_count + path_count;
    double *points = qm_context_alloc(s->ctx, count, POINT_SIZE);
    if (!points) return no_memory(s->ctx);
    memcpy(points, polyline->points, at * POINT_SIZE);
    memcpy(points + 3 * (at + path_count), polyline->points + 3 * at,
           (polyline->point_count - at) * POINT_SIZE);
    uint32_t i = to;
    for (size_t k = at + path_count; k-- > at; i = s->previous[i])
        memcpy(points + 3 * k, s->samples.positions + 3 * (size_t)i, POINT_SIZE);
    smooth(s->r, points + 3 * (at - 1), path_count + 2);
    qm_status status = resample(s->ctx, s->r, curve, points, count, polyline);
    qm_context_free(s->ctx, points, count, POINT_SIZE);
    return status;
}

/** Reroutes the jumps of a polyline, the longest first, up to one without a path. */
static qm_status reroute(path_search *s, const qm_curve *curve, qm_polyline *polyline)
{
    qm_status status = QM_OK;
    for (int count = 0; count < MAX_REROUTES && status == QM_OK; count++) {
        size_t at = find_jump(polyline);
        if (at == 0) return QM_OK;
        qm_vec start = point_at(polyline->points, at - 1), end = point_at(polyline->points, at);
        uint32_t from = nearest_sample(s, start), to = nearest_sample(s, end);
        status = find_paths(s, from, to, MAX_PATH * qm_vec_distance(start, end));
        if (status != QM_OK || from == to || s->length[to] == INFINITY) return status;
        status = insert_path(s, curve, polyline, at, from, to);
    }
    return status;
}

/** Marked curves lie where they were drawn. */
static bool may_jump(const qm_reconstruction *r, size_t curve)
{
    return r->layout.curves[curve].mark == QM_CURVE_SMOOTH;
}

bool qm_polylines_has_jump(const qm_reconstruction *r, size_t curve)
{
    return r->options.pull_curves && may_jump(r, curve) && find_jump(&r->polylines[curve]) > 0;
}

qm_status qm_polylines_follow(qm_context *ctx, qm_reconstruction *r, size_t curve, const double *points,
                              size_t count)
{
    return resample(ctx, r, &r->layout.curves[curve], points, count, &r->polylines[curve]);
}

qm_status qm_polylines_reroute(qm_context *ctx, qm_reconstruction *r, size_t sample_count)
{
    bool has_jumps = false;
    for (size_t i = 0; i < r->layout.curve_count; i++)
        has_jumps |= qm_polylines_has_jump(r, i);
    if (!has_jumps) return QM_OK;
    path_search s = {.ctx = ctx, .r = r};
    qm_status status = qm_samples_create(ctx, r, sample_count, &s.samples);
    if (status != QM_OK) return status;
    size_t count = s.samples.count;
    s.length = qm_context_alloc(ctx, count, sizeof *s.length);
    s.previous = qm_context_alloc(ctx, count, sizeof *s.previous);
    status = s.length && s.previous ? QM_OK : no_memory(ctx);
    if (status == QM_OK) status = qm_knn_graph_build(ctx, s.samples.positions, count, NULL, &s.graph);
    for (size_t i = 0; i < r->layout.curve_count && status == QM_OK; i++)
        if (qm_polylines_has_jump(r, i)) status = reroute(&s, &r->layout.curves[i], &r->polylines[i]);
    qm_knn_graph_reset(ctx, &s.graph);
    qm_context_free(ctx, s.length, count, sizeof *s.length);
    qm_context_free(ctx, s.previous, count, sizeof *s.previous);
    qm_samples_reset(ctx, &s.samples);
    return status;
}
