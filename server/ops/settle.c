/**
 * settle.c: a mesh is settled, and compared with what it was; that of a reconstruction is made anew for it.
 */
#include "settle.h"

#include <math.h>
#include <string.h>

#include "refine.h"

#define TOLERANCE 1e-6  /* of the measured distance, a fraction of the diagonal */
#define MOST_RATIO 1.25 /* of the distance, by which it may grow: the quads are better */
#define WORTH_RATIO 2.0 /* of the distance, by which it may be greater for fewer poor quads */

qm_interval qm_settle_two_sided(const qm_settle_distance *distance)
{
    return (qm_interval){fmax(distance->from_surface.lower, distance->from_quads.lower),
                         fmax(distance->from_surface.upper, distance->from_quads.upper)};
}

qm_status qm_settle_measure(qm_context *ctx, const qm_ref_surface *surface, const qm_settle_goal *goal,
                            const qm_mesh *mesh, qm_settle_distance *out)
{
    const qm_refine_goal how = {.hausdorff = goal->distance, .thread_count = goal->quads.thread_count};
    qm_interval *from = &out->from_surface, *back = &out->from_quads;
    qm_bvh *tree = NULL;
    qm_status status = qm_bvh_build(ctx, mesh, QM_BVH_TARGET, how.thread_count, &tree);
    if (status == QM_OK)
        status =
            qm_refine_measure(ctx, surface, tree, QM_A_TO_B, TOLERANCE, &how, &from->lower, &from->upper);
    if (status == QM_OK)
        status =
            qm_refine_measure(ctx, surface, tree, QM_B_TO_A, TOLERANCE, &how, &back->lower, &back->upper);
    if (status == QM_OK && qm_context_canceled(ctx)) status = qm_context_fail(ctx, QM_E_CANCELED, "canceled");
    qm_bvh_destroy(ctx, tree);
    return status;
}

/** A mesh as it was before, with its distance once it is measured. */
typedef struct unsettled {
    qm_mesh mesh; /* with vertices of its own */
    qm_settle_distance distance;
    bool is_measured;
} unsettled;

/** Whether a mesh is better than it was before. */
static qm_status compare(qm_context *ctx, const qm_ref_surface *surface, const qm_settle_goal *goal,
                         unsettled *before, qm_settled *out)
{
    double after = qm_settle_two_sided(&out->distance).upper;
    out->is_kept = true;
    if (goal->distance > 0.0 && after <= goal->distance) return QM_OK;
    qm_status status =
        before->is_measured ? QM_OK : qm_settle_measure(ctx, surface, goal, &before->mesh, &before->distance);
    if (status != QM_OK) return status;
    before->is_measured = true;
    double upper = qm_settle_two_sided(&before->distance).upper;
    bool was_near = goal->distance > 0.0 && upper <= goal->distance;
    out->is_kept = !was_near && after <= MOST_RATIO * upper;
    return QM_OK;
}

static qm_status settle(qm_context *ctx, const qm_ref_surface *surface, const qm_settle_goal *goal,
                        unsettled *before, qm_mesh *mesh, qm_settled *out)
{
    const size_t size = 3 * mesh->vertex_count * sizeof *mesh->positions;
    const qm_quads_settling ways[] = {goal->is_quick ? QM_QUADS_SPREAD_ONCE : QM_QUADS_SPREAD, QM_QUADS_STAY};
    const int count = goal->is_quick ? 1 : 2;
    qm_status status = QM_OK;
    for (int k = 0; k < count && !out->is_kept && status == QM_OK; k++) {
        status = qm_quads_settle(ctx, surface->bvh, &goal->quads, ways[k], goal->marks, mesh);
        if (status == QM_OK) status = qm_settle_measure(ctx, surface, goal, mesh, &out->distance);
        if (status == QM_OK) status = compare(ctx, surface, goal, before, out);
        if (status == QM_OK && !out->is_kept) memcpy(mesh->positions, before->mesh.positions, size);
    }
    if (status == QM_OK && !out->is_kept) out->distance = before->distance;
    return status;
}

qm_status qm_settle(qm_context *ctx, const qm_ref_surface *surface, const qm_settle_goal *goal, qm_mesh *mesh,
                    qm_settled *out)
{
    size_t count = 3 * mesh->vertex_count;
    double *positions = qm_context_alloc(ctx, count, sizeof *positions);
    if (!positions) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for a copy of the vertices");
    memcpy(positions, mesh->positions, count * sizeof *positions);
    unsettled before = {.mesh = *mesh};
    before.mesh.positions = positions;
    *out = (qm_settled){0};
    qm_status status = settle(ctx, surface, goal, &before, mesh, out);
    qm_context_free(ctx, positions, count, sizeof *positions);
    if (status == QM_OK) qm_quality_measure(mesh, &out->quality);
    return status;
}

