/* Collision of the faces near the other mesh alone against that of trees of whole meshes. */
#include <math.h>
#include <string.h>

#include "base/host.h"
#include "bvh/kernel.h"
#include "check.h"
#include "collide/collide_overlap.h"
#include "failing_allocator.h"
#include "qm/collide.h"
#include "shapes.h"

static void check_same(const qm_mesh *a, const qm_mesh *b, qm_quad_reading quads, bool *has_pairs)
{
    qm_context ctx = qm_context_make();
    ctx.parallel = qm_host_parallel;
    qm_collide_options options = qm_collide_options_default();
    options.quads = quads;
    options.tolerance = 1e-6;
    options.thread_count = 2;
    qm_bvh *tree[2];
    qm_collision whole, near;
    assert_int_equal(qm_bvh_build(&ctx, a, QM_BVH_SOURCE, 1, &tree[0]), QM_OK);
    assert_int_equal(qm_bvh_build(&ctx, b, QM_BVH_SOURCE, 1, &tree[1]), QM_OK);
    assert_int_equal(qm_collide_meshes(&ctx, tree[0], tree[1], &options, &whole), QM_OK);
    assert_int_equal(qm_collide_surfaces(&ctx, a, b, &options, &near), QM_OK);
    assert_int_equal(whole.pair_count, near.pair_count);
    if (whole.pair_count > 0)
        assert_memory_equal(whole.pairs, near.pairs, whole.pair_count * sizeof *whole.pairs);
    *has_pairs = whole.pair_count > 0;
    qm_collide_reset(&ctx, &whole);
    qm_collide_reset(&ctx, &near);
    qm_bvh_destroy(&ctx, tree[0]);
    qm_bvh_destroy(&ctx, tree[1]);
}

/** How many faces of both meshes are left in the parts. */
static size_t count_near(const qm_mesh *a, const qm_mesh *b)
{
    qm_context ctx = qm_context_make();
    qm_overlap overlap;
    assert_int_equal(qm_overlap_find(&ctx, a, b, &overlap), QM_OK);
    size_t count = overlap.is_empty   ? 0
                   : overlap.is_whole ? a->face_count + b->face_count
                                      : overlap.part[0].count + overlap.part[1].count;
    qm_overlap_reset(&ctx, &overlap);
    return count;
}

static void parts_give_the_same_pairs(void **state)
{
    (void)state;
    size_t with_pairs = 0, runs = qm_check_long() ? 200 : 25;
    for (size_t run = 0; run < runs; run++) {
        qm_random random = qm_random_make(qm_check_seed(), run);
        qm_mesh torus = qm_shape_torus(60, 40, 1.0, 0.3), sphere = qm_shape_sphere(0.3);
        const double shift[3] = {qm_random_range(&random, -2, 2), qm_random_range(&random, -2, 2),
                                 qm_random_range(&random, -1, 1)};
        qm_shape_move(&sphere, run % 3 ? 0.4 : 1.1, shift);
        qm_mesh triangles = qm_shape_triangulated(&sphere);
        bool has_pairs;
        check_same(&torus, run % 2 ? &sphere : &triangles, QM_QUADS_TRIANGLES, &has_pairs);
        with_pairs += has_pairs;
        if (run % 5 == 0) check_same(&sphere, &torus, QM_QUADS_BILINEAR, &has_pairs);
        qm_shape_free(&triangles);
        qm_shape_free(&sphere);
        qm_shape_free(&torus);
    }
    assert_in_range(with_pairs, runs / 4, runs);
}

