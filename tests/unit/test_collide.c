/* Collision of meshes against all pairs of their triangles in whole numbers. */
#include <string.h>

#include "base/host.h"
#include "check.h"
#include "data_mesh.h"
#include "exact_twin.h"
#include "failing_allocator.h"
#include "qm/collide.h"
#include "shapes.h"

/** A soup with corners that are whole numbers; triangles, quads and polygons, cut as the reader would. */
typedef struct bigint_soup {
    qm_mesh mesh;
    qm_bigint_point *corner; /* of each vertex */
} bigint_soup;

static void *grab(size_t count, size_t width)
{
    void *block = calloc(count > 0 ? count : 1, width);
    if (!block) abort();
    return block;
}

static void set_position(bigint_soup *soup, size_t vertex, double step, const double shift[3])
{
    for (int k = 0; k < 3; k++)
        soup->mesh.positions[3 * vertex + (size_t)k] = step * ((double)soup->corner[vertex].x[k] + shift[k]);
}

/**
 * limit bounds the coordinates and pool the vertices: small ones make contact of every kind. With polygons
 * some neighbours are one face of the input.
 */
static bigint_soup make_soup(qm_random *random, size_t faces, size_t pool, int limit, bool has_quads,
                             bool has_polygons)
{
    bigint_soup soup = {qm_shape_make(pool, faces), grab(pool, sizeof(qm_bigint_point))};
    static const double none[3];
    bool is_flat = qm_random_below(random, 4) == 0;
    for (size_t v = 0; v < pool; v++) {
        for (int k = 0; k < 3; k++)
            soup.corner[v].x[k] = (int64_t)qm_random_below(random, (size_t)(2 * limit + 1)) - limit;
        if (is_flat) soup.corner[v].x[2] = soup.corner[v].x[0];
        set_position(&soup, v, 1.0, none);
    }
    for (size_t f = 0; f < faces; f++)
        for (int i = 0; i < 4; i++)
            soup.mesh.faces[4 * f + (size_t)i] = i == 3 && (!has_quads || qm_random_below(random, 2) == 0)
                                                     ? QM_NO_INDEX
                                                     : (uint32_t)qm_random_below(random, pool);
    if (has_polygons) {
        soup.mesh.face_origin = grab(faces, sizeof(uint32_t));
        for (size_t f = 1; f < faces; f++)
            soup.mesh.face_origin[f] =
                soup.mesh.face_origin[f - 1] + (qm_random_below(random, 3) > 0 ? 1 : 0);
    }
    return soup;
}

static void free_soup(bigint_soup *soup)
{
    free(soup->corner);
    qm_shape_free(&soup->mesh);
}

/** Triangle t of a face; false when it has none. */
static bool load_triangle(const bigint_soup *soup, size_t face, int t, uint32_t index[3],
                          qm_bigint_point p[3])
{
    const uint32_t *corner = soup->mesh.faces + 4 * face;
    if (t == 1 && corner[3] == QM_NO_INDEX) return false;
    index[0] = corner[0];
    index[1] = corner[1 + t];
    index[2] = corner[2 + t];
    for (int i = 0; i < 3; i++)
        p[i] = soup->corner[index[i]];
    return true;
}

static bool faces_meet(const bigint_soup *a, size_t i, const bigint_soup *b, size_t k, bool is_self)
{
    uint32_t a_index[3], b_index[3];
    qm_bigint_point p[3], q[3];
    for (int s = 0; s < 2; s++)
        for (int t = 0; t < 2; t++)
            if (load_triangle(a, i, s, a_index, p) && load_triangle(b, k, t, b_index, q) &&
                (is_self ? qm_exact_cross(p, a_index, q, b_index) : qm_exact_meet(p, q)))
                return true;
    return false;
}

