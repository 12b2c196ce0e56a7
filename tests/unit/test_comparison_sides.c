/*
 * Comparisons with a sign, bands and regions: boxes in boxes and boxes that are shifted, whose figures have closed forms, at many
 * sizes and places; what a mesh that is open, a point set or a surface without area leaves out; and cancelations.
 */
#include <math.h>
#include <stdatomic.h>
#include <string.h>

#include "base/host.h"
#include "check.h"
#include "failing_allocator.h"
#include "measured.h"
#include "shapes.h"

static qm_comparison_options options_for(double size, qm_sign sign, const qm_interval *band, size_t count)
{
    qm_comparison_options options = qm_deviation_options_default();
    options.tolerance = 1e-7 * size;
    options.accuracy = 1e-3;
    options.sign = sign;
    options.band = band;
    options.band_count = count;
    options.face_limit = 4;
    return options;
}

/** Values are as exact as the coordinates and the roundings of the test, which slack covers. */
static void check_holds(qm_interval found, double value, double slack, double width, const char *name,
                        uint64_t stream)
{
    QM_CHECK(found.lower <= value + slack && value - slack <= found.upper,
             "stream %llu: %s: %.17g is not in [%.17g, %.17g]", (unsigned long long)stream, name, value,
             found.lower, found.upper);
    QM_CHECK(found.lower <= found.upper && found.upper - found.lower <= width,
             "stream %llu: %s: [%.17g, %.17g]", (unsigned long long)stream, name, found.lower, found.upper);
}

/** A box, as triangles that are cut a few times where the draw says so. */
static qm_mesh draw_box(qm_random *random, double half)
{
    qm_mesh out = qm_shape_cube(half);
    for (uint64_t cuts = qm_random_below(random, 3); cuts > 0; cuts--) {
        qm_mesh triangles = qm_shape_triangulated(&out), fine = qm_shape_refined(&triangles);
        qm_shape_free(&triangles);
        qm_shape_free(&out);
        out = fine;
    }
    return out;
}

/** Where both meshes are moved to: no farther than coordinates keep most of their digits. */
typedef struct placing {
    double size, shift[3];
} placing;

static placing draw_placing(qm_random *random)
{
    placing out = {.size = ldexp(1.0, (int)qm_random_below(random, 160) - 80)};
    double far = qm_random_below(random, 2) ? 1024.0 * out.size : 0.0;
    for (int k = 0; k < 3; k++)
        out.shift[k] = far * (double)((int)qm_random_below(random, 3) - 1);
    return out;
}

/* ---- known values ---- */

