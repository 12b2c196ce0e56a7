#include "near_grid.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { SIZE_LIMIT = 80 };

typedef struct cell_range {
    int low[3], high[3];
} cell_range;

static void *allocate(size_t count, size_t width)
{
    void *block = calloc(count, width);
    if (!block) {
        fprintf(stderr, "out of memory in the near grid\n");
        abort();
    }
    return block;
}

static int clamp_cell(double x, int size)
{
    return x < 0 ? 0 : x >= size ? size - 1 : (int)x;
}

static cell_range face_range(const qm_near_grid *grid, size_t face)
{
    const uint32_t *index = grid->mesh->faces + 4 * face;
    cell_range range;
    for (int k = 0; k < 3; ++k) {
        double low = INFINITY, high = -INFINITY;
        for (int i = 0; i < 4 && index[i] != QM_NO_INDEX; ++i) {
            double x = grid->mesh->positions[3 * (size_t)index[i] + (size_t)k];
            low = fmin(low, x);
            high = fmax(high, x);
        }
        /* A little more than reach, so that rounding loses no face. */
        double margin = 1.001 * grid->reach + 1e-9 * grid->cell;
        range.low[k] = clamp_cell((low - margin - grid->low[k]) / grid->cell, grid->size[k]);
        range.high[k] = clamp_cell((high + margin - grid->low[k]) / grid->cell, grid->size[k]);
    }
    return range;
}

static size_t cell_index(const qm_near_grid *grid, int x, int y, int z)
{
    return ((size_t)z * (size_t)grid->size[1] + (size_t)y) * (size_t)grid->size[0] + (size_t)x;
}

/** Counts the faces of each cell into start, or, given the list, enters them from each cell's end. */
static void visit_faces(qm_near_grid *grid, uint32_t *list)
{
    for (size_t f = 0; f < grid->mesh->face_count; ++f) {
        cell_range r = face_range(grid, f);
        for (int z = r.low[2]; z <= r.high[2]; ++z)
            for (int y = r.low[1]; y <= r.high[1]; ++y)
                for (int x = r.low[0]; x <= r.high[0]; ++x) {
                    size_t *at = grid->start + cell_index(grid, x, y, z);
                    if (list)
                        list[--*at] = (uint32_t)f;
                    else
                        ++*at;
                }
    }
}

qm_near_grid qm_near_grid_make(const qm_mesh *mesh, qm_quad_reading reading, double reach)
{
    qm_near_grid grid = {.mesh = mesh, .reading = reading, .reach = reach};
    qm_box box = qm_mesh_bounding_box(mesh);
    grid.cell = fmax(reach, qm_mesh_box_diagonal(&box) / SIZE_LIMIT);
    size_t cells = 1;
    for (int k = 0; k < 3; ++k) {
        grid.low[k] = box.min[k] - 1.01 * reach;
        grid.size[k] = 1 + (int)((box.max[k] + 1.01 * reach - grid.low[k]) / grid.cell);
        cells *= (size_t)grid.size[k];
    }
    grid.start = allocate(cells + 1, sizeof *grid.start);
    visit_faces(&grid, NULL);
    size_t end = 0;
    for (size_t i = 0; i <= cells; ++i) {
        end += grid.start[i];
        grid.start[i] = end;
    }
    grid.faces = allocate(end + 1, sizeof *grid.faces);
    visit_faces(&grid, grid.faces);
    return grid;
}

void qm_near_grid_free(qm_near_grid *grid)
{
    free(grid->start);
    free(grid->faces);
    *grid = (qm_near_grid){0};
}

static bool face_within(qm_near_grid *grid, uint32_t face, const double p[3])
{
    if (!qm_slow_face_within(grid->mesh, face, grid->reading, p, grid->reach)) return false;
    grid->hint = face;
    return true;
}

bool qm_near_grid_within(qm_near_grid *grid, const double p[3])
{
    if (face_within(grid, grid->hint, p)) return true;
    int at[3];
    for (int k = 0; k < 3; ++k) {
        double x = (p[k] - grid->low[k]) / grid->cell;
        if (x < 0 || x >= grid->size[k]) return false;
        at[k] = (int)x;
    }
    size_t cell = cell_index(grid, at[0], at[1], at[2]);
    for (size_t i = grid->start[cell]; i < grid->start[cell + 1]; ++i)
        if (face_within(grid, grid->faces[i], p)) return true;
    return false;
}
