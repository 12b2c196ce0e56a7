/* Picking, and the surface of a point set: projection, normals, the disc radius. */
#include "check.h"

#include "core/vec.h"
#include "failing_allocator.h"
#include "ground.h"
#include "layouts.h"
#include "qm/pick.h"

#include <math.h>
#include <string.h>

static void sphere_at(const void *user, double u, double v, double out[3])
{
    (void)user;
    double z = 2.0 * v - 1.0, radius = sqrt(1.0 - z * z), angle = 6.283185307179586 * u;
    out[0] = radius * cos(angle);
    out[1] = radius * sin(angle);
    out[2] = z;
}

/** An eye at (0, 0, 5) that looks down on the origin, with a field of view of 53 degrees, 800 x 600
 * pixels. */
static qm_camera camera_above(void)
{
    const double near = 1.0, far = 10.0, height = 0.5;
    qm_camera camera = {.view = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, -5, 1},
                        .viewport = {0, 0, 800, 600}};
    double *p = camera.projection;
    p[0] = near / (height * 800.0 / 600.0);
    p[5] = near / height;
    p[10] = -(far + near) / (far - near);
    p[11] = -1.0;
    p[14] = -2.0 * far * near / (far - near);
    return camera;
}

static qm_pick_view view_of(qm_ground *g, const qm_camera *camera)
{
    qm_pick_view view;
    const qm_pick_options options = {0};
    qm_status status = qm_pick_view_init(&g->ctx, &g->source, camera, &options, &view);
    QM_CHECK(status == QM_OK, "%s", g->ctx.message);
    return view;
}

/** Where a point of space appears. */
static void window_of(const qm_camera *camera, qm_vec p, double window[2])
{
    double depth = 5.0 - p.z;
    window[0] = 400.0 * (1.0 + camera->projection[0] * p.x / depth);
    window[1] = 300.0 * (1.0 - camera->projection[5] * p.y / depth);
}

/** Picks at where points of the upper half of the unit sphere appear, and finds them again. */
static void check_sphere(qm_mesh mesh, double tolerance)
{
    qm_ground g;
    qm_ground_make(&g, mesh);
    qm_camera camera = camera_above();
    qm_pick_view view = view_of(&g, &camera);
    qm_random random = qm_random_make(qm_check_seed(), 7);
    for (int i = 0; i < 200; i++) {
        double p[3], window[2], at[3];
        sphere_at(NULL, qm_random_range(&random, 0, 1), qm_random_range(&random, 0.8, 0.99), p);
        window_of(&camera, qm_vec_load(p), window);
        bool found;
        assert_int_equal(qm_pick_point(&g.ctx, &view, window, at, &found), QM_OK);
        assert_true(found);
        double off = qm_vec_distance(qm_vec_load(at), qm_vec_load(p));
        QM_CHECK(off < tolerance, "point %d: off by %g", i, off);
    }
    const double beside[2] = {5, 5}, nowhere[2] = {NAN, 0};
    double at[3];
    bool found = true;
    assert_int_equal(qm_pick_point(&g.ctx, &view, beside, at, &found), QM_OK);
    assert_false(found);
    assert_int_equal(qm_pick_point(&g.ctx, &view, nowhere, at, &found), QM_OK);
    assert_false(found);
    qm_ground_free(&g);
}

static void picks_find_the_visible_side(void **state)
{
    (void)state;
    check_sphere(qm_shape_sphere(0.0), 1.2e-2);
    check_sphere(qm_ground_sample(sphere_at, 40000, 0.0, 1), 4e-2);
}

