/**
 * refine.c: the loop of steps, and the distance after each.
 */
#include "refine.h"

#include <math.h>
#include <string.h>

#include "base/clock.h"

#define TOLERANCE 1e-5      /* of a measured distance, a fraction of the diagonal */
#define GOAL_TOLERANCE 0.05 /* of a measured distance, a fraction of the goal, if that is smaller */
#define DEADLINE_MS 20000.0 /* of one measurement; its bounds are valid when it ends early */
/* Fraction of the points that may stay uncovered beyond the estimate, which was made from samples. */
#define UNCOVERED_SLACK 1e-3

typedef struct refinement {
    qm_context *ctx;
    const qm_ref_surface *source;
    const qm_reconstruction *reconstruction;
    const qm_refine_goal *goal;
    double cover_distance;
    double uncovered_fraction; /* of the points, before the first step */
} refinement;

const char *qm_refine_stop_name(qm_refine_stop stop)
{
    static const char *const names[] = {"steps", "max_quads", "edge_length", "hausdorff", "canceled"};
    return names[stop];
}

qm_status qm_refine_measure(qm_context *ctx, const qm_ref_surface *source, const qm_bvh *mesh,
                            qm_direction direction, double tolerance, const qm_refine_goal *goal,
                            double *lower, double *upper)
{
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.direction = direction;
    options.tolerance = tolerance * source->diagonal;
    if (goal->hausdorff > 0.0) options.tolerance = fmin(options.tolerance, GOAL_TOLERANCE * goal->hausdorff);
    options.deadline_ms = DEADLINE_MS;
    options.thread_count = goal->thread_count;
    qm_hausdorff_result result;
    qm_status status = qm_hausdorff_measure(ctx, source->bvh, mesh, &options, &result);
    QM_ASSERT(status != QM_OK || result.lower <= result.upper);
    *lower = result.lower;
    *upper = result.upper;
    return status;
}

static qm_status measure(const refinement *r, const qm_bvh *mesh, qm_direction direction, double *lower,
                         double *upper)
{
    return qm_refine_measure(r->ctx, r->source, mesh, direction, TOLERANCE, r->goal, lower, upper);
}

/** Projections of points onto the mesh of a step. */
typedef struct point_projections {
    size_t count;
    qm_projection nearest;
    bool *on_rim;
} point_projections;

static void free_projections(qm_context *ctx, const point_projections *p)
{
    qm_context_free(ctx, p->nearest.distance, p->count, sizeof *p->nearest.distance);
    qm_context_free(ctx, p->nearest.face, p->count, sizeof *p->nearest.face);
    qm_context_free(ctx, p->nearest.uv, p->count, 2 * sizeof *p->nearest.uv);
    qm_context_free(ctx, p->on_rim, p->count, sizeof *p->on_rim);
}

/** Projects points; *p is for free_projections, also after an error. */
static qm_status project_points(const refinement *r, const qm_bvh *mesh, const double *points, size_t count,
                                point_projections *p)
{
    *p = (point_projections){.count = count};
    p->nearest.distance = qm_context_alloc(r->ctx, count, sizeof *p->nearest.distance);
    p->nearest.face = qm_context_alloc(r->ctx, count, sizeof *p->nearest.face);
    p->nearest.uv = qm_context_alloc(r->ctx, count, 2 * sizeof *p->nearest.uv);
    p->on_rim = qm_context_alloc(r->ctx, count, sizeof *p->on_rim);
    if (!p->nearest.distance || !p->nearest.face || !p->nearest.uv || !p->on_rim)
        return qm_context_fail(r->ctx, QM_E_NO_MEMORY, "out of memory for %zu distances", count);
    qm_status status = qm_project_points(r->ctx, mesh, QM_QUADS_TRIANGLES, points, count,
                                         r->goal->thread_count, &p->nearest);
    if (status != QM_OK) return status;
    return qm_reconstruction_mark_boundary(r->ctx, r->reconstruction, p->nearest.face, p->nearest.uv, count,
                                           p->on_rim);
}

/** Max distances of all points and of the covered ones, and the number of the others. */
static qm_status measure_points(const refinement *r, const qm_bvh *mesh, qm_refine_record *record)
{
    const qm_mesh *cloud = qm_bvh_mesh(r->source->bvh);
    point_projections p;
    qm_status status = project_points(r, mesh, cloud->positions, cloud->vertex_count, &p);
    record->upper = record->covered = 0.0;
    record->uncovered = record->beyond = 0;
    for (size_t i = 0; i < p.count && status == QM_OK; i++) {
        double distance = p.nearest.distance[i];
        record->upper = fmax(record->upper, distance);
        if (distance > r->cover_distance)
            record->uncovered++;
        else if (p.on_rim[i])
            record->beyond++;
        else
            record->covered = fmax(record->covered, distance);
    }
    record->lower = record->upper;
    free_projections(r->ctx, &p);
    return status;
}