/** Every pair, marked at [input face of a][input face of b]. */
static uint8_t *slow_pairs(const bigint_soup *a, const bigint_soup *b, bool is_self, size_t *count)
{
    size_t rows = a->mesh.face_count, columns = b->mesh.face_count;
    uint8_t *meets = grab(rows * columns, 1);
    for (size_t i = 0; i < rows; i++) {
        for (size_t k = is_self ? i + 1 : 0; k < columns; k++) {
            size_t at_a = qm_mesh_input_face(&a->mesh, (uint32_t)i),
                   at_b = qm_mesh_input_face(&b->mesh, (uint32_t)k);
            if (is_self && at_a == at_b) continue;
            if (faces_meet(a, i, b, k, is_self)) meets[at_a * columns + at_b] = 1;
        }
    }
    *count = 0;
    for (size_t i = 0; i < rows * columns; i++)
        *count += meets[i];
    return meets;
}

static qm_collision collide(const qm_mesh *a, const qm_mesh *b, qm_collide_mode mode, int threads)
{
    qm_context ctx = qm_context_make();
    ctx.parallel = qm_host_parallel;
    qm_bvh *bvh_a, *bvh_b = NULL;
    qm_collision found;
    qm_collide_options options = qm_collide_options_default();
    options.mode = mode;
    options.thread_count = threads;
    assert_int_equal(qm_bvh_build(&ctx, a, QM_BVH_SOURCE, 1, &bvh_a), QM_OK);
    if (b) {
        assert_int_equal(qm_bvh_build(&ctx, b, QM_BVH_SOURCE, 1, &bvh_b), QM_OK);
        assert_int_equal(qm_collide_meshes(&ctx, bvh_a, bvh_b, &options, &found), QM_OK);
    } else {
        assert_int_equal(qm_collide_self(&ctx, bvh_a, &options, NULL, &found), QM_OK);
    }
    qm_bvh_destroy(&ctx, bvh_a);
    qm_bvh_destroy(&ctx, bvh_b);
    return found;
}

static void free_collision(qm_collision *collision)
{
    qm_context ctx = qm_context_make();
    qm_collide_reset(&ctx, collision);
}

static void check_order(const qm_collision *found)
{
    for (size_t i = 1; i < found->pair_count; i++) {
        qm_face_pair last = found->pairs[i - 1], here = found->pairs[i];
        assert_true(last.a < here.a || (last.a == here.a && last.b < here.b));
    }
}

static void check_same(const qm_collision *x, const qm_collision *y)
{
    assert_int_equal(x->pair_count, y->pair_count);
    if (x->pair_count > 0) assert_memory_equal(x->pairs, y->pairs, x->pair_count * sizeof *x->pairs);
}

/** All modes and thread counts agree with all pairs on one thread. */
static void check_modes(const bigint_soup *a, const bigint_soup *b, const qm_collision *all)
{
    const qm_mesh *other = b ? &b->mesh : NULL;
    qm_collision first = collide(&a->mesh, other, QM_COLLIDE_FIRST, 1),
                 any = collide(&a->mesh, other, QM_COLLIDE_ANY, 3),
                 threads = collide(&a->mesh, other, QM_COLLIDE_ALL, 3);
    check_same(all, &threads);
    assert_int_equal(first.pair_count, all->pair_count > 0);
    assert_int_equal(any.pair_count, all->pair_count > 0);
    if (all->pair_count > 0) {
        assert_memory_equal(first.pairs, all->pairs, sizeof *all->pairs);
        bool known = false;
        for (size_t i = 0; i < all->pair_count; i++)
            known |= all->pairs[i].a == any.pairs[0].a && all->pairs[i].b == any.pairs[0].b;
        assert_true(known);
    }
    free_collision(&first);
    free_collision(&any);
    free_collision(&threads);
}

static void check_contacts(const bigint_soup *a, const bigint_soup *b, const qm_collision *found)
{
    qm_collide_options options = qm_collide_options_default();
    for (size_t i = 0; i < found->pair_count; i++) {
        qm_contact contact;
        assert_true(
            qm_collide_contact(&a->mesh, b ? &b->mesh : &a->mesh, &options, found->pairs[i], &contact));
    }
}

