/**
 * project.c: projects batches of points. The points are visited along a Hilbert curve, so that each search
 * starts from the pack where the last one ended; results are written in the caller's order.
 */
#include "qm/project.h"

#include "core/radix.h"
#include "nearest.h"
#include "surface.h"

#define CHECK_STRIDE 0x4000 /* points between two checks before they are projected */
#define BLOCK 1024          /* points between two checks of the cancel flag */
#define MIN_SORTED 256      /* points that make sorting worthwhile */
#define AHEAD 16            /* points ahead that are prefetched: the order jumps about */

typedef struct point_batch {
    qm_context *ctx;
    const qm_locator *locator;
    qm_quad_reading reading;
    const double *points;
    const uint64_t *order;
    size_t count;
    int workers;
    const qm_projection *out;
} point_batch;

static void project_one(const point_batch *batch, const qm_kernel *kernel, size_t i, uint32_t *hint)
{
    const qm_bvh *bvh = batch->locator->bvh;
    qm_vec p = qm_frame_local(&bvh->frame, batch->points + 3 * i);
    qm_tie found = qm_nearest_face(kernel, batch->locator, batch->reading, p, hint);
    qm_surface_point foot = {.face = found.face};
    if (batch->out->position || batch->out->uv)
        foot = batch->reading == QM_QUADS_BILINEAR && qm_bvh_has_twists(bvh)
                   ? qm_surface_face_foot(bvh, batch->reading, found.face, p, qm_bilinear_error(p))
                   : qm_surface_triangle_foot(bvh, found.pack, found.lane, p);
    if (batch->out->distance) batch->out->distance[i] = found.distance * bvh->frame.inverse_scale;
    if (batch->out->position) qm_vec_store(batch->out->position + 3 * i, qm_vec_load(foot.position));
    if (batch->out->face) batch->out->face[i] = foot.face;
    if (batch->out->uv) {
        batch->out->uv[2 * i] = foot.uv[0];
        batch->out->uv[2 * i + 1] = foot.uv[1];
    }
}

/** Prefetches a point soon to be projected, and the memory of its result. Always inlined: GCC considers a
 * function that only prefetches to have no effect, and drops its calls. */
__attribute__((always_inline)) static inline void fetch_soon(const point_batch *batch, size_t i)
{
    const qm_projection *out = batch->out;
    __builtin_prefetch(batch->points + 3 * i);
    __builtin_prefetch(batch->points + 3 * i + 2);
    if (out->distance) __builtin_prefetch(out->distance + i, 1);
    if (out->face) __builtin_prefetch(out->face + i, 1);
    if (out->uv) __builtin_prefetch(out->uv + 2 * i, 1);
    if (!out->position) return;
    __builtin_prefetch(out->position + 3 * i, 1);
    __builtin_prefetch(out->position + 3 * i + 2, 1);
}

/** Where the last search of a thread ended: calls for one point are often near the one before. The result is the same from any
 * start, of this or another tree. */
static _Thread_local uint32_t last_pack;

static void project_range(void *data, int worker)
{
    const point_batch *batch = data;
    const qm_kernel *kernel = qm_kernel_get();
    size_t begin = batch->count * (size_t)worker / (size_t)batch->workers;
    size_t end = batch->count * ((size_t)worker + 1) / (size_t)batch->workers;
    uint32_t hint = last_pack < batch->locator->bvh->pack_count ? last_pack : 0;
    for (size_t k = begin; k < end; k++) {
        if ((k - begin) % BLOCK == 0 && qm_context_canceled(batch->ctx)) return;
        if (k + AHEAD < end) fetch_soon(batch, batch->order[k + AHEAD] & QM_RADIX_INDEX_MASK);
        project_one(batch, kernel, batch->order[k] & QM_RADIX_INDEX_MASK, &hint);
    }
    last_pack = hint;
}

static qm_status check_canceled(qm_context *ctx)
{
    return qm_context_canceled(ctx) ? qm_context_fail(ctx, QM_E_CANCELED, "projection canceled") : QM_OK;
}

