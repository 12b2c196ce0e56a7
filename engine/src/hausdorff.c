/**
 * hausdorff.c: the call: checks, frames and rounding margins, the first samples, the workers, the result.
 *
 * Roundings. Every distance is computed in a frame centred on the target and is off by at most eta = 128 u S,
 * where u = 2^-53 and S is the greatest coordinate there. The search discards at lower + tolerance - 4 eta,
 * and the result opens the bracket by eta on both sides.
 */
#include "qm/hausdorff.h"

#include <string.h>

#include "hausdorff_search.h"
#include "surface.h"

#define ETA_ROUNDINGS 128.0

qm_hausdorff_options qm_hausdorff_options_default(void)
{
    return (qm_hausdorff_options){.direction = QM_TWO_SIDED, .threshold = NAN, .thread_count = 1};
}

static qm_status check_options(qm_context *ctx, const qm_hausdorff_options *options)
{
    if (!(options->tolerance > 0.0) || !isfinite(options->tolerance))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "tolerance must be a positive number, got %g",
                               options->tolerance);
    if (options->threshold < 0.0 || isinf(options->threshold))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "threshold must be 0 or more, got %g", options->threshold);
    if (options->thread_count < 1)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "thread count must be 1 or more, got %d",
                               options->thread_count);
    if (!(options->deadline_ms >= 0.0))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "deadline must be 0 or more, got %g",
                               options->deadline_ms);
    return QM_OK;
}

static qm_status set_side(qm_context *ctx, qm_side *side, const qm_bvh *source, const qm_bvh *target,
                          qm_quad_reading quads)
{
    if (!qm_bvh_is_target(target, quads))
        return qm_context_fail(ctx, QM_E_ARGUMENT,
                               "the tree of the target lacks parts that this reading needs");
    *side = (qm_side){
        .source = source,
        .target = target,
        .scale = target->frame.scale,
        .inverse_scale = target->frame.inverse_scale,
        .factor = source->frame.inverse_scale * target->frame.scale,
        .target_patches = quads == QM_QUADS_BILINEAR && target->twist,
        .source_patches = quads == QM_QUADS_BILINEAR && source->has_quads,
    };
    side->shift = qm_vec_scale(side->scale, qm_vec_sub(source->frame.origin, target->frame.origin));
    double offset = fmax(fabs(side->shift.x), fmax(fabs(side->shift.y), fabs(side->shift.z)));
    side->reach = fmax(target->reach, offset + side->factor * source->reach);
    if (!(side->factor >= 1.0 / QM_MAX_SCALE_RATIO && side->factor <= QM_MAX_SCALE_RATIO &&
          offset <= QM_MAX_SCALE_RATIO))
        return qm_context_fail(ctx, QM_E_SCALE, "the meshes' sizes or places differ by more than 2^300");
    return QM_OK;
}

static qm_status set_sides(qm_context *ctx, qm_search *search, const qm_bvh *a, const qm_bvh *b)
{
    const qm_hausdorff_options *options = search->options;
    qm_status status = QM_OK;
    if (options->direction != QM_B_TO_A)
        status = set_side(ctx, &search->side[search->side_count++], a, b, options->quads);
    if (status == QM_OK && options->direction != QM_A_TO_B)
        status = set_side(ctx, &search->side[search->side_count++], b, a, options->quads);
    if (status != QM_OK) return status;
    for (int i = 0; i < search->side_count; i++)
        search->eta = fmax(search->eta,
                           ETA_ROUNDINGS * 0x1p-53 * search->side[i].reach * search->side[i].inverse_scale);
    search->tolerance = fmax(options->tolerance - 4.0 * search->eta, 4.0 * search->eta);
    if (options->threshold >= 0.0) search->floor = fmax(0.0, options->threshold - 2.0 * search->eta);
    return QM_OK;
}

/** Looks for a good lower bound and queues the root of the source. */
static void start_side(qm_context *ctx, qm_search *search, int index)
{
    const qm_side *side = &search->side[index];
    uint32_t hint = qm_search_scout(ctx, search, side);
    double radius = sqrt(3.0) * side->source->reach * side->factor;
    double upper = qm_side_pack_upper(search, side, hint, side->shift) + radius;
    qm_entry root = {
        .upper = upper * side->inverse_scale,
        .hint = hint,
        .kind = QM_ENTRY_GROUP,
        .side = (uint8_t)index,
        .level = (uint8_t)side->source->boxes.level_count,
    };
    qm_worker_push(&search->workers[0], root, NULL);
}

static void run_worker(void *data, int index)
{
    qm_worker_run(&((qm_search *)data)->workers[index]);
}

static void run(qm_context *ctx, qm_search *search)
{
    for (int i = 0; i < search->side_count; i++)
        start_side(ctx, search, i);
    qm_context_parallel(ctx, search->worker_count, run_worker, search);
}

static const qm_worker *best_witness(const qm_search *search)
{
    const qm_worker *best = &search->workers[0];
    for (int i = 1; i < search->worker_count; i++)
        if (search->workers[i].witness > best->witness) best = &search->workers[i];
    return best;
}

