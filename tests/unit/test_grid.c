/* The uniform grid against the box tree, bit for bit, and against brute force. */
#include "check.h"

#include "failing_allocator.h"
#include "kernel.h"
#include "parallel.h"
#include "qm/hausdorff.h"
#include "random.h"
#include "shapes.h"
#include "slow_twin.h"

#include <math.h>
#include <string.h>

enum { POINT_COUNT = 40 };

/** A mesh with its tree and grid, and where points are drawn. */
typedef struct bench {
    const char *name;
    uint64_t seed;
    qm_context ctx;
    qm_mesh mesh;
    qm_bvh *tree;
    qm_grid *grid;
    qm_box box;
    double size; /* greatest coordinate */
} bench;

static bench bench_make(const char *name, uint64_t seed, qm_mesh mesh)
{
    bench b = {.name = name, .seed = seed, .ctx = qm_context_make(), .mesh = mesh};
    assert_int_equal(qm_bvh_build(&b.ctx, &mesh, QM_BVH_ALL, 1, &b.tree), QM_OK);
    qm_status status = qm_grid_build(&b.ctx, b.tree, &b.grid);
    QM_CHECK(status == QM_OK, "%s: %s", name, b.ctx.message);
    b.box = qm_mesh_bounding_box(&mesh);
    for (int k = 0; k < 3; k++)
        b.size = fmax(b.size, fmax(fabs(b.box.min[k]), fabs(b.box.max[k])));
    return b;
}

static void bench_free(bench *b)
{
    qm_grid_destroy(&b->ctx, b->grid);
    qm_bvh_destroy(&b->ctx, b->tree);
    qm_shape_free(&b->mesh);
}

/** Vertices, points of the surface and near it, in the box, outside, far and very far outside. */
static void draw_point(const bench *b, qm_random *random, int i, double p[3])
{
    static const double reach[] = {0, 0, 0, 1, 3, 1e3, 1e9};
    double diagonal = qm_box_diagonal(&b->box);
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

/** Both searches in every kernel: the same triangle at the same distance, whatever pack they start from. */
static void check_triangle(const bench *b, int i, qm_vec p, uint32_t start)
{
    for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++) {
        qm_hit tree = {.d2 = INFINITY, .pack = start}, grid = tree;
        (*kernel)->closest(b->tree, p, &tree);
        (*kernel)->grid_closest(b->grid, p, &grid);
        QM_CHECK(grid.d2 == tree.d2 && grid.pack == tree.pack && grid.lane == tree.lane,
                 "%s, seed %llu, point %d, %s: grid %.17g in pack %u lane %u, tree %.17g in pack %u lane %u",
                 b->name, (unsigned long long)b->seed, i, (*kernel)->name, sqrt(grid.d2), grid.pack,
                 grid.lane, sqrt(tree.d2), tree.pack, tree.lane);
    }
}

