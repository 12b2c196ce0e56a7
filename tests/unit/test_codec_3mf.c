/* 3MF packages that are made here: objects in objects, in several models, mirrored; every fault with its place. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "check.h"
#include "decode.h"
#include "format/archive.h"
#include "format/encoder.h"

#define CORE "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
#define PRODUCTION "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
#define MODEL "<model xmlns=\"" CORE "\" xmlns:p=\"" PRODUCTION "\">"
#define CORNERS                                                                                              \
    "<vertices><vertex x=\"0\" y=\"0\" z=\"0\"/><vertex x=\"1\" y=\"0\" z=\"0\"/>"                           \
    "<vertex x=\"0\" y=\"1\" z=\"0\"/></vertices>"
#define MESH "<mesh>" CORNERS "<triangles><triangle v1=\"0\" v2=\"1\" v3=\"2\"/></triangles></mesh>"
#define OBJECT "<resources><object id=\"7\">" MESH "</object></resources>"
#define ONE MODEL OBJECT "<build><item objectid=\"7\"/></build></model>"
#define RELATIONS(target)                                                                                    \
    "<Relationships xmlns=\"http://schemas.openxmlformats.org/package/2006/relationships\">"                 \
    "<Relationship Id=\"t\" Type=\"http://example.org/thumbnail\" Target=\"/t.png\"/>"                       \
    "<Relationship Id=\"m\" Type=\"http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel\" "          \
    "Target=\"" target "\"/></Relationships>"

static qm_decoded decode_files(const qm_archive_file *files, size_t count, const qm_codec_limits *limits)
{
    qm_text archive = {0};
    assert_int_equal(qm_archive_write(files, count, &archive), QM_OK);
    assert_int_equal(qm_format_sniff((const uint8_t *)archive.data, archive.size), QM_FORMAT_3MF);
    qm_decoded decoded = limits ? qm_decode_limited(QM_FORMAT_3MF, archive.data, archive.size, *limits)
                                : qm_decode(QM_FORMAT_3MF, archive.data, archive.size);
    qm_text_reset(&archive);
    return decoded;
}

static qm_decoded decode_model(const char *model)
{
    const qm_archive_file file = {"3D/3dmodel.model", model, strlen(model)};
    return decode_files(&file, 1, NULL);
}

static void check_mesh(qm_decoded *decoded, size_t vertices, size_t faces, const char *name)
{
    QM_CHECK(decoded->status == QM_OK, "%s: %s", name, decoded->report.detail);
    assert_int_equal(decoded->mesh.vertex_count, vertices);
    assert_int_equal(decoded->mesh.face_count, faces);
}

static void models_are_read(void **state)
{
    (void)state;
    static const char *const models[] = {
        ONE,
        "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<!-- c -->" ONE "\n",
        "<model>" OBJECT "<build><item objectid=\" 7 \"/></build></model>",
        "<a:model xmlns:a=\"" CORE "\" requiredextensions=\"\"><a:resources><a:object id=\"7\"><a:mesh>"
        "<a:vertices><a:vertex x=\"0\" y=\"0\" z=\"0\"/><a:vertex y=\"0\" z=\"0\" x=\"1\"/>"
        "<a:vertex x=\"0\" y=\"1e0\" z=\"0\"/></a:vertices><a:triangles><a:triangle v1=\"0\" v2=\"1\" "
        "v3=\"2\" p1=\"4\"/>"
        "</a:triangles></a:mesh></a:object></a:resources><a:build><a:item "
        "objectid=\"7\"/></a:build></a:model>",
    };
    static const double positions[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    for (size_t i = 0; i < sizeof models / sizeof *models; i++) {
        qm_decoded decoded = decode_model(models[i]);
        check_mesh(&decoded, 3, 1, models[i]);
        assert_int_equal(decoded.report.warning_count, 0);
        assert_memory_equal(decoded.mesh.positions, positions, sizeof positions);
        assert_memory_equal(decoded.mesh.faces, ((uint32_t[4]){0, 1, 2, QM_NO_INDEX}), 4 * sizeof(uint32_t));
        qm_decoded_free(&decoded);
    }
}

static void objects_stand_where_the_build_has_them(void **state)
{
    (void)state;
    static const char model[] = MODEL
        "<resources><object id=\"7\">" MESH "</object>"
        "<object id=\"9\"><components><component objectid=\"7\" transform=\"2 0 0 0 1 0 0 0 1 10 0 0\"/>"
        "<component objectid=\"7\" transform=\"-1 0 0 0 1 0 0 0 1 0 0 5\"/></components></object></resources>"
        "<build><item objectid=\"9\" transform=\"0 1 0 -1 0 0 0 0 1 0 0 100\"/><item "
        "objectid=\"7\"/></build></model>";
    /* The first component: x doubled, moved by 10 along x; then a quarter turn, x to y, and 100 up. */
    static const double first[9] = {0, 10, 100, 0, 12, 100, -1, 10, 100};
    qm_decoded decoded = decode_model(model);
    check_mesh(&decoded, 9, 3, "components");
    assert_memory_equal(decoded.mesh.positions, first, sizeof first);
    assert_memory_equal(decoded.mesh.faces, ((uint32_t[4]){0, 1, 2, QM_NO_INDEX}), 4 * sizeof(uint32_t));
    /* The mirrored one keeps its outside. */
    assert_memory_equal(decoded.mesh.faces + 4, ((uint32_t[4]){3, 5, 4, QM_NO_INDEX}), 4 * sizeof(uint32_t));
    assert_true(decoded.mesh.positions[3 * 6 + 2] == 0.0);
    qm_decoded_free(&decoded);
}

