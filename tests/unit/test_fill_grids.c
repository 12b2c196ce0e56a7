/* qm_reconstruction_fill_grids: the mesh of a layout with grids, at once; what comes out is measured by other code. */
#include "check.h"

#include <math.h>
#include <string.h>

#include "core/vec.h"
#include "failing_allocator.h"
#include "ground.h"
#include "qm/quad_layout.h"
#include "qm/reconstruct.h"
#include "quad_topology.h"

/** A layout of a surface, with its grids. */
typedef struct drawn {
    qm_ground ground;
    qm_layout layout;
    double *grids;
} drawn;

static drawn draw(qm_mesh surface, size_t quads, size_t patches)
{
    drawn d;
    qm_layout_issues issues;
    const qm_quad_layout_options options = {.effort = 100, .patches = patches};
    const qm_quads_options how = {.quads = quads, .crease_angle = 40, .thread_count = 1};
    qm_ground_make(&d.ground, surface);
    assert_int_equal(qm_quad_layout_make_of_surface(&d.ground.ctx, &d.ground.source, &how, NULL, &options,
                                                    &d.layout, &issues, NULL, &d.grids),
                     QM_OK);
    qm_layout_issues_reset(&d.ground.ctx, &issues);
    return d;
}

static void free_drawn(drawn *d)
{
    qm_quad_layout_free_grids(&d->ground.ctx, &d->layout, d->grids);
    qm_layout_reset(&d->ground.ctx, &d->layout);
    qm_ground_free(&d->ground);
}

static qm_status fill(drawn *d, qm_context *ctx, size_t limit, qm_mesh *out)
{
    qm_reconstruction_options how = qm_reconstruction_options_default();
    how.grids = d->grids;
    qm_quads_options quads = qm_quads_options_default();
    quads.quads = limit;
    return qm_reconstruction_fill_grids(ctx, &d->ground.source, &d->layout, &how, &quads, out);
}

/** Six times the volume that a mesh encloses; below 0 inside out. */
static double volume_of(const qm_mesh *m)
{
    double sum = 0.0;
    for (size_t f = 0; f < m->face_count; f++) {
        const uint32_t *c = m->faces + 4 * f;
        qm_vec a = qm_vec_load(m->positions + 3 * (size_t)c[0]);
        for (int k = 1; k + 1 < (c[3] == QM_NO_INDEX ? 3 : 4); k++)
            sum += qm_vec_dot(a, qm_vec_cross(qm_vec_load(m->positions + 3 * (size_t)c[k]),
                                              qm_vec_load(m->positions + 3 * (size_t)c[k + 1])));
    }
    return sum;
}

static qm_mesh sphere(void)
{
    qm_mesh m = qm_shape_cube_grid(24);
    for (size_t v = 0; v < m.vertex_count; v++) {
        double *p = m.positions + 3 * v, length = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
        for (int k = 0; k < 3; k++)
            p[k] /= length;
    }
    return m;
}

static qm_mesh cube(void)
{
    return qm_shape_cube_grid(6);
}

static qm_mesh torus(void)
{
    return qm_shape_torus(64, 32, 1.0, 0.4);
}

/** Two boxes whose walls are a hundredth of their side apart, and as thick. */
static qm_mesh plates(void)
{
    qm_mesh one = qm_shape_cube_grid(12);
    for (size_t v = 0; v < one.vertex_count; v++)
        one.positions[3 * v + 2] *= 0.01;
    qm_mesh other = qm_shape_copy(&one);
    for (size_t v = 0; v < other.vertex_count; v++)
        other.positions[3 * v + 2] += 0.04;
    qm_mesh both = qm_shape_joined(&one, &other);
    qm_shape_free(&one);
    qm_shape_free(&other);
    return both;
}

/** Fills a layout of so many quads; returns the least sine of a corner. */
static double check_filled(const char *name, qm_mesh surface, size_t quads, size_t patches, size_t limit)
{
    drawn d = draw(surface, quads, patches);
    double wanted = volume_of(&d.ground.mesh);
    qm_mesh mesh;
    QM_CHECK(fill(&d, &d.ground.ctx, limit, &mesh) == QM_OK, "%s: %s", name, d.ground.ctx.message);
    QM_CHECK(mesh.face_count <= limit && 10 * mesh.face_count >= 7 * limit, "%s: %zu quads of %zu", name,
             mesh.face_count, limit);
    QM_CHECK(mesh.grid_count == d.layout.patch_count, "%s: %zu grids", name, mesh.grid_count);
    qm_topology from = qm_topology_find(&d.ground.mesh), to = qm_topology_find(&mesh);
    QM_CHECK(to.is_manifold && to.is_oriented && to.is_all_quads && to.euler == from.euler &&
                 to.components == from.components && to.boundary_edges == 0,
             "%s: Euler number %td, %zu components", name, to.euler, to.components);
    double volume = volume_of(&mesh), sine = qm_topology_least_sine(&mesh);
    QM_CHECK(fabs(volume - wanted) <= 0.02 * fabs(wanted), "%s: volume %g, not %g", name, volume, wanted);
    for (size_t v = 0; v < mesh.vertex_count; v++) {
        qm_ref_surface_point on;
        qm_ref_surface_project(&d.ground.source, mesh.positions + 3 * v, &on);
        QM_CHECK(on.distance <= 1e-9 * d.ground.source.diagonal, "%s: vertex %zu is %g off", name, v,
                 on.distance);
    }
    qm_mesh_reset(&d.ground.ctx, &mesh);
    free_drawn(&d);
    return sine;
}

