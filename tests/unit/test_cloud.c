/* Surfaces of triangles that are made of points: on shapes by formula with normals and without, with noise, outliers, holes and uneven
 * density; open ones; points that are no surface; the grid and the zeros of a function beside twins that look at every cell; lack of
 * memory and cancellation. */
#include "check.h"

#include "cloud/cloud_isosurface.h"
#include "core/vec.h"
#include "failing_allocator.h"
#include "ground.h"
#include "qm/cloud.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define PI 3.141592653589793

/* ---- points of shapes ---- */

static double torus_distance(const double p[3])
{
    return fabs(hypot(hypot(p[0], p[1]) - 1.0, p[2]) - 0.35);
}

static void torus_at(qm_random *random, double out[3], double normal[3])
{
    double u, v;
    do { /* evenly over the area */
        u = qm_random_range(random, 0.0, 2.0 * PI);
        v = qm_random_range(random, 0.0, 2.0 * PI);
    } while (qm_random_range(random, 0.0, 1.35) > 1.0 + 0.35 * cos(v));
    normal[0] = cos(u) * cos(v);
    normal[1] = sin(u) * cos(v);
    normal[2] = sin(v);
    out[0] = cos(u) * (1.0 + 0.35 * cos(v));
    out[1] = sin(u) * (1.0 + 0.35 * cos(v));
    out[2] = 0.35 * sin(v);
}

#define TORUS_DIAGONAL 3.8818

static double gauss(qm_random *random)
{
    double sum = -6.0;
    for (int k = 0; k < 12; k++)
        sum += qm_random_range(random, 0.0, 1.0);
    return sum;
}

/** How the points of a torus are made worse. */
typedef struct fault {
    const char *name;
    bool has_normals;
    double noise;     /* of the diagonal */
    double outliers;  /* of the points */
    double hole;      /* radius of one at (1.35, 0, 0) */
    double gradient;  /* times as dense at one end of x */
    double most, rms; /* of the distance of the vertices, of the diagonal; with noise shares of that */
} fault;

static qm_mesh make_points(const fault *f, size_t count, uint64_t stream)
{
    qm_random random = qm_random_make(qm_check_seed(), stream);
    qm_mesh points = qm_shape_make(count, 0);
    float *normals = malloc(count * 3 * sizeof *normals);
    assert_non_null(normals);
    size_t outliers = (size_t)(f->outliers * (double)count);
    for (size_t i = 0; i < count;) {
        double *p = points.positions + 3 * i, normal[3];
        torus_at(&random, p, normal);
        if (hypot(hypot(p[0] - 1.35, p[1]), p[2]) < f->hole) continue;
        if (f->gradient > 1.0 && qm_random_range(&random, 0.0, 1.0) > pow(f->gradient, (p[0] - 1.35) / 2.7))
            continue;
        for (int k = 0; k < 3; k++) {
            p[k] += f->noise * TORUS_DIAGONAL * gauss(&random);
            normals[3 * i + (size_t)k] = (float)normal[k];
        }
        if (i < outliers) qm_random_point(&random, -1.5, 1.5, p);
        i++;
    }
    if (f->has_normals)
        points.normals = normals;
    else
        free(normals);
    return points;
}

static void free_ground(qm_ground *g)
{
    free(g->mesh.normals);
    g->mesh.normals = NULL;
    qm_ground_free(g);
}

static qm_status make_surface(qm_ground *g, qm_mesh points, qm_mesh *out, qm_cloud_record *record)
{
    qm_ground_make(g, points);
    const qm_cloud_options options = qm_cloud_options_default();
    return qm_cloud_make_surface(&g->ctx, &g->source, &options, out, record);
}

