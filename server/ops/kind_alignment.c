/**
 * kind_alignment.c: the motion that brings A onto B, and the distance that is left.
 */
#include <cjson/cJSON.h>
#include <math.h>

#include "job_kinds_internal.h"
#include "json_request.h"

const char *const qm_align_fit_names[] = {"least_squares", "min_max", NULL};
const char *const qm_align_start_names[] = {"principal", "centroids", "identity", "landmarks", NULL};
const char *const qm_align_motion_names[] = {"rigid", "rigid_scale", "translation", NULL};
const char *const qm_align_direction_names[] = {"auto", "two_sided", "a_to_b", "b_to_a", NULL};

/* ---- running ---- */

static qm_direction direction_of(const qm_job_request *request)
{
    const qm_align_options *align = &request->align;
    switch (request->align_direction) {
    case QM_JOB_ALIGN_TWO_SIDED:
        return QM_TWO_SIDED;
    case QM_JOB_ALIGN_A_TO_B:
        return QM_A_TO_B;
    case QM_JOB_ALIGN_B_TO_A:
        return QM_B_TO_A;
    case QM_JOB_ALIGN_AUTO:
        break;
    }
    const bool is_partial = align->fit == QM_ALIGN_LEAST_SQUARES && align->motion != QM_ALIGN_RIGID_SCALE;
    return is_partial ? QM_A_TO_B : QM_TWO_SIDED;
}

/** The two-sided Hausdorff distance of the moved mesh, its positions as rounded. */
static qm_status measure_moved(const qm_job_call *call, qm_job_result *out)
{
    const qm_job_request *request = call->request;
    qm_context *ctx = call->ctx;
    qm_mesh moved = call->a->mesh;
    qm_bvh *tree = NULL;
    moved.positions = qm_context_alloc(ctx, moved.vertex_count, 3 * sizeof *moved.positions);
    if (!moved.positions) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the moved mesh");
    qm_status status = qm_transform_positions(ctx, out->alignment.transform, &call->a->mesh, moved.positions);
    if (status == QM_OK) status = qm_mesh_validate(ctx, &moved);
    if (status == QM_OK) status = qm_bvh_build(ctx, &moved, QM_BVH_ALL, call->threads, &tree);
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.quads = request->quads;
    options.tolerance = out->tolerance = qm_job_tolerance(call);
    options.memory_limit = request->memory_limit;
    options.thread_count = call->threads;
    options.progress = call->progress;
    options.progress_user = call->progress_user;
    if (status == QM_OK) status = qm_hausdorff_measure(ctx, tree, call->b->bvh, &options, &out->hausdorff);
    qm_bvh_destroy(ctx, tree);
    qm_context_free(ctx, moved.positions, moved.vertex_count, 3 * sizeof *moved.positions);
    out->is_canceled = status == QM_OK && out->hausdorff.stop == QM_STOP_CANCELED;
    return status;
}

static qm_status run(const qm_job_call *call, qm_job_result *out)
{
    const qm_job_request *request = call->request;
    qm_align_options options = request->align;
    options.direction = direction_of(request);
    options.quads = request->quads;
    options.landmarks = request->landmarks;
    options.landmark_count = request->landmark_count;
    options.thread_count = call->threads;
    qm_status status = qm_align_find(call->ctx, call->a->bvh, call->b->bvh, &options, &out->alignment);
    if (status != QM_OK) return status;
    /* The true A goes with A: it is as near to the moved one as the motion leaves it. */
    const qm_transform_change moved = qm_transform_find_change(out->alignment.transform, &call->a->mesh);
    qm_mesh_move_notes(&moved, &out->notes[0]);
    return measure_moved(call, out);
}

/* ---- the request ---- */

/** Pairs of points, [[x, y, z] of A, [x, y, z] of B]. */
static bool read_landmarks(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    if (!cJSON_IsArray(value) || cJSON_GetArraySize(value) > QM_JOB_MAX_LANDMARKS) return false;
    out->landmark_count = 0;
    for (const cJSON *pair = value->child; pair; pair = pair->next) {
        qm_align_landmark *landmark = &out->landmarks[out->landmark_count];
        at->depth = 1;
        at->index[0] = out->landmark_count++;
        if (!cJSON_IsArray(pair) || cJSON_GetArraySize(pair) != 2) return false;
        at->depth = 2;
        for (int k = 0; k < 2; k++) {
            at->index[1] = (size_t)k;
            if (!qm_json_read_numbers(cJSON_GetArrayItem(pair, k), 3, k == 0 ? landmark->a : landmark->b))
                return false;
        }
    }
    return true;
}

/** null: every distance counts. */
static bool read_max_distance(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    (void)at;
    if (cJSON_IsNull(value)) return true;
    return qm_json_read_number(value, &out->align.max_distance) && out->align.max_distance > 0.0;
}

static bool read_trim(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    (void)at;
    return qm_json_read_number(value, &out->align.trim) && out->align.trim >= 0.0 && out->align.trim <= 0.9;
}

