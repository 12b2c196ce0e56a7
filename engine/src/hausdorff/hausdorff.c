/**
 * hausdorff.c: the public call: checks, local spaces and rounding margins, seeds, workers, the result.
 *
 * Roundings. Every distance is computed in the local frame of the target, and the bracket is opened by eta on
 * both sides for the roundings (rounding.h). So the search itself works with the tolerance less these
 * margins, but with no less than 2 eta: computed distances of one point differ by up to eta, and the search
 * ends only if a piece may be discarded at half the tolerance (hausdorff_piece.c).
 */
#include "qm/hausdorff.h"

#include <float.h>
#include <string.h>

#include "bvh/surface.h"
#include "core/rounding.h"
#include "hausdorff_exact.h"
#include "hausdorff_parts.h"
#include "hausdorff_sample.h"

/* By how many eta the result is wider than the search's own bracket, and its rounding */
#define OPENED_BY 2.25
#define WITNESS_ERROR 1e-3 /* of the tolerance: certified error of the witness over patches */

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
    QM_ASSERT(source && target);
    if (!qm_bvh_is_target(target, quads))
        return qm_context_fail(ctx, QM_E_ARGUMENT,
                               "the tree of the target lacks parts that this reading needs");
    *side = (qm_side){
        .source = source,
        .target = target,
        .scale = target->frame.scale,
        .inverse_scale = target->frame.inverse_scale,
        .factor = source->frame.inverse_scale * target->frame.scale,
        .target_patches = quads == QM_QUADS_BILINEAR && qm_bvh_has_twists(target),
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
        search->eta = fmax(search->eta, QM_ETA_ROUNDINGS * QM_UNIT_ROUNDING * search->side[i].reach *
                                            search->side[i].inverse_scale);
    search->tolerance = fmax(options->tolerance - OPENED_BY * search->eta, 2.0 * search->eta);
    if (options->threshold >= 0.0) search->floor = fmax(0.0, options->threshold - 2.0 * search->eta);
    return QM_OK;
}

static void run_worker(void *data, int index)
{
    qm_worker_run(&((qm_search *)data)->workers[index]);
}

/**
 * Fills in the two points of the witness: the footpoint on its own face, and the nearest point of the target.
 * Both are rounded to the doubles of the meshes' frame, which may take them off their surfaces, so nothing is
 * concluded from them. The unrounded point is certified once more, closely: the search saves itself that
 * where the lower bound would rise by less than a share of the tolerance.
 */
static void set_witness(const qm_search *search, qm_hausdorff_result *out)
{
    QM_ASSERT(search->side_count > 0);
    const qm_worker *best = &search->workers[0];
    for (int i = 1; i < search->worker_count; i++)
        if (search->workers[i].witness > best->witness) best = &search->workers[i];
    out->found_lower = best->witness;
    if (best->witness < 0.0) return;
    const qm_side *side = &search->side[best->witness_side];
    qm_quad_reading quads = search->options->quads;
    double error = fmax(WITNESS_ERROR * search->tolerance * side->scale, QM_BILINEAR_MIN_ERROR * side->reach);
    double world[3];
    qm_vec_store(world, qm_frame_world(&side->target->frame, best->witness_point));
    qm_vec at_source = qm_frame_local(&side->source->frame, world);
    out->from =
        qm_surface_face_foot(side->source, quads, best->witness_face, at_source, error / side->factor);
    qm_vec p = best->witness_point;
    qm_hit hit = {.d2 = INFINITY, .pack = best->witness_hint};
    search->kernel->closest(side->target, p, &hit);
    double certified = sqrt(hit.d2);
    if (side->target_patches) {
        qm_bilinear_hit patch;
        search->kernel->closest_patch(side->target, p, hit.pack, error, &patch);
        certified = patch.lower;
        out->to = isnan(patch.uv[0]) ? qm_surface_face_foot(side->target, quads, patch.face, p, error)
                                     : qm_surface_patch_point(side->target, patch.face, patch.uv);
    } else {
        out->to = qm_surface_triangle_foot(side->target, hit.pack, hit.lane, p);
    }
    out->from_side = search->options->direction == QM_B_TO_A ? 1 : best->witness_side;
    out->has_witness = true;
    double lower = (certified - best->witness_slack) * side->inverse_scale - search->eta;
    if (lower > out->lower && lower <= out->upper) out->lower = lower;
}

