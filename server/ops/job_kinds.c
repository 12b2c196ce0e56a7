/**
 * job_kinds.c: the table of kinds, and an adapter to the engine's call for each.
 */
#include "job_kinds.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"

const char *const qm_priority_names[] = {"low", "normal", "high", NULL};
#define XX(suffix, name, first, second) #name,
const char *const qm_job_kind_names[] = {QM_JOB_MAP(XX) NULL};
#undef XX
const char *const qm_direction_names[] = {"two_sided", "a_to_b", "b_to_a", NULL};
const char *const qm_quads_names[] = {"triangles", "bilinear", NULL};
const char *const qm_accelerator_names[] = {"auto", "boxes", "tetra", "grid", NULL};
const char *const qm_bounds_names[] = {"cover", "matching", "cells", NULL};
const char *const qm_collide_mode_names[] = {"all", "first", "any", NULL};
const char *const qm_tolerance_unit_names[] = {"relative", "absolute", NULL};

qm_job_request qm_job_request_default(void)
{
    return (qm_job_request){
        .kind = QM_JOB_HAUSDORFF,
        .priority = QM_PRIORITY_NORMAL,
        .direction = QM_TWO_SIDED,
        .quads = QM_QUADS_TRIANGLES,
        .tolerance = 1e-6,
        .threshold = NAN,
        .accuracy = 1e-2,
        .pieces = 1u << 20,
        .bins = 50,
        .percentiles = {1, 5, 25, 50, 75, 90, 95, 99},
        .percentile_count = 8,
        .mode = QM_COLLIDE_ALL,
        .list_limit = 1000,
        .goal = {.measures = true},
    };
}

void qm_job_request_reset(qm_job_request *request)
{
    free(request->points);
    request->points = NULL;
    request->point_count = 0;
}

/** A request with its meshes and its context. */
typedef struct job_call {
    qm_context *ctx;
    const qm_job_request *request;
    const qm_loaded_mesh *a, *b;
    qm_hausdorff_progress_fn *progress;
    void *progress_user;
    int threads;
} job_call;

/** The tolerance in the unit of the meshes. */
static double absolute_tolerance(const job_call *call)
{
    bool is_absolute = call->request->tolerance_is_absolute || call->a->diagonal == 0.0;
    return is_absolute ? call->request->tolerance : call->request->tolerance * call->a->diagonal;
}

/* ---- hausdorff ---- */

static qm_status run_hausdorff(const job_call *call, qm_job_result *out)
{
    const qm_job_request *request = call->request;
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.direction = request->direction;
    options.quads = request->quads;
    options.tolerance = absolute_tolerance(call);
    options.threshold = request->threshold;
    options.deadline_ms = request->deadline_ms;
    options.memory_limit = request->memory_limit;
    options.accelerator = request->accelerator;
    options.tetra[0] = call->a->tetra;
    options.tetra[1] = call->b->tetra;
    /* Any other value is the former name of the default. */
    options.bounds = request->bounds == QM_BOUNDS_MATCHING ? QM_BOUNDS_MATCHING : QM_BOUNDS_COVER;
    options.thread_count = call->threads;
    options.progress = call->progress;
    options.progress_user = call->progress_user;
    out->tolerance = options.tolerance;
    qm_status status = qm_hausdorff_measure(call->ctx, call->a->bvh, call->b->bvh, &options, &out->hausdorff);
    if (status != QM_OK) return status;
    const qm_loaded_mesh *source = out->hausdorff.from_side == 0 ? call->a : call->b,
                         *target = source == call->a ? call->b : call->a;
    out->from_face = qm_mesh_input_face(&source->mesh, out->hausdorff.from.face);
    out->to_face = qm_mesh_input_face(&target->mesh, out->hausdorff.to.face);
    out->is_canceled = out->hausdorff.stop == QM_STOP_CANCELED;
    return QM_OK;
}

/* ---- project ---- */

static qm_status run_project(const job_call *call, qm_job_result *out)
{
    const qm_job_request *request = call->request;
    qm_locator locator;
    qm_status status =
        qm_locator_build(call->ctx, call->a->bvh, call->a->tetra, request->accelerator, &locator);
    if (status == QM_OK)
        status = qm_projections_find(call->ctx, call->a, &locator, request->quads, request->points,
                                     request->point_count, call->threads, &out->projections);
    qm_locator_reset(call->ctx, &locator);
    return status;
}

/* ---- deviation ---- */

static qm_status run_deviation(const job_call *call, qm_job_result *out)
{
    const qm_job_request *request = call->request;
    qm_deviation_options options = qm_deviation_options_default();
    options.quads = request->quads;
    options.accuracy = request->accuracy;
    options.tolerance = absolute_tolerance(call);
    options.piece_limit = request->pieces;
    options.percentile = request->percentiles;
    options.percentile_count = request->percentile_count;
    options.bin_count = request->bins;
    options.thread_count = call->threads;
    options.progress = call->progress;
    options.progress_user = call->progress_user;
    out->tolerance = options.tolerance;
    qm_status status = qm_deviation_measure(call->ctx, call->a->bvh, call->b->bvh, &options, &out->deviation);
    out->is_canceled = status == QM_OK && out->deviation.is_canceled;
    return status;
}

/* ---- distance ---- */

