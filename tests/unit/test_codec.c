/* Format names, sniffing, and what is common to decoders: limits, canceling, faults of the whole file. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "decode.h"
#include "random.h"

static void formats_are_found_by_name_path_and_media_type(void **state)
{
    (void)state;
    assert_int_equal(qm_format_from_name("ply"), QM_FORMAT_PLY);
    assert_int_equal(qm_format_from_name("OBJ"), QM_FORMAT_OBJ);
    assert_int_equal(qm_format_from_name("pl"), QM_FORMAT_UNKNOWN);
    assert_int_equal(qm_format_from_name(""), QM_FORMAT_UNKNOWN);
    assert_int_equal(qm_format_from_path("a.b/part.STL"), QM_FORMAT_STL);
    assert_int_equal(qm_format_from_path("no_extension"), QM_FORMAT_UNKNOWN);
    assert_int_equal(qm_format_from_path("a.b/scan.ply.gz"), QM_FORMAT_PLY);
    assert_int_equal(qm_format_from_path("SCAN.PLY.GZ"), QM_FORMAT_PLY);
    assert_int_equal(qm_format_from_path(".gz"), QM_FORMAT_UNKNOWN);
    assert_int_equal(qm_format_from_path("scan.a_long_one"), QM_FORMAT_UNKNOWN);
    assert_int_equal(qm_format_from_path("mesh.objx"), QM_FORMAT_UNKNOWN);
    assert_int_equal(qm_format_from_media_type("model/gltf-binary"), QM_FORMAT_GLB);
    assert_int_equal(qm_format_from_media_type("Model/OBJ; charset=utf-8"), QM_FORMAT_OBJ);
    assert_int_equal(qm_format_from_media_type("model/ob"), QM_FORMAT_UNKNOWN);
    assert_string_equal(qm_format_name(QM_FORMAT_XYZ), "xyz");
    assert_string_equal(qm_format_name(QM_FORMAT_UNKNOWN), "unknown");
}

static void text_formats_are_told_by_their_first_row(void **state)
{
    (void)state;
    static const struct {
        const char *text;
        qm_format format;
    } cases[] = {
        {"DRACO\2\2", QM_FORMAT_DRC},
        {"glTF\2", QM_FORMAT_GLB},
        {"ply\nformat ascii 1.0\n", QM_FORMAT_PLY},
        {"solid part\nfacet", QM_FORMAT_STL},
        {"# from somewhere\n\nv 0 0 0\n", QM_FORMAT_OBJ},
        {"\xef\xbb\xbfmtllib a.mtl\n", QM_FORMAT_OBJ},
        {"OFF\n3 1 0\n", QM_FORMAT_OFF},
        {"COFF 3 1 0\n", QM_FORMAT_OFF},
        {"0.5 1 2\n", QM_FORMAT_XYZ},
        {"1, 2, 3, 255\n4, 5, 6, 0\n", QM_FORMAT_XYZ},
        {"1 2 3\n4 5 6\n", QM_FORMAT_XYZ},
        {"3 1 0\n0.0 0 0\n", QM_FORMAT_UNKNOWN}, /* points, or OFF without its word */
        {"1 2\n", QM_FORMAT_UNKNOWN},
        {"hello\n", QM_FORMAT_UNKNOWN},
        {"# only a comment", QM_FORMAT_UNKNOWN},
        {"", QM_FORMAT_UNKNOWN},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        qm_format found = qm_format_sniff((const uint8_t *)cases[i].text, strlen(cases[i].text));
        QM_CHECK(found == cases[i].format, "case %zu: %s", i, qm_format_name(found));
    }
}

static void binary_stl_is_told_by_its_size(void **state)
{
    (void)state;
    uint8_t file[84 + 50] = "solid, but binary";
    file[80] = 1;
    assert_int_equal(qm_format_sniff(file, sizeof file), QM_FORMAT_STL);
    memset(file, 0, 80);
    assert_int_equal(qm_format_sniff(file, sizeof file), QM_FORMAT_STL);
    assert_int_equal(qm_format_sniff(file, sizeof file - 1), QM_FORMAT_UNKNOWN);
}

static void empty_and_unknown_files_are_refused(void **state)
{
    (void)state;
    for (qm_format format = QM_FORMAT_OBJ; format <= QM_FORMAT_XYZ; ++format) {
        qm_decoded decoded = qm_decode(format, "", 0);
        assert_int_equal(decoded.status, QM_E_EMPTY);
    }
    qm_context ctx = qm_context_make();
    qm_codec_limits limits = {1, 1, 1, 0, NULL};
    qm_mesh mesh;
    qm_codec_report report;
    assert_int_equal(
        qm_codec_decode(&ctx, QM_FORMAT_UNKNOWN, (const uint8_t *)"v", 1, &limits, &mesh, &report),
        QM_E_UNSUPPORTED);
    assert_non_null(strstr(report.detail, "is unknown"));
}

