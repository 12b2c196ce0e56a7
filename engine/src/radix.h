/**
 * radix.h: sorting of indices by Hilbert key, shared by the tree builder and batch projection.
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

/** Sorts entries, no two of them equal, on up to so many threads. Returns QM_OK or QM_E_NO_MEMORY. */
qm_status qm_radix_sort(qm_context *ctx, uint64_t *entries, size_t count, int workers);

#endif
