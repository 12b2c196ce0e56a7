/* qm_quads_settle: the vertices of a mesh of quads move, its faces stay; what comes out is measured by other code. */
#include "check.h"
#include "measured.h"

#include "core/vec.h"
#include "failing_allocator.h"
#include "qm/hausdorff.h"
#include "qm/quads.h"
#include "quad_topology.h"
#include "random.h"
#include "shapes.h"

#include <math.h>
#include <string.h>

/* ---- shapes ---- */

typedef void move_fn(double p[3]);

/** The cube [-1, 1]^3 of n x n quads a side, each point moved. */
static qm_mesh make_shape(int n, move_fn *move)
{
    qm_mesh m = qm_shape_cube_grid(n);
    for (size_t v = 0; v < m.vertex_count; v++)
        move(m.positions + 3 * v);
    return m;
}

static void to_cube(double p[3])
{
    (void)p;
}

static void to_sphere(double p[3])
{
    double length = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
    for (int k = 0; k < 3; k++)
        p[k] /= length;
}

/** A sphere with three fingers, as long as its diameter. */
static void to_fingers(double p[3])
{
    static const double way[3][3] = {{0.96, 0.28, 0}, {-0.6, 0, 0.8}, {0, -0.8, -0.6}};
    to_sphere(p);
    double size = 1.0;
    for (int i = 0; i < 3; i++) {
        double cosine = qm_clamp(p[0] * way[i][0] + p[1] * way[i][1] + p[2] * way[i][2], -1.0, 1.0);
        size += 2.0 * exp(-pow(acos(cosine) / 0.3, 4.0));
    }
    for (int k = 0; k < 3; k++)
        p[k] *= size;
}

/** A sphere with a crevice round its equator, about as wide as a quad of 15 a side. */
static void to_crevice(double p[3])
{
    to_sphere(p);
    double size = 1.0 - 0.3 * exp(-pow(p[2] / 0.05, 2.0));
    for (int k = 0; k < 3; k++)
        p[k] *= size;
}

/** A sphere turned about its axis, the more the higher: its quads are sheared. */
static void to_twisted(double p[3])
{
    to_sphere(p);
    double angle = 1.2 * p[2], x = p[0], y = p[1];
    p[0] = cos(angle) * x - sin(angle) * y;
    p[1] = sin(angle) * x + cos(angle) * y;
}

/* ---- checks ---- */

static double distance_between(const qm_mesh *a, const qm_mesh *b)
{
    qm_hausdorff_options options = qm_hausdorff_options_default();
    options.tolerance = 1e-5;
    return qm_measured(a, b, &options).upper;
}

/** Settles a mesh; its faces must stay. */
static void settle_as(const qm_mesh *surface, qm_quads_settling how, const qm_quads_marks *marks,
                      qm_mesh *mesh, int threads)
{
    qm_context ctx = qm_context_make();
    qm_bvh *bvh;
    qm_quads_options options = qm_quads_options_default();
    options.thread_count = threads;
    qm_mesh before = qm_shape_copy(mesh);
    assert_int_equal(qm_bvh_build(&ctx, surface, QM_BVH_TARGET, 1, &bvh), QM_OK);
    QM_CHECK(qm_quads_settle(&ctx, bvh, &options, how, marks, mesh) == QM_OK, "%s", ctx.message);
    assert_int_equal(mesh->face_count, before.face_count);
    assert_int_equal(mesh->vertex_count, before.vertex_count);
    assert_memory_equal(mesh->faces, before.faces, 4 * mesh->face_count * sizeof *mesh->faces);
    qm_bvh_destroy(&ctx, bvh);
    qm_shape_free(&before);
}

static void settle_marked(const qm_mesh *surface, const qm_quads_marks *marks, qm_mesh *mesh, int threads)
{
    settle_as(surface, QM_QUADS_SPREAD, marks, mesh, threads);
}

static void settle(const qm_mesh *surface, qm_mesh *mesh, int threads)
{
    settle_marked(surface, NULL, mesh, threads);
}

