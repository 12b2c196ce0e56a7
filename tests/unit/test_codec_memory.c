/* Every allocation of every decoder failing in turn: a status, an empty mesh, and nothing left behind. */
#include <string.h>

#include "check.h"
#include "decode.h"
#include "failing_allocator.h"
#include "format/archive.h"

static qm_status decode_failing_at(qm_format format, const uint8_t *bytes, size_t size, size_t fail_at,
                                   size_t *calls)
{
    qm_failing_allocator allocator = {.fail_at = fail_at};
    qm_context ctx = qm_context_make();
    ctx.allocator = qm_failing_allocator_hook(&allocator);
    qm_codec_limits limits = {1000000, 1000000, 2, 0, NULL};
    qm_mesh mesh;
    qm_codec_report report;
    qm_status status = qm_codec_decode(&ctx, format, bytes, size, &limits, &mesh, &report);
    if (status != QM_OK) {
        assert_null(mesh.positions);
        assert_true(report.detail[0] != 0);
    }
    qm_mesh_reset(&ctx, &mesh);
    QM_CHECK(allocator.live_blocks == 0 && allocator.live_bytes == 0, "%s: %zu blocks left, failing at %zu",
             qm_format_name(format), allocator.live_blocks, fail_at);
    QM_CHECK(!allocator.mismatched, "%s: sizes do not match, failing at %zu", qm_format_name(format),
             fail_at);
    *calls = allocator.calls;
    return status;
}

static void check_every_failure(qm_format format, const void *bytes, size_t size)
{
    size_t calls, ignored;
    assert_int_equal(decode_failing_at(format, bytes, size, SIZE_MAX, &calls), QM_OK);
    assert_true(calls > 0);
    for (size_t fail_at = 0; fail_at < calls; ++fail_at) {
        qm_status status = decode_failing_at(format, bytes, size, fail_at, &ignored);
        QM_CHECK(status == QM_E_NO_MEMORY, "%s: %s, failing at %zu of %zu", qm_format_name(format),
                 qm_status_code(status), fail_at, calls);
    }
}

#define CHECK_TEXT(format, text) check_every_failure(format, text, strlen(text))

static void text_decoders_survive_every_failure(void **state)
{
    (void)state;
    CHECK_TEXT(QM_FORMAT_OBJ, "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nf 1 2 3 4\nf 1 2 3 4 5\n");
    CHECK_TEXT(QM_FORMAT_OFF, "OFF\n5 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n5 0 1 2 3 4\n");
    CHECK_TEXT(QM_FORMAT_XYZ, "0 0 0\n1 0 0\n");
    CHECK_TEXT(QM_FORMAT_PCD, "FIELDS x y z\nPOINTS 2\nDATA ascii\n0 0 0\n1 0 0\n");
    CHECK_TEXT(QM_FORMAT_PLY,
               "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\n"
               "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
               "0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n5 0 1 2 3 4\n");
    CHECK_TEXT(QM_FORMAT_STL, "solid\nfacet\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendfacet\nendsolid\n");
}

static void archives_survive_every_failure(void **state)
{
    (void)state;
    static const char model[] =
        "<model><resources><object id=\"1\"><mesh><vertices><vertex x=\"0\" y=\"0\" z=\"0\"/>"
        "<vertex x=\"1\" y=\"0\" z=\"0\"/><vertex x=\"0\" y=\"1\" z=\"0\"/></vertices><triangles>"
        "<triangle v1=\"0\" v2=\"1\" v3=\"2\"/></triangles></mesh></object><object id=\"2\"><components>"
        "<component objectid=\"1\"/></components></object></resources><build><item "
        "objectid=\"2\"/></build></model>";
    const qm_archive_file file = {"3D/3dmodel.model", model, strlen(model)};
    qm_text archive = {0};
    assert_int_equal(qm_archive_write(&file, 1, &archive), QM_OK);
    check_every_failure(QM_FORMAT_3MF, archive.data, archive.size);
    qm_text_reset(&archive);
}

static void compressed_points_survive_every_failure(void **state)
{
    (void)state;
    static const char file[] =
        "FIELDS x y z\nPOINTS 1\nDATA binary_compressed\n\15\0\0\0\14\0\0\0\13abcdefghijkl";
    check_every_failure(QM_FORMAT_PCD, file, sizeof file - 1);
}