/** That a mesh is closed, of one component, oriented, and looks out of a torus or sphere. */
static void check_closed(qm_context *ctx, const qm_mesh *mesh, ptrdiff_t euler, const char *name)
{
    qm_mesh_facts facts;
    assert_int_equal(qm_mesh_find_facts(ctx, mesh, &facts), QM_OK);
    QM_CHECK(facts.watertight && facts.manifold && facts.winding_consistent && facts.components == 1 &&
                 facts.euler_number == euler,
             "%s: %zu boundary edges, %zu components, Euler number %td", name, facts.boundary_edges,
             facts.components, facts.euler_number);
    double volume = 0.0;
    for (size_t i = 0; i < mesh->face_count; i++) {
        qm_vec p[3];
        for (int k = 0; k < 3; k++)
            p[k] = qm_vec_load(mesh->positions + 3 * (size_t)mesh->faces[4 * i + (size_t)k]);
        volume += qm_vec_dot(p[0], qm_vec_cross(p[1], p[2]));
    }
    QM_CHECK(volume > 0.0, "%s: inside out", name);
}

/* ---- the tests ---- */

static void worse_and_worse_points_of_a_torus_become_one(void **state)
{
    (void)state;
    static const fault faults[] = {{"clean", true, 0.0, 0.0, 0.0, 1.0, 1.5e-3, 2e-4},
                                   {"no normals", false, 0.0, 0.0, 0.0, 1.0, 1.5e-3, 2e-4},
                                   {"noise", true, 0.002, 0.0, 0.0, 1.0, 1.8, 0.4},
                                   {"noise, no normals", false, 0.005, 0.0, 0.0, 1.0, 1.8, 0.4},
                                   {"outliers", true, 0.0, 0.01, 0.0, 1.0, 1.2e-2, 6e-4},
                                   {"outliers, no normals", false, 0.0, 0.01, 0.0, 1.0, 1.2e-2, 6e-4},
                                   {"hole", true, 0.0, 0.0, 0.2, 1.0, 8e-3, 4e-4},
                                   {"hole, no normals", false, 0.0, 0.0, 0.2, 1.0, 8e-3, 4e-4},
                                   {"density", true, 0.0, 0.0, 0.0, 50.0, 6e-3, 5e-4},
                                   {"density, no normals", false, 0.0, 0.0, 0.0, 50.0, 6e-3, 5e-4},
                                   {"all", true, 0.003, 0.01, 0.2, 10.0, 4.0, 0.7}};
    for (size_t i = 0; i < sizeof faults / sizeof *faults; i++) {
        const fault *f = &faults[i];
        qm_ground g;
        qm_mesh made;
        qm_cloud_record record;
        qm_status status = make_surface(&g, make_points(f, 12000, 10 + i), &made, &record);
        QM_CHECK(status == QM_OK, "%s: %s", f->name, g.ctx.message);
        check_closed(&g.ctx, &made, 0, f->name);
        double sum = 0.0, most = 0.0, unit = TORUS_DIAGONAL * (f->noise > 0.0 ? f->noise : 1.0);
        for (size_t v = 0; v < made.vertex_count; v++) {
            double distance = torus_distance(made.positions + 3 * v) / unit;
            sum += distance * distance;
            most = fmax(most, distance);
        }
        double rms = sqrt(sum / (double)made.vertex_count);
        printf("%s: rms %.3g, most %.3g, %zu faces, %zu outliers, noise %.3g, %zu holes, %.3g of the area\n",
               f->name, rms, most, made.face_count, record.outliers, record.noise / TORUS_DIAGONAL,
               record.holes_filled, record.filled_share);
        QM_CHECK(rms <= f->rms && most <= f->most, "%s: rms %g, most %g", f->name, rms, most);
        assert_true(record.has_own_normals == f->has_normals && record.borders == 0 &&
                    record.components == 1);
        QM_CHECK((record.noise > 0.0) == (f->noise > 0.0), "%s: noise %g", f->name, record.noise);
        QM_CHECK(f->outliers == 0.0 ? record.outliers <= 12 : record.outliers >= 60, "%s: %zu outliers",
                 f->name, record.outliers);
        if (f->gradient == 1.0) /* what is in no gap between its parts may divide one */
            assert_true(f->hole > 0.0 ? record.holes_filled >= 1 && record.holes_filled <= 3
                                      : record.holes_filled == 0);
        qm_mesh_reset(&g.ctx, &made);
        free_ground(&g);
    }
}

