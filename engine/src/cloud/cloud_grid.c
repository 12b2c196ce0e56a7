/**
 * cloud_grid.c: makes a sparse grid: nodes and neighbours come from passes over sorted keys.
 */
#include "cloud_grid.h"

#include "core/radix.h"

#define KEY_BITS (3 * QM_CLOUD_GRID_BITS)

void qm_cloud_grid_reset(qm_context *ctx, qm_cloud_grid *grid)
{
    qm_context_free(ctx, grid->cells, grid->cell_capacity, sizeof *grid->cells);
    qm_context_free(ctx, grid->nodes, grid->node_capacity, sizeof *grid->nodes);
    qm_context_free(ctx, grid->low, grid->cell_count, sizeof *grid->low);
    qm_context_free(ctx, grid->next, grid->node_count, sizeof *grid->next);
    *grid = (qm_cloud_grid){0};
}

qm_status qm_cloud_keys_sort(qm_context *ctx, uint64_t *keys, size_t *count)
{
    qm_status status = qm_radix_sort_numbers(ctx, keys, *count, KEY_BITS, 1);
    if (status != QM_OK) return qm_context_fail(ctx, status, "out of memory for the cells round points");
    size_t kept = 0;
    for (size_t i = 0; i < *count; i++)
        if (kept == 0 || keys[kept - 1] != keys[i]) keys[kept++] = keys[i];
    *count = kept;
    return QM_OK;
}

size_t qm_cloud_keys_find(const uint64_t *keys, size_t count, uint64_t key)
{
    size_t low = 0, high = count;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (keys[middle] < key)
            low = middle + 1;
        else
            high = middle;
    }
    return low < count && keys[low] == key ? low : SIZE_MAX;
}

/** Sets the eight corners of each cell, unsorted. */
static void list_corners(const qm_cloud_grid *grid, uint64_t *nodes)
{
    for (size_t c = 0; c < grid->cell_count; c++)
        for (uint64_t i = 0; i < 8; i++)
            nodes[8 * c + i] = grid->cells[c] + qm_cloud_key(i & 1, i >> 1 & 1, i >> 2);
}

/** Links all nodes along one axis: the key of the next one is greater by the same step for all. */
static void link_axis(qm_cloud_grid *grid, int axis)
{
    const uint64_t step = qm_cloud_key(axis == 0, axis == 1, axis == 2);
    for (size_t i = 0; i < grid->node_count; i++)
        grid->next[i][QM_CLOUD_BEFORE + axis] = QM_NO_INDEX;
    for (size_t i = 0, j = 0; i < grid->node_count; i++) {
        uint64_t key = grid->nodes[i] + step;
        while (j < grid->node_count && grid->nodes[j] < key)
            j++;
        bool is_there = j < grid->node_count && grid->nodes[j] == key;
        grid->next[i][QM_CLOUD_AFTER + axis] = is_there ? (uint32_t)j : QM_NO_INDEX;
        if (is_there) grid->next[j][QM_CLOUD_BEFORE + axis] = (uint32_t)i;
    }
}

static qm_status link_nodes(qm_context *ctx, qm_cloud_grid *grid)
{
    grid->low = qm_context_alloc(ctx, grid->cell_count, sizeof *grid->low);
    grid->next = qm_context_alloc(ctx, grid->node_count, sizeof *grid->next);
    if (!grid->low || !grid->next)
        return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the cells round points");
    for (int axis = 0; axis < 3; axis++)
        link_axis(grid, axis);
    for (size_t c = 0, j = 0; c < grid->cell_count; c++) {
        while (grid->nodes[j] < grid->cells[c])
            j++;
        grid->low[c] = (uint32_t)j;
    }
    return QM_OK;
}

qm_status qm_cloud_grid_make(qm_context *ctx, qm_vec origin, double side, uint64_t *cells, size_t count,
                             size_t capacity, qm_cloud_grid *out)
{
    QM_ASSERT(cells && count >= 1 && count <= QM_NO_INDEX / 8);
    *out = (qm_cloud_grid){
        .origin = origin, .side = side, .cells = cells, .cell_count = count, .cell_capacity = capacity};
    out->node_capacity = 8 * count;
    out->nodes = qm_context_alloc(ctx, out->node_capacity, sizeof *out->nodes);
    qm_status status = QM_OK;
    if (out->nodes) {
        list_corners(out, out->nodes);
        size_t nodes = out->node_capacity;
        status = qm_cloud_keys_sort(ctx, out->nodes, &nodes);
        out->node_count = nodes;
    } else {
        status = qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the cells round points");
    }
    if (status == QM_OK) {
        uint64_t *fewer =
            qm_context_resize(ctx, out->nodes, out->node_capacity, out->node_count, sizeof *out->nodes);
        if (fewer) {
            out->nodes = fewer;
            out->node_capacity = out->node_count;
        }
        status = link_nodes(ctx, out);
    }
    if (status != QM_OK) qm_cloud_grid_reset(ctx, out);
    return status;
}
