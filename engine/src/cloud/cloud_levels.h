/**
 * cloud_levels.h: the function of oriented points, from a coarse grid over their whole box to a fine one near them.
 */
#ifndef QM_CLOUD_LEVELS_H
#define QM_CLOUD_LEVELS_H

#include "cloud_field.h"

typedef struct qm_cloud_level {
    qm_cloud_grid grid;
    double *field; /* of each node, in cells */
    size_t thin;   /* points along whose normals the function does not grow: other walls are as near */
} qm_cloud_level;

void qm_cloud_level_reset(qm_context *ctx, qm_cloud_level *level);

/**
 * Finds the function on cells of about a given side, or of a larger one where points would lie in too many of them. A cell of a finer
 * grid is one near points, up to so many rings of cells round them, or near the zeros of the function on the coarser one: so zeros go on across holes.
 *
 * Ownership: *out is the caller's, for qm_cloud_level_reset; empty after an error. QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_cloud_levels_solve(qm_context *ctx, const qm_cloud_points *points, double side,
                                qm_cloud_level *out);

#endif