static void shaken_quads_open(void **state)
{
    (void)state;
    qm_mesh surface = make_shape(32, to_sphere), smooth = make_shape(8, to_sphere);
    double own = distance_between(&surface, &smooth);
    for (uint64_t seed = 1; seed <= 4; seed++) {
        qm_random random = qm_random_make(seed, 0);
        qm_mesh mesh = qm_shape_copy(&smooth);
        qm_shape_shake(&mesh, &random, 0.14); /* of sides between 0.15 and 0.25 */
        size_t before = qm_topology_count_folded(&mesh);
        settle(&surface, &mesh, 1);
        double least = qm_topology_least_sine(&mesh), distance = distance_between(&surface, &mesh);
        QM_CHECK(before > 0 && qm_topology_count_folded(&mesh) == 0 && least >= 0.3,
                 "seed %llu: %zu folded before, least sine %.3f", (unsigned long long)seed, before, least);
        QM_CHECK(distance <= own, "seed %llu: distance %.4f, without shaking %.4f", (unsigned long long)seed,
                 distance, own);
        qm_shape_free(&mesh);
    }
    qm_shape_free(&surface);
    qm_shape_free(&smooth);
}

/** Vertices within a reach of a place change sides, as in a mirror: they lie in the wrong order over a part that is wider than what
 * opens bad quads. */
static void mirror_part(qm_mesh *m, const double middle[3], double reach)
{
    const qm_mesh before = qm_shape_copy(m);
    for (size_t v = 0; v < m->vertex_count; v++) {
        const double *p = before.positions + 3 * v;
        double away[3], image[3], best = INFINITY;
        for (int k = 0; k < 3; k++)
            away[k] = p[k] - middle[k];
        if (sqrt(away[0] * away[0] + away[1] * away[1] + away[2] * away[2]) > reach) continue;
        for (int k = 0; k < 3; k++)
            image[k] = middle[k] + (k == 0 ? -away[k] : away[k]);
        for (size_t u = 0; u < m->vertex_count; u++) {
            const double *q = before.positions + 3 * u;
            double off = fabs(q[0] - image[0]) + fabs(q[1] - image[1]) + fabs(q[2] - image[2]);
            if (off < best) best = off, memcpy(m->positions + 3 * v, q, 3 * sizeof(double));
        }
    }
    qm_mesh copy = before;
    qm_shape_free(&copy);
}

static void parts_in_the_wrong_order_open(void **state)
{
    (void)state;
    qm_mesh surface = make_shape(48, to_sphere), smooth = make_shape(16, to_sphere);
    double own = distance_between(&surface, &smooth);
    const double middle[2][3] = {{0, 0, 1}, {0, 0.6, 0.8}};
    for (int i = 0; i < 2; i++)
        for (int rings = 2; rings <= 6; rings++) {
            qm_mesh mesh = qm_shape_copy(&smooth);
            mirror_part(&mesh, middle[i], 0.11 * rings);
            size_t before = qm_topology_count_folded(&mesh);
            settle(&surface, &mesh, 1);
            double least = qm_topology_least_sine(&mesh), distance = distance_between(&surface, &mesh);
            QM_CHECK(before > 0 && qm_topology_count_folded(&mesh) == 0 && least >= 0.3,
                     "%d, %d rings: %zu folded before, least sine %.3f", i, rings, before, least);
            QM_CHECK(distance <= 1.5 * own, "%d, %d rings: distance %.4f, without it %.4f", i, rings,
                     distance, own);
            qm_shape_free(&mesh);
        }
    qm_shape_free(&surface);
    qm_shape_free(&smooth);
}