/** A box of half width 1 - gap in one of 1: the one is gap inside everywhere; the other one is outside, at its corners farthest. */
static void check_nested(qm_random *random, uint64_t stream)
{
    placing at = draw_placing(random);
    double gap = (double)(1 + qm_random_below(random, 31)) / 64.0, size = at.size;
    qm_mesh a = draw_box(random, 1.0 - gap), b = draw_box(random, 1.0);
    qm_shape_move(&a, size, at.shift);
    qm_shape_move(&b, size, at.shift);
    bool is_outside = qm_random_below(random, 2);
    double s = is_outside ? 1.0 : -1.0, far = sqrt(3.0) * gap * size, slack = 1e-14 * size;
    const qm_interval bands[] = {
        {-INFINITY, -0.5 * gap * size}, {-0.5 * gap * size, 0.5 * gap * size}, {0.5 * gap * size, INFINITY}};
    qm_comparison_options options =
        options_for(size, is_outside ? QM_SIGN_OUTSIDE : QM_SIGN_INSIDE, bands, 3);
    options.quads = (qm_quad_reading)(stream % 2);
    options.region_limit = 0.5 * gap * size;
    qm_comparison found = qm_measured_comparison(&a, &b, &options);
    assert_true(found.is_signed[0] && found.is_signed[1] && found.knows_solid);
    const qm_signed_deviation *of_a = &found.side[0].sides, *of_b = &found.side[1].sides;
    check_holds(of_a->behind.max, gap * size, slack, 1e-6 * size, "A inside", stream);
    check_holds(of_a->front.max, 0.0, 0.0, 1e-9 * size, "A outside", stream); /* a crack between pieces */
    check_holds(of_a->mean, -s * gap * size, slack, 2e-3 * size, "mean of A", stream);
    check_holds(of_a->band[is_outside ? 0 : 2], 1.0, 1e-9, 1e-3, "band", stream);
    check_holds(of_a->band[1], 0.0, 1e-9, 1e-3, "middle band", stream);
    check_holds(of_b->front.max, far, 2 * slack, 1e-6 * size, "B outside", stream);
    check_holds(of_b->behind.max, 0.0, 0.0, 1e-9 * size, "B inside", stream);
    QM_CHECK(of_b->mean.lower * s <= far && of_b->mean.upper * s >= gap * size * (1 - 1e-12),
             "stream %llu: mean of B", (unsigned long long)stream);
    check_holds(of_b->band[is_outside ? 2 : 0], 1.0, 1e-9, 1e-3, "band of B", stream);
    for (int side = 0; side < 2; side++) {
        const qm_deviation *of = &found.side[side];
        assert_true(of->has_regions && of->region_count == 1);
        assert_true(of->region[0].listed_faces == 4 && of->region[0].face_count >= 6);
        check_holds(of->region[0].max, side == 0 ? gap * size : far, 2 * slack, 0.1 * size, "region", stream);
    }
    qm_measured_comparison_free(&found);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/**
 * A box of half width 1 that is shifted by t < 1 along an axis, from where it was: outside by t, and inside by t in the middle of
 * the face on the other side. The integral of the signed distance is 4 t over the front face, 4 t^2 / 2 * 2 over the strips of the
 * four sides, less that of min(t, 1 - |y|, 1 - |z|) over the other face, (4 / 3) (1 - (1 - t)^3). What of the sides is on the
 * target has no side. Seen from the target it is the mirror image.
 */
static void check_shifted(qm_random *random, uint64_t stream)
{
    placing at = draw_placing(random);
    double t = (double)(1 + qm_random_below(random, 48)) / 64.0, size = at.size, along[3] = {0, 0, 0};
    along[qm_random_below(random, 3)] = qm_random_below(random, 2) ? t : -t;
    qm_mesh a = draw_box(random, 1.0), b = draw_box(random, 1.0);
    qm_shape_move(&a, 1.0, along);
    qm_shape_move(&a, size, at.shift);
    qm_shape_move(&b, size, at.shift);
    const qm_interval bands[] = {{0.5 * t * size, INFINITY}, {-INFINITY, -0.5 * t * size}};
    qm_comparison_options options = options_for(size, QM_SIGN_OUTSIDE, bands, 2);
    options.quads = (qm_quad_reading)(stream % 2);
    options.accuracy = 0.03;
    options.region_limit = 0.9 * t * size;
    qm_comparison found = qm_measured_comparison(&a, &b, &options);
    double slack = 1e-13 * size,
           mean = (4 * t + 4 * t * t - 4.0 / 3.0 * (1 - (1 - t) * (1 - t) * (1 - t))) / 24;
    double front = (4.0 + 4 * t) / 24, behind = 4.0 * (1 - 0.5 * t) * (1 - 0.5 * t) / 24;
    for (int side = 0; side < 2; side++) {
        assert_true(found.is_signed[side]);
        const qm_signed_deviation *of = &found.side[side].sides;
        check_holds(of->front.max, t * size, slack, 1e-3 * size, "outside", stream);
        check_holds(of->behind.max, t * size, slack, 1e-2 * size, "inside", stream);
        check_holds(of->mean, mean * size, slack, 0.1 * size, "mean", stream);
        check_holds(of->band[0], front, 1e-12, 0.2, "band in front", stream);
        check_holds(of->band[1], behind, 1e-12, 0.2, "band behind", stream);
        /* The front face, with the strips beside it; and the middle of the face on the other side. */
        assert_true(found.side[side].region_count == 2);
    }
    check_holds(found.hausdorff, t * size, slack, 1e-6 * size, "hausdorff", stream);
    qm_measured_comparison_free(&found);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

static void check_many(void (*check)(qm_random *random, uint64_t stream), uint64_t few, uint64_t first)
{
    uint64_t count = qm_check_long() ? 200 * few : few, seed = qm_check_seed();
    print_message("seed %llu\n", (unsigned long long)seed);
    for (uint64_t i = 0; i < count; i++) {
        qm_random random = qm_random_make(seed, first + i);
        check(&random, i);
    }
}

static void boxes_in_boxes_are_on_one_side(void **state)
{
    (void)state;
    check_many(check_nested, 60, 7000000);
}

static void shifted_boxes_are_on_both_sides(void **state)
{
    (void)state;
    check_many(check_shifted, 12, 8000000);
}

/* ---- what is left out ---- */

static void check_one_way(const qm_mesh *a, const qm_mesh *b, qm_sign sign, qm_solid_fault fault)
{
    const qm_interval band = {-0.1, 0.1};
    qm_comparison_options options = options_for(1.0, sign, &band, 1);
    qm_comparison found = qm_measured_comparison(a, b, &options);
    assert_true(found.is_signed[0] && !found.is_signed[1]);
    assert_int_equal(found.solid_a.fault, fault);
    assert_int_equal(found.side[0].sides.band_count, 1);
    assert_int_equal(found.side[1].sides.band_count, 0);
    assert_true(found.side[1].max.upper > 0.0);
    qm_measured_comparison_free(&found);
}

static void what_cannot_be_signed_is_told(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 3);
    qm_mesh box = qm_shape_cube(1.0), open = qm_shape_cube(0.5), points = qm_shape_points(&random, 20),
            turned = qm_shape_cube(0.5);
    open.face_count--;
    uint32_t first = turned.faces[1];
    turned.faces[1] = turned.faces[3];
    turned.faces[3] = first;
    check_one_way(&open, &box, QM_SIGN_OUTSIDE, QM_SOLID_OPEN);
    check_one_way(&turned, &box, QM_SIGN_INSIDE, QM_SOLID_TURNED);
    check_one_way(&points, &box, QM_SIGN_OUTSIDE, QM_SOLID_EMPTY);
    check_one_way(&points, &box, QM_SIGN_NORMAL, QM_SOLID_PROVEN);
    const qm_mesh *bad[] = {&open, &turned, &points};
    for (size_t i = 0; i < 3; i++) {
        qm_context ctx = qm_context_make();
        qm_comparison_options options = options_for(1.0, QM_SIGN_OUTSIDE, NULL, 0);
        qm_comparison found;
        assert_int_equal(qm_measured_comparison_in(&ctx, &box, bad[i], &options, &found), QM_E_NOT_CLOSED);
        assert_false(found.is_signed[0]);
    }
    open.face_count++;
    qm_shape_free(&box);
    qm_shape_free(&open);
    qm_shape_free(&points);
    qm_shape_free(&turned);
}

static void surfaces_without_area_have_no_regions(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 4);
    static const double needle[3][3] = {{0, 0, 3}, {1, 0, 3}, {2, 0, 3}};
    qm_mesh box = qm_shape_cube(1.0), flat[2] = {qm_shape_points(&random, 20), qm_shape_face(3, needle)};
    for (int i = 0; i < 2; i++) {
        qm_comparison_options options = options_for(1.0, QM_SIGN_NONE, NULL, 0);
        options.region_limit = 0.5;
        qm_comparison found = qm_measured_comparison(&box, &flat[i], &options);
        assert_true(found.side[0].has_regions && !found.side[1].has_regions);
        qm_measured_comparison_free(&found);
        qm_context ctx = qm_context_make();
        assert_int_equal(qm_measured_comparison_in(&ctx, &flat[i], &box, &options, &found), QM_E_UNSUPPORTED);
        qm_shape_free(&flat[i]);
    }
    qm_shape_free(&box);
}

