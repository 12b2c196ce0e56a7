/**
 * cells.h: solids of box-shaped cells, warped by a function, with the layout of all edges of their sides: boxes however
 * thin, sheets, fins, wedges. On malloc; an error ends the test.
 */
#ifndef QM_CELLS_H
#define QM_CELLS_H

#include "qm/layout.h"
#include "shapes.h"

enum { QM_CELLS_MAX = 4 };

/** Moves a point in place. */
typedef void qm_cells_warp(double p[3]);

/** Cells of a grid with planes at given coordinates. No two filled cells touch at an edge or a corner only. */
typedef struct qm_cells {
    int count[3];
    double plane[3][QM_CELLS_MAX + 1];
    bool is_filled[QM_CELLS_MAX][QM_CELLS_MAX][QM_CELLS_MAX];
    int pieces[3];       /* each side of a cell along an axis is cut into so many */
    qm_cells_warp *warp; /* or NULL */
} qm_cells;

/** The surface, outward: quads with shared vertices. */
qm_mesh qm_cells_surface(const qm_cells *cells);

/** A patch for each side of a cell that belongs to the surface; curves of `pieces` pieces. */
qm_layout qm_cells_layout(const qm_cells *cells, int pieces);

/** Random points of the surface with outward normals, count for each unit of area of a cell's side before the warp, but
 * `least` for each side. The seed is the test's. */
qm_mesh qm_cells_points(const qm_cells *cells, double count, size_t least, uint64_t stream);

#endif
