/* OFF and XYZ files by hand: the forms of their heads, left-out columns, every fault with its line. */
#include <string.h>

#include "check.h"
#include "decode.h"

#define SQUARE "0 0 0\n1 0 0\n1 1 0\n0 1 0\n"

static void off_heads_come_in_every_form(void **state)
{
    (void)state;
    static const char *const texts[] = {
        "OFF\n4 1 4\n" SQUARE "4 0 1 2 3\n",
        "OFF 4 1 4\n" SQUARE "4 0 1 2 3",
        "off # comment\n# more\n\n4 1\n" SQUARE "\n# faces\n4 0 1 2 3 # the square\n",
        "OFF\r\n4 1 4\r\n0 0 0\r\n1 0 0\r\n1 1 0\r\n0 1 0\r\n4 0 1 2 3\r\n",
        "OFF\n4 1 4\n" SQUARE "4 0 1 2 3 0.5 0.5 0.5 1\n",
        "COFF\n4 1 4\n0 0 0 1 1 1 1\n1 0 0 1 1 1 1\n1 1 0 1 1 1 1\n0 1 0 1 1 1 1\n4 0 1 2 3\n",
        "NOFF\n4 1 4\n0 0 0 0 0 1\n1 0 0 0 0 1\n1 1 0 0 0 1\n0 1 0 0 0 1\n4 0 1 2 3\n",
    };
    static const uint32_t face[4] = {0, 1, 2, 3};
    for (size_t i = 0; i < sizeof texts / sizeof *texts; ++i) {
        qm_decoded decoded = qm_decode_text(QM_FORMAT_OFF, texts[i]);
        QM_CHECK(decoded.status == QM_OK, "case %zu: %s", i, decoded.report.detail);
        assert_int_equal(decoded.mesh.vertex_count, 4);
        assert_int_equal(decoded.mesh.face_count, 1);
        assert_memory_equal(decoded.mesh.faces, face, sizeof face);
        assert_int_equal(decoded.report.warning_count, 0);
        qm_decoded_free(&decoded);
    }
}

static void off_oddities_are_reported(void **state)
{
    (void)state;
    qm_decoded decoded = qm_decode_text(QM_FORMAT_OFF, "4 1 0\n" SQUARE "4 0 1 2 3\nmore\n");
    assert_int_equal(decoded.status, QM_OK);
    assert_true(qm_decoded_warns(&decoded, "word OFF"));
    assert_true(qm_decoded_warns(&decoded, "line 7"));
    qm_decoded_free(&decoded);

    decoded = qm_decode_text(QM_FORMAT_OFF, "OFF\n4 0 0\n" SQUARE);
    assert_int_equal(decoded.status, QM_OK);
    assert_int_equal(decoded.mesh.face_count, 0);
    qm_decoded_free(&decoded);
}

static void off_faults_name_their_line(void **state)
{
    (void)state;
    static const qm_refusal refusals[] = {
        {"# nothing\n", QM_E_EMPTY, 2, "no data"},
        {"OFF\n", QM_E_FORMAT, 2, "counts are missing"},
        {"OFF\n0 0 0\n", QM_E_EMPTY, 3, "no vertex"},
        {"OFF BINARY\n", QM_E_FORMAT, 11, "counts are missing"},
        {"OFF BINARY 0", QM_E_FORMAT, 12, "not followed by a line end"},
        {"4OFF\n", QM_E_UNSUPPORTED, 1, "\"4OFF\" has vertices of four coordinates"},
        {"STCN4OFF BINARY\n", QM_E_UNSUPPORTED, 1, "\"STCN4OFF\" has vertices of four coordinates"},
        {"nOFF\n3\n", QM_E_UNSUPPORTED, 1, "\"nOFF\" has vertices of n coordinates"},
        {"CnOFF\n3\n", QM_E_UNSUPPORTED, 1, "of n coordinates"},
        {"noff\n3\n", QM_E_FORMAT, 2, "line ends"},
        {"\xff\xfeO", QM_E_UNSUPPORTED, 1, "UTF-16"},
        {"what\n", QM_E_FORMAT, 1, "starts with \"what\", not with OFF or with counts"},
        {"OFF\n4\n", QM_E_FORMAT, 2, "line ends"},
        {"OFF\n-4 1 0\n", QM_E_FORMAT, 2, "negative"},
        {"OFF\n4 -1 0\n" SQUARE, QM_E_FORMAT, 2, "negative"},
        {"OFF\n9999999999 1 0\n" SQUARE, QM_E_FORMAT, 2, "specifies 9999999999 vertices"},
        {"OFF\n4 9999999999 0\n" SQUARE, QM_E_FORMAT, 2, "specifies 9999999999 faces"},
        {"OFF\n4 1 0\n0 0 0\n1 0\n", QM_E_FORMAT, 2, "specifies 4 vertices"},
        {"OFF\n4 1 0\n0 0 0\n1 0\n1 1 0\n0 1 0\n4 0 1 2 3\n", QM_E_FORMAT, 4, "line ends"},
        {"OFF\n4 1 0\n0.000 0.000 0.000\n1 0 0\n", QM_E_FORMAT, 5, "ends after 2 of 4 vertices"},
        {"OFF\n4 2 0\n" SQUARE "4 0 1 2 3\n", QM_E_FORMAT, 8, "ends after 1 of 2 faces"},
        {"OFF\n4 1 0\n" SQUARE "4 0 1 2\n", QM_E_FORMAT, 7, "line ends"},
        {"OFF\n4 1 0\n" SQUARE "4 0 1 2 4\n", QM_E_INDEX, 7, "vertex 4, but the file has 4 vertices"},
        {"OFF\n4 1 0\n" SQUARE "4 0 1 2 -1\n", QM_E_INDEX, 7, "vertex -1"},
        {"OFF\n4 1 0\n" SQUARE "2 0 1\n", QM_E_FORMAT, 7, "2 corners"},
        {"OFF\n4 1 0\n" SQUARE "-3 0 1\n", QM_E_FORMAT, 7, "0 corners"},
        {"OFF\n4 1 0\n0 0 0\n1 0 inf\n1 1 0\n0 1 0\n4 0 1 2 3\n", QM_E_NOT_FINITE, 4, "not a finite"},
    };
    QM_CHECK_REFUSALS(QM_FORMAT_OFF, refusals);
}