/** Points of a square sheet that is bent along a parabola, with a round hole of a radius. */
static qm_mesh make_sheet(double hole)
{
    qm_random random = qm_random_make(qm_check_seed(), 40);
    qm_mesh points = qm_shape_make(8000, 0);
    for (size_t i = 0; i < points.vertex_count;) {
        double *p = points.positions + 3 * i;
        p[0] = qm_random_range(&random, -1.0, 1.0);
        p[1] = qm_random_range(&random, -1.0, 1.0);
        p[2] = 0.3 * p[0] * p[0];
        if (hypot(p[0], p[1]) > hole) i++;
    }
    return points;
}

static void open_surfaces_end_where_the_points_do(void **state)
{
    (void)state;
    /* A hole of 0.45 is beyond 15 % of the diagonal, one of 0.15 is not. */
    for (int k = 0; k < 3; k++) {
        double hole = k == 0 ? 0.0 : k == 1 ? 0.15 : 0.45, area = 0.0;
        qm_ground g;
        qm_mesh made;
        qm_cloud_record record;
        assert_int_equal(make_surface(&g, make_sheet(hole), &made, &record), QM_OK);
        qm_mesh_facts facts;
        assert_int_equal(qm_mesh_find_facts(&g.ctx, &made, &facts), QM_OK);
        assert_int_equal(facts.boundary_loops, k == 2 ? 2 : 1);
        assert_int_equal(record.borders, k == 2 ? 2 : 1);
        assert_int_equal(record.holes_filled, k == 1);
        assert_true(facts.manifold && facts.components == 1);
        for (size_t v = 0; v < made.vertex_count; v++) {
            const double *p = made.positions + 3 * v;
            QM_CHECK(fmax(fabs(p[0]), fabs(p[1])) < 1.08 && fabs(p[2] - 0.3 * p[0] * p[0]) < 0.02, "%g %g %g",
                     p[0], p[1], p[2]);
            if (k == 2) assert_true(hypot(p[0], p[1]) > 0.35);
        }
        for (size_t i = 0; i < made.face_count; i++) {
            qm_vec p[3];
            for (int c = 0; c < 3; c++)
                p[c] = qm_vec_load(made.positions + 3 * (size_t)made.faces[4 * i + (size_t)c]);
            area += 0.5 * qm_vec_norm(qm_vec_cross(qm_vec_sub(p[1], p[0]), qm_vec_sub(p[2], p[0])));
        }
        /* Of the parabola: 2 times the integral of sqrt(1 + 0.36 x^2) from -1 to 1. */
        double whole = 2.0 * (sqrt(1.36) + asinh(0.6) / 0.6),
               true_area = whole - (k == 2 ? PI * hole * hole : 0.0);
        QM_CHECK(fabs(area / true_area - 1.0) < 0.04, "area %g, not %g", area, true_area);
        qm_mesh_reset(&g.ctx, &made);
        free_ground(&g);
    }
}

/** Points of both walls of a sheet that is bent along a parabola, with normals. */
static qm_mesh make_walls(double thickness)
{
    qm_random random = qm_random_make(qm_check_seed(), 45);
    qm_mesh points = qm_shape_make(4000, 0);
    points.normals = malloc(points.vertex_count * 3 * sizeof *points.normals);
    assert_non_null(points.normals);
    for (size_t i = 0; i < points.vertex_count; i++) {
        double x = qm_random_range(&random, -1.0, 1.0), y = qm_random_range(&random, -1.0, 1.0),
               side = i % 2 ? 1.0 : -1.0;
        double length = hypot(0.6 * x, 1.0), normal[3] = {-0.6 * x / length, 0.0, 1.0 / length};
        const double middle[3] = {x, y, 0.3 * x * x};
        for (size_t k = 0; k < 3; k++) {
            points.positions[3 * i + k] = middle[k] + 0.5 * thickness * side * normal[k];
            points.normals[3 * i + k] = (float)(side * normal[k]);
        }
    }
    return points;
}

