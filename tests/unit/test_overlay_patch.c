/* Rectangles of patches over facets, and faces over patches: the vertical distance is at least that of each sampled pair of
 * points, one straight over the other, in long double; it is hardly more than the greatest of them; and a rectangle that is
 * settled is near everywhere, whatever the target is like. */
#include "check.h"

#include "hausdorff/hausdorff_overlay.h"
#include "prim/bilinear.h"
#include "random.h"
#include "shapes.h"
#include "slow_twin.h"
#include "target.h"

#include <math.h>
#include <string.h>

enum { PAIRS = 3000, STEPS = 48, TARGETS = 200, TRIES = 12, SAMPLES = 40, COLUMNS = 12 };

static void draw_corner(qm_random *random, double spread, double height, double at[3])
{
    for (int k = 0; k < 2; k++)
        at[k] = spread * qm_random_range(random, -1, 1);
    at[2] = height * qm_random_range(random, -1, 1);
}

/** Corners of a patch in cyclic order: nearly a square, or any. */
static void draw_patch(qm_random *random, double height, double corner[4][3])
{
    static const double square[4][2] = {{-0.7, -0.7}, {0.7, -0.7}, {0.7, 0.7}, {-0.7, 0.7}};
    bool is_any = qm_random_below(random, 4) == 0;
    for (int i = 0; i < 4; i++) {
        draw_corner(random, is_any ? 1.0 : 0.3, height, corner[i]);
        for (int k = 0; k < 2 && !is_any; k++)
            corner[i][k] += square[i][k];
    }
}

static void patch_at(const double c[4][3], long double s, long double t, long double at[3])
{
    for (int k = 0; k < 3; k++)
        at[k] = (1 - s) * (1 - t) * c[0][k] + s * (1 - t) * c[1][k] + s * t * c[2][k] + (1 - s) * t * c[3][k];
}

/** The height of a point above a triangle's plane where it is over the triangle, by weights; NAN elsewhere. */
static long double height_over(const double t[3][3], const long double p[3])
{
    long double weight[3], sum = 0, height = p[2];
    for (int i = 0; i < 3; i++) {
        const double *a = t[(i + 1) % 3], *b = t[(i + 2) % 3];
        weight[i] = ((long double)b[0] - a[0]) * (p[1] - a[1]) - ((long double)b[1] - a[1]) * (p[0] - a[0]);
        sum += weight[i];
    }
    for (int i = 0; i < 3; i++) {
        if (!(weight[i] / sum >= 0)) return NAN;
        height -= weight[i] / sum * t[i][2];
    }
    return height;
}

/** The greatest height of the points of a grid, and how many are over the triangle. */
static long double greatest_height(const double patch[4][3], const double triangle[3][3], int *count)
{
    long double greatest = 0;
    *count = 0;
    for (int i = 0; i <= STEPS; i++)
        for (int j = 0; j <= STEPS; j++) {
            long double p[3];
            patch_at(patch, (long double)i / STEPS, (long double)j / STEPS, p);
            long double height = fabsl(height_over(triangle, p));
            if (isnan(height)) continue;
            ++*count;
            greatest = fmaxl(greatest, height);
        }
    return greatest;
}

static void set_facet(qm_overlay_facets *facets, const double triangle[3][3])
{
    memset(facets, 0, sizeof *facets);
    for (int i = 0; i < 9; i++)
        facets->group[0].at[i / 3][i % 3][0] = triangle[i / 3][i % 3];
    facets->count = 1;
    facets->size = 2.0;
    qm_kernel_get()->overlay_close(facets);
}

/** With nothing allowed the vertical distance is told, not the shorter one from a steep facet. */
static void the_gap_of_a_patch_is_that_of_its_points(void **state)
{
    (void)state;
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 1);
    static qm_overlay_facets facets;
    int over = 0, tight = 0;
    for (int i = 0; i < PAIRS; i++) {
        double patch[4][3], triangle[3][3], height = pow(10, qm_random_range(&random, -6, -2));
        draw_patch(&random, height, patch);
        for (int k = 0; k < 3; k++)
            draw_corner(&random, 1.0, height, triangle[k]);
        set_facet(&facets, triangle);
        int count;
        long double greatest = greatest_height(patch, triangle, &count);
        double gap = qm_overlay_patch_gap(&facets, patch, 0.0, NULL);
        QM_CHECK(count == 0 || gap >= (double)greatest * (1 - 1e-3),
                 "seed %llu, pair %d: gap %.17g, a point at %.17Lg", (unsigned long long)seed, i, gap,
                 greatest);
        qm_overlay_face face;
        memcpy(face.corner, triangle, sizeof triangle);
        if (!(qm_overlay_set_face(&face, 2.0) < 1e-9)) continue;
        /* The same the other way round: a patch over a face, with the patch's first facet in the set. */
        const double first[3][3] = {{patch[0][0], patch[0][1], patch[0][2]},
                                    {patch[1][0], patch[1][1], patch[1][2]},
                                    {patch[2][0], patch[2][1], patch[2][2]}};
        set_facet(&facets, first);
        facets.group[0].twist[0] = 1.0;
        for (int k = 0; k < 3; k++)
            facets.group[0].opposite[k][0] = patch[3][k];
        uint8_t far[QM_OVERLAY_GROUPS] = {1};
        bool is_near = qm_overlay_patches_are_near(&facets, &face, (double)greatest * (1 - 1e-9), far);
        assert_true(is_near == !far[0]);
        QM_CHECK(count == 0 || greatest == 0 || !is_near,
                 "seed %llu, pair %d: within %.17Lg, a point is there", (unsigned long long)seed, i,
                 greatest);
        if (count < STEPS) continue;
        over++;
        far[0] = 1;
        tight += qm_overlay_patches_are_near(&facets, &face, 1.15 * (double)greatest, far) &&
                 gap <= 1.15 * (double)greatest;
    }
    QM_CHECK(over > PAIRS / 4 && tight > over / 2, "seed %llu: %d of %d pairs are bounded well",
             (unsigned long long)seed, tight, over);
}

