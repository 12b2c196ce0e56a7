/**
 * align.c: checks the options, makes frames and points, and calls the two fits.
 */
#include "align_work.h"

#include "core/clock.h"

#define MAX_TRIM 0.9
#define MAX_WITNESSES 128

qm_align_options qm_align_options_default(void)
{
    return (qm_align_options){.fit = QM_ALIGN_LEAST_SQUARES,
                              .start = QM_ALIGN_PRINCIPAL,
                              .motion = QM_ALIGN_RIGID,
                              .direction = QM_A_TO_B,
                              .quads = QM_QUADS_TRIANGLES,
                              .max_distance = INFINITY,
                              .sample_count = QM_ALIGN_SAMPLES,
                              .thread_count = 1};
}

static qm_status check_options(qm_context *ctx, const qm_align_options *options)
{
    const char *fault = NULL;
    if (!(options->trim >= 0.0 && options->trim <= MAX_TRIM)) fault = "trim must lie from 0 to 0.9";
    if (!(options->max_distance > 0.0)) fault = "the greatest distance that counts must be above 0";
    if (options->sample_count < QM_ALIGN_MIN_SAMPLES || options->sample_count > QM_ALIGN_MAX_SAMPLES)
        fault = "the number of samples must lie from 100 to 10000000";
    if (options->thread_count < 1) fault = "there must be at least one thread";
    if (options->start == QM_ALIGN_LANDMARKS && options->landmark_count == 0)
        fault = "no landmarks are given";
    if (options->motion == QM_ALIGN_RIGID_SCALE && options->direction == QM_A_TO_B)
        fault = "with a scale the distances of B must count, too: A could shrink to a point of B";
    if (options->fit == QM_ALIGN_MIN_MAX && (options->trim > 0.0 || options->max_distance < INFINITY))
        fault = "min-max counts every point: it takes neither trim nor a greatest distance";
    for (size_t i = 0; i < options->landmark_count && !fault; i++)
        for (int k = 0; k < 3; k++)
            if (!isfinite(options->landmarks[i].a[k]) || !isfinite(options->landmarks[i].b[k]))
                fault = "a landmark is not finite";
    return fault ? qm_context_fail(ctx, QM_E_ARGUMENT, "%s", fault) : QM_OK;
}

/** The frames, and the length below which roundings hide a direction: a few ulp of the largest coordinate. */
static void make_frames(qm_align_work *work)
{
    double extent = 0.0, largest = 0.0;
    for (int side = 1; side >= 0; side--) {
        const qm_box box = qm_mesh_bounding_box(qm_bvh_mesh(work->tree[side]));
        for (int k = 0; k < 3; k++)
            work->frames.center[side][k] = 0.5 * box.min[k] + 0.5 * box.max[k];
        if (extent == 0.0) extent = qm_mesh_box_diagonal(&box);
        if (side == 1)
            for (int k = 0; k < 3; k++)
                largest = qm_max(largest, qm_max(fabs(box.min[k]), fabs(box.max[k])));
    }
    int exponent = 0;
    if (extent > 0.0) frexp(extent, &exponent);
    if (exponent < -1000) exponent = -1000;
    work->frames.unit = ldexp(1.0, exponent);
    work->noise = qm_max(1e-10, 0x1p-49 * largest / work->frames.unit);
}

static qm_status init(qm_align_work *work)
{
    const qm_align_options *options = work->options;
    const size_t count = options->sample_count;
    work->counts[0] = options->direction != QM_B_TO_A;
    work->counts[1] = options->direction != QM_A_TO_B;
    make_frames(work);
    work->pair_capacity = 2 * count + MAX_WITNESSES;
    work->pairs = qm_context_alloc(work->ctx, work->pair_capacity, sizeof *work->pairs);
    work->numbers = qm_context_alloc(work->ctx, work->pair_capacity, 3 * sizeof *work->numbers);
    work->feet = qm_context_alloc(work->ctx, count, 3 * sizeof *work->feet);
    work->distances = qm_context_alloc(work->ctx, count, sizeof *work->distances);
    work->uv = qm_context_alloc(work->ctx, count, 2 * sizeof *work->uv);
    work->faces = qm_context_alloc(work->ctx, count, sizeof *work->faces);
    const bool has_memory =
        work->pairs && work->numbers && work->feet && work->distances && work->uv && work->faces;
    if (has_memory && qm_align_points_make(work, 0, count) && qm_align_points_make(work, 1, count))
        return QM_OK;
    return qm_context_fail(work->ctx, QM_E_NO_MEMORY, "out of memory for the alignment");
}

