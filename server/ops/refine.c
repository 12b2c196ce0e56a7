#include "refine.h"

#include <math.h>
#include <string.h>

#include "base/clock.h"

#define TOLERANCE 1e-5      /* of the diagonal: how closely a distance is measured */
#define GOAL_TOLERANCE 0.05 /* of the goal, when that is closer */
/* Of all points: so many more may be out of reach, as samples told the share    \ */
#define UNCOVERED_SLACK 1e-3
#define DEADLINE_MS 20000.0 /* for the distance after one step; the bounds hold whenever it ends */

typedef struct refinement {
    qm_context *ctx;
    const qm_source *source;
    const qm_reconstruction *reconstruction;
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

/** Where the points of a set lie nearest to the mesh of a step. */
typedef struct point_feet {
    size_t count;
    qm_projection feet;
    bool *on_rim;
} point_feet;

static void free_feet(qm_context *ctx, const point_feet *f)
{
    qm_context_free(ctx, f->feet.distance, f->count, sizeof *f->feet.distance);
    qm_context_free(ctx, f->feet.face, f->count, sizeof *f->feet.face);
    qm_context_free(ctx, f->feet.uv, f->count, 2 * sizeof *f->feet.uv);
    qm_context_free(ctx, f->on_rim, f->count, sizeof *f->on_rim);
}

/** The feet of so many points, for free_feet whatever is returned. */
static qm_status find_feet(const refinement *r, const qm_bvh *mesh, const double *points, size_t count,
                           point_feet *f)
{
    *f = (point_feet){.count = count};
    f->feet.distance = qm_context_alloc(r->ctx, count, sizeof *f->feet.distance);
    f->feet.face = qm_context_alloc(r->ctx, count, sizeof *f->feet.face);
    f->feet.uv = qm_context_alloc(r->ctx, count, 2 * sizeof *f->feet.uv);
    f->on_rim = qm_context_alloc(r->ctx, count, sizeof *f->on_rim);
    if (!f->feet.distance || !f->feet.face || !f->feet.uv || !f->on_rim)
        return qm_context_fail(r->ctx, QM_E_NO_MEMORY, "out of memory for %zu distances", count);
    qm_status status =
        qm_project_points(r->ctx, mesh, QM_QUADS_TRIANGLES, points, count, r->goal->thread_count, &f->feet);
    if (status != QM_OK) return status;
    return qm_reconstruction_find_rim(r->ctx, r->reconstruction, f->feet.face, f->feet.uv, count, f->on_rim);
}

/** The farthest of the points, of those that are covered, and how many are not. */
static qm_status measure_points(const refinement *r, const qm_bvh *mesh, qm_refine_record *record)
{
    const qm_mesh *cloud = qm_bvh_mesh(r->source->bvh);
    point_feet f;
    qm_status status = find_feet(r, mesh, cloud->positions, cloud->vertex_count, &f);
    record->upper = record->covered = 0.0;
    record->uncovered = record->beyond = 0;
    for (size_t i = 0; i < f.count && status == QM_OK; i++) {
        double distance = f.feet.distance[i];
        record->upper = fmax(record->upper, distance);
        if (distance > r->reach)
            record->uncovered++;
        else if (f.on_rim[i])
            record->beyond++;
        else
            record->covered = fmax(record->covered, distance);
    }
    record->lower = record->upper;
    free_feet(r->ctx, &f);
    return status;
}

/** A rim that coarse quads cut short leaves drawn points beyond the mesh: so the rim counts as it was
 * drawn. */
static qm_status measure_rim(const refinement *r, const qm_bvh *mesh, qm_refine_record *record)
{
    double *points;
    size_t count;
    qm_status status = qm_reconstruction_rim(r->ctx, r->reconstruction, &points, &count);
    if (status != QM_OK || count == 0) return status;
    point_feet f;
    status = find_feet(r, mesh, points, count, &f);
    for (size_t i = 0; i < count && status == QM_OK; i++)
        record->covered = fmax(record->covered, f.feet.distance[i]);
    free_feet(r->ctx, &f);
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

/** True when all count but the points that no patch reached from the start, and those beyond the rim. */
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
    refinement r = {ctx,
                    source,
                    reconstruction,
                    goal,
                    qm_reconstruction_cover_distance(reconstruction),
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