/** Fills in the two points of the witness: the foot on its own face first, then the nearest point of the
 * target. */
static void set_witness(const qm_search *search, qm_hausdorff_result *out)
{
    const qm_worker *best = best_witness(search);
    const qm_side *side = &search->side[best->witness_side];
    qm_quad_reading quads = search->options->quads;
    double error = 0x1p-46 * side->reach;
    double world[3];
    qm_vec_store(world, qm_frame_world(&side->target->frame, best->witness_point));
    qm_vec at_source = qm_frame_local(&side->source->frame, world);
    out->from = qm_surface_face_foot(side->source, quads, best->witness_face, at_source, error);
    qm_vec p = qm_frame_local(&side->target->frame, out->from.position);
    qm_hit hit = {.d2 = INFINITY};
    search->kernel->closest(side->target, p, &hit);
    double certified = sqrt(hit.d2);
    if (side->target_patches) {
        qm_patch_hit patch;
        search->kernel->closest_patch(side->target, p, hit.pack, error, &patch);
        certified = patch.lower;
        out->to = qm_surface_face_foot(side->target, quads, patch.face, p, error);
    } else {
        out->to = qm_surface_triangle_foot(side->target, hit.pack, hit.lane, p);
    }
    out->from_side = search->options->direction == QM_B_TO_A ? 1 : best->witness_side;
    out->has_witness = true;
    double lower = certified * side->inverse_scale - search->eta;
    if (lower > out->lower && lower <= out->upper) out->lower = lower;
}

static void set_result(const qm_search *search, qm_hausdorff_result *out)
{
    const qm_hausdorff_options *options = search->options;
    double lower = atomic_load(&search->lower);
    out->lower = fmax(0.0, lower - search->eta);
    out->upper = fmin(search->reported_upper, fmax(lower, qm_search_upper(search)) + search->eta);
    out->iterations = atomic_load(&search->iterations);
    out->projections = atomic_load(&search->projections);
    for (int i = 0; i < search->worker_count; i++)
        out->max_queue += search->workers[i].max_queue;
    int reason = atomic_load(&search->stop);
    set_witness(search, out);
    if (out->lower > options->threshold) out->verdict = 1;
    if (out->upper <= options->threshold) out->verdict = -1;
    bool converged = out->upper - out->lower <= options->tolerance;
    out->stop = converged                     ? QM_STOP_CONVERGED
                : out->verdict != 0           ? QM_STOP_THRESHOLD
                : reason == QM_SEARCH_RUNNING ? QM_STOP_PRECISION
                                              : (qm_hausdorff_stop)reason;
}

/** The hierarchy at hand over a target, or NULL. */
static const qm_tetra *tetra_over(const qm_hausdorff_options *options, const qm_bvh *target)
{
    for (int i = 0; i < 2; i++)
        if (options->tetra[i] && qm_tetra_bvh(options->tetra[i]) == target) return options->tetra[i];
    return NULL;
}

/** A call canceled meanwhile goes on with the tree alone: the workers see the flag, and the result is valid.
 */
static qm_status build_locators(qm_context *ctx, qm_search *search)
{
    qm_status status = QM_OK;
    for (int i = 0; i < search->side_count && status == QM_OK; i++) {
        qm_side *side = &search->side[i];
        status = qm_locator_build(ctx, side->target, tetra_over(search->options, side->target),
                                  search->options->accelerator, &side->nearest);
        if (status == QM_E_CANCELED)
            status = qm_locator_build(ctx, side->target, NULL, QM_ACCELERATOR_BOXES, &side->nearest);
    }
    return status;
}

static qm_status run_search(qm_context *ctx, qm_search *search, qm_hausdorff_result *out)
{
    if (!qm_search_create_workers(ctx, search, ctx->parallel ? search->options->thread_count : 1))
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the workers of a search");
    qm_status status = QM_OK;
    run(ctx, search);
    if (atomic_load(&search->stop) == QM_SEARCH_OUT_OF_MEMORY)
        status = qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the queue of a search");
    else
        set_result(search, out);
    out->elapsed_ms = qm_clock_ms() - search->start_ms;
    qm_search_destroy_workers(ctx, search);
    return status;
}

qm_status qm_hausdorff_measure(qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                               const qm_hausdorff_options *options, qm_hausdorff_result *out)
{
    QM_ASSERT(ctx && a && b && options && out);
    *out = (qm_hausdorff_result){0};
    qm_status status = check_options(ctx, options);
    if (status != QM_OK) return status;
    qm_search search = {
        .kernel = qm_kernel_get(),
        .options = options,
        .stop = QM_SEARCH_RUNNING,
        .reporting = ATOMIC_FLAG_INIT,
        .start_ms = qm_clock_ms(),
        .reported_ms = -INFINITY,
        .reported_gap = INFINITY,
        .reported_upper = INFINITY,
    };
    status = set_sides(ctx, &search, a, b);
    if (status == QM_OK) status = build_locators(ctx, &search);
    if (status == QM_OK) status = run_search(ctx, &search, out);
    for (int i = 0; i < search.side_count; i++)
        qm_locator_reset(ctx, &search.side[i].nearest);
    return status;
}