/* ---- a call that does not end ---- */

static const atomic_bool always = true;

typedef struct canceling {
    atomic_bool cancel;
    size_t polls, cancel_at;
} canceling;

static void cancel_in_time(void *user)
{
    canceling *at = user;
    if (at->polls++ >= at->cancel_at) atomic_store(&at->cancel, true);
}

static bool meet(qm_interval x, qm_interval y)
{
    return x.lower <= x.upper && x.lower <= y.upper && x.upper >= y.lower;
}

/** Cancels at the n-th poll: what has a sign holds what the whole call found. */
static bool cancel_at(qm_bvh *const tree[2], const qm_comparison_options *options, size_t n,
                      const qm_comparison *truth)
{
    canceling at = {.cancel_at = n};
    qm_context ctx = qm_context_make();
    ctx.cancel = &at.cancel;
    ctx.pause = &always;
    ctx.wait = cancel_in_time;
    ctx.wait_user = &at;
    qm_comparison found;
    assert_int_equal(qm_comparison_measure(&ctx, tree[0], tree[1], options, NULL, &found), QM_OK);
    bool was_raised = atomic_load(&at.cancel);
    assert_true(found.is_signed[0] && (was_raised || found.is_signed[1]));
    for (int side = 0; side < 2; side++) {
        const qm_signed_deviation *part = &found.side[side].sides, *whole = &truth->side[side].sides;
        if (!found.is_signed[side]) continue;
        bool holds = meet(part->mean, whole->mean) && meet(part->front.max, whole->front.max) &&
                     meet(part->behind.max, whole->behind.max) && meet(part->band[0], whole->band[0]);
        QM_CHECK(holds, "side %d, canceled at poll %zu", side, n);
    }
    qm_comparison_reset(&ctx, &found);
    return was_raised;
}