static void thin_parts_are_told_where_they_are_not_kept(void **state)
{
    (void)state;
    static const double thicknesses[] = {0.1, 0.04, 0.008};
    for (int k = 0; k < 3; k++) {
        qm_ground g;
        qm_mesh made;
        qm_cloud_record record;
        double sum = 0.0, t = thicknesses[k];
        qm_status status = make_surface(&g, make_walls(t), &made, &record);
        for (size_t v = 0; v < made.vertex_count; v++) {
            const double *p = made.positions + 3 * v;
            double off = fabs(fabs(p[2] - 0.3 * p[0] * p[0]) / hypot(0.6 * p[0], 1.0) - 0.5 * t);
            sum += off * off;
        }
        double rms = sqrt(sum / (double)made.vertex_count);
        printf("walls %g apart, points %g: status %d, normals %d, thin share %g, rms %g, %zu components, %zu "
               "borders\n",
               t, record.spacing, status, record.has_own_normals, record.thin_share, rms, record.components,
               record.borders);
        assert_true(status == QM_OK || (status == QM_E_EMPTY && strstr(g.ctx.message, "walls")));
        if (t >= 0.1) assert_true(record.thin_share < 0.01 && rms < 1e-3);
        assert_true(rms < 0.1 * t || record.thin_share > 0.01);
        if (status == QM_OK) qm_mesh_reset(&g.ctx, &made);
        free_ground(&g);
    }
}

/** Points that are no surface, by number. */
static qm_mesh make_no_surface(int which)
{
    qm_random random = qm_random_make(qm_check_seed(), 50 + (uint64_t)which);
    static const size_t counts[] = {2, 40, 500, 2000, 3000, 60};
    qm_mesh points = qm_shape_make(counts[which], 0);
    for (size_t i = 0; i < points.vertex_count; i++) {
        double *p = points.positions + 3 * i, t = qm_random_range(&random, 0.0, 20.0);
        qm_random_point(&random, -1.0, 1.0, p);
        if (which == 1) p[0] = i < 3 ? p[0] : 1.0, p[1] = p[2] = 2.0; /* four places */
        if (which == 2) p[0] = t, p[1] = 2.0 * t, p[2] = -3.0 * t;    /* a line */
        if (which == 3) p[0] = cos(t), p[1] = sin(t), p[2] = 0.1 * t; /* a helix */
    }
    return points;
}

static void points_that_are_no_surface_are_refused(void **state)
{
    (void)state;
    static const char *const words[] = {"too few",     "too few",    "along lines",
                                        "along lines", "fill space", "fill space"};
    for (int k = 0; k < 6; k++) {
        qm_ground g;
        qm_mesh made;
        qm_cloud_record record;
        qm_status status = make_surface(&g, make_no_surface(k), &made, &record);
        QM_CHECK(status == QM_E_EMPTY && strstr(g.ctx.message, words[k]), "case %d: status %d, %s", k, status,
                 g.ctx.message);
        assert_null(made.positions);
        free_ground(&g);
    }
    qm_ground g;
    qm_mesh made;
    assert_int_equal(make_surface(&g, qm_shape_torus(20, 10, 1.0, 0.35), &made, NULL), QM_E_ARGUMENT);
    free_ground(&g);
}

