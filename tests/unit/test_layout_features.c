/* Layouts: features of a mesh as curves, marks of curves and corners, and reconstructions that keep them. */
#include "check.h"

#include "failing_allocator.h"
#include "ground.h"
#include "layout/layout_creases.h"
#include "layouts.h"
#include "qm/features.h"
#include "qm/layout_edit.h"
#include "qm/layout_suggest.h"
#include "qm/quad_layout.h"
#include "qm/reconstruct.h"
#include "random.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- features ---- */

/** Every triangle with corners of its own, and some of them turned round. */
static qm_mesh tear(const qm_mesh *mesh, qm_random *random, bool turns)
{
    qm_mesh torn = qm_shape_make(3 * mesh->face_count, mesh->face_count);
    for (size_t f = 0; f < mesh->face_count; f++) {
        bool is_turned = turns && qm_random_below(random, 3) == 0;
        for (size_t k = 0; k < 3; k++) {
            size_t from = is_turned ? 2 - k : k;
            memcpy(torn.positions + 3 * (3 * f + k), mesh->positions + 3 * (size_t)mesh->faces[4 * f + from],
                   24);
            torn.faces[4 * f + k] = (uint32_t)(3 * f + k);
        }
        torn.faces[4 * f + 3] = QM_NO_INDEX;
    }
    return torn;
}

static bool same_place(const double *a, const double *b)
{
    return a[0] == b[0] && a[1] == b[1] && a[2] == b[2];
}

static void unit_normal(const qm_mesh *mesh, size_t face, double out[3])
{
    const double *p[3];
    double u[3], v[3], length = 0.0;
    for (int k = 0; k < 3; k++)
        p[k] = mesh->positions + 3 * (size_t)mesh->faces[4 * face + (size_t)k];
    for (int k = 0; k < 3; k++) {
        u[k] = p[1][k] - p[0][k];
        v[k] = p[2][k] - p[0][k];
    }
    for (int k = 0; k < 3; k++)
        out[k] = u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3];
    for (int k = 0; k < 3; k++)
        length += out[k] * out[k];
    for (int k = 0; k < 3; k++)
        out[k] /= sqrt(length);
}

/** The slow twin: for an edge of a face, whether it is a feature, by a look at all faces. False if that hangs on rounding. */
static bool decide_slowly(const qm_mesh *mesh, size_t face, int side, double angle, bool *is_feature)
{
    const double *a = mesh->positions + 3 * (size_t)mesh->faces[4 * face + (size_t)side],
                 *b = mesh->positions + 3 * (size_t)mesh->faces[4 * face + (size_t)((side + 1) % 3)];
    double own[3], other[3], degrees = 0.0;
    int others = 0;
    unit_normal(mesh, face, own);
    for (size_t g = 0; g < mesh->face_count; g++)
        for (int k = 0; k < 3 && g != face; k++) {
            const double *c = mesh->positions + 3 * (size_t)mesh->faces[4 * g + (size_t)k],
                         *d = mesh->positions + 3 * (size_t)mesh->faces[4 * g + (size_t)((k + 1) % 3)];
            bool along = same_place(a, c) && same_place(b, d), against = same_place(a, d) && same_place(b, c);
            if (!along && !against) continue;
            others++;
            unit_normal(mesh, g, other);
            double dot = own[0] * other[0] + own[1] * other[1] + own[2] * other[2];
            degrees = acos(fmin(1.0, fmax(-1.0, along ? -dot : dot))) * 180.0 / 3.14159265358979323846;
        }
    *is_feature = others != 1 || degrees > angle;
    return others != 1 || fabs(degrees - angle) > 1e-4;
}

static bool has_edge(const qm_features *f, const double *a, const double *b)
{
    for (size_t i = 0; i < f->edge_count; i++) {
        const double *c = f->points + 3 * (size_t)f->edges[i][0], *d = f->points + 3 * (size_t)f->edges[i][1];
        if ((same_place(a, c) && same_place(b, d)) || (same_place(a, d) && same_place(b, c))) return true;
    }
    return false;
}

