/* The least distance of two surfaces against that of all their faces, sampled. */
#include "check.h"
#include "core/vec.h"
#include "qm/distance.h"
#include "random.h"
#include "shapes.h"
#include "slow_twin.h"

static qm_distance measure_to(const qm_mesh *a, const qm_mesh *b, qm_quad_reading quads, double tolerance,
                              double limit)
{
    qm_context ctx = qm_context_make();
    qm_bvh *bvh_a, *bvh_b;
    qm_distance found;
    qm_distance_options options = {quads, tolerance, limit};
    assert_int_equal(qm_bvh_build(&ctx, a, QM_BVH_SOURCE, 1, &bvh_a), QM_OK);
    assert_int_equal(qm_bvh_build(&ctx, b, QM_BVH_SOURCE, 1, &bvh_b), QM_OK);
    assert_int_equal(qm_distance_measure(&ctx, bvh_a, bvh_b, &options, &found), QM_OK);
    qm_bvh_destroy(&ctx, bvh_a);
    qm_bvh_destroy(&ctx, bvh_b);
    return found;
}

static qm_distance measure(const qm_mesh *a, const qm_mesh *b, qm_quad_reading quads, double tolerance)
{
    return measure_to(a, b, quads, tolerance, NAN);
}

/** The returned points lie on their faces, and are as far apart as the upper bound says. */
static void check_witness(const qm_mesh *a, const qm_mesh *b, qm_quad_reading quads, const qm_distance *found,
                          unsigned run)
{
    double apart = qm_vec_distance(qm_vec_load(found->from.position), qm_vec_load(found->to.position));
    QM_CHECK(fabs(apart - found->upper) < 1e-10, "run %u: %g apart, upper %g", run, apart, found->upper);
    double at[3];
    qm_slow_position(a, found->from.face, quads, found->from.uv, at);
    QM_CHECK(qm_vec_distance(qm_vec_load(at), qm_vec_load(found->from.position)) < 1e-10, "run %u", run);
    qm_slow_position(b, found->to.face, quads, found->to.uv, at);
    QM_CHECK(qm_vec_distance(qm_vec_load(at), qm_vec_load(found->to.position)) < 1e-10, "run %u", run);
}

/** No sampled point of one surface is nearer to the other than the lower bound; vertices are samples. */
static void check_samples(const qm_mesh *a, const qm_mesh *b, qm_quad_reading quads, const qm_distance *found,
                          qm_random *random, unsigned run)
{
    enum { COUNT = 60 };
    double points[3 * COUNT];
    qm_slow_sample(a, quads, random, COUNT, points);
    for (int i = 0; i < COUNT; i++) {
        qm_slow_bracket slow = qm_slow_distance(b, quads, points + 3 * i, 1e-9);
        QM_CHECK(slow.upper >= found->lower, "run %u: %.17g is below %.17g", run, slow.upper, found->lower);
    }
}

