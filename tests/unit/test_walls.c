/* Reconstructions of thin parts: walls, fins, sheets and gaps that are nearer than the quads are long. */
#include "check.h"

#include "cells.h"
#include "core/vec.h"
#include "ground.h"
#include "layouts.h"
#include "measured.h"
#include "qm/reconstruct.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define QUADS 1200

typedef enum reading { TRIANGLES, QUADS_AS_GIVEN, CLOUD } reading;

static const char *const reading_name[] = {"triangles", "quads", "points"};

static double diagonal_of(const qm_mesh *mesh)
{
    qm_box box = qm_mesh_bounding_box(mesh);
    return qm_mesh_box_diagonal(&box);
}

/** Greatest two-sided distance of a reconstruction from the surface that it was made of, a fraction of the diagonal. */
static double rebuild(const qm_cells *cells, reading how, double density, int pieces, size_t quads)
{
    qm_mesh truth = qm_cells_surface(cells);
    qm_mesh surface = how == TRIANGLES ? qm_shape_triangulated(&truth)
                      : how == CLOUD   ? qm_cells_points(cells, density, 40, 31)
                                       : qm_shape_copy(&truth);
    qm_layout layout = qm_cells_layout(cells, pieces);
    qm_ground g;
    qm_ground_make(&g, surface);
    qm_reconstruction_options options = qm_reconstruction_options_default();
    qm_reconstruction *r;
    QM_CHECK(qm_reconstruction_create(&g.ctx, &g.source, &layout, &options, &r) == QM_OK, "%s",
             g.ctx.message);
    qm_reconstruction_record record;
    do
        assert_int_equal(qm_reconstruction_step(&g.ctx, r, quads, &record), QM_OK);
    while (record.chords_changed > 0);
    qm_mesh mesh;
    assert_int_equal(qm_reconstruction_mesh(&g.ctx, r, &mesh), QM_OK);
    qm_hausdorff_options measure = qm_hausdorff_options_default();
    measure.tolerance = 2e-6 * diagonal_of(&truth);
    double found = qm_measured(&mesh, &truth, &measure).upper / diagonal_of(&truth);
    free(g.mesh.normals);
    g.mesh.normals = NULL;
    qm_mesh_reset(&g.ctx, &mesh);
    qm_reconstruction_destroy(&g.ctx, r);
    qm_layout_free(&layout);
    qm_ground_free(&g);
    qm_shape_free(&truth);
    return found;
}

/** A box 2 x 2 x thickness. */
static qm_cells box(double thickness)
{
    return (qm_cells){.count = {1, 1, 1},
                      .plane = {{0, 2}, {0, 2}, {0, thickness}},
                      .is_filled = {{{true}}},
                      .pieces = {16, 16, 2}};
}

/** Checks a solid as a mesh, and as points with a limit of their own; 0: not as points. */
static void check_solid(const char *name, const qm_cells *cells, double density, double limit,
                        double point_limit)
{
    for (reading how = TRIANGLES; how <= CLOUD; how++) {
        if (how == CLOUD && point_limit == 0.0) continue;
        double found = rebuild(cells, how, density, 64, QUADS);
        QM_CHECK(found <= (how == CLOUD ? point_limit : limit), "%s, %s: %g of the diagonal", name,
                 reading_name[how], found);
    }
}

static void thin_boxes_keep_their_walls(void **state)
{
    (void)state;
    static const double share[] = {0.018, 0.001}; /* of the diagonal */
    for (size_t i = 0; i < sizeof share / sizeof *share; i++) {
        qm_cells cells = box(share[i] * sqrt(8.0));
        check_solid("box", &cells, 2500.0, 1e-4, 1e-4);
    }
}

/** A quarter of a cylinder of radius 1, of which z is the height over its inner wall. */
static void bend(double p[3])
{
    double angle = 0.7853981633974483 * p[0], radius = 1.0 + p[2];
    p[0] = radius * sin(angle);
    p[2] = radius * cos(angle);
}

