/* qm_quads_make: meshes of quads of shapes by formula have the topology of the shape, lie on it, and have few irregular vertices. */
#include "check.h"
#include "measured.h"

#include "base/host.h"
#include "failing_allocator.h"
#include "poll_cancel.h"
#include "qm/features.h"
#include "qm/hausdorff.h"
#include "qm/quads.h"
#include "quad_topology.h"
#include "quads/quads_internal.h"
#include "shapes.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define PI 3.14159265358979323846

/* ---- shapes ---- */

/** A grid's quads cut into triangles. */
static qm_mesh triangles_of(qm_mesh quads)
{
    qm_mesh m = qm_shape_make(quads.vertex_count, 2 * quads.face_count);
    memcpy(m.positions, quads.positions, 3 * quads.vertex_count * sizeof *m.positions);
    for (size_t f = 0; f < quads.face_count; f++) {
        const uint32_t *c = quads.faces + 4 * f;
        const uint32_t cut[8] = {c[0], c[1], c[2], QM_NO_INDEX, c[0], c[2], c[3], QM_NO_INDEX};
        memcpy(m.faces + 8 * f, cut, sizeof cut);
    }
    qm_shape_free(&quads);
    return m;
}

/** The cube [-1, 1]^3 of n x n quads a side, each point moved. */
typedef void move_fn(double p[3]);
static qm_mesh cube_grid(int n, move_fn *moved)
{
    qm_mesh m = qm_shape_cube_grid(n);
    for (size_t v = 0; v < m.vertex_count; v++)
        moved(m.positions + 3 * v);
    return m;
}

static void to_sphere(double p[3])
{
    double length = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
    for (int k = 0; k < 3; k++)
        p[k] /= length;
}

static void to_box(double p[3])
{
    p[1] *= 0.7, p[2] *= 0.4;
}

static void to_thin_box(double p[3])
{
    p[2] *= 0.1;
}

static double thickness; /* of plates, as a share of their side */

/** A plate of two sides of 2. */
static void to_plate(double p[3])
{
    p[2] *= thickness;
}

/** A plate that is bent into a cap; each wall is off the middle along the normal. */
static void to_cap(double p[3])
{
    double slope = p[0], length = hypot(1.0, slope), off = thickness * p[2];
    p[2] = -0.5 * p[0] * p[0] + off / length;
    p[0] += off * slope / length;
}

/** A cylinder with flat caps: squares become discs. */
static void to_cylinder(double p[3])
{
    double radius = fmax(fabs(p[0]), fabs(p[1])), length = hypot(p[0], p[1]);
    if (length > 0.0) p[0] *= radius / length, p[1] *= radius / length;
    p[2] *= 1.5;
}

/** An ellipsoid, bent round the y axis. */
static void to_banana(double p[3])
{
    to_sphere(p);
    double x = 0.5 * p[0], angle = 2.0 * p[2];
    p[1] *= 0.5;
    p[0] = (2.0 + x) * cos(angle) - 2.0;
    p[2] = (2.0 + x) * sin(angle);
}

/** A sphere with bumps. */
static void to_bumps(double p[3])
{
    to_sphere(p);
    double size = 1.0 + 0.15 * sin(6.0 * p[0]) * sin(6.0 * p[1]) * sin(6.0 * p[2] + 1.0);
    for (int k = 0; k < 3; k++)
        p[k] *= size;
}

/** An ellipsoid, each point of which lies by up to 15 % too far or too near: few triangles make facets of it. */
static void to_facets(double p[3])
{
    to_sphere(p);
    double size = 1.0 + 0.15 * sin(29.0 * p[0]) * sin(31.0 * p[1] + 1.0) * sin(37.0 * p[2] + 2.0);
    p[0] *= 2.0 * size, p[1] *= 1.2 * size, p[2] *= size;
}

/** A sphere with a horn, the end of which is a cone of 14 degrees to its axis. */
static void to_horn(double p[3])
{
    to_sphere(p);
    double off = acos(fmin(fmax(p[2], -1.0), 1.0)), size = 1.0 + fmax(1.0 - 4.0 * off, 0.0);
    for (int k = 0; k < 3; k++)
        p[k] *= size;
}

static void moebius_point(const void *user, double u, double v, double out[3])
{
    (void)user;
    double t = 2.0 * PI * u, w = v - 0.5;
    out[0] = (1.0 + w * cos(t / 2.0)) * cos(t);
    out[1] = (1.0 + w * cos(t / 2.0)) * sin(t);
    out[2] = w * sin(t / 2.0);
}

/* ---- checks ---- */

typedef struct wanted {
    const char *name;
    size_t quads;
    ptrdiff_t euler;
    size_t components;
    bool is_closed;
    size_t least_irregular, most_irregular;
    double most_distance; /* in sides of a quad */
} wanted;

static qm_mesh make_quads(qm_context *ctx, const qm_mesh *surface, size_t quads, int threads)
{
    qm_bvh *bvh;
    qm_mesh out;
    qm_quads_record record;
    qm_quads_options options = qm_quads_options_default();
    options.quads = quads;
    options.thread_count = threads;
    assert_int_equal(qm_bvh_build(ctx, surface, QM_BVH_TARGET, threads, &bvh), QM_OK);
    QM_CHECK(qm_quads_make(ctx, bvh, &options, &out, &record) == QM_OK, "%s", ctx->message);
    assert_int_equal(record.steps_open, 0);
    qm_bvh_destroy(ctx, bvh);
    return out;
}

static double distance_between(const qm_mesh *a, const qm_mesh *b)
{
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.tolerance = 1e-6;
    return qm_measured(a, b, &options).upper;
}

static double area_of(const qm_mesh *m)
{
    double sum = 0.0;
    for (size_t f = 0; f < m->face_count; f++) {
        int corners = m->faces[4 * f + 3] == QM_NO_INDEX ? 3 : 4;
        qm_vec p[4];
        for (int k = 0; k < corners; k++)
            p[k] = qm_vec_load(m->positions + 3 * (size_t)m->faces[4 * f + (size_t)k]);
        for (int k = 2; k < corners; k++)
            sum += 0.5 * qm_vec_norm(qm_vec_cross(qm_vec_sub(p[k - 1], p[0]), qm_vec_sub(p[k], p[0])));
    }
    return sum;
}

/** most_off: of the number of quads, as a share */
static void check_quads_off(qm_mesh surface, const wanted *w, double most_off)
{
    qm_context ctx = qm_context_make();
    qm_mesh quads = make_quads(&ctx, &surface, w->quads, 1);
    qm_topology t = qm_topology_find(&quads);
    double size = sqrt(area_of(&surface) / (double)w->quads), distance = distance_between(&surface, &quads);
    double least = qm_topology_least_sine(&quads);
    size_t folded = qm_topology_count_folded(&quads);
    if (getenv("QM_TEST_SHOW"))
        print_message("%s: %zu quads, euler %td, %zu components, %zu irregular, %zu boundary, distance %.3f, "
                      "folded %zu, least sine %.3f\n",
                      w->name, quads.face_count, t.euler, t.components, t.irregular, t.boundary_edges,
                      distance / size, folded, least);
    QM_CHECK(t.is_all_quads && t.is_manifold && t.is_oriented, "%s: quads %d, manifold %d, oriented %d",
             w->name, t.is_all_quads, t.is_manifold, t.is_oriented);
    QM_CHECK(t.euler == w->euler && t.components == w->components, "%s: Euler number %td, %zu components",
             w->name, t.euler, t.components);
    QM_CHECK((t.boundary_edges == 0) == w->is_closed, "%s: %zu boundary edges", w->name, t.boundary_edges);
    QM_CHECK(t.irregular >= w->least_irregular && t.irregular <= w->most_irregular,
             "%s: %zu irregular vertices", w->name, t.irregular);
    QM_CHECK(distance <= w->most_distance * size, "%s: distance %.3g, side %.3g", w->name, distance, size);
    QM_CHECK(folded == 0 && least >= 0.2, "%s: %zu folded quads, least scaled Jacobian %.3f", w->name, folded,
             least);
    QM_CHECK(fabs((double)quads.face_count / (double)w->quads - 1.0) <= most_off, "%s: %zu quads of %zu",
             w->name, quads.face_count, w->quads);
    qm_mesh_reset(&ctx, &quads);
    qm_shape_free(&surface);
}

static void check_quads(qm_mesh surface, const wanted *w)
{
    check_quads_off(surface, w, 0.06);
}

