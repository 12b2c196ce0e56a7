/*
 * Distances at a limit, decided without rounding: against distances in long double where these are certain, against known
 * ones where they are equal to the limit, and the same of whole surfaces.
 */
#include <math.h>
#include <string.h>

#include "check.h"
#include "prim/reach.h"
#include "qm/comparison.h"
#include "random.h"
#include "shapes.h"
#include "slow_twin.h"

/** Vectors of whole numbers with a whole length. */
static const double whole[][4] = {{1, 2, 2, 3},   {2, 3, 6, 7},   {1, 4, 8, 9},    {4, 4, 7, 9},
                                  {2, 6, 9, 11},  {6, 6, 7, 11},  {3, 4, 0, 5},    {0, 0, 1, 1},
                                  {2, 5, 14, 15}, {8, 9, 12, 17}, {1, 12, 12, 17}, {0, 5, 12, 13}};
enum { WHOLE = sizeof whole / sizeof whole[0] };

static double below(double x)
{
    return nextafter(x, 0.0);
}

/* ---- points and triangles ---- */

/** One of these vectors, turned by a random change of axes and signs. */
static double pick_whole(qm_random *random, double out[3])
{
    const double *row = whole[qm_random_below(random, WHOLE)];
    size_t first = qm_random_below(random, 3), step = 1 + qm_random_below(random, 2);
    for (size_t k = 0; k < 3; k++)
        out[k] = row[(first + step * k) % 3] * (qm_random_below(random, 2) ? 1.0 : -1.0);
    return row[3];
}

