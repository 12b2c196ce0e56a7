/* Projection against brute force over all faces: values, feet, ties, order, threads, scales, bad input. */
#include "check.h"

#include "base/host.h"
#include "failing_allocator.h"
#include "qm/project.h"
#include "random.h"
#include "shapes.h"
#include "slow_twin.h"

#include <math.h>
#include <string.h>

enum { BATCH_LIMIT = 3000 };

/** A finished batch with all arrays. */
typedef struct batch {
    size_t count;
    double points[3 * BATCH_LIMIT];
    double distance[BATCH_LIMIT], position[3 * BATCH_LIMIT], uv[2 * BATCH_LIMIT];
    uint32_t face[BATCH_LIMIT];
} batch;

static batch first_batch, second_batch;

static void project(batch *out, const qm_mesh *mesh, qm_quad_reading reading, int threads)
{
    qm_context ctx = qm_context_make();
    if (threads > 1) ctx.parallel = qm_host_parallel;
    qm_bvh *tree;
    assert_int_equal(qm_bvh_build(&ctx, mesh, QM_BVH_ALL, 1, &tree), QM_OK);
    qm_projection to = {out->distance, out->position, out->face, out->uv};
    assert_int_equal(qm_project_points(&ctx, tree, reading, out->points, out->count, threads, &to), QM_OK);
    qm_bvh_destroy(&ctx, tree);
}

static double gap(const double a[3], const double b[3])
{
    double d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    double most = fmax(fabs(d[0]), fmax(fabs(d[1]), fabs(d[2])));
    if (most == 0) return 0;
    return most * sqrt((d[0] / most) * (d[0] / most) + (d[1] / most) * (d[1] / most) +
                       (d[2] / most) * (d[2] / most));
}

static double mesh_size(const qm_mesh *mesh)
{
    double size = 0;
    for (size_t i = 0; i < 3 * mesh->vertex_count; ++i)
        size = fmax(size, fabs(mesh->positions[i]));
    return size;
}

/** One answer of a batch: the distance, and that face, parameters and position name one and the same
 * point. */
static void check_answer(const batch *b, size_t i, const qm_mesh *mesh, qm_quad_reading reading,
                         const char *name, uint64_t seed)
{
    const double *p = b->points + 3 * i, *foot = b->position + 3 * i;
    double size = mesh_size(mesh) + gap(p, mesh->positions), slack = 1e-12 * size, at[3];
    qm_slow_bracket slow = qm_slow_distance(mesh, reading, p, 1e-13 * size);
    QM_CHECK(b->distance[i] >= slow.lower - slack && b->distance[i] <= slow.upper + slack,
             "%s, seed %llu, point %zu: %.17g, true [%.17g, %.17g]", name, (unsigned long long)seed, i,
             b->distance[i], slow.lower, slow.upper);
    QM_CHECK(fabs(gap(p, foot) - b->distance[i]) <= slack, "%s, seed %llu, point %zu: %.17g, foot at %.17g",
             name, (unsigned long long)seed, i, b->distance[i], gap(p, foot));
    size_t faces = mesh->face_count ? mesh->face_count : mesh->vertex_count;
    QM_CHECK(b->face[i] < faces, "%s, seed %llu, point %zu: face %u", name, (unsigned long long)seed, i,
             b->face[i]);
    qm_slow_position(mesh, b->face[i], reading, b->uv + 2 * i, at);
    QM_CHECK(gap(at, foot) <= slack, "%s, seed %llu, point %zu: foot %g from its parameters (%g, %g)", name,
             (unsigned long long)seed, i, gap(at, foot), b->uv[2 * i], b->uv[2 * i + 1]);
    double u = b->uv[2 * i], v = b->uv[2 * i + 1];
    bool triangle = mesh->face_count > 0 && mesh->faces[4 * b->face[i] + 3] == QM_NO_INDEX;
    QM_CHECK(u >= 0 && v >= 0 && u <= 1 && v <= 1 && (!triangle || u + v <= 1 + 1e-15),
             "%s, seed %llu, point %zu: (%.17g, %.17g)", name, (unsigned long long)seed, i, u, v);
}