static void closed_shapes_become_closed_quads(void **state)
{
    (void)state;
    const wanted sphere = {"sphere", 1000, 2, 1, true, 8, 24, 0.08};
    check_quads(cube_grid(16, to_sphere), &sphere);
    check_quads(triangles_of(cube_grid(23, to_sphere)), &sphere);
    const wanted banana = {"banana", 800, 2, 1, true, 8, 30, 0.6};
    check_quads(triangles_of(cube_grid(20, to_banana)), &banana);
    const wanted bumps = {"bumps", 2500, 2, 1, true, 8, 30, 0.2};
    check_quads(triangles_of(cube_grid(24, to_bumps)), &bumps);
    const wanted torus = {"torus", 1500, 0, 1, true, 0, 24, 0.25};
    check_quads(triangles_of(qm_shape_torus(60, 24, 1.0, 0.35)), &torus);
}

/** A torus has a field without singular vertices, a sphere needs eight: pairs of opposites cancel, and no field winds round a handle. */
static void smooth_shapes_have_few_irregular_vertices(void **state)
{
    (void)state;
    static const double tube[3] = {0.2, 0.35, 0.5};
    for (int k = 0; k < 3; k++) {
        const wanted torus = {"torus", 6000, 0, 1, true, 0, 8, 0.25};
        check_quads(triangles_of(qm_shape_torus(60, 24, 1.0, tube[k])), &torus);
    }
    const wanted sphere = {"sphere", 4000, 2, 1, true, 8, 8, 0.08};
    check_quads(triangles_of(cube_grid(23, to_sphere)), &sphere);
}

/** How many vertices of a surface are tips, and how high it reaches after triangles of a length were made of it. */
static size_t hold_tips_of(qm_mesh surface, double size, double *height)
{
    qm_context ctx = qm_context_make();
    qm_bvh *bvh;
    uint32_t(*corner)[3] = malloc(surface.face_count * sizeof *corner);
    assert_non_null(corner);
    for (size_t f = 0; f < surface.face_count; f++)
        memcpy(corner[f], surface.faces + 4 * f, sizeof *corner);
    qm_trimesh m;
    assert_int_equal(qm_bvh_build(&ctx, &surface, QM_BVH_TARGET, 1, &bvh), QM_OK);
    assert_int_equal(qm_trimesh_build(&ctx, surface.positions, surface.vertex_count,
                                      (const uint32_t(*)[3])corner, surface.face_count, &m),
                     QM_OK);
    size_t held = 0, left = 0;
    assert_int_equal(qm_quads_hold_tips(&ctx, &m, size), QM_OK);
    for (size_t v = 0; v < m.vertex_count; v++)
        held += m.is_fixed[v];
    assert_int_equal(qm_quads_remesh(&ctx, &m, bvh, size, 1), QM_OK);
    qm_quads_release_tips(&m);
    *height = 0.0;
    for (size_t v = 0; v < m.vertex_count; v++) {
        left += m.is_fixed[v];
        *height = fmax(*height, m.position[v].z);
    }
    assert_int_equal(left, 0);
    qm_trimesh_reset(&ctx, &m);
    qm_bvh_destroy(&ctx, bvh);
    free(corner);
    qm_shape_free(&surface);
    return held;
}

/** Centred among its neighbours, the tip of a horn slid down it. */
static void tips_stay(void **state)
{
    (void)state;
    double height;
    for (double size = 0.05; size < 0.2; size *= 1.5) {
        size_t tips = hold_tips_of(triangles_of(cube_grid(40, to_horn)), size, &height);
        QM_CHECK(tips == 1 && height > 2.0 - 1e-9, "triangles of %.3g: %zu tips, height %.6f", size, tips,
                 height);
    }
    size_t tips = hold_tips_of(triangles_of(cube_grid(20, to_bumps)), 0.05, &height);
    QM_CHECK(tips == 0, "%zu tips of bumps", tips);
    tips = hold_tips_of(triangles_of(cube_grid(20, to_box)), 0.05, &height);
    QM_CHECK(tips == 0, "%zu tips of a box", tips);
}

static void creases_are_followed(void **state)
{
    (void)state;
    const wanted box = {"box", 900, 2, 1, true, 8, 8, 1e-3};
    check_quads(triangles_of(cube_grid(14, to_box)), &box);
    const wanted few = {"box of 12 triangles", 400, 2, 1, true, 8, 8, 1e-3};
    check_quads(triangles_of(qm_shape_box(1.0, 1.3, 0.8)), &few);
    const wanted thin = {"thin box", 2000, 2, 1, true, 8, 8, 1e-3};
    check_quads(triangles_of(cube_grid(20, to_thin_box)), &thin);
    const wanted cylinder = {"cylinder", 1200, 2, 1, true, 8, 40, 0.2};
    check_quads(triangles_of(cube_grid(24, to_cylinder)), &cylinder);
}

/** A disc of triangles from an apex to the corners of a regular polygon in the plane z = 0, a share of the full turn. */
static qm_mesh cone_of(int sides, double share, const double apex[3])
{
    bool is_whole = share >= 1.0;
    size_t count = (size_t)sides, corners = count + !is_whole;
    qm_mesh m = qm_shape_make(corners + 1, count);
    memcpy(m.positions, apex, 3 * sizeof *apex);
    for (size_t i = 0; i < corners; i++) {
        double angle = 2.0 * PI * share * (double)i / sides;
        m.positions[3 * i + 3] = cos(angle), m.positions[3 * i + 4] = sin(angle),
                            m.positions[3 * i + 5] = 0.0;
    }
    for (size_t i = 0; i < count; i++) {
        const uint32_t corner[4] = {0, (uint32_t)i + 1, (uint32_t)((i + 1) % corners) + 1, QM_NO_INDEX};
        memcpy(m.faces + 4 * i, corner, sizeof corner);
    }
    return m;
}

/** Two cones over one polygon. */
static qm_mesh bipyramid_of(int sides, double top, double bottom)
{
    size_t count = (size_t)sides;
    qm_mesh upper = cone_of(sides, 1.0, (double[]){0, 0, top}), m = qm_shape_make(count + 2, 2 * count);
    memcpy(m.positions, upper.positions, 3 * (count + 1) * sizeof *m.positions);
    memcpy(m.faces, upper.faces, 4 * count * sizeof *m.faces);
    m.positions[3 * count + 3] = m.positions[3 * count + 4] = 0.0, m.positions[3 * count + 5] = bottom;
    for (size_t i = 0; i < count; i++) {
        const uint32_t *c = upper.faces + 4 * i;
        const uint32_t below[4] = {(uint32_t)count + 1, c[2], c[1], QM_NO_INDEX};
        memcpy(m.faces + 4 * (count + i), below, sizeof below);
    }
    qm_shape_free(&upper);
    return m;
}

/** Without a quarter turn at an acute corner all rows of the grid end there: half of the quads were missing, and a tenth folded. */
static void acute_corners_have_a_quad(void **state)
{
    (void)state;
    const double origin[3] = {0, 0, 0};
    const wanted right = {"triangle of 45 degrees", 500, 1, 1, false, 0, 10, 1e-3};
    check_quads_off(cone_of(1, 0.25, origin), &right, 0.15);
    const wanted wedge = {"triangle of 30 degrees", 1000, 1, 1, false, 0, 10, 1e-3};
    check_quads_off(cone_of(1, 1.0 / 12.0, origin), &wedge, 0.15);
    const wanted narrow = {"triangle of 20 degrees", 500, 1, 1, false, 0, 10, 1e-3};
    check_quads_off(cone_of(1, 1.0 / 18.0, origin), &narrow, 0.15);
    const wanted pyramid = {"pyramid", 1000, 2, 1, true, 8, 40, 0.6};
    check_quads_off(bipyramid_of(6, 2.0, 0.0), &pyramid, 0.2);
    const wanted spindle = {"spindle", 1000, 2, 1, true, 6, 40, 0.6};
    check_quads_off(bipyramid_of(4, 1.5, -2.5), &spindle, 0.2);
}

/** A wheel of height 0.3 with teeth; its caps are fans, in which the triangles at the radial edges of the teeth have no height. */
static qm_mesh wheel(int teeth)
{
    static const double turn[4] = {0.0, 0.3, 0.3, 0.7}, radius[4] = {0.8, 0.8, 1.0, 1.0};
    uint32_t rim = 5 * (uint32_t)teeth;
    qm_mesh m = qm_shape_make(2 * rim + 2, 4 * rim);
    for (uint32_t i = 0; i < rim; i++) {
        bool is_last = i % 5 == 4;
        double angle = 2.0 * PI * (i / 5 + (is_last ? 0.7 : turn[i % 5])) / teeth,
               r = is_last ? 0.8 : radius[i % 5];
        for (uint32_t top = 0; top < 2; top++) {
            double *p = m.positions + 3 * (size_t)(top * rim + i);
            p[0] = r * cos(angle), p[1] = r * sin(angle), p[2] = 0.3 * top;
        }
    }
    for (uint32_t top = 0; top < 2; top++) {
        double *p = m.positions + 3 * (size_t)(2 * rim + top);
        p[0] = p[1] = 0.0, p[2] = 0.3 * top;
    }
    for (uint32_t i = 0; i < rim; i++) {
        uint32_t j = (i + 1) % rim;
        const uint32_t rows[4][4] = {{i, j, rim + j, QM_NO_INDEX},
                                     {i, rim + j, rim + i, QM_NO_INDEX},
                                     {j, i, 2 * rim, QM_NO_INDEX},
                                     {rim + i, rim + j, 2 * rim + 1, QM_NO_INDEX}};
        memcpy(m.faces + 16 * (size_t)i, rows, sizeof rows);
    }
    return m;
}

