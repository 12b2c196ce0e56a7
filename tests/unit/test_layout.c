/* Layouts: patches found from the embedding, faults named, edits one at a time. */
#include "check.h"

#include "layout/layout_creases.h"

#include "failing_allocator.h"
#include "ground.h"
#include "layouts.h"
#include "qm/layout_edit.h"
#include "random.h"

#include <math.h>
#include <string.h>

/** The mesh without its faces. */
static qm_mesh points_of(qm_mesh mesh)
{
    qm_mesh points = qm_shape_make(mesh.vertex_count, 0);
    memcpy(points.positions, mesh.positions, 3 * sizeof(double) * mesh.vertex_count);
    qm_shape_free(&mesh);
    return points;
}

static bool has_side(const qm_layout_patch *patch, uint32_t curve)
{
    return patch->side[0] == curve || patch->side[1] == curve || patch->side[2] == curve ||
           patch->side[3] == curve;
}

/** How many patches of one layout have the same four sides as one of the other. */
static size_t count_shared(const qm_layout *a, const qm_layout *b)
{
    size_t shared = 0;
    for (size_t i = 0; i < a->patch_count; i++)
        for (size_t k = 0; k < b->patch_count; k++) {
            int sides = 0;
            for (int s = 0; s < 4; s++)
                sides += has_side(&b->patches[k], a->patches[i].side[s]);
            shared += sides == 4;
        }
    return shared;
}

static void check_found(qm_mesh mesh, qm_layout layout)
{
    qm_ground g;
    qm_ground_make(&g, mesh);
    qm_layout found;
    qm_layout_issues issues;
    assert_int_equal(qm_layout_copy(&g.ctx, &layout, &found), QM_OK);
    assert_int_equal(qm_layout_find_patches(&g.ctx, &g.source, &found, &issues), QM_OK);
    assert_int_equal(issues.count, 0);
    assert_int_equal(found.patch_count, layout.patch_count);
    assert_int_equal(count_shared(&layout, &found), layout.patch_count);
    assert_int_equal(qm_layout_validate(&g.ctx, &found, g.source.diagonal, &g.source), QM_OK);
    qm_layout_issues_reset(&g.ctx, &issues);
    qm_layout_free(&found);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

static void patches_are_found_on_meshes_and_points(void **state)
{
    (void)state;
    check_found(qm_shape_torus(48, 24, 1.0, 0.35),
                qm_layout_of_grid(6, 4, true, true, 12, qm_torus_at, NULL));
    check_found(qm_shape_torus(48, 24, 1.0, 0.35),
                qm_layout_of_grid(2, 2, true, true, 30, qm_torus_at, NULL));
    check_found(points_of(qm_shape_torus(96, 48, 1.0, 0.35)),
                qm_layout_of_grid(3, 3, true, true, 12, qm_torus_at, NULL));
    check_found(qm_shape_saddle(20), qm_layout_of_grid(3, 2, false, false, 5, qm_saddle_at, NULL));
    /* The outside of a single patch has four sides too, and is none. */
    check_found(qm_shape_plane(8, 0.0), qm_layout_of_grid(1, 1, false, false, 4, qm_square_at, NULL));
}

/** Curves along the edges of a box, whose corners have three faces and no one tangent plane. */
static void patches_are_found_at_sharp_corners(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_box(1.0, 0.8, 0.6));
    qm_layout layout = {0};
    for (size_t v = 0; v < g.mesh.vertex_count; v++)
        assert_int_equal(qm_layout_add_node(&g.ctx, &layout, g.mesh.positions + 3 * v), QM_OK);
    for (size_t f = 0; f < g.mesh.face_count; f++) {
        for (size_t k = 0; k < 4; k++) {
            uint32_t from = g.mesh.faces[4 * f + k], to = g.mesh.faces[4 * f + (k + 1) % 4];
            if (from > to) continue; /* the other face has it the other way round */
            double ends[6];
            memcpy(ends, layout.nodes + 3 * (size_t)from, 24);
            memcpy(ends + 3, layout.nodes + 3 * (size_t)to, 24);
            assert_int_equal(qm_layout_add_curve(&g.ctx, &layout, from, to, ends, 2), QM_OK);
        }
    }
    assert_int_equal(layout.curve_count, 12);
    qm_layout_issues issues;
    assert_int_equal(qm_layout_find_patches(&g.ctx, &g.source, &layout, &issues), QM_OK);
    assert_int_equal(layout.patch_count, 6);
    assert_int_equal(issues.count, 0);
    qm_layout_reset(&g.ctx, &layout);
    qm_ground_free(&g);
}