static void set_result(const qm_search *search, qm_hausdorff_result *out)
{
    const qm_hausdorff_options *options = search->options;
    double lower = atomic_load(&search->lower);
    out->lower = fmin(DBL_MAX, fmax(0.0, lower - search->eta)); /* a distance may be beyond all doubles */
    out->upper = fmin(search->reported_upper, fmax(lower, qm_worker_max_upper(search)) + search->eta);
    out->iterations = atomic_load(&search->iterations);
    out->projections = atomic_load(&search->projections);
    out->margin = search->eta;
    for (int i = 0; i < search->worker_count; i++) {
        out->max_queue += search->workers[i].max_queue;
        out->discarded = fmax(out->discarded, atomic_load(&search->workers[i].discarded));
    }
    int reason = atomic_load(&search->stop);
    QM_ASSERT(!(out->lower > out->upper));
    set_witness(search, out);
    if (out->lower > options->threshold) out->verdict = 1;
    if (out->upper <= options->threshold) out->verdict = -1;
    bool converged = out->upper - out->lower <= options->tolerance;
    out->stop = converged                     ? QM_STOP_CONVERGED
                : out->verdict != 0           ? QM_STOP_THRESHOLD
                : reason == QM_SEARCH_RUNNING ? QM_STOP_PRECISION
                                              : (qm_hausdorff_stop)reason;
}

/** Takes the tetrahedron hierarchies that the caller has given. A call canceled meanwhile goes on with the
 * tree alone: the workers see the flag, and the result is valid. */
static qm_status build_locators(qm_context *ctx, qm_search *search)
{
    const qm_hausdorff_options *options = search->options;
    qm_status status = QM_OK;
    for (int i = 0; i < search->side_count && status == QM_OK; i++) {
        qm_side *side = &search->side[i];
        const qm_tetra *tetra = NULL;
        for (int k = 0; k < 2 && !tetra; k++)
            if (options->tetra[k] && qm_tetra_bvh(options->tetra[k]) == side->target)
                tetra = options->tetra[k];
        status = qm_locator_build(ctx, side->target, tetra, options->accelerator, &side->nearest);
        if (status == QM_E_CANCELED)
            status = qm_locator_build(ctx, side->target, NULL, QM_ACCELERATOR_BOXES, &side->nearest);
    }
    return status;
}

uint64_t qm_hausdorff_default_work(const qm_bvh *a, const qm_bvh *b, qm_direction direction)
{
    QM_ASSERT(a && b);
    uint64_t sides = direction == QM_TWO_SIDED ? 2 : 1, packs = (uint64_t)a->pack_count + b->pack_count;
    return QM_HAUSDORFF_BASE_WORK + sides * QM_HAUSDORFF_FACE_WORK * QM_PACK_LANES * packs;
}

static void set_limits(qm_search *search, int workers)
{
    const qm_hausdorff_options *options = search->options;
    search->work_limit = options->work_limit;
    search->work_stop = QM_STOP_DEADLINE;
    if (search->work_limit == 0) {
        search->work_stop = QM_STOP_WORK;
        search->work_limit =
            qm_hausdorff_default_work(search->side[0].source, search->side[0].target, options->direction);
    }
    size_t memory = options->memory_limit > 0 ? options->memory_limit : QM_HAUSDORFF_MEMORY;
    search->memory_limit = memory / (size_t)workers;
}

/** Raises the lower bound by seeds, and queues the root of each source. */
static void queue_sources(qm_context *ctx, qm_search *search)
{
    for (int i = 0; i < search->side_count; i++) {
        const qm_side *side = &search->side[i];
        uint32_t hint = qm_sample_seeds(ctx, search, &search->side[i]);
        double radius = sqrt(3.0) * side->source->reach * side->factor;
        double upper = qm_sample_pack_upper(search->kernel, side, hint, side->shift) + radius;
        qm_entry root = {
            .upper = upper * side->inverse_scale,
            .hint = hint,
            .kind = QM_ENTRY_NODE,
            .side = (uint8_t)i,
            .level = (uint8_t)side->source->boxes.level_count,
        };
        qm_worker_push(&search->workers[0], root, NULL);
    }
}

/** Queues the sources, or the parts that the caller has given, and runs the workers until they end. */
static qm_status run_search(qm_context *ctx, qm_search *search, qm_hausdorff_result *out)
{
    int workers = ctx->parallel ? search->options->thread_count : 1;
    set_limits(search, workers);
    if (!qm_worker_create_all(ctx, search, workers))
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the workers of a search");
    if (search->options->parts && search->options->parts->begin)
        qm_parts_queue(search);
    else
        queue_sources(ctx, search);
    search->is_queued = true;
    qm_context_parallel(ctx, search->worker_count, run_worker, search);
    set_result(search, out);
    qm_parts_give_rest(search);
    out->elapsed_ms = qm_clock_ms() - search->start_ms;
    qm_worker_destroy_all(ctx, search);
    for (int i = 0; i < search->side_count; i++)
        qm_sample_free_seeds(ctx, &search->side[i]);
    return QM_OK;
}

/** True when two meshes have the same triangles in the same order, a quad being two. *of_b becomes the face
 * of b that has the first triangle of a face of a. */