static void features_are_those_of_a_slow_twin(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    uint64_t seed = qm_check_seed();
    for (uint64_t n = 0; n < (qm_check_long() ? 400 : 40); n++) {
        qm_random random = qm_random_make(seed, n);
        qm_mesh quads = n % 4 == 0   ? qm_shape_cube_grid(2)
                        : n % 4 == 1 ? qm_shape_torus(7, 5, 1.0, 0.4)
                        : n % 4 == 2 ? qm_shape_strip(6, 2, 2.0)
                                     : qm_shape_waves(4, 0.3, 0.1);
        if (n % 3 == 0) qm_shape_shake(&quads, &random, 0.05);
        qm_mesh whole = qm_shape_triangulated(&quads);
        qm_mesh mesh = n % 2 == 0 ? qm_shape_copy(&whole) : tear(&whole, &random, n % 8 > 4);
        const qm_features_options options = {.angle = qm_random_range(&random, 5.0, 100.0), .shortest = 1e-9};
        qm_features found;
        assert_int_equal(qm_features_find(&ctx, &mesh, &options, &found), QM_OK);
        size_t known = 0, wanted = 0;
        for (size_t f = 0; f < mesh.face_count; f++)
            for (int k = 0; k < 3; k++) {
                bool is_feature;
                if (!decide_slowly(&mesh, f, k, options.angle, &is_feature)) continue;
                const double *a = mesh.positions + 3 * (size_t)mesh.faces[4 * f + (size_t)k],
                             *b = mesh.positions + 3 * (size_t)mesh.faces[4 * f + (size_t)((k + 1) % 3)];
                QM_CHECK(has_edge(&found, a, b) == is_feature,
                         "seed %llu, case %llu: face %zu, side %d at %g degrees", (unsigned long long)seed,
                         (unsigned long long)n, f, k, options.angle);
                known++;
                wanted += is_feature;
            }
        assert_true(known > 0 && (wanted > 0) == (found.edge_count > 0));
        qm_features_reset(&ctx, &found);
        qm_shape_free(&mesh);
        qm_shape_free(&whole);
        qm_shape_free(&quads);
    }
}

static void a_box_leaves_out_what_lies_beside_it(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh mesh = qm_shape_cube_grid(8);
    const double box[6] = {0.3, -2.0, -2.0, 2.0, 2.0, 2.0};
    const qm_features_options options = {.angle = 40.0, .shortest = 1e-9, .box = box};
    qm_features found;
    assert_int_equal(qm_features_find(&ctx, &mesh, &options, &found), QM_OK);
    /* Four edges of the far side, of eight parts each, and the three last parts of four that run along x. */
    assert_int_equal(found.edge_count, 4 * 8 + 4 * 3);
    qm_features_reset(&ctx, &found);
    const double far[6] = {5.0, 5.0, 5.0, 6.0, 6.0, 6.0};
    const qm_features_options nowhere = {.angle = 40.0, .shortest = 1e-9, .box = far};
    assert_int_equal(qm_features_find(&ctx, &mesh, &nowhere, &found), QM_OK);
    assert_int_equal(found.edge_count, 0);
    const qm_features_options none = {.angle = 0.0, .shortest = 1.0};
    assert_int_equal(qm_features_find(&ctx, &mesh, &none, &found), QM_E_ARGUMENT);
    qm_shape_free(&mesh);
}

/* ---- curves along features ---- */

static qm_layout draw_features(qm_ground *g, size_t *added)
{
    qm_layout layout = {0};
    const qm_layout_features_options options = qm_layout_features_options_default();
    QM_CHECK(qm_layout_add_features(&g->ctx, &layout, &g->source, &options, added) == QM_OK, "%s",
             g->ctx.message);
    return layout;
}

static size_t count_issues(qm_ground *g, qm_layout *layout)
{
    qm_layout_issues issues;
    assert_int_equal(qm_layout_find_patches(&g->ctx, &g->source, layout, &issues), QM_OK);
    size_t count = issues.count;
    qm_layout_issues_reset(&g->ctx, &issues);
    return count;
}

static size_t count_marked(const qm_layout *layout, qm_curve_mark mark)
{
    size_t count = 0;
    for (size_t i = 0; i < layout->curve_count; i++)
        count += layout->curves[i].mark == mark;
    return count;
}

static void a_cube_is_drawn_by_its_features(void **state)
{
    (void)state;
    for (int kind = 0; kind < 2; kind++) {
        qm_ground g;
        qm_random random = qm_random_make(qm_check_seed(), 77);
        qm_mesh quads = qm_shape_cube_grid(6), whole = qm_shape_triangulated(&quads);
        qm_ground_make(&g, kind == 0 ? qm_shape_copy(&whole) : tear(&whole, &random, false));
        size_t added;
        qm_layout layout = draw_features(&g, &added);
        assert_int_equal(added, 12);
        assert_int_equal(layout.corner_count, 8);
        assert_int_equal(layout.node_count, 8);
        assert_int_equal(count_marked(&layout, QM_CURVE_SHARP), 12);
        for (size_t i = 0; i < 12; i++)
            assert_int_equal(layout.curves[i].point_count, 2); /* what lies between on the line is left out */
        if (kind == 0) assert_int_equal(count_issues(&g, &layout), 0);
        if (kind == 0) assert_int_equal(layout.patch_count, 6);
        qm_layout_reset(&g.ctx, &layout);
        qm_shape_free(&whole);
        qm_shape_free(&quads);
        qm_ground_free(&g);
    }
}

/** A tube round z from 0 to 2, of radius 1, closed by discs: u round it, v up the first disc, the tube, down the second. */
static void can_at(const void *user, double u, double v, double out[3])
{
    (void)user;
    double angle = 6.283185307179586 * u, radius = v < 0.25   ? 0.1 + 3.6 * v
                                                   : v > 0.75 ? 0.1 + 3.6 * (1.0 - v)
                                                              : 1.0;
    out[0] = radius * cos(angle);
    out[1] = radius * sin(angle);
    out[2] = v < 0.25 ? 0.0 : v > 0.75 ? 2.0 : 4.0 * (v - 0.25);
}

