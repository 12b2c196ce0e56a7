/* Quads of a grid that lie upside down between their neighbours. */
#include "check.h"

#include "ground.h"
#include "layouts.h"
#include "random.h"
#include "reconstruct/reconstruct_internal.h"
#include "shapes.h"

#include <string.h>

enum { COLUMNS = 14, ROWS = 11 };

static void place_vertex(const qm_lattice *grid, uint32_t i, uint32_t j, double x, double y)
{
    const double at[3] = {x, y, 0.0};
    memcpy(qm_lattice_vertex(grid, i, j), at, sizeof at);
}

static qm_lattice make_grid(qm_context *ctx)
{
    qm_lattice grid = {.columns = COLUMNS, .rows = ROWS};
    assert_true(qm_lattice_allocate(ctx, &grid));
    for (uint32_t j = 0; j <= ROWS; j++)
        for (uint32_t i = 0; i <= COLUMNS; i++)
            place_vertex(&grid, i, j, (double)i / COLUMNS, (double)j / ROWS);
    return grid;
}

static qm_vec normal_of(const qm_lattice *grid, uint32_t i, uint32_t j)
{
    qm_vec a = qm_vec_load(qm_lattice_vertex(grid, i, j)), b = qm_vec_load(qm_lattice_vertex(grid, i + 1, j));
    qm_vec c = qm_vec_load(qm_lattice_vertex(grid, i + 1, j + 1)),
           d = qm_vec_load(qm_lattice_vertex(grid, i, j + 1));
    return qm_vec_cross(qm_vec_sub(c, a), qm_vec_sub(d, b));
}

static size_t count_upside_down(const qm_lattice *grid)
{
    size_t count = 0;
    for (uint32_t j = 0; j < ROWS; j++)
        for (uint32_t i = 0; i < COLUMNS; i++)
            count += normal_of(grid, i, j).z <= 0.0;
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
            qm_lattice grid = make_grid(&g.ctx);
            for (uint32_t j = low; j <= high; j++) { /* columns 5 and 6 changed over */
                place_vertex(&grid, 5, j, 6.0 / COLUMNS, (double)j / ROWS);
                place_vertex(&grid, 6, j, 5.0 / COLUMNS, (double)j / ROWS);
            }
            assert_true(count_upside_down(&grid) > 0);
            qm_lattice_untangle(&g.source, &grid);
            QM_CHECK(count_upside_down(&grid) == 0, "rows %u to %u: %zu quads upside down", low, high,
                     count_upside_down(&grid));
            qm_lattice_free(&g.ctx, &grid);
        }
    }
    qm_ground_free(&g);
}

