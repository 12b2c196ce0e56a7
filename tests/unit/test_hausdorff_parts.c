/*
 * A search in parts: calls that begin with any of the parts that others have left, in any order, with any lower
 * bound that holds, on trees that are built again for each call; some calls are lost, some are made twice. The
 * bracket made of them holds the distance after every call, and closes.
 */
#include "check.h"

#include "bvh/bvh_tree.h"
#include "measured.h"
#include "random.h"
#include "regridded.h"
#include "shapes.h"
#include "slow_twin.h"

#include <math.h>
#include <string.h>

enum { MOST_PARTS = 1 << 16, MOST_AT_ONCE = 64, MOST_CALLS = 2000, PATIENCE = 32 };

/** What is stored of a search between its calls. */
typedef struct pool {
    qm_hausdorff_part part[MOST_PARTS];
    size_t count;
    double lower, discarded, upper; /* upper: the least bound so far, with its margin */
    double truth[2];                /* the distance lies between them */
    uint64_t seed;
} pool;

/** A call of the pool. */
typedef struct call {
    pool *of;
    qm_hausdorff_part rest[MOST_PARTS];
    size_t rest_count;
    double known, found;
} call;

/** Called by all workers: what it is told is checked after the call, by the thread of the test. */
static double exchange(void *user, double found)
{
    call *c = user;
    c->found = fmax(c->found, found);
    return c->of->lower;
}

static void keep_rest(void *user, const qm_hausdorff_part *part)
{
    call *c = user;
    assert_true(c->rest_count < MOST_PARTS);
    c->rest[c->rest_count++] = *part;
}

/** Runs a call with the last parts of the pool; all of the search for 0. */
static qm_hausdorff_result run_call(call *c, const qm_mesh *a, const qm_mesh *b, qm_hausdorff_options options,
                                    size_t parts)
{
    QM_CHECK(parts <= c->of->count, "seed %llu", (unsigned long long)c->of->seed);
    qm_hausdorff_parts begun = {.begin = parts > 0 ? c->of->part + c->of->count - parts : NULL,
                                .count = parts,
                                .known_lower = c->known,
                                .exchange = exchange,
                                .rest = keep_rest,
                                .user = c};
    options.parts = &begun;
    c->rest_count = 0;
    c->found = -1;
    qm_hausdorff_result r = qm_measured(a, b, &options);
    QM_CHECK(c->found <= c->of->truth[1] * (1 + 1e-12) + 1e-12, "seed %llu: found %.17g, true at most %.17g",
             (unsigned long long)c->of->seed, c->found, c->of->truth[1]);
    QM_CHECK(r.has_witness == (r.found_lower >= 0), "seed %llu: found %g", (unsigned long long)c->of->seed,
             r.found_lower);
    return r;
}

/** The bracket that the pool stands for holds the distance. */
static void check_bracket(pool *p, double margin, double size)
{
    double upper = fmax(p->lower, p->discarded), slack = 1e-12 * size;
    for (size_t i = 0; i < p->count; i++)
        upper = fmax(upper, p->part[i].upper);
    p->upper = fmin(p->upper, upper + margin);
    QM_CHECK(p->lower - margin <= p->truth[1] + slack, "seed %llu: lower %.17g, true at most %.17g",
             (unsigned long long)p->seed, p->lower - margin, p->truth[1]);
    QM_CHECK(p->upper >= p->truth[0] - slack, "seed %llu: upper %.17g, true at least %.17g",
             (unsigned long long)p->seed, p->upper, p->truth[0]);
}

/** Moves a random choice of parts to the end of the pool. */
static size_t choose_parts(pool *p, qm_random *random)
{
    size_t count = 1 + qm_random_below(random, MOST_AT_ONCE);
    if (count > p->count) count = p->count;
    for (size_t i = 0; i < count; i++) {
        size_t last = p->count - 1 - i, k = qm_random_below(random, last + 1);
        qm_hausdorff_part part = p->part[k];
        p->part[k] = p->part[last];
        p->part[last] = part;
    }
    return count;
}

