/*
 * Heat maps: at random points of the triangles the distance by the slow twin is within the error of what is interpolated, and the
 * triangles cover the surface.
 */
#include <math.h>
#include <string.h>

#include "base/host.h"
#include "check.h"
#include "failing_allocator.h"
#include "measured.h"
#include "qm/heatmap.h"
#include "shapes.h"
#include "slow_twin.h"

static qm_status make_in(qm_context *ctx, const qm_mesh *a, const qm_mesh *b,
                         const qm_heatmap_options *options, qm_heatmap *out)
{
    qm_bvh *tree[2];
    memset(out, 0, sizeof *out);
    qm_status status = qm_measured_trees(ctx, a, b, tree);
    if (status == QM_OK) status = qm_heatmap_make(ctx, tree[0], tree[1], options, out);
    qm_measured_trees_free(ctx, tree);
    return status;
}

static double area_of(const double *row)
{
    double e[2][3], n[3];
    for (int k = 0; k < 3; k++) {
        e[0][k] = row[4 + k] - row[k];
        e[1][k] = row[8 + k] - row[k];
    }
    for (int k = 0; k < 3; k++)
        n[k] = e[0][(k + 1) % 3] * e[1][(k + 2) % 3] - e[0][(k + 2) % 3] * e[1][(k + 1) % 3];
    return 0.5 * sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
}

/** Of flat triangles: between the corners of a piece of a patch the patch is elsewhere. */
static void check_points(const qm_heatmap *map, const qm_mesh *b, qm_quad_reading reading, qm_random *random,
                         int run)
{
    for (int i = 0; i < 200; i++) {
        const double *row = map->row + QM_HEATMAP_COLUMNS * qm_random_below(random, map->count);
        double u = qm_random_range(random, 0, 1), v = qm_random_range(random, 0, 1);
        if (i % 4 == 0) u = v = 0.0;
        if (u + v > 1.0) {
            u = 1.0 - u;
            v = 1.0 - v;
        }
        const double weight[3] = {1.0 - u - v, u, v};
        double p[3] = {0, 0, 0}, told = 0.0;
        for (int k = 0; k < 3; k++) {
            told += weight[k] * row[4 * k + 3];
            for (int axis = 0; axis < 3; axis++)
                p[axis] += weight[k] * row[4 * k + axis];
        }
        qm_slow_bracket far = qm_slow_distance(b, reading, p, 1e-10);
        QM_CHECK(far.upper >= told - row[QM_HEATMAP_ERROR] - 1e-12 &&
                     far.lower <= told + row[QM_HEATMAP_ERROR] + 1e-12,
                 "run %d, seed %llu: %.12g is not within %g of %.12g", run,
                 (unsigned long long)qm_check_seed(), far.lower, row[QM_HEATMAP_ERROR], told);
        QM_CHECK(row[QM_HEATMAP_ERROR] <= map->error && row[3] >= 0.0, "run %d", run);
    }
}

