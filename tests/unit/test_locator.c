/* The uniform grid and the offset tetrahedra against the box tree, bit for bit, and against brute force. */
#include "check.h"

#include "base/host.h"
#include "bvh/nearest.h"
#include "failing_allocator.h"
#include "qm/hausdorff.h"
#include "random.h"
#include "shapes.h"
#include "slow_twin.h"

#include <math.h>
#include <string.h>

enum { POINT_COUNT = 40 };

/** What is built over a tree. */
static const struct {
    const char *name;
    qm_accelerator accelerator;
} others[] = {{"grid", QM_ACCELERATOR_GRID}, {"tetra", QM_ACCELERATOR_TETRA}};

enum { OTHER_COUNT = sizeof others / sizeof *others };

/** A mesh with its tree and what is built over it, and where points are drawn. */
typedef struct bench {
    const char *name;
    uint64_t seed;
    qm_context ctx;
    qm_mesh mesh;
    qm_bvh *tree;
    qm_locator locator[OTHER_COUNT]; /* without a tree where there is none of the kind */
    qm_box box;
    double size; /* greatest coordinate */
} bench;

static bench bench_make(const char *name, uint64_t seed, qm_mesh mesh)
{
    bench b = {.name = name, .seed = seed, .ctx = qm_context_make(), .mesh = mesh};
    assert_int_equal(qm_bvh_build(&b.ctx, &mesh, QM_BVH_ALL, 1, &b.tree), QM_OK);
    for (int i = 0; i < OTHER_COUNT; i++) {
        qm_status status = qm_locator_build(&b.ctx, b.tree, NULL, others[i].accelerator, &b.locator[i]);
        bool is_lacking = others[i].accelerator == QM_ACCELERATOR_TETRA && mesh.face_count == 0;
        QM_CHECK(status == (is_lacking ? QM_E_UNSUPPORTED : QM_OK), "%s: %s", name, b.ctx.message);
    }
    b.box = qm_mesh_bounding_box(&mesh);
    for (int k = 0; k < 3; k++)
        b.size = fmax(b.size, fmax(fabs(b.box.min[k]), fabs(b.box.max[k])));
    return b;
}

static void bench_free(bench *b)
{
    for (int i = 0; i < OTHER_COUNT; i++)
        qm_locator_reset(&b->ctx, &b->locator[i]);
    qm_bvh_destroy(&b->ctx, b->tree);
    qm_shape_free(&b->mesh);
}

/** Vertices, points of the surface and near it, in the box, outside, far and very far outside. */
static void draw_point(const bench *b, qm_random *random, int i, double p[3])
{
    static const double reach[] = {0, 0, 0, 1, 3, 1e3, 1e9};
    double diagonal = qm_mesh_box_diagonal(&b->box);
    int kind = i % 7;
    if (kind == 0) {
        memcpy(p, b->mesh.positions + 3 * qm_random_below(random, b->mesh.vertex_count), 24);
    } else if (kind < 3) {
        double noise = kind == 1 ? 1e-9 : 1e-2;
        if (b->mesh.face_count > 0)
            qm_slow_sample(&b->mesh, QM_QUADS_BILINEAR, random, 1, p);
        else
            memcpy(p, b->mesh.positions, 24);
        for (int k = 0; k < 3; k++)
            p[k] += qm_random_range(random, -noise, noise) * diagonal;
    } else {
        for (int k = 0; k < 3; k++) {
            double middle = 0.5 * (b->box.min[k] + b->box.max[k]);
            p[k] = middle + reach[kind] * qm_random_range(random, -0.5, 0.5) * (diagonal + 1e-30);
        }
    }
}

/** Every search in every kernel: the same triangle at the same distance, whatever pack they start from. */
static void check_triangle(const bench *b, int other, int i, qm_vec p, uint32_t start)
{
    for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++) {
        qm_hit tree = {.d2 = INFINITY, .pack = start}, hit = tree;
        (*kernel)->closest(b->tree, p, &tree);
        qm_nearest_triangle(*kernel, &b->locator[other], p, &hit);
        QM_CHECK(hit.d2 == tree.d2 && hit.pack == tree.pack && hit.lane == tree.lane,
                 "%s, seed %llu, point %d, %s: %s %.17g in pack %u lane %u, tree %.17g in pack %u lane %u",
                 b->name, (unsigned long long)b->seed, i, (*kernel)->name, others[other].name, sqrt(hit.d2),
                 hit.pack, hit.lane, sqrt(tree.d2), tree.pack, tree.lane);
    }
}