/** A facet that is steep, and a patch that nearly lies in its plane: where the gap is below the vertical one, each point that
 * is over the facet is as near as the gap says. */
static void gaps_from_steep_facets_are_distances(void **state)
{
    (void)state;
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 3);
    static qm_overlay_facets facets;
    int below = 0, nearly = 0;
    for (int i = 0; i < PAIRS; i++) {
        double patch[4][3], triangle[3][3], height = pow(10, qm_random_range(&random, -3, -0.5));
        double slope[2] = {qm_random_range(&random, -1, 1), qm_random_range(&random, -1, 1)};
        draw_patch(&random, height, patch);
        for (int k = 0; k < 4 && i % 4 > 0;
             k++) /* bent: most along a diagonal that an edge of the facet may be near */
            patch[k][2] = k % 2 ? height : 0.0;
        for (int k = 0; k < 3; k++)
            draw_corner(&random, 1.0, 0.0, triangle[k]);
        for (int k = 0; k < 7; k++) {
            double *at = k < 4 ? patch[k] : triangle[k - 4];
            at[2] += slope[0] * at[0] + slope[1] * at[1];
        }
        set_facet(&facets, triangle);
        double vertical = qm_overlay_patch_gap(&facets, patch, 0.0, NULL);
        double enough = vertical * qm_random_range(&random, 0.5, 1.0);
        double gap = qm_overlay_patch_gap(&facets, patch, enough, NULL), farthest = 0.0;
        if (!(gap < vertical && gap <= enough)) continue;
        below++;
        for (int j = 0; j <= STEPS; j++)
            for (int k = 0; k <= STEPS; k++) {
                long double p[3];
                patch_at(patch, (long double)j / STEPS, (long double)k / STEPS, p);
                if (isnan(height_over(triangle, p))) continue;
                double at[3] = {(double)p[0], (double)p[1], (double)p[2]};
                farthest =
                    fmax(farthest, qm_slow_triangle_distance(at, triangle[0], triangle[1], triangle[2]));
            }
        QM_CHECK(farthest <= gap, "seed %llu, pair %d: gap %.17g, a point %.17g away",
                 (unsigned long long)seed, i, gap, farthest);
        nearly += farthest > 0.98 * gap;
    }
    QM_CHECK(below > PAIRS / 100 && nearly > PAIRS / 1000,
             "seed %llu: %d gaps below the vertical ones, %d of them close", (unsigned long long)seed, below,
             nearly);
}

/** A patch with a reflex corner is also over points beside the two triangles of its corners: here over a hole. */
static void patches_with_a_reflex_corner_are_not_their_triangles(void **state)
{
    (void)state;
    static const double line[4] = {-0.5, 0.315, 0.335, 1.5};
    qm_mesh mesh = qm_shape_make(16, 16);
    size_t count = 0;
    for (int i = 0; i < 16; i++)
        memcpy(mesh.positions + 3 * i, (const double[3]){line[i % 4], line[i / 4], 0.0}, 3 * sizeof(double));
    for (uint32_t cell = 0; cell < 9; cell++) {
        uint32_t low = cell / 3 * 4 + cell % 3;
        if (cell == 4) continue;
        const uint32_t halves[2][4] = {{low, low + 1, low + 5, QM_NO_INDEX},
                                       {low, low + 5, low + 4, QM_NO_INDEX}};
        memcpy(mesh.faces + 4 * count, halves, sizeof halves);
        count += 2;
    }
    mesh.face_count = count;
    qm_context ctx = qm_context_make();
    qm_bvh *target;
    assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &target), QM_OK);
    for (int is_reflex = 0; is_reflex < 2; is_reflex++) {
        double tip = is_reflex ? 0.3 : 1.2;
        const double world[4][3] = {{0, 0, 5e-4}, {1, 0, 5e-4}, {tip, tip, 5e-4}, {0, 1, 5e-4}};
        const double beside[4][3] = {{0, 0, 5e-4}, {0.3, 0, 5e-4}, {0.31, 0.31, 5e-4}, {0, 0.3, 5e-4}};
        qm_search search;
        qm_side side;
        qm_target_search(&search, &side, target, 1e-3 * target->frame.scale);
        qm_worker worker = {.search = &search};
        for (int is_beside = 0; is_beside < 2; is_beside++) {
            qm_vec corner[4];
            for (int i = 0; i < 4; i++)
                corner[i] = qm_frame_local(&target->frame, is_beside ? beside[i] : world[i]);
            qm_near_packs near;
            qm_box box = qm_vec_box(corner, 4);
            search.kernel->gather(target, &box, search.floor, &near);
            assert_int_equal(qm_overlay_test_patch(&worker, &side, corner, &near), is_beside);
        }
    }
    qm_bvh_destroy(&ctx, target);
    qm_shape_free(&mesh);
}

