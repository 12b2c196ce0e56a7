#include "radix.h"

#include <assert.h>
#include <string.h>

#define MAX_DIGIT_BITS 12
#define MAX_DIGITS 6
#define ENTRY_DIGIT_BITS 10 /* at most: places that the first caches hold; or */
#define WIDE_DIGIT_BITS 12  /* for so many entries that a pass less is worth it: */
#define MANY_ENTRIES 16384
#define MIN_SHARE 2048 /* entries that make it worth to start another thread */
#define SLICE_BITS 9   /* by so many leading bits entries are dealt out to ranges */
#define SLICES (1 << SLICE_BITS)
#define CHUNK 512          /* entries that are made, then counted while they are at hand */
#define BLOCK_LEAST 512    /* entries of a block, */
#define BLOCK_MOST 2048    /* which the first caches hold twice; */
#define MANY_BLOCKS 32     /* so many blocks do when there are few entries */
#define RANGE_ENTRIES 8192 /* about so many to a range, which the second caches then hold, */
#define MAX_RANGES 64      /* as long as there are not more */

/**
 * With more workers than one the entries are sorted by blocks and ranges, which the workers share. Each block
 * puts its own entries in order of slices, which are their leading bits; runs of slices make ranges with
 * about the same number of entries; and each range gathers its part of every block on its way to the first
 * digit's order, and then sorts by the other digits.
 */
typedef struct sort_block {
    uint16_t slice_begin[SLICES + 1];
} sort_block;

typedef struct sort_range {
    uint32_t slice; /* its first; the range after the last has the end */
    size_t begin;   /* of its entries */
} sort_range;

typedef struct sort_work {
    uint64_t *from, *to;
    size_t count;
    const qm_radix_maker *maker; /* writes the entries; NULL when they are there */
    int workers;
    int low_bit, digits, digit_bits; /* what is sorted by: entries have a low bit, numbers none */
    int slice_shift, slice_bits;
    sort_block *block;
    size_t block_entries, block_count, range_count;
    sort_range range[MAX_RANGES + 1];
} sort_work;

static size_t clamp(size_t a, size_t least, size_t most)
{
    return a < least ? least : a > most ? most : a;
}

static size_t chunk_end(size_t begin, size_t end)
{
    return end - begin < CHUNK ? end : begin + CHUNK;
}

/** From counts to the places of the first of each. */
static inline void sum_up(uint32_t *place, uint64_t last)
{
    uint32_t start = 0;
    for (uint64_t b = 0; b <= last; b++) {
        uint32_t here = place[b];
        place[b] = start;
        start += here;
    }
}

/** Least significant digit first, counting all digits in one pass; to home, which is from or to. */
static inline void sort_digits(const qm_radix_maker *maker, uint64_t *from, uint64_t *to, uint64_t *home,
                               size_t count, int low_bit, int digits, int digit_bits)
{
    uint32_t place[MAX_DIGITS][1 << MAX_DIGIT_BITS];
    const uint64_t mask = (UINT64_C(1) << digit_bits) - 1;
    memset(place, 0, (size_t)digits * sizeof place[0]);
    for (size_t begin = 0; begin < count; begin += CHUNK) {
        size_t end = chunk_end(begin, count);
        if (maker) maker->make(maker->data, begin, end, from + begin);
        for (size_t i = begin; i < end; i++)
            for (int d = 0; d < digits; d++)
                place[d][from[i] >> (low_bit + d * digit_bits) & mask]++;
    }
    for (int d = 0; d < digits; d++) {
        sum_up(place[d], mask);
        for (size_t i = 0; i < count; i++)
            to[place[d][from[i] >> (low_bit + d * digit_bits) & mask]++] = from[i];
        uint64_t *swap = from;
        from = to;
        to = swap;
    }
    if (from != home) memcpy(home, from, count * sizeof *home);
}

/** Sorts by the digits from one on. Entries have loops of their own, in which the compiler knows the digits.
 */
