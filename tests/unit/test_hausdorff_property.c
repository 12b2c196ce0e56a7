/* The Hausdorff bracket on thousands of random small soups, against the slow twin's bracket. */
#include "check.h"

#include "measured.h"
#include "random.h"
#include "shapes.h"
#include "slow_twin.h"

#include <math.h>
#include <string.h>

#define SEED_FORMAT "seed %llu, %s, %s"
#define SEED_VALUES(pair)                                                                                    \
    (unsigned long long)(pair)->seed, direction_names[(pair)->direction], reading_names[(pair)->reading]

static const char *const direction_names[] = {"two-sided", "a to b", "b to a"};
static const char *const reading_names[] = {"triangles", "bilinear"};

/** Two soups, what to ask about them, and their common size. */
typedef struct soup_pair {
    uint64_t seed;
    qm_mesh a, b;
    qm_direction direction;
    qm_quad_reading reading;
    double size;
} soup_pair;

static qm_mesh draw_mesh(qm_random *random, qm_soup_style style)
{
    if (qm_random_below(random, 12) == 0) return qm_shape_points(random, 1 + qm_random_below(random, 6));
    qm_soup_corners corners = (qm_soup_corners)qm_random_below(random, 3);
    double twist = (double[]){0, 0.1, 0.5, 2}[qm_random_below(random, 4)];
    return qm_shape_soup(random, 1 + qm_random_below(random, 8), corners, style, twist);
}

/** Half of the pairs are a soup and a shaken copy of it, as they are in practice. */
static soup_pair draw_pair(uint64_t seed)
{
    qm_random random = qm_random_make(qm_check_seed(), seed);
    qm_soup_style style = (qm_soup_style)qm_random_below(&random, QM_SOUP_STYLE_COUNT);
    soup_pair pair = {.seed = seed, .a = draw_mesh(&random, style)};
    if (qm_random_below(&random, 2) == 0) {
        double amplitude = (double[]){0, 1e-9, 1e-3, 0.1}[qm_random_below(&random, 4)];
        pair.b = qm_shape_copy(&pair.a);
        qm_shape_shake(&pair.b, &random, amplitude);
    } else {
        pair.b = draw_mesh(&random, (qm_soup_style)qm_random_below(&random, QM_SOUP_STYLE_COUNT));
    }
    pair.direction = (qm_direction)qm_random_below(&random, 3);
    pair.reading = (qm_quad_reading)qm_random_below(&random, 2);
    pair.size = qm_measured_size(&pair.a, &pair.b);
    return pair;
}

static void free_pair(soup_pair *pair)
{
    qm_shape_free(&pair->a);
    qm_shape_free(&pair->b);
}

static qm_hausdorff_options pair_options(const soup_pair *pair, double tolerance, int threads)
{
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.direction = pair->direction;
    options.quads = pair->reading;
    options.tolerance = tolerance;
    options.thread_count = threads;
    options.work_limit = pair->reading == QM_QUADS_BILINEAR ? 4000 : 200000;
    return options;
}

static void check_against_slow(const soup_pair *pair, const qm_hausdorff_result *fast,
                               const qm_slow_bracket *slow)
{
    double slack = 1e-12 * pair->size;
    QM_CHECK(fast->lower <= fast->upper, SEED_FORMAT ": [%.17g, %.17g]", SEED_VALUES(pair), fast->lower,
             fast->upper);
    QM_CHECK(fast->lower <= slow->upper + slack, SEED_FORMAT ": lower %.17g, true at most %.17g",
             SEED_VALUES(pair), fast->lower, slow->upper);
    QM_CHECK(fast->upper >= slow->lower - slack, SEED_FORMAT ": upper %.17g, true at least %.17g",
             SEED_VALUES(pair), fast->upper, slow->lower);
}

static double gap(const double a[3], const double b[3])
{
    return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) +
                (a[2] - b[2]) * (a[2] - b[2]));
}

/**
 * The witness lies on its surface where its parameters say, and is as far from the other one as lower says:
 * of patches, whose nearest points are certified no closer than it pays, to within a share of the tolerance.
 */
