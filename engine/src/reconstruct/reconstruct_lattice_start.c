/**
 * reconstruct_lattice_start.c: lattices from grids that came with the layout, as those of a layout that was made of quads do: they
 * lie on the surface over ears and fingers too, where a Coons patch does not.
 *
 * The vertices of curves of a layout with grids lie at equal arc length, and those of grids where the grid has them. So a vertex of the lattice has the
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

static int cell_of(double place)
{
    return (int)qm_clamp(floor(place), 0, CELLS - 1);
}

static qm_vec interpolate(const start_grid *grid, double column, double row)
{
    int i = cell_of(column), j = cell_of(row);
    return qm_vec_mix(qm_vec_mix(grid->at[j][i], grid->at[j][i + 1], column - i),
                      qm_vec_mix(grid->at[j + 1][i], grid->at[j + 1][i + 1], column - i), row - j);
}

/** The nearest point of the wall that looks as a cell of the grid does there, if one is nearer than the cell is wide, else the
 * nearest of all. */
static void project(const qm_reconstruction *r, const start_grid *grid, double column, double row,
                    qm_ref_surface_point *on)
{
    double at[3], toward[3];
    int i = cell_of(column), j = cell_of(row);
    qm_vec rise = qm_vec_sub(grid->at[j + 1][i + 1], grid->at[j][i]),
           fall = qm_vec_sub(grid->at[j + 1][i], grid->at[j][i + 1]), normal = qm_vec_cross(rise, fall);
    double length = qm_vec_norm(normal), reach = fmax(qm_vec_norm(rise), qm_vec_norm(fall));
    qm_vec_store(at, interpolate(grid, column, row));
    if (r->has_sides && length > 0.0) {
        qm_vec_store(toward, qm_vec_scale(1.0 / length, normal));
        if (qm_ref_surface_project_toward(&r->surface, at, toward, reach, on)) return;
    }
    qm_ref_surface_project(&r->surface, at, on);
}

/** Above 0 if the grid of a patch is anticlockwise about the surface's normals, below 0 if it is clockwise. */
static double side_of_grid(const qm_reconstruction *r, size_t p)
{
    start_grid grid;
    double sum = 0.0;
    load_grid(r, p, &grid);
    for (int row = 1; row < CELLS; row++)
        for (int column = 1; column < CELLS; column++) {
            double at[3];
            qm_ref_surface_point on;
            qm_vec_store(at, grid.at[row][column]);
            qm_ref_surface_project(&r->surface, at, &on);
            qm_vec along = qm_vec_sub(grid.at[row][column + 1], grid.at[row][column - 1]),
                   up = qm_vec_sub(grid.at[row + 1][column], grid.at[row - 1][column]);
            sum += qm_vec_dot(qm_vec_cross(along, up), qm_vec_load(on.normal));
        }
    return sum;
}

void qm_lattices_orient(qm_reconstruction *r)
{
    size_t patches = r->layout.patch_count;
    uint32_t components = 0;
    for (size_t p = 0; p < patches; p++)
        if (r->lattices[p].component >= components) components = r->lattices[p].component + 1;
    for (uint32_t component = 0; component < components; component++) {
        double sum = 0.0;
        for (size_t p = 0; p < patches; p++)
            if (r->lattices[p].component == component) sum += side_of_grid(r, p);
        for (size_t p = 0; p < patches && sum < 0.0; p++)
            if (r->lattices[p].component == component) qm_parameters_flip(r, p);
    }
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
            qm_ref_surface_point on;
            project(r, &grid, column, row, &on);
            memcpy(qm_lattice_vertex(lattice, i, j), on.position, sizeof on.position);
        }
    }
}

qm_status qm_lattices_place(qm_context *ctx, qm_reconstruction *r)
{
    qm_status status = qm_lattices_create(ctx, r);
    if (status == QM_OK && !r->options.grids) return qm_maps_start(ctx, r);
    for (size_t p = 0; p < r->layout.patch_count && status == QM_OK; p++)
        start_inside(r, p);
    return status;
}