static void sort_alone(const sort_work *work, const qm_radix_maker *maker, int first_digit, uint64_t *from,
                       uint64_t *to, uint64_t *home, size_t count)
{
    int low_bit = work->low_bit + first_digit * work->digit_bits, digits = work->digits - first_digit;
    if (low_bit == QM_RADIX_INDEX_BITS && digits == 3 && work->digit_bits == 8)
        sort_digits(maker, from, to, home, count, QM_RADIX_INDEX_BITS, 3, 8);
    else if (low_bit == QM_RADIX_INDEX_BITS && digits == 2 && work->digit_bits == WIDE_DIGIT_BITS)
        sort_digits(maker, from, to, home, count, QM_RADIX_INDEX_BITS, 2, WIDE_DIGIT_BITS);
    else if (low_bit == QM_RADIX_INDEX_BITS && digits == 3 && work->digit_bits == 10)
        sort_digits(maker, from, to, home, count, QM_RADIX_INDEX_BITS, 3, 10);
    else if (digits == 1)
        sort_digits(maker, from, to, home, count, low_bit, 1, work->digit_bits);
    else
        sort_digits(maker, from, to, home, count, low_bit, digits, work->digit_bits);
}

static uint32_t slice_of(const sort_work *work, uint64_t entry)
{
    return (uint32_t)(entry >> work->slice_shift) & ((1u << work->slice_bits) - 1);
}

/** Neighbours are often of one slice: counted by twos, none waits for the other. */
static void count_slices(const sort_work *work, const uint64_t *entries, size_t count, uint16_t *slice_begin)
{
    uint16_t even[SLICES] = {0}, odd[SLICES] = {0};
    size_t i = 0;
    for (; i + 1 < count; i += 2) {
        even[slice_of(work, entries[i])]++;
        odd[slice_of(work, entries[i + 1])]++;
    }
    if (i < count) even[slice_of(work, entries[i])]++;
    uint16_t begin = 0;
    for (int slice = 0; slice < SLICES; slice++) {
        slice_begin[slice] = begin;
        begin = (uint16_t)(begin + even[slice] + odd[slice]);
    }
    slice_begin[SLICES] = begin;
}

static void sort_block_entries(void *data, int worker, size_t block)
{
    (void)worker;
    const sort_work *work = data;
    uint64_t made[BLOCK_MOST];
    uint16_t place[SLICES], *slice_begin = work->block[block].slice_begin;
    size_t begin = block * work->block_entries, end = begin + work->block_entries;
    end = end < work->count ? end : work->count;
    if (work->maker)
        work->maker->make(work->maker->data, begin, end, made);
    else
        memcpy(made, work->from + begin, (end - begin) * sizeof *made);
    count_slices(work, made, end - begin, slice_begin);
    memcpy(place, slice_begin, sizeof place);
    uint64_t *home = work->from + begin;
    for (size_t i = 0; i < end - begin; i++)
        home[place[slice_of(work, made[i])]++] = made[i];
}

/** Cuts the slices into ranges with about as many entries each. */
static void make_ranges(sort_work *work)
{
    uint32_t total[SLICES] = {0};
    for (size_t b = 0; b < work->block_count; b++)
        for (int slice = 0; slice < SLICES; slice++)
            total[slice] +=
                (uint32_t)(work->block[b].slice_begin[slice + 1] - work->block[b].slice_begin[slice]);
    size_t range = 0, begin = 0;
    for (uint32_t slice = 0; slice < SLICES; slice++) {
        while (range + 1 < work->range_count && begin >= work->count * (range + 1) / work->range_count)
            work->range[++range] = (sort_range){slice, begin};
        begin += total[slice];
    }
    while (range < work->range_count)
        work->range[++range] = (sort_range){SLICES, begin};
}

/** A range's entries of one block. */
static const uint64_t *part_of_block(const sort_work *work, size_t block, size_t range, size_t *count)
{
    const uint16_t *slice_begin = work->block[block].slice_begin;
    size_t begin = slice_begin[work->range[range].slice];
    *count = slice_begin[work->range[range + 1].slice] - begin;
    return work->from + block * work->block_entries + begin;
}

/** From all blocks, which lie in order, to the order of the first digit. */
static void gather_range(void *data, int worker, size_t range)
{
    (void)worker;
    const sort_work *work = data;
    uint32_t place[1 << MAX_DIGIT_BITS];
    const uint64_t mask = (UINT64_C(1) << work->digit_bits) - 1;
    memset(place, 0, (size_t)(mask + 1) * sizeof *place);
    for (size_t b = 0, count; b < work->block_count; b++) {
        const uint64_t *entries = part_of_block(work, b, range, &count);
        for (size_t i = 0; i < count; i++)
            place[entries[i] >> work->low_bit & mask]++;
    }
    sum_up(place, mask);
    uint64_t *to = work->to + work->range[range].begin;
    for (size_t b = 0, count; b < work->block_count; b++) {
        const uint64_t *entries = part_of_block(work, b, range, &count);
        for (size_t i = 0; i < count; i++)
            to[place[entries[i] >> work->low_bit & mask]++] = entries[i];
    }
}

