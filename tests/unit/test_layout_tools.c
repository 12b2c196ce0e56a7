/* Layouts: cells filled by patterns, chords, nodes that move, rings, tubes, links, mirror images. */
#include "check.h"

#include "failing_allocator.h"
#include "ground.h"
#include "layouts.h"
#include "qm/layout_edit.h"
#include "random.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define CENTRE 0.5

static void place_on(double radius, double angle, double out[3])
{
    out[0] = CENTRE + radius * cos(angle);
    out[1] = CENTRE + radius * sin(angle);
    out[2] = 0.0;
}

enum { PIECES = 8 };

/** A curve between two nodes at angles of one circle: along it, or for bulge 0 straight. */
static void add_side(qm_context *ctx, qm_layout *layout, uint32_t from, uint32_t to, double radius,
                     const double angle[2], double bulge)
{
    double points[3 * (PIECES + 1)], a[3], b[3], on[3];
    place_on(radius, angle[0], a);
    place_on(radius, angle[1], b);
    for (int i = 0; i <= PIECES; i++) {
        double t = (double)i / PIECES;
        place_on(radius, angle[0] + t * (angle[1] - angle[0]), on);
        for (int k = 0; k < 3; k++)
            points[3 * i + k] = bulge * on[k] + (1.0 - bulge) * ((1.0 - t) * a[k] + t * b[k]);
    }
    assert_int_equal(qm_layout_add_curve(ctx, layout, from, to, points, PIECES + 1), QM_OK);
}

/** A cell of these corners on a circle, in a wreath of patches out to a larger circle. */
static qm_layout make_wreath(qm_context *ctx, int sides, const double *angle, double bulge)
{
    qm_layout layout = {0};
    double place[3];
    for (int ring = 0; ring < 2; ring++)
        for (int i = 0; i < sides; i++) {
            place_on(ring == 0 ? 0.22 : 0.45, angle[i], place);
            assert_int_equal(qm_layout_add_node(ctx, &layout, place), QM_OK);
        }
    for (int i = 0; i < sides; i++) {
        int next = (i + 1) % sides;
        const double ends[2] = {angle[i], next > i ? angle[next] : angle[next] + 6.283185307179586};
        double spoke[6];
        add_side(ctx, &layout, (uint32_t)i, (uint32_t)next, 0.22, ends, bulge);
        add_side(ctx, &layout, (uint32_t)(sides + i), (uint32_t)(sides + next), 0.45, ends, 1.0);
        memcpy(spoke, layout.nodes + 3 * i, 24);
        memcpy(spoke + 3, layout.nodes + 3 * (sides + i), 24);
        assert_int_equal(qm_layout_add_curve(ctx, &layout, (uint32_t)i, (uint32_t)(sides + i), spoke, 2),
                         QM_OK);
    }
    return layout;
}

/** Finds the patches, which must be all there is; returns their number. */
static size_t check_complete(qm_ground *g, qm_layout *layout, const char *what)
{
    qm_layout_issues issues;
    assert_int_equal(qm_layout_find_patches(&g->ctx, &g->source, layout, &issues), QM_OK);
    if (issues.count > 0)
        QM_CHECK(false, "%s: %zu issues, the first of kind %d, curves %u and %u, %u sides, at %g %g %g", what,
                 issues.count, (int)issues.items[0].fault, issues.items[0].curve[0], issues.items[0].curve[1],
                 issues.items[0].sides, issues.items[0].position[0], issues.items[0].position[1],
                 issues.items[0].position[2]);
    qm_layout_issues_reset(&g->ctx, &issues);
    QM_CHECK(qm_layout_validate(&g->ctx, layout, g->source.diagonal, &g->source) == QM_OK, "%s: %s", what,
             g->ctx.message);
    return layout->patch_count;
}

static void regular_cells_get_few_patches(void **state)
{
    (void)state;
    /* Of the cell, and of the wreath with the rows that the cuts of its sides add there. */
    static const size_t expected[][2] = {{3, 3 + 6}, {5, 2 + 6}, {6, 2 + 6}};
    qm_ground g;
    qm_ground_make(&g, qm_shape_plane(16, 0.0));
    for (size_t i = 0; i < sizeof expected / sizeof *expected; i++) {
        double angle[8];
        for (size_t k = 0; k < expected[i][0]; k++)
            angle[k] = 6.283185307179586 * (double)k / (double)expected[i][0];
        qm_layout layout = make_wreath(&g.ctx, (int)expected[i][0], angle, 0.0);
        size_t filled;
        assert_int_equal(qm_layout_fill(&g.ctx, &layout, &g.source, NULL, &filled), QM_OK);
        assert_int_equal(filled, 1);
        assert_int_equal(check_complete(&g, &layout, "regular"), expected[i][1]);
        qm_layout_free(&layout);
    }
    qm_ground_free(&g);
}

