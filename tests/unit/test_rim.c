/* The rim of the patches of a reconstruction. */
#include "check.h"

#include "core/vec.h"
#include "failing_allocator.h"
#include "ground.h"
#include "layouts.h"
#include "qm/reconstruct.h"

#include <math.h>

/** A reconstruction that has come to so many quads. */
static qm_reconstruction *start(qm_ground *g, const qm_layout *layout, size_t max_quads)
{
    qm_reconstruction_options options = qm_reconstruction_options_default();
    qm_reconstruction *r;
    QM_CHECK(qm_reconstruction_create(&g->ctx, &g->source, layout, &options, &r) == QM_OK, "%s",
             g->ctx.message);
    qm_reconstruction_record record;
    do
        assert_int_equal(qm_reconstruction_step(&g->ctx, r, max_quads, &record), QM_OK);
    while (record.chords_changed > 0);
    return r;
}

static qm_vec corner_at(const qm_mesh *mesh, size_t face, int k)
{
    return qm_vec_load(mesh->positions + 3 * (size_t)mesh->faces[4 * face + (size_t)k]);
}

/** Two patches over x from 0 to 0.5 and on to 1: of their seven curves all but the one between are the
 * rim. */
static void the_rim_is_what_one_patch_alone_has(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_plane(8, 0.0));
    qm_layout layout = qm_layout_of_grid(2, 1, false, false, 4, qm_square_at, NULL);
    qm_reconstruction *r = start(&g, &layout, 32);
    double *points;
    size_t count;
    assert_int_equal(qm_reconstruction_boundary(&g.ctx, r, &points, &count), QM_OK);
    assert_true(count > 0);
    for (size_t i = 0; i < count; i++) {
        const double *p = points + 3 * i;
        assert_true(fmin(fmin(p[0], 1.0 - p[0]), fmin(p[1], 1.0 - p[1])) < 1e-9);
    }
    qm_context_free(&g.ctx, points, count, 3 * sizeof *points);

    qm_mesh mesh;
    assert_int_equal(qm_reconstruction_mesh(&g.ctx, r, &mesh), QM_OK);
    assert_in_range(mesh.face_count, 28, 32);
    const double corner[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    for (uint32_t face = 0; face < mesh.face_count; face++) {
        for (int k = 0; k < 4; k++) {
            const double *at = corner[k], *to = corner[(k + 1) % 4];
            const double uv[2] = {0.5 * (at[0] + to[0]), 0.5 * (at[1] + to[1])};
            qm_vec a = corner_at(&mesh, face, k), b = corner_at(&mesh, face, (k + 1) % 4);
            qm_vec p = qm_vec_mix(a, b, 0.5);
            bool expected = fmin(fmin(p.x, 1.0 - p.x), fmin(p.y, 1.0 - p.y)) < 1e-9, found;
            assert_int_equal(qm_reconstruction_mark_boundary(&g.ctx, r, &face, uv, 1, &found), QM_OK);
            QM_CHECK(found == expected, "face %u, side %d", face, k);
        }
    }
    qm_shape_free(&mesh);
    qm_reconstruction_destroy(&g.ctx, r);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

static void closed_surfaces_have_no_rim(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_torus(48, 24, 1.0, 0.35));
    qm_layout layout = qm_layout_of_grid(3, 2, true, true, 16, qm_torus_at, NULL);
    qm_reconstruction *r = start(&g, &layout, 6);
    double *points;
    size_t count;
    assert_int_equal(qm_reconstruction_boundary(&g.ctx, r, &points, &count), QM_OK);
    assert_true(count == 0 && !points);
    qm_reconstruction_destroy(&g.ctx, r);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

static void running_out_of_memory_is_a_status(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_plane(8, 0.0));
    qm_layout layout = qm_layout_of_grid(2, 1, false, false, 4, qm_square_at, NULL);
    qm_reconstruction *r = start(&g, &layout, 2);
    for (size_t fail_at = 0; fail_at < 2; fail_at++) {
        qm_failing_allocator memory = {.fail_at = fail_at};
        qm_context ctx = {.allocator = qm_failing_allocator_hook(&memory)};
        double *points;
        size_t count;
        assert_int_equal(qm_reconstruction_boundary(&ctx, r, &points, &count), QM_E_NO_MEMORY);
        assert_null(points);
        assert_true(memory.live_blocks == 0 && !memory.mismatched);
        const uint32_t face = 0;
        const double uv[2] = {0.5, 0.0};
        bool found;
        memory = (qm_failing_allocator){.fail_at = fail_at};
        assert_int_equal(qm_reconstruction_mark_boundary(&ctx, r, &face, uv, 1, &found), QM_E_NO_MEMORY);
        assert_true(memory.live_blocks == 0 && !memory.mismatched);
    }
    qm_reconstruction_destroy(&g.ctx, r);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_rim_is_what_one_patch_alone_has),
        cmocka_unit_test(closed_surfaces_have_no_rim),
        cmocka_unit_test(running_out_of_memory_is_a_status),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