static void cells_that_are_no_patch_are_explained(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_plane(8, 0.0));
    qm_layout layout = qm_layout_of_grid(2, 1, false, false, 4, qm_square_at, NULL);
    /* Without the curve between them, two patches are one cell of six sides. */
    assert_int_equal(qm_layout_delete_curve(&g.ctx, &layout, 5), QM_OK);
    qm_layout_issues issues;
    assert_int_equal(qm_layout_find_patches(&g.ctx, &g.source, &layout, &issues), QM_OK);
    assert_int_equal(layout.patch_count, 0);
    assert_int_equal(issues.count, 1);
    assert_int_equal(issues.items[0].fault, QM_LAYOUT_CELL_SIDES);
    assert_int_equal(issues.items[0].sides, 6);
    qm_layout_issues_reset(&g.ctx, &issues);

    const double stub[] = {0.0, 0.0, 0.0, 0.2, 0.3, 0.0};
    uint32_t id;
    assert_int_equal(qm_layout_add_stroke(&g.ctx, &layout, NULL, stub, 2, 0.01, &id), QM_OK);
    assert_int_equal(qm_layout_find_patches(&g.ctx, &g.source, &layout, &issues), QM_OK);
    bool is_dangling = false;
    for (size_t i = 0; i < issues.count; i++)
        is_dangling |= issues.items[i].fault == QM_LAYOUT_DANGLING_END && issues.items[i].curve[0] == id;
    assert_true(is_dangling);
    qm_layout_issues_reset(&g.ctx, &issues);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

static void crossing_curves_are_named(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_layout layout = qm_layout_of_grid(1, 1, false, false, 4, qm_square_at, NULL);
    const double across[] = {0.0, 0.5, 0.0, 0.4, 0.5, 0.0, 1.2, 0.55, 0.0};
    for (int k = 0; k < 3; k += 2)
        assert_int_equal(qm_layout_add_node(&ctx, &layout, across + 3 * k), QM_OK);
    assert_int_equal(qm_layout_add_curve(&ctx, &layout, 4, 5, across, 3), QM_OK);
    assert_int_equal(qm_layout_validate(&ctx, &layout, 1.4, NULL), QM_E_LAYOUT);
    assert_non_null(strstr(ctx.message, "curves 3 and 4 cross"));
    qm_layout_free(&layout);

    layout = (qm_layout){0};
    const double loop[] = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0.5, 1, 0, 0.5, -1, 0};
    assert_int_equal(qm_layout_add_node(&ctx, &layout, loop), QM_OK);
    assert_int_equal(qm_layout_add_node(&ctx, &layout, loop + 12), QM_OK);
    assert_int_equal(qm_layout_add_curve(&ctx, &layout, 0, 1, loop, 5), QM_OK);
    assert_int_equal(qm_layout_validate(&ctx, &layout, 1.4, NULL), QM_E_LAYOUT);
    assert_non_null(strstr(ctx.message, "curve 0 crosses itself"));
    qm_layout_free(&layout);
}

static int64_t turn_of(const int p[2], const int q[2], const int r[2])
{
    int64_t turn = (int64_t)(q[0] - p[0]) * (r[1] - p[1]) - (int64_t)(q[1] - p[1]) * (r[0] - p[0]);
    return (turn > 0) - (turn < 0);
}

/** Adds a curve of the torus through places of it, in degrees round the tube and in lengths along its outer circle. */
static void add_torus_curve(qm_context *ctx, qm_layout *layout, const double (*place)[2], size_t count)
{
    double points[9];
    uint32_t node[2];
    assert_true(count <= 3);
    for (size_t i = 0; i < count; i++)
        qm_torus_at(NULL, place[i][1] / (2 * M_PI * 1.35), place[i][0] / 360, points + 3 * i);
    for (size_t k = 0; k < 2; k++) {
        node[k] = (uint32_t)layout->node_count;
        assert_int_equal(qm_layout_add_node(ctx, layout, points + 3 * k * (count - 1)), QM_OK);
    }
    assert_int_equal(qm_layout_add_curve(ctx, layout, node[0], node[1], points, count), QM_OK);
}