static void round_features_are_cut_into_four(void **state)
{
    (void)state;
    qm_ground g;
    size_t added;
    qm_ground_make(&g, qm_shape_grid(64, 32, true, false, can_at, NULL));
    qm_layout layout = draw_features(&g, &added);
    /* Two rims of the tube, and two boundaries of the holes in the discs. */
    assert_int_equal(added, 16);
    assert_int_equal(layout.corner_count, 0);
    assert_int_equal(count_marked(&layout, QM_CURVE_SHARP), 16);
    /* The cuts of all lie beside each other: at the same angles. */
    double first = atan2(layout.nodes[1], layout.nodes[0]);
    for (size_t i = 1; i < layout.node_count; i++) {
        double turn = (atan2(layout.nodes[3 * i + 1], layout.nodes[3 * i]) - first) * 4.0;
        assert_true(cos(turn) > 1.0 - 1e-9);
    }
    qm_layout_reset(&g.ctx, &layout);
    qm_ground_free(&g);
}

/* Of thousands of edges that are bent as creases are. */
#define FEW_SPECKS 40

static void rough_surfaces_have_no_specks(void **state)
{
    (void)state;
    /* Edges are 0.008 long: with the least height few are bent as a crease is, with the greatest nearly all. */
    for (double height = 0.001; height < 0.009; height *= 1.4) {
        qm_random random = qm_random_make(qm_check_seed(), 5);
        qm_mesh quads = qm_shape_plane(120, 0.0), mesh = qm_shape_triangulated(&quads);
        for (size_t i = 0; i < mesh.vertex_count; i++)
            mesh.positions[3 * i + 2] += qm_random_range(&random, -height, height);
        qm_ground g;
        size_t added;
        qm_ground_make(&g, mesh);
        qm_features found;
        const qm_features_options bare = {.angle = 40.0, .shortest = 1e-9};
        assert_int_equal(qm_features_find(&g.ctx, &g.mesh, &bare, &found), QM_OK);
        assert_true(height < 0.004 || found.edge_count > 5000);
        qm_features_reset(&g.ctx, &found);
        qm_layout layout = draw_features(&g, &added);
        QM_CHECK(added >= 4 && added <= 4 + FEW_SPECKS, "height %g: %zu curves", height, added);
        QM_CHECK(added == 4 || height > 0.003, "height %g: %zu curves", height, added);
        qm_layout_reset(&g.ctx, &layout);
        qm_shape_free(&quads);
        qm_ground_free(&g);
    }
}

static void features_that_are_drawn_become_sharp(void **state)
{
    (void)state;
    qm_ground g;
    size_t added;
    uint32_t id;
    qm_layout layout = {0};
    const qm_layout_features_options options = qm_layout_features_options_default();
    qm_ground_make(&g, qm_shape_cube_grid(6));
    const double drawn[] = {-1.0, 0.99, 1.0, -0.3, 1.0, 0.995, 0.4, 0.99, 1.0, 1.0, 1.0, 0.99};
    const double across[] = {0.0, 0.2, 1.0, 0.0, 0.99, 1.0, 0.0, 1.0, 0.99, 0.0, 1.0, 0.5};
    assert_int_equal(qm_layout_add_stroke(&g.ctx, &layout, &g.source, drawn, 4, 0.02, &id), QM_OK);
    assert_int_equal(qm_layout_add_stroke(&g.ctx, &layout, &g.source, across, 4, 0.02, &id), QM_OK);
    size_t before = layout.curve_count;
    assert_int_equal(before, 4); /* both are cut where they cross */
    assert_int_equal(qm_layout_add_features(&g.ctx, &layout, &g.source, &options, &added), QM_OK);
    assert_int_equal(added, 11);
    assert_int_equal(count_marked(&layout, QM_CURVE_SMOOTH), 2);
    assert_int_equal(count_marked(&layout, QM_CURVE_SHARP), 13);
    assert_int_equal(layout.corner_count, 8);
    assert_int_equal(qm_layout_add_features(&g.ctx, &layout, &g.source, &options, &added), QM_OK);
    assert_int_equal(added, 0);
    qm_layout_reset(&g.ctx, &layout);
    qm_ground_free(&g);
}