static void models_refer_to_others(void **state)
{
    (void)state;
    static const char relations[] = RELATIONS("/3D/a.model"), other[] = MODEL OBJECT "<build/></model>";
    static const char first[] = MODEL
        "<resources><object id=\"1\"><components><component p:path=\"/3D/Objects/b.model\" objectid=\"7\"/>"
        "</components></object></resources><build><item objectid=\"1\"/><item objectid=\"7\" "
        "p:path=\"/3D/Objects/b.model\" transform=\"1 0 0 0 1 0 0 0 1 0 0 1\"/></build></model>";
    const qm_archive_file files[] = {{"_rels/.rels", relations, strlen(relations)},
                                     {"3D/Objects/B.model", other, strlen(other)},
                                     {"3D/a.model", first, strlen(first)}};
    qm_decoded decoded = decode_files(files, 3, NULL);
    check_mesh(&decoded, 6, 2, "two models");
    qm_decoded_free(&decoded);
    decoded = decode_files(files, 2, NULL);
    assert_int_equal(decoded.status, QM_E_FORMAT);
    assert_non_null(strstr(decoded.report.detail, "no 3D model"));
    decoded = decode_files((const qm_archive_file[]){files[0], files[2]}, 2, NULL);
    assert_int_equal(decoded.status, QM_E_FORMAT);
    assert_non_null(strstr(decoded.report.detail, "no file 3D/Objects/b.model"));
}

