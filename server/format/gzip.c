/**
 * gzip.c: inflates gzip data, member after member. The output grows within the budget of the context, whatever the
 * trailer announces.
 */
#include "gzip.h"

#include <zlib.h>

#include "codec_builder.h"

#define MAX_RATIO 1032        /* of deflate: 258 bytes of two bits */
#define MAX_STEP (1u << 20)   /* bytes that come out between two looks at the flag of cancelation */
#define GZIP_WINDOW (15 + 16) /* the largest window, with the header and trailer of gzip */

bool qm_gzip_is_packed(const uint8_t *bytes, size_t size)
{
    return size >= QM_GZIP_MAGIC_SIZE && bytes[0] == 0x1f && bytes[1] == 0x8b && bytes[2] == Z_DEFLATED;
}

/** A first capacity: the trailer has the size of the last member, which may be wrong or one of many. */
static size_t guess_size(const uint8_t *bytes, size_t size, size_t max_size)
{
    size_t guess = size < 4 ? 0 : qm_read_u32_le(bytes + size - 4);
    if (guess / MAX_RATIO > size) guess = 0;
    if (guess < size) guess = 4 * size;
    return guess < max_size ? guess : max_size;
}

/** Makes room for more bytes, of which one may exceed the limit: that the limit is passed shows only then. */
static qm_status make_room(qm_context *ctx, qm_gzip_content *out, size_t needed, size_t max_size)
{
    QM_ASSERT(out->size <= max_size);
    if (out->only_counts ? out->bytes != NULL : out->size < out->capacity) return QM_OK;
    size_t capacity = needed < max_size ? needed + 1 : max_size + 1;
    if (out->only_counts) capacity = MAX_STEP;
    uint8_t *bytes = qm_context_resize(ctx, out->bytes, out->capacity, capacity, 1);
    if (!bytes) return QM_E_NO_MEMORY;
    out->bytes = bytes;
    out->capacity = capacity;
    return QM_OK;
}

/** Inflates up to MAX_STEP bytes; *result is the library's. */
static qm_status inflate_step(z_stream *stream, qm_gzip_content *out, size_t left, int *result)
{
    const size_t at = out->only_counts ? 0 : out->size, room = out->capacity - at;
    const uInt step = room < MAX_STEP ? (uInt)room : MAX_STEP;
    const uInt input = left < MAX_STEP ? (uInt)left : MAX_STEP;
    stream->next_out = out->bytes + at;
    stream->avail_out = step;
    stream->avail_in = input;
    *result = inflate(stream, Z_NO_FLUSH);
    out->size += step - stream->avail_out;
    return *result == Z_MEM_ERROR ? QM_E_NO_MEMORY : QM_OK;
}

static qm_status inflate_members(qm_context *ctx, z_stream *stream, const uint8_t *bytes, size_t size,
                                 size_t max_size, qm_gzip_content *out, qm_codec_report *report)
{
    const uint8_t *const end = bytes + size;
    const size_t guess = guess_size(bytes, size, max_size);
    stream->next_in = (z_const Bytef *)bytes;
    for (;;) {
        int result = Z_OK;
        if (qm_context_canceled(ctx)) return QM_E_CANCELED;
        qm_status status = make_room(ctx, out, out->capacity ? 2 * out->size : guess, max_size);
        if (status == QM_OK) status = inflate_step(stream, out, (size_t)(end - stream->next_in), &result);
        if (status != QM_OK) return status;
        const size_t at = (size_t)(stream->next_in - bytes);
        report->offset = at;
        if (out->size > max_size)
            return qm_codec_fail(report, QM_E_TOO_LARGE, "the gzip data inflates to more than %zu bytes",
                                 max_size);
        if (result == Z_STREAM_END) {
            if (at == size) return QM_OK;
            if (!qm_gzip_is_packed(stream->next_in, size - at))
                return qm_codec_fail(report, QM_E_FORMAT,
                                     "bytes that are no gzip data follow its end at byte %zu", at);
            inflateReset(stream);
        } else if (result != Z_OK && result != Z_BUF_ERROR) {
            return qm_codec_fail(report, QM_E_FORMAT, "the gzip data is damaged before byte %zu%s%s", at,
                                 stream->msg ? ": " : "", stream->msg ? stream->msg : "");
        } else if (at == size && stream->avail_out > 0) {
            return qm_codec_fail(report, QM_E_FORMAT, "the gzip data ends early at byte %zu", at);
        }
    }
}

/** Inflates the file into *out, which is empty. */
static qm_status inflate_file(qm_context *ctx, const uint8_t *bytes, size_t size, size_t max_size,
                              qm_gzip_content *out, qm_codec_report *report)
{
    z_stream stream = {0};
    report->offset = 0;
    if (max_size == 0) max_size = SIZE_MAX / 4;
    qm_status status = inflateInit2(&stream, GZIP_WINDOW) == Z_OK ? QM_OK : QM_E_NO_MEMORY;
    if (status == QM_OK) {
        status = inflate_members(ctx, &stream, bytes, size, max_size, out, report);
        inflateEnd(&stream);
    }
    if (status == QM_OK) {
        report->offset = QM_NO_LOCATION;
        return QM_OK;
    }
    if (!report->detail[0]) qm_codec_fail(report, status, "%s", qm_status_text(status));
    qm_gzip_content_free(ctx, out);
    return status;
}

qm_status qm_gzip_inflate(qm_context *ctx, const uint8_t *bytes, size_t size, size_t max_size,
                          qm_gzip_content *out, qm_codec_report *report)
{
    *out = (qm_gzip_content){0};
    return inflate_file(ctx, bytes, size, max_size, out, report);
}

qm_status qm_gzip_measure(qm_context *ctx, const uint8_t *bytes, size_t size, size_t max_size, size_t *out,
                          qm_codec_report *report)
{
    qm_gzip_content content = {.only_counts = true};
    qm_status status = inflate_file(ctx, bytes, size, max_size, &content, report);
    *out = content.size;
    qm_gzip_content_free(ctx, &content);
    return status;
}

void qm_gzip_content_free(qm_context *ctx, qm_gzip_content *content)
{
    qm_context_free(ctx, content->bytes, content->capacity, 1);
    *content = (qm_gzip_content){0};
}
