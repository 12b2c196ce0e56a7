/**
 * dense_cells.h: a surface cut evenly into small cells, each with an interval of its distance from another surface: that of
 * its middle, opened by the cell's radius, as no distance changes faster than the place it is measured at. What sums over
 * the cells give is certain, but for the areas of the cells of bent patches, which are those of flat ones.
 */
#ifndef QM_DENSE_CELLS_H
#define QM_DENSE_CELLS_H

#include "qm/mesh.h"

/** A cell of the source: its area, the interval of the distances in it, and where it is. */
typedef struct qm_dense_cell {
    double area, low, high, middle[3], radius;
} qm_dense_cell;

typedef struct qm_cell_list {
    qm_dense_cell *cells;
    size_t count;
    double area;
} qm_cell_list;

/** Cuts each triangle and each patch of a into n x n cells, and measures them to b. */
qm_cell_list qm_cells_sample(const qm_mesh *a, const qm_mesh *b, qm_quad_reading reading, int n);

void qm_cells_free(qm_cell_list *list);

/** Share of the area whose distance is surely (or possibly) within [from, to]. */
double qm_cells_share(const qm_cell_list *list, double from, double to, bool surely);

#endif