/** Curves side by side, of segments so coarse that they cut the surface's corners and pass each other, do not cross; those that
 * do cross on the surface do. On points as on a mesh. */
static void coarse_curves_cross_on_the_surface_only(void **state)
{
    (void)state;
    for (int is_cloud = 0; is_cloud < 2; is_cloud++) {
        qm_mesh torus = qm_shape_torus(144, 64, 1.0, 0.35);
        qm_ground g;
        qm_ground_make(&g, is_cloud ? points_of(torus) : torus);
        qm_layout layout = {0};
        qm_layout_issues issues = {0};
        add_torus_curve(&g.ctx, &layout, (const double[][2]){{0, 0}, {50, 0}}, 2);
        add_torus_curve(&g.ctx, &layout, (const double[][2]){{-5, 0.02}, {20, 0.02}, {60, 0.02}}, 3);
        assert_int_equal(qm_layout_find_crossings(&g.ctx, &layout, NULL, &issues), QM_OK);
        assert_int_equal(issues.count, 1); /* as drawn through space */
        qm_layout_issues_reset(&g.ctx, &issues);
        assert_int_equal(qm_layout_find_crossings(&g.ctx, &layout, &g.source, &issues), QM_OK);
        assert_int_equal(issues.count, 0);
        add_torus_curve(&g.ctx, &layout, (const double[][2]){{10, -0.06}, {40, 0.06}}, 2);
        assert_int_equal(qm_layout_find_crossings(&g.ctx, &layout, &g.source, &issues), QM_OK);
        assert_int_equal(issues.count, 2);
        qm_layout_issues_reset(&g.ctx, &issues);
        qm_layout_free(&layout);
        qm_ground_free(&g);
    }
}

/** Segments with small integer coordinates in planes across each axis, against exact tests of all pairs. */
static void crossings_are_those_of_all_pairs(void **state)
{
    (void)state;
    enum { LINES = 60, SIDE = 20 };
    for (int axis = 0; axis < 3; axis++) {
        qm_random random = qm_random_make(qm_check_seed(), (uint64_t)axis);
        qm_context ctx = qm_context_make();
        qm_layout layout = {0};
        int end[LINES][2][2];
        for (uint32_t c = 0; c < LINES; c++) {
            double line[2][3];
            do {
                for (int i = 0; i < 4; i++)
                    end[c][i / 2][i % 2] = (int)qm_random_below(&random, SIDE + 1);
            } while (end[c][0][0] == end[c][1][0] && end[c][0][1] == end[c][1][1]);
            for (int k = 0; k < 2; k++) {
                line[k][axis] = c % 2 ? 100.0 : 0.0;
                line[k][(axis + 1) % 3] = end[c][k][0];
                line[k][(axis + 2) % 3] = end[c][k][1];
                assert_int_equal(qm_layout_add_node(&ctx, &layout, line[k]), QM_OK);
            }
            assert_int_equal(qm_layout_add_curve(&ctx, &layout, 2 * c, 2 * c + 1, line[0], 2), QM_OK);
        }
        bool is_expected[LINES][LINES] = {{false}};
        size_t expected = 0;
        for (int a = 0; a < LINES; a++)
            for (int b = a + 2; b < LINES; b += 2) {
                const int *p = end[a][0], *q = end[a][1], *r = end[b][0], *t = end[b][1];
                is_expected[a][b] =
                    turn_of(p, q, r) * turn_of(p, q, t) < 0 && turn_of(r, t, p) * turn_of(r, t, q) < 0;
                expected += is_expected[a][b];
            }
        assert_true(expected > LINES);
        qm_layout_issues issues = {0};
        assert_int_equal(qm_layout_find_crossings(&ctx, &layout, NULL, &issues), QM_OK);
        for (size_t i = 0; i < issues.count; i++)
            QM_CHECK(is_expected[issues.items[i].curve[0]][issues.items[i].curve[1]], "axis %d: %u and %u",
                     axis, issues.items[i].curve[0], issues.items[i].curve[1]);
        assert_int_equal(issues.count, expected);
        qm_layout_issues_reset(&ctx, &issues);
        qm_layout_free(&layout);
    }
}

