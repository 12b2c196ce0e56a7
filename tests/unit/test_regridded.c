/*
 * One surface of folded quads in two grids, where nearest points jump from sheet to sheet, and heaps of folded
 * quads that cross one another: the search ends within its bound of parts, and its bracket holds what the slow
 * twin finds.
 */
#include "check.h"
#include "measured.h"
#include "regridded.h"
#include "slow_twin.h"

#include <math.h>
#include <string.h>

enum { PAIRS = 16, SAMPLES = 2, HEAP = 100, HEAPS = 6, PARTS_PER_FACE = 100 };

static const char *const names[QM_FOLD_COUNT] = {"bow-tie",         "swapped", "at an edge", "reflex",
                                                 "over a diagonal", "in line", "any"};

static double diagonal_of(const qm_mesh *mesh)
{
    qm_box box = qm_mesh_bounding_box(mesh);
    return hypot(hypot(box.max[0] - box.min[0], box.max[1] - box.min[1]), box.max[2] - box.min[2]);
}

/** No sample of either surface is farther from the other than the upper bound. */
static void check_samples(const qm_regridded_pair *pair, const qm_hausdorff_result *r, qm_random *random,
                          const char *name, int k)
{
    const qm_mesh *meshes[] = {&pair->a, &pair->b};
    for (int side = 0; side < 2; side++)
        for (int i = 0; i < SAMPLES; i++) {
            const qm_mesh *mesh = meshes[side];
            double p[3], uv[2] = {qm_random_range(random, 0, 1), qm_random_range(random, 0, 1)};
            size_t face = qm_random_below(random, mesh->face_count);
            bool is_triangle = mesh->faces[4 * face + 3] == QM_NO_INDEX;
            if (is_triangle && uv[0] + uv[1] > 1) uv[1] = 1 - uv[0];
            qm_slow_position(mesh, face, QM_QUADS_BILINEAR, uv, p);
            double far = qm_slow_distance(meshes[1 - side], QM_QUADS_BILINEAR, p, 1e-7).lower;
            QM_CHECK(far <= r->upper + 1e-14, "%s %d: a point is %.17g away, upper bound %.17g", name, k, far,
                     r->upper);
        }
}

static void check_pair(qm_random *random, qm_fold fold, qm_regridding how, int k)
{
    qm_regridded_pair pair = qm_regridded_draw(random, fold, how);
    double size = diagonal_of(&pair.a);
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.quads = QM_QUADS_BILINEAR;
    options.tolerance = 1e-6 * size;
    qm_hausdorff_result r = qm_measured(&pair.a, &pair.b, &options);
    QM_CHECK(r.stop == QM_STOP_CONVERGED, "%s %d.%d: stop %d, [%.17g, %.17g] after %llu parts", names[fold],
             (int)how, k, (int)r.stop, r.lower, r.upper, (unsigned long long)r.iterations);
    /* Points of the same parameters are no farther apart than their corners were moved. */
    if (how != QM_REGRIDDED_TRIANGLES)
        QM_CHECK(r.lower <= sqrt(3) * pair.noise + 1e-14, "%s %d: lower %.17g, noise %g", names[fold], k,
                 r.lower, pair.noise);
    check_samples(&pair, &r, random, names[fold], k);
    qm_shape_free(&pair.a);
    qm_shape_free(&pair.b);
}

/** A heap and a noisy copy in another order end after a few parts of each face. */
static void check_heap(uint64_t seed, uint64_t stream)
{
    qm_random random = qm_random_make(seed, stream);
    qm_mesh heap = qm_folded_heap(&random, HEAP), copy = qm_shape_copy(&heap);
    qm_shape_shake(&copy, &random, 0.03);
    qm_regridded_pair pair = {heap, qm_shape_reversed(&copy), 0.03};
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.quads = QM_QUADS_BILINEAR;
    options.tolerance = 1e-6 * diagonal_of(&heap);
    qm_hausdorff_result r = qm_measured(&pair.a, &pair.b, &options);
    QM_CHECK(r.stop == QM_STOP_CONVERGED && r.iterations < PARTS_PER_FACE * HEAP,
             "heap %llu.%llu: stop %d after %llu parts", (unsigned long long)seed, (unsigned long long)stream,
             (int)r.stop, (unsigned long long)r.iterations);
    check_samples(&pair, &r, &random, "heap", (int)stream);
    qm_shape_free(&copy);
    qm_shape_free(&pair.a);
    qm_shape_free(&pair.b);
}

