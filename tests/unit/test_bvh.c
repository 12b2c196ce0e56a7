/* Trees: equal on any number of threads, with only the requested parts, and the sort below them. */
#include "check.h"

#include "base/host.h"
#include "bvh/bvh_demand.h"
#include "bvh/kernel.h"
#include "core/radix.h"
#include "qm/hausdorff.h"
#include "random.h"
#include "shapes.h"

#include <math.h>
#include <string.h>

static qm_bvh *build(qm_context *ctx, const qm_mesh *mesh, qm_bvh_parts parts, int threads)
{
    qm_bvh *tree;
    ctx->parallel = threads > 1 ? qm_host_parallel : NULL;
    assert_int_equal(qm_bvh_build(ctx, mesh, parts, threads, &tree), QM_OK);
    return tree;
}

static void check_same(const qm_bvh *a, const qm_bvh *b)
{
    assert_memory_equal(&a->frame, &b->frame, sizeof a->frame);
    assert_true(a->reach == b->reach);
    assert_int_equal(a->pack_count, b->pack_count);
    for (size_t i = 0; i < a->pack_count; i++) {
        qm_pack spare[2];
        assert_memory_equal(qm_bvh_pack(a, i, &spare[0]), qm_bvh_pack(b, i, &spare[1]), sizeof(qm_pack));
        assert_memory_equal(qm_bvh_float_pack(a, i), qm_bvh_float_pack(b, i), sizeof(qm_float_pack));
        if (a->has_quads)
            assert_memory_equal(qm_bvh_twists(a, i), qm_bvh_twists(b, i), sizeof(qm_pack_twists));
        const qm_pack_lanes *one = &a->lanes[i], *other = &b->lanes[i];
        assert_memory_equal(one->face, other->face, sizeof one->face);
        assert_int_equal(one->lane_count, other->lane_count);
        assert_int_equal(one->second, other->second);
        assert_int_equal(one->vertex_count, other->vertex_count);
        assert_memory_equal(one->vertex, other->vertex, one->vertex_count * sizeof *one->vertex);
        assert_memory_equal(one->corner, other->corner, one->lane_count * sizeof *one->corner);
    }
    assert_int_equal(a->boxes.level_count, b->boxes.level_count);
    for (int level = 1; level <= a->boxes.level_count; level++)
        assert_memory_equal(a->boxes.groups[level], b->boxes.groups[level],
                            a->boxes.group_count[level] * sizeof *a->boxes.groups[level]);
}

/** Before a tree is built its size is known from below, and not far from it. */
static void check_needed(qm_mesh mesh)
{
    const qm_bvh_parts parts[] = {QM_BVH_SOURCE, QM_BVH_TARGET, QM_BVH_ALL};
    const size_t facets = mesh.face_count > 0 ? mesh.face_count : mesh.vertex_count;
    size_t quads = 0;
    for (size_t i = 0; i < mesh.face_count; i++)
        quads += mesh.faces[4 * i + 3] != QM_NO_INDEX;
    for (size_t i = 0; i < 3; i++) {
        qm_context ctx = qm_context_make();
        qm_bvh *tree = build(&ctx, &mesh, parts[i], 1);
        size_t needed = qm_bvh_memory_needed(facets - quads, quads, parts[i]);
        size_t built = qm_bvh_memory_size(tree) + facets * sizeof(uint64_t);
        QM_CHECK(needed <= built && (facets < 1000 || 2 * needed > built), "parts %d: %zu of %zu bytes",
                 (int)parts[i], needed, built);
        qm_bvh_destroy(&ctx, tree);
    }
    qm_shape_free(&mesh);
}

static void sizes_are_known_before(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 2);
    check_needed(qm_shape_sphere(0.0));
    check_needed(qm_shape_copies(1));
    check_needed(qm_shape_copies(5000));
    check_needed(qm_shape_points(&random, 20000));
    check_needed(qm_shape_soup(&random, 9, QM_SOUP_MIXED, QM_SOUP_POOLED, 0.0));
    check_needed(qm_shape_soup(&random, 4000, QM_SOUP_MIXED, QM_SOUP_POOLED, 0.0));
    check_needed(qm_shape_soup(&random, 4000, QM_SOUP_QUADS, QM_SOUP_POOLED, 0.0));
}

