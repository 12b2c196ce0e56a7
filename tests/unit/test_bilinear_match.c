/* Matches of bilinear patches: whatever they say is covered lies within the distance, measured by the slow
 * twin; patches that nearly coincide are covered whole, folded ones too, however their parameters run. */
#include "check.h"
#include "prim/bilinear_match.h"
#include "random.h"
#include "slow_twin.h"

enum { TRIES = 3000, NOISY_TRIES = 600, SAMPLES = 24, MAX_REST = 4096 };

typedef struct rest_list {
    int count;
    qm_uv_box at[MAX_REST];
} rest_list;

static void keep_rest(void *user, const qm_uv_box *rest)
{
    rest_list *list = user;
    assert_true(list->count < MAX_REST);
    list->at[list->count++] = *rest;
}

static bool is_left_over(const rest_list *list, double s, double t)
{
    for (int i = 0; i < list->count; i++) {
        const qm_uv_box *box = &list->at[i];
        if (s >= box->low[0] && s <= box->high[0] && t >= box->low[1] && t <= box->high[1]) return true;
    }
    return false;
}

static qm_vec random_vec(qm_random *random, double size)
{
    return (qm_vec){size * qm_random_range(random, -1, 1), size * qm_random_range(random, -1, 1),
                    size * qm_random_range(random, -1, 1)};
}

/** Corners of a patch: wild, folded over, flat, nearly a segment. */
static void random_corners(qm_random *random, qm_vec corner[4])
{
    int kind = (int)qm_random_below(random, 4);
    for (int i = 0; i < 4; i++)
        corner[i] = random_vec(random, 1.0);
    if (kind == 1) corner[2] = qm_vec_add(corner[3], random_vec(random, 0.3));
    for (int i = 0; i < 4 && kind == 2; i++)
        corner[i].z = 0.0;
    for (int i = 0; i < 4 && kind == 3; i++)
        corner[i] = qm_vec_axpy(random_vec(random, 1e-3), qm_random_range(random, -1, 1), corner[0]);
}

static double slow_distance(const qm_vec corner[4], qm_vec p)
{
    double c[4][3], at[3];
    for (int i = 0; i < 4; i++)
        qm_vec_store(c[i], corner[i]);
    qm_vec_store(at, p);
    return qm_slow_patch_distance(at, c, 1e-13).lower;
}

/** Points of the box that are not left over lie within the distance of the target. */
static void check_covered(const qm_bilinear *source, const qm_uv_box *box, const qm_vec target[4],
                          double cutoff, const rest_list *rest, qm_random *random)
{
    for (int k = 0; k < SAMPLES; k++) {
        double s = qm_random_range(random, box->low[0], box->high[0]);
        double t = qm_random_range(random, box->low[1], box->high[1]);
        if (is_left_over(rest, s, t)) continue;
        double distance = slow_distance(target, qm_bilinear_at(source, s, t));
        QM_CHECK(distance <= cutoff * (1.0 + 1e-9) + 1e-14, "(%.17g, %.17g) is %.17g away, cutoff %.17g", s,
                 t, distance, cutoff);
    }
}

static void covered_points_are_near(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 100);
    int covered = 0;
    for (int k = 0; k < TRIES; k++) {
        qm_vec from[4], to[4];
        random_corners(&random, from);
        random_corners(&random, to);
        double noise = pow(10.0, qm_random_range(&random, -6, 0));
        for (int i = 0; i < 4 && k % 4 > 0; i++)
            to[i] = qm_vec_add(from[i], random_vec(&random, noise));
        qm_bilinear source = qm_bilinear_make(from), target = qm_bilinear_make(to);
        qm_uv_box box;
        for (int axis = 0; axis < 2; axis++) {
            double a = qm_random_range(&random, 0, 1), b = qm_random_range(&random, 0, 1);
            box.low[axis] = k % 3 ? fmin(a, b) : 0.0;
            box.high[axis] = k % 3 ? fmax(a, b) : 1.0;
        }
        const double middle[2] = {qm_random_range(&random, 0, 1), qm_random_range(&random, 0, 1)};
        double cutoff = noise * qm_random_range(&random, 0.3, 2.0);
        rest_list rest = {0};
        if (!qm_bilinear_match(&source, &box, &target, middle, cutoff, keep_rest, &rest)) continue;
        covered++;
        check_covered(&source, &box, to, cutoff, &rest, &random);
    }
    assert_true(covered > TRIES / 4);
}

