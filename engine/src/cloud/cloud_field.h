/**
 * cloud_field.h: a function on a sparse grid that is about the signed distance from the surface of points.
 */
#ifndef QM_CLOUD_FIELD_H
#define QM_CLOUD_FIELD_H

#include "cloud_grid.h"

/** What the points of a cell say: at a place in it the function is 0, and its slope the normal. */
typedef struct qm_cloud_sample {
    uint32_t cell;
    qm_vec at;     /* from 0 to 1 on each axis */
    qm_vec normal; /* of length 1 */
} qm_cloud_sample;

/** Oriented points, local. */
typedef struct qm_cloud_points {
    size_t count;
    const qm_vec *position;
    qm_vec *normal; /* of length 1; 0 where unknown: such points do not count */
    uint64_t rings; /* of cells round each point, that belong to the finer grids: 1 or more */
    bool is_sure;   /* normals are known: else they may be turned round */
} qm_cloud_points;

/**
 * Takes the mean of the points in each cell. Cells whose normals cancel, as those of the two walls of a thin part, say nothing.
 *
 * grid  has a cell at each point
 *
 * Ownership: *out is the caller's, grid->cell_count of them allocated. QM_OK; QM_E_NO_MEMORY.
 */
qm_status qm_cloud_samples_make(qm_context *ctx, const qm_cloud_grid *grid, const qm_cloud_points *points,
                                qm_cloud_sample **out, size_t *count);

/**
 * Finds the values f at the nodes, in cells, for which
 *
 *     sum over samples of f(p)^2 + |grad f(p) - n|^2  +  bending sum over nodes of |second differences of f|^2
 *
 * is least, by conjugate gradients from the values that are given, to which all nodes are held very weakly.
 *
 * QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_cloud_field_solve(qm_context *ctx, const qm_cloud_grid *grid, const qm_cloud_sample *samples,
                               size_t count, double *field);

#endif
