#include "refine.h"

#include <math.h>
#include <string.h>

#include "clock.h"

#define TOLERANCE 1e-5      /* of the diagonal: how closely a distance is measured */
#define GOAL_TOLERANCE 0.05 /* of the goal, when that is closer */
#define UNCOVERED_SLACK                                                                                      \
    1e-3                    /* of all points: so many more may be out of reach, as samples told the share    \
                             */
#define DEADLINE_MS 20000.0 /* for the distance after one step; the bounds hold whenever it ends */

typedef struct refinement {
    qm_context *ctx;
    const qm_source *source;
    const qm_refine_goal *goal;
    double reach;
    double uncovered_share; /* of the points, before the first step */
} refinement;

const char *qm_refine_stop_name(qm_refine_stop stop)
{
    static const char *const names[] = {"steps", "max_quads", "edge_length", "hausdorff", "canceled"};
    return names[stop];
}

static qm_status measure(const refinement *r, const qm_bvh *mesh, qm_direction direction, double *lower,
                         double *upper)
{
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.direction = direction;
    options.tolerance = TOLERANCE * r->source->diagonal;
    if (r->goal->hausdorff > 0.0)
        options.tolerance = fmin(options.tolerance, GOAL_TOLERANCE * r->goal->hausdorff);
    options.deadline_ms = DEADLINE_MS;
    options.thread_count = r->goal->thread_count;
    qm_hausdorff_result result;
    qm_status status = qm_hausdorff_measure(r->ctx, r->source->bvh, mesh, &options, &result);
    *lower = result.lower;
    *upper = result.upper;
    return status;
}

/** The farthest of the points that are covered, and how many are not. */
static qm_status measure_points(const refinement *r, const qm_bvh *mesh, qm_refine_record *record)
{
    const qm_mesh *cloud = qm_bvh_mesh(r->source->bvh);
    size_t count = cloud->vertex_count;
    double *distance = qm_context_alloc(r->ctx, count, sizeof *distance);
    if (!distance) return qm_context_fail(r->ctx, QM_E_NO_MEMORY, "out of memory for %zu distances", count);
    qm_projection feet = {.distance = distance};
    qm_status status = qm_project_points(r->ctx, mesh, QM_QUADS_TRIANGLES, cloud->positions, count,
                                         r->goal->thread_count, &feet);
    record->upper = record->covered = 0.0;
    record->uncovered = 0;
    for (size_t i = 0; i < count && status == QM_OK; i++) {
        record->upper = fmax(record->upper, distance[i]);
        if (distance[i] > r->reach)
            record->uncovered++;
        else
            record->covered = fmax(record->covered, distance[i]);
    }
    record->lower = record->upper;
    qm_context_free(r->ctx, distance, count, sizeof *distance);
    return status;
}

static qm_status measure_distance(const refinement *r, const qm_mesh *mesh, qm_refine_record *record)
{
    qm_bvh *tree = NULL;
    qm_status status = qm_bvh_build(r->ctx, mesh, QM_BVH_TARGET, r->goal->thread_count, &tree);
    if (status == QM_OK && r->source->is_cloud) {
        status = measure_points(r, tree, record);
        if (status == QM_OK)
            status =
                measure(r, tree, QM_B_TO_A, &record->mesh_to_points_lower, &record->mesh_to_points_upper);
    } else if (status == QM_OK) {
        status = measure(r, tree, QM_TWO_SIDED, &record->lower, &record->upper);
    }
    qm_bvh_destroy(r->ctx, tree);
    record->is_measured = status == QM_OK;
    return status;
}

/** The quads' shape, and the distance if it is wanted. */
static qm_status measure_step(const refinement *r, const qm_reconstruction *reconstruction,
                              qm_refine_record *record)
{
    double start = qm_now_ms();
    qm_mesh mesh;
    qm_status status = qm_reconstruction_mesh(r->ctx, reconstruction, &mesh);
    if (status != QM_OK) return status;
    qm_quality_measure(&mesh, &record->quality);
    if (r->goal->measures || r->goal->hausdorff > 0.0) status = measure_distance(r, &mesh, record);
    qm_mesh_reset(r->ctx, &mesh);
    record->measure_ms = qm_now_ms() - start;
    return status;
}

/** True when all count but the points that no patch reached from the start. */
static bool is_near(const refinement *r, const qm_refine_record *record)
{
    if (!record->is_measured) return false;
    if (record->upper <= r->goal->hausdorff) return true;
    if (!r->source->is_cloud || record->covered > r->goal->hausdorff) return false;
    double points = (double)qm_bvh_mesh(r->source->bvh)->vertex_count;
    return (double)record->uncovered <= (r->uncovered_share + UNCOVERED_SLACK) * points;
}

static bool is_reached(const refinement *r, const qm_refine_record *record, size_t steps,
                       qm_refine_stop *stop)
{
    const qm_refine_goal *goal = r->goal;
    if (goal->hausdorff > 0.0 && is_near(r, record)) return *stop = QM_REFINE_HAUSDORFF, true;
    if (goal->edge > 0.0 && record->step.longest_edge <= goal->edge) return *stop = QM_REFINE_EDGE, true;
    if (goal->steps > 0 && steps >= goal->steps) return *stop = QM_REFINE_STEPS, true;
    return false;
}

qm_status qm_refine(qm_context *ctx, qm_reconstruction *reconstruction, const qm_source *source,
                    const qm_refine_goal *goal, qm_refine_fn *on_step, void *user, qm_refine_stop *stop)
{
    size_t points, uncovered;
    qm_reconstruction_coverage(reconstruction, &points, &uncovered);
    refinement r = {ctx, source, goal, qm_reconstruction_cover_distance(reconstruction),
                    (double)uncovered / (double)points};
    size_t max_quads = goal->max_quads > 0 ? goal->max_quads : QM_REFINE_MOST_QUADS;
    for (size_t steps = 1;; steps++) {
        if (qm_context_canceled(ctx)) return *stop = QM_REFINE_CANCELED, QM_OK;
        qm_refine_record record = {0};
        double start = qm_now_ms();
        qm_status status = qm_reconstruction_step(ctx, reconstruction, max_quads, &record.step);
        record.step_ms = qm_now_ms() - start;
        if (status == QM_E_CANCELED) return *stop = QM_REFINE_CANCELED, QM_OK;
        if (status != QM_OK) return status;
        if (record.step.chords_doubled == 0) return *stop = QM_REFINE_QUADS, QM_OK;
        status = measure_step(&r, reconstruction, &record);
        /* A step whose distance was not measured to the end is whole all the same. */
        if (status != QM_OK && status != QM_E_CANCELED) return status;
        on_step(user, &record);
        if (is_reached(&r, &record, steps, stop)) return QM_OK;
    }
}
