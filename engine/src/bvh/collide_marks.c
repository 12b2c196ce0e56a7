#include "collide_marks.h"

void qm_cell_marks_add_large(const qm_cell_grid *grid, qm_cell_marks *marks, const qm_cell_rows *rows)
{
    for (uint32_t x = rows->x; x <= rows->x + rows->x_more; x++)
        for (uint32_t y = rows->y; y <= rows->y + rows->y_more; y++)
            marks[qm_cell_rows_place(grid, x, y)].over[0] |= rows->bits;
}

/** Word 0 of each row becomes all of its marks. A row has those of boxes that begin there, one row before
 * along either axis, or along both; from the last row on, what is read has not been changed yet. */
static void gather_rows(const qm_cell_grid *grid, qm_cell_marks *marks)
{
    size_t stride = qm_cell_stride(grid);
    for (size_t i = grid->row_count; i-- > 0;) {
        const qm_cell_row *own = marks[i].over;
        qm_cell_row all = own[0] | own[1] | own[2] | own[3];
        if (i >= 1) all |= marks[i - 1].over[1] | marks[i - 1].over[3];
        if (i >= stride) all |= marks[i - stride].over[2] | marks[i - stride].over[3];
        if (i >= stride + 1) all |= marks[i - stride - 1].over[3];
        marks[i].over[0] = all;
    }
}

void qm_cell_marks_spread(const qm_cell_grid *grid, qm_cell_marks *marks)
{
    size_t stride = qm_cell_stride(grid), count = grid->row_count;
    gather_rows(grid, marks);
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
            found |= marks[qm_cell_rows_place(grid, x, y)].over[0];
    return (found & rows->bits) != 0;
}