/** Both brackets of the distance to the patches hold the same value, and are as narrow as asked. */
static void check_patch(const bench *b, int i, qm_vec p, uint32_t start)
{
    const qm_kernel *kernel = qm_kernel_get();
    double size = fmax(1.0, qm_vec_norm(p)), error = 1e-13 * size, rounding = 0x1p-46 * size;
    qm_patch_hit tree, grid;
    kernel->closest_patch(b->tree, p, start, error, &tree);
    kernel->grid_closest_patch(b->grid, p, start, error, &grid);
    QM_CHECK(grid.lower <= tree.distance + rounding && tree.lower <= grid.distance + rounding,
             "%s, seed %llu, point %d: grid [%.17g, %.17g], tree [%.17g, %.17g]", b->name,
             (unsigned long long)b->seed, i, grid.lower, grid.distance, tree.lower, tree.distance);
    QM_CHECK(grid.distance - grid.lower <= 1.01 * error && tree.distance - tree.lower <= 1.01 * error,
             "%s, seed %llu, point %d: off by %g, the tree by %g", b->name, (unsigned long long)b->seed, i,
             grid.distance - grid.lower, tree.distance - tree.lower);
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

static void check_points(const bench *b, int count, bool brute)
{
    qm_random random = qm_random_make(qm_check_seed(), b->seed);
    for (int i = 0; i < count; i++) {
        double point[3];
        draw_point(b, &random, i, point);
        qm_vec p = qm_frame_local(&b->tree->frame, point);
        uint32_t start = (uint32_t)qm_random_below(&random, b->tree->pack_count);
        check_triangle(b, i, p, start);
        check_patch(b, i, p, start);
        if (!brute) continue;
        qm_hit hit = {.d2 = INFINITY, .pack = start};
        qm_kernel_get()->grid_closest(b->grid, p, &hit);
        check_brute_force(b, i, point, sqrt(hit.d2) * b->tree->frame.inverse_scale, QM_QUADS_TRIANGLES);
        if (i % 8) continue;
        qm_patch_hit patch;
        qm_kernel_get()->grid_closest_patch(b->grid, p, start, 1e-13, &patch);
        check_brute_force(b, i, point, patch.distance * b->tree->frame.inverse_scale, QM_QUADS_BILINEAR);
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
    uint64_t count = qm_check_long() ? 10000 : 400;
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
        QM_CHECK(qm_grid_memory_size(b.grid) <= bound, "%s: %zu bytes, bound %zu", b.name,
                 qm_grid_memory_size(b.grid), bound);
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
    QM_CHECK(qm_grid_memory_size(joined.grid) > qm_grid_memory_size(apart.grid) / 2, "%zu bytes beside %zu",
             qm_grid_memory_size(joined.grid), qm_grid_memory_size(apart.grid));
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
    b->ctx.parallel = qm_parallel_run;
    assert_int_equal(qm_locator_build(&b->ctx, b->tree, accelerator, &locator), QM_OK);
    assert_int_equal(qm_project_points_with(&b->ctx, &locator, reading, points, 1000, 2, &out), QM_OK);
    qm_locator_reset(&b->ctx, &locator);
    assert_null(locator.grid);
}

static void batches_are_the_same_with_each_accelerator(void **state)
{
    (void)state;
    static double points[3 * 1000];
    bench b = bench_make("torus", 0, qm_shape_torus(40, 20, 1, 0.4));
    qm_random random = qm_random_make(qm_check_seed(), 1);
    for (int i = 0; i < 1000; i++)
        draw_point(&b, &random, i % 5, points + 3 * i);
    for (int reading = 0; reading < 2; reading++) {
        project_batch(&b, QM_ACCELERATOR_AUTO, (qm_quad_reading)reading, points, 0);
        project_batch(&b, QM_ACCELERATOR_GRID, (qm_quad_reading)reading, points, 1);
        for (int i = 0; i < 1000; i++)
            QM_CHECK(fabs(answers[0][i] - answers[1][i]) <= (reading == 0 ? 0 : 4e-13),
                     "reading %d, point %d: %.17g by boxes, %.17g by the grid", reading, i, answers[0][i],
                     answers[1][i]);
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

/** The same nearest points make the same search: every bound and every count. */
static void distances_take_the_same_path_with_each_accelerator(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 40; seed++) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        qm_mesh soup = qm_shape_soup(&random, 40, QM_SOUP_MIXED, QM_SOUP_POOLED, 0.1);
        qm_mesh shaken = qm_shape_copy(&soup);
        qm_shape_shake(&shaken, &random, 0.05);
        bench a = bench_make("soup", seed, soup), b = bench_make("shaken soup", seed, shaken);
        qm_hausdorff_result boxes, grid;
        qm_quad_reading reading = (qm_quad_reading)(seed % 4 == 0);
        assert_int_equal(measure(&a, &b, QM_ACCELERATOR_BOXES, reading, &boxes), QM_OK);
        assert_int_equal(measure(&a, &b, QM_ACCELERATOR_GRID, reading, &grid), QM_OK);
        QM_CHECK(boxes.lower <= grid.upper && grid.lower <= boxes.upper,
                 "seed %llu: boxes [%.17g, %.17g], grid [%.17g, %.17g]", (unsigned long long)seed,
                 boxes.lower, boxes.upper, grid.lower, grid.upper);
        if (reading == QM_QUADS_TRIANGLES) {
            assert_true(boxes.lower == grid.lower && boxes.upper == grid.upper);
            assert_int_equal(boxes.iterations, grid.iterations);
            assert_int_equal(boxes.projections, grid.projections);
        }
        bench_free(&a);
        bench_free(&b);
    }
}

/** Raised before the grid is built: the call still ends with valid bounds, as without a grid. */
static void a_canceled_distance_is_a_valid_one(void **state)
{
    (void)state;
    bench a = bench_make("cube", 0, qm_shape_box(1, 1, 1)), b = bench_make("box", 0, qm_shape_box(1, 1, 2));
    atomic_bool cancel = true;
    a.ctx.cancel = &cancel;
    qm_hausdorff_result result;
    assert_int_equal(measure(&a, &b, QM_ACCELERATOR_GRID, QM_QUADS_TRIANGLES, &result), QM_OK);
    assert_true(result.lower <= 1 && result.upper >= 1);
    assert_int_equal(measure(&a, &b, QM_ACCELERATOR_TETRA, QM_QUADS_TRIANGLES, &result), QM_E_UNSUPPORTED);
    bench_free(&a);
    bench_free(&b);
}

static void tetra_and_unknown_accelerators_are_refused(void **state)
{
    (void)state;
    bench b = bench_make("cube", 0, qm_shape_box(1, 1, 1));
    qm_locator locator;
    assert_int_equal(qm_locator_build(&b.ctx, b.tree, QM_ACCELERATOR_TETRA, &locator), QM_E_UNSUPPORTED);
    assert_non_null(strstr(b.ctx.message, "patches"));
    assert_int_equal(qm_locator_build(&b.ctx, b.tree, QM_ACCELERATOR_COUNT, &locator), QM_E_ARGUMENT);
    assert_null(locator.bvh);
    bench_free(&b);
}

static void a_source_tree_is_refused(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh cube = qm_shape_box(1, 1, 1);
    qm_bvh *tree;
    qm_grid *grid;
    qm_locator locator;
    assert_int_equal(qm_bvh_build(&ctx, &cube, QM_BVH_SOURCE, 1, &tree), QM_OK);
    assert_int_equal(qm_grid_build(&ctx, tree, &grid), QM_E_ARGUMENT);
    assert_null(grid);
    assert_int_equal(qm_locator_build(&ctx, tree, QM_ACCELERATOR_GRID, &locator), QM_E_ARGUMENT);
    qm_bvh_destroy(&ctx, tree);
    qm_shape_free(&cube);
}

static void running_out_of_memory_is_a_status_at_every_place(void **state)
{
    (void)state;
    qm_mesh mesh = qm_shape_torus(40, 20, 1, 0.4);
    qm_context plain = qm_context_make();
    qm_bvh *tree;
    assert_int_equal(qm_bvh_build(&plain, &mesh, QM_BVH_ALL, 1, &tree), QM_OK);
    qm_status status = QM_E_NO_MEMORY;
    size_t fail_at = 0;
    for (; status != QM_OK && fail_at < 100; fail_at++) {
        qm_failing_allocator memory = {.fail_at = fail_at};
        qm_context ctx = qm_context_make();
        ctx.allocator = qm_failing_allocator_hook(&memory);
        qm_grid *grid;
        status = qm_grid_build(&ctx, tree, &grid);
        assert_true(status == QM_OK || (status == QM_E_NO_MEMORY && grid == NULL));
        qm_grid_destroy(&ctx, grid);
        QM_CHECK(memory.live_blocks == 0 && !memory.mismatched, "call %zu: %zu blocks left", fail_at,
                 memory.live_blocks);
    }
    assert_int_equal(status, QM_OK);
    assert_true(fail_at > 3);
    qm_bvh_destroy(&plain, tree);
    qm_shape_free(&mesh);
}

static void a_raised_flag_cancels(void **state)
{
    (void)state;
    bench b = bench_make("cube", 0, qm_shape_box(1, 1, 1));
    atomic_bool cancel = true;
    b.ctx.cancel = &cancel;
    qm_grid *grid;
    assert_int_equal(qm_grid_build(&b.ctx, b.tree, &grid), QM_E_CANCELED);
    assert_null(grid);
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
        cmocka_unit_test(distances_take_the_same_path_with_each_accelerator),
        cmocka_unit_test(a_canceled_distance_is_a_valid_one),
        cmocka_unit_test(tetra_and_unknown_accelerators_are_refused),
        cmocka_unit_test(a_source_tree_is_refused),
        cmocka_unit_test(running_out_of_memory_is_a_status_at_every_place),
        cmocka_unit_test(a_raised_flag_cancels),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
