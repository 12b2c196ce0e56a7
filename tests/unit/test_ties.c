/* The face that a projection returns among several equally near ones: the rule of project.h against distances in 113
 * bits, on every accelerator and kernel, from any start, and with the faces in the opposite order. */
#include "check.h"

#include "bvh/nearest.h"
#include "data_mesh.h"
#include "ground.h"
#include "qm/project.h"
#include "random.h"
#include "shapes.h"
#include "slow_twin.h"

#include <math.h>
#include <string.h>

enum { FACE_LIMIT = 4096 };

static const qm_accelerator accelerators[] = {QM_ACCELERATOR_BOXES, QM_ACCELERATOR_GRID,
                                              QM_ACCELERATOR_TETRA};
enum { ACCELERATORS = sizeof accelerators / sizeof *accelerators };

typedef struct target {
    const char *name;
    uint64_t seed;
    qm_context ctx;
    qm_mesh mesh;
    qm_bvh *tree;
    qm_locator locator[ACCELERATORS];
} target;

static void target_make(target *t, const char *name, uint64_t seed, qm_mesh mesh)
{
    *t = (target){.name = name, .seed = seed, .ctx = qm_context_make(), .mesh = mesh};
    assert_true(mesh.face_count <= FACE_LIMIT);
    assert_int_equal(qm_bvh_build(&t->ctx, &mesh, QM_BVH_ALL, 1, &t->tree), QM_OK);
    for (int i = 0; i < ACCELERATORS; i++)
        assert_int_equal(qm_locator_build(&t->ctx, t->tree, NULL, accelerators[i], &t->locator[i]), QM_OK);
}

static void target_free(target *t)
{
    for (int i = 0; i < ACCELERATORS; i++)
        qm_locator_reset(&t->ctx, &t->locator[i]);
    qm_bvh_destroy(&t->ctx, t->tree);
}

/** What is known of the distances to the faces, and of the errors of computed ones. Unit of the mesh. */
typedef struct truth {
    double lower[FACE_LIMIT], upper[FACE_LIMIT];
    double least_lower, least_upper;
    double error; /* of a computed distance */
    double tied;  /* faces that are no more than this farther than the nearest surely win over higher ones */
} truth;

static truth known;

static void find_truth(const target *t, qm_quad_reading reading, const double p[3])
{
    qm_vec local = qm_frame_local(&t->tree->frame, p);
    bool has_patches = reading == QM_QUADS_BILINEAR && t->tree->has_quads;
    double unit = t->tree->frame.inverse_scale, rounding = qm_distance_rounding(local) * unit;
    known.error = rounding + (has_patches ? qm_bilinear_error(local) * unit : 0.0);
    /* Computed distances are never more than the rounding below the true ones: half of the rest is spare. */
    known.tied = has_patches ? 0.25 * QM_BILINEAR_MIN_ERROR * unit : 0.0;
    known.least_lower = known.least_upper = INFINITY;
    for (size_t i = 0; i < t->mesh.face_count; i++) {
        qm_slow_bracket slow = qm_slow_face_distance(&t->mesh, i, reading, p, fmax(known.tied, 1e-16 * unit));
        known.lower[i] = slow.lower;
        known.upper[i] = slow.upper;
        known.least_lower = fmin(known.least_lower, slow.lower);
        known.least_upper = fmin(known.least_upper, slow.upper);
    }
}