/** What moves once either has few poor quads then, or is as it was. Whether it is near is for the caller, where part of it was turned round. */
static void what_moves_once_is_good_or_goes_back(void **state)
{
    (void)state;
    qm_mesh surface = make_shape(48, to_sphere), smooth = make_shape(16, to_sphere);
    double own = distance_between(&surface, &smooth);
    size_t opened = 0, gone_back = 0;
    for (int k = 0; k < 12; k++) {
        qm_random random = qm_random_make(qm_check_seed(), (uint64_t)k);
        qm_mesh mesh = qm_shape_copy(&smooth);
        qm_shape_shake(&mesh, &random, 0.01 * (1 + k)); /* of sides between 0.07 and 0.12 */
        bool is_turned = k >= 6;
        if (is_turned) mirror_part(&mesh, (const double[3]){0, 0, 1}, 0.11 * k);
        const qm_mesh before = qm_shape_copy(&mesh);
        settle_as(&surface, QM_QUADS_SPREAD_ONCE, NULL, &mesh, 1);
        bool is_as_before =
            memcmp(mesh.positions, before.positions, 3 * mesh.vertex_count * sizeof(double)) == 0;
        double distance = distance_between(&surface, &mesh);
        QM_CHECK(is_as_before || (qm_topology_count_folded(&mesh) == 0 && qm_quads_count_poor(&mesh) <= 4 &&
                                  (is_turned || distance <= 1.5 * own)),
                 "seed %llu, stream %d: %zu folded, %zu poor, distance %.4f, without shaking %.4f",
                 (unsigned long long)qm_check_seed(), k, qm_topology_count_folded(&mesh),
                 qm_quads_count_poor(&mesh), distance, own);
        opened += !is_as_before;
        gone_back += is_as_before;
        qm_mesh copy = before;
        qm_shape_free(&copy);
        qm_shape_free(&mesh);
    }
    QM_CHECK(opened > 0 && gone_back > 0, "%zu opened, %zu went back", opened, gone_back);
    qm_shape_free(&surface);
    qm_shape_free(&smooth);
}

static void vertices_are_drawn_along_fingers(void **state)
{
    (void)state;
    qm_mesh surface = make_shape(64, to_fingers), mesh = make_shape(16, to_fingers);
    double before = distance_between(&surface, &mesh);
    settle(&surface, &mesh, 1);
    double least = qm_topology_least_sine(&mesh), after = distance_between(&surface, &mesh);
    QM_CHECK(qm_topology_count_folded(&mesh) == 0 && least >= 0.2, "least sine %.3f", least);
    QM_CHECK(after <= 0.5 * before, "distance %.4f, before %.4f", after, before);
    qm_shape_free(&surface);
    qm_shape_free(&mesh);
}

/** How many coordinates of a point are -1 or 1: 2 on an edge of the cube, 3 at its corners. */
static int count_ends(const double p[3], double tolerance)
{
    int count = 0;
    for (int k = 0; k < 3; k++)
        count += fabs(fabs(p[k]) - 1.0) <= tolerance;
    return count;
}

/** Where quads span a crevice, the normals at their corners do not tell of it. */
static void vertices_are_drawn_into_crevices(void **state)
{
    (void)state;
    qm_mesh surface = make_shape(96, to_crevice), mesh = make_shape(15, to_sphere);
    settle(&surface, &mesh, 1);
    double after = distance_between(&surface, &mesh);
    /* By the normals alone it is 0.102. */
    QM_CHECK(after <= 0.08 && qm_topology_least_sine(&mesh) >= 0.3, "distance %.4f", after);
    qm_shape_free(&surface);
    qm_shape_free(&mesh);
}

/** How far corners are off right ones in the mean, in degrees. */
static double mean_angle(const qm_mesh *mesh)
{
    double sum = 0.0;
    for (size_t c = 0; c < 4 * mesh->face_count; c++) {
        const uint32_t *f = mesh->faces + c / 4 * 4;
        const double *a = mesh->positions + 3 * (size_t)f[c % 4],
                     *b = mesh->positions + 3 * (size_t)f[(c + 1) % 4],
                     *d = mesh->positions + 3 * (size_t)f[(c + 3) % 4];
        double dot = 0.0, one = 0.0, other = 0.0;
        for (int k = 0; k < 3; k++) {
            dot += (b[k] - a[k]) * (d[k] - a[k]);
            one += (b[k] - a[k]) * (b[k] - a[k]);
            other += (d[k] - a[k]) * (d[k] - a[k]);
        }
        sum += fabs(90.0 - acos(dot / sqrt(one * other)) * 180.0 / acos(-1.0));
    }
    return sum / (4.0 * (double)mesh->face_count);
}

