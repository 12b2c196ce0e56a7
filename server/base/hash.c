/**
 * hash.c: SHA-256 by nettle.
 */
#include "hash.h"

#include <nettle/base64.h>
#include <nettle/sha2.h>
#include <stdio.h>

void qm_hash_print(const uint8_t digest[QM_DIGEST_SIZE], char out[QM_HASH_SIZE])
{
    for (size_t i = 0; i < QM_DIGEST_SIZE; i++)
        snprintf(out + 2 * i, 3, "%02x", digest[i]);
}

void qm_hash_bytes(const void *bytes, size_t size, uint8_t digest[QM_DIGEST_SIZE])
{
    struct sha256_ctx hash;
    sha256_init(&hash);
    sha256_update(&hash, size, bytes);
    sha256_digest(&hash, QM_DIGEST_SIZE, digest);
}

void qm_hash_text(const char *text, size_t size, char out[QM_HASH_SIZE])
{
    uint8_t digest[QM_DIGEST_SIZE];
    qm_hash_bytes(text, size, digest);
    qm_hash_print(digest, out);
}

void qm_hash_text_base64(const char *text, size_t size, char out[QM_HASH_BASE64_SIZE])
{
    uint8_t digest[QM_DIGEST_SIZE];
    qm_hash_bytes(text, size, digest);
    base64_encode_raw(out, sizeof digest, digest);
    out[QM_HASH_BASE64_SIZE - 1] = '\0';
}
