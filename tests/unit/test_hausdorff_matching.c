/* The bounds of chapter 5, matching, against the bounds by cells, the slow twin, and values that are
 * known. */
#include "check.h"

#include "base/host.h"
#include "qm/hausdorff.h"
#include "random.h"
#include "shapes.h"
#include "slow_twin.h"

#include <math.h>

static qm_hausdorff_options options_of(qm_bounds bounds, qm_quad_reading reading, double tolerance)
{
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.bounds = bounds;
    options.quads = reading;
    options.tolerance = tolerance;
    options.work_limit = 200000; /* far more than any of these needs: a failure rather than a hang */
    return options;
}

static qm_hausdorff_result measure(const qm_mesh *a, const qm_mesh *b, const qm_hausdorff_options *options)
{
    qm_context ctx = qm_context_make();
    if (options->thread_count > 1) ctx.parallel = qm_host_parallel;
    qm_bvh *tree_a, *tree_b;
    qm_hausdorff_result result;
    assert_int_equal(qm_bvh_build(&ctx, a, QM_BVH_ALL, 1, &tree_a), QM_OK);
    assert_int_equal(qm_bvh_build(&ctx, b, QM_BVH_ALL, 1, &tree_b), QM_OK);
    assert_int_equal(qm_hausdorff_measure(&ctx, tree_a, tree_b, options, &result), QM_OK);
    qm_bvh_destroy(&ctx, tree_a);
    qm_bvh_destroy(&ctx, tree_b);
    return result;
}

/** A pair of small soups of any kind; half of the second ones are shaken copies of the first. */
typedef struct soup_pair {
    qm_mesh a, b;
    double size;
    qm_quad_reading reading;
    qm_direction direction;
} soup_pair;

static soup_pair draw_pair(uint64_t seed)
{
    qm_random random = qm_random_make(qm_check_seed(), seed);
    qm_mesh mesh[2];
    for (int i = 0; i < 2; i++) {
        qm_soup_style style = (qm_soup_style)qm_random_below(&random, QM_SOUP_STYLE_COUNT);
        double twist = (double[]){0, 0.1, 0.5, 2}[qm_random_below(&random, 4)];
        mesh[i] = qm_shape_soup(&random, 1 + qm_random_below(&random, 8),
                                (qm_soup_corners)qm_random_below(&random, 3), style, twist);
    }
    soup_pair pair = {.a = mesh[0], .b = mesh[1]};
    if (seed % 2) {
        qm_shape_free(&pair.b);
        pair.b = qm_shape_copy(&pair.a);
        qm_shape_shake(&pair.b, &random, (double[]){0, 1e-9, 1e-3, 0.1}[qm_random_below(&random, 4)]);
    }
    for (size_t i = 0; i < 3 * pair.a.vertex_count; i++)
        pair.size = fmax(pair.size, fabs(pair.a.positions[i]));
    for (size_t i = 0; i < 3 * pair.b.vertex_count; i++)
        pair.size = fmax(pair.size, fabs(pair.b.positions[i]));
    pair.direction = (qm_direction)qm_random_below(&random, 3);
    pair.reading = (qm_quad_reading)qm_random_below(&random, 2);
    return pair;
}

static void check_overlap(const char *name, uint64_t seed, const qm_hausdorff_result *matching, double lower,
                          double upper, double slack)
{
    QM_CHECK(matching->lower <= matching->upper && matching->lower <= upper + slack &&
                 matching->upper >= lower - slack,
             "%s, seed %llu: matching [%.17g, %.17g], should hold a value of [%.17g, %.17g]", name,
             (unsigned long long)seed, matching->lower, matching->upper, lower, upper);
}

