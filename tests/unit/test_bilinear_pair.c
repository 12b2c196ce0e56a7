/* Distance and contact of bilinear patches against the slow twin's distance from many of their points. */
#include "check.h"
#include "prim/bilinear_pair.h"
#include "qm/collide.h"
#include "random.h"
#include "shapes.h"
#include "slow_twin.h"

static qm_vec random_vec(qm_random *random, double reach)
{
    double p[3];
    qm_random_point(random, -reach, reach, p);
    return qm_vec_load(p);
}

/** A parallelogram whose third corner is moved by up to twist; a triangle now and then. */
static qm_face_shape random_face(qm_random *random, double twist)
{
    qm_face_shape face = {.count = qm_random_below(random, 5) == 0 ? 3 : 4};
    qm_vec origin = random_vec(random, 0.7), u = random_vec(random, 0.5), v = random_vec(random, 0.5);
    face.corner[0] = origin;
    face.corner[1] = qm_vec_add(origin, u);
    face.corner[3] = qm_vec_add(origin, v);
    face.corner[2] = qm_vec_add(qm_vec_add(face.corner[1], v), random_vec(random, twist));
    return face;
}

static qm_vec point_of(const qm_face_shape *face, double u, double v)
{
    const qm_vec *c = face->corner;
    if (face->count == 3) return qm_vec_axpy(qm_vec_axpy(qm_vec_scale(1 - u - v, c[0]), u, c[1]), v, c[2]);
    return qm_vec_mix(qm_vec_mix(c[0], c[1], u), qm_vec_mix(c[3], c[2], u), v);
}

static qm_slow_bracket slow_distance(const qm_face_shape *face, qm_vec point)
{
    double p[3], c[4][3];
    qm_vec_store(p, point);
    for (int i = 0; i < face->count; i++)
        qm_vec_store(c[i], face->corner[i]);
    if (face->count == 4) return qm_slow_patch_distance(p, (const double(*)[3])c, 1e-9);
    double d = qm_slow_triangle_distance(p, c[0], c[1], c[2]);
    return (qm_slow_bracket){d, d, true};
}

/** The least slow distance from points of a to b, which is never below the true one; *step is how far any
 * point of a is from one of them. */
static double sample_distance(const qm_face_shape *a, const qm_face_shape *b, double *step)
{
    enum { STEPS = 12 };
    double least = INFINITY, longest = 0.0;
    for (int i = 0; i < a->count; i++)
        for (int k = 0; k < i; k++)
            longest = fmax(longest, qm_vec_distance(a->corner[i], a->corner[k]));
    for (int i = 0; i <= STEPS; i++)
        for (int k = 0; k <= (a->count == 3 ? STEPS - i : STEPS); k++)
            least = fmin(least, slow_distance(b, point_of(a, (double)i / STEPS, (double)k / STEPS)).upper);
    *step = longest / STEPS;
    return least;
}

static void bounds_hold(void **state)
{
    (void)state;
    for (unsigned run = 0; run < 400; run++) {
        qm_random random = qm_random_make(qm_check_seed(), run);
        double twist = run % 4 == 0 ? 0.0 : run % 4 == 1 ? 0.05 : 0.5, step;
        qm_face_shape a = random_face(&random, twist), b = random_face(&random, twist);
        double error = run % 2 ? 1e-4 : 1e-9;
        qm_bilinear_gap gap = qm_bilinear_pair_distance(&a, &b, error, INFINITY);
        double sampled = sample_distance(&a, &b, &step);
        QM_CHECK(gap.upper - gap.lower <= error, "run %u: %g to %g", run, gap.lower, gap.upper);
        QM_CHECK(gap.lower <= sampled && gap.upper >= sampled - step - 1e-9, "run %u: %g to %g, sampled %g",
                 run, gap.lower, gap.upper, sampled);
        qm_vec p = point_of(&a, gap.uv[0][0], gap.uv[0][1]), q = point_of(&b, gap.uv[1][0], gap.uv[1][1]);
        QM_CHECK(fabs(qm_vec_distance(p, q) - gap.upper) < 1e-12, "run %u: not attained", run);
        qm_bilinear_gap early = qm_bilinear_pair_distance(&a, &b, error, 0.5 * gap.upper);
        QM_CHECK(early.lower >= fmin(gap.lower, 0.5 * gap.upper) - error && early.lower <= gap.upper,
                 "run %u: %g", run, early.lower);
        qm_bilinear_gap turned = qm_bilinear_pair_distance(&b, &a, error, INFINITY);
        QM_CHECK(turned.lower <= gap.upper && gap.lower <= turned.upper, "run %u", run);
    }
}

