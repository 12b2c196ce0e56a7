/**
 * grid.h: a uniform grid over the faces of a tree, as another way to search for nearest points.
 *
 * A cell lists the packs of the tree that come through it, so that no face is held twice. Cells are cubes:
 * about as many as QM_GRID_DENSITY 2times the triangles in the box of the mesh, or in its rectangle or on its
 * line where the box is flatter or thinner than such a cube. Blocks of 4 x 4 x 4 cells know which of their
 * cells are used, and only those are kept. Where faces come through more cells than QM_GRID_SHARE times their
 * number, the cells are doubled until they do not: so a grid is never larger than a few words a triangle.
 *
 * Source: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh, section 4.3; with the
 * exact rule to stop: every cell that meets the ball round the point through the best foot so far is visited.
 */
#ifndef QM_GRID_H
#define QM_GRID_H

#include "qm/bvh.h"

#define QM_GRID_DENSITY 2 /* cells a triangle in the box of the mesh, used or not */
#define QM_GRID_SHARE 4   /* entries of the cells' lists a triangle, at most, beside a constant */

typedef struct qm_grid qm_grid;

/**
 * Builds the grid of a tree that was built with QM_BVH_TARGET; it serves the readings that the tree serves.
 *
 * Ownership: borrows the tree, which must outlive the grid; *out is the caller's, for qm_grid_destroy.
 * Threads:   the finished grid is only read, so any number of calls may use it at once.
 * Returns:   QM_OK; QM_E_ARGUMENT (the tree is no target); QM_E_NO_MEMORY; QM_E_CANCELED. After an error *out
 *            is NULL.
 */
qm_status qm_grid_build(qm_context *ctx, const qm_bvh *bvh, qm_grid **out);

/** Frees a grid with the allocator that built it. NULL is fine. */
void qm_grid_destroy(qm_context *ctx, qm_grid *grid);

/** Bytes that the grid holds, without the tree. */
size_t qm_grid_memory_size(const qm_grid *grid);

#endif
