#include "reconstruct_work.h"

#include <string.h>

#define FLAT_TURN 20.0 /* what flat places count as turning along the diagonal, in radians */

enum { ROW = 3 * sizeof(double) };

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the patches");
}

bool qm_grid_allocate(qm_context *ctx, qm_patch_grid *grid)
{
    size_t count = qm_grid_vertex_count(grid);
    grid->vertices = qm_context_alloc(ctx, count, ROW);
    grid->in_hole = qm_context_alloc(ctx, count, sizeof *grid->in_hole);
    if (grid->vertices && grid->in_hole) {
        memset(grid->in_hole, 0, count * sizeof *grid->in_hole);
        return true;
    }
    qm_grid_free(ctx, grid);
    return false;
}

void qm_grid_free(qm_context *ctx, qm_patch_grid *grid)
{
    size_t count = qm_grid_vertex_count(grid);
    qm_context_free(ctx, grid->vertices, count, ROW);
    qm_context_free(ctx, grid->in_hole, count, sizeof *grid->in_hole);
    grid->vertices = NULL;
    grid->in_hole = NULL;
}

/** Copies the vertices of the four curves to the outline of a grid. */
static void set_outline(const qm_reconstruction *r, size_t p)
{
    const qm_layout_patch *patch = &r->layout.patches[p];
    qm_patch_grid *grid = &r->grids[p];
    for (uint32_t i = 0; i <= grid->columns; i++) {
        memcpy(qm_grid_vertex(grid, i, 0), qm_border_vertex(r, patch, 0, i), ROW);
        memcpy(qm_grid_vertex(grid, i, grid->rows), qm_border_vertex(r, patch, 2, grid->columns - i), ROW);
    }
    for (uint32_t j = 0; j <= grid->rows; j++) {
        memcpy(qm_grid_vertex(grid, grid->columns, j), qm_border_vertex(r, patch, 1, j), ROW);
        memcpy(qm_grid_vertex(grid, 0, j), qm_border_vertex(r, patch, 3, grid->rows - j), ROW);
    }
}

/** Bilinearly blended: two ruled surfaces less the bilinear one of the corners (6.4 of the source). */
qm_vec qm_grid_coons(const qm_patch_grid *grid, const qm_vertex_block *block, uint32_t column, uint32_t row)
{
    uint32_t left = block->low[0], right = block->high[0], first = block->low[1], last = block->high[1];
    double u = (double)(column - left) / (right - left), v = (double)(row - first) / (last - first);
    qm_vec across = qm_vec_mix(qm_grid_at(grid, column, first), qm_grid_at(grid, column, last), v);
    qm_vec along = qm_vec_mix(qm_grid_at(grid, left, row), qm_grid_at(grid, right, row), u);
    qm_vec bottom = qm_vec_mix(qm_grid_at(grid, left, first), qm_grid_at(grid, right, first), u);
    qm_vec top = qm_vec_mix(qm_grid_at(grid, left, last), qm_grid_at(grid, right, last), u);
    return qm_vec_sub(qm_vec_add(across, along), qm_vec_mix(bottom, top, v));
}

static void blend_coons(qm_patch_grid *grid)
{
    const qm_vertex_block whole = {{0, 0}, {grid->columns, grid->rows}};
    for (uint32_t j = 1; j < grid->rows; j++)
        for (uint32_t i = 1; i < grid->columns; i++)
            qm_vec_store(qm_grid_vertex(grid, i, j), qm_grid_coons(grid, &whole, i, j));
}

qm_status qm_grids_create(qm_context *ctx, qm_reconstruction *r)
{
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        qm_patch_grid *grid = &r->grids[p];
        qm_grid_free(ctx, grid);
        *grid = (qm_patch_grid){.columns = qm_patch_chord(r, p, 0)->work,
                                .rows = qm_patch_chord(r, p, 1)->work,
                                .is_stale = true,
                                .part = grid->part,
                                .points = grid->points};
        if (!qm_grid_allocate(ctx, grid)) return no_memory(ctx);
        set_outline(r, p);
        blend_coons(grid);
    }
    return QM_OK;
}

/** A finer grid through the old vertices; those between them lie in the middle of their two or four. */
static void fill_between(const qm_patch_grid *old, qm_patch_grid *fine)
{
    uint32_t across = fine->columns / old->columns, down = fine->rows / old->rows;
    for (uint32_t j = 0; j <= fine->rows; j++) {
        uint32_t row = j / down, next_row = row < old->rows ? row + 1 : row;
        double v = (double)(j % down) / down;
        for (uint32_t i = 0; i <= fine->columns; i++) {
            uint32_t column = i / across, next = column < old->columns ? column + 1 : column;
            double u = (double)(i % across) / across;
            qm_vec low = qm_vec_mix(qm_grid_at(old, column, row), qm_grid_at(old, next, row), u);
            qm_vec high = qm_vec_mix(qm_grid_at(old, column, next_row), qm_grid_at(old, next, next_row), u);
            qm_vec_store(qm_grid_vertex(fine, i, j), qm_vec_mix(low, high, v));
        }
    }
}

static qm_status double_grid(qm_context *ctx, qm_reconstruction *r, size_t p, uint32_t columns, uint32_t rows)
{
    qm_patch_grid *grid = &r->grids[p];
    qm_patch_grid fine = {
        .columns = columns, .rows = rows, .is_stale = true, .part = grid->part, .points = grid->points};
    if (!qm_grid_allocate(ctx, &fine)) return no_memory(ctx);
    fill_between(grid, &fine);
    qm_grid_free(ctx, grid);
    *grid = fine;
    set_outline(r, p);
    return QM_OK;
}