static void interpolated_distances_are_right_to_the_error(void **state)
{
    (void)state;
    int runs = qm_check_long() ? 200 : 24, accurate = 0;
    for (int run = 0; run < runs; run++) {
        qm_random random = qm_random_make(qm_check_seed(), (uint64_t)run);
        qm_quad_reading reading = (qm_quad_reading)(run % 2);
        qm_mesh a = qm_shape_soup(&random, 3, QM_SOUP_TRIANGLES, QM_SOUP_APART, 0.0);
        qm_mesh b = qm_shape_soup(&random, 8, QM_SOUP_MIXED, (qm_soup_style)(run / 2 % 3), 0.3);
        qm_heatmap_options options = {reading, run % 3 ? 0.01 : 0.1, 1 << 14, 1};
        qm_context ctx = qm_context_make();
        qm_heatmap map;
        assert_int_equal(make_in(&ctx, &a, &b, &options, &map), QM_OK);
        QM_CHECK(map.is_accurate == (map.error <= options.error), "run %d: %g", run, map.error);
        accurate += map.is_accurate;
        check_points(&map, &b, reading, &random, run);
        double area = 0.0, truth = 0.0;
        for (size_t i = 0; i < map.count; i++)
            area += area_of(map.row + QM_HEATMAP_COLUMNS * i);
        for (size_t f = 0; f < a.face_count; f++) {
            double row[12];
            for (int k = 0; k < 3; k++)
                memcpy(row + 4 * k, a.positions + 3 * (size_t)a.faces[4 * f + (size_t)k], 3 * sizeof *row);
            truth += area_of(row);
        }
        QM_CHECK(fabs(area - truth) < 1e-9 * truth, "run %d: area %g, %g", run, area, truth);
        qm_heatmap_reset(&ctx, &map);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
    QM_CHECK(accurate >= runs * 9 / 10, "%d of %d", accurate, runs);
}

/** Corners of pieces of patches lie on the patch, at the distance that is told. */
static void corners_of_patches_are_right_too(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_torus(12, 8, 1.0, 0.4), b = qm_shape_torus(10, 9, 1.1, 0.4);
    for (int threads = 1; threads <= 2; threads++) {
        qm_heatmap_options options = {QM_QUADS_BILINEAR, 0.005, 1 << 16, threads};
        qm_context ctx = qm_host_context();
        qm_heatmap map;
        assert_int_equal(make_in(&ctx, &a, &b, &options, &map), QM_OK);
        assert_true(map.is_accurate);
        qm_random random = qm_random_make(qm_check_seed(), 77);
        for (int i = 0; i < 60; i++) {
            const double *row = map.row + QM_HEATMAP_COLUMNS * qm_random_below(&random, map.count);
            qm_slow_bracket far = qm_slow_distance(&b, QM_QUADS_BILINEAR, row, 1e-9);
            assert_true(fabs(far.lower - row[3]) <= row[QM_HEATMAP_ERROR] + 1e-8);
            qm_slow_bracket on =
                qm_slow_face_distance(&a, (size_t)row[QM_HEATMAP_FACE], QM_QUADS_BILINEAR, row, 1e-9);
            assert_true(on.lower < 1e-3);
        }
        qm_heatmap_reset(&ctx, &map);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void bad_options_and_points_are_refused(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 5);
    qm_mesh points = qm_shape_points(&random, 9), box = qm_shape_box(1, 1, 1);
    qm_context ctx = qm_context_make();
    qm_heatmap map;
    qm_heatmap_options options = {QM_QUADS_TRIANGLES, 0.1, 100, 1};
    assert_int_equal(make_in(&ctx, &points, &box, &options, &map), QM_E_UNSUPPORTED);
    assert_int_equal(make_in(&ctx, &box, &points, &options, &map), QM_OK);
    assert_true(map.count >= 12);
    qm_heatmap_reset(&ctx, &map);
    options.error = 0.0;
    assert_int_equal(make_in(&ctx, &box, &box, &options, &map), QM_E_ARGUMENT);
    options = (qm_heatmap_options){QM_QUADS_TRIANGLES, 1e-9, 0, 1};
    assert_int_equal(make_in(&ctx, &box, &points, &options, &map), QM_OK);
    assert_false(map.is_accurate);
    qm_heatmap_reset(&ctx, &map);
    options = (qm_heatmap_options){QM_QUADS_TRIANGLES, 0.2, 1000, 1};
    qm_status status = QM_E_NO_MEMORY;
    for (size_t at = 0; status == QM_E_NO_MEMORY; at++) {
        qm_failing_allocator failing = {.fail_at = at};
        qm_context failing_ctx = qm_context_make();
        failing_ctx.allocator = qm_failing_allocator_hook(&failing);
        status = make_in(&failing_ctx, &box, &points, &options, &map);
        if (status == QM_OK) qm_heatmap_reset(&failing_ctx, &map);
        assert_true(status == QM_OK || status == QM_E_NO_MEMORY);
        assert_int_equal(failing.live_blocks, 0);
        assert_false(failing.mismatched);
    }
    qm_shape_free(&points);
    qm_shape_free(&box);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(interpolated_distances_are_right_to_the_error),
        cmocka_unit_test(corners_of_patches_are_right_too),
        cmocka_unit_test(bad_options_and_points_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