/** The length of the features of a mesh. */
static double feature_length(const qm_mesh *mesh)
{
    qm_context ctx = qm_context_make();
    qm_features features;
    const qm_features_options options = {.angle = 40.0, .shortest = 0.1};
    double sum = 0.0;
    assert_int_equal(qm_features_find(&ctx, mesh, &options, &features), QM_OK);
    for (size_t i = 0; i < features.edge_count; i++)
        sum += qm_vec_distance(qm_vec_load(features.points + 3 * (size_t)features.edges[i][0]),
                               qm_vec_load(features.points + 3 * (size_t)features.edges[i][1]));
    qm_features_reset(&ctx, &features);
    return sum;
}

/** A crease beside a triangle without a height was not found: a tenth of the quads were folded. */
static void slivers_hide_no_creases(void **state)
{
    (void)state;
    const wanted teeth = {"wheel of 8 teeth", 1200, 2, 1, true, 40, 90, 0.1};
    check_quads(wheel(8), &teeth);
    qm_mesh mesh = wheel(8);
    double turn = PI / 4.0, flat = 2.0 * 0.8 * sin(0.15 * turn), tip = 2.0 * sin(0.2 * turn);
    double one =
        2.0 * (2.0 * flat + tip + 0.4) + 4 * 0.3; /* both rims of a tooth, and its edges between them */
    QM_CHECK(fabs(feature_length(&mesh) - 8 * one) < 1e-9, "features of %.17g, not %.17g",
             feature_length(&mesh), 8 * one);
    qm_shape_free(&mesh);
}

/** Where quads were finer than triangles, edges between facets of a rounded surface were creases, with loose ends all over. */
static void facets_are_no_creases(void **state)
{
    (void)state;
    const wanted facets = {"ellipsoid of facets", 8000, 2, 1, true, 8, 60, 1.5};
    check_quads(triangles_of(cube_grid(10, to_facets)), &facets);
}

/** A flat star of triangles from its middle; every second corner lies at a radius. */
static qm_mesh star(uint32_t points, double radius)
{
    qm_mesh m = qm_shape_make(2 * points + 1, 2 * points);
    for (uint32_t i = 0; i < 2 * points; i++) {
        double angle = PI * i / points + 0.3, r = i % 2 == 0 ? 1.0 : radius;
        double *p = m.positions + 3 * (size_t)i;
        p[0] = r * cos(angle), p[1] = r * sin(angle), p[2] = 0.0;
        const uint32_t row[4] = {i, (i + 1) % (2 * points), 2 * points, QM_NO_INDEX};
        memcpy(m.faces + 4 * (size_t)i, row, sizeof row);
    }
    memset(m.positions + 6 * (size_t)points, 0, 3 * sizeof *m.positions);
    return m;
}

/** A quad that was folded over a reflex corner was taken for that of an acute one. */
static void reflex_corners_have_room(void **state)
{
    (void)state;
    for (size_t quads = 400; quads <= 600; quads += 100) {
        const wanted six = {"star of six points", quads, 1, 1, false, 6, 14, 1e-3};
        check_quads(star(6, 0.35), &six);
    }
    const wanted five = {"star of five points", 400, 1, 1, false, 6, 12, 1e-3};
    check_quads(star(5, 0.2), &five);
}

/** A screw of three turns without its ends: its creases run into these at 4 degrees. */
static void screw_point(const void *user, double u, double v, double out[3])
{
    (void)user;
    double turn = v + 3.0 * u, radius = 1.0 + 0.4 * fabs(turn - floor(turn) - 0.5);
    out[0] = radius * cos(2.0 * PI * v);
    out[1] = radius * sin(2.0 * PI * v);
    out[2] = 1.2 * u;
}

/** Two thirds of the quads were missing, and a third of the rest folded: no row fits between a crease and the boundary. */
static void creases_that_leave_no_room_go(void **state)
{
    (void)state;
    for (size_t quads = 600; quads <= 1000; quads += 200) {
        const wanted screw = {"screw", quads, 0, 1, false, 0, 12, 0.7};
        check_quads(triangles_of(qm_shape_grid(60, 24, false, true, screw_point, NULL)), &screw);
    }
}

/** A vertex of a straight boundary with one quad left that without a shape. */
static void straight_boundaries_have_two_quads(void **state)
{
    (void)state;
    const wanted five = {"star of five points", 1000, 1, 1, false, 5, 14, 1e-3};
    check_quads_off(star(5, 0.2), &five, 0.12);
    const wanted six = {"star of six points", 1000, 1, 1, false, 6, 18, 1e-3};
    check_quads_off(star(6, 0.35), &six, 0.2);
}

static void open_shapes_keep_their_boundaries(void **state)
{
    (void)state;
    const wanted plane = {"plane", 400, 1, 1, false, 0, 0, 1e-3};
    check_quads(triangles_of(qm_shape_plane(13, 0.5)), &plane);
    const wanted saddle = {"saddle", 400, 1, 1, false, 0, 12, 0.3};
    check_quads(triangles_of(qm_shape_saddle(20)), &saddle);
    const wanted strip = {"twisted strip", 600, 1, 1, false, 0, 12, 0.3};
    check_quads(triangles_of(qm_shape_strip(60, 15, 3.0)), &strip);
    for (double length = 200.0; length <= 3000.0; length *= 15.0) {
        qm_mesh ribbon = triangles_of(qm_shape_plane(20, 0.0));
        for (size_t v = 0; v < ribbon.vertex_count; v++)
            ribbon.positions[3 * v] *= length;
        const wanted narrow = {"ribbon narrower than a quad", 100, 1, 1, false, 0, 0, 1e-3};
        check_quads_off(ribbon, &narrow, 0.2);
    }
    const wanted moebius = {"slit Moebius strip", 600, 1, 1, false, 0, 20, 0.4};
    check_quads(triangles_of(qm_shape_grid(80, 12, false, false, moebius_point, NULL)), &moebius);
}

static void components_stay_apart(void **state)
{
    (void)state;
    qm_mesh a = cube_grid(12, to_sphere), b = cube_grid(3, to_sphere);
    qm_mesh both = qm_shape_make(a.vertex_count + b.vertex_count, a.face_count + b.face_count);
    memcpy(both.positions, a.positions, 3 * a.vertex_count * sizeof(double));
    memcpy(both.faces, a.faces, 4 * a.face_count * sizeof(uint32_t));
    for (size_t i = 0; i < 3 * b.vertex_count; i++)
        both.positions[3 * a.vertex_count + i] = 0.01 * b.positions[i] + 3.0;
    for (size_t i = 0; i < 4 * b.face_count; i++)
        both.faces[4 * a.face_count + i] = (uint32_t)a.vertex_count + b.faces[i];
    qm_shape_free(&a);
    qm_shape_free(&b);
    const wanted w = {"two spheres", 600, 4, 2, true, 16, 40, 0.15};
    check_quads(both, &w);
}

/** Each face of a sphere of cells with vertices of its own, as files have them that keep a normal for each corner. */
/** Each face by itself, with vertices of its own. */
static qm_mesh loose_faces_of(const qm_mesh *m)
{
    qm_mesh apart = qm_shape_make(4 * m->face_count, m->face_count);
    for (size_t c = 0; c < 4 * m->face_count; c++) {
        memcpy(apart.positions + 3 * c, m->positions + 3 * (size_t)m->faces[c], 3 * sizeof(double));
        apart.faces[c] = (uint32_t)c;
    }
    return apart;
}

static void turn_face(const qm_mesh *m, size_t face)
{
    uint32_t *c = m->faces + 4 * face, other = c[1];
    c[1] = c[3], c[3] = other;
}

