/**
 * id.h: names of what is stored: random ids of resources, and the SHA-256 of contents.
 */
#ifndef QM_ID_H
#define QM_ID_H

#include <stddef.h>
#include <stdint.h>

#define QM_ID_SIZE 40 /* with the terminating zero */

/** A new random id: a prefix, then 20 characters of a to z and digits. */
void qm_id_make(char prefix, char out[QM_ID_SIZE]);

#define QM_DIGEST_SIZE 32
#define QM_HASH_SIZE 65 /* 64 digits and a 0 */

void qm_id_hash_bytes(const void *bytes, size_t size, uint8_t digest[QM_DIGEST_SIZE]);

/** The digest of a text, in hex. */
void qm_id_hash_text(const char *text, size_t size, char out[QM_HASH_SIZE]);

/** The digest of a text, in base64, as Content-Security-Policy needs it. */
#define QM_HASH_BASE64_SIZE 45
void qm_id_hash_text_base64(const char *text, size_t size, char out[QM_HASH_BASE64_SIZE]);

/** Writes a digest in hex. */
void qm_id_hash_print(const uint8_t digest[QM_DIGEST_SIZE], char out[QM_HASH_SIZE]);

#endif