/** Soups touch in every way; some have faces across the whole box, or vertices far out that no face uses. */
static void parts_of_soups_give_the_same_pairs(void **state)
{
    (void)state;
    size_t with_pairs = 0;
    for (int run = 0; run < 2 * QM_SOUP_STYLE_COUNT; run++) {
        qm_random random = qm_random_make(qm_check_seed(), 100 + (uint64_t)run);
        qm_soup_style style = (qm_soup_style)(run % QM_SOUP_STYLE_COUNT);
        qm_mesh plane = qm_shape_plane(35, 0.25), wide = qm_shape_plane(40, 0.0);
        qm_mesh soup = qm_shape_soup(&random, 60, QM_SOUP_MIXED, style, 0.2);
        qm_mesh a = qm_shape_joined(&plane, &soup);
        const double far_out[3] = {1e6, -1e6, 30}, shift[3] = {run % 2 ? 0.5 : 0.01, 0.02, 0.25};
        qm_shape_move(&wide, 0.7, shift);
        qm_mesh b = qm_shape_with_unused(&wide, 5, far_out);
        bool has_pairs;
        check_same(&a, &b, QM_QUADS_TRIANGLES, &has_pairs);
        with_pairs += has_pairs;
        check_same(&b, &a, QM_QUADS_TRIANGLES, &has_pairs);
        qm_mesh *const all[] = {&plane, &wide, &soup, &a, &b};
        for (size_t i = 0; i < sizeof all / sizeof *all; i++)
            qm_shape_free(all[i]);
    }
    assert_int_equal(with_pairs, 2 * QM_SOUP_STYLE_COUNT);
}