/** Six times the volume that the quads of a surface enclose. */
static double volume_of_quads(const qm_mesh *surface, size_t quads)
{
    qm_context ctx = qm_context_make();
    qm_mesh made = make_quads(&ctx, surface, quads, 1);
    double sum = 0.0;
    for (size_t f = 0; f < made.face_count; f++) {
        qm_vec p[4];
        for (int k = 0; k < 4; k++)
            p[k] = qm_vec_load(made.positions + 3 * (size_t)made.faces[4 * f + (size_t)k]);
        for (int k = 1; k < 3; k++)
            sum += qm_vec_dot(p[0], qm_vec_cross(p[k], p[k + 1]));
    }
    qm_mesh_reset(&ctx, &made);
    return sum;
}

/** Where neighbours look different ways each edge between them was a boundary of the quads. */
static void faces_that_look_either_way_are_turned(void **state)
{
    (void)state;
    const wanted sphere = {"sphere of turned faces", 600, 2, 1, true, 8, 20, 0.15};
    for (int is_loose = 0; is_loose < 2; is_loose++)
        for (uint64_t run = 0; run < 3; run++) {
            qm_random random = qm_random_make(qm_check_seed(), run);
            qm_mesh whole = cube_grid(12, to_sphere),
                    m = is_loose ? loose_faces_of(&whole) : qm_shape_copy(&whole);
            for (size_t f = 0; f < m.face_count; f++)
                if (qm_random_bits(&random) >> 63) turn_face(&m, f);
            qm_shape_free(&whole);
            check_quads(m, &sphere);
        }
    /* the greater part stays as it is, whichever way that is */
    qm_mesh whole = cube_grid(12, to_sphere);
    for (size_t f = 0; f < whole.face_count; f += 3)
        turn_face(&whole, f);
    QM_CHECK(volume_of_quads(&whole, 400) > 24.0, "volume %g", volume_of_quads(&whole, 400) / 6.0);
    for (size_t f = 0; f < whole.face_count; f++)
        turn_face(&whole, f);
    QM_CHECK(volume_of_quads(&whole, 400) < -24.0, "volume %g", volume_of_quads(&whole, 400) / 6.0);
    qm_shape_free(&whole);
}

static void seams_close(void **state)
{
    (void)state;
    qm_mesh whole = cube_grid(12, to_sphere), apart = loose_faces_of(&whole);
    qm_shape_free(&whole);
    const wanted sphere = {"sphere of loose faces", 600, 2, 1, true, 8, 20, 0.15};
    check_quads(apart, &sphere);
    /* Four triangles at one edge: which belong together cannot be told, and none are joined. */
    const double corners[][3] = {{0, 0, 0}, {0, 0, 1}, {1, 0, 0.5}, {0, 1, 0.5}, {-1, 0, 0.5}, {0, -1, 0.5}};
    qm_mesh fan = qm_shape_make(12, 4);
    for (uint32_t f = 0; f < 4; f++) {
        const double *at[3] = {corners[f % 2], corners[1 - f % 2], corners[2 + f]};
        for (uint32_t k = 0; k < 3; k++) {
            memcpy(fan.positions + 3 * (3 * f + k), at[k], sizeof corners[0]);
            fan.faces[4 * f + k] = 3 * f + k;
        }
        fan.faces[4 * f + 3] = QM_NO_INDEX;
    }
    qm_context ctx = qm_context_make();
    qm_mesh quads = make_quads(&ctx, &fan, 200, 1);
    qm_topology t = qm_topology_find(&quads);
    QM_CHECK(t.components == 4, "%zu components", t.components);
    qm_mesh_reset(&ctx, &quads);
    qm_shape_free(&fan);
}

static void check_soup(qm_mesh soup, size_t wanted_quads, uint64_t run)
{
    qm_context ctx = qm_context_make();
    qm_bvh *bvh;
    qm_mesh out;
    qm_quads_options options = qm_quads_options_default();
    options.quads = wanted_quads;
    assert_int_equal(qm_bvh_build(&ctx, &soup, QM_BVH_TARGET, 1, &bvh), QM_OK);
    qm_status status = qm_quads_make(&ctx, bvh, &options, &out, NULL);
    QM_CHECK(status == QM_OK || status == QM_E_EMPTY, "seed %llu, run %llu: %s",
             (unsigned long long)qm_check_seed(), (unsigned long long)run, ctx.message);
    if (status == QM_OK) {
        qm_topology t = qm_topology_find(&out);
        QM_CHECK(t.is_all_quads && t.is_manifold && t.is_oriented,
                 "seed %llu, run %llu: quads %d, manifold %d", (unsigned long long)qm_check_seed(),
                 (unsigned long long)run, t.is_all_quads, t.is_manifold);
    }
    qm_mesh_reset(&ctx, &out);
    qm_bvh_destroy(&ctx, bvh);
    qm_shape_free(&soup);
}

static void any_soup_becomes_manifold_quads(void **state)
{
    (void)state;
    for (uint64_t run = 0; run < 2 * (uint64_t)QM_SOUP_STYLE_COUNT; run++) {
        qm_random random = qm_random_make(qm_check_seed(), run);
        check_soup(qm_shape_soup(&random, 12, QM_SOUP_MIXED, (qm_soup_style)(run % QM_SOUP_STYLE_COUNT), 0.3),
                   300, run);
    }
}

/** A fin on an edge inside a surface makes it a slit, whose two sides have both vertices in common. */
static void fins_leave_slits(void **state)
{
    (void)state;
    for (uint64_t run = 0; run < 12; run++) {
        qm_random random = qm_random_make(qm_check_seed(), run);
        qm_mesh ball = triangles_of(cube_grid(3 + (int)(run % 3), to_sphere));
        size_t fins = 1 + ball.face_count / 8;
        qm_mesh m = qm_shape_make(ball.vertex_count + fins, ball.face_count + fins);
        memcpy(m.positions, ball.positions, 3 * ball.vertex_count * sizeof *m.positions);
        memcpy(m.faces, ball.faces, 4 * ball.face_count * sizeof *m.faces);
        for (size_t i = 0; i < fins; i++) {
            const uint32_t *c = ball.faces + 4 * qm_random_below(&random, ball.face_count);
            size_t k = qm_random_below(&random, 3), tip = ball.vertex_count + i;
            const uint32_t row[4] = {c[k], c[(k + 1) % 3], (uint32_t)tip, QM_NO_INDEX};
            memcpy(m.faces + 4 * (ball.face_count + i), row, sizeof row);
            for (size_t x = 0; x < 3; x++)
                m.positions[3 * tip + x] =
                    0.7 * (ball.positions[3 * row[0] + x] + ball.positions[3 * row[1] + x]);
        }
        qm_shape_free(&ball);
        check_soup(m, 100 + 50 * run, run);
    }
}

static qm_mesh sheet_of_two_sides(void)
{
    const double corners[9] = {0, 0, 0, 2, 0, 0, 0.5, 1.5, 0};
    const uint32_t rows[8] = {0, 1, 2, QM_NO_INDEX, 0, 2, 1, QM_NO_INDEX};
    qm_mesh sheet = qm_shape_make(3, 2);
    memcpy(sheet.positions, corners, sizeof corners);
    memcpy(sheet.faces, rows, sizeof rows);
    return sheet;
}

/** Half-edges that lead from one vertex to another where another half-edge does. */
static size_t count_doubles(const qm_trimesh *m)
{
    size_t count = 0;
    for (uint32_t h = 0; h < 3 * m->face_count; h++)
        for (uint32_t k = 0; k < 3 * m->face_count; k++)
            count += k != h && m->from[k] == m->from[h] && qm_trimesh_to(m, k) == qm_trimesh_to(m, h);
    return count;
}

/** A triangle of two sides: from the middle of one of its edges two edges led to the corner across, which quads could not tell apart. */
static void sheets_of_two_sides_are_split(void **state)
{
    (void)state;
    qm_mesh sheet = sheet_of_two_sides();
    qm_context ctx = qm_context_make();
    const uint32_t corner[2][3] = {{0, 1, 2}, {0, 2, 1}};
    for (int is_split = 0; is_split < 2; is_split++) {
        qm_trimesh m;
        uint32_t vertex;
        assert_int_equal(qm_trimesh_build(&ctx, sheet.positions, 3, corner, 2, &m), QM_OK);
        if (is_split) assert_int_equal(qm_trimesh_split_doubles(&ctx, &m), QM_OK);
        QM_CHECK(count_doubles(&m) == 0, "%zu doubles", count_doubles(&m));
        qm_vec middle = qm_vec_mix(m.position[m.from[0]], m.position[qm_trimesh_to(&m, 0)], 0.5);
        assert_int_equal(qm_trimesh_split(&ctx, &m, 0, middle, &vertex), QM_OK);
        QM_CHECK((count_doubles(&m) == 0) == is_split, "split %d: %zu doubles", is_split, count_doubles(&m));
        qm_trimesh_reset(&ctx, &m);
    }
    qm_shape_free(&sheet);
}

