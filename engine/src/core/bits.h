/**
 * bits.h: sets of small whole numbers as bits, 64 to a word.
 */
#ifndef QM_BITS_H
#define QM_BITS_H

#include <string.h>

#include "qm/context.h"

static inline size_t qm_bits_words(size_t count)
{
    return (count + 63) / 64;
}

/** An empty set of numbers below count; NULL when out of memory. For qm_bits_free with the same count. */
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

/** Writes the numbers of the set in ascending order; returns how many there are. */
static inline size_t qm_bits_list(const uint64_t *bits, size_t count, uint32_t *out)
{
    size_t listed = 0;
    for (size_t word = 0; word < qm_bits_words(count); word++)
        for (uint64_t rest = bits[word]; rest; rest &= rest - 1)
            out[listed++] = (uint32_t)(64 * word) + (uint32_t)__builtin_ctzll(rest);
    return listed;
}

static inline size_t qm_bits_count(const uint64_t *bits, size_t count)
{
    size_t sum = 0; /* most words hold nothing, and counting bits may take a call */
    for (size_t word = 0; word < qm_bits_words(count); word++)
        if (bits[word] != 0) sum += (size_t)__builtin_popcountll(bits[word]);
    return sum;
}

#endif
