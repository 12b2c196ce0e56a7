/*
 * Proofs that a patch lies beyond a distance, against certified distances in 113 bits: none goes beyond the
 * truth, and most distances a little short of it are proven.
 */
#include "check.h"

#include "prim/bilinear.h"
#include "random.h"
#include "shapes.h"
#include "wide_surface.h"

#include <math.h>

#define UNIT 0x1p-53
#define PROMISE 60.0 /* u S: the roundings of a certified distance (rounding.h) */
#define SHORT 128.0  /* u S: how far short of the distance a proof is expected */

/** How a patch is drawn. */
typedef enum shape { ANY, FLAT, COLLAPSED, NEEDLE, PARALLEL, SHAPES } shape;

static void draw_patch(qm_random *random, shape kind, double corner[4][3])
{
    for (int i = 0; i < 4; i++)
        qm_random_point(random, -1, 1, corner[i]);
    double thin = pow(10, qm_random_range(random, -14, -1));
    for (int i = 0; i < 4 && kind == FLAT; i++)
        corner[i][2] *= thin;
    size_t at = qm_random_below(random, 4), other = (at + 1 + qm_random_below(random, 3)) % 4;
    for (int k = 0; k < 3; k++) {
        if (kind == COLLAPSED) corner[at][k] = corner[other][k] + thin * qm_random_range(random, -1, 1);
        /* Opposite sides that nearly add up to 0: a segment of the family is nearly a point. */
        if (kind == PARALLEL)
            corner[2][k] =
                corner[1][k] + (corner[0][k] - corner[3][k]) * 0.7 + thin * qm_random_range(random, -1, 1);
    }
    for (int i = 0; i < 4 && kind == NEEDLE; i++)
        for (int k = 1; k < 3; k++)
            corner[i][k] *= thin;
}

/** A point on the patch, near it, or far away. */
static void draw_point(qm_random *random, const double corner[4][3], double p[3])
{
    double reach = pow(10, qm_random_range(random, -12, 3)), off[3];
    double u = qm_random_range(random, 0, 1), v = qm_random_range(random, 0, 1);
    qm_random_direction(random, off);
    for (int k = 0; k < 3; k++)
        p[k] = (1 - u) * (1 - v) * corner[0][k] + u * (1 - v) * corner[1][k] + u * v * corner[2][k] +
               (1 - u) * v * corner[3][k] + reach * off[k];
}

static qm_wide_distance true_distance(const double corner[4][3], const double p[3])
{
    qm_mesh mesh = qm_shape_face(4, corner);
    qm_wide_frame frame = {.scale = 1};
    qm_wide_surface surface = qm_wide_surface_make(&frame, &mesh, QM_QUADS_BILINEAR);
    qm_wide_distance d = qm_wide_surface_distance(&surface, qm_wide_local(&frame, p), 0x1p-58L);
    qm_wide_surface_free(&surface);
    qm_shape_free(&mesh);
    return d;
}

static double greatest_coordinate(const double corner[4][3], const double p[3])
{
    double greatest = 0;
    for (int k = 0; k < 3; k++) {
        greatest = fmax(greatest, fabs(p[k]));
        for (int i = 0; i < 4; i++)
            greatest = fmax(greatest, fabs(corner[i][k]));
    }
    return greatest;
}

static void proofs_hold_up_to_the_distance(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 200000 : 4000, tried = 0, proven = 0;
    print_message("seed %llu\n", (unsigned long long)qm_check_seed());
    for (uint64_t number = 0; number < count; number++) {
        qm_random random = qm_random_make(qm_check_seed(), 840000 + number);
        shape kind = (shape)qm_random_below(&random, SHAPES);
        double corner[4][3], p[3];
        draw_patch(&random, kind, corner);
        draw_point(&random, (const double(*)[3])corner, p);
        const qm_vec c[4] = {qm_vec_load(corner[0]), qm_vec_load(corner[1]), qm_vec_load(corner[2]),
                             qm_vec_load(corner[3])};
        qm_bilinear patch = qm_bilinear_make(c);
        qm_wide_distance truth = true_distance((const double(*)[3])corner, p);
        double unit = UNIT * greatest_coordinate((const double(*)[3])corner, p);
        double upper = (double)truth.upper, lower = (double)truth.lower;
        for (int i = 0; i < 8; i++) {
            double above =
                upper + PROMISE * unit + (i ? upper * pow(10, qm_random_range(&random, -16, 0)) : 0);
            QM_CHECK(!qm_bilinear_is_beyond(&patch, qm_vec_load(p), above),
                     "seed %llu, case %llu, shape %d: beyond %.17g, is %.17g",
                     (unsigned long long)qm_check_seed(), (unsigned long long)number, kind, above, upper);
        }
        if (kind == NEEDLE || upper - lower > unit) continue;
        tried++;
        proven += qm_bilinear_is_beyond(&patch, qm_vec_load(p), lower - SHORT * unit);
    }
    QM_CHECK(tried > count / 2 && proven * 100 > tried * 95, "seed %llu: only %llu of %llu are proven",
             (unsigned long long)qm_check_seed(), (unsigned long long)proven, (unsigned long long)tried);
}