static void sheared_quads_straighten(void **state)
{
    (void)state;
    qm_mesh surface = make_shape(48, to_sphere), mesh = make_shape(24, to_twisted);
    double before = mean_angle(&mesh);
    settle(&surface, &mesh, 1);
    double after = mean_angle(&mesh);
    /* Moves without momentum come to 30.6 degrees. */
    QM_CHECK(before > 30.0 && after <= 12.0, "%.1f degrees before, %.1f after", before, after);
    qm_shape_free(&surface);
    qm_shape_free(&mesh);
}

static void creases_hold_their_vertices(void **state)
{
    (void)state;
    qm_mesh surface = make_shape(16, to_cube), exact = make_shape(8, to_cube), mesh = qm_shape_copy(&exact);
    qm_random random = qm_random_make(5, 0);
    qm_shape_shake(&mesh, &random, 0.03);
    for (size_t v = 0; v < mesh.vertex_count; v++)
        if (count_ends(exact.positions + 3 * v, 0.0) == 3)
            memcpy(mesh.positions + 3 * v, exact.positions + 3 * v, 3 * sizeof(double));
    settle(&surface, &mesh, 1);
    for (size_t v = 0; v < mesh.vertex_count; v++) {
        int ends = count_ends(exact.positions + 3 * v, 0.0);
        QM_CHECK(ends < 2 || count_ends(mesh.positions + 3 * v, 1e-9) == ends, "vertex %zu left its edge", v);
    }
    QM_CHECK(distance_between(&surface, &mesh) <= 1e-4, "distance %.3g", distance_between(&surface, &mesh));
    QM_CHECK(qm_topology_least_sine(&mesh) >= 0.7, "least sine %.3f", qm_topology_least_sine(&mesh));
    qm_shape_free(&surface);
    qm_shape_free(&exact);
    qm_shape_free(&mesh);
}

static bool is_on_equator(const qm_mesh *m, uint32_t vertex)
{
    return fabs(m->positions[3 * (size_t)vertex + 2]) <= 1e-12;
}

/** The equator of a sphere, across which it does not bend, as lines; and every seventh of the other vertices. */
static qm_quads_marks mark_equator(const qm_mesh *surface, const qm_mesh *exact)
{
    qm_quads_marks marks = {.vertex_count = exact->vertex_count, .face_count = exact->face_count};
    marks.stays = calloc(marks.vertex_count, 1);
    marks.sharp = calloc(marks.face_count, 1);
    marks.lines = calloc(8 * surface->face_count, 6 * sizeof *marks.lines);
    for (uint32_t v = 0; v < marks.vertex_count; v++)
        marks.stays[v] = v % 7 == 3 && !is_on_equator(exact, v);
    for (size_t s = 0; s < 4 * exact->face_count; s++) {
        const uint32_t *face = exact->faces + s / 4 * 4;
        if (is_on_equator(exact, face[s % 4]) && is_on_equator(exact, face[(s + 1) % 4]))
            marks.sharp[s / 4] |= (uint8_t)(1 << s % 4);
    }
    for (size_t s = 0; s < 4 * surface->face_count; s++) {
        const uint32_t end[2] = {surface->faces[s], surface->faces[s / 4 * 4 + (s + 1) % 4]};
        for (size_t k = 0; k < 2 && is_on_equator(surface, end[0]) && is_on_equator(surface, end[1]); k++)
            memcpy(marks.lines + 6 * marks.line_count + 3 * k, surface->positions + 3 * (size_t)end[k],
                   3 * sizeof(double));
        marks.line_count += is_on_equator(surface, end[0]) && is_on_equator(surface, end[1]);
    }
    return marks;
}

