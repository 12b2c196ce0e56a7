/* Distances of all pairs: against brute force over a metric of whole numbers, whose distances are exact, and against meshes whose
 * Hausdorff distances are known by formula. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "check.h"
#include "qm/bvh.h"
#include "qm/hausdorff.h"
#include "qm/matrix.h"
#include "random.h"
#include "shapes.h"

enum { MAX_ITEMS = 24, AXES = 3 };

/* ---- a metric of whole numbers ---- */

/** Points with whole coordinates under the largest difference, and a measurement that is as lazy as it may be. */
typedef struct lattice {
    size_t count;
    double at[MAX_ITEMS][AXES];
    size_t same[MAX_ITEMS];
    qm_random random;
    size_t asked[MAX_ITEMS][MAX_ITEMS]; /* how often each pair was measured */
    size_t calls, stop_after;           /* the host stops at this call; 0: never */
    bool is_blunt;                      /* some measurements end early, as at the limit of precision */
} lattice;

static double true_distance(const lattice *set, size_t a, size_t b)
{
    double distance = 0.0;
    for (int k = 0; k < AXES; k++)
        distance = fmax(distance, fabs(set->at[a][k] - set->at[b][k]));
    return distance;
}

static qm_status measure_lattice(void *user, const qm_matrix_question *question, qm_matrix_answer *out)
{
    lattice *set = user;
    size_t a = question->a, b = question->b;
    assert_true(a < b && b < set->count && question->tolerance > 0.0);
    set->asked[a][b]++;
    set->calls++;
    double distance = true_distance(set, a, b), width = question->tolerance;
    if (set->is_blunt && qm_random_below(&set->random, 4) == 0) width *= 64.0;
    double share = qm_random_range(&set->random, 0.0, 1.0);
    /* Dyadic shares: the bounds are exact. */
    share = floor(share * 64.0) / 64.0;
    *out = (qm_matrix_answer){.lower = fmax(distance - share * width, 0.0),
                              .upper = distance + (1.0 - share) * width,
                              .is_stopped = set->calls == set->stop_after};
    if (distance <= question->threshold) *out = (qm_matrix_answer){0.0, question->threshold, out->is_stopped};
    if (distance > question->threshold)
        *out =
            (qm_matrix_answer){nextafter(question->threshold, INFINITY), distance + 1000.0, out->is_stopped};
    if (out->is_stopped) *out = (qm_matrix_answer){0.0, INFINITY, true};
    return QM_OK;
}

static lattice make_lattice(unsigned run)
{
    lattice set = {.random = qm_random_make(qm_check_seed(), run)};
    set.count = 2 + qm_random_below(&set.random, MAX_ITEMS - 1);
    double reach = run % 3 == 0 ? 4.0 : run % 3 == 1 ? 40.0 : 4000.0;
    bool has_clusters = qm_random_below(&set.random, 2) == 0;
    for (size_t i = 0; i < set.count; i++) {
        bool copies = i > 0 && qm_random_below(&set.random, 8) == 0;
        size_t from = copies ? qm_random_below(&set.random, i) : i;
        set.same[i] = copies && qm_random_below(&set.random, 2) ? set.same[from] : i;
        for (int k = 0; k < AXES; k++) {
            double far = has_clusters ? 5000.0 * (double)(i % 3) : 0.0;
            set.at[i][k] =
                copies ? set.at[from][k] : far + floor(qm_random_range(&set.random, -reach, reach));
        }
    }
    return set;
}

static qm_matrix_options options_of(lattice *set, qm_matrix_want want)
{
    return (qm_matrix_options){.count = set->count,
                               .same = set->same,
                               .want = want,
                               .nearest = 1 + qm_random_below(&set->random, set->count - 1),
                               .limit = floor(qm_random_range(&set->random, 0.0, 60.0)),
                               .tolerance = qm_random_below(&set->random, 2) ? 0x1p-6 : 2.0,
                               .measure = measure_lattice,
                               .user = set};
}

static void check_bounds(const lattice *set, const qm_matrix *matrix, unsigned run)
{
    for (size_t a = 0; a < set->count; a++)
        for (size_t b = a + 1; b < set->count; b++) {
            size_t pair = qm_matrix_pair(set->count, a, b);
            double distance = true_distance(set, a, b);
            QM_CHECK(matrix->lower[pair] <= distance && distance <= matrix->upper[pair],
                     "seed %llu run %u pair %zu %zu: %.17g is not in [%.17g, %.17g]",
                     (unsigned long long)qm_check_seed(), run, a, b, distance, matrix->lower[pair],
                     matrix->upper[pair]);
            QM_CHECK(set->asked[a][b] <= 3, "run %u: pair %zu %zu was measured %zu times", run, a, b,
                     set->asked[a][b]);
        }
    assert_true(matrix->searched <= matrix->pair_count && matrix->searched <= matrix->searches);
    assert_int_equal(matrix->searches, set->calls);
    if (matrix->open == 0) assert_int_equal(matrix->searched + matrix->bounded, matrix->pair_count);
}