static void bounds_hold(void **state)
{
    (void)state;
    for (unsigned run = 0; run < 72; run++) {
        qm_random random = qm_random_make(qm_check_seed(), run);
        qm_quad_reading quads = run % 2 ? QM_QUADS_BILINEAR : QM_QUADS_TRIANGLES;
        qm_soup_style style = (qm_soup_style)(run % QM_SOUP_STYLE_COUNT);
        qm_mesh a = qm_shape_soup(&random, 1 + qm_random_below(&random, 12), QM_SOUP_MIXED, style, 0.4),
                b = qm_shape_soup(&random, 1 + qm_random_below(&random, 12), QM_SOUP_MIXED, style, 0.4);
        double away[3];
        qm_random_direction(&random, away);
        for (int k = 0; k < 3; k++)
            away[k] *= run % 3 == 0 ? 0.5 : 4.0;
        qm_shape_move(&b, 1.0, away);
        double tolerance = run % 5 ? 1e-9 : 1e-3;
        qm_distance found = measure(&a, &b, quads, tolerance), turned = measure(&b, &a, quads, tolerance);
        /* Folded quads in parallel planes are equally far all over: that ends with what is known by then. */
        bool is_hard = style == QM_SOUP_COPLANAR && quads == QM_QUADS_BILINEAR;
        double gap = is_hard ? 0.01 : tolerance;
        QM_CHECK(found.is_converged == (found.upper - found.lower <= tolerance), "run %u", run);
        QM_CHECK(found.upper - found.lower <= gap, "run %u: %g to %g", run, found.lower, found.upper);
        QM_CHECK(found.lower <= turned.upper && turned.lower <= found.upper, "run %u: %g to %g, %g to %g",
                 run, found.lower, found.upper, turned.lower, turned.upper);
        check_witness(&a, &b, quads, &found, run);
        check_samples(&a, &b, quads, &found, &random, run);
        check_samples(&b, &a, quads, &found, &random, run);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

static void known_distances(void **state)
{
    (void)state;
    qm_mesh low = qm_shape_plane(20, 0.0), high = qm_shape_plane(33, 0.25), box = qm_shape_box(1, 1, 1);
    qm_distance found = measure(&low, &high, QM_QUADS_TRIANGLES, 1e-9);
    assert_true(found.lower <= 0.25 && found.upper >= 0.25 && found.is_converged);
    found = measure(&low, &box, QM_QUADS_TRIANGLES, 1e-9);
    assert_true(found.lower == 0.0 && found.upper == 0.0 && found.is_converged);
    /* Far away and much smaller: relative to the larger one the bounds stay as sharp. */
    qm_shape_move(&box, 1e-3, (const double[3]){1000, 0, 0});
    found = measure(&low, &box, QM_QUADS_BILINEAR, 1e-6);
    assert_true(found.lower <= 999.0 && found.upper >= 999.0 && found.is_converged);
    /* Tori in one another like links of a chain: 1 apart less both tubes, but for their facets. */
    qm_mesh torus = qm_shape_torus(64, 32, 2.0, 0.4), link = qm_shape_torus(64, 32, 2.0, 0.4);
    for (size_t i = 0; i < link.vertex_count; i++) {
        double *p = link.positions + 3 * i, y = p[1];
        p[1] = p[2];
        p[2] = y;
        p[0] += 2.0;
    }
    found = measure(&torus, &link, QM_QUADS_TRIANGLES, 1e-9);
    assert_true(found.lower > 2.0 - 0.8 - 0.01 && found.upper < 2.0 - 0.8 + 0.01);
    qm_shape_free(&low);
    qm_shape_free(&high);
    qm_shape_free(&box);
    qm_shape_free(&torus);
    qm_shape_free(&link);
}

/** With a limit the bounds hold, the verdict is right, and fewer pairs are measured. */
static void a_limit_ends_the_search(void **state)
{
    (void)state;
    uint64_t whole = 0, ended = 0; /* pairs in two searches without a limit, and with two */
    for (unsigned run = 0; run < 60; run++) {
        qm_random random = qm_random_make(qm_check_seed(), 500 + run);
        qm_quad_reading quads = run % 2 ? QM_QUADS_BILINEAR : QM_QUADS_TRIANGLES;
        qm_mesh a = qm_shape_soup(&random, 40, QM_SOUP_MIXED, QM_SOUP_APART, 0.2),
                b = qm_shape_soup(&random, 40, QM_SOUP_MIXED, QM_SOUP_APART, 0.2);
        const double away[3] = {run % 3 ? 3.0 : 0.0, 0.5, 0.0};
        qm_shape_move(&b, 1.0, away);
        qm_distance exact = measure(&a, &b, quads, 1e-9);
        whole += 2 * exact.pairs;
        static const double factors[] = {0.0, 0.5, 0.999, 1.001, 2.0, 1e300};
        for (size_t i = 0; i < sizeof factors / sizeof *factors; i++) {
            double limit = factors[i] * exact.upper;
            qm_distance found = measure_to(&a, &b, quads, 1e-9, limit);
            QM_CHECK(found.lower <= exact.upper && found.upper >= exact.lower, "run %u, limit %g", run,
                     limit);
            qm_verdict truth = exact.upper <= limit  ? QM_VERDICT_BELOW
                               : exact.lower > limit ? QM_VERDICT_ABOVE
                                                     : QM_VERDICT_OPEN;
            QM_CHECK(found.verdict == truth, "run %u, limit %g: %d", run, limit, found.verdict);
            if (i == 1 || i == 4) ended += found.pairs;
        }
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
    assert_true(ended < whole);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bounds_hold),
        cmocka_unit_test(known_distances),
        cmocka_unit_test(a_limit_ends_the_search),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