/** Appends a number as geomview writes it. */
static void add_big(qm_bytes *file, uint32_t value)
{
    qm_bytes_add_u32(file, __builtin_bswap32(value));
}

/** A square of one quad with a colour, and a pentagon; letters announce extras numbers behind each vertex. */
static void make_binary(qm_bytes *file, const char *head, int extras)
{
    static const float positions[5][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0.5f, 0.5f, 2}};
    file->size = 0;
    qm_bytes_add_text(file, head);
    for (uint32_t i = 0; i < 3; i++)
        add_big(file, (const uint32_t[]){5, 2, 7}[i]);
    for (int i = 0; i < 5; i++) {
        for (int axis = 0; axis < 3; axis++) {
            uint32_t bits;
            memcpy(&bits, &positions[i][axis], sizeof bits);
            add_big(file, bits);
        }
        for (int k = 0; k < extras; k++)
            add_big(file, 0x7fc00000);
    }
    static const uint32_t faces[] = {4, 0, 1, 2, 3, 3, 0, 0, 0, 5, 0, 1, 2, 3, 4, 0};
    for (size_t i = 0; i < sizeof faces / sizeof *faces; i++)
        add_big(file, faces[i]);
}

static void binary_off_is_read(void **state)
{
    (void)state;
    static const struct {
        const char *head;
        int extras;
    } cases[] = {{"OFF BINARY\n", 0},
                 {"off binary \r\n", 0},
                 {"# comment\nOFF BINARY\n", 0},
                 {"NOFF BINARY\n", 3},
                 {"COFF BINARY\n", 4},
                 {"CNOFF BINARY\n", 7},
                 {"STCNOFF BINARY\n", 9},
                 {"\xef\xbb\xbfSTOFF BINARY\n", 2}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        qm_bytes file;
        make_binary(&file, cases[i].head, cases[i].extras);
        qm_decoded decoded = qm_decode(QM_FORMAT_OFF, file.data, file.size);
        QM_CHECK(decoded.status == QM_OK, "case %zu: %s", i, decoded.report.detail);
        assert_int_equal(decoded.mesh.vertex_count, 5);
        assert_int_equal(decoded.mesh.face_count, 4);
        assert_int_equal(decoded.mesh.polygon_count, 1);
        assert_true(decoded.mesh.positions[14] == 2.0 && decoded.mesh.positions[12] == 0.5);
        assert_int_equal(decoded.mesh.faces[3], 3);
        qm_decoded_free(&decoded);
        /* Every file that is cut short is refused. */
        for (size_t size = strlen(cases[i].head); size < file.size; size++) {
            decoded = qm_decode(QM_FORMAT_OFF, file.data, size);
            QM_CHECK(decoded.status == QM_E_FORMAT && decoded.report.offset <= size, "case %zu: %zu: %s", i,
                     size, decoded.report.detail);
        }
    }
}