static void a_ray_meets_the_same_triangle_as_all_of_them_tried(void **state)
{
    (void)state;
    for (uint64_t seed = 1; seed <= 20; seed++) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        qm_ground g;
        qm_ground_make(&g, qm_shape_soup(&random, 200, QM_SOUP_MIXED, QM_SOUP_APART, 0.0));
        qm_camera camera = camera_above();
        qm_pick_view view = view_of(&g, &camera);
        for (int i = 0; i < 40; i++) {
            const double window[2] = {qm_random_range(&random, 200, 600), qm_random_range(&random, 100, 500)};
            /* The eye is at (0, 0, 5), and the near plane at a distance of 1. */
            qm_vec eye = {0, 0, 5}, ray = {(window[0] / 400.0 - 1.0) / camera.projection[0],
                                           (1.0 - window[1] / 300.0) / camera.projection[5], -1.0};
            double first = INFINITY;
            for (size_t f = 0; f < g.mesh.face_count; f++) {
                const uint32_t *index = g.mesh.faces + 4 * f;
                for (int half = 0; half < (index[3] == QM_NO_INDEX ? 1 : 2); half++) {
                    qm_vec a = qm_vec_load(g.mesh.positions + 3 * (size_t)index[0]);
                    qm_vec b = qm_vec_load(g.mesh.positions + 3 * (size_t)index[1 + half]);
                    qm_vec c = qm_vec_load(g.mesh.positions + 3 * (size_t)index[2 + half]);
                    qm_vec n = qm_vec_cross(qm_vec_sub(b, a), qm_vec_sub(c, a));
                    double t = qm_vec_dot(n, qm_vec_sub(a, eye)) / qm_vec_dot(n, ray);
                    qm_vec p = qm_vec_axpy(eye, t, ray);
                    bool inside = qm_vec_dot(n, qm_vec_cross(qm_vec_sub(b, a), qm_vec_sub(p, a))) >= 0.0 &&
                                  qm_vec_dot(n, qm_vec_cross(qm_vec_sub(c, b), qm_vec_sub(p, b))) >= 0.0 &&
                                  qm_vec_dot(n, qm_vec_cross(qm_vec_sub(a, c), qm_vec_sub(p, c))) >= 0.0;
                    if (inside && t >= 1.0 && t < first) first = t;
                }
            }
            double at[3];
            bool found;
            assert_int_equal(qm_pick_point(&g.ctx, &view, window, at, &found), QM_OK);
            QM_CHECK(found == (first < INFINITY) && (!found || fabs(5.0 - at[2] - first) < 1e-9),
                     "seed %llu, ray %d: at depth %g, tried %g", (unsigned long long)seed, i, 5.0 - at[2],
                     first);
        }
        qm_ground_free(&g);
    }
}

static void the_same_stroke_gives_the_same_bits(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_ground_sample(sphere_at, 20000, 0.0, 2));
    qm_camera camera = camera_above();
    double window[40], first[60], again[60];
    for (int i = 0; i < 20; i++) {
        window[2 * i] = 100.0 + 30.0 * i; /* starts and ends beside the sphere */
        window[2 * i + 1] = 280.0 + 2.0 * i;
    }
    size_t count, missed, count_again;
    qm_pick_view view = view_of(&g, &camera);
    assert_int_equal(qm_pick_stroke(&g.ctx, &view, window, 20, first, &count, &missed), QM_OK);
    QM_CHECK(count + missed == 20 && count > 8 && missed > 0, "%zu hit, %zu missed", count, missed);
    view = view_of(&g, &camera);
    assert_int_equal(qm_pick_stroke(&g.ctx, &view, window, 20, again, &count_again, &missed), QM_OK);
    assert_int_equal(count, count_again);
    assert_memory_equal(first, again, 24 * count);
    qm_ground_free(&g);
}

static void cameras_that_see_nothing_are_refused(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_plane(2, 0.0));
    const qm_pick_options options = {0};
    qm_pick_view view;
    qm_camera camera = camera_above();
    camera.viewport[2] = 0.0;
    assert_int_equal(qm_pick_view_init(&g.ctx, &g.source, &camera, &options, &view), QM_E_ARGUMENT);
    camera = camera_above();
    camera.view[0] = NAN;
    assert_int_equal(qm_pick_view_init(&g.ctx, &g.source, &camera, &options, &view), QM_E_ARGUMENT);
    camera = camera_above();
    memset(camera.projection, 0, sizeof camera.projection);
    assert_int_equal(qm_pick_view_init(&g.ctx, &g.source, &camera, &options, &view), QM_E_ARGUMENT);
    assert_non_null(strstr(g.ctx.message, "inverse"));
    qm_ground_free(&g);
}

static void pulled_points_lie_on_the_sphere(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_ground_sample(sphere_at, 20000, 0.0, 3));
    qm_random random = qm_random_make(qm_check_seed(), 8);
    for (int i = 0; i < 200; i++) {
        double p[3];
        qm_random_direction(&random, p);
        qm_vec truth = qm_vec_load(p);
        qm_vec_store(p, qm_vec_scale(qm_random_range(&random, 0.95, 1.05), truth));
        qm_ref_surface_point foot;
        qm_ref_surface_project(&g.source, p, &foot);
        double off = fabs(qm_vec_norm(qm_vec_load(foot.position)) - 1.0);
        double turned = fabs(qm_vec_dot(qm_vec_load(foot.normal), truth));
        QM_CHECK(off < 2e-4 && turned > 0.998, "point %d: off by %g, cosine %g", i, off, turned);
    }
    double radius = qm_ref_surface_disc_radius(&g.mesh);
    QM_CHECK(fabs(radius - 0.15 * cbrt(8.0 / 20000.0)) < 1e-3 * radius, "disc radius %g", radius);
    qm_ground_free(&g);
}