static void cells_of_two_to_nine_sides_are_filled(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_plane(16, 0.0));
    for (uint64_t run = 0; run < 80; run++) {
        qm_random random = qm_random_make(qm_check_seed(), run);
        int sides = 2 + (int)(run % 8);
        double angle[9], turn = qm_random_range(&random, 0.0, 6.0);
        if (sides == 4) continue; /* is a patch already */
        for (int i = 0; i < sides; i++)
            angle[i] = turn + (i + qm_random_range(&random, -0.2, 0.2)) * 6.283185307179586 / sides;
        qm_layout layout =
            make_wreath(&g.ctx, sides, angle, sides == 2 ? 0.8 : qm_random_range(&random, 0.0, 0.8));
        const double centre[3] = {CENTRE, CENTRE, 0.0};
        size_t filled;
        char what[32];
        snprintf(what, sizeof what, "run %d, %d sides", (int)run, sides);
        QM_CHECK(qm_layout_fill(&g.ctx, &layout, &g.source, run % 2 ? NULL : centre, &filled) == QM_OK,
                 "%s: %s", what, g.ctx.message);
        assert_int_equal(filled, 1);
        check_complete(&g, &layout, what);
        assert_int_equal(qm_layout_fill(&g.ctx, &layout, &g.source, NULL, &filled), QM_E_ARGUMENT);
        qm_layout_free(&layout);
    }
    qm_ground_free(&g);
}

static void chords_run_through_all_their_patches(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_torus(48, 24, 1.0, 0.35));
    qm_layout layout = qm_layout_of_grid(4, 3, true, true, 16, qm_torus_at, NULL);
    uint32_t id = layout.curves[0].id;
    assert_int_equal(qm_layout_split_chord(&g.ctx, &layout, &g.source, id, 1), QM_E_ARGUMENT);
    assert_int_equal(qm_layout_split_chord(&g.ctx, &layout, &g.source, 999, 2), QM_E_ARGUMENT);
    assert_int_equal(qm_layout_split_chord(&g.ctx, &layout, &g.source, id, 3), QM_OK);
    size_t patches = check_complete(&g, &layout, "a chord in three");
    assert_true(patches == 12 + 2 * 3 || patches == 12 + 2 * 4);
    for (size_t i = 0; i < layout.node_count; i++) {
        const double *p = layout.nodes + 3 * i;
        double away = hypot(hypot(p[0], p[1]) - 1.0, p[2]);
        QM_CHECK(fabs(away - 0.35) < 0.02, "node %zu at %g of the axis", i, away);
    }
    qm_layout_free(&layout);
    /* A layout does not grow without end. */
    layout = qm_layout_of_grid(12, 60, true, true, 2, qm_torus_at, NULL);
    qm_status status = QM_OK;
    for (uint32_t curve = 0; curve < 12 && status == QM_OK; curve++)
        status = qm_layout_split_chord(&g.ctx, &layout, &g.source, curve, QM_CHORD_PARTS_MAX);
    assert_int_equal(status, QM_E_ARGUMENT);
    assert_true(layout.curve_count <= 10000 && strstr(g.ctx.message, "10000 are the most"));
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

/** A ring round the tube of a torus, at an angle about its axis. */
static uint32_t add_ring(qm_ground *g, qm_layout *layout, double angle)
{
    const double through[3] = {1.35 * cos(angle), 1.35 * sin(angle), 0.0};
    uint32_t id;
    QM_CHECK(qm_layout_add_ring(&g->ctx, layout, &g->source, through, NULL, 0.02, &id) == QM_OK, "%s",
             g->ctx.message);
    return id;
}