/** Near the surface and around it. */
static void draw_points(batch *b, qm_random *random, const qm_mesh *mesh, size_t count)
{
    b->count = count;
    for (size_t i = 0; i < count; ++i) {
        double *p = b->points + 3 * i;
        qm_random_point(random, -1.5, 1.5, p);
        if (mesh->face_count > 0 && i % 3 == 0) qm_slow_sample(mesh, QM_QUADS_BILINEAR, random, 1, p);
        if (i % 7 == 0) memcpy(p, mesh->positions + 3 * qm_random_below(random, mesh->vertex_count), 24);
    }
}

static void soups_match_brute_force(void **state)
{
    (void)state;
    uint64_t count = qm_check_long() ? 20000 : 500;
    for (uint64_t seed = 0; seed < count; ++seed) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        qm_soup_style style = (qm_soup_style)qm_random_below(&random, QM_SOUP_STYLE_COUNT);
        double twist = (double[]){0, 0.1, 0.5, 2}[qm_random_below(&random, 4)];
        qm_mesh mesh = qm_shape_soup(&random, 1 + qm_random_below(&random, 30),
                                     (qm_soup_corners)qm_random_below(&random, 3), style, twist);
        qm_quad_reading reading = (qm_quad_reading)(seed % 2);
        draw_points(&first_batch, &random, &mesh, 14);
        project(&first_batch, &mesh, reading, 1);
        for (size_t i = 0; i < first_batch.count; ++i)
            check_answer(&first_batch, i, &mesh, reading, "soup", seed);
        qm_shape_free(&mesh);
    }
}

static void check_shape(qm_mesh mesh, const char *name)
{
    for (int reading = 0; reading < 2; ++reading) {
        qm_random random = qm_random_make(qm_check_seed(), (uint64_t)reading);
        draw_points(&first_batch, &random, &mesh, 60);
        project(&first_batch, &mesh, (qm_quad_reading)reading, 1);
        for (size_t i = 0; i < first_batch.count; ++i)
            check_answer(&first_batch, i, &mesh, (qm_quad_reading)reading, name, (uint64_t)reading);
    }
    qm_shape_free(&mesh);
}

static void shapes_match_brute_force(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 0);
    check_shape(qm_shape_torus(40, 20, 1, 0.4), "torus");
    check_shape(qm_shape_saddle(1), "saddle of one quad");
    check_shape(qm_shape_saddle(16), "saddle");
    check_shape(qm_shape_strip(30, 3, 9), "strip");
    check_shape(qm_shape_strip(3, 1, 9), "coarse strip");
    check_shape(qm_shape_plane(20, 0.5), "plane");
    check_shape(qm_shape_box(1, 1, 1), "cube");
    check_shape(qm_shape_box(1, 1, 0), "flat box");
    check_shape(qm_shape_copies(50), "copies");
    check_shape(qm_shape_points(&random, 500), "points");
    check_shape(qm_shape_points(&random, 1), "one point");
}

/** Far from the origin and at other scales the error stays at 1e-12 of the size, the shift being part of
 * it. */
static void moved_and_scaled_meshes_match_brute_force(void **state)
{
    (void)state;
    static const double moves[][2] = {{1, 1e7},    {1e-9, 0},  {1e-9, 1},   {1e-30, 0},
                                      {1e-170, 0}, {1e150, 0}, {1e30, 1e30}};
    for (uint64_t seed = 0; seed < 70; ++seed) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        const double *move = moves[seed % 7], shift[3] = {move[1], -move[1], move[1]};
        qm_mesh mesh = qm_shape_soup(&random, 12, QM_SOUP_MIXED, QM_SOUP_APART, 0.5);
        draw_points(&first_batch, &random, &mesh, 10);
        qm_shape_move(&mesh, move[0], shift);
        for (size_t i = 0; i < 3 * first_batch.count; ++i)
            first_batch.points[i] = move[0] * first_batch.points[i] + shift[i % 3];
        qm_quad_reading reading = (qm_quad_reading)(seed / 7 % 2);
        project(&first_batch, &mesh, reading, 1);
        for (size_t i = 0; i < first_batch.count; ++i)
            check_answer(&first_batch, i, &mesh, reading, "moved", seed);
        qm_shape_free(&mesh);
    }
}

