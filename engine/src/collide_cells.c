/**
 * collide_cells.c: a grid over two meshes. Coordinates become cells by the same monotone steps for both, so
 * that what has a point in common has its cell in common.
 */
#include "collide_cells.h"

#include <math.h>

#define MOST_CELLS 160   /* along an axis: cells 0 to MOST_CELLS + 1 are a byte */
#define MOST_IN_ROW 62   /* along the shortest axis: a row is a word */
#define FACES_A_CELL 2.0 /* the square root of the faces over it are the cells along the longest axis */

static qm_box vertex_box(const qm_mesh *mesh)
{
    qm_box box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        for (int k = 0; k < 3; k++) {
            double x = mesh->positions[3 * i + (size_t)k];
            box.min[k] = x < box.min[k] ? x : box.min[k];
            box.max[k] = x > box.max[k] ? x : box.max[k];
        }
    }
    return box;
}

/** Puts the shortest axis last. */
static void order_axes(const qm_box *box, int axis[3])
{
    int last = 0;
    for (int k = 1; k < 3; k++)
        if (box->max[k] - box->min[k] < box->max[last] - box->min[last]) last = k;
    axis[0] = (last + 1) % 3;
    axis[1] = (last + 2) % 3;
    axis[2] = last;
}

/** The box that two have in common; false when there is none. */
static bool common_box(const qm_box *a, const qm_box *b, qm_box *out)
{
    bool is_there = true;
    for (int k = 0; k < 3; k++) {
        out->min[k] = fmax(a->min[k], b->min[k]);
        out->max[k] = fmin(a->max[k], b->max[k]);
        is_there &= out->min[k] <= out->max[k];
    }
    return is_there;
}

bool qm_cell_grid_lay(const qm_mesh *const mesh[2], qm_cell_grid *grid)
{
    qm_box a = vertex_box(mesh[0]), b = vertex_box(mesh[1]), box;
    if (!common_box(&a, &b, &box)) return false;
    order_axes(&box, grid->axis);
    double faces = (double)(mesh[0]->face_count + mesh[1]->face_count) / 2.0, longest = 0.0;
    double cells = fmin(sqrt(faces) / FACES_A_CELL, MOST_CELLS);
    for (int k = 0; k < 3; k++)
        longest = fmax(longest, box.max[k] - box.min[k]);
    for (int k = 0; k < 3; k++) {
        grid->low[k] = box.min[grid->axis[k]];
        grid->high[k] = box.max[grid->axis[k]];
        double length = grid->high[k] - grid->low[k];
        double count =
            longest > 0.0 ? fmin(ceil(cells * (length / longest)), k == 2 ? MOST_IN_ROW : MOST_CELLS) : 1.0;
        grid->count[k] = count > 1.0 ? (uint32_t)count : 1;
        grid->scale[k] = length > 0.0 ? grid->count[k] / length : 0.0;
        if (!(grid->scale[k] < INFINITY)) grid->scale[k] = 0.0;
    }
    grid->row_count = (grid->count[0] + 2) * (size_t)(grid->count[1] + 2);
    return true;
}

static uint32_t find_cell(const qm_cell_grid *grid, int k, double x)
{
    double place = (x - grid->low[k]) * grid->scale[k], last = grid->count[k] - 1.0;
    place = place > 0.0 ? place : 0.0;
    uint32_t inside = 1 + (uint32_t)(int32_t)(place < last ? place : last);
    return x < grid->low[k] ? 0 : x > grid->high[k] ? grid->count[k] + 1 : inside;
}

void qm_cell_grid_find(const qm_cell_grid *grid, const qm_mesh *mesh, qm_cell *cells)
{
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        const double *p = mesh->positions + 3 * i;
        cells[i] = find_cell(grid, 0, p[grid->axis[0]]) << QM_CELL_X |
                   find_cell(grid, 1, p[grid->axis[1]]) << QM_CELL_Y |
                   find_cell(grid, 2, p[grid->axis[2]]) << QM_CELL_Z;
    }
}