static void check_soups(bigint_soup *a, bigint_soup *b, unsigned run)
{
    size_t expected;
    const bigint_soup *other = b ? b : a;
    uint8_t *meets = slow_pairs(a, other, !b, &expected);
    qm_collision found = collide(&a->mesh, b ? &b->mesh : NULL, QM_COLLIDE_ALL, 1);
    check_order(&found);
    for (size_t i = 0; i < found.pair_count; i++) {
        qm_face_pair pair = found.pairs[i];
        QM_CHECK(meets[pair.a * other->mesh.face_count + pair.b], "seed %llu run %u: %u %u don't meet",
                 (unsigned long long)qm_check_seed(), run, pair.a, pair.b);
    }
    QM_CHECK(found.pair_count == expected, "seed %llu run %u: %zu pairs, not %zu",
             (unsigned long long)qm_check_seed(), run, found.pair_count, expected);
    if (run % 4 == 0) check_modes(a, b, &found);
    if (run % 4 == 1) check_contacts(a, b, &found);
    /* An exact shift and scale of everything changes nothing. */
    const double shift[3] = {1 << 20, -5000, 77};
    for (size_t v = 0; v < a->mesh.vertex_count; v++)
        set_position(a, v, 0x1p-7, shift);
    for (size_t v = 0; b && v < b->mesh.vertex_count; v++)
        set_position(b, v, 0x1p-7, shift);
    qm_collision moved = collide(&a->mesh, b ? &b->mesh : NULL, QM_COLLIDE_ALL, 1);
    check_same(&found, &moved);
    free_collision(&moved);
    free_collision(&found);
    free(meets);
}

/** A soup against an equal one, where every face meets itself and every pair counts both ways. */
static void check_twins(bigint_soup *soup, unsigned run)
{
    bigint_soup twin = {qm_shape_copy(&soup->mesh), soup->corner};
    check_soups(soup, &twin, run);
    qm_shape_free(&twin.mesh);
}

static void soups_match_twin(void **state)
{
    (void)state;
    unsigned runs = qm_check_long() ? 400 : 60;
    size_t sum = 0;
    for (unsigned run = 0; run < runs; run++) {
        qm_random random = qm_random_make(qm_check_seed(), run);
        size_t faces = 1 + qm_random_below(&random, 45);
        int limit = run % 3 == 0 ? 2 : run % 3 == 1 ? 10 : 400;
        size_t pool = 3 + qm_random_below(&random, 3 * faces);
        bigint_soup a = make_soup(&random, faces, pool, limit, run % 2 == 1, run % 5 == 4),
                    b = make_soup(&random, 1 + qm_random_below(&random, 45), pool, limit, run % 2 == 1,
                                  run % 5 == 4);
        check_soups(&a, &b, run);
        check_soups(&a, NULL, run);
        check_twins(&a, run);
        sum += faces;
        free_soup(&a);
        free_soup(&b);
    }
    assert_true(sum > 1000);
}

/** Small faces scattered over a large box: hardly any meet, so that the filter has its say. */
static void thin_soups_match_twin(void **state)
{
    (void)state;
    for (unsigned run = 0; run < 12; run++) {
        qm_random random = qm_random_make(qm_check_seed(), 1000 + run);
        bigint_soup a = make_soup(&random, 300, 900, 60, run % 2 == 1, false);
        for (size_t v = 0; v < 900; v++) {
            for (int k = 0; k < 3; k++)
                if (v % 3 > 0)
                    a.corner[v].x[k] = a.corner[v - v % 3].x[k] + (int64_t)qm_random_below(&random, 41) - 20;
            set_position(&a, v, 1.0, (const double[3]){0, 0, 0});
        }
        for (uint32_t f = 0; f < 300; f++)
            for (uint32_t i = 0; i < 3; i++)
                a.mesh.faces[4 * f + i] = 3 * f + i;
        check_soups(&a, NULL, run);
        free_soup(&a);
    }
}