static void faults_have_their_place(void **state)
{
    (void)state;
    static const struct {
        const char *model;
        qm_status status;
        size_t line;
        const char *words;
    } cases[] = {
        {"<model>\n\n<resources>", QM_E_FORMAT, 3, "no element found"},
        {"<model>\n<a></b></model>", QM_E_FORMAT, 2, "mismatched tag"},
        {MODEL "\n<model unit=\"inch\"/></model>", QM_E_FORMAT, 2, "a model inside another element"},
        {"<!DOCTYPE model [<!ENTITY a \"b\">]>" ONE, QM_E_FORMAT, 1, "document type"},
        {MODEL "\n<resources><object id=\"7\"><mesh><vertices>\n<vertex x=\"0\" y=\"1\"/>", QM_E_FORMAT, 3,
         "a vertex has no z"},
        {MODEL "<resources><object id=\"7\"><mesh><vertices>\n<vertex x=\"0\" y=\"b\" z=\"0\"/>", QM_E_FORMAT,
         2, "number"},
        {MODEL "<resources><object id=\"7\"><mesh><vertices>\n<vertex x=\"0\" y=\"nan\" z=\"0\"/>",
         QM_E_NOT_FINITE, 2, ""},
        {MODEL "<resources><object id=\"7\"><mesh><vertices>\n<vertex x=\"0 1\" y=\"0\" z=\"0\"/>",
         QM_E_FORMAT, 2, "more than 1"},
        {MODEL "<resources><object id=\"7\"><mesh>" CORNERS
               "\n<triangles><triangle v1=\"0\" v2=\"3\" v3=\"1\"/>",
         QM_E_INDEX, 2, "refers to vertex 3, but its object has 3"},
        {MODEL "<resources><object id=\"7\"><mesh>" CORNERS
               "\n<triangles><triangle v1=\"0\" v2=\"-1\" v3=\"1\"/>",
         QM_E_FORMAT, 2, "v2 of a triangle must be an integer"},
        {MODEL "<resources><object>", QM_E_FORMAT, 1, "id of an object"},
        {MODEL OBJECT "\n<build><item objectid=\"8\"/></build></model>", QM_E_FORMAT, 2, "no object 8"},
        {MODEL OBJECT "\n<build><item objectid=\"7\" transform=\"1 0 0\"/></build></model>", QM_E_FORMAT, 2,
         ""},
        {MODEL OBJECT "<build></build></model>", QM_E_EMPTY, QM_NO_LOCATION, "no item"},
        {"<model xmlns=\"" CORE
         "\" xmlns:b=\"http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02\""
         " requiredextensions=\"b\">",
         QM_E_UNSUPPORTED, 1, "beamlattice"},
        {"<model requiredextensions=\"zz\">", QM_E_UNSUPPORTED, 1, "zz"},
        {MODEL "<resources><object id=\"7\"><components><component objectid=\"7\"/></components></object>"
               "</resources><build>\n<item objectid=\"7\"/></build></model>",
         QM_E_TOO_LARGE, 1, "64 levels"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        qm_decoded decoded = decode_model(cases[i].model);
        QM_CHECK(decoded.status == cases[i].status && strstr(decoded.report.detail, cases[i].words) &&
                     decoded.report.line == cases[i].line,
                 "case %zu: status %d, line %zu: %s", i, (int)decoded.status, decoded.report.line,
                 decoded.report.detail);
        qm_decoded_free(&decoded);
    }
}

/** Each object has the one before it twice: 2^40 places for some kilobytes. */
static void objects_do_not_multiply_without_end(void **state)
{
    (void)state;
    qm_text model = {0};
    qm_text_add_string(&model, MODEL "<resources><object id=\"0\">" MESH "</object>");
    for (int i = 1; i <= 40; i++)
        qm_text_printf(
            &model,
            "<object id=\"%d\"><components><component objectid=\"%d\"/><component objectid=\"%d\"/>"
            "</components></object>",
            i, i - 1, i - 1);
    qm_text_add_string(&model, "</resources><build><item objectid=\"40\"/></build></model>");
    char *text = qm_text_take(&model);
    qm_decoded decoded = decode_model(text);
    assert_int_equal(decoded.status, QM_E_TOO_LARGE);
    qm_decoded_free(&decoded);
    free(text);
}

/** Elements in elements, and one that does not end, take memory of the parser. */
static void the_parser_has_little_memory(void **state)
{
    (void)state;
    enum { COUNT = 1 << 20 };
    for (int kind = 0; kind < 3; kind++) {
        qm_text model = {0};
        qm_text_add_string(&model, kind == 1 ? "<model unit=\"" : "<model>");
        for (int i = 0; i < COUNT && kind < 2; i++)
            qm_text_add_string(&model, kind == 0 ? "<a>" : "aaaaa");
        for (int i = 0; i < COUNT / 4 && kind == 2; i++)
            qm_text_printf(&model, "<name%d/>", i);
        char *text = qm_text_take(&model);
        qm_decoded decoded = decode_model(text);
        QM_CHECK(decoded.status == QM_E_TOO_LARGE && strstr(decoded.report.detail, "bytes"), "%s",
                 decoded.report.detail);
        qm_decoded_free(&decoded);
        free(text);
    }
}

static void archives_have_limits(void **state)
{
    (void)state;
    const qm_archive_file file = {"3D/3dmodel.model", ONE, strlen(ONE)};
    qm_codec_limits limits = {.max_vertices = 3, .max_faces = 1, .thread_count = 1, .max_size = strlen(ONE)};
    qm_decoded decoded = decode_files(&file, 1, &limits);
    check_mesh(&decoded, 3, 1, "as much as it may");
    qm_decoded_free(&decoded);
    limits.max_size--;
    decoded = decode_files(&file, 1, &limits);
    assert_int_equal(decoded.status, QM_E_TOO_LARGE);
    limits.max_size = 0;
    limits.max_vertices = 2;
    decoded = decode_files(&file, 1, &limits);
    assert_int_equal(decoded.status, QM_E_TOO_LARGE);
}

/** Each byte of an archive is changed, and each prefix read. */
static void damaged_archives_are_refused(void **state)
{
    (void)state;
    const qm_archive_file file = {"3D/3dmodel.model", ONE, strlen(ONE)};
    qm_text archive = {0};
    assert_int_equal(qm_archive_write(&file, 1, &archive), QM_OK);
    for (size_t i = 0; i < archive.size; i++) {
        qm_decoded decoded = qm_decode(QM_FORMAT_3MF, archive.data, i);
        QM_CHECK(decoded.status != QM_OK && decoded.report.detail[0], "%zu bytes", i);
        qm_decoded_free(&decoded);
        archive.data[i] ^= 0x10;
        decoded = qm_decode(QM_FORMAT_3MF, archive.data, archive.size);
        if (decoded.status == QM_OK) /* a date, or the version that made it */
            check_mesh(&decoded, 3, 1, "an archive with a changed byte");
        qm_decoded_free(&decoded);
        archive.data[i] ^= 0x10;
    }
    qm_text_reset(&archive);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(models_are_read),
        cmocka_unit_test(objects_stand_where_the_build_has_them),
        cmocka_unit_test(models_refer_to_others),
        cmocka_unit_test(faults_have_their_place),
        cmocka_unit_test(objects_do_not_multiply_without_end),
        cmocka_unit_test(the_parser_has_little_memory),
        cmocka_unit_test(archives_have_limits),
        cmocka_unit_test(damaged_archives_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