static void check(const qm_job_request *request, qm_problem *problem)
{
    const qm_align_options *align = &request->align;
    const bool needs_landmarks = align->start == QM_ALIGN_LANDMARKS;
    const size_t least = align->motion == QM_ALIGN_TRANSLATION ? 1 : 3;
    if (needs_landmarks && request->landmark_count < least)
        qm_json_report(
            problem, "landmarks",
            "must be given where the search starts from them: three pairs or more, one for a translation");
    if (align->motion == QM_ALIGN_RIGID_SCALE && request->align_direction == QM_JOB_ALIGN_A_TO_B)
        qm_json_report(problem, "direction",
                       "must count distances of B with a scale: A could shrink to a point of B");
    if (align->fit == QM_ALIGN_MIN_MAX && align->trim > 0.0)
        qm_json_report(problem, "trim", "does not go with min_max, which counts every point");
    if (align->fit == QM_ALIGN_MIN_MAX && isfinite(align->max_distance))
        qm_json_report(problem, "max_distance", "does not go with min_max, which counts every point");
}

static void write_request(qm_text *out, const qm_job_request *request, bool is_brief)
{
    (void)is_brief;
    const qm_align_options *align = &request->align;
    qm_json_add_string(out, "fit", qm_align_fit_names[align->fit]);
    qm_json_add_string(out, "start", qm_align_start_names[align->start]);
    qm_json_add_string(out, "motion", qm_align_motion_names[align->motion]);
    if (request->align_direction != QM_JOB_ALIGN_AUTO)
        qm_json_add_string(out, "direction", qm_align_direction_names[request->align_direction]);
    if (align->trim > 0.0) qm_json_add_number(out, "trim", align->trim);
    if (isfinite(align->max_distance)) qm_json_add_number(out, "max_distance", align->max_distance);
    if (align->may_mirror) qm_json_add_bool(out, "mirror", true);
    qm_json_add_count(out, "samples", align->sample_count);
    qm_job_add_gap(out, request);
    if (request->landmark_count == 0) return;
    qm_json_open(out, "landmarks", "[");
    for (size_t i = 0; i < request->landmark_count; i++) {
        qm_json_add_comma(out);
        qm_text_add_string(out, "[");
        qm_json_add_array(out, request->landmarks[i].a, 3);
        qm_json_add_array(out, request->landmarks[i].b, 3);
        qm_text_add_string(out, "]");
    }
    qm_text_add_string(out, "]");
}

/* ---- the result ---- */

static void write_result(qm_text *out, const qm_job_request *request, const qm_job_result *result)
{
    const qm_align_result *align = &result->alignment;
    const qm_hausdorff_result *h = &result->hausdorff;
    qm_json_add_numbers(out, "transform", align->transform, QM_TRANSFORM_SIZE);
    qm_json_add_number(out, "rms", align->rms);
    qm_json_add_number(out, "scale", align->scale);
    qm_json_add_bool(out, "mirrored", align->is_mirrored);
    if (request->align.motion == QM_ALIGN_RIGID_SCALE)
        qm_json_add_word(out, "floor", "null");
    else
        qm_json_add_number(out, "floor", align->floor);
    qm_json_open(out, "certainty", "{");
    qm_json_add_number(out, "runner_up_rms", align->runner_up_rms);
    qm_text_add_string(out, "}");
    qm_json_open(out, "hausdorff", "{");
    qm_json_add_lower_upper(out, h->lower, h->upper, result->diagonal);
    qm_job_add_of_true(out, result, (qm_interval){h->lower, h->upper});
    qm_json_add_bool(out, "converged", h->stop == QM_STOP_CONVERGED);
    qm_text_add_string(out, "}");
    qm_json_add_string(out, "fit", qm_align_fit_names[request->align.fit]);
    qm_json_add_string(out, "quads", qm_quads_names[request->quads]);
    qm_json_add_number(out, "gap", result->tolerance);
    qm_json_add_count(out, "iterations", align->iterations);
    qm_json_add_count(out, "rounds", align->rounds);
    qm_json_add_bool(out, "converged", align->is_converged);
    qm_json_add_prepare_ms(out, result);
    qm_json_add_ms(out, "elapsed_ms", result->elapsed_ms);
}

static const qm_job_field fields[] = {
    QM_JOB_FIELD_PAIR,
    QM_JOB_FIELD_QUADS,
    QM_JOB_FIELDS_GAP,
    {"fit", QM_FIELD_CHOICE, QM_FIELD_AT(align.fit), .names = qm_align_fit_names},
    {"start", QM_FIELD_CHOICE, QM_FIELD_AT(align.start), .names = qm_align_start_names},
    {"motion", QM_FIELD_CHOICE, QM_FIELD_AT(align.motion), .names = qm_align_motion_names},
    {"direction", QM_FIELD_CHOICE, QM_FIELD_AT(align_direction), .names = qm_align_direction_names},
    {"landmarks", QM_FIELD_OTHER, .read = read_landmarks,
     .expected = "must be an array of at most 32 pairs of points, each [[x, y, z] of A, [x, y, z] of B]"},
    {"trim", QM_FIELD_OTHER, .read = read_trim, .expected = "must be a number from 0 to 0.9"},
    {"max_distance", QM_FIELD_OTHER, .read = read_max_distance,
     .expected = "must be a number above 0, or null"},
    {"mirror", QM_FIELD_FLAG, QM_FIELD_AT(align.may_mirror)},
    {"samples", QM_FIELD_COUNT, QM_FIELD_AT(align.sample_count), .min = QM_ALIGN_MIN_SAMPLES,
     .max = QM_ALIGN_MAX_SAMPLES},
    {0}};

const qm_job_hooks qm_job_kind_alignment = {
    .type = {.name = "alignment", .mesh_field = {"a", "b"}, .is_pure = true},
    .fields = fields,
    .check = check,
    .run = run,
    .write_request = write_request,
    .write_result = write_result};
