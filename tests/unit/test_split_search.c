/*
 * Searches in parts with the engine and an embedded store: whoever runs the parts, is stopped, dies between its claim and
 * its finish, or runs what another runs too, every bracket holds the distance, the stored bounds are monotone, and the
 * search ends.
 */
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <uv.h>

#include "check.h"
#include "folder.h"
#include "job/split_search.h"
#include "measured.h"
#include "random.h"
#include "shapes.h"

#define ROUND_MS 20.0 /* short, though a sanitized build has to get on in it */

enum { HELPERS = 2, MOST_LIVES = 400, MOST_PIECES = 1000 };

/** A pair with its store, and the bounds of its distance. */
typedef struct scene {
    char *folder;
    qm_store *store;
    qm_mesh a, b;
    qm_bvh *tree_a, *tree_b;
    qm_hausdorff_options options;
    double low, high; /* the distance lies between them */
    uint64_t seed;
    size_t most_pieces;
} scene;

/** What a listener to one run has heard. */
typedef struct listener {
    const scene *of;
    double lower, upper;
    int reports, most; /* after these it raises the flag */
    atomic_bool cancel;
} listener;

static void open_store(scene *s)
{
    char message[QM_MESSAGE_SIZE] = "";
    qm_store_open(s->folder, QM_STORE_SERVE, &s->store, message);
    QM_CHECK(s->store, "%s", message);
}

static void submit(scene *s)
{
    const qm_store_job job = {.id = "j_split",
                              .key = "key",
                              .body = "{}",
                              .type = "hausdorff",
                              .created = "2026-01-02T03:04:05.678Z"};
    assert_int_equal(qm_store_submit_job(s->store, &(qm_store_submission){.job = &job}), QM_STORED);
}

/** Takes over the meshes. */
static scene make_scene(qm_mesh a, qm_mesh b, double tolerance, uint64_t seed)
{
    scene s = {.folder = qm_folder_make(), .a = a, .b = b, .seed = seed, .most_pieces = MOST_PIECES};
    qm_context ctx = qm_context_make();
    assert_int_equal(qm_bvh_build(&ctx, &s.a, QM_BVH_ALL, 1, &s.tree_a), QM_OK);
    assert_int_equal(qm_bvh_build(&ctx, &s.b, QM_BVH_ALL, 1, &s.tree_b), QM_OK);
    s.options = qm_hausdorff_options_default();
    s.options.tolerance = tolerance;
    open_store(&s);
    submit(&s);
    return s;
}

static void free_scene(scene *s)
{
    qm_context ctx = qm_context_make();
    qm_store_close(s->store);
    qm_bvh_destroy(&ctx, s->tree_a);
    qm_bvh_destroy(&ctx, s->tree_b);
    qm_shape_free(&s->a);
    qm_shape_free(&s->b);
    qm_folder_remove(s->folder);
}

/** Two spheres, one turned about its axis by half a cell: their distance is 1 - cos(pi / 100). */
static scene make_spheres(uint64_t seed)
{
    const double pi = 3.14159265358979323846, truth = 2 * sin(pi / 200) * sin(pi / 200);
    scene s = make_scene(qm_shape_sphere(0), qm_shape_sphere(pi / 100), 1e-6, seed);
    s.low = truth * (1 - 1e-12);
    s.high = truth * (1 + 1e-12);
    return s;
}

/** Soups, whose distance the whole search knows more closely. */
static scene make_soups(uint64_t seed)
{
    qm_random random = qm_random_make(qm_check_seed(), 810000 + seed);
    qm_soup_style style = (qm_soup_style)qm_random_below(&random, QM_SOUP_STYLE_COUNT);
    qm_soup_corners corners = (qm_soup_corners)qm_random_below(&random, 3);
    qm_mesh a = qm_shape_soup(&random, 100 + qm_random_below(&random, 400), corners, style, 0.1);
    qm_mesh b = qm_shape_copy(&a);
    qm_shape_shake(&b, &random, 0.1);
    scene s = make_scene(a, b, 1e-5 * qm_measured_size(&a, &b), seed);
    s.options.direction = (qm_direction)qm_random_below(&random, 3);
    s.options.quads = (qm_quad_reading)qm_random_below(&random, 2);
    qm_hausdorff_options close = s.options;
    close.tolerance *= 0.01;
    qm_hausdorff_result whole = qm_measured(&s.a, &s.b, &close);
    s.low = whole.lower;
    s.high = whole.upper;
    return s;
}