/** Longest side of the box of a mesh. */
static double longest_side(const qm_mesh *mesh)
{
    qm_box box = qm_mesh_bounding_box(mesh);
    return fmax(box.max[0] - box.min[0], fmax(box.max[1] - box.min[1], box.max[2] - box.min[2]));
}

/** The errors that project.h promises, for points from a hundredth to 1e13 sizes away. */
static void errors_are_those_promised_however_far_the_points(void **state)
{
    (void)state;
    for (int power = -2; power <= 13; ++power) {
        qm_random random = qm_random_make(qm_check_seed(), (uint64_t)(power + 2));
        qm_mesh mesh = power % 2 ? qm_shape_torus(12, 8, 1, 0.4)
                                 : qm_shape_soup(&random, 30, QM_SOUP_MIXED, QM_SOUP_APART, 0.5);
        double side = longest_side(&mesh);
        first_batch.count = 12;
        for (size_t i = 0; i < first_batch.count; ++i) {
            double scale = pow(10, power) * qm_random_range(&random, 0.3, 3);
            qm_random_direction(&random, first_batch.points + 3 * i);
            for (int k = 0; k < 3; ++k)
                first_batch.points[3 * i + (size_t)k] *= scale;
        }
        for (int reading = 0; reading < 2; ++reading) {
            project(&first_batch, &mesh, (qm_quad_reading)reading, 1);
            for (size_t i = 0; i < first_batch.count; ++i) {
                const double *p = first_batch.points + 3 * i, reported = first_batch.distance[i];
                qm_slow_bracket slow = qm_slow_distance(&mesh, (qm_quad_reading)reading, p, 1e-14 * side);
                double error =
                    reading ? 3.5e-13 * side + 2.5e-14 * slow.upper : 1.5e-13 * side + 2e-14 * slow.upper;
                QM_CHECK(reported >= slow.lower - error && reported <= slow.upper + error,
                         "1e%d, reading %d, point %zu: %.17g, true [%.17g, %.17g]", power, reading, i,
                         reported, slow.lower, slow.upper);
                check_answer(&first_batch, i, &mesh, (qm_quad_reading)reading, "far", (uint64_t)(power + 2));
            }
        }
        qm_shape_free(&mesh);
    }
}

static void equally_near_faces_give_the_lowest_index(void **state)
{
    (void)state;
    enum { N = 8 };
    qm_mesh plane = qm_shape_plane(N, 0);
    first_batch.count = 0;
    for (int j = 0; j <= N; ++j)
        for (int i = 0; i <= N; ++i)
            memcpy(first_batch.points + 3 * first_batch.count++,
                   (const double[]){(double)i / N, (double)j / N, 0.25 * (i + j)}, 24);
    for (int reading = 0; reading < 2; ++reading) {
        project(&first_batch, &plane, (qm_quad_reading)reading, 1);
        for (size_t k = 0; k < first_batch.count; ++k) {
            size_t i = k % (N + 1), j = k / (N + 1);
            size_t lowest = (j ? j - 1 : 0) * N + (i ? i - 1 : 0);
            QM_CHECK(first_batch.face[k] == lowest, "vertex (%zu, %zu): face %u, not %zu", i, j,
                     first_batch.face[k], lowest);
        }
    }
    qm_mesh copies = qm_shape_copies(100);
    qm_random random = qm_random_make(qm_check_seed(), 0);
    draw_points(&first_batch, &random, &copies, 50);
    project(&first_batch, &copies, QM_QUADS_TRIANGLES, 1);
    for (size_t i = 0; i < first_batch.count; ++i)
        assert_int_equal(first_batch.face[i], 0);
    qm_shape_free(&plane);
    qm_shape_free(&copies);
}

static bool same_answer(const batch *a, size_t i, const batch *b, size_t j)
{
    return memcmp(a->distance + i, b->distance + j, sizeof *a->distance) == 0 &&
           memcmp(a->position + 3 * i, b->position + 3 * j, 3 * sizeof *a->position) == 0 &&
           memcmp(a->uv + 2 * i, b->uv + 2 * j, 2 * sizeof *a->uv) == 0 && a->face[i] == b->face[j];
}