static void reset(qm_align_work *work)
{
    const size_t count = work->options->sample_count;
    for (int side = 0; side < 2; side++)
        qm_context_free(work->ctx, work->points[side].point, work->points[side].capacity,
                        sizeof *work->points[side].point);
    qm_context_free(work->ctx, work->pairs, work->pair_capacity, sizeof *work->pairs);
    qm_context_free(work->ctx, work->numbers, work->pair_capacity, 3 * sizeof *work->numbers);
    qm_context_free(work->ctx, work->feet, count, 3 * sizeof *work->feet);
    qm_context_free(work->ctx, work->distances, count, sizeof *work->distances);
    qm_context_free(work->ctx, work->uv, count, 2 * sizeof *work->uv);
    qm_context_free(work->ctx, work->faces, count, sizeof *work->faces);
}

/** The root mean square over the points of the sides that count, at the end. */
static qm_status measure_end(qm_align_work *work, const qm_align_pose *pose, double *rms)
{
    qm_status status = qm_align_measure(work, pose, work->options->sample_count, NULL, 0);
    double sum = 0.0;
    for (size_t i = 0; status == QM_OK && i < work->pair_count; i++)
        sum += work->pairs[i].distance * work->pairs[i].distance;
    if (status == QM_OK) *rms = sqrt(sum / (double)work->pair_count);
    return status;
}

static qm_status find(qm_align_work *work, qm_align_result *out)
{
    qm_align_ranking ranking;
    qm_status status = qm_align_search_starts(work, &ranking);
    if (status != QM_OK) return status;
    qm_align_pose pose = ranking.best.pose;
    out->is_converged = ranking.best.is_converged;
    double rms = ranking.best.rms;
    if (work->options->fit == QM_ALIGN_MIN_MAX) {
        status = qm_align_lower_maximum(work, &pose, out);
        if (status == QM_OK) status = measure_end(work, &pose, &rms);
        if (status != QM_OK) return status;
    }
    const double unit = work->frames.unit;
    qm_align_pose_transform(&work->frames, &pose, out->transform);
    out->rms = rms * unit;
    out->runner_up_rms = ranking.has_second ? ranking.second.rms * unit : NAN;
    out->scale = pose.scale;
    out->iterations = work->iterations;
    out->is_mirrored = pose.is_mirrored;
    for (int i = 0; i < QM_TRANSFORM_SIZE; i++)
        if (!isfinite(out->transform[i]))
            return qm_context_fail(work->ctx, QM_E_NOT_FINITE, "the motion overflows double precision");
    return QM_OK;
}

static qm_status find_floor(qm_context *ctx, const qm_bvh *a, const qm_bvh *b, double *out)
{
    qm_align_ball ball[2];
    qm_status status = qm_align_enclose(ctx, qm_bvh_mesh(a), &ball[0]);
    if (status == QM_OK) status = qm_align_enclose(ctx, qm_bvh_mesh(b), &ball[1]);
    if (status == QM_OK) *out = qm_align_floor(&ball[0], &ball[1]);
    return status;
}

qm_status qm_align_find(qm_context *ctx, const qm_bvh *a, const qm_bvh *b, const qm_align_options *options,
                        qm_align_result *out)
{
    QM_ASSERT(ctx && a && b && options && out);
    const double start_ms = qm_clock_ms();
    *out = (qm_align_result){.runner_up_rms = NAN, .scale = 1.0};
    qm_status status = check_options(ctx, options);
    if (status == QM_OK && options->motion != QM_ALIGN_RIGID_SCALE)
        status = find_floor(ctx, a, b, &out->floor);
    if (status != QM_OK) return status;
    qm_align_work work = {.ctx = ctx, .tree = {a, b}, .options = options};
    status = init(&work);
    if (status == QM_OK) status = find(&work, out);
    reset(&work);
    out->elapsed_ms = qm_clock_ms() - start_ms;
    return status;
}
