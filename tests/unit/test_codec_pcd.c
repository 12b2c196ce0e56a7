/* PCD files by hand: every type in every encoding, what is stepped over or left out, every fault with its place. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "check.h"
#include "decode.h"

#define HEAD "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\n"
#define FACTS "SIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
#define TWO "WIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\n"
#define TEXT_HEAD HEAD FACTS TWO "DATA ascii\n"

static void check_two_points(qm_decoded *decoded, const char *name)
{
    static const double positions[6] = {1, 2, 3, 4, 5, 6};
    QM_CHECK(decoded->status == QM_OK, "%s: %s", name, decoded->report.detail);
    assert_int_equal(decoded->mesh.vertex_count, 2);
    assert_int_equal(decoded->mesh.face_count, 0);
    assert_memory_equal(decoded->mesh.positions, positions, sizeof positions);
    qm_decoded_free(decoded);
}

static void texts_are_read(void **state)
{
    (void)state;
    static const char *const texts[] = {
        TEXT_HEAD "1 2 3\n4 5 6\n",
        TEXT_HEAD "1 2 3\n\n# between\n 4\t5  6 # end",
        "VERSION .7\r\nFIELDS x y z\r\n" FACTS
        "WIDTH 2\r\nHEIGHT 1\r\nPOINTS 2\r\nDATA ascii\r\n1 2 3\r\n4 5 6\r\n",
        "version .5\ncolumns x y z\nsize 4 4 4\ntype f f f\nwidth 1\nheight 2\ndata ascii\n1 2 3\n4 5 6\n",
        "FIELDS x y z\nPOINTS 2\nDATA ascii\n1 2 3\n4 5 6\n",
        "\xef\xbb\xbf# c\nFIELDS rgb z x _ y\nSIZE 4 4 4 1 4\nTYPE U F F U F\nCOUNT 1 1 1 3 1\n" TWO
        "DATA ascii\n4278190080 3 1 a b c 2\n7 6 4 x nan z 5\n",
    };
    for (size_t i = 0; i < sizeof texts / sizeof *texts; ++i) {
        char name[24];
        snprintf(name, sizeof name, "case %zu", i);
        assert_int_equal(qm_format_sniff((const uint8_t *)texts[i], strlen(texts[i])), QM_FORMAT_PCD);
        qm_decoded decoded = qm_decode_text(QM_FORMAT_PCD, texts[i]);
        assert_int_equal(decoded.report.warning_count, 0);
        check_two_points(&decoded, name);
    }
}

static void points_that_were_not_seen_are_left_out(void **state)
{
    (void)state;
    static const char text[] =
        HEAD FACTS "WIDTH 3\nHEIGHT 2\nDATA ascii\nnan nan nan\n1 2 3\n0 -NaN 0\n4 5 6\n+inf 0 0\n"
                   "0 0 -INF\nmore\n";
    qm_decoded decoded = qm_decode_text(QM_FORMAT_PCD, text);
    assert_true(qm_decoded_warns(&decoded, "not finite: 4 (left out)"));
    assert_true(qm_decoded_warns(&decoded, "line 16"));
    check_two_points(&decoded, "holes");

    decoded = qm_decode_text(QM_FORMAT_PCD, HEAD FACTS "WIDTH 1\nHEIGHT 1\nDATA ascii\nnan 0 0\n");
    assert_int_equal(decoded.status, QM_E_EMPTY);
    assert_non_null(strstr(decoded.report.detail, "no point has finite"));
}

static void normals_are_kept(void **state)
{
    (void)state;
    static const char text[] =
        "FIELDS x y z normal_x normal_y normal_z curvature\nSIZE 4 4 4 4 4 4 4\n"
        "TYPE F F F F F F F\nWIDTH 2\nHEIGHT 1\nDATA ascii\n1 2 3 0 0 1 9\n4 5 6 nan 0 1 9\n";
    qm_decoded decoded = qm_decode_text(QM_FORMAT_PCD, text);
    assert_int_equal(decoded.status, QM_OK);
    assert_non_null(decoded.mesh.normals);
    assert_true(decoded.mesh.normals[2] == 1.0f && decoded.mesh.normals[5] == 0.0f);
    assert_true(qm_decoded_warns(&decoded, "normals that are not finite: 1"));
    check_two_points(&decoded, "normals");
}

/** Writes a small number as a little-endian value of a type. */
static void add_number(qm_bytes *file, char type, size_t size, int value)
{
    int64_t integer = value;
    double wide = value;
    float narrow = (float)value;
    qm_bytes_add(file, type != 'F' ? (void *)&integer : size == 8 ? (void *)&wide : (void *)&narrow, size);
}

