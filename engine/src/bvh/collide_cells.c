/**
 * collide_cells.c: a grid over two meshes. Coordinates become cells by the same monotone steps for both, so
 * that what has a point in common has its cell in common.
 */
#include "collide_cells.h"

#include <math.h>

#include "kernel.h"

#define MOST_CELLS 160 /* along an axis: cells 0 to MOST_CELLS + 1 are a byte */
#define MOST_IN_ROW 62 /* along the shortest axis: a row is a word */
/* The square root of the faces over it are the cells along the longest axis. They are longer along the first
 * two, where faces over more than two rows take long to look up; along a row any number is looked up at once.
 */
#define FACES_A_ROW 3.5
#define FACES_A_CELL 1.8

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

bool qm_cell_grid_lay(const qm_mesh *const mesh[2], qm_box own[2], qm_cell_grid *grid)
{
    qm_box box;
    for (int side = 0; side < 2; side++)
        qm_kernel_get()->vertex_box(mesh[side]->positions, mesh[side]->vertex_count, &own[side]);
    if (!common_box(&own[0], &own[1], &box)) return false;
    order_axes(&box, grid->axis);
    double faces = (double)(mesh[0]->face_count + mesh[1]->face_count) / 2.0, longest = 0.0;
    for (int k = 0; k < 3; k++)
        longest = fmax(longest, box.max[k] - box.min[k]);
    for (int k = 0; k < 3; k++) {
        grid->low[k] = box.min[grid->axis[k]];
        grid->high[k] = box.max[grid->axis[k]];
        double length = grid->high[k] - grid->low[k];
        double cells = sqrt(faces) / (k == 2 ? FACES_A_CELL : FACES_A_ROW);
        double count =
            longest > 0.0 ? fmin(ceil(cells * (length / longest)), k == 2 ? MOST_IN_ROW : MOST_CELLS) : 1.0;
        grid->count[k] = count > 1.0 ? (uint32_t)count : 1;
        grid->scale[k] = length > 0.0 ? grid->count[k] / length : 0.0;
        if (!(grid->scale[k] < INFINITY)) grid->scale[k] = 0.0;
    }
    grid->row_count = (grid->count[0] + 2) * (size_t)(grid->count[1] + 2);
    return true;
}
