/* PLY files by hand: all scalar types in all encodings, what is stepped over, every fault with its place. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "check.h"
#include "decode.h"

#define HEAD "ply\nformat ascii 1.0\n"
#define XYZ "property float x\nproperty float y\nproperty float z\n"
#define LIST "property list uchar int vertex_indices\n"
#define TRIANGLE_HEAD HEAD "element vertex 3\n" XYZ "element face 1\n" LIST "end_header\n"
#define STRIP_HEAD HEAD "element vertex 4\n" XYZ "element tristrips 1\n" LIST "end_header\n"
#define BINARY_HEAD                                                                                          \
    "ply\nformat binary_little_endian 1.0\nelement vertex 3\n" XYZ "element face 1\n" LIST "end_header\n"

static void check_triangle(qm_decoded decoded, const char *name)
{
    static const uint32_t face[4] = {0, 1, 2, QM_NO_INDEX};
    static const double positions[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    QM_CHECK(decoded.status == QM_OK, "%s: %s", name, decoded.report.detail);
    assert_int_equal(decoded.mesh.vertex_count, 3);
    assert_int_equal(decoded.mesh.face_count, 1);
    assert_memory_equal(decoded.mesh.faces, face, sizeof face);
    assert_memory_equal(decoded.mesh.positions, positions, sizeof positions);
    qm_decoded_free(&decoded);
}

static void text_files_are_read(void **state)
{
    (void)state;
    static const char *const texts[] = {
        TRIANGLE_HEAD "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        TRIANGLE_HEAD "0 0 0\n1 0 0\n\n0 1 0\n 3\t0 1 2",
        "ply\r\nformat ascii 1.0\r\ncomment by hand\r\nobj_info \xe9\r\nelement vertex 3\r\n"
        "property double x\r\nproperty double y\r\nproperty double z\r\nelement face 1\r\n"
        "property list uint8 uint32 vertex_index\r\nend_header\r\n0 0 0\r\n1 0 0\r\n0 1 0\r\n3 0 1 2\r\n",
        /* Faces first, coordinates in another order, other properties round both. */
        HEAD "element face 1\nproperty uchar flags\n" LIST "property list uchar float texcoord\n"
             "element vertex 3\nproperty float z\nproperty uchar red\nproperty float x\nproperty float y\n"
             "end_header\n7 3 0 1 2 2 .5 .5\n0 255 0 0\n0 0 1 0\n0 1 0 1\n",
    };
    for (size_t i = 0; i < sizeof texts / sizeof *texts; ++i)
        check_triangle(qm_decode_text(QM_FORMAT_PLY, texts[i]), texts[i]);
}

/** Writes a whole number as any scalar type in either byte order. */
static void add_scalar(qm_bytes *bytes, const char *type, bool big, int value)
{
    uint8_t data[8];
    size_t size = 4;
    if (strcmp(type, "double") == 0) {
        double number = value;
        memcpy(data, &number, size = 8);
    } else if (strcmp(type, "float") == 0) {
        float number = (float)value;
        memcpy(data, &number, 4);
    } else {
        int32_t number = value;
        memcpy(data, &number, 4);
        size = strstr(type, "char") ? 1 : strstr(type, "short") ? 2 : 4;
    }
    for (size_t i = 0; i < size; ++i)
        qm_bytes_add(bytes, &data[big ? size - 1 - i : i], 1);
}