static void check_witness(const soup_pair *pair, const qm_hausdorff_result *fast, double tolerance)
{
    const qm_mesh *source = fast->from_side == 0 ? &pair->a : &pair->b;
    const qm_mesh *target = fast->from_side == 0 ? &pair->b : &pair->a;
    double slack = 1e-12 * pair->size, at[3];
    assert_true(fast->has_witness);
    QM_CHECK(pair->direction == QM_TWO_SIDED || fast->from_side == (pair->direction == QM_B_TO_A),
             SEED_FORMAT ": witness from side %d", SEED_VALUES(pair), fast->from_side);
    double apart = gap(fast->from.position, fast->to.position);
    double share = pair->reading == QM_QUADS_BILINEAR ? 0.3 * tolerance : 0;
    QM_CHECK(fast->lower <= apart + slack && fast->lower >= apart - slack - share,
             SEED_FORMAT ": %.17g apart, lower %.17g", SEED_VALUES(pair), apart, fast->lower);
    qm_slow_position(source, fast->from.face, pair->reading, fast->from.uv, at);
    QM_CHECK(gap(at, fast->from.position) <= slack, SEED_FORMAT ": from is %g off its face %u",
             SEED_VALUES(pair), gap(at, fast->from.position), fast->from.face);
    qm_slow_position(target, fast->to.face, pair->reading, fast->to.uv, at);
    QM_CHECK(gap(at, fast->to.position) <= slack, SEED_FORMAT ": to is %g off its face %u", SEED_VALUES(pair),
             gap(at, fast->to.position), fast->to.face);
    qm_slow_bracket d = qm_slow_distance(target, pair->reading, fast->from.position, 1e-12 * pair->size);
    QM_CHECK(fast->lower <= d.upper + slack, SEED_FORMAT ": lower %.17g, the witness is only %.17g away",
             SEED_VALUES(pair), fast->lower, d.upper);
}

static void brackets_meet_those_of_the_slow_twin(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 10000 : 1000, closed = 0, drawn[2] = {0}, converged[2] = {0};
    for (uint64_t seed = 0; seed < count; ++seed) {
        soup_pair pair = draw_pair(seed);
        /* The slow twin takes a tenth of a second for patches: the short run draws fewer of them. */
        if (pair.reading == QM_QUADS_BILINEAR && seed % 8 != 0 && !qm_check_long()) {
            free_pair(&pair);
            continue;
        }
        double tolerance = pair.size * (double[]){1e-3, 1e-6, 1e-9}[seed % 3];
        qm_hausdorff_options options = pair_options(&pair, tolerance, 1);
        qm_hausdorff_result fast = qm_measured(&pair.a, &pair.b, &options);
        size_t limit = pair.reading == QM_QUADS_BILINEAR ? 100 : 400;
        qm_slow_bracket slow =
            qm_slow_hausdorff(&pair.a, &pair.b, pair.direction, pair.reading, 1e-9 * pair.size, limit);
        check_against_slow(&pair, &fast, &slow);
        check_witness(&pair, &fast, tolerance);
        if (fast.stop == QM_STOP_CONVERGED)
            QM_CHECK(fast.upper - fast.lower <= tolerance, SEED_FORMAT ": width %g, tolerance %g",
                     SEED_VALUES(&pair), fast.upper - fast.lower, tolerance);
        drawn[pair.reading]++;
        converged[pair.reading] += fast.stop == QM_STOP_CONVERGED;
        closed += slow.upper - slow.lower <= 1e-3 * pair.size;
        free_pair(&pair);
    }
    uint64_t all = drawn[QM_QUADS_TRIANGLES] + drawn[QM_QUADS_BILINEAR];
    print_message("the engine converged on %llu of %llu pairs of triangles and %llu of %llu of patches; the "
                  "slow twin was "
                  "within 1e-3 on %llu\n",
                  (unsigned long long)converged[QM_QUADS_TRIANGLES],
                  (unsigned long long)drawn[QM_QUADS_TRIANGLES],
                  (unsigned long long)converged[QM_QUADS_BILINEAR],
                  (unsigned long long)drawn[QM_QUADS_BILINEAR], (unsigned long long)closed);
    assert_int_equal(converged[QM_QUADS_TRIANGLES], drawn[QM_QUADS_TRIANGLES]);
    /* Patches bent by up to two edge lengths meet ridges of the distance that take more than the work
     * limit. */
    assert_true(converged[QM_QUADS_BILINEAR] * 100 >= drawn[QM_QUADS_BILINEAR] * 80);
    assert_true(closed * 2 >= all);
}

/** The last bounds that the progress callback got, and whether one of them ever moved the wrong way. */
typedef struct watch {
    double lower, upper;
    int calls;
    bool loosened;
} watch;

static void look(void *user, const qm_hausdorff_progress *now)
{
    watch *seen = user;
    ++seen->calls;
    seen->loosened = seen->loosened || !(now->lower >= seen->lower) || !(now->upper <= seen->upper);
    seen->lower = now->lower;
    seen->upper = now->upper;
}