/** A copy of the mesh with faces and corners in random order; place[f] is where face f went. */
static qm_mesh shuffled(const qm_mesh *mesh, qm_random *random, uint32_t *place)
{
    qm_mesh copy = qm_shape_copy(mesh);
    for (size_t f = 0; f < mesh->face_count; f++)
        place[f] = (uint32_t)f;
    for (size_t f = mesh->face_count; f > 1; f--) {
        size_t other = qm_random_below(random, f);
        uint32_t swap = place[f - 1];
        place[f - 1] = place[other];
        place[other] = swap;
    }
    for (size_t f = 0; f < mesh->face_count; f++) {
        size_t turn = mesh->faces[4 * f + 3] == QM_NO_INDEX ? qm_random_below(random, 3) : 0;
        for (size_t i = 0; i < 4; i++)
            copy.faces[4 * place[f] + i] = mesh->faces[4 * f + (i < 3 ? (i + turn) % 3 : i)];
    }
    return copy;
}

static void order_of_faces_does_not_matter(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 5);
    for (int run = 0; run < 10; run++) {
        qm_mesh mesh = qm_shape_soup(&random, 400, run % 2 ? QM_SOUP_MIXED : QM_SOUP_TRIANGLES,
                                     run % 3 ? QM_SOUP_LATTICE : QM_SOUP_POOLED, 0.3);
        uint32_t *place = grab(mesh.face_count, sizeof *place);
        qm_mesh other = shuffled(&mesh, &random, place);
        qm_collision x = collide(&mesh, NULL, QM_COLLIDE_ALL, 1),
                     y = collide(&other, NULL, QM_COLLIDE_ALL, 2);
        assert_true(x.pair_count > 0);
        assert_int_equal(x.pair_count, y.pair_count);
        uint8_t *known = grab(mesh.face_count * mesh.face_count, 1);
        for (size_t i = 0; i < y.pair_count; i++)
            known[y.pairs[i].a * mesh.face_count + y.pairs[i].b] = 1;
        for (size_t i = 0; i < x.pair_count; i++) {
            uint32_t p = place[x.pairs[i].a], q = place[x.pairs[i].b];
            assert_true(known[(p < q ? p : q) * mesh.face_count + (p < q ? q : p)]);
        }
        free(known);
        free(place);
        free_collision(&x);
        free_collision(&y);
        qm_shape_free(&mesh);
        qm_shape_free(&other);
    }
}

/** Moves some vertices of a soup, and finds the pairs from those of before. */
static void check_changes(bigint_soup *soup, qm_random *random, int limit, size_t moved, int threads)
{
    qm_context ctx = qm_context_make();
    ctx.parallel = qm_host_parallel;
    qm_collide_options options = qm_collide_options_default();
    options.thread_count = threads;
    qm_collision before = collide(&soup->mesh, NULL, QM_COLLIDE_ALL, 1), after;
    uint32_t *vertices = grab(moved, sizeof *vertices);
    for (size_t i = 0; i < moved; i++) {
        vertices[i] = (uint32_t)qm_random_below(random, soup->mesh.vertex_count);
        for (int k = 0; k < 3; k++)
            soup->corner[vertices[i]].x[k] =
                (int64_t)qm_random_below(random, (size_t)(2 * limit + 1)) - limit;
        set_position(soup, vertices[i], 1.0, (const double[3]){0, 0, 0});
    }
    qm_collide_changes changes = {vertices, moved, before.pairs, before.pair_count};
    qm_bvh *bvh;
    assert_int_equal(qm_bvh_build(&ctx, &soup->mesh, QM_BVH_SOURCE, 1, &bvh), QM_OK);
    assert_int_equal(qm_collide_self(&ctx, bvh, &options, &changes, &after), QM_OK);
    qm_bvh_destroy(&ctx, bvh);
    qm_collision full = collide(&soup->mesh, NULL, QM_COLLIDE_ALL, 1);
    check_same(&full, &after);
    assert_true(after.tests <= full.tests);
    free_collision(&before);
    free_collision(&after);
    free_collision(&full);
    free(vertices);
}

