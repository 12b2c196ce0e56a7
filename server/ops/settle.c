/**
 * settle.c: a mesh is settled, and compared with what it was.
 */
#include "settle.h"

#include <string.h>

#include "refine.h"

#define TOLERANCE 1e-6  /* of the measured distance, a fraction of the diagonal */
#define MOST_RATIO 1.25 /* of the distance, by which it may grow: the quads are better */

static qm_status measure(qm_context *ctx, const qm_ref_surface *surface, const qm_settle_goal *goal,
                         const qm_mesh *mesh, qm_interval *out)
{
    const qm_refine_goal how = {.hausdorff = goal->distance, .thread_count = goal->quads.thread_count};
    return qm_refine_measure_mesh(ctx, surface, mesh, TOLERANCE, &how, &out->lower, &out->upper);
}

static bool is_kept(const qm_settle_goal *goal, const qm_interval *before, const qm_interval *after)
{
    if (goal->distance > 0.0 && before->upper <= goal->distance) return after->upper <= goal->distance;
    return after->upper <= MOST_RATIO * before->upper;
}

qm_status qm_settle(qm_context *ctx, const qm_ref_surface *surface, const qm_settle_goal *goal, qm_mesh *mesh,
                    double *lower, double *upper)
{
    qm_interval before, after;
    qm_status status = measure(ctx, surface, goal, mesh, &before);
    if (status != QM_OK) return status;
    size_t count = 3 * mesh->vertex_count;
    double *positions = qm_context_alloc(ctx, count, sizeof *positions);
    if (!positions) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a copy of the vertices");
    memcpy(positions, mesh->positions, count * sizeof *positions);
    status = qm_quads_settle(ctx, surface->bvh, &goal->quads, mesh);
    if (status == QM_OK) status = measure(ctx, surface, goal, mesh, &after);
    if (status == QM_OK && !is_kept(goal, &before, &after)) {
        memcpy(mesh->positions, positions, count * sizeof *positions);
        after = before;
    }
    qm_context_free(ctx, positions, count, sizeof *positions);
    if (status != QM_OK) return status;
    *lower = after.lower;
    *upper = after.upper;
    return QM_OK;
}