static void rings_and_tubes_go_round_a_torus(void **state)
{
    (void)state;
    qm_mesh mesh = qm_shape_torus(96, 48, 1.0, 0.35);
    for (int is_cloud = 0; is_cloud < 2; is_cloud++) {
        qm_mesh own = mesh;
        if (is_cloud) { /* the same without faces */
            own = qm_shape_make(mesh.vertex_count, 0);
            memcpy(own.positions, mesh.positions, 3 * sizeof(double) * mesh.vertex_count);
        } else {
            own = qm_shape_copy(&mesh);
        }
        qm_ground g;
        qm_ground_make(&g, own);
        qm_layout layout = {0};
        uint32_t ring[6];
        for (int k = 0; k < 6; k++)
            ring[k] = add_ring(&g, &layout, 0.1 + 1.04719755 * k);
        assert_int_equal(layout.curve_count, 24);
        double length = 0.0;
        for (size_t i = 0; i < 4; i++)
            length += qm_layout_curve_length(&layout.curves[i]);
        QM_CHECK(fabs(length - 0.7 * 3.14159265) < 0.03, "a ring of length %g", length);
        for (int k = 0; k < 6; k++)
            QM_CHECK(qm_layout_add_tube(&g.ctx, &layout, &g.source, ring[k], ring[(k + 1) % 6]) == QM_OK,
                     "%s", g.ctx.message);
        assert_int_equal(check_complete(&g, &layout, is_cloud ? "points" : "mesh"), 24);
        assert_int_equal(qm_layout_add_tube(&g.ctx, &layout, &g.source, ring[0], 999), QM_E_ARGUMENT);
        qm_layout_free(&layout);
        qm_ground_free(&g);
    }
    qm_shape_free(&mesh);
}

static void parts_that_lie_apart_are_told(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_torus(96, 48, 1.0, 0.35));
    qm_layout layout = {0};
    add_ring(&g, &layout, 0.1);
    uint32_t second = add_ring(&g, &layout, 3.0);
    qm_layout_issues issues;
    assert_int_equal(qm_layout_find_patches(&g.ctx, &g.source, &layout, &issues), QM_OK);
    size_t apart = 0;
    for (size_t i = 0; i < issues.count; i++)
        apart += issues.items[i].fault == QM_LAYOUT_APART && issues.items[i].curve[0] == second;
    assert_int_equal(apart, 1);
    qm_layout_issues_reset(&g.ctx, &issues);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

static void a_mirror_image_is_that_of_the_side_before_the_plane(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_plane(16, 0.0));
    qm_layout layout = {0};
    uint32_t id;
    const double right[] = {0.7, 0.2, 0, 0.9, 0.3, 0, 0.9, 0.8, 0}, left[] = {0.1, 0.1, 0, 0.3, 0.9, 0};
    const double over[] = {0.3, 0.6, 0, 0.8, 0.7, 0};
    assert_int_equal(qm_layout_add_stroke(&g.ctx, &layout, &g.source, right, 3, 0.01, &id), QM_OK);
    assert_int_equal(qm_layout_add_stroke(&g.ctx, &layout, &g.source, left, 2, 0.01, &id), QM_OK);
    assert_int_equal(qm_layout_add_stroke(&g.ctx, &layout, &g.source, over, 2, 0.01, &id), QM_OK);
    const double point[3] = {0.5, 0, 0}, normal[3] = {2, 0, 0}, none[3] = {0};
    assert_int_equal(qm_layout_mirror(&g.ctx, &layout, &g.source, point, none, 0.01), QM_E_ARGUMENT);
    assert_int_equal(qm_layout_mirror(&g.ctx, &layout, &g.source, point, normal, 0.01), QM_OK);
    assert_int_equal(layout.curve_count, 3); /* right, its image, and the one over the plane */
    assert_int_equal(layout.node_count, 6);
    for (size_t i = 0; i < layout.node_count; i++) {
        bool has_image = false;
        for (size_t k = 0; k < layout.node_count; k++)
            has_image |= fabs(layout.nodes[3 * i] + layout.nodes[3 * k] - 1.0) < 1e-9 &&
                         fabs(layout.nodes[3 * i + 1] - layout.nodes[3 * k + 1]) < 1e-9;
        QM_CHECK(has_image, "node %zu at %g %g", i, layout.nodes[3 * i], layout.nodes[3 * i + 1]);
    }
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