/** Quads that cannot open, on a wide plane: no vertex may leave for a better quad elsewhere. */
static void vertices_stay_among_their_neighbours(void **state)
{
    (void)state;
    const double corners[][3] = {{-100, -100, 0}, {100, -100, 0}, {100, 100, 0}, {-100, 100, 0}};
    qm_ground g;
    qm_ground_make(&g, qm_shape_face(4, corners));
    for (uint64_t stream = 1; stream <= 200; stream++) {
        qm_random random = qm_random_make(qm_check_seed(), stream);
        qm_lattice grid = make_grid(&g.ctx);
        for (uint32_t j = 0; j <= ROWS; j++)
            for (uint32_t i = 0; i <= COLUMNS; i++)
                place_vertex(&grid, i, j, qm_random_range(&random, 0.0, 1.0),
                             qm_random_range(&random, 0.0, 1.0));
        qm_lattice_untangle(&g.source, &grid);
        double farthest = 0.0;
        for (size_t k = 0; k < 3 * qm_lattice_vertex_count(&grid); k++)
            farthest = fmax(farthest, fabs(grid.vertices[k] - 0.5));
        QM_CHECK(farthest <= 3.0, "seed %llu, stream %d: a vertex is %g away",
                 (unsigned long long)qm_check_seed(), (int)stream, farthest);
        qm_lattice_free(&g.ctx, &grid);
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
    qm_lattice grid = make_grid(&g.ctx), before = make_grid(&g.ctx);
    for (uint32_t j = 0; j <= ROWS; j++) {
        for (uint32_t i = 0; i <= COLUMNS; i++) {
            double *vertex = qm_lattice_vertex(&grid, i, j);
            vertex[2] = 8.0 * (vertex[0] < 0.5 ? vertex[0] : 1.0 - vertex[0]);
            memcpy(qm_lattice_vertex(&before, i, j), vertex, 3 * sizeof *vertex);
        }
    }
    assert_false(qm_lattice_rebuild_inverted(&g.source, &grid));
    assert_memory_equal(grid.vertices, before.vertices, qm_lattice_vertex_count(&grid) * 3 * sizeof(double));
    qm_lattice_free(&g.ctx, &before);
    qm_lattice_free(&g.ctx, &grid);
    qm_ground_free(&g);
}

static bool are_apart(const qm_lattice *grid, uint32_t i, uint32_t j, uint32_t column, uint32_t row)
{
    qm_vec a = normal_of(grid, i, j), b = normal_of(grid, column, row);
    return qm_vec_dot(a, b) < -0.2 * qm_vec_norm(a) * qm_vec_norm(b);
}

/** Inner quads that look away from three or four of those beside them. */
static size_t count_apart(const qm_lattice *grid)
{
    size_t count = 0;
    for (uint32_t j = 1; j + 1 < ROWS; j++) {
        for (uint32_t i = 1; i + 1 < COLUMNS; i++) {
            int apart = are_apart(grid, i, j, i - 1, j) + are_apart(grid, i, j, i + 1, j) +
                        are_apart(grid, i, j, i, j - 1) + are_apart(grid, i, j, i, j + 1);
            count += apart >= 3;
        }
    }
    return count;
}

/** Columns 5 and 6 changed over, on points that lie farther from the plane than vertices from one another. */
static void noise_does_not_keep_quads_upside_down(void **state)
{
    (void)state;
    for (uint64_t stream = 1; stream <= 60; stream++) {
        qm_ground g;
        qm_ground_make(&g, qm_ground_sample(qm_square_at, 200, 0.1, stream));
        qm_lattice grid = make_grid(&g.ctx);
        for (uint32_t j = 3; j <= 8; j++) {
            place_vertex(&grid, 5, j, 6.0 / COLUMNS, (double)j / ROWS);
            place_vertex(&grid, 6, j, 5.0 / COLUMNS, (double)j / ROWS);
        }
        qm_lattice_untangle(&g.source, &grid);
        QM_CHECK(count_apart(&grid) == 0, "seed %llu, stream %d: %zu quads upside down",
                 (unsigned long long)qm_check_seed(), (int)stream, count_apart(&grid));
        qm_lattice_free(&g.ctx, &grid);
        qm_ground_free(&g);
    }
}

static qm_vec edge_of(const qm_polyline *track, uint32_t k)
{
    return qm_vec_sub(qm_vec_load(track->vertices + 3 * (size_t)k + 3),
                      qm_vec_load(track->vertices + 3 * (size_t)k));
}

/** Edges of a curve that lead back between two that lead on. */
static size_t count_back(const qm_polyline *track)
{
    size_t back = 0;
    for (uint32_t k = 1; k + 1 < track->vertex_edges; k++) {
        qm_vec before = edge_of(track, k - 1), here = edge_of(track, k), after = edge_of(track, k + 1);
        back += qm_vec_dot(before, here) < 0.0 && qm_vec_dot(here, after) < 0.0 &&
                qm_vec_dot(before, after) > 0.0;
    }
    return back;
}

static void curves_over_few_points_do_not_turn_back(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_ground_sample(qm_torus_at, 2000, 0.06, 9));
    qm_layout layout = qm_layout_of_grid(2, 2, true, true, 60, qm_torus_at, NULL);
    qm_reconstruction_options options = qm_reconstruction_options_default();
    qm_reconstruction *r;
    assert_int_equal(qm_reconstruction_create(&g.ctx, &g.source, &layout, &options, &r), QM_OK);
    qm_reconstruction_record record;
    do
        assert_int_equal(qm_reconstruction_step(&g.ctx, r, 16384, &record), QM_OK);
    while (record.chords_changed > 0);
    for (size_t c = 0; c < layout.curve_count; c++) {
        assert_true(r->polylines[c].vertex_edges >= 32);
        QM_CHECK(count_back(&r->polylines[c]) == 0, "curve %zu: %zu of %u edges lead back", c,
                 count_back(&r->polylines[c]), r->polylines[c].vertex_edges);
    }
    qm_reconstruction_destroy(&g.ctx, r);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(vertices_in_the_wrong_order_are_laid_anew),
        cmocka_unit_test(vertices_stay_among_their_neighbours),
        cmocka_unit_test(ridges_stay),
        cmocka_unit_test(noise_does_not_keep_quads_upside_down),
        cmocka_unit_test(curves_over_few_points_do_not_turn_back),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