/** The slow twin of a list: all distances of an item, sorted. */
static void check_list(const lattice *set, const qm_matrix *matrix, const qm_matrix_options *options,
                       size_t item, unsigned run)
{
    qm_matrix_near near[MAX_ITEMS];
    double sorted[MAX_ITEMS];
    size_t others = 0,
           count = qm_matrix_list_nearest(matrix, item, options->nearest, options->tolerance, near);
    for (size_t i = 0; i < set->count; i++) {
        if (i == item) continue;
        size_t at = others++;
        for (; at > 0 && sorted[at - 1] > true_distance(set, item, i); at--)
            sorted[at] = sorted[at - 1];
        sorted[at] = true_distance(set, item, i);
    }
    assert_int_equal(count, options->nearest);
    for (size_t i = 0; i < count; i++) {
        double distance = true_distance(set, item, near[i].item);
        double off = fabs(distance - sorted[i]);
        if (near[i].place == QM_MATRIX_PROVEN)
            QM_CHECK(off == 0.0, "run %u item %zu place %zu: %g, not %g", run, item, i, distance, sorted[i]);
        if (near[i].place == QM_MATRIX_TIED)
            QM_CHECK(off <= 2.0 * options->tolerance, "run %u item %zu place %zu: %g, not %g", run, item, i,
                     distance, sorted[i]);
        if (!set->is_blunt && set->stop_after == 0) {
            QM_CHECK(near[i].place != QM_MATRIX_OPEN, "run %u item %zu place %zu is open", run, item, i);
            QM_CHECK(near[i].upper - near[i].lower <= options->tolerance, "run %u item %zu place %zu: wide",
                     run, item, i);
        }
    }
}

static void check_answers(const lattice *set, const qm_matrix *matrix, const qm_matrix_options *options,
                          unsigned run)
{
    bool is_whole = !set->is_blunt && set->stop_after == 0;
    if (is_whole) QM_CHECK(matrix->open == 0, "run %u: %zu are open", run, matrix->open);
    for (size_t pair = 0; pair < matrix->pair_count && is_whole; pair++) {
        double lower = matrix->lower[pair], upper = matrix->upper[pair];
        if (options->want == QM_MATRIX_ALL)
            QM_CHECK(upper - lower <= options->tolerance, "run %u pair %zu: [%g, %g]", run, pair, lower,
                     upper);
        if (options->want == QM_MATRIX_WITHIN)
            QM_CHECK(upper <= options->limit || lower > options->limit, "run %u pair %zu: [%g, %g] around %g",
                     run, pair, lower, upper, options->limit);
    }
    for (size_t item = 0; item < set->count && options->want == QM_MATRIX_NEAREST; item++)
        check_list(set, matrix, options, item, run);
}

static void sets_of_whole_numbers(void **state)
{
    (void)state;
    for (unsigned run = 0; run < 12000; run++) {
        lattice set = make_lattice(run);
        qm_context ctx = qm_context_make();
        qm_matrix matrix;
        qm_matrix_options options = options_of(&set, (qm_matrix_want)(run % 3));
        set.is_blunt = run % 7 == 0;
        set.stop_after = run % 11 == 0 ? 1 + qm_random_below(&set.random, 40) : 0;
        assert_int_equal(qm_matrix_measure(&ctx, &options, &matrix), QM_OK);
        check_bounds(&set, &matrix, run);
        check_answers(&set, &matrix, &options, run);
        if (set.stop_after > 0 && set.calls == set.stop_after)
            assert_int_equal(matrix.stop, QM_MATRIX_DEADLINE);
        qm_matrix_reset(&ctx, &matrix);
    }
}