static void faces_far_away_are_left_out(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_sphere(0.0), b = qm_shape_sphere(0.0);
    assert_int_equal(count_near(&a, &b), 2 * a.face_count);
    qm_shape_move(&b, 1.0, (const double[3]){1.8, 0, 0});
    size_t near = count_near(&a, &b);
    assert_in_range(near, 100, a.face_count / 2);
    /* One inside the other, with no face of either near one of the other. */
    qm_shape_move(&b, 0.5, (const double[3]){-0.9, 0, 0});
    assert_int_equal(count_near(&a, &b), 0);
    qm_shape_move(&b, 1.0, (const double[3]){5, 0, 0});
    assert_int_equal(count_near(&a, &b), 0);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

/** Planes at one height, of which the second begins where the first one ends. */
static void touching_in_a_line_is_found(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_plane(40, 0.0), b = qm_shape_plane(40, 0.0);
    qm_shape_move(&b, 1.0, (const double[3]){1, 0, 0});
    bool has_pairs;
    check_same(&a, &b, QM_QUADS_TRIANGLES, &has_pairs);
    assert_true(has_pairs);
    size_t near = count_near(&a, &b);
    assert_in_range(near, 80, 400);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

enum { CELL_VERTICES = 50, CELL_SIDES = 162 };

/** A grid with marks, and eight faces whose vertices have random cells, mostly near one another. */
typedef struct cell_trial {
    qm_cell_grid grid;
    qm_cell_row rows[CELL_SIDES * CELL_SIDES]; /* what is marked, a bit a cell */
    qm_cell_marks marks[CELL_SIDES * CELL_SIDES + 1];
    qm_cell cells[CELL_VERTICES];
    uint32_t faces[QM_CELL_FACES][4];
} cell_trial;

static qm_cell random_cell(qm_random *random, const uint32_t count[3], const uint32_t middle[3],
                           uint32_t reach)
{
    qm_cell cell = 0;
    for (int k = 0; k < 3; k++) {
        uint32_t at = middle[k] + (uint32_t)qm_random_below(random, reach);
        cell = cell << 8 | (at < count[k] + 1 ? at : count[k] + 1);
    }
    return cell;
}

/** Marks a random box, in both ways. */
static void mark_box(qm_random *random, const uint32_t middle[3], uint32_t reach, cell_trial *t)
{
    qm_cell a = random_cell(random, t->grid.count, middle, reach),
            b = random_cell(random, t->grid.count, middle, reach), low = 0, high = 0;
    for (int shift = 0; shift < 24; shift += 8) {
        uint32_t x = qm_cell_axis(a, shift), y = qm_cell_axis(b, shift);
        low |= (x < y ? x : y) << shift;
        high |= (x < y ? y : x) << shift;
    }
    qm_cell_rows rows = qm_cell_rows_find(low, high);
    qm_cell_marks_add(&t->grid, t->marks, &rows);
    for (uint32_t x = qm_cell_axis(low, QM_CELL_X); x <= qm_cell_axis(high, QM_CELL_X); x++)
        for (uint32_t y = qm_cell_axis(low, QM_CELL_Y); y <= qm_cell_axis(high, QM_CELL_Y); y++)
            for (uint32_t z = qm_cell_axis(low, QM_CELL_Z); z <= qm_cell_axis(high, QM_CELL_Z); z++)
                t->rows[x * (t->grid.count[1] + 2) + y] |= (qm_cell_row)1 << z;
}

static void make_cell_trial(qm_random *random, int run, cell_trial *t)
{
    for (int k = 0; k < 3; k++)
        t->grid.count[k] = 1 + (uint32_t)qm_random_below(random, k == 2 ? 62 : 160);
    t->grid.row_count = (t->grid.count[0] + 2) * (size_t)(t->grid.count[1] + 2);
    memset(t->rows, 0, sizeof t->rows);
    memset(t->marks, 0, sizeof t->marks);
    uint32_t middle[3];
    for (int k = 0; k < 3; k++)
        middle[k] = (uint32_t)qm_random_below(random, t->grid.count[k] + 2);
    for (int i = 0; i < run % 5; i++)
        mark_box(random, middle, i % 4 ? 3 : 10, t);
    qm_cell_marks_spread(&t->grid, t->marks);
    for (int i = 0; i < CELL_VERTICES; i++)
        t->cells[i] = random_cell(random, t->grid.count, middle, run % 3 == 0 ? 60 : 3);
    for (int i = 0; i < QM_CELL_FACES; i++)
        for (int k = 0; k < 4; k++)
            t->faces[i][k] =
                k == 3 && run % 2 ? QM_NO_INDEX : (uint32_t)qm_random_below(random, CELL_VERTICES);
}

/** The cells of one face along one axis: the least and the greatest. */
static void slow_range(const cell_trial *t, int face, int axis, uint32_t range[2])
{
    range[0] = 255;
    range[1] = 0;
    for (int k = 0; k < 4; k++) {
        if (t->faces[face][k] == QM_NO_INDEX) continue;
        uint32_t cell = t->cells[t->faces[face][k]] >> (8 * (2 - axis)) & 0xff;
        range[0] = cell < range[0] ? cell : range[0];
        range[1] = cell > range[1] ? cell : range[1];
    }
}

static void check_face(const cell_trial *t, const qm_kernel *kernel, int face)
{
    qm_cell_boxes boxes;
    unsigned inside = kernel->cell_boxes(&t->grid, t->faces[0], t->cells, &boxes), large;
    unsigned marked = kernel->cells_marked(&t->grid, t->marks, &boxes, &large);
    uint32_t range[3][2];
    bool is_inside = true, is_marked = false;
    for (int k = 0; k < 3; k++) {
        slow_range(t, face, k, range[k]);
        is_inside &= range[k][1] >= 1 && range[k][0] <= t->grid.count[k];
    }
    bool is_large = range[0][1] - range[0][0] > 1 || range[1][1] - range[1][0] > 1 ||
                    range[2][1] - range[2][0] > QM_CELL_SPAN;
    for (uint32_t x = range[0][0]; x <= range[0][1]; x++)
        for (uint32_t y = range[1][0]; y <= range[1][1]; y++)
            for (uint32_t z = range[2][0]; z <= range[2][1]; z++)
                is_marked |= t->rows[x * (t->grid.count[1] + 2) + y] >> z & 1;
    const qm_cell_rows rows = qm_cell_rows_find(boxes.low[face], boxes.high[face]);
    QM_CHECK(qm_cell_marks_meet(&t->grid, t->marks, &rows) == is_marked, "face %d", face);
    QM_CHECK((inside >> face & 1) == is_inside, "%s: face %d", kernel->name, face);
    QM_CHECK((large >> face & 1) == is_large, "%s: face %d", kernel->name, face);
    QM_CHECK((marked >> face & 1) == (is_marked && !is_large), "%s: face %d", kernel->name, face);
}

static void cells_are_those_of_a_slow_twin(void **state)
{
    (void)state;
    static cell_trial trial;
    for (int run = 0; run < 1000; run++) {
        qm_random random = qm_random_make(qm_check_seed(), 1000 + (uint64_t)run);
        make_cell_trial(&random, run, &trial);
        for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++)
            for (int face = 0; face < QM_CELL_FACES; face++)
                check_face(&trial, *kernel, face);
    }
}

static uint32_t slow_cell(const qm_cell_grid *grid, int k, double x)
{
    double place = (x - grid->low[k]) * grid->scale[k];
    uint32_t cell = place > 0.0 ? 1 + (uint32_t)place : 1;
    if (cell > grid->count[k]) cell = grid->count[k];
    return x < grid->low[k] ? 0 : x > grid->high[k] ? grid->count[k] + 1 : cell;
}

/** Numbers of vertices that four don't divide, a flat axis, and vertices outside and on the border. */
static void cells_of_vertices_are_those_of_a_slow_twin(void **state)
{
    (void)state;
    for (size_t run = 0; run < 100; run++) {
        qm_random random = qm_random_make(qm_check_seed(), 3000 + run);
        enum { MOST = 23 };
        double p[3 * MOST];
        size_t count = 1 + qm_random_below(&random, MOST);
        for (size_t i = 0; i < 3 * count; i++)
            p[i] = run % 4 == 0 && i % 3 == 1 ? 0.5 : qm_random_range(&random, -1, 1);
        qm_mesh points = {.positions = p, .vertex_count = count}, a = points, b = points;
        a.face_count = 90;
        b.face_count = 5000;
        b.vertex_count = (count + 1) / 2;
        qm_cell_grid grid;
        qm_box own[2];
        assert_true(qm_cell_grid_init((const qm_mesh *const[]){&a, &b}, own, &grid));
        for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++) {
            qm_cell cells[MOST];
            qm_box box, slow = qm_mesh_bounding_box(&points);
            (*kernel)->vertex_box(p, count, &box);
            assert_memory_equal(&box, &slow, sizeof box);
            (*kernel)->vertex_cells(&grid, p, count, cells);
            for (size_t i = 0; i < count; i++) {
                const double *x = p + 3 * i;
                qm_cell cell = slow_cell(&grid, 0, x[grid.axis[0]]) << QM_CELL_X |
                               slow_cell(&grid, 1, x[grid.axis[1]]) << QM_CELL_Y |
                               slow_cell(&grid, 2, x[grid.axis[2]]) << QM_CELL_Z;
                QM_CHECK(cells[i] == cell, "%s: run %zu, vertex %zu", (*kernel)->name, run, i);
            }
        }
    }
}

