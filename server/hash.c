#include "hash.h"

#include <nettle/base64.h>
#include <nettle/sha2.h>
#include <stdio.h>

void qm_hash_print(const uint8_t digest[32], char out[QM_HASH_SIZE])
{
    for (size_t i = 0; i < SHA256_DIGEST_SIZE; i++)
        snprintf(out + 2 * i, 3, "%02x", digest[i]);
}

static void digest_text(const char *text, size_t size, uint8_t digest[SHA256_DIGEST_SIZE])
{
    struct sha256_ctx hash;
    sha256_init(&hash);
    sha256_update(&hash, size, (const uint8_t *)text);
    sha256_digest(&hash, SHA256_DIGEST_SIZE, digest);
}

void qm_hash_text(const char *text, size_t size, char out[QM_HASH_SIZE])
{
    uint8_t digest[SHA256_DIGEST_SIZE];
    digest_text(text, size, digest);
    qm_hash_print(digest, out);
}

void qm_hash_text_base64(const char *text, size_t size, char out[QM_HASH_BASE64_SIZE])
{
    uint8_t digest[SHA256_DIGEST_SIZE];
    digest_text(text, size, digest);
    base64_encode_raw(out, sizeof digest, digest);
    out[QM_HASH_BASE64_SIZE - 1] = '\0';
}