static void cross(const double a[3], const double b[3], double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

/** A point at a whole distance from the inside, an edge or a corner of a triangle, at a random size and place. */
static void check_tie(uint64_t seed, uint64_t stream)
{
    qm_random random = qm_random_make(seed, stream);
    double way[3], side[3], other[3], seed_side[3], corner[3][3], p[3];
    double length = pick_whole(&random, way), size = ldexp(1.0, (int)qm_random_below(&random, 300) - 150);
    do {
        for (int k = 0; k < 3; k++)
            seed_side[k] = (double)qm_random_below(&random, 7) - 3.0;
        cross(way, seed_side, side);
    } while (side[0] == 0.0 && side[1] == 0.0 && side[2] == 0.0);
    cross(way, side, other);
    size_t feature = qm_random_below(&random, 3), turn = qm_random_below(&random, 3);
    double shift = (double)qm_random_below(&random, 1000);
    for (int k = 0; k < 3; k++) {
        /* The foot is the origin: the middle, the middle of an edge, or a corner. */
        const double at[3][3] = {{-side[k] - other[k], 2 * side[k] - other[k], 2 * other[k] - side[k]},
                                 {-side[k], side[k], other[k] - way[k]},
                                 {0.0, side[k] - way[k], -side[k] - 2 * way[k]}};
        for (size_t i = 0; i < 3; i++)
            corner[(i + turn) % 3][k] = size * (shift + at[feature][i]);
        p[k] = size * (shift + way[k]);
    }
    const double *const corners[3] = {corner[0], corner[1], corner[2]};
    double limit = size * length;
    QM_CHECK(qm_reach_triangle(p, corners, limit) && !qm_reach_triangle(p, corners, below(limit)),
             "seed %llu, stream %llu: feature %zu", (unsigned long long)seed, (unsigned long long)stream,
             feature);
    const double foot[3] = {size * shift, size * shift, size * shift};
    assert_true(qm_reach_point(p, foot, limit) && !qm_reach_point(p, foot, below(limit)));
}

static void ties_are_within(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 1000000 : 20000, seed = qm_check_seed();
    print_message("seed %llu\n", (unsigned long long)seed);
    for (uint64_t i = 0; i < count; i++)
        check_tie(seed, 8000000 + i);
}

static void random_triangles_agree_with_their_distance(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 1000000 : 20000, seed = qm_check_seed();
    print_message("seed %llu\n", (unsigned long long)seed);
    for (uint64_t i = 0; i < count; i++) {
        qm_random random = qm_random_make(seed, 9000000 + i);
        double corner[3][3], p[3];
        bool is_lattice = i % 2;
        for (int c = 0; c < 4; c++)
            for (int k = 0; k < 3; k++)
                (c < 3 ? corner[c] : p)[k] =
                    is_lattice ? (double)qm_random_below(&random, 4) : qm_random_range(&random, -1, 1);
        const double *const corners[3] = {corner[0], corner[1], corner[2]};
        double distance = qm_slow_triangle_distance(p, corner[0], corner[1], corner[2]);
        double off = 1e-12 * fmax(1.0, distance);
        QM_CHECK(qm_reach_triangle(p, corners, distance + off), "seed %llu, stream %llu",
                 (unsigned long long)seed, (unsigned long long)i);
        QM_CHECK(distance <= off || !qm_reach_triangle(p, corners, distance - off), "seed %llu, stream %llu",
                 (unsigned long long)seed, (unsigned long long)i);
        /* A point of the triangle is at no distance; one that is beside it by the last bit is not. */
        assert_true(qm_reach_triangle(corner[i % 3], corners, 0.0));
        if (distance > off) assert_false(qm_reach_triangle(p, corners, 0.0));
    }
}

static void degenerate_triangles_are_segments_and_points(void **state)
{
    (void)state;
    const double a[3] = {0, 0, 0}, b[3] = {4, 0, 0}, c[3] = {8, 0, 0}, p[3] = {6, 3, 4}, q[3] = {11, 4, 0};
    const double *const segment[3] = {a, b, c}, *const point[3] = {a, a, a}, *const doubled[3] = {a, c, a};
    assert_true(qm_reach_triangle(p, segment, 5.0) && !qm_reach_triangle(p, segment, below(5.0)));
    assert_true(qm_reach_triangle(q, segment, 5.0) && !qm_reach_triangle(q, segment, below(5.0)));
    assert_true(qm_reach_triangle(p, doubled, 5.0) && !qm_reach_triangle(p, doubled, below(5.0)));
    const double r[3] = {3, 4, 0};
    assert_true(qm_reach_triangle(r, point, 5.0) && !qm_reach_triangle(r, point, below(5.0)));
    /* Too far apart in size to be decided: never "within" by mistake. */
    const double tiny[3] = {0x1p-1000, 0, 0}, huge[3] = {0x1p200, 0, 0};
    assert_false(qm_reach_point(huge, tiny, 1.0));
    assert_true(qm_reach_point(tiny, tiny, 0.0));
}

static void parallelograms_are_flat(void **state)
{
    (void)state;
    const double a[3] = {0, 0, 0}, b[3] = {1, 0, 0.1}, c[3] = {1, 1, 0.1}, d[3] = {0, 1, 0},
                 e[3] = {0, 1, 0x1p-60};
    assert_true(qm_reach_is_flat((const double *const[]){a, b, c, d}));
    assert_false(qm_reach_is_flat((const double *const[]){a, b, c, e}));
    assert_false(qm_reach_is_flat((const double *const[]){a, c, b, d}));
}

/* ---- surfaces ---- */

static qm_hausdorff_result measure(const qm_mesh *a, const qm_mesh *b, qm_quad_reading reading, double limit)
{
    qm_context ctx = qm_context_make();
    qm_bvh *tree[2];
    assert_int_equal(qm_bvh_build(&ctx, a, QM_BVH_ALL, 1, &tree[0]), QM_OK);
    assert_int_equal(qm_bvh_build(&ctx, b, QM_BVH_ALL, 1, &tree[1]), QM_OK);
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.quads = reading;
    options.tolerance = 1e-300;
    options.threshold = limit;
    qm_hausdorff_result found;
    assert_int_equal(qm_hausdorff_measure(&ctx, tree[0], tree[1], &options, &found), QM_OK);
    qm_bvh_destroy(&ctx, tree[0]);
    qm_bvh_destroy(&ctx, tree[1]);
    return found;
}

static void faces_in_another_order_are_the_same_surface(void **state)
{
    (void)state;
    static const qm_soup_style styles[] = {QM_SOUP_APART, QM_SOUP_NEEDLES, QM_SOUP_POOLED};
    uint64_t count = qm_check_long() ? 4000 : 200, seed = qm_check_seed();
    print_message("seed %llu\n", (unsigned long long)seed);
    for (uint64_t i = 0; i < count; i++) {
        qm_random random = qm_random_make(seed, 9500000 + i);
        qm_soup_style style = styles[qm_random_below(&random, 3)];
        size_t faces = 1 + qm_random_below(&random, 20);
        qm_mesh a = i % 5 == 4 ? qm_shape_points(&random, 20)
                               : qm_shape_soup(&random, faces, QM_SOUP_MIXED, style, 0.5);
        qm_mesh b = qm_shape_reversed(&a);
        /* Beside a patch of the pool, or a needle, the facet that is nearest may be another one, and no proof. */
        for (int reading = 0; reading < (style == QM_SOUP_APART ? 2 : 1); reading++) {
            qm_hausdorff_result found = measure(&a, &b, (qm_quad_reading)reading, 0.0);
            QM_CHECK(found.verdict == QM_VERDICT_BELOW && found.lower == 0.0 && found.upper == 0.0,
                     "stream %llu, style %d, reading %d, %zu faces: [%g, %g]", (unsigned long long)i, style,
                     reading, a.face_count, found.lower, found.upper);
        }
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

/** Where a face is moved by the last bit, there is no proof. */
static void moved_faces_are_not_within(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 4000 : 200, seed = qm_check_seed();
    print_message("seed %llu\n", (unsigned long long)seed);
    for (uint64_t i = 0; i < count; i++) {
        qm_random random = qm_random_make(seed, 9600000 + i);
        qm_mesh a =
            qm_shape_soup(&random, 1 + qm_random_below(&random, 10), QM_SOUP_TRIANGLES, QM_SOUP_APART, 0.5);
        qm_mesh b = qm_shape_reversed(&a);
        const uint32_t *face = a.faces + 4 * qm_random_below(&random, a.face_count);
        double *moved =
            &a.positions[3 * (size_t)face[qm_random_below(&random, 3)] + qm_random_below(&random, 3)];
        *moved = nextafter(*moved, qm_random_below(&random, 2) ? 9.0 : -9.0);
        qm_hausdorff_result found = measure(&a, &b, QM_QUADS_TRIANGLES, 0.0);
        QM_CHECK(found.verdict != QM_VERDICT_BELOW && found.upper > 0.0, "stream %llu",
                 (unsigned long long)i);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

/** Along the normal, so that nothing is nearer. */
static void shifted_surfaces_are_at_their_limit(void **state)
{
    (void)state;
    for (int shape = 0; shape < 2; shape++)
        for (int reading = 0; reading < 2; reading++)
            for (int i = 0; i < 40; i++) {
                qm_mesh a = shape == 0 ? qm_shape_plane(4, 0.25) : qm_shape_box(1, 2, 0);
                qm_mesh b = qm_shape_copy(&a);
                const double up[3] = {0, 0, ldexp(1 + i % 7, i / 2 - 12)};
                qm_shape_move(&b, 1.0, up);
                qm_hausdorff_result at = measure(&a, &b, (qm_quad_reading)reading, up[2]);
                qm_hausdorff_result under = measure(&a, &b, (qm_quad_reading)reading, below(up[2]));
                QM_CHECK(at.verdict == QM_VERDICT_BELOW && at.upper <= up[2] && at.lower <= at.upper,
                         "shape %d: [%.17g, %.17g]", shape, at.lower, at.upper);
                QM_CHECK(under.verdict != QM_VERDICT_BELOW, "shape %d: %.17g", shape, up[2]);
                qm_shape_free(&a);
                qm_shape_free(&b);
            }
}

/** The figures of a comparison at the limit are exact too. */
static void shares_at_the_distance_are_exact(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_plane(4, 0.0), b = qm_shape_plane(4, 0.75);
    const double limits[] = {0.75, 0.5};
    qm_context ctx = qm_context_make();
    qm_bvh *tree[2];
    assert_int_equal(qm_bvh_build(&ctx, &a, QM_BVH_ALL, 1, &tree[0]), QM_OK);
    assert_int_equal(qm_bvh_build(&ctx, &b, QM_BVH_ALL, 1, &tree[1]), QM_OK);
    for (int reading = 0; reading < 2; reading++) {
        qm_comparison_options options = qm_deviation_options_default();
        options.quads = (qm_quad_reading)reading;
        options.tolerance = 1e-9;
        options.limit = limits;
        options.limit_count = 2;
        qm_comparison found;
        assert_int_equal(qm_comparison_measure(&ctx, tree[0], tree[1], &options, NULL, &found), QM_OK);
        assert_true(found.f_score[0].f.lower == 1.0 && found.f_score[0].f.upper == 1.0);
        assert_true(found.f_score[1].f.lower == 0.0 && found.f_score[1].f.upper == 0.0);
        assert_true(found.hausdorff.upper == 0.75 && found.mean.upper == 0.75);
        qm_comparison_reset(&ctx, &found);
    }
    qm_bvh_destroy(&ctx, tree[0]);
    qm_bvh_destroy(&ctx, tree[1]);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ties_are_within),
        cmocka_unit_test(random_triangles_agree_with_their_distance),
        cmocka_unit_test(degenerate_triangles_are_segments_and_points),
        cmocka_unit_test(parallelograms_are_flat),
        cmocka_unit_test(faces_in_another_order_are_the_same_surface),
        cmocka_unit_test(moved_faces_are_not_within),
        cmocka_unit_test(shifted_surfaces_are_at_their_limit),
        cmocka_unit_test(shares_at_the_distance_are_exact),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
