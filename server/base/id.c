/**
 * id.c: random ids, and SHA-256 by nettle.
 */
#include "id.h"

#include <nettle/base64.h>
#include <nettle/sha2.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/random.h>

void qm_id_make(char prefix, char out[QM_ID_SIZE])
{
    static const char alphabet[] = "abcdefghijklmnopqrstuvwxyz234567";
    uint8_t random[20];
    if (getrandom(random, sizeof random, 0) != (ssize_t)sizeof random) abort();
    out[0] = prefix;
    out[1] = '_';
    for (size_t i = 0; i < sizeof random; i++)
        out[2 + i] = alphabet[random[i] % 32];
    out[2 + sizeof random] = '\0';
}

void qm_id_hash_print(const uint8_t digest[QM_DIGEST_SIZE], char out[QM_HASH_SIZE])
{
    for (size_t i = 0; i < QM_DIGEST_SIZE; i++)
        snprintf(out + 2 * i, 3, "%02x", digest[i]);
}

void qm_id_hash_bytes(const void *bytes, size_t size, uint8_t digest[QM_DIGEST_SIZE])
{
    struct sha256_ctx hash;
    sha256_init(&hash);
    sha256_update(&hash, size, bytes);
    sha256_digest(&hash, QM_DIGEST_SIZE, digest);
}

void qm_id_hash_text(const char *text, size_t size, char out[QM_HASH_SIZE])
{
    uint8_t digest[QM_DIGEST_SIZE];
    qm_id_hash_bytes(text, size, digest);
    qm_id_hash_print(digest, out);
}

void qm_id_hash_text_base64(const char *text, size_t size, char out[QM_HASH_BASE64_SIZE])
{
    uint8_t digest[QM_DIGEST_SIZE];
    qm_id_hash_bytes(text, size, digest);
    base64_encode_raw(out, sizeof digest, digest);
    out[QM_HASH_BASE64_SIZE - 1] = '\0';
}
