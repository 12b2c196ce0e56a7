/* qm_mesh_validate, boxes and diagonals. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "bvh/kernel.h"
#include "check.h"
#include "qm/mesh.h"
#include "random.h"

static qm_status validate(double *positions, size_t vertex_count, uint32_t *faces, size_t face_count,
                          const char *words)
{
    qm_context ctx = qm_context_make();
    qm_mesh mesh = {
        .positions = positions, .vertex_count = vertex_count, .faces = faces, .face_count = face_count};
    qm_status status = qm_mesh_validate(&ctx, &mesh);
    if (words) QM_CHECK(strstr(ctx.message, words), "\"%s\" lacks \"%s\"", ctx.message, words);
    return status;
}

static void faults_are_named(void **state)
{
    (void)state;
    double positions[12] = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};
    uint32_t quad[8] = {0, 1, 2, 3, 0, 1, 2, QM_NO_INDEX};
    assert_int_equal(validate(positions, 4, quad, 2, NULL), QM_OK);
    assert_int_equal(validate(positions, 4, NULL, 0, NULL), QM_OK);
    assert_int_equal(validate(NULL, 0, NULL, 0, "no vertex"), QM_E_EMPTY);
    assert_int_equal(validate(positions, 3, quad, 1, "face 0 refers to vertex 3 of 3"), QM_E_INDEX);
    assert_int_equal(validate(NULL, 0, quad, 1, "face 0"), QM_E_INDEX);
    quad[6] = QM_NO_INDEX; /* only the fourth corner may be absent */
    assert_int_equal(validate(positions, 4, quad, 2, "face 1"), QM_E_INDEX);
    positions[7] = NAN;
    assert_int_equal(validate(positions, 4, NULL, 0, "vertex 2"), QM_E_NOT_FINITE);
    positions[7] = -INFINITY;
    assert_int_equal(validate(positions, 4, NULL, 0, "vertex 2"), QM_E_NOT_FINITE);
}

static void span_must_not_overflow(void **state)
{
    (void)state;
    double axis[6] = {-DBL_MAX, 0, 0, DBL_MAX, 0, 0};
    assert_int_equal(validate(axis, 2, NULL, 0, "far apart"), QM_E_NOT_FINITE);
    double diagonal[6] = {0, 0, 0, DBL_MAX, DBL_MAX, 0};
    assert_int_equal(validate(diagonal, 2, NULL, 0, "far apart"), QM_E_NOT_FINITE);
    double large[6] = {0, 0, 0, DBL_MAX, 0, 0};
    assert_int_equal(validate(large, 2, NULL, 0, NULL), QM_OK);
}

static void box_holds_what_faces_use(void **state)
{
    (void)state;
    double positions[15] = {0, 0, 0, 1, 0, 0, 1, 2, 0, 0, 2, 3, 99, 99, 99};
    uint32_t faces[8] = {0, 1, 2, QM_NO_INDEX, 0, 1, 2, 3};
    qm_mesh mesh = {.positions = positions, .vertex_count = 5, .faces = faces, .face_count = 1};
    static const qm_box triangle = {{0, 0, 0}, {1, 2, 0}}, both = {{0, 0, 0}, {1, 2, 3}},
                        all = {{0, 0, 0}, {99, 99, 99}};
    qm_box box = qm_mesh_bounding_box(&mesh);
    assert_memory_equal(&box, &triangle, sizeof box);
    mesh.face_count = 2;
    box = qm_mesh_bounding_box(&mesh);
    assert_memory_equal(&box, &both, sizeof box);
    mesh.face_count = 0;
    box = qm_mesh_bounding_box(&mesh);
    assert_memory_equal(&box, &all, sizeof box);
}

enum { VERTICES = 12, FACES = 9, MESHES = 3000 };

/** Few places, so that many vertices lie on the same side of the box; and few of them are used. */
static void box_is_that_of_each_corner(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 0);
    for (int round = 0; round < MESHES; ++round) {
        double positions[3 * VERTICES];
        uint32_t faces[4 * FACES];
        for (int i = 0; i < 3 * VERTICES; ++i)
            positions[i] = (double)qm_random_below(&random, 7) - 3.5;
        size_t face_count = 1 + qm_random_below(&random, FACES),
               used = 3 + qm_random_below(&random, VERTICES - 2);
        for (size_t i = 0; i < 4 * face_count; ++i)
            faces[i] = i % 4 == 3 && qm_random_below(&random, 2) ? QM_NO_INDEX
                                                                 : (uint32_t)qm_random_below(&random, used);
        qm_box slow = {{9, 9, 9}, {-9, -9, -9}};
        for (size_t i = 0; i < 4 * face_count; ++i)
            for (int axis = 0; axis < 3 && faces[i] != QM_NO_INDEX; ++axis) {
                slow.min[axis] = fmin(slow.min[axis], positions[3 * faces[i] + (uint32_t)axis]);
                slow.max[axis] = fmax(slow.max[axis], positions[3 * faces[i] + (uint32_t)axis]);
            }
        qm_mesh mesh = {
            .positions = positions, .vertex_count = VERTICES, .faces = faces, .face_count = face_count};
        qm_box box = qm_mesh_bounding_box(&mesh);
        QM_CHECK(memcmp(&box, &slow, sizeof box) == 0, "mesh %d, seed %llu", round,
                 (unsigned long long)qm_check_seed());
    }
}

