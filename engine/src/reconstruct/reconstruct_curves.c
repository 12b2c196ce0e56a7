#include "reconstruct_work.h"

#include <string.h>

#define FINE_EDGES 64        /* pieces of the fine polyline at least */
#define STRAIGHTEN_ROUNDS 30 /* of evening out; what strays then is left */

enum { ROW = 3 * sizeof(double) };

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the curves");
}

/** Pulls a point of a curve onto the surface, unless that is so far away that there may be a hole. */
static void pull(const qm_reconstruction *r, double p[3])
{
    if (!r->options.pull_curves) return;
    qm_foothold foot;
    qm_source_pull(&r->source, p, &foot);
    if (foot.distance <= qm_reconstruction_reach(r)) memcpy(p, foot.position, ROW);
}

/** Point of a polyline at a length along it, which lies in piece *at or later; ends are exact. */
static qm_vec point_along(const double *points, const double *arc, size_t count, double length, size_t *at)
{
    while (*at + 2 < count && arc[*at + 1] < length)
        ++*at;
    double piece = arc[*at + 1] - arc[*at];
    double t = piece > 0.0 ? qm_clamp((length - arc[*at]) / piece, 0.0, 1.0) : 0.0;
    return qm_vec_mix(qm_vec_load(points + 3 * *at), qm_vec_load(points + 3 * *at + 3), t);
}

static void set_arc(const double *points, size_t count, double *arc)
{
    arc[0] = 0.0;
    for (size_t i = 1; i < count; i++)
        arc[i] = arc[i - 1] + qm_vec_distance(qm_vec_load(points + 3 * i - 3), qm_vec_load(points + 3 * i));
}

/** Edge i of a chain leads to point i. */
static qm_vec edge_to(const double *points, size_t i)
{
    return qm_vec_sub(qm_vec_load(points + 3 * i), qm_vec_load(points + 3 * i - 3));
}

static bool go_apart(const double *points, size_t a, size_t b)
{
    return qm_vec_dot(edge_to(points, a), edge_to(points, b)) < 0.0;
}

/** True when a chain turns back at an inner point and goes on as before soon: round the rim of a sheet it
 * does not. */
static bool strays(const double *points, size_t last, size_t i)
{
    if (!go_apart(points, i, i + 1)) return false;
    bool has_before = i > 1, has_after = i + 2 <= last;
    return (has_before && !go_apart(points, i - 1, i + 1)) || (has_after && !go_apart(points, i, i + 2)) ||
           (has_before && has_after && !go_apart(points, i - 1, i + 2));
}

/**
 * Where points are few or noisy, neighbours of a chain may be pulled past each other, which would turn quads
 * upside down: there they go to the middle of those beside them, on the surface or not. The ends stay.
 */
static bool straighten(double *points, size_t last)
{
    bool changed = false, goes_on = true;
    for (int round = 0; round < STRAIGHTEN_ROUNDS && goes_on; round++) {
        goes_on = false;
        for (size_t i = 1; i < last; i++) {
            double *p = points + 3 * i;
            if (!strays(points, last, i)) continue;
            qm_vec_store(p, qm_vec_mix(qm_vec_load(p - 3), qm_vec_load(p + 3), 0.5));
            changed = goes_on = true;
        }
    }
    return changed;
}

void qm_tracks_straighten(qm_reconstruction *r)
{
    for (size_t i = 0; i < r->layout.curve_count && r->options.pull_curves; i++) {
        qm_track *track = &r->tracks[i];
        if (straighten(track->points, track->point_count - 1))
            set_arc(track->points, track->point_count, track->arc);
    }
}

/** Fine points at equal length along a polyline, then on the surface. */
static void lay_points(const qm_reconstruction *r, const double *points, const double *arc, size_t count,
                       qm_track *track)
{
    size_t at = 0, last = track->point_count - 1;
    for (size_t i = 0; i <= last; i++) {
        double length = arc[count - 1] * ((double)i / (double)last);
        qm_vec_store(track->points + 3 * i, i == last ? qm_vec_load(points + 3 * (count - 1))
                                                      : point_along(points, arc, count, length, &at));
        pull(r, track->points + 3 * i);
    }
    set_arc(track->points, track->point_count, track->arc);
}

qm_status qm_track_lay(qm_context *ctx, const qm_reconstruction *r, const double *points, size_t count,
                       qm_track *track)
{
    double *arc = qm_context_alloc(ctx, count, sizeof *arc);
    if (!arc) return no_memory(ctx);
    set_arc(points, count, arc);
    lay_points(r, points, arc, count, track);
    qm_context_free(ctx, arc, count, sizeof *arc);
    return QM_OK;
}

static qm_status create_track(qm_context *ctx, qm_reconstruction *r, size_t place)
{
    const qm_curve *curve = &r->layout.curves[place];
    qm_track *track = &r->tracks[place];
    size_t count = 2 * (curve->point_count - 1);
    track->point_count = (count < FINE_EDGES ? FINE_EDGES : count) + 1;
    track->points = qm_context_alloc(ctx, track->point_count, ROW);
    track->arc = qm_context_alloc(ctx, track->point_count, sizeof *track->arc);
    if (!track->points || !track->arc) return no_memory(ctx);
    return qm_track_lay(ctx, r, curve->points, curve->point_count, track);
}

qm_status qm_tracks_create(qm_context *ctx, qm_reconstruction *r)
{
    for (size_t i = 0; i < r->layout.curve_count; i++) {
        qm_status status = create_track(ctx, r, i);
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

void qm_track_at(const qm_track *track, double share, double position[3], qm_vec *tangent)
{
    size_t at = 0, last = track->point_count - 1;
    qm_vec_store(position,
                 point_along(track->points, track->arc, track->point_count, share * track->arc[last], &at));
    *tangent = qm_vec_sub(qm_vec_load(track->points + 3 * at + 3), qm_vec_load(track->points + 3 * at));
    double length = qm_vec_norm(*tangent);
    if (length > 0.0) *tangent = qm_vec_scale(1.0 / length, *tangent);
}

/** Vertices at equal arc length. Where there are more of them than fine points, the surface is asked
 * again. */
static qm_status set_vertices(qm_context *ctx, const qm_reconstruction *r, qm_track *track, uint32_t edges)
{
    double *vertices = qm_context_alloc(ctx, (size_t)edges + 1, ROW);
    if (!vertices) return no_memory(ctx);
    size_t at = 0, last = track->point_count - 1;
    for (uint32_t i = 1; i < edges; i++) {
        double length = track->arc[last] * ((double)i / edges);
        qm_vec_store(vertices + 3 * (size_t)i,
                     point_along(track->points, track->arc, track->point_count, length, &at));
        pull(r, vertices + 3 * (size_t)i);
    }
    memcpy(vertices, track->points, ROW);
    memcpy(vertices + 3 * (size_t)edges, track->points + 3 * last, ROW);
    if (r->options.pull_curves) straighten(vertices, edges);
    qm_context_free(ctx, track->vertices, (size_t)track->vertex_edges + 1, ROW);
    track->vertices = vertices;
    track->vertex_edges = edges;
    return QM_OK;
}

qm_status qm_tracks_set_vertices(qm_context *ctx, qm_reconstruction *r)
{
    for (size_t i = 0; i < r->layout.curve_count; i++) {
        qm_track *track = &r->tracks[i];
        if (track->chord == QM_NO_INDEX || r->chords[track->chord].work == track->vertex_edges) continue;
        qm_status status = set_vertices(ctx, r, track, r->chords[track->chord].work);
        if (status != QM_OK) return status;
    }
    return QM_OK;
}