static void strokes_snap_to_features(void **state)
{
    (void)state;
    qm_ground g;
    qm_layout layout = {0};
    uint32_t id;
    qm_ground_make(&g, qm_shape_cube_grid(10));
    /* Along an edge and round a corner, then off over a side; and one that only crosses an edge. */
    const double round[] = {0.97, 1.0, -0.5, 1.0, 0.98, 0.2, 0.99, 1.0, 0.9,
                            0.9,  1.0, 0.98, 0.1, 0.98, 1.0, -0.5, 1.0, 0.99};
    const double off[] = {0.2, 1.0, 0.97, -0.2, 0.99, 1.0, -0.6, 0.98, 1.0, -0.7, 0.6, 1.0, -0.7, 0.1, 1.0};
    const double across[] = {0.5, 0.6, 1.0, 0.5, 0.99, 1.0, 0.5, 1.0, 0.99, 0.5, 1.0, 0.6};
    assert_int_equal(
        qm_layout_add_snapped_stroke(&g.ctx, &layout, &g.source, round, 6, 1e-6, 40.0, 0.06, &id), QM_OK);
    assert_int_equal(layout.curves[0].mark, QM_CURVE_SHARP);
    bool has_corner = false;
    for (size_t i = 0; i < layout.curves[0].point_count; i++) {
        const double *p = layout.curves[0].points + 3 * i;
        assert_true(p[1] == 1.0 && (p[0] == 1.0 || p[2] == 1.0));
        has_corner |= p[0] == 1.0 && p[2] == 1.0;
    }
    assert_true(has_corner);
    qm_layout_reset(&g.ctx, &layout);

    assert_int_equal(qm_layout_add_snapped_stroke(&g.ctx, &layout, &g.source, off, 5, 1e-6, 40.0, 0.06, &id),
                     QM_OK);
    assert_int_equal(layout.curves[0].mark, QM_CURVE_SMOOTH);
    assert_true(layout.nodes[1] == 1.0 && layout.nodes[2] == 1.0);
    const double *last = layout.nodes + 3 * (layout.node_count - 1);
    assert_true(last[0] == -0.7 && last[1] == 0.1);
    qm_layout_reset(&g.ctx, &layout);

    assert_int_equal(
        qm_layout_add_snapped_stroke(&g.ctx, &layout, &g.source, across, 4, 1e-6, 40.0, 0.06, &id), QM_OK);
    assert_int_equal(layout.curves[0].point_count, 4);
    assert_int_equal(
        qm_layout_add_snapped_stroke(&g.ctx, &layout, &g.source, across, 4, 1e-6, 0.0, 0.06, &id),
        QM_E_ARGUMENT);
    qm_layout_reset(&g.ctx, &layout);
    qm_ground_free(&g);
}

/* ---- marks ---- */

static void edits_keep_marks(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_plane(8, 0.0));
    qm_context *ctx = &g.ctx;
    qm_layout layout = qm_layout_of_grid(2, 2, false, false, 4, qm_square_at, NULL);
    const uint32_t sharp[] = {0, 6}, fixed[] = {3}, missing[] = {0, 99}, corners[] = {0, 4};
    assert_int_equal(qm_layout_mark_curves(ctx, &layout, sharp, 2, QM_CURVE_SHARP), QM_OK);
    assert_int_equal(qm_layout_mark_curves(ctx, &layout, fixed, 1, QM_CURVE_FIXED), QM_OK);
    assert_int_equal(qm_layout_mark_curves(ctx, &layout, missing, 2, QM_CURVE_FIXED), QM_E_ARGUMENT);
    assert_int_equal(qm_layout_mark_nodes(ctx, &layout, corners, 2, true), QM_OK);
    assert_int_equal(qm_layout_mark_nodes(ctx, &layout, missing, 2, true), QM_E_ARGUMENT);
    assert_int_equal(layout.corner_count, 2);

    const double middle[] = {0.25, 0.0, 0.0}, to[] = {0.6, 0.6, 0.0}, on_fixed[] = {0.75, 0.5, 0.0};
    assert_int_equal(qm_layout_split_curve(ctx, &layout, 0, middle), QM_OK);
    assert_int_equal(layout.curves[layout.curve_count - 1].mark, QM_CURVE_SHARP);
    uint32_t part = layout.next_id - 1;
    assert_int_equal(qm_layout_mark_curves(ctx, &layout, &part, 1, QM_CURVE_SMOOTH), QM_OK);
    assert_int_equal(qm_layout_merge_curves(ctx, &layout, 0, part), QM_E_ARGUMENT);
    assert_non_null(strstr(ctx->message, "mark them alike"));
    assert_int_equal(qm_layout_mark_curves(ctx, &layout, &part, 1, QM_CURVE_SHARP), QM_OK);
    uint32_t node = (uint32_t)layout.node_count - 1;
    assert_int_equal(qm_layout_mark_nodes(ctx, &layout, &node, 1, true), QM_OK);
    assert_int_equal(qm_layout_merge_curves(ctx, &layout, 0, part), QM_E_ARGUMENT);
    assert_non_null(strstr(ctx->message, "corner"));
    assert_int_equal(qm_layout_mark_nodes(ctx, &layout, &node, 1, false), QM_OK);
    assert_int_equal(qm_layout_merge_curves(ctx, &layout, 0, part), QM_OK);
    assert_int_equal(layout.curves[0].mark, QM_CURVE_SHARP);

    /* Corners and the ends of fixed curves do not move, nor do their points. */
    assert_int_equal(qm_layout_move_node(ctx, &layout, &g.source, 4, to), QM_E_ARGUMENT);
    assert_int_equal(qm_layout_move_node(ctx, &layout, &g.source, 5, to), QM_E_ARGUMENT);
    assert_int_equal(qm_layout_move_node(ctx, &layout, &g.source, 7, to), QM_OK);
    assert_int_equal(qm_layout_slide_curve(ctx, &layout, &g.source, 3, on_fixed, to), QM_E_ARGUMENT);
    assert_int_equal(qm_layout_snap_end(ctx, &layout, 3, 1, to, 0.5), QM_E_ARGUMENT);
    assert_int_equal(qm_layout_merge_nodes(ctx, &layout, &g.source, 1, 4), QM_E_ARGUMENT);

    /* Corners keep their places when nodes before them go: the curves at node 0 are deleted. */
    assert_int_equal(qm_layout_delete_curve(ctx, &layout, 0), QM_OK);
    assert_int_equal(qm_layout_delete_curve(ctx, &layout, 6), QM_OK);
    assert_int_equal(layout.corner_count, 1);
    assert_true(fabs(layout.nodes[3 * layout.corners[0]] - 0.5) < 1e-12 &&
                fabs(layout.nodes[3 * layout.corners[0] + 1] - 0.5) < 1e-12);

    /* Chords and copies. */
    assert_int_equal(qm_layout_split_chord(ctx, &layout, &g.source, 3, 3), QM_OK);
    assert_int_equal(count_marked(&layout, QM_CURVE_FIXED), 3);
    qm_layout copy;
    assert_int_equal(qm_layout_copy(ctx, &layout, &copy), QM_OK);
    assert_int_equal(count_marked(&copy, QM_CURVE_FIXED), 3);
    assert_true(copy.corner_count == 1 && copy.corners[0] == layout.corners[0]);
    qm_layout_reset(ctx, &copy);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

