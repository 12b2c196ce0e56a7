/**
 * gzip.h: files that are compressed with gzip (RFC 1952), by zlib.
 */
#ifndef QM_GZIP_H
#define QM_GZIP_H

#include "codec.h"

#define QM_GZIP_MAGIC_SIZE 3

/** Whether a file starts like gzip data, as no mesh file does. */
bool qm_gzip_is_packed(const uint8_t *bytes, size_t size);

/** What a file inflates to. */
typedef struct qm_gzip_content {
    uint8_t *bytes;
    size_t size, capacity;
    bool only_counts; /* bytes are a buffer that each step overwrites */
} qm_gzip_content;

/**
 * Inflates all members of a file, in memory of the context. The caller frees *out by qm_gzip_content_free.
 *
 * max_size  bytes that may come out; 0: no limit
 *
 * Returns QM_OK; QM_E_FORMAT for data that is damaged, cut short or followed by other bytes, and QM_E_TOO_LARGE, with
 * report->detail and the offset in the file; QM_E_NO_MEMORY; QM_E_CANCELED. After an error *out is empty.
 */
qm_status qm_gzip_inflate(qm_context *ctx, const uint8_t *bytes, size_t size, size_t max_size,
                          qm_gzip_content *out, qm_codec_report *report);
void qm_gzip_content_free(qm_context *ctx, qm_gzip_content *content);

/** The size that a file inflates to, in *out. Returns as qm_gzip_inflate. */
qm_status qm_gzip_measure(qm_context *ctx, const uint8_t *bytes, size_t size, size_t max_size, size_t *out,
                          qm_codec_report *report);

#endif
