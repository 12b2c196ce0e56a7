/*
 * Comparisons both ways: exact where they must be, known values at any size and place, and the figures of random meshes
 * against sums over dense cells, which share no code with the engine.
 */
#include <float.h>
#include <math.h>
#include <stdatomic.h>
#include <string.h>

#include "base/host.h"
#include "check.h"
#include "dense_cells.h"
#include "failing_allocator.h"
#include "measured.h"
#include "shapes.h"
#include "slow_twin.h"

static const double percents[] = {5, 50, 95, 100};
enum { PERCENTS = sizeof percents / sizeof percents[0], MAX_LIMITS = 6 };

static qm_comparison_options options_for(qm_quad_reading quads, const double *limit, size_t limit_count)
{
    qm_comparison_options options = qm_deviation_options_default();
    options.quads = quads;
    options.tolerance = 1e-6;
    options.percentile = percents;
    options.percentile_count = PERCENTS;
    options.limit = limit;
    options.limit_count = limit_count;
    return options;
}

static void check_is(qm_interval found, double value, const char *name)
{
    QM_CHECK(found.lower == value && found.upper == value, "%s: [%.17g, %.17g] is not %g", name, found.lower,
             found.upper, value);
}

static void check_holds(qm_interval found, double low, double high, const char *name, uint64_t stream)
{
    QM_CHECK(found.lower <= high && found.upper >= low && found.lower <= found.upper,
             "stream %llu: %s: [%.17g, %.17g] against [%.17g, %.17g]", (unsigned long long)stream, name,
             found.lower, found.upper, low, high);
}

/* ---- exact values ---- */

static void check_same(const qm_mesh *a, const qm_mesh *b, qm_quad_reading reading)
{
    static const double limits[] = {1.0, 0.0, 1e-300};
    qm_comparison_options options = options_for(reading, limits, 3);
    options.worst_count = 3;
    options.piece_limit = 5000;
    qm_comparison found = qm_measured_comparison(a, b, &options);
    const qm_interval zeros[] = {found.hausdorff,  found.hd95,       found.mean,      found.rms,
                                 found.chamfer_l1, found.chamfer_l2, found.spread[0], found.spread[1]};
    for (size_t i = 0; i < sizeof zeros / sizeof *zeros; i++)
        check_is(zeros[i], 0.0, "a figure of a mesh against itself");
    for (size_t i = 0; i < 3; i++) {
        check_is(found.f_score[i].f, 1.0, "F-score");
        check_is(found.f_score[i].precision, 1.0, "precision");
        check_is(found.f_score[i].recall, 1.0, "recall");
    }
    for (size_t i = 0; i <= PERCENTS; i++)
        check_is(found.side[0].percentile[i], 0.0, "percentile");
    qm_measured_comparison_free(&found);
}

static void a_mesh_is_what_it_is(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 1);
    static const double far[3] = {1e9, -1e9, 3e8};
    for (int shape = 0; shape < 12; shape++) {
        qm_mesh a = shape == 0   ? qm_shape_torus(12, 6, 1.0, 0.3)
                    : shape == 1 ? qm_shape_saddle(5)
                    : shape == 2 ? qm_shape_points(&random, 30)
                    : shape == 3 ? qm_shape_strip(7, 2, 2.0)
                    : shape == 4 ? qm_shape_box(1, 2, 0)
                                 : qm_shape_soup(&random, 12, QM_SOUP_MIXED,
                                                 (qm_soup_style)(shape - 5) % QM_SOUP_STYLE_COUNT, 0.5);
        if (shape % 3 == 1) qm_shape_move(&a, 1.0, far);
        if (shape % 3 == 2) qm_shape_move(&a, 1e-30, (const double[3]){0, 0, 0});
        qm_mesh copy = qm_shape_copy(&a), cut = qm_shape_triangulated(&a);
        for (int reading = 0; reading < 2; reading++)
            check_same(&a, &copy, (qm_quad_reading)reading);
        if (a.face_count > 0) check_same(&a, &cut, QM_QUADS_TRIANGLES);
        qm_shape_free(&a);
        qm_shape_free(&copy);
        qm_shape_free(&cut);
    }
}