static void marks_are_kept(void **state)
{
    (void)state;
    qm_mesh surface = make_shape(32, to_sphere), exact = make_shape(8, to_sphere);
    qm_quads_marks marks = mark_equator(&surface, &exact);
    for (uint64_t seed = 1; seed <= 2; seed++) {
        qm_random random = qm_random_make(seed, 0);
        qm_mesh mesh = qm_shape_copy(&exact);
        qm_shape_shake(&mesh, &random, 0.14);
        for (uint32_t v = 0; v < mesh.vertex_count; v++)
            if (is_on_equator(&exact, v))
                memcpy(mesh.positions + 3 * (size_t)v, exact.positions + 3 * (size_t)v, 3 * sizeof(double));
        qm_mesh before = qm_shape_copy(&mesh), unmarked = qm_shape_copy(&mesh);
        settle_marked(&surface, &marks, &mesh, 1);
        settle(&surface, &unmarked, 1);
        size_t left = 0, slid = 0;
        for (uint32_t v = 0; v < mesh.vertex_count; v++) {
            const double *p = mesh.positions + 3 * (size_t)v, *was = before.positions + 3 * (size_t)v;
            bool is_same = memcmp(p, was, 3 * sizeof(double)) == 0;
            QM_CHECK(!marks.stays[v] || is_same, "seed %llu: vertex %u has moved", (unsigned long long)seed,
                     v);
            if (!is_on_equator(&exact, v)) continue;
            slid += !is_same;
            left += fabs(unmarked.positions[3 * (size_t)v + 2]) > 1e-3;
            QM_CHECK(fabs(p[2]) <= 1e-9 && hypot(p[0], p[1]) >= 0.998, "seed %llu: vertex %u left its line",
                     (unsigned long long)seed, v);
        }
        QM_CHECK(slid > 0 && left > 0, "seed %llu: %zu slid, %zu unmarked ones left",
                 (unsigned long long)seed, slid, left);
        QM_CHECK(qm_topology_count_folded(&mesh) <= qm_topology_count_folded(&before), "%zu folded",
                 qm_topology_count_folded(&mesh));
        qm_shape_free(&mesh);
        qm_shape_free(&before);
        qm_shape_free(&unmarked);
    }
    free(marks.stays);
    free(marks.sharp);
    free(marks.lines);
    qm_shape_free(&surface);
    qm_shape_free(&exact);
}

static void boundaries_within_the_surface_stay(void **state)
{
    (void)state;
    qm_mesh surface = qm_shape_plane(10, 0.0), mesh = qm_shape_plane(6, 0.0);
    const double shift[3] = {0.2, 0.3, 0.0};
    qm_shape_move(&mesh, 0.5, shift);
    qm_mesh before = qm_shape_copy(&mesh);
    qm_topology t = qm_topology_find(&mesh);
    for (size_t v = 0; v < mesh.vertex_count; v++)
        mesh.positions[3 * v] += 1e-3 * (double)(v % 7);
    qm_mesh moved = qm_shape_copy(&mesh);
    settle(&surface, &mesh, 1);
    size_t stayed = 0;
    for (size_t v = 0; v < mesh.vertex_count; v++)
        stayed += memcmp(mesh.positions + 3 * v, moved.positions + 3 * v, 3 * sizeof(double)) == 0;
    QM_CHECK(stayed >= t.boundary_edges && stayed < mesh.vertex_count, "%zu vertices stayed of %zu", stayed,
             mesh.vertex_count);
    qm_shape_free(&surface);
    qm_shape_free(&mesh);
    qm_shape_free(&before);
    qm_shape_free(&moved);
}

/** Two quads that share a corner alone, and three at a side, are left as they were. */
static void other_meshes_are_left_alone(void **state)
{
    (void)state;
    qm_mesh surface = qm_shape_plane(4, 0.0);
    const uint32_t faces[2][12] = {{0, 1, 2, 3, 2, 4, 5, 6, 2, 4, 5, 6},
                                   {0, 1, 2, 3, 1, 0, 4, 5, 1, 0, 6, 2}};
    for (int i = 0; i < 2; i++) {
        qm_mesh mesh = qm_shape_make(7, i == 0 ? 2 : 3);
        for (size_t k = 0; k < 21; k++)
            mesh.positions[k] = 0.1 * (double)(k * k % 11);
        memcpy(mesh.faces, faces[i], 4 * mesh.face_count * sizeof *mesh.faces);
        qm_mesh before = qm_shape_copy(&mesh);
        settle(&surface, &mesh, 1);
        assert_memory_equal(mesh.positions, before.positions, 21 * sizeof(double));
        qm_shape_free(&mesh);
        qm_shape_free(&before);
    }
    qm_shape_free(&surface);
}