/** Far clusters: between them the triangle inequality decides nearly every pair. */
static void few_searches_decide(void **state)
{
    (void)state;
    lattice set = {.count = MAX_ITEMS, .random = qm_random_make(qm_check_seed(), 1)};
    for (size_t i = 0; i < set.count; i++) {
        set.same[i] = i;
        for (int k = 0; k < AXES; k++)
            set.at[i][k] = 1e6 * (double)(i % 3) + floor(qm_random_range(&set.random, -3.0, 3.0));
    }
    qm_context ctx = qm_context_make();
    qm_matrix matrix;
    qm_matrix_options options = options_of(&set, QM_MATRIX_WITHIN);
    options.limit = 1000.0;
    options.tolerance = 0x1p-6;
    assert_int_equal(qm_matrix_measure(&ctx, &options, &matrix), QM_OK);
    check_bounds(&set, &matrix, 0);
    check_answers(&set, &matrix, &options, 0);
    QM_CHECK(matrix.searched <= 4 * set.count, "%zu of %zu pairs were searched", matrix.searched,
             matrix.pair_count);
    qm_matrix_reset(&ctx, &matrix);
}

static void wrong_options_are_refused(void **state)
{
    (void)state;
    lattice set = make_lattice(5);
    const qm_matrix_options good = {.count = set.count,
                                    .want = QM_MATRIX_NEAREST,
                                    .nearest = 1,
                                    .tolerance = 1.0,
                                    .measure = measure_lattice,
                                    .user = &set};
    qm_matrix_options bad[6];
    for (size_t i = 0; i < 6; i++)
        bad[i] = good;
    bad[0].count = 1;
    bad[1].nearest = 0;
    bad[2].nearest = set.count;
    bad[3].tolerance = 0.0;
    bad[4].measure = NULL;
    bad[5].want = QM_MATRIX_WITHIN;
    bad[5].limit = -1.0;
    qm_context ctx = qm_context_make();
    qm_matrix matrix;
    for (size_t i = 0; i < 6; i++)
        assert_int_equal(qm_matrix_measure(&ctx, &bad[i], &matrix), QM_E_ARGUMENT);
}

static void flag_stops_at_once(void **state)
{
    (void)state;
    lattice set = make_lattice(4);
    qm_context ctx = qm_context_make();
    atomic_bool flag = true;
    ctx.cancel = &flag;
    qm_matrix matrix;
    qm_matrix_options options = options_of(&set, QM_MATRIX_ALL);
    assert_int_equal(qm_matrix_measure(&ctx, &options, &matrix), QM_OK);
    assert_int_equal(matrix.stop, QM_MATRIX_CANCELED);
    assert_int_equal(set.calls, 0);
    check_bounds(&set, &matrix, 4);
    qm_matrix_reset(&ctx, &matrix);
}

/* ---- meshes ---- */

typedef struct mesh_set {
    qm_context *ctx;
    size_t count;
    qm_mesh mesh[MAX_ITEMS];
    qm_bvh *tree[MAX_ITEMS];
    qm_box box[MAX_ITEMS];
    double shift[MAX_ITEMS][3];
    qm_quad_reading quads;
} mesh_set;

static qm_hausdorff_result search(const mesh_set *set, size_t a, size_t b, double tolerance, double threshold)
{
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.tolerance = tolerance;
    options.threshold = threshold;
    options.quads = set->quads;
    qm_hausdorff_result found;
    assert_int_equal(qm_hausdorff_measure(set->ctx, set->tree[a], set->tree[b], &options, &found), QM_OK);
    return found;
}

static qm_status measure_meshes(void *user, const qm_matrix_question *question, qm_matrix_answer *out)
{
    qm_hausdorff_result found =
        search(user, question->a, question->b, question->tolerance, question->threshold);
    *out = (qm_matrix_answer){.lower = found.lower, .upper = found.upper};
    return QM_OK;
}

/** A shape whose coordinates are multiples of 1/64 up to 4. */
static qm_mesh make_shape(qm_random *random, unsigned run)
{
    static const qm_soup_style styles[] = {QM_SOUP_APART, QM_SOUP_POOLED, QM_SOUP_LATTICE, QM_SOUP_COPLANAR,
                                           QM_SOUP_DEGENERATE};
    qm_mesh mesh = run % 6 == 5 ? qm_shape_points(random, 1 + qm_random_below(random, 8))
                                : qm_shape_soup(random, 1 + qm_random_below(random, 5), QM_SOUP_MIXED,
                                                styles[run % 6], 0.3);
    for (size_t i = 0; i < 3 * mesh.vertex_count; i++)
        mesh.positions[i] = floor(64.0 * mesh.positions[i]) / 64.0;
    return mesh;
}

static void add_mesh(mesh_set *set, qm_mesh mesh)
{
    size_t i = set->count++;
    set->mesh[i] = mesh;
    set->box[i] = qm_mesh_bounding_box(&mesh);
    assert_int_equal(qm_bvh_build(set->ctx, &set->mesh[i], QM_BVH_ALL, 1, &set->tree[i]), QM_OK);
}