/** Both brackets of the distance to the patches hold the same value, and are as narrow as requested. */
static void check_patch(const bench *b, int other, int i, qm_vec p, uint32_t start)
{
    const qm_kernel *kernel = qm_kernel_get();
    double size = fmax(1.0, qm_vec_norm(p)), error = 1e-13 * size, rounding = 0x1p-46 * size;
    qm_bilinear_hit tree, hit;
    kernel->closest_patch(b->tree, p, start, error, &tree);
    qm_nearest_patch(kernel, &b->locator[other], p, start, error, &hit);
    QM_CHECK(hit.lower <= tree.distance + rounding && tree.lower <= hit.distance + rounding,
             "%s, seed %llu, point %d: %s [%.17g, %.17g], tree [%.17g, %.17g]", b->name,
             (unsigned long long)b->seed, i, others[other].name, hit.lower, hit.distance, tree.lower,
             tree.distance);
    QM_CHECK(hit.distance - hit.lower <= 1.01 * error && tree.distance - tree.lower <= 1.01 * error,
             "%s, seed %llu, point %d: %s is off by %g, the tree by %g", b->name, (unsigned long long)b->seed,
             i, others[other].name, hit.distance - hit.lower, tree.distance - tree.lower);
}

/** A search that ends at the first patch that is near enough finds one if there is one, and else does not tell of a nearer
 * one than the nearest; the same on all kernels. */
static void check_near_patch(const bench *b, int i, qm_vec p, uint32_t start)
{
    double size = fmax(1.0, qm_vec_norm(p)), rounding = 0x1p-46 * size;
    qm_bilinear_hit nearest, hit;
    qm_kernel_get()->closest_patch(b->tree, p, start, 1e-13 * size, &nearest);
    for (int share = 0; share < 4; share++) {
        double enough = 0.5 * (share + 1) * nearest.distance; /* half of it to twice */
        for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++) {
            (*kernel)->near_patch(b->tree, p, start, enough, &hit);
            QM_CHECK(hit.lower == 0.0 && hit.distance >= nearest.lower - rounding &&
                         (enough < nearest.distance + rounding || hit.distance <= enough),
                     "%s, seed %llu, point %d, %s: %.17g, enough %.17g, nearest [%.17g, %.17g]", b->name,
                     (unsigned long long)b->seed, i, (*kernel)->name, hit.distance, enough, nearest.lower,
                     nearest.distance);
        }
    }
}

static void check_brute_force(const bench *b, int i, const double p[3], double distance,
                              qm_quad_reading reading)
{
    double size = b->size + sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]), slack = 1e-12 * size;
    qm_slow_bracket slow = qm_slow_distance(&b->mesh, reading, p, 1e-13 * size);
    QM_CHECK(distance >= slow.lower - slack && distance <= slow.upper + slack,
             "%s, seed %llu, point %d, reading %d: %.17g, true [%.17g, %.17g]", b->name,
             (unsigned long long)b->seed, i, (int)reading, distance, slow.lower, slow.upper);
}

static void check_locator(const bench *b, const qm_locator *locator, int i, const double point[3],
                          uint32_t start)
{
    qm_vec p = qm_frame_local(&b->tree->frame, point);
    qm_hit hit = {.d2 = INFINITY, .pack = start};
    qm_nearest_triangle(qm_kernel_get(), locator, p, &hit);
    check_brute_force(b, i, point, sqrt(hit.d2) * b->tree->frame.inverse_scale, QM_QUADS_TRIANGLES);
    if (i % 8) return;
    qm_bilinear_hit patch;
    qm_nearest_patch(qm_kernel_get(), locator, p, start, 1e-13, &patch);
    check_brute_force(b, i, point, patch.distance * b->tree->frame.inverse_scale, QM_QUADS_BILINEAR);
}

static void check_points(const bench *b, int count, bool brute)
{
    qm_random random = qm_random_make(qm_check_seed(), b->seed);
    for (int i = 0; i < count; i++) {
        double point[3];
        draw_point(b, &random, i, point);
        qm_vec p = qm_frame_local(&b->tree->frame, point);
        uint32_t start = (uint32_t)qm_random_below(&random, b->tree->pack_count);
        check_near_patch(b, i, p, start);
        for (int other = 0; other < OTHER_COUNT; other++) {
            const qm_locator *locator = &b->locator[other];
            if (!locator->bvh) continue;
            check_triangle(b, other, i, p, start);
            check_patch(b, other, i, p, start);
            if (brute) check_locator(b, locator, i, point, start);
        }
    }
}

static void check_mesh(const char *name, uint64_t seed, qm_mesh mesh, bool brute)
{
    bench b = bench_make(name, seed, mesh);
    check_points(&b, POINT_COUNT, brute);
    bench_free(&b);
}

