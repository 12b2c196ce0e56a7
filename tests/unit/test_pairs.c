/*
 * Real pairs of meshes, read from a data folder where there is one (QM_TEST_DATA, or ../shared/data): no
 * point of a dense sampling may lie above the upper bound, and the witness proves the lower one.
 */
#include "check.h"

#include "data_mesh.h"
#include "near_grid.h"
#include "qm/hausdorff.h"
#include "random.h"
#include "shapes.h"

#include <math.h>
#include <stdio.h>

#define SAMPLES 1000000

static const char *const pairs[][2] = {
    {"pairs/spot/tri.obj", "pairs/spot/quad_coarse.obj"},
    {"pairs/cow/tri.obj", "pairs/cow/quad_qf.obj"},
    {"pairs/fandisk/tri.obj", "pairs/fandisk/quad_bommes.off"},
};

enum { PAIR_COUNT = sizeof pairs / sizeof *pairs };

static double samples[3 * SAMPLES];

static void check_samples(const char *name, const qm_mesh *from, const qm_mesh *to, qm_quad_reading reading,
                          const qm_hausdorff_result *r)
{
    qm_box box = qm_mesh_bounding_box(to);
    double slack = 1e-12 * qm_mesh_box_diagonal(&box);
    qm_near_grid grid = qm_near_grid_make(to, reading, r->upper + slack);
    qm_random random = qm_random_make(qm_check_seed(), 0);
    size_t count = qm_check_long() ? SAMPLES : SAMPLES / 4;
    qm_slow_sample(from, reading, &random, count, samples);
    for (size_t i = 0; i < count; ++i)
        QM_CHECK(qm_near_grid_within(&grid, samples + 3 * i), "%s: sample %zu is beyond %.17g", name, i,
                 r->upper);
    for (size_t i = 0; i < 4 * from->face_count; ++i)
        if (from->faces[i] != QM_NO_INDEX)
            QM_CHECK(qm_near_grid_within(&grid, from->positions + 3 * (size_t)from->faces[i]),
                     "%s: vertex %u is beyond %.17g", name, from->faces[i], r->upper);
    qm_near_grid_free(&grid);

    qm_slow_bracket d = qm_slow_distance(to, reading, r->from.position, slack);
    QM_CHECK(d.upper >= r->lower - slack, "%s: lower %.17g, the witness is %.17g away", name, r->lower,
             d.upper);
    qm_slow_bracket on = qm_slow_distance(from, reading, r->from.position, slack);
    QM_CHECK(on.lower <= slack, "%s: the witness is %g off its surface", name, on.lower);
}

static void check_pair(size_t index, qm_quad_reading reading)
{
    qm_context ctx = qm_context_make();
    qm_mesh mesh[2] = {{0}};
    for (int i = 0; i < 2; ++i)
        qm_data_mesh_read(&ctx, pairs[index][i], &mesh[i]);
    qm_bvh *tree[2];
    for (int i = 0; i < 2; ++i)
        assert_int_equal(qm_bvh_build(&ctx, &mesh[i], QM_BVH_ALL, 1, &tree[i]), QM_OK);
    qm_box box = qm_mesh_bounding_box(&mesh[0]);
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.quads = reading;
    options.tolerance = 1e-6 * qm_mesh_box_diagonal(&box);
    for (int side = 0; side < 2; ++side) {
        options.direction = QM_A_TO_B;
        qm_hausdorff_result r;
        assert_int_equal(qm_hausdorff_measure(&ctx, tree[side], tree[1 - side], &options, &r), QM_OK);
        assert_int_equal(r.stop, QM_STOP_CONVERGED);
        assert_true(r.upper - r.lower <= options.tolerance);
        check_samples(pairs[index][side], &mesh[side], &mesh[1 - side], reading, &r);
    }
    for (int i = 0; i < 2; ++i) {
        qm_bvh_destroy(&ctx, tree[i]);
        qm_mesh_reset(&ctx, &mesh[i]);
    }
}

static void no_sample_lies_above_upper_in_the_triangle_reading(void **state)
{
    (void)state;
    for (size_t i = 0; i < PAIR_COUNT; ++i)
        check_pair(i, QM_QUADS_TRIANGLES);
}

static void no_sample_lies_above_upper_in_the_bilinear_reading(void **state)
{
    (void)state;
    for (size_t i = 0; i < PAIR_COUNT; ++i)
        check_pair(i, QM_QUADS_BILINEAR);
}

/** A grid that is queried with less than the true distance must say no. */
static void the_grid_tells_near_from_far(void **state)
{
    (void)state;
    qm_mesh torus = qm_shape_torus(30, 20, 1, 0.4);
    for (uint64_t seed = 0; seed < 200; ++seed) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        qm_quad_reading reading = (qm_quad_reading)(seed % 2);
        double p[3];
        qm_random_point(&random, -1.5, 1.5, p);
        qm_slow_bracket d = qm_slow_distance(&torus, reading, p, 1e-12);
        qm_near_grid more = qm_near_grid_make(&torus, reading, d.upper * (1 + 1e-6));
        qm_near_grid less = qm_near_grid_make(&torus, reading, d.lower * (1 - 1e-6));
        QM_CHECK(qm_near_grid_within(&more, p), "seed %llu", (unsigned long long)seed);
        QM_CHECK(!qm_near_grid_within(&less, p), "seed %llu", (unsigned long long)seed);
        qm_near_grid_free(&more);
        qm_near_grid_free(&less);
    }
    qm_shape_free(&torus);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_grid_tells_near_from_far),
    };
    const struct CMUnitTest data_tests[] = {
        cmocka_unit_test(no_sample_lies_above_upper_in_the_triangle_reading),
        cmocka_unit_test(no_sample_lies_above_upper_in_the_bilinear_reading),
    };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    return failed + qm_data_run_group_tests(data_tests);
}