/** Meshes with many ties and near-ties: a lattice soup, a torus and duplicated faces. */
static qm_mesh tie_mesh(int which)
{
    qm_random random = qm_random_make(qm_check_seed(), 77);
    if (which == 0) return qm_shape_soup(&random, 60, QM_SOUP_MIXED, QM_SOUP_LATTICE, 1);
    qm_mesh torus = qm_shape_torus(24, 12, 1, 0.4);
    if (which == 1) return torus;
    qm_mesh twice = qm_shape_joined(&torus, &torus);
    qm_shape_free(&torus);
    return twice;
}

static void answers_do_not_depend_on_the_order_of_the_points(void **state)
{
    (void)state;
    static size_t order[BATCH_LIMIT];
    for (int which = 0; which < 3; ++which)
        for (int reading = 0; reading < 2; ++reading) {
            qm_mesh mesh = tie_mesh(which);
            qm_random random = qm_random_make(qm_check_seed(), 5);
            size_t count = BATCH_LIMIT / 3;
            draw_points(&first_batch, &random, &mesh, count);
            second_batch.count = count;
            for (size_t i = 0; i < count; ++i) {
                size_t j = qm_random_below(&random, i + 1);
                order[i] = order[j];
                order[j] = i;
            }
            for (size_t i = 0; i < count; ++i)
                memcpy(second_batch.points + 3 * i, first_batch.points + 3 * order[i], 24);
            project(&first_batch, &mesh, (qm_quad_reading)reading, 1);
            project(&second_batch, &mesh, (qm_quad_reading)reading, 1);
            for (size_t i = 0; i < count; ++i)
                QM_CHECK(same_answer(&second_batch, i, &first_batch, order[i]),
                         "mesh %d, reading %d, point %zu: face %u at %.17g, then face %u at %.17g", which,
                         reading, order[i], first_batch.face[order[i]], first_batch.distance[order[i]],
                         second_batch.face[i], second_batch.distance[i]);
            /* Each alone gives the same again: no hint from the point before. */
            for (size_t i = 0; i < 20; ++i) {
                second_batch.count = 1;
                memcpy(second_batch.points, first_batch.points + 3 * i, 24);
                project(&second_batch, &mesh, (qm_quad_reading)reading, 1);
                QM_CHECK(same_answer(&second_batch, 0, &first_batch, i), "mesh %d, reading %d, point %zu",
                         which, reading, i);
            }
            qm_shape_free(&mesh);
        }
}

static void answers_do_not_depend_on_the_number_of_threads(void **state)
{
    (void)state;
    for (int which = 0; which < 3; ++which)
        for (int reading = 0; reading < 2; ++reading) {
            qm_mesh mesh = tie_mesh(which);
            qm_random random = qm_random_make(qm_check_seed(), 6);
            draw_points(&first_batch, &random, &mesh, BATCH_LIMIT / 3);
            memcpy(&second_batch, &first_batch, sizeof first_batch);
            project(&first_batch, &mesh, (qm_quad_reading)reading, 1);
            for (int k = 0; k < 2; ++k) {
                project(&second_batch, &mesh, (qm_quad_reading)reading, k ? 7 : 2);
                for (size_t i = 0; i < first_batch.count; ++i)
                    QM_CHECK(same_answer(&second_batch, i, &first_batch, i), "mesh %d, reading %d, point %zu",
                             which, reading, i);
            }
            qm_shape_free(&mesh);
        }
}

static void unused_vertices_do_not_attract(void **state)
{
    (void)state;
    qm_mesh box = qm_shape_box(1, 1, 1);
    qm_mesh padded = qm_shape_with_unused(&box, 4, (const double[3]){3, 3, 3});
    first_batch.count = 1;
    memcpy(first_batch.points, (const double[]){3, 0.5, 0.5}, 24);
    project(&first_batch, &padded, QM_QUADS_TRIANGLES, 1);
    assert_true(first_batch.distance[0] == 2);
    qm_shape_free(&box);
    qm_shape_free(&padded);
}

