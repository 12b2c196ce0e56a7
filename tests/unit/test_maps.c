/* Maps of patches over the triangles of a surface, and meshes made anew from them; what comes out is measured by other code. */
#include "check.h"

#include "cells.h"
#include "core/vec.h"
#include "failing_allocator.h"
#include "ground.h"
#include "layouts.h"
#include "qm/reconstruct.h"
#include "quad_topology.h"
#include "random.h"
#include "tmesh/tmesh_maps.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { STEPS = 12 }; /* of a patch that is looked at, along a side */

/** Makes maps of a layout; its curves are their own guides. */
static qm_status make_maps(qm_ground *g, const qm_layout *layout, bool *is_rough, qm_tmesh_maps **out)
{
    size_t count = 0, curves = layout->curve_count;
    for (size_t c = 0; c < curves; c++)
        count += layout->curves[c].point_count;
    qm_tmesh_guides guides = {.count = curves};
    guides.first = malloc((curves + 1) * sizeof *guides.first);
    guides.points = malloc(count * sizeof *guides.points);
    assert_true(guides.first && guides.points);
    count = 0;
    for (size_t c = 0; c < curves; c++) {
        guides.first[c] = count;
        for (size_t i = 0; i < layout->curves[c].point_count; i++)
            guides.points[count++] = qm_vec_load(layout->curves[c].points + 3 * i);
    }
    guides.first[curves] = count;
    qm_status status = qm_tmesh_maps_make(&g->ctx, &g->source, layout, &guides, is_rough, out);
    free(guides.first);
    free(guides.points);
    return status;
}

/** The point of a patch; it must lie on the surface. */
static qm_vec look_up(const qm_ground *g, const qm_tmesh_maps *maps, size_t patch, double u, double v,
                      uint32_t *triangle)
{
    qm_vec at;
    double p[3];
    qm_ref_surface_point on;
    QM_CHECK(qm_tmesh_maps_at(maps, patch, u, v, triangle, &at), "patch %zu has no point at %g %g", patch, u,
             v);
    qm_vec_store(p, at);
    qm_ref_surface_project(&g->source, p, &on);
    QM_CHECK(on.distance <= 1e-12 * g->source.diagonal, "patch %zu at %g %g: %g off", patch, u, v,
             on.distance);
    return at;
}

/** Checks that the patches cover the surface once: the areas of their cells add up to its area, and each is about as great as others of its patch. */
static void check_cover(const char *name, const qm_ground *g, const qm_layout *layout, qm_tmesh_maps *maps,
                        double most_ratio)
{
    double sum = 0.0, wanted = 0.0;
    for (size_t f = 0; f < g->mesh.face_count; f++) {
        const uint32_t *c = g->mesh.faces + 4 * f;
        qm_vec at[4];
        for (int k = 0; k < 4; k++)
            at[k] = qm_vec_load(g->mesh.positions + 3 * (size_t)c[c[k] == QM_NO_INDEX ? 2 : k]);
        wanted += 0.5 * qm_vec_norm(qm_vec_cross(qm_vec_sub(at[1], at[0]), qm_vec_sub(at[2], at[0])));
        wanted += 0.5 * qm_vec_norm(qm_vec_cross(qm_vec_sub(at[2], at[0]), qm_vec_sub(at[3], at[0])));
    }
    for (size_t p = 0; p < layout->patch_count; p++) {
        qm_vec at[STEPS + 1][STEPS + 1];
        uint32_t triangle = 0;
        double least = INFINITY, most = 0.0;
        for (int j = 0; j <= STEPS; j++)
            for (int i = 0; i <= STEPS; i++)
                at[j][i] = look_up(g, maps, p, (double)i / STEPS, (double)j / STEPS, &triangle);
        for (int j = 0; j < STEPS; j++)
            for (int i = 0; i < STEPS; i++) {
                double area = 0.5 * qm_vec_norm(qm_vec_cross(qm_vec_sub(at[j + 1][i + 1], at[j][i]),
                                                             qm_vec_sub(at[j + 1][i], at[j][i + 1])));
                least = fmin(least, area);
                most = fmax(most, area);
                sum += area;
            }
        QM_CHECK(most <= most_ratio * least, "%s, patch %zu: cells of %g to %g", name, p, least, most);
    }
    QM_CHECK(fabs(sum - wanted) <= 0.02 * wanted, "%s: patches of %g on a surface of %g", name, sum, wanted);
}

