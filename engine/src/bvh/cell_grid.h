/**
 * cell_grid.h: a uniform grid over the region that two meshes have in common, and which of its cells the
 * faces of a mesh reach into. Cells are packed so that kernels find those of eight faces at once.
 *
 * Most faces are small and reach into one or two rows of cells along each of the first two axes; one word,
 * chosen without regard to where they lie, marks or looks up such a face.
 */
#ifndef QM_CELL_GRID_H
#define QM_CELL_GRID_H

#include "core/vec.h"

#define QM_CELL_FACES 8 /* faces that a kernel handles at once */
#define QM_CELL_SPAN 24 /* max cells along a row of a face that is looked up with others */

/** Three cell coordinates, a byte each: the last axis lowest. */
typedef uint32_t qm_cell;
enum { QM_CELL_Z = 0, QM_CELL_Y = 8, QM_CELL_X = 16 }; /* the shift of each */

/** Marks of the cells of a row, along the last axis, a bit each. */
typedef uint64_t qm_cell_row;

/** Cells 1 to count along each axis; 0 and count + 1 are all that is outside. The shortest axis comes
 * last. */
typedef struct qm_cell_grid {
    int axis[3]; /* of the mesh; all else is in this order */
    double low[3], high[3], scale[3];
    uint32_t count[3];
    size_t row_count; /* of marks; arrays of marks have room for one more */
} qm_cell_grid;

/** The cells that the boxes of some faces reach into. */
typedef struct qm_cell_boxes {
    _Alignas(32) qm_cell low[QM_CELL_FACES], high[QM_CELL_FACES];
} qm_cell_boxes;

#define QM_CELL_LIST 512 /* faces */

/** Faces with the cells that their boxes reach into; kernels append eight at a time, so there is room beyond
 * the end. */
typedef struct qm_cell_list {
    _Alignas(32) uint32_t face[QM_CELL_LIST + QM_CELL_FACES];
    qm_cell low[QM_CELL_LIST + QM_CELL_FACES], high[QM_CELL_LIST + QM_CELL_FACES];
    unsigned count; /* at most QM_CELL_LIST before faces are appended */
} qm_cell_list;

/** Builds the grid over the intersection of the bounding boxes of two meshes, which box returns. False if the
 * boxes are disjoint. */
bool qm_cell_grid_init(const qm_mesh *const mesh[2], qm_box box[2], qm_cell_grid *grid);

/** Rows from one x to the next. */
static inline uint32_t qm_cell_stride(const qm_cell_grid *grid)
{
    return grid->count[1] + 2;
}

/* ---- marked cells ---- */

/**
 * Marks of the row of cells at x and y. Word 2 i + j, with i and j 0 or 1, is about the rows x to x + i and y
 * to y + j: while marks are added, the marks of boxes that span exactly these rows; after
 * qm_cell_marks_spread, all marks in any of these rows.
 */
typedef struct qm_cell_marks {
    qm_cell_row over[4];
} qm_cell_marks;

/** The rows that a box spans. */
typedef struct qm_cell_rows {
    uint32_t x, y, x_more, y_more; /* the first, and how many more */
    qm_cell_row bits;              /* of the cells in each row */
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

static inline size_t qm_cell_rows_index(const qm_cell_grid *grid, uint32_t x, uint32_t y)
{
    QM_ASSERT(x < grid->count[0] + 2 && y < grid->count[1] + 2);
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
        marks[qm_cell_rows_index(grid, rows->x, rows->y)].over[2 * rows->x_more + rows->y_more] |= rows->bits;
    else
        qm_cell_marks_add_large(grid, marks, rows);
}

/** Prepares marks that were added for lookups. */
void qm_cell_marks_spread(const qm_cell_grid *grid, qm_cell_marks *marks);

/** True when a box of any size reaches into a marked cell. */
bool qm_cell_marks_meet(const qm_cell_grid *grid, const qm_cell_marks *marks, const qm_cell_rows *rows);

#endif