static void brackets_hold_for_any_number_of_threads(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 1500 : 150, reported = 0;
    for (uint64_t seed = 0; seed < count; ++seed) {
        soup_pair pair = draw_pair(1000000 + seed);
        qm_slow_bracket slow =
            qm_slow_hausdorff(&pair.a, &pair.b, pair.direction, pair.reading, 1e-9 * pair.size, 60);
        double tolerance = pair.size * (double[]){1e-3, 1e-6, 1e-9}[seed % 3];
        for (int k = 0; k < 4; ++k) {
            qm_hausdorff_options options = pair_options(&pair, tolerance, (int[]){1, 2, 3, 8}[k]);
            watch seen = {.upper = INFINITY};
            options.progress = look;
            options.progress_user = &seen;
            qm_hausdorff_result fast = qm_measured(&pair.a, &pair.b, &options);
            check_against_slow(&pair, &fast, &slow);
            check_witness(&pair, &fast, tolerance);
            QM_CHECK(!seen.loosened && fast.lower >= seen.lower && fast.upper <= seen.upper,
                     SEED_FORMAT ", %d threads: [%.17g, %.17g] after [%.17g, %.17g], loosened %d",
                     SEED_VALUES(&pair), options.thread_count, fast.lower, fast.upper, seen.lower, seen.upper,
                     seen.loosened);
            reported += (uint64_t)seen.calls;
        }
        free_pair(&pair);
    }
    assert_true(reported > count);
}

static void one_thread_gives_the_same_bits_twice(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 200; ++seed) {
        soup_pair pair = draw_pair(2000000 + seed);
        qm_hausdorff_options options = pair_options(&pair, 1e-6 * pair.size, 1);
        qm_hausdorff_result first = qm_measured(&pair.a, &pair.b, &options);
        qm_hausdorff_result second = qm_measured(&pair.a, &pair.b, &options);
        bool same = first.lower == second.lower && first.upper == second.upper &&
                    first.iterations == second.iterations && first.projections == second.projections &&
                    first.from.face == second.from.face && first.to.face == second.to.face &&
                    memcmp(first.from.position, second.from.position, sizeof first.from.position) == 0 &&
                    memcmp(first.to.position, second.to.position, sizeof first.to.position) == 0;
        QM_CHECK(same, SEED_FORMAT ": [%.17g, %.17g], then [%.17g, %.17g]", SEED_VALUES(&pair), first.lower,
                 first.upper, second.lower, second.upper);
        free_pair(&pair);
    }
}

/** Moved and scaled copies: the bracket must overlap the moved bracket of the original. */
static void brackets_move_and_scale_with_the_meshes(void **state)
{
    (void)state;
    static const struct {
        double scale, shift;
    } moves[] = {{1, 1e7}, {1e-9, 0}, {1e-9, 1}, {1e-30, 0}, {1e30, 0}, {1e-150, 0}, {1e150, 0}, {3, -5}};
    for (uint64_t seed = 0; seed < 400; ++seed) {
        soup_pair pair = draw_pair(3000000 + seed);
        qm_hausdorff_options options = pair_options(&pair, 1e-6 * pair.size, 1);
        qm_hausdorff_result plain = qm_measured(&pair.a, &pair.b, &options);
        double scale = moves[seed % 8].scale, shift = moves[seed % 8].shift;
        const double shifts[3] = {shift, -0.5 * shift, 0.25 * shift};
        qm_shape_move(&pair.a, scale, shifts);
        qm_shape_move(&pair.b, scale, shifts);
        options.tolerance = fmax(1e-6 * pair.size * scale, 1e-12 * fabs(shift));
        qm_hausdorff_result moved = qm_measured(&pair.a, &pair.b, &options);
        /* Rounding the moved corners changes the meshes themselves by this much. */
        double slack = 4 * 0x1p-53 * (fabs(shift) + 4 * pair.size * scale) + 1e-12 * pair.size * scale;
        QM_CHECK(moved.lower <= plain.upper * scale + slack && moved.upper >= plain.lower * scale - slack,
                 SEED_FORMAT ", scale %g, shift %g: [%.17g, %.17g], was [%.17g, %.17g]", SEED_VALUES(&pair),
                 scale, shift, moved.lower, moved.upper, plain.lower * scale, plain.upper * scale);
        free_pair(&pair);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(brackets_meet_those_of_the_slow_twin),
        cmocka_unit_test(brackets_hold_for_any_number_of_threads),
        cmocka_unit_test(one_thread_gives_the_same_bits_twice),
        cmocka_unit_test(brackets_move_and_scale_with_the_meshes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
