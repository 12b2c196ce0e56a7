/* qm_quads_divide: each part against the quad that it comes from, by its corners' coordinates alone. */
#include "check.h"

#include "core/vec.h"
#include "failing_allocator.h"
#include "qm/quads.h"
#include "quad_topology.h"
#include "shapes.h"

#include <math.h>
#include <string.h>

static qm_vec corner_of(const qm_mesh *m, size_t face, int k)
{
    return qm_vec_load(m->positions + 3 * (size_t)m->faces[4 * face + (size_t)(k & 3)]);
}

static void check_near(qm_vec a, qm_vec b)
{
    assert_true(qm_vec_distance(a, b) <= 1e-12);
}

/** Part k of a face: its corner k, the middles of the sides at it, and the mean, wound as the face is. */
static void check_part(const qm_mesh *m, const qm_mesh *divided, size_t face, int k)
{
    size_t part = 4 * face + (size_t)k;
    qm_vec c[4], sum = {0, 0, 0};
    for (int i = 0; i < 4; i++) {
        c[i] = corner_of(m, face, i);
        sum = qm_vec_add(sum, c[i]);
    }
    assert_int_equal(divided->faces[4 * part + (size_t)k], m->faces[4 * face + (size_t)k]);
    check_near(corner_of(divided, part, k), c[k]);
    check_near(corner_of(divided, part, k + 1), qm_vec_mix(c[k], c[(k + 1) & 3], 0.5));
    check_near(corner_of(divided, part, k + 2), qm_vec_scale(0.25, sum));
    check_near(corner_of(divided, part, k + 3), qm_vec_mix(c[(k + 3) & 3], c[k], 0.5));
}

static void check_divided(qm_mesh *m)
{
    qm_context ctx = qm_context_make();
    qm_mesh divided;
    assert_int_equal(qm_quads_divide(&ctx, m, &divided), QM_OK);
    qm_topology before = qm_topology_find(m), after = qm_topology_find(&divided);
    assert_int_equal(divided.face_count, 4 * m->face_count);
    assert_memory_equal(divided.positions, m->positions, 3 * m->vertex_count * sizeof *m->positions);
    for (size_t f = 0; f < m->face_count; f++)
        for (int k = 0; k < 4; k++)
            check_part(m, &divided, f, k);
    assert_true(after.is_all_quads && after.is_manifold && after.is_oriented);
    assert_int_equal(after.euler, before.euler);
    assert_int_equal(after.components, before.components);
    assert_int_equal(after.boundary_edges, 2 * before.boundary_edges);
    assert_int_equal(after.irregular, before.irregular);
    qm_mesh_reset(&ctx, &divided);
    qm_shape_free(m);
}

static void closed_open_and_wrapped_meshes(void **state)
{
    (void)state;
    qm_mesh cube = qm_shape_cube_grid(3), torus = qm_shape_torus(9, 7, 1.0, 0.3),
            waves = qm_shape_waves(5, 0.2, 0.1), sphere = qm_shape_sphere(0.2);
    check_divided(&cube);
    check_divided(&torus);
    check_divided(&waves);
    check_divided(&sphere);
}

/** Sides of three quads are no two quads' alone: each quad has its own middle there, and none is left out. */
static void three_quads_at_an_edge(void **state)
{
    (void)state;
    static const double positions[] = {0,  0, 0, 0,  0, 1, 1,  0,  0, 1,  0,  1,
                                       -1, 1, 0, -1, 1, 1, -1, -1, 0, -1, -1, 1};
    static const uint32_t faces[] = {0, 1, 3, 2, 0, 1, 5, 4, 0, 1, 7, 6};
    qm_context ctx = qm_context_make();
    qm_mesh m = qm_shape_make(8, 3), divided;
    memcpy(m.positions, positions, sizeof positions);
    memcpy(m.faces, faces, sizeof faces);
    assert_int_equal(qm_quads_divide(&ctx, &m, &divided), QM_OK);
    assert_int_equal(divided.vertex_count, 8 + 12 + 3);
    for (size_t f = 0; f < 3; f++)
        for (int k = 0; k < 4; k++)
            check_part(&m, &divided, f, k);
    qm_mesh_reset(&ctx, &divided);
    qm_shape_free(&m);
}

static void out_of_memory(void **state)
{
    (void)state;
    qm_mesh cube = qm_shape_cube_grid(4);
    qm_status status = QM_E_NO_MEMORY;
    for (size_t fail_at = 0; status == QM_E_NO_MEMORY; fail_at++) {
        qm_failing_allocator memory = {.fail_at = fail_at};
        qm_context ctx = qm_context_make();
        ctx.allocator = qm_failing_allocator_hook(&memory);
        qm_mesh divided;
        status = qm_quads_divide(&ctx, &cube, &divided);
        assert_true(status == QM_OK || divided.face_count == 0);
        qm_mesh_reset(&ctx, &divided);
        assert_int_equal(memory.live_blocks, 0);
        assert_false(memory.mismatched);
        assert_true(fail_at > 2 || status == QM_E_NO_MEMORY);
    }
    assert_int_equal(status, QM_OK);
    qm_shape_free(&cube);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(closed_open_and_wrapped_meshes),
        cmocka_unit_test(three_quads_at_an_edge),
        cmocka_unit_test(out_of_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