/** A drawing of thousands of curves across each other ends, and tells of some. */
static void a_scribble_ends(void **state)
{
    (void)state;
    enum { LINES = 3000, TOLD = 1000 };
    qm_random random = qm_random_make(qm_check_seed(), 9);
    qm_ground g;
    qm_ground_make(&g, qm_shape_plane(4, 0));
    qm_layout layout = {0};
    for (uint32_t c = 0; c < LINES; c++) {
        double line[2][3] = {{0}};
        for (int k = 0; k < 2; k++) {
            line[k][0] = qm_random_range(&random, 0, 1);
            line[k][1] = qm_random_range(&random, 0, 1);
            assert_int_equal(qm_layout_add_node(&g.ctx, &layout, line[k]), QM_OK);
        }
        assert_int_equal(qm_layout_add_curve(&g.ctx, &layout, 2 * c, 2 * c + 1, line[0], 2), QM_OK);
    }
    qm_layout_issues issues = {0};
    for (int again = 0; again < 2; again++) { /* those that are known count */
        assert_int_equal(qm_layout_find_crossings(&g.ctx, &layout, &g.source, &issues), QM_OK);
        assert_int_equal(issues.count, TOLD);
    }
    for (size_t i = 1; i < issues.count; i++)
        assert_true(issues.items[i].curve[0] != issues.items[0].curve[0] ||
                    issues.items[i].curve[1] != issues.items[0].curve[1]);
    qm_layout_issues_reset(&g.ctx, &issues);
    atomic_bool canceled = true;
    g.ctx.cancel = &canceled;
    assert_int_equal(qm_layout_find_crossings(&g.ctx, &layout, &g.source, &issues), QM_E_CANCELED);
    assert_int_equal(issues.count, 0);
    g.ctx.cancel = NULL;
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

/** Points that no square can hold come from the surface, whose own size is limited. */
static void sizes_beyond_doubles_are_a_status(void **state)
{
    (void)state;
    static const double far[][3] = {
        {1e160, 0, 0}, {-1e308, 1e308, 0}, {NAN, 0.5, 0}, {INFINITY, -INFINITY, NAN}};
    qm_ground g;
    qm_ground_make(&g, qm_shape_plane(4, 0));
    for (size_t i = 0; i < sizeof far / sizeof *far; i++) {
        static const double up[3] = {0, 0, 1};
        qm_ref_surface_point on;
        qm_ref_surface_project(&g.source, far[i], &on);
        QM_CHECK(on.position[0] >= 0 && on.position[0] <= 1 && on.position[2] == 0, "point %zu", i);
        (void)qm_ref_surface_project_toward(&g.source, far[i], up, 1, &on);
        QM_CHECK(on.position[0] >= 0 && on.position[0] <= 1 && on.position[2] == 0, "point %zu", i);
    }
    qm_ground_free(&g);
    static const double scales[] = {1e150, 1e-160, 1e100};
    for (size_t i = 0; i < sizeof scales / sizeof *scales; i++) {
        qm_context ctx = qm_context_make();
        qm_mesh mesh = qm_shape_plane(4, 0);
        for (size_t k = 0; k < 3 * mesh.vertex_count; k++)
            mesh.positions[k] *= scales[i];
        qm_bvh *tree;
        qm_ref_surface surface;
        assert_int_equal(qm_bvh_build(&ctx, &mesh, QM_BVH_TARGET, 1, &tree), QM_OK);
        assert_int_equal(qm_ref_surface_init(&ctx, tree, &surface), QM_E_SCALE);
        assert_non_null(strstr(ctx.message, "2^310"));
        qm_bvh_destroy(&ctx, tree);
        qm_shape_free(&mesh);
    }
}

static void bad_layouts_are_refused_by_name(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_layout layout = qm_layout_of_grid(2, 1, false, false, 2, qm_square_at, NULL);
    qm_curve *curve = &layout.curves[1];
    double kept = curve->points[4];
    curve->points[4] = NAN;
    assert_int_equal(qm_layout_validate(&ctx, &layout, 1.0, NULL), QM_E_NOT_FINITE);
    assert_non_null(strstr(ctx.message, "point 1 of curve 1"));
    curve->points[4] = kept;

    const uint32_t open[4] = {0, 5, 1, 4};
    assert_int_equal(qm_layout_add_patch(&ctx, &layout, open), QM_E_ARGUMENT);
    assert_non_null(strstr(ctx.message, "patch 2 does not close"));
    const uint32_t unknown[4] = {0, 5, 77, 4};
    assert_int_equal(qm_layout_add_patch(&ctx, &layout, unknown), QM_E_ARGUMENT);
    assert_non_null(strstr(ctx.message, "curve 77"));

    const uint32_t again[4] = {0, 5, 2, 4};
    for (int k = 0; k < 2; k++)
        assert_int_equal(qm_layout_add_patch(&ctx, &layout, again), QM_OK);
    assert_int_equal(qm_layout_validate(&ctx, &layout, 1.0, NULL), QM_E_LAYOUT);
    assert_non_null(strstr(ctx.message, "more than two patches"));
    qm_layout_clear_patches(&ctx, &layout);

    for (size_t k = 0; k < curve->point_count; k++)
        memcpy(curve->points + 3 * k, layout.nodes + 3 * (size_t)curve->from, 3 * sizeof(double));
    curve->to = curve->from;
    assert_int_equal(qm_layout_validate(&ctx, &layout, 1.0, NULL), QM_E_LAYOUT);
    assert_non_null(strstr(ctx.message, "curve 1 has no length"));
    qm_layout_free(&layout);
}

static void split_and_merge_undo_one_another(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_layout layout = {0};
    const double line[] = {0, 0, 0, 1, 0, 0, 2, 0, 0};
    uint32_t id, part;
    assert_int_equal(qm_layout_add_stroke(&ctx, &layout, NULL, line, 3, 0.1, &id), QM_OK);
    assert_int_equal(qm_layout_split_curve(&ctx, &layout, id, (const double[]){1.5, 0.3, 0}), QM_OK);
    assert_int_equal(layout.curve_count, 2);
    assert_int_equal(layout.node_count, 3);
    assert_int_equal(layout.curves[0].point_count, 3);
    assert_true(layout.curves[0].points[6] == 1.5 && layout.curves[1].points[0] == 1.5);
    part = layout.curves[1].id;
    assert_int_equal(qm_layout_split_curve(&ctx, &layout, part, (const double[]){3, 0, 0}), QM_E_ARGUMENT);

    assert_int_equal(qm_layout_merge_curves(&ctx, &layout, part, id), QM_OK);
    assert_int_equal(layout.curve_count, 1);
    assert_int_equal(layout.node_count, 2);
    assert_int_equal(layout.curves[0].id, part);
    assert_true(qm_layout_curve_length(&layout.curves[0]) == 2.0);
    assert_int_equal(qm_layout_validate(&ctx, &layout, 1.0, NULL), QM_OK);
    assert_int_equal(qm_layout_merge_curves(&ctx, &layout, part, part), QM_E_ARGUMENT);
    assert_int_equal(qm_layout_merge_curves(&ctx, &layout, part, 99), QM_E_ARGUMENT);
    assert_int_equal(qm_layout_delete_curve(&ctx, &layout, part), QM_OK);
    assert_int_equal(layout.node_count, 0);
    assert_int_equal(qm_layout_delete_curve(&ctx, &layout, part), QM_E_ARGUMENT);
    qm_layout_free(&layout);
}

static void strokes_snap_merge_and_split(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_layout layout = {0};
    uint32_t first, next;
    const double line[] = {0, 0, 0, 1, 0, 0}, on[] = {1.05, 0.02, 0, 2, 0.1, 0};
    assert_int_equal(qm_layout_add_stroke(&ctx, &layout, NULL, line, 2, 0.1, &first), QM_OK);
    /* Goes on nearly straight: one curve. */
    assert_int_equal(qm_layout_add_stroke(&ctx, &layout, NULL, on, 2, 0.1, &next), QM_OK);
    assert_int_equal(next, first);
    assert_int_equal(layout.curve_count, 1);
    assert_int_equal(layout.node_count, 2);
    /* Turns off at a right angle: two curves that share a node. */
    const double off[] = {2, 0.05, 0, 2, 1, 0};
    assert_int_equal(qm_layout_add_stroke(&ctx, &layout, NULL, off, 2, 0.1, &next), QM_OK);
    assert_int_not_equal(next, first);
    assert_int_equal(layout.curve_count, 2);
    assert_int_equal(layout.node_count, 3);
    /* Begins in the middle of the first: that is split, and nothing is joined at the new node of three. */
    const double branch[] = {0.5, -0.05, 0, 0.5, -1, 0};
    assert_int_equal(qm_layout_add_stroke(&ctx, &layout, NULL, branch, 2, 0.1, &next), QM_OK);
    assert_int_equal(layout.curve_count, 4);
    assert_int_equal(layout.node_count, 5);
    assert_int_equal(qm_layout_validate(&ctx, &layout, 2.0, NULL), QM_OK);

    /* An end that hangs free is put on a curve, and on nothing where there is nothing. */
    assert_int_equal(qm_layout_snap_end(&ctx, &layout, next, 1, (const double[]){9, 9, 9}, 0.5),
                     QM_E_ARGUMENT);
    assert_int_equal(qm_layout_snap_end(&ctx, &layout, next, 1, (const double[]){0.25, 0, 0}, 0.1), QM_OK);
    assert_int_equal(layout.curve_count, 5);
    assert_int_equal(layout.node_count, 5);
    assert_int_equal(qm_layout_validate(&ctx, &layout, 2.0, NULL), QM_OK);

    const double detour[] = {7, 7, 7, 0.4, -0.6, 0, 7, 7, 7};
    assert_int_equal(qm_layout_redraw_curve(&ctx, &layout, next, detour, 3), QM_OK);
    const qm_curve *drawn = &layout.curves[qm_layout_find_curve(&layout, next)];
    assert_int_equal(drawn->point_count, 3);
    assert_true(drawn->points[3] == 0.4 && drawn->points[0] == 0.5);
    /* The same the other way round. */
    const double back[] = {0.25, 0, 0, 0.3, -0.7, 0, 0.4, -0.6, 0, 0.5, -0.05, 0};
    assert_int_equal(qm_layout_redraw_curve(&ctx, &layout, next, back, 4), QM_OK);
    drawn = &layout.curves[qm_layout_find_curve(&layout, next)];
    assert_true(drawn->points[0] == 0.5 && drawn->points[3] == 0.4 && drawn->points[6] == 0.3);
    assert_int_equal(qm_layout_validate(&ctx, &layout, 2.0, NULL), QM_OK);
    qm_layout_free(&layout);
}

static void strokes_cut_what_they_cross(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_layout layout = {0};
    uint32_t id;
    /* Three lines across; the last one has a point where the stroke has one, too. */
    const double across[][9] = {
        {1, -1, 0, 1, 0.5, 0, 1, 1, 0}, {2, -1, 0, 2, 0.7, 0, 2, 1, 0}, {3, -1, 0, 3, 0, 0, 3, 1, 0}};
    for (int i = 0; i < 3; i++)
        assert_int_equal(qm_layout_add_stroke(&ctx, &layout, NULL, across[i], 3, 0.1, &id), QM_OK);
    assert_int_equal(layout.curve_count, 3);
    const double stroke[] = {0, 0, 0, 0.9, 0, 0, 3, 0, 0, 4, 0, 0};
    assert_int_equal(qm_layout_add_stroke(&ctx, &layout, NULL, stroke, 4, 0.1, &id), QM_OK);
    assert_int_equal(layout.curve_count, 3 + 4 + 3);
    assert_int_equal(layout.node_count, 6 + 2 + 3);
    qm_layout_issues crossings = {0};
    assert_int_equal(qm_layout_find_crossings(&ctx, &layout, NULL, &crossings), QM_OK);
    assert_int_equal(crossings.count, 0);
    assert_int_equal(qm_layout_validate(&ctx, &layout, 5.0, NULL), QM_OK);
    const qm_curve *own = &layout.curves[qm_layout_find_curve(&layout, id)];
    assert_true(own->points[0] == 0.0 && own->points[3 * (own->point_count - 1)] == 1.0);
    /* Another goes near the node in the middle, so through it: only itself is cut. */
    const double oblique[] = {1.5, -0.5, 0, 2.04, 0, 0, 2.6, 0.5, 0};
    assert_int_equal(qm_layout_add_stroke(&ctx, &layout, NULL, oblique, 3, 0.1, &id), QM_OK);
    assert_int_equal(layout.curve_count, 10 + 2);
    assert_int_equal(layout.node_count, 11 + 2);
    qm_layout_issues_reset(&ctx, &crossings);
    assert_int_equal(qm_layout_find_crossings(&ctx, &layout, NULL, &crossings), QM_OK);
    assert_int_equal(crossings.count, 0);
    /* One that shoots past a node ends there, without crossing what it has passed. */
    const double past[] = {4.5, 2, 0, 4.2, 0.5, 0, 4, 0.05, 0, 3.96, -0.06, 0, 3.95, 0.02, 0};
    assert_int_equal(qm_layout_add_stroke(&ctx, &layout, NULL, past, 5, 0.1, &id), QM_OK);
    assert_int_equal(layout.curve_count, 12 + 1);
    assert_int_equal(layout.node_count, 13 + 1);
    assert_int_equal(layout.curves[qm_layout_find_curve(&layout, id)].point_count, 3);
    qm_layout_issues_reset(&ctx, &crossings);
    assert_int_equal(qm_layout_find_crossings(&ctx, &layout, NULL, &crossings), QM_OK);
    assert_int_equal(crossings.count, 0);
    qm_layout_issues_reset(&ctx, &crossings);
    qm_layout_free(&layout);
}

/** Every edit and the search for patches with an allocator that fails at each call in turn. */
static qm_status run_all(qm_context *ctx, const qm_ref_surface *source, qm_layout *layout)
{
    const double stroke[] = {0.25, 0, 0, 0.25, 1, 0};
    uint32_t id;
    qm_layout_issues issues = {0};
    qm_status status = qm_layout_add_stroke(ctx, layout, NULL, stroke, 2, 0.01, &id);
    if (status == QM_OK) status = qm_layout_split_curve(ctx, layout, id, (const double[]){0.25, 0.5, 0});
    if (status == QM_OK) status = qm_layout_merge_curves(ctx, layout, id, layout->next_id - 1);
    if (status == QM_OK) status = qm_layout_redraw_curve(ctx, layout, id, stroke, 2);
    if (status == QM_OK) status = qm_layout_find_patches(ctx, source, layout, &issues);
    if (status == QM_OK) assert_int_equal(layout->patch_count, 3);
    qm_layout_issues_reset(ctx, &issues);
    if (status == QM_OK) status = qm_layout_delete_curve(ctx, layout, id);
    const double across[] = {0, 0.5, 0, 0.495, 0.5, 0, 1, 0.5, 0};
    if (status == QM_OK) status = qm_layout_add_stroke(ctx, layout, NULL, across, 3, 0.01, &id);
    return status;
}

static void running_out_of_memory_leaves_a_whole_layout(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_plane(4, 0.0));
    qm_layout whole = qm_layout_of_grid(2, 1, false, false, 2, qm_square_at, NULL);
    qm_status status = QM_E_NO_MEMORY;
    for (size_t fail_at = 0; status != QM_OK; fail_at++) {
        qm_failing_allocator memory = {.fail_at = SIZE_MAX};
        qm_context ctx = {.allocator = qm_failing_allocator_hook(&memory)};
        qm_layout layout;
        assert_int_equal(qm_layout_copy(&ctx, &whole, &layout), QM_OK);
        memory.fail_at = memory.calls + fail_at;
        status = run_all(&ctx, &g.source, &layout);
        QM_CHECK(status == QM_OK || status == QM_E_NO_MEMORY, "call %zu: %s", fail_at, ctx.message);
        qm_context plain = qm_context_make();
        QM_CHECK(qm_layout_validate(&plain, &layout, 1.0, NULL) == QM_OK, "call %zu: %s", fail_at,
                 plain.message);
        qm_layout_reset(&ctx, &layout);
        QM_CHECK(memory.live_blocks == 0 && !memory.mismatched, "call %zu leaves %zu blocks", fail_at,
                 memory.live_blocks);
    }
    qm_layout_free(&whole);
    qm_ground_free(&g);
}