static void check_threads(qm_mesh mesh)
{
    qm_context ctx = qm_context_make();
    qm_bvh *alone = build(&ctx, &mesh, QM_BVH_ALL, 1);
    for (int threads = 2; threads <= 5; threads++) {
        qm_bvh *tree = build(&ctx, &mesh, QM_BVH_ALL, threads);
        check_same(alone, tree);
        qm_bvh_destroy(&ctx, tree);
    }
    qm_bvh_destroy(&ctx, alone);
    qm_shape_free(&mesh);
}

static void ask_for_everything(void *data, int worker)
{
    (void)worker;
    const qm_bvh *tree = data;
    for (size_t i = 0; i < tree->pack_count; i++) {
        qm_bvh_float_pack(tree, i);
        qm_pack spare;
        qm_bvh_pack(tree, i, &spare);
        qm_bvh_twists(tree, i);
    }
}

static void check_all_made(const qm_demand *demand)
{
    for (size_t i = 0; i < demand->count; i++)
        assert_true(demand->slot[i] < demand->count);
    assert_int_equal(*demand->used, demand->count);
}

/** All threads come to the same pack at about the same time, again and again. */
static void threads_make_the_same_items(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh mesh = qm_shape_torus(200, 50, 2.0, 0.5);
    qm_bvh *alone = build(&ctx, &mesh, QM_BVH_ALL, 1), *shared = build(&ctx, &mesh, QM_BVH_ALL, 1);
    qm_host_parallel(NULL, 4, ask_for_everything, shared);
    check_all_made(&shared->floats);
    check_all_made(&shared->rows);
    check_all_made(&shared->twists);
    check_same(alone, shared);
    qm_bvh_destroy(&ctx, shared);
    qm_bvh_destroy(&ctx, alone);
    qm_shape_free(&mesh);
}

/** The float pack that the tree gives is that of the corners of its faces as they are. */
static void check_float_packs(const qm_bvh *tree)
{
    const qm_kernel *kernel = qm_kernel_get();
    for (size_t i = 0; i < tree->pack_count; i++) {
        qm_pack_corners corners;
        qm_float_pack expected;
        kernel->load_corners(tree, i, &corners);
        kernel->fill_float(&expected, corners.at);
        assert_memory_equal(qm_bvh_float_pack(tree, i), &expected, sizeof expected);
    }
}

/** Those of a small tree are made by the build; the others are stored in the order in which they are asked for, also
 * when they are made again for a mesh that has moved. */
static void float_packs_of_large_trees_are_made_on_demand(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh mesh = qm_shape_torus(200, 100, 2.0, 0.5);
    qm_bvh *tree = build(&ctx, &mesh, QM_BVH_ALL, 1);
    assert_int_equal(*tree->floats.used, 0);
    const qm_float_pack *first = qm_bvh_float_pack(tree, 4000), *second = qm_bvh_float_pack(tree, 17);
    assert_true(second == first + 1 && qm_bvh_float_pack(tree, 4000) == first);
    assert_int_equal(*tree->floats.used, 2);
    qm_host_parallel(NULL, 4, ask_for_everything, tree);
    check_all_made(&tree->floats);
    check_float_packs(tree);

    qm_deformer *deformer;
    size_t updated;
    assert_int_equal(qm_deformer_build(&ctx, tree, &deformer), QM_OK);
    for (size_t i = 0; i < 3 * mesh.vertex_count; i++)
        mesh.positions[i] = 1.25 * mesh.positions[i] + 0.125;
    assert_int_equal(qm_bvh_refit(&ctx, tree, deformer, &mesh, NULL, 0, 1, &updated), QM_OK);
    assert_true(qm_bvh_float_pack(tree, 17) == second);
    check_float_packs(tree);
    check_all_made(&tree->floats);
    qm_deformer_destroy(&ctx, deformer);
    qm_bvh_destroy(&ctx, tree);
    qm_shape_free(&mesh);
}

static qm_hausdorff_result measure(qm_context *ctx, const qm_bvh *a, const qm_bvh *b)
{
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.tolerance = 1e-7;
    options.quads = QM_QUADS_BILINEAR;
    qm_hausdorff_result result;
    assert_int_equal(qm_hausdorff_measure(ctx, a, b, &options, &result), QM_OK);
    return result;
}

