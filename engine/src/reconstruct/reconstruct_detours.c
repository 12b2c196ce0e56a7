/**
 * reconstruct_detours.c: curves that leave the surface for good. A piece may run through a thin wall or over
 * a gap between two ears: its points then jump from one side to the other when they are pulled. Such a jump
 * is led round along the surface, by the shortest way over samples of it.
 */
#include "reconstruct_work.h"

#include <string.h>

#include "core/heap.h"
#include "layout/surface_graph.h"

#define JUMP 2.5     /* mean spacings of the fine points: two that lie farther apart have jumped */
#define LONGEST 20.0 /* jumps: no detour is longer */
#define SMOOTH_ROUNDS 6
#define MOST_DETOURS 4 /* a curve */

enum { ROW = 3 * sizeof(double) };

typedef struct detours {
    qm_context *ctx;
    qm_reconstruction *r;
    qm_samples samples;
    qm_surface_graph graph;
    double *length;   /* of the way to each sample */
    uint32_t *before; /* the sample before it */
} detours;

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the curves' detours");
}

static qm_vec point_at(const double *points, size_t i)
{
    return qm_vec_load(points + 3 * i);
}

/** The fine point that lies farthest from the one before it, if that is a jump; 0 for none. */
static size_t find_jump(const qm_track *t)
{
    size_t place = 0, last = t->point_count - 1;
    double longest = JUMP * t->arc[last] / (double)last;
    for (size_t i = 1; i <= last; i++) {
        double step = t->arc[i] - t->arc[i - 1];
        if (step <= longest) continue;
        longest = step;
        place = i;
    }
    return place;
}

static uint32_t nearest_sample(const detours *d, qm_vec p)
{
    uint32_t best = 0;
    double least = INFINITY;
    for (size_t i = 0; i < d->samples.count; i++) {
        double distance = qm_vec_norm2(qm_vec_sub(point_at(d->samples.positions, i), p));
        if (distance >= least) continue;
        least = distance;
        best = (uint32_t)i;
    }
    return best;
}

/** Ways from one sample to all up to a length, or to the one wanted. */
static qm_status search(detours *d, uint32_t from, uint32_t to, double limit)
{
    qm_heap heap = {0};
    for (size_t i = 0; i < d->samples.count; i++)
        d->length[i] = INFINITY;
    d->length[from] = 0.0;
    qm_status status = qm_heap_push(d->ctx, &heap, (qm_heap_item){.number = from});
    while (status == QM_OK && heap.count > 0) {
        qm_heap_item item = qm_heap_pop(&heap);
        if (item.key > d->length[item.number]) continue;
        if (item.number == to || item.key > limit) break;
        for (int k = 0; k < QM_GRAPH_LINKS && status == QM_OK; k++) {
            uint32_t next = d->graph.link[item.number][k];
            if (next == QM_NO_INDEX) break;
            double length = item.key + qm_vec_distance(point_at(d->samples.positions, item.number),
                                                       point_at(d->samples.positions, next));
            if (length >= d->length[next]) continue;
            d->length[next] = length;
            d->before[next] = item.number;
            status = qm_heap_push(d->ctx, &heap, (qm_heap_item){.key = length, .number = next});
        }
    }
    qm_heap_reset(d->ctx, &heap);
    return status;
}

/** Straightens a way over samples within the surface; the two ends stay. */
static void smooth(const qm_reconstruction *r, double *points, size_t count)
{
    for (int round = 0; round < SMOOTH_ROUNDS; round++) {
        for (size_t i = 1; i + 1 < count; i++) {
            qm_vec sides = qm_vec_add(point_at(points, i - 1), point_at(points, i + 1));
            double at[3];
            qm_foothold foot;
            qm_vec_store(at, qm_vec_scale(0.25, qm_vec_axpy(sides, 2.0, point_at(points, i))));
            qm_source_pull(&r->source, at, &foot);
            memcpy(points + 3 * i, foot.position, ROW);
        }
    }
}

/** Puts the way that ends at sample `to` between the fine points at - 1 and at, and lays the track anew. */
static qm_status insert_way(detours *d, size_t track, size_t at, uint32_t from, uint32_t to)
{
    qm_track *t = &d->r->tracks[track];
    size_t way = 1;
    for (uint32_t i = to; i != from; i = d->before[i])
        way++;
    size_t count = t->point_count + way;
    double *points = qm_context_alloc(d->ctx, count, ROW);
    if (!points) return no_memory(d->ctx);
    memcpy(points, t->points, at * ROW);
    memcpy(points + 3 * (at + way), t->points + 3 * at, (t->point_count - at) * ROW);
    uint32_t i = to;
    for (size_t k = at + way; k-- > at; i = d->before[i])
        memcpy(points + 3 * k, d->samples.positions + 3 * (size_t)i, ROW);
    smooth(d->r, points + 3 * (at - 1), way + 2);
    qm_status status = qm_track_lay(d->ctx, d->r, points, count, t);
    qm_context_free(d->ctx, points, count, ROW);
    return status;
}

/** Leads the jumps of a track round, the longest first, until one is left that no way is found for. */
static qm_status lead_round(detours *d, size_t track)
{
    qm_status status = QM_OK;
    for (int count = 0; count < MOST_DETOURS && status == QM_OK; count++) {
        const qm_track *t = &d->r->tracks[track];
        size_t at = find_jump(t);
        if (at == 0) return QM_OK;
        qm_vec start = point_at(t->points, at - 1), end = point_at(t->points, at);
        uint32_t from = nearest_sample(d, start), to = nearest_sample(d, end);
        status = search(d, from, to, LONGEST * qm_vec_distance(start, end));
        if (status != QM_OK || from == to || d->length[to] == INFINITY) return status;
        status = insert_way(d, track, at, from, to);
    }
    return status;
}

static qm_status lead_all(detours *d)
{
    for (size_t i = 0; i < d->r->layout.curve_count; i++) {
        if (find_jump(&d->r->tracks[i]) == 0) continue;
        qm_status status = lead_round(d, i);
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

static bool has_jumps(const qm_reconstruction *r)
{
    for (size_t i = 0; i < r->layout.curve_count; i++)
        if (find_jump(&r->tracks[i]) > 0) return true;
    return false;
}

qm_status qm_tracks_detour(qm_context *ctx, qm_reconstruction *r, size_t wanted)
{
    if (!r->options.pull_curves || !has_jumps(r)) return QM_OK;
    detours d = {.ctx = ctx, .r = r};
    qm_status status = qm_samples_create(ctx, r, wanted, &d.samples);
    if (status != QM_OK) return status;
    size_t count = d.samples.count;
    d.length = qm_context_alloc(ctx, count, sizeof *d.length);
    d.before = qm_context_alloc(ctx, count, sizeof *d.before);
    status = d.length && d.before ? QM_OK : no_memory(ctx);
    if (status == QM_OK) status = qm_surface_graph_build(ctx, d.samples.positions, count, NULL, &d.graph);
    if (status == QM_OK) status = lead_all(&d);
    qm_surface_graph_reset(ctx, &d.graph);
    qm_context_free(ctx, d.length, count, sizeof *d.length);
    qm_context_free(ctx, d.before, count, sizeof *d.before);
    qm_samples_reset(ctx, &d.samples);
    return status;
}
