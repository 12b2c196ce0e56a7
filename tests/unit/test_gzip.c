/* Files that are compressed with gzip: members, damage, limits, and what is kept of them when they are loaded. */
#include "format/gzip.h"

#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "failing_allocator.h"
#include "ops/mesh_load.h"

#define SQUARE "OFF\n4 1 4\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n"

/* gzip.compress(SQUARE, mtime=0) of Python. */
static const uint8_t packed[] = {0x1f, 0x8b, 0x08, 0x00, 0x00, 0x00, 0x00, 0x00, 0x02, 0x03, 0xf3, 0x77, 0x73,
                                 0xe3, 0x32, 0x51, 0x30, 0x54, 0x30, 0xe1, 0x32, 0x50, 0x00, 0x42, 0x2e, 0x43,
                                 0x28, 0x09, 0xa4, 0x81, 0x22, 0x20, 0xd2, 0x44, 0x01, 0x44, 0x1b, 0x29, 0x18,
                                 0x73, 0x01, 0x00, 0xdd, 0x29, 0xf2, 0x84, 0x2c, 0x00, 0x00, 0x00};

/** Inflates a copy of the bytes on the heap, where the sanitizer sees a read past the end. */
static qm_status inflate_copy(qm_context *ctx, const void *bytes, size_t size, size_t max_size,
                              qm_gzip_content *out, qm_codec_report *report)
{
    uint8_t *copy = malloc(size);
    assert_non_null(copy);
    memcpy(copy, bytes, size);
    *report = (qm_codec_report){.line = QM_NO_LOCATION, .offset = QM_NO_LOCATION};
    qm_status status = qm_gzip_inflate(ctx, copy, size, max_size, out, report);
    size_t measured;
    qm_codec_report other = {.line = QM_NO_LOCATION, .offset = QM_NO_LOCATION};
    if (status != QM_E_NO_MEMORY) {
        assert_int_equal(qm_gzip_measure(ctx, copy, size, max_size, &measured, &other), status);
        assert_string_equal(other.detail, report->detail);
        if (status == QM_OK) assert_int_equal(measured, out->size);
    }
    free(copy);
    if (status != QM_OK) {
        assert_null(out->bytes);
        assert_true(report->detail[0] != 0 && report->line == QM_NO_LOCATION);
    }
    return status;
}

static void members_are_joined(void **state)
{
    (void)state;
    uint8_t file[3 * sizeof packed];
    qm_context ctx = qm_context_make();
    for (size_t count = 1; count <= 3; count++) {
        qm_gzip_content content;
        qm_codec_report report;
        memcpy(file + (count - 1) * sizeof packed, packed, sizeof packed);
        assert_true(qm_gzip_is_packed(file, count * sizeof packed));
        assert_int_equal(inflate_copy(&ctx, file, count * sizeof packed, 0, &content, &report), QM_OK);
        assert_int_equal(content.size, count * strlen(SQUARE));
        for (size_t i = 0; i < count; i++)
            assert_memory_equal(content.bytes + i * strlen(SQUARE), SQUARE, strlen(SQUARE));
        assert_true(report.offset == QM_NO_LOCATION);
        qm_gzip_content_free(&ctx, &content);
    }
    assert_false(qm_gzip_is_packed((const uint8_t *)SQUARE, strlen(SQUARE)));
    assert_false(qm_gzip_is_packed(packed, 2));
}

static void every_truncation_names_its_byte(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    for (size_t size = QM_GZIP_MAGIC_SIZE; size < sizeof packed; size++) {
        qm_gzip_content content;
        qm_codec_report report;
        assert_int_equal(inflate_copy(&ctx, packed, size, 0, &content, &report), QM_E_FORMAT);
        QM_CHECK(strstr(report.detail, "ends early at byte") && report.offset == size, "%zu: %s", size,
                 report.detail);
    }
}

