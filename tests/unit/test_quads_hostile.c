/* qm_quads_make on surfaces that nobody would draw: it ends with manifold quads of finite corners, or tells why not. */
#include "check.h"

#include "base/host.h"
#include "qm/quads.h"
#include "quad_topology.h"
#include "shapes.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define PI 3.14159265358979323846

/** Checks what holds for any surface; returns the mesh, which is empty after an error. */
static qm_mesh remesh(const char *name, const qm_mesh *surface, size_t quads, qm_status expected)
{
    qm_context ctx = qm_host_context();
    qm_bvh *bvh;
    qm_mesh out;
    qm_quads_options options = qm_quads_options_default();
    options.quads = quads;
    qm_status status = qm_bvh_build(&ctx, surface, QM_BVH_TARGET, 1, &bvh);
    QM_CHECK(status == QM_OK, "%s: %s", name, ctx.message);
    status = qm_quads_make(&ctx, bvh, &options, &out, NULL);
    qm_bvh_destroy(&ctx, bvh);
    QM_CHECK(status == expected, "%s, %zu quads: status %d, %s", name, quads, status, ctx.message);
    if (status != QM_OK) {
        QM_CHECK(ctx.message[0] != '\0' && out.face_count == 0, "%s: no message, or a mesh", name);
        return out;
    }
    qm_topology t = qm_topology_find(&out);
    QM_CHECK(out.face_count > 0 && t.is_all_quads && t.is_manifold && t.is_oriented,
             "%s, %zu quads: %zu faces, quads %d, manifold %d, oriented %d", name, quads, out.face_count,
             t.is_all_quads, t.is_manifold, t.is_oriented);
    for (size_t i = 0; i < 3 * out.vertex_count; i++)
        QM_CHECK(isfinite(out.positions[i]), "%s: vertex %zu", name, i / 3);
    return out;
}

static void check(const char *name, qm_mesh surface, size_t quads, qm_status expected)
{
    qm_context ctx = qm_host_context();
    qm_mesh out = remesh(name, &surface, quads, expected);
    qm_mesh_reset(&ctx, &out);
    qm_shape_free(&surface);
}

static void add_triangle(qm_mesh *m, size_t face, uint32_t a, uint32_t b, uint32_t c)
{
    const uint32_t corner[4] = {a, b, c, QM_NO_INDEX};
    memcpy(m->faces + 4 * face, corner, sizeof corner);
}

/** A closed strip with a half turn: along one row of edges the faces contradict each other. */
static qm_mesh moebius_strip(uint32_t columns, uint32_t rows)
{
    qm_mesh m = qm_shape_make((size_t)columns * (rows + 1), 2 * (size_t)columns * rows);
    for (uint32_t i = 0; i < columns; i++) {
        for (uint32_t j = 0; j <= rows; j++) {
            double t = 2.0 * PI * i / columns, w = (double)j / rows - 0.5;
            double *p = m.positions + 3 * (size_t)(i * (rows + 1) + j);
            p[0] = (1.0 + w * cos(t / 2.0)) * cos(t);
            p[1] = (1.0 + w * cos(t / 2.0)) * sin(t);
            p[2] = w * sin(t / 2.0);
        }
    }
    size_t face = 0;
    for (uint32_t i = 0; i < columns; i++) {
        for (uint32_t j = 0; j < rows; j++) {
            uint32_t next = i + 1 == columns ? 0 : (i + 1) * (rows + 1);
            uint32_t a = i * (rows + 1) + j, b = a + 1;
            uint32_t c = i + 1 == columns ? rows - j : next + j,
                     d = i + 1 == columns ? rows - j - 1 : next + j + 1;
            add_triangle(&m, face++, a, c, d);
            add_triangle(&m, face++, a, d, b);
        }
    }
    return m;
}

