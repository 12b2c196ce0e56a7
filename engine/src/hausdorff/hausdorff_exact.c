/**
 * hausdorff_exact.c: exact upper bounds at a limit.
 *
 * The distance from a convex set is a convex function, so that all of a triangle, or of the hull of a patch's corners, is
 * within the limit of a triangle of the target when its corners are. For two patches P and Q with corners p_i and q_i the
 * difference P(s, t) - Q(s, t) is the bilinear function of p_i - q_i, no longer than the longest of these: corners are
 * matched in each of their eight orders. A patch that is a parallelogram is its two triangles.
 *
 * Which facets are tried is found by rounded searches: those nearest to some points of the face. It decides whether
 * a proof is found, never whether it holds.
 */
#include "hausdorff_exact.h"

#include "bvh/bvh_tree.h"
#include "bvh/kernel.h"
#include "core/clock.h"
#include "core/face_ring.h"
#include "prim/reach.h"

#define CANCEL_STRIDE 0x100

typedef struct exact_proof {
    const qm_kernel *kernel;
    const qm_bvh *target;
    bool is_bilinear;
    double limit;
} exact_proof;

/** The corners of a face, or of a vertex of a point set; returns how many. */
static int load_corners(const qm_mesh *mesh, size_t face, const double *corner[4])
{
    if (mesh->face_count == 0) {
        corner[0] = mesh->positions + 3 * face;
        return 1;
    }
    const uint32_t *index = mesh->faces + 4 * face;
    int count = qm_face_corners(index);
    for (int i = 0; i < count; i++)
        corner[i] = mesh->positions + 3 * (size_t)index[i];
    return count;
}

/** The corners of two patches in one of the eight orders in which they are the same patch. */
static bool are_matched(const double *const p[4], const double *const q[4], double limit)
{
    for (int order = 0; order < 8; order++) {
        bool is_near = true;
        for (int i = 0; i < 4 && is_near; i++) {
            int k = order < 4 ? (i + order) % 4 : (order + 4 - i) % 4;
            is_near = qm_reach_point(p[i], q[k], limit);
        }
        if (is_near) return true;
    }
    return false;
}

/** True when all these points are near one convex facet of a face of the target, or are a patch that is near one. */
static bool is_near_face(const exact_proof *proof, const double *const point[4], int count, bool is_patch,
                         size_t face)
{
    const double *corner[4];
    int corners = load_corners(&proof->target->mesh, face, corner);
    if (corners == 1) corner[1] = corner[2] = corner[0];
    if (corners == 4 && proof->is_bilinear && !qm_reach_is_flat((const double *const *)corner))
        return is_patch && are_matched(point, (const double *const *)corner, proof->limit);
    for (int half = 0; half < (corners == 4 ? 2 : 1); half++) {
        const double *const triangle[3] = {corner[0], corner[1 + half], corner[2 + half]};
        bool is_near = true;
        for (int i = 0; i < count && is_near; i++)
            is_near = qm_reach_triangle(point[i], triangle, proof->limit);
        if (is_near) return true;
    }
    return false;
}

/** A point of the hull by these weights. */
static qm_vec mix_points(const exact_proof *proof, const double *const point[4], int count,
                         const double weight[4])
{
    double at[3] = {0.0, 0.0, 0.0}, sum = 0.0;
    for (int i = 0; i < count; i++)
        sum += weight[i];
    for (int i = 0; i < count; i++)
        for (int k = 0; k < 3; k++)
            at[k] += weight[i] / sum * point[i][k];
    return qm_frame_local(&proof->target->frame, at);
}

/** True when the hull of these points, or the patch with these corners, is near one of the facets nearest to some of its
 * points: first inner ones, where one that lies on a facet is on no other, as a rule. */
static bool is_near(const exact_proof *proof, const double *const point[4], int count, bool is_patch)
{
    /* The trees hold the triangles of patches, on which only points of three corners lie. */
    static const double weights[][4] = {{3, 3, 3, 0}, {5, 3, 2, 0}, {2, 0, 3, 4}, {2, 5, 3, 0}, {0, 3, 2, 4},
                                        {4, 3, 0, 2}, {1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}};
    size_t last = SIZE_MAX;
    for (size_t i = 0; i < (count == 1 ? 1 : sizeof weights / sizeof *weights); i++) {
        qm_hit hit = {.d2 = INFINITY, .pack = 0};
        proof->kernel->closest(proof->target, mix_points(proof, point, count, weights[i]), &hit);
        size_t face = proof->target->lanes[hit.pack].face[hit.lane];
        if (face != last && is_near_face(proof, point, count, is_patch, face)) return true;
        last = face;
    }
    return false;
}

static bool is_face_near(const exact_proof *proof, const qm_mesh *mesh, size_t face)
{
    const double *corner[4];
    int count = load_corners(mesh, face, corner);
    if (count < 4) return is_near(proof, (const double *const *)corner, count, false);
    if (proof->is_bilinear && !qm_reach_is_flat((const double *const *)corner))
        return is_near(proof, (const double *const *)corner, 4, true);
    const double *const first[4] = {corner[0], corner[1], corner[2]}, *const second[4] = {
                                                                          corner[0], corner[2], corner[3]};
    return is_near(proof, first, 3, false) && is_near(proof, second, 3, false);
}

qm_status qm_hausdorff_prove_within(qm_context *ctx, const qm_bvh *source, const qm_bvh *target,
                                    qm_quad_reading reading, double limit, double until_ms, bool *is_proven)
{
    QM_ASSERT(ctx && source && target && limit >= 0.0 && is_proven);
    const exact_proof proof = {qm_kernel_get(), target, reading == QM_QUADS_BILINEAR, limit};
    const qm_mesh *mesh = &source->mesh;
    size_t count = mesh->face_count > 0 ? mesh->face_count : mesh->vertex_count;
    *is_proven = false;
    for (size_t i = 0; i < count; i++) {
        if (i % CANCEL_STRIDE == 0 && qm_context_canceled(ctx))
            return qm_context_fail(ctx, QM_E_CANCELED, "proof canceled");
        if (i % CANCEL_STRIDE == 0 && qm_clock_ms() > until_ms) return QM_OK;
        if (!is_face_near(&proof, mesh, i)) return QM_OK;
    }
    *is_proven = true;
    return QM_OK;
}