static int compare_nodes(const void *a, const void *b)
{
    const qm_hausdorff_part *p = a, *q = b;
    if (p->side != q->side) return p->side < q->side ? -1 : 1;
    if (p->level != q->level) return p->level < q->level ? -1 : 1;
    return (p->index > q->index) - (p->index < q->index);
}

/** Puts packs in place of some pieces, or of all of them. */
static void drop_pieces(pool *p, qm_random *random)
{
    size_t share = qm_random_below(random, 4); /* 0: every piece stays */
    for (size_t i = 0; i < p->count; i++)
        if (share > 0 && qm_random_below(random, share) == 0) p->part[i].piece_size = 0;
}

/** A node that came several times is one part with the largest of the bounds, which stands for pieces of it. */
static void merge_parts(pool *p)
{
    size_t kept = 0;
    qsort(p->part, p->count, sizeof *p->part, compare_nodes);
    for (size_t i = 0, end; i < p->count; i = end) {
        qm_hausdorff_part whole = p->part[i];
        bool is_whole = false;
        for (end = i; end < p->count && compare_nodes(&p->part[i], &p->part[end]) == 0; end++) {
            is_whole |= p->part[end].piece_size == 0;
            whole.upper = fmax(whole.upper, p->part[end].upper);
        }
        whole.piece_size = 0;
        for (size_t k = i; k < end && !is_whole; k++)
            p->part[kept++] = p->part[k];
        if (is_whole) p->part[kept++] = whole;
    }
    p->count = kept;
}

/** The end of a call: its parts leave the pool, its rest and its bounds join it; packs in place of some pieces, with `random`. */
static void end_call(pool *p, const call *c, const qm_hausdorff_result *r, size_t parts, qm_random *random)
{
    p->count -= parts;
    assert_true(p->count + c->rest_count <= MOST_PARTS);
    if (c->rest_count > 0) memcpy(p->part + p->count, c->rest, c->rest_count * sizeof *c->rest);
    p->count += c->rest_count;
    if (random) drop_pieces(p, random);
    merge_parts(p);
    p->discarded = fmax(p->discarded, r->discarded);
    p->lower = fmax(p->lower, fmax(r->found_lower, c->found));
}

/** Adds the nodes of one level of a mesh's tree as parts of a side: together they are all of the source. */
static void add_level(pool *p, const qm_mesh *mesh, int side, qm_random *random)
{
    qm_context ctx = qm_context_make();
    qm_bvh *tree = NULL;
    assert_int_equal(qm_bvh_build(&ctx, mesh, QM_BVH_ALL, 1, &tree), QM_OK);
    int level = (int)qm_random_below(random, (size_t)tree->boxes.level_count + 1);
    for (size_t i = 0; i < tree->boxes.group_count[level]; i++)
        p->part[p->count++] = (qm_hausdorff_part){
            .upper = INFINITY, .index = (uint32_t)i, .side = (uint8_t)side, .level = (uint8_t)level};
    qm_bvh_destroy(&ctx, tree);
}

/**
 * Searches in parts until none is left; returns the number of calls. The first call is one without parts, or the
 * pool begins with all nodes of a level: no call then samples the sources, and the farthest points are found as
 * their packs come.
 */