/** Pages that meet in one edge. */
static qm_mesh book(uint32_t pages)
{
    qm_mesh m = qm_shape_make(2 + 2 * (size_t)pages, 2 * (size_t)pages);
    m.positions[5] = 1.0; /* the edge runs from 0 to 1 along z */
    for (uint32_t i = 0; i < pages; i++) {
        for (uint32_t k = 0; k < 2; k++) {
            double *p = m.positions + 3 * (size_t)(2 + 2 * i + k);
            p[0] = cos(2.0 * PI * i / pages), p[1] = sin(2.0 * PI * i / pages), p[2] = k;
        }
        add_triangle(&m, 2 * (size_t)i, 0, 2 + 2 * i, 3 + 2 * i);
        add_triangle(&m, 2 * (size_t)i + 1, 0, 3 + 2 * i, 1);
    }
    return m;
}

static void surfaces_without_sides_become_quads(void **state)
{
    (void)state;
    for (size_t quads = 1; quads <= 100; quads *= 10) {
        check("Moebius strip", moebius_strip(40, 5), quads, QM_OK);
        check("short Moebius strip", moebius_strip(5, 1), quads, QM_OK);
        check("book", book(3), quads, QM_OK);
        check("thick book", book(7), quads, QM_OK);
    }
}

static void sizes_are_told(void **state)
{
    (void)state;
    const double shift[3] = {0, 0, 0};
    for (int power = -150; power <= 150; power += 10) {
        qm_mesh shape = qm_shape_box(1.0, 0.7, 0.5);
        qm_shape_move(&shape, pow(10.0, power), shift);
        check("box", shape, 60, power >= -70 && power <= 70 ? QM_OK : QM_E_SCALE);
    }
}

static void numbers_are_told(void **state)
{
    (void)state;
    const double corner[3][3] = {{0, 0, 0}, {1, 0, 0}, {0.2, 1, 0}};
    const size_t wrong[3] = {0, (size_t)QM_QUADS_MOST + 1, SIZE_MAX};
    for (int i = 0; i < 3; i++)
        check("triangle", qm_shape_face(3, corner), wrong[i], QM_E_ARGUMENT);
    for (size_t quads = 1; quads <= 1000; quads *= 10)
        check("triangle", qm_shape_face(3, corner), quads, QM_OK);
    const double thin[3][3] = {{0, 0, 0}, {1, 0, 0}, {0.5, 1e-3, 0}};
    check("thin triangle", qm_shape_face(3, thin), 100, QM_OK);
    check("one quad on a sphere", qm_shape_sphere(0.1), 1, QM_OK);
}

/** Faces repeat corners, have corners in one line, or lie on each other. */
static void faces_without_area_do_no_harm(void **state)
{
    (void)state;
    for (uint64_t run = 0; run < 3; run++) {
        qm_random random = qm_random_make(qm_check_seed(), run);
        qm_mesh sphere = qm_shape_sphere(0.3), base = qm_shape_triangulated(&sphere);
        size_t extra = 30;
        qm_mesh m = qm_shape_make(base.vertex_count + extra, base.face_count + 2 * extra);
        memcpy(m.positions, base.positions, 3 * base.vertex_count * sizeof(double));
        memcpy(m.faces, base.faces, 4 * base.face_count * sizeof(uint32_t));
        for (size_t i = 0; i < extra; i++) {
            size_t face = qm_random_below(&random, base.face_count), other = base.face_count + 2 * i;
            const uint32_t *c = base.faces + 4 * face;
            uint32_t middle = (uint32_t)(base.vertex_count + i);
            for (size_t k = 0; k < 3;
                 k++) /* in the middle of a side: a face that has three corners in one line */
                m.positions[3 * (size_t)middle + k] =
                    0.5 * (base.positions[3 * (size_t)c[0] + k] + base.positions[3 * (size_t)c[1] + k]);
            add_triangle(&m, other, c[0], middle, c[1]);
            if (i % 2 == 0)
                add_triangle(&m, other + 1, c[0], c[1], c[0]);
            else
                add_triangle(&m, other + 1, c[0], c[1], c[2]);
        }
        check("sphere with faces of no area", m, 200, QM_OK);
        qm_shape_free(&sphere);
        qm_shape_free(&base);
    }
}

