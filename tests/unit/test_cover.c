/* Covers of triangles by what lies within reach of facets, in both precisions and by every kernel: whatever a
 * cover takes away must be within reach. */
#include "check.h"

#include "bvh/bvh_demand.h"
#include "bvh/kernel.h"
#include "random.h"
#include "shapes.h"
#include "slow_twin.h"

#include <math.h>
#include <string.h>

enum { SOUPS = 150, PIECES = 12, SAMPLES = 60, FACES = 24 };

typedef struct trial {
    const qm_kernel *kernel;
    const qm_bvh *tree;
    qm_shortlist list;
    double cutoff;
    float twist[QM_PACK_LANES];
    qm_vec corner[3];
    unsigned long long seed;
} trial;

/** Distance from p to a lane of the list, less what its twist takes from the cutoff. */
static bool within_reach(const trial *t, qm_vec p)
{
    for (int i = 0; i < QM_PACK_LANES; i++) {
        qm_vec corner[4];
        double at[3][3];
        const double point[3] = {p.x, p.y, p.z};
        qm_bvh_load_face(t->tree, t->tree->lanes[t->list.pack[i]].face[t->list.lane[i]], corner);
        for (int k = 0; k < 3; k++)
            qm_vec_store(at[k], corner[k]);
        double distance = qm_slow_triangle_distance(point, at[0], at[1], at[2]);
        if (distance <= t->cutoff - (double)t->twist[i] + 1e-14) return true;
    }
    return false;
}

/** Whether p, in the plane of a convex polygon, lies in it or within a rounding of it. */
static bool lies_in(const qm_polygon *polygon, qm_vec p)
{
    qm_vec normal = {0, 0, 0};
    for (int i = 1; i + 1 < polygon->count; i++)
        normal = qm_vec_axpy(normal, 1.0,
                             qm_vec_cross(qm_vec_sub(polygon->corner[i], polygon->corner[0]),
                                          qm_vec_sub(polygon->corner[i + 1], polygon->corner[0])));
    double size = qm_vec_norm(normal);
    for (int i = 0; i < polygon->count; i++) {
        qm_vec from = polygon->corner[i], along = qm_vec_sub(polygon->corner[(i + 1) % polygon->count], from);
        if (qm_vec_dot(normal, qm_vec_cross(along, qm_vec_sub(p, from))) < -1e-12 * (size + 1e-12))
            return false;
    }
    return true;
}

static void check_rest(const trial *t, bool is_covered, const qm_polygon *rest, const char *how,
                       qm_random *random)
{
    for (int i = 0; i < SAMPLES; i++) {
        double u = qm_random_range(random, 0.0, 1.0), v = qm_random_range(random, 0.0, 1.0);
        if (u + v > 1.0) {
            u = 1.0 - u;
            v = 1.0 - v;
        }
        qm_vec p = qm_vec_axpy(t->corner[0], u, qm_vec_sub(t->corner[1], t->corner[0]));
        p = qm_vec_axpy(p, v, qm_vec_sub(t->corner[2], t->corner[0]));
        if (!is_covered && lies_in(rest, p)) continue;
        QM_CHECK(within_reach(t, p), "seed %llu, %s, %s: a point at %g, %g of the piece is beyond %.17g",
                 t->seed, t->kernel->name, how, u, v, t->cutoff);
    }
}

/** Returns whether anything was taken away. */
static bool cover_in_doubles(const trial *t, qm_random *random)
{
    qm_pack rows;
    t->kernel->shortlist_pack(t->tree, &t->list, &rows);
    qm_candidates candidates = {.count = 1, .pack = {&rows}};
    for (int i = 0; i < QM_PACK_LANES; i++) {
        double rest = t->cutoff - (double)t->twist[i];
        candidates.cutoff2[0][i] = rest >= 0.0 ? rest * rest : -1.0;
    }
    qm_polygon polygon = {.count = 3, .cuts_left = 48, .corner = {t->corner[0], t->corner[1], t->corner[2]}};
    for (int i = 0; i < 3; i++)
        polygon.in_reach[i] = t->kernel->in_reach(&candidates, polygon.corner[i]);
    bool moved = false, is_covered = t->kernel->cover(&candidates, &polygon, &moved);
    check_rest(t, is_covered, &polygon, "double", random);
    return is_covered || moved;
}

