/**
 * faced_surface.h: a surface with faces, for what needs them: a mesh as it is, or one that is made of a point set. Shared by the
 * daemon and the command line.
 */
#ifndef QM_FACED_SURFACE_H
#define QM_FACED_SURFACE_H

#include "base/text.h"
#include "qm/cloud.h"

typedef struct qm_faced_surface {
    qm_ref_surface surface; /* has faces */
    bool is_made;           /* of points: the members below belong to it */
    qm_mesh mesh;
    qm_bvh *tree;
    qm_cloud_record record;
} qm_faced_surface;

/**
 * Makes it. With faces the given surface is borrowed.
 *
 * Ownership: *out is the caller's, for qm_faced_surface_reset; empty after an error.
 * Returns: QM_OK; what qm_cloud_make_surface and qm_bvh_build return.
 */
qm_status qm_faced_surface_make(qm_context *ctx, const qm_ref_surface *given, int thread_count,
                                qm_faced_surface *out);
void qm_faced_surface_reset(qm_context *ctx, qm_faced_surface *surface);

/** What a result tells of the points that it was made of. */
typedef struct qm_faced_points {
    bool is_made; /* else it was made of a mesh, and there is nothing to tell */
    qm_cloud_record record;
    qm_interval
        hausdorff; /* two-sided, between the result and the surface that was made of the points, in their unit */
} qm_faced_points;

/** Adds the member `points` to an object, where there were some. */
void qm_faced_surface_describe(qm_text *out, const qm_faced_points *points, double diagonal);

#endif