/** Balls whose sizes differ by so much a step; those of next to no area get no quads. */
static void small_components_are_kept(void **state)
{
    (void)state;
    const double steps[3] = {0.3, 1e-2, 1e-4};
    for (int i = 0; i < 3; i++) {
        qm_mesh all = qm_shape_sphere(0.2);
        double size = 1.0, at = 3.0;
        for (int k = 1; k < 4; k++) {
            qm_mesh ball = qm_shape_sphere(0.2 * k);
            const double shift[3] = {at, 0.0, 0.0};
            size *= steps[i], at += 3.0;
            qm_shape_move(&ball, size, shift);
            qm_mesh both = qm_shape_joined(&all, &ball);
            qm_shape_free(&all);
            qm_shape_free(&ball);
            all = both;
        }
        check("balls", all, 200, QM_OK);
    }
}

/** A torus with one vertex far out: the needles have most of the area, yet they are far longer than sides of quads. */
static void needles_become_few_quads(void **state)
{
    (void)state;
    const double far_out[3] = {1e3, 1e9, 1e30};
    for (int i = 0; i < 3; i++) {
        qm_mesh torus = qm_shape_torus(8, 4, 1.0, 0.4);
        torus.positions[0] = far_out[i];
        qm_context ctx = qm_host_context();
        qm_mesh out = remesh("torus with needles", &torus, 30, QM_OK);
        QM_CHECK(out.face_count < 1000, "a needle of %g: %zu quads", far_out[i], out.face_count);
        qm_mesh_reset(&ctx, &out);
        qm_shape_free(&torus);
    }
}

/** Any damage to a closed surface: faces go, turn over, or are there twice; vertices fall together, or jump. */
static void damaged_surfaces_become_quads(void **state)
{
    (void)state;
    for (uint64_t run = 0; run < 16; run++) {
        qm_random random = qm_random_make(qm_check_seed(), run);
        qm_mesh whole = run % 2 == 0 ? qm_shape_torus(16, 8, 1.0, 0.4) : qm_shape_sphere(0.4);
        qm_mesh m = qm_shape_triangulated(&whole);
        size_t kept = 0, edits = 1 + qm_random_below(&random, 60);
        for (size_t i = 0; i < edits; i++) {
            uint32_t *c = m.faces + 4 * qm_random_below(&random, m.face_count), first = c[0];
            uint32_t a = (uint32_t)qm_random_below(&random, m.vertex_count),
                     b = (uint32_t)qm_random_below(&random, m.vertex_count);
            switch (qm_random_below(&random, 5)) {
            case 0:
                c[0] = c[1], c[1] = first;
                break;
            case 1:
                memcpy(c, m.faces + 4 * qm_random_below(&random, m.face_count), 4 * sizeof *c);
                break;
            case 2:
                c[qm_random_below(&random, 3)] = a;
                break;
            case 3:
                memcpy(m.positions + 3 * (size_t)a, m.positions + 3 * (size_t)b, 3 * sizeof(double));
                break;
            default:
                m.positions[3 * (size_t)a + qm_random_below(&random, 3)] +=
                    qm_random_range(&random, -4.0, 4.0);
                break;
            }
        }
        size_t gone = qm_random_below(&random, 40);
        for (size_t f = 0; f < m.face_count; f++) /* a face with one corner thrice is no face */
            if (f % 50 >= gone || run % 3 != 0)
                memmove(m.faces + 4 * kept++, m.faces + 4 * f, 4 * sizeof *m.faces);
        size_t all = m.face_count;
        m.face_count = kept;
        qm_context ctx = qm_host_context();
        char name[80];
        snprintf(name, sizeof name, "seed %llu, run %llu", (unsigned long long)qm_check_seed(),
                 (unsigned long long)run);
        qm_mesh out = remesh(name, &m, 1 + qm_random_below(&random, 150), QM_OK);
        qm_mesh_reset(&ctx, &out);
        m.face_count = all;
        qm_shape_free(&m);
        qm_shape_free(&whole);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(surfaces_without_sides_become_quads),
        cmocka_unit_test(sizes_are_told),
        cmocka_unit_test(numbers_are_told),
        cmocka_unit_test(faces_without_area_do_no_harm),
        cmocka_unit_test(small_components_are_kept),
        cmocka_unit_test(needles_become_few_quads),
        cmocka_unit_test(damaged_surfaces_become_quads),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