static void arrays_that_are_not_asked_for_are_left_alone(void **state)
{
    (void)state;
    qm_mesh box = qm_shape_box(1, 1, 1);
    qm_context ctx = qm_context_make();
    qm_bvh *tree;
    assert_int_equal(qm_bvh_build(&ctx, &box, QM_BVH_ALL, 1, &tree), QM_OK);
    const double p[3] = {2, 0.5, 0.5};
    double distance = -1;
    uint32_t face = 99;
    qm_projection none = {0}, one = {.distance = &distance}, other = {.face = &face};
    assert_int_equal(qm_project_points(&ctx, tree, QM_QUADS_TRIANGLES, p, 1, 1, &none), QM_OK);
    assert_int_equal(qm_project_points(&ctx, tree, QM_QUADS_TRIANGLES, p, 1, 1, &one), QM_OK);
    assert_int_equal(qm_project_points(&ctx, tree, QM_QUADS_BILINEAR, p, 1, 1, &other), QM_OK);
    assert_int_equal(qm_project_points(&ctx, tree, QM_QUADS_TRIANGLES, p, 0, 1, &one), QM_OK);
    assert_true(distance == 1);
    assert_int_equal(face, 5);
    qm_bvh_destroy(&ctx, tree);
    qm_shape_free(&box);
}

static void points_too_far_to_be_squared_are_named(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh box = qm_shape_box(1, 1, 1);
    qm_bvh *tree;
    assert_int_equal(qm_bvh_build(&ctx, &box, QM_BVH_ALL, 1, &tree), QM_OK);
    const double points[] = {0, 0, 0, 0, 1e80, 0, 0, 0, -1e200};
    double distance[3];
    qm_projection out = {.distance = distance};
    assert_int_equal(qm_project_points(&ctx, tree, QM_QUADS_TRIANGLES, points, 2, 1, &out), QM_OK);
    assert_true(fabs(distance[1] - 1e80) <= 1e65);
    assert_int_equal(qm_project_points(&ctx, tree, QM_QUADS_BILINEAR, points, 3, 1, &out), QM_E_SCALE);
    assert_non_null(strstr(ctx.message, "point 2"));
    qm_bvh_destroy(&ctx, tree);
    qm_shape_free(&box);
}

static void points_that_are_not_finite_are_named(void **state)
{
    (void)state;
    qm_mesh box = qm_shape_box(1, 1, 1);
    qm_context ctx = qm_context_make();
    qm_bvh *tree;
    assert_int_equal(qm_bvh_build(&ctx, &box, QM_BVH_ALL, 1, &tree), QM_OK);
    const double points[9] = {0, 0, 0, 1, 1, 1, 0, NAN, 0}, infinite[3] = {INFINITY, 0, 0};
    double distance[3];
    qm_projection out = {.distance = distance};
    assert_int_equal(qm_project_points(&ctx, tree, QM_QUADS_TRIANGLES, points, 3, 1, &out), QM_E_NOT_FINITE);
    assert_non_null(strchr(ctx.message, '2'));
    assert_int_equal(qm_project_points(&ctx, tree, QM_QUADS_TRIANGLES, infinite, 1, 1, &out),
                     QM_E_NOT_FINITE);
    qm_bvh_destroy(&ctx, tree);
    qm_shape_free(&box);
}

/** Meshes of any size: errors are counted from a size of 2^-1000 on, and what would not be a number is
 * told. */