/** No face that surely ties has a lower index, and the returned one is hardly farther than the nearest. */
static void check_rule(const target *t, qm_quad_reading reading, const double p[3], uint32_t face,
                       double distance)
{
    double tau = 2.0 * known.error;
    QM_CHECK(known.lower[face] <= known.least_upper + tau + 2.0 * known.error,
             "%s, seed %llu, reading %d, (%.17g, %.17g, %.17g): face %u at %.17g, the nearest at %.17g",
             t->name, (unsigned long long)t->seed, (int)reading, p[0], p[1], p[2], face, known.lower[face],
             known.least_upper);
    QM_CHECK(distance >= known.lower[face] - known.error && distance <= known.upper[face] + known.error,
             "%s, seed %llu, reading %d: face %u reported at %.17g, is at [%.17g, %.17g]", t->name,
             (unsigned long long)t->seed, (int)reading, face, distance, known.lower[face], known.upper[face]);
    for (uint32_t lower = 0; lower < face; lower++)
        QM_CHECK(known.upper[lower] > known.least_lower + known.tied,
                 "%s, seed %llu, reading %d, (%.17g, %.17g, %.17g): face %u at %.17g, but %u at %.17g",
                 t->name, (unsigned long long)t->seed, (int)reading, p[0], p[1], p[2], face,
                 known.lower[face], lower, known.upper[lower]);
}

/** Every kernel and accelerator, from several packs: the same face, lane and bits of the distance. */
static qm_tie find_face(const target *t, qm_quad_reading reading, const double p[3], qm_random *random)
{
    qm_vec local = qm_frame_local(&t->tree->frame, p);
    uint32_t hint = 0;
    qm_tie first = qm_nearest_face(qm_kernel_get(), &t->locator[0], reading, local, &hint);
    for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; kernel++) {
        for (int i = 0; i < ACCELERATORS; i++) {
            hint = (uint32_t)qm_random_below(random, t->tree->pack_count);
            qm_tie tie = qm_nearest_face(*kernel, &t->locator[i], reading, local, &hint);
            QM_CHECK(
                tie.face == first.face && tie.pack == first.pack && tie.lane == first.lane &&
                    tie.distance == first.distance,
                "%s, seed %llu, reading %d, (%.17g, %.17g, %.17g), %s, accelerator %d: face %u at %.17g, "
                "not %u at %.17g",
                t->name, (unsigned long long)t->seed, (int)reading, p[0], p[1], p[2], (*kernel)->name,
                (int)accelerators[i], tie.face, tie.distance, first.face, first.distance);
        }
    }
    return first;
}

/** Distance, position and parameters of an answer are those of its face, the same from every accelerator. */
static void check_answer(const target *t, qm_quad_reading reading, const double p[3], const qm_tie *tie)
{
    double distance[ACCELERATORS], position[ACCELERATORS][3], uv[ACCELERATORS][2], at[3];
    uint32_t face[ACCELERATORS];
    qm_context ctx = t->ctx;
    for (int i = 0; i < ACCELERATORS; i++) {
        qm_projection out = {&distance[i], position[i], &face[i], uv[i]};
        assert_int_equal(qm_project_points_with(&ctx, &t->locator[i], reading, p, 1, 1, &out), QM_OK);
        QM_CHECK(face[i] == tie->face && distance[i] == tie->distance * t->tree->frame.inverse_scale,
                 "%s, seed %llu: face %u at %.17g, not %u", t->name, (unsigned long long)t->seed, face[i],
                 distance[i], tie->face);
        assert_memory_equal(position[i], position[0], sizeof *position);
        assert_memory_equal(uv[i], uv[0], sizeof *uv);
    }
    qm_slow_position(&t->mesh, face[0], reading, uv[0], at);
    double gap = 0.0, there = 0.0, world = 0.0;
    for (int k = 0; k < 3; k++) {
        gap = hypot(gap, at[k] - position[0][k]);
        there = hypot(there, p[k] - position[0][k]);
        world = fmax(world, fabs(position[0][k]));
    }
    double slack = 2.0 * known.error + 0x1p-50 * world;
    QM_CHECK(gap <= slack && fabs(there - distance[0]) <= slack,
             "%s, seed %llu, reading %d, face %u: foot %g from its parameters, %.17g away and not %.17g",
             t->name, (unsigned long long)t->seed, (int)reading, face[0], gap, there, distance[0]);
}