/** The place and unit of points do not matter, nor does a point that is there many times. */
static void place_unit_and_copies_do_not_matter(void **state)
{
    (void)state;
    static const fault clean = {"clean", false, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0};
    static const struct {
        double scale, shift[3];
        size_t copies;
    } cases[] = {{1.0, {0, 0, 0}, 1},
                 {0x1p200, {0, 0, 0}, 1},
                 {0x1p-200, {0, 0, 0}, 1},
                 {1.0, {1e4, -1e4, 1e4}, 1},
                 {1.0, {0, 0, 0}, 30}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        qm_mesh once = make_points(&clean, 3000, 60), points = qm_shape_make(3000 * cases[k].copies, 0);
        for (size_t i = 0; i < points.vertex_count; i++)
            memcpy(points.positions + 3 * i, once.positions + 3 * (i / cases[k].copies), 24);
        qm_shape_free(&once);
        qm_shape_move(&points, cases[k].scale, cases[k].shift);
        qm_ground g;
        qm_mesh made;
        qm_cloud_record record;
        assert_int_equal(make_surface(&g, points, &made, &record), QM_OK);
        assert_int_equal(record.points, 3000);
        check_closed(&g.ctx, &made, 0, "moved");
        for (size_t v = 0; v < made.vertex_count; v++) {
            double p[3];
            for (size_t axis = 0; axis < 3; axis++)
                p[axis] = (made.positions[3 * v + axis] - cases[k].shift[axis]) / cases[k].scale;
            QM_CHECK(torus_distance(p) < 0.02, "case %zu: %g off", k, torus_distance(p));
        }
        qm_mesh_reset(&g.ctx, &made);
        free_ground(&g);
    }
}

/** A function whose zeros are cut: a sphere, or a soup of values. */
static double value_at(qm_random *random, qm_vec p, int which)
{
    if (which == 0) return qm_vec_norm(qm_vec_sub(p, (qm_vec){4.1, 4.3, 3.9})) - 2.7;
    return qm_random_range(random, -1.0, 1.0);
}

static void zeros_are_closed_surfaces_between_the_signs(void **state)
{
    (void)state;
    for (int which = 0; which < 6; which++) {
        qm_context ctx = qm_context_make();
        qm_random random = qm_random_make(qm_check_seed(), 70 + (uint64_t)which);
        uint64_t *cells = qm_context_alloc(&ctx, 512, sizeof *cells);
        size_t count = 0;
        for (uint64_t i = 0; i < 512; i++)
            cells[count++] = qm_cloud_key(i % 8, i / 8 % 8, i / 64);
        qm_cloud_grid grid;
        assert_int_equal(qm_cloud_grid_make(&ctx, (qm_vec){0, 0, 0}, 1.0, cells, count, 512, &grid), QM_OK);
        assert_int_equal(grid.node_count, 729);
        double *field = qm_context_alloc(&ctx, grid.node_count, sizeof *field);
        for (uint32_t i = 0; i < grid.node_count; i++) {
            uint64_t key = grid.nodes[i], x = qm_cloud_key_part(key, 0), y = qm_cloud_key_part(key, 1),
                     z = qm_cloud_key_part(key, 2);
            /* A twin of the links: the keys of all nodes, one by one. */
            for (int axis = 0; axis < 3; axis++) {
                uint64_t wanted = key + qm_cloud_key(axis == 0, axis == 1, axis == 2);
                uint32_t found = QM_NO_INDEX;
                for (uint32_t j = 0; j < grid.node_count; j++)
                    if (grid.nodes[j] == wanted) found = j;
                assert_int_equal(grid.next[i][axis], found);
            }
            bool is_end = x % 8 == 0 || y % 8 == 0 || z % 8 == 0;
            field[i] = is_end ? 1.0 : value_at(&random, qm_cloud_grid_node(&grid, i), which);
        }
        qm_cloud_triangles made;
        assert_int_equal(qm_cloud_isosurface(&ctx, &grid, field, &made), QM_OK);
        /* All at the end is above: so the zeros are closed. Each edge has its opposite once. */
        double volume = 0.0;
        for (size_t i = 0; i < made.count; i++) {
            const uint32_t *c = made.corner[i];
            volume +=
                qm_vec_dot(made.position[c[0]], qm_vec_cross(made.position[c[1]], made.position[c[2]])) / 6.0;
            for (int k = 0; k < 3; k++) {
                size_t along = 0, against = 0;
                for (size_t j = 0; j < made.count; j++)
                    for (int l = 0; l < 3; l++) {
                        along += made.corner[j][l] == c[k] && made.corner[j][(l + 1) % 3] == c[(k + 1) % 3];
                        against += made.corner[j][(l + 1) % 3] == c[k] && made.corner[j][l] == c[(k + 1) % 3];
                    }
                QM_CHECK(along == 1 && against == 1, "field %d: an edge has %zu and %zu faces", which, along,
                         against);
            }
        }
        /* A field of values above and below is about as often below: only that the zeros look up is known. */
        QM_CHECK(volume > 0.0, "field %d: volume %g", which, volume);
        if (which == 0) {
            double truth = 4.0 / 3.0 * PI * 2.7 * 2.7 * 2.7;
            QM_CHECK(fabs(volume / truth - 1.0) < 0.1, "volume %g, not %g", volume, truth);
        }
        qm_cloud_triangles_reset(&ctx, &made);
        qm_context_free(&ctx, field, grid.node_count, sizeof *field);
        qm_cloud_grid_reset(&ctx, &grid);
    }
}

