/**
 * collide_cells.h: cells of a grid that two meshes are looked at through, packed so that those of eight faces
 * are found at once.
 */
#ifndef QM_COLLIDE_CELLS_H
#define QM_COLLIDE_CELLS_H

#include "core/vec.h"

#define QM_CELL_FACES 8 /* faces that are looked at together */
#define QM_CELL_SPAN 24 /* cells along a row that a face may reach over to be looked up with others */

/** Three cells, one along each axis, a byte each: the last axis lowest. */
typedef uint32_t qm_cell;
enum { QM_CELL_Z = 0, QM_CELL_Y = 8, QM_CELL_X = 16 }; /* how far each is shifted */

/** Marks of the cells along the last axis, a bit each. */
typedef uint64_t qm_cell_row;

/** Cells 1 to count along each axis; 0 and count + 1 are all that is outside. The shortest axis comes
 * last. */
typedef struct qm_cell_grid {
    int axis[3]; /* the mesh's; all else is in this order */
    double low[3], high[3], scale[3];
    uint32_t count[3];
    size_t row_count; /* of marks; there is room for one more */
} qm_cell_grid;

/** The cells that the boxes of some faces reach into. */
typedef struct qm_cell_boxes {
    _Alignas(32) qm_cell low[QM_CELL_FACES], high[QM_CELL_FACES];
} qm_cell_boxes;

#define QM_CELL_LIST 512 /* faces */

/** Faces with the cells that their boxes reach into; there is room beyond the end for what is put in eight at
 * a time. */
typedef struct qm_cell_list {
    _Alignas(32) uint32_t face[QM_CELL_LIST + QM_CELL_FACES];
    qm_cell low[QM_CELL_LIST + QM_CELL_FACES], high[QM_CELL_LIST + QM_CELL_FACES];
    unsigned count; /* at most QM_CELL_LIST before faces are added */
} qm_cell_list;

/** Lays the grid over what the boxes of two meshes' vertices, which are told, have in common; false when that
 * is nothing. */
bool qm_cell_grid_lay(const qm_mesh *const mesh[2], qm_box box[2], qm_cell_grid *grid);

/** Rows from one x to the next are this many apart. */
static inline uint32_t qm_cell_stride(const qm_cell_grid *grid)
{
    return grid->count[1] + 2;
}

#endif