static void meshes_of_any_size_are_answered_or_refused(void **state)
{
    (void)state;
    static const double sizes[] = {1e-290, 0x1p-1000, 1e-305, 1e-310, 1e-320, 1e89, 0x1p298, 1e300, 1e307};
    for (size_t k = 0; k < sizeof sizes / sizeof *sizes; ++k) {
        qm_random random = qm_random_make(qm_check_seed(), k);
        qm_mesh mesh = qm_shape_soup(&random, 12, QM_SOUP_MIXED, QM_SOUP_APART, 0.5);
        const double none[3] = {0};
        draw_points(&first_batch, &random, &mesh, 12);
        qm_shape_move(&mesh, sizes[k], none);
        for (size_t i = 0; i < 3 * first_batch.count; ++i)
            first_batch.points[i] *= sizes[k];
        double side = fmax(longest_side(&mesh), 0x1p-1000);
        for (int reading = 0; reading < 2; ++reading) {
            project(&first_batch, &mesh, (qm_quad_reading)reading, 1);
            for (size_t i = 0; i < first_batch.count; ++i) {
                /* The twin takes squares: it measures at size 1, to which the powers of two bring all
                 * exactly. */
                double at[3];
                qm_mesh near = qm_shape_copy(&mesh);
                int power = -ilogb(sizes[k]);
                for (size_t j = 0; j < 3 * near.vertex_count; ++j)
                    near.positions[j] = ldexp(near.positions[j], power);
                for (int j = 0; j < 3; ++j)
                    at[j] = ldexp(first_batch.points[3 * i + (size_t)j], power);
                double reported = ldexp(first_batch.distance[i], power);
                qm_slow_bracket slow = qm_slow_distance(&near, (qm_quad_reading)reading, at, 1e-14);
                double error = 3.5e-13 * ldexp(side, power) + 2.5e-14 * slow.upper + ldexp(0x1p-1074, power);
                QM_CHECK(reported >= slow.lower - error && reported <= slow.upper + error,
                         "size %g, reading %d, point %zu: %.17g, true [%.17g, %.17g]", sizes[k], reading, i,
                         reported, slow.lower, slow.upper);
                for (int j = 0; j < 3; ++j)
                    assert_true(isfinite(first_batch.position[3 * i + (size_t)j]));
                qm_shape_free(&near);
            }
        }
        qm_shape_free(&mesh);
    }
}

/** A quad round the origin whose squared sides are no normal numbers, far within a box of ordinary size: it
 * is as far as the origin is, but for its size. */
static void a_speck_is_as_far_as_its_place(void **state)
{
    (void)state;
    static const double far[][3] = {{-9, -9, -9}, {-9, -8, -9}, {-8, -9, -9},
                                    {9, 9, 9},    {9, 8, 9},    {8, 9, 9}};
    static const uint32_t faces[] = {0, 1, 2, QM_NO_INDEX, 3, 4, 5, QM_NO_INDEX, 6, 7, 8, 9};
    qm_random random = qm_random_make(qm_check_seed(), 0);
    const double origin[3] = {0};
    for (int k = 0; k < 400; ++k) {
        double size = pow(10, qm_random_range(&random, -320, -120));
        qm_mesh mesh = qm_shape_make(10, 3);
        memcpy(mesh.positions, far, sizeof far);
        memcpy(mesh.faces, faces, sizeof faces);
        for (size_t i = 18; i < 30; ++i)
            mesh.positions[i] = size * qm_random_range(&random, -1, 1);
        first_batch.count = 16;
        for (size_t i = 0; i < first_batch.count; ++i)
            qm_random_point(&random, -1, 1, first_batch.points + 3 * i);
        for (int reading = 0; reading < 2; ++reading) {
            project(&first_batch, &mesh, (qm_quad_reading)reading, 1);
            for (size_t i = 0; i < first_batch.count; ++i) {
                double truth = gap(first_batch.points + 3 * i, origin), reported = first_batch.distance[i];
                QM_CHECK(first_batch.face[i] == 2 && fabs(reported - truth) <= 3.5e-13 * 18,
                         "size %.3g, reading %d: face %u, %.17g, true %.17g", size, reading,
                         first_batch.face[i], reported, truth);
            }
        }
        qm_shape_free(&mesh);
    }
}

static void distances_that_overflow_are_refused(void **state)
{
    (void)state;
    const double far = 1.7e308, corner[][3] = {{far, far, far}, {1e308, far, far}, {far, 1e308, far}},
                 points[] = {far, far, 1.5e308, -far, -far, -far, 0, 0, 0, -1e308, 0, far};
    qm_context ctx = qm_context_make();
    qm_mesh mesh = qm_shape_face(3, corner);
    qm_bvh *tree;
    assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &tree), QM_OK);
    double distance[4], position[12];
    qm_projection out = {.distance = distance, .position = position};
    for (size_t i = 0; i < 4; i++) {
        qm_status status = qm_project_points(&ctx, tree, QM_QUADS_TRIANGLES, points + 3 * i, 1, 1, &out);
        QM_CHECK(status == QM_E_SCALE || (status == QM_OK && isfinite(distance[0]) && isfinite(position[0]) &&
                                          isfinite(position[1]) && isfinite(position[2])),
                 "point %zu: status %d, %g", i, (int)status, distance[0]);
        if (i == 1) assert_int_equal(status, QM_E_SCALE);
    }
    qm_bvh_destroy(&ctx, tree);
    qm_shape_free(&mesh);
}