static void out_of_memory_is_a_status(void **state)
{
    (void)state;
    qm_mesh a = qm_shape_sphere(0.0), b = qm_shape_sphere(0.0);
    qm_shape_move(&b, 1.0, (const double[3]){1.8, 0, 0});
    qm_collide_options options = qm_collide_options_default();
    qm_status status = QM_E_NO_MEMORY;
    size_t fail_at = 0;
    for (; status == QM_E_NO_MEMORY; fail_at++) {
        qm_failing_allocator failing = {.fail_at = fail_at};
        qm_context ctx = qm_context_make();
        ctx.allocator = qm_failing_allocator_hook(&failing);
        qm_collision found;
        status = qm_collide_surfaces(&ctx, &a, &b, &options, &found);
        if (status == QM_OK)
            qm_collide_reset(&ctx, &found);
        else
            assert_true(strlen(ctx.message) > 0 && !found.pairs);
        assert_true(failing.live_blocks == 0 && !failing.mismatched);
    }
    assert_int_equal(status, QM_OK);
    assert_true(fail_at > 20);
    qm_shape_free(&a);
    qm_shape_free(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(parts_give_the_same_pairs),
        cmocka_unit_test(parts_of_soups_give_the_same_pairs),
        cmocka_unit_test(faces_far_away_are_left_out),
        cmocka_unit_test(touching_in_a_line_is_found),
        cmocka_unit_test(cells_are_those_of_a_slow_twin),
        cmocka_unit_test(cells_of_vertices_are_those_of_a_slow_twin),
        cmocka_unit_test(out_of_memory_is_a_status),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