static void sheets_of_two_sides_become_closed_quads(void **state)
{
    (void)state;
    for (size_t quads = 30; quads <= 240; quads *= 2) {
        qm_mesh sheet = sheet_of_two_sides();
        qm_context ctx = qm_context_make();
        qm_mesh made = make_quads(&ctx, &sheet, quads, 1);
        qm_topology t = qm_topology_find(&made);
        QM_CHECK(t.is_all_quads && t.is_manifold && t.is_oriented && t.euler == 2 && t.boundary_edges == 0,
                 "%zu quads: manifold %d, Euler number %td", made.face_count, t.is_manifold, t.euler);
        qm_mesh_reset(&ctx, &made);
        qm_shape_free(&sheet);
    }
}

static void threads_do_not_change_the_mesh(void **state)
{
    (void)state;
    qm_mesh surface = triangles_of(cube_grid(12, to_bumps)), made[2];
    qm_context ctx = qm_host_context();
    for (int i = 0; i < 2; i++)
        made[i] = make_quads(&ctx, &surface, 700, 1 + 3 * i);
    assert_int_equal(made[0].face_count, made[1].face_count);
    assert_int_equal(made[0].vertex_count, made[1].vertex_count);
    assert_memory_equal(made[0].faces, made[1].faces, 4 * made[0].face_count * sizeof(uint32_t));
    assert_memory_equal(made[0].positions, made[1].positions, 3 * made[0].vertex_count * sizeof(double));
    qm_mesh_reset(&ctx, &made[0]);
    qm_mesh_reset(&ctx, &made[1]);
    qm_shape_free(&surface);
}

static void bad_input_is_told(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_random random = qm_random_make(qm_check_seed(), 0);
    qm_mesh shape[4] = {qm_shape_points(&random, 20), qm_shape_plane(2, 0.0), qm_shape_copies(3),
                        qm_shape_cube(1e90)};
    for (size_t v = 0; v < shape[2].vertex_count; v++) /* a triangle without area */
        for (size_t k = 0; k < 3; k++)
            shape[2].positions[3 * v + k] = k == 0 ? (double)v : 0.0;
    const qm_status expected[4] = {QM_E_ARGUMENT, QM_E_ARGUMENT, QM_E_EMPTY, QM_E_SCALE};
    for (int i = 0; i < 4; i++) {
        qm_bvh *bvh;
        qm_mesh out;
        qm_quads_options options = qm_quads_options_default();
        options.quads = i == 1 ? 0 : 100;
        assert_int_equal(qm_bvh_build(&ctx, &shape[i], QM_BVH_TARGET, 1, &bvh), QM_OK);
        assert_int_equal(qm_quads_make(&ctx, bvh, &options, &out, NULL), expected[i]);
        assert_null(out.positions);
        qm_bvh_destroy(&ctx, bvh);
        qm_shape_free(&shape[i]);
    }
}

static void memory_and_cancel_end_the_call(void **state)
{
    (void)state;
    qm_mesh surface = triangles_of(cube_grid(4, to_box));
    qm_context ctx = qm_context_make();
    qm_bvh *bvh;
    assert_int_equal(qm_bvh_build(&ctx, &surface, QM_BVH_TARGET, 1, &bvh), QM_OK);
    qm_quads_options options = qm_quads_options_default();
    options.quads = 60;
    qm_status status = QM_E_NO_MEMORY;
    for (size_t fail_at = 0; status != QM_OK; fail_at++) {
        qm_failing_allocator memory = {.fail_at = fail_at};
        qm_context poor = qm_context_make();
        qm_mesh out;
        poor.allocator = qm_failing_allocator_hook(&memory);
        status = qm_quads_make(&poor, bvh, &options, &out, NULL);
        QM_CHECK(status == QM_OK || status == QM_E_NO_MEMORY, "call %zu: %d", fail_at, status);
        qm_mesh_reset(&poor, &out);
        QM_CHECK(memory.live_blocks == 0 && !memory.mismatched, "call %zu leaves %zu blocks, mismatched %d",
                 fail_at, memory.live_blocks, memory.mismatched);
    }
    atomic_bool is_canceled = true;
    ctx.cancel = &is_canceled;
    qm_mesh out;
    assert_int_equal(qm_quads_make(&ctx, bvh, &options, &out, NULL), QM_E_CANCELED);
    assert_null(out.faces);
    qm_bvh_destroy(&ctx, bvh);
    qm_shape_free(&surface);
}

/** Wherever the engine polls, it ends there, with nothing; and it polls in every sweep of the fields. */
static void every_poll_can_end_the_call(void **state)
{
    (void)state;
    qm_mesh surface = triangles_of(cube_grid(6, to_box));
    qm_context ctx = qm_context_make();
    qm_bvh *bvh;
    assert_int_equal(qm_bvh_build(&ctx, &surface, QM_BVH_TARGET, 1, &bvh), QM_OK);
    qm_quads_options options = qm_quads_options_default();
    options.quads = 200;
    qm_poll_cancel c;
    qm_context watched = qm_poll_cancel_context(&c, SIZE_MAX);
    qm_mesh out;
    assert_int_equal(qm_quads_make(&watched, bvh, &options, &out, NULL), QM_OK);
    qm_mesh_reset(&watched, &out);
    size_t all = c.polls;
    QM_CHECK(all > 100, "%zu polls", all);
    for (size_t at = 0; at < all; at += 1 + at / 16) {
        qm_failing_allocator memory = {.fail_at = SIZE_MAX};
        watched = qm_poll_cancel_context(&c, at);
        watched.allocator = qm_failing_allocator_hook(&memory);
        qm_status status = qm_quads_make(&watched, bvh, &options, &out, NULL);
        QM_CHECK(status == QM_E_CANCELED, "poll %zu: %d", at, status);
        QM_CHECK(c.polls < at + 24, "poll %zu: %zu more", at, c.polls - at);
        assert_null(out.faces);
        QM_CHECK(memory.live_blocks == 0, "poll %zu leaves %zu blocks", at, memory.live_blocks);
    }
    qm_bvh_destroy(&ctx, bvh);
    qm_shape_free(&surface);
}

/* ---- the triangle mesh ---- */

/** Walls that are far nearer to each other than a quad is long stay two, whichever way they look. */
static void thin_walls_stay_apart(void **state)
{
    (void)state;
    const double part[] = {0.1, 0.03, 0.01, 0.003};
    for (int i = 0; i < 4; i++) {
        thickness = part[i];
        const wanted plate = {"plate", 500, 2, 1, true, 8, 8, 1e-3};
        check_quads(triangles_of(qm_shape_box(2.0, 2.0, 2.0 * thickness)), &plate);
        check_quads(triangles_of(cube_grid(10, to_plate)), &plate);
        const wanted cap = {"bent plate", 1500, 2, 1, true, 8, 20, 0.03};
        qm_mesh bent = triangles_of(cube_grid(24, to_cap));
        check_quads(qm_shape_reversed(&bent), &cap);
        check_quads(bent, &cap);
    }
}

/** A plate of cells by two, each a square with a round hole in its middle; lengths are in sides of a quad. */
typedef struct pierced {
    uint32_t across, along, sides; /* cells, and corners of each hole: a multiple of 4 */
    double cell, diameter, thickness, chamfer;
} pierced;

/** The vertices of a pierced plate: points of the sides of cells, below and above, then rings of holes. */
typedef struct pierced_maker {
    const pierced *p;
    uint32_t *at; /* of each point of the lattice that the sides of cells lie on, for each level */
    uint32_t vertices, faces;
    qm_mesh m;
} pierced_maker;

static uint32_t add_point(pierced_maker *k, double x, double y, double z)
{
    double *to = k->m.positions + 3 * (size_t)k->vertices;
    to[0] = x, to[1] = y, to[2] = z;
    return k->vertices++;
}

/** looks_back: the corners are in clockwise order */
static void add_quad(pierced_maker *k, uint32_t a, uint32_t b, uint32_t c, uint32_t d, bool looks_back)
{
    const uint32_t row[4] = {a, looks_back ? d : b, c, looks_back ? b : d};
    memcpy(k->m.faces + 4 * (size_t)k->faces++, row, sizeof row);
}

/** The point of a cell's sides that is so many steps from its first corner, counterclockwise. */
static uint32_t *side_point(pierced_maker *k, uint32_t i, uint32_t j, uint32_t step, uint32_t level)
{
    uint32_t n = k->p->sides / 4, side = step / n % 4, off = step % n;
    uint32_t x = i * n + (side == 0 ? off : side == 1 ? n : side == 2 ? n - off : 0);
    uint32_t y = j * n + (side == 0 ? 0 : side == 1 ? off : side == 2 ? n : n - off);
    uint32_t columns = k->p->across * n + 1, rows = k->p->along * n + 1;
    uint32_t *at = &k->at[(level * rows + y) * columns + x];
    double scale = k->p->cell / n;
    if (*at == QM_NO_INDEX) *at = add_point(k, scale * x, scale * y, level * k->p->thickness);
    return at;
}

