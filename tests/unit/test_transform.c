/* Transforms: what is refused, and the roundings of moved positions against extended precision. */
#include "check.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "qm/transform.h"
#include "random.h"
#include "shapes.h"

static const double identity[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

static void transforms_that_move_nothing_well_are_refused(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    double m[16];
    memcpy(m, identity, sizeof m);
    assert_int_equal(qm_transform_check(&ctx, m), QM_OK);
    for (int i = 0; i < 16; i++) {
        const double bad[] = {NAN, INFINITY, -INFINITY};
        for (int k = 0; k < 3; k++) {
            memcpy(m, identity, sizeof m);
            m[i] = bad[k];
            char place[24];
            snprintf(place, sizeof place, "number %d ", i);
            assert_int_equal(qm_transform_check(&ctx, m), QM_E_NOT_FINITE);
            assert_non_null(strstr(ctx.message, place));
        }
    }
    for (int k = 0; k < 4; k++) {
        memcpy(m, identity, sizeof m);
        m[4 * k + 3] += 1e-9;
        assert_int_equal(qm_transform_check(&ctx, m), QM_E_ARGUMENT);
        assert_non_null(strstr(ctx.message, "last row"));
    }
    for (int k = 0; k < 3; k++) { /* a column of 0, two equal ones, one in the plane of the others */
        memcpy(m, identity, sizeof m);
        m[5 * k] = 0.0;
        assert_int_equal(qm_transform_check(&ctx, m), QM_E_ARGUMENT);
        memcpy(m, identity, sizeof m);
        memcpy(m + 4 * k, m + 4 * ((k + 1) % 3), 3 * sizeof *m);
        assert_int_equal(qm_transform_check(&ctx, m), QM_E_ARGUMENT);
        assert_non_null(strstr(ctx.message, "singular"));
    }
}

static void any_size_of_a_transform_is_taken(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    for (int power = -300; power <= 300; power += 50) {
        double m[16];
        memcpy(m, identity, sizeof m);
        for (int k = 0; k < 3; k++)
            m[5 * k] = pow(10.0, power);
        assert_int_equal(qm_transform_check(&ctx, m), QM_OK);
        assert_false(qm_transform_mirrors(m));
        m[10] = -m[10];
        assert_true(qm_transform_mirrors(m));
    }
}

static void moved_positions_are_within_the_stated_rounding(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    for (uint64_t i = 0; i < 200; i++) {
        qm_random random = qm_random_make(qm_check_seed(), i);
        qm_mesh mesh = qm_shape_points(&random, 50), moved = qm_shape_copy(&mesh);
        double m[16], size = pow(10.0, qm_random_range(&random, -30.0, 30.0));
        memcpy(m, identity, sizeof m);
        for (int k = 0; k < 4; k++)
            for (int r = 0; r < 3; r++)
                m[4 * k + r] = qm_random_range(&random, -1.0, 1.0) * (k == 3 ? size : 1.0);
        assert_int_equal(qm_transform_positions(&ctx, m, &mesh, moved.positions), QM_OK);
        for (size_t v = 0; v < mesh.vertex_count; v++)
            for (int r = 0; r < 3; r++) {
                const double *p = mesh.positions + 3 * v;
                const long double term[4] = {(long double)m[r] * p[0], (long double)m[4 + r] * p[1],
                                             (long double)m[8 + r] * p[2], m[12 + r]};
                long double sum = 0.0L, most = 0.0L;
                for (int k = 0; k < 4; k++) {
                    sum += term[k];
                    most = fmaxl(most, fabsl(term[k]));
                }
                QM_CHECK(fabsl(sum - moved.positions[3 * v + (size_t)r]) <= 0x1p-49L * most, "case %llu",
                         (unsigned long long)i);
            }
        qm_shape_free(&moved);
        qm_shape_free(&mesh);
    }
}

/** The true surface moves by the exact map, the mesh by the rounded one: no two points get farther apart than the change says. */
static void distances_change_by_what_is_told(void **state)
{
    (void)state;
    for (uint64_t round = 0; round < 3000; round++) {
        qm_random random = qm_random_make(20261126, round); /* the seed */
        double m[16], from[6], to[3];
        memcpy(m, identity, sizeof m);
        const double scale = pow(10.0, qm_random_range(&random, -8.0, 8.0));
        const double shift = scale * pow(10.0, qm_random_range(&random, -3.0, 9.0));
        for (int k = 0; k < 3; k++) {
            for (int i = 0; i < 3; i++)
                m[4 * k + i] = scale * qm_random_range(&random, -1.0, 1.0);
            m[12 + k] = shift * qm_random_range(&random, -1.0, 1.0);
        }
        const double apart = pow(10.0, qm_random_range(&random, -12.0, 0.0));
        for (int k = 0; k < 3; k++) {
            from[k] = qm_random_range(&random, -1.0, 1.0);
            from[3 + k] = from[k] + apart * qm_random_range(&random, -1.0, 1.0);
        }
        const qm_mesh mesh = {.vertex_count = 1, .positions = from};
        qm_context ctx = qm_context_make();
        const qm_transform_change change = qm_transform_find_change(m, &mesh);
        assert_int_equal(qm_transform_positions(&ctx, m, &mesh, to), QM_OK);
        long double before = 0, after = 0, frobenius = 0;
        for (int k = 0; k < 3; k++) {
            long double image = m[12 + k];
            for (int i = 0; i < 3; i++)
                image += (long double)m[4 * i + k] * from[3 + i];
            after += (image - to[k]) * (image - to[k]);
            before += ((long double)from[3 + k] - from[k]) * ((long double)from[3 + k] - from[k]);
            for (int i = 0; i < 3; i++)
                frobenius += (long double)m[4 * i + k] * m[4 * i + k];
        }
        QM_CHECK(sqrtl(after) <= change.norm * sqrtl(before) + change.rounding, "case %llu of seed 20261126",
                 (unsigned long long)round);
        assert_true(change.norm <= sqrtl(3 * frobenius) * (1 + 1e-12L));
    }
    /* A turn with a scale changes all distances alike, and the bound is as good as equal. */
    const double angle = 0.7, turn[16] = {3 * cos(angle),
                                          3 * sin(angle),
                                          0,
                                          0,
                                          -3 * sin(angle),
                                          3 * cos(angle),
                                          0,
                                          0,
                                          0,
                                          0,
                                          3,
                                          0,
                                          0,
                                          0,
                                          0,
                                          1};
    const double corner[3] = {1, 2, 3};
    const qm_mesh mesh = {.vertex_count = 1, .positions = (double *)corner};
    const qm_transform_change change = qm_transform_find_change(turn, &mesh);
    assert_true(change.norm >= 3.0 && change.norm <= 3.0 + 1e-13);
    assert_true(change.rounding > 0.0 && change.rounding < 1e-13);
}

/** The exact image of a point under one row of a map, and the largest of its terms. */
static long double exact_image(const double row[4], const double point[3], long double *most)
{
    long double image = row[3];
    *most = fabsl(image);
    for (int k = 0; k < 3; k++) {
        const long double term = (long double)row[k] * point[k];
        image += term;
        *most = fmaxl(*most, fabsl(term));
    }
    return image;
}

/** Terms just above 1, of which each sum is just above 2, 3 and 4, where roundings are the largest for the sizes of the terms: of many
 * rows those that are rounded the most, one for each coordinate of one point. */
static void roundings_of_all_coordinates_may_add_up(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    long double worst = 0.0L;
    for (uint64_t round = 0; round < 8; round++) {
        qm_random random = qm_random_make(qm_check_seed(), 30000 + round);
        double m[16], point[3], to[3];
        long double off[3] = {0.0L, 0.0L, 0.0L};
        memcpy(m, identity, sizeof m);
        for (int k = 0; k < 3; k++)
            point[k] = qm_random_range(&random, 1.0, 1.0 + 0x1p-10);
        const qm_mesh mesh = {.vertex_count = 1, .positions = point};
        for (int attempt = 0; attempt < 4000; attempt++) {
            double row[4], moved[3], map[16];
            memcpy(map, identity, sizeof map);
            for (int k = 0; k < 4; k++)
                map[4 * k] = row[k] = qm_random_range(&random, 1.0, 1.0 + 0x1p-10);
            assert_int_equal(qm_transform_positions(&ctx, map, &mesh, moved), QM_OK);
            long double most, error = fabsl(exact_image(row, point, &most) - moved[0]);
            QM_CHECK(error <= 0x1p-49L * most, "seed %llu round %llu", (unsigned long long)qm_check_seed(),
                     (unsigned long long)round);
            const int r = attempt % 3;
            if (error <= off[r]) continue;
            off[r] = error;
            for (int k = 0; k < 4; k++)
                m[4 * k + r] = row[k];
        }
        const qm_transform_change change = qm_transform_find_change(m, &mesh);
        assert_int_equal(qm_transform_positions(&ctx, m, &mesh, to), QM_OK);
        long double square = 0.0L;
        for (int r = 0; r < 3; r++) {
            const double row[4] = {m[r], m[4 + r], m[8 + r], m[12 + r]};
            long double most, error = exact_image(row, point, &most) - to[r];
            square += error * error;
        }
        const long double moved_off = sqrtl(square);
        QM_CHECK(moved_off <= change.rounding, "seed %llu round %llu: off by %Lg, told %g",
                 (unsigned long long)qm_check_seed(), (unsigned long long)round, moved_off, change.rounding);
        worst = fmaxl(worst, moved_off / change.rounding);
    }
    QM_CHECK(worst > 0.5L, "the worst found is %Lg of what is told", worst);
}

static void the_identity_keeps_every_bit(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    double positions[6] = {-0.0, 1e-310, 1e300, -1.5, 0.0, 3.0}, moved[6];
    qm_mesh mesh = {.positions = positions, .vertex_count = 2};
    double m[16];
    qm_transform_identity(m);
    assert_int_equal(qm_transform_positions(&ctx, m, &mesh, moved), QM_OK);
    assert_memory_equal(moved, positions, sizeof moved);
}

static void a_vertex_that_overflows_is_named(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    double positions[6] = {0.0, 0.0, 0.0, 1e200, 0.0, 0.0}, moved[6], m[16];
    qm_mesh mesh = {.positions = positions, .vertex_count = 2};
    qm_transform_identity(m);
    m[0] = 1e200;
    assert_int_equal(qm_transform_positions(&ctx, m, &mesh, moved), QM_E_NOT_FINITE);
    assert_non_null(strstr(ctx.message, "vertex 1 "));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(transforms_that_move_nothing_well_are_refused),
        cmocka_unit_test(any_size_of_a_transform_is_taken),
        cmocka_unit_test(moved_positions_are_within_the_stated_rounding),
        cmocka_unit_test(distances_change_by_what_is_told),
        cmocka_unit_test(roundings_of_all_coordinates_may_add_up),
        cmocka_unit_test(the_identity_keeps_every_bit),
        cmocka_unit_test(a_vertex_that_overflows_is_named),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