/** Lists are of one item. */
static qm_matrix_options options_for(mesh_set *set, qm_matrix_want want, double tolerance)
{
    return (qm_matrix_options){.count = set->count,
                               .boxes = set->box,
                               .want = want,
                               .nearest = 1,
                               .tolerance = tolerance,
                               .measure = measure_meshes,
                               .user = set};
}

static void free_meshes(mesh_set *set)
{
    for (size_t i = 0; i < set->count; i++) {
        qm_bvh_destroy(set->ctx, set->tree[i]);
        qm_shape_free(&set->mesh[i]);
    }
}

/**
 * Copies of a shape that were moved by whole numbers, which is exact. The distance of two is the length of the way between
 * them: no point has farther to go, and the point of one that is farthest along the way has no point of the other beyond it
 * less that length.
 */
static void moved_copies(void **state)
{
    (void)state;
    for (unsigned run = 0; run < 360; run++) {
        qm_random random = qm_random_make(qm_check_seed(), 7000 + run);
        qm_context ctx = qm_context_make();
        mesh_set set = {.ctx = &ctx, .quads = run % 2 ? QM_QUADS_BILINEAR : QM_QUADS_TRIANGLES};
        qm_mesh shape = make_shape(&random, run);
        double scale = run % 4 == 3 ? ldexp(1.0, run % 8 == 3 ? -90 : 90) : 1.0;
        size_t count = 3 + qm_random_below(&random, 6);
        for (size_t i = 0; i < count; i++) {
            qm_mesh copy = qm_shape_copy(&shape);
            for (int k = 0; k < 3; k++)
                set.shift[i][k] = floor(qm_random_range(&random, -4.0, 4.0)) * scale;
            for (size_t at = 0; at < 3 * copy.vertex_count; at++)
                copy.positions[at] = copy.positions[at] * scale + set.shift[i][at % 3];
            add_mesh(&set, copy);
        }
        qm_matrix_options options = options_for(&set, (qm_matrix_want)(run % 3), 1e-3 * scale);
        options.nearest = 1 + qm_random_below(&random, count - 1);
        options.limit = scale * floor(qm_random_range(&random, 0.0, 9.0));
        qm_matrix matrix;
        assert_int_equal(qm_matrix_measure(&ctx, &options, &matrix), QM_OK);
        for (size_t a = 0; a < count; a++)
            for (size_t b = a + 1; b < count; b++) {
                size_t pair = qm_matrix_pair(count, a, b);
                double square = 0.0; /* in units of the scale: a whole number */
                for (int k = 0; k < 3; k++)
                    square += pow((set.shift[a][k] - set.shift[b][k]) / scale, 2.0);
                /* The root is compared by squares in long doubles, so that no rounding of the test decides. */
                long double lower = matrix.lower[pair] / scale, upper = matrix.upper[pair] / scale;
                QM_CHECK(lower * lower <= (long double)square * (1.0L + 0x1p-60L) &&
                             (long double)square * (1.0L - 0x1p-60L) <= upper * upper,
                         "seed %llu run %u pair %zu %zu: the root of %g is not in [%.17g, %.17g]",
                         (unsigned long long)qm_check_seed(), run, a, b, square, (double)lower,
                         (double)upper);
            }
        qm_matrix_reset(&ctx, &matrix);
        free_meshes(&set);
        qm_shape_free(&shape);
    }
}

/** Boxes around one centre, each inside the next: a corner of the larger one is the farthest point. */
static void nested_boxes(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    mesh_set set = {.ctx = &ctx};
    for (size_t i = 0; i < 12; i++)
        add_mesh(&set, qm_shape_cube(1.0 + 0.25 * (double)i));
    qm_matrix_options options = options_for(&set, QM_MATRIX_NEAREST, 1e-6);
    options.nearest = 3;
    qm_matrix matrix;
    assert_int_equal(qm_matrix_measure(&ctx, &options, &matrix), QM_OK);
    assert_int_equal(matrix.open, 0);
    for (size_t a = 0; a < set.count; a++)
        for (size_t b = a + 1; b < set.count; b++) {
            size_t pair = qm_matrix_pair(set.count, a, b);
            long double square = 3.0L * 0.0625L * (long double)((b - a) * (b - a));
            assert_true((long double)matrix.lower[pair] * matrix.lower[pair] <= square &&
                        square <= (long double)matrix.upper[pair] * matrix.upper[pair]);
        }
    /* Neighbours on both sides are as far: a tie. */
    qm_matrix_near near[MAX_ITEMS];
    assert_int_equal(qm_matrix_list_nearest(&matrix, 5, 3, options.tolerance, near), 3);
    assert_true(near[0].item + near[1].item == 10 && near[0].place != QM_MATRIX_OPEN);
    assert_true(near[2].item == 3 || near[2].item == 7);
    qm_matrix_reset(&ctx, &matrix);
    free_meshes(&set);
}

