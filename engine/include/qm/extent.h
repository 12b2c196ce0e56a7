/**
 * extent.h: the area of a surface and the volume that it encloses, as intervals, and its faces without area.
 *
 * Quads have both figures in each of their two readings (mesh.h). Coordinates of any size will do.
 */
#ifndef QM_EXTENT_H
#define QM_EXTENT_H

#include "qm/mesh.h"

typedef struct qm_extent {
    qm_interval area[2];   /* by qm_quad_reading */
    qm_interval volume[2]; /* below 0 when the faces turn to the inside */
    size_t
        degenerate_faces; /* of the input: without area, exactly; a quad when neither of its triangles has any, a
                                polygon when no triangle of its fan has */
} qm_extent;

/**
 * Measures a valid mesh on up to thread_count threads; a point set has no extent. The volume is that between the
 * surface and any point, the same for all points when the surface is closed (watertight and winding_consistent of
 * qm_mesh_facts); it has no meaning else.
 *
 * The intervals hold the exact figures of the exact surface. Their width is some 1e-15 times the sum of the squares of
 * the edges (for the volume, times the size of the mesh), and up to 1e-8 of the area of curved bilinear quads, or more
 * where there are very many that fold.
 *
 * Cost:    linear in the faces; the result does not depend on the threads.
 * Returns: QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_extent_measure(qm_context *ctx, const qm_mesh *mesh, int thread_count, qm_extent *out);

#endif