static void formats_that_are_not_read_are_named(void **state)
{
    (void)state;
    static const char *const files[][2] = {
        {"# vtk DataFile Version 3.0\ntitle\nASCII\n", "VTK"},
        {"$MeshFormat\n4.1 0 8\n", "Gmsh"},
        {"\xef\xbb\xbf<?xml version=\"1.0\"?>\n  <COLLADA xmlns=\"a\">", "COLLADA"},
        {"<?xml version=\"1.0\"?><VTKFile type=\"PolyData\">", "VTK"},
        {"<?xml version=\"1.0\"", "XML"},
        {"\n<!DOCTYPE html>", "HTML"},
        {"Kaydara FBX Binary  ", "FBX"},
    };
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        size_t size = strlen(files[i][0]);
        qm_format format = qm_format_sniff((const uint8_t *)files[i][0], size);
        assert_int_equal(format, QM_FORMAT_UNKNOWN);
        qm_decoded decoded = qm_decode(format, files[i][0], size);
        assert_int_equal(decoded.status, QM_E_UNSUPPORTED);
        QM_CHECK(strstr(decoded.report.detail, files[i][1]) && strstr(decoded.report.detail, " ply obj"),
                 "%s", decoded.report.detail);
    }
}

static void limits_are_kept(void **state)
{
    (void)state;
    static const char triangle[] = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    static const char pentagon[] = "v 0 0 0\nv 1 0 0\nv 2 1 0\nv 1 2 0\nv 0 1 0\nf 1 2 3 4 5\n";
    qm_decoded decoded =
        qm_decode_limited(QM_FORMAT_OBJ, triangle, strlen(triangle), (qm_codec_limits){3, 1, 1, 0, NULL});
    assert_int_equal(decoded.status, QM_OK);
    qm_decoded_free(&decoded);
    decoded =
        qm_decode_limited(QM_FORMAT_OBJ, triangle, strlen(triangle), (qm_codec_limits){2, 1, 1, 0, NULL});
    assert_int_equal(decoded.status, QM_E_TOO_LARGE);
    assert_int_equal(decoded.report.line, 3);
    decoded =
        qm_decode_limited(QM_FORMAT_OBJ, triangle, strlen(triangle), (qm_codec_limits){3, 0, 1, 0, NULL});
    assert_int_equal(decoded.status, QM_E_TOO_LARGE);
    assert_int_equal(decoded.report.line, 4);
    /* The fan of a pentagon counts as three. */
    decoded =
        qm_decode_limited(QM_FORMAT_OBJ, pentagon, strlen(pentagon), (qm_codec_limits){5, 2, 1, 0, NULL});
    assert_int_equal(decoded.status, QM_E_TOO_LARGE);
}

static void raised_flag_cancels(void **state)
{
    (void)state;
    static const char text[] = "v 0 0 0\n";
    atomic_bool cancel = true;
    qm_context ctx = qm_context_make();
    ctx.cancel = &cancel;
    qm_codec_limits limits = {10, 10, 1, 0, NULL};
    qm_mesh mesh;
    qm_codec_report report;
    assert_int_equal(
        qm_codec_decode(&ctx, QM_FORMAT_OBJ, (const uint8_t *)text, strlen(text), &limits, &mesh, &report),
        QM_E_CANCELED);
    assert_null(mesh.positions);
}

static void span_that_overflows_is_refused(void **state)
{
    (void)state;
    qm_decoded decoded = qm_decode_text(QM_FORMAT_XYZ, "-1.7e308 0 0\n1.7e308 0 0\n");
    assert_int_equal(decoded.status, QM_E_NOT_FINITE);
    assert_non_null(strstr(decoded.report.detail, "far apart"));
}

/** A number as files have it, or a little different. */
static void print_number(qm_random *random, char *out, size_t size)
{
    double number = qm_random_range(random, -1, 1) * (qm_random_below(random, 4) == 0 ? 1e4 : 1.0);
    int digits = (int)qm_random_below(random, 18);
    switch (qm_random_below(random, 4)) {
    case 0:
        snprintf(out, size, "%.*g", digits, number);
        break;
    case 1:
        snprintf(out, size, "%d", (int)number);
        break;
    default:
        snprintf(out, size, "%.*f", digits, number);
    }
}