/** Patches moved so that a point of one lies at a known place of the other, or off both at a distance. */
static void contact_is_certain(void **state)
{
    (void)state;
    for (unsigned run = 0; run < 400; run++) {
        qm_random random = qm_random_make(qm_check_seed(), 1000 + run);
        qm_face_shape a = random_face(&random, 0.4), b = random_face(&random, 0.4);
        double u = qm_random_range(&random, 0, 0.5), v = qm_random_range(&random, 0, 0.5);
        qm_vec shift = qm_vec_sub(point_of(&a, u, v), point_of(&b, v, u));
        for (int i = 0; i < 4; i++)
            b.corner[i] = qm_vec_add(b.corner[i], shift);
        qm_bilinear_gap gap;
        QM_CHECK(qm_bilinear_pair_meet(&a, &b, 1e-7, &gap), "run %u: contact is missed", run);
        QM_CHECK(gap.upper <= 1e-7, "run %u: found at %g", run, gap.upper);
        qm_vec aside = random_vec(&random, 1.0);
        for (int i = 0; i < 4; i++)
            b.corner[i] = qm_vec_add(b.corner[i], aside);
        qm_bilinear_gap apart = qm_bilinear_pair_distance(&a, &b, 1e-9, INFINITY);
        if (apart.lower > 1e-7)
            QM_CHECK(!qm_bilinear_pair_meet(&a, &b, 1e-7, &gap), "run %u: not apart", run);
        if (apart.upper <= 1e-9) QM_CHECK(qm_bilinear_pair_meet(&a, &b, 1e-7, &gap), "run %u: missed", run);
    }
}

static qm_collision collide_self(const qm_mesh *mesh, double tolerance)
{
    qm_context ctx = qm_context_make();
    qm_collide_options options = qm_collide_options_default();
    options.quads = QM_QUADS_BILINEAR;
    options.tolerance = tolerance;
    qm_bvh *bvh;
    qm_collision found;
    assert_int_equal(qm_bvh_build(&ctx, mesh, QM_BVH_SOURCE, 1, &bvh), QM_OK);
    assert_int_equal(qm_collide_self(&ctx, bvh, &options, NULL, &found), QM_OK);
    qm_bvh_destroy(&ctx, bvh);
    return found;
}

static void check_pairs(qm_mesh mesh, size_t expected, const char *name)
{
    qm_context ctx = qm_context_make();
    qm_collision found = collide_self(&mesh, 1e-7);
    QM_CHECK(found.pair_count == expected, "%s: %zu pairs, not %zu", name, found.pair_count, expected);
    qm_collide_reset(&ctx, &found);
    qm_shape_free(&mesh);
}

/** Neighbours of a surface that doesn't cross itself share edges and corners and nothing else. */
static void smooth_surfaces_are_clear(void **state)
{
    (void)state;
    check_pairs(qm_shape_saddle(12), 0, "saddle");
    check_pairs(qm_shape_torus(24, 12, 2.0, 0.7), 0, "torus");
    check_pairs(qm_shape_strip(30, 6, 3.0), 0, "strip");
    check_pairs(qm_shape_plane(9, 0.0), 0, "plane");
    check_pairs(qm_shape_box(1, 2, 3), 0, "box");
    qm_random random = qm_random_make(qm_check_seed(), 3);
    qm_mesh shaken = qm_shape_torus(24, 12, 2.0, 0.7);
    qm_shape_shake(&shaken, &random, 0.02);
    check_pairs(shaken, 0, "shaken torus");
}

/** Two quads over one edge: the second is turned about it, down onto the first, and through it. */
static void folds_are_found(void **state)
{
    (void)state;
    for (int step = 0; step <= 16; step++) {
        double angle = 3.141592653589793 * step / 16.0;
        qm_mesh mesh = qm_shape_make(6, 2);
        const double corner[6][3] = {{0, 0, 0},
                                     {0, 1, 0},
                                     {1, 1, 0.1},
                                     {1, 0, 0},
                                     {cos(angle), 0, sin(angle)},
                                     {cos(angle), 1, sin(angle)}};
        const uint32_t face[8] = {0, 1, 2, 3, 0, 4, 5, 1};
        for (int i = 0; i < 18; i++)
            mesh.positions[i] = corner[i / 3][i % 3];
        for (int i = 0; i < 8; i++)
            mesh.faces[i] = face[i];
        /* At angle 0 the flat quad lies beneath the twisted one and meets it along a side too. */
        check_pairs(mesh, step == 0 ? 1 : 0, "turned about an edge");
    }
    qm_mesh through = qm_shape_make(7, 2);
    const double corner[7][3] = {{0, 0, 0},    {1, 0, 0.2},   {1, 1, 0},    {0, 1, 0.3},
                                 {1, 0.4, -1}, {1.2, 0.5, 1}, {0.5, 0.6, 1}};
    const uint32_t face[8] = {0, 1, 2, 3, 0, 4, 5, 6};
    for (int i = 0; i < 21; i++)
        through.positions[i] = corner[i / 3][i % 3];
    for (int i = 0; i < 8; i++)
        through.faces[i] = face[i];
    check_pairs(through, 1, "through a neighbour at a corner");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bounds_hold),
        cmocka_unit_test(contact_is_certain),
        cmocka_unit_test(smooth_surfaces_are_clear),
        cmocka_unit_test(folds_are_found),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