static bool are_same_triangles(const qm_mesh *a, const qm_mesh *b, size_t face, uint32_t *of_b)
{
    size_t i = 0, k = 0;
    int half_i = 0, half_k = 0;
    while (i < a->face_count && k < b->face_count) {
        const uint32_t *c = a->faces + 4 * i, *d = b->faces + 4 * k;
        if (i == face && half_i == 0) *of_b = (uint32_t)k;
        if (c[0] != d[0] || c[1 + half_i] != d[1 + half_k] || c[2 + half_i] != d[2 + half_k]) return false;
        half_i = half_i == 0 && c[3] != QM_NO_INDEX;
        half_k = half_k == 0 && d[3] != QM_NO_INDEX;
        i += half_i == 0;
        k += half_k == 0;
    }
    return i == a->face_count && k == b->face_count;
}

/**
 * Two meshes of the same arrays are one set of points in either reading, so the distance is 0, exactly; so
 * are meshes of the same triangles where quads are read as these. A tree over a part of a mesh can be the
 * source only: part of the target's points then, which are at distance 0 too. The witness is the first corner
 * of the source's first face, which is the first corner of the target's, too. False for other meshes.
 */
static bool set_same(const qm_search *search, qm_hausdorff_result *out)
{
    const qm_bvh *source = search->side[0].source;
    const qm_mesh *mesh = &source->mesh, *other = &search->side[0].target->mesh;
    uint32_t face = source->lanes[0].face[0], of_other = face;
    /* Bit by bit: the usual difference shows in the counts or at the first vertices. */
    if (mesh->vertex_count != other->vertex_count ||
        memcmp(mesh->positions, other->positions, 3 * mesh->vertex_count * sizeof *mesh->positions) != 0)
        return false;
    bool is_same = mesh->face_count == other->face_count &&
                   (mesh->face_count == 0 ||
                    memcmp(mesh->faces, other->faces, 4 * mesh->face_count * sizeof *mesh->faces) == 0);
    is_same = is_same || (search->options->quads == QM_QUADS_TRIANGLES &&
                          are_same_triangles(mesh, other, face, &of_other));
    if (!is_same) return false;
    uint32_t vertex = mesh->face_count > 0 ? mesh->faces[4 * (size_t)face] : face;
    out->from.face = face;
    memcpy(out->from.position, mesh->positions + 3 * (size_t)vertex, sizeof out->from.position);
    out->to = out->from;
    out->to.face = of_other;
    out->has_witness = true;
    out->from_side = search->options->direction == QM_B_TO_A ? 1 : 0;
    out->stop = QM_STOP_CONVERGED;
    if (search->options->threshold >= 0.0) out->verdict = -1;
    out->elapsed_ms = qm_clock_ms() - search->start_ms;
    return true;
}

/** A distance that is the threshold itself, or less by rounding alone, stays open however the bounds narrow: it is decided
 * without rounding where that can be. A search of given parts is left as it is, as its bounds are about these alone. */
static qm_status decide_exactly(qm_context *ctx, const qm_search *search, qm_hausdorff_result *out)
{
    const qm_hausdorff_options *options = search->options;
    bool is_narrow = out->stop == QM_STOP_CONVERGED || out->stop == QM_STOP_PRECISION;
    double until_ms = options->deadline_ms > 0.0 ? search->start_ms + options->deadline_ms : INFINITY;
    bool is_open = options->threshold >= out->lower && options->threshold < out->upper;
    bool is_of_parts = options->parts && options->parts->begin;
    bool is_proven = is_narrow && is_open && !is_of_parts;
    qm_status status = QM_OK;
    for (int i = 0; status == QM_OK && is_proven && i < search->side_count; i++)
        status = qm_hausdorff_prove_within(ctx, search->side[i].source, search->side[i].target,
                                           options->quads, options->threshold, until_ms, &is_proven);
    if (status == QM_E_CANCELED) out->stop = QM_STOP_CANCELED;
    if (status != QM_OK || !is_proven) return status == QM_E_CANCELED ? QM_OK : status;
    out->upper = options->threshold;
    out->verdict = QM_VERDICT_BELOW;
    out->stop = QM_STOP_THRESHOLD;
    return QM_OK;
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
        .lower = options->parts ? options->parts->known_lower : 0.0,
    };
    status = set_sides(ctx, &search, a, b);
    if (status == QM_OK) status = qm_parts_check(ctx, &search);
    if (status == QM_OK && set_same(&search, out)) return QM_OK;
    if (status == QM_OK) status = build_locators(ctx, &search);
    if (status == QM_OK) status = run_search(ctx, &search, out);
    if (status == QM_OK) status = decide_exactly(ctx, &search, out);
    for (int i = 0; i < search.side_count; i++)
        qm_locator_reset(ctx, &search.side[i].nearest);
    return status;
}
