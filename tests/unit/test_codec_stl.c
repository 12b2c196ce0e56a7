/* STL files by hand: welding, text against binary, every fault with its place. */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "check.h"
#include "decode.h"
#include "random.h"

#define FACET(a, b, c)                                                                                       \
    "facet normal 0 0 1\nouter loop\nvertex " a "\nvertex " b "\nvertex " c "\nendloop\nendfacet\n"

static void text_corners_are_welded(void **state)
{
    (void)state;
    static const char *const texts[] = {
        "solid square\n" FACET("0 0 0", "1 0 0", "1 1 0")
            FACET("-0 0 0", "1 1 -0", "0 1 0") "endsolid square\n",
        "SOLID a\r\n" FACET("0 0 0", "1e0 0.0 0",
                            "1 1 0") "ENDSOLID\r\nsolid b\r\n" FACET("0 0 0", "1 1 0", "0 1 0") "endsolid b",
        "solid\nfacet normal nan nan nan outer loop vertex 0 0 0 vertex 1 0 0 vertex 1 1 0 endloop endfacet\n"
        "facet\nouter loop\nvertex 0 0 0\nvertex 1 1 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n",
    };
    static const uint32_t faces[2][4] = {{0, 1, 2, QM_NO_INDEX}, {0, 2, 3, QM_NO_INDEX}};
    for (size_t i = 0; i < sizeof texts / sizeof *texts; ++i) {
        qm_decoded decoded = qm_decode_text(QM_FORMAT_STL, texts[i]);
        QM_CHECK(decoded.status == QM_OK, "case %zu: %s", i, decoded.report.detail);
        assert_int_equal(decoded.mesh.vertex_count, 4);
        assert_int_equal(decoded.mesh.face_count, 2);
        assert_memory_equal(decoded.mesh.faces, faces, sizeof faces);
        assert_int_equal(decoded.report.warning_count, 0);
        qm_decoded_free(&decoded);
    }
}

static void missing_endsolid_is_a_warning(void **state)
{
    (void)state;
    qm_decoded decoded = qm_decode_text(QM_FORMAT_STL, "solid x\n" FACET("0 0 0", "1 0 0", "1 1 0"));
    assert_int_equal(decoded.status, QM_OK);
    assert_true(qm_decoded_warns(&decoded, "endsolid"));
    qm_decoded_free(&decoded);
}

static void add_head(qm_bytes *file, const char *head, uint32_t count)
{
    char padded[80] = {0};
    memcpy(padded, head, strlen(head));
    qm_bytes_add(file, padded, sizeof padded);
    qm_bytes_add_u32(file, count);
}

/** A triangle of the grid: corners (i, 0, 0), (i + 1, 0, 0), (i, 1, 0); normal and attribute are noise. */
static void add_triangle(qm_bytes *file, int i)
{
    float x = (float)i;
    const float values[12] = {NAN, INFINITY, 0, x, -0.0f, 0, x + 1, 0, 0, x, 1, -0.0f};
    qm_bytes_add_floats(file, values, 12);
    qm_bytes_add_u16(file, 0xabcd);
}

static void binary_corners_are_welded(void **state)
{
    (void)state;
    static const char *const heads[] = {"made by hand", "solid but binary", ""};
    for (size_t i = 0; i < 3; ++i) {
        qm_bytes file = {.size = 0};
        add_head(&file, heads[i], 2);
        add_triangle(&file, 0);
        add_triangle(&file, 1);
        qm_decoded decoded = qm_decode(QM_FORMAT_STL, file.data, file.size);
        static const uint32_t faces[2][4] = {{0, 1, 2, QM_NO_INDEX}, {1, 3, 4, QM_NO_INDEX}};
        assert_int_equal(decoded.status, QM_OK);
        assert_int_equal(decoded.mesh.vertex_count, 5);
        assert_memory_equal(decoded.mesh.faces, faces, sizeof faces);
        assert_false(signbit(decoded.mesh.positions[1]));
        qm_decoded_free(&decoded);

        qm_bytes_add(&file, "more", 4);
        decoded = qm_decode(QM_FORMAT_STL, file.data, file.size);
        assert_int_equal(decoded.status, QM_OK);
        assert_true(qm_decoded_warns(&decoded, "bytes after the last triangle: 4"));
        qm_decoded_free(&decoded);
    }
}

static void welding_survives_a_growing_table(void **state)
{
    (void)state;
    enum { COUNT = 5000 };
    static uint8_t file[84 + 50 * COUNT];
    file[80] = COUNT & 0xff;
    file[81] = COUNT >> 8;
    for (int i = 0; i < COUNT; ++i) {
        qm_bytes one = {.size = 0};
        add_triangle(&one, i);
        memcpy(file + 84 + 50 * i, one.data, 50);
    }
    qm_decoded decoded = qm_decode(QM_FORMAT_STL, file, sizeof file);
    assert_int_equal(decoded.status, QM_OK);
    assert_int_equal(decoded.mesh.vertex_count, 2 * COUNT + 1);
    for (uint32_t i = 0; i + 1 < COUNT; ++i)
        assert_int_equal(decoded.mesh.faces[4 * i + 1], decoded.mesh.faces[4 * i + 4]);
    qm_decoded_free(&decoded);
}