/** Packs bytes as LZF, by literals and by references to what is one distance back. */
static void add_lzf(qm_bytes *file, const uint8_t *bytes, size_t size, size_t distance)
{
    for (size_t i = 0, length; i < size; i += length) {
        for (length = 0; i + length < size && length < 264 && i >= distance; ++length)
            if (bytes[i + length] != bytes[i + length - distance]) break;
        if (length >= 3) {
            const size_t code = length - 2 < 7 ? length - 2 : 7;
            const uint8_t head = (uint8_t)(code << 5 | (distance - 1) >> 8), low = (uint8_t)(distance - 1);
            const uint8_t more = (uint8_t)(length - 9);
            qm_bytes_add(file, &head, 1);
            if (code == 7) qm_bytes_add(file, &more, 1);
            qm_bytes_add(file, &low, 1);
        } else {
            const uint8_t head = 0;
            length = 1;
            qm_bytes_add(file, &head, 1);
            qm_bytes_add(file, bytes + i, 1);
        }
    }
}

enum { POINTS = 40 };

static int value_at(bool is_unsigned, int point, int axis)
{
    int value = point * 3 + axis;
    return is_unsigned || point % 2 ? value : -value;
}

/** Points of one type between other fields; returns the size of the header. */
static size_t write_typed(qm_bytes *file, char type, size_t size, bool is_compressed, size_t distance)
{
    char text[300];
    qm_bytes rows = {.size = 0};
    snprintf(
        text, sizeof text,
        "FIELDS a z x _ y\nSIZE 2 %zu %zu 1 %zu\nTYPE U %c %c U %c\nCOUNT 1 1 1 3 1\nWIDTH %d\nHEIGHT 1\n"
        "DATA %s\n",
        size, size, size, type, type, type, POINTS, is_compressed ? "binary_compressed" : "binary");
    *file = (qm_bytes){.size = 0};
    qm_bytes_add_text(file, text);
    const size_t start = file->size;
    static const int axes[5] = {-1, 2, 0, -1, 1};
    const size_t sizes[5] = {2, size, size, 3, size};
    /* Rows have all fields of a point; arrays have all points of a field. */
    for (int i = 0; i < 5 * POINTS; ++i) {
        const int field = is_compressed ? i / POINTS : i % 5, point = is_compressed ? i % POINTS : i / 5;
        if (axes[field] < 0)
            add_number(&rows, 'U', sizes[field], 0x7f7f7f);
        else
            add_number(&rows, type, size, value_at(type == 'U', point, axes[field]));
    }
    if (!is_compressed) {
        qm_bytes_add(file, rows.data, rows.size);
        return start;
    }
    qm_bytes packed = {.size = 0};
    add_lzf(&packed, rows.data, rows.size, distance);
    qm_bytes_add_u32(file, (uint32_t)packed.size);
    qm_bytes_add_u32(file, (uint32_t)rows.size);
    qm_bytes_add(file, packed.data, packed.size);
    return start;
}

static void binary_files_have_every_type(void **state)
{
    (void)state;
    static const struct {
        char type;
        size_t size;
    } types[] = {{'F', 4}, {'F', 8}, {'I', 1}, {'I', 2}, {'I', 4},
                 {'I', 8}, {'U', 1}, {'U', 2}, {'U', 4}, {'U', 8}};
    for (size_t i = 0; i < sizeof types / sizeof *types; ++i)
        for (size_t distance = 0; distance <= 3; ++distance) {
            qm_bytes file;
            write_typed(&file, types[i].type, types[i].size, distance > 0, distance);
            qm_decoded decoded = qm_decode(QM_FORMAT_PCD, file.data, file.size);
            QM_CHECK(decoded.status == QM_OK, "%c%zu: %s", types[i].type, types[i].size,
                     decoded.report.detail);
            assert_int_equal(decoded.mesh.vertex_count, POINTS);
            assert_int_equal(decoded.report.warning_count, 0);
            for (int k = 0; k < 3 * POINTS; ++k) {
                const int expected = value_at(types[i].type == 'U', k / 3, k % 3);
                QM_CHECK(decoded.mesh.positions[k] == (double)expected, "%c%zu: %g instead of %d",
                         types[i].type, types[i].size, decoded.mesh.positions[k], expected);
            }
            qm_decoded_free(&decoded);
            decoded = qm_decode_limited(QM_FORMAT_PCD, file.data, file.size,
                                        (qm_codec_limits){POINTS - 1, 1, 1, 0, NULL});
            assert_int_equal(decoded.status, QM_E_TOO_LARGE);
            qm_bytes_add_u32(&file, 7);
            decoded = qm_decode(QM_FORMAT_PCD, file.data, file.size);
            assert_true(qm_decoded_warns(&decoded, "after the last point: 4"));
            qm_decoded_free(&decoded);
        }
}