static bool cover_in_floats(const trial *t, qm_random *random)
{
    qm_float_pack rows;
    t->kernel->shortlist_float_pack(t->tree, &t->list, &rows);
    qm_polygon polygon = {.count = 3, .cuts_left = 48, .corner = {t->corner[0], t->corner[1], t->corner[2]}};
    bool moved = false;
    qm_float_verdict verdict = t->kernel->float_cover(&rows, t->twist, t->cutoff, &polygon, &moved);
    check_rest(t, verdict == QM_FLOAT_COVERED, &polygon, "float", random);
    return verdict == QM_FLOAT_COVERED || moved;
}

/** A piece about as large as the facets, beside one of them. */
static void draw_piece(qm_random *random, trial *t)
{
    qm_vec corner[4];
    qm_bvh_load_face(t->tree, (uint32_t)qm_random_below(random, FACES), corner);
    double size = pow(10.0, qm_random_range(random, -3.0, 0.0));
    for (int i = 0; i < 3; i++) {
        const qm_vec step = {qm_random_range(random, -1.0, 1.0), qm_random_range(random, -1.0, 1.0),
                             qm_random_range(random, -1.0, 1.0)};
        t->corner[i] = qm_vec_axpy(corner[i], size, step);
    }
    t->cutoff = size * pow(10.0, qm_random_range(random, -1.0, 0.7));
    for (int i = 0; i < QM_PACK_LANES; i++)
        t->twist[i] = (float)(t->cutoff * fmax(0.0, qm_random_range(random, -1.0, 1.2)));
}

static void covers_take_only_what_is_in_reach(void **state)
{
    (void)state;
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 0);
    qm_context ctx = qm_context_make();
    long taken[2] = {0, 0};
    for (int soup = 0; soup < SOUPS; soup++) {
        qm_mesh mesh = qm_shape_soup(&random, FACES, QM_SOUP_TRIANGLES,
                                     (qm_soup_style)(soup % QM_SOUP_STYLE_COUNT), 0.0);
        qm_bvh *tree;
        assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &tree), QM_OK);
        for (int piece = 0; piece < PIECES; piece++) {
            trial t = {.tree = tree, .seed = (unsigned long long)seed};
            draw_piece(&random, &t);
            qm_near_packs near;
            const qm_box everywhere = {{-2, -2, -2}, {2, 2, 2}};
            for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++) {
                t.kernel = *kernel;
                t.kernel->gather(tree, &everywhere, 4.0, &near);
                t.kernel->shortlist(tree, &near, qm_vec_mix(t.corner[0], t.corner[1], 0.5), &t.list);
                taken[0] += cover_in_doubles(&t, &random);
                taken[1] += cover_in_floats(&t, &random);
            }
        }
        qm_bvh_destroy(&ctx, tree);
        qm_shape_free(&mesh);
    }
    QM_CHECK(taken[0] > SOUPS && taken[1] > SOUPS, "seed %llu: hardly anything was covered: %ld, %ld",
             (unsigned long long)seed, taken[0], taken[1]);
}

/** Where the cutoff is lost in the roundings of single precision, it says so. */
static void tiny_distances_are_too_coarse(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh mesh = qm_shape_torus(8, 6, 0.8, 0.2);
    qm_bvh *tree;
    assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &tree), QM_OK);
    qm_vec corner[4];
    qm_bvh_load_face(tree, tree->lanes[0].face[0], corner);
    for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++) {
        qm_shortlist list = {.pack = {0}, .lane = {0, 1, 2, 3, 4, 5, 6, 7}};
        qm_float_pack rows;
        (*kernel)->shortlist_float_pack(tree, &list, &rows);
        qm_polygon polygon = {.count = 3, .cuts_left = 48, .corner = {corner[0], corner[1], corner[2]}};
        bool moved = false;
        assert_int_equal((*kernel)->float_cover(&rows, NULL, 1e-9, &polygon, &moved), QM_FLOAT_TOO_COARSE);
        assert_int_equal((*kernel)->float_cover(&rows, NULL, 1e3, &polygon, &moved), QM_FLOAT_COVERED);
        assert_int_equal((*kernel)->float_cover(&rows, NULL, 1e-3, &polygon, &moved), QM_FLOAT_COVERED);
        assert_false(moved);
    }
    qm_bvh_destroy(&ctx, tree);
    qm_shape_free(&mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(covers_take_only_what_is_in_reach),
        cmocka_unit_test(tiny_distances_are_too_coarse),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
