/* Reconstruction: structure of the mesh, distance that falls, the same bits, faults, lack of memory. */
#include "check.h"

#include "base/host.h"
#include "core/vec.h"
#include "failing_allocator.h"
#include "ground.h"
#include "layouts.h"
#include "measured.h"
#include "qm/reconstruct.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static qm_reconstruction *start(qm_ground *g, const qm_layout *layout)
{
    qm_reconstruction_options options = qm_reconstruction_options_default();
    qm_reconstruction *r;
    qm_status status = qm_reconstruction_create(&g->ctx, &g->source, layout, &options, &r);
    QM_CHECK(status == QM_OK, "%s", g->ctx.message);
    return r;
}

/** Steps until nothing more fits; returns the quads that there are then. */
static size_t step_to(qm_ground *g, qm_reconstruction *r, size_t max_quads)
{
    qm_reconstruction_record record;
    do
        assert_int_equal(qm_reconstruction_step(&g->ctx, r, max_quads, &record), QM_OK);
    while (record.chords_changed > 0);
    assert_true(record.quads <= max_quads);
    return record.quads;
}

static qm_mesh mesh_of(qm_ground *g, const qm_reconstruction *r)
{
    qm_mesh mesh;
    assert_int_equal(qm_reconstruction_mesh(&g->ctx, r, &mesh), QM_OK);
    assert_int_equal(qm_mesh_validate(&g->ctx, &mesh), QM_OK);
    return mesh;
}

/** The two-sided distance as a share of the second mesh's diagonal. */
static double distance(const qm_mesh *mesh, const qm_mesh *truth)
{
    qm_box box = qm_mesh_bounding_box(truth);
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.tolerance = 5e-6 * qm_mesh_box_diagonal(&box);
    return qm_measured(mesh, truth, &options).upper / qm_mesh_box_diagonal(&box);
}

static qm_vec corner_at(const qm_mesh *mesh, size_t face, int k)
{
    return qm_vec_load(mesh->positions + 3 * (size_t)mesh->faces[4 * face + (size_t)k]);
}

/** Least over the faces of the sine at a corner, seen along the face's normal: above 0 when no quad folds. */
static double least_jacobian(const qm_mesh *mesh)
{
    double least = INFINITY;
    for (size_t face = 0; face < mesh->face_count; face++) {
        qm_vec normal = qm_vec_cross(qm_vec_sub(corner_at(mesh, face, 2), corner_at(mesh, face, 0)),
                                     qm_vec_sub(corner_at(mesh, face, 3), corner_at(mesh, face, 1)));
        for (int k = 0; k < 4; k++) {
            qm_vec here = corner_at(mesh, face, k);
            qm_vec on = qm_vec_sub(corner_at(mesh, face, (k + 1) % 4), here);
            qm_vec back = qm_vec_sub(corner_at(mesh, face, (k + 3) % 4), here);
            double sine = qm_vec_dot(qm_vec_cross(on, back), normal) /
                          (qm_vec_norm(on) * qm_vec_norm(back) * qm_vec_norm(normal));
            least = fmin(least, sine);
        }
    }
    return least;
}

static void meshes_are_semi_regular(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_torus(96, 48, 1.0, 0.35));
    qm_layout layout = qm_layout_of_grid(6, 4, true, true, 12, qm_torus_at, NULL);
    qm_reconstruction *r = start(&g, &layout);
    qm_mesh mesh = mesh_of(&g, r);
    assert_int_equal(mesh.face_count, 24);
    assert_int_equal(mesh.vertex_count, 24);
    qm_shape_free(&mesh);
    for (size_t limit = 100; limit <= 6400; limit *= 4) {
        step_to(&g, r, limit);
        mesh = mesh_of(&g, r);
        qm_mesh_facts facts;
        assert_int_equal(qm_mesh_find_facts(&g.ctx, &mesh, &facts), QM_OK);
        assert_int_equal(facts.boundary_edges, 0);
        assert_int_equal(facts.irregular_vertices, 0);
        assert_int_equal(facts.components, 1);
        assert_true(facts.manifold);
        assert_int_equal(facts.quads, mesh.face_count);
        assert_int_equal(mesh.vertex_count, mesh.face_count);
        QM_CHECK(least_jacobian(&mesh) > 0.9, "%zu quads: %g", mesh.face_count, least_jacobian(&mesh));
        qm_shape_free(&mesh);
    }
    qm_reconstruction_destroy(&g.ctx, r);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