static void triangle_of_one_point_is_kept_with_a_warning(void **state)
{
    (void)state;
    qm_decoded decoded =
        qm_decode_text(QM_FORMAT_STL, "solid x\n" FACET("1 2 3", "1 2 3", "1 2 3") "endsolid\n");
    assert_int_equal(decoded.status, QM_OK);
    assert_int_equal(decoded.mesh.vertex_count, 1);
    assert_true(qm_decoded_warns(&decoded, "name a vertex twice: 1"));
    qm_decoded_free(&decoded);
}

static void text_faults_name_their_line(void **state)
{
    (void)state;
    static const qm_refusal refusals[] = {
        {"solid x\nendsolid x\n", QM_E_EMPTY, 3, "no vertex"},
        {"solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nendloop\nendfacet\n",
         QM_E_FORMAT, 7, "fewer than three"},
        {"solid x\nfacet\nvertex 0 0 0\nvertex 1 0 0\nvertex 1 0 0\nvertex 1 1 0\n", QM_E_FORMAT, 6,
         "more than three"},
        {"solid x\nvertex 0 0 0\n", QM_E_FORMAT, 2, "outside of a facet"},
        {"solid x\nfacet normal 0 0 1\nfacet\n", QM_E_FORMAT, 3, "within another"},
        {"solid x\nfacet normal 0 0\n", QM_E_FORMAT, 2, "fewer than three numbers"},
        {"solid x\nfacet 0 0 1\n", QM_E_FORMAT, 2, "without a normal"},
        {"solid x\nendfacet\n", QM_E_FORMAT, 2, "endfacet without"},
        {"solid x\nfacet\nendsolid\n", QM_E_FORMAT, 3, "no end"},
        {"solid x\nfacet\nvertex 0 0 0\n", QM_E_FORMAT, 4, "within a facet"},
        {"solid x\nsolid y\n", QM_E_FORMAT, 2, "within another"},
        {"solid x\nendsolid\nendsolid\n", QM_E_FORMAT, 3, "endsolid without"},
        {"solid x\nendsolid\nfacet\n", QM_E_FORMAT, 3, "outside of a solid"},
        {"solid x\nwhat\n", QM_E_FORMAT, 2, "unknown keyword"},
        {"solid x\nfacet\nvertex 0 0\n", QM_E_FORMAT, 3, "line ends"},
        {"solid x\nfacet\nvertex 0 0 inf\n", QM_E_NOT_FINITE, 3, "not a finite"},
        {"facet normal 0 0 1\n", QM_E_FORMAT, 19, "neither a text STL"},
    };
    QM_CHECK_REFUSALS(QM_FORMAT_STL, refusals);
}

static void binary_faults_name_their_byte(void **state)
{
    (void)state;
    qm_bytes file = {.size = 0};
    add_head(&file, "x", 2);
    add_triangle(&file, 0);
    add_triangle(&file, 1);
    qm_decoded decoded = qm_decode(QM_FORMAT_STL, file.data, file.size - 1);
    assert_int_equal(decoded.status, QM_E_FORMAT);
    assert_int_equal(decoded.report.offset, 80);
    assert_non_null(strstr(decoded.report.detail, "specifies 2 triangles, but the file has room for 1"));

    memset(file.data + 84 + 50 + 12, 0xff, 4);
    decoded = qm_decode(QM_FORMAT_STL, file.data, file.size);
    assert_int_equal(decoded.status, QM_E_NOT_FINITE);
    assert_int_equal(decoded.report.offset, 134);

    file.size = 0;
    add_head(&file, "x", 0);
    decoded = qm_decode(QM_FORMAT_STL, file.data, file.size);
    assert_int_equal(decoded.status, QM_E_EMPTY);
    decoded = qm_decode_limited(QM_FORMAT_STL, file.data, file.size, (qm_codec_limits){1, 1, 1, 0, NULL});
    assert_int_equal(decoded.status, QM_E_EMPTY);
}

#define TRIANGLES 700
#define FILE_SIZE (84 + 50 * TRIANGLES)

/** A file whose corners are points of a list in random order. number is set to the order in which the points
 * come, which is that of the vertices; returns how many come. */
