/* Bounds in single precision against distances computed in long double, for every kernel. */
#include "check.h"

#include "bvh/bvh_demand.h"
#include "bvh/bvh_tree.h"
#include "bvh/kernel.h"
#include "random.h"
#include "shapes.h"
#include "slow_twin.h"

#include <math.h>
#include <string.h>

enum { SOUPS = 60, FACES = 24, POINTS = 40 };

/** Triangles of all shapes, in places and sizes that differ widely: fat, slivers, needles, segments,
 * points. */
static qm_mesh draw_soup(qm_random *random, int kind)
{
    double spread = pow(10.0, qm_random_range(random, -6.0, 0.0));
    double *positions = malloc(FACES * 9 * sizeof *positions);
    uint32_t *faces = malloc(FACES * 4 * sizeof *faces);
    for (uint32_t f = 0; f < FACES; f++) {
        double at[3], along[3], across[3];
        for (int k = 0; k < 3; k++) {
            at[k] = spread * qm_random_range(random, -1.0, 1.0);
            along[k] = qm_random_range(random, -1.0, 1.0);
            across[k] = qm_random_range(random, -1.0, 1.0);
        }
        double length = pow(10.0, qm_random_range(random, -4.0, 0.0));
        double width = length * (kind == 0   ? 1.0
                                 : kind == 1 ? pow(10.0, qm_random_range(random, -12.0, 0.0))
                                             : 0.0);
        double apex = qm_random_range(random, 0.0, 1.0);
        if (kind == 3) length = 0.0;
        for (int k = 0; k < 3; k++) {
            double *corner = positions + 9 * (size_t)f + k;
            corner[0] = at[k];
            corner[3] = at[k] + length * along[k];
            corner[6] = at[k] + apex * length * along[k] + width * across[k];
        }
        const uint32_t face[4] = {3 * f, 3 * f + 1, 3 * f + 2, QM_NO_INDEX};
        memcpy(faces + 4 * (size_t)f, face, sizeof face);
    }
    return (qm_mesh){.vertex_count = 3 * FACES, .positions = positions, .face_count = FACES, .faces = faces};
}

/** On a face, near one, anywhere in the frame, and far outside. */
static qm_vec draw_point(qm_random *random, const qm_bvh *tree, int kind)
{
    qm_vec corner[4], p = {qm_random_range(random, -1.0, 1.0), qm_random_range(random, -1.0, 1.0),
                           qm_random_range(random, -1.0, 1.0)};
    if (kind == 2) return p;
    if (kind == 3) return qm_vec_scale(pow(10.0, qm_random_range(random, 0.0, 12.0)), p);
    qm_bvh_load_face(tree, (uint32_t)qm_random_below(random, FACES), corner);
    double u = qm_random_range(random, 0.0, 1.0), v = qm_random_range(random, 0.0, 1.0 - u);
    qm_vec on = qm_vec_axpy(corner[0], u, qm_vec_sub(corner[1], corner[0]));
    on = qm_vec_axpy(on, v, qm_vec_sub(corner[2], corner[0]));
    return kind == 0 ? on : qm_vec_axpy(on, pow(10.0, qm_random_range(random, -9.0, 0.0)), p);
}

/** Distance to a lane's triangle as it lies in the local frame. */
static double lane_distance(const qm_bvh *tree, uint32_t pack, int lane, qm_vec p)
{
    qm_vec corner[4];
    double at[3][3];
    const double point[3] = {p.x, p.y, p.z};
    qm_bvh_load_face(tree, tree->lanes[pack].face[lane], corner);
    for (int i = 0; i < 3; i++)
        qm_vec_store(at[i], corner[i]);
    return qm_slow_triangle_distance(point, at[0], at[1], at[2]);
}

typedef struct trial {
    const qm_kernel *kernel;
    const qm_bvh *tree;
    qm_vec p;
    unsigned long long seed;
} trial;

/** The bound of a pack holds, and is no farther from the truth than the margin says. */
static double check_pack(const trial *t, uint32_t pack)
{
    const qm_float_pack *rows = qm_bvh_float_pack(t->tree, pack);
    double least = INFINITY, distance[QM_PACK_LANES];
    for (int lane = 0; lane < QM_PACK_LANES; lane++)
        least = fmin(least, distance[lane] = lane_distance(t->tree, pack, lane, t->p));
    double reach = (double)rows->radius;
    const double p[3] = {t->p.x, t->p.y, t->p.z};
    for (int k = 0; k < 3; k++)
        reach += fabs(p[k] - (double)rows->middle[k]);
    double upper = t->kernel->float_upper(rows, NULL, t->p);
    QM_CHECK(upper >= least, "seed %llu, %s: %.17g below the distance %.17g", t->seed, t->kernel->name, upper,
             least);
    QM_CHECK(upper <= least + 2.1 * 64.0 * 0x1p-24 * reach + 0x1p-58,
             "seed %llu, %s: %.17g for %.17g, reach %g", t->seed, t->kernel->name, upper, least, reach);
    for (int lane = 0; lane < QM_PACK_LANES; lane++) {
        qm_float_bits bits;
        t->kernel->float_reach(rows, NULL, distance[lane] * (1.0 - 1e-12), &t->p, 1, &bits);
        for (int other = 0; other < QM_PACK_LANES; other++)
            QM_CHECK(!(qm_float_certain(bits) >> other & 1) || distance[other] < distance[lane],
                     "seed %llu, %s: lane %d is not within %.17g", t->seed, t->kernel->name, other,
                     distance[lane]);
        t->kernel->float_reach(rows, NULL, distance[lane] * (1.0 + 1e-12), &t->p, 1, &bits);
        for (int other = 0; other < QM_PACK_LANES; other++)
            QM_CHECK((bits >> (8 + other) & 1) || distance[other] > distance[lane],
                     "seed %llu, %s: lane %d is within %.17g", t->seed, t->kernel->name, other,
                     distance[lane]);
    }
    return least;
}

