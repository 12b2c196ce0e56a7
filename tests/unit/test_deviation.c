/*
 * Mean, rms, percentiles and histogram of distances: known values, and intervals held against a dense
 * sampling that is itself an interval, as no distance changes faster than the place it is measured at.
 */
#include <math.h>
#include <stdatomic.h>
#include <string.h>

#include "base/host.h"
#include "check.h"
#include "dense_cells.h"
#include "failing_allocator.h"
#include "measured.h"
#include "regridded.h"
#include "shapes.h"
#include "slow_twin.h"

static const double percents[] = {1, 5, 25, 50, 75, 95, 100};
enum { PERCENTS = sizeof percents / sizeof percents[0], BINS = 8 };

static qm_deviation_options options_for(qm_quad_reading quads, double tolerance)
{
    qm_deviation_options options = qm_deviation_options_default();
    options.quads = quads;
    options.tolerance = tolerance;
    options.percentile = percents;
    options.percentile_count = PERCENTS;
    options.bin_count = BINS;
    return options;
}

/* ---- known values ---- */

static qm_mesh make_plane(double low, double high, const double height[4])
{
    const double corners[4][3] = {
        {low, low, height[0]}, {high, low, height[1]}, {high, high, height[2]}, {low, high, height[3]}};
    return qm_shape_face(4, corners);
}

static const double level[4] = {0, 0, 0, 0};