static void binary_off_faults_name_their_byte(void **state)
{
    (void)state;
    enum { HEAD = 11, COUNTS = HEAD + 12, FACES = COUNTS + 60 };
    static const struct {
        size_t place;
        uint32_t value;
        qm_status status;
        size_t offset;
        const char *words;
    } cases[] = {{HEAD, 0xffffffff, QM_E_FORMAT, COUNTS, "vertices is negative"},
                 {HEAD, 500, QM_E_FORMAT, COUNTS, "specifies 500 vertices"},
                 {HEAD + 4, 1000000, QM_E_FORMAT, COUNTS, "specifies 1000000 faces"},
                 {COUNTS + 8, 0x7f800000, QM_E_NOT_FINITE, COUNTS + 8, "not a finite"},
                 {FACES + 4, 5, QM_E_INDEX, FACES + 4, "vertex 5, but the file has 5"},
                 {FACES + 8, 0xffffffff, QM_E_INDEX, FACES + 8, "vertex -1"},
                 {FACES, 2, QM_E_FORMAT, FACES + 12, "2 corners"},
                 {FACES, 0xffffffff, QM_E_FORMAT, FACES + 4, "0 corners"},
                 {FACES + 20, 0xffffffff, QM_E_FORMAT, FACES + 24, "-1 components"},
                 {FACES + 20, 0x7fffffff, QM_E_FORMAT, FACES + 24, "components"}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        qm_bytes file;
        make_binary(&file, "OFF BINARY\n", 0);
        const uint32_t value = __builtin_bswap32(cases[i].value);
        memcpy(file.data + cases[i].place, &value, sizeof value);
        qm_decoded decoded = qm_decode(QM_FORMAT_OFF, file.data, file.size);
        QM_CHECK(decoded.status == cases[i].status && decoded.report.offset == cases[i].offset &&
                     strstr(decoded.report.detail, cases[i].words),
                 "case %zu: %zu: %s", i, decoded.report.offset, decoded.report.detail);
    }
    qm_bytes file;
    make_binary(&file, "OFF BINARY\n", 0);
    qm_bytes_add_u32(&file, 0);
    qm_decoded decoded = qm_decode(QM_FORMAT_OFF, file.data, file.size);
    assert_int_equal(decoded.status, QM_OK);
    assert_true(qm_decoded_warns(&decoded, "after the last face: 4"));
    qm_decoded_free(&decoded);
}

static void xyz_columns_are_set_apart_by_blanks_or_commas(void **state)
{
    (void)state;
    static const char *const texts[] = {
        "1 2 3\n4 5 6\n",
        "1\t2  3 255 255 255\n\n# comment\n4 5 6 # end\n",
        "1,2,3\n4,5,6",
        "1, 2, 3, 9\n4, 5, 6\n",
        "1 , 2 , 3\r\n4 , 5 , 6\r\n",
        "1 2 3\r4 5 6\r",
    };
    static const double positions[6] = {1, 2, 3, 4, 5, 6};
    for (size_t i = 0; i < sizeof texts / sizeof *texts; ++i) {
        qm_decoded decoded = qm_decode_text(QM_FORMAT_XYZ, texts[i]);
        QM_CHECK(decoded.status == QM_OK, "case %zu: %s", i, decoded.report.detail);
        assert_int_equal(decoded.mesh.vertex_count, 2);
        assert_int_equal(decoded.mesh.face_count, 0);
        assert_memory_equal(decoded.mesh.positions, positions, sizeof positions);
        qm_decoded_free(&decoded);
    }
}

static void xyz_faults_name_their_line(void **state)
{
    (void)state;
    static const qm_refusal refusals[] = {
        {"# nothing", QM_E_EMPTY, 1, "no vertex"},
        {"1 2 3\n1 2\n", QM_E_FORMAT, 2, "line ends"},
        {"x y z\n", QM_E_FORMAT, 1, "expected a number"},
        {"1 2 3\n1 nan 3\n", QM_E_NOT_FINITE, 2, "not a finite"},
        {"1,,3\n", QM_E_FORMAT, 1, "expected a number"},
        {"1;2;3\n", QM_E_FORMAT, 1, "expected a number"},
        {"1,5 2,5 3,5\n", QM_E_FORMAT, 1, "decimal commas"},
        {"1,5, 2,5, 3,5\n", QM_E_FORMAT, 1, "decimal commas"},
        {"1 2,5 3\n", QM_E_FORMAT, 1, "decimal commas"},
    };
    QM_CHECK_REFUSALS(QM_FORMAT_XYZ, refusals);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(off_heads_come_in_every_form),
        cmocka_unit_test(off_oddities_are_reported),
        cmocka_unit_test(off_faults_name_their_line),
        cmocka_unit_test(binary_off_is_read),
        cmocka_unit_test(binary_off_faults_name_their_byte),
        cmocka_unit_test(xyz_columns_are_set_apart_by_blanks_or_commas),
        cmocka_unit_test(xyz_faults_name_their_line),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