static void add_cell(pierced_maker *k, uint32_t i, uint32_t j)
{
    enum { MOST_SIDES = 64 };
    const pierced *p = k->p;
    uint32_t ring[4][MOST_SIDES], rings = p->chamfer > 0.0 ? 4 : 2, sides = p->sides, n = sides / 4;
    double r = 0.5 * p->diameter, wide = r + p->chamfer, x = (i + 0.5) * p->cell, y = (j + 0.5) * p->cell;
    assert_true(sides <= MOST_SIDES && sides % 4 == 0);
    /* from below to above, the walls between rings look inwards */
    const double radius[4] = {wide, r, r, wide};
    const double z[4] = {0.0, p->chamfer, p->thickness - p->chamfer, p->thickness};
    for (uint32_t g = 0; g < rings; g++)
        for (uint32_t s = 0; s < sides; s++) {
            uint32_t of = rings == 4 ? g : 3 * g;
            double angle = 2.0 * PI * s / sides - 0.75 * PI;
            ring[g][s] = add_point(k, x + radius[of] * cos(angle), y + radius[of] * sin(angle), z[of]);
        }
    for (uint32_t s = 0; s < sides; s++) {
        uint32_t t = (s + 1) % sides;
        for (uint32_t level = 0; level < 2; level++) {
            const uint32_t *inner = ring[level * (rings - 1)];
            uint32_t a = *side_point(k, i, j, s, level), b = *side_point(k, i, j, t, level);
            add_quad(k, a, b, inner[t], inner[s], level == 0);
        }
        for (uint32_t g = 0; g + 1 < rings; g++)
            add_quad(k, ring[g][s], ring[g][t], ring[g + 1][t], ring[g + 1][s], true);
        const bool is_rim[4] = {j == 0, i + 1 == p->across, j + 1 == p->along, i == 0};
        if (is_rim[s / n])
            add_quad(k, *side_point(k, i, j, s, 0), *side_point(k, i, j, t, 0), *side_point(k, i, j, t, 1),
                     *side_point(k, i, j, s, 1), false);
    }
}

static qm_mesh pierced_plate(const pierced *p)
{
    uint32_t n = p->sides / 4, cells = p->across * p->along;
    size_t lattice = 2 * (size_t)(p->across * n + 1) * (p->along * n + 1);
    pierced_maker k = {.p = p, .at = malloc(lattice * sizeof *k.at)};
    assert_non_null(k.at);
    memset(k.at, 0xff, lattice * sizeof *k.at);
    k.m = qm_shape_make(lattice + 4 * (size_t)cells * p->sides, 7 * (size_t)cells * p->sides);
    for (uint32_t j = 0; j < p->along; j++)
        for (uint32_t i = 0; i < p->across; i++)
            add_cell(&k, i, j);
    k.m.vertex_count = k.vertices, k.m.face_count = k.faces;
    free(k.at);
    return k.m;
}

static ptrdiff_t euler_of(const pierced *p)
{
    return 2 - 2 * (ptrdiff_t)p->across * (ptrdiff_t)p->along;
}

static void check_pierced(const pierced *p)
{
    char name[128];
    snprintf(name, sizeof name, "plate of %g, %u x %u holes of %u sides, diameter %g, chamfer %g",
             p->thickness, p->across, p->along, p->sides, p->diameter, p->chamfer);
    qm_mesh plate = pierced_plate(p);
    qm_topology t = qm_topology_find(&plate);
    QM_CHECK(t.is_manifold && t.is_oriented && t.euler == euler_of(p) && t.boundary_edges == 0,
             "%s: Euler number %td", name, t.euler);
    /* a hole of two quads across is a polygon of few sides */
    double most_distance = p->diameter < 3.0 ? 0.75 : 0.35;
    size_t irregular = 8 + 12 * (size_t)p->across * p->along;
    const wanted w = {name,         (size_t)lrint(area_of(&plate)), euler_of(p), 1, true, 8, irregular,
                      most_distance};
    check_quads_off(triangles_of(plate), &w, 0.08);
}

/** The i-th of 18 plates with holes of a diameter; false if their chamfers leave no wall between them. */
static bool next_pierced(int i, double diameter, pierced *p)
{
    static const uint32_t sides[] = {12, 16, 24};
    static const double chamfer[] = {0.0, 0.25, 0.5};
    *p = (pierced){.across = 3, .along = 2, .sides = sides[i % 3], .diameter = diameter};
    p->chamfer = chamfer[i / 3 % 3], p->thickness = 1.0 + i / 9;
    p->cell = fmax(4.0, p->diameter + 3.0);
    return 2.0 * p->chamfer < p->thickness;
}

/** Round holes of few quads, with and without a chamfer, closed, or folded, where vertices on rims were not centred before others. */
static void small_holes_stay_open(void **state)
{
    (void)state;
    static const double diameter[] = {1.5, 2.0, 3.0, 4.0};
    for (int i = 0; i < 4 * 18; i++) {
        pierced p;
        bool is_left_out = !qm_check_long() && i % 2 == 1;
        if (!is_left_out && next_pierced(i % 18, diameter[i / 18], &p)) check_pierced(&p);
    }
}

/** Holes of one quad across stay open, too, but there is not always room for quads that are not folded. */
static void holes_of_one_quad_stay_open(void **state)
{
    (void)state;
    int count = 0, folded = 0;
    for (int i = 0; i < 18; i++) {
        pierced p;
        if (!next_pierced(i, 1.0, &p)) continue;
        qm_mesh plate = pierced_plate(&p), surface = triangles_of(plate);
        qm_context ctx = qm_context_make();
        qm_mesh quads = make_quads(&ctx, &surface, (size_t)lrint(area_of(&surface)), 1);
        qm_topology t = qm_topology_find(&quads);
        QM_CHECK(t.is_all_quads && t.is_manifold && t.is_oriented && t.euler == euler_of(&p) &&
                     t.boundary_edges == 0,
                 "%u sides, chamfer %g, thickness %g: Euler number %td", p.sides, p.chamfer, p.thickness,
                 t.euler);
        count++;
        folded += qm_topology_count_folded(&quads) > 0;
        qm_mesh_reset(&ctx, &quads);
        qm_shape_free(&surface);
    }
    QM_CHECK(5 * folded <= 2 * count, "%d of %d have folded quads", folded, count);
}

/** Every half-edge and its twin run between the same vertices; the Euler number by counting. */
static ptrdiff_t check_trimesh(const qm_trimesh *m, uint64_t seed)
{
    ptrdiff_t faces = 0, halves = 0, pairs = 0, vertices = 0;
    for (uint32_t h = 0; h < 3 * m->face_count; h++) {
        if (!qm_trimesh_has_face(m, h / 3)) continue;
        uint32_t t = m->twin[h];
        faces += h % 3 == 0;
        halves++;
        QM_CHECK(m->out[m->from[h]] != QM_NO_INDEX, "seed %llu: half-edge %u of a vertex that is gone",
                 (unsigned long long)seed, h);
        if (t == QM_NO_INDEX) continue;
        pairs++;
        QM_CHECK(m->twin[t] == h && m->from[t] == qm_trimesh_to(m, h) && m->from[h] == qm_trimesh_to(m, t),
                 "seed %llu: half-edge %u", (unsigned long long)seed, h);
        QM_CHECK(m->is_feature[t] == m->is_feature[h], "seed %llu: half-edge %u", (unsigned long long)seed,
                 h);
    }
    for (uint32_t v = 0; v < m->vertex_count; v++) {
        if (m->out[v] == QM_NO_INDEX) continue;
        vertices++;
        QM_CHECK(m->from[m->out[v]] == v, "seed %llu: vertex %u", (unsigned long long)seed, v);
    }
    return vertices - (halves - pairs / 2) + faces;
}