qm_status qm_grids_double(qm_context *ctx, qm_reconstruction *r)
{
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        uint32_t columns = qm_patch_chord(r, p, 0)->work, rows = qm_patch_chord(r, p, 1)->work;
        if (columns == r->grids[p].columns && rows == r->grids[p].rows) continue;
        qm_status status = double_grid(ctx, r, p, columns, rows);
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

/** Normal of the grid at a vertex, by the neighbours that there are; 0 where they lie on one line. */
static qm_vec grid_normal(const qm_patch_grid *grid, uint32_t i, uint32_t j)
{
    uint32_t west = i > 0 ? i - 1 : i, east = i < grid->columns ? i + 1 : i;
    uint32_t south = j > 0 ? j - 1 : j, north = j < grid->rows ? j + 1 : j;
    qm_vec normal = qm_vec_cross(qm_vec_sub(qm_grid_at(grid, east, j), qm_grid_at(grid, west, j)),
                                 qm_vec_sub(qm_grid_at(grid, i, north), qm_grid_at(grid, i, south)));
    double length = qm_vec_norm(normal);
    return length > 0.0 ? qm_vec_scale(1.0 / length, normal) : (qm_vec){0, 0, 0};
}

/** A vertex with its normal. */
typedef struct fair_point {
    qm_vec at, normal;
} fair_point;

/**
 * What an edge weighs: the square root of its height over the chord, which is its length times the angle that
 * the surface turns along it, and of a flat part so that flat places get vertices too. Equal weights mean
 * equal distances from the surface.
 */
static double edge_weight(const fair_point *a, const fair_point *b, double flat)
{
    double length2 = qm_vec_norm2(qm_vec_sub(a->at, b->at));
    double turn2 = qm_vec_norm2(qm_vec_sub(a->normal, b->normal));
    return sqrt(flat * length2 + sqrt(length2 * turn2));
}

/** A quarter of the way along the heavier of two edges to where both would weigh the same. */
static qm_vec even_out(const fair_point *before, const fair_point *here, const fair_point *after, double flat)
{
    double back = edge_weight(before, here, flat), on = edge_weight(here, after, flat);
    double heavier = fmax(back, on);
    if (heavier == 0.0) return (qm_vec){0, 0, 0};
    return qm_vec_scale(0.25 * fabs(on - back) / heavier,
                        qm_vec_sub(on > back ? after->at : before->at, here->at));
}

static fair_point point_of(const qm_patch_grid *grid, const qm_vec *normal, uint32_t i, uint32_t j)
{
    return (fair_point){qm_grid_at(grid, i, j), normal[(size_t)j * (grid->columns + 1) + i]};
}

/** Slides each vertex along its row and its column towards equal weights on both sides. */
static void fair_round(qm_patch_grid *grid, qm_vec *normal, double flat)
{
    for (uint32_t j = 0; j <= grid->rows; j++)
        for (uint32_t i = 0; i <= grid->columns; i++)
            normal[(size_t)j * (grid->columns + 1) + i] = grid_normal(grid, i, j);
    for (uint32_t j = 1; j < grid->rows; j++) {
        for (uint32_t i = 1; i < grid->columns; i++) {
            fair_point here = point_of(grid, normal, i, j);
            fair_point west = point_of(grid, normal, i - 1, j), east = point_of(grid, normal, i + 1, j);
            fair_point south = point_of(grid, normal, i, j - 1), north = point_of(grid, normal, i, j + 1);
            qm_vec move =
                qm_vec_add(even_out(&west, &here, &east, flat), even_out(&south, &here, &north, flat));
            qm_vec_store(qm_grid_vertex(grid, i, j), qm_vec_add(here.at, move));
        }
    }
}

/** Vertices that have slid off the surface would be projected on from the wrong side of a narrow gap. */
static void pull_round(const qm_source *source, qm_patch_grid *grid)
{
    for (uint32_t j = 1; j < grid->rows; j++) {
        for (uint32_t i = 1; i < grid->columns; i++) {
            qm_foothold foot;
            qm_source_pull(source, qm_grid_vertex(grid, i, j), &foot);
            memcpy(qm_grid_vertex(grid, i, j), foot.position, ROW);
        }
    }
}

qm_status qm_grids_fair(qm_context *ctx, qm_reconstruction *r, int rounds)
{
    size_t most = 0;
    for (size_t p = 0; p < r->layout.patch_count; p++) {
        size_t count = qm_grid_vertex_count(&r->grids[p]);
        if (count > most) most = count;
    }
    qm_vec *normal = qm_context_alloc(ctx, most, sizeof *normal);
    if (!normal) return no_memory(ctx);
    double flat = FLAT_TURN / r->source.diagonal;
    for (size_t p = 0; p < r->layout.patch_count; p++)
        for (int round = 0; round < rounds && r->grids[p].is_stale; round++) {
            fair_round(&r->grids[p], normal, flat);
            /* A point set may have noise, which would roughen the grid before anything is averaged. */
            if (!r->source.is_cloud) pull_round(&r->source, &r->grids[p]);
        }
    qm_context_free(ctx, normal, most, sizeof *normal);
    return QM_OK;
}
