/* The slow twin itself, held against values known by hand and against plain searches over parameters. */
#include "check.h"

#include "random.h"
#include "shapes.h"
#include "slow_twin.h"

#include <math.h>
#include <string.h>

static double gap(const double a[3], const double b[3])
{
    return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) +
                (a[2] - b[2]) * (a[2] - b[2]));
}

static void triangle_distances_are_those_of_the_drawing(void **state)
{
    (void)state;
    const double a[3] = {0, 0, 0}, b[3] = {4, 0, 0}, c[3] = {0, 3, 0};
    assert_true(qm_slow_triangle_distance((const double[3]){1, 1, 2}, a, b, c) == 2);
    assert_true(qm_slow_triangle_distance((const double[3]){-3, -4, 0}, a, b, c) == 5);
    assert_true(qm_slow_triangle_distance((const double[3]){2, -3, 4}, a, b, c) == 5);
    assert_true(fabs(qm_slow_triangle_distance((const double[3]){4, 3, 0}, a, b, c) - 2.4) < 1e-15);
    assert_true(qm_slow_triangle_distance((const double[3]){2, 5, 0}, a, b, b) == 5);
    assert_true(qm_slow_triangle_distance((const double[3]){3, 4, 0}, a, a, a) == 5);
}

/** The least distance over a lattice of points of a face bounds the true one from above, and nearly meets
 * it. */
static void brackets_of_faces_fit_a_lattice_of_points(void **state)
{
    (void)state;
    enum { LATTICE = 60 };
    int unfinished = 0;
    for (uint64_t seed = 0; seed < 300; ++seed) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        qm_soup_style style = (qm_soup_style)qm_random_below(&random, QM_SOUP_STYLE_COUNT);
        qm_mesh mesh = qm_shape_soup(&random, 1, QM_SOUP_MIXED, style, 2);
        qm_quad_reading reading = seed % 2 ? QM_QUADS_BILINEAR : QM_QUADS_TRIANGLES;
        double p[3], least = INFINITY, step = 4.0 * 3 / LATTICE;
        qm_random_point(&random, -1, 1, p);
        qm_slow_bracket d = qm_slow_face_distance(&mesh, 0, reading, p, 1e-12);
        bool triangle = mesh.faces[3] == QM_NO_INDEX;
        for (int i = 0; i <= LATTICE; ++i)
            for (int j = 0; j <= (triangle ? LATTICE - i : LATTICE); ++j) {
                double at[3], uv[2] = {(double)i / LATTICE, (double)j / LATTICE};
                qm_slow_position(&mesh, 0, reading, uv, at);
                least = fmin(least, gap(p, at));
            }
        unfinished += !d.finished;
        QM_CHECK(d.lower <= least + 1e-15 && d.upper >= least - step,
                 "seed %llu: [%.17g, %.17g], least %.17g", (unsigned long long)seed, d.lower, d.upper, least);
        qm_shape_free(&mesh);
    }
    assert_true(unfinished <= 6);
}

static void hausdorff_brackets_close_on_known_values(void **state)
{
    (void)state;
    qm_mesh low = qm_shape_plane(1, 0), high = qm_shape_plane(1, 0.25);
    qm_mesh box = qm_shape_box(1, 1, 1), moved = qm_shape_box(1, 1, 1);
    qm_shape_move(&moved, 1, (const double[3]){0.5, 0, 0});
    for (int reading = 0; reading < 2; ++reading) {
        qm_slow_bracket d =
            qm_slow_hausdorff(&low, &high, QM_TWO_SIDED, (qm_quad_reading)reading, 1e-9, 1000);
        assert_true(d.lower <= 0.25 && d.upper >= 0.25 && d.upper - d.lower <= 1e-9);
        d = qm_slow_hausdorff(&box, &moved, QM_A_TO_B, (qm_quad_reading)reading, 1e-3, 20000);
        assert_true(d.lower <= 0.5 && d.upper >= 0.5 && d.upper - d.lower <= 0.01);
    }
    qm_shape_free(&low);
    qm_shape_free(&high);
    qm_shape_free(&box);
    qm_shape_free(&moved);
}

/** No sample of the source may lie farther from the target than the upper bound. */
static void samples_stay_below_the_upper_bound(void **state)
{
    (void)state;
    enum { SAMPLES = 50 };
    static double points[3 * SAMPLES];
    for (uint64_t seed = 0; seed < 100; ++seed) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        qm_soup_style style = (qm_soup_style)qm_random_below(&random, QM_SOUP_STYLE_COUNT);
        qm_mesh a = qm_shape_soup(&random, 3, QM_SOUP_MIXED, style, 1);
        qm_mesh b = qm_shape_soup(&random, 3, QM_SOUP_MIXED, style, 1);
        qm_quad_reading reading = seed % 2 ? QM_QUADS_BILINEAR : QM_QUADS_TRIANGLES;
        qm_slow_bracket d = qm_slow_hausdorff(&a, &b, QM_A_TO_B, reading, 1e-6, 500);
        assert_true(d.lower <= d.upper);
        qm_slow_sample(&a, reading, &random, SAMPLES, points);
        for (size_t i = 0; i < SAMPLES; ++i) {
            qm_slow_bracket one = qm_slow_distance(&b, reading, points + 3 * i, 1e-4);
            QM_CHECK(one.lower <= d.upper + 1e-15, "seed %llu: %.17g above %.17g", (unsigned long long)seed,
                     one.lower, d.upper);
        }
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(triangle_distances_are_those_of_the_drawing),
        cmocka_unit_test(brackets_of_faces_fit_a_lattice_of_points),
        cmocka_unit_test(hausdorff_brackets_close_on_known_values),
        cmocka_unit_test(samples_stay_below_the_upper_bound),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