static void random_edits_keep_the_topology(void **state)
{
    (void)state;
    for (uint64_t run = 0; run < 12; run++) {
        qm_random random = qm_random_make(qm_check_seed(), run);
        bool is_open = run % 2 == 1;
        qm_mesh surface = triangles_of(is_open ? qm_shape_saddle(4) : cube_grid(3, to_sphere));
        qm_context ctx = qm_context_make();
        uint32_t(*corner)[3] = malloc(surface.face_count * sizeof *corner);
        assert_non_null(corner);
        for (size_t f = 0; f < surface.face_count; f++)
            memcpy(corner[f], surface.faces + 4 * f, sizeof *corner);
        qm_trimesh m;
        assert_int_equal(qm_trimesh_build(&ctx, surface.positions, surface.vertex_count,
                                          (const uint32_t(*)[3])corner, surface.face_count, &m),
                         QM_OK);
        for (int edit = 0; edit < 600; edit++) {
            uint32_t h = (uint32_t)qm_random_below(&random, 3 * m.face_count), vertex;
            if (!qm_trimesh_has_face(&m, h / 3)) continue;
            switch (qm_random_below(&random, edit < 200 ? 4 : 7)) {
            case 0:
                assert_int_equal(qm_trimesh_split(&ctx, &m, h, m.position[m.from[h]], &vertex), QM_OK);
                break;
            case 1:
                assert_int_equal(qm_trimesh_split_face(&ctx, &m, h / 3, &vertex), QM_OK);
                break;
            case 2:
                if (qm_trimesh_can_flip(&m, h)) qm_trimesh_flip(&m, h);
                break;
            case 3:
                if (edit % 50 == 0) qm_trimesh_compact(&m);
                break;
            default:
                if (qm_trimesh_can_collapse(&m, h)) qm_trimesh_collapse(&m, h);
                break;
            }
            ptrdiff_t euler = check_trimesh(&m, qm_check_seed());
            QM_CHECK(euler == (is_open ? 1 : 2), "seed %llu, run %llu, edit %d: Euler number %td",
                     (unsigned long long)qm_check_seed(), (unsigned long long)run, edit, euler);
        }
        qm_trimesh_reset(&ctx, &m);
        free(corner);
        qm_shape_free(&surface);
    }
}

/** What lies in a cycle of three edges, one of them without a step, kept that edge, and quads without room were made of it. */
static void pockets_are_cut(void **state)
{
    (void)state;
    enum { SIDE = 5, GRID = SIDE * SIDE, QUADS = (SIDE - 1) * (SIDE - 1) };
    qm_context ctx = qm_context_make();
    double positions[3 * GRID];
    uint32_t corner[2 * QUADS][3];
    for (uint32_t v = 0; v < GRID; v++) {
        const double at[3] = {v % SIDE, v / SIDE, 0.0};
        memcpy(positions + 3 * v, at, sizeof at);
    }
    for (uint32_t q = 0; q < QUADS; q++) {
        uint32_t a = q / (SIDE - 1) * SIDE + q % (SIDE - 1);
        const uint32_t rows[2][3] = {{a, a + 1, a + SIDE + 1}, {a, a + SIDE + 1, a + SIDE}};
        memcpy(corner[2 * q], rows, sizeof rows);
    }
    qm_trimesh m;
    assert_int_equal(qm_trimesh_build(&ctx, positions, GRID, (const uint32_t(*)[3])corner, 2 * QUADS, &m),
                     QM_OK);
    int32_t place[GRID + 2][2]; /* on the grid */
    for (uint32_t v = 0; v < GRID; v++)
        place[v][0] = (int32_t)m.position[v].x, place[v][1] = (int32_t)m.position[v].y;
    /* one vertex at the place of a corner u of an inner face, and, between these and w, another at a place that is taken */
    uint32_t f = 10, u = m.from[3 * f], x, y;
    assert_int_equal(qm_trimesh_split_face(&ctx, &m, f, &x), QM_OK);
    f = (uint32_t)m.face_count - 1; /* w u x */
    assert_true(m.from[3 * f + 1] == u && m.from[3 * f + 2] == x);
    assert_int_equal(qm_trimesh_split_face(&ctx, &m, f, &y), QM_OK);
    assert_true(x < GRID + 2 && y < GRID + 2);
    place[x][0] = place[u][0], place[x][1] = place[u][1];
    place[y][0] = place[u][0], place[y][1] = place[u][1] + 1;
    for (uint32_t h = 0; h < 3 * m.face_count; h++)
        for (int axis = 0; axis < 2; axis++)
            m.step[h][axis] = place[qm_trimesh_to(&m, h)][axis] - place[m.from[h]][axis];
    qm_quads_result r = {0};
    qm_quads_record record = {0};
    assert_int_equal(qm_quads_extract(&ctx, &m, 1.0, &r.mesh, &r.is_fixed, &r.is_feature, &record), QM_OK);
    qm_topology t = qm_topology_find(&r.mesh);
    QM_CHECK(r.mesh.face_count == QUADS && t.irregular == 0 && record.unmatched == 0,
             "%zu quads, %zu irregular vertices, %zu triangles without a partner", r.mesh.face_count,
             t.irregular, record.unmatched);
    qm_quads_result_reset(&ctx, &r);
    qm_trimesh_reset(&ctx, &m);
}

/** A tube of length gap + 2 with features a unit from both ends, all edges between which have no step along it: as many columns as
 * units round it. Returns the number of quads that are made of it; *off receives how far their features are from where they were. */
static size_t extract_pinched_tube(int32_t gap, double *off)
{
    enum { COLUMNS = 12, MOST_ROWS = 8 };
    qm_context ctx = qm_context_make();
    double positions[3 * COLUMNS * (MOST_ROWS + 1)];
    uint32_t corner[2 * COLUMNS * MOST_ROWS][3], vertices = COLUMNS * ((uint32_t)gap + 3), faces = 0;
    for (uint32_t v = 0; v < vertices; v++) {
        double angle = 2.0 * PI * (v % COLUMNS) / COLUMNS, radius = COLUMNS / (2.0 * PI);
        const double at[3] = {radius * cos(angle), radius * sin(angle), v / COLUMNS};
        memcpy(positions + 3 * (size_t)v, at, sizeof at);
    }
    for (uint32_t v = 0; v < vertices - COLUMNS; v++) {
        uint32_t next = v % COLUMNS == COLUMNS - 1 ? v + 1 - COLUMNS : v + 1;
        const uint32_t two[2][3] = {{v, next, next + COLUMNS}, {v, next + COLUMNS, v + COLUMNS}};
        memcpy(corner[faces], two, sizeof two);
        faces += 2;
    }
    qm_trimesh m;
    assert_int_equal(qm_trimesh_build(&ctx, positions, vertices, (const uint32_t(*)[3])corner, faces, &m),
                     QM_OK);
    for (uint32_t h = 0; h < 3 * m.face_count; h++) {
        const qm_vec end[2] = {m.position[m.from[h]], m.position[qm_trimesh_to(&m, h)]};
        int32_t row[2], place[2];
        for (int k = 0; k < 2; k++) {
            row[k] = (int32_t)lrint(end[k].z);
            place[k] = row[k] == 0 ? 0 : row[k] <= gap + 1 ? 1 : 2;
        }
        double turned = end[0].x * end[1].y - end[0].y * end[1].x;
        m.step[h][0] = turned > 0.1 ? 1 : turned < -0.1 ? -1 : 0;
        m.step[h][1] = place[1] - place[0];
        m.is_feature[h] |= row[0] == row[1] && (row[0] == 1 || row[0] == gap + 1);
    }
    qm_quads_result r = {0};
    qm_quads_record record = {0};
    assert_int_equal(qm_quads_extract(&ctx, &m, 1.0, &r.mesh, &r.is_fixed, &r.is_feature, &record), QM_OK);
    *off = 0.0;
    for (size_t s = 0; s < 4 * r.mesh.face_count; s++) {
        if (!r.is_feature[s]) continue;
        double z = r.mesh.positions[3 * (size_t)r.mesh.faces[s] + 2], here = INFINITY;
        const double lines[4] = {0.0, 1.0, gap + 1.0, gap + 2.0};
        for (int k = 0; k < 4; k++)
            here = fmin(here, fabs(z - lines[k]));
        *off = fmax(*off, here);
    }
    size_t count = r.mesh.face_count;
    qm_quads_result_reset(&ctx, &r);
    qm_trimesh_reset(&ctx, &m);
    return count;
}

/** Creases three quads apart, between which the flow left no row, became one line halfway between them; those of a narrow chamfer do. */
static void creases_apart_are_not_pinched(void **state)
{
    (void)state;
    double off;
    size_t count = extract_pinched_tube(3, &off);
    QM_CHECK(count == 36 && off < 1e-9, "%zu quads, creases %.3g from where they were", count, off);
    count = extract_pinched_tube(1, &off);
    QM_CHECK(count == 24 && off < 0.51, "%zu quads, creases %.3g from where they were", count, off);
}

/* ---- tidying ---- */

