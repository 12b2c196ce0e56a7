#include "radix.h"

#include <assert.h>
#include <string.h>

#define MAX_DIGIT_BITS 12
#define MAX_DIGITS 6
#define ENTRY_DIGIT_BITS 10 /* at most: places that the first caches hold; or */
#define WIDE_DIGIT_BITS 12  /* for so many entries that a pass less is worth it: */
#define MANY_ENTRIES 16384
#define MIN_SHARE 8192 /* entries that make it worth to start another thread */
#define MAX_WORKERS 64
#define SLICE_BITS 10 /* by so many leading bits entries are dealt out to workers */
#define SLICES (1 << SLICE_BITS)

/**
 * With more workers than one each counts a share of the entries by their leading bits. Then whole slices are
 * dealt out: every worker moves its share to the ranges of those that sort them, and sorts its own range.
 */
typedef struct sort_work {
    uint64_t *from, *to;
    size_t count;
    int workers;
    int low_bit, digits, digit_bits; /* what is sorted by: entries have a low bit, numbers none */
    uint32_t (*slice_count)[SLICES]; /* for each worker, of its share */
    uint8_t owner[SLICES];           /* who sorts the slice */
    size_t range_begin[MAX_WORKERS + 1];
} sort_work;

/** Least significant digit first, counting all digits in one pass; to home, which is from or to. */
static inline void sort_digits(uint64_t *from, uint64_t *to, uint64_t *home, size_t count, int low_bit,
                               int digits, int digit_bits)
{
    uint32_t place[MAX_DIGITS][1 << MAX_DIGIT_BITS];
    const uint64_t mask = (UINT64_C(1) << digit_bits) - 1;
    memset(place, 0, (size_t)digits * sizeof place[0]);
    for (size_t i = 0; i < count; i++)
        for (int d = 0; d < digits; d++)
            place[d][from[i] >> (low_bit + d * digit_bits) & mask]++;
    for (int d = 0; d < digits; d++) {
        uint32_t start = 0;
        for (uint64_t b = 0; b <= mask; b++) {
            uint32_t here = place[d][b];
            place[d][b] = start;
            start += here;
        }
        for (size_t i = 0; i < count; i++)
            to[place[d][from[i] >> (low_bit + d * digit_bits) & mask]++] = from[i];
        uint64_t *swap = from;
        from = to;
        to = swap;
    }
    if (from != home) memcpy(home, from, count * sizeof *home);
}

/** Entries have loops of their own, in which the compiler knows the digits. */
static void sort_alone(const sort_work *work, uint64_t *from, uint64_t *to, uint64_t *home, size_t count)
{
    if (work->low_bit == 0)
        sort_digits(from, to, home, count, 0, work->digits, work->digit_bits);
    else if (work->digits == 3 && work->digit_bits == 8)
        sort_digits(from, to, home, count, QM_RADIX_INDEX_BITS, 3, 8);
    else if (work->digits == 2 && work->digit_bits == WIDE_DIGIT_BITS)
        sort_digits(from, to, home, count, QM_RADIX_INDEX_BITS, 2, WIDE_DIGIT_BITS);
    else if (work->digits == 3 && work->digit_bits == 10)
        sort_digits(from, to, home, count, QM_RADIX_INDEX_BITS, 3, 10);
    else
        sort_digits(from, to, home, count, QM_RADIX_INDEX_BITS, work->digits, work->digit_bits);
}

static size_t share_begin(const sort_work *work, int worker)
{
    return work->count * (size_t)worker / (size_t)work->workers;
}

static uint32_t slice_of(const sort_work *work, uint64_t entry)
{
    int bits = work->digits * work->digit_bits, slice_bits = bits < SLICE_BITS ? bits : SLICE_BITS;
    return (uint32_t)(entry >> (work->low_bit + bits - slice_bits)) & ((1u << slice_bits) - 1);
}

static void count_slices(void *data, int worker)
{
    const sort_work *work = data;
    uint32_t *count = work->slice_count[worker];
    memset(count, 0, sizeof work->slice_count[worker]);
    for (size_t i = share_begin(work, worker); i < share_begin(work, worker + 1); i++)
        count[slice_of(work, work->from[i])]++;
}

