#include "hash.h"

#include <nettle/sha2.h>
#include <stdio.h>

void qm_hash_print(const uint8_t digest[32], char out[QM_HASH_SIZE])
{
    for (size_t i = 0; i < SHA256_DIGEST_SIZE; i++)
        snprintf(out + 2 * i, 3, "%02x", digest[i]);
}

void qm_hash_text(const char *text, size_t size, char out[QM_HASH_SIZE])
{
    struct sha256_ctx hash;
    uint8_t digest[SHA256_DIGEST_SIZE];
    sha256_init(&hash);
    sha256_update(&hash, size, (const uint8_t *)text);
    sha256_digest(&hash, sizeof digest, digest);
    qm_hash_print(digest, out);
}
