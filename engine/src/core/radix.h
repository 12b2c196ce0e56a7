/**
 * radix.h: sorting of whole numbers: indices by Hilbert key for the tree builder and batch projection, and
 * pairs of faces for collision.
 */
#ifndef QM_RADIX_H
#define QM_RADIX_H

#include "qm/context.h"

#define QM_RADIX_INDEX_BITS 28 /* the rest of an entry, 36 bits, is the key */
#define QM_RADIX_INDEX_MASK ((UINT64_C(1) << QM_RADIX_INDEX_BITS) - 1)

static inline uint64_t qm_radix_entry(uint64_t key, uint64_t index)
{
    return key << QM_RADIX_INDEX_BITS | index;
}

/** Sorts entries by key, those of equal keys by index if they come so, on up to so many threads; keys are
 * below 2^key_bits. Returns QM_OK or QM_E_NO_MEMORY. */
qm_status qm_radix_sort(qm_context *ctx, uint64_t *entries, size_t count, int key_bits, int workers);

/** Writes entries begin to end, before they are sorted, to their places, a few at a time; by several
 * threads. */
typedef struct qm_radix_maker {
    void (*make)(void *data, size_t begin, size_t end, uint64_t *entries);
    void *data;
} qm_radix_maker;

/** The same for entries that a maker writes: they are counted while the first caches hold them. spare has
 * room for as many, and until all are made it may hold what the maker reads. */
void qm_radix_sort_made(qm_context *ctx, uint64_t *entries, uint64_t *spare, size_t count, int key_bits,
                        int workers, const qm_radix_maker *maker);

/** Sorts whole numbers, equal ones too, by their low bit_count bits; those above are the same in all. */
qm_status qm_radix_sort_numbers(qm_context *ctx, uint64_t *numbers, size_t count, int bit_count, int workers);

#endif