static void brackets_hold_the_slow_twins_value(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 20000 : 500, converged = 0, measured = 0;
    for (uint64_t seed = 0; seed < count; seed++) {
        soup_pair pair = draw_pair(seed);
        double tolerance = pair.size * (seed % 3 ? 1e-3 : 1e-6), slack = 1e-12 * pair.size;
        bool is_slow = pair.reading == QM_QUADS_BILINEAR;
        /* The slow twin takes a tenth of a second for patches: the short run measures fewer of them. */
        if (!is_slow || seed % 8 == 0 || qm_check_long()) {
            qm_hausdorff_options options = options_of(QM_BOUNDS_MATCHING, pair.reading, tolerance);
            options.direction = pair.direction;
            options.work_limit = is_slow ? 2000 : 20000;
            qm_hausdorff_result matching = measure(&pair.a, &pair.b, &options);
            options.bounds = QM_BOUNDS_COVER;
            qm_hausdorff_result cells = measure(&pair.a, &pair.b, &options);
            qm_slow_bracket slow = qm_slow_hausdorff(&pair.a, &pair.b, pair.direction, pair.reading,
                                                     0.1 * tolerance, is_slow ? 2000 : 20000);
            check_overlap("cells", seed, &matching, cells.lower, cells.upper, slack);
            check_overlap("slow twin", seed, &matching, slow.lower, slow.upper, slack);
            measured++;
            converged += matching.stop == QM_STOP_CONVERGED;
        }
        qm_shape_free(&pair.a);
        qm_shape_free(&pair.b);
    }
    QM_CHECK(converged > measured * 3 / 4, "only %llu of %llu converged", (unsigned long long)converged,
             (unsigned long long)measured);
}

/** Both bounds hold the value, in every direction and on one thread and two; matching converges. */
static void check_value(const char *name, const qm_mesh *a, const qm_mesh *b, qm_quad_reading reading,
                        double tolerance, double expected)
{
    for (int threads = 1; threads <= 2; threads++) {
        qm_hausdorff_options options = options_of(QM_BOUNDS_MATCHING, reading, tolerance);
        options.thread_count = threads;
        qm_hausdorff_result r = measure(a, b, &options);
        double slack = 1e-15 * (1 + expected);
        QM_CHECK(r.lower <= expected + slack && r.upper >= expected - slack,
                 "%s, reading %d, %d threads: [%.17g, %.17g], expected %.17g", name, (int)reading, threads,
                 r.lower, r.upper, expected);
        QM_CHECK(r.stop == QM_STOP_CONVERGED && r.upper - r.lower <= tolerance,
                 "%s, reading %d, %d threads: stop %d, width %g after %llu", name, (int)reading, threads,
                 (int)r.stop, r.upper - r.lower, (unsigned long long)r.iterations);
    }
}

static void offset_planes_are_as_far_apart_as_they_lie(void **state)
{
    (void)state;
    qm_mesh low = qm_shape_plane(5, 0), high = qm_shape_plane(7, 0.25), one = qm_shape_plane(1, 0.25);
    for (int reading = 0; reading < 2; reading++) {
        check_value("planes", &low, &high, (qm_quad_reading)reading, 1e-9, 0.25);
        check_value("plane of one quad", &low, &one, (qm_quad_reading)reading, 1e-9, 0.25);
    }
    qm_shape_free(&low);
    qm_shape_free(&high);
    qm_shape_free(&one);
}

/** Bilinear quads on one saddle: the same surface however it is cut, and each match follows the
 * parameters. */
static void nested_saddles_are_one_surface(void **state)
{
    (void)state;
    qm_mesh one = qm_shape_saddle(1), four = qm_shape_saddle(4), eight = qm_shape_saddle(8);
    check_value("saddles of 1 and 4", &one, &four, QM_QUADS_BILINEAR, 1e-6, 0);
    check_value("saddles of 4 and 8", &four, &eight, QM_QUADS_BILINEAR, 1e-6, 0);
    qm_shape_free(&one);
    qm_shape_free(&four);
    qm_shape_free(&eight);
}