/** Coarse quads shorten the boundary and leave points beyond the mesh, so the boundary as it was drawn counts too. */
static qm_status measure_rim(const refinement *r, const qm_bvh *mesh, qm_refine_record *record)
{
    double *points;
    size_t count;
    qm_status status = qm_reconstruction_boundary(r->ctx, r->reconstruction, &points, &count);
    if (status != QM_OK || count == 0) return status;
    point_projections p;
    status = project_points(r, mesh, points, count, &p);
    for (size_t i = 0; i < count && status == QM_OK; i++)
        record->covered = fmax(record->covered, p.nearest.distance[i]);
    free_projections(r->ctx, &p);
    qm_context_free(r->ctx, points, count, 3 * sizeof *points);
    return status;
}

static qm_status measure_distance(const refinement *r, const qm_mesh *mesh, qm_refine_record *record)
{
    qm_bvh *tree = NULL;
    qm_status status = qm_bvh_build(r->ctx, mesh, QM_BVH_TARGET, r->goal->thread_count, &tree);
    if (status == QM_OK && r->source->is_cloud) {
        status = measure_points(r, tree, record);
        if (status == QM_OK) status = measure_rim(r, tree, record);
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

/** The quality of the quads, and the distance if it is requested. */
static qm_status measure_step(const refinement *r, const qm_reconstruction *reconstruction,
                              qm_refine_record *record)
{
    double start = qm_clock_now_ms();
    qm_mesh mesh;
    qm_status status = qm_reconstruction_mesh(r->ctx, reconstruction, &mesh);
    if (status != QM_OK) return status;
    qm_quality_measure(&mesh, &record->quality);
    if (r->goal->measures || r->goal->hausdorff > 0.0) status = measure_distance(r, &mesh, record);
    qm_mesh_reset(r->ctx, &mesh);
    record->measure_ms = qm_clock_now_ms() - start;
    return status;
}

/** True if the distance is reached, ignoring points that no patch covered at the start or that lie beyond the boundary. */
static bool is_near(const refinement *r, const qm_refine_record *record)
{
    if (!record->is_measured) return false;
    if (record->upper <= r->goal->hausdorff) return true;
    if (!r->source->is_cloud || record->covered > r->goal->hausdorff) return false;
    double points = (double)qm_bvh_mesh(r->source->bvh)->vertex_count;
    return (double)record->uncovered <= (r->uncovered_fraction + UNCOVERED_SLACK) * points;
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

static size_t find_limit(const qm_refine_goal *goal)
{
    if (goal->max_quads > 0) return goal->max_quads;
    bool has_goal = goal->steps > 0 || goal->edge > 0.0 || goal->hausdorff > 0.0;
    return has_goal ? QM_REFINE_MAX_QUADS : QM_REFINE_DEFAULT_QUADS;
}

static size_t count_quads(const qm_reconstruction *reconstruction)
{
    size_t quads = 0;
    for (size_t p = 0; p < qm_reconstruction_patch_count(reconstruction); p++) {
        qm_reconstruction_patch patch = qm_reconstruction_get_patch(reconstruction, p);
        quads += (size_t)patch.columns * patch.rows;
    }
    return quads;
}

qm_status qm_refine(qm_context *ctx, qm_reconstruction *reconstruction, const qm_ref_surface *source,
                    const qm_refine_goal *goal, qm_refine_fn *on_step, void *user, qm_refine_stop *stop)
{
    QM_ASSERT(on_step && goal->thread_count >= 1);
    size_t points, uncovered;
    qm_reconstruction_coverage(reconstruction, &points, &uncovered);
    refinement r = {ctx,
                    source,
                    reconstruction,
                    goal,
                    qm_reconstruction_cover_distance(reconstruction),
                    (double)uncovered / (double)points};
    size_t max_quads = find_limit(goal), quads = count_quads(reconstruction);
    if (quads > max_quads)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "the mesh has %zu quads already, the limit is %zu", quads,
                               max_quads);
    for (size_t steps = 1;; steps++) {
        if (qm_context_canceled(ctx)) return *stop = QM_REFINE_CANCELED, QM_OK;
        qm_refine_record record = {0};
        double start = qm_clock_now_ms();
        qm_status status = qm_reconstruction_step(ctx, reconstruction, max_quads, &record.step);
        record.step_ms = qm_clock_now_ms() - start;
        if (status == QM_E_CANCELED) return *stop = QM_REFINE_CANCELED, QM_OK;
        if (status != QM_OK) return status;
        if (record.step.chords_changed == 0) {
            /* Of one quad a patch nothing was asked yet: a limit that allows no step is a mistake. */
            if (quads > qm_reconstruction_patch_count(reconstruction) || steps > 1)
                return *stop = QM_REFINE_QUADS, QM_OK;
            return qm_context_fail(
                ctx, QM_E_ARGUMENT,
                "no step fits into the limit of %zu quads: the mesh has %zu, one a patch, and a "
                "step doubles a row of patches",
                max_quads, quads);
        }
        status = measure_step(&r, reconstruction, &record);
        /* A step is complete even if the measurement of its distance was canceled. */
        if (status != QM_OK && status != QM_E_CANCELED) return status;
        on_step(user, &record);
        if (is_reached(&r, &record, steps, stop)) return QM_OK;
    }
}