static void soups_match_the_tree_and_brute_force(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 10000 : 150;
    for (uint64_t seed = 0; seed < count; seed++) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        qm_soup_style style = (qm_soup_style)(seed % QM_SOUP_STYLE_COUNT);
        double twist = (double[]){0, 0.1, 0.5, 2}[qm_random_below(&random, 4)];
        size_t faces = 1 + qm_random_below(&random, seed % 10 == 0 ? 2000 : 30);
        qm_mesh mesh =
            qm_shape_soup(&random, faces, (qm_soup_corners)qm_random_below(&random, 3), style, twist);
        check_mesh("soup", seed, mesh, faces <= 30);
    }
}

static void shapes_match_the_tree(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 0);
    check_mesh("torus", 0, qm_shape_torus(80, 40, 1, 0.4), false);
    check_mesh("sphere", 0, qm_shape_sphere(0), false);
    check_mesh("saddle of one quad", 0, qm_shape_saddle(1), true);
    check_mesh("saddle", 0, qm_shape_saddle(16), false);
    check_mesh("twisted strip", 0, qm_shape_strip(30, 3, 9), false);
    check_mesh("plane", 0, qm_shape_plane(60, 0.5), false);
    check_mesh("cube", 0, qm_shape_box(1, 1, 1), true);
    check_mesh("flat box", 0, qm_shape_box(1, 1, 0), true);
    check_mesh("needle of a box", 0, qm_shape_box(1, 1e-7, 1e-9), true);
    check_mesh("points", 0, qm_shape_points(&random, 3000), false);
    check_mesh("one point", 0, qm_shape_points(&random, 1), true);
}

static void moved_and_scaled_meshes_match_the_tree(void **state)
{
    (void)state;
    static const double moves[][2] = {{1, 1e7}, {1e-9, 0}, {1e-9, 1}, {1e-170, 0}, {1e150, 0}, {1e30, 1e30}};
    for (uint64_t seed = 0; seed < 60; seed++) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        const double *move = moves[seed % 6], shift[3] = {move[1], -move[1], move[1]};
        qm_mesh mesh = qm_shape_soup(&random, 12, QM_SOUP_MIXED, QM_SOUP_APART, 0.5);
        qm_shape_move(&mesh, move[0], shift);
        check_mesh("moved", seed, mesh, false);
    }
}

/** Many faces that each come through very many cells: the cells grow, and the grid stays small. */
static void large_faces_do_not_blow_the_grid_up(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 0);
    qm_mesh needles = qm_shape_soup(&random, 20000, QM_SOUP_TRIANGLES, QM_SOUP_NEEDLES, 0);
    qm_mesh meshes[] = {qm_shape_copies(100000), needles};
    for (int i = 0; i < 2; i++) {
        bench b = bench_make(i == 0 ? "copies" : "needles", 0, meshes[i]);
        size_t bound = 4096 + 40 * 8 * b.tree->pack_count;
        QM_CHECK(qm_grid_memory_size(b.locator[0].grid) <= bound, "%s: %zu bytes, bound %zu", b.name,
                 qm_grid_memory_size(b.locator[0].grid), bound);
        check_points(&b, 7, false);
        bench_free(&b);
    }
}

/** One face over everything beside many small ones, whose cells should stay small. */
static void a_large_face_beside_small_ones_keeps_the_cells_small(void **state)
{
    (void)state;
    qm_mesh torus = qm_shape_torus(100, 50, 1, 0.4);
    const double corner[3][3] = {{-1.4, -1.4, -0.4}, {1.4, -1.4, 0.4}, {1.4, 1.4, -0.4}};
    qm_mesh face = qm_shape_face(3, corner), both = qm_shape_joined(&torus, &face);
    bench apart = bench_make("torus", 0, torus), joined = bench_make("torus and face", 0, both);
    check_points(&joined, POINT_COUNT, false);
    QM_CHECK(qm_grid_memory_size(joined.locator[0].grid) > qm_grid_memory_size(apart.locator[0].grid) / 2,
             "%zu bytes beside %zu", qm_grid_memory_size(joined.locator[0].grid),
             qm_grid_memory_size(apart.locator[0].grid));
    qm_shape_free(&face);
    bench_free(&apart);
    bench_free(&joined);
}

static double answers[2][7 * 1000];
static uint32_t answer_faces[2][1000];

