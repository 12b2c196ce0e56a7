/* What a picture shows at each pixel, against a search over all faces, and how far that is, against formulas. */
#include "check.h"

#include "failing_allocator.h"
#include "report/heat.h"
#include "shapes.h"

#include <float.h>
#include <math.h>
#include <string.h>

enum { WIDTH = 64, HEIGHT = 48, PIXELS = WIDTH * HEIGHT };

/* ---- the search over all faces ---- */

/** The middle of a pixel, on the plane through the centre of the view. */
static void middle_of(const qm_view *view, int x, int y, long double out[3])
{
    long double across = ((long double)x + 0.5L - 0.5L * view->width) / view->scale * view->size;
    long double down = ((long double)y + 0.5L - 0.5L * view->height) / view->scale * view->size;
    for (int k = 0; k < 3; k++)
        out[k] = view->centre[k] + across * view->right[k] - down * view->up[k];
}

static long double dot(const long double *a, const long double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const long double *a, const long double *b, long double *out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/** Where a ray towards the viewer meets a triangle, in pixels before the plane of the centre; -infinity where it passes it, or
 * its edge by less than a millionth. Source: Moeller, Trumbore, Fast, minimum storage ray/triangle intersection, 1997. */
static long double hit(const qm_view *view, const long double *from, const double *a, const double *b,
                       const double *c)
{
    long double e[3], f[3], s[3], p[3], q[3], way[3];
    for (int k = 0; k < 3; k++) {
        e[k] = (long double)b[k] - a[k];
        f[k] = (long double)c[k] - a[k];
        s[k] = from[k] - a[k];
        way[k] = view->towards[k];
    }
    cross(way, f, p);
    long double det = dot(e, p);
    if (det == 0.0L) return -INFINITY;
    cross(s, e, q);
    long double u = dot(s, p) / det, v = dot(way, q) / det;
    if (u < 1e-6L || v < 1e-6L || u + v > 1.0L - 1e-6L) return -INFINITY;
    return dot(f, q) / det / view->size * view->scale;
}

/** The greatest depth of all triangles at a pixel. */
static long double find_nearest(const qm_view *view, const qm_mesh *mesh, int x, int y)
{
    long double from[3], nearest = -INFINITY;
    middle_of(view, x, y, from);
    for (size_t i = 0; i < mesh->face_count; i++) {
        const uint32_t *face = mesh->faces + 4 * i;
        for (int k = 1; k < (face[3] == QM_NO_INDEX ? 2 : 3); k++)
            nearest = fmaxl(nearest, hit(view, from, mesh->positions + 3 * (size_t)face[0],
                                         mesh->positions + 3 * (size_t)face[k],
                                         mesh->positions + 3 * (size_t)face[k + 1]));
    }
    return nearest;
}

/** Moves a mesh away from the origin, and makes it larger or smaller. */
static void place(qm_random *random, qm_mesh *mesh)
{
    static const double sizes[] = {1e-30, 1e-3, 1.0, 1e6, 1e30}, offsets[] = {0.0, 10.0, 1e9};
    double size = sizes[qm_random_below(random, 5)], offset = offsets[qm_random_below(random, 3)];
    for (size_t i = 0; i < 3 * mesh->vertex_count; i++)
        mesh->positions[i] = size * (mesh->positions[i] + offset);
}

/** How many pixels a point may be off: by the rounding of its coordinates, which may be large beside the mesh. */
static double allow_for_rounding(const qm_view *view, const qm_mesh *mesh)
{
    double greatest = 0.0;
    for (size_t i = 0; i < 3 * mesh->vertex_count; i++)
        greatest = fmax(greatest, fabs(mesh->positions[i]));
    return 1e-6 + 20.0 * DBL_EPSILON * greatest / view->size * view->scale;
}

static qm_view look(qm_random *random, const qm_mesh *mesh)
{
    qm_box box = qm_mesh_bounding_box(mesh);
    double towards[3], up[3] = {0.0, 0.0, 1.0};
    qm_random_direction(random, towards);
    /* Sides exactly along an axis, as in reports. */
    if (qm_random_below(random, 4) == 0) {
        memset(towards, 0, sizeof towards);
        towards[qm_random_below(random, 2)] = 1.0;
    }
    return qm_raster_view(&box, towards, up, WIDTH, HEIGHT);
}

static void check_pixel(const qm_raster *r, const qm_mesh *mesh, qm_quad_reading quads, int x, int y,
                        double off, double wide, size_t draw)
{
    size_t i = (size_t)y * WIDTH + (size_t)x;
    if (r->face[i] == QM_NO_INDEX) return;
    double point[3], at[3];
    qm_raster_position(mesh, quads, r->face[i], r->uv + 2 * i, point);
    qm_raster_project(&r->view, point, at);
    QM_CHECK(fabs(at[0] - x - 0.5) <= wide + off && fabs(at[1] - y - 0.5) <= wide + off,
             "draw %zu: the point of pixel %d %d is at %g %g", draw, x, y, at[0], at[1]);
    QM_CHECK(fabs(at[2] - r->depth[i]) <= wide - 1.0 + off,
             "draw %zu: pixel %d %d: depth %.17g, of its point %.17g", draw, x, y, r->depth[i], at[2]);
}

static void pixels_show_what_a_search_over_all_faces_finds(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    size_t draws = qm_check_long() ? 2000 : 60, seen = 0;
    for (size_t n = 0; n <= draws; n++) {
        /* Draw 458 of seed 1 has a sliver, to whose inside rounding added pixels that are not near it. */
        size_t draw = n < draws ? n : 458;
        qm_random random = qm_random_make(qm_check_seed(), draw);
        qm_mesh mesh = qm_shape_soup(&random, 1 + qm_random_below(&random, 30),
                                     (qm_soup_corners)qm_random_below(&random, 3),
                                     (qm_soup_style)qm_random_below(&random, QM_SOUP_STYLE_COUNT), 0.5);
        place(&random, &mesh);
        qm_view view = look(&random, &mesh);
        double off = allow_for_rounding(&view, &mesh);
        qm_raster r;
        assert_true(qm_raster_init(&ctx, &view, &r));
        qm_raster_draw(&r, &mesh, QM_QUADS_TRIANGLES);
        for (int y = 0; y < HEIGHT; y++) {
            for (int x = 0; x < WIDTH; x++) {
                double depth = r.depth[y * WIDTH + x];
                long double nearest = find_nearest(&view, &mesh, x, y);
                QM_CHECK(depth >= nearest - off,
                         "seed %llu draw %zu: pixel %d %d has depth %.17g, and a face %.17Lg",
                         (unsigned long long)qm_check_seed(), draw, x, y, depth, nearest);
                check_pixel(&r, &mesh, QM_QUADS_TRIANGLES, x, y, off, 1.0, draw);
                seen += isfinite(nearest);
            }
        }
        qm_raster_reset(&ctx, &r);
        qm_shape_free(&mesh);
    }
    assert_true(seen > 100 * draws);
}

static void pixels_of_patches_show_points_of_them(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    for (size_t draw = 0; draw < 60; draw++) {
        qm_random random = qm_random_make(qm_check_seed(), 1000 + draw);
        qm_mesh mesh =
            qm_shape_soup(&random, 1 + qm_random_below(&random, 9), QM_SOUP_QUADS, QM_SOUP_APART, 1.0);
        place(&random, &mesh);
        qm_view view = look(&random, &mesh);
        double off = allow_for_rounding(&view, &mesh);
        qm_raster r;
        assert_true(qm_raster_init(&ctx, &view, &r));
        qm_raster_draw(&r, &mesh, QM_QUADS_BILINEAR);
        for (int y = 0; y < HEIGHT; y++)
            for (int x = 0; x < WIDTH; x++)
                check_pixel(&r, &mesh, QM_QUADS_BILINEAR, x, y, off, 1.3, draw);
        qm_raster_reset(&ctx, &r);
        qm_shape_free(&mesh);
    }
}

static size_t count_seen(qm_context *ctx, const qm_mesh *mesh)
{
    qm_box box = qm_mesh_bounding_box(mesh);
    const double towards[3] = {0.0, -1.0, 0.0}, up[3] = {0.0, 0.0, 1.0};
    qm_view view = qm_raster_view(&box, towards, up, WIDTH, HEIGHT);
    qm_raster r;
    size_t seen = 0;
    assert_true(qm_raster_init(ctx, &view, &r));
    qm_raster_draw(&r, mesh, QM_QUADS_TRIANGLES);
    for (size_t i = 0; i < PIXELS; i++)
        seen += r.face[i] != QM_NO_INDEX;
    qm_raster_reset(ctx, &r);
    return seen;
}

static void what_has_no_area_is_seen_as_well(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    const double needle[3][3] = {{0, 0, 0}, {1, 0, 1}, {0.5, 0, 0.5}},
                 dot_face[3][3] = {{2, 2, 2}, {2, 2, 2}, {2, 2, 2}},
                 edge_on[3][3] = {{0, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    qm_mesh mesh = qm_shape_face(3, needle);
    QM_CHECK(count_seen(&ctx, &mesh) >= 40, "a needle over the picture");
    qm_shape_free(&mesh);
    mesh = qm_shape_face(3, dot_face);
    QM_CHECK(count_seen(&ctx, &mesh) >= 1, "a face that is a point");
    qm_shape_free(&mesh);
    mesh = qm_shape_face(3, edge_on);
    QM_CHECK(count_seen(&ctx, &mesh) >= 40, "a face that is seen from its edge");
    qm_shape_free(&mesh);
    qm_random random = qm_random_make(qm_check_seed(), 7);
    mesh = qm_shape_points(&random, 1);
    QM_CHECK(count_seen(&ctx, &mesh) >= 9, "a single point");
    qm_shape_free(&mesh);
}

/* ---- distances ---- */

typedef double distance_fn(double x, double y);

/** Draws a mesh from above, and holds each pixel against a formula of where its middle is. */
static void check_distances(qm_mesh mesh, qm_mesh target, qm_quad_reading quads, distance_fn *expected)
{
    qm_context ctx = qm_context_make();
    qm_bvh *bvh;
    assert_int_equal(qm_bvh_build(&ctx, &target, QM_BVH_ALL, 1, &bvh), QM_OK);
    qm_box box = qm_mesh_bounding_box(&mesh);
    const double towards[3] = {0.0, 0.0, 1.0}, up[3] = {0.0, 1.0, 0.0};
    qm_view view = qm_raster_view(&box, towards, up, WIDTH, HEIGHT);
    qm_heat heat;
    assert_int_equal(qm_heat_draw(&ctx, &view, &mesh, bvh, quads, 1, &heat), QM_OK);
    size_t seen = 0;
    for (int y = 0; y < HEIGHT; y++) {
        for (int x = 0; x < WIDTH; x++) {
            double found = heat.distance[y * WIDTH + x];
            if (isnan(found)) continue;
            long double at[3];
            middle_of(&view, x, y, at);
            double truth = expected((double)at[0], (double)at[1]);
            QM_CHECK(fabs(found - truth) < 1e-9, "pixel %d %d: %.17g for %.17g", x, y, found, truth);
            seen++;
        }
    }
    QM_CHECK(seen > 1000, "%zu pixels", seen);
    qm_heat_reset(&ctx, &heat);
    qm_bvh_destroy(&ctx, bvh);
    qm_shape_free(&target);
    qm_shape_free(&mesh);
}

static qm_mesh make_square(double half, double height)
{
    const double corners[4][3] = {
        {-half, -half, height}, {half, -half, height}, {half, half, height}, {-half, half, height}};
    return qm_shape_face(4, corners);
}

static double of_plane(double x, double y)
{
    (void)x, (void)y;
    return 0.25;
}

static double of_saddle(double x, double y)
{
    return fabs(x * y);
}

static double of_split_saddle(double x, double y)
{
    return fabs(1.0 - fabs(x - y));
}

/** Of the square z = 0 from the pyramid over it of height 1, which meets it at all four corners. */
static double of_pyramid(double x, double y)
{
    return (1.0 - fmax(fabs(x), fabs(y))) / sqrt(2.0);
}

static void pixels_have_the_distance_of_their_points(void **state)
{
    (void)state;
    const double saddle[4][3] = {{-1, -1, 1}, {1, -1, -1}, {1, 1, 1}, {-1, 1, -1}};
    check_distances(make_square(1.0, 0.25), make_square(3.0, 0.0), QM_QUADS_TRIANGLES, of_plane);
    check_distances(qm_shape_face(4, saddle), make_square(3.0, 0.0), QM_QUADS_BILINEAR, of_saddle);
    check_distances(qm_shape_face(4, saddle), make_square(3.0, 0.0), QM_QUADS_TRIANGLES, of_split_saddle);
}

static void corners_on_the_other_mesh_do_not_hide_what_is_between(void **state)
{
    (void)state;
    qm_mesh pyramid = qm_shape_make(5, 4);
    static const double corners[5][3] = {{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}, {0, 0, 1}};
    memcpy(pyramid.positions, corners, sizeof corners);
    for (uint32_t i = 0; i < 4; i++) {
        const uint32_t face[4] = {i, (i + 1) % 4, 4, QM_NO_INDEX};
        memcpy(pyramid.faces + (size_t)4 * i, face, sizeof face);
    }
    check_distances(make_square(1.0, 0.0), pyramid, QM_QUADS_TRIANGLES, of_pyramid);
}

/** A box of size 1 and how it is looked at. */
typedef struct seen_box {
    qm_mesh box;
    qm_bvh *bvh;
    qm_view view;
} seen_box;

static seen_box see_box(qm_context *ctx, const double towards[3], const double up[3])
{
    seen_box out = {.box = qm_shape_box(1.0, 1.0, 1.0)};
    assert_int_equal(qm_bvh_build(ctx, &out.box, QM_BVH_ALL, 1, &out.bvh), QM_OK);
    qm_box bounds = qm_mesh_bounding_box(&out.box);
    out.view = qm_raster_view(&bounds, towards, up, WIDTH, HEIGHT);
    return out;
}

static void seen_box_free(qm_context *ctx, seen_box *seen)
{
    qm_bvh_destroy(ctx, seen->bvh);
    qm_shape_free(&seen->box);
}

static void places_are_seen_where_nothing_is_before_them(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    const double towards[3] = {0.0, 0.0, 1.0}, up[3] = {0.0, 1.0, 0.0};
    seen_box seen = see_box(&ctx, towards, up);
    qm_heat heat;
    assert_int_equal(qm_heat_draw(&ctx, &seen.view, &seen.box, seen.bvh, QM_QUADS_TRIANGLES, 1, &heat),
                     QM_OK);
    const double above[3] = {0.3, 0.6, 1.0}, below[3] = {0.3, 0.6, 0.0}, beside[3] = {9.0, 0.6, 1.0},
                 corner[3] = {1, 1, 1};
    assert_true(qm_heat_shows(&heat, above));
    assert_true(qm_heat_shows(&heat, corner));
    assert_false(qm_heat_shows(&heat, below));
    assert_false(qm_heat_shows(&heat, beside));
    qm_heat_reset(&ctx, &heat);
    seen_box_free(&ctx, &seen);
}

static void a_failed_allocation_is_told_and_leaves_nothing(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    const double towards[3] = {1.0, 0.0, 0.0}, up[3] = {0.0, 0.0, 1.0};
    seen_box seen = see_box(&ctx, towards, up);
    qm_status status = QM_E_NO_MEMORY;
    for (size_t fail_at = 0; status != QM_OK; fail_at++) {
        qm_failing_allocator memory = {.fail_at = fail_at};
        qm_context failing = qm_context_make();
        failing.allocator = qm_failing_allocator_hook(&memory);
        qm_heat heat;
        status = qm_heat_draw(&failing, &seen.view, &seen.box, seen.bvh, QM_QUADS_TRIANGLES, 1, &heat);
        assert_true(status == QM_OK || status == QM_E_NO_MEMORY);
        if (status == QM_OK) qm_heat_reset(&failing, &heat);
        assert_int_equal(memory.live_blocks, 0);
        assert_false(memory.mismatched);
        assert_true(fail_at < 100);
    }
    seen_box_free(&ctx, &seen);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pixels_show_what_a_search_over_all_faces_finds),
        cmocka_unit_test(pixels_of_patches_show_points_of_them),
        cmocka_unit_test(what_has_no_area_is_seen_as_well),
        cmocka_unit_test(pixels_have_the_distance_of_their_points),
        cmocka_unit_test(corners_on_the_other_mesh_do_not_hide_what_is_between),
        cmocka_unit_test(places_are_seen_where_nothing_is_before_them),
        cmocka_unit_test(a_failed_allocation_is_told_and_leaves_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
