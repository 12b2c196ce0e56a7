/* Planes of symmetry: found where shapes have them, refused where not, with a distance that holds. */
#include "check.h"

#include "failing_allocator.h"
#include "ground.h"
#include "qm/project.h"
#include "qm/symmetry.h"
#include "random.h"

#include <math.h>
#include <string.h>

/** A surface that is its own mirror image across x only: bulges along y and z differ by side. */
static void lump_at(const void *user, double u, double v, double out[3])
{
    double a = 6.283185307179586 * u, b = 3.141592653589793 * (0.02 + 0.96 * v), dent = *(const double *)user;
    double x = sin(b) * cos(a), y = sin(b) * sin(a), z = cos(b);
    double radius = 1.0 + 0.3 * y + 0.25 * z * z + 0.2 * z + dent * (x > 0.0 ? x * x : 0.0);
    out[0] = 1.2 * radius * x;
    out[1] = radius * y;
    out[2] = 0.8 * radius * z;
}

/** Turns and shifts a mesh in place; what a direction becomes. */
static void turn(qm_mesh *mesh, double angle, double direction[3], double place[3])
{
    double c = cos(angle), s = sin(angle);
    for (size_t i = 0; i <= mesh->vertex_count; i++) {
        double *p = i < mesh->vertex_count ? mesh->positions + 3 * i : direction;
        const double q[3] = {c * p[0] - s * p[1], s * p[0] + c * p[1], p[2]};
        const double r[3] = {q[0], c * q[1] - s * q[2], s * q[1] + c * q[2]};
        for (size_t k = 0; k < 3; k++)
            p[k] = r[k] + (i < mesh->vertex_count ? 0.3 * (double)k : 0.0);
    }
    for (size_t k = 0; k < 3; k++)
        place[k] = 0.3 * (double)k;
}

/** The greatest distance of mirrored vertices from the mesh: no more than the distance to the mirror image. */
static double slow_distance(qm_ground *g, const qm_symmetry_plane *plane)
{
    double greatest = 0.0;
    for (size_t i = 0; i < g->mesh.vertex_count; i++) {
        double *p = g->mesh.positions + 3 * i, image[3], height = 0.0;
        qm_ref_surface_point on;
        for (int k = 0; k < 3; k++)
            height += (p[k] - plane->point[k]) * plane->normal[k];
        for (int k = 0; k < 3; k++)
            image[k] = p[k] - 2.0 * height * plane->normal[k];
        qm_ref_surface_project(&g->source, image, &on);
        greatest = fmax(greatest, on.distance);
    }
    return greatest;
}

static void the_plane_of_a_turned_shape_is_found(void **state)
{
    (void)state;
    for (int n = 0; n < 8; n++) {
        qm_ground g;
        double direction[3] = {1, 0, 0}, place[3], dent = 0.0;
        qm_mesh mesh = qm_shape_grid(48, 24, true, false, lump_at, &dent);
        turn(&mesh, 0.4 * n, direction, place);
        qm_ground_make(&g, mesh);
        qm_symmetry_plane plane[QM_SYMMETRY_PLANES];
        size_t count;
        assert_int_equal(qm_symmetry_find(&g.ctx, &g.source, 0.01, plane, &count), QM_OK);
        QM_CHECK(count == 1, "turn %d: %zu planes", n, count);
        double cosine = 0.0, height = 0.0;
        for (int k = 0; k < 3; k++) {
            cosine += direction[k] * plane[0].normal[k];
            height += (place[k] - plane[0].point[k]) * plane[0].normal[k];
        }
        QM_CHECK(fabs(cosine) > 1.0 - 1e-4 && fabs(height) < 0.01, "turn %d: cosine %g, height %g", n, cosine,
                 height);
        double slow = slow_distance(&g, &plane[0]);
        QM_CHECK(plane[0].lower <= plane[0].upper && slow <= plane[0].upper &&
                     plane[0].upper <= 0.01 * g.source.diagonal,
                 "turn %d: %g in [%g, %g]", n, slow, plane[0].lower, plane[0].upper);
        qm_ground_free(&g);
    }
}

static void what_is_not_symmetric_has_no_plane(void **state)
{
    (void)state;
    qm_ground g;
    double dent = 0.3;
    qm_symmetry_plane plane[QM_SYMMETRY_PLANES];
    size_t count;
    qm_ground_make(&g, qm_shape_grid(48, 24, true, false, lump_at, &dent));
    assert_int_equal(qm_symmetry_find(&g.ctx, &g.source, 0.01, plane, &count), QM_OK);
    assert_int_equal(count, 0);
    assert_int_equal(qm_symmetry_find(&g.ctx, &g.source, 0.2, plane, &count), QM_OK);
    assert_true(count > 0 && slow_distance(&g, &plane[0]) <= plane[0].upper);
    assert_int_equal(qm_symmetry_find(&g.ctx, &g.source, 0.0, plane, &count), QM_E_ARGUMENT);
    qm_ground_free(&g);
}

static void boxes_and_points_have_theirs(void **state)
{
    (void)state;
    qm_ground g;
    qm_symmetry_plane plane[QM_SYMMETRY_PLANES];
    size_t count;
    qm_ground_make(&g, qm_shape_box(3.0, 2.0, 1.0));
    assert_int_equal(qm_symmetry_find(&g.ctx, &g.source, 0.01, plane, &count), QM_OK);
    assert_int_equal(count, 3);
    for (size_t i = 0; i < count; i++)
        assert_true(fmax(fabs(plane[i].normal[0]), fmax(fabs(plane[i].normal[1]), fabs(plane[i].normal[2]))) >
                    0.9999);
    qm_ground_free(&g);
    double dent = 0.0;
    qm_mesh dense = qm_shape_grid(160, 80, true, false, lump_at, &dent);
    dense.face_count = 0;
    qm_ground_make(&g, dense);
    assert_int_equal(qm_symmetry_find(&g.ctx, &g.source, 0.01, plane, &count), QM_OK);
    assert_int_equal(count, 1);
    assert_true(fabs(plane[0].normal[0]) > 0.999);
    qm_ground_free(&g);
}

static void running_out_of_memory_is_told(void **state)
{
    (void)state;
    qm_ground g;
    qm_ground_make(&g, qm_shape_box(3.0, 2.0, 1.0));
    qm_status status = QM_E_NO_MEMORY;
    for (size_t fail_at = 0; status != QM_OK; fail_at += 1 + fail_at / 20) {
        qm_failing_allocator memory = {.fail_at = fail_at};
        qm_context ctx = {.allocator = qm_failing_allocator_hook(&memory)};
        qm_symmetry_plane plane[QM_SYMMETRY_PLANES];
        size_t count;
        status = qm_symmetry_find(&ctx, &g.source, 0.01, plane, &count);
        QM_CHECK(status == QM_OK || status == QM_E_NO_MEMORY, "call %zu: %s", fail_at, ctx.message);
        QM_CHECK(memory.live_blocks == 0 && !memory.mismatched, "call %zu", fail_at);
    }
    qm_ground_free(&g);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_plane_of_a_turned_shape_is_found),
        cmocka_unit_test(what_is_not_symmetric_has_no_plane),
        cmocka_unit_test(boxes_and_points_have_theirs),
        cmocka_unit_test(running_out_of_memory_is_told),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