static void check_tree(const trial *t)
{
    double nearest = INFINITY;
    for (uint32_t pack = 0; pack < t->tree->pack_count; pack++)
        nearest = fmin(nearest, check_pack(t, pack));
    qm_float_hit hit = {.pack = 0};
    t->kernel->float_closest(t->tree, t->p, 0.0, &hit);
    double margin = 4.0 * 64.0 * 0x1p-24 * (2.0 + qm_vec_norm(t->p));
    QM_CHECK(hit.upper >= nearest, "seed %llu, %s: %.17g is nearer than the nearest", t->seed,
             t->kernel->name, hit.upper);
    QM_CHECK(hit.upper <= 1.2 * nearest + margin, "seed %llu, %s: %.17g, the nearest is at %.17g", t->seed,
             t->kernel->name, hit.upper, nearest);
    QM_CHECK(hit.upper >= lane_distance(t->tree, hit.pack, (int)hit.lane, t->p), "seed %llu: not of lane %u",
             t->seed, hit.lane);
    qm_float_hit enough = {.pack = 0};
    t->kernel->float_closest(t->tree, t->p, 2.0 * nearest + margin, &enough);
    QM_CHECK(enough.upper <= 2.0 * nearest + margin, "seed %llu: ended before it was enough", t->seed);
}

static void bounds_hold_and_are_tight(void **state)
{
    (void)state;
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 0);
    qm_context ctx = qm_context_make();
    for (int soup = 0; soup < SOUPS; soup++) {
        qm_mesh mesh = draw_soup(&random, soup % 4);
        qm_bvh *tree;
        assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &tree), QM_OK);
        for (int i = 0; i < POINTS; i++) {
            qm_vec p = draw_point(&random, tree, i % 4);
            for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++)
                check_tree(&(trial){*kernel, tree, p, (unsigned long long)seed});
        }
        qm_bvh_destroy(&ctx, tree);
        qm_shape_free(&mesh);
    }
}

/** Of several points those that are wanted are compared, each in its place, and no other place is written. */
static void wanted_points_are_compared(void **state)
{
    (void)state;
    enum { MOST_POINTS = 3 * QM_PACK_LANES, UNTOUCHED = 0x1234 };
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 2);
    qm_context ctx = qm_context_make();
    qm_mesh quads = qm_shape_torus(20, 12, 0.7, 0.25), mesh = qm_shape_triangulated(&quads);
    qm_shape_free(&quads);
    qm_bvh *tree;
    assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &tree), QM_OK);
    for (int i = 0; i < 200; i++) {
        uint32_t pack = (uint32_t)qm_random_below(&random, (uint32_t)tree->pack_count);
        double allowed = qm_random_range(&random, 0.0, 1.0);
        unsigned wanted = (unsigned)qm_random_below(&random, 1u << MOST_POINTS);
        qm_vec p[MOST_POINTS];
        for (int k = 0; k < MOST_POINTS; k++)
            p[k] = (qm_vec){qm_random_range(&random, -1.0, 1.0), qm_random_range(&random, -1.0, 1.0),
                            qm_random_range(&random, -0.5, 0.5)};
        for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++) {
            qm_float_bits bits[MOST_POINTS];
            for (int k = 0; k < MOST_POINTS; k++)
                bits[k] = UNTOUCHED;
            (*kernel)->float_reach(qm_bvh_float_pack(tree, pack), NULL, allowed, p, wanted, bits);
            for (int k = 0; k < MOST_POINTS; k++) {
                if (!(wanted >> k & 1)) {
                    assert_int_equal(bits[k], UNTOUCHED);
                    continue;
                }
                for (int lane = 0; lane < QM_PACK_LANES; lane++) {
                    double distance = lane_distance(tree, pack, lane, p[k]);
                    QM_CHECK(distance <= allowed || !(qm_float_certain(bits[k]) >> lane & 1),
                             "seed %llu, %s: %.17g is not within %.17g", (unsigned long long)seed,
                             (*kernel)->name, distance, allowed);
                    QM_CHECK(distance > allowed || (bits[k] >> (8 + lane) & 1),
                             "seed %llu, %s: %.17g is within %.17g", (unsigned long long)seed,
                             (*kernel)->name, distance, allowed);
                }
            }
        }
    }
    qm_bvh_destroy(&ctx, tree);
    qm_shape_free(&mesh);
}