/** Where several quads have a side in common, any two of them were paired, and walking round a vertex came back to none of its own sides. */
static void sides_of_several_quads_are_boundaries(void **state)
{
    (void)state;
    for (uint64_t run = 0; run < 200; run++) {
        qm_random random = qm_random_make(qm_check_seed(), run);
        qm_mesh ball = cube_grid(2 + (int)(run % 3), to_sphere);
        qm_context ctx = qm_context_make();
        qm_quads_result r = {0};
        /* a pair of vertices become one: sides from both to a third are then the same */
        uint32_t kept = (uint32_t)qm_random_below(&random, ball.vertex_count),
                 gone = (uint32_t)qm_random_below(&random, ball.vertex_count);
        size_t faces = ball.face_count;
        r.mesh = (qm_mesh){.vertex_count = ball.vertex_count, .face_count = faces};
        r.mesh.positions = qm_context_alloc(&ctx, ball.vertex_count, 3 * sizeof(double));
        r.mesh.faces = qm_context_alloc(&ctx, faces, 4 * sizeof(uint32_t));
        r.is_fixed = qm_context_alloc(&ctx, ball.vertex_count, 1);
        r.is_feature = qm_context_alloc(&ctx, faces, 4);
        memcpy(r.mesh.positions, ball.positions, 3 * ball.vertex_count * sizeof(double));
        memset(r.is_fixed, 0, ball.vertex_count);
        memset(r.is_feature, 0, 4 * faces);
        for (size_t c = 0; c < 4 * faces; c++)
            r.mesh.faces[c] = ball.faces[c] == gone ? kept : ball.faces[c];
        size_t irregular = 0;
        bool has_corner_twice = false;
        for (size_t f = 0; f < faces; f++)
            for (int k = 0; k < 4; k++)
                for (int i = 0; i < k; i++)
                    has_corner_twice |= r.mesh.faces[4 * f + (size_t)k] == r.mesh.faces[4 * f + (size_t)i];
        if (!has_corner_twice) {
            assert_int_equal(qm_quads_tidy(&ctx, &r, &irregular), QM_OK);
            QM_CHECK(r.mesh.face_count > faces / 4 && r.mesh.face_count <= faces,
                     "seed %llu, run %llu: %zu quads of %zu", (unsigned long long)qm_check_seed(),
                     (unsigned long long)run, r.mesh.face_count, faces);
        }
        qm_quads_result_reset(&ctx, &r);
        qm_shape_free(&ball);
    }
}

/* ---- fitting ---- */

#define MAJOR 1.0
#define MINOR 0.4

/** Signed, from the torus of the formula, outside of it positive. */
static double torus_distance(const double p[3])
{
    return hypot(hypot(p[0], p[1]) - MAJOR, p[2]) - MINOR;
}

static void mix3(const double *a, const double *b, double share, double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = a[k] + share * (b[k] - a[k]);
}

typedef struct spread_of_distances {
    double greatest, rms;
} spread_of_distances;

/** Over points of the triangles c0 c1 c2 and c0 c2 c3 of all quads. */
static spread_of_distances measure_torus(const qm_mesh *m)
{
    enum { STEPS = 8 };
    spread_of_distances out = {0, 0};
    double count = 0.0;
    for (size_t t = 0; t < 2 * m->face_count; t++) {
        const uint32_t *c = m->faces + 4 * (t / 2);
        const double *a = m->positions + 3 * (size_t)c[0], *b = m->positions + 3 * (size_t)c[1 + t % 2],
                     *d = m->positions + 3 * (size_t)c[2 + t % 2];
        for (int i = 0; i <= STEPS; i++)
            for (int j = 0; j <= STEPS; j++) {
                double edge[3], at[3];
                mix3(b, d, (double)j / STEPS, edge);
                mix3(a, edge, (double)i / STEPS, at);
                double distance = fabs(torus_distance(at));
                out.greatest = fmax(out.greatest, distance);
                out.rms += distance * distance, count += 1.0;
            }
    }
    out.rms = sqrt(out.rms / count);
    return out;
}

/** Of the angles of quads from right ones, in degrees. */
static double mean_deviation(const qm_mesh *m)
{
    double sum = 0.0;
    for (size_t c = 0; c < 4 * m->face_count; c++) {
        const double *corner = m->positions + 3 * (size_t)m->faces[c];
        const double *next = m->positions + 3 * (size_t)m->faces[c / 4 * 4 + (c + 1) % 4];
        const double *last = m->positions + 3 * (size_t)m->faces[c / 4 * 4 + (c + 3) % 4];
        double dot = 0.0, length_a = 0.0, length_b = 0.0;
        for (int k = 0; k < 3; k++) {
            double a = next[k] - corner[k], b = last[k] - corner[k];
            dot += a * b, length_a += a * a, length_b += b * b;
        }
        sum += fabs(90.0 - acos(dot / sqrt(length_a * length_b)) * 180.0 / PI);
    }
    return sum / (4.0 * (double)m->face_count);
}

/** The torus has quads of a side of 0.2, with a sagitta of 0.0125 round its tube; the surface itself has one of 0.0005. */
static void quads_lie_on_both_sides(void **state)
{
    (void)state;
    qm_context ctx = qm_host_context();
    qm_mesh surface = triangles_of(qm_shape_torus(128, 64, MAJOR, MINOR)), out;
    qm_bvh *bvh;
    qm_quads_options options = qm_quads_options_default();
    options.quads = 400;
    assert_int_equal(qm_bvh_build(&ctx, &surface, QM_BVH_TARGET, 1, &bvh), QM_OK);
    assert_int_equal(qm_quads_make(&ctx, bvh, &options, &out, NULL), QM_OK);
    for (size_t f = 0; f < out.face_count; f++) {
        double distance[2];
        for (size_t k = 0; k < 2; k++) {
            double middle[3];
            const uint32_t *c = out.faces + 4 * f + k;
            mix3(out.positions + 3 * (size_t)c[0], out.positions + 3 * (size_t)c[2], 0.5, middle);
            distance[k] = fabs(torus_distance(middle));
        }
        QM_CHECK(distance[0] <= distance[1] + 0.002, "quad %zu: %g, and %g from the other diagonal", f,
                 distance[0], distance[1]);
    }
    double deviation = mean_deviation(&out);
    QM_CHECK(deviation < 9.0, "angles are off right ones by %g degrees", deviation);
    spread_of_distances fitted = measure_torus(&out);
    for (size_t v = 0; v < out.vertex_count; v++) { /* onto the torus */
        double *p = out.positions + 3 * v, ring = hypot(p[0], p[1]);
        double tube = hypot(ring - MAJOR, p[2]), wide = (MAJOR + (ring - MAJOR) * MINOR / tube) / ring;
        p[0] *= wide, p[1] *= wide, p[2] *= MINOR / tube;
    }
    spread_of_distances inscribed = measure_torus(&out);
    QM_CHECK(fitted.rms < 0.64 * inscribed.rms && fitted.greatest < 0.95 * inscribed.greatest,
             "rms %g, %g with vertices on the torus; greatest %g, %g", fitted.rms, inscribed.rms,
             fitted.greatest, inscribed.greatest);
    qm_mesh_reset(&ctx, &out);
    qm_bvh_destroy(&ctx, bvh);
    qm_shape_free(&surface);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(random_edits_keep_the_topology),
        cmocka_unit_test(pockets_are_cut),
        cmocka_unit_test(creases_apart_are_not_pinched),
        cmocka_unit_test(sides_of_several_quads_are_boundaries),
        cmocka_unit_test(closed_shapes_become_closed_quads),
        cmocka_unit_test(smooth_shapes_have_few_irregular_vertices),
        cmocka_unit_test(quads_lie_on_both_sides),
        cmocka_unit_test(creases_are_followed),
        cmocka_unit_test(tips_stay),
        cmocka_unit_test(acute_corners_have_a_quad),
        cmocka_unit_test(slivers_hide_no_creases),
        cmocka_unit_test(facets_are_no_creases),
        cmocka_unit_test(reflex_corners_have_room),
        cmocka_unit_test(creases_that_leave_no_room_go),
        cmocka_unit_test(straight_boundaries_have_two_quads),
        cmocka_unit_test(thin_walls_stay_apart),
        cmocka_unit_test(small_holes_stay_open),
        cmocka_unit_test(holes_of_one_quad_stay_open),
        cmocka_unit_test(open_shapes_keep_their_boundaries),
        cmocka_unit_test(components_stay_apart),
        cmocka_unit_test(seams_close),
        cmocka_unit_test(faces_that_look_either_way_are_turned),
        cmocka_unit_test(any_soup_becomes_manifold_quads),
        cmocka_unit_test(fins_leave_slits),
        cmocka_unit_test(sheets_of_two_sides_are_split),
        cmocka_unit_test(sheets_of_two_sides_become_closed_quads),
        cmocka_unit_test(threads_do_not_change_the_mesh),
        cmocka_unit_test(bad_input_is_told),
        cmocka_unit_test(memory_and_cancel_end_the_call),
        cmocka_unit_test(every_poll_can_end_the_call),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
