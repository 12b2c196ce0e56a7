/*
 * The collection of broken and awkward files, where it is there: QM_TEST_DATA or ../shared/data. CASES.tsv
 * says of each what a reader must do with it; the formats folder holds one shape in every format.
 */
#include <stdio.h>
#include <string.h>

#include "check.h"
#include "data_mesh.h"
#include "decode.h"

/** For free. */
static uint8_t *read_file(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    QM_CHECK(file, "%s is missing", path);
    assert_int_equal(fseek(file, 0, SEEK_END), 0);
    long length = ftell(file);
    rewind(file);
    uint8_t *bytes = malloc((size_t)length + 1);
    assert_non_null(bytes);
    *size = fread(bytes, 1, (size_t)length, file);
    assert_int_equal(*size, length);
    fclose(file);
    return bytes;
}

static qm_decoded decode_file(const char *folder, const char *name)
{
    char path[512];
    size_t size;
    snprintf(path, sizeof path, "%s/%s/%s", qm_data_folder(), folder, name);
    uint8_t *bytes = read_file(path, &size);
    qm_decoded decoded = qm_decode(qm_format_from_path(name), bytes, size);
    free(bytes);
    return decoded;
}

/* A refusal's words and place are checked by qm_decode. */
static void check_case(const char *name, const char *expected)
{
    qm_decoded decoded = decode_file("nasty", name);
    if (strcmp(expected, "ok") == 0)
        QM_CHECK(decoded.status == QM_OK, "%s must load: %s", name, decoded.report.detail);
    else if (strcmp(expected, "bad") == 0)
        QM_CHECK(decoded.status != QM_OK, "%s must be refused", name);
    else
        QM_CHECK(strcmp(expected, "either") == 0, "%s: what does %s mean?", name, expected);
    qm_decoded_free(&decoded);
}

static void nasty_files_give_what_their_list_says(void **state)
{
    (void)state;
    char path[512], line[512], name[256], expected[16];
    int count = 0;
    snprintf(path, sizeof path, "%s/nasty/CASES.tsv", qm_data_folder());
    FILE *cases = fopen(path, "r");
    QM_CHECK(cases, "%s is missing", path);
    assert_non_null(fgets(line, sizeof line, cases));
    while (fgets(line, sizeof line, cases)) {
        assert_int_equal(sscanf(line, "%255[^\t]\t%15[^\t]", name, expected), 2);
        check_case(name, expected);
        ++count;
    }
    fclose(cases);
    assert_true(count > 0);
    print_message("%d nasty files\n", count);
}

static void one_shape_has_the_same_counts_in_every_format(void **state)
{
    (void)state;
    static const struct {
        const char *name;
        size_t vertices, faces;
        bool quads;
    } files[] = {
        {"wingnut.obj", 1075, 1073, true},
        {"wingnut_normals.obj", 1075, 1073, true},
        {"wingnut_tris.obj", 1075, 2146, false},
        {"wingnut.off", 1075, 1073, true},
        {"wingnut_ascii.ply", 1075, 1073, true},
        {"wingnut_le_float.ply", 1075, 1073, true},
        {"wingnut_be_double.ply", 1075, 1073, true},
        {"wingnut_ascii.stl", 1075, 2146, false},
        {"wingnut_binary.stl", 1075, 2146, false},
        {"wingnut.glb", 1075, 2146, false},
        {"wingnut_q0_sequential.drc", 1075, 2146, false},
        {"wingnut_q11_normals.drc", 1075, 2146, false},
        {"wingnut_q14_edgebreaker.drc", 1075, 2146, false},
        {"wingnut_points.drc", 1075, 0, false},
    };
    for (size_t i = 0; i < sizeof files / sizeof *files; ++i) {
        qm_decoded decoded = decode_file("formats", files[i].name);
        QM_CHECK(decoded.status == QM_OK, "%s: %s", files[i].name, decoded.report.detail);
        QM_CHECK(decoded.mesh.vertex_count == files[i].vertices && decoded.mesh.face_count == files[i].faces,
                 "%s: %zu vertices, %zu faces", files[i].name, decoded.mesh.vertex_count,
                 decoded.mesh.face_count);
        for (size_t face = 0; face < decoded.mesh.face_count; ++face)
            assert_int_equal(decoded.mesh.faces[4 * face + 3] != QM_NO_INDEX, files[i].quads);
        qm_box box = qm_mesh_bounding_box(&decoded.mesh);
        QM_CHECK(qm_mesh_box_diagonal(&box) > 8.83 && qm_mesh_box_diagonal(&box) < 8.84, "%s: diagonal %g",
                 files[i].name, qm_mesh_box_diagonal(&box));
        qm_decoded_free(&decoded);
    }
    static const char *const broken[] = {"wingnut_bad_magic.drc", "wingnut_truncated.drc"};
    for (size_t i = 0; i < 2; ++i)
        assert_int_equal(decode_file("formats", broken[i]).status, QM_E_FORMAT);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nasty_files_give_what_their_list_says),
        cmocka_unit_test(one_shape_has_the_same_counts_in_every_format),
    };
    return qm_data_run_group_tests(tests);
}