static void thin_bent_sheets_keep_their_walls(void **state)
{
    (void)state;
    static const double thickness[] = {0.1, 0.003};
    for (size_t i = 0; i < sizeof thickness / sizeof *thickness; i++) {
        qm_cells cells = box(thickness[i]);
        cells.pieces[0] = 64;
        cells.warp = bend;
        /* Sixteen quads along the arc are that far from it. Points of the thinner ones are as far apart as the walls. */
        check_solid("bent sheet", &cells, 2500.0, 7e-4, i == 0 ? 1e-3 : 0.0);
    }
}

/** A body with a fin on it, the extrusion of a profile. */
static void fins_keep_their_walls(void **state)
{
    (void)state;
    qm_cells cells = {.count = {1, 3, 2},
                      .plane = {{0, 2}, {-1, -0.005, 0.005, 1}, {0, 1, 2}},
                      .is_filled = {{{true}, {true, true}, {true}}},
                      .pieces = {16, 2, 8}};
    check_solid("fin", &cells, 2000.0, 1e-4, 1e-4);
}

static void sheets_close_together_stay_apart(void **state)
{
    (void)state;
    qm_cells cells = {.count = {1, 1, 3},
                      .plane = {{0, 2}, {0, 2}, {0, 0.01, 0.016, 0.026}},
                      .is_filled = {{{true, false, true}}},
                      .pieces = {16, 16, 2}};
    check_solid("two sheets", &cells, 2500.0, 1e-4, 1e-4);
}

/** A wedge: the thickness falls along x. */
static void sharpen(double p[3])
{
    p[2] *= 1.0 - 0.49 * p[0];
}

static void knife_edges_stay_sharp(void **state)
{
    (void)state;
    static const double thickness[] = {0.05};
    for (size_t i = 0; i < sizeof thickness / sizeof *thickness; i++) {
        qm_cells cells = box(thickness[i]);
        cells.warp = sharpen;
        check_solid("knife", &cells, 2500.0, 1e-4, 1e-4);
    }
}

static void curves_on_opposite_walls_do_not_cross(void **state)
{
    (void)state;
    qm_cells cells = box(0.01);
    qm_mesh surface = qm_cells_surface(&cells), points = qm_cells_points(&cells, 2500.0, 40, 32);
    qm_mesh *ground[] = {&surface, &points};
    for (size_t i = 0; i < 2; i++) {
        qm_ground g;
        qm_ground_make(&g, *ground[i]);
        qm_layout layout = {0};
        static const double line[3][2][3] = {
            {{0.2, 0.3, 0.01}, {1.7, 0.9, 0.01}}, /* on top */
            {{0.8, 0.1, 0.0}, {1.1, 1.7, 0.0}},   /* below, across it */
            {{0.7, 0.1, 0.01}, {1.0, 1.7, 0.01}}, /* on top, across it */
        };
        for (uint32_t c = 0; c < 3; c++) {
            for (uint32_t k = 0; k < 2; k++)
                assert_int_equal(qm_layout_add_node(&g.ctx, &layout, line[c][k]), QM_OK);
            assert_int_equal(qm_layout_add_curve(&g.ctx, &layout, 2 * c, 2 * c + 1, line[c][0], 2), QM_OK);
        }
        qm_layout_issues issues = {0};
        assert_int_equal(qm_layout_find_crossings(&g.ctx, &layout, &g.source, &issues), QM_OK);
        assert_int_equal(issues.count, 1);
        assert_int_equal(issues.items[0].curve[0], 0);
        assert_int_equal(issues.items[0].curve[1], 2);
        qm_layout_issues_reset(&g.ctx, &issues);
        /* Without a surface nearness alone decides. */
        assert_int_equal(qm_layout_find_crossings(&g.ctx, &layout, NULL, &issues), QM_OK);
        assert_int_equal(issues.count, 2);
        qm_layout_issues_reset(&g.ctx, &issues);
        qm_layout_free(&layout);
        free(g.mesh.normals);
        g.mesh.normals = NULL;
        qm_ground_free(&g);
    }
}