static void lack_of_memory_is_told_everywhere(void **state)
{
    (void)state;
    static const fault faults[] = {{"noise", false, 0.004, 0.01, 0.2, 1.0, 0.0, 0.0},
                                   {"clean", true, 0.0, 0.01, 0.0, 1.0, 0.0, 0.0}};
    for (int k = 0; k < 2; k++) {
        qm_ground g;
        qm_ground_make(&g, make_points(&faults[k], 1800, 80));
        size_t calls = 0;
        for (size_t fail_at = 0;; fail_at += calls > 60 ? calls / 40 : 1) {
            qm_failing_allocator memory = {.fail_at = fail_at >= calls && calls > 0 ? SIZE_MAX : fail_at};
            if (calls == 0) memory.fail_at = SIZE_MAX;
            qm_context ctx = qm_context_make();
            ctx.allocator = qm_failing_allocator_hook(&memory);
            const qm_cloud_options options = qm_cloud_options_default();
            qm_mesh made;
            qm_status status = qm_cloud_make_surface(&ctx, &g.source, &options, &made, NULL);
            bool is_whole = memory.fail_at == SIZE_MAX;
            QM_CHECK(status == (is_whole ? QM_OK : QM_E_NO_MEMORY), "call %zu of %zu: status %d", fail_at,
                     calls, status);
            if (status == QM_OK) qm_mesh_reset(&ctx, &made);
            assert_true(memory.live_blocks == 0 && !memory.mismatched);
            if (calls > 0 && is_whole) break;
            if (calls == 0) {
                calls = memory.calls;
                fail_at = SIZE_MAX - (calls > 60 ? calls / 40 : 1) + 1; /* from 0 on */
            }
        }
        free_ground(&g);
    }
}

static void it_can_be_canceled(void **state)
{
    (void)state;
    static const fault noisy = {"noise", false, 0.004, 0.0, 0.0, 1.0, 0.0, 0.0};
    qm_ground g;
    qm_ground_make(&g, make_points(&noisy, 2000, 90));
    atomic_bool cancel = true;
    g.ctx.cancel = &cancel;
    const qm_cloud_options options = qm_cloud_options_default();
    qm_mesh made;
    assert_int_equal(qm_cloud_make_surface(&g.ctx, &g.source, &options, &made, NULL), QM_E_CANCELED);
    free_ground(&g);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(worse_and_worse_points_of_a_torus_become_one),
                                       cmocka_unit_test(open_surfaces_end_where_the_points_do),
                                       cmocka_unit_test(thin_parts_are_told_where_they_are_not_kept),
                                       cmocka_unit_test(points_that_are_no_surface_are_refused),
                                       cmocka_unit_test(place_unit_and_copies_do_not_matter),
                                       cmocka_unit_test(zeros_are_closed_surfaces_between_the_signs),
                                       cmocka_unit_test(lack_of_memory_is_told_everywhere),
                                       cmocka_unit_test(it_can_be_canceled)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