static void translated_twisted_quads_are_their_shift_apart(void **state)
{
    (void)state;
    qm_mesh saddle = qm_shape_saddle(4), moved = qm_shape_copy(&saddle);
    const double shift[3] = {0, 0, 1e-3};
    qm_shape_move(&moved, 1, shift);
    qm_hausdorff_options options = options_of(QM_BOUNDS_MATCHING, QM_QUADS_BILINEAR, 1e-8);
    qm_hausdorff_result matching = measure(&saddle, &moved, &options);
    options.bounds = QM_BOUNDS_COVER;
    qm_hausdorff_result cells = measure(&saddle, &moved, &options);
    check_overlap("shifted saddle", 0, &matching, cells.lower, cells.upper, 1e-15);
    assert_true(matching.upper <= 1e-3 + 1e-8);
    qm_shape_free(&saddle);
    qm_shape_free(&moved);
}

/** Latitudes and longitudes of pi / 50, one turned by half a step: h = 1 - cos(pi / 100). */
static void spheres_of_the_source_have_their_distance(void **state)
{
    (void)state;
    const double half_step = acos(-1.0) / 100;
    qm_mesh a = qm_shape_sphere(0), b = qm_shape_sphere(half_step);
    check_value("spheres", &a, &b, QM_QUADS_TRIANGLES, 3.4618e-6, 1 - cos(half_step));
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void identical_meshes_end(void **state)
{
    (void)state;
    qm_mesh torus = qm_shape_torus(40, 20, 1, 0.4), triangles = qm_shape_triangulated(&torus);
    qm_mesh same = qm_shape_reversed(&torus);
    check_value("torus", &torus, &same, QM_QUADS_TRIANGLES, 1e-9, 0);
    check_value("torus", &torus, &same, QM_QUADS_BILINEAR, 1e-9, 0);
    check_value("torus of triangles", &torus, &triangles, QM_QUADS_TRIANGLES, 1e-9, 0);
    qm_shape_free(&torus);
    qm_shape_free(&same);
    qm_shape_free(&triangles);
}

/** Stopped early, the bracket is wide but valid. */
static void a_work_limit_leaves_a_valid_bracket(void **state)
{
    (void)state;
    const double half_step = acos(-1.0) / 100;
    qm_mesh a = qm_shape_sphere(0), b = qm_shape_sphere(half_step);
    double last = INFINITY;
    for (uint64_t limit = 100; limit < 30000; limit *= 4) {
        qm_hausdorff_options options = options_of(QM_BOUNDS_MATCHING, QM_QUADS_TRIANGLES, 1e-9);
        options.work_limit = limit;
        qm_hausdorff_result r = measure(&a, &b, &options);
        check_overlap("limited", limit, &r, 1 - cos(half_step), 1 - cos(half_step), 1e-15);
        assert_int_equal(r.stop, QM_STOP_DEADLINE);
        assert_true(r.upper <= last);
        last = r.upper;
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void points_are_measured_to_their_nearest(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 0);
    qm_mesh points = qm_shape_points(&random, 200), others = qm_shape_points(&random, 300);
    for (int direction = 0; direction < 3; direction++) {
        qm_hausdorff_options options = options_of(QM_BOUNDS_MATCHING, QM_QUADS_TRIANGLES, 1e-9);
        options.direction = (qm_direction)direction;
        qm_hausdorff_result r = measure(&points, &others, &options);
        qm_slow_bracket slow =
            qm_slow_hausdorff(&points, &others, (qm_direction)direction, QM_QUADS_TRIANGLES, 1e-10, 100000);
        check_overlap("points", (uint64_t)direction, &r, slow.lower, slow.upper, 1e-15);
        assert_int_equal(r.stop, QM_STOP_CONVERGED);
    }
    qm_shape_free(&points);
    qm_shape_free(&others);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(brackets_hold_the_slow_twins_value),
        cmocka_unit_test(offset_planes_are_as_far_apart_as_they_lie),
        cmocka_unit_test(nested_saddles_are_one_surface),
        cmocka_unit_test(translated_twisted_quads_are_their_shift_apart),
        cmocka_unit_test(spheres_of_the_source_have_their_distance),
        cmocka_unit_test(identical_meshes_end),
        cmocka_unit_test(a_work_limit_leaves_a_valid_bracket),
        cmocka_unit_test(points_are_measured_to_their_nearest),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