static void parallel_planes_are_as_far_as_they_are(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_plane(5, 0.25), b = make_plane(-3, 4, level);
    for (int reading = 0; reading < 2; reading++) {
        qm_deviation_options options = options_for((qm_quad_reading)reading, 1e-9);
        qm_deviation found = qm_measured_deviation(&a, &b, &options);
        assert_int_equal(found.measure, QM_OVER_AREA);
        assert_true(found.is_accurate);
        qm_measured_holds(found.size, 1.0, 1e-9, "area");
        qm_measured_holds(found.mean, 0.25, 1e-9, "mean");
        qm_measured_holds(found.rms, 0.25, 1e-9, "rms");
        qm_measured_holds(found.max, 0.25, 1e-9, "max");
        for (int i = 0; i < PERCENTS; i++)
            qm_measured_holds(found.percentile[i], 0.25, 1e-8, "percentile");
        assert_int_equal(found.vertex_count, a.vertex_count);
        for (size_t i = 0; i < found.vertex_count; i++)
            assert_true(fabs(found.vertex_distance[i] - 0.25) < 1e-12);
        assert_int_equal(found.bin_count, BINS);
        qm_measured_holds(found.bin[BINS - 1], 1.0, 1e-9, "last bin");
        qm_measured_holds(found.bin[0], 0.0, 1e-9, "first bin");
        qm_measured_deviation_free(&found);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void a_tilted_plane_has_exact_moments(void **state)
{
    (void)state;
    static const double tilted[4] = {1, 1.5, 1.5, 1};
    qm_mesh a = make_plane(0, 1, tilted), b = make_plane(-3, 4, level);
    qm_deviation_options options = options_for(QM_QUADS_TRIANGLES, 1e-9);
    qm_deviation found = qm_measured_deviation(&a, &b, &options);
    qm_measured_holds(found.size, sqrt(1.25), 1e-9, "area");
    qm_measured_holds(found.mean, 1.25, 1e-9, "mean");
    qm_measured_holds(found.rms, sqrt(19.0 / 12.0), 1e-9, "rms");
    for (int i = 0; i < PERCENTS; i++)
        qm_measured_holds(found.percentile[i], 1.0 + 0.005 * percents[i], 1e-8, "percentile");
    assert_true(found.bin_width == found.max.upper / BINS);
    for (int i = 0; i < BINS; i++) {
        double from = fmax(1.0, i * found.bin_width), to = fmin(1.5, (i + 1) * found.bin_width);
        qm_measured_holds(found.bin[i], fmax(0.0, 2.0 * (to - from)), 1e-8, "bin");
    }
    qm_measured_deviation_free(&found);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void a_plane_through_another_is_folded_up(void **state)
{
    (void)state;
    static const double tilted[4] = {-0.5, 0.5, 0.5, -0.5};
    qm_mesh a = make_plane(0, 1, tilted), b = make_plane(-3, 4, level);
    qm_deviation_options options = options_for(QM_QUADS_TRIANGLES, 1e-9);
    qm_deviation found = qm_measured_deviation(&a, &b, &options);
    assert_true(found.is_accurate);
    qm_measured_holds(found.mean, 0.25, 0.0026, "mean");
    qm_measured_holds(found.rms, sqrt(1.0 / 12.0), 0.003, "rms");
    qm_measured_holds(found.percentile[3], 0.25, 0.01, "median");
    qm_measured_deviation_free(&found);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void a_saddle_over_a_plane_is_balanced(void **state)
{
    (void)state;
    /* z = x y over [-1, 1]^2, 3 above the plane: for each point there is one as far below 3 as it is
     * above. */
    qm_mesh a = qm_shape_saddle(1);
    static const double down[3] = {0, 0, 3};
    qm_shape_move(&a, 1.0, down);
    qm_mesh b = make_plane(-9, 9, level);
    for (size_t limit = 0; limit <= 4000; limit = 10 * limit + 4) {
        qm_deviation_options options = options_for(QM_QUADS_BILINEAR, 1e-3);
        options.accuracy = 1e-4;
        options.piece_limit = limit;
        qm_deviation found = qm_measured_deviation(&a, &b, &options);
        double width = limit < 4000 ? 8.0 : 0.01;
        qm_measured_holds(found.mean, 3.0, width, "mean");
        qm_measured_holds(found.percentile[3], 3.0, width, "median");
        qm_measured_holds(found.max, 4.0, 1e-3, "max");
        QM_CHECK(found.rms.lower < 3.02 && found.rms.upper > 3.0, "[%g, %g]", found.rms.lower,
                 found.rms.upper);
        qm_measured_deviation_free(&found);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void far_spheres_are_their_radii_apart(void **state)
{
    (void)state;
    /* The inner one is finer than its distance: its points lie 9 to 9.01 from the outer one. */
    qm_mesh a = qm_shape_sphere(0.0), b = qm_shape_sphere(0.0);
    static const double nowhere[3] = {0, 0, 0};
    qm_shape_move(&b, 10.0, nowhere);
    qm_deviation_options options = options_for(QM_QUADS_TRIANGLES, 1e-3);
    qm_deviation found = qm_measured_deviation(&a, &b, &options);
    assert_true(found.is_accurate);
    QM_CHECK(found.mean.lower <= 9.02 && found.mean.upper >= 8.97, "[%g, %g]", found.mean.lower,
             found.mean.upper);
    QM_CHECK(found.rms.lower >= 0.98 * found.mean.lower && found.rms.upper <= 1.02 * found.mean.upper,
             "[%g, %g]", found.rms.lower, found.rms.upper);
    qm_measured_deviation_free(&found);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void a_mesh_lies_on_itself(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_torus(20, 10, 1.0, 0.3);
    for (int reading = 0; reading < 2; reading++) {
        qm_deviation_options options = options_for((qm_quad_reading)reading, 1e-3);
        options.piece_limit = 20000;
        qm_deviation found = qm_measured_deviation(&a, &a, &options);
        QM_CHECK(found.mean.lower == 0.0 && found.mean.upper < (reading ? 0.05 : 1e-9), "[%g, %g]",
                 found.mean.lower, found.mean.upper);
        for (size_t i = 0; i < found.vertex_count; i++)
            assert_true(found.vertex_distance[i] < 1e-12);
        qm_measured_deviation_free(&found);
    }
    qm_shape_free(&a);
}

static void points_are_counted(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_make(4, 0), b = make_plane(-3, 4, level);
    static const double positions[] = {0, 0, 1, 0, 1, 2, 1, 0, 3, 1, 1, 6};
    memcpy(a.positions, positions, sizeof positions);
    qm_deviation_options options = options_for(QM_QUADS_TRIANGLES, 1e-9);
    qm_deviation found = qm_measured_deviation(&a, &b, &options);
    assert_int_equal(found.measure, QM_OVER_POINTS);
    assert_true(found.size.lower == 4.0 && found.size.upper == 4.0);
    qm_measured_holds(found.mean, 3.0, 1e-10, "mean");
    qm_measured_holds(found.rms, sqrt(12.5), 1e-10, "rms");
    static const double expected[PERCENTS] = {1, 1, 1, 2, 3, 6, 6};
    for (int i = 0; i < PERCENTS; i++)
        qm_measured_holds(found.percentile[i], expected[i], i == 2 || i == 3 || i == 4 ? 6.0 : 1e-8,
                          "percentile");
    qm_measured_deviation_free(&found);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void needles_count_by_their_vertices(void **state)
{
    (void)state;
    static const double corners[3][3] = {{0, 0, 1}, {1, 0, 2}, {2, 0, 3}};
    qm_mesh a = qm_shape_face(3, corners), b = make_plane(-3, 4, level);
    static const double far[3] = {0, 0, 50};
    qm_mesh with_unused = qm_shape_with_unused(&a, 2, far);
    qm_deviation_options options = options_for(QM_QUADS_TRIANGLES, 1e-9);
    qm_deviation found = qm_measured_deviation(&with_unused, &b, &options);
    assert_int_equal(found.measure, QM_OVER_VERTICES);
    assert_true(found.size.lower == 3.0);
    qm_measured_holds(found.mean, 2.0, 1e-10, "mean");
    qm_measured_holds(found.max, 3.0, 1e-9, "max");
    qm_measured_deviation_free(&found);
    qm_shape_free(&with_unused);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** Through the hole of a torus, where it is farther than at its ends. */
static void the_maximum_over_a_needle_is_between_its_corners(void **state)
{
    (void)state;
    static const double corners[3][3] = {{-1, 0, 0}, {1, 0, 0}, {1, 0, 0}};
    qm_mesh a = qm_shape_face(3, corners), b = qm_shape_torus(64, 32, 1.0, 0.3);
    qm_deviation_options options = options_for(QM_QUADS_TRIANGLES, 1e-9);
    qm_deviation found = qm_measured_deviation(&a, &b, &options);
    assert_int_equal(found.measure, QM_OVER_VERTICES);
    assert_true(found.mean.upper < 0.35);
    /* 0.7 but for the chords of the polygons. */
    QM_CHECK(found.max.lower > 0.69 && found.max.upper < 0.71, "max: [%.17g, %.17g]", found.max.lower,
             found.max.upper);
    qm_measured_deviation_free(&found);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/* ---- against dense sampling ---- */

/** Two intervals of one value have something in common; slack is what the areas of the sampling are off
 * by. */
static void check_meet(qm_interval found, double low, double high, double slack, uint64_t seed,
                       const char *name)
{
    QM_CHECK(found.lower <= found.upper && found.lower <= high + slack && found.upper >= low - slack,
             "seed %llu: %s [%.12g, %.12g] against [%.12g, %.12g]", (unsigned long long)seed, name,
             found.lower, found.upper, low, high);
}

static void check_against(const qm_deviation *found, const qm_cell_list *list, double slack, uint64_t seed)
{
    double mean[2] = {0, 0}, square[2] = {0, 0}, greatest = 0.0;
    for (size_t i = 0; i < list->count; i++) {
        const qm_dense_cell *c = &list->cells[i];
        double weight = c->area / list->area;
        mean[0] += weight * c->low;
        mean[1] += weight * c->high;
        square[0] += weight * c->low * c->low;
        square[1] += weight * c->high * c->high;
        greatest = fmax(greatest, c->high);
    }
    check_meet(found->size, list->area, list->area, (slack + 1e-9) * list->area, seed, "area");
    check_meet(found->mean, mean[0], mean[1], slack * greatest, seed, "mean");
    check_meet(found->rms, sqrt(square[0]), sqrt(square[1]), slack * greatest, seed, "rms");
    for (int i = 0; i < PERCENTS; i++) {
        qm_interval p = found->percentile[i];
        QM_CHECK(qm_cells_share(list, 0.0, p.upper, false) >= percents[i] / 100.0 - slack - 1e-9 &&
                     qm_cells_share(list, 0.0, p.lower, true) <= percents[i] / 100.0 + slack + 1e-9,
                 "seed %llu: percentile %g [%.12g, %.12g]", (unsigned long long)seed, percents[i], p.lower,
                 p.upper);
    }
    for (int i = 0; i < BINS; i++) {
        double from = i * found->bin_width, to = from + found->bin_width;
        check_meet(found->bin[i],
                   qm_cells_share(list, from, i + 1 < BINS ? nextafter(to, 0.0) : INFINITY, true),
                   qm_cells_share(list, from, to, false), slack + 1e-9, seed, "bin");
    }
}

static void one_soup(uint64_t seed, uint64_t stream, qm_quad_reading reading)
{
    qm_random random = qm_random_make(seed, stream);
    bool is_bilinear = reading == QM_QUADS_BILINEAR;
    qm_soup_corners corners = is_bilinear ? QM_SOUP_QUADS : (qm_soup_corners)qm_random_below(&random, 3);
    qm_soup_style styles[2] = {(qm_soup_style)qm_random_below(&random, QM_SOUP_STYLE_COUNT),
                               (qm_soup_style)qm_random_below(&random, QM_SOUP_STYLE_COUNT)};
    qm_mesh a =
        qm_shape_soup(&random, 1 + qm_random_below(&random, 3), corners, styles[0], is_bilinear ? 0.5 : 1.0);
    qm_mesh b =
        qm_shape_soup(&random, 1 + qm_random_below(&random, 8), corners, styles[1], is_bilinear ? 0.5 : 1.0);
    qm_deviation_options options = options_for(reading, 1e-3);
    options.piece_limit = 1000 * qm_random_below(&random, 10);
    qm_deviation found = qm_measured_deviation(&a, &b, &options);
    if (found.measure == QM_OVER_AREA) {
        qm_cell_list list = qm_cells_sample(&a, &b, reading, is_bilinear ? 12 : 24);
        check_against(&found, &list, is_bilinear ? 0.05 : 0.0, stream);
        qm_cells_free(&list);
    }
    qm_measured_deviation_free(&found);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void random_soups_agree_with_sampling(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 2000 : 60, seed = qm_check_seed();
    print_message("seed %llu\n", (unsigned long long)seed);
    for (uint64_t i = 0; i < count; i++)
        one_soup(seed, i, QM_QUADS_TRIANGLES);
}

static void random_patches_agree_with_sampling(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 60 : 12, seed = qm_check_seed();
    print_message("seed %llu\n", (unsigned long long)seed);
    for (uint64_t i = 0; i < count; i++)
        one_soup(seed, 1000000 + i, QM_QUADS_BILINEAR);
}

static void more_pieces_only_narrow(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_sphere(0.0), b = qm_shape_sphere(0.0314159);
    qm_interval last = {0.0, INFINITY};
    for (size_t limit = 0; limit <= 40000; limit = 2 * limit + 10000) {
        qm_deviation_options options = options_for(QM_QUADS_TRIANGLES, 1e-3);
        options.piece_limit = limit;
        options.accuracy = 1e-4;
        qm_deviation found = qm_measured_deviation(&a, &b, &options);
        assert_false(found.is_accurate);
        assert_true(found.pieces <= 9600 + limit);
        QM_CHECK(found.mean.lower <= last.upper && found.mean.upper >= last.lower &&
                     found.mean.upper - found.mean.lower < last.upper - last.lower,
                 "[%g, %g]", found.mean.lower, found.mean.upper);
        last = found.mean;
        qm_measured_deviation_free(&found);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/* ---- surfaces that nearly coincide ---- */

/** Measures two tori that differ by a shift, a shake and how finely they are cut, and by dense sampling. */
static void one_near_pair(int columns, int rows, double shift, double shake, qm_quad_reading reading, int n)
{
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 77);
    qm_mesh a = qm_shape_torus(8, 6, 1.0, 0.3), b = qm_shape_torus(columns, rows, 1.0, 0.3);
    const double by[3] = {shift, -2.0 * shift, 0.5 * shift};
    qm_shape_move(&b, 1.0, by);
    qm_shape_shake(&b, &random, shake);
    for (int side = 0; side < 2; side++) {
        const qm_mesh *from = side ? &b : &a, *to = side ? &a : &b;
        qm_deviation_options options = options_for(reading, 1e-6);
        if (reading == QM_QUADS_BILINEAR) options.accuracy = 0.1;
        qm_deviation found = qm_measured_deviation(from, to, &options);
        assert_true(found.is_accurate);
        qm_cell_list list = qm_cells_sample(from, to, reading, n);
        check_against(&found, &list, reading == QM_QUADS_BILINEAR ? 0.05 : 0.0, seed);
        qm_cells_free(&list);
        qm_measured_deviation_free(&found);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void moved_copies_agree_with_sampling(void **state)
{
    (void)state;
    one_near_pair(8, 6, 1e-3, 0.0, QM_QUADS_TRIANGLES, 5);
    one_near_pair(8, 6, 0.0, 1e-3, QM_QUADS_TRIANGLES, 5);
    one_near_pair(8, 6, 1e-2, 1e-3, QM_QUADS_BILINEAR, 3);
}

static void finer_copies_agree_with_sampling(void **state)
{
    (void)state;
    one_near_pair(16, 12, 0.0, 0.0, QM_QUADS_TRIANGLES, 3);
    one_near_pair(13, 7, 1e-3, 1e-3, QM_QUADS_TRIANGLES, 3);
}

/** The mean of surfaces that nearly coincide closes long before their distribution, which is not left
 * behind. */
static void percentiles_of_noisy_copies_are_narrow(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 79);
    qm_mesh a = qm_shape_torus(24, 12, 1.0, 0.3), b = qm_shape_copy(&a);
    qm_shape_shake(&b, &random, 1e-4);
    qm_deviation_options options = options_for(QM_QUADS_TRIANGLES, 1e-6);
    options.accuracy = 1e-3;
    qm_deviation found = qm_measured_deviation(&a, &b, &options);
    assert_true(found.is_accurate);
    QM_CHECK(found.pieces < 20000, "%zu pieces of 576 triangles", found.pieces);
    for (int i = 2; i < PERCENTS - 1; i++)
        QM_CHECK(found.percentile[i].upper - found.percentile[i].lower < 0.03 * found.mean.lower,
                 "seed %llu, %g %%: [%g, %g]", (unsigned long long)qm_check_seed(), percents[i],
                 found.percentile[i].lower, found.percentile[i].upper);
    qm_measured_deviation_free(&found);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** Bent patches and their noisy copies, alone and side by side: few pieces are enough, however small the
 * noise. */
static void noisy_copies_of_bent_patches_close(void **state)
{
    (void)state;
    static const double amplitudes[] = {1e-9, 1e-6, 1e-3};
    for (int k = 0; k < 6; k++) {
        qm_random random = qm_random_make(qm_check_seed(), 83 + (uint64_t)k);
        bool is_torus = k >= 3;
        qm_mesh a = is_torus ? qm_shape_torus(8, 6, 1.0, 0.3)
                             : qm_shape_soup(&random, 1, QM_SOUP_QUADS, QM_SOUP_APART, 0.5);
        qm_mesh b = qm_shape_copy(&a);
        qm_shape_shake(&b, &random, amplitudes[k % 3]);
        qm_deviation_options options = options_for(QM_QUADS_BILINEAR, 1e-2);
        options.accuracy = is_torus ? 1e-2 : 1e-3;
        options.piece_limit = 60000;
        qm_deviation found = qm_measured_deviation(&a, &b, &options);
        QM_CHECK(found.is_accurate, "seed %llu, pair %d: mean [%g, %g], rms [%g, %g], %zu pieces",
                 (unsigned long long)qm_check_seed(), k, found.mean.lower, found.mean.upper, found.rms.lower,
                 found.rms.upper, found.pieces);
        qm_measured_deviation_free(&found);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

/** Mean and root mean square of bilinear quads are accurate to 0.001 within so many pieces. */
static void check_closes(const qm_mesh *a, const qm_mesh *b, size_t piece_limit, const char *what,
                         double value)
{
    qm_deviation_options options = options_for(QM_QUADS_BILINEAR, 1e-2);
    options.accuracy = 1e-3;
    options.piece_limit = piece_limit;
    qm_deviation found = qm_measured_deviation(a, b, &options);
    QM_CHECK(found.is_accurate, "seed %llu, %s %g: mean [%g, %g], rms [%g, %g], %zu pieces",
             (unsigned long long)qm_check_seed(), what, value, found.mean.lower, found.mean.upper,
             found.rms.lower, found.rms.upper, found.pieces);
    qm_measured_deviation_free(&found);
}

/** A cone of trapezoids, and one the other way round upon it: the upper and the lower row lie at an angle. */
static qm_mesh make_trapezoids(uint32_t columns)
{
    static const double radius[3] = {0.2, 1.0, 0.15};
    qm_mesh mesh = qm_shape_make(3 * (size_t)columns, 2 * (size_t)columns);
    for (uint32_t i = 0; i < 3 * columns; i++) {
        double angle = 2.0 * M_PI * (double)(i % columns) / columns;
        double *at = mesh.positions + 3 * (size_t)i;
        at[0] = radius[i / columns] * cos(angle);
        at[1] = radius[i / columns] * sin(angle);
        at[2] = 0.5 * (i / columns);
    }
    for (uint32_t i = 0; i < 2 * columns; i++) {
        uint32_t next = i / columns * columns + (i + 1) % columns;
        const uint32_t corners[4] = {i, next, next + columns, i + columns};
        memcpy(mesh.faces + 4 * (size_t)i, corners, sizeof corners);
    }
    return mesh;
}

/** Plane trapezoids and their noisy copies: lines of parameters bend in the plane, so that pieces lie over both
 * triangles of a quad, whose common edge is no border of the distance. Few pieces are enough, however small the
 * noise. */
static void noisy_copies_of_trapezoids_take_few_pieces(void **state)
{
    (void)state;
    static const double amplitudes[] = {1e-8, 1e-6, 1e-5};
    for (int k = 0; k < 3; k++) {
        qm_random random = qm_random_make(qm_check_seed(), 97 + (uint64_t)k);
        qm_mesh b = make_trapezoids(12), a = qm_shape_copy(&b);
        qm_shape_shake(&a, &random, amplitudes[k]);
        check_closes(&a, &b, 2000, "noise", amplitudes[k]);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

/** Mean height of a patch over the plane z = 0, times its area, by midpoints. */
static double integrate_height(const double corner[4][3], int n, double *area)
{
    double sum = 0.0;
    for (int i = 0; i < n * n; i++) {
        double s = (i % n + 0.5) / n, t = (i / n + 0.5) / n, p[3], along_s[3], along_t[3];
        for (int k = 0; k < 3; k++) {
            double low = (1 - s) * corner[0][k] + s * corner[1][k];
            double high = (1 - s) * corner[3][k] + s * corner[2][k];
            p[k] = (1 - t) * low + t * high;
            along_t[k] = high - low;
            along_s[k] = (1 - t) * (corner[1][k] - corner[0][k]) + t * (corner[2][k] - corner[3][k]);
        }
        double x = along_s[1] * along_t[2] - along_s[2] * along_t[1],
               y = along_s[2] * along_t[0] - along_s[0] * along_t[2],
               z = along_s[0] * along_t[1] - along_s[1] * along_t[0],
               part = sqrt(x * x + y * y + z * z) / (n * n);
        sum += part * fabs(p[2]);
        *area += part;
    }
    return sum;
}

/** A sheet of quads that bend over a flat one: heights of both signs are quadratic, so that few pieces are
 * enough. */
static void bent_patches_over_flat_ones_close(void **state)
{
    (void)state;
    static const double cuts[] = {0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1};
    static const double other_cuts[] = {0, 0.2, 0.4, 0.6, 0.8, 1};
    qm_random random = qm_random_make(qm_check_seed(), 97);
    qm_mesh whole = make_plane(0, 1, level), a = qm_regridded(&whole, 8, cuts, 8, cuts, false);
    qm_mesh b = qm_regridded(&whole, 5, other_cuts, 1, (const double[]){0, 1}, false);
    for (size_t v = 0; v < a.vertex_count; v++)
        a.positions[3 * v + 2] = qm_random_range(&random, -1e-3, 1e-3);
    qm_deviation_options options = options_for(QM_QUADS_BILINEAR, 1e-3);
    options.accuracy = 1e-3;
    options.piece_limit = 6400;
    qm_deviation found = qm_measured_deviation(&a, &b, &options);
    double area = 0.0, sum = 0.0;
    for (size_t f = 0; f < a.face_count; f++) {
        double corner[4][3];
        for (int i = 0; i < 4; i++)
            memcpy(corner[i], a.positions + 3 * (size_t)a.faces[4 * f + (size_t)i], sizeof corner[i]);
        sum += integrate_height(corner, 100, &area);
    }
    QM_CHECK(found.is_accurate && found.mean.lower <= (1 + 1e-4) * sum / area &&
                 found.mean.upper >= (1 - 1e-4) * sum / area,
             "seed %llu: mean [%g, %g] of %g, rms [%g, %g], %zu pieces of 64 quads",
             (unsigned long long)qm_check_seed(), found.mean.lower, found.mean.upper, sum / area,
             found.rms.lower, found.rms.upper, found.pieces);
    qm_measured_deviation_free(&found);
    qm_shape_free(&whole);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** A twisted surface that slides along itself: pieces stick out over the edges of the patches under them by more
 * than they are away, and are cut there, although the facets of a patch are farther from it than that. */
static void turned_copies_of_twisted_patches_close(void **state)
{
    (void)state;
    static const double turns[] = {1e-6, 1e-3};
    for (int k = 0; k < 2; k++) {
        qm_random random = qm_random_make(qm_check_seed(), 97);
        qm_mesh a = qm_shape_torus(16, 10, 1.0, 0.3);
        qm_shape_shake(&a, &random, 1e-3);
        qm_mesh b = qm_shape_copy(&a);
        for (size_t i = 0; i < b.vertex_count; i++) {
            double *at = b.positions + 3 * i, x = at[0];
            at[0] = x * cos(turns[k]) - at[1] * sin(turns[k]);
            at[1] = x * sin(turns[k]) + at[1] * cos(turns[k]);
        }
        check_closes(&a, &b, 20000, "turn", turns[k]);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

static void near_planes_of_other_facets_are_exact(void **state)
{
    (void)state;
    static const double near[4] = {1e-4, 1e-4, 1e-4, 1e-4};
    qm_mesh fine = qm_shape_plane(23, 0.0), coarse = make_plane(0, 1, near);
    for (int side = 0; side < 2; side++) {
        qm_deviation_options options = options_for(QM_QUADS_TRIANGLES, 1e-9);
        options.accuracy = 1e-3;
        qm_deviation found = side ? qm_measured_deviation(&coarse, &fine, &options)
                                  : qm_measured_deviation(&fine, &coarse, &options);
        assert_true(found.is_accurate);
        qm_measured_holds(found.mean, 1e-4, 1.1e-7, "mean");
        qm_measured_holds(found.rms, 1e-4, 1.1e-7, "rms");
        qm_measured_deviation_free(&found);
    }
    qm_shape_free(&fine);
    qm_shape_free(&coarse);
}

/** Seen from below, another facet far above lowers nothing. */
static void a_ceiling_takes_nothing_off(void **state)
{
    (void)state;
    static const double tilted[4] = {-1e-3, 1e-3, 1e-3, -1e-3};
    static const double above[3][3] = {{-3, -3, 0.5}, {6, -3, 0.5}, {-3, 6, 0.5}};
    qm_mesh a = make_plane(0, 1, tilted), floor = make_plane(-1, 2, level), ceiling = qm_shape_face(3, above);
    qm_mesh b = qm_shape_joined(&floor, &ceiling);
    qm_deviation_options options = options_for(QM_QUADS_TRIANGLES, 1e-9);
    options.piece_limit = 0;
    qm_deviation found = qm_measured_deviation(&a, &b, &options);
    qm_measured_holds(found.mean, 5e-4, 1e-9, "mean");
    qm_measured_holds(found.rms, 1e-3 / sqrt(3.0), 1e-9, "rms");
    qm_measured_deviation_free(&found);
    qm_shape_free(&a);
    qm_shape_free(&b);
    qm_shape_free(&floor);
    qm_shape_free(&ceiling);
}

/** A cone of needles, its apex in the middle. */
static qm_mesh make_needles(size_t count)
{
    qm_mesh mesh = qm_shape_make(count + 1, count);
    mesh.positions[2] = 0.3;
    for (size_t i = 0; i < count; i++) {
        double *rim = mesh.positions + 3 * (i + 1), angle = 2.0 * M_PI * (double)i / (double)count;
        rim[0] = cos(angle);
        rim[1] = sin(angle);
        const uint32_t corners[4] = {0, (uint32_t)i + 1, (uint32_t)((i + 1) % count) + 1, QM_NO_INDEX};
        memcpy(mesh.faces + 4 * i, corners, sizeof corners);
    }
    return mesh;
}

/** A box, a cone of needles and a torus, moved by a millionth, close with few pieces: what lies beside a
 * facet is beside one edge of it, a piece has the narrow functions and the narrow integrals of both bounds,
 * and it does not stray where a neighbour in the same plane lowers its height by a rounding. */
static void moved_copies_take_few_pieces(void **state)
{
    (void)state;
    static const double move[3] = {1e-6, 0.7e-6, 0.4e-6};
    for (int shape = 0; shape < 3; shape++) {
        qm_mesh a = shape == 0   ? qm_shape_box(1.0, 1.0, 1.0)
                    : shape == 1 ? make_needles(200)
                                 : qm_shape_torus(32, 24, 1.0, 0.4);
        qm_mesh b = qm_shape_copy(&a);
        for (size_t i = 0; i < 3 * b.vertex_count; i++)
            b.positions[i] += move[i % 3];
        qm_deviation_options options = options_for(QM_QUADS_TRIANGLES, 1e-9);
        options.accuracy = 1e-3;
        options.piece_limit = 1000;
        qm_deviation found = qm_measured_deviation(&a, &b, &options);
        assert_true(found.is_accurate);
        for (int i = 0; i < PERCENTS && percents[i] < 100; i++)
            QM_CHECK(found.percentile[i].upper - found.percentile[i].lower <= 2e-8, "%g %%: [%g, %g]",
                     percents[i], found.percentile[i].lower, found.percentile[i].upper);
        qm_measured_deviation_free(&found);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

/* ---- flat patches ---- */

static void turn(qm_mesh *mesh, double angle)
{
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        double *p = mesh->positions + 3 * v, y = p[1], z = p[2];
        p[1] = cos(angle) * y - sin(angle) * z;
        p[2] = sin(angle) * y + cos(angle) * z;
    }
}

/** Trapezoids, whose parameters are not those of their triangles, against themselves turned and shaken. */
static void flat_patches_close_as_triangles_do(void **state)
{
    (void)state;
    static const double angles[] = {1e-7, 1e-4, 0.1}, shakes[] = {0.0, 0.0, 1e-7, 1e-4};
    qm_mesh a = qm_shape_torus(16, 12, 1.0, 0.4);
    for (size_t i = 0; i < 3 + 2; i++) {
        qm_random random = qm_random_make(qm_check_seed(), i);
        qm_mesh b = qm_shape_copy(&a);
        if (i < 3)
            turn(&b, angles[i]);
        else
            qm_shape_shake(&b, &random, shakes[i - 1]);
        qm_deviation_options options = options_for(QM_QUADS_BILINEAR, 1e-3);
        options.piece_limit = 40000;
        qm_deviation found = qm_measured_deviation(&a, &b, &options);
        QM_CHECK(found.is_accurate, "seed %llu, number %zu: mean [%g, %g]",
                 (unsigned long long)qm_check_seed(), i, found.mean.lower, found.mean.upper);
        qm_measured_deviation_free(&found);
        qm_shape_free(&b);
    }
    qm_shape_free(&a);
}

/** A bent quad near its twin, and far points of little area that make the mean look much greater than it is:
 * triangles stand for the quad at first, and are too far from it. */
static void make_misleading_twins(qm_mesh *quad, qm_mesh *twin)
{
    enum { FAR = 40 };
    static const double bent[4] = {0, 1e-4, 0, 1e-4}, over[4] = {1e-6, 1.01e-4, 1e-6, 1.01e-4};
    qm_mesh a = make_plane(0, 1, bent);
    for (int i = 0; i < FAR; i++) {
        const double low = 0.5, high = 0.5 + 1e-8;
        const double corners[4][3] = {{low, low, 1}, {high, low, 1}, {high, high, 1}, {low, high, 1}};
        qm_mesh small = qm_shape_face(4, corners), both = qm_shape_joined(&a, &small);
        qm_shape_free(&a);
        qm_shape_free(&small);
        a = both;
    }
    *quad = a;
    *twin = make_plane(0, 1, over);
}

/** A patch z = bend x y, a triangle through its chord, which lies above the patch, and a thin source straight
 * over the chord, everywhere at one distance from that triangle, which is nearer than the patch and farther
 * than linear bounds of the height over the patch. */
static void facets_nearer_than_the_ground_patch_count(void **state)
{
    (void)state;
    static const double bends[] = {0.05, 0.2, 0.5}, heights[] = {0.03, 0.1, 0.3}, accuracies[] = {0.2, 0.01};
    for (size_t i = 0; i < 3 * 3 * 2; i++) {
        double c = bends[i % 3], h = heights[i / 3 % 3], truth = h / sqrt(1.0 + 0.5 * c * c);
        const double patch[4][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, c}, {0, 1, 0}};
        const double chord[3][3] = {
            {-0.35, 0.07, -0.23 * c}, {1.54, 1.54, 1.45 * c}, {0.07, -0.35, -0.23 * c}};
        const double over[3][3] = {
            {0.3, 0.3, h + 0.21 * c}, {0.7, 0.7, h + 0.61 * c}, {0.48, 0.52, h + 0.41 * c}};
        qm_mesh quad = qm_shape_face(4, patch), triangle = qm_shape_face(3, chord);
        qm_mesh a = qm_shape_face(3, over), b = qm_shape_joined(&quad, &triangle);
        qm_deviation_options options = options_for(QM_QUADS_BILINEAR, 1e-9);
        options.accuracy = accuracies[i / 9];
        options.piece_limit = 2000;
        qm_deviation found = qm_measured_deviation(&a, &b, &options);
        qm_measured_holds(found.mean, truth, 2.0 * options.accuracy * truth, "mean");
        qm_measured_holds(found.rms, truth, INFINITY, "rms");
        qm_measured_deviation_free(&found);
        qm_shape_free(&quad);
        qm_shape_free(&triangle);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

static void triangles_too_coarse_for_the_mean_are_given_up(void **state)
{
    (void)state;
    qm_mesh a, b;
    make_misleading_twins(&a, &b);
    qm_deviation_options options = options_for(QM_QUADS_BILINEAR, 1e-6);
    options.piece_limit = 20000;
    qm_deviation found = qm_measured_deviation(&a, &b, &options);
    assert_true(found.is_accurate);
    qm_measured_holds(found.mean, 1e-6, 1e-8, "mean");
    qm_measured_deviation_free(&found);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/* ---- folded patches ---- */

/** The area of a patch, by the middles of many cells; the place is where a parameter's derivatives cross. */
static double patch_area(const qm_mesh *mesh, size_t face)
{
    enum { CELLS = 200 };
    double area = 0.0;
    for (int i = 0; i < CELLS * CELLS; i++) {
        double s = (i / CELLS + 0.5) / CELLS, t = (i % CELLS + 0.5) / CELLS, side[4][3], a[3], b[3];
        const double at[4][2] = {{0.0, t}, {1.0, t}, {s, 0.0}, {s, 1.0}};
        for (int k = 0; k < 4; k++)
            qm_slow_position(mesh, face, QM_QUADS_BILINEAR, at[k], side[k]);
        for (int k = 0; k < 3; k++) {
            a[k] = side[1][k] - side[0][k];
            b[k] = side[3][k] - side[2][k];
        }
        double n[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
        area += sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]) / (CELLS * CELLS);
    }
    return area;
}

/** Quads with two corners swapped: bow-ties, whose normals cancel. */
static qm_mesh make_bow_ties(void)
{
    qm_mesh mesh = qm_shape_torus(6, 4, 1.0, 0.3);
    for (size_t f = 0; f < mesh.face_count; f++) {
        uint32_t *corner = mesh.faces + 4 * f, third = corner[2];
        corner[2] = corner[3];
        corner[3] = third;
    }
    return mesh;
}

static void folded_patches_count_by_their_area(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 78);
    qm_mesh a = make_bow_ties(), b = make_bow_ties();
    qm_shape_shake(&b, &random, 1e-5);
    double area = 0.0;
    for (size_t f = 0; f < a.face_count; f++)
        area += patch_area(&a, f);
    for (size_t limit = 0; limit <= 2000; limit += 2000) {
        qm_deviation_options options = options_for(QM_QUADS_BILINEAR, 1e-6);
        options.piece_limit = limit;
        qm_deviation found = qm_measured_deviation(&a, &b, &options);
        assert_int_equal(found.measure, QM_OVER_AREA);
        QM_CHECK(found.size.lower <= area * 1.001 && found.size.upper >= area * 0.999, "[%g, %g] against %g",
                 found.size.lower, found.size.upper, area);
        QM_CHECK(limit == 0 || found.size.lower > 0.7 * found.size.upper, "[%g, %g]", found.size.lower,
                 found.size.upper);
        /* No point has been moved by more. */
        QM_CHECK(found.mean.lower <= 2e-5 && found.rms.lower <= 2e-5 && found.max.lower <= 2e-5, "%g %g %g",
                 found.mean.lower, found.rms.lower, found.max.lower);
        assert_true(found.mean.upper <= found.max.upper && found.rms.upper <= found.max.upper);
        qm_measured_deviation_free(&found);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** What was reported: bounds that only come closer. Those of boxes and pieces are wide; narrower ones are of the search for the
 * maximum, and raise the flag. */
typedef struct reports {
    atomic_bool cancel;
    int count;
    qm_interval last;
} reports;

static void take_report(void *user, const qm_hausdorff_progress *progress)
{
    reports *told = user;
    assert_true(progress->lower >= told->last.lower && progress->upper <= told->last.upper);
    told->last = (qm_interval){progress->lower, progress->upper};
    told->count++;
    if (progress->upper - progress->lower < 1e-3 * progress->upper) atomic_store(&told->cancel, true);
}

static void the_pieces_bound_the_maximum(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_torus(36, 18, 1.0, 0.3), b = qm_shape_torus(30, 15, 1.0, 0.31);
    qm_deviation_options options = options_for(QM_QUADS_BILINEAR, 1e-9);
    options.accuracy = 0.01;
    qm_deviation truth = qm_measured_deviation(&a, &b, &options), found;
    qm_context ctx = qm_context_make();
    reports told = {.last = {0.0, INFINITY}};
    ctx.cancel = &told.cancel;
    options.progress = take_report;
    options.progress_user = &told;
    assert_int_equal(qm_measured_deviation_in(&ctx, &a, &b, &options, &found), QM_OK);
    assert_true(found.is_canceled && found.is_accurate);
    assert_true(told.count >= 3 && told.last.lower <= truth.max.upper && told.last.upper >= truth.max.lower);
    assert_true(found.max.lower >= told.last.lower && found.max.upper <= told.last.upper);
    QM_CHECK(found.max.lower <= truth.max.upper && found.max.upper >= truth.max.lower &&
                 found.max.lower > 0.5 * found.max.upper,
             "[%g, %g] against [%g, %g]", found.max.lower, found.max.upper, truth.max.lower, truth.max.upper);
    qm_measured_deviation_free(&found);
    qm_measured_deviation_free(&truth);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/* ---- the call ---- */

/** The maximum, which caps all bounds, is known to within its tolerance, and lies elsewhere in it with other
 * threads. */
static void check_same(qm_interval found, qm_interval with_one, double tolerance)
{
    assert_true(fabs(found.lower - with_one.lower) <= tolerance);
    assert_true(fabs(found.upper - with_one.upper) <= tolerance);
}

static void threads_change_no_more_than_the_maximum_may(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_torus(24, 12, 1.0, 0.3), b = qm_shape_torus(20, 10, 1.0, 0.31);
    qm_deviation found[3];
    qm_context ctx = qm_context_make();
    ctx.parallel = qm_host_parallel;
    static const int threads[3] = {1, 2, 7};
    for (int i = 0; i < 3; i++) {
        qm_deviation_options options = options_for(QM_QUADS_BILINEAR, 1e-9);
        options.thread_count = threads[i];
        options.piece_limit = 5000;
        assert_int_equal(qm_measured_deviation_in(&ctx, &a, &b, &options, &found[i]), QM_OK);
        check_same(found[i].mean, found[0].mean, options.tolerance);
        check_same(found[i].rms, found[0].rms, options.tolerance);
        check_same(found[i].max, found[0].max, options.tolerance);
        assert_memory_equal(found[i].vertex_distance, found[0].vertex_distance,
                            found[0].vertex_count * sizeof *found[0].vertex_distance);
    }
    for (int i = 0; i < 3; i++)
        qm_measured_deviation_free(&found[i]);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void bad_options_are_refused(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_plane(2, 1.0);
    qm_context ctx = qm_context_make();
    static const double bad[] = {0.0, -1.0, 100.5, NAN};
    qm_deviation found;
    for (int i = 0; i < 4; i++) {
        qm_deviation_options options = options_for(QM_QUADS_TRIANGLES, 1e-3);
        options.percentile = &bad[i];
        options.percentile_count = 1;
        assert_int_equal(qm_measured_deviation_in(&ctx, &a, &a, &options, &found), QM_E_ARGUMENT);
        assert_null(found.vertex_distance);
        if (i == 2) continue;
        options = options_for(QM_QUADS_TRIANGLES, 1e-3);
        options.accuracy = bad[i];
        assert_int_equal(qm_measured_deviation_in(&ctx, &a, &a, &options, &found), QM_E_ARGUMENT);
        options = options_for(QM_QUADS_TRIANGLES, bad[i]);
        assert_int_equal(qm_measured_deviation_in(&ctx, &a, &a, &options, &found), QM_E_ARGUMENT);
    }
    qm_shape_free(&a);
}

/** Raises the cancel flag when the engine asks for the n-th time whether it is to pause. */
typedef struct canceling {
    atomic_bool cancel;
    size_t polls, cancel_at;
} canceling;

static const atomic_bool always = true;

static void cancel_in_time(void *user)
{
    canceling *at = user;
    if (at->polls++ >= at->cancel_at) atomic_store(&at->cancel, true);
}

static bool meet(qm_interval a, qm_interval b)
{
    return a.lower <= a.upper && a.lower <= b.upper && b.lower <= a.upper;
}

/** Cancels a call at its n-th poll: all intervals hold nevertheless. Returns whether it was canceled; adds up
 * how often vertex distances were known, and the mean within a tenth of the maximum. */
static bool cancel_at(const qm_mesh *a, const qm_mesh *b, const qm_deviation_options *options, size_t n,
                      const qm_deviation *truth, int counts[2])
{
    canceling at = {.cancel_at = n};
    qm_context ctx = qm_context_make();
    qm_bvh *of_a = NULL, *of_b = NULL;
    assert_int_equal(qm_bvh_build(&ctx, a, QM_BVH_ALL, 1, &of_a), QM_OK);
    assert_int_equal(qm_bvh_build(&ctx, b, QM_BVH_ALL, 1, &of_b), QM_OK);
    ctx.cancel = &at.cancel;
    ctx.pause = &always;
    ctx.wait = cancel_in_time;
    ctx.wait_user = &at;
    qm_deviation found;
    assert_int_equal(qm_deviation_measure(&ctx, of_a, of_b, options, &found), QM_OK);
    bool was_raised = atomic_load(&at.cancel);
    assert_true(found.is_canceled == was_raised && (was_raised || found.is_accurate));
    bool holds = meet(found.max, truth->max) && meet(found.mean, truth->mean) && meet(found.rms, truth->rms);
    /* Before the area is known, the measure may not be. */
    holds &= found.measure != truth->measure || meet(found.size, truth->size);
    for (size_t i = 0; i < PERCENTS; i++)
        holds &= meet(found.percentile[i], truth->percentile[i]);
    double last = 0.0;
    for (size_t i = 0; i < BINS; i++) {
        holds &= found.bin[i].lower <= found.bin[i].upper;
        last += found.bin[i].upper;
    }
    QM_CHECK(holds && last >= 1.0, "canceled at %zu: mean [%g, %g] and [%g, %g], max [%g, %g] and [%g, %g]",
             n, found.mean.lower, found.mean.upper, truth->mean.lower, truth->mean.upper, found.max.lower,
             found.max.upper, truth->max.lower, truth->max.upper);
    counts[0] += found.vertex_distance != NULL;
    counts[1] += found.mean.upper - found.mean.lower <= 0.1 * truth->max.upper;
    qm_deviation_reset(&ctx, &found);
    qm_bvh_destroy(&ctx, of_a);
    qm_bvh_destroy(&ctx, of_b);
    return was_raised;
}

/** Cancels a call at its first polls, and at later ones that are farther and farther apart. */
static void check_canceled_calls(const qm_mesh *a, const qm_mesh *b, const qm_deviation_options *options)
{
    qm_deviation truth = qm_measured_deviation(a, b, options);
    int counts[2] = {0, 0};
    size_t n = 0, calls = 1;
    for (; cancel_at(a, b, options, n, &truth, counts); n += 1 + n / 50)
        calls++;
    QM_CHECK(counts[0] > 1 && counts[1] > 1 && calls > 2, "%zu calls: %d with vertices, %d narrow", calls,
             counts[0], counts[1]);
    qm_measured_deviation_free(&truth);
}

static void a_canceled_call_tells_what_it_has(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_torus(12, 6, 1.0, 0.3), b = qm_shape_torus(10, 5, 1.0, 0.31);
    qm_deviation_options options = options_for(QM_QUADS_TRIANGLES, 1e-4);
    check_canceled_calls(&a, &b, &options);
    options.quads = QM_QUADS_BILINEAR;
    options.piece_limit = 3000;
    check_canceled_calls(&a, &b, &options);
    /* Points, and a surface without area. */
    qm_mesh points = a;
    points.face_count = 0;
    check_canceled_calls(&points, &b, &options);
    qm_mesh needles = a;
    needles.positions = malloc(3 * a.vertex_count * sizeof *needles.positions);
    assert_non_null(needles.positions);
    for (size_t i = 0; i < 3 * a.vertex_count; i++)
        needles.positions[i] = i % 3 == 0 ? a.positions[i] : 0.0;
    check_canceled_calls(&needles, &b, &options);
    free(needles.positions);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** New pieces have no bounds at first. */
static void a_canceled_restart_tells_what_was_there(void **state)
{
    (void)state;
    qm_mesh a, b;
    make_misleading_twins(&a, &b);
    qm_deviation_options options = options_for(QM_QUADS_BILINEAR, 1e-6);
    options.piece_limit = 20000;
    check_canceled_calls(&a, &b, &options);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_torus(6, 4, 1.0, 0.3), b = qm_shape_torus(5, 4, 1.0, 0.35);
    qm_deviation_options options = options_for(QM_QUADS_TRIANGLES, 1e-2);
    options.piece_limit = 300;
    bool succeeded = false;
    for (size_t fail_at = 0; !succeeded; fail_at++) {
        assert_true(fail_at < 10000);
        qm_failing_allocator failing = {.fail_at = fail_at};
        qm_context ctx = qm_context_make();
        ctx.allocator = qm_failing_allocator_hook(&failing);
        qm_deviation found;
        qm_status status = qm_measured_deviation_in(&ctx, &a, &b, &options, &found);
        succeeded = status == QM_OK;
        assert_true(succeeded || status == QM_E_NO_MEMORY);
        qm_deviation_reset(&ctx, &found);
        QM_CHECK(failing.live_blocks == 0 && !failing.mismatched, "call %zu: %zu blocks", fail_at,
                 failing.live_blocks);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(parallel_planes_are_as_far_as_they_are),
        cmocka_unit_test(a_tilted_plane_has_exact_moments),
        cmocka_unit_test(a_plane_through_another_is_folded_up),
        cmocka_unit_test(a_saddle_over_a_plane_is_balanced),
        cmocka_unit_test(far_spheres_are_their_radii_apart),
        cmocka_unit_test(a_mesh_lies_on_itself),
        cmocka_unit_test(points_are_counted),
        cmocka_unit_test(needles_count_by_their_vertices),
        cmocka_unit_test(the_maximum_over_a_needle_is_between_its_corners),
        cmocka_unit_test(random_soups_agree_with_sampling),
        cmocka_unit_test(random_patches_agree_with_sampling),
        cmocka_unit_test(more_pieces_only_narrow),
        cmocka_unit_test(moved_copies_agree_with_sampling),
        cmocka_unit_test(finer_copies_agree_with_sampling),
        cmocka_unit_test(percentiles_of_noisy_copies_are_narrow),
        cmocka_unit_test(noisy_copies_of_bent_patches_close),
        cmocka_unit_test(noisy_copies_of_trapezoids_take_few_pieces),
        cmocka_unit_test(bent_patches_over_flat_ones_close),
        cmocka_unit_test(turned_copies_of_twisted_patches_close),
        cmocka_unit_test(near_planes_of_other_facets_are_exact),
        cmocka_unit_test(a_ceiling_takes_nothing_off),
        cmocka_unit_test(flat_patches_close_as_triangles_do),
        cmocka_unit_test(triangles_too_coarse_for_the_mean_are_given_up),
        cmocka_unit_test(facets_nearer_than_the_ground_patch_count),
        cmocka_unit_test(moved_copies_take_few_pieces),
        cmocka_unit_test(folded_patches_count_by_their_area),
        cmocka_unit_test(the_pieces_bound_the_maximum),
        cmocka_unit_test(threads_change_no_more_than_the_maximum_may),
        cmocka_unit_test(bad_options_are_refused),
        cmocka_unit_test(a_canceled_call_tells_what_it_has),
        cmocka_unit_test(a_canceled_restart_tells_what_was_there),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
