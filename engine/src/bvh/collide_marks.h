/**
 * collide_marks.h: which cells of a grid the faces of a mesh reach into, and whether a box reaches into any
 * of them. Most faces are small and lie over one row of cells or two; those are marked and looked up by one
 * word each, whatever their place.
 */
#ifndef QM_COLLIDE_MARKS_H
#define QM_COLLIDE_MARKS_H

#include "collide_cells.h"

/**
 * Of the row of cells at x and y. Word 2 i + j, with i and j 0 or 1, is about the rows x to x + i and y to
 * y + j: while marks are added, those of boxes that lie over exactly these rows; after qm_cell_marks_spread,
 * all marks in any of them.
 */
typedef struct qm_cell_marks {
    qm_cell_row over[4];
} qm_cell_marks;

/** Where the rows of a box lie. */
typedef struct qm_cell_rows {
    uint32_t x, y, x_more, y_more; /* the first, and how many more */
    qm_cell_row bits;              /* of the cells in each */
} qm_cell_rows;

static inline uint32_t qm_cell_axis(qm_cell c, int shift)
{
    return c >> shift & 0xff;
}

static inline qm_cell_rows qm_cell_rows_find(qm_cell low, qm_cell high)
{
    uint32_t first = qm_cell_axis(low, QM_CELL_Z), more = qm_cell_axis(high, QM_CELL_Z) - first;
    return (qm_cell_rows){.x = qm_cell_axis(low, QM_CELL_X),
                          .y = qm_cell_axis(low, QM_CELL_Y),
                          .x_more = qm_cell_axis(high - low, QM_CELL_X),
                          .y_more = qm_cell_axis(high - low, QM_CELL_Y),
                          .bits = (((qm_cell_row)2 << more) - 1) << first};
}

static inline size_t qm_cell_rows_place(const qm_cell_grid *grid, uint32_t x, uint32_t y)
{
    return x * (size_t)qm_cell_stride(grid) + y;
}

static inline size_t qm_cell_rows_count(const qm_cell_rows *rows)
{
    return (rows->x_more + 1) * (size_t)(rows->y_more + 1);
}

/** Marks a box of more than two by two rows. */
void qm_cell_marks_add_large(const qm_cell_grid *grid, qm_cell_marks *marks, const qm_cell_rows *rows);

/** Marks a box. */
static inline void qm_cell_marks_add(const qm_cell_grid *grid, qm_cell_marks *marks, const qm_cell_rows *rows)
{
    if (rows->x_more < 2 && rows->y_more < 2)
        marks[qm_cell_rows_place(grid, rows->x, rows->y)].over[2 * rows->x_more + rows->y_more] |= rows->bits;
    else
        qm_cell_marks_add_large(grid, marks, rows);
}

/** Makes marks that were added ready to be looked up. */
void qm_cell_marks_spread(const qm_cell_grid *grid, qm_cell_marks *marks);

/** Whether a box of any size reaches into a marked cell. */
bool qm_cell_marks_meet(const qm_cell_grid *grid, const qm_cell_marks *marks, const qm_cell_rows *rows);

#endif
