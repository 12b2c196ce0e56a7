/**
 * hash.h: SHA-256 of bytes in memory, as a digest, in hex or in base64.
 */
#ifndef QM_HASH_H
#define QM_HASH_H

#include <stddef.h>
#include <stdint.h>

#define QM_DIGEST_SIZE 32
#define QM_HASH_SIZE 65 /* 64 digits and a 0 */

void qm_hash_bytes(const void *bytes, size_t size, uint8_t digest[QM_DIGEST_SIZE]);

/** The digest of a text, in hex. */
void qm_hash_text(const char *text, size_t size, char out[QM_HASH_SIZE]);

/** The digest of a text, in base64, as Content-Security-Policy needs it. */
#define QM_HASH_BASE64_SIZE 45
void qm_hash_text_base64(const char *text, size_t size, char out[QM_HASH_BASE64_SIZE]);

/** Writes a digest in hex. */
void qm_hash_print(const uint8_t digest[QM_DIGEST_SIZE], char out[QM_HASH_SIZE]);

#endif