static qm_status check_point(qm_context *ctx, const qm_frame *frame, const double *p, size_t row)
{
    double origin = qm_max_coordinate(frame->origin), max = qm_max_coordinate(qm_frame_local(frame, p));
    if (!isfinite(p[0]) || !isfinite(p[1]) || !isfinite(p[2]))
        return qm_context_fail(ctx, QM_E_NOT_FINITE, "point %zu has a coordinate that is not finite", row);
    if (!(max <= QM_MAX_SCALE_RATIO))
        return qm_context_fail(ctx, QM_E_SCALE, "point %zu lies farther than 2^300 sizes from the mesh", row);
    /* Distances are below 2 (max + 1), positions within 1 of the origin along each axis and their
     * roundings. */
    if (!isfinite(origin + 2.0 * (max + 1.0) * frame->inverse_scale))
        return qm_context_fail(ctx, QM_E_SCALE, "distances from point %zu overflow double precision", row);
    return QM_OK;
}

qm_status qm_project_check(qm_context *ctx, const qm_bvh *bvh, const double *points, size_t first,
                           size_t point_count)
{
    qm_status status = QM_OK;
    for (size_t i = 0; status == QM_OK && i < point_count; i++) {
        status = check_point(ctx, &bvh->frame, points + 3 * i, first + i);
        if (i % CHECK_STRIDE == 0 && status == QM_OK) status = check_canceled(ctx);
    }
    return status;
}

static qm_status sort_points(qm_context *ctx, const qm_bvh *bvh, const double *points, size_t count,
                             int workers, uint64_t *order)
{
    qm_hilbert_cells cells;
    uint64_t keys[QM_HILBERT_BATCH];
    for (size_t first = 0; first < count; first += QM_HILBERT_BATCH) {
        if (first % CHECK_STRIDE == 0 && qm_context_canceled(ctx)) return check_canceled(ctx);
        int batch = count - first < QM_HILBERT_BATCH ? (int)(count - first) : QM_HILBERT_BATCH;
        for (int i = 0; i < batch; i++) {
            qm_vec local = qm_frame_local(&bvh->frame, points + 3 * (first + (size_t)i));
            cells.axis[0][i] = qm_hilbert_quantise(local.x);
            cells.axis[1][i] = qm_hilbert_quantise(local.y);
            cells.axis[2][i] = qm_hilbert_quantise(local.z);
        }
        qm_kernel_get()->hilbert_keys(&cells, batch, QM_HILBERT_BITS, keys);
        for (int i = 0; i < batch; i++)
            order[first + (size_t)i] = qm_radix_entry(keys[i], first + (size_t)i);
    }
    return qm_radix_sort(ctx, order, count, 3 * QM_HILBERT_BITS, workers);
}

static qm_status fill_order(qm_context *ctx, const qm_bvh *bvh, const double *points, size_t count,
                            int workers, uint64_t *order)
{
    qm_status status = qm_project_check(ctx, bvh, points, 0, count);
    if (status != QM_OK || count >= MIN_SORTED)
        return status == QM_OK ? sort_points(ctx, bvh, points, count, workers, order) : status;
    for (size_t i = 0; i < count; i++)
        order[i] = i;
    return QM_OK;
}

qm_status qm_project_points_with(qm_context *ctx, const qm_locator *locator, qm_quad_reading reading,
                                 const double *points, size_t point_count, int thread_count,
                                 const qm_projection *out)
{
    if (point_count == 0) return QM_OK;
    if (!qm_bvh_is_target(locator->bvh, reading))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the tree lacks parts that this reading needs");
    if (point_count > QM_RADIX_INDEX_MASK)
        return qm_context_fail(ctx, QM_E_TOO_LARGE, "a batch holds at most %llu points",
                               (unsigned long long)QM_RADIX_INDEX_MASK);
    point_batch batch = {.ctx = ctx,
                         .locator = locator,
                         .reading = reading,
                         .points = points,
                         .count = point_count,
                         .out = out};
    uint64_t *order = qm_context_alloc(ctx, batch.count, sizeof *order);
    if (!order) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for %zu points", batch.count);
    batch.workers = ctx->parallel && thread_count > 1 ? thread_count : 1;
    qm_status status = fill_order(ctx, locator->bvh, points, point_count, batch.workers, order);
    if (status == QM_OK) {
        batch.order = order;
        if (batch.workers > 1)
            ctx->parallel(ctx->parallel_user, batch.workers, project_range, &batch);
        else
            project_range(&batch, 0);
        status = check_canceled(ctx);
    }
    qm_context_free(ctx, order, batch.count, sizeof *order);
    return status;
}

qm_status qm_project_points(qm_context *ctx, const qm_bvh *bvh, qm_quad_reading reading, const double *points,
                            size_t point_count, int thread_count, const qm_projection *out)
{
    qm_locator boxes = {.bvh = bvh};
    return qm_project_points_with(ctx, &boxes, reading, points, point_count, thread_count, out);
}