static void mirror_images_and_strokes_have_marks(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_plane(8, 0.0));
    qm_layout layout = {0};
    uint32_t id, other;
    const double drawn[] = {0.6, 0.5, 0.0, 0.9, 0.5, 0.0}, on[] = {0.905, 0.5, 0.0, 0.97, 0.52, 0.0};
    const double point[] = {0.5, 0.5, 0.0}, normal[] = {1.0, 0.0, 0.0};
    assert_int_equal(qm_layout_add_stroke(&g.ctx, &layout, &g.source, drawn, 2, 0.02, &id), QM_OK);
    assert_int_equal(qm_layout_mark_curves(&g.ctx, &layout, &id, 1, QM_CURVE_SHARP), QM_OK);
    /* A stroke that goes on from a curve takes its mark; at a corner it is a curve of its own. */
    assert_int_equal(qm_layout_add_stroke(&g.ctx, &layout, &g.source, on, 2, 0.02, &other), QM_OK);
    assert_int_equal(other, id);
    assert_int_equal(layout.curve_count, 1);
    assert_int_equal(layout.curves[0].mark, QM_CURVE_SHARP);
    const uint32_t end = layout.curves[0].to;
    assert_int_equal(qm_layout_mark_nodes(&g.ctx, &layout, &end, 1, true), QM_OK);
    const double beyond[] = {0.97, 0.52, 0.0, 0.99, 0.526, 0.0};
    assert_int_equal(qm_layout_add_stroke(&g.ctx, &layout, &g.source, beyond, 2, 0.004, &other), QM_OK);
    assert_int_equal(layout.curve_count, 2);
    assert_int_equal(qm_layout_mirror(&g.ctx, &layout, &g.source, point, normal, 0.01), QM_OK);
    assert_int_equal(layout.curve_count, 4);
    assert_int_equal(count_marked(&layout, QM_CURVE_SHARP), 2);
    assert_int_equal(layout.corner_count, 2);
    qm_layout_reset(&g.ctx, &layout);
    qm_ground_free(&g);
}

/* ---- reconstructions ---- */

/** The layout of a cube's edges, drawn by an unsure hand: its nodes and points are off them by so much. */
static qm_layout draw_unsure(qm_ground *g, uint64_t stream, double off)
{
    size_t added;
    qm_random random = qm_random_make(qm_check_seed(), stream);
    qm_layout exact = draw_features(g, &added), layout = {0};
    for (size_t i = 0; i < exact.node_count; i++) {
        double at[3];
        for (size_t k = 0; k < 3; k++)
            at[k] = exact.nodes[3 * i + k] + qm_random_range(&random, -off, off);
        assert_int_equal(qm_layout_add_node(&g->ctx, &layout, at), QM_OK);
    }
    for (size_t i = 0; i < exact.curve_count; i++) {
        double points[3 * 17];
        const qm_curve *curve = &exact.curves[i];
        for (size_t s = 0; s <= 16; s++)
            for (size_t k = 0; k < 3; k++)
                points[3 * s + k] = curve->points[k] +
                                    (curve->points[3 + k] - curve->points[k]) * (double)s / 16.0 +
                                    qm_random_range(&random, -off, off);
        assert_int_equal(qm_layout_add_curve(&g->ctx, &layout, curve->from, curve->to, points, 17), QM_OK);
    }
    assert_int_equal(count_issues(g, &layout), 0);
    qm_layout_reset(&g->ctx, &exact);
    return layout;
}