/** Twists are added to every lane's bound. */
static void twists_count(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh mesh = qm_shape_torus(8, 6, 0.8, 0.2);
    qm_bvh *tree;
    assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &tree), QM_OK);
    float twist[QM_PACK_LANES];
    for (int lane = 0; lane < QM_PACK_LANES; lane++)
        twist[lane] = 0.25f;
    const qm_vec p = {0.9, 0.1, 0.2};
    for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++) {
        double without = (*kernel)->float_upper(qm_bvh_float_pack(tree, 0), NULL, p);
        double with = (*kernel)->float_upper(qm_bvh_float_pack(tree, 0), twist, p);
        QM_CHECK(fabs(with - without - 0.25) < 1e-6, "%s: %g and %g", (*kernel)->name, with, without);
        qm_float_bits bits;
        (*kernel)->float_reach(qm_bvh_float_pack(tree, 0), twist, without + 0.2, &p, 1, &bits);
        assert_int_equal(qm_float_certain(bits), 0);
    }
    qm_bvh_destroy(&ctx, tree);
    qm_shape_free(&mesh);
}

/** Where floats overflow there is no bound, and never a false one. */
static void far_points_have_no_bound(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh mesh = qm_shape_torus(8, 6, 0.8, 0.2);
    qm_bvh *tree;
    assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &tree), QM_OK);
    const qm_vec far[] = {{1e19, 0, 0}, {0, 1e30, 1e30}, {1e38, 1e38, 1e38}, {1e80, -1e80, 0}, {0, 0, 1e200}};
    for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++) {
        for (size_t i = 0; i < sizeof far / sizeof *far; i++) {
            double distance = qm_vec_norm(far[i]) - 1.0;
            assert_true((*kernel)->float_upper(qm_bvh_float_pack(tree, 0), NULL, far[i]) >= distance);
            qm_float_hit hit = {.pack = 1};
            (*kernel)->float_closest(tree, far[i], 0.0, &hit);
            assert_true(hit.upper >= distance && hit.pack < tree->pack_count && hit.lane < QM_PACK_LANES);
            qm_float_bits bits;
            (*kernel)->float_reach(qm_bvh_float_pack(tree, 0), NULL, 0.5 * distance, &far[i], 1, &bits);
            assert_int_equal(qm_float_certain(bits), 0);
        }
    }
    qm_bvh_destroy(&ctx, tree);
    qm_shape_free(&mesh);
}

/** Wherever a search starts, it climbs over the whole tree. */
static void searches_climb_from_any_start(void **state)
{
    (void)state;
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 1);
    qm_context ctx = qm_context_make();
    qm_mesh mesh = qm_shape_torus(90, 50, 0.7, 0.25);
    qm_bvh *tree;
    assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &tree), QM_OK);
    assert_true(tree->boxes.level_count > 2);
    for (int i = 0; i < 400; i++) {
        qm_vec p = {qm_random_range(&random, -1.2, 1.2), qm_random_range(&random, -1.2, 1.2),
                    qm_random_range(&random, -0.5, 0.5)};
        uint32_t start = (uint32_t)qm_random_below(&random, (uint32_t)tree->pack_count);
        qm_hit nearest = {.d2 = INFINITY, .pack = 0};
        qm_kernel_get()->closest(tree, p, &nearest);
        double distance = sqrt(nearest.d2), margin = 4.0 * 64.0 * 0x1p-24 * (2.0 + qm_vec_norm(p));
        for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++) {
            qm_float_hit hit = {.pack = start};
            (*kernel)->float_closest(tree, p, 0.0, &hit);
            QM_CHECK(hit.upper >= distance && hit.upper <= 1.2 * distance + margin,
                     "seed %llu, %s: %.17g for %.17g from pack %u", (unsigned long long)seed, (*kernel)->name,
                     hit.upper, distance, start);
            double enough = 3.0 * distance + margin;
            hit = (qm_float_hit){.pack = start};
            (*kernel)->float_closest(tree, p, enough, &hit);
            QM_CHECK(hit.upper >= distance && hit.upper <= enough,
                     "seed %llu, %s: %.17g is not enough for %.17g", (unsigned long long)seed,
                     (*kernel)->name, hit.upper, enough);
        }
    }
    qm_bvh_destroy(&ctx, tree);
    qm_shape_free(&mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bounds_hold_and_are_tight),
        cmocka_unit_test(wanted_points_are_compared),
        cmocka_unit_test(twists_count),
        cmocka_unit_test(far_points_have_no_bound),
        cmocka_unit_test(searches_climb_from_any_start),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