static void check_point(const target *t, const double p[3], qm_random *random)
{
    for (int reading = 0; reading < 2; reading++) {
        find_truth(t, (qm_quad_reading)reading, p);
        qm_tie tie = find_face(t, (qm_quad_reading)reading, p, random);
        check_rule(t, (qm_quad_reading)reading, p, tie.face, tie.distance * t->tree->frame.inverse_scale);
        check_answer(t, (qm_quad_reading)reading, p, &tie);
    }
}

static qm_mesh reversed(const qm_mesh *mesh)
{
    qm_mesh turned = qm_shape_copy(mesh);
    for (size_t i = 0; i < mesh->face_count; i++)
        memcpy((uint32_t *)turned.faces + 4 * i, mesh->faces + 4 * (mesh->face_count - 1 - i), 16);
    return turned;
}

/** Checks points on a mesh, and on the one with its faces in the opposite order. */
static void check_mesh(const char *name, uint64_t seed, qm_mesh mesh, const double *points, size_t count)
{
    qm_mesh meshes[2] = {mesh, reversed(&mesh)};
    for (int order = 0; order < 2; order++) {
        target t;
        qm_random random = qm_random_make(qm_check_seed(), seed + 1000);
        target_make(&t, name, seed, meshes[order]);
        for (size_t i = 0; i < count; i++)
            check_point(&t, points + 3 * i, &random);
        target_free(&t);
    }
    qm_shape_free(&meshes[0]);
    qm_shape_free(&meshes[1]);
}

/* ---- ties by construction ---- */

/** Coordinates in another order: faces in every direction. */
static void turn_axes(double *rows, size_t count, int by)
{
    for (size_t i = 0; i < count; i++) {
        double kept[3];
        memcpy(kept, rows + 3 * i, sizeof kept);
        for (int k = 0; k < 3; k++)
            rows[3 * i + (size_t)((k + by) % 3)] = kept[k];
    }
}

static void grids_tie_at_their_vertices_and_edges(void **state)
{
    (void)state;
    enum { N = 7 };
    static double points[3 * (2 * N + 1) * (2 * N + 1)];
    for (int turn = 0; turn < 3; turn++) {
        for (int n = 4; n <= N; n += 3) {
            qm_mesh plane = qm_shape_plane(n, 0.0);
            size_t count = 0;
            for (int j = 0; j <= 2 * n; j++)
                for (int i = 0; i <= 2 * n; i++, count++)
                    memcpy(points + 3 * count, (double[]){0.5 * i / n, 0.5 * j / n, 0.3 * (i + j) / n}, 24);
            turn_axes(plane.positions, plane.vertex_count, turn);
            turn_axes(points, count, turn);
            check_mesh("grid", (uint64_t)(10 * turn + n), plane, points, count);
        }
    }
}

/** count triangles, or half as many quads, round an apex, over a convex polygon of exact coordinates. */
static qm_mesh cone_make(uint32_t count, bool quads)
{
    uint32_t faces = quads ? count / 2 : count;
    qm_mesh mesh = qm_shape_make(1 + count, faces);
    double *at = mesh.positions;
    memcpy(at, (double[]){0.125, 0.375, 1.0}, 24);
    for (uint32_t i = 0; i < count; i++) {
        double angle = 2.0 * 3.14159265358979 * i / count;
        for (int k = 0; k < 3; k++) /* not all in one plane, so that quads are bent */
            at[3 * (i + 1) + (uint32_t)k] = ldexp(rint(ldexp(k == 0   ? cos(angle)
                                                             : k == 1 ? sin(angle)
                                                                      : 0.03 * (i % 3),
                                                             20)),
                                                  -20);
    }
    for (uint32_t i = 0; i < faces; i++) {
        uint32_t step = quads ? 2 : 1, first = step * i, *face = mesh.faces + 4 * i;
        face[0] = 0;
        face[1] = 1 + first;
        face[2] = 1 + (first + 1) % count;
        face[3] = quads ? 1 + (first + 2) % count : QM_NO_INDEX;
    }
    return mesh;
}