/** Steps until the mesh has the most quads, which are nearly the limit; the distance falls at least so many times each fourfold. */
static void check_order(qm_mesh surface, qm_layout layout, size_t first, size_t last, double least_fall)
{
    qm_ground g;
    qm_ground_make(&g, surface);
    qm_reconstruction *r = start(&g, &layout);
    double before = INFINITY;
    for (size_t limit = first; limit <= last; limit *= 4) {
        size_t quads = step_to(&g, r, limit);
        QM_CHECK(10 * quads >= 9 * limit, "%zu quads of %zu", quads, limit);
        qm_mesh mesh = mesh_of(&g, r);
        double now = distance(&mesh, &g.mesh);
        QM_CHECK(now * least_fall <= before, "%zu quads: %g after %g", quads, now, before);
        before = now;
        qm_shape_free(&mesh);
    }
    qm_reconstruction_destroy(&g.ctx, r);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

static void distances_fall_by_the_square(void **state)
{
    (void)state;
    check_order(qm_shape_saddle(128), qm_layout_of_grid(3, 2, false, false, 8, qm_saddle_at, NULL), 96, 6144,
                3.2);
    check_order(qm_shape_torus(256, 128, 1.0, 0.35),
                qm_layout_of_grid(6, 4, true, true, 24, qm_torus_at, NULL), 96, 6144, 3.0);
    /* The four corners of each of these patches lie on one line. */
    check_order(qm_shape_torus(256, 128, 1.0, 0.35),
                qm_layout_of_grid(2, 2, true, true, 60, qm_torus_at, NULL), 256, 4096, 3.0);
}

/** A vault: z = user[0] x^2 + user[1] y^2 over the unit square. */
static void vault_at(const void *user, double u, double v, double out[3])
{
    const double *bend = user;
    out[0] = u;
    out[1] = v;
    out[2] = bend[0] * u * u + bend[1] * v * v;
}

/** Twice the mean square of the height of a vault over columns by rows of edges, but for a factor. */
static double vault_error(const double bend[2], double columns, double rows)
{
    double error = bend[0] / (columns * columns) + bend[1] / (rows * rows);
    return error * error;
}

/** One patch on a vault: its columns and rows are about as good as the best of all pairs of counts. */
static void counts_are_where_the_surface_bends(void **state)
{
    (void)state;
    const double bends[][2] = {{0.4, 0.1}, {0.05, 0.4}, {0.3, 0.3}, {0.5, 0.02}};
    const size_t limits[] = {60, 150, 777};
    for (size_t i = 0; i < sizeof bends / sizeof *bends; i++) {
        for (size_t k = 0; k < sizeof limits / sizeof *limits; k++) {
            qm_ground g;
            qm_ground_make(&g, qm_shape_grid(64, 64, false, false, vault_at, bends[i]));
            qm_layout layout = qm_layout_of_grid(1, 1, false, false, 32, vault_at, bends[i]);
            qm_reconstruction *r = start(&g, &layout);
            step_to(&g, r, limits[k]);
            qm_reconstruction_patch patch = qm_reconstruction_get_patch(r, 0);
            double least = INFINITY;
            for (size_t columns = 1; columns <= limits[k]; columns++)
                least = fmin(least, vault_error(bends[i], (double)columns, (double)(limits[k] / columns)));
            double found = vault_error(bends[i], patch.columns, patch.rows);
            QM_CHECK(found < 1.5 * least, "%u by %u of %zu for %g, %g: %g, the best is %g", patch.columns,
                     patch.rows, limits[k], bends[i][0], bends[i][1], found, least);
            qm_reconstruction_destroy(&g.ctx, r);
            qm_layout_free(&layout);
            qm_ground_free(&g);
        }
    }
}

/** The unit square with a flat ear on its first quarter: user[0] high, half as wide as the quarter at its base, and
 * user[1] times as thick as wide. */
static void ear_at(const void *user, double u, double v, double out[3])
{
    const double *ear = user, base = 0.14;
    double x = u - 0.25, y = v - 0.25, rise = 1.0 - hypot(x, y) / base;
    out[0] = u;
    out[1] = v;
    out[2] = 0.0;
    if (!(rise > 0.0)) return;
    double width = sqrt(1.0 - rise * rise) / (1.0 - rise + 1e-12);
    double thin = 1.0 - (1.0 - ear[1]) * fmin(1.0, 4.0 * rise);
    out[0] = 0.25 + width * x;
    out[1] = 0.25 + width * thin * y;
    out[2] = ear[0] * rise;
}

/** An ear inside a patch is reached to its tip, however high it is. */
static void ears_inside_a_patch_are_reached(void **state)
{
    (void)state;
    const double ears[][2] = {{0.3, 1.0}, {0.6, 1.0}, {0.6, 0.3}, {1.0, 0.5}, {1.0, 0.25}};
    for (size_t i = 0; i < sizeof ears / sizeof *ears; i++) {
        qm_ground g;
        qm_ground_make(&g, qm_shape_grid(240, 240, false, false, ear_at, ears[i]));
        qm_layout layout = qm_layout_of_grid(2, 2, false, false, 32, ear_at, ears[i]);
        qm_reconstruction *r = start(&g, &layout);
        for (size_t limit = 1000; limit <= 4000; limit *= 4) {
            step_to(&g, r, limit);
            qm_mesh mesh = mesh_of(&g, r);
            double now = distance(&mesh, &g.mesh), most = limit == 1000 ? 0.04 : 0.02;
            QM_CHECK(now <= most, "an ear %g high, %g thick, %zu quads: %g", ears[i][0], ears[i][1], limit,
                     now);
            QM_CHECK(least_jacobian(&mesh) > 0.0, "%zu quads: %g", limit, least_jacobian(&mesh));
            qm_shape_free(&mesh);
        }
        qm_reconstruction_destroy(&g.ctx, r);
        qm_layout_free(&layout);
        qm_ground_free(&g);
    }
}

/** A fin along y, one high and a tenth thick, with a round rim; u leads over the rim. */
static void fin_at(const void *user, double u, double v, double out[3])
{
    (void)user;
    const double radius = 0.05, pi = 3.14159265358979323846;
    double length = u * (2.0 + pi * radius), turn = qm_clamp((length - 1.0) / radius, 0.0, pi);
    double up = fmin(length, 1.0), down = fmax(length - 1.0 - pi * radius, 0.0);
    out[0] = -radius * cos(turn);
    out[1] = v;
    out[2] = up - down + radius * sin(turn);
}

/** Vertices at equal distances along the curves would cut off the rim: 0.030. */
static void curves_follow_rims(void **state)
{
    (void)state;
    for (int rows = 1; rows <= 3; rows++) {
        qm_ground g;
        qm_ground_make(&g, qm_shape_grid(400, 40, false, false, fin_at, NULL));
        qm_layout layout = qm_layout_of_grid(1, rows, false, false, 200, fin_at, NULL);
        qm_reconstruction *r = start(&g, &layout);
        step_to(&g, r, 15 * (size_t)rows);
        qm_mesh mesh = mesh_of(&g, r);
        QM_CHECK(distance(&mesh, &g.mesh) <= 0.015, "%d rows, %zu quads: %g", rows, mesh.face_count,
                 distance(&mesh, &g.mesh));
        qm_shape_free(&mesh);
        qm_reconstruction_destroy(&g.ctx, r);
        qm_layout_free(&layout);
        qm_ground_free(&g);
    }
}

static void noise_is_averaged_away(void **state)
{
    (void)state;
    qm_mesh truth = qm_shape_torus(192, 96, 1.0, 0.35);
    qm_box box = qm_mesh_bounding_box(&truth);
    double noise = 0.002 * qm_mesh_box_diagonal(&box);
    qm_ground g;
    qm_ground_make(&g, qm_ground_sample(qm_torus_at, 30000, noise, 1));
    qm_layout layout = qm_layout_of_grid(6, 4, true, true, 24, qm_torus_at, NULL);
    qm_reconstruction *r = start(&g, &layout);
    step_to(&g, r, 6144);
    qm_mesh mesh = mesh_of(&g, r);
    double now = distance(&mesh, &truth);
    QM_CHECK(now <= 3.0 * 0.002, "%g of the diagonal", now);
    qm_shape_free(&mesh);
    qm_reconstruction_destroy(&g.ctx, r);
    qm_layout_free(&layout);
    qm_ground_free(&g);
    qm_shape_free(&truth);
}

static void same_bits(const qm_mesh *a, const qm_mesh *b)
{
    assert_int_equal(a->vertex_count, b->vertex_count);
    assert_int_equal(a->face_count, b->face_count);
    assert_memory_equal(a->positions, b->positions, 3 * sizeof(double) * a->vertex_count);
    assert_memory_equal(a->faces, b->faces, 4 * sizeof(uint32_t) * a->face_count);
}

static void threads_and_pauses_do_not_change_a_bit(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_torus(64, 32, 1.0, 0.35));
    qm_layout layout = qm_layout_of_grid(3, 2, true, true, 16, qm_torus_at, NULL);
    qm_reconstruction *one = start(&g, &layout), *many;
    step_to(&g, one, 1536);
    qm_mesh expected = mesh_of(&g, one);
    for (int threads = 2; threads <= 7; threads += 5) {
        qm_reconstruction_options options = qm_reconstruction_options_default();
        options.thread_count = threads;
        g.ctx.parallel = qm_host_parallel;
        assert_int_equal(qm_reconstruction_create(&g.ctx, &g.source, &layout, &options, &many), QM_OK);
        step_to(&g, many, 1536);
        qm_mesh mesh = mesh_of(&g, many);
        same_bits(&mesh, &expected);
        qm_shape_free(&mesh);
        qm_reconstruction_destroy(&g.ctx, many);
    }
    qm_shape_free(&expected);
    qm_reconstruction_destroy(&g.ctx, one);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

static void a_canceled_step_leaves_the_last_whole_one(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_torus(64, 32, 1.0, 0.35));
    qm_layout layout = qm_layout_of_grid(3, 2, true, true, 16, qm_torus_at, NULL);
    qm_reconstruction *r = start(&g, &layout);
    step_to(&g, r, 6 * 64);
    qm_mesh before = mesh_of(&g, r);
    atomic_bool cancel = true;
    g.ctx.cancel = &cancel;
    qm_reconstruction_record record;
    qm_status status;
    do /* steps that take vertices of the first grids have nothing to cancel */
        status = qm_reconstruction_step(&g.ctx, r, 1 << 20, &record);
    while (status == QM_OK);
    assert_int_equal(status, QM_E_CANCELED);
    g.ctx.cancel = NULL;
    qm_mesh after = mesh_of(&g, r);
    assert_true(after.face_count >= before.face_count);
    assert_int_equal(after.face_count, record.quads);
    size_t quads = record.quads;
    assert_int_equal(qm_reconstruction_step(&g.ctx, r, 1 << 20, &record), QM_OK);
    assert_true(record.quads > quads);
    qm_shape_free(&before);
    qm_shape_free(&after);
    qm_reconstruction_destroy(&g.ctx, r);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

/** Creation on a bad input: refused with words, or a mesh of finite vertices. */
static void check_refused(qm_mesh surface, qm_layout layout, qm_status expected, const char *words)
{
    qm_ground g;
    qm_ground_make(&g, surface);
    qm_reconstruction_options options = qm_reconstruction_options_default();
    qm_reconstruction *r;
    qm_status status = qm_reconstruction_create(&g.ctx, &g.source, &layout, &options, &r);
    QM_CHECK(status == expected, "status %d: %s", (int)status, g.ctx.message);
    QM_CHECK(strstr(g.ctx.message, words) != NULL, "\"%s\" lacks \"%s\"", g.ctx.message, words);
    assert_null(r);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

static void layouts_that_do_not_fit_are_named(void **state)
{
    (void)state;
    check_refused(qm_shape_plane(8, 0.0), (qm_layout){0}, QM_E_LAYOUT, "no patch");
    qm_layout collapsed = qm_layout_of_grid(1, 1, false, false, 4, qm_square_at, NULL);
    for (size_t k = 0; k < collapsed.curves[1].point_count; k++)
        memcpy(collapsed.curves[1].points + 3 * k, collapsed.nodes + 3 * (size_t)collapsed.curves[1].from,
               24);
    check_refused(qm_shape_plane(8, 0.0), collapsed, QM_E_LAYOUT, "curve 1");
    /* A second patch beside the surface, which ends at x = 1. */
    qm_layout beyond = qm_layout_of_grid(2, 1, false, false, 4, qm_square_at, NULL);
    for (size_t c = 0; c < beyond.curve_count; c++)
        for (size_t k = 0; k < beyond.curves[c].point_count; k++)
            beyond.curves[c].points[3 * k] *= 2.0;
    for (size_t n = 0; n < beyond.node_count; n++)
        beyond.nodes[3 * n] *= 2.0;
    check_refused(qm_shape_plane(8, 0.0), beyond, QM_E_LAYOUT, "patch 1");
}

/** A reconstruction that comes to its end with finite vertices; returns its distance to the truth. */
static double survive(qm_mesh surface, const qm_layout *layout, const qm_mesh *truth, size_t *holes)
{
    qm_ground g;
    qm_ground_make(&g, surface);
    qm_reconstruction *r = start(&g, layout);
    qm_reconstruction_record record;
    *holes = 0;
    do {
        assert_int_equal(qm_reconstruction_step(&g.ctx, r, 1536, &record), QM_OK);
        *holes += record.holes_filled;
    } while (record.chords_changed > 0);
    qm_mesh mesh = mesh_of(&g, r);
    double found = distance(&mesh, truth);
    qm_shape_free(&mesh);
    qm_reconstruction_destroy(&g.ctx, r);
    qm_ground_free(&g);
    return found;
}

static qm_mesh keep_points(qm_mesh points, bool (*keeps)(const double *p))
{
    size_t count = 0;
    for (size_t i = 0; i < points.vertex_count; i++)
        if (keeps(points.positions + 3 * i))
            memcpy(points.positions + 3 * count++, points.positions + 3 * i, 24);
    points.vertex_count = count;
    return points;
}

static bool outside_the_hole(const double *p)
{
    return hypot(p[0] - 0.2, p[1] - 0.3) > 0.2;
}

static void clouds_made_worse_still_give_meshes(void **state)
{
    (void)state;
    qm_mesh truth = qm_shape_saddle(64);
    qm_layout layout = qm_layout_of_grid(2, 2, false, false, 16, qm_saddle_at, NULL);
    size_t holes;
    double plain = survive(qm_ground_sample(qm_saddle_at, 8000, 0.0, 2), &layout, &truth, &holes);
    QM_CHECK(plain < 2e-3, "plain %g", plain);

    double found = survive(keep_points(qm_ground_sample(qm_saddle_at, 8000, 0.0, 3), outside_the_hole),
                           &layout, &truth, &holes);
    QM_CHECK(found < 0.02 && holes > 0, "hole: %g, %zu vertices filled", found, holes);

    qm_mesh outliers = qm_ground_sample(qm_saddle_at, 8000, 0.0, 4);
    qm_random random = qm_random_make(qm_check_seed(), 5);
    for (size_t i = 0; i < outliers.vertex_count; i += 100)
        qm_random_point(&random, -1.5, 1.5, outliers.positions + 3 * i);
    found = survive(outliers, &layout, &truth, &holes);
    QM_CHECK(found < 0.02, "outliers: %g", found);

    qm_mesh twice = qm_ground_sample(qm_saddle_at, 8000, 0.0, 6);
    memcpy(twice.positions, twice.positions + 3 * 4000, 4000 * 24);
    found = survive(twice, &layout, &truth, &holes);
    QM_CHECK(found < 4e-3, "duplicates: %g", found);

    qm_mesh apart = qm_ground_sample(qm_saddle_at, 8000, 0.0, 7);
    for (size_t i = 0; i < 2000; i++)
        apart.positions[3 * i + 2] += 20.0;
    found = survive(apart, &layout, &truth, &holes);
    QM_CHECK(found < 4e-3, "two clouds: %g", found);
    qm_layout_free(&layout);
    qm_shape_free(&truth);
}

#define THINNESS 0.1

/** A torus flattened to a ring of two sheets, a fiftieth of its diagonal apart where they are farthest. */
static void flat_ring_at(const void *user, double u, double v, double out[3])
{
    qm_torus_at(user, u, v, out);
    out[2] *= THINNESS;
}

/** Gives points of the flat ring its outer normals: with the sign that a function gives. */
static void set_ring_normals(qm_mesh *points, float (*sign)(qm_random *random))
{
    qm_random random = qm_random_make(qm_check_seed(), 20);
    points->normals = malloc(3 * sizeof(float) * points->vertex_count);
    assert_non_null(points->normals);
    for (size_t i = 0; i < points->vertex_count; i++) {
        const double *p = points->positions + 3 * i;
        double away = hypot(p[0], p[1]), out = (away - 1.0) / away;
        float side = sign(&random);
        points->normals[3 * i] = side * (float)(p[0] * out);
        points->normals[3 * i + 1] = side * (float)(p[1] * out);
        points->normals[3 * i + 2] = side * (float)(p[2] / (THINNESS * THINNESS));
    }
}

static float outward(qm_random *random)
{
    (void)random;
    return 1.0f;
}

static float inward(qm_random *random)
{
    (void)random;
    return -1.0f;
}

static float either_way(qm_random *random)
{
    return qm_random_below(random, 2) ? 1.0f : -1.0f;
}

/** Six times the volume that a closed mesh encloses; below 0 when its faces look inward. */
static double enclosed(const qm_mesh *mesh)
{
    double sum = 0.0;
    for (size_t face = 0; face < mesh->face_count; face++) {
        qm_vec a = corner_at(mesh, face, 0), b = corner_at(mesh, face, 1), c = corner_at(mesh, face, 2);
        qm_vec d = corner_at(mesh, face, 3);
        sum += qm_vec_dot(a, qm_vec_cross(b, c)) + qm_vec_dot(a, qm_vec_cross(c, d));
    }
    return sum;
}

static qm_mesh ring_mesh(const qm_layout *layout, float (*sign)(qm_random *random))
{
    qm_ground g;
    qm_mesh points = qm_ground_sample(flat_ring_at, 20000, 0.0, 21);
    if (sign) set_ring_normals(&points, sign);
    qm_ground_make(&g, points);
    qm_reconstruction *r = start(&g, layout);
    step_to(&g, r, 1536);
    qm_mesh mesh = mesh_of(&g, r);
    qm_reconstruction_destroy(&g.ctx, r);
    free(g.mesh.normals);
    g.mesh.normals = NULL;
    qm_ground_free(&g);
    return mesh;
}

static void normals_tell_the_sides_unless_they_are_wrong(void **state)
{
    (void)state;
    qm_layout layout = qm_layout_of_grid(6, 4, true, true, 12, flat_ring_at, NULL);
    qm_mesh truth = qm_shape_grid(192, 96, true, true, flat_ring_at, NULL);
    qm_mesh out = ring_mesh(&layout, outward), in = ring_mesh(&layout, inward);
    qm_mesh wrong = ring_mesh(&layout, either_way), none = ring_mesh(&layout, NULL);
    QM_CHECK(enclosed(&out) > 0.0, "%g", enclosed(&out));
    QM_CHECK(enclosed(&in) < 0.0, "%g", enclosed(&in));
    QM_CHECK(distance(&out, &truth) < 0.02, "%g", distance(&out, &truth));
    QM_CHECK(distance(&in, &truth) < 0.02, "%g", distance(&in, &truth));
    same_bits(&wrong, &none);
    qm_mesh *all[] = {&out, &in, &wrong, &none, &truth};
    for (size_t i = 0; i < 5; i++)
        qm_shape_free(all[i]);
    qm_layout_free(&layout);
}

/** A trench across a strip, a twentieth of it wide and sixteen times as deep as its bottom is round. */
static void trench_at(const void *user, double u, double v, double out[3])
{
    (void)user;
    double x = 2.0 * u - 1.0;
    out[0] = x + 0.15 * exp(-100.0 * x * x) * x;
    out[1] = v;
    out[2] = -0.8 * exp(-600.0 * x * x);
}

static void narrow_gaps_are_followed_without_folds(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_grid(400, 40, false, false, trench_at, NULL));
    qm_layout layout = qm_layout_of_grid(1, 1, false, false, 200, trench_at, NULL);
    qm_reconstruction *r = start(&g, &layout);
    step_to(&g, r, 2048);
    qm_mesh mesh = mesh_of(&g, r);
    QM_CHECK(least_jacobian(&mesh) > 0.0, "%g", least_jacobian(&mesh));
    QM_CHECK(distance(&mesh, &g.mesh) < 2.5e-2, "%g", distance(&mesh, &g.mesh));
    qm_shape_free(&mesh);
    qm_reconstruction_destroy(&g.ctx, r);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

static void what_no_patch_covers_is_counted(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_torus(96, 48, 1.0, 0.35));
    qm_layout layout = qm_layout_of_grid(6, 4, true, true, 12, qm_torus_at, NULL);
    layout.patch_count = 18; /* of 24; the last ones are dropped in place */
    qm_reconstruction_options options = qm_reconstruction_options_default();
    qm_reconstruction *r;
    assert_int_equal(qm_reconstruction_create(&g.ctx, &g.source, &layout, &options, &r), QM_OK);
    size_t points, uncovered;
    qm_reconstruction_coverage(r, &points, &uncovered);
    QM_CHECK(uncovered > points / 10 && uncovered < points / 3, "%zu of %zu", uncovered, points);
    size_t sum = 0, first = 0;
    for (size_t p = 0; p < qm_reconstruction_patch_count(r); p++) {
        qm_reconstruction_patch patch = qm_reconstruction_get_patch(r, p);
        assert_int_equal(patch.first_face, first);
        first += (size_t)patch.columns * patch.rows;
        sum += patch.points;
    }
    QM_CHECK(sum > points / 2 && sum < points, "%zu of %zu", sum, points);
    qm_reconstruction_destroy(&g.ctx, r);
    layout.patch_count = 24;
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

/** Faces of a patch of one mesh that have the same corners, bit for bit, as that patch's of another. */
static bool has_same_patch(const qm_mesh *a, const qm_mesh *b, const qm_reconstruction_patch *patch)
{
    for (size_t f = patch->first_face; f < patch->first_face + (size_t)patch->columns * patch->rows; f++)
        for (int k = 0; k < 4; k++)
            if (memcmp(a->positions + 3 * (size_t)a->faces[4 * f + (size_t)k],
                       b->positions + 3 * (size_t)b->faces[4 * f + (size_t)k], 24) != 0)
                return false;
    return true;
}

static void an_edit_redoes_only_the_patches_that_it_touches(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_saddle(64));
    qm_layout layout = qm_layout_of_grid(3, 2, false, false, 8, qm_saddle_at, NULL);
    qm_reconstruction *r = start(&g, &layout), *edited;
    step_to(&g, r, 1536);
    qm_mesh before = mesh_of(&g, r);

    /* The curve between the first two patches, drawn with a bend. */
    uint32_t middle = layout.patches[0].side[1];
    for (size_t k = 1; k + 1 < layout.curves[middle].point_count; k++) {
        double *p = layout.curves[middle].points + 3 * k;
        p[0] += 0.1 * sin(3.141592653589793 * (double)k / (double)(layout.curves[middle].point_count - 1));
        p[2] = p[0] * p[1];
    }
    /* The fourth patch begins at another corner, which changes nothing. */
    qm_layout_patch turned = layout.patches[3];
    for (int k = 0; k < 4; k++) {
        layout.patches[3].side[k] = turned.side[(k + 1) % 4];
        layout.patches[3].against[k] = turned.against[(k + 1) % 4];
    }
    size_t redone;
    qm_status status = qm_reconstruction_edit(&g.ctx, r, &layout, &edited, &redone);
    QM_CHECK(status == QM_OK, "%s", g.ctx.message);
    assert_int_equal(redone, 2);
    qm_mesh after = mesh_of(&g, edited);
    assert_int_equal(after.face_count, before.face_count);
    for (size_t p = 0; p < qm_reconstruction_patch_count(edited); p++) {
        qm_reconstruction_patch patch = qm_reconstruction_get_patch(edited, p);
        if (p != 3) QM_CHECK(has_same_patch(&before, &after, &patch) == (p > 1), "patch %zu", p);
    }
    assert_true(least_jacobian(&after) > 0.5);
    QM_CHECK(distance(&after, &g.mesh) < 1e-3, "%g", distance(&after, &g.mesh));
    qm_reconstruction_record record;
    assert_int_equal(qm_reconstruction_step(&g.ctx, edited, 1 << 14, &record), QM_OK);
    assert_true(record.quads > after.face_count);

    layout.patch_count = 5; /* one patch less: the others stay */
    qm_reconstruction *fewer;
    assert_int_equal(qm_reconstruction_edit(&g.ctx, edited, &layout, &fewer, &redone), QM_OK);
    assert_int_equal(redone, 0);
    layout.patch_count = 6;
    qm_reconstruction *again; /* and when it comes back, it alone is made */
    assert_int_equal(qm_reconstruction_edit(&g.ctx, fewer, &layout, &again, &redone), QM_OK);
    assert_int_equal(redone, 1);
    qm_reconstruction_destroy(&g.ctx, again);
    qm_reconstruction_destroy(&g.ctx, fewer);
    qm_reconstruction_destroy(&g.ctx, edited);
    qm_reconstruction_destroy(&g.ctx, r);
    qm_shape_free(&before);
    qm_shape_free(&after);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

/** Of a plane in two patches: the curve between them is sharp, two of the others, which meet, are fixed. */
static void marks_name_vertices_and_sides(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_plane(8, 0.0));
    qm_layout layout = qm_layout_of_grid(2, 1, false, false, 2, qm_square_at, NULL);
    assert_int_equal(layout.patch_count, 2);
    uint32_t between = QM_NO_INDEX, only[2] = {layout.patches[0].side[0], layout.patches[0].side[3]};
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 4; k++)
            if (layout.patches[0].side[i] == layout.patches[1].side[k]) between = layout.patches[0].side[i];
    assert_true(between != QM_NO_INDEX);
    for (int k = 0; k < 2; k++)
        if (only[k] == between) only[k] = layout.patches[0].side[k == 0 ? 2 : 1];
    layout.curves[between].mark = QM_CURVE_SHARP;
    layout.curves[only[0]].mark = layout.curves[only[1]].mark = QM_CURVE_FIXED;
    qm_reconstruction *r = start(&g, &layout);
    qm_reconstruction_record record;
    for (int k = 0; k < 6; k++)
        assert_int_equal(qm_reconstruction_step(&g.ctx, r, 512, &record), QM_OK);
    qm_mesh mesh;
    qm_quads_marks marks;
    assert_int_equal(qm_reconstruction_mesh(&g.ctx, r, &mesh), QM_OK);
    assert_int_equal(qm_reconstruction_find_marks(&g.ctx, r, &marks), QM_OK);
    assert_true(marks.vertex_count == mesh.vertex_count && marks.face_count == mesh.face_count);
    const qm_curve *middle = &layout.curves[between];
    qm_vec a = qm_vec_load(middle->points), b = qm_vec_load(middle->points + 3 * (middle->point_count - 1));
    qm_vec way = qm_vec_scale(1.0 / qm_vec_distance(a, b), qm_vec_sub(b, a));
    size_t sharp = 0, stays = 0;
    for (size_t s = 0; s < 4 * mesh.face_count; s++) {
        double off = 0.0;
        for (size_t k = 0; k < 2; k++) {
            size_t vertex = mesh.faces[s / 4 * 4 + (s + k) % 4];
            qm_vec from = qm_vec_sub(qm_vec_load(mesh.positions + 3 * vertex), a);
            off = fmax(off, qm_vec_norm(qm_vec_axpy(from, -qm_vec_dot(from, way), way)));
        }
        bool is_sharp = marks.sharp[s / 4] >> s % 4 & 1;
        QM_CHECK(is_sharp == (off < 1e-9), "side %zu is %.3g off the middle", s, off);
        sharp += is_sharp;
    }
    for (size_t v = 0; v < mesh.vertex_count; v++)
        stays += marks.stays[v];
    qm_reconstruction_patch patch = qm_reconstruction_get_patch(r, 0);
    QM_CHECK(sharp > 4 && stays == (size_t)patch.columns + patch.rows + 1, "%zu sharp, %zu stay", sharp,
             stays);
    assert_true(marks.line_count >= sharp / 2);
    qm_quads_marks_reset(&g.ctx, &marks);
    qm_mesh_reset(&g.ctx, &mesh);
    qm_reconstruction_destroy(&g.ctx, r);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

static qm_status run_once(qm_context *ctx, const qm_ref_surface *source, const qm_layout *layout)
{
    qm_reconstruction_options options = qm_reconstruction_options_default();
    qm_reconstruction *r;
    qm_status status = qm_reconstruction_create(ctx, source, layout, &options, &r);
    qm_reconstruction_record record;
    for (int k = 0; k < 10 && status == QM_OK; k++)
        status = qm_reconstruction_step(ctx, r, 1 << 14, &record);
    qm_mesh mesh = {0};
    if (status == QM_OK) status = qm_reconstruction_mesh(ctx, r, &mesh);
    qm_mesh_reset(ctx, &mesh);
    qm_quads_marks marks = {0};
    if (status == QM_OK) status = qm_reconstruction_find_marks(ctx, r, &marks);
    qm_quads_marks_reset(ctx, &marks);
    qm_reconstruction *edited = NULL;
    size_t redone;
    if (status == QM_OK) status = qm_reconstruction_edit(ctx, r, layout, &edited, &redone);
    qm_reconstruction_destroy(ctx, edited);
    qm_reconstruction_destroy(ctx, r);
    return status;
}

static void running_out_of_memory_is_a_status_at_every_place(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_plane(8, 0.0));
    qm_layout layout = qm_layout_of_grid(1, 1, false, false, 2, qm_square_at, NULL);
    layout.curves[0].mark = QM_CURVE_SHARP;
    qm_status status = QM_E_NO_MEMORY;
    for (size_t fail_at = 0; status != QM_OK; fail_at += 1 + fail_at / 16) {
        qm_failing_allocator memory = {.fail_at = fail_at};
        qm_context ctx = {.allocator = qm_failing_allocator_hook(&memory)};
        status = run_once(&ctx, &g.source, &layout);
        QM_CHECK(status == QM_OK || status == QM_E_NO_MEMORY, "call %zu: %s", fail_at, ctx.message);
        QM_CHECK(memory.live_blocks == 0 && !memory.mismatched, "call %zu leaves %zu blocks", fail_at,
                 memory.live_blocks);
    }
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(meshes_are_semi_regular),
        cmocka_unit_test(distances_fall_by_the_square),
        cmocka_unit_test(counts_are_where_the_surface_bends),
        cmocka_unit_test(ears_inside_a_patch_are_reached),
        cmocka_unit_test(curves_follow_rims),
        cmocka_unit_test(noise_is_averaged_away),
        cmocka_unit_test(threads_and_pauses_do_not_change_a_bit),
        cmocka_unit_test(a_canceled_step_leaves_the_last_whole_one),
        cmocka_unit_test(layouts_that_do_not_fit_are_named),
        cmocka_unit_test(clouds_made_worse_still_give_meshes),
        cmocka_unit_test(normals_tell_the_sides_unless_they_are_wrong),
        cmocka_unit_test(narrow_gaps_are_followed_without_folds),
        cmocka_unit_test(what_no_patch_covers_is_counted),
        cmocka_unit_test(an_edit_redoes_only_the_patches_that_it_touches),
        cmocka_unit_test(marks_name_vertices_and_sides),
        cmocka_unit_test(running_out_of_memory_is_a_status_at_every_place),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