static void a_raised_flag_cancels(void **state)
{
    (void)state;
    qm_mesh mesh = qm_shape_torus(24, 12, 1, 0.4);
    qm_context ctx = qm_context_make();
    qm_bvh *tree;
    assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &tree), QM_OK);
    qm_random random = qm_random_make(qm_check_seed(), 6);
    draw_points(&first_batch, &random, &mesh, BATCH_LIMIT);
    atomic_bool cancel = true;
    ctx.cancel = &cancel;
    qm_projection out = {.distance = first_batch.distance};
    assert_int_equal(
        qm_project_points(&ctx, tree, QM_QUADS_TRIANGLES, first_batch.points, BATCH_LIMIT, 1, &out),
        QM_E_CANCELED);
    qm_bvh *refused = tree;
    assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &refused), QM_E_CANCELED);
    assert_null(refused);
    qm_bvh_destroy(&ctx, tree);
    qm_shape_free(&mesh);
}

/** Builds and projects with the allocator failing at one call after the other, until none fails. */
static void running_out_of_memory_is_a_status_and_leaks_nothing(void **state)
{
    (void)state;
    qm_mesh mesh = qm_shape_torus(24, 12, 1, 0.4);
    qm_random random = qm_random_make(qm_check_seed(), 6);
    draw_points(&first_batch, &random, &mesh, 200);
    qm_status status = QM_E_NO_MEMORY;
    size_t failures = 0;
    for (size_t fail_at = 0; status != QM_OK; ++fail_at) {
        qm_failing_allocator memory = {.fail_at = fail_at};
        qm_context ctx = qm_context_make();
        ctx.allocator = qm_failing_allocator_hook(&memory);
        qm_bvh *tree = NULL;
        status = qm_bvh_build(&ctx, &mesh, QM_BVH_ALL, 1, &tree);
        qm_projection out = {.distance = first_batch.distance};
        if (status == QM_OK)
            status = qm_project_points(&ctx, tree, QM_QUADS_BILINEAR, first_batch.points, 200, 1, &out);
        else
            assert_null(tree);
        qm_bvh_destroy(&ctx, tree);
        QM_CHECK(status == QM_OK || status == QM_E_NO_MEMORY, "call %zu: status %d", fail_at, (int)status);
        QM_CHECK(memory.live_blocks == 0 && memory.live_bytes == 0, "call %zu: %zu blocks left", fail_at,
                 memory.live_blocks);
        QM_CHECK(!memory.mismatched, "call %zu: a block came back with another size", fail_at);
        failures += status == QM_E_NO_MEMORY;
    }
    assert_true(failures >= 3);
    qm_shape_free(&mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(soups_match_brute_force),
        cmocka_unit_test(shapes_match_brute_force),
        cmocka_unit_test(moved_and_scaled_meshes_match_brute_force),
        cmocka_unit_test(errors_are_those_promised_however_far_the_points),
        cmocka_unit_test(equally_near_faces_give_the_lowest_index),
        cmocka_unit_test(answers_do_not_depend_on_the_order_of_the_points),
        cmocka_unit_test(answers_do_not_depend_on_the_number_of_threads),
        cmocka_unit_test(unused_vertices_do_not_attract),
        cmocka_unit_test(arrays_that_are_not_asked_for_are_left_alone),
        cmocka_unit_test(points_that_are_not_finite_are_named),
        cmocka_unit_test(points_too_far_to_be_squared_are_named),
        cmocka_unit_test(meshes_of_any_size_are_answered_or_refused),
        cmocka_unit_test(a_speck_is_as_far_as_its_place),
        cmocka_unit_test(distances_that_overflow_are_refused),
        cmocka_unit_test(a_raised_flag_cancels),
        cmocka_unit_test(running_out_of_memory_is_a_status_and_leaks_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
