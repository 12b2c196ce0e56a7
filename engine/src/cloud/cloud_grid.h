/**
 * cloud_grid.h: a sparse grid of cubes near points: cells, their corners (nodes), and which nodes are neighbours.
 *
 * A place in the grid is a key: whole coordinates of 21 bits each, x lowest. Keys of cells and nodes are kept in increasing order, so
 * that all of one kind with the same offset are found in one pass. The cell of a key lies between the node of that key and the node
 * that has one more of each coordinate.
 */
#ifndef QM_CLOUD_GRID_H
#define QM_CLOUD_GRID_H

#include "core/vec.h"

#define QM_CLOUD_GRID_BITS 21

/** Neighbours of a node: the next ones along x, y and z, then those before. */
enum { QM_CLOUD_AFTER = 0, QM_CLOUD_BEFORE = 3, QM_CLOUD_NEIGHBOURS = 6 };

typedef struct qm_cloud_grid {
    qm_vec origin; /* of node 0 0 0 */
    double side;   /* of a cell */
    size_t cell_count, node_count;
    uint64_t *cells, *nodes;               /* keys, in increasing order */
    uint32_t *low;                         /* the node of the lowest corner of each cell */
    uint32_t (*next)[QM_CLOUD_NEIGHBOURS]; /* of each node; QM_NO_INDEX where there is none */
    size_t cell_capacity, node_capacity;   /* of the arrays */
} qm_cloud_grid;

static inline uint64_t qm_cloud_key(uint64_t x, uint64_t y, uint64_t z)
{
    return x | y << QM_CLOUD_GRID_BITS | z << 2 * QM_CLOUD_GRID_BITS;
}

static inline uint64_t qm_cloud_key_part(uint64_t key, int axis)
{
    return key >> axis * QM_CLOUD_GRID_BITS & ((UINT64_C(1) << QM_CLOUD_GRID_BITS) - 1);
}

/** The key of the cell of a point, which lies above the origin on each axis. */
static inline uint64_t qm_cloud_grid_key_at(const qm_cloud_grid *grid, qm_vec p)
{
    qm_vec at = qm_vec_scale(1.0 / grid->side, qm_vec_sub(p, grid->origin));
    return qm_cloud_key((uint64_t)at.x, (uint64_t)at.y, (uint64_t)at.z);
}

/** The place of a point in the cell of a key, from 0 to 1 on each axis. */
static inline qm_vec qm_cloud_grid_within(const qm_cloud_grid *grid, uint64_t key, qm_vec p)
{
    qm_vec at = qm_vec_scale(1.0 / grid->side, qm_vec_sub(p, grid->origin));
    return (qm_vec){at.x - (double)qm_cloud_key_part(key, 0), at.y - (double)qm_cloud_key_part(key, 1),
                    at.z - (double)qm_cloud_key_part(key, 2)};
}

/** The position of a node. */
static inline qm_vec qm_cloud_grid_node(const qm_cloud_grid *grid, uint32_t node)
{
    uint64_t key = grid->nodes[node];
    qm_vec at = {(double)qm_cloud_key_part(key, 0), (double)qm_cloud_key_part(key, 1),
                 (double)qm_cloud_key_part(key, 2)};
    return qm_vec_axpy(grid->origin, grid->side, at);
}

/** The eight corners of a cell: corner i has one more of x, y and z where its bits 0, 1 and 2 are set. */
static inline void qm_cloud_grid_corners(const qm_cloud_grid *grid, size_t cell, uint32_t corner[8])
{
    corner[0] = grid->low[cell];
    for (uint32_t i = 1; i < 8; i++) {
        uint32_t axis = i & 4 ? 2 : i & 2 ? 1 : 0;
        corner[i] = grid->next[corner[i ^ 1U << axis]][axis];
    }
}

/** Sorts keys and drops those that are there twice; sets *count. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_cloud_keys_sort(qm_context *ctx, uint64_t *keys, size_t *count);

/** The position of a key in a sorted array, or SIZE_MAX. */
size_t qm_cloud_keys_find(const uint64_t *keys, size_t count, uint64_t key);

/**
 * Makes a grid of cells.
 *
 * cells  sorted keys, each once, whose coordinates are below 2^21 - 1; count at least 1, capacity as allocated. Taken over, also
 *        after an error
 *
 * Ownership: *out is the caller's, for qm_cloud_grid_reset; empty after an error. QM_OK; QM_E_NO_MEMORY.
 */
qm_status qm_cloud_grid_make(qm_context *ctx, qm_vec origin, double side, uint64_t *cells, size_t count,
                             size_t capacity, qm_cloud_grid *out);
void qm_cloud_grid_reset(qm_context *ctx, qm_cloud_grid *grid);

/** The weights of a cell's corners at a place in it, and their derivatives along the axes. */
static inline void qm_cloud_grid_weights(qm_vec at, double value[8], double slope[3][8])
{
    const double w[3][2] = {{1.0 - at.x, at.x}, {1.0 - at.y, at.y}, {1.0 - at.z, at.z}};
    for (int i = 0; i < 8; i++) {
        int x = i & 1, y = i >> 1 & 1, z = i >> 2;
        value[i] = w[0][x] * w[1][y] * w[2][z];
        slope[0][i] = (x ? 1.0 : -1.0) * w[1][y] * w[2][z];
        slope[1][i] = (y ? 1.0 : -1.0) * w[0][x] * w[2][z];
        slope[2][i] = (z ? 1.0 : -1.0) * w[0][x] * w[1][y];
    }
}

#endif
