#include "job_kinds.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"

qm_job_request qm_job_request_default(void)
{
    return (qm_job_request){
        .kind = QM_JOB_HAUSDORFF,
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

/** One question of any kind, with everything that its runner needs. */
typedef struct question {
    qm_context *ctx;
    const qm_job_request *request;
    const qm_loaded_mesh *a, *b;
    qm_hausdorff_progress_fn *progress;
    void *progress_user;
    int threads;
} question;

/** What the request's tolerance is in the unit of the meshes. */
static double absolute_tolerance(const question *q)
{
    bool is_absolute = q->request->tolerance_is_absolute || q->a->diagonal == 0.0;
    return is_absolute ? q->request->tolerance : q->request->tolerance * q->a->diagonal;
}

/* ---- hausdorff ---- */

static qm_status run_hausdorff(const question *q, qm_job_result *out)
{
    const qm_job_request *request = q->request;
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.direction = request->direction;
    options.quads = request->quads;
    options.tolerance = absolute_tolerance(q);
    options.threshold = request->threshold;
    options.deadline_ms = request->deadline_ms;
    options.memory_limit = request->memory_limit;
    options.accelerator = request->accelerator;
    options.tetra[0] = q->a->tetra;
    options.tetra[1] = q->b->tetra;
    options.bounds = request->bounds;
    options.thread_count = q->threads;
    options.progress = q->progress;
    options.progress_user = q->progress_user;
    out->tolerance = options.tolerance;
    qm_status status = qm_hausdorff_measure(q->ctx, q->a->bvh, q->b->bvh, &options, &out->hausdorff);
    if (status != QM_OK) return status;
    const qm_loaded_mesh *source = out->hausdorff.from_side == 0 ? q->a : q->b,
                         *target = source == q->a ? q->b : q->a;
    out->from_face = qm_mesh_input_face(&source->mesh, out->hausdorff.from.face);
    out->to_face = qm_mesh_input_face(&target->mesh, out->hausdorff.to.face);
    out->is_canceled = out->hausdorff.stop == QM_STOP_CANCELED;
    return QM_OK;
}

static void reset_hausdorff(qm_context *ctx, qm_job_result *result)
{
    (void)ctx, (void)result;
}

/* ---- project ---- */

static void reset_project(qm_context *ctx, qm_job_result *result)
{
    qm_projections_reset(ctx, &result->feet);
}

static qm_status run_project(const question *q, qm_job_result *out)
{
    const qm_job_request *request = q->request;
    qm_locator locator;
    qm_status status = qm_locator_build(q->ctx, q->a->bvh, q->a->tetra, request->accelerator, &locator);
    if (status == QM_OK)
        status = qm_projections_find(q->ctx, q->a, &locator, request->quads, request->points,
                                     request->point_count, q->threads, &out->feet);
    qm_locator_reset(q->ctx, &locator);
    return status;
}

/* ---- deviation ---- */

static void reset_deviation(qm_context *ctx, qm_job_result *result)
{
    qm_deviation_reset(ctx, &result->deviation);
}

static qm_status run_deviation(const question *q, qm_job_result *out)
{
    const qm_job_request *request = q->request;
    qm_deviation_options options = qm_deviation_options_default();
    options.quads = request->quads;
    options.accuracy = request->accuracy;
    options.tolerance = absolute_tolerance(q);
    options.piece_limit = request->pieces;
    options.percentile = request->percentiles;
    options.percentile_count = request->percentile_count;
    options.bin_count = request->bins;
    options.thread_count = q->threads;
    options.progress = q->progress;
    options.progress_user = q->progress_user;
    out->tolerance = options.tolerance;
    qm_status status = qm_deviation_measure(q->ctx, q->a->bvh, q->b->bvh, &options, &out->deviation);
    out->is_canceled = status == QM_OK && out->deviation.is_canceled;
    return status;
}

/* ---- distance ---- */

static void reset_distance(qm_context *ctx, qm_job_result *result)
{
    (void)ctx, (void)result;
}

static qm_status run_distance(const question *q, qm_job_result *out)
{
    qm_distance_options options = {.quads = q->request->quads, .tolerance = absolute_tolerance(q)};
    out->tolerance = options.tolerance;
    qm_status status = qm_distance_measure(q->ctx, q->a->bvh, q->b->bvh, &options, &out->distance);
    out->from_face = qm_mesh_input_face(&q->a->mesh, out->distance.from.face);
    out->to_face = qm_mesh_input_face(&q->b->mesh, out->distance.to.face);
    return status;
}

/* ---- collision, self_collision ---- */

static void reset_collision(qm_context *ctx, qm_job_result *result)
{
    qm_told_pairs_reset(ctx, &result->pairs);
}

static qm_status run_collision(const question *q, qm_job_result *out)
{
    qm_collide_options options = qm_collide_options_default();
    options.quads = q->request->quads;
    options.mode = q->request->mode;
    options.tolerance = out->tolerance = absolute_tolerance(q);
    options.thread_count = q->threads;
    return qm_told_pairs_find(q->ctx, q->a, q->b, &options, q->request->incremental, q->request->list_limit,
                              &out->pairs);
}

static void reset_self_collision(qm_context *ctx, qm_job_result *result)
{
    reset_collision(ctx, result);
}

static qm_status run_self_collision(const question *q, qm_job_result *out)
{
    return run_collision(q, out);
}

/* ---- reconstruction_step ---- */

static void reset_reconstruction_step(qm_context *ctx, qm_job_result *result)
{
    (void)ctx, (void)result;
}

static qm_status run_reconstruction_step(const question *q, qm_job_result *out)
{
    const qm_job_refining *refining = q->request->refining;
    qm_refine_goal goal = q->request->goal;
    goal.hausdorff = q->request->hausdorff_relative * refining->source->diagonal;
    goal.thread_count = q->threads;
    qm_status status = qm_refine(q->ctx, refining->reconstruction, refining->source, &goal, refining->on_step,
                                 refining->user, &out->refine_stop);
    out->is_canceled = status == QM_OK && out->refine_stop == QM_REFINE_CANCELED;
    return status;
}

/* ---- any kind ---- */

typedef struct runner {
    qm_job_type type;
    qm_status (*run)(const question *question, qm_job_result *out);
    void (*reset)(qm_context *ctx, qm_job_result *result);
} runner;

static const runner runners[] = {
#define XX(suffix, name, first, second)                                                                      \
    {{#name, {first, second}, QM_JOB_##suffix != QM_JOB_RECONSTRUCTION_STEP}, run_##name, reset_##name},
    QM_JOB_MAP(XX)
#undef XX
};

const qm_job_type *qm_job_type_of(qm_job_kind kind)
{
    return &runners[kind].type;
}

bool qm_job_kind_find(const char *name, qm_job_kind *out)
{
    for (int kind = 0; kind < QM_JOB_KIND_COUNT; kind++) {
        if (strcmp(runners[kind].type.name, name) != 0) continue;
        *out = (qm_job_kind)kind;
        return true;
    }
    return false;
}

const qm_job_array *qm_job_array_of(qm_job_kind kind)
{
    static const qm_job_array distances = {"vertex_distances", "vertex,distance", 1};
    static const qm_job_array pairs = {"all_pairs", "face_a,face_b", 2};
    bool has_pairs = kind == QM_JOB_COLLISION || kind == QM_JOB_SELF_COLLISION;
    return kind == QM_JOB_DEVIATION ? &distances : has_pairs ? &pairs : NULL;
}

static double prepare_ms(const qm_loaded_mesh *mesh)
{
    return mesh ? mesh->parse_ms + mesh->topology_ms + mesh->bvh_ms : 0.0;
}

qm_status qm_job_answer(qm_context *ctx, const qm_job_request *request, const qm_loaded_mesh *a,
                        const qm_loaded_mesh *b, qm_hausdorff_progress_fn *progress, void *progress_user,
                        qm_job_result *out)
{
    *out = (qm_job_result){.kind = request->kind,
                           .diagonal = a->diagonal,
                           .prepare_a_ms = prepare_ms(a),
                           .prepare_b_ms = prepare_ms(b)};
    question asked = {
        ctx, request, a, b, progress, progress_user, request->threads > 0 ? request->threads : 1};
    double start_ms = qm_now_ms();
    qm_status status = runners[request->kind].run(&asked, out);
    out->elapsed_ms = qm_now_ms() - start_ms;
    if (status != QM_OK) qm_job_result_reset(ctx, out);
    return status;
}

const double *qm_job_result_array(const qm_job_result *result, size_t *count)
{
    if (result->pairs.rows) {
        *count = 2 * result->pairs.found.pair_count;
        return result->pairs.rows;
    }
    *count = result->deviation.vertex_count;
    return result->deviation.vertex_distance;
}

void qm_job_result_reset(qm_context *ctx, qm_job_result *result)
{
    runners[result->kind].reset(ctx, result);
}
