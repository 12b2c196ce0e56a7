/**
 * decode.h: a decoder's outcome in one value, for tests that decode small files from memory. Every mesh that
 * comes out is checked with qm_mesh_validate, and every refusal for words and for an empty mesh.
 */
#ifndef QM_DECODE_H
#define QM_DECODE_H

#include "format/codec.h"

typedef struct qm_decoded {
    qm_status status;
    qm_mesh mesh;
    qm_codec_report report;
} qm_decoded;

/** With limits of a million vertices and faces. Give it to qm_decoded_free. */
qm_decoded qm_decode(qm_format format, const void *bytes, size_t size);
qm_decoded qm_decode_limited(qm_format format, const void *bytes, size_t size, qm_codec_limits limits);
qm_decoded qm_decode_text(qm_format format, const char *text);
void qm_decoded_free(qm_decoded *decoded);

/** True if one of the warnings holds these words. */
bool qm_decoded_warns(const qm_decoded *decoded, const char *words);

/** A file that must be refused: with this status, at this line or byte, and with these words in the
 * detail. */
typedef struct qm_refusal {
    const char *text;
    qm_status status;
    size_t place;
    const char *words;
} qm_refusal;

/** Decodes each text and fails the test at the first one that is not refused as it says. */
void qm_check_refusals(qm_format format, const qm_refusal *refusals, size_t count);
#define QM_CHECK_REFUSALS(format, refusals)                                                                  \
    qm_check_refusals(format, refusals, sizeof(refusals) / sizeof *(refusals))

/** A growing file, for binary formats written by hand. */
typedef struct qm_bytes {
    uint8_t data[4096];
    size_t size;
} qm_bytes;

void qm_bytes_add(qm_bytes *bytes, const void *data, size_t size);
void qm_bytes_add_text(qm_bytes *bytes, const char *text);
void qm_bytes_add_u32(qm_bytes *bytes, uint32_t value); /* little-endian, like the two below */
void qm_bytes_add_u16(qm_bytes *bytes, uint16_t value);
void qm_bytes_add_floats(qm_bytes *bytes, const float *values, size_t count);

/** A mesh as a file, after what bytes holds already. */
void qm_encoded_bytes(const qm_mesh *mesh, qm_format format, qm_bytes *bytes);

#endif