/** True if the four corners of a face lie in one side of the cube, exactly but for rounding. */
static bool is_in_side(const qm_mesh *mesh, size_t face)
{
    for (size_t k = 0; k < 3; k++)
        for (double side = -1.0; side <= 1.0; side += 2.0) {
            int on = 0;
            for (size_t c = 0; c < 4; c++)
                on += fabs(mesh->positions[3 * (size_t)mesh->faces[4 * face + c] + k] - side) < 1e-12;
            if (on == 4) return true;
        }
    return false;
}

static size_t count_off_sides(const qm_mesh *mesh)
{
    size_t off = 0;
    for (size_t f = 0; f < mesh->face_count; f++)
        off += !is_in_side(mesh, f);
    return off;
}

static void sharp_curves_stay_on_the_crease_at_every_step(void **state)
{
    (void)state;
    for (int is_sharp = 0; is_sharp < 2; is_sharp++) {
        qm_ground g;
        qm_ground_make(&g, qm_shape_cube_grid(8));
        qm_layout layout = draw_unsure(&g, 3, 0.015);
        for (size_t i = 0; i < layout.curve_count && is_sharp; i++)
            layout.curves[i].mark = QM_CURVE_SHARP;
        qm_reconstruction_options options = qm_reconstruction_options_default();
        qm_reconstruction *r;
        QM_CHECK(qm_reconstruction_create(&g.ctx, &g.source, &layout, &options, &r) == QM_OK, "%s",
                 g.ctx.message);
        qm_reconstruction_record record = {.chords_changed = 1};
        size_t off = 0;
        while (record.chords_changed > 0) {
            qm_mesh mesh;
            assert_int_equal(qm_reconstruction_mesh(&g.ctx, r, &mesh), QM_OK);
            size_t here = count_off_sides(&mesh);
            QM_CHECK(!is_sharp || here == 0, "%zu of %zu quads lie in no side of the cube", here,
                     mesh.face_count);
            off += here;
            qm_mesh_reset(&g.ctx, &mesh);
            assert_int_equal(qm_reconstruction_step(&g.ctx, r, 3000, &record), QM_OK);
        }
        assert_true(is_sharp || off > 0); /* the same curves, not marked, run beside the edges */
        qm_reconstruction_destroy(&g.ctx, r);
        qm_layout_free(&layout);
        qm_ground_free(&g);
    }
}

/** How many coordinates of a place are -1 or 1. */
static int count_ends(const double *p)
{
    int ends = 0;
    for (int k = 0; k < 3; k++)
        ends += fabs(fabs(p[k]) - 1.0) <= 1e-12;
    return ends;
}

static void automatic_layouts_follow_creases_exactly(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_cube_grid(8));
    qm_quads_options quads = qm_quads_options_default();
    quads.quads = 400;
    qm_quad_layout_options how = qm_quad_layout_options_default();
    qm_layout layout;
    qm_layout_issues issues;
    for (int from_quads = 0; from_quads < 2; from_quads++) {
        how.crease_angle = 40.0;
        qm_status status = from_quads
                               ? qm_quad_layout_make(&g.ctx, &g.mesh, &g.source, &how, &layout, &issues, NULL)
                               : qm_quad_layout_make_of_surface(&g.ctx, &g.source, &quads, NULL, &how,
                                                                &layout, &issues, NULL, NULL);
        QM_CHECK(status == QM_OK, "%s", g.ctx.message);
        double length = 0.0;
        for (size_t i = 0; i < layout.curve_count; i++) {
            const qm_curve *curve = &layout.curves[i];
            size_t off = 0;
            for (size_t k = 0; k < curve->point_count; k++)
                off += count_ends(curve->points + 3 * k) < 2;
            QM_CHECK((curve->mark == QM_CURVE_SHARP) == (off == 0), "curve %zu: %zu points off the edges", i,
                     off);
            if (off == 0) length += qm_layout_curve_length(curve);
        }
        QM_CHECK(fabs(length - 24.0) <= 1e-9, "%.12g of 24 are sharp", length);
        assert_int_equal(layout.corner_count, 8);
        for (size_t i = 0; i < 8; i++)
            assert_int_equal(count_ends(layout.nodes + 3 * (size_t)layout.corners[i]), 3);
        qm_layout_reset(&g.ctx, &layout);
        qm_layout_issues_reset(&g.ctx, &issues);
    }
    qm_ground_free(&g);
}

static void boundaries_of_quads_are_sharp(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_plane(6, 0.0));
    qm_quad_layout_options how = qm_quad_layout_options_default();
    qm_layout layout;
    qm_layout_issues issues;
    assert_int_equal(qm_quad_layout_make(&g.ctx, &g.mesh, &g.source, &how, &layout, &issues, NULL), QM_OK);
    assert_true(layout.patch_count == 1 && layout.curve_count == 4 && layout.corner_count == 4);
    for (size_t i = 0; i < 4; i++)
        assert_int_equal(layout.curves[i].mark, QM_CURVE_SHARP);
    qm_layout_reset(&g.ctx, &layout);
    qm_layout_issues_reset(&g.ctx, &issues);
    qm_ground_free(&g);
}

