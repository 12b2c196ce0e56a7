/* The certified reference against the slow twin, which is another way to the same answers, and on paper. */
#include "check.h"

#include "random.h"
#include "shapes.h"
#include "slow_twin.h"
#include "wide_farthest.h"

#include <math.h>

static qm_mesh draw(qm_random *random)
{
    double twist = (double[]){0, 0.1, 1, 4}[qm_random_below(random, 4)];
    return qm_shape_soup(random, 1 + qm_random_below(random, 3), (qm_soup_corners)qm_random_below(random, 3),
                         (qm_soup_style)qm_random_below(random, QM_SOUP_STYLE_COUNT), twist);
}

static void distances_of_points_agree(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < (qm_check_long() ? 20000u : 1000u); seed++) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        qm_mesh mesh = draw(&random);
        qm_quad_reading quads = (qm_quad_reading)(seed % 2);
        qm_wide_frame frame = qm_wide_frame_make(&mesh, NULL);
        qm_wide_surface surface = qm_wide_surface_make(&frame, &mesh, quads);
        double p[3];
        qm_random_point(&random, -1, 1, p);
        qm_wide_distance d = qm_wide_surface_distance(&surface, qm_wide_local(&frame, p), 0x1p-60L);
        qm_slow_bracket slow = qm_slow_distance(&mesh, quads, p, 1e-12);
        double lower = (double)(d.lower / frame.scale), upper = (double)(d.upper / frame.scale);
        QM_CHECK((double)((d.upper - d.lower) / frame.scale) <= 1e-17, "seed %llu: [%.17g, %.17g]",
                 (unsigned long long)seed, lower, upper);
        QM_CHECK(lower <= slow.upper + 1e-15 && upper >= slow.lower - 1e-15,
                 "seed %llu: [%.17g, %.17g], slow twin [%.17g, %.17g]", (unsigned long long)seed, lower,
                 upper, slow.lower, slow.upper);
        qm_wide_surface_free(&surface);
        qm_shape_free(&mesh);
    }
}

/* The distance to a patch has several minima; from a ruling that is nearer than the best, one stride down crossed a
 * minimum and a maximum. */
static void points_of_patches_are_found(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < (qm_check_long() ? 200000u : 10000u); seed++) {
        qm_random random = qm_random_make(qm_check_seed(), 200000 + seed);
        double corner[4][3], p[3], u = qm_random_range(&random, 0, 1), v = qm_random_range(&random, 0, 1);
        for (int i = 0; i < 4; i++)
            qm_random_point(&random, -1, 1, corner[i]);
        for (int k = 0; k < 3; k++)
            p[k] = (1 - v) * ((1 - u) * corner[0][k] + u * corner[1][k]) +
                   v * ((1 - u) * corner[3][k] + u * corner[2][k]);
        qm_mesh mesh = qm_shape_face(4, (const double(*)[3])corner);
        qm_wide_frame frame = qm_wide_frame_make(&mesh, NULL);
        qm_wide_surface surface = qm_wide_surface_make(&frame, &mesh, QM_QUADS_BILINEAR);
        qm_wide_distance d = qm_wide_surface_distance(&surface, qm_wide_local(&frame, p), 0x1p-60L);
        QM_CHECK((double)(d.upper / frame.scale) <= 1e-15, "seed %llu: %g", (unsigned long long)seed,
                 (double)(d.upper / frame.scale));
        qm_wide_surface_free(&surface);
        qm_shape_free(&mesh);
    }
}

static void distances_of_surfaces_agree(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 2000 : 200, narrow = 0;
    for (uint64_t seed = 0; seed < count; seed++) {
        qm_random random = qm_random_make(qm_check_seed(), 100000 + seed);
        qm_mesh a = draw(&random), b = qm_shape_copy(&a);
        qm_shape_shake(&b, &random, (double[]){0.1, 1e-3, 1e-6}[seed % 3]);
        qm_quad_reading quads = (qm_quad_reading)(seed / 3 % 2);
        qm_wide_frame frame = qm_wide_frame_make(&a, &b);
        qm_wide_surface from = qm_wide_surface_make(&frame, &a, quads),
                        to = qm_wide_surface_make(&frame, &b, quads);
        qm_wide_maximum m = qm_wide_farthest(&from, &to, 0x1p-54L, 1000);
        qm_slow_bracket slow = qm_slow_hausdorff(&a, &b, QM_A_TO_B, quads, 1e-9, 60);
        double lower = (double)(m.lower / frame.scale), upper = (double)(m.upper / frame.scale);
        QM_CHECK(lower <= slow.upper + 1e-15 && upper >= slow.lower - 1e-15,
                 "seed %llu: [%.17g, %.17g], slow twin [%.17g, %.17g]", (unsigned long long)seed, lower,
                 upper, slow.lower, slow.upper);
        narrow += upper - lower <= 1e-15;
        qm_wide_surface_free(&from);
        qm_wide_surface_free(&to);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
    print_message("within 1e-15 on %llu of %llu\n", (unsigned long long)narrow, (unsigned long long)count);
    assert_true(narrow * 10 >= count * 9);
}

/** Half of the circle through the corners of a right triangle, seen from its longest side; a raised
 * saddle. */
static void values_on_paper(void **state)
{
    (void)state;
    qm_mesh face = qm_shape_face(3, (const double[][3]){{0, 0, 0}, {4, 0, 0}, {0, 3, 0}}),
            corners = qm_shape_make(3, 0);
    for (int i = 0; i < 9; i++)
        corners.positions[i] = face.positions[i];
    qm_wide_frame frame = qm_wide_frame_make(&face, &corners);
    qm_wide_surface a = qm_wide_surface_make(&frame, &face, QM_QUADS_TRIANGLES);
    qm_wide_surface b = qm_wide_surface_make(&frame, &corners, QM_QUADS_TRIANGLES);
    qm_wide_maximum m = qm_wide_farthest(&a, &b, 0x1p-54L, 5000);
    double lower = (double)(m.lower / frame.scale), upper = (double)(m.upper / frame.scale);
    QM_CHECK(lower <= 2.5 && upper >= 2.5 && upper - lower <= 1e-14, "[%.17g, %.17g]", lower, upper);
    qm_wide_surface_free(&a);
    qm_wide_surface_free(&b);
    qm_shape_free(&face);
    qm_shape_free(&corners);

    /* Above the middle of z = x y, the nearest point of it is the middle up to a height of 1. */
    qm_mesh saddle = qm_shape_saddle(1);
    frame = qm_wide_frame_make(&saddle, NULL);
    a = qm_wide_surface_make(&frame, &saddle, QM_QUADS_BILINEAR);
    qm_wide_distance d =
        qm_wide_surface_distance(&a, qm_wide_local(&frame, (double[]){0, 0, 0.75}), 0x1p-80L);
    lower = (double)(d.lower / frame.scale);
    upper = (double)(d.upper / frame.scale);
    QM_CHECK(lower <= 0.75 && upper >= 0.75 && upper - lower <= 1e-17, "[%.17g, %.17g]", lower, upper);
    qm_wide_surface_free(&a);
    qm_shape_free(&saddle);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(distances_of_points_agree),
        cmocka_unit_test(points_of_patches_are_found),
        cmocka_unit_test(distances_of_surfaces_agree),
        cmocka_unit_test(values_on_paper),
    };
    print_message("seed %llu\n", (unsigned long long)qm_check_seed());
    return cmocka_run_group_tests(tests, NULL, NULL);
}