static int check_search(uint64_t base, uint64_t seed, const qm_mesh *a, const qm_mesh *b,
                        qm_hausdorff_options options, const double truth[2], uint64_t most_work)
{
    static pool p;
    static call c;
    qm_random random = qm_random_make(base, seed);
    double size = qm_measured_size(a, b);
    p = (pool){.upper = INFINITY, .truth = {truth[0], truth[1]}, .seed = seed};
    c.of = &p;
    if (qm_random_below(&random, 2) == 0) {
        const qm_mesh *source[] = {a, b};
        for (int side = 0; side < (options.direction == QM_TWO_SIDED ? 2 : 1); side++)
            add_level(&p, source[options.direction == QM_B_TO_A ? 1 - side : side], side, &random);
    }
    int calls = 0;
    for (; calls == 0 || p.count > 0; calls++) {
        QM_CHECK(calls < MOST_CALLS, "seed %llu: %zu parts are left", (unsigned long long)seed, p.count);
        /* Where packs are put in place of pieces, little work may never end one. */
        options.work_limit =
            1 + qm_random_below(&random, most_work << (calls / PATIENCE < 16 ? calls / PATIENCE : 16));
        options.thread_count = qm_random_below(&random, 4) == 0 ? 3 : 1;
        size_t parts = p.count == 0 ? 0 : choose_parts(&p, &random);
        c.known = qm_random_below(&random, 4) == 0 ? 0 : qm_random_range(&random, 0, p.lower);
        if (qm_random_below(&random, 4) == 0) c.known = qm_random_range(&random, 0, truth[0]);
        if (qm_random_below(&random, 2) == 0) c.known = p.lower;
        p.lower = fmax(p.lower, c.known); /* it holds, wherever it comes from */
        qm_hausdorff_result r = run_call(&c, a, b, options, parts);
        bool is_lost = qm_random_below(&random, 8) == 0, is_twice = qm_random_below(&random, 8) == 0;
        if (is_lost && parts > 0) continue;
        end_call(&p, &c, &r, parts, &random);
        check_bracket(&p, r.margin, size);
        if (!is_twice || p.count == 0) continue;
        /* Another process has run parts meanwhile that are others' by now: only its lower bound counts. */
        parts = choose_parts(&p, &random);
        r = run_call(&c, a, b, options, parts);
        p.lower = fmax(p.lower, fmax(r.found_lower, c.found));
        check_bracket(&p, r.margin, size);
    }
    qm_hausdorff_result whole = qm_measured(a, b, &options);
    double gap = p.upper - fmax(0, p.lower - whole.margin);
    QM_CHECK(gap <= options.tolerance * (1 + 1e-9), "seed %llu: gap %g after %d calls",
             (unsigned long long)seed, gap, calls);
    return calls;
}

/** Searches two soups in parts; returns the number of calls. */
static int search_soups(uint64_t base, uint64_t seed)
{
    qm_random random = qm_random_make(base, 700000 + seed);
    qm_soup_style style = (qm_soup_style)qm_random_below(&random, QM_SOUP_STYLE_COUNT);
    qm_soup_corners corners = (qm_soup_corners)qm_random_below(&random, 3);
    qm_mesh a = qm_shape_soup(&random, 20 + qm_random_below(&random, 120), corners, style, 0.1), b;
    if (qm_random_below(&random, 2) == 0) {
        qm_mesh copy = qm_shape_copy(&a);
        qm_shape_shake(&copy, &random, 0.1);
        b = qm_shape_reversed(&copy);
        qm_shape_free(&copy);
    } else {
        b = qm_shape_soup(&random, 20 + qm_random_below(&random, 60), corners, style, 0.1);
    }
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.direction = (qm_direction)qm_random_below(&random, 3);
    options.quads = (qm_quad_reading)qm_random_below(&random, 2);
    options.tolerance = 1e-3 * qm_measured_size(&a, &b);
    if (options.quads == QM_QUADS_TRIANGLES && qm_random_below(&random, 6) == 0)
        options.bounds = QM_BOUNDS_MATCHING;
    size_t cells = options.quads == QM_QUADS_BILINEAR ? 100 : 400; /* its bracket holds in any case */
    qm_slow_bracket slow =
        qm_slow_hausdorff(&a, &b, options.direction, options.quads, options.tolerance, cells);
    int calls = check_search(base, seed, &a, &b, options, (const double[]){slow.lower, slow.upper}, 12);
    qm_shape_free(&a);
    qm_shape_free(&b);
    return calls;
}

static void soups_in_parts_hold_the_distance(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 2000 : 60;
    int most = 0;
    for (uint64_t seed = 0; seed < count; seed++) {
        int calls = search_soups(qm_check_seed(), seed);
        most = calls > most ? calls : most;
    }
    assert_true(most > 10);
}

/** Samples of the corners of one piece that brought two packs: the second one was asked for before the first was there. For
 * a build that finds reads of freed memory. */
static void pieces_that_are_sampled_twice(void **state)
{
    (void)state;
    search_soups(22, 81);
    search_soups(21, 238);
}