static void a_canceled_call_holds(void **state)
{
    (void)state;
    const qm_interval band = {-0.1, 0.2};
    qm_mesh mesh[2] = {qm_shape_cube(0.7), qm_shape_cube(1.0)};
    const double shift[3] = {0.5, 0.2, 0.1};
    qm_shape_move(&mesh[0], 1.0, shift);
    qm_context ctx = qm_context_make();
    qm_bvh *tree[2] = {NULL, NULL};
    for (int i = 0; i < 2; i++)
        assert_int_equal(qm_bvh_build(&ctx, &mesh[i], QM_BVH_ALL, 1, &tree[i]), QM_OK);
    qm_comparison_options options = options_for(1.0, QM_SIGN_OUTSIDE, &band, 1);
    options.accuracy = 0.1;
    options.piece_limit = 5000;
    options.region_limit = 0.2;
    qm_comparison truth = qm_measured_comparison(&mesh[0], &mesh[1], &options);
    for (size_t n = 0; cancel_at(tree, &options, n, &truth);)
        n += 1 + n / 8;
    qm_measured_comparison_free(&truth);
    for (int i = 0; i < 2; i++) {
        qm_bvh_destroy(&ctx, tree[i]);
        qm_shape_free(&mesh[i]);
    }
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_cube(0.9), b = qm_shape_cube(1.0);
    const qm_interval band = {-0.1, 0.1};
    qm_comparison_options options = options_for(1.0, QM_SIGN_OUTSIDE, &band, 1);
    options.accuracy = 0.3;
    options.region_limit = 0.05;
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(boxes_in_boxes_are_on_one_side),
        cmocka_unit_test(shifted_boxes_are_on_both_sides),
        cmocka_unit_test(what_cannot_be_signed_is_told),
        cmocka_unit_test(surfaces_without_area_have_no_regions),
        cmocka_unit_test(a_canceled_call_holds),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
