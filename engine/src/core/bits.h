/**
 * bits.h: a bitset: a set of indices below a fixed count, 64 to a word.
 */
#ifndef QM_BITS_H
#define QM_BITS_H

#include <string.h>

#include "qm/context.h"

static inline size_t qm_bits_words(size_t count)
{
    return (count + 63) / 64;
}

/** An empty set of indices below count, for qm_bits_free with the same count; NULL when out of memory. */
static inline uint64_t *qm_bits_create(qm_context *ctx, size_t count)
{
    uint64_t *bits = qm_context_alloc(ctx, qm_bits_words(count), sizeof *bits);
    if (bits) memset(bits, 0, qm_bits_words(count) * sizeof *bits);
    return bits;
}

static inline void qm_bits_free(qm_context *ctx, uint64_t *bits, size_t count)
{
    qm_context_free(ctx, bits, qm_bits_words(count), sizeof *bits);
}

static inline void qm_bits_add(uint64_t *bits, size_t i)
{
    bits[i / 64] |= UINT64_C(1) << i % 64;
}

static inline bool qm_bits_has(const uint64_t *bits, size_t i)
{
    return bits[i / 64] >> i % 64 & 1;
}

/** Writes the indices in the set to out, in ascending order; returns their count. */
static inline size_t qm_bits_list(const uint64_t *bits, size_t count, uint32_t *out)
{
    size_t listed = 0;
    for (size_t word = 0; word < qm_bits_words(count); word++)
        for (uint64_t unlisted = bits[word]; unlisted; unlisted &= unlisted - 1)
            out[listed++] = (uint32_t)(64 * word) + (uint32_t)__builtin_ctzll(unlisted);
    return listed;
}

/** Size of the set. Skips empty words: most are, and a bit count may be a library call. */
static inline size_t qm_bits_count(const uint64_t *bits, size_t count)
{
    size_t sum = 0;
    for (size_t word = 0; word < qm_bits_words(count); word++)
        if (bits[word] != 0) sum += (size_t)__builtin_popcountll(bits[word]);
    return sum;
}

#endif