/** Frames that are not stored are computed on each query, with equal bits; several threads take the last slots. */
static void rows_without_room_are_the_same(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh fine = qm_shape_torus(60, 40, 2.0, 0.5), coarse = qm_shape_torus(25, 15, 2.0, 0.5);
    qm_bvh *source = build(&ctx, &coarse, QM_BVH_ALL, 1), *kept = build(&ctx, &fine, QM_BVH_ALL, 1);
    qm_hausdorff_result expected = measure(&ctx, source, kept);
    static const size_t rooms[] = {0, 1, 7, 100};
    for (size_t i = 0; i < sizeof rooms / sizeof *rooms; i++) {
        qm_bvh *tree = build(&ctx, &fine, QM_BVH_ALL, 1);
        size_t whole = tree->rows.room;
        assert_int_equal(whole, tree->pack_count);
        tree->rows.room = rooms[i];
        qm_host_parallel(NULL, 4, ask_for_everything, tree);
        assert_int_equal(*tree->rows.used, rooms[i]);
        check_same(kept, tree);
        qm_hausdorff_result result = measure(&ctx, source, tree);
        assert_true(result.lower == expected.lower && result.upper == expected.upper);
        tree->rows.room = whole;
        qm_bvh_destroy(&ctx, tree);
    }
    qm_bvh_destroy(&ctx, kept);
    qm_bvh_destroy(&ctx, source);
    qm_shape_free(&coarse);
    qm_shape_free(&fine);
}

static void threads_build_the_same_tree(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 0);
    check_threads(qm_shape_torus(400, 150, 2.0, 0.5));
    check_threads(qm_shape_points(&random, 50000));
    check_threads(qm_shape_copies(40000));
    check_threads(qm_shape_box(1.0, 2.0, 0.0));
}

/** Sets the box of a pack to NaN, so that a side that is not set again shows. */
static void spoil_box(qm_bvh *tree, size_t pack)
{
    qm_box_node *group = &tree->boxes.groups[1][pack / 8];
    for (int k = 0; k < 3; k++)
        group->low[k][pack % 8] = group->high[k][pack % 8] = NAN;
}

/** The box of a pack must be that of its local vertices, and the margin. */
static void check_box(const qm_bvh *tree, size_t pack)
{
    const qm_pack_lanes *lanes = &tree->lanes[pack];
    const qm_box_node *group = &tree->boxes.groups[1][pack / 8];
    for (int k = 0; k < 3; k++) {
        double low = INFINITY, high = -INFINITY;
        for (int i = 0; i < lanes->vertex_count; i++) {
            const double *p = tree->mesh.positions + 3 * (size_t)lanes->vertex[i];
            qm_vec local = qm_frame_local(&tree->frame, p);
            const double at[3] = {local.x, local.y, local.z};
            low = fmin(low, at[k]);
            high = fmax(high, at[k]);
        }
        assert_true(group->low[k][pack % 8] == (float)(low - QM_BOX_MARGIN));
        assert_true(group->high[k][pack % 8] == (float)(high + QM_BOX_MARGIN));
    }
}

/** The corners must be those of the faces in the lanes, past the last lane those of the first. */
static void check_corners(const qm_bvh *tree, size_t pack, const qm_pack_corners *corners)
{
    const uint32_t count = tree->lanes[pack].lane_count;
    for (uint32_t lane = 0; lane < QM_PACK_LANES; lane++) {
        qm_vec corner[3];
        qm_bvh_load_triangle(tree, (uint32_t)pack, lane < count ? lane : 0, corner);
        for (int i = 0; i < 3; i++)
            assert_true(corners->at[i][0][lane] == corner[i].x && corners->at[i][1][lane] == corner[i].y &&
                        corners->at[i][2][lane] == corner[i].z);
    }
}

/** Each kernel must find boxes and corners from the vertices. */
static void check_boxes(qm_bvh *tree, const qm_kernel *kernel)
{
    for (size_t pack = 0; pack < tree->pack_count; pack++) {
        const qm_pack_lanes *lanes = &tree->lanes[pack];
        qm_pack_corners corners;
        spoil_box(tree, pack);
        kernel->fit_box(tree, pack, lanes->vertex, lanes->vertex_count);
        check_box(tree, pack);
        spoil_box(tree, pack);
        kernel->fit_corners(tree, pack, &corners);
        check_box(tree, pack);
        check_corners(tree, pack, &corners);
        kernel->load_corners(tree, pack, &corners);
        check_corners(tree, pack, &corners);
    }
}

