/**
 * near_grid.h: proves for many points that a surface comes within one fixed distance of them. A plain grid
 * over the faces' boxes; every distance is the slow twin's.
 */
#ifndef QM_NEAR_GRID_H
#define QM_NEAR_GRID_H

#include "slow_twin.h"

typedef struct qm_near_grid {
    const qm_mesh *mesh; /* borrowed */
    qm_quad_reading reading;
    double reach;
    double low[3], cell;
    int size[3];
    size_t *start;   /* of each cell's list in faces; one more at the end */
    uint32_t *faces; /* faces whose box, grown by reach, meets the cell */
    uint32_t hint;   /* the face that served last */
} qm_near_grid;

/** Sorts the faces of a mesh into cells for points within reach > 0 of it. Give back by qm_near_grid_free. */
qm_near_grid qm_near_grid_make(const qm_mesh *mesh, qm_quad_reading reading, double reach);

void qm_near_grid_free(qm_near_grid *grid);

/** True when some face is proven to come within reach of p; false when each one is proven to be beyond. */
bool qm_near_grid_within(qm_near_grid *grid, const double p[3]);

#endif
