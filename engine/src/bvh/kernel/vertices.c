/**
 * vertices.c: passes over all vertices of a mesh, four at a time: twelve coordinates are three vectors, in
 * each of which the axes come in another order.
 */
#include <string.h>

#include "bvh/cell_grid.h"
#include "four.h"
#include "kernels.h"

enum { BATCH = 4, PARTS = 3 };

typedef int32_t four_cells __attribute__((vector_size(16)));

static inline qm_four load(const double *p)
{
    typedef double four __attribute__((vector_size(32), aligned(8)));
    return (qm_four) * (const four *)(const void *)p;
}

/** Repeats a value of each axis in the order of the twelve coordinates. */
static inline void repeat(const double axis[3], qm_four part[PARTS])
{
    for (int i = 0; i < PARTS * BATCH; i++)
        part[i / BATCH][i % BATCH] = axis[i % 3];
}

void QM_KERNEL(vertex_box)(const double *positions, size_t count, qm_box *box)
{
    qm_four low[PARTS], high[PARTS];
    for (int part = 0; part < PARTS; part++) {
        low[part] = (qm_four){INFINITY, INFINITY, INFINITY, INFINITY};
        high[part] = -low[part];
    }
    size_t i = 0;
    for (; i + BATCH <= count; i += BATCH) {
        for (int part = 0; part < PARTS; part++) {
            qm_four p = load(positions + 3 * i + BATCH * part);
            low[part] = qm_four_min(p, low[part]);
            high[part] = qm_four_max(p, high[part]);
        }
    }
    *box = (qm_box){{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (int k = 0; k < PARTS * BATCH; k++) {
        box->min[k % 3] = fmin(box->min[k % 3], low[k / BATCH][k % BATCH]);
        box->max[k % 3] = fmax(box->max[k % 3], high[k / BATCH][k % BATCH]);
    }
    for (; i < count; i++) {
        for (int k = 0; k < 3; k++) {
            box->min[k] = fmin(box->min[k], positions[3 * i + (size_t)k]);
            box->max[k] = fmax(box->max[k], positions[3 * i + (size_t)k]);
        }
    }
}

/** Sets the vertices that lie on a side, of count positions from first on. */
static inline void set_sides(const double *positions, size_t first, size_t count, const qm_box *box,
                             uint32_t vertex[QM_BOX_SIDES])
{
    for (size_t i = 3 * first; i < 3 * (first + count); i++) {
        if (positions[i] == box->min[i % 3]) vertex[i % 3] = (uint32_t)(i / 3);
        if (positions[i] == box->max[i % 3]) vertex[3 + i % 3] = (uint32_t)(i / 3);
    }
}

/** Few vertices lie on any side: four at a time are tested and skipped. */
void QM_KERNEL(vertices_on_sides)(const double *positions, size_t count, const qm_box *box,
                                  uint32_t vertex[QM_BOX_SIDES])
{
    qm_four low[PARTS], high[PARTS];
    repeat(box->min, low);
    repeat(box->max, high);
    size_t i = 0;
    for (; i + BATCH <= count; i += BATCH) {
        qm_four_mask on = {0};
        for (int part = 0; part < PARTS; part++) {
            qm_four p = load(positions + 3 * i + BATCH * part);
            on |= (p == low[part]) | (p == high[part]);
        }
        if ((on[0] | on[1] | on[2] | on[3]) != 0) set_sides(positions, i, BATCH, box, vertex);
    }
    set_sides(positions, i, count - i, box, vertex);
}

/** The grid in the order of the twelve coordinates. */
typedef struct wide_grid {
    qm_four low[PARTS], high[PARTS], scale[PARTS], count[PARTS];
    four_cells shift[PARTS];
} wide_grid;

static inline void widen(const qm_cell_grid *grid, wide_grid *out)
{
    static const int shift_of[3] = {QM_CELL_X, QM_CELL_Y, QM_CELL_Z};
    double low[3], high[3], scale[3], count[3];
    int shift[3];
    for (int k = 0; k < 3; k++) {
        int axis = grid->axis[k];
        low[axis] = grid->low[k];
        high[axis] = grid->high[k];
        scale[axis] = grid->scale[k];
        count[axis] = grid->count[k];
        shift[axis] = shift_of[k];
    }
    repeat(low, out->low);
    repeat(high, out->high);
    repeat(scale, out->scale);
    repeat(count, out->count);
    for (int i = 0; i < PARTS * BATCH; i++)
        out->shift[i / BATCH][i % BATCH] = shift[i % 3];
}

/** The cell of each coordinate, shifted to its byte. NaN, from a grid of no length, gives the first cell. */
static inline four_cells find_cells(const wide_grid *grid, int part, qm_four p)
{
    const qm_four zero = {0}, none = zero - 1.0, count = grid->count[part];
    qm_four cell = qm_four_max((p - grid->low[part]) * grid->scale[part], zero);
    cell = qm_four_min(cell, count - 1.0);
    cell = qm_four_select(p > grid->high[part], count, cell);
    cell = qm_four_select(p < grid->low[part], none, cell);
    return (__builtin_convertvector(cell, four_cells) + 1) << grid->shift[part];
}

static inline void find_four(const wide_grid *grid, const double *positions, qm_cell *cells)
{
    _Alignas(16) int32_t cell[PARTS * BATCH];
    for (int part = 0; part < PARTS; part++)
        *(four_cells *)(void *)(cell + BATCH * part) = find_cells(grid, part, load(positions + BATCH * part));
    for (int i = 0; i < BATCH; i++)
        cells[i] = (qm_cell)(cell[3 * i] | cell[3 * i + 1] | cell[3 * i + 2]);
}

void QM_KERNEL(vertex_cells)(const qm_cell_grid *grid, const double *positions, size_t count, qm_cell *cells)
{
    wide_grid wide;
    widen(grid, &wide);
    size_t i = 0;
    for (; i + BATCH <= count; i += BATCH)
        find_four(&wide, positions + 3 * i, cells + i);
    if (i == count) return;
    double remainder[3 * BATCH] = {0};
    qm_cell found[BATCH];
    memcpy(remainder, positions + 3 * i, 3 * (count - i) * sizeof *remainder);
    find_four(&wide, remainder, found);
    memcpy(cells + i, found, (count - i) * sizeof *found);
}

/** Quantizes four vertices. */
static inline void fine_four(const qm_four origin[PARTS], qm_four scale, const double *positions,
                             uint64_t fine[BATCH])
{
    const qm_four half = qm_four_set(1 << (QM_FINE_BITS - 1)), last = 2.0 * half - 1.0;
    _Alignas(16) int32_t number[PARTS * BATCH];
    for (int part = 0; part < PARTS; part++) {
        qm_four local = (load(positions + BATCH * part) - origin[part]) * scale;
        qm_four within = qm_four_min(qm_four_max((local + 1.0) * half, (qm_four){0}), last);
        *(four_cells *)(void *)(number + BATCH * part) = __builtin_convertvector(within, four_cells);
    }
    for (int i = 0; i < BATCH; i++)
        fine[i] = (uint64_t)number[3 * i] | (uint64_t)number[3 * i + 1] << QM_FINE_FIELD |
                  (uint64_t)number[3 * i + 2] << (2 * QM_FINE_FIELD);
}

void QM_KERNEL(vertex_fine)(const double origin[3], double scale, const double *positions, size_t count,
                            uint64_t *fine)
{
    qm_four wide_origin[PARTS];
    repeat(origin, wide_origin);
    size_t i = 0;
    for (; i + BATCH <= count; i += BATCH)
        fine_four(wide_origin, qm_four_set(scale), positions + 3 * i, fine + i);
    if (i == count) return;
    double remainder[3 * BATCH] = {0};
    uint64_t found[BATCH];
    memcpy(remainder, positions + 3 * i, 3 * (count - i) * sizeof *remainder);
    fine_four(wide_origin, qm_four_set(scale), remainder, found);
    memcpy(fine + i, found, (count - i) * sizeof *found);
}