/** A batch through the locator of an accelerator, on two threads. */
static void project_batch(bench *b, qm_accelerator accelerator, qm_quad_reading reading, const double *points,
                          int which)
{
    double *row = answers[which];
    qm_projection out = {row, row + 1000, answer_faces[which], row + 4000};
    qm_locator locator;
    b->ctx.parallel = qm_host_parallel;
    assert_int_equal(qm_locator_build(&b->ctx, b->tree, NULL, accelerator, &locator), QM_OK);
    assert_int_equal(qm_project_points_with(&b->ctx, &locator, reading, points, 1000, 2, &out), QM_OK);
    qm_locator_reset(&b->ctx, &locator);
    assert_null(locator.grid);
    assert_null(locator.tetra);
}

static void batches_are_the_same_with_each_accelerator(void **state)
{
    (void)state;
    static double points[3 * 1000];
    bench b = bench_make("torus", 0, qm_shape_torus(40, 20, 1, 0.4));
    qm_random random = qm_random_make(qm_check_seed(), 1);
    for (int i = 0; i < 1000; i++)
        draw_point(&b, &random, i % 5, points + 3 * i);
    for (int which = 0; which < 2 * OTHER_COUNT; which++) {
        int reading = which % 2, other = which / 2;
        project_batch(&b, QM_ACCELERATOR_AUTO, (qm_quad_reading)reading, points, 0);
        project_batch(&b, others[other].accelerator, (qm_quad_reading)reading, points, 1);
        for (int i = 0; i < 1000; i++)
            QM_CHECK(fabs(answers[0][i] - answers[1][i]) <= (reading == 0 ? 0 : 4e-13),
                     "reading %d, point %d: %.17g by boxes, %.17g by %s", reading, i, answers[0][i],
                     answers[1][i], others[other].name);
        if (reading == 1) continue;
        assert_memory_equal(answers[0], answers[1], sizeof answers[0]);
        assert_memory_equal(answer_faces[0], answer_faces[1], sizeof answer_faces[0]);
    }
    bench_free(&b);
}

static qm_status measure(bench *a, const bench *b, qm_accelerator accelerator, qm_quad_reading reading,
                         qm_hausdorff_result *out)
{
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.tolerance = 1e-6;
    options.quads = reading;
    options.accelerator = accelerator;
    options.work_limit = 20000;
    return qm_hausdorff_measure(&a->ctx, a->tree, b->tree, &options, out);
}

/** Searches may go other ways, since boxes alone bound by single precision first; they meet in the
 * distance. */
static void distances_agree_with_each_accelerator(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 40; seed++) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        qm_mesh soup = qm_shape_soup(&random, 40, QM_SOUP_MIXED, QM_SOUP_POOLED, 0.1);
        qm_mesh shaken = qm_shape_copy(&soup);
        qm_shape_shake(&shaken, &random, 0.05);
        bench a = bench_make("soup", seed, soup), b = bench_make("shaken soup", seed, shaken);
        qm_hausdorff_result boxes, result;
        qm_quad_reading reading = (qm_quad_reading)(seed % 4 == 0);
        assert_int_equal(measure(&a, &b, QM_ACCELERATOR_BOXES, reading, &boxes), QM_OK);
        for (int other = 0; other < OTHER_COUNT; other++) {
            assert_int_equal(measure(&a, &b, others[other].accelerator, reading, &result), QM_OK);
            QM_CHECK(boxes.lower <= result.upper && result.lower <= boxes.upper,
                     "seed %llu: boxes [%.17g, %.17g], %s [%.17g, %.17g]", (unsigned long long)seed,
                     boxes.lower, boxes.upper, others[other].name, result.lower, result.upper);
            if (reading == QM_QUADS_TRIANGLES) {
                assert_int_equal(boxes.stop, QM_STOP_CONVERGED);
                assert_int_equal(result.stop, QM_STOP_CONVERGED);
            }
        }
        bench_free(&a);
        bench_free(&b);
    }
}

/** Raised before anything is built: the call still ends with valid bounds, as without. */
static void a_canceled_distance_is_a_valid_one(void **state)
{
    (void)state;
    bench a = bench_make("cube", 0, qm_shape_box(1, 1, 1)), b = bench_make("box", 0, qm_shape_box(1, 1, 2));
    atomic_bool cancel = true;
    a.ctx.cancel = &cancel;
    qm_hausdorff_result result;
    for (int other = 0; other < OTHER_COUNT; other++) {
        assert_int_equal(measure(&a, &b, others[other].accelerator, QM_QUADS_TRIANGLES, &result), QM_OK);
        assert_true(result.lower <= 1 && result.upper >= 1);
    }
    bench_free(&a);
    bench_free(&b);
}