static size_t make_soup(qm_random *random, size_t points, uint8_t file[FILE_SIZE],
                        uint32_t faces[TRIANGLES][4], uint32_t most, size_t *first_beyond)
{
    static uint32_t number[3 * TRIANGLES];
    uint32_t count = 0;
    memset(file, 0, FILE_SIZE);
    file[80] = TRIANGLES & 0xff;
    file[81] = TRIANGLES >> 8;
    memset(number, 0xff, sizeof number);
    *first_beyond = TRIANGLES;
    for (size_t i = 0; i < TRIANGLES; i++) {
        faces[i][3] = QM_NO_INDEX;
        for (size_t k = 0; k < 3; k++) {
            const size_t point = qm_random_below(random, points);
            const float zero = qm_random_below(random, 2) ? 0.0f : -0.0f;
            const float corner[3] = {(float)(point % 40), point % 3 ? (float)(point / 40 + 1) : zero, zero};
            const size_t same = point % 3 ? point : point % 40 + 3 * TRIANGLES - 40;
            memcpy(file + 84 + 50 * i + 12 + 12 * k, corner, sizeof corner);
            if (number[same] == QM_NO_INDEX) {
                if (count == most) *first_beyond = i;
                number[same] = count++;
            }
            faces[i][k] = number[same];
        }
    }
    return count;
}

static void random_triangles_are_welded_in_their_order(void **state)
{
    static uint8_t file[FILE_SIZE];
    static uint32_t faces[TRIANGLES][4];
    (void)state;
    for (uint64_t i = 0; i < 60; i++) {
        qm_random random = qm_random_make(qm_check_seed(), i);
        size_t beyond, points = 4 + qm_random_below(&random, 2000), bad = qm_random_below(&random, TRIANGLES);
        const uint32_t most = 3 + (uint32_t)qm_random_below(&random, 300);
        const size_t count = make_soup(&random, points, file, faces, most, &beyond);
        qm_decoded decoded = qm_decode(QM_FORMAT_STL, file, sizeof file);
        QM_CHECK(decoded.status == QM_OK && decoded.mesh.vertex_count == count &&
                     decoded.mesh.face_count == TRIANGLES,
                 "case %" PRIu64 ", seed %" PRIu64 ": %s", i, qm_check_seed(), decoded.report.detail);
        assert_memory_equal(decoded.mesh.faces, faces, sizeof faces);
        qm_decoded_free(&decoded);

        const bool is_bad = i % 2 == 0;
        if (is_bad) memset(file + 84 + 50 * bad + 12 + 4 * qm_random_below(&random, 9), 0xff, 4);
        decoded = qm_decode_limited(QM_FORMAT_STL, file, sizeof file,
                                    (qm_codec_limits){most, TRIANGLES, 1, 0, NULL});
        const size_t place = is_bad && bad <= beyond ? bad : beyond;
        const qm_status expected = is_bad && bad <= beyond && bad < TRIANGLES ? QM_E_NOT_FINITE
                                   : beyond < TRIANGLES                       ? QM_E_TOO_LARGE
                                                                              : QM_OK;
        QM_CHECK(decoded.status == expected, "case %" PRIu64 ", seed %" PRIu64 ": %s", i, qm_check_seed(),
                 decoded.report.detail);
        if (expected != QM_OK) assert_int_equal(decoded.report.offset, 84 + 50 * place);
        qm_decoded_free(&decoded);
    }
}

/** Facets are welded in batches; the error still names the first faulty line. */
static void the_first_of_two_text_faults_is_told(void **state)
{
    (void)state;
    for (size_t facets = 30; facets < 50; facets++)
        for (size_t bad = 0; bad < facets; bad++) {
            /* Each facet has five lines and a vertex of its own; two are those of all. */
            char text[50 * 200];
            size_t size = (size_t)snprintf(text, sizeof text, "solid x\n");
            for (size_t i = 0; i < facets; i++)
                size += (size_t)snprintf(text + size, sizeof text - size,
                                         "facet normal 0 0 1 outer loop\nvertex 0 0 0\nvertex %zu 1 0\n"
                                         "vertex %s 2 0\nendloop endfacet\n",
                                         i, i == bad ? "x" : "0.5e1");
            qm_decoded decoded =
                qm_decode_limited(QM_FORMAT_STL, text, size, (qm_codec_limits){99, 99, 1, 0, NULL});
            QM_CHECK(decoded.status == QM_E_FORMAT, "%zu facets: %s", facets, decoded.report.detail);
            assert_int_equal(decoded.report.line, 5 * bad + 5);
            decoded = qm_decode_limited(QM_FORMAT_STL, text, size, (qm_codec_limits){22, 99, 1, 0, NULL});
            const bool is_full = bad >= 21;
            QM_CHECK(decoded.status == (is_full ? QM_E_TOO_LARGE : QM_E_FORMAT), "%zu facets, %zu bad: %s",
                     facets, bad, decoded.report.detail);
            assert_int_equal(decoded.report.line, is_full ? 5 * 20 + 6 : 5 * bad + 5);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(text_corners_are_welded),
        cmocka_unit_test(missing_endsolid_is_a_warning),
        cmocka_unit_test(binary_corners_are_welded),
        cmocka_unit_test(welding_survives_a_growing_table),
        cmocka_unit_test(random_triangles_are_welded_in_their_order),
        cmocka_unit_test(the_first_of_two_text_faults_is_told),
        cmocka_unit_test(triangle_of_one_point_is_kept_with_a_warning),
        cmocka_unit_test(text_faults_name_their_line),
        cmocka_unit_test(binary_faults_name_their_byte),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