static void threads_do_not_change_the_mesh(void **state)
{
    (void)state;
    qm_mesh surface = make_shape(32, to_fingers), one = make_shape(8, to_fingers),
            three = qm_shape_copy(&one);
    settle(&surface, &one, 1);
    settle(&surface, &three, 3);
    assert_memory_equal(one.positions, three.positions, 3 * one.vertex_count * sizeof(double));
    qm_shape_free(&surface);
    qm_shape_free(&one);
    qm_shape_free(&three);
}

static void memory_and_cancel_end_the_call(void **state)
{
    (void)state;
    qm_mesh surface = make_shape(4, to_cube);
    qm_context ctx = qm_context_make();
    qm_bvh *bvh;
    assert_int_equal(qm_bvh_build(&ctx, &surface, QM_BVH_TARGET, 1, &bvh), QM_OK);
    qm_quads_options options = qm_quads_options_default();
    qm_status status = QM_E_NO_MEMORY;
    for (size_t fail_at = 0; status != QM_OK; fail_at++) {
        qm_failing_allocator memory = {.fail_at = fail_at};
        qm_context poor = qm_context_make();
        qm_mesh mesh = make_shape(2, to_cube);
        poor.allocator = qm_failing_allocator_hook(&memory);
        status = qm_quads_settle(&poor, bvh, &options, QM_QUADS_SPREAD, NULL, &mesh);
        QM_CHECK(status == QM_OK || status == QM_E_NO_MEMORY, "call %zu: %d", fail_at, status);
        QM_CHECK(memory.live_blocks == 0 && !memory.mismatched, "call %zu leaves %zu blocks, mismatched %d",
                 fail_at, memory.live_blocks, memory.mismatched);
        qm_shape_free(&mesh);
        if (fail_at > 40) fail_at += 6; /* the many calls of its rounds are alike */
    }
    atomic_bool is_canceled = true;
    qm_mesh mesh = make_shape(8, to_cube);
    ctx.cancel = &is_canceled;
    assert_int_equal(qm_quads_settle(&ctx, bvh, &options, QM_QUADS_SPREAD, NULL, &mesh), QM_E_CANCELED);
    ctx.cancel = NULL;
    qm_bvh_destroy(&ctx, bvh);
    qm_random random = qm_random_make(1, 0);
    qm_mesh points = qm_shape_points(&random, 9);
    assert_int_equal(qm_bvh_build(&ctx, &points, QM_BVH_TARGET, 1, &bvh), QM_OK);
    assert_int_equal(qm_quads_settle(&ctx, bvh, &options, QM_QUADS_SPREAD, NULL, &mesh), QM_E_ARGUMENT);
    qm_bvh_destroy(&ctx, bvh);
    assert_int_equal(qm_bvh_build(&ctx, &surface, QM_BVH_TARGET, 1, &bvh), QM_OK);
    mesh.faces[7] = QM_NO_INDEX;
    assert_int_equal(qm_quads_settle(&ctx, bvh, &options, QM_QUADS_SPREAD, NULL, &mesh), QM_E_ARGUMENT);
    qm_bvh_destroy(&ctx, bvh);
    qm_shape_free(&points);
    qm_shape_free(&mesh);
    qm_shape_free(&surface);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(shaken_quads_open),
        cmocka_unit_test(parts_in_the_wrong_order_open),
        cmocka_unit_test(what_moves_once_is_good_or_goes_back),
        cmocka_unit_test(vertices_are_drawn_along_fingers),
        cmocka_unit_test(vertices_are_drawn_into_crevices),
        cmocka_unit_test(sheared_quads_straighten),
        cmocka_unit_test(creases_hold_their_vertices),
        cmocka_unit_test(marks_are_kept),
        cmocka_unit_test(boundaries_within_the_surface_stay),
        cmocka_unit_test(other_meshes_are_left_alone),
        cmocka_unit_test(threads_do_not_change_the_mesh),
        cmocka_unit_test(memory_and_cancel_end_the_call),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