static void what_cannot_be_built_is_refused(void **state)
{
    (void)state;
    bench cube = bench_make("cube", 0, qm_shape_box(1, 1, 1));
    qm_random random = qm_random_make(qm_check_seed(), 0);
    bench points = bench_make("points", 0, qm_shape_points(&random, 10));
    qm_locator locator;
    qm_status status = qm_locator_build(&points.ctx, points.tree, NULL, QM_ACCELERATOR_TETRA, &locator);
    assert_int_equal(status, QM_E_UNSUPPORTED);
    assert_non_null(strstr(points.ctx.message, "patches"));
    assert_int_equal(qm_locator_build(&cube.ctx, cube.tree, NULL, QM_ACCELERATOR_COUNT, &locator),
                     QM_E_ARGUMENT);
    assert_null(locator.bvh);
    qm_tetra *tetra;
    status = qm_tetra_build(&cube.ctx, cube.tree, &(qm_patch_set){0}, &tetra);
    assert_int_equal(status, QM_E_ARGUMENT);
    assert_null(tetra);
    bench_free(&cube);
    bench_free(&points);
}

static void a_source_tree_is_refused(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh cube = qm_shape_box(1, 1, 1);
    qm_bvh *tree;
    qm_locator locator;
    assert_int_equal(qm_bvh_build(&ctx, &cube, QM_BVH_SOURCE, 1, &tree), QM_OK);
    for (int i = 0; i < OTHER_COUNT; i++)
        assert_int_equal(qm_locator_build(&ctx, tree, NULL, others[i].accelerator, &locator), QM_E_ARGUMENT);
    qm_bvh_destroy(&ctx, tree);
    qm_shape_free(&cube);
}

static void run_out_of_memory(const qm_bvh *tree, qm_accelerator accelerator)
{
    qm_status status = QM_E_NO_MEMORY;
    size_t fail_at = 0;
    for (; status != QM_OK && fail_at < 100; fail_at++) {
        qm_failing_allocator memory = {.fail_at = fail_at};
        qm_context ctx = qm_context_make();
        ctx.allocator = qm_failing_allocator_hook(&memory);
        qm_locator locator;
        status = qm_locator_build(&ctx, tree, NULL, accelerator, &locator);
        assert_true(status == QM_OK || (status == QM_E_NO_MEMORY && !locator.bvh));
        qm_locator_reset(&ctx, &locator);
        QM_CHECK(memory.live_blocks == 0 && !memory.mismatched, "call %zu: %zu blocks left", fail_at,
                 memory.live_blocks);
    }
    assert_int_equal(status, QM_OK);
    assert_true(fail_at > 3);
}

static void running_out_of_memory_is_a_status_at_every_place(void **state)
{
    (void)state;
    qm_mesh mesh = qm_shape_torus(40, 20, 1, 0.4);
    qm_context plain = qm_context_make();
    qm_bvh *tree;
    assert_int_equal(qm_bvh_build(&plain, &mesh, QM_BVH_ALL, 1, &tree), QM_OK);
    for (int i = 0; i < OTHER_COUNT; i++)
        run_out_of_memory(tree, others[i].accelerator);
    qm_bvh_destroy(&plain, tree);
    qm_shape_free(&mesh);
}

static void a_raised_flag_cancels(void **state)
{
    (void)state;
    bench b = bench_make("cube", 0, qm_shape_box(1, 1, 1));
    atomic_bool cancel = true;
    b.ctx.cancel = &cancel;
    for (int i = 0; i < OTHER_COUNT; i++) {
        qm_locator locator;
        assert_int_equal(qm_locator_build(&b.ctx, b.tree, NULL, others[i].accelerator, &locator),
                         QM_E_CANCELED);
        assert_null(locator.bvh);
    }
    bench_free(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(soups_match_the_tree_and_brute_force),
        cmocka_unit_test(shapes_match_the_tree),
        cmocka_unit_test(moved_and_scaled_meshes_match_the_tree),
        cmocka_unit_test(large_faces_do_not_blow_the_grid_up),
        cmocka_unit_test(a_large_face_beside_small_ones_keeps_the_cells_small),
        cmocka_unit_test(batches_are_the_same_with_each_accelerator),
        cmocka_unit_test(distances_agree_with_each_accelerator),
        cmocka_unit_test(a_canceled_distance_is_a_valid_one),
        cmocka_unit_test(what_cannot_be_built_is_refused),
        cmocka_unit_test(a_source_tree_is_refused),
        cmocka_unit_test(running_out_of_memory_is_a_status_at_every_place),
        cmocka_unit_test(a_raised_flag_cancels),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
