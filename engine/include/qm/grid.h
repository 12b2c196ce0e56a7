/**
 * grid.h: a uniform grid over the faces of a tree, as another accelerator for nearest-point searches.
 *
 * A cell lists the packs of the tree that intersect it, so that no face is stored twice. Cells are cubes:
 * their number is about QM_GRID_DENSITY times that of the triangles, in the box of the mesh, or in its
 * rectangle or on its line where the box is flatter or thinner than such a cube. Bricks of 4 x 4 x 4 cells
 * know which of their cells are used, and store only those. Where the lists have more than QM_GRID_SHARE
 * entries a triangle, the cells are doubled in size until they have not: so a grid takes at most a few words
 * a triangle.
 *
 * Source: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh, section 4.3; with an
 * exact stopping rule: visits every cell that intersects the ball around the point through the best footpoint
 * so far.
 */
#ifndef QM_GRID_H
#define QM_GRID_H

#include "qm/bvh.h"

#define QM_GRID_DENSITY 2 /* cells a triangle in the box of the mesh, used or not */
#define QM_GRID_SHARE 4   /* entries of the cells' lists a triangle, at most, besides a constant */

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

/** Frees a grid with the allocator that built it. NULL is allowed. */
void qm_grid_destroy(qm_context *ctx, qm_grid *grid);

/** Bytes that the grid holds, without the tree. */
size_t qm_grid_memory_size(const qm_grid *grid);

#endif