static void changes_give_what_a_full_run_does(void **state)
{
    (void)state;
    for (unsigned run = 0; run < 15; run++) {
        qm_random random = qm_random_make(qm_check_seed(), 2000 + run);
        int limit = run % 2 ? 30 : 300;
        bigint_soup soup = make_soup(&random, 150, 200, limit, run % 3 == 1, run % 5 == 2);
        for (size_t moved = 0; moved < 60; moved = 3 * moved + 1)
            check_changes(&soup, &random, limit, moved, run % 2 ? 3 : 1);
        free_soup(&soup);
    }
}

/** How many pairs of real meshes meet in both readings; b is NULL for a mesh with itself. */
static void check_data(const char *name_a, const char *name_b, bool meets)
{
    for (int reading = 0; reading < 2; reading++) {
        qm_context ctx = qm_context_make();
        qm_mesh a, b = {0};
        qm_bvh *bvh_a, *bvh_b = NULL;
        qm_collision found;
        qm_collide_options options = qm_collide_options_default();
        options.quads = reading == 0 ? QM_QUADS_TRIANGLES : QM_QUADS_BILINEAR;
        options.tolerance = 1e-7;
        qm_data_mesh_read(&ctx, name_a, &a);
        assert_int_equal(qm_bvh_build(&ctx, &a, QM_BVH_SOURCE, 1, &bvh_a), QM_OK);
        if (name_b) {
            qm_data_mesh_read(&ctx, name_b, &b);
            assert_int_equal(qm_bvh_build(&ctx, &b, QM_BVH_SOURCE, 1, &bvh_b), QM_OK);
        }
        assert_int_equal(name_b ? qm_collide_meshes(&ctx, bvh_a, bvh_b, &options, &found)
                                : qm_collide_self(&ctx, bvh_a, &options, NULL, &found),
                         QM_OK);
        QM_CHECK((found.pair_count > 0) == meets, "%s, reading %d: %zu pairs", name_a, reading,
                 found.pair_count);
        qm_collide_reset(&ctx, &found);
        qm_bvh_destroy(&ctx, bvh_a);
        qm_bvh_destroy(&ctx, bvh_b);
        qm_mesh_reset(&ctx, &a);
        qm_mesh_reset(&ctx, &b);
    }
}

static void grids_are_as_they_were_made(void **state)
{
    (void)state;
    check_data("grids/cloth_fold_apart_quads.obj", NULL, false);
    check_data("grids/cloth_fold_through_quads.obj", NULL, true);
    check_data("grids/cloth_pair_A_quads.obj", "grids/cloth_pair_B_apart_quads.obj", false);
    check_data("grids/cloth_pair_A_quads.obj", "grids/cloth_pair_B_quads.obj", true);
    check_data("grids/plate_low_quads.obj", "grids/plate_cross_quads.obj", true);
    check_data("grids/plate_low_quads.obj", "grids/plate_touch_quads.obj", true);
    check_data("grids/torus_96x48_quads.obj", NULL, false);
    check_data("grids/saddle_32x32_quads.obj", NULL, false);
}