static void hear(void *user, const qm_hausdorff_progress *progress)
{
    listener *l = user;
    QM_CHECK(progress->lower >= l->lower && progress->upper <= l->upper,
             "seed %llu: %.17g %.17g widen to %.17g %.17g", (unsigned long long)l->of->seed, l->lower,
             l->upper, progress->lower, progress->upper);
    l->lower = progress->lower;
    l->upper = progress->upper;
    QM_CHECK(l->lower <= l->of->high && l->upper >= l->of->low, "seed %llu: %.17g %.17g without %.17g %.17g",
             (unsigned long long)l->of->seed, l->lower, l->upper, l->of->low, l->of->high);
    if (++l->reports >= l->most) atomic_store(&l->cancel, true);
}

/** One run by the owner, which is stopped after so many reports. */
static qm_hausdorff_result own(scene *s, int64_t restarts, double whole_ms, double round_ms, int reports)
{
    qm_context ctx = qm_context_make();
    listener l = {.of = s, .upper = INFINITY, .most = reports};
    ctx.cancel = &l.cancel;
    qm_split split = {.store = s->store,
                      .job = "j_split",
                      .restarts = restarts,
                      .whole_ms = whole_ms,
                      .round_ms = round_ms,
                      .most_pieces = s->most_pieces};
    qm_hausdorff_options options = s->options;
    options.progress = hear;
    options.progress_user = &l;
    qm_hausdorff_result result;
    qm_status status = qm_split_measure(&split, &ctx, s->tree_a, s->tree_b, &options, &result);
    QM_CHECK(status == QM_OK, "seed %llu: %s", (unsigned long long)s->seed, ctx.message);
    QM_CHECK(result.lower <= s->high && result.upper >= s->low, "seed %llu: %.17g %.17g without %.17g %.17g",
             (unsigned long long)s->seed, result.lower, result.upper, s->low, s->high);
    return result;
}

static void check_end(const scene *s, const qm_hausdorff_result *r)
{
    QM_CHECK(r->stop == QM_STOP_CONVERGED && r->upper - r->lower <= s->options.tolerance,
             "seed %llu: stop %d at %.17g %.17g", (unsigned long long)s->seed, (int)r->stop, r->lower,
             r->upper);
    assert_true(r->has_witness && r->iterations > 0);
    double distance = 0;
    for (int k = 0; k < 3; k++)
        distance += (r->from.position[k] - r->to.position[k]) * (r->from.position[k] - r->to.position[k]);
    QM_CHECK(fabs(sqrt(distance) - r->lower) <= s->options.tolerance + 2 * r->margin,
             "seed %llu: witness %.17g, lower %.17g", (unsigned long long)s->seed, sqrt(distance), r->lower);
}

static void one_process_ends_a_search(void **state)
{
    (void)state;
    for (int i = 0; i < 2; i++) {
        scene s = make_spheres((uint64_t)i);
        qm_hausdorff_result r = own(&s, 0, 1e-3, (const double[]){10, 2000}[i], INT32_MAX);
        check_end(&s, &r);
        qm_store_bounds bounds;
        assert_int_equal(qm_store_read_bounds(s.store, "j_split", NULL, 0, &bounds), QM_STORED);
        assert_int_equal(bounds.iterations, r.iterations);
        free_scene(&s);
    }
}

static void a_short_search_stores_nothing(void **state)
{
    (void)state;
    scene s = make_spheres(0);
    qm_hausdorff_result r = own(&s, 0, 1e9, 1e9, INT32_MAX), whole = qm_measured(&s.a, &s.b, &s.options);
    assert_true(r.lower == whole.lower && r.upper == whole.upper && r.iterations == whole.iterations);
    qm_store_bounds bounds;
    assert_int_equal(qm_store_read_bounds(s.store, "j_split", NULL, 0, &bounds), QM_STORED_NONE);
    free_scene(&s);
}

/** Ends the process: the claims of its last moment are lost. Returns the claims of the job before the next one. */
static int64_t die(scene *s, qm_random *random)
{
    qm_store_part lost[8];
    qm_store_job row;
    size_t count;
    assert_int_equal(qm_store_claim_parts(s->store, "j_split", qm_random_below(random, 8), lost, &count),
                     QM_STORED);
    qm_store_parts_reset(lost, count);
    qm_store_close(s->store);
    open_store(s);
    assert_int_equal(qm_store_claim_jobs(s->store, &(qm_store_wish){.free = 1}, &row, &count), QM_STORED);
    assert_int_equal(count, 1);
    int64_t restarts = row.restarts;
    qm_store_job_reset(&row);
    return restarts;
}