static void check_regridding(qm_regridding how)
{
    uint64_t seed = qm_check_seed();
    for (int fold = 0; fold < QM_FOLD_COUNT; fold++)
        for (int k = 0; k < PAIRS; k++) {
            qm_random random = qm_random_make(seed, (uint64_t)(1000 * fold + k));
            check_pair(&random, (qm_fold)fold, how, k);
        }
}

static void grids_that_nearly_coincide_converge(void **state)
{
    (void)state;
    check_regridding(QM_REGRIDDED_CLOSELY);
}

static void noisy_grids_converge(void **state)
{
    (void)state;
    check_regridding(QM_REGRIDDED_NOISY);
}

static void a_grid_and_its_triangles_converge(void **state)
{
    (void)state;
    check_regridding(QM_REGRIDDED_TRIANGLES);
}

/** In these a patch is just as far as the cutoff: matches came down to rectangles between neighbouring
 * numbers, and left these over again and again. */
static void heaps_that_a_patch_just_reaches_converge(void **state)
{
    (void)state;
    const uint64_t endless[] = {88, 563, 988};
    for (size_t i = 0; i < sizeof endless / sizeof *endless; i++)
        check_heap(20261125, endless[i]);
}

static void shuffled_heaps_converge(void **state)
{
    (void)state;
    uint64_t seed = qm_check_seed();
    for (int k = 0; k < HEAPS; k++)
        check_heap(seed, (uint64_t)(100000 + k));
}

typedef struct known_pair {
    qm_fold fold;
    qm_regridding how;
    uint64_t seed, stream, parts;
} known_pair;

/** These end before they come to so many parts. */
static void check_parts(const known_pair pairs[], size_t count)
{
    for (size_t i = 0; i < count; i++) {
        qm_random random = qm_random_make(pairs[i].seed, pairs[i].stream);
        qm_regridded_pair pair = qm_regridded_draw(&random, pairs[i].fold, pairs[i].how);
        qm_hausdorff_options options = qm_hausdorff_options_default();
        options.quads = QM_QUADS_BILINEAR;
        options.tolerance = 1e-6 * diagonal_of(&pair.a);
        qm_hausdorff_result r = qm_measured(&pair.a, &pair.b, &options);
        QM_CHECK(r.stop == QM_STOP_CONVERGED && r.iterations < pairs[i].parts,
                 "%s %llu: stop %d after %llu parts", names[pairs[i].fold],
                 (unsigned long long)pairs[i].stream, (int)r.stop, (unsigned long long)r.iterations);
        check_samples(&pair, &r, &random, names[pairs[i].fold], (int)i);
        qm_shape_free(&pair.a);
        qm_shape_free(&pair.b);
    }
}

/** Flat bow-ties over triangles, whose flatness bound is as large as they are, and a rectangle along an edge of
 * the target, which was cut in ever more quarters: 1,000 to 3,000 parts each. */
static void flat_folds_take_few_parts(void **state)
{
    (void)state;
    const known_pair pairs[] = {{QM_FOLD_BOW_TIE, QM_REGRIDDED_TRIANGLES, 1, 200072, 500},
                                {QM_FOLD_BOW_TIE, QM_REGRIDDED_TRIANGLES, 1, 200213, 500},
                                {QM_FOLD_AT_EDGE, QM_REGRIDDED_NOISY, 1, 102104, 500}};
    check_parts(pairs, sizeof pairs / sizeof *pairs);
}

/** Fans and wedges of patches over one another, and a coarse patch over triangles: labels, which lose the twist
 * of a patch, took 880 to 4,300 parts. */
static void fans_of_patches_take_few_parts(void **state)
{
    (void)state;
    const known_pair pairs[] = {{QM_FOLD_BOW_TIE, QM_REGRIDDED_NOISY, 1, 100124, 400},
                                {QM_FOLD_BOW_TIE, QM_REGRIDDED_NOISY, 3, 100127, 300},
                                {QM_FOLD_ANY, QM_REGRIDDED_TRIANGLES, 2, 206008, 500},
                                {QM_FOLD_ANY, QM_REGRIDDED_TRIANGLES, 3, 206191, 1600},
                                {QM_FOLD_ANY, QM_REGRIDDED_TRIANGLES, 3, 206232, 1200}};
    check_parts(pairs, sizeof pairs / sizeof *pairs);
}

/** A coarse grid over a fine one: halves that came down to the gap at each line, and matches that left hundreds of
 * quarters, took 590 to 1,710 parts. */