/** On a cube: a sharp curve beside an edge, and another one that lies between it and the edge, or does not. */
static void sharp_curves_that_would_cross_become_smooth(void **state)
{
    (void)state;
    for (int is_between = 0; is_between < 2; is_between++) {
        qm_ground g;
        qm_ground_make(&g, qm_shape_cube_grid(8));
        qm_layout layout = {0};
        qm_layout_issues issues = {0};
        double y = is_between ? 0.995 : 0.5, sharp[9][3], other[9][3];
        for (int k = 0; k < 9; k++) {
            const double at[2][3] = {{-0.8 + 0.2 * k, 0.98, 1}, {-0.4 + 0.1 * k, y, 1}};
            memcpy(sharp[k], at[0], sizeof at[0]);
            memcpy(other[k], at[1], sizeof at[1]);
        }
        /* the other one goes down the next side, so that it crosses the edge */
        if (is_between) other[7][1] = other[8][1] = 1.0, other[8][2] = 0.8;
        const double *node[4] = {sharp[0], sharp[8], other[0], other[8]};
        for (int k = 0; k < 4; k++)
            assert_int_equal(qm_layout_add_node(&g.ctx, &layout, node[k]), QM_OK);
        assert_int_equal(qm_layout_add_curve(&g.ctx, &layout, 0, 1, sharp[0], 9), QM_OK);
        assert_int_equal(qm_layout_add_curve(&g.ctx, &layout, 2, 3, other[0], 9), QM_OK);
        layout.curves[0].mark = QM_CURVE_SHARP;
        assert_int_equal(qm_layout_find_crossings(&g.ctx, &layout, &g.source, &issues), QM_OK);
        assert_int_equal(issues.count, 0);
        assert_int_equal(qm_creases_settle_curves(&g.ctx, &layout, &g.source, &issues), QM_OK);
        assert_int_equal(issues.count, 0);
        assert_int_equal(layout.curves[0].mark, is_between ? QM_CURVE_SMOOTH : QM_CURVE_SHARP);
        assert_int_equal(layout.corner_count, is_between ? 0 : 2);
        if (is_between) {
            assert_int_equal(layout.curves[0].point_count, 9);
            assert_memory_equal(layout.curves[0].points, sharp, sizeof sharp);
        }
        for (size_t k = 0; k < layout.curves[0].point_count && !is_between; k++)
            assert_int_equal(count_ends(layout.curves[0].points + 3 * k), 2);
        qm_layout_issues_reset(&g.ctx, &issues);
        qm_layout_reset(&g.ctx, &layout);
        qm_ground_free(&g);
    }
}

static void fixed_curves_and_corners_stay_where_they_were_drawn(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_plane(16, 0.0));
    qm_layout layout = qm_layout_of_grid(2, 2, false, false, 4, qm_square_at, NULL);
    const uint32_t fixed[] = {2}, corner[] = {1};
    /* The curve from the middle of the left side to the centre is drawn above the plane, as is the corner below. */
    for (size_t i = 1; i + 1 < layout.curves[2].point_count; i++)
        layout.curves[2].points[3 * i + 2] = 0.01;
    layout.nodes[3 * 1 + 2] = 0.005;
    for (size_t i = 0; i < layout.curve_count; i++) {
        if (layout.curves[i].from == 1) layout.curves[i].points[2] = 0.005;
        if (layout.curves[i].to == 1) layout.curves[i].points[3 * layout.curves[i].point_count - 1] = 0.005;
    }
    assert_int_equal(qm_layout_mark_curves(&g.ctx, &layout, fixed, 1, QM_CURVE_FIXED), QM_OK);
    assert_int_equal(qm_layout_mark_nodes(&g.ctx, &layout, corner, 1, true), QM_OK);
    assert_int_equal(count_issues(&g, &layout), 0);
    qm_reconstruction_options options = qm_reconstruction_options_default();
    qm_reconstruction *r, *again;
    QM_CHECK(qm_reconstruction_create(&g.ctx, &g.source, &layout, &options, &r) == QM_OK, "%s",
             g.ctx.message);
    qm_reconstruction_record record;
    size_t high = 0, at_corner = 0, redone;
    qm_mesh mesh;
    for (int step = 0; step < 6; step++)
        assert_int_equal(qm_reconstruction_step(&g.ctx, r, 4000, &record), QM_OK);
    assert_int_equal(qm_reconstruction_mesh(&g.ctx, r, &mesh), QM_OK);
    for (size_t i = 0; i < mesh.vertex_count; i++) {
        const double *p = mesh.positions + 3 * i;
        high += fabs(p[2] - 0.01) < 1e-12 && fabs(p[1] - 0.5) < 1e-9 && p[0] < 0.5;
        at_corner += p[0] == 0.5 && p[1] == 0.0 && p[2] == 0.005;
    }
    QM_CHECK(high >= 4 && at_corner == 1, "%zu vertices of the curve, %zu of the corner", high, at_corner);
    qm_mesh_reset(&g.ctx, &mesh);
    /* Without the mark it comes down to the surface, and nothing has to be drawn for that. */
    assert_int_equal(qm_layout_mark_curves(&g.ctx, &layout, fixed, 1, QM_CURVE_SMOOTH), QM_OK);
    assert_int_equal(count_issues(&g, &layout), 0);
    assert_int_equal(qm_reconstruction_edit(&g.ctx, r, &layout, &again, &redone), QM_OK);
    assert_true(redone >= 2);
    assert_int_equal(qm_reconstruction_mesh(&g.ctx, again, &mesh), QM_OK);
    for (size_t i = 0; i < mesh.vertex_count; i++)
        assert_true(fabs(mesh.positions[3 * i + 2]) < 1e-12 || mesh.positions[3 * i + 2] == 0.005);
    qm_mesh_reset(&g.ctx, &mesh);
    qm_reconstruction_destroy(&g.ctx, again);
    qm_reconstruction_destroy(&g.ctx, r);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