/** Rounds to so few digits that differences of coordinates, and sums of four of them, are exact. */
static void shorten(double p[3])
{
    for (int k = 0; k < 3; k++)
        p[k] = round(p[k] * 0x1p20) * 0x1p-20;
}

/**
 * Where no coordinate is rounded before a proof, its own margins have to cover all of its roundings: it never goes beyond
 * the distance, by however little. Half of the points are beside a side; others are over the patch, where a segment
 * between two is rounded, by less than u.
 */
static void exact_patches_leave_nothing_to_the_promise(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 100000 : 3000;
    for (uint64_t number = 0; number < count; number++) {
        qm_random random = qm_random_make(qm_check_seed(), 870000 + number);
        double corner[4][3], p[3], off[3], reach = pow(10, qm_random_range(&random, -2, 1));
        for (int i = 0; i < 4; i++) {
            qm_random_point(&random, -1, 1, corner[i]);
            shorten(corner[i]);
        }
        size_t side = qm_random_below(&random, 4), next = (side + 1) % 4, across = (side + 3) % 4;
        double u = qm_random_range(&random, 0.1, 0.9), beside = qm_random_range(&random, 0, 2);
        qm_random_direction(&random, off);
        for (int k = 0; k < 3; k++) {
            double on_side = corner[side][k] + u * (corner[next][k] - corner[side][k]);
            bool is_beside = number % 2;
            p[k] =
                on_side + (is_beside ? beside * (corner[side][k] - corner[across][k]) : 0.0) + reach * off[k];
        }
        shorten(p);
        const qm_vec c[4] = {qm_vec_load(corner[0]), qm_vec_load(corner[1]), qm_vec_load(corner[2]),
                             qm_vec_load(corner[3])};
        qm_bilinear patch = qm_bilinear_make(c);
        qm_wide_distance truth = true_distance((const double(*)[3])corner, p);
        double above = nextafter((double)truth.upper, INFINITY) + (number % 2 ? 0.0 : UNIT);
        QM_CHECK(!qm_bilinear_is_beyond(&patch, qm_vec_load(p), above),
                 "seed %llu, case %llu: beyond %.17g, is %.17Lg", (unsigned long long)qm_check_seed(),
                 (unsigned long long)number, above, (long double)truth.upper);
    }
}

/**
 * Parallelograms of few digits, and points straight over the middle of their segments: no coordinate is rounded, nor any
 * point of the segment that is nearest, and the distance is known. What cross products and their squares lose is covered by
 * their own margins alone; without both, one in four is proven an ulp beyond its distance. Each covers for the other here.
 */
static void cross_products_are_covered(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 1000000 : 20000;
    for (uint64_t number = 0; number < count; number++) {
        qm_random random = qm_random_make(qm_check_seed(), 900000 + number);
        double e[2][3], n[3], p[3], t = 0.5 + 0.25 * (double)(number % 2);
        for (int i = 0; i < 2; i++)
            for (int k = 0; k < 3; k++)
                e[i][k] = round(qm_random_range(&random, -1, 1) * 0x1p16) * 0x1p-16;
        double height = ldexp(1, -(int)qm_random_below(&random, 16));
        long double square = 0;
        for (int k = 0; k < 3; k++) {
            n[k] = e[0][(k + 1) % 3] * e[1][(k + 2) % 3] - e[0][(k + 2) % 3] * e[1][(k + 1) % 3];
            p[k] = 0.5 * e[0][k] + t * e[1][k] + height * n[k];
            square += (long double)n[k] * n[k];
        }
        if (!(square > 0)) continue;
        qm_vec zero = {0, 0, 0};
        const qm_bilinear patch = {zero, qm_vec_load(e[number / 2 % 2]), qm_vec_load(e[1 - number / 2 % 2]),
                                   zero};
        double above = nextafter((double)(height * sqrtl(square)), INFINITY);
        QM_CHECK(!qm_bilinear_is_beyond(&patch, qm_vec_load(p), above), "seed %llu, case %llu: beyond %.17g",
                 (unsigned long long)qm_check_seed(), (unsigned long long)number, above);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(proofs_hold_up_to_the_distance),
        cmocka_unit_test(cross_products_are_covered),
        cmocka_unit_test(exact_patches_leave_nothing_to_the_promise),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