/** Every allocation fails in turn: a status, and nothing is left behind. */
static void out_of_memory_is_a_status(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 9);
    bigint_soup soup = make_soup(&random, 200, 300, 20, true, false);
    qm_context plain = qm_context_make();
    qm_bvh *bvh;
    assert_int_equal(qm_bvh_build(&plain, &soup.mesh, QM_BVH_SOURCE, 1, &bvh), QM_OK);
    qm_collide_options options = qm_collide_options_default();
    qm_collision all = collide(&soup.mesh, NULL, QM_COLLIDE_ALL, 1), found;
    const uint32_t moved = 3;
    qm_collide_changes changes = {&moved, 1, all.pairs, all.pair_count};
    for (int form = 0; form < 3; form++) {
        qm_status status = QM_E_NO_MEMORY;
        size_t fail_at = 0;
        for (; status == QM_E_NO_MEMORY; fail_at++) {
            qm_failing_allocator failing = {.fail_at = fail_at};
            qm_context ctx = qm_context_make();
            ctx.allocator = qm_failing_allocator_hook(&failing);
            status = form == 0 ? qm_collide_meshes(&ctx, bvh, bvh, &options, &found)
                               : qm_collide_self(&ctx, bvh, &options, form == 1 ? NULL : &changes, &found);
            if (status == QM_OK) qm_collide_reset(&ctx, &found);
            assert_true(failing.live_blocks == 0 && !failing.mismatched);
        }
        assert_int_equal(status, QM_OK);
        assert_true(fail_at > 4);
    }
    free_collision(&all);
    qm_bvh_destroy(&plain, bvh);
    free_soup(&soup);
}

static void faults_are_told(void **state)
{
    (void)state;
    qm_mesh box = qm_shape_box(1, 1, 1), huge = qm_shape_box(1, 1, 1);
    qm_shape_move(&huge, 0x1p310, (const double[3]){0, 0, 0});
    qm_context ctx = qm_context_make();
    qm_bvh *bvh, *huge_bvh;
    assert_int_equal(qm_bvh_build(&ctx, &box, QM_BVH_SOURCE, 1, &bvh), QM_OK);
    assert_int_equal(qm_bvh_build(&ctx, &huge, QM_BVH_SOURCE, 1, &huge_bvh), QM_OK);
    qm_collide_options options = qm_collide_options_default();
    qm_collision found;
    assert_int_equal(qm_collide_meshes(&ctx, bvh, huge_bvh, &options, &found), QM_E_SCALE);
    options.pair_limit = 2;
    assert_int_equal(qm_collide_meshes(&ctx, bvh, bvh, &options, &found), QM_E_TOO_LARGE);
    assert_string_equal(ctx.message, "more than 2 pairs of faces meet");
    options.thread_count = 0;
    assert_int_equal(qm_collide_self(&ctx, bvh, &options, NULL, &found), QM_E_ARGUMENT);
    options = qm_collide_options_default();
    options.quads = QM_QUADS_BILINEAR;
    assert_int_equal(qm_collide_self(&ctx, bvh, &options, NULL, &found), QM_E_ARGUMENT);
    options.quads = QM_QUADS_TRIANGLES;
    const uint32_t nowhere = 8;
    const qm_face_pair no_faces = {0, 6};
    qm_collide_changes changes = {&nowhere, 1, NULL, 0};
    assert_int_equal(qm_collide_self(&ctx, bvh, &options, &changes, &found), QM_E_INDEX);
    changes = (qm_collide_changes){NULL, 0, &no_faces, 1};
    assert_int_equal(qm_collide_self(&ctx, bvh, &options, &changes, &found), QM_E_INDEX);
    qm_bvh_destroy(&ctx, bvh);
    qm_bvh_destroy(&ctx, huge_bvh);
    qm_shape_free(&box);
    qm_shape_free(&huge);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(soups_match_twin),
        cmocka_unit_test(thin_soups_match_twin),
        cmocka_unit_test(order_of_faces_does_not_matter),
        cmocka_unit_test(changes_give_what_a_full_run_does),
        cmocka_unit_test(out_of_memory_is_a_status),
        cmocka_unit_test(faults_are_told),
    };
    const struct CMUnitTest data_tests[] = {cmocka_unit_test(grids_are_as_they_were_made)};
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    return failed + qm_data_run_group_tests(data_tests);
}