/** Products of four sides of the target vanish, and so do the determinants of its matches: a corner at the
 * target says nothing of the other three. */
static void points_are_not_covered_by_a_speck(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 500);
    const qm_uv_box square = {{0.0, 0.0}, {1.0, 1.0}};
    const double middle[2] = {0.5, 0.5};
    for (int k = 0; k < TRIES; k++) {
        double size = pow(10.0, qm_random_range(&random, -320, -60)), farthest = 0.0;
        qm_vec from[4], to[4];
        for (int i = 0; i < 4; i++) {
            from[i] = random_vec(&random, 1.0);
            to[i] = random_vec(&random, size);
        }
        from[k % 4] = to[0];
        for (int i = 0; i < 4; i++)
            farthest = fmax(farthest, qm_vec_norm(from[i]));
        qm_bilinear source = qm_bilinear_make(from), target = qm_bilinear_make(to);
        double cutoff = farthest * qm_random_range(&random, 0.5, 1.0);
        for (int alike = 0; alike < 2; alike++) {
            rest_list rest = {0};
            bool is_covered =
                alike ? qm_bilinear_match_coincident(&source, &square, &target, cutoff, keep_rest, &rest)
                      : qm_bilinear_match(&source, &square, &target, middle, cutoff, keep_rest, &rest);
            QM_CHECK(!is_covered || rest.count > 0, "a corner %.17g away is covered for %.17g, size %.3g",
                     farthest, cutoff, size);
            if (is_covered) check_covered(&source, &square, to, cutoff, &rest, &random);
        }
    }
}

/** The target is the source with its corners turned or mirrored, and a little noise. */
static void near_copies_are_covered_however_they_are_turned(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 200);
    const qm_uv_box square = {{0.0, 0.0}, {1.0, 1.0}};
    for (int k = 0; k < TRIES; k++) {
        qm_vec from[4], to[4];
        random_corners(&random, from);
        double noise = pow(10.0, qm_random_range(&random, -14, -2));
        for (int i = 0; i < 4; i++)
            to[(k & 4 ? 7 - i : i + k) % 4] = qm_vec_add(from[i], random_vec(&random, noise));
        qm_bilinear source = qm_bilinear_make(from), target = qm_bilinear_make(to);
        const double middle[2] = {0.5, 0.5};
        rest_list rest = {0};
        assert_true(
            qm_bilinear_match(&source, &square, &target, middle, 2.0 * noise + 1e-14, keep_rest, &rest));
        assert_int_equal(rest.count, 0);
    }
}

/** Parts of patches that are alike: all of a part is covered where the corners' differences allow it, what is
 * covered is near in any case, and patches that are not alike are refused. */
static void parts_of_patches_that_are_alike(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 400);
    int partly = 0;
    for (int k = 0; k < TRIES; k++) {
        qm_vec from[4], to[4];
        random_corners(&random, from);
        double noise = pow(10.0, qm_random_range(&random, -12, -2)), most = 0;
        for (int i = 0; i < 4; i++) {
            qm_vec moved = random_vec(&random, noise);
            most = fmax(most, qm_vec_norm(moved));
            to[(k & 4 ? 7 - i : i + k) % 4] = qm_vec_add(from[i], moved);
        }
        qm_bilinear source = qm_bilinear_make(from), target = qm_bilinear_make(to);
        qm_uv_box box;
        for (int axis = 0; axis < 2; axis++) {
            double a = qm_random_range(&random, 0, 1), b = qm_random_range(&random, 0, 1);
            box.low[axis] = fmin(a, b);
            box.high[axis] = fmax(a, b);
        }
        rest_list rest = {0};
        assert_true(qm_bilinear_match_coincident(&source, &box, &target, 1.001 * most, keep_rest, &rest));
        assert_int_equal(rest.count, 0);
        double cutoff = most * qm_random_range(&random, 0.5, 1.0);
        if (qm_bilinear_match_coincident(&source, &box, &target, cutoff, keep_rest, &rest))
            check_covered(&source, &box, to, cutoff, &rest, &random);
        partly += rest.count > 0;
        to[k % 4] = qm_vec_add(to[k % 4], (qm_vec){5, 0, 0});
        target = qm_bilinear_make(to);
        assert_false(qm_bilinear_match_coincident(&source, &box, &target, 0.1, keep_rest, &rest));
    }
    assert_true(partly > TRIES / 50);
}

