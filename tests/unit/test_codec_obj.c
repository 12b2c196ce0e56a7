/* OBJ files by hand: every form of a corner, every warning, every fault with its line. */
#include <string.h>

#include "check.h"
#include "decode.h"

#define SQUARE "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
#define NONE QM_NO_INDEX

static void check_faces(const char *text, const uint32_t (*faces)[4], size_t count)
{
    qm_decoded decoded = qm_decode_text(QM_FORMAT_OBJ, text);
    QM_CHECK(decoded.status == QM_OK, "%s: %s", text, decoded.report.detail);
    assert_int_equal(decoded.mesh.face_count, count);
    assert_memory_equal(decoded.mesh.faces, faces, count * sizeof *faces);
    qm_decoded_free(&decoded);
}

static void corners_come_in_every_form(void **state)
{
    (void)state;
    static const char *const quads[] = {
        SQUARE "f 1 2 3 4\n",
        SQUARE "f 1 2 3 4",
        SQUARE "f\t1  2\t 3 4 \t\n",
        SQUARE "f 1/5 2/6 3/7 4/8\n",
        SQUARE "f 1//5 2//6 3//7 4//8\n",
        SQUARE "f 1/1/1 2/2 3//3 4\n",
        SQUARE "f 1/-1/-1 2/ 3// 4\n",
        SQUARE "f -4 -3 -2 -1\n",
        SQUARE "f 1 -3 3 -1 # the square\n",
        SQUARE "f 1 2 \\\n3 4\n",
        SQUARE "f 1 2 3\\\r\n4\n",
        "f 1 2 3 4\n" SQUARE,
        "\xef\xbb\xbf" SQUARE "f 1 2 3 4\n",
        "v 0 0 0\rv 1 0 0\rv 1 1 0\rv 0 1 0\rf 1 2 3 4\r",
        "v 0 0 0\r\nv 1 0 0\r\nv 1 1 0\r\nv 0 1 0\r\nf 1 2 3 4\r\n",
        "v 0 0 0 1 .5 .5\nv 1 0 0 1 1 1\nv 1 1 0 1\nv 0 1 0\nf 1 2 3 4\n",
        "# \\\nv 0 0 0\n# C:\\\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n",
    };
    static const uint32_t quad[1][4] = {{0, 1, 2, 3}};
    for (size_t i = 0; i < sizeof quads / sizeof *quads; ++i)
        check_faces(quads[i], quad, 1);
    static const uint32_t mixed[2][4] = {{0, 1, 2, NONE}, {0, 2, 3, 1}};
    check_faces(SQUARE "f 1 2 3\nf 1 3 4 2\n", mixed, 2);
}

static void coordinates_are_kept_to_the_last_bit(void **state)
{
    (void)state;
    qm_decoded decoded = qm_decode_text(QM_FORMAT_OBJ, "v 0.1 -2.5e-3 30000000000000001\n");
    static const double expected[3] = {0.1, -2.5e-3, 30000000000000001.0};
    assert_int_equal(decoded.status, QM_OK);
    assert_memory_equal(decoded.mesh.positions, expected, sizeof expected);
    qm_decoded_free(&decoded);
}

static void polygons_become_fans_that_remember_their_face(void **state)
{
    (void)state;
    qm_decoded decoded = qm_decode_text(
        QM_FORMAT_OBJ, SQUARE "v -1 .5 0\nv -1 .2 0\nf 1 2 3\nf 1 2 3 4 5\nf 1 2 3 4\nf 1 2 3 4 5 6\n");
    assert_int_equal(decoded.status, QM_OK);
    static const uint32_t faces[9][4] = {{0, 1, 2, NONE}, {0, 1, 2, NONE}, {0, 2, 3, NONE},
                                         {0, 3, 4, NONE}, {0, 1, 2, 3},    {0, 1, 2, NONE},
                                         {0, 2, 3, NONE}, {0, 3, 4, NONE}, {0, 4, 5, NONE}};
    static const uint32_t origins[9] = {0, 1, 1, 1, 2, 3, 3, 3, 3};
    assert_int_equal(decoded.mesh.face_count, 9);
    assert_memory_equal(decoded.mesh.faces, faces, sizeof faces);
    assert_memory_equal(decoded.mesh.face_origin, origins, sizeof origins);
    assert_int_equal(decoded.mesh.polygon_count, 2);
    assert_int_equal(decoded.report.warning_count, 1);
    assert_true(qm_decoded_warns(&decoded, "polygons of five corners or more: 2"));
    qm_decoded_free(&decoded);
}

static void many_polygons_grow_all_arrays_together(void **state)
{
    (void)state;
    static char text[200000];
    size_t size = 0;
    static const char vertices[] = SQUARE "v -1 .5 0\n", triangle[] = "f 1 2 3\n",
                      pentagon[] = "f 1 2 3 4 5\n";
    memcpy(text, vertices, sizeof vertices - 1);
    size = sizeof vertices - 1;
    for (int i = 0; i < 2000; ++i) {
        const char *face = i < 40 ? triangle : pentagon;
        memcpy(text + size, face, strlen(face));
        size += strlen(face);
    }
    qm_decoded decoded = qm_decode(QM_FORMAT_OBJ, text, size);
    assert_int_equal(decoded.status, QM_OK);
    assert_int_equal(decoded.mesh.face_count, 40 + 3 * 1960);
    for (uint32_t face = 0; face < decoded.mesh.face_count; ++face)
        assert_int_equal(qm_mesh_input_face(&decoded.mesh, face), face < 40 ? face : 40 + (face - 40) / 3);
    qm_decoded_free(&decoded);
}

