#include "patch_grid.h"

/** Goes back to the first column; false when there is none, since the cells come round to where they
 * began. */
static bool find_start(const qm_patch_links *links, qm_quad_cell *cell)
{
    qm_quad_cell at = qm_quad_cell_reverse_u(*cell), begin = at;
    while (qm_quad_cell_next(links, &at))
        if (at.face == begin.face && at.u == begin.u) return false;
    *cell = qm_quad_cell_reverse_u(at);
    return true;
}

/** Cells from here to the last column, this one included. */
static uint32_t count_columns(const qm_patch_links *links, qm_quad_cell cell)
{
    uint32_t count = 1;
    while (qm_quad_cell_next(links, &cell))
        count++;
    return count;
}

bool qm_quad_cell_block_find(const qm_patch_links *links, qm_quad_cell cell, qm_quad_cell_block *block,
                             unsigned *ring)
{
    *ring = find_start(links, &cell) ? 0 : 1;
    cell = qm_quad_cell_swap(cell);
    if (!find_start(links, &cell)) *ring |= 2;
    if (*ring) return false;
    block->rows = count_columns(links, cell);
    block->first = cell = qm_quad_cell_swap(cell);
    block->columns = count_columns(links, cell);
    return true;
}