static void check_shape(const char *name, qm_mesh surface, qm_layout layout, double most_ratio)
{
    qm_ground g;
    qm_tmesh_maps *maps;
    qm_ground_make(&g, surface);
    bool *is_rough = calloc(layout.curve_count, sizeof *is_rough);
    assert_non_null(is_rough);
    assert_int_equal(make_maps(&g, &layout, is_rough, &maps), QM_OK);
    QM_CHECK(maps != NULL, "%s: no maps", name);
    for (size_t c = 0; c < layout.curve_count; c++)
        QM_CHECK(!is_rough[c], "%s: curve %zu went astray", name, c);
    check_cover(name, &g, &layout, maps, most_ratio);
    qm_tmesh_maps_destroy(&g.ctx, maps);
    free(is_rough);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

static void patches_cover_the_surface_once(void **state)
{
    (void)state;
    const qm_cells cube = {.count = {1, 1, 1},
                           .plane = {{0, 2}, {0, 2}, {0, 1}},
                           .is_filled = {{{true}}},
                           .pieces = {16, 16, 8}};
    check_shape("torus", qm_shape_torus(64, 32, 1.0, 0.35),
                qm_layout_of_grid(6, 4, true, true, 16, qm_torus_at, NULL), 3.0);
    check_shape("saddle", qm_shape_saddle(32), qm_layout_of_grid(3, 2, false, false, 16, qm_saddle_at, NULL),
                3.0);
    check_shape("box", qm_cells_surface(&cube), qm_cells_layout(&cube, 16), 1.1);
}

/** A square of triangles whose inner vertices lie anywhere. */
static qm_mesh ragged_square(int n, uint64_t stream)
{
    qm_mesh square = qm_shape_plane(n, 0.0), m = qm_shape_triangulated(&square);
    qm_random random = qm_random_make(1, stream);
    for (size_t v = 0; v < m.vertex_count; v++) {
        double *p = m.positions + 3 * v;
        for (int k = 0; k < 2; k++)
            if (p[0] > 1e-9 && p[0] < 1 - 1e-9 && p[1] > 1e-9 && p[1] < 1 - 1e-9)
                p[k] += qm_random_range(&random, -0.3 / n, 0.3 / n);
    }
    qm_shape_free(&square);
    return m;
}

/** What is flat is mapped as it is, where the curves are straight on it. */
static void flat_patches_are_mapped_as_they_are(void **state)
{
    (void)state;
    for (int is_ragged = 0; is_ragged < 2; is_ragged++) {
        qm_ground g;
        qm_tmesh_maps *maps;
        qm_ground_make(&g, is_ragged ? ragged_square(30, 7) : qm_shape_plane(30, 0.0));
        qm_layout layout = qm_layout_of_grid(3, 2, false, false, 16, qm_square_at, NULL);
        bool is_rough[32] = {false};
        assert_true(layout.curve_count <= 32);
        assert_int_equal(make_maps(&g, &layout, is_rough, &maps), QM_OK);
        assert_non_null(maps);
        const double most = is_ragged ? 0.02 : 1e-3; /* of a patch: paths are not quite straight */
        for (size_t p = 0; p < layout.patch_count; p++) {
            uint32_t triangle = 0;
            qm_vec corner = look_up(&g, maps, p, 0, 0, &triangle),
                   along = look_up(&g, maps, p, 1, 0, &triangle), up = look_up(&g, maps, p, 0, 1, &triangle);
            for (int j = 0; j <= STEPS; j++)
                for (int i = 0; i <= STEPS; i++) {
                    double u = (double)i / STEPS, v = (double)j / STEPS;
                    qm_vec at = look_up(&g, maps, p, u, v, &triangle),
                           wanted = qm_vec_axpy(qm_vec_axpy(corner, u, qm_vec_sub(along, corner)), v,
                                                qm_vec_sub(up, corner));
                    QM_CHECK(qm_vec_distance(at, wanted) <= most, "patch %zu at %g %g: %g off", p, u, v,
                             qm_vec_distance(at, wanted));
                }
        }
        qm_tmesh_maps_destroy(&g.ctx, maps);
        qm_layout_free(&layout);
        qm_ground_free(&g);
    }
}

/** A point of a curve on the opposite wall of the tube, as where a stroke goes through: the path stays on the surface. */
static void curves_that_jump_are_laid_on_the_surface(void **state)
{
    (void)state;
    qm_ground g;
    qm_tmesh_maps *maps;
    qm_ground_make(&g, qm_shape_torus(64, 32, 1.0, 0.35));
    qm_layout layout = qm_layout_of_grid(6, 4, true, true, 16, qm_torus_at, NULL);
    bool is_rough[64] = {false};
    assert_true(layout.curve_count <= 64);
    const size_t jumping = 3;
    qm_curve *curve = &layout.curves[jumping];
    double length = qm_layout_curve_length(curve);
    qm_torus_at(NULL, 3.5 / 6, 0.5, curve->points + 3 * (curve->point_count / 2));
    is_rough[jumping] = true;
    assert_int_equal(make_maps(&g, &layout, is_rough, &maps), QM_OK);
    assert_non_null(maps);
    check_cover("torus", &g, &layout, maps, 4.0);
    for (size_t c = 0; c < layout.curve_count; c++) {
        size_t count;
        const double *points = qm_tmesh_maps_path(maps, c, &count);
        QM_CHECK((count > 0) == (c == jumping), "curve %zu has a path of %zu points", c, count);
        double path = 0.0;
        for (size_t i = 0; i < count; i++) {
            qm_ref_surface_point on;
            qm_ref_surface_project(&g.source, points + 3 * i, &on);
            QM_CHECK(on.distance <= 1e-12, "point %zu is %g off", i, on.distance);
            if (i > 0) path += qm_vec_distance(qm_vec_load(points + 3 * i), qm_vec_load(points + 3 * i - 3));
        }
        QM_CHECK(count == 0 || path <= 1.2 * length, "a path of %g instead of %g", path, length);
    }
    qm_tmesh_maps_destroy(&g.ctx, maps);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

/** What does not bound the whole surface has no maps, which is no error. */
static void what_does_not_cover_the_surface_has_no_maps(void **state)
{
    (void)state;
    for (int way = 0; way < 3; way++) {
        qm_ground g;
        qm_tmesh_maps *maps;
        bool is_rough[64] = {false};
        /* a patch left out, with its curves; half of a closed surface; patches of a plane on a torus */
        qm_ground_make(&g, qm_shape_torus(64, 32, 1.0, 0.35));
        qm_layout layout = way < 2 ? qm_layout_of_grid(6, 4, true, true, 16, qm_torus_at, NULL)
                                   : qm_layout_of_grid(3, 2, false, false, 16, qm_square_at, NULL);
        if (way == 0) layout.patch_count--;
        if (way == 1) layout.patch_count /= 2;
        assert_int_equal(make_maps(&g, &layout, is_rough, &maps), QM_OK);
        QM_CHECK(maps == NULL, "way %d has maps", way);
        layout.patch_count = way == 0   ? layout.patch_count + 1
                             : way == 1 ? 2 * layout.patch_count
                                        : layout.patch_count;
        qm_layout_free(&layout);
        qm_ground_free(&g);
    }
}

/** A torus whose rows are turned against each other, so that nodes lie far from where quads need them. */
static void askew_at(const void *user, double u, double v, double out[3])
{
    qm_torus_at(user, u + 0.04 * sin(6.283185307179586 * (2.0 * v + u)),
                v + 0.06 * sin(6.283185307179586 * 3.0 * u), out);
}

/** The mesh made anew has its vertices on the surface and all of it, no fold, and leaves the reconstruction as it is. */
static void a_mesh_made_anew_is_whole(void **state)
{
    (void)state;
    qm_ground g;
    qm_reconstruction *r;
    qm_reconstruction_record record;
    qm_reconstruction_options options = qm_reconstruction_options_default();
    qm_quads_options quads = qm_quads_options_default();
    qm_mesh before, after, anew;
    qm_ground_make(&g, qm_shape_torus(96, 48, 1.0, 0.35));
    qm_layout layout = qm_layout_of_grid(6, 4, true, true, 24, askew_at, NULL);
    assert_int_equal(qm_reconstruction_create(&g.ctx, &g.source, &layout, &options, &r), QM_OK);
    do
        assert_int_equal(qm_reconstruction_step(&g.ctx, r, 2500, &record), QM_OK);
    while (record.chords_changed > 0);
    assert_int_equal(qm_reconstruction_mesh(&g.ctx, r, &before), QM_OK);
    assert_int_equal(qm_reconstruction_mesh_anew(&g.ctx, r, &quads, &anew), QM_OK);
    assert_int_equal(qm_reconstruction_mesh(&g.ctx, r, &after), QM_OK);
    assert_int_equal(before.vertex_count, after.vertex_count);
    assert_memory_equal(before.positions, after.positions,
                        3 * before.vertex_count * sizeof *before.positions);
    assert_int_equal(anew.face_count, before.face_count);
    assert_memory_equal(anew.faces, before.faces, 4 * anew.face_count * sizeof *anew.faces);
    for (size_t v = 0; v < anew.vertex_count; v++) {
        qm_ref_surface_point on;
        qm_ref_surface_project(&g.source, anew.positions + 3 * v, &on);
        QM_CHECK(on.distance <= 1e-9, "vertex %zu is %g off", v, on.distance);
    }
    double sine = qm_topology_least_sine(&anew), old = qm_topology_least_sine(&before);
    QM_CHECK(sine >= 0.5 && sine > old, "the least sine of a corner is %g, and was %g", sine, old);
    qm_mesh_reset(&g.ctx, &before);
    qm_mesh_reset(&g.ctx, &after);
    qm_mesh_reset(&g.ctx, &anew);
    qm_reconstruction_destroy(&g.ctx, r);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

/** Memory that runs out while a mesh is made anew is a status, frees all that was allocated, and leaves the reconstruction. */
static void running_out_of_memory_leaves_the_reconstruction(void **state)
{
    (void)state;
    enum { STRIDE = 97 }; /* of the calls that fail */
    qm_ground g;
    qm_ground_make(&g, qm_shape_torus(48, 24, 1.0, 0.35));
    qm_layout layout = qm_layout_of_grid(6, 4, true, true, 16, qm_torus_at, NULL);
    qm_failing_allocator memory = {.fail_at = SIZE_MAX};
    qm_context ctx = {.allocator = qm_failing_allocator_hook(&memory)};
    qm_reconstruction_options options = qm_reconstruction_options_default();
    qm_quads_options quads = qm_quads_options_default();
    qm_reconstruction_record record;
    qm_reconstruction *r;
    assert_int_equal(qm_reconstruction_create(&ctx, &g.source, &layout, &options, &r), QM_OK);
    do
        assert_int_equal(qm_reconstruction_step(&ctx, r, 2000, &record), QM_OK);
    while (record.chords_changed > 0);
    const size_t blocks = memory.live_blocks;
    qm_mesh first;
    assert_int_equal(qm_reconstruction_mesh(&ctx, r, &first), QM_OK);
    size_t failed = 0;
    qm_status status = QM_E_NO_MEMORY;
    for (size_t k = 0; status == QM_E_NO_MEMORY; k += STRIDE) {
        qm_mesh anew, now;
        memory.fail_at = memory.calls + k;
        status = qm_reconstruction_mesh_anew(&ctx, r, &quads, &anew);
        memory.fail_at = SIZE_MAX;
        QM_CHECK(status == QM_OK || status == QM_E_NO_MEMORY, "call %zu: %s", k, ctx.message);
        failed += status != QM_OK;
        qm_mesh_reset(&ctx, &anew);
        assert_int_equal(qm_reconstruction_mesh(&ctx, r, &now), QM_OK);
        assert_memory_equal(first.positions, now.positions, 3 * first.vertex_count * sizeof *first.positions);
        qm_mesh_reset(&ctx, &now);
    }
    QM_CHECK(failed > 5, "only %zu calls failed", failed);
    qm_mesh_reset(&ctx, &first);
    QM_CHECK(memory.live_blocks == blocks && !memory.mismatched, "%zu blocks instead of %zu",
             memory.live_blocks, blocks);
    qm_reconstruction_destroy(&ctx, r);
    assert_int_equal(memory.live_blocks, 0);
    qm_layout_free(&layout);
    qm_ground_free(&g);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(patches_cover_the_surface_once),
        cmocka_unit_test(flat_patches_are_mapped_as_they_are),
        cmocka_unit_test(curves_that_jump_are_laid_on_the_surface),
        cmocka_unit_test(what_does_not_cover_the_surface_has_no_maps),
        cmocka_unit_test(a_mesh_made_anew_is_whole),
        cmocka_unit_test(running_out_of_memory_leaves_the_reconstruction),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