static void binary_faults_name_their_byte(void **state)
{
    (void)state;
    for (int is_compressed = 0; is_compressed < 2; ++is_compressed) {
        qm_bytes file;
        const size_t start = write_typed(&file, 'F', 4, is_compressed, 4);
        for (size_t size = start; size < file.size; ++size) {
            qm_decoded decoded = qm_decode(QM_FORMAT_PCD, file.data, size);
            QM_CHECK(decoded.status == QM_E_FORMAT && decoded.report.offset <= size, "%zu: %s", size,
                     decoded.report.detail);
        }
    }
    qm_bytes file;
    const size_t start = write_typed(&file, 'F', 4, true, 4);
    qm_decoded decoded =
        qm_decode_limited(QM_FORMAT_PCD, file.data, file.size, (qm_codec_limits){POINTS, 1, 1, 100, NULL});
    assert_int_equal(decoded.status, QM_E_TOO_LARGE);
    assert_non_null(strstr(decoded.report.detail, "more than 100 bytes"));
    /* One literal becomes a reference to before the first byte. */
    file.data[start + 8] = 0x20;
    decoded = qm_decode(QM_FORMAT_PCD, file.data, file.size);
    assert_int_equal(decoded.status, QM_E_FORMAT);
    assert_non_null(strstr(decoded.report.detail, "are damaged"));
    assert_int_equal(decoded.report.offset, start + 8);
    /* The sizes do not fit the points. */
    file.data[start + 4]++;
    decoded = qm_decode(QM_FORMAT_PCD, file.data, file.size);
    assert_non_null(strstr(decoded.report.detail, "specifies 40 points of 17 bytes"));
}

static void faults_name_their_line(void **state)
{
    (void)state;
    static const qm_refusal refusals[] = {
        {"# .PCD\n", QM_E_FORMAT, 2, "no DATA line"},
        {"# .PCD\nwhat is it\n", QM_E_FORMAT, 2, "line 2 of the header starts with \"what\""},
        {HEAD "FIELDS x y z\n", QM_E_FORMAT, 4, "twice"},
        {"FIELDS x y z x\n", QM_E_FORMAT, 1, "twice"},
        {"SIZE 4 4 4\n", QM_E_FORMAT, 1, "must follow FIELDS"},
        {HEAD "SIZE 4 4\n", QM_E_FORMAT, 4, "line ends"},
        {HEAD "SIZE 4 4 4 4\n", QM_E_FORMAT, 4, "another number of values"},
        {HEAD "SIZE 4 4 3\n", QM_E_FORMAT, 4, "1, 2, 4 or 8"},
        {HEAD "TYPE F F\n", QM_E_FORMAT, 4, "another number of values"},
        {HEAD "TYPE F F G\n", QM_E_FORMAT, 4, "F, I or U"},
        {HEAD "COUNT 1 1 -1\n", QM_E_FORMAT, 4, "out of range"},
        {HEAD "COUNT 1 1 2\nDATA ascii\n", QM_E_FORMAT, 5, "the count 1"},
        {HEAD "SIZE 2 2 2\nDATA ascii\n", QM_E_FORMAT, 5, "size 4 or 8"},
        {HEAD "WIDTH -1\n", QM_E_FORMAT, 4, "negative"},
        {HEAD "DATA\n", QM_E_FORMAT, 4, "no encoding"},
        {HEAD "DATA zip\n", QM_E_UNSUPPORTED, 4, "encoding \"zip\""},
        {"FIELDS x y\nDATA ascii\n", QM_E_FORMAT, 2, "x, y and z"},
        {HEAD "WIDTH 3\nHEIGHT 1\nPOINTS 2\nDATA ascii\n", QM_E_FORMAT, 7, "WIDTH times HEIGHT"},
        {HEAD "POINTS 0\nDATA ascii\n", QM_E_EMPTY, 6, "no vertex"},
        {HEAD "WIDTH 9000000000000000000\nHEIGHT 9000000000000000000\nDATA ascii\n1 2 3\n", QM_E_FORMAT, 7,
         "room for 1"},
        {TEXT_HEAD "1 2 3         \n", QM_E_FORMAT, 13, "ends after 1 of 2 points"},
        {TEXT_HEAD "1 2 3\n4 5     \n", QM_E_FORMAT, 13, "a point has 3"},
        {TEXT_HEAD "1 2 3\n4 5 6 7\n", QM_E_FORMAT, 13, "more values than fields"},
        {TEXT_HEAD "1 2 3\n4 x 6\n", QM_E_FORMAT, 13, "expected a number"},
        {TEXT_HEAD "1 2 3\n4 1e999 6\n", QM_E_NOT_FINITE, 13, "too large"},
    };
    QM_CHECK_REFUSALS(QM_FORMAT_PCD, refusals);
    static const char nul[] = TEXT_HEAD "1 2 3\n4 5 \0\n";
    qm_decoded decoded = qm_decode(QM_FORMAT_PCD, nul, sizeof nul - 1);
    assert_int_equal(decoded.report.line, 13);
    assert_non_null(strstr(decoded.report.detail, "NUL"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(texts_are_read),
        cmocka_unit_test(points_that_were_not_seen_are_left_out),
        cmocka_unit_test(normals_are_kept),
        cmocka_unit_test(binary_files_have_every_type),
        cmocka_unit_test(binary_faults_name_their_byte),
        cmocka_unit_test(faults_name_their_line),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
