/**
 * project.h: projection: the nearest point of a surface.
 */
#ifndef QM_PROJECT_H
#define QM_PROJECT_H

#include "qm/locator.h"

/** A point of a surface: face (of the mesh as stored), parameters (see mesh.h) and position. */
typedef struct qm_surface_point {
    uint32_t face; /* for a point set: the vertex */
    double uv[2];
    double position[3];
} qm_surface_point;

/** The output arrays of a batch of projections; a NULL array is skipped. */
typedef struct qm_projection {
    double *distance; /* point_count, >= 0, unit of the mesh */
    double *position; /* point_count rows of x y z on the surface */
    uint32_t *face;   /* point_count, index into the mesh's faces (vertices for a point set) */
    double *uv;       /* point_count rows of u v */
} qm_projection;

/**
 * Projects a batch of points onto a mesh: finds the nearest point of the surface to each.
 *
 * Ties. Of the faces whose computed distance exceeds the minimum by at most tau, the result is the one of
 * lowest index, with the minimum distance; position and parameters are those of that face. tau is more than
 * three times the largest measured difference between computed distances of equally near faces, so the lowest
 * index of these wins; a face that is farther by less than tau wins over higher ones. The result is equal to
 * the last bit for every accelerator, instruction set, number of threads and order of the points.
 *
 * Error. Let L be the longest side of the box of the surface (for a single point its largest coordinate), at
 * least 2^-1000, and D the distance: a returned distance is off by at most 1.5e-13 L + 2e-14 D, and for
 * bilinear patches by at most 3.5e-13 L + 2.5e-14 D. Both include tau. The distance of the returned position
 * has the same error, and the position is rounded to the coordinates of the mesh (2^-52 of the largest).
 *
 * points        point_count rows of x y z, finite, in the frame and unit of the mesh
 * reading       QM_QUADS_BILINEAR finds the certified global minimum over each patch
 * thread_count  1 or more; more than one only with ctx->parallel
 * out           arrays of the caller, point_count rows each
 *
 * Ownership: borrows every argument, keeps none.
 * Threads:   only reads the tree, so any number of calls may use it at once; splits the batch with
 *            ctx->parallel.
 * Cost:      about log(triangles) nodes a point on even meshes; every node at worst.
 * Returns:   QM_OK; QM_E_ARGUMENT (the tree was not built with QM_BVH_TARGET, or with QM_BVH_PATCHES for
 *            bilinear quads); QM_E_NOT_FINITE, QM_E_SCALE (ctx->message names the row: the point lies beyond
 *            2^300 sizes of the mesh, or so far away that distances overflow); QM_E_NO_MEMORY; QM_E_CANCELED.
 *            After an error the contents of out are unspecified.
 * Source:    nearest box first: Roussopoulos, Kelley, Vincent, Nearest Neighbor Queries, 1995.
 */
qm_status qm_project_points(qm_context *ctx, const qm_bvh *bvh, qm_quad_reading reading, const double *points,
                            size_t point_count, int thread_count, const qm_projection *out);

/** As qm_project_points with a locator, which serves any number of batches. */
qm_status qm_project_points_with(qm_context *ctx, const qm_locator *locator, qm_quad_reading reading,
                                 const double *points, size_t point_count, int thread_count,
                                 const qm_projection *out);

/**
 * Checks points before a projection, for callers that get a batch in parts.
 *
 * first  row of points[0] in the batch, for messages
 *
 * Returns: QM_OK; QM_E_NOT_FINITE, QM_E_SCALE (ctx->message names the row); QM_E_CANCELED.
 */
qm_status qm_project_check(qm_context *ctx, const qm_bvh *bvh, const double *points, size_t first,
                           size_t point_count);

#endif