/** A sheet with a face that lies elsewhere, torn at a vertex, or whole; in triangles. */
static qm_mesh draw_target(qm_random *random, int flaw)
{
    qm_mesh sheet =
        qm_shape_waves(COLUMNS, qm_random_range(random, 0.0, 0.1), qm_random_range(random, 0.0, 3.0));
    if (flaw == 1)
        memcpy(sheet.faces + 4 * qm_random_below(random, sheet.face_count),
               sheet.faces + 4 * qm_random_below(random, sheet.face_count), 4 * sizeof *sheet.faces);
    if (flaw == 2)
        qm_random_point(random, 0.0, 1.0, sheet.positions + 3 * qm_random_below(random, sheet.vertex_count));
    if (flaw == 3) qm_shape_shake(&sheet, random, qm_random_range(random, 0.0, 0.05));
    qm_mesh triangles = qm_shape_triangulated(&sheet);
    qm_shape_free(&sheet);
    return triangles;
}

/** A bent rectangle beside a target, smaller than its facets or over several of them. */
static void draw_rectangle(qm_random *random, const qm_bvh *target, qm_vec corner[4])
{
    static const double square[4][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
    double size = pow(2.0, qm_random_range(random, -2.0, 1.5)) / COLUMNS,
           away = pow(10.0, qm_random_range(random, -4.0, -1.0));
    qm_vec at[3];
    qm_bvh_load_triangle(target, (uint32_t)qm_random_below(random, target->pack_count), 0, at);
    for (int i = 0; i < 4; i++) {
        double shake = qm_random_below(random, 8) ? 0.3 : 1.5;
        corner[i] = (qm_vec){at[0].x + size * (square[i][0] + shake * qm_random_range(random, -1, 1)),
                             at[0].y + size * (square[i][1] + shake * qm_random_range(random, -1, 1)),
                             at[0].z + away * qm_random_range(random, -1, 1)};
    }
}

static void settled_rectangles_are_near(void **state)
{
    (void)state;
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 2);
    qm_context ctx = qm_context_make();
    int settled[4] = {0};
    for (int i = 0; i < TARGETS; i++) {
        int flaw = i % 4;
        qm_mesh mesh = draw_target(&random, flaw);
        qm_bvh *target;
        assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &target), QM_OK);
        for (int k = 0; k < TRIES; k++) {
            double cutoff = pow(10.0, qm_random_range(&random, -3.0, -0.7));
            qm_search search;
            qm_side side;
            qm_target_search(&search, &side, target, cutoff);
            qm_worker worker = {.search = &search};
            qm_vec corner[4];
            draw_rectangle(&random, target, corner);
            qm_near_packs near;
            qm_box box = qm_vec_box(corner, 4);
            search.kernel->gather(target, &box, cutoff, &near);
            if (!qm_overlay_test_patch(&worker, &side, corner, &near)) continue;
            settled[flaw]++;
            qm_bilinear patch = qm_bilinear_make(corner);
            for (int j = 0; j < SAMPLES; j++) {
                double s = j < 4 ? j % 2 : qm_random_range(&random, 0, 1),
                       t = j < 4 ? j / 2 : qm_random_range(&random, 0, 1);
                double distance = qm_target_distance(target, qm_bilinear_at(&patch, s, t));
                QM_CHECK(distance <= cutoff + 1e-14,
                         "seed %llu, flaw %d: settled at %.17g, but (%g, %g) is %.17g away",
                         (unsigned long long)seed, flaw, cutoff, s, t, distance);
            }
        }
        qm_bvh_destroy(&ctx, target);
        qm_shape_free(&mesh);
    }
    for (int flaw = 0; flaw < 4; flaw++)
        QM_CHECK(settled[flaw] > TARGETS / 8, "seed %llu: flaw %d: %d settled", (unsigned long long)seed,
                 flaw, settled[flaw]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_gap_of_a_patch_is_that_of_its_points),
        cmocka_unit_test(gaps_from_steep_facets_are_distances),
        cmocka_unit_test(patches_with_a_reflex_corner_are_not_their_triangles),
        cmocka_unit_test(settled_rectangles_are_near),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