static void boxes_are_those_of_the_vertices(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_random random = qm_random_make(qm_check_seed(), 2);
    qm_mesh meshes[] = {qm_shape_torus(40, 15, 2.0, 0.5),
                        qm_shape_soup(&random, 300, QM_SOUP_MIXED, QM_SOUP_POOLED, 1.0)};
    for (int i = 0; i < 2; i++) {
        qm_bvh *tree = build(&ctx, &meshes[i], QM_BVH_SOURCE, 1);
        for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++)
            check_boxes(tree, *kernel);
        qm_bvh_destroy(&ctx, tree);
        qm_shape_free(&meshes[i]);
    }
}

static void sources_hold_no_triangles_and_are_refused_as_targets(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh mesh = qm_shape_saddle(20);
    qm_bvh *source = build(&ctx, &mesh, QM_BVH_SOURCE, 1), *target = build(&ctx, &mesh, QM_BVH_TARGET, 1);
    qm_bvh *all = build(&ctx, &mesh, QM_BVH_ALL, 1);
    assert_true(qm_bvh_memory_size(source) < qm_bvh_memory_size(target) / 3);
    assert_true(qm_bvh_memory_size(target) < qm_bvh_memory_size(all));

    qm_hausdorff_options options = qm_hausdorff_options_default();
    qm_hausdorff_result result;
    options.tolerance = 1e-6;
    options.direction = QM_A_TO_B;
    assert_int_equal(qm_hausdorff_measure(&ctx, source, target, &options, &result), QM_OK);
    assert_int_equal(qm_hausdorff_measure(&ctx, target, source, &options, &result), QM_E_ARGUMENT);
    options.quads = QM_QUADS_BILINEAR;
    assert_int_equal(qm_hausdorff_measure(&ctx, source, target, &options, &result), QM_E_ARGUMENT);
    assert_int_equal(qm_hausdorff_measure(&ctx, source, all, &options, &result), QM_OK);
    options.direction = QM_TWO_SIDED;
    assert_int_equal(qm_hausdorff_measure(&ctx, source, all, &options, &result), QM_E_ARGUMENT);

    const double point[3] = {0.1, 0.2, 0.3};
    double distance;
    qm_projection out = {.distance = &distance};
    assert_int_equal(qm_project_points(&ctx, source, QM_QUADS_TRIANGLES, point, 1, 1, &out), QM_E_ARGUMENT);
    assert_int_equal(qm_project_points(&ctx, target, QM_QUADS_BILINEAR, point, 1, 1, &out), QM_E_ARGUMENT);
    assert_int_equal(qm_project_points(&ctx, target, QM_QUADS_TRIANGLES, point, 1, 1, &out), QM_OK);
    assert_true(distance > 0.0);
    qm_bvh_destroy(&ctx, source);
    qm_bvh_destroy(&ctx, target);
    qm_bvh_destroy(&ctx, all);
    qm_shape_free(&mesh);
}

/** A far vertex that no face uses widens the frame at first; the surface must not lose its digits to it. */
static void a_stray_vertex_costs_no_precision(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh mesh = qm_shape_torus(12, 8, 0.8, 0.2);
    qm_mesh stray = qm_shape_with_unused(&mesh, 1, (const double[3]){1e30, 1e30, 1e30});
    qm_bvh *with, *without;
    assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &without), QM_OK);
    assert_int_equal(qm_bvh_build(&ctx, &stray, QM_BVH_ALL, 1, &with), QM_OK);
    assert_true(with->frame.scale == without->frame.scale);
    assert_true(with->reach == without->reach);
    qm_bvh_destroy(&ctx, with);
    qm_bvh_destroy(&ctx, without);
    qm_shape_free(&stray);
    qm_shape_free(&mesh);
}

static int compare_entries(const void *a, const void *b)
{
    uint64_t first, second;
    memcpy(&first, a, sizeof first);
    memcpy(&second, b, sizeof second);
    return (first > second) - (first < second);
}