static bool is_near(const qm_settle_goal *goal, const qm_settled *settled)
{
    return !(goal->distance > 0.0) || qm_settle_two_sided(&settled->distance).upper <= goal->distance;
}

/** A settled mesh, and how many of its quads are poor. */
typedef struct candidate {
    qm_mesh *mesh;
    qm_settled settled;
    size_t poor;
} candidate;

static qm_status settle_candidate(qm_context *ctx, const qm_ref_surface *surface, const qm_settle_goal *goal,
                                  candidate *c)
{
    qm_status status = qm_settle(ctx, surface, goal, c->mesh, &c->settled);
    c->poor = qm_quads_count_poor(c->mesh);
    return status;
}

/** Whether a mesh has no folded quads where another one has, or else fewer poor ones. */
static bool is_cleaner(const candidate *a, const candidate *b)
{
    bool is_whole = a->settled.quality.folded == 0;
    return is_whole != (b->settled.quality.folded == 0) ? is_whole : a->poor < b->poor;
}

/** Whether a mesh is better than another one: near enough, cleaner up to WORTH_RATIO times its distance, or nearer. */
static bool is_better(const qm_settle_goal *goal, const candidate *a, const candidate *b)
{
    if (is_near(goal, &a->settled) != is_near(goal, &b->settled)) return is_near(goal, &a->settled);
    double far = qm_settle_two_sided(&a->settled.distance).upper,
           other = qm_settle_two_sided(&b->settled.distance).upper;
    if (is_cleaner(a, b)) return far <= WORTH_RATIO * other;
    if (is_cleaner(b, a)) return WORTH_RATIO * far < other;
    return far < other;
}

/** Settles the mesh made anew, unless it is empty, and that of the steps where need be; *mesh becomes the better one, and *steps the other. */
static qm_status settle_both(qm_context *ctx, const qm_ref_surface *surface, const qm_settle_goal *goal,
                             qm_mesh *steps, qm_mesh *mesh, qm_settled *out)
{
    candidate anew = {.mesh = mesh}, stepped = {.mesh = steps};
    if (mesh->face_count > 0) {
        qm_settle_distance distance;
        qm_status status = settle_candidate(ctx, surface, goal, &anew);
        if (status == QM_OK) status = qm_settle_measure(ctx, surface, goal, steps, &distance);
        *out = anew.settled;
        out->is_kept = true; /* its vertices are not those of the steps in any case */
        if (status != QM_OK) return status;
        double most = MOST_RATIO * qm_settle_two_sided(&distance).upper;
        bool is_good = anew.poor == 0 && qm_settle_two_sided(&out->distance).upper <= most;
        if (is_good && is_near(goal, out)) return QM_OK;
    }
    qm_status status = settle_candidate(ctx, surface, goal, &stepped);
    if (status != QM_OK || (mesh->face_count > 0 && !is_better(goal, &stepped, &anew))) return status;
    qm_mesh spare = *mesh;
    *mesh = *steps;
    *steps = spare;
    *out = stepped.settled;
    return QM_OK;
}

qm_status qm_settle_reconstruction(qm_context *ctx, const qm_ref_surface *surface, const qm_settle_goal *goal,
                                   qm_reconstruction *reconstruction, qm_mesh *mesh, qm_settled *out)
{
    qm_settle_goal marked = *goal;
    qm_quads_marks marks = {0};
    qm_mesh steps = {0};
    marked.marks = &marks;
    *mesh = (qm_mesh){0};
    qm_status status = qm_reconstruction_mesh(ctx, reconstruction, &steps);
    if (status == QM_OK) status = qm_reconstruction_find_marks(ctx, reconstruction, &marks);
    if (status == QM_OK) status = qm_reconstruction_mesh_anew(ctx, reconstruction, &goal->quads, mesh);
    if (status == QM_OK) status = settle_both(ctx, surface, &marked, &steps, mesh, out);
    qm_quads_marks_reset(ctx, &marks);
    qm_mesh_reset(ctx, &steps);
    if (status != QM_OK) qm_mesh_reset(ctx, mesh);
    return status;
}