/** Stops the owner after a few reports, again and again. */
static void check_lives(scene *s)
{
    qm_random random = qm_random_make(qm_check_seed(), 820000 + s->seed);
    qm_store_bounds before = {.upper = INFINITY, .discarded = INFINITY}, now;
    qm_hausdorff_result r = {.stop = QM_STOP_CANCELED};
    int64_t restarts = 0;
    int lives = 0;
    for (; r.stop == QM_STOP_CANCELED; lives++) {
        QM_CHECK(lives < MOST_LIVES, "seed %llu: it does not end", (unsigned long long)s->seed);
        /* Of a run without any report, as of a very short one, nothing is told: the next one gets longer. */
        r = own(s, restarts, 0.2, ROUND_MS, 2 + (int)qm_random_below(&random, 6) + lives / 8);
        if (qm_store_read_bounds(s->store, "j_split", NULL, 0, &now) == QM_STORED) {
            double upper = fmax(now.lower, fmax(now.discarded, now.upper));
            QM_CHECK(now.lower >= before.lower &&
                         upper <= fmax(before.lower, fmax(before.discarded, before.upper)),
                     "seed %llu: stored bounds widen", (unsigned long long)s->seed);
            before = now;
        }
        if (r.stop == QM_STOP_CANCELED) restarts = die(s, &random);
    }
    check_end(s, &r);
}

static void a_search_goes_on_after_deaths(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < (qm_check_long() ? 20u : 1u); seed++) {
        scene s = make_spheres(seed);
        check_lives(&s);
        free_scene(&s);
    }
    for (uint64_t seed = 0; seed < (qm_check_long() ? 200u : 5u); seed++) {
        scene s = make_soups(seed);
        check_lives(&s);
        free_scene(&s);
    }
}

/** A thread that helps with a round now and then until the owner has ended. */
typedef struct helper {
    const scene *of;
    atomic_bool *is_over;
    int calls; /* of stops since the last help */
} helper;

static bool has_done_one(void *user)
{
    helper *h = user;
    return h->calls++ > 0 || atomic_load(h->is_over);
}

static void *help(void *user)
{
    helper *h = user;
    const scene *s = h->of;
    qm_context ctx = qm_context_make();
    qm_split split = {
        .store = s->store, .job = "j_split", .round_ms = ROUND_MS, .most_pieces = s->most_pieces};
    for (; !atomic_load(h->is_over); h->calls = 0) {
        qm_split_help(&split, &ctx, s->tree_a, s->tree_b, &s->options, has_done_one, h);
        uv_sleep(50);
    }
    return NULL;
}

/** In an embedded store each claim takes parts from whoever runs them: many are run more than once. */
static void check_helpers(scene *s)
{
    atomic_bool over = false;
    pthread_t threads[HELPERS];
    helper helpers[HELPERS];
    for (int i = 0; i < HELPERS; i++) {
        helpers[i] = (helper){s, &over, 0};
        assert_int_equal(pthread_create(&threads[i], NULL, help, &helpers[i]), 0);
    }
    qm_hausdorff_result r = own(s, 0, 1e-3, ROUND_MS, INT32_MAX);
    atomic_store(&over, true);
    for (int i = 0; i < HELPERS; i++)
        pthread_join(threads[i], NULL);
    check_end(s, &r);
}

static void parts_that_are_run_twice_count_once(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < (qm_check_long() ? 20u : 1u); seed++) {
        scene s = make_spheres(seed);
        check_helpers(&s);
        free_scene(&s);
    }
    for (uint64_t seed = 20; seed < (qm_check_long() ? 220u : 23u); seed++) {
        scene s = make_soups(seed);
        check_helpers(&s);
        free_scene(&s);
    }
}

/** Parts of other trees are not run: the search begins anew. */
static void parts_of_other_trees_are_left(void **state)
{
    (void)state;
    scene s = make_spheres(0);
    const qm_store_bounds other = {.engine = "another", .lower = 100, .discarded = 100};
    assert_int_equal(qm_store_open_parts(s.store, "j_split", 0, &other, NULL, 0), QM_STORED);
    qm_context ctx = qm_context_make();
    atomic_bool over = false;
    helper h = {&s, &over, 0};
    qm_split split = {.store = s.store, .job = "j_split", .round_ms = ROUND_MS, .most_pieces = MOST_PIECES};
    assert_false(qm_split_help(&split, &ctx, s.tree_a, s.tree_b, &s.options, has_done_one, &h));
    qm_random random = qm_random_make(qm_check_seed(), 830000);
    qm_hausdorff_result r = own(&s, die(&s, &random), 1e-3, 20, INT32_MAX);
    check_end(&s, &r);
    free_scene(&s);
}

