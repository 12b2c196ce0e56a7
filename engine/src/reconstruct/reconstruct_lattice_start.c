/**
 * reconstruct_lattice_start.c: lattices from grids that came with the layout, as those of a layout that was made of quads do: they
 * lie on the surface over ears and fingers too, where a Coons patch does not.
 *
 * The vertices of curves lie at equal arc length, and those of grids where the grid has them. So a vertex of the lattice has the
 * parameters in the grid at which its row and its column have their share of the sides' lengths.
 */
#include "reconstruct_internal.h"

#include <string.h>

#define CELLS QM_LAYOUT_GRID
#define MEETING_ROUNDS 4 /* of finding where a row and a column meet */

/** A grid in the orientation of its patch, and the arc length up to each point of its sides, as shares of them. */
typedef struct start_grid {
    qm_vec at[CELLS + 1][CELLS + 1]; /* by row, column */
    double share[4][CELLS +
                    1]; /* along the columns of rows 0 and CELLS, along the rows of columns 0 and CELLS */
} start_grid;

static void load_grid(const qm_reconstruction *r, size_t p, start_grid *grid)
{
    const double *from = r->options.grids + 3 * QM_LAYOUT_GRID_POINTS * p;
    for (int row = 0; row <= CELLS; row++)
        for (int column = 0; column <= CELLS; column++, from += 3) {
            qm_vec *to = r->lattices[p].is_flipped ? &grid->at[column][row] : &grid->at[row][column];
            *to = qm_vec_load(from);
        }
    for (int side = 0; side < 4; side++) {
        int line = side % 2 == 0 ? 0 : CELLS;
        grid->share[side][0] = 0.0;
        for (int k = 1; k <= CELLS; k++) {
            qm_vec a = side < 2 ? grid->at[line][k - 1] : grid->at[k - 1][line],
                   b = side < 2 ? grid->at[line][k] : grid->at[k][line];
            grid->share[side][k] = grid->share[side][k - 1] + qm_vec_distance(a, b);
        }
        for (int k = 1; k <= CELLS; k++)
            grid->share[side][k] = grid->share[side][CELLS] > 0.0
                                       ? grid->share[side][k] / grid->share[side][CELLS]
                                       : (double)k / CELLS;
    }
}

/** Where a side has a share of its length, in cells. */
static double place_of(const double *share, double wanted)
{
    int k = 0;
    while (k + 1 < CELLS && share[k + 1] < wanted)
        k++;
    double step = share[k + 1] - share[k];
    return k + (step > 0.0 ? qm_clamp((wanted - share[k]) / step, 0.0, 1.0) : 0.5);
}

static qm_vec interpolate(const start_grid *grid, double column, double row)
{
    int i = (int)qm_clamp(floor(column), 0, CELLS - 1), j = (int)qm_clamp(floor(row), 0, CELLS - 1);
    return qm_vec_mix(qm_vec_mix(grid->at[j][i], grid->at[j][i + 1], column - i),
                      qm_vec_mix(grid->at[j + 1][i], grid->at[j + 1][i + 1], column - i), row - j);
}

static void start_inside(const qm_reconstruction *r, size_t p)
{
    const qm_lattice *lattice = &r->lattices[p];
    start_grid grid;
    load_grid(r, p, &grid);
    for (uint32_t j = 1; j < lattice->rows; j++) {
        double v = (double)j / lattice->rows, left = place_of(grid.share[2], v),
               right = place_of(grid.share[3], v);
        for (uint32_t i = 1; i < lattice->columns; i++) {
            double u = (double)i / lattice->columns, low = place_of(grid.share[0], u),
                   high = place_of(grid.share[1], u), column = CELLS * u, row = CELLS * v;
            for (int round = 0; round < MEETING_ROUNDS; round++) {
                column = low + row / CELLS * (high - low);
                row = left + column / CELLS * (right - left);
            }
            double at[3];
            qm_ref_surface_point on;
            qm_vec_store(at, interpolate(&grid, column, row));
            qm_ref_surface_project(&r->surface, at, &on);
            memcpy(qm_lattice_vertex(lattice, i, j), on.position, sizeof on.position);
        }
    }
}

qm_status qm_lattices_start(qm_context *ctx, qm_reconstruction *r)
{
    qm_status status = qm_lattices_create(ctx, r);
    for (size_t p = 0; p < r->layout.patch_count && status == QM_OK; p++)
        start_inside(r, p);
    return status;
}
