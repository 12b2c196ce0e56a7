#include "reconstruct_work.h"

#include <string.h>

#define FAIR_STEP 0.6 /* share of the way to the middle of the neighbours */

enum { ROW = 3 * sizeof(double) };

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the patches");
}

/** Copies the vertices of the four curves to the outline of a grid. */
static void set_outline(const qm_reconstruction *r, size_t p)
{
    const qm_layout_patch *patch = &r->layout.patches[p];
    qm_patch_grid *grid = &r->grids[p];
    for (uint32_t i = 0; i <= grid->columns; i++) {
        memcpy(qm_grid_vertex(grid, i, 0), qm_side_vertex(r, patch, 0, i), ROW);
        memcpy(qm_grid_vertex(grid, i, grid->rows), qm_side_vertex(r, patch, 2, grid->columns - i), ROW);
    }
    for (uint32_t j = 0; j <= grid->rows; j++) {
        memcpy(qm_grid_vertex(grid, grid->columns, j), qm_side_vertex(r, patch, 1, j), ROW);
        memcpy(qm_grid_vertex(grid, 0, j), qm_side_vertex(r, patch, 3, grid->rows - j), ROW);
    }
}

static qm_vec vertex_at(const qm_patch_grid *grid, uint32_t column, uint32_t row)
{
    return qm_vec_load(qm_grid_vertex(grid, column, row));
}

/** Bilinearly blended: two ruled surfaces less the bilinear one of the corners (6.4 of the source). */
static void blend_coons(qm_patch_grid *grid)
{
    uint32_t n = grid->columns, m = grid->rows;
    for (uint32_t j = 1; j < m; j++) {
        double v = (double)j / m;
        for (uint32_t i = 1; i < n; i++) {
            double u = (double)i / n;
            qm_vec across = qm_vec_mix(vertex_at(grid, i, 0), vertex_at(grid, i, m), v);
            qm_vec along = qm_vec_mix(vertex_at(grid, 0, j), vertex_at(grid, n, j), u);
            qm_vec bottom = qm_vec_mix(vertex_at(grid, 0, 0), vertex_at(grid, n, 0), u);
            qm_vec top = qm_vec_mix(vertex_at(grid, 0, m), vertex_at(grid, n, m), u);
            qm_vec blend = qm_vec_sub(qm_vec_add(across, along), qm_vec_mix(bottom, top, v));
            qm_vec_store(qm_grid_vertex(grid, i, j), blend);
        }
    }
}

qm_status qm_grids_create(qm_context *ctx, qm_reconstruction *r)
{
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        qm_patch_grid *grid = &r->grids[p];
        *grid = (qm_patch_grid){.columns = qm_patch_chord(r, p, 0)->work,
                                .rows = qm_patch_chord(r, p, 1)->work,
                                .is_stale = true};
        grid->vertices = qm_context_alloc(ctx, qm_grid_vertex_count(grid), ROW);
        if (!grid->vertices) return no_memory(ctx);
        set_outline(r, p);
        blend_coons(grid);
    }
    return QM_OK;
}

/** A finer grid through the old vertices; those between them lie in the middle of their two or four. */
static void fill_between(const qm_patch_grid *old, qm_patch_grid *fine)
{
    uint32_t across = fine->columns / old->columns, down = fine->rows / old->rows;
    for (uint32_t j = 0; j <= fine->rows; j++) {
        uint32_t row = j / down, next_row = row < old->rows ? row + 1 : row;
        double v = (double)(j % down) / down;
        for (uint32_t i = 0; i <= fine->columns; i++) {
            uint32_t column = i / across, next = column < old->columns ? column + 1 : column;
            double u = (double)(i % across) / across;
            qm_vec low = qm_vec_mix(vertex_at(old, column, row), vertex_at(old, next, row), u);
            qm_vec high = qm_vec_mix(vertex_at(old, column, next_row), vertex_at(old, next, next_row), u);
            qm_vec_store(qm_grid_vertex(fine, i, j), qm_vec_mix(low, high, v));
        }
    }
}

static qm_status double_grid(qm_context *ctx, qm_reconstruction *r, size_t p, uint32_t columns, uint32_t rows)
{
    qm_patch_grid *grid = &r->grids[p];
    qm_patch_grid fine = {.columns = columns, .rows = rows, .is_stale = true, .points = grid->points};
    fine.vertices = qm_context_alloc(ctx, qm_grid_vertex_count(&fine), ROW);
    if (!fine.vertices) return no_memory(ctx);
    fill_between(grid, &fine);
    qm_context_free(ctx, grid->vertices, qm_grid_vertex_count(grid), ROW);
    *grid = fine;
    set_outline(r, p);
    return QM_OK;
}

qm_status qm_grids_double(qm_context *ctx, qm_reconstruction *r)
{
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        uint32_t columns = qm_patch_chord(r, p, 0)->work, rows = qm_patch_chord(r, p, 1)->work;
        if (columns == r->grids[p].columns && rows == r->grids[p].rows) continue;
        qm_status status = double_grid(ctx, r, p, columns, rows);
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

/** Moves a vertex towards the middle of its four neighbours, but not along the surface's normal. */
static void fair_vertex(qm_patch_grid *grid, uint32_t i, uint32_t j)
{
    qm_vec here = vertex_at(grid, i, j);
    qm_vec west = vertex_at(grid, i - 1, j), east = vertex_at(grid, i + 1, j);
    qm_vec south = vertex_at(grid, i, j - 1), north = vertex_at(grid, i, j + 1);
    qm_vec middle = qm_vec_scale(0.25, qm_vec_add(qm_vec_add(west, east), qm_vec_add(south, north)));
    qm_vec move = qm_vec_sub(middle, here);
    qm_vec normal = qm_vec_cross(qm_vec_sub(east, west), qm_vec_sub(north, south));
    double norm2 = qm_vec_norm2(normal);
    if (norm2 > 0.0) move = qm_vec_axpy(move, -qm_vec_dot(move, normal) / norm2, normal);
    qm_vec_store(qm_grid_vertex(grid, i, j), qm_vec_axpy(here, FAIR_STEP, move));
}

void qm_grids_fair(qm_reconstruction *r, int rounds)
{
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        qm_patch_grid *grid = &r->grids[p];
        if (!grid->is_stale) continue;
        for (int round = 0; round < rounds; round++)
            for (uint32_t j = 1; j < grid->rows; j++)
                for (uint32_t i = 1; i < grid->columns; i++)
                    fair_vertex(grid, i, j);
    }
}