static void other_trees_have_other_fingerprints(void **state)
{
    (void)state;
    scene s = make_spheres(0);
    qm_context ctx = qm_context_make();
    qm_bvh *again = NULL, *turned = NULL;
    qm_mesh reversed = qm_shape_reversed(&s.a);
    assert_int_equal(qm_bvh_build(&ctx, &s.a, QM_BVH_TARGET, 1, &again), QM_OK);
    assert_int_equal(qm_bvh_build(&ctx, &reversed, QM_BVH_TARGET, 1, &turned), QM_OK);
    assert_true(qm_bvh_fingerprint(s.tree_a) == qm_bvh_fingerprint(again));
    assert_true(qm_bvh_fingerprint(s.tree_a) != qm_bvh_fingerprint(turned));
    assert_true(qm_bvh_fingerprint(s.tree_a) != qm_bvh_fingerprint(s.tree_b));
    qm_bvh_destroy(&ctx, again);
    qm_bvh_destroy(&ctx, turned);
    qm_shape_free(&reversed);
    free_scene(&s);
}

/** Packs in place of pieces: the search takes more work, and its bounds hold. */
static void pieces_that_are_too_many_become_packs(void **state)
{
    (void)state;
    for (uint64_t seed = 30; seed < (qm_check_long() ? 60u : 34u); seed++) {
        scene s = make_soups(seed);
        s.most_pieces = seed % 4;
        s.options.work_limit = UINT64_C(1) << 40;
        qm_hausdorff_result r = own(&s, 0, 1e-3, 100, INT32_MAX);
        check_end(&s, &r);
        free_scene(&s);
    }
}

/** Limits end a search in parts as they end a whole one. */
static void limits_end_a_search(void **state)
{
    (void)state;
    scene s = make_spheres(0);
    s.options.threshold = 0.5 * s.low;
    qm_hausdorff_result r = own(&s, 0, 1e-3, 3, INT32_MAX);
    assert_int_equal(r.stop, QM_STOP_THRESHOLD);
    assert_int_equal(r.verdict, QM_VERDICT_ABOVE);
    free_scene(&s);
    s = make_spheres(1);
    s.options.threshold = 2 * s.high;
    r = own(&s, 0, 1e-3, 3, INT32_MAX);
    assert_int_equal(r.verdict, QM_VERDICT_BELOW);
    free_scene(&s);
    s = make_spheres(2);
    s.options.tolerance = 1e-15;
    s.options.deadline_ms = 30;
    r = own(&s, 0, 1e-3, 3, INT32_MAX);
    assert_true(r.stop == QM_STOP_DEADLINE || r.stop == QM_STOP_PRECISION);
    free_scene(&s);
    s = make_spheres(3);
    /* The same work as of a whole search: its calls count together, and a limit is seen an interval late. */
    s.options.work_limit = 200;
    r = own(&s, 0, 1e-3, 3, INT32_MAX);
    qm_hausdorff_result whole = qm_measured(&s.a, &s.b, &s.options);
    assert_int_equal(r.stop, QM_STOP_DEADLINE);
    assert_int_equal(whole.stop, QM_STOP_DEADLINE);
    QM_CHECK(r.iterations >= 200 && r.iterations <= whole.iterations + 32,
             "%llu iterations, %llu of a whole search", (unsigned long long)r.iterations,
             (unsigned long long)whole.iterations);
    free_scene(&s);
    s = make_spheres(4);
    s.options.memory_limit = 1;
    r = own(&s, 0, 1e-3, 3, INT32_MAX);
    assert_int_equal(r.stop, QM_STOP_MEMORY);
    free_scene(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_process_ends_a_search),
        cmocka_unit_test(a_short_search_stores_nothing),
        cmocka_unit_test(a_search_goes_on_after_deaths),
        cmocka_unit_test(parts_that_are_run_twice_count_once),
        cmocka_unit_test(parts_of_other_trees_are_left),
        cmocka_unit_test(other_trees_have_other_fingerprints),
        cmocka_unit_test(pieces_that_are_too_many_become_packs),
        cmocka_unit_test(limits_end_a_search),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