static void odd_faces_are_kept_with_a_warning(void **state)
{
    (void)state;
    qm_decoded decoded =
        qm_decode_text(QM_FORMAT_OBJ, SQUARE "v 9 9 9\nf 1 2 2 4\nf 3 3 3\nf 1 2 3 4\nl 1 2\np 1\nwhat 1\n");
    static const uint32_t faces[3][4] = {{0, 1, 1, 3}, {2, 2, 2, NONE}, {0, 1, 2, 3}};
    assert_int_equal(decoded.status, QM_OK);
    assert_int_equal(decoded.mesh.vertex_count, 5);
    assert_memory_equal(decoded.mesh.faces, faces, sizeof faces);
    assert_null(decoded.mesh.face_origin);
    assert_true(qm_decoded_warns(&decoded, "name a vertex twice: 2"));
    assert_true(qm_decoded_warns(&decoded, "lines and curves: 3"));
    qm_decoded_free(&decoded);
}

static void looks_and_names_pass_without_a_warning(void **state)
{
    (void)state;
    qm_decoded decoded =
        qm_decode_text(QM_FORMAT_OBJ, "mtllib \xe9.mtl\no a\ng b c\ns off\nusemtl d\nvt 0 nan\n"
                                      "vn x y z\n" SQUARE "f 1 2 3 4\n");
    assert_int_equal(decoded.status, QM_OK);
    assert_int_equal(decoded.report.warning_count, 0);
    qm_decoded_free(&decoded);
}

static void vertices_alone_are_a_point_set(void **state)
{
    (void)state;
    qm_decoded decoded = qm_decode_text(QM_FORMAT_OBJ, SQUARE);
    assert_int_equal(decoded.status, QM_OK);
    assert_int_equal(decoded.mesh.vertex_count, 4);
    assert_int_equal(decoded.mesh.face_count, 0);
    assert_null(decoded.mesh.faces);
    assert_int_equal(decoded.report.warning_count, 0);
    qm_decoded_free(&decoded);
}

static void faults_name_their_line(void **state)
{
    (void)state;
    static const qm_refusal refusals[] = {
        {"# nothing\n", QM_E_EMPTY, 2, "no vertex"},
        {"f 1 2 3\n", QM_E_INDEX, 1, "vertex 3, but the file has 0 vertices"},
        {SQUARE "f 1 2 9\nf 1 2 3\n", QM_E_INDEX, 5, "face refers to vertex 9, but the file has 4 vertices"},
        {SQUARE "f 1 2 0\n", QM_E_INDEX, 5, "count from 1"},
        {SQUARE "f 1 2 -5\n", QM_E_INDEX, 5, "vertex -5, but only 4 vertices come before it"},
        {SQUARE "f 1 2 99999999999999999999999\n", QM_E_INDEX, 5, "63 bits"},
        {SQUARE "f 1 2 2147483649\n", QM_E_INDEX, 5, "2147483649"},
        {SQUARE "f 1 2\n", QM_E_FORMAT, 5, "2 corners"},
        {SQUARE "f\n", QM_E_FORMAT, 5, "0 corners"},
        {SQUARE "f 1 2 x\n", QM_E_FORMAT, 5, "v/vt/vn"},
        {SQUARE "f 1 2 3/x\n", QM_E_FORMAT, 5, "v/vt/vn"},
        {SQUARE "f 1 2 3/1/1/1\n", QM_E_FORMAT, 5, "v/vt/vn"},
        {SQUARE "f 1 2 3.5\n", QM_E_FORMAT, 5, "v/vt/vn"},
        {SQUARE "f 1 2 3/99999999999999999999999\n", QM_E_FORMAT, 5, "v/vt/vn"},
        {SQUARE "f 1 \\\n2 \\\n9\n", QM_E_INDEX, 7, "vertex 9"},
        {"v 0 0\n", QM_E_FORMAT, 1, "line ends"},
        {"v 0 0 \\\n", QM_E_FORMAT, 2, "line ends"},
        {"v 0 zero 0\n", QM_E_FORMAT, 1, "expected a number"},
        {"v 0,5 0 0\n", QM_E_FORMAT, 1, "comma"},
        {"\nv 0 nan 0\n", QM_E_NOT_FINITE, 2, "not a finite"},
        {"v 0 1e999 0\n", QM_E_NOT_FINITE, 1, "too large"},
        {"v 0 0 0\r\rv 1 1\r", QM_E_FORMAT, 3, "line ends"},
    };
    QM_CHECK_REFUSALS(QM_FORMAT_OBJ, refusals);
    static const char nul[] = "v 0 0 0\nv 1 \0 0\n";
    qm_decoded decoded = qm_decode(QM_FORMAT_OBJ, nul, sizeof nul - 1);
    assert_int_equal(decoded.status, QM_E_FORMAT);
    assert_int_equal(decoded.report.line, 2);
    assert_non_null(strstr(decoded.report.detail, "NUL"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(corners_come_in_every_form),
        cmocka_unit_test(coordinates_are_kept_to_the_last_bit),
        cmocka_unit_test(polygons_become_fans_that_remember_their_face),
        cmocka_unit_test(many_polygons_grow_all_arrays_together),
        cmocka_unit_test(odd_faces_are_kept_with_a_warning),
        cmocka_unit_test(looks_and_names_pass_without_a_warning),
        cmocka_unit_test(vertices_alone_are_a_point_set),
        cmocka_unit_test(faults_name_their_line),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
