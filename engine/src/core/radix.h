/**
 * radix.h: radix sort of integers: indices by Hilbert key for the tree builder and batch projection, and
 * pairs of faces for collision.
 */
#ifndef QM_RADIX_H
#define QM_RADIX_H

#include "qm/context.h"

#define QM_RADIX_INDEX_BITS 28 /* the upper 36 bits of an entry are the key */
#define QM_RADIX_INDEX_MASK ((UINT64_C(1) << QM_RADIX_INDEX_BITS) - 1)

static inline uint64_t qm_radix_entry(uint64_t key, uint64_t index)
{
    return key << QM_RADIX_INDEX_BITS | index;
}

/** Sorts entries by key, stably, on up to workers threads; keys are below 2^key_bits. Returns QM_OK or
 * QM_E_NO_MEMORY. */
qm_status qm_radix_sort(qm_context *ctx, uint64_t *entries, size_t count, int key_bits, int workers);

/** Produces the unsorted entries begin to end, a small range in each call; several threads may call it at
 * once. */
typedef struct qm_radix_producer {
    void (*produce)(void *data, size_t begin, size_t end, uint64_t *entries);
    void *data;
} qm_radix_producer;

/** As qm_radix_sort for entries that a producer writes: they are counted while the L1 cache holds them. spare
 * has room for count entries; until all are produced it may hold the producer's input. */
void qm_radix_sort_produced(qm_context *ctx, uint64_t *entries, uint64_t *spare, size_t count, int key_bits,
                            int workers, const qm_radix_producer *producer);

/** Sorts integers by their low bit_count bits; the bits above are equal in all. */
qm_status qm_radix_sort_numbers(qm_context *ctx, uint64_t *numbers, size_t count, int bit_count, int workers);

#endif