static void growing_arrays_survive_every_failure(void **state)
{
    (void)state;
    enum { COUNT = 600 };
    static uint8_t file[84 + 50 * COUNT];
    file[80] = COUNT & 0xff;
    file[81] = COUNT >> 8;
    for (size_t i = 0; i < 3 * COUNT; ++i) {
        float x = (float)i;
        memcpy(file + 84 + 50 * (i / 3) + 12 + 12 * (i % 3), &x, sizeof x);
    }
    check_every_failure(QM_FORMAT_STL, file, sizeof file);
}

static void blocks_of_text_survive_every_failure(void **state)
{
    (void)state;
    static const char rows[2][29] = {"v 1.0000 2.0000 3.000000000\n", "f 1 2 3                    \n"};
    enum { VERTICES = 6000, FACES = 8000, ROW = 28 };
    static char text[(VERTICES + FACES) * ROW];
    for (size_t i = 0; i < VERTICES + FACES; ++i)
        memcpy(text + ROW * i, rows[i >= VERTICES], ROW);
    check_every_failure(QM_FORMAT_OBJ, text, sizeof text);
}

static void glb_decoder_survives_every_failure(void **state)
{
    (void)state;
    static const char json[] =
        "{\"buffers\":[{}],\"bufferViews\":[{\"buffer\":0,\"byteLength\":36}],\"accessors\":[{\"bufferView\":"
        "0,"
        "\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}],\"meshes\":[{\"primitives\":[{\"attributes\":"
        "{\"POSITION\":0}}]}],\"nodes\":[{\"children\":[1]},{\"mesh\":0}],\"scenes\":[{\"nodes\":[0]}]}";
    static const float positions[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    qm_bytes file = {.size = 0};
    qm_bytes_add_text(&file, "glTF");
    qm_bytes_add_u32(&file, 2);
    qm_bytes_add_u32(&file, (uint32_t)(12 + 8 + strlen(json) + 8 + 36));
    qm_bytes_add_u32(&file, (uint32_t)strlen(json));
    qm_bytes_add_text(&file, "JSON");
    qm_bytes_add_text(&file, json);
    qm_bytes_add_u32(&file, 36);
    qm_bytes_add(&file, "BIN", 4);
    qm_bytes_add_floats(&file, positions, 9);
    check_every_failure(QM_FORMAT_GLB, file.data, file.size);
}

static void draco_decoder_survives_every_failure(void **state)
{
    (void)state;
    /* A pentagon as three triangles with added edges, one vertex twice. */
    static const uint8_t pentagon_file[] = {
        0x44, 0x52, 0x41, 0x43, 0x4f, 0x02, 0x02, 0x01, 0x00, 0x00, 0x80, 0x01, 0x01, 0x01, 0x04, 0x6e,
        0x61, 0x6d, 0x65, 0x0b, 0x61, 0x64, 0x64, 0x65, 0x64, 0x5f, 0x65, 0x64, 0x67, 0x65, 0x73, 0x00,
        0x00, 0x00, 0x03, 0x06, 0x01, 0x00, 0x01, 0x02, 0x00, 0x03, 0x04, 0x00, 0x04, 0x05, 0x01, 0x02,
        0x00, 0x09, 0x03, 0x00, 0x00, 0x04, 0x02, 0x01, 0x00, 0x01, 0x02, 0x01, 0x00, 0x01, 0x01, 0x01,
        0x01, 0xad, 0x01, 0x1d, 0x27, 0xff, 0xff, 0x9f, 0x1d, 0x07, 0x1d, 0x07, 0x1d, 0x07, 0x91, 0x03,
        0x06, 0xbb, 0x99, 0x4c, 0xdc, 0xc1, 0x9d, 0x00, 0x00, 0x00, 0x00, 0xff, 0x00, 0x00, 0x00, 0xfe,
        0x01, 0x01, 0x01, 0x03, 0xad, 0x2a, 0x03, 0x55, 0x15, 0x03, 0x3a, 0x95, 0x8a, 0x00, 0x00, 0x00,
        0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x40, 0x40, 0x08};
    check_every_failure(QM_FORMAT_DRC, pentagon_file, sizeof pentagon_file);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(text_decoders_survive_every_failure),
        cmocka_unit_test(archives_survive_every_failure),
        cmocka_unit_test(compressed_points_survive_every_failure),
        cmocka_unit_test(growing_arrays_survive_every_failure),
        cmocka_unit_test(blocks_of_text_survive_every_failure),
        cmocka_unit_test(glb_decoder_survives_every_failure),
        cmocka_unit_test(draco_decoder_survives_every_failure),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