/**
 * Two planes that pass through each other along the x axis, each of its own vertices, and curves across the axis at one place: on two
 * sheets they do not cross, on one they do, though these are as near.
 */
static void curves_on_sheets_that_meet_do_not_cross(void **state)
{
    (void)state;
    qm_mesh flat = qm_shape_plane(12, 0.0), upright = qm_shape_copy(&flat);
    double middle[3] = {0};
    for (size_t i = 0; i < 3 * flat.vertex_count; i++)
        middle[i % 3] += flat.positions[i] / (double)flat.vertex_count;
    for (size_t v = 0; v < flat.vertex_count; v++) {
        double *p = flat.positions + 3 * v, *q = upright.positions + 3 * v;
        for (int k = 0; k < 3; k++)
            p[k] = q[k] = p[k] - middle[k];
        q[2] = q[1] + 0.01;
        q[1] = 0;
    }
    qm_mesh both = qm_shape_joined(&flat, &upright);
    qm_shape_free(&flat);
    qm_shape_free(&upright);
    qm_ground g;
    qm_ground_make(&g, both);
    const double r = 0.2;
    const double line[3][2][3] = {{{-r, -r, 0}, {r, r, 0}},  /* on the flat one */
                                  {{r, 0, -r}, {-r, 0, r}},  /* on the upright one */
                                  {{r, -r, 0}, {-r, r, 0}}}; /* on the flat one, across the first */
    qm_layout layout = {0};
    for (uint32_t c = 0; c < 3; c++) {
        for (uint32_t k = 0; k < 2; k++)
            assert_int_equal(qm_layout_add_node(&g.ctx, &layout, line[c][k]), QM_OK);
        const double half[3][3] = {{line[c][0][0], line[c][0][1], line[c][0][2]},
                                   {0.001 * c, 0, 0},
                                   {line[c][1][0], line[c][1][1], line[c][1][2]}};
        assert_int_equal(qm_layout_add_curve(&g.ctx, &layout, 2 * c, 2 * c + 1, c == 1 ? half[0] : line[c][0],
                                             c == 1 ? 3 : 2),
                         QM_OK);
    }
    qm_layout_issues issues = {0};
    assert_int_equal(qm_layout_find_crossings(&g.ctx, &layout, &g.source, &issues), QM_OK);
    QM_CHECK(issues.count == 1 && issues.items[0].curve[0] == 0 && issues.items[0].curve[1] == 2,
             "%zu crossings", issues.count);
    qm_layout_issues_reset(&g.ctx, &issues);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

/**
 * Near the edge of a blade of 60 degrees the walls are nearer than a tenth of the segments, but their normals are not
 * opposed.
 */
static void curves_round_the_edge_of_a_blade_do_not_cross(void **state)
{
    (void)state;
    double half = sin(30 * QM_DEGREE) / cos(30 * QM_DEGREE);
    /* The walls meet at x = 1, z = 0. */
    const double corner[6][3] = {{0, -1, half}, {1, -1, 0},     {1, 1, 0},
                                 {0, 1, half},  {0, -1, -half}, {0, 1, -half}};
    static const uint32_t face[2][4] = {{0, 1, 2, 3}, {4, 5, 2, 1}};
    qm_mesh mesh = {
        .positions = malloc(sizeof corner), .vertex_count = 6, .faces = malloc(sizeof face), .face_count = 2};
    assert_true(mesh.positions && mesh.faces);
    memcpy(mesh.positions, corner, sizeof corner);
    memcpy(mesh.faces, face, sizeof face);
    qm_ground g;
    qm_ground_make(&g, mesh);
    qm_layout layout = {0};
    /* By x, y and the side of z: over each other at x = 0.95, where the blade is 0.06 thick. */
    static const double line[3][2][3] = {{{0.92, -0.4, 1}, {0.98, 0.4, 1}},   /* on top */
                                         {{0.98, -0.4, -1}, {0.92, 0.4, -1}}, /* below, across it */
                                         {{0.98, -0.3, 1}, {0.92, 0.5, 1}}};  /* on top, across it */
    for (uint32_t c = 0; c < 3; c++) {
        double points[2][3];
        for (uint32_t k = 0; k < 2; k++) {
            memcpy(points[k], line[c][k], sizeof points[k]);
            points[k][2] *= half * (1 - points[k][0]);
            assert_int_equal(qm_layout_add_node(&g.ctx, &layout, points[k]), QM_OK);
        }
        assert_int_equal(qm_layout_add_curve(&g.ctx, &layout, 2 * c, 2 * c + 1, points[0], 2), QM_OK);
    }
    qm_layout_issues issues = {0};
    assert_int_equal(qm_layout_find_crossings(&g.ctx, &layout, &g.source, &issues), QM_OK);
    assert_int_equal(issues.count, 1);
    assert_int_equal(issues.items[0].curve[0], 0);
    assert_int_equal(issues.items[0].curve[1], 2);
    qm_layout_issues_reset(&g.ctx, &issues);
    assert_int_equal(qm_layout_find_crossings(&g.ctx, &layout, NULL, &issues), QM_OK);
    assert_true(issues.count > 1);
    qm_layout_issues_reset(&g.ctx, &issues);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

/** The warnings of a reconstruction of a few steps; returns their number. */
static size_t warnings_of(qm_mesh surface, const qm_layout *layout, qm_reconstruction_warning out[4],
                          double *distance, const qm_mesh *truth)
{
    qm_ground g;
    qm_ground_make(&g, surface);
    qm_reconstruction_options options = qm_reconstruction_options_default();
    qm_reconstruction *r;
    QM_CHECK(qm_reconstruction_create(&g.ctx, &g.source, layout, &options, &r) == QM_OK, "%s", g.ctx.message);
    qm_reconstruction_record record;
    do
        assert_int_equal(qm_reconstruction_step(&g.ctx, r, 1000, &record), QM_OK);
    while (record.chords_changed > 0);
    size_t count = qm_reconstruction_find_warnings(r, out, 4);
    if (truth) {
        qm_mesh mesh;
        assert_int_equal(qm_reconstruction_mesh(&g.ctx, r, &mesh), QM_OK);
        qm_hausdorff_options measure = qm_hausdorff_options_default();
        measure.tolerance = 1e-4 * diagonal_of(truth);
        *distance = qm_measured(&mesh, truth, &measure).upper / diagonal_of(truth);
        qm_mesh_reset(&g.ctx, &mesh);
    }
    qm_reconstruction_destroy(&g.ctx, r);
    qm_ground_free(&g);
    return count;
}

static bool is_outside(const double p[3], double half)
{
    return fmax(fabs(p[0]), fabs(p[1])) > half;
}

/** Without the faces that have a corner in [-half, half] squared. */
static qm_mesh with_hole(qm_mesh scan, double half)
{
    size_t faces = 0;
    for (size_t f = 0; f < scan.face_count; f++) {
        bool keeps = true;
        for (size_t k = 0; k < 4; k++)
            keeps &= is_outside(scan.positions + 3 * (size_t)scan.faces[4 * f + k], half);
        for (size_t k = 0; k < 4 && keeps; k++)
            scan.faces[4 * faces + k] = scan.faces[4 * f + k];
        faces += keeps;
    }
    scan.face_count = faces;
    return scan;
}

/** The layout has 3 x 3 patches, the middle one over [-1/3, 1/3] squared. */
static void a_patch_in_a_hole_is_spanned_and_told(void **state)
{
    (void)state;
    qm_mesh truth = qm_shape_saddle(64), scan = with_hole(qm_shape_saddle(64), 0.36);
    qm_mesh points = qm_ground_sample(qm_saddle_at, 8000, 0.0, 33);
    size_t count = 0;
    for (size_t i = 0; i < points.vertex_count; i++)
        if (is_outside(points.positions + 3 * i, 0.36)) {
            for (size_t k = 0; k < 3; k++)
                points.positions[3 * count + k] = points.positions[3 * i + k];
            count++;
        }
    points.vertex_count = count;
    qm_layout layout = qm_layout_of_grid(3, 3, false, false, 16, qm_saddle_at, NULL);
    qm_mesh ground[] = {scan, points};
    for (size_t i = 0; i < 2; i++) {
        qm_reconstruction_warning warning[4];
        double found;
        size_t warnings = warnings_of(ground[i], &layout, warning, &found, &truth);
        /* Of points it is told, too, that they have no normals, and that patches beside the hole reach into it. */
        QM_CHECK(warnings == (i == 0 ? 1 : 3) && warning[0].kind == QM_RECONSTRUCTION_SPANS_HOLE &&
                     warning[0].patch == 4,
                 "%zu warnings, surface %zu", warnings, i);
        if (i == 1)
            QM_CHECK(warning[1].kind == QM_RECONSTRUCTION_NORMALS &&
                         warning[2].kind == QM_RECONSTRUCTION_FILLS_HOLE,
                     "warnings %d and %d", (int)warning[1].kind, (int)warning[2].kind);
        QM_CHECK(found < 0.01, "surface %zu: %g of the diagonal", i, found);
    }
    qm_layout_free(&layout);
    qm_shape_free(&truth);
}

/** A hill over [-1, 1] squared whose foot is flat: the Coons patch of its boundary is a square below it. */
static void hill_at(const void *user, double u, double v, double out[3])
{
    (void)user;
    out[0] = 2.0 * u - 1.0;
    out[1] = 2.0 * v - 1.0;
    out[2] = 0.8 * (1.0 - out[0] * out[0]) * (1.0 - out[1] * out[1]);
}

/** A hole in the middle of a patch is filled by quads of their usual size, and told with its area. */
static void a_hole_in_a_patch_is_filled_and_told(void **state)
{
    (void)state;
    /* Faces with a corner at 11 / 32 or nearer are gone. */
    const double half = 12.0 / 32;
    qm_ground g;
    qm_ground_make(&g, with_hole(qm_shape_grid(64, 64, false, false, hill_at, NULL), 0.35));
    qm_layout layout = qm_layout_of_grid(1, 1, false, false, 16, hill_at, NULL);
    qm_reconstruction_options options = qm_reconstruction_options_default();
    qm_reconstruction *r;
    QM_CHECK(qm_reconstruction_create(&g.ctx, &g.source, &layout, &options, &r) == QM_OK, "%s",
             g.ctx.message);
    qm_reconstruction_record record;
    do
        assert_int_equal(qm_reconstruction_step(&g.ctx, r, 1024, &record), QM_OK);
    while (record.chords_changed > 0);
    qm_mesh mesh;
    assert_int_equal(qm_reconstruction_mesh(&g.ctx, r, &mesh), QM_OK);
    double longest = 0.0;
    for (size_t f = 0; f < mesh.face_count; f++)
        for (size_t k = 0; k < 4; k++) {
            const uint32_t *corner = mesh.faces + 4 * f;
            longest =
                fmax(longest, qm_vec_distance(qm_vec_load(mesh.positions + 3 * (size_t)corner[k]),
                                              qm_vec_load(mesh.positions + 3 * (size_t)corner[(k + 1) % 4])));
        }
    QM_CHECK(longest < half, "an edge of %g over a hole of %g", longest, 2.0 * half);
    /* The hill is steep beside the hole, and has less than twice the area of its square. */
    double share = half * half;
    qm_reconstruction_warning warning[2];
    assert_int_equal(qm_reconstruction_find_warnings(r, warning, 2), 1);
    assert_int_equal(warning[0].kind, QM_RECONSTRUCTION_FILLS_HOLE);
    QM_CHECK(warning[0].share > 0.4 * share && warning[0].share < share, "%g of %g", warning[0].share, share);
    qm_mesh_reset(&g.ctx, &mesh);
    qm_reconstruction_destroy(&g.ctx, r);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

static void a_strip(const void *user, double u, double v, double out[3])
{
    const double whole = 6.283185307179586;
    double turn = *(const double *)user * u, radius = 1.0 + 0.3 * (v - 0.5) * cos(turn);
    out[0] = radius * cos(whole * u);
    out[1] = radius * sin(whole * u);
    out[2] = 0.3 * (v - 0.5) * sin(turn);
}

/** A ring of four patches whose last is closed with a half turn. */
static void one_sided_and_inside_out_results_are_told(void **state)
{
    (void)state;
    double half_turn = 3.141592653589793;
    qm_context ctx = qm_context_make();
    qm_layout layout = {0};
    for (int j = 0; j < 2; j++)
        for (int i = 0; i < 4; i++) {
            double p[3];
            a_strip(&half_turn, i / 4.0, j, p);
            assert_int_equal(qm_layout_add_node(&ctx, &layout, p), QM_OK);
        }
    for (uint32_t c = 0; c < 12; c++) { /* 0..3 below, 4..7 above, 8..11 across */
        uint32_t j = c / 4, i = c % 4, from = j == 2 ? i : 4 * j + i;
        uint32_t to = j == 2 ? 4 + i : i < 3 ? from + 1 : j == 0 ? 4 : 0;
        double points[3 * 17];
        for (int k = 0; k <= 16; k++)
            a_strip(&half_turn, (i + (j == 2 ? 0.0 : k / 16.0)) / 4.0, j == 2 ? k / 16.0 : j, points + 3 * k);
        assert_int_equal(qm_layout_add_curve(&ctx, &layout, from, to, points, 17), QM_OK);
    }
    for (uint32_t i = 0; i < 4; i++) {
        const uint32_t id[4] = {i, 8 + (i + 1) % 4, 4 + i, 8 + i};
        assert_int_equal(qm_layout_add_patch(&ctx, &layout, id), QM_OK);
    }
    qm_reconstruction_warning warning[4];
    size_t count =
        warnings_of(qm_shape_grid(96, 8, false, false, a_strip, &half_turn), &layout, warning, NULL, NULL);
    bool is_told = false;
    for (size_t i = 0; i < count; i++)
        is_told |= warning[i].kind == QM_RECONSTRUCTION_ONE_SIDED;
    assert_true(is_told);
    qm_layout_free(&layout);

    qm_cells cells = box(1.0);
    for (int turned = 0; turned < 2; turned++) {
        qm_mesh surface = qm_cells_surface(&cells);
        for (size_t f = 0; f < surface.face_count && turned; f++) {
            uint32_t second = surface.faces[4 * f + 1];
            surface.faces[4 * f + 1] = surface.faces[4 * f + 3];
            surface.faces[4 * f + 3] = second;
        }
        layout = qm_cells_layout(&cells, 16);
        count = warnings_of(surface, &layout, warning, NULL, NULL);
        assert_int_equal(count, turned);
        if (turned) assert_int_equal(warning[0].kind, QM_RECONSTRUCTION_INSIDE_OUT);
        qm_layout_free(&layout);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(thin_boxes_keep_their_walls),
        cmocka_unit_test(thin_bent_sheets_keep_their_walls),
        cmocka_unit_test(fins_keep_their_walls),
        cmocka_unit_test(sheets_close_together_stay_apart),
        cmocka_unit_test(knife_edges_stay_sharp),
        cmocka_unit_test(curves_on_opposite_walls_do_not_cross),
        cmocka_unit_test(curves_on_sheets_that_meet_do_not_cross),
        cmocka_unit_test(curves_round_the_edge_of_a_blade_do_not_cross),
        cmocka_unit_test(a_patch_in_a_hole_is_spanned_and_told),
        cmocka_unit_test(a_hole_in_a_patch_is_filled_and_told),
        cmocka_unit_test(one_sided_and_inside_out_results_are_told),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