/* ---- memory ---- */

static void running_out_of_memory_leaves_nothing_behind(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_cube_grid(3));
    qm_layout drawn = draw_unsure(&g, 9, 0.01);
    for (size_t i = 0; i < drawn.curve_count; i++)
        drawn.curves[i].mark = QM_CURVE_SHARP;
    const double along[] = {-0.8, 0.95, 1.0, 0.0, 0.97, 1.0, 0.8, 0.94, 1.0};
    /* All edges, and a curve that ends in a side. */
    size_t count;
    uint32_t end;
    qm_layout open = draw_features(&g, &count);
    const double inward[] = {1.0, 0.0, 1.0, 0.0, 0.1, 1.0};
    assert_int_equal(qm_layout_add_stroke(&g.ctx, &open, &g.source, inward, 2, 0.01, &end), QM_OK);
    for (int what = 0; what < 4; what++) {
        qm_status status = QM_E_NO_MEMORY;
        for (size_t fail_at = 0; status != QM_OK; fail_at++) {
            qm_failing_allocator memory = {.fail_at = SIZE_MAX};
            qm_context ctx = {.allocator = qm_failing_allocator_hook(&memory)};
            const qm_layout_features_options options = qm_layout_features_options_default();
            qm_reconstruction_options wanted = qm_reconstruction_options_default();
            qm_layout layout = {0};
            qm_reconstruction *r = NULL;
            qm_layout_suggestions suggestions = {0};
            size_t added;
            uint32_t id;
            memory.fail_at = memory.calls + fail_at;
            if (what == 0)
                status = qm_layout_add_features(&ctx, &layout, &g.source, &options, &added);
            else if (what == 1)
                status = qm_reconstruction_create(&ctx, &g.source, &drawn, &wanted, &r);
            else if (what == 2)
                status =
                    qm_layout_add_snapped_stroke(&ctx, &layout, &g.source, along, 3, 0.01, 40.0, 0.1, &id);
            else
                status = qm_layout_suggest(&ctx, &open, &g.source, &options, 10, &suggestions);
            QM_CHECK(status == QM_OK || status == QM_E_NO_MEMORY, "call %zu: %s", fail_at, ctx.message);
            qm_layout_reset(&ctx, &layout);
            qm_reconstruction_destroy(&ctx, r);
            qm_layout_suggestions_reset(&ctx, &suggestions);
            QM_CHECK(memory.live_blocks == 0 && !memory.mismatched, "%d: call %zu leaves %zu blocks", what,
                     fail_at, memory.live_blocks);
            if (what == 1 && fail_at > 400) fail_at += 97; /* the rest is walked by other tests */
        }
    }
    qm_layout_free(&open);
    qm_layout_free(&drawn);
    qm_ground_free(&g);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(features_are_those_of_a_slow_twin),
        cmocka_unit_test(a_box_leaves_out_what_lies_beside_it),
        cmocka_unit_test(a_cube_is_drawn_by_its_features),
        cmocka_unit_test(round_features_are_cut_into_four),
        cmocka_unit_test(rough_surfaces_have_no_specks),
        cmocka_unit_test(features_that_are_drawn_become_sharp),
        cmocka_unit_test(strokes_snap_to_features),
        cmocka_unit_test(edits_keep_marks),
        cmocka_unit_test(mirror_images_and_strokes_have_marks),
        cmocka_unit_test(automatic_layouts_follow_creases_exactly),
        cmocka_unit_test(boundaries_of_quads_are_sharp),
        cmocka_unit_test(sharp_curves_that_would_cross_become_smooth),
        cmocka_unit_test(sharp_curves_stay_on_the_crease_at_every_step),
        cmocka_unit_test(fixed_curves_and_corners_stay_where_they_were_drawn),
        cmocka_unit_test(running_out_of_memory_leaves_nothing_behind),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