/** A mesh of random triangles and quads in a text format, now and then with a byte that belongs elsewhere. */
static void print_mesh(qm_random *random, qm_format format, char *out, size_t size)
{
    enum { VERTICES = 12, FACES = 10 };
    char *at = out, *end = out + size;
    if (format == QM_FORMAT_OFF) at += snprintf(at, size, "OFF\n%d %d 0\n", VERTICES, FACES);
    if (format == QM_FORMAT_PLY)
        at += snprintf(at, size,
                       "ply\nformat ascii 1.0\nelement vertex %d\nproperty float x\nproperty float y\n"
                       "property float z\nelement face %d\nproperty list uchar int vertex_index\n"
                       "end_header\n",
                       VERTICES, FACES);
    char *rows = at;
    for (int i = 0; i < VERTICES; i++) {
        char number[3][40];
        for (int k = 0; k < 3; k++)
            print_number(random, number[k], sizeof number[k]);
        at += snprintf(at, (size_t)(end - at), "%s%s %s %s%s", format == QM_FORMAT_OBJ ? "v " : "", number[0],
                       number[1], number[2], qm_random_below(random, 9) == 0 ? "\r\n" : "\n");
    }
    for (int i = 0; i < FACES; i++) {
        int corners = 3 + (int)qm_random_below(random, qm_random_below(random, 5) == 0 ? 4 : 2);
        at += format == QM_FORMAT_OBJ ? snprintf(at, (size_t)(end - at), "f")
                                      : snprintf(at, (size_t)(end - at), "%d", corners);
        for (int k = 0; k < corners; k++)
            at += snprintf(at, (size_t)(end - at), " %d",
                           (int)qm_random_below(random, VERTICES) + (format == QM_FORMAT_OBJ));
        at += snprintf(at, (size_t)(end - at), "\n");
    }
    const char strange[] = "/-+.,e#\\x3\n\r\x80\xff";
    if (qm_random_below(random, 2) == 0)
        rows[qm_random_below(random, (uint32_t)(at - rows))] =
            strange[qm_random_below(random, sizeof strange - 1)];
}

/** Decodes from a block that ends with the text, so that a sanitizer sees reads beyond it. */
static qm_decoded decode_exactly(qm_format format, const char *text)
{
    size_t size = strlen(text);
    char *copy = malloc(size);
    assert_non_null(copy);
    memcpy(copy, text, size);
    qm_decoded decoded = qm_decode(format, copy, size);
    free(copy);
    return decoded;
}

/** With tabs for blanks the fast paths are not taken. */
static void fast_and_slow_paths_agree(void **state)
{
    (void)state;
    static const qm_format formats[] = {QM_FORMAT_OBJ, QM_FORMAT_OFF, QM_FORMAT_PLY};
    uint64_t seed = qm_check_seed();
    qm_random random = qm_random_make(seed, 3);
    int good = 0;
    for (int round = 0; round < 6000; ++round) {
        char text[4096];
        const qm_format format = formats[round % 3];
        print_mesh(&random, format, text, sizeof text);
        qm_decoded fast = decode_exactly(format, text);
        char *rows = strstr(text, "end_header");
        for (char *at = rows ? rows : text; *at; at++)
            if (*at == ' ') *at = '\t';
        qm_decoded slow = decode_exactly(format, text);
        QM_CHECK(fast.status == slow.status && fast.report.line == slow.report.line &&
                     strcmp(fast.report.detail, slow.report.detail) == 0,
                 "round %d: status %d at %zu (%s), not %d at %zu (%s), seed %" PRIu64, round, fast.status,
                 fast.report.line, fast.report.detail, slow.status, slow.report.line, slow.report.detail,
                 seed);
        QM_CHECK(fast.mesh.vertex_count == slow.mesh.vertex_count &&
                     fast.mesh.face_count == slow.mesh.face_count &&
                     fast.report.warning_count == slow.report.warning_count,
                 "round %d: counts differ, seed %" PRIu64, round, seed);
        if (fast.status == QM_OK) {
            good++;
            assert_memory_equal(fast.mesh.positions, slow.mesh.positions,
                                3 * fast.mesh.vertex_count * sizeof *fast.mesh.positions);
            assert_memory_equal(fast.mesh.faces, slow.mesh.faces,
                                4 * fast.mesh.face_count * sizeof *fast.mesh.faces);
        }
        qm_decoded_free(&fast);
        qm_decoded_free(&slow);
    }
    QM_CHECK(good > 2000, "only %d of the files were good, seed %" PRIu64, good, seed);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(formats_are_found_by_name_path_and_media_type),
        cmocka_unit_test(text_formats_are_told_by_their_first_row),
        cmocka_unit_test(binary_stl_is_told_by_its_size),
        cmocka_unit_test(empty_and_unknown_files_are_refused),
        cmocka_unit_test(formats_that_are_not_read_are_named),
        cmocka_unit_test(limits_are_kept),
        cmocka_unit_test(raised_flag_cancels),
        cmocka_unit_test(span_that_overflows_is_refused),
        cmocka_unit_test(fast_and_slow_paths_agree),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