static void moved_nodes_take_their_curves_along(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_torus(48, 24, 1.0, 0.35));
    qm_layout layout = qm_layout_of_grid(12, 6, true, true, 16, qm_torus_at, NULL);
    double to[3];
    memcpy(to, layout.nodes, sizeof to);
    to[2] += 0.05;
    assert_int_equal(qm_layout_move_node(&g.ctx, &layout, &g.source, 99, to), QM_E_ARGUMENT);
    assert_int_equal(qm_layout_move_node(&g.ctx, &layout, &g.source, 0, to), QM_OK);
    assert_true(fabs(hypot(hypot(layout.nodes[0], layout.nodes[1]) - 1.0, layout.nodes[2]) - 0.35) < 0.01);
    assert_int_equal(check_complete(&g, &layout, "moved"), 72);
    const qm_curve *curve = &layout.curves[3];
    double held[3], bent[3];
    memcpy(held, curve->points + 3 * (curve->point_count / 2), sizeof held);
    for (int k = 0; k < 3; k++)
        bent[k] = held[k] + (k == 2 ? 0.05 : 0.01);
    uint32_t id = curve->id;
    assert_int_equal(qm_layout_slide_curve(&g.ctx, &layout, &g.source, id, curve->points, bent),
                     QM_E_ARGUMENT);
    assert_int_equal(qm_layout_slide_curve(&g.ctx, &layout, &g.source, id, held, bent), QM_OK);
    assert_int_equal(check_complete(&g, &layout, "bent"), 72);
    /* Two nodes that a curve joins become one: the four patches at that curve's sides and ends change. */
    assert_int_equal(qm_layout_merge_nodes(&g.ctx, &layout, &g.source, 0, 0), QM_E_ARGUMENT);
    size_t nodes = layout.node_count, curves = layout.curve_count;
    curve = &layout.curves[0];
    assert_int_equal(qm_layout_merge_nodes(&g.ctx, &layout, &g.source, curve->from, curve->to), QM_OK);
    assert_int_equal(layout.node_count, nodes - 1);
    assert_int_equal(layout.curve_count, curves - 1);
    QM_CHECK(qm_layout_validate(&g.ctx, &layout, g.source.diagonal, &g.source) == QM_OK, "%s", g.ctx.message);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

/** Every edit, with an allocator that fails at each call in turn. */
static qm_status run_all(qm_context *ctx, const qm_ref_surface *surface, qm_layout *layout)
{
    size_t filled;
    uint32_t id;
    const double stub[] = {0.5, 0.5, 0, 1.0, 0.4, 0}, at[3] = {0.45, 0.55, 0}, held[3] = {0.1, 0, 0},
                 normal[3] = {0, 1, 0};
    qm_status status = qm_layout_add_stroke(ctx, layout, surface, stub, 2, 0.01, &id);
    if (status == QM_OK) status = qm_layout_fill(ctx, layout, surface, NULL, &filled);
    if (status == QM_OK) status = qm_layout_split_chord(ctx, layout, surface, layout->curves[0].id, 2);
    if (status == QM_OK) status = qm_layout_move_node(ctx, layout, surface, layout->curves[id].from, at);
    if (status == QM_OK) status = qm_layout_slide_curve(ctx, layout, surface, layout->curves[0].id, held, at);
    if (status == QM_OK) status = qm_layout_add_link(ctx, layout, surface, 0, 4);
    if (status == QM_OK) status = qm_layout_merge_nodes(ctx, layout, surface, 0, 1);
    if (status == QM_OK) status = qm_layout_mirror(ctx, layout, surface, at, normal, 0.001);
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
        for (size_t i = 0; i < layout.curve_count; i++)
            assert_true(layout.curves[i].from < layout.node_count && layout.curves[i].to < layout.node_count);
        qm_layout_reset(&ctx, &layout);
        QM_CHECK(memory.live_blocks == 0 && !memory.mismatched, "call %zu leaves %zu blocks", fail_at,
                 memory.live_blocks);
    }
    qm_layout_free(&whole);
    qm_ground_free(&g);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(regular_cells_get_few_patches),
        cmocka_unit_test(cells_of_two_to_nine_sides_are_filled),
        cmocka_unit_test(chords_run_through_all_their_patches),
        cmocka_unit_test(rings_and_tubes_go_round_a_torus),
        cmocka_unit_test(parts_that_lie_apart_are_told),
        cmocka_unit_test(a_mirror_image_is_that_of_the_side_before_the_plane),
        cmocka_unit_test(moved_nodes_take_their_curves_along),
        cmocka_unit_test(running_out_of_memory_leaves_a_whole_layout),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