/** Two spheres, one turned about its axis by half a cell: their distance is 1 - cos(pi / 100). */
static void spheres_in_parts_hold_the_distance(void **state)
{
    (void)state;
    const double pi = 3.14159265358979323846, truth = 2 * sin(pi / 200) * sin(pi / 200);
    qm_mesh a = qm_shape_sphere(0), b = qm_shape_sphere(pi / 100);
    for (uint64_t seed = 0; seed < 3; seed++) {
        qm_hausdorff_options options = qm_hausdorff_options_default();
        options.tolerance = 1e-6;
        int calls = check_search(qm_check_seed(), seed, &a, &b, options, (const double[]){truth, truth}, 400);
        assert_true(calls > 4);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** Folded patches in one grid, and a little apart in another: much is left of most faces before they are proved near. */
static void make_folds(qm_random *random, bool as_triangles, qm_mesh *a, qm_mesh *b)
{
    const double half[] = {0, 0.5, 1}, third[] = {0, 0.34, 0.67, 1}, shift[] = {0, 0, 1.0 / 512};
    qm_mesh heap = qm_folded_heap(random, 12);
    *a = qm_regridded(&heap, 2, half, 2, half, as_triangles);
    *b = qm_regridded(&heap, 3, third, 3, third, as_triangles);
    qm_shape_move(b, 1, shift);
    qm_shape_free(&heap);
}

/** Iterations of a search by calls of `most` iterations, each of which goes on with all that the one before has left. */
static uint64_t work_of_calls(const qm_mesh *a, const qm_mesh *b, qm_hausdorff_options options, uint64_t most,
                              int *calls)
{
    static pool p;
    static call c;
    uint64_t iterations = 0;
    p = (pool){.truth = {0, INFINITY}};
    c.of = &p;
    options.work_limit = most;
    for (*calls = 0; *calls == 0 || p.count > 0; ++*calls) {
        QM_CHECK(*calls < MOST_CALLS, "%zu parts are left", p.count);
        c.known = p.lower;
        size_t parts = p.count;
        qm_hausdorff_result r = run_call(&c, a, b, options, parts);
        end_call(&p, &c, &r, parts, NULL);
        iterations += r.iterations;
    }
    return iterations;
}

/** What a call leaves is all that is left to do: calls of which none ends a pack do together what one call does. */
static void calls_do_nothing_again(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 720000);
    for (int i = 0; i < 6; i++) {
        qm_mesh a, b;
        make_folds(&random, false, &a, &b);
        qm_hausdorff_options options = qm_hausdorff_options_default();
        options.quads = QM_QUADS_BILINEAR;
        options.tolerance = 1e-6 * qm_measured_size(&a, &b);
        qm_hausdorff_result whole = qm_measured(&a, &b, &options);
        int calls;
        uint64_t work = work_of_calls(&a, &b, options, whole.iterations / 20 + 1, &calls);
        QM_CHECK(calls >= 10 && (double)work <= 1.1 * (double)whole.iterations + 16.0 * calls,
                 "case %d: %llu iterations in %d calls, %llu whole", i, (unsigned long long)work, calls,
                 (unsigned long long)whole.iterations);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

static qm_status status_with(const qm_mesh *a, const qm_mesh *b, qm_hausdorff_options options,
                             const qm_hausdorff_parts *parts)
{
    qm_context ctx = qm_context_make();
    qm_bvh *tree_a = NULL, *tree_b = NULL;
    qm_hausdorff_result result;
    options.parts = parts;
    assert_int_equal(qm_bvh_build(&ctx, a, QM_BVH_ALL, 1, &tree_a), QM_OK);
    assert_int_equal(qm_bvh_build(&ctx, b, QM_BVH_ALL, 1, &tree_b), QM_OK);
    qm_status status = qm_hausdorff_measure(&ctx, tree_a, tree_b, &options, &result);
    qm_bvh_destroy(&ctx, tree_a);
    qm_bvh_destroy(&ctx, tree_b);
    return status;
}

static qm_status status_of(const qm_mesh *a, const qm_mesh *b, const qm_hausdorff_parts *parts)
{
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.direction = QM_A_TO_B;
    options.tolerance = 1e-6;
    return status_with(a, b, options, parts);
}

static void parts_that_the_trees_lack_are_refused(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_plane(2, 0), b = qm_shape_plane(2, 1); /* one pack and one node each */
    const qm_hausdorff_part wrong[] = {
        {.upper = 1, .side = 1},
        {.upper = 1, .level = 2},
        {.upper = 1, .index = 1},
        {.upper = 1, .hint = 1},
        {.upper = -1},
        {.upper = NAN},
        {.upper = 1, .level = 1, .index = 1},
    };
    qm_hausdorff_part right = {.upper = 4, .level = 1};
    qm_hausdorff_parts parts = {.begin = &right, .count = 1};
    assert_int_equal(status_of(&a, &b, &parts), QM_OK);
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        parts.begin = &wrong[i];
        QM_CHECK(status_of(&a, &b, &parts) == QM_E_ARGUMENT, "part %zu", i);
    }
    const double lower[] = {-1, NAN, INFINITY};
    parts.begin = &right;
    for (size_t i = 0; i < sizeof lower / sizeof *lower; i++) {
        parts.known_lower = lower[i];
        QM_CHECK(status_of(&a, &b, &parts) == QM_E_ARGUMENT, "lower bound %g", lower[i]);
    }
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** A piece with a changed byte is refused, or is another piece: nothing worse comes of it. */
static void pieces_that_are_none_are_refused(void **state)
{
    (void)state;
    static pool p;
    static call c;
    qm_random random = qm_random_make(qm_check_seed(), 730000);
    /* Patches, triangles, and triangles by matching. */
    const qm_bounds bounds[] = {QM_BOUNDS_COVER, QM_BOUNDS_COVER, QM_BOUNDS_MATCHING};
    for (int i = 0; i < 3; i++) {
        qm_mesh a, b;
        make_folds(&random, i > 0, &a, &b);
        qm_hausdorff_options options = qm_hausdorff_options_default();
        options.direction = QM_A_TO_B;
        options.quads = i == 0 ? QM_QUADS_BILINEAR : QM_QUADS_TRIANGLES;
        options.bounds = bounds[i];
        options.tolerance = 1e-9;
        c.of = &p;
        c.known = 0;
        c.rest_count = 0;
        bool has_piece = false;
        for (options.work_limit = 1; !has_piece && options.work_limit < 1000; options.work_limit *= 2) {
            p = (pool){.truth = {0, INFINITY}};
            run_call(&c, &a, &b, options, 0);
            for (size_t k = 0; k < c.rest_count; k++)
                has_piece |= c.rest[k].piece_size > 0;
        }
        size_t pieces = 0;
        for (size_t k = 0; k < c.rest_count; k++) {
            qm_hausdorff_part part = c.rest[k];
            if (part.piece_size == 0) continue;
            pieces++;
            qm_hausdorff_parts parts = {.begin = &part, .count = 1};
            assert_int_equal(status_with(&a, &b, options, &parts), QM_OK);
            part.piece_size--;
            assert_int_equal(status_with(&a, &b, options, &parts), QM_E_ARGUMENT);
            part.piece_size++;
            part.level = 1, part.index = 0;
            assert_int_equal(status_with(&a, &b, options, &parts), QM_E_ARGUMENT);
            part = c.rest[k];
            memset(part.piece + 4, 0xff, 4); /* the face */
            assert_int_equal(status_with(&a, &b, options, &parts), QM_E_ARGUMENT);
            part = c.rest[k];
            memset(part.piece + 16, 0xff, 8); /* a coordinate: not a number */
            assert_int_equal(status_with(&a, &b, options, &parts), QM_E_ARGUMENT);
            part = c.rest[k];
            part.piece[qm_random_below(&random, part.piece_size)] ^=
                (unsigned char)(1 + qm_random_below(&random, 255));
            qm_status status = status_with(&a, &b, options, &parts);
            assert_true(status == QM_OK || status == QM_E_ARGUMENT);
        }
        assert_true(pieces > 0);
        qm_shape_free(&a);
        qm_shape_free(&b);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(soups_in_parts_hold_the_distance),
        cmocka_unit_test(pieces_that_are_sampled_twice),
        cmocka_unit_test(spheres_in_parts_hold_the_distance),
        cmocka_unit_test(calls_do_nothing_again),
        cmocka_unit_test(pieces_that_are_none_are_refused),
        cmocka_unit_test(parts_that_the_trees_lack_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