static void coarse_grids_take_few_parts(void **state)
{
    (void)state;
    const known_pair pairs[] = {{QM_FOLD_SWAPPED, QM_REGRIDDED_NOISY, 783, 101038, 400},
                                {QM_FOLD_SWAPPED, QM_REGRIDDED_NOISY, 782, 101179, 600},
                                {QM_FOLD_AT_EDGE, QM_REGRIDDED_NOISY, 788, 102397, 400},
                                {QM_FOLD_AT_EDGE, QM_REGRIDDED_NOISY, 778, 102140, 400},
                                {QM_FOLD_LINE, QM_REGRIDDED_NOISY, 786, 105014, 400},
                                {QM_FOLD_DIAGONAL, QM_REGRIDDED_NOISY, 789, 104018, 400}};
    check_parts(pairs, sizeof pairs / sizeof *pairs);
}

/** Triangles over one patch that turns under them: labels cut slivers off, 730 to 2,030 parts. */
static void triangles_over_one_patch_take_few_parts(void **state)
{
    (void)state;
    const known_pair pairs[] = {{QM_FOLD_LINE, QM_REGRIDDED_TRIANGLES, 9001, 205441, 550},
                                {QM_FOLD_AT_EDGE, QM_REGRIDDED_TRIANGLES, 779, 202327, 1200},
                                {QM_FOLD_BOW_TIE, QM_REGRIDDED_NOISY, 782, 100149, 500}};
    check_parts(pairs, sizeof pairs / sizeof *pairs);
}

/** Needles along the line between two sheets, and slivers at an apex: strips of two triangles each were cut in half again
 * and again, 900, 1,039 and 733 parts. */
static void needles_take_few_parts(void **state)
{
    (void)state;
    const known_pair pairs[] = {{QM_FOLD_DIAGONAL, QM_REGRIDDED_TRIANGLES, 925, 204324, 100},
                                {QM_FOLD_AT_EDGE, QM_REGRIDDED_TRIANGLES, 787, 202379, 900},
                                {QM_FOLD_AT_EDGE, QM_REGRIDDED_TRIANGLES, 931, 202343, 550}};
    check_parts(pairs, sizeof pairs / sizeof *pairs);
}

/** One cell is missing in a noisy grid over a patch: the search finds the hole, in whichever of the rectangles it lies that
 * are left beside the cell under the centre. */
static void a_hole_beside_the_centre_is_found(void **state)
{
    (void)state;
    const double corner[4][3] = {{0, 0, 0}, {1, 0, 0.1}, {1, 1, -0.2}, {0, 1, 0.3}};
    const double cut[] = {0, 0.2, 0.4, 0.6, 0.8, 1};
    qm_mesh patch = qm_shape_make(4, 1);
    memcpy(patch.positions, corner, sizeof corner);
    for (uint32_t i = 0; i < 4; i++)
        patch.faces[i] = i;
    for (int hole = 0; hole < 25; hole++) {
        qm_random random = qm_random_make(qm_check_seed(), (uint64_t)(300000 + hole));
        qm_mesh grid = qm_regridded(&patch, 5, cut, 5, cut, false);
        qm_shape_shake(&grid, &random, 1e-3);
        grid.face_count--;
        memcpy(grid.faces + 4 * hole, grid.faces + 4 * grid.face_count, 4 * sizeof *grid.faces);
        qm_hausdorff_options options = qm_hausdorff_options_default();
        options.quads = QM_QUADS_BILINEAR;
        options.tolerance = 1e-5;
        qm_hausdorff_result r = qm_measured(&patch, &grid, &options);
        double p[3], uv[2] = {0.2 * (hole % 5) + 0.1, 0.2 * (hole / 5) + 0.1};
        qm_slow_position(&patch, 0, QM_QUADS_BILINEAR, uv, p);
        double far = qm_slow_distance(&grid, QM_QUADS_BILINEAR, p, 1e-7).lower;
        QM_CHECK(far <= r.upper + 1e-14, "hole %d: %.17g away, upper bound %.17g", hole, far, r.upper);
        qm_shape_free(&grid);
    }
    qm_shape_free(&patch);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(grids_that_nearly_coincide_converge),
        cmocka_unit_test(noisy_grids_converge),
        cmocka_unit_test(a_grid_and_its_triangles_converge),
        cmocka_unit_test(flat_folds_take_few_parts),
        cmocka_unit_test(fans_of_patches_take_few_parts),
        cmocka_unit_test(coarse_grids_take_few_parts),
        cmocka_unit_test(triangles_over_one_patch_take_few_parts),
        cmocka_unit_test(needles_take_few_parts),
        cmocka_unit_test(a_hole_beside_the_centre_is_found),
        cmocka_unit_test(heaps_that_a_patch_just_reaches_converge),
        cmocka_unit_test(shuffled_heaps_converge),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
