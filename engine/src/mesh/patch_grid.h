/**
 * patch_grid.h: walking over the cells of a rectangle of quads whose sides are cuts.
 */
#ifndef QM_PATCH_GRID_H
#define QM_PATCH_GRID_H

#include "patch_links.h"

/** A cell of a rectangle: its face, and the sides of it that look along the columns' and the rows'
 * numbers. */
typedef struct qm_quad_cell {
    uint32_t face;
    uint32_t u, v; /* sides of the face, next to one another: towards the next column, and the next row */
} qm_quad_cell;

/** The cell as its face lies: corner 0 at (0, 0), corner 1 at the next column. */
static inline qm_quad_cell qm_quad_cell_make(uint32_t face)
{
    return (qm_quad_cell){face, 1, 2};
}

/** The same cell with columns and rows changed over, or looking back. */
static inline qm_quad_cell qm_quad_cell_swap(qm_quad_cell cell)
{
    return (qm_quad_cell){cell.face, cell.v, cell.u};
}

static inline qm_quad_cell qm_quad_cell_reverse_u(qm_quad_cell cell)
{
    return (qm_quad_cell){cell.face, (cell.u + 2) & 3, cell.v};
}

static inline qm_quad_cell qm_quad_cell_reverse_v(qm_quad_cell cell)
{
    return (qm_quad_cell){cell.face, cell.u, (cell.v + 2) & 3};
}

/** Steps over the side u, which has a link. The corner between the sides u and v stays where it is. */
static inline void qm_quad_cell_cross(const qm_patch_links *links, qm_quad_cell *cell)
{
    bool v_follows = cell->v == ((cell->u + 1) & 3);
    qm_spoke spoke = {{cell->face, cell->u}, v_follows ? cell->v : cell->u};
    qm_spoke over = qm_spoke_cross(links, spoke);
    *cell = (qm_quad_cell){over.at.face, (over.at.side + 2) & 3, qm_spoke_turn(over).at.side};
}

/** Steps to the next column; false at a cut. */
static inline bool qm_quad_cell_next(const qm_patch_links *links, qm_quad_cell *cell)
{
    if (qm_links_is_cut(links, (qm_quad_side){cell->face, cell->u})) return false;
    qm_quad_cell_cross(links, cell);
    return true;
}

/** Steps to the next row; false at a cut. */
static inline bool qm_quad_cell_next_row(const qm_patch_links *links, qm_quad_cell *cell)
{
    qm_quad_cell swapped = qm_quad_cell_swap(*cell);
    if (!qm_quad_cell_next(links, &swapped)) return false;
    *cell = qm_quad_cell_swap(swapped);
    return true;
}

/** Which corner of the face lies where: see qm_patch_set's turns. */
static inline uint8_t qm_quad_cell_turn(qm_quad_cell cell)
{
    bool is_mirrored = cell.v != ((cell.u + 1) & 3);
    return is_mirrored ? (uint8_t)(4 | ((cell.u + 2) & 3)) : (uint8_t)((cell.u + 3) & 3);
}

/** A rectangle: its first cell, and its size. */
typedef struct qm_quad_cell_block {
    qm_quad_cell first;
    uint32_t rows, columns;
} qm_quad_cell_block;

/**
 * Finds the block that a cell lies in. False when the cells do not end: *ring is then set for columns that
 * run into themselves (bit 0) and rows that do (bit 1).
 */
bool qm_quad_cell_block_find(const qm_patch_links *links, qm_quad_cell cell, qm_quad_cell_block *block,
                             unsigned *ring);

#endif