static void damage_and_tails_are_refused(void **state)
{
    (void)state;
    uint8_t file[sizeof packed + 4] = {0};
    qm_context ctx = qm_context_make();
    qm_gzip_content content;
    qm_codec_report report;
    memcpy(file, packed, sizeof packed);
    assert_int_equal(inflate_copy(&ctx, file, sizeof file, 0, &content, &report), QM_E_FORMAT);
    assert_non_null(strstr(report.detail, "no gzip data follow"));
    assert_int_equal(report.offset, sizeof packed);
    /* A bit of the checksum, and one of the length. */
    for (size_t i = sizeof packed - 8; i < sizeof packed; i += 4) {
        file[i] ^= 1;
        assert_int_equal(inflate_copy(&ctx, file, sizeof packed, 0, &content, &report), QM_E_FORMAT);
        assert_non_null(strstr(report.detail, "damaged before byte"));
        file[i] ^= 1;
    }
}

static void output_is_limited(void **state)
{
    (void)state;
    qm_context ctx = qm_context_make();
    qm_gzip_content content;
    qm_codec_report report;
    const size_t size = strlen(SQUARE);
    assert_int_equal(inflate_copy(&ctx, packed, sizeof packed, size, &content, &report), QM_OK);
    qm_gzip_content_free(&ctx, &content);
    for (size_t max_size = 1; max_size < size; max_size++) {
        assert_int_equal(inflate_copy(&ctx, packed, sizeof packed, max_size, &content, &report),
                         QM_E_TOO_LARGE);
        assert_non_null(strstr(report.detail, "inflates to more than"));
    }
}

static void lack_of_memory_is_survived(void **state)
{
    (void)state;
    qm_failing_allocator allocator = {.fail_at = 0};
    qm_context ctx = qm_context_make();
    ctx.allocator = qm_failing_allocator_hook(&allocator);
    qm_gzip_content content;
    qm_codec_report report;
    assert_int_equal(inflate_copy(&ctx, packed, sizeof packed, 0, &content, &report), QM_E_NO_MEMORY);
    assert_int_equal(allocator.live_blocks, 0);
    atomic_bool cancel = true;
    ctx = qm_context_make();
    ctx.cancel = &cancel;
    assert_int_equal(inflate_copy(&ctx, packed, sizeof packed, 0, &content, &report), QM_E_CANCELED);
}

static qm_status load(qm_format format, const uint8_t *bytes, size_t size, qm_loaded_mesh *out,
                      qm_codec_report *report)
{
    qm_context ctx = qm_context_make();
    const qm_codec_limits limits = {.max_vertices = 100, .max_faces = 100, .thread_count = 1};
    const qm_preparation preparation = {.has_facts = true, .thread_count = 1};
    return qm_mesh_load(&ctx, format, bytes, size, &limits, &preparation, out, report);
}

static void packed_files_are_loaded_like_others(void **state)
{
    (void)state;
    static const qm_format formats[] = {QM_FORMAT_UNKNOWN, QM_FORMAT_OFF};
    for (int i = 0; i < 2; i++) {
        qm_context ctx = qm_context_make();
        qm_loaded_mesh mesh;
        qm_codec_report report;
        assert_int_equal(load(formats[i], packed, sizeof packed, &mesh, &report), QM_OK);
        assert_int_equal(mesh.format, QM_FORMAT_OFF);
        assert_int_equal(mesh.facts.quads, 1);
        assert_int_equal(mesh.file_size, sizeof packed);
        qm_loaded_mesh_reset(&ctx, &mesh);
    }
    qm_loaded_mesh mesh;
    qm_codec_report report;
    assert_int_equal(load(QM_FORMAT_OFF, packed, 30, &mesh, &report), QM_E_FORMAT);
    assert_int_equal(report.offset, 30);
    assert_null(mesh.mesh.positions);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(members_are_joined),           cmocka_unit_test(every_truncation_names_its_byte),
        cmocka_unit_test(damage_and_tails_are_refused), cmocka_unit_test(output_is_limited),
        cmocka_unit_test(lack_of_memory_is_survived),   cmocka_unit_test(packed_files_are_loaded_like_others),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
