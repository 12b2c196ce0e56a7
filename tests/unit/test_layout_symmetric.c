/* Layouts that are their own mirror image, and which node or curve is the image of which. */
#include "check.h"

#include "failing_allocator.h"
#include "ground.h"
#include "qm/layout_edit.h"
#include "qm/quad_layout.h"

#include <math.h>
#include <string.h>

static const double origin[3] = {0, 0, 0}, along_x[3] = {2, 0, 0};

/** A closed surface whose only plane of symmetry is x = 0: a cube's grid on a sphere with a bump on that plane. */
static qm_mesh make_bump(int n)
{
    qm_mesh m = qm_shape_cube_grid(n);
    for (size_t v = 0; v < m.vertex_count; v++) {
        double *p = m.positions + 3 * v, length = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
        for (int k = 0; k < 3; k++)
            p[k] /= length;
        double y = p[1] - 0.8, z = p[2] - 0.6, size = 1.0 + 0.4 * exp(-5.0 * (p[0] * p[0] + y * y + z * z));
        for (int k = 0; k < 3; k++)
            p[k] *= size;
        p[1] += 0.2 * p[2] * p[2];
    }
    return m;
}

static qm_status make(qm_context *ctx, const qm_ref_surface *surface, size_t quads, const double *normal,
                      qm_layout *layout, qm_layout_issues *issues)
{
    qm_quads_options wanted = qm_quads_options_default();
    wanted.quads = quads;
    const qm_quad_layout_options how = qm_quad_layout_options_default();
    return qm_quad_layout_make_symmetric(ctx, surface, origin, normal, &wanted, &how, layout, issues, NULL);
}

static void both_sides_are_alike(void **state)
{
    (void)state;
    const double normals[2][3] = {{2, 0, 0}, {-1, 0, 0}};
    qm_ground g;
    qm_ground_make(&g, make_bump(16));
    for (int i = 0; i < 2; i++) {
        qm_layout layout;
        qm_layout_issues issues;
        QM_CHECK(make(&g.ctx, &g.source, 800, normals[i], &layout, &issues) == QM_OK, "%s", g.ctx.message);
        QM_CHECK(issues.count == 0 && layout.patch_count > 4, "%zu issues, %zu patches", issues.count,
                 layout.patch_count);
        size_t on_plane = 0;
        double radius = 1e-3 * g.source.diagonal;
        for (uint32_t node = 0; node < layout.node_count; node++)
            assert_true(qm_layout_find_image_node(&layout, &g.source, origin, along_x, node, radius) !=
                        QM_NO_INDEX);
        for (size_t c = 0; c < layout.curve_count; c++) {
            bool is_reversed;
            uint32_t id = layout.curves[c].id,
                     image = qm_layout_find_image_curve(&layout, &g.source, origin, along_x, id, radius,
                                                        &is_reversed);
            QM_CHECK(image != QM_NO_INDEX, "curve %u has no image", id);
            assert_int_equal(
                qm_layout_find_image_curve(&layout, &g.source, origin, along_x, image, radius, &is_reversed),
                id);
            on_plane += image == id;
        }
        assert_true(on_plane >= 3 && on_plane < layout.curve_count / 2);
        qm_layout_reset(&g.ctx, &layout);
        qm_layout_issues_reset(&g.ctx, &issues);
    }
    qm_ground_free(&g);
}

/** Of a cube the plane x = 0 passes through vertices of the grid, or through the middles of its edges; the curves on it are smooth, and the
 * cube's own edges sharp on both sides. */
static void creases_are_kept_on_both_sides(void **state)
{
    (void)state;
    for (int n = 8; n < 10; n++) {
        qm_ground g;
        qm_ground_make(&g, qm_shape_cube_grid(n));
        qm_layout layout;
        qm_layout_issues issues;
        QM_CHECK(make(&g.ctx, &g.source, 600, along_x, &layout, &issues) == QM_OK, "%s", g.ctx.message);
        assert_int_equal(issues.count, 0);
        double sharp = 0.0;
        for (size_t c = 0; c < layout.curve_count; c++)
            if (layout.curves[c].mark == QM_CURVE_SHARP) sharp += qm_layout_curve_length(&layout.curves[c]);
        QM_CHECK(fabs(sharp - 24.0) < 1e-6, "%.9g of 24 are sharp", sharp);
        assert_int_equal(layout.corner_count, 8);
        qm_layout_reset(&g.ctx, &layout);
        qm_layout_issues_reset(&g.ctx, &issues);
        qm_ground_free(&g);
    }
}

static void bad_planes_and_surfaces_are_refused(void **state)
{
    (void)state;
    const double beyond[3] = {0, 0, 5};
    const qm_quads_options quads = qm_quads_options_default();
    const qm_quad_layout_options how = qm_quad_layout_options_default();
    qm_ground g;
    qm_ground_make(&g, qm_shape_cube_grid(2));
    qm_layout layout;
    qm_layout_issues issues;
    assert_int_equal(make(&g.ctx, &g.source, 100, origin, &layout, &issues), QM_E_ARGUMENT);
    assert_int_equal(qm_quad_layout_make_symmetric(&g.ctx, &g.source, beyond, beyond, &quads, &how, &layout,
                                                   &issues, NULL),
                     QM_E_ARGUMENT);
    assert_true(layout.curve_count == 0 && issues.count == 0);
    atomic_bool is_canceled = true;
    g.ctx.cancel = &is_canceled;
    assert_int_equal(make(&g.ctx, &g.source, 100, along_x, &layout, &issues), QM_E_CANCELED);
    qm_ground_free(&g);
}

static void running_out_of_memory_is_a_status(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_cube_grid(3));
    qm_status status = QM_E_NO_MEMORY;
    for (size_t fail_at = 0; status != QM_OK; fail_at += 1 + fail_at / 8) {
        qm_failing_allocator memory = {.fail_at = fail_at};
        qm_context ctx = {.allocator = qm_failing_allocator_hook(&memory)};
        qm_layout layout;
        qm_layout_issues issues;
        status = make(&ctx, &g.source, 60, along_x, &layout, &issues);
        QM_CHECK(status == QM_OK || status == QM_E_NO_MEMORY, "call %zu: %s", fail_at, ctx.message);
        qm_layout_reset(&ctx, &layout);
        qm_layout_issues_reset(&ctx, &issues);
        QM_CHECK(memory.live_blocks == 0 && !memory.mismatched, "call %zu leaves %zu blocks", fail_at,
                 memory.live_blocks);
    }
    qm_ground_free(&g);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(both_sides_are_alike),
        cmocka_unit_test(creases_are_kept_on_both_sides),
        cmocka_unit_test(bad_planes_and_surfaces_are_refused),
        cmocka_unit_test(running_out_of_memory_is_a_status),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
