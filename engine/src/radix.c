#include "radix.h"

#include <assert.h>

#define DIGIT_BITS 9
enum { DIGITS = (64 - QM_RADIX_INDEX_BITS) / DIGIT_BITS, BUCKETS = 1 << DIGIT_BITS };
static_assert(DIGITS % 2 == 0, "an even number of passes ends where it began");
static_assert(DIGITS * DIGIT_BITS == 64 - QM_RADIX_INDEX_BITS, "the digits make up the key");

static unsigned digit(uint64_t entry, int d)
{
    return (unsigned)(entry >> (QM_RADIX_INDEX_BITS + d * DIGIT_BITS)) & (BUCKETS - 1);
}

/** Least significant digit first, counting all digits in one pass. */
static void sort_between(uint64_t *from, uint64_t *to, size_t count)
{
    uint32_t place[DIGITS][BUCKETS] = {{0}};
    for (size_t i = 0; i < count; i++)
        for (int d = 0; d < DIGITS; d++)
            place[d][digit(from[i], d)]++;
    for (int d = 0; d < DIGITS; d++) {
        uint32_t start = 0;
        for (int b = 0; b < BUCKETS; b++) {
            uint32_t here = place[d][b];
            place[d][b] = start;
            start += here;
        }
        for (size_t i = 0; i < count; i++)
            to[place[d][digit(from[i], d)]++] = from[i];
        uint64_t *swap = from;
        from = to;
        to = swap;
    }
}

qm_status qm_radix_sort(qm_context *ctx, uint64_t *entries, size_t count)
{
    if (count < 2) return QM_OK;
    uint64_t *spare = qm_context_alloc(ctx, count, sizeof *spare);
    if (!spare) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory while sorting");
    sort_between(entries, spare, count);
    qm_context_free(ctx, spare, count, sizeof *spare);
    return QM_OK;
}