static void check_not_folded(const char *name, qm_mesh surface, size_t patches, size_t limit, double least)
{
    double sine = check_filled(name, surface, 400, patches, limit);
    QM_CHECK(sine >= least, "%s: least sine %.3f", name, sine);
}

static void shapes_are_filled(void **state)
{
    (void)state;
    check_not_folded("sphere", sphere(), 40, 1500, 0.0);
    check_not_folded("cube", cube(), 24, 900, 0.6);
    check_not_folded("torus", torus(), 60, 2000, 0.0);
    check_not_folded("plates", plates(), 60, 1500, 0.0);
    qm_mesh out = plates();
    check_not_folded("plates inside out", qm_shape_reversed(&out), 60, 1500, 0.0);
    qm_shape_free(&out);
}

/** Filled at once, a quad beside an irregular vertex may be folded, for settling to open; most fillings have none. */
static void spheres_are_filled_either_way(void **state)
{
    (void)state;
    double sum = 0.0;
    int count = 0, folded = 0;
    for (size_t quads = 200; quads <= 800; quads += 200)
        for (size_t patches = 20; patches <= 100; patches += 40)
            for (int is_reversed = 0; is_reversed < 2; is_reversed++) {
                qm_mesh out = sphere(), other = is_reversed ? qm_shape_reversed(&out) : qm_shape_copy(&out);
                double sine =
                    check_filled(is_reversed ? "sphere inside out" : "sphere", other, quads, patches, 1500);
                qm_shape_free(&out);
                sum += sine, count++, folded += sine < 0.0;
            }
    QM_CHECK(10 * folded <= count && sum >= 0.15 * count, "%d of %d are folded, mean of the least sines %.3f",
             folded, count, sum / count);
}

static void bad_input_is_a_status(void **state)
{
    (void)state;
    drawn d = draw(cube(), 200, 24);
    qm_mesh mesh;
    assert_int_equal(fill(&d, &d.ground.ctx, d.layout.patch_count - 1, &mesh), QM_E_ARGUMENT);
    assert_int_equal(fill(&d, &d.ground.ctx, d.layout.patch_count, &mesh), QM_OK);
    assert_int_equal(mesh.face_count, d.layout.patch_count);
    qm_mesh_reset(&d.ground.ctx, &mesh);
    d.ground.source.is_cloud = true;
    assert_int_equal(fill(&d, &d.ground.ctx, 500, &mesh), QM_E_ARGUMENT);
    d.ground.source.is_cloud = false;
    atomic_bool is_canceled = true;
    d.ground.ctx.cancel = &is_canceled;
    assert_int_equal(fill(&d, &d.ground.ctx, 500, &mesh), QM_E_CANCELED);
    d.ground.ctx.cancel = NULL;
    free_drawn(&d);
}

static void running_out_of_memory_is_a_status(void **state)
{
    (void)state;
    drawn d = draw(cube(), 100, 6);
    qm_status status = QM_E_NO_MEMORY;
    for (size_t fail_at = 0; status != QM_OK; fail_at++) {
        qm_failing_allocator memory = {.fail_at = fail_at};
        qm_context ctx = {.allocator = qm_failing_allocator_hook(&memory)};
        qm_mesh mesh = {0};
        status = fill(&d, &ctx, 100, &mesh);
        QM_CHECK(status == QM_OK || status == QM_E_NO_MEMORY, "call %zu: %s", fail_at, ctx.message);
        qm_mesh_reset(&ctx, &mesh);
        QM_CHECK(memory.live_blocks == 0 && !memory.mismatched, "call %zu leaves %zu blocks", fail_at,
                 memory.live_blocks);
    }
    free_drawn(&d);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(shapes_are_filled),
        cmocka_unit_test(spheres_are_filled_either_way),
        cmocka_unit_test(bad_input_is_a_status),
        cmocka_unit_test(running_out_of_memory_is_a_status),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