static void limits_beside_the_distance_are_exact(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_plane(4, 0.0), b = qm_shape_plane(3, 0.75);
    static const double limits[] = {0.0, 0.7499999, 0.75, 0.7500001, 1e300, 0x1p-1074};
    for (int reading = 0; reading < 2; reading++) {
        qm_comparison_options options = options_for((qm_quad_reading)reading, limits, 6);
        options.tolerance = 1e-9;
        qm_comparison found = qm_measured_comparison(&a, &b, &options);
        static const double expected[] = {0, 0, 1, 1, 1, 0};
        for (size_t i = 0; i < 6; i++) {
            if (i == 2) { /* no double tells the distance from its computed bounds */
                check_holds(found.f_score[i].f, 1.0, 1.0, "F-score at the distance", 0);
                continue;
            }
            check_is(found.side[0].share[i], expected[i], "share");
            check_is(found.f_score[i].f, expected[i], "F-score");
        }
        qm_measured_comparison_free(&found);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/* ---- known values ---- */

/** The plane z = slope x over [0, width]^2 against a large plane z = 0: the distance of a point is slope x. */
static void check_wedge(qm_random *random, uint64_t stream)
{
    /* Powers of two and few digits, so that the corners are what they should be, far from the origin too. */
    double size = ldexp(1.0, (int)qm_random_below(random, 200) - 100);
    double rise = (double)(1 + qm_random_below(random, 64)) / 16.0 * size,
           width = (double)(1 + qm_random_below(random, 8)) * size;
    double away = (double)qm_random_below(random, 3) * 1024.0 * size;
    const double corner[4][3] = {{away, away, away},
                                 {away + width, away, away + rise},
                                 {away + width, away + width, away + rise},
                                 {away, away + width, away}};
    const double ground[4][3] = {{away - 64 * size, away - 64 * size, away},
                                 {away + 64 * size, away - 64 * size, away},
                                 {away + 64 * size, away + 64 * size, away},
                                 {away - 64 * size, away + 64 * size, away}};
    qm_mesh a = qm_shape_face(4, corner), b = qm_shape_face(4, ground);
    double limits[MAX_LIMITS];
    for (int i = 0; i < MAX_LIMITS; i++)
        limits[i] = rise * (i == 0 ? 0.0 : i == 1 ? 1.0 : qm_random_range(random, 0.0, 1.2));
    qm_comparison_options options = options_for((qm_quad_reading)(stream % 2), limits, MAX_LIMITS);
    options.tolerance = 1e-6 * size;
    options.accuracy = ldexp(1.0, -(int)qm_random_below(random, 12));
    qm_comparison found = qm_measured_comparison(&a, &b, &options);
    const qm_deviation *up = &found.side[0];
    check_holds(up->max, rise, rise, "maximum", stream);
    check_holds(up->mean, 0.5 * rise, 0.5 * rise, "mean", stream);
    check_holds(up->rms, rise * sqrt(1.0 / 3.0) * (1 - 1e-15), rise * sqrt(1.0 / 3.0) * (1 + 1e-15), "rms",
                stream);
    check_holds(found.spread[0], rise * sqrt(1.0 / 12.0) * (1 - 1e-15), rise * sqrt(1.0 / 12.0) * (1 + 1e-15),
                "std", stream);
    for (int i = 0; i < PERCENTS; i++)
        check_holds(up->percentile[i], percents[i] / 100.0 * rise * (1 - 1e-15),
                    percents[i] / 100.0 * rise * (1 + 1e-15), "percentile", stream);
    for (int i = 0; i < MAX_LIMITS; i++) {
        double share = fmin(1.0, limits[i] / rise);
        check_holds(up->share[i], share * (1 - 1e-15), share * (1 + 1e-15), "share", stream);
        assert_true(found.f_score[i].precision.lower == up->share[i].lower);
    }
    /* Nothing is loose: the distance is linear. */
    QM_CHECK(up->share[0].upper < 1e-6 && found.spread[0].upper - found.spread[0].lower <= 0.2 * rise,
             "[%g, %g]", found.spread[0].lower, found.spread[0].upper);
    qm_measured_comparison_free(&found);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void wedges_have_known_figures(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 20000 : 400, seed = qm_check_seed();
    print_message("seed %llu\n", (unsigned long long)seed);
    for (uint64_t i = 0; i < count; i++) {
        qm_random random = qm_random_make(seed, 5000000 + i);
        check_wedge(&random, i);
    }
}

static void points_are_counted(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_make(4, 0), b = qm_shape_make(2, 0);
    static const double of_a[] = {0, 0, 1, 0, 1, 2, 1, 0, 3, 1, 1, 6}, of_b[] = {0, 0, 1, 1, 1, 8};
    memcpy(a.positions, of_a, sizeof of_a);
    memcpy(b.positions, of_b, sizeof of_b);
    static const double limits[] = {0.5, 2.0, 1.99};
    qm_comparison_options options = options_for(QM_QUADS_TRIANGLES, limits, 3);
    options.tolerance = 1e-9;
    options.worst_count = 3;
    options.worst_radius = 0.5;
    qm_comparison found = qm_measured_comparison(&a, &b, &options);
    /* Distances 0, sqrt 2, sqrt 5, 2 and 0, 2. */
    double mean_a = (sqrt(2) + sqrt(5) + 2) / 4, mean_b = 1.0, low = 1 - 1e-15, high = 1 + 1e-15;
    check_holds(found.side[0].mean, mean_a * low, mean_a * high, "mean", 0);
    check_holds(found.chamfer_l1, (mean_a + mean_b) * low, (mean_a + mean_b) * high, "l1", 0);
    check_holds(found.chamfer_l2, (11.0 / 4 + 2) * low, (11.0 / 4 + 2) * high, "l2", 0);
    check_holds(found.mean, (4 * mean_a + 2 * mean_b) / 6 * low, (4 * mean_a + 2 * mean_b) / 6 * high,
                "mean of both", 0);
    check_holds(found.rms, sqrt(15.0 / 6) * low, sqrt(15.0 / 6) * high, "rms of both", 0);
    check_holds(found.side[0].share[0], 0.25, 0.25, "share", 0);
    check_holds(found.side[0].share[1], 0.75, 0.75, "share", 0);
    check_holds(found.f_score[2].f, 0.5, 0.5, "F-score", 0);
    QM_CHECK(found.f_score[2].f.upper - found.f_score[2].f.lower < 1e-9, "F-score: [%g, %g]",
             found.f_score[2].f.lower, found.f_score[2].f.upper);
    assert_int_equal(found.side[0].worst_count, 3);
    static const uint32_t worst[] = {2, 3, 1};
    for (int i = 0; i < 3; i++)
        assert_int_equal(found.side[0].worst[i].from.face, worst[i]);
    assert_int_equal(found.side[1].worst_count, 1); /* the other point coincides with one of A */
    qm_measured_comparison_free(&found);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/* ---- against dense cells ---- */

/** What cells tell of a direction. */
typedef struct cell_sums {
    qm_interval mean, square, max, p95;
} cell_sums;

static cell_sums sum_cells(const qm_cell_list *list)
{
    cell_sums sum = {{0, 0}, {0, 0}, {0, 0}, {0, 0}};
    for (size_t i = 0; i < list->count; i++) {
        const qm_dense_cell *c = &list->cells[i];
        double weight = c->area / list->area;
        sum.mean.lower += weight * c->low;
        sum.mean.upper += weight * c->high;
        sum.square.lower += weight * c->low * c->low;
        sum.square.upper += weight * c->high * c->high;
        sum.max.lower = fmax(sum.max.lower, c->low);
        sum.max.upper = fmax(sum.max.upper, c->high);
    }
    return sum;
}

/** The places are on the source, as far as they say, apart, and nothing that is outside of their radii is farther. */
static void check_worst(const qm_deviation *side, const qm_cell_list *list, const qm_mesh *a,
                        const qm_mesh *b, qm_quad_reading reading, double radius, uint64_t stream)
{
    QM_CHECK(side->worst_count >= 1, "stream %llu", (unsigned long long)stream);
    for (size_t i = 0; i < side->worst_count; i++) {
        const qm_deviation_place *place = &side->worst[i];
        double off = 1e-9, on[3];
        qm_slow_bracket from_b = qm_slow_distance(b, reading, place->from.position, 1e-9);
        qm_slow_bracket from_a = qm_slow_distance(a, reading, place->from.position, 1e-9);
        QM_CHECK(from_b.upper >= place->lower - off && place->lower <= place->upper,
                 "stream %llu: place %zu is %.12g away, not %.12g", (unsigned long long)stream, i,
                 from_b.upper, place->lower);
        /* A patch may stand for its triangles to within the accuracy. */
        double beside = reading == QM_QUADS_BILINEAR ? 1e-2 : off;
        QM_CHECK(from_a.lower <= beside, "stream %llu: place %zu is %g beside the surface",
                 (unsigned long long)stream, i, from_a.lower);
        qm_slow_position(a, place->from.face, reading, place->from.uv, on);
        for (int k = 0; k < 3; k++)
            QM_CHECK(fabs(on[k] - place->from.position[k]) <= (reading == QM_QUADS_BILINEAR ? 0.3 : off),
                     "stream %llu: parameters of place %zu: %g", (unsigned long long)stream, i,
                     on[k] - place->from.position[k]);
        for (size_t k = 0; k < i; k++) {
            const double *p = place->from.position, *q = side->worst[k].from.position;
            double apart = sqrt((p[0] - q[0]) * (p[0] - q[0]) + (p[1] - q[1]) * (p[1] - q[1]) +
                                (p[2] - q[2]) * (p[2] - q[2]));
            QM_CHECK(apart > radius * (1 - 1e-9), "stream %llu: places %g apart", (unsigned long long)stream,
                     apart);
        }
        for (size_t c = 0; c < list->count; c++) {
            const qm_dense_cell *cell = &list->cells[c];
            bool is_outside = true;
            for (size_t k = 0; k < i; k++) {
                const double *p = cell->middle, *q = side->worst[k].from.position;
                is_outside &= sqrt((p[0] - q[0]) * (p[0] - q[0]) + (p[1] - q[1]) * (p[1] - q[1]) +
                                   (p[2] - q[2]) * (p[2] - q[2])) > radius + cell->radius + off;
            }
            QM_CHECK(!is_outside || cell->low <= place->upper + off,
                     "stream %llu: a point %g away, place %zu at most %g", (unsigned long long)stream,
                     cell->low, i, place->upper);
        }
    }
}

static void check_side(const qm_comparison *found, int side, const qm_cell_list *list, const cell_sums *t,
                       const double *limits, double slack, uint64_t stream)
{
    const qm_deviation *deviation = &found->side[side];
    double most = t->max.upper;
    check_holds(deviation->mean, t->mean.lower - slack * most, t->mean.upper + slack * most, "mean", stream);
    check_holds(deviation->max, t->max.lower - 1e-9, t->max.upper + 1e-9, "maximum", stream);
    double variance[2] = {t->square.lower - t->mean.upper * t->mean.upper,
                          t->square.upper - t->mean.lower * t->mean.lower};
    check_holds(found->spread[side], sqrt(fmax(0.0, variance[0])) - sqrt(slack) * most - 1e-9,
                sqrt(fmax(0.0, variance[1])) + sqrt(slack) * most + 1e-9, "std", stream);
    for (size_t i = 0; i < deviation->limit_count; i++)
        check_holds(deviation->share[i], qm_cells_share(list, 0.0, limits[i], true) - slack - 1e-9,
                    qm_cells_share(list, 0.0, limits[i], false) + slack + 1e-9, "share", stream);
}

static double harmonic(double x, double y)
{
    return x + y > 0.0 ? 2.0 * x * y / (x + y) : 0.0;
}

static void check_both(const qm_comparison *found, const qm_cell_list list[2], const cell_sums t[2],
                       const double *limits, double slack, uint64_t stream)
{
    double most = fmax(t[0].max.upper, t[1].max.upper), more = slack * most + 1e-9;
    check_holds(found->hausdorff, fmax(t[0].max.lower, t[1].max.lower) - 1e-9, most + 1e-9,
                "Hausdorff distance", stream);
    check_holds(found->chamfer_l1, t[0].mean.lower + t[1].mean.lower - 2 * more,
                t[0].mean.upper + t[1].mean.upper + 2 * more, "l1", stream);
    check_holds(found->chamfer_l2, t[0].square.lower + t[1].square.lower - 4 * more * (1 + most),
                t[0].square.upper + t[1].square.upper + 4 * more * (1 + most), "l2", stream);
    double weight = list[0].area / (list[0].area + list[1].area);
    check_holds(found->mean, weight * t[0].mean.lower + (1 - weight) * t[1].mean.lower - 2 * more,
                weight * t[0].mean.upper + (1 - weight) * t[1].mean.upper + 2 * more, "mean of both", stream);
    double square[2] = {weight * t[0].square.lower + (1 - weight) * t[1].square.lower,
                        weight * t[0].square.upper + (1 - weight) * t[1].square.upper};
    check_holds(found->rms, sqrt(square[0]) - 2 * more, sqrt(square[1]) + 2 * more, "rms of both", stream);
    /* The greater 95th percentile p: within p surely 95 % of both, and below it not of one. */
    bool is_reached = true, is_first = false;
    for (int i = 0; i < 2; i++) {
        is_reached &= qm_cells_share(&list[i], 0.0, found->hd95.upper, false) >= 0.95 - slack - 1e-9;
        is_first |=
            qm_cells_share(&list[i], 0.0, nextafter(found->hd95.lower, 0.0), true) <= 0.95 + slack + 1e-9;
    }
    QM_CHECK(is_reached && is_first, "stream %llu: hd95 [%g, %g]", (unsigned long long)stream,
             found->hd95.lower, found->hd95.upper);
    for (size_t i = 0; i < found->limit_count; i++) {
        double sure[2], may[2];
        for (int k = 0; k < 2; k++) {
            sure[k] = fmax(0.0, qm_cells_share(&list[k], 0.0, limits[i], true) - slack - 1e-9);
            may[k] = qm_cells_share(&list[k], 0.0, limits[i], false) + slack + 1e-9;
        }
        check_holds(found->f_score[i].f, harmonic(sure[0], sure[1]), harmonic(may[0], may[1]), "F-score",
                    stream);
    }
}

/** Bounds that are reported only come closer; user is the last interval. */
static void take_report(void *user, const qm_hausdorff_progress *progress)
{
    qm_interval *told = user;
    assert_true(told->lower <= progress->lower && progress->lower <= progress->upper &&
                progress->upper <= told->upper);
    *told = (qm_interval){progress->lower, progress->upper};
}

static void check_pair(const qm_mesh *a, const qm_mesh *b, qm_quad_reading reading, qm_random *random, int n,
                       uint64_t stream)
{
    const qm_mesh *mesh[2] = {a, b};
    bool is_bilinear = reading == QM_QUADS_BILINEAR;
    double slack = is_bilinear ? 0.05 : 0.0, limits[MAX_LIMITS], radius = qm_random_range(random, 0.0, 1.0);
    qm_cell_list list[2];
    cell_sums t[2];
    for (int i = 0; i < 2; i++) {
        list[i] = qm_cells_sample(mesh[i], mesh[1 - i], reading, n);
        t[i] = sum_cells(&list[i]);
    }
    for (int i = 0; i < MAX_LIMITS; i++)
        limits[i] = i == 0 ? 0.0 : qm_random_range(random, 0.0, 1.1 * fmax(t[0].max.upper, t[1].max.upper));
    qm_comparison_options options = options_for(reading, limits, MAX_LIMITS);
    options.piece_limit = 1000 * qm_random_below(random, 8);
    options.worst_count = 1 + qm_random_below(random, 6);
    options.worst_radius = radius;
    qm_interval told = {0.0, INFINITY};
    options.progress = take_report;
    options.progress_user = &told;
    qm_comparison found = qm_measured_comparison(a, b, &options);
    QM_CHECK(told.upper < INFINITY && told.lower <= found.hausdorff.lower &&
                 found.hausdorff.upper <= told.upper,
             "stream %llu: told [%.17g, %.17g], found [%.17g, %.17g]", (unsigned long long)stream, told.lower,
             told.upper, found.hausdorff.lower, found.hausdorff.upper);
    if (found.side[0].measure == QM_OVER_AREA && found.side[1].measure == QM_OVER_AREA) {
        for (int i = 0; i < 2; i++) {
            check_side(&found, i, &list[i], &t[i], limits, slack, stream);
            check_worst(&found.side[i], &list[i], mesh[i], mesh[1 - i], reading, radius, stream);
        }
        check_both(&found, list, t, limits, slack, stream);
    }
    qm_measured_comparison_free(&found);
    qm_cells_free(&list[0]);
    qm_cells_free(&list[1]);
}

static void one_soup(uint64_t seed, uint64_t stream, qm_quad_reading reading)
{
    qm_random random = qm_random_make(seed, stream);
    bool is_bilinear = reading == QM_QUADS_BILINEAR;
    qm_mesh mesh[2];
    for (int i = 0; i < 2; i++) {
        qm_soup_corners corners = is_bilinear ? QM_SOUP_QUADS : (qm_soup_corners)qm_random_below(&random, 3);
        qm_soup_style style = (qm_soup_style)qm_random_below(&random, QM_SOUP_STYLE_COUNT);
        mesh[i] =
            qm_shape_soup(&random, 1 + qm_random_below(&random, 5), corners, style, is_bilinear ? 0.5 : 1.0);
    }
    check_pair(&mesh[0], &mesh[1], reading, &random, is_bilinear ? 8 : 12, stream);
    qm_shape_free(&mesh[0]);
    qm_shape_free(&mesh[1]);
}

static void random_soups_agree_with_cells(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 4000 : 40, seed = qm_check_seed();
    print_message("seed %llu\n", (unsigned long long)seed);
    for (uint64_t i = 0; i < count; i++)
        one_soup(seed, 6000000 + i, QM_QUADS_TRIANGLES);
}

static void random_patches_agree_with_cells(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 200 : 6, seed = qm_check_seed();
    print_message("seed %llu\n", (unsigned long long)seed);
    for (uint64_t i = 0; i < count; i++)
        one_soup(seed, 7000000 + i, QM_QUADS_BILINEAR);
}

/* ---- the call ---- */

static void threads_change_nothing(void **state)
{
    (void)state;
    static const double limits[] = {0.02, 0.01};
    qm_mesh a = qm_shape_torus(20, 10, 1.0, 0.3), b = qm_shape_torus(17, 9, 1.0, 0.31);
    qm_comparison found[2];
    for (int i = 0; i < 2; i++) {
        qm_context ctx = qm_host_context();
        qm_comparison_options options = options_for(QM_QUADS_TRIANGLES, limits, 2);
        options.thread_count = 1 + 2 * i;
        options.worst_count = 4;
        options.worst_radius = 0.2;
        assert_int_equal(qm_measured_comparison_in(&ctx, &a, &b, &options, &found[i]), QM_OK);
    }
    for (int side = 0; side < 2; side++) {
        const qm_deviation *one = &found[0].side[side], *more = &found[1].side[side];
        assert_memory_equal(one->share, more->share, 2 * sizeof *one->share);
        assert_int_equal(one->worst_count, more->worst_count);
        assert_true(one->worst_count == 4);
        for (size_t i = 1; i < one->worst_count; i++)
            assert_memory_equal(&one->worst[i].lower, &more->worst[i].lower, 2 * sizeof(double));
    }
    assert_memory_equal(&found[0].chamfer_l1, &found[1].chamfer_l1, 2 * sizeof(qm_interval));
    qm_context ctx = qm_host_context();
    qm_comparison_reset(&ctx, &found[0]);
    qm_comparison_reset(&ctx, &found[1]);
    qm_shape_free(&a);
    qm_shape_free(&b);
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

static bool meet(qm_interval x, qm_interval y)
{
    return x.lower <= x.upper && x.lower <= y.upper && x.upper >= y.lower;
}

/** Cancels a comparison at its n-th poll: all intervals hold nevertheless. */
static bool cancel_at(const qm_mesh *a, const qm_mesh *b, const qm_comparison_options *options, size_t n,
                      const qm_comparison *truth)
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
    qm_comparison found;
    assert_int_equal(qm_comparison_measure(&ctx, of_a, of_b, options, NULL, &found), QM_OK);
    bool was_raised = atomic_load(&at.cancel);
    assert_true(found.is_canceled == was_raised);
    bool holds = meet(found.hausdorff, truth->hausdorff) && meet(found.hd95, truth->hd95) &&
                 meet(found.mean, truth->mean) && meet(found.rms, truth->rms) &&
                 meet(found.chamfer_l1, truth->chamfer_l1) && meet(found.chamfer_l2, truth->chamfer_l2);
    for (int side = 0; side < 2; side++)
        holds &= meet(found.spread[side], truth->spread[side]);
    for (size_t i = 0; i < found.limit_count; i++)
        holds &= meet(found.f_score[i].f, truth->f_score[i].f);
    QM_CHECK(holds, "canceled at poll %zu", n);
    qm_comparison_reset(&ctx, &found);
    qm_bvh_destroy(&ctx, of_a);
    qm_bvh_destroy(&ctx, of_b);
    return was_raised;
}

static void a_canceled_call_tells_what_it_has(void **state)
{
    (void)state;
    static const double limits[] = {0.0, 0.02, 0.2};
    qm_mesh a = qm_shape_torus(10, 6, 1.0, 0.3), b = qm_shape_torus(9, 5, 1.0, 0.31);
    for (int reading = 0; reading < 2; reading++) {
        qm_comparison_options options = options_for((qm_quad_reading)reading, limits, 3);
        options.piece_limit = 3000;
        options.worst_count = 5;
        options.worst_radius = 0.1;
        qm_comparison truth = qm_measured_comparison(&a, &b, &options);
        size_t n = 0;
        while (cancel_at(&a, &b, &options, n, &truth))
            n += 1 + n / 12;
        qm_measured_comparison_free(&truth);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    static const double limits[] = {0.02};
    qm_mesh a = qm_shape_torus(6, 4, 1.0, 0.3), b = qm_shape_torus(5, 4, 1.0, 0.31);
    qm_comparison_options options = options_for(QM_QUADS_TRIANGLES, limits, 1);
    options.worst_count = 3;
    options.worst_radius = 0.1;
    options.piece_limit = 500;
    qm_status status = QM_E_NO_MEMORY;
    for (size_t fail_at = 0; status != QM_OK; fail_at++) {
        qm_failing_allocator allocator = {.fail_at = fail_at};
        qm_context ctx = qm_context_make();
        ctx.allocator = qm_failing_allocator_hook(&allocator);
        qm_comparison found;
        status = qm_measured_comparison_in(&ctx, &a, &b, &options, &found);
        assert_true(status == QM_OK || status == QM_E_NO_MEMORY);
        qm_comparison_reset(&ctx, &found);
        assert_int_equal(allocator.live_blocks, 0);
        assert_false(allocator.mismatched);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void bad_options_are_refused(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_plane(1, 0.0);
    static const double limits[][2] = {{-1.0, 1.0}, {NAN, 1.0}, {INFINITY, 1.0}, {1.0, -1.0}, {1.0, NAN}};
    for (size_t i = 0; i < sizeof limits / sizeof *limits; i++) {
        qm_context ctx = qm_context_make();
        qm_comparison_options options = options_for(QM_QUADS_TRIANGLES, limits[i], 1);
        options.worst_count = 1;
        options.worst_radius = limits[i][1];
        qm_comparison found;
        assert_int_equal(qm_measured_comparison_in(&ctx, &a, &a, &options, &found), QM_E_ARGUMENT);
        assert_true(found.f_score == NULL && found.limit_count == 0);
    }
    qm_shape_free(&a);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_mesh_is_what_it_is),
        cmocka_unit_test(limits_beside_the_distance_are_exact),
        cmocka_unit_test(wedges_have_known_figures),
        cmocka_unit_test(points_are_counted),
        cmocka_unit_test(random_soups_agree_with_cells),
        cmocka_unit_test(random_patches_agree_with_cells),
        cmocka_unit_test(threads_change_nothing),
        cmocka_unit_test(a_canceled_call_tells_what_it_has),
        cmocka_unit_test(every_allocation_may_fail),
        cmocka_unit_test(bad_options_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