/** Entries come by ascending index, as the builder makes them. */
static void check_sort(qm_context *ctx, qm_random *random, size_t count, int shift, int key_bits)
{
    uint64_t *given = malloc((count + 1) * sizeof *given), *wanted = malloc((count + 1) * sizeof *wanted),
             *entries = malloc((count + 1) * sizeof *entries);
    for (size_t i = 0; i < count; i++) /* few different keys, so that many are equal */
        given[i] = qm_radix_entry((uint64_t)qm_random_below(random, 500) << shift, i);
    memcpy(wanted, given, count * sizeof *wanted);
    qsort(wanted, count, sizeof *wanted, compare_entries);
    for (int workers = 1; workers <= 6; workers++) {
        memcpy(entries, given, count * sizeof *entries);
        assert_int_equal(qm_radix_sort(ctx, entries, count, key_bits, workers), QM_OK);
        QM_CHECK(memcmp(entries, wanted, count * sizeof *entries) == 0,
                 "seed %llu, %zu entries, keys of %d bits, %d workers", (unsigned long long)qm_check_seed(),
                 count, key_bits, workers);
    }
    free(given);
    free(wanted);
    free(entries);
}

static void entries_are_sorted_by_any_number_of_workers(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 0);
    qm_context ctx = qm_context_make();
    ctx.parallel = qm_host_parallel;
    const size_t counts[] = {0, 1, 2, 1000, 16384, 50001, 70000};
    for (int part = 0; part < 3; part++) {
        for (size_t c = 0; c < sizeof counts / sizeof *counts; c++) {
            /* 24 and 36 bits are sorted in wide digits where there are many. */
            check_sort(&ctx, &random, counts[c], 7 * part, 24);
            for (int key_bits = 30; key_bits <= 36; key_bits += 3)
                check_sort(&ctx, &random, counts[c], 10 * part, key_bits);
        }
    }
    check_sort(&ctx, &random, 600001, 27, 36); /* as many ranges as there are at most */
}

/** Numbers that have their high bits in common, as the pairs of one face do. */
static void check_numbers(qm_context *ctx, qm_random *random, size_t count, int bit_count)
{
    uint64_t *given = malloc(count * sizeof *given), *wanted = malloc(count * sizeof *wanted),
             *numbers = malloc(count * sizeof *numbers);
    for (size_t i = 0; i < count; i++)
        given[i] =
            UINT64_C(0x2b) << bit_count | (bit_count > 0 ? qm_random_bits(random) >> (64 - bit_count) : 0);
    memcpy(wanted, given, count * sizeof *wanted);
    qsort(wanted, count, sizeof *wanted, compare_entries);
    for (int workers = 1; workers <= 6; workers++) {
        memcpy(numbers, given, count * sizeof *numbers);
        assert_int_equal(qm_radix_sort_numbers(ctx, numbers, count, bit_count, workers), QM_OK);
        QM_CHECK(memcmp(numbers, wanted, count * sizeof *numbers) == 0,
                 "seed %llu, %zu numbers of %d bits, %d workers", (unsigned long long)qm_check_seed(), count,
                 bit_count, workers);
    }
    free(given);
    free(wanted);
    free(numbers);
}

static void numbers_are_sorted_below_bits_in_common(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 1);
    qm_context ctx = qm_context_make();
    ctx.parallel = qm_host_parallel;
    for (int bit_count = 0; bit_count <= 40; bit_count += bit_count == 0 ? 1 : 3) {
        check_numbers(&ctx, &random, 3, bit_count);
        check_numbers(&ctx, &random, 60000, bit_count);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sizes_are_known_before),
        cmocka_unit_test(threads_build_the_same_tree),
        cmocka_unit_test(threads_make_the_same_items),
        cmocka_unit_test(float_packs_of_large_trees_are_made_on_demand),
        cmocka_unit_test(rows_without_room_are_the_same),
        cmocka_unit_test(boxes_are_those_of_the_vertices),
        cmocka_unit_test(sources_hold_no_triangles_and_are_refused_as_targets),
        cmocka_unit_test(a_stray_vertex_costs_no_precision),
        cmocka_unit_test(entries_are_sorted_by_any_number_of_workers),
        cmocka_unit_test(numbers_are_sorted_below_bits_in_common),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