/** Gives each worker a range of slices with about as many entries as the others'. */
static void deal_out(sort_work *work)
{
    size_t begin = 0;
    int owner = 0;
    for (int slice = 0; slice < SLICES; slice++) {
        while (owner + 1 < work->workers && begin >= share_begin(work, owner + 1))
            work->range_begin[++owner] = begin;
        work->owner[slice] = (uint8_t)owner;
        for (int worker = 0; worker < work->workers; worker++)
            begin += work->slice_count[worker][slice];
    }
    while (owner < work->workers)
        work->range_begin[++owner] = begin;
}

/** Moves a share of the entries to the ranges that they belong to, after those of the shares before it. */
static void move_share(void *data, int worker)
{
    const sort_work *work = data;
    size_t place[MAX_WORKERS];
    memcpy(place, work->range_begin, (size_t)work->workers * sizeof *place);
    for (int before = 0; before < worker; before++)
        for (int slice = 0; slice < SLICES; slice++)
            place[work->owner[slice]] += work->slice_count[before][slice];
    for (size_t i = share_begin(work, worker); i < share_begin(work, worker + 1); i++)
        work->to[place[work->owner[slice_of(work, work->from[i])]]++] = work->from[i];
}

static void sort_range(void *data, int worker)
{
    const sort_work *work = data;
    size_t begin = work->range_begin[worker], end = work->range_begin[worker + 1];
    uint64_t *home = work->from + begin;
    sort_alone(work, work->to + begin, home, home, end - begin);
}

static qm_status sort_together(qm_context *ctx, sort_work *work)
{
    work->slice_count = qm_context_alloc(ctx, (size_t)work->workers, sizeof *work->slice_count);
    if (!work->slice_count) return QM_E_NO_MEMORY;
    qm_context_parallel(ctx, work->workers, count_slices, work);
    deal_out(work);
    qm_context_parallel(ctx, work->workers, move_share, work);
    qm_context_parallel(ctx, work->workers, sort_range, work);
    qm_context_free(ctx, work->slice_count, (size_t)work->workers, sizeof *work->slice_count);
    return QM_OK;
}

static qm_status sort(qm_context *ctx, sort_work work)
{
    if (work.count < 2) return QM_OK;
    work.to = qm_context_alloc(ctx, work.count, sizeof *work.to);
    if (!work.to) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory while sorting");
    int most = (int)(work.count / MIN_SHARE < MAX_WORKERS ? work.count / MIN_SHARE : MAX_WORKERS);
    if (work.workers > most) work.workers = most > 1 ? most : 1;
    if (work.workers == 1 || sort_together(ctx, &work) != QM_OK)
        sort_alone(&work, work.from, work.to, work.from, work.count);
    qm_context_free(ctx, work.to, work.count, sizeof *work.to);
    return QM_OK;
}

qm_status qm_radix_sort(qm_context *ctx, uint64_t *entries, size_t count, int key_bits, int workers)
{
    bool is_wide = key_bits == 2 * WIDE_DIGIT_BITS && count > MANY_ENTRIES;
    int most = is_wide ? WIDE_DIGIT_BITS : ENTRY_DIGIT_BITS, digits = (key_bits + most - 1) / most;
    return sort(ctx, (sort_work){.from = entries,
                                 .count = count,
                                 .workers = workers,
                                 .low_bit = QM_RADIX_INDEX_BITS,
                                 .digits = digits,
                                 .digit_bits = (key_bits + digits - 1) / digits});
}

qm_status qm_radix_sort_numbers(qm_context *ctx, uint64_t *numbers, size_t count, int bit_count, int workers)
{
    int digits = (bit_count + MAX_DIGIT_BITS - 1) / MAX_DIGIT_BITS;
    return sort(ctx, (sort_work){.from = numbers,
                                 .count = count,
                                 .workers = workers,
                                 .digits = digits,
                                 .digit_bits = digits > 0 ? (bit_count + digits - 1) / digits : 0});
}
