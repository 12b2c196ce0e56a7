/* The shape of quads: known values, bad quads, triangles. */
#include "check.h"

#include "qm/quality.h"
#include "shapes.h"

#include <math.h>
#include <string.h>

static qm_quality quality_of(qm_mesh mesh)
{
    qm_quality quality;
    qm_quality_measure(&mesh, &quality);
    qm_shape_free(&mesh);
    return quality;
}

static qm_quality quality_of_face(int count, const double corners[][3])
{
    return quality_of(qm_shape_face(count, corners));
}

static void near_to(double found, double expected)
{
    QM_CHECK(fabs(found - expected) < 1e-12 * fmax(1.0, fabs(expected)), "%.17g for %.17g", found, expected);
}

static void known_quads_have_known_shapes(void **state)
{
    (void)state;
    const double square[4][3] = {{0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {0, 2, 0}};
    qm_quality found = quality_of_face(4, square);
    assert_int_equal(found.quads, 1);
    assert_int_equal(found.folded, 0);
    near_to(found.least_jacobian, 1.0);
    near_to(found.max_angle, 0.0);
    near_to(found.max_edge_ratio, 1.0);
    near_to(found.max_warp, 0.0);

    const double leaning[4][3] = {{0, 0, 0}, {4, 0, 0}, {5, 1, 0}, {1, 1, 0}};
    found = quality_of_face(4, leaning);
    near_to(found.least_jacobian, sqrt(0.5));
    near_to(found.mean_angle, 45.0);
    near_to(found.max_angle, 45.0);
    near_to(found.max_edge_ratio, 4.0 / sqrt(2.0));

    /* The diagonals pass by one another at height 1 and are sqrt(8) long. */
    const double bent[4][3] = {{0, 0, 0}, {2, 0, 1}, {2, 2, 0}, {0, 2, 1}};
    found = quality_of_face(4, bent);
    near_to(found.mean_warp, 1.0 / sqrt(8.0));
    near_to(found.mean_edge_ratio, 1.0);
    assert_int_equal(found.folded, 0);
}

static void bad_quads_are_counted(void **state)
{
    (void)state;
    const double dart[4][3] = {{0, 0, 0}, {2, 0, 0}, {0.5, 0.5, 0}, {0, 2, 0}};
    qm_quality found = quality_of_face(4, dart);
    assert_int_equal(found.folded, 1);
    assert_true(found.least_jacobian < 0.0 && found.least_jacobian >= -1.0);

    const double crossed[4][3] = {{0, 0, 0}, {1, 1, 0}, {1, 0, 0}, {0, 1.5, 0}};
    assert_int_equal(quality_of_face(4, crossed).folded, 1);

    const double shut[4][3] = {{0, 0, 0}, {1, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    found = quality_of_face(4, shut);
    assert_int_equal(found.folded, 1);
    near_to(found.least_jacobian, -1.0);
    near_to(found.max_edge_ratio, QM_QUALITY_MAX_RATIO);

    const double gone[4][3] = {{3, 3, 3}, {3, 3, 3}, {3, 3, 3}, {3, 3, 3}};
    found = quality_of_face(4, gone);
    assert_int_equal(found.folded, 1);
    assert_true(isfinite(found.mean_warp) && isfinite(found.mean_angle));
}

static void triangles_do_not_count(void **state)
{
    (void)state;
    const double corners[3][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    qm_quality found = quality_of_face(3, corners), none = {0};
    assert_memory_equal(&found, &none, sizeof none);
}

static void means_are_over_all_quads(void **state)
{
    (void)state;
    const double square[4][3] = {{0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {0, 2, 0}};
    const double flat[4][3] = {{0, 0, 5}, {3, 0, 5}, {3, 1, 5}, {0, 1, 5}};
    qm_mesh one = qm_shape_face(4, square), other = qm_shape_face(4, flat);
    qm_quality found = quality_of(qm_shape_joined(&one, &other));
    assert_int_equal(found.quads, 2);
    near_to(found.mean_edge_ratio, 2.0);
    near_to(found.max_edge_ratio, 3.0);
    qm_shape_free(&one);
    qm_shape_free(&other);
}

/** A grid of 5 by 3 unit squares, the middle one upside down: its corners are changed over from left to
 * right. */
static void quads_upside_down_are_counted(void **state)
{
    (void)state;
    qm_mesh mesh = qm_shape_make(24, 15);
    for (uint32_t v = 0; v < 24; v++) {
        mesh.positions[3 * v] = v % 6;
        mesh.positions[3 * v + 1] = v / 6;
    }
    for (uint32_t face = 0; face < 15; face++) {
        uint32_t corner = face / 5 * 6 + face % 5;
        const uint32_t index[4] = {corner, corner + 1, corner + 7, corner + 6};
        memcpy(mesh.faces + 4 * face, index, sizeof index);
    }
    qm_mesh_grid grid = {.rows = 3, .columns = 5};
    mesh.grids = &grid;
    mesh.grid_count = 1;
    qm_quality found;
    qm_quality_measure(&mesh, &found);
    assert_int_equal(found.turned, 0);
    for (uint32_t row = 1; row < 3; row++) {
        mesh.positions[3 * (6 * row + 2)] = 2.6;
        mesh.positions[3 * (6 * row + 3)] = 2.4;
    }
    qm_quality_measure(&mesh, &found);
    assert_int_equal(found.turned, 1);
    mesh.grids = NULL;
    mesh.grid_count = 0;
    qm_shape_free(&mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(known_quads_have_known_shapes), cmocka_unit_test(bad_quads_are_counted),
        cmocka_unit_test(triangles_do_not_count),        cmocka_unit_test(means_are_over_all_quads),
        cmocka_unit_test(quads_upside_down_are_counted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
