/**
 * keys.h: the eight smallest of some distances, in order, in one vector.
 *
 * A key is a distance as a float, whose bits order like integers, with its index in the last bits. Inserting
 * takes no branch, where a loop would mispredict most of them.
 */
#ifndef QM_KERNEL_KEYS_H
#define QM_KERNEL_KEYS_H

#include <string.h>

#include "simd.h"

typedef int32_t qm_vi __attribute__((vector_size(32)));
typedef float qm_vf __attribute__((vector_size(32)));

#define QM_KEY_INDEX_BITS 8 /* of a key */
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

/** a where the mask is all ones, b where it is all zeros */
static inline qm_vi qm_vi_select(qm_vi mask, qm_vi a, qm_vi b)
{
#if defined(__AVX2__)
    return (qm_vi)_mm256_blendv_epi8((__m256i)b, (__m256i)a, (__m256i)mask);
#else
    return (a & mask) | (b & ~mask);
#endif
}

static inline unsigned qm_key_index(int32_t key)
{
    return (unsigned)key & ((1u << QM_KEY_INDEX_BITS) - 1);
}

/** The max of each lane and its partner where takes_max has all ones, else the min. */
#define QM_EXCHANGE(a, takes_max, ...)                                                                       \
    do {                                                                                                     \
        qm_vi partner = __builtin_shufflevector(a, a, __VA_ARGS__);                                          \
        a = qm_vi_select(takes_max, qm_keys_max(a, partner), qm_keys_min(a, partner));                       \
    } while (0)

/** Eight numbers in descending order: Batcher's bitonic network (Sorting Networks and their Applications,
 * 1968), in the form in which all comparisons go one way. */
static inline qm_vi qm_vi_sort(qm_vi a)
{
    const qm_vi odd = {-1, 0, -1, 0, -1, 0, -1, 0}, low = {-1, -1, 0, 0, -1, -1, 0, 0},
                half = {-1, -1, -1, -1, 0, 0, 0, 0};
    QM_EXCHANGE(a, odd, 1, 0, 3, 2, 5, 4, 7, 6);
    QM_EXCHANGE(a, low, 3, 2, 1, 0, 7, 6, 5, 4);
    QM_EXCHANGE(a, odd, 1, 0, 3, 2, 5, 4, 7, 6);
    QM_EXCHANGE(a, half, 7, 6, 5, 4, 3, 2, 1, 0);
    QM_EXCHANGE(a, low, 2, 3, 0, 1, 6, 7, 4, 5);
    QM_EXCHANGE(a, odd, 1, 0, 3, 2, 5, 4, 7, 6);
    return a;
}

/** The eight smallest numbers of two descending lists, descending. */
static inline qm_vi qm_vi_keep_min(qm_vi a, qm_vi b)
{
    const qm_vi odd = {-1, 0, -1, 0, -1, 0, -1, 0}, low = {-1, -1, 0, 0, -1, -1, 0, 0},
                half = {-1, -1, -1, -1, 0, 0, 0, 0};
    a = qm_keys_min(a, __builtin_shufflevector(b, b, 7, 6, 5, 4, 3, 2, 1, 0));
    QM_EXCHANGE(a, half, 4, 5, 6, 7, 0, 1, 2, 3);
    QM_EXCHANGE(a, low, 2, 3, 0, 1, 6, 7, 4, 5);
    QM_EXCHANGE(a, odd, 1, 0, 3, 2, 5, 4, 7, 6);
    return a;
}

/** All ones in the first count lanes. */
static inline qm_vi qm_first_lanes(int count)
{
    const qm_vi lane = {0, 1, 2, 3, 4, 5, 6, 7};
    return lane < count;
}

/** Descending keys of eight distances, not negative, with the indices from first on; absent lanes come
 * first. */
static inline qm_vi qm_keys_sorted(qm_vf distance, unsigned first, qm_vi there)
{
    const qm_vi lane = {0, 1, 2, 3, 4, 5, 6, 7};
    qm_vi keys = ((qm_vi)distance & -(1 << QM_KEY_INDEX_BITS)) | (lane + (int32_t)first);
    return qm_vi_sort(qm_vi_select(there, keys, (qm_vi){0} + QM_NO_KEY));
}

#endif