/** Each kernel finds the one corner that is out of range, and vertices on all sides of the box. */
static void kernels_find_what_a_walk_finds(void **state)
{
    (void)state;
    qm_random random = qm_random_make(qm_check_seed(), 1);
    for (int round = 0; round < MESHES; ++round) {
        double positions[3 * VERTICES];
        uint32_t faces[4 * FACES], limit = 1 + (uint32_t)qm_random_below(&random, VERTICES);
        size_t count = qm_random_below(&random, FACES + 1), bad = qm_random_below(&random, 4 * FACES);
        for (int i = 0; i < 3 * VERTICES; ++i)
            positions[i] = (double)qm_random_below(&random, 7) - 3.5;
        for (size_t i = 0; i < 4 * FACES; ++i)
            faces[i] = i % 4 == 3 && qm_random_below(&random, 2) ? QM_NO_INDEX
                                                                 : (uint32_t)qm_random_below(&random, limit);
        const uint32_t wrong[] = {limit, QM_NO_INDEX, QM_NO_INDEX - 1};
        uint32_t put = wrong[qm_random_below(&random, 3)];
        bool is_good = bad >= 4 * count || (put == QM_NO_INDEX && bad % 4 == 3);
        for (const qm_kernel *const *kernel = qm_kernel_list(); *kernel; ++kernel) {
            assert_true((*kernel)->faces_below(faces, count, limit));
            uint32_t kept = faces[bad];
            faces[bad] = put;
            assert_int_equal((*kernel)->faces_below(faces, count, limit), is_good);
            faces[bad] = kept;
            qm_box box;
            uint32_t side[QM_BOX_SIDES];
            (*kernel)->vertex_box(positions, limit, &box);
            (*kernel)->vertices_on_sides(positions, limit, &box, side);
            bool are_named = true;
            for (uint32_t k = 0; k < QM_BOX_SIDES; ++k) {
                assert_true(side[k] < limit);
                assert_true(positions[3 * side[k] + k % 3] == (k < 3 ? box.min[k] : box.max[k - 3]));
                bool is_named = false;
                for (size_t i = 0; i < 4 * count; ++i)
                    is_named |= faces[i] == side[k];
                are_named &= is_named;
            }
            assert_int_equal((*kernel)->faces_contain(faces, count, side), are_named);
        }
    }
}

static void diagonal_keeps_its_digits_at_every_scale(void **state)
{
    (void)state;
    static const int exponents[] = {0, 500, 1020, -500, -1020};
    for (size_t i = 0; i < sizeof exponents / sizeof *exponents; ++i) {
        double unit = ldexp(1, exponents[i]);
        qm_box box = {{-unit, 0, 0}, {unit, 3 * unit, 6 * unit}};
        assert_true(qm_mesh_box_diagonal(&box) == 7 * unit);
    }
    qm_box point = {{5, 5, 5}, {5, 5, 5}};
    assert_true(qm_mesh_box_diagonal(&point) == 0);
    qm_box smallest = {{0, 0, 0}, {DBL_TRUE_MIN, 0, 0}};
    assert_true(qm_mesh_box_diagonal(&smallest) == DBL_TRUE_MIN);
}

static void reset_leaves_nothing(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_mesh mesh = {.vertex_count = 2, .face_count = 1};
    mesh.positions = qm_context_alloc(&ctx, 6, sizeof(double));
    mesh.faces = qm_context_alloc(&ctx, 4, sizeof(uint32_t));
    mesh.face_origin = qm_context_alloc(&ctx, 1, sizeof(uint32_t));
    qm_mesh_reset(&ctx, &mesh);
    static const qm_mesh zero = {0};
    assert_memory_equal(&mesh, &zero, sizeof mesh);
    qm_mesh_reset(&ctx, &mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(faults_are_named),
        cmocka_unit_test(span_must_not_overflow),
        cmocka_unit_test(box_holds_what_faces_use),
        cmocka_unit_test(box_is_that_of_each_corner),
        cmocka_unit_test(kernels_find_what_a_walk_finds),
        cmocka_unit_test(diagonal_keeps_its_digits_at_every_scale),
        cmocka_unit_test(reset_leaves_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
