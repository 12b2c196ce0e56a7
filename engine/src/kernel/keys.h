/**
 * keys.h: the eight least of some distances, in order, in one vector.
 *
 * A key is a distance as a float, whose bits order like whole numbers, with the place that it belongs to in
 * its last bits. Inserting takes no branch, where a loop would mispredict most of them.
 */
#ifndef QM_KERNEL_KEYS_H
#define QM_KERNEL_KEYS_H

#include <string.h>

#include "simd.h"

typedef int32_t qm_vi __attribute__((vector_size(32)));

#define QM_KEY_PLACE_BITS 8 /* of a key */
#define QM_NO_KEY INT32_MAX

static inline qm_vi qm_keys_min(qm_vi a, qm_vi b)
{
#if defined(__AVX2__)
    return (qm_vi)_mm256_min_epi32((__m256i)a, (__m256i)b);
#else
    qm_vi below = a < b;
    return (a & below) | (b & ~below);
#endif
}

static inline qm_vi qm_keys_max(qm_vi a, qm_vi b)
{
#if defined(__AVX2__)
    return (qm_vi)_mm256_max_epi32((__m256i)a, (__m256i)b);
#else
    qm_vi above = a > b;
    return (a & above) | (b & ~above);
#endif
}

/** Each key moves up when the one below it, or the new one, is greater. */
static inline qm_vi qm_keys_insert(qm_vi keys, int32_t key)
{
    const qm_vi lowest = (qm_vi){0} + INT32_MIN;
    qm_vi below = __builtin_shufflevector(keys, lowest, 8, 0, 1, 2, 3, 4, 5, 6);
    return qm_keys_min(keys, qm_keys_max(below, (qm_vi){0} + key));
}

static inline int32_t qm_key_make(float distance, unsigned place)
{
    int32_t bits;
    memcpy(&bits, &distance, sizeof bits);
    return (int32_t)(((uint32_t)bits & ~((1u << QM_KEY_PLACE_BITS) - 1)) | place);
}

static inline unsigned qm_key_place(int32_t key)
{
    return (unsigned)key & ((1u << QM_KEY_PLACE_BITS) - 1);
}

#endif