static void normals_are_estimated_on_one_side(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_ground_sample(qm_torus_at, 20000, 0.0, 4));
    double *normals = malloc(3 * sizeof(double) * g.mesh.vertex_count);
    assert_non_null(normals);
    assert_int_equal(qm_ref_surface_estimate_normals(&g.ctx, &g.source, normals), QM_OK);
    for (size_t i = 0; i < g.mesh.vertex_count; i++) {
        qm_vec p = qm_vec_load(g.mesh.positions + 3 * i);
        double across = hypot(p.x, p.y);
        qm_vec truth = {(p.x - p.x / across) / 0.35, (p.y - p.y / across) / 0.35, p.z / 0.35};
        double cosine = qm_vec_dot(truth, qm_vec_load(normals + 3 * i));
        QM_CHECK(cosine > 0.9, "point %zu: cosine %g", i, cosine);
    }
    free(normals);
    qm_ground_free(&g);

    qm_ground_make(&g, qm_shape_plane(2, 0.0));
    assert_int_equal(qm_ref_surface_estimate_normals(&g.ctx, &g.source, NULL), QM_E_ARGUMENT);
    qm_ground_free(&g);
}

static void sources_of_no_size_are_refused(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh points = qm_shape_make(3, 0);
    qm_bvh *tree;
    qm_ref_surface source;
    assert_int_equal(qm_bvh_build(&ctx, &points, QM_BVH_TARGET, 1, &tree), QM_OK);
    assert_int_equal(qm_ref_surface_init(&ctx, tree, &source), QM_E_EMPTY);
    qm_bvh_destroy(&ctx, tree);
    qm_shape_free(&points);
}

static void running_out_of_memory_is_a_status(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_ground_sample(sphere_at, 2000, 0.0, 5));
    double *normals = malloc(3 * sizeof(double) * g.mesh.vertex_count), at[3];
    assert_non_null(normals);
    qm_camera camera = camera_above();
    qm_pick_view view = view_of(&g, &camera);
    const double middle[2] = {400, 300};
    qm_status status = QM_E_NO_MEMORY;
    for (size_t fail_at = 0; status != QM_OK; fail_at++) {
        qm_failing_allocator memory = {.fail_at = fail_at};
        qm_context ctx = {.allocator = qm_failing_allocator_hook(&memory)};
        bool found;
        status = qm_pick_point(&ctx, &view, middle, at, &found);
        if (status == QM_OK) status = qm_ref_surface_estimate_normals(&ctx, &g.source, normals);
        QM_CHECK(status == QM_OK || status == QM_E_NO_MEMORY, "call %zu: %s", fail_at, ctx.message);
        QM_CHECK(memory.live_blocks == 0 && !memory.mismatched, "call %zu leaves %zu blocks", fail_at,
                 memory.live_blocks);
    }
    free(normals);
    qm_ground_free(&g);
}

static void a_plane_contains_both_places_and_the_view(void **state)
{
    (void)state;
    qm_camera camera = camera_above();
    const double a[3] = {-0.4, 0.1, 0.2}, b[3] = {0.5, 0.3, -0.1};
    double normal[3], window[2];
    assert_true(qm_pick_plane(&camera, a, b, normal));
    qm_vec n = qm_vec_load(normal), d = qm_vec_sub(qm_vec_load(b), qm_vec_load(a));
    assert_true(fabs(qm_vec_norm(n) - 1.0) < 1e-12 && fabs(qm_vec_dot(n, d)) < 1e-12);
    /* Places of the plane at any depth are on one line of the window: that through both. */
    double first[2], last[2];
    window_of(&camera, qm_vec_load(a), first);
    window_of(&camera, qm_vec_load(b), last);
    qm_vec up = qm_vec_cross(n, d);
    for (int k = -3; k <= 3; k++) {
        window_of(&camera, qm_vec_axpy(qm_vec_mix(qm_vec_load(a), qm_vec_load(b), 0.3), 0.2 * k, up), window);
        double off =
            (last[0] - first[0]) * (window[1] - first[1]) - (last[1] - first[1]) * (window[0] - first[0]);
        QM_CHECK(fabs(off) < 1e-6 * hypot(last[0] - first[0], last[1] - first[1]), "%g pixels off", off);
    }
    assert_false(qm_pick_plane(&camera, a, a, normal));
    memset(camera.projection, 0, sizeof camera.projection);
    assert_false(qm_pick_plane(&camera, a, b, normal));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(picks_find_the_visible_side),
        cmocka_unit_test(a_ray_meets_the_same_triangle_as_all_of_them_tried),
        cmocka_unit_test(the_same_stroke_gives_the_same_bits),
        cmocka_unit_test(cameras_that_see_nothing_are_refused),
        cmocka_unit_test(a_plane_contains_both_places_and_the_view),
        cmocka_unit_test(pulled_points_lie_on_the_sphere),
        cmocka_unit_test(normals_are_estimated_on_one_side),
        cmocka_unit_test(sources_of_no_size_are_refused),
        cmocka_unit_test(running_out_of_memory_is_a_status),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