/** A bowl, more than half a sphere, whose rim is drawn: beyond it lies no surface, and no cell, though the curvature beyond is
 * that of less than half a sphere. The same curve a little inside bounds a cell on both sides. */
static void beyond_a_boundary_is_no_cell(void **state)
{
    (void)state;
    for (int is_inside = 0; is_inside < 2; is_inside++) {
        qm_ground g;
        qm_mesh bowl = qm_shape_plane(16, 0.0);
        for (size_t v = 0; v < bowl.vertex_count; v++) {
            double *p = bowl.positions + 3 * v, x = 2.0 * p[0] - 1.0, y = 2.0 * p[1] - 1.0;
            double ring = fmax(fabs(x), fabs(y)), round = hypot(x, y), angle = 1.7 * ring;
            double scale = round > 0.0 ? sin(angle) / round : 0.0;
            p[0] = scale * x, p[1] = scale * y, p[2] = -cos(angle);
        }
        qm_ground_make(&g, bowl);
        qm_layout layout = {0};
        double tilt = is_inside ? 1.6 : 1.7, corner[4][3], line[33][3];
        for (int k = 0; k < 4; k++) {
            const int ends[4][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
            for (int i = 0; i < 2; i++)
                corner[k][i] = sin(tilt) * ends[k][i] / sqrt(2.0);
            corner[k][2] = -cos(tilt);
            assert_int_equal(qm_layout_add_node(&g.ctx, &layout, corner[k]), QM_OK);
        }
        for (uint32_t k = 0; k < 4; k++) {
            for (int i = 0; i <= 32; i++) {
                double turn = (-135.0 + 90.0 * (k + i / 32.0)) * QM_DEGREE;
                const double at[3] = {sin(tilt) * cos(turn), sin(tilt) * sin(turn), -cos(tilt)};
                memcpy(line[i], at, sizeof at);
            }
            assert_int_equal(qm_layout_add_curve(&g.ctx, &layout, k, (k + 1) % 4, line[0], 33), QM_OK);
        }
        for (size_t c = 0; c < 4 && !is_inside; c++)
            layout.curves[c].mark = QM_CURVE_SHARP;
        qm_creases creases;
        assert_int_equal(qm_creases_follow(&g.ctx, &layout, &g.source, &creases), QM_OK);
        qm_creases_reset(&g.ctx, &creases);
        qm_layout_issues issues;
        assert_int_equal(qm_layout_find_patches(&g.ctx, &g.source, &layout, &issues), QM_OK);
        QM_CHECK(layout.patch_count == (is_inside ? 2 : 1) && issues.count == 0, "inside %d: %zu patches",
                 is_inside, layout.patch_count);
        qm_layout_issues_reset(&g.ctx, &issues);
        qm_layout_reset(&g.ctx, &layout);
        qm_ground_free(&g);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(patches_are_found_on_meshes_and_points),
        cmocka_unit_test(patches_are_found_at_sharp_corners),
        cmocka_unit_test(cells_that_are_no_patch_are_explained),
        cmocka_unit_test(crossing_curves_are_named),
        cmocka_unit_test(coarse_curves_cross_on_the_surface_only),
        cmocka_unit_test(crossings_are_those_of_all_pairs),
        cmocka_unit_test(a_scribble_ends),
        cmocka_unit_test(sizes_beyond_doubles_are_a_status),
        cmocka_unit_test(bad_layouts_are_refused_by_name),
        cmocka_unit_test(split_and_merge_undo_one_another),
        cmocka_unit_test(strokes_snap_merge_and_split),
        cmocka_unit_test(strokes_cut_what_they_cross),
        cmocka_unit_test(running_out_of_memory_leaves_a_whole_layout),
        cmocka_unit_test(beyond_a_boundary_is_no_cell),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