static void add_typed_file(qm_bytes *file, bool big, const char *coordinate, const char *count,
                           const char *index)
{
    char head[512];
    static const int positions[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    snprintf(head, sizeof head,
             "ply\nformat binary_%s_endian 1.0\nelement vertex 3\nproperty %s x\nproperty %s y\n"
             "property %s z\nelement face 1\nproperty list %s %s vertex_indices\nend_header\n",
             big ? "big" : "little", coordinate, coordinate, coordinate, count, index);
    file->size = 0;
    qm_bytes_add_text(file, head);
    for (int i = 0; i < 9; ++i)
        add_scalar(file, coordinate, big, positions[i]);
    add_scalar(file, count, big, 3);
    for (int i = 0; i < 3; ++i)
        add_scalar(file, index, big, i);
}

static void binary_files_take_every_type_in_both_orders(void **state)
{
    (void)state;
    static const char *const types[] = {"char", "uchar", "short", "ushort", "int", "uint", "float", "double"};
    for (int big = 0; big < 2; ++big)
        for (int coordinate = 0; coordinate < 8; ++coordinate)
            for (int count = 0; count < 6; ++count)
                for (int index = 0; index < 6; ++index) {
                    qm_bytes file;
                    add_typed_file(&file, big, types[coordinate], types[count], types[index]);
                    check_triangle(qm_decode(QM_FORMAT_PLY, file.data, file.size), types[coordinate]);
                    /* Every shorter file is refused. */
                    qm_decoded cut = qm_decode(QM_FORMAT_PLY, file.data, file.size - 1);
                    assert_int_equal(cut.status, QM_E_FORMAT);
                    assert_true(cut.report.offset <= file.size);
                }
}

static void binary_rows_step_over_everything_else(void **state)
{
    (void)state;
    qm_bytes file = {.size = 0};
    qm_bytes_add_text(&file,
                      "ply\nformat binary_little_endian 1.0\nelement camera 1\nproperty list uchar double a\n"
                      "property short b\nelement empty 5\nelement vertex 3\nproperty uchar red\n" XYZ
                      "property list ushort uchar tags\nelement face 1\nproperty list uchar float uv\n" LIST
                      "property double area\nelement edge 1\nproperty int a\nend_header\n");
    static const float positions[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    qm_bytes_add(&file, "\2abcdefghABCDEFGHxx", 19);
    for (int i = 0; i < 3; ++i) {
        qm_bytes_add(&file, "r", 1);
        qm_bytes_add_floats(&file, positions + 3 * i, 3);
        qm_bytes_add_u16(&file, (uint16_t)i);
        qm_bytes_add(&file, "ttt", (size_t)i);
    }
    qm_bytes_add(&file, "\1ffff\3", 6);
    for (uint32_t i = 0; i < 3; ++i)
        qm_bytes_add_u32(&file, i);
    qm_bytes_add(&file, "aaaaaaaaeeee", 12);
    qm_decoded decoded = qm_decode(QM_FORMAT_PLY, file.data, file.size);
    assert_true(qm_decoded_warns(&decoded, "other than vertex, face and tristrips: 3"));
    assert_int_equal(decoded.report.warning_count, 1);
    check_triangle(decoded, "other elements");
}

static void quads_polygons_and_points_are_kept(void **state)
{
    (void)state;
    qm_decoded decoded = qm_decode_text(
        QM_FORMAT_PLY, HEAD "element vertex 5\n" XYZ "element face 2\n" LIST
                            "end_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n-1 .5 0\n4 0 1 2 3\n5 0 1 2 3 4\n");
    assert_int_equal(decoded.status, QM_OK);
    static const uint32_t faces[4][4] = {
        {0, 1, 2, 3}, {0, 1, 2, QM_NO_INDEX}, {0, 2, 3, QM_NO_INDEX}, {0, 3, 4, QM_NO_INDEX}};
    static const uint32_t origins[4] = {0, 1, 1, 1};
    assert_int_equal(decoded.mesh.face_count, 4);
    assert_memory_equal(decoded.mesh.faces, faces, sizeof faces);
    assert_memory_equal(decoded.mesh.face_origin, origins, sizeof origins);
    assert_int_equal(decoded.mesh.polygon_count, 1);
    qm_decoded_free(&decoded);

    decoded = qm_decode_text(QM_FORMAT_PLY, HEAD "element vertex 2\n" XYZ "end_header\n0 0 0\n1 2 3\n");
    assert_int_equal(decoded.status, QM_OK);
    assert_int_equal(decoded.mesh.vertex_count, 2);
    assert_int_equal(decoded.mesh.face_count, 0);
    qm_decoded_free(&decoded);
}

#define NORMALS "property float nx\nproperty float ny\nproperty float nz\n"

static void normals_of_points_are_kept(void **state)
{
    (void)state;
    qm_bytes file = {.size = 0};
    qm_bytes_add_text(&file,
                      "ply\nformat binary_little_endian 1.0\nelement vertex 2\n" NORMALS XYZ "end_header\n");
    static const float rows[12] = {0, 0, 2, 1, 2, 3, NAN, 1, 0, 4, 5, 6};
    qm_bytes_add_floats(&file, rows, 12);
    qm_decoded decoded = qm_decode(QM_FORMAT_PLY, file.data, file.size);
    assert_int_equal(decoded.status, QM_OK);
    static const float normals[6] = {0, 0, 2, 0, 0, 0};
    assert_memory_equal(decoded.mesh.normals, normals, sizeof normals);
    assert_true(decoded.mesh.positions[0] == 1.0 && decoded.mesh.positions[5] == 6.0);
    assert_true(qm_decoded_warns(&decoded, "not finite: 1"));
    qm_decoded_free(&decoded);

    const char *text = "ply\nformat ascii 1.0\nelement vertex 1\n" XYZ NORMALS "end_header\n1 2 3 0 -1 0\n";
    decoded = qm_decode_text(QM_FORMAT_PLY, text);
    assert_int_equal(decoded.status, QM_OK);
    assert_true(decoded.mesh.normals[1] == -1.0f);
    qm_decoded_free(&decoded);

    /* A mesh gets its normals from its faces, and two numbers are no normal. */
    const char *mesh = "ply\nformat ascii 1.0\nelement vertex 3\n" XYZ NORMALS "element face 1\n" LIST
                       "end_header\n0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n3 0 1 2\n";
    decoded = qm_decode_text(QM_FORMAT_PLY, mesh);
    assert_int_equal(decoded.status, QM_OK);
    assert_null(decoded.mesh.normals);
    qm_decoded_free(&decoded);
    const char *two = "ply\nformat ascii 1.0\nelement vertex 1\n" XYZ "property float nx\nproperty float ny\n"
                      "end_header\n1 2 3 0 -1\n";
    decoded = qm_decode_text(QM_FORMAT_PLY, two);
    assert_int_equal(decoded.status, QM_OK);
    assert_null(decoded.mesh.normals);
    qm_decoded_free(&decoded);
}

static void grids_are_read_from_comments(void **state)
{
    (void)state;
    const char *text =
        "ply\ncomment grid 1 2\nformat ascii 1.0\ncomment grid\ncomment grid 3\ncomment grid 0 1\n"
        "comment grid -1 2\ncomment grid one two\ncomment grid 99999999999 1\ncomment a grid 4 4\n"
        "comment grid 5 6 of more\nelement vertex 1\n" XYZ "end_header\n1 2 3\n";
    qm_decoded decoded = qm_decode_text(QM_FORMAT_PLY, text);
    assert_int_equal(decoded.status, QM_OK);
    assert_int_equal(decoded.mesh.grid_count, 2);
    assert_true(decoded.mesh.grids[0].rows == 1 && decoded.mesh.grids[0].columns == 2);
    assert_true(decoded.mesh.grids[1].rows == 5 && decoded.mesh.grids[1].columns == 6);
    qm_decoded_free(&decoded);
}

static void what_follows_the_last_row_is_reported(void **state)
{
    (void)state;
    qm_decoded decoded =
        qm_decode_text(QM_FORMAT_PLY, TRIANGLE_HEAD "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n\nmore\n");
    assert_true(qm_decoded_warns(&decoded, "line 15"));
    check_triangle(decoded, "text");
    qm_bytes file = {.size = 0};
    static const float positions[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    qm_bytes_add_text(&file, BINARY_HEAD);
    qm_bytes_add_floats(&file, positions, 9);
    qm_bytes_add(&file, "\3\0\0\0\0\1\0\0\0\2\0\0\0rest", 17);
    decoded = qm_decode(QM_FORMAT_PLY, file.data, file.size);
    assert_true(qm_decoded_warns(&decoded, "bytes after the last row: 4"));
    check_triangle(decoded, "binary");
}

static void faults_name_their_line(void **state)
{
    (void)state;
    static const qm_refusal refusals[] = {
        {"plx\n", QM_E_FORMAT, 1, "word ply"},
        {"ply\n", QM_E_FORMAT, 2, "no end"},
        {"ply\nelement vertex 0\n" XYZ "end_header\n", QM_E_FORMAT, 6, "no format line"},
        {"ply\nformat\n", QM_E_FORMAT, 2, "has no format"},
        {"ply\nformat binary 1.0\n", QM_E_FORMAT, 2, "unknown format \"binary\""},
        {"ply\nformat ascii 2.0\n", QM_E_FORMAT, 2, "1.0"},
        {HEAD "format ascii 1.0\n", QM_E_FORMAT, 3, "second format"},
        {HEAD "what is this\n", QM_E_FORMAT, 3, "line 3 of the header starts with \"what\""},
        {HEAD "\xff\"a_word_of_very_many_characters\n", QM_E_FORMAT, 3, "\"??a_word_of_very_many_ch...\""},
        {HEAD "element\n", QM_E_FORMAT, 3, "no name"},
        {HEAD "element vertex\n", QM_E_FORMAT, 3, "line ends"},
        {HEAD "element vertex x\n", QM_E_FORMAT, 3, "expected an integer"},
        {HEAD "element vertex -1\n", QM_E_FORMAT, 3, "negative"},
        {HEAD "element vertex 99999999999999999999\n", QM_E_FORMAT, 3, "too large"},
        {HEAD "property float x\n", QM_E_FORMAT, 3, "before the first element"},
        {HEAD "element vertex 1\nproperty\n", QM_E_FORMAT, 4, "no type"},
        {HEAD "element vertex 1\nproperty half x\n", QM_E_FORMAT, 4, "unknown type \"half\""},
        {HEAD "element vertex 1\nproperty float\n", QM_E_FORMAT, 4, "no name"},
        {HEAD "element vertex 1\nproperty float x\nproperty int x\n", QM_E_FORMAT, 5, "twice"},
        {HEAD "element vertex 1\nelement vertex 1\n", QM_E_FORMAT, 4, "twice"},
        {HEAD "element tristrips 1\nelement tristrips 1\n", QM_E_FORMAT, 4, "twice"},
        {STRIP_HEAD "0 0 0\n1 0 0\n0 1 0\n1 1 0\n4 0 1 2 4\n", QM_E_INDEX, 14,
         "vertex 4, but the file has 4"},
        {STRIP_HEAD "0 0 0\n1 0 0\n0 1 0\n1 1 0\n4 0 1 2 -2\n", QM_E_INDEX, 14, "vertex -2"},
        {STRIP_HEAD "0 0 0\n1 0 0\n0 1 0\n1 1 0\n4 0 1 2\n", QM_E_FORMAT, 14, "line ends"},
        {HEAD "element vertex 1\n" XYZ "element tristrips 1\nproperty int a\nend_header\n0 0 0\n1\n",
         QM_E_FORMAT, 10, "no list named"},
        {HEAD "element face 1\nproperty list float int vertex_indices\n", QM_E_FORMAT, 4, "length of a list"},
        {HEAD "element face 1\nproperty list uchar float vertex_indices\n", QM_E_FORMAT, 4,
         "must be integers"},
        {HEAD "element vertex 1\nproperty float x\nproperty float y\nend_header\n0 0\n", QM_E_FORMAT, 7,
         "x, y and z"},
        {HEAD "element vertex 1\n" XYZ "element face 1\nproperty int a\nend_header\n0 0 0\n1\n", QM_E_FORMAT,
         10, "no list named"},
        {HEAD "element vertex 0\n" XYZ "end_header\n", QM_E_EMPTY, 8, "no vertex"},
        {TRIANGLE_HEAD "0 0 0\n1 0 0\n", QM_E_FORMAT, 10, "specifies 3 rows"},
        {TRIANGLE_HEAD "0.00 0.00 0.00\n1 0 0\n", QM_E_FORMAT, 12, "ends after 2 of 3 rows"},
        {TRIANGLE_HEAD "0 0 0\n1 0\n0 1 0\n3 0 1 2\n", QM_E_FORMAT, 11, "line ends"},
        {TRIANGLE_HEAD "0 0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", QM_E_FORMAT, 10, "more values"},
        {TRIANGLE_HEAD "0 0 0\n1 0 nan\n0 1 0\n3 0 1 2\n", QM_E_NOT_FINITE, 11, "not a finite"},
        {TRIANGLE_HEAD "0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", QM_E_INDEX, 13, "vertex 3, but the file has 3"},
        {TRIANGLE_HEAD "0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", QM_E_INDEX, 13, "vertex -1"},
        {TRIANGLE_HEAD "0 0 0\n1 0 0\n0 1 0\n2 0 1    \n", QM_E_FORMAT, 13, "2 corners"},
        {TRIANGLE_HEAD "0 0 0\n1 0 0\n0 1 0\n0", QM_E_FORMAT, 13, "0 corners"},
        {HEAD "element vertex 3\n" XYZ "element face 2\n" LIST "end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n0",
         QM_E_FORMAT, 14, "0 corners"},
        {HEAD "element vertex 3\n" XYZ "element face 2\n" LIST "end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
         QM_E_FORMAT, 14, "ends after 1 of 2 rows"},
        {TRIANGLE_HEAD "0 0 0\n1 0 0\n0 1 0\n-3 0 1 2\n", QM_E_FORMAT, 13, "negative"},
        {TRIANGLE_HEAD "0 0 0\n1 0 0\n0 1 0\n9999999 0 1 2\n", QM_E_FORMAT, 13, "line ends"},
    };
    QM_CHECK_REFUSALS(QM_FORMAT_PLY, refusals);
}

static void binary_faults_name_their_byte(void **state)
{
    (void)state;
    static const float positions[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    static const struct {
        const char *face;
        qm_status status;
        size_t place; /* after the vertices */
        const char *words;
    } cases[] = {{"\3\0\0\0\0\1\0\0\0\3\0\0\0", QM_E_INDEX, 9, "vertex 3"},
                 {"\3\0\0\0\0\1\0\0\0\xff\xff\xff\xff", QM_E_INDEX, 9, "vertex -1"},
                 {"\2\0\0\0\0\1\0\0\0\3\0\0\0", QM_E_FORMAT, 9, "2 corners"},
                 {"\xff\0\0\0\0\1\0\0\0\3\0\0\0", QM_E_FORMAT, 1, "within a row"}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        qm_bytes file = {.size = 0};
        qm_bytes_add_text(&file, BINARY_HEAD);
        qm_bytes_add_floats(&file, positions, 9);
        size_t start = file.size;
        qm_bytes_add(&file, cases[i].face, 13);
        qm_decoded decoded = qm_decode(QM_FORMAT_PLY, file.data, file.size);
        QM_CHECK(decoded.status == cases[i].status && decoded.report.offset == start + cases[i].place &&
                     strstr(decoded.report.detail, cases[i].words),
                 "case %zu: %zu: %s", i, decoded.report.offset, decoded.report.detail);
    }
    qm_bytes file = {.size = 0};
    static const float broken[3] = {0, 0, __builtin_nanf("")};
    qm_bytes_add_text(&file, BINARY_HEAD);
    size_t start = file.size;
    qm_bytes_add_floats(&file, broken, 3);
    qm_bytes_add(&file, file.data, 100);
    qm_decoded decoded = qm_decode(QM_FORMAT_PLY, file.data, file.size);
    assert_int_equal(decoded.status, QM_E_NOT_FINITE);
    assert_int_equal(decoded.report.offset, start + 8);
}

static void announced_counts_need_bytes(void **state)
{
    (void)state;
    static const qm_refusal refusals[] = {
        {"ply\nformat binary_big_endian 1.0\nelement vertex 4000000000\n" XYZ "end_header\n", QM_E_FORMAT,
         121, "specifies 4000000000 rows"},
        {"ply\nformat binary_big_endian 1.0\nelement x 9000000000000000000\nproperty list uchar uchar a\n"
         "element vertex 1\n" XYZ "end_header\n",
         QM_E_FORMAT, 170, "room for 0"},
        {HEAD "element vertex 9000000000000000000\n" XYZ "end_header\n0 0 0\n", QM_E_FORMAT, 8, "room for 1"},
    };
    QM_CHECK_REFUSALS(QM_FORMAT_PLY, refusals);
}

/** A strip in all encodings, against its triangles one by one. */
static void strips_turn_every_second_triangle(void **state)
{
    (void)state;
    static const int strip[] = {0, 1, 2, 3, 4, -1, 5, 4, -1, 3, 2, 2, 1, 0};
    static const uint32_t faces[][4] = {
        {0, 1, 2, QM_NO_INDEX}, {2, 1, 3, QM_NO_INDEX}, {2, 3, 4, QM_NO_INDEX}, {2, 1, 0, QM_NO_INDEX}};
    enum { LENGTH = sizeof strip / sizeof *strip, ROWS = 2 };
    static const char *const encodings[] = {"ascii", "binary_little_endian", "binary_big_endian"};
    for (int e = 0; e < 3; ++e) {
        qm_bytes file = {.size = 0};
        char text[200];
        snprintf(text, sizeof text, "ply\nformat %s 1.0\nelement vertex 6\n" XYZ "element tristrips %d\n",
                 encodings[e], ROWS);
        qm_bytes_add_text(&file, text);
        qm_bytes_add_text(&file, "property list int int vertex_indices\nend_header\n");
        for (int i = 0; i < 18; ++i) {
            snprintf(text, sizeof text, "%d%c", i * i % 7, i % 3 == 2 ? '\n' : ' ');
            if (e == 0) qm_bytes_add_text(&file, text);
            if (e > 0) add_scalar(&file, "float", e == 2, i * i % 7);
        }
        for (int i = 0; i < ROWS * (1 + LENGTH); ++i) {
            const int value = i % (1 + LENGTH) == 0 ? LENGTH : strip[i % (1 + LENGTH) - 1];
            snprintf(text, sizeof text, "%d%c", value, i % (1 + LENGTH) == LENGTH ? '\n' : ' ');
            if (e == 0) qm_bytes_add_text(&file, text);
            if (e > 0) add_scalar(&file, "int", e == 2, value);
        }
        qm_decoded decoded = qm_decode(QM_FORMAT_PLY, file.data, file.size);
        QM_CHECK(decoded.status == QM_OK, "%s: %s", encodings[e], decoded.report.detail);
        assert_int_equal(decoded.mesh.vertex_count, 6);
        assert_int_equal(decoded.mesh.face_count, 4 * ROWS);
        for (int row = 0; row < ROWS; ++row)
            assert_memory_equal(decoded.mesh.faces + 16 * row, faces, sizeof faces);
        assert_true(qm_decoded_warns(&decoded, "name a vertex twice: 4 (left out)"));
        qm_decoded_free(&decoded);
        decoded = qm_decode_limited(QM_FORMAT_PLY, file.data, file.size, (qm_codec_limits){6, 7, 1, 0, NULL});
        assert_int_equal(decoded.status, QM_E_TOO_LARGE);
    }
}

enum { MANY = 2500, FIRST_QUAD = 1700 }; /* rows: more than two blocks of those that are read together */

/** Triangles, then quads and triangles by turns; the last vertex and face are the given ones. */
static size_t write_many(uint8_t *file, const char *type, const double last[3], uint32_t last_corner)
{
    size_t size = (size_t)sprintf((char *)file,
                                  "ply\nformat binary_little_endian 1.0\nelement vertex %d\nproperty %s x\n"
                                  "property %s y\nproperty %s z\nelement face %d\n" LIST "end_header\n",
                                  MANY, type, type, type, MANY);
    bool is_double = strcmp(type, "double") == 0;
    for (int i = 0; i < 3 * MANY; ++i) {
        double wide = i < 3 * (MANY - 1) ? 0.5 * i : last[i % 3];
        float narrow = (float)wide;
        memcpy(file + size, is_double ? (void *)&wide : (void *)&narrow, is_double ? 8 : 4);
        size += is_double ? 8 : 4;
    }
    for (uint32_t i = 0; i < MANY; ++i) {
        const uint32_t corners[4] = {i, i == 9 ? i : (i + 1) % MANY,
                                     i < MANY - 1 ? (i + 2) % MANY : last_corner, (i + 3) % MANY};
        file[size++] = i >= FIRST_QUAD && i % 2 == 0 ? 4 : 3;
        memcpy(file + size, corners, 4u * file[size - 1]);
        size += 4u * file[size - 1];
    }
    return size;
}

static void blocks_of_rows_are_as_single_ones(void **state)
{
    (void)state;
    static uint8_t file[MANY * 50];
    static const double good[3] = {-1.25, 2, 7}, bad[3] = {1, 2, INFINITY};
    for (int k = 0; k < 2; ++k) {
        const char *type = k == 0 ? "float" : "double";
        size_t size = write_many(file, type, good, 5);
        qm_decoded decoded = qm_decode(QM_FORMAT_PLY, file, size);
        QM_CHECK(decoded.status == QM_OK, "%s: %s", type, decoded.report.detail);
        assert_int_equal(decoded.mesh.vertex_count, MANY);
        assert_int_equal(decoded.mesh.face_count, MANY);
        assert_null(decoded.mesh.face_origin);
        assert_true(qm_decoded_warns(&decoded, "name a vertex twice: 1 "));
        for (size_t i = 0; i < 3 * (MANY - 1); ++i)
            assert_true(decoded.mesh.positions[i] == 0.5 * (double)i);
        assert_memory_equal(decoded.mesh.positions + 3 * (MANY - 1), good, sizeof good);
        for (uint32_t i = 0; i < MANY; ++i) {
            bool is_quad = i >= FIRST_QUAD && i % 2 == 0;
            assert_int_equal(decoded.mesh.faces[4 * i], i);
            assert_int_equal(decoded.mesh.faces[4 * i + 2], i < MANY - 1 ? (i + 2) % MANY : 5);
            assert_int_equal(decoded.mesh.faces[4 * i + 3], is_quad ? (i + 3) % MANY : QM_NO_INDEX);
        }
        qm_decoded_free(&decoded);

        size = write_many(file, type, good, MANY);
        decoded = qm_decode(QM_FORMAT_PLY, file, size);
        assert_int_equal(decoded.status, QM_E_INDEX);
        assert_int_equal(decoded.report.offset, size - 4); /* the last face is a triangle */
        size = write_many(file, type, bad, 5);
        decoded = qm_decode(QM_FORMAT_PLY, file, size);
        assert_int_equal(decoded.status, QM_E_NOT_FINITE);
        size = write_many(file, type, good, 5);
        decoded = qm_decode(QM_FORMAT_PLY, file, size - 1);
        assert_int_equal(decoded.status, QM_E_FORMAT);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(text_files_are_read),
        cmocka_unit_test(binary_files_take_every_type_in_both_orders),
        cmocka_unit_test(binary_rows_step_over_everything_else),
        cmocka_unit_test(quads_polygons_and_points_are_kept),
        cmocka_unit_test(normals_of_points_are_kept),
        cmocka_unit_test(grids_are_read_from_comments),
        cmocka_unit_test(what_follows_the_last_row_is_reported),
        cmocka_unit_test(faults_name_their_line),
        cmocka_unit_test(binary_faults_name_their_byte),
        cmocka_unit_test(announced_counts_need_bytes),
        cmocka_unit_test(strips_turn_every_second_triangle),
        cmocka_unit_test(blocks_of_rows_are_as_single_ones),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
