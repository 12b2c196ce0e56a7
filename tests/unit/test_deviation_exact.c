/*
 * Deviations of one triangle from one facet or point, whose moments and shares have closed forms, in 113
 * bits: near, touching, crossing, slivers, and with origins up to 1e13 away. The intervals hold the value
 * itself, so that a margin too small by a rounding is seen.
 */
#include "check.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "qm/deviation.h"
#include "shapes.h"
#include "slow_twin.h"

typedef __float128 wide;

static const double percents[] = {0.1, 10, 37, 50, 82, 99, 100};
enum { PERCENTS = sizeof percents / sizeof percents[0], BINS = 5 };

static wide wide_root(wide x)
{
    if (!(x > 0)) return 0;
    wide root = (wide)sqrtl((long double)x);
    for (int i = 0; i < 3; i++)
        root = (root + x / root) / 2;
    return root;
}

static wide dot(const wide a[3], const wide b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void subtract(const double a[3], const double b[3], wide out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = (wide)a[k] - (wide)b[k];
}

static void cross(const wide a[3], const wide b[3], wide out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

static wide triangle_area(const double corner[3][3])
{
    wide a[3], b[3], n[3];
    subtract(corner[1], corner[0], a);
    subtract(corner[2], corner[0], b);
    cross(a, b, n);
    return wide_root(dot(n, n)) / 2;
}

/* ---- |f| of a linear f over a triangle ---- */

/** Share of a triangle in which a linear function with these values is at most x. */
static wide share_below(const wide f[3], wide x)
{
    wide v[3] = {f[0], f[1], f[2]};
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 2 - i; k++)
            if (v[k] > v[k + 1]) {
                wide larger = v[k];
                v[k] = v[k + 1];
                v[k + 1] = larger;
            }
    if (x < v[0]) return 0;
    if (x >= v[2]) return 1;
    if (x < v[1]) return (x - v[0]) * (x - v[0]) / ((v[1] - v[0]) * (v[2] - v[0]));
    return 1 - (v[2] - x) * (v[2] - x) / ((v[2] - v[1]) * (v[2] - v[0]));
}

/** Share in which |f| < x, or <= x. */
static wide share_within(const wide f[3], wide x, bool is_closed)
{
    const wide minus[3] = {-f[0], -f[1], -f[2]};
    if (f[0] == f[1] && f[1] == f[2]) {
        wide size = f[0] < 0 ? -f[0] : f[0];
        return size < x || (is_closed && size == x) ? 1 : 0;
    }
    if (!(x > 0)) return 0;
    return share_below(f, x) + share_below(minus, x) - 1;
}

/** Mean of max(f, 0). */
static wide mean_above(const wide f[3])
{
    int positive = (f[0] > 0) + (f[1] > 0) + (f[2] > 0);
    wide mean = (f[0] + f[1] + f[2]) / 3;
    if (positive == 0) return 0;
    if (positive == 3) return mean;
    if (positive == 2) {
        const wide minus[3] = {-f[0], -f[1], -f[2]};
        return mean + mean_above(minus);
    }
    int i = f[0] > 0 ? 0 : f[1] > 0 ? 1 : 2;
    wide a = f[i], b = f[(i + 1) % 3], c = f[(i + 2) % 3];
    return a * a * a / ((a - b) * (a - c)) / 3;
}

static wide mean_square(const wide f[3])
{
    return (f[0] * f[0] + f[1] * f[1] + f[2] * f[2] + f[0] * f[1] + f[1] * f[2] + f[2] * f[0]) / 6;
}

/* ---- one try ---- */

typedef struct exact_pair {
    uint64_t number;
    qm_random random;
    double a[3][3], b[3][3];
    double worth; /* about the greatest distance */
    qm_deviation found;
} exact_pair;

static void check_holds(const exact_pair *pair, qm_interval found, wide value, const char *name)
{
    QM_CHECK((wide)found.lower <= value && value <= (wide)found.upper,
             "seed %llu, pair %llu: %s [%.20g, %.20g], but it is %.20g, %.3g below, %.3g above",
             (unsigned long long)qm_check_seed(), (unsigned long long)pair->number, name, found.lower,
             found.upper, (double)value, (double)((wide)found.lower - value),
             (double)(value - (wide)found.upper));
}

static void measure_to(exact_pair *pair, qm_mesh *target)
{
    qm_mesh a = qm_shape_face(3, (const double(*)[3])pair->a), b = *target;
    qm_context ctx = qm_context_make();
    qm_bvh *tree_a = NULL, *tree_b = NULL;
    assert_int_equal(qm_bvh_build(&ctx, &a, QM_BVH_ALL, 1, &tree_a), QM_OK);
    assert_int_equal(qm_bvh_build(&ctx, &b, QM_BVH_ALL, 1, &tree_b), QM_OK);
    qm_deviation_options options = qm_deviation_options_default();
    options.quads = (qm_quad_reading)qm_random_below(&pair->random, 2);
    options.percentile = percents;
    options.percentile_count = PERCENTS;
    options.bin_count = BINS;
    options.accuracy = pow(10.0, qm_random_range(&pair->random, -4.0, -1.0));
    options.tolerance = 1e-6 * fmax(pair->worth, 1e-300);
    options.piece_limit = qm_random_below(&pair->random, 500);
    assert_int_equal(qm_deviation_measure(&ctx, tree_a, tree_b, &options, &pair->found), QM_OK);
    qm_bvh_destroy(&ctx, tree_a);
    qm_bvh_destroy(&ctx, tree_b);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void measure(exact_pair *pair)
{
    qm_mesh b = qm_shape_face(3, (const double(*)[3])pair->b);
    measure_to(pair, &b);
}

static void finish(exact_pair *pair)
{
    qm_context ctx = qm_context_make();
    qm_deviation_reset(&ctx, &pair->found);
}

/** A random frame of axes x, y, z. */
static void draw_axes(qm_random *random, double axis[3][3])
{
    double other[3], length = 0.0;
    qm_random_direction(random, axis[0]);
    do {
        qm_random_direction(random, other);
        double along = axis[0][0] * other[0] + axis[0][1] * other[1] + axis[0][2] * other[2];
        length = 0.0;
        for (int k = 0; k < 3; k++) {
            axis[1][k] = other[k] - along * axis[0][k];
            length += axis[1][k] * axis[1][k];
        }
    } while (length < 0.01);
    for (int k = 0; k < 3; k++)
        axis[1][k] /= sqrt(length);
    for (int k = 0; k < 3; k++)
        axis[2][k] =
            axis[0][(k + 1) % 3] * axis[1][(k + 2) % 3] - axis[0][(k + 2) % 3] * axis[1][(k + 1) % 3];
}

static void place(double axis[3][3], const double origin[3], double x, double y, double z, double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = origin[k] + x * axis[0][k] + y * axis[1][k] + z * axis[2][k];
}

/** Half of the tries near the origin, the others 1e3 to 1e13 away from it. */
static void draw_origin(exact_pair *pair, double origin[3])
{
    bool is_far = qm_random_below(&pair->random, 2) == 1;
    double away = is_far ? pow(10.0, qm_random_range(&pair->random, 3.0, 13.0)) : 0.0;
    qm_random_direction(&pair->random, origin);
    for (int k = 0; k < 3; k++)
        origin[k] *= away;
}

/* ---- over a plane ---- */

/** The heights of A's corners over B's plane; false when a foot is not well inside of B. */
static bool heights_over(const exact_pair *pair, wide height[3])
{
    wide e[3], f[3], n[3];
    subtract(pair->b[1], pair->b[0], e);
    subtract(pair->b[2], pair->b[0], f);
    cross(e, f, n);
    wide length2 = dot(n, n);
    if (!(length2 > 0)) return false;
    for (int i = 0; i < 3; i++) {
        wide d[3], across[3], weight[2];
        subtract(pair->a[i], pair->b[0], d);
        height[i] = dot(d, n) / wide_root(length2);
        cross(d, f, across);
        weight[0] = dot(across, n) / length2;
        cross(e, d, across);
        weight[1] = dot(across, n) / length2;
        if (!(weight[0] >= 0 && weight[1] >= 0 && weight[0] + weight[1] <= 1)) return false;
    }
    return true;
}

static void check_plane(exact_pair *pair, const wide height[3])
{
    const wide minus[3] = {-height[0], -height[1], -height[2]};
    const qm_deviation *found = &pair->found;
    wide greatest = 0;
    for (int i = 0; i < 3; i++) {
        wide size = height[i] < 0 ? -height[i] : height[i];
        if (size > greatest) greatest = size;
    }
    check_holds(pair, found->max, greatest, "max");
    if (found->measure != QM_OVER_AREA) return;
    check_holds(pair, found->size, triangle_area((const double(*)[3])pair->a), "area");
    check_holds(pair, found->mean, mean_above(height) + mean_above(minus), "mean");
    check_holds(pair, found->rms, wide_root(mean_square(height)), "rms");
    for (int i = 0; i < PERCENTS; i++) {
        wide share = (wide)percents[i] / 100, low = share_within(height, found->percentile[i].lower, false);
        QM_CHECK(low <= share &&
                     (share >= 1 || share_within(height, found->percentile[i].upper, true) >= share),
                 "seed %llu, pair %llu: percentile %g [%.20g, %.20g]", (unsigned long long)qm_check_seed(),
                 (unsigned long long)pair->number, percents[i], found->percentile[i].lower,
                 found->percentile[i].upper);
    }
    for (int i = 0; i < BINS; i++) {
        wide from = (wide)i * (wide)found->bin_width, to = (wide)(i + 1) * (wide)found->bin_width;
        wide share = (i + 1 < BINS ? share_within(height, to, false) : 1) - share_within(height, from, false);
        check_holds(pair, found->bin[i], share, "bin");
    }
}

/** A triangle near a much larger one: beside it, touching it, through it; up to a sliver. */
static void triangles_over_a_plane_are_exact(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 300000 : 1500, tried = 0;
    print_message("seed %llu\n", (unsigned long long)qm_check_seed());
    for (uint64_t number = 0; number < count; number++) {
        exact_pair pair = {.number = number, .random = qm_random_make(qm_check_seed(), number)};
        qm_random *random = &pair.random;
        double axis[3][3], origin[3], size = pow(2.0, qm_random_range(random, -20.0, 20.0));
        draw_axes(random, axis);
        draw_origin(&pair, origin);
        double thin = qm_random_below(random, 3) ? 1.0 : pow(10.0, qm_random_range(random, -9.0, 0.0));
        double rise = size * pow(10.0, qm_random_range(random, -16.0, 0.0));
        double up = rise * (double)qm_random_below(random, 3);
        for (int i = 0; i < 3; i++) {
            place(axis, origin, size * qm_random_range(random, -1.0, 1.0),
                  size * thin * qm_random_range(random, -1.0, 1.0),
                  up + rise * qm_random_range(random, -1.0, 1.0), pair.a[i]);
            double angle = 2.0 * M_PI * i / 3, far = size * 20.0;
            place(axis, origin, far * cos(angle), far * sin(angle), 0.0, pair.b[i]);
        }
        pair.worth = up + rise;
        wide height[3];
        if (!heights_over(&pair, height)) continue;
        tried++;
        measure(&pair);
        check_plane(&pair, height);
        finish(&pair);
    }
    QM_CHECK(tried > count / 2, "%llu of %llu", (unsigned long long)tried, (unsigned long long)count);
}

/* ---- over an edge and in a valley ---- */

/** The mean of max(f, 0)^2, by the corner of a sign of its own: f is linear along the edges. */
static wide mean_square_above(const wide f[3])
{
    int positive = (f[0] > 0) + (f[1] > 0) + (f[2] > 0);
    if (positive == 0) return 0;
    if (positive == 3) return mean_square(f);
    if (positive == 2) {
        const wide minus[3] = {-f[0], -f[1], -f[2]};
        return mean_square(f) - mean_square_above(minus);
    }
    int i = f[0] > 0 ? 0 : f[1] > 0 ? 1 : 2;
    wide a = f[i], b = f[(i + 1) % 3], c = f[(i + 2) % 3];
    return a * a * a * a / ((a - b) * (a - c)) / 6;
}

/**
 * A triangle that sticks out over the edge of a large facet by up to all of its size: the square of the
 * distance is that of the height and, beyond the edge, that of how far it lies beyond.
 */
static void triangles_over_an_edge_are_exact(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 200000 : 1000;
    print_message("seed %llu\n", (unsigned long long)qm_check_seed());
    for (uint64_t number = 0; number < count; number++) {
        exact_pair pair = {.number = number, .random = qm_random_make(qm_check_seed(), 1000000 + number)};
        qm_random *random = &pair.random;
        double axis[3][3], origin[3], size = pow(10.0, qm_random_range(random, -3.0, 0.0));
        draw_axes(random, axis);
        draw_origin(&pair, origin);
        double rise = size * pow(10.0, qm_random_range(random, -9.0, 0.0));
        double out = size * pow(10.0, qm_random_range(random, -9.0, 0.5)),
               up = rise * (double)qm_random_below(random, 3);
        for (int i = 0; i < 3; i++) {
            double y = qm_random_range(random, 0.0, 2.0 * size);
            place(axis, origin, size * qm_random_range(random, -1.0, 1.0), y - out,
                  up + rise * qm_random_range(random, -1.0, 1.0), pair.a[i]);
        }
        place(axis, origin, -60.0 * size, 0.0, 0.0, pair.b[0]);
        place(axis, origin, 60.0 * size, 0.0, 0.0, pair.b[1]);
        place(axis, origin, 0.0, 60.0 * size, 0.0, pair.b[2]);
        pair.worth = up + rise + size;
        wide e[3], f[3], n[3], inward[3], height[3], beyond[3];
        subtract(pair.b[1], pair.b[0], e);
        subtract(pair.b[2], pair.b[0], f);
        cross(e, f, n);
        cross(n, e, inward);
        for (int i = 0; i < 3; i++) {
            wide d[3];
            subtract(pair.a[i], pair.b[0], d);
            height[i] = dot(d, n) / wide_root(dot(n, n));
            beyond[i] = -dot(d, inward) / wide_root(dot(inward, inward));
        }
        measure(&pair);
        if (pair.found.measure == QM_OVER_AREA)
            check_holds(&pair, pair.found.rms, wide_root(mean_square(height) + mean_square_above(beyond)),
                        "rms");
        finish(&pair);
    }
}

/** B as a valley of two large facets that meet in an edge; A's feet are well inside of both. */
static void triangles_in_a_valley_are_exact(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 200000 : 1000;
    print_message("seed %llu\n", (unsigned long long)qm_check_seed());
    for (uint64_t number = 0; number < count; number++) {
        qm_random random = qm_random_make(qm_check_seed(), 2000000 + number);
        exact_pair pair = {.number = number, .random = random};
        double axis[3][3], origin[3], corner[4][3], slope[2];
        draw_axes(&pair.random, axis);
        draw_origin(&pair, origin);
        for (int i = 0; i < 2; i++)
            slope[i] = qm_random_range(&pair.random, 0.05, 1.0);
        double low = pow(10.0, qm_random_range(&pair.random, -9.0, -1.0));
        for (int i = 0; i < 3; i++) {
            double y = qm_random_range(&pair.random, -1.0, 1.0);
            double ground = y < 0.0 ? -y * slope[0] : y * slope[1];
            place(axis, origin, qm_random_range(&pair.random, -1.0, 1.0), y,
                  ground + low * qm_random_range(&pair.random, 1.0, 3.0), pair.a[i]);
        }
        place(axis, origin, -50.0, 0.0, 0.0, corner[0]);
        place(axis, origin, 50.0, 0.0, 0.0, corner[1]);
        place(axis, origin, 0.0, -50.0, 50.0 * slope[0], corner[2]);
        place(axis, origin, 0.0, 50.0, 50.0 * slope[1], corner[3]);
        qm_mesh b = qm_shape_make(4, 2);
        memcpy(b.positions, corner, sizeof corner);
        static const uint32_t faces[8] = {0, 1, 3, QM_NO_INDEX, 1, 0, 2, QM_NO_INDEX};
        memcpy(b.faces, faces, sizeof faces);
        pair.worth = 1.0;
        measure_to(&pair, &b);
        wide height[2][3], over[3];
        bool is_above = true;
        for (int side = 0; side < 2; side++) {
            wide e[3], f[3], n[3];
            subtract(corner[side ? 0 : 1], corner[side ? 1 : 0], e);
            subtract(corner[side ? 2 : 3], corner[side ? 1 : 0], f);
            cross(e, f, n);
            for (int i = 0; i < 3; i++) {
                wide d[3];
                subtract(pair.a[i], corner[0], d);
                height[side][i] = dot(d, n) / wide_root(dot(n, n));
                is_above &= height[side][i] > 0;
            }
        }
        for (int i = 0; i < 3; i++)
            over[i] = height[0][i] - height[1][i];
        wide mean = (height[0][0] + height[0][1] + height[0][2]) / 3 - mean_above(over);
        if (is_above && pair.found.measure == QM_OVER_AREA) check_holds(&pair, pair.found.mean, mean, "mean");
        finish(&pair);
    }
}

/* ---- over a point ---- */

/** The mean of |p - b|^2 is that over the middles of the edges. */
static wide mean_square_from(const double a[3][3], const double b[3])
{
    wide sum = 0;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            wide d = ((wide)a[i][k] + (wide)a[(i + 1) % 3][k]) / 2 - (wide)b[k];
            sum += d * d;
        }
    return sum / 3;
}

/** A triangle and a facet that is a single point: in it, or up to 1e6, now and then 1e85 sizes away. */
static void triangles_over_a_point_are_exact(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 100000 : 500;
    print_message("seed %llu\n", (unsigned long long)qm_check_seed());
    for (uint64_t number = 0; number < count; number++) {
        exact_pair pair = {.number = number, .random = qm_random_make(qm_check_seed(), 500000 + number)};
        qm_random *random = &pair.random;
        double axis[3][3], origin[3];
        draw_axes(random, axis);
        draw_origin(&pair, origin);
        double most = qm_random_below(random, 8) ? 6.0 : 85.0;
        double above = qm_random_below(random, 2) ? 0.0 : pow(10.0, qm_random_range(random, -12.0, most));
        for (int i = 0; i < 3; i++)
            place(axis, origin, qm_random_range(random, -1.0, 1.0), qm_random_range(random, -1.0, 1.0), 0.0,
                  pair.a[i]);
        for (int i = 0; i < 3; i++)
            place(axis, origin, 0.0, 0.0, above, pair.b[i]);
        pair.worth = 1.0 + above;
        measure(&pair);
        wide greatest = 0;
        for (int i = 0; i < 3; i++) {
            wide d[3];
            subtract(pair.a[i], pair.b[i], d);
            if (dot(d, d) > greatest) greatest = dot(d, d);
        }
        check_holds(&pair, pair.found.max, wide_root(greatest), "max");
        if (pair.found.measure == QM_OVER_AREA) {
            check_holds(&pair, pair.found.size, triangle_area((const double(*)[3])pair.a), "area");
            check_holds(&pair, pair.found.rms,
                        wide_root(mean_square_from((const double(*)[3])pair.a, pair.b[0])), "rms");
        }
        finish(&pair);
    }
}

/* ---- points ---- */

/** Points up to 1e12 sizes away from a bent patch; the twin in long double finds their footpoints. */
static void far_points_are_measured_to_patches(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 10000 : 200;
    print_message("seed %llu\n", (unsigned long long)qm_check_seed());
    for (uint64_t number = 0; number < count; number++) {
        qm_random random = qm_random_make(qm_check_seed(), 700000 + number);
        double corner[4][3], away = pow(10.0, qm_random_range(&random, -3.0, 12.0));
        for (int i = 0; i < 4; i++)
            qm_random_point(&random, -1.0, 1.0, corner[i]);
        qm_mesh a = qm_shape_make(3, 0), b = qm_shape_face(4, (const double(*)[3])corner);
        wide mean[2] = {0, 0};
        for (int i = 0; i < 3; i++) {
            double *position = a.positions + 3 * i;
            qm_random_direction(&random, position);
            for (int k = 0; k < 3; k++)
                position[k] *= away;
            qm_slow_bracket distance =
                qm_slow_distance(&b, QM_QUADS_BILINEAR, position, 1e-15 * (1.0 + away));
            mean[0] += (wide)distance.lower / 3;
            mean[1] += (wide)distance.upper / 3;
        }
        qm_context ctx = qm_context_make();
        qm_bvh *tree_a = NULL, *tree_b = NULL;
        assert_int_equal(qm_bvh_build(&ctx, &a, QM_BVH_ALL, 1, &tree_a), QM_OK);
        assert_int_equal(qm_bvh_build(&ctx, &b, QM_BVH_ALL, 1, &tree_b), QM_OK);
        qm_deviation_options options = qm_deviation_options_default();
        options.quads = QM_QUADS_BILINEAR;
        options.tolerance = 1e-3 * away;
        qm_deviation found;
        assert_int_equal(qm_deviation_measure(&ctx, tree_a, tree_b, &options, &found), QM_OK);
        assert_int_equal(found.measure, QM_OVER_POINTS);
        QM_CHECK((wide)found.mean.lower <= mean[1] && mean[0] <= (wide)found.mean.upper,
                 "seed %llu, number %llu: [%.20g, %.20g] against [%.20g, %.20g]",
                 (unsigned long long)qm_check_seed(), (unsigned long long)number, found.mean.lower,
                 found.mean.upper, (double)mean[0], (double)mean[1]);
        qm_deviation_reset(&ctx, &found);
        qm_bvh_destroy(&ctx, tree_a);
        qm_bvh_destroy(&ctx, tree_b);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(triangles_over_a_plane_are_exact),
        cmocka_unit_test(triangles_over_an_edge_are_exact),
        cmocka_unit_test(triangles_in_a_valley_are_exact),
        cmocka_unit_test(triangles_over_a_point_are_exact),
        cmocka_unit_test(far_points_are_measured_to_patches),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