static qm_status run_distance(const job_call *call, qm_job_result *out)
{
    qm_distance_options options = {.quads = call->request->quads, .tolerance = absolute_tolerance(call)};
    out->tolerance = options.tolerance;
    qm_status status = qm_distance_measure(call->ctx, call->a->bvh, call->b->bvh, &options, &out->distance);
    out->from_face = qm_mesh_input_face(&call->a->mesh, out->distance.from.face);
    out->to_face = qm_mesh_input_face(&call->b->mesh, out->distance.to.face);
    return status;
}

/* ---- collision, self_collision ---- */

static qm_status run_collision(const job_call *call, qm_job_result *out)
{
    qm_collide_options options = qm_collide_options_default();
    options.quads = call->request->quads;
    options.mode = call->request->mode;
    options.tolerance = out->tolerance = absolute_tolerance(call);
    options.thread_count = call->threads;
    return qm_listed_pairs_find(call->ctx, call->a, call->b, &options, call->request->incremental,
                                call->request->list_limit, &out->pairs);
}

static qm_status run_self_collision(const job_call *call, qm_job_result *out)
{
    return run_collision(call, out);
}

/* ---- reconstruction_step ---- */

static qm_status run_reconstruction_step(const job_call *call, qm_job_result *out)
{
    const qm_job_refinement *refining = call->request->refining;
    qm_refine_goal goal = call->request->goal;
    goal.hausdorff = call->request->hausdorff_relative * refining->source->diagonal;
    goal.thread_count = call->threads;
    qm_status status = qm_refine(call->ctx, refining->reconstruction, refining->source, &goal,
                                 refining->on_step, refining->user, &out->refine_stop);
    out->is_canceled = status == QM_OK && out->refine_stop == QM_REFINE_CANCELED;
    return status;
}

/* ---- any kind ---- */

typedef struct kind_row {
    qm_job_type type;
    qm_status (*run)(const job_call *call, qm_job_result *out);
} kind_row;

static const kind_row rows[] = {
#define XX(suffix, name, first, second)                                                                      \
    {{#name,                                                                                                 \
      {first, second},                                                                                       \
      QM_JOB_##suffix != QM_JOB_RECONSTRUCTION_STEP,                                                         \
      QM_JOB_##suffix == QM_JOB_HAUSDORFF || QM_JOB_##suffix == QM_JOB_DEVIATION},                           \
     run_##name},
    QM_JOB_MAP(XX)
#undef XX
};

const qm_job_type *qm_job_type_of(qm_job_kind kind)
{
    QM_ASSERT(kind < QM_JOB_KIND_COUNT);
    return &rows[kind].type;
}

bool qm_job_kind_find(const char *name, qm_job_kind *out)
{
    for (int kind = 0; kind < QM_JOB_KIND_COUNT; kind++) {
        if (strcmp(rows[kind].type.name, name) != 0) continue;
        *out = (qm_job_kind)kind;
        return true;
    }
    return false;
}

const qm_job_array *qm_job_array_of(qm_job_kind kind)
{
    static const qm_job_array distances = {"vertex_distances", "vertex,distance", 1};
    static const qm_job_array pairs = {"all_pairs", "face_a,face_b", 2};
    static const qm_job_array *const arrays[QM_JOB_KIND_COUNT] = {
        [QM_JOB_DEVIATION] = &distances, [QM_JOB_COLLISION] = &pairs, [QM_JOB_SELF_COLLISION] = &pairs};
    QM_ASSERT(kind < QM_JOB_KIND_COUNT);
    return arrays[kind];
}

static double prepare_ms(const qm_loaded_mesh *mesh)
{
    return mesh ? mesh->parse_ms + mesh->topology_ms + mesh->bvh_ms : 0.0;
}

qm_status qm_job_execute(qm_context *ctx, const qm_job_request *request, const qm_loaded_mesh *a,
                         const qm_loaded_mesh *b, qm_hausdorff_progress_fn *progress, void *progress_user,
                         qm_job_result *out)
{
    *out = (qm_job_result){.kind = request->kind,
                           .diagonal = a->diagonal,
                           .prepare_a_ms = prepare_ms(a),
                           .prepare_b_ms = prepare_ms(b)};
    QM_ASSERT(ctx && a && request->kind < QM_JOB_KIND_COUNT);
    const job_call call = {
        ctx, request, a, b, progress, progress_user, request->threads > 0 ? request->threads : 1};
    double start_ms = qm_clock_now_ms();
    qm_status status = rows[request->kind].run(&call, out);
    out->elapsed_ms = qm_clock_now_ms() - start_ms;
    if (status != QM_OK) qm_job_result_reset(ctx, out);
    return status;
}

const double *qm_job_result_array(const qm_job_result *result, size_t *count)
{
    if (result->pairs.faces) {
        *count = 2 * result->pairs.found.pair_count;
        return result->pairs.faces;
    }
    *count = result->deviation.vertex_count;
    return result->deviation.vertex_distance;
}

void qm_job_result_reset(qm_context *ctx, qm_job_result *result)
{
    /* What other kinds have is empty. */
    qm_projections_reset(ctx, &result->projections);
    qm_deviation_reset(ctx, &result->deviation);
    qm_listed_pairs_reset(ctx, &result->pairs);
}
