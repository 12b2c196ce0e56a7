#include "decode.h"

#include <stdio.h>
#include <string.h>

#include "base/host.h"
#include "check.h"
#include "format/encoder.h"

/** Counting a file agrees with decoding it, and allocates no array of its vertices or faces. */
static void check_counts(const qm_decoded *decoded, qm_format format, const uint8_t *bytes, size_t size,
                         const qm_codec_limits *limits)
{
    qm_context ctx = qm_context_make();
    qm_codec_counts counts;
    qm_codec_report report;
    qm_status status = qm_codec_count(&ctx, format, bytes, size, limits, &counts, &report);
    if (decoded->status != QM_OK) {
        bool is_found_late = decoded->status == QM_E_INDEX || decoded->status == QM_E_EMPTY ||
                             decoded->status == QM_E_NOT_FINITE || decoded->status == QM_E_TOO_LARGE ||
                             format == QM_FORMAT_DRC || format == QM_FORMAT_GLB;
        QM_CHECK(status == decoded->status || is_found_late, "%s: counting gives %s, decoding %s",
                 qm_format_name(format), qm_status_code(status), qm_status_code(decoded->status));
        return;
    }
    QM_CHECK(status == QM_OK, "%s: counting gives %s: %s", qm_format_name(format), qm_status_code(status),
             report.detail);
    const qm_mesh *mesh = &decoded->mesh;
    size_t quads = 0;
    for (size_t i = 0; i < mesh->face_count; ++i)
        quads += mesh->faces[4 * i + 3] != QM_NO_INDEX;
    QM_CHECK(counts.is_exact ? counts.vertices == mesh->vertex_count && counts.faces == mesh->face_count &&
                                   counts.quads == quads
                             : counts.vertices <= mesh->vertex_count && counts.faces <= mesh->face_count,
             "%s: counted %zu vertices, %zu faces, %zu quads of %zu, %zu, %zu", qm_format_name(format),
             counts.vertices, counts.faces, counts.quads, mesh->vertex_count, mesh->face_count, quads);
}

qm_decoded qm_decode_limited(qm_format format, const void *bytes, size_t size, qm_codec_limits limits)
{
    qm_context ctx = qm_context_make();
    ctx.parallel = qm_host_parallel;
    qm_decoded decoded;
    /* An exact copy on the heap lets the sanitizer see a read past the end. */
    uint8_t *copy = malloc(size ? size : 1);
    assert_non_null(copy);
    memcpy(copy, bytes, size);
    decoded.status = qm_codec_decode(&ctx, format, copy, size, &limits, &decoded.mesh, &decoded.report);
    check_counts(&decoded, format, copy, size, &limits);
    free(copy);
    if (decoded.status == QM_OK) {
        assert_int_equal(qm_mesh_validate(&ctx, &decoded.mesh), QM_OK);
        assert_true(decoded.report.line == QM_NO_LOCATION && decoded.report.offset == QM_NO_LOCATION);
    } else {
        assert_null(decoded.mesh.positions);
        assert_null(decoded.mesh.faces);
        assert_true(decoded.report.detail[0] != 0);
        assert_true((decoded.report.line == QM_NO_LOCATION) != (decoded.report.offset == QM_NO_LOCATION));
    }
    return decoded;
}

qm_decoded qm_decode(qm_format format, const void *bytes, size_t size)
{
    return qm_decode_limited(format, bytes, size, (qm_codec_limits){1000000, 1000000, 1, 0, NULL});
}

qm_decoded qm_decode_text(qm_format format, const char *text)
{
    return qm_decode(format, text, strlen(text));
}

void qm_decoded_free(qm_decoded *decoded)
{
    qm_context ctx = qm_context_make();
    qm_mesh_reset(&ctx, &decoded->mesh);
}

bool qm_decoded_warns(const qm_decoded *decoded, const char *words)
{
    for (size_t i = 0; i < decoded->report.warning_count; ++i)
        if (strstr(decoded->report.warnings[i], words)) return true;
    return false;
}

void qm_check_refusals(qm_format format, const qm_refusal *refusals, size_t count)
{
    for (size_t i = 0; i < count; ++i) {
        qm_decoded decoded = qm_decode_text(format, refusals[i].text);
        size_t place = decoded.report.line != QM_NO_LOCATION ? decoded.report.line : decoded.report.offset;
        QM_CHECK(decoded.status == refusals[i].status, "case %zu: %s instead of %s: %s", i,
                 qm_status_code(decoded.status), qm_status_code(refusals[i].status), decoded.report.detail);
        QM_CHECK(place == refusals[i].place, "case %zu: at %zu instead of %zu", i, place, refusals[i].place);
        QM_CHECK(strstr(decoded.report.detail, refusals[i].words), "case %zu: \"%s\" lacks \"%s\"", i,
                 decoded.report.detail, refusals[i].words);
        qm_decoded_free(&decoded);
    }
}

void qm_bytes_add(qm_bytes *bytes, const void *data, size_t size)
{
    assert_true(size <= sizeof bytes->data - bytes->size);
    memcpy(bytes->data + bytes->size, data, size);
    bytes->size += size;
}

void qm_bytes_add_text(qm_bytes *bytes, const char *text)
{
    qm_bytes_add(bytes, text, strlen(text));
}

void qm_bytes_add_u32(qm_bytes *bytes, uint32_t value)
{
    const uint8_t data[4] = {(uint8_t)value, (uint8_t)(value >> 8), (uint8_t)(value >> 16),
                             (uint8_t)(value >> 24)};
    qm_bytes_add(bytes, data, sizeof data);
}

void qm_bytes_add_u16(qm_bytes *bytes, uint16_t value)
{
    const uint8_t data[2] = {(uint8_t)value, (uint8_t)(value >> 8)};
    qm_bytes_add(bytes, data, sizeof data);
}

void qm_bytes_add_floats(qm_bytes *bytes, const float *values, size_t count)
{
    for (size_t i = 0; i < count; ++i) {
        uint32_t bits;
        memcpy(&bits, &values[i], sizeof bits);
        qm_bytes_add_u32(bytes, bits);
    }
}

void qm_encoded_bytes(const qm_mesh *mesh, qm_format format, qm_bytes *bytes)
{
    qm_context ctx = qm_context_make();
    qm_mesh_facts facts;
    qm_encoder *encoder;
    qm_text out = {0};
    assert_int_equal(qm_mesh_find_facts(&ctx, mesh, &facts), QM_OK);
    assert_int_equal(qm_encoder_create(&ctx, mesh, &facts, format, 0, NULL, &encoder), QM_OK);
    while (qm_encoder_next(encoder, &out))
        continue;
    assert_false(out.failed);
    qm_bytes_add(bytes, out.data, out.size);
    qm_text_reset(&out);
    qm_encoder_destroy(encoder);
}
