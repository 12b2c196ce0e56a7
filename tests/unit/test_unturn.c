/* Quads of a grid that lie upside down between their neighbours. */
#include "check.h"

#include "ground.h"
#include "reconstruct_work.h"
#include "shapes.h"

#include <string.h>

enum { COLUMNS = 14, ROWS = 11 };

static void place_vertex(const qm_patch_grid *grid, uint32_t i, uint32_t j, double x, double y)
{
    const double at[3] = {x, y, 0.0};
    memcpy(qm_grid_vertex(grid, i, j), at, sizeof at);
}

static qm_patch_grid make_grid(qm_context *ctx)
{
    qm_patch_grid grid = {.columns = COLUMNS, .rows = ROWS};
    assert_true(qm_grid_allocate(ctx, &grid));
    for (uint32_t j = 0; j <= ROWS; j++)
        for (uint32_t i = 0; i <= COLUMNS; i++)
            place_vertex(&grid, i, j, (double)i / COLUMNS, (double)j / ROWS);
    return grid;
}

static double height(const qm_patch_grid *grid, uint32_t i, uint32_t j)
{
    qm_vec a = qm_vec_load(qm_grid_vertex(grid, i, j)), b = qm_vec_load(qm_grid_vertex(grid, i + 1, j));
    qm_vec c = qm_vec_load(qm_grid_vertex(grid, i + 1, j + 1)),
           d = qm_vec_load(qm_grid_vertex(grid, i, j + 1));
    return qm_vec_cross(qm_vec_sub(c, a), qm_vec_sub(d, b)).z;
}

static size_t count_upside_down(const qm_patch_grid *grid)
{
    size_t count = 0;
    for (uint32_t j = 0; j < ROWS; j++)
        for (uint32_t i = 0; i < COLUMNS; i++)
            count += height(grid, i, j) <= 0.0;
    return count;
}

static void vertices_in_the_wrong_order_are_laid_anew(void **state)
{
    (void)state;
    const double corners[][3] = {{-1, -1, 0}, {2, -1, 0}, {2, 2, 0}, {-1, 2, 0}};
    qm_ground g;
    qm_ground_make(&g, qm_shape_face(4, corners));
    for (uint32_t low = 2; low < 8; low++) {
        for (uint32_t high = low + 1; high < 9; high++) {
            qm_patch_grid grid = make_grid(&g.ctx);
            for (uint32_t j = low; j <= high; j++) { /* columns 5 and 6 changed over */
                place_vertex(&grid, 5, j, 6.0 / COLUMNS, (double)j / ROWS);
                place_vertex(&grid, 6, j, 5.0 / COLUMNS, (double)j / ROWS);
            }
            assert_true(count_upside_down(&grid) > 0);
            qm_grid_untangle(&g.source, &grid);
            QM_CHECK(count_upside_down(&grid) == 0, "rows %u to %u: %zu quads upside down", low, high,
                     count_upside_down(&grid));
            qm_grid_free(&g.ctx, &grid);
        }
    }
    qm_ground_free(&g);
}

/** Quads on both sides of a ridge look apart and are right. */
static void ridges_stay(void **state)
{
    (void)state;
    const double slopes[][3] = {{0, -1, 0}, {0.5, -1, 4}, {0.5, 2, 4}, {0, 2, 0}};
    qm_ground g;
    qm_ground_make(&g, qm_shape_face(4, slopes));
    qm_patch_grid grid = make_grid(&g.ctx), before = make_grid(&g.ctx);
    for (uint32_t j = 0; j <= ROWS; j++) {
        for (uint32_t i = 0; i <= COLUMNS; i++) {
            double *vertex = qm_grid_vertex(&grid, i, j);
            vertex[2] = 8.0 * (vertex[0] < 0.5 ? vertex[0] : 1.0 - vertex[0]);
            memcpy(qm_grid_vertex(&before, i, j), vertex, 3 * sizeof *vertex);
        }
    }
    assert_false(qm_grid_unturn(&g.source, &grid));
    assert_memory_equal(grid.vertices, before.vertices, qm_grid_vertex_count(&grid) * 3 * sizeof(double));
    qm_grid_free(&g.ctx, &before);
    qm_grid_free(&g.ctx, &grid);
    qm_ground_free(&g);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(vertices_in_the_wrong_order_are_laid_anew),
        cmocka_unit_test(ridges_stay),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
