/**
 * cloud_isosurface.h: triangles where a function on a sparse grid is 0.
 */
#ifndef QM_CLOUD_ISOSURFACE_H
#define QM_CLOUD_ISOSURFACE_H

#include "cloud_grid.h"

/** Triangles of shared corners, local. */
typedef struct qm_cloud_triangles {
    qm_vec *position;
    size_t vertex_count;
    uint32_t (*corner)[3];
    size_t count, capacity; /* of the triangles; capacity as allocated */
    size_t vertex_capacity;
} qm_cloud_triangles;

void qm_cloud_triangles_reset(qm_context *ctx, qm_cloud_triangles *triangles);

/** True if the function has both signs at the corners of a cell. A value of 0 counts as above. */
bool qm_cloud_crosses(const qm_cloud_grid *grid, const double *field, size_t cell);

/**
 * Cuts each cell into six tetrahedra round its diagonal, the same way in all cells, and each of these by the plane where the function
 * is 0. Every edge has two triangles at most, and one only at the end of the grid. Triangles look where the function grows.
 *
 * Ownership: *out is the caller's, for qm_cloud_triangles_reset; empty after an error. QM_OK; QM_E_NO_MEMORY.
 */
qm_status qm_cloud_isosurface(qm_context *ctx, const qm_cloud_grid *grid, const double *field,
                              qm_cloud_triangles *out);

#endif
