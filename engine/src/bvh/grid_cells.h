/**
 * grid_cells.h: the representation of a uniform grid, shared by its builder and the kernels.
 *
 * Lengths are in cells: a point p of the tree's local space is at (p - low) * inverse, and cell i spans [i, i
 * + 1] along each axis. Cells lie in blocks of 4 x 4 x 4; cell (x, y, z) of a block is bit x + 4 y + 16 z.
 * The used cells are numbered through the blocks in order:
 *
 *     blocks   { used: 0b...0110, first: 7 }
 *     start            [7]  [8]                   one entry a used cell, and one more at the end
 *     packs    ... | 12 13 | 13 | ...             the packs that meet the cell, ascending
 */
#ifndef QM_GRID_CELLS_H
#define QM_GRID_CELLS_H

#include "bvh_tree.h"
#include "qm/grid.h"

/**
 * Faces and balls are enlarged by this, in cells. Positions are off by two roundings of at most 2^31 cells (2
 * by at least 2^-30), 2^-21, while the point lies within 32 of the center; for farther points the factor
 * REACH_FACTOR of kernel/grid_search.c covers the error.
 */
#define QM_GRID_MARGIN 0x1p-16

/** A block (brick) of cells: which of them are used, and the index of the first used one. */
typedef struct qm_grid_block {
    uint64_t used;
    uint32_t first;
} qm_grid_block;

struct qm_grid {
    const qm_bvh *bvh;
    qm_vec low;
    double inverse; /* cells a local length */
    int size[3];    /* cells along each axis */
    int blocks[3];  /* blocks along each axis */
    size_t block_count, cell_count, pack_count;
    qm_grid_block *block;
    uint32_t *start;
    uint32_t *packs;
};

/** The cell, from 0 to size - 1, that holds x or is nearest to it; 0 for NaN. */
static inline int qm_grid_clamp(double x, int size)
{
    return x > 0.0 ? x < (double)size ? (int)x : size - 1 : 0;
}

/** A local point in cells. */
static inline qm_vec qm_grid_position(const qm_grid *grid, qm_vec p)
{
    return qm_vec_scale(grid->inverse, qm_vec_sub(p, grid->low));
}

static inline size_t qm_grid_block_at(const qm_grid *grid, int x, int y, int z)
{
    QM_ASSERT(x >= 0 && x < grid->blocks[0] && y >= 0 && y < grid->blocks[1] && z >= 0 &&
              z < grid->blocks[2]);
    return ((size_t)z * (size_t)grid->blocks[1] + (size_t)y) * (size_t)grid->blocks[0] + (size_t)x;
}

/** Bits of a block's cells with low[k] <= coordinate k <= high[k], each from 0 to 3. */
static inline uint64_t qm_grid_range_bits(const int low[3], const int high[3])
{
    uint64_t x = ((UINT64_C(2) << high[0]) - (UINT64_C(1) << low[0])) * UINT64_C(0x1111111111111111);
    uint64_t y = ((UINT64_C(16) << 4 * high[1]) - (UINT64_C(1) << 4 * low[1])) * UINT64_C(0x0001000100010001);
    uint64_t z = (~UINT64_C(0) >> (48 - 16 * high[2])) & (~UINT64_C(0) << 16 * low[2]);
    return x & y & z;
}

#endif
