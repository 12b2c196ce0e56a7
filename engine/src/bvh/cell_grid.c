/**
 * cell_grid.c: a grid over two meshes. The same monotone steps turn the coordinates of both into cells, so
 * that what has a point in common has its cell in common.
 */
#include "cell_grid.h"

#include <math.h>

#include "kernel.h"

#define MAX_CELLS 160 /* along an axis: cells 0 to MAX_CELLS + 1 fit in a byte */
#define MAX_IN_ROW 62 /* along the shortest axis: a row fits in a word */
/* The longest axis has the square root of the faces over this many cells. Cells are longer along the first
 * two axes, where faces over more than two rows take long to look up; along a row one word looks up any
 * number. */
#define FACES_PER_ROW 3.5
#define FACES_PER_CELL 1.8

bool qm_cell_grid_init(const qm_mesh *const mesh[2], qm_box own[2], qm_cell_grid *grid)
{
    qm_box box;
    for (int side = 0; side < 2; side++)
        qm_kernel_get()->vertex_box(mesh[side]->positions, mesh[side]->vertex_count, &own[side]);
    bool is_there = true; /* a point that both boxes contain */
    for (int k = 0; k < 3; k++) {
        box.min[k] = fmax(own[0].min[k], own[1].min[k]);
        box.max[k] = fmin(own[0].max[k], own[1].max[k]);
        is_there &= box.min[k] <= box.max[k];
    }
    if (!is_there) return false;
    int last = 0; /* the shortest axis */
    for (int k = 1; k < 3; k++)
        if (box.max[k] - box.min[k] < box.max[last] - box.min[last]) last = k;
    grid->axis[0] = (last + 1) % 3;
    grid->axis[1] = (last + 2) % 3;
    grid->axis[2] = last;
    double faces = (double)(mesh[0]->face_count + mesh[1]->face_count) / 2.0, longest = 0.0;
    for (int k = 0; k < 3; k++)
        longest = fmax(longest, box.max[k] - box.min[k]);
    for (int k = 0; k < 3; k++) {
        grid->low[k] = box.min[grid->axis[k]];
        grid->high[k] = box.max[grid->axis[k]];
        double length = grid->high[k] - grid->low[k];
        double cells = sqrt(faces) / (k == 2 ? FACES_PER_CELL : FACES_PER_ROW);
        double count =
            longest > 0.0 ? fmin(ceil(cells * (length / longest)), k == 2 ? MAX_IN_ROW : MAX_CELLS) : 1.0;
        grid->count[k] = count > 1.0 ? (uint32_t)count : 1;
        grid->scale[k] = length > 0.0 ? grid->count[k] / length : 0.0;
        if (!(grid->scale[k] < INFINITY)) grid->scale[k] = 0.0;
    }
    QM_ASSERT(grid->count[0] <= MAX_CELLS && grid->count[1] <= MAX_CELLS && grid->count[2] <= MAX_IN_ROW);
    grid->row_count = (grid->count[0] + 2) * (size_t)(grid->count[1] + 2);
    return true;
}

void qm_cell_marks_add_large(const qm_cell_grid *grid, qm_cell_marks *marks, const qm_cell_rows *rows)
{
    for (uint32_t x = rows->x; x <= rows->x + rows->x_more; x++)
        for (uint32_t y = rows->y; y <= rows->y + rows->y_more; y++)
            marks[qm_cell_rows_index(grid, x, y)].over[0] |= rows->bits;
}

/** Two passes. The first sets word 0 of each row to all of its marks: a row has the marks of boxes that begin
 * there, one row before along either axis, or along both. Rows are changed from the last to the first, so that
 * the rows read are unchanged. */
void qm_cell_marks_spread(const qm_cell_grid *grid, qm_cell_marks *marks)
{
    size_t stride = qm_cell_stride(grid), count = grid->row_count;
    for (size_t i = count; i-- > 0;) {
        const qm_cell_row *own = marks[i].over;
        qm_cell_row all = own[0] | own[1] | own[2] | own[3];
        if (i >= 1) all |= marks[i - 1].over[1] | marks[i - 1].over[3];
        if (i >= stride) all |= marks[i - stride].over[2] | marks[i - stride].over[3];
        if (i >= stride + 1) all |= marks[i - stride - 1].over[3];
        marks[i].over[0] = all;
    }
    for (size_t i = 0; i < count; i++) {
        qm_cell_row own = marks[i].over[0], y = i + 1 < count ? marks[i + 1].over[0] : 0,
                    x = i + stride < count ? marks[i + stride].over[0] : 0,
                    both = i + stride + 1 < count ? marks[i + stride + 1].over[0] : 0;
        marks[i].over[1] = own | y;
        marks[i].over[2] = own | x;
        marks[i].over[3] = own | y | x | both;
    }
}

bool qm_cell_marks_meet(const qm_cell_grid *grid, const qm_cell_marks *marks, const qm_cell_rows *rows)
{
    qm_cell_row found = 0;
    for (uint32_t x = rows->x; x <= rows->x + rows->x_more; x++)
        for (uint32_t y = rows->y; y <= rows->y + rows->y_more; y++)
            found |= marks[qm_cell_rows_index(grid, x, y)].over[0];
    return (found & rows->bits) != 0;
}