/** The source is a larger piece of the surface that the target is a part of: what lies over the target is
 * covered. */
static void what_lies_over_a_part_is_covered(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 300);
    int whole = 0;
    for (int k = 0; k < TRIES; k++) {
        qm_vec from[4], to[4];
        random_corners(&random, from);
        qm_bilinear source = qm_bilinear_make(from);
        double low[2], high[2];
        for (int axis = 0; axis < 2; axis++) {
            low[axis] = qm_random_range(&random, 0.1, 0.4);
            high[axis] = qm_random_range(&random, 0.6, 0.9);
        }
        const qm_uv_box part = {{low[0], low[1]}, {high[0], high[1]}}, square = {{0.0, 0.0}, {1.0, 1.0}};
        qm_uv_box_corners(&source, &part, to);
        qm_bilinear target = qm_bilinear_make(to);
        const double middle[2] = {(0.5 - low[0]) / (high[0] - low[0]), (0.5 - low[1]) / (high[1] - low[1])};
        rest_list rest = {0};
        if (!qm_bilinear_match(&source, &square, &target, middle, 1e-9, keep_rest, &rest)) continue;
        check_covered(&source, &square, to, 1e-9, &rest, &random);
        whole += rest.count <= 4;
    }
    assert_true(whole > TRIES * 9 / 10);
}

/** The same with noise: the target continued is several times the noise from the source at the source's corners, and so
 * beyond the cutoff; what lies over the target is within it. */
static void what_lies_over_a_noisy_part_is_covered(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 600);
    int whole = 0;
    for (int k = 0; k < NOISY_TRIES; k++) {
        qm_vec from[4], to[4];
        random_corners(&random, from);
        qm_bilinear source = qm_bilinear_make(from);
        double low[2] = {0, 0}, high[2] = {1, 1}, noise = pow(10.0, qm_random_range(&random, -9, -5));
        for (int axis = 0; axis < 2; axis++) {
            if (k % 3 == axis) continue;
            low[axis] = qm_random_range(&random, 0.1, 0.4);
            high[axis] = low[axis] + qm_random_range(&random, 0.15, 0.3);
        }
        const qm_uv_box part = {{low[0], low[1]}, {high[0], high[1]}}, square = {{0.0, 0.0}, {1.0, 1.0}};
        qm_uv_box_corners(&source, &part, to);
        for (int i = 0; i < 4; i++)
            to[i] = qm_vec_add(to[i], random_vec(&random, noise));
        qm_bilinear target = qm_bilinear_make(to);
        double middle[2];
        for (int axis = 0; axis < 2; axis++)
            middle[axis] = qm_clamp((0.5 - low[axis]) / (high[axis] - low[axis]), 0.0, 1.0);
        rest_list rest = {0};
        if (!qm_bilinear_match(&source, &square, &target, middle, 2.0 * noise, keep_rest, &rest)) continue;
        check_covered(&source, &square, to, 2.0 * noise, &rest, &random);
        whole += rest.count <= 4;
    }
    assert_true(whole > NOISY_TRIES * 9 / 10);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(covered_points_are_near),
        cmocka_unit_test(points_are_not_covered_by_a_speck),
        cmocka_unit_test(parts_of_patches_that_are_alike),
        cmocka_unit_test(near_copies_are_covered_however_they_are_turned),
        cmocka_unit_test(what_lies_over_a_part_is_covered),
        cmocka_unit_test(what_lies_over_a_noisy_part_is_covered),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