static void cones_tie_at_their_apex(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 0);
    double points[3 * 24];
    for (size_t i = 0; i < 24; i++) {
        double away = exp2(qm_random_range(&random, -30, 3));
        points[3 * i] = 0.125 + 0.2 * away * qm_random_range(&random, -1, 1);
        points[3 * i + 1] = 0.375 + 0.2 * away * qm_random_range(&random, -1, 1);
        points[3 * i + 2] = 1.0 + away;
    }
    check_mesh("cone of triangles", 64, cone_make(64, false), points, 24);
    check_mesh("cone of quads", 65, cone_make(64, true), points, 24);
    check_mesh("cone of many", 500, cone_make(500, false), points, 8);
}

/** The nearest face has the highest index, and all are within tau: more than a list of ties holds. Faces are
 * moved aside, so that they are looked at in no order of their indices. */
static void check_stack(uint64_t seed)
{
    enum { COUNT = 36 };
    qm_random random = qm_random_make(qm_check_seed(), seed);
    qm_mesh stack = qm_shape_make(4 * COUNT, COUNT);
    for (uint32_t i = 0; i < COUNT; i++) {
        double aside[2] = {qm_random_range(&random, -0.4, 0.4), qm_random_range(&random, -0.4, 0.4)};
        for (uint32_t k = 0; k < 4; k++) {
            double *at = stack.positions + 3 * (4 * i + k);
            at[0] = (k == 1 || k == 2 ? 1.0 : 0.0) + aside[0];
            at[1] = (k >= 2 ? 1.0 : 0.0) + aside[1];
            at[2] = 0.5 + 0x1p-53 * i;
            stack.faces[4 * i + k] = 4 * i + k;
        }
    }
    target t;
    target_make(&t, "stack", seed, stack);
    for (int i = 0; i < 3; i++) {
        double p[3] = {qm_random_range(&random, 0.45, 0.55), qm_random_range(&random, 0.45, 0.55), 1.25};
        for (int reading = 0; reading < 2; reading++) {
            qm_tie tie = find_face(&t, (qm_quad_reading)reading, p, &random);
            QM_CHECK(tie.face == 0, "stack %llu, point %d, reading %d: face %u", (unsigned long long)seed, i,
                     reading, tie.face);
        }
        check_point(&t, p, &random);
    }
    target_free(&t);
    qm_shape_free(&stack);
}

static void stacks_of_faces_within_tau_give_the_lowest(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 12; seed++)
        check_stack(seed);
}

static void the_middle_of_a_sphere_gives_the_first_face(void **state)
{
    (void)state;
    qm_mesh sphere = qm_shape_sphere(0.0), cut = qm_shape_triangulated(&sphere);
    const double points[] = {0, 0, 0, 0, 0, 0.25};
    cut.face_count = FACE_LIMIT;
    check_mesh("sphere", 0, cut, points, 2);
    qm_shape_free(&sphere);
}

/* ---- ties at random ---- */

/** Points whose nearest point is likely a vertex or on an edge: off those, and in between. */
static void draw_points(const qm_mesh *mesh, qm_random *random, double *points, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        const uint32_t *face = mesh->faces + 4 * qm_random_below(random, mesh->face_count);
        const double *a = mesh->positions + 3 * (size_t)face[0], *b = mesh->positions + 3 * (size_t)face[1];
        double share = (double[]){0, 0.5, qm_random_range(random, 0, 1)}[i % 3], off[3];
        double away = exp2(qm_random_range(random, -40, 2));
        qm_random_direction(random, off);
        for (int k = 0; k < 3; k++)
            points[3 * i + (size_t)k] = a[k] + share * (b[k] - a[k]) + (i % 4 ? away * off[k] : 0.0);
    }
}