/** Random soups: the interval of each pair and that of a search of its own have a value in common. */
static void every_pair_agrees_with_its_own_search(void **state)
{
    (void)state;
    for (unsigned run = 0; run < 120; run++) {
        qm_random random = qm_random_make(qm_check_seed(), 9000 + run);
        qm_context ctx = qm_context_make();
        mesh_set set = {.ctx = &ctx, .quads = run % 2 ? QM_QUADS_BILINEAR : QM_QUADS_TRIANGLES};
        size_t count = 3 + qm_random_below(&random, 5);
        for (size_t i = 0; i < count; i++)
            add_mesh(&set, make_shape(&random, run % 3 == 0 ? (unsigned)qm_random_below(&random, 6) : run));
        qm_matrix_options options = options_for(&set, (qm_matrix_want)(run % 3), 1e-2);
        options.limit = 1.0;
        qm_matrix matrix;
        assert_int_equal(qm_matrix_measure(&ctx, &options, &matrix), QM_OK);
        for (size_t a = 0; a < count; a++)
            for (size_t b = a + 1; b < count; b++) {
                size_t pair = qm_matrix_pair(count, a, b);
                qm_hausdorff_result found = search(&set, a, b, 1e-3, NAN);
                QM_CHECK(matrix.lower[pair] <= found.upper && found.lower <= matrix.upper[pair],
                         "seed %llu run %u pair %zu %zu: [%.17g, %.17g] and [%.17g, %.17g]",
                         (unsigned long long)qm_check_seed(), run, a, b, matrix.lower[pair],
                         matrix.upper[pair], found.lower, found.upper);
            }
        qm_matrix_reset(&ctx, &matrix);
        free_meshes(&set);
    }
}

/** Boxes with any coordinates: the bounds hold the distance of sets that have these boxes. */
static void boxes_bound_the_sets_in_them(void **state)
{
    (void)state;
    for (unsigned run = 0; run < 4000; run++) {
        qm_random random = qm_random_make(qm_check_seed(), 20000 + run);
        double scale = ldexp(1.0, (int)qm_random_below(&random, 1900) - 1000),
               offset = run % 5 == 0 ? 1e9 : 0.0;
        double point[2][3];
        qm_box box[2];
        for (int side = 0; side < 2; side++)
            for (int k = 0; k < 3; k++) {
                point[side][k] = (offset + qm_random_range(&random, -1.0, 1.0)) * scale;
                box[side].min[k] = box[side].max[k] = point[side][k];
            }
        double lower, upper;
        qm_matrix_bound_by_boxes(&box[0], &box[1], &lower, &upper);
        long double square = 0.0L, largest = 0.0L;
        for (int k = 0; k < 3; k++) {
            long double difference = (long double)point[0][k] - point[1][k];
            square += difference * difference;
            largest = fmaxl(largest, fabsl(difference));
        }
        long double distance = sqrtl(square);
        QM_CHECK(lower <= largest && upper >= distance * (1.0L - 0x1p-60L),
                 "seed %llu run %u: %.21Lg is not in [%.17g, %.17g]", (unsigned long long)qm_check_seed(),
                 run, distance, lower, upper);
        QM_CHECK(upper <= distance * (1.0L + 0x1p-48L) + 0x1p-1072L, "run %u: %.17g is loose", run, upper);
    }
}

/** Two boxes whose distance is above all doubles. */
static void boxes_that_are_too_far_apart(void **state)
{
    (void)state;
    const qm_box a = {{-0x1p1023, 0, 0}, {-0x1p1023, 1, 1}}, b = {{0x1p1023, 0, 0}, {0x1p1023, 1, 1}};
    double lower, upper;
    qm_matrix_bound_by_boxes(&a, &b, &lower, &upper);
    assert_true(lower == DBL_MAX && upper == INFINITY);
    qm_matrix_bound_by_boxes(&b, &a, &lower, &upper);
    assert_true(lower == DBL_MAX && upper == INFINITY);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sets_of_whole_numbers),
        cmocka_unit_test(few_searches_decide),
        cmocka_unit_test(wrong_options_are_refused),
        cmocka_unit_test(flag_stops_at_once),
        cmocka_unit_test(moved_copies),
        cmocka_unit_test(nested_boxes),
        cmocka_unit_test(every_pair_agrees_with_its_own_search),
        cmocka_unit_test(boxes_bound_the_sets_in_them),
        cmocka_unit_test(boxes_that_are_too_far_apart),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