static void finish_range(void *data, int worker, size_t range)
{
    (void)worker;
    const sort_work *work = data;
    size_t begin = work->range[range].begin, end = work->range[range + 1].begin;
    uint64_t *home = work->from + begin;
    sort_alone(work, NULL, 1, work->to + begin, home, home, end - begin);
}

static bool sort_together(qm_context *ctx, sort_work *work)
{
    int bits = work->digits * work->digit_bits;
    work->slice_bits = bits < SLICE_BITS ? bits : SLICE_BITS;
    work->slice_shift = work->low_bit + bits - work->slice_bits;
    work->block_entries = clamp(work->count / MANY_BLOCKS, BLOCK_LEAST, BLOCK_MOST);
    work->block_count = (work->count + work->block_entries - 1) / work->block_entries;
    work->range_count = clamp(work->count / RANGE_ENTRIES, (size_t)work->workers, MAX_RANGES);
    work->block = qm_context_alloc(ctx, work->block_count, sizeof *work->block);
    if (!work->block) return false;
    qm_context_share(ctx, work->workers, work->block_count, sort_block_entries, work);
    make_ranges(work);
    qm_context_share(ctx, work->workers, work->range_count, gather_range, work);
    qm_context_share(ctx, work->workers, work->range_count, finish_range, work);
    qm_context_free(ctx, work->block, work->block_count, sizeof *work->block);
    return true;
}

static void sort(qm_context *ctx, sort_work work)
{
    work.workers = (int)clamp(work.count / MIN_SHARE, 1, clamp((size_t)work.workers, 1, MAX_RANGES));
    if (work.workers == 1 || !sort_together(ctx, &work))
        sort_alone(&work, work.maker, 0, work.from, work.to, work.from, work.count);
}

static qm_status sort_with_spare(qm_context *ctx, sort_work work)
{
    if (work.count < 2 || work.digits == 0) return QM_OK;
    work.to = qm_context_alloc(ctx, work.count, sizeof *work.to);
    if (!work.to) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory while sorting");
    sort(ctx, work);
    qm_context_free(ctx, work.to, work.count, sizeof *work.to);
    return QM_OK;
}

static sort_work entry_work(uint64_t *entries, size_t count, int key_bits, int workers)
{
    bool is_wide = key_bits == 2 * WIDE_DIGIT_BITS && count > MANY_ENTRIES;
    int most = is_wide ? WIDE_DIGIT_BITS : ENTRY_DIGIT_BITS, digits = (key_bits + most - 1) / most;
    return (sort_work){.from = entries,
                       .count = count,
                       .workers = workers,
                       .low_bit = QM_RADIX_INDEX_BITS,
                       .digits = digits,
                       .digit_bits = (key_bits + digits - 1) / digits};
}

qm_status qm_radix_sort(qm_context *ctx, uint64_t *entries, size_t count, int key_bits, int workers)
{
    return sort_with_spare(ctx, entry_work(entries, count, key_bits, workers));
}

void qm_radix_sort_made(qm_context *ctx, uint64_t *entries, uint64_t *spare, size_t count, int key_bits,
                        int workers, const qm_radix_maker *maker)
{
    sort_work work = entry_work(entries, count, key_bits, workers);
    work.to = spare;
    work.maker = maker;
    sort(ctx, work);
}

qm_status qm_radix_sort_numbers(qm_context *ctx, uint64_t *numbers, size_t count, int bit_count, int workers)
{
    int digits = (bit_count + MAX_DIGIT_BITS - 1) / MAX_DIGIT_BITS;
    return sort_with_spare(ctx,
                           (sort_work){.from = numbers,
                                       .count = count,
                                       .workers = workers,
                                       .digits = digits,
                                       .digit_bits = digits > 0 ? (bit_count + digits - 1) / digits : 0});
}