static void random_meshes_follow_the_rule(void **state)
{
    (void)state;
    enum { COUNT = 12 };
    uint64_t count = qm_check_long() ? 3000 : 60;
    for (uint64_t seed = 0; seed < count; seed++) {
        qm_random random = qm_random_make(qm_check_seed(), seed);
        double points[3 * COUNT], shake = (double[]){0, 0.02, 0.1}[seed % 3];
        qm_mesh mesh = seed % 5 == 0   ? qm_shape_torus(10, 6, 1, 0.4)
                       : seed % 5 == 1 ? qm_shape_box(1, 1, 1)
                       : seed % 5 == 2 ? qm_shape_saddle(5)
                                       : qm_shape_soup(&random, 30, (qm_soup_corners)(seed % 3),
                                                       (qm_soup_style)(seed / 5 % QM_SOUP_STYLE_COUNT), 0.5);
        if (seed % 5 < 3) qm_shape_shake(&mesh, &random, shake);
        if (seed % 7 == 6) {
            qm_mesh cut = qm_shape_triangulated(&mesh);
            qm_shape_free(&mesh);
            mesh = cut;
        }
        draw_points(&mesh, &random, points, COUNT);
        check_mesh("random", seed, mesh, points, COUNT);
    }
}

static void accelerators_agree_on_a_mesh_that_they_did_not(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh mesh;
    qm_data_mesh_read(&ctx, "rigour/acc_509.obj", &mesh);
    const double point[] = {0.7142857142857143, 0.7142857142857143, 0.00036858182792235626};
    check_mesh("acc_509", 509, qm_shape_copy(&mesh), point, 1);
    qm_mesh_reset(&ctx, &mesh);
}

/** A thread starts a search where its last one ended: points over vertices and edges of faces, in two orders, have the same footpoints
 * and normals, to the bit. */
static void footpoints_do_not_depend_on_the_last_search(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 77);
    qm_ground g[3];
    qm_ground_make(&g[0], qm_shape_plane(24, 0.0));
    qm_ground_make(&g[1], qm_shape_cube_grid(12));
    qm_ground_make(&g[2], qm_shape_torus(48, 24, 1.0, 0.35));
    enum { POINTS = 2000 };
    static double point[3][POINTS][3];
    static qm_ref_surface_point first[3][POINTS];
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < POINTS; i++) {
            const qm_mesh *mesh = &g[k].mesh;
            const uint32_t *face = mesh->faces + 4 * qm_random_below(&random, mesh->face_count);
            const double *a = mesh->positions + 3 * (size_t)face[0],
                         *b = mesh->positions + 3 * (size_t)face[1];
            double share = i % 3 == 0 ? 0.0 : i % 3 == 1 ? 0.5 : qm_random_range(&random, 0.0, 1.0);
            double out = i % 2 ? 0.0 : qm_random_range(&random, -0.2, 0.2);
            for (int axis = 0; axis < 3; axis++)
                point[k][i][axis] = a[axis] + share * (b[axis] - a[axis]) + (axis == 2 ? out : 0.0);
        }
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < POINTS; i++)
            qm_ref_surface_project(&g[k].source, point[k][i], &first[k][i]);
    for (int i = POINTS - 1; i >= 0; i--)
        for (int k = 0; k < 3; k++) {
            qm_ref_surface_point again;
            qm_ref_surface_project(&g[k].source, point[k][i], &again);
            QM_CHECK(memcmp(again.position, first[k][i].position, sizeof again.position) == 0 &&
                         memcmp(again.normal, first[k][i].normal, sizeof again.normal) == 0 &&
                         again.distance == first[k][i].distance,
                     "seed %llu, surface %d, point %d", (unsigned long long)qm_check_seed(), k, i);
        }
    for (int k = 0; k < 3; k++)
        qm_ground_free(&g[k]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(grids_tie_at_their_vertices_and_edges),
        cmocka_unit_test(cones_tie_at_their_apex),
        cmocka_unit_test(stacks_of_faces_within_tau_give_the_lowest),
        cmocka_unit_test(the_middle_of_a_sphere_gives_the_first_face),
        cmocka_unit_test(footpoints_do_not_depend_on_the_last_search),
        cmocka_unit_test(random_meshes_follow_the_rule),
    };
    const struct CMUnitTest data[] = {cmocka_unit_test(accelerators_agree_on_a_mesh_that_they_did_not)};
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    return failed + qm_data_run_group_tests(data);
}
