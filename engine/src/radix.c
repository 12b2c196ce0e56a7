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
#define BLOCK_ENTRIES 512  /* about so many to a block, */
#define RANGE_ENTRIES 8192 /* and to a range, which the second caches then hold, */
#define MAX_BLOCKS 32      /* as long as there are not more of either */
#define MAX_RANGES 64

/**
 * With more workers than one the entries are sorted by blocks and ranges, which the workers share. Each block
 * counts its entries by their leading bits; runs of these slices make ranges of about the same size; each
 * block moves its entries to the ranges that they belong to, and then each range is sorted.
 */
typedef struct sort_block {
    uint32_t slice_count[SLICES];
    uint32_t place[MAX_RANGES]; /* where the block's entries of each range go */
} sort_block;

typedef struct sort_work {
    uint64_t *from, *to;
    size_t count;
    const qm_radix_maker *maker; /* writes the entries; NULL when they are there */
    int workers;
    int low_bit, digits, digit_bits; /* what is sorted by: entries have a low bit, numbers none */
    int slice_shift, slice_bits;
    sort_block *block;
    size_t block_count, range_count;
    uint8_t range_of[SLICES];
    size_t range_begin[MAX_RANGES + 1];
} sort_work;

static size_t clamp(size_t a, size_t least, size_t most)
{
    return a < least ? least : a > most ? most : a;
}

static size_t chunk_end(size_t begin, size_t end)
{
    return end - begin < CHUNK ? end : begin + CHUNK;
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
static void sort_alone(const sort_work *work, const qm_radix_maker *maker, uint64_t *from, uint64_t *to,
                       uint64_t *home, size_t count)
{
    if (work->low_bit == 0)
        sort_digits(maker, from, to, home, count, 0, work->digits, work->digit_bits);
    else if (work->digits == 3 && work->digit_bits == 8)
        sort_digits(maker, from, to, home, count, QM_RADIX_INDEX_BITS, 3, 8);
    else if (work->digits == 2 && work->digit_bits == WIDE_DIGIT_BITS)
        sort_digits(maker, from, to, home, count, QM_RADIX_INDEX_BITS, 2, WIDE_DIGIT_BITS);
    else if (work->digits == 3 && work->digit_bits == 10)
        sort_digits(maker, from, to, home, count, QM_RADIX_INDEX_BITS, 3, 10);
    else
        sort_digits(maker, from, to, home, count, QM_RADIX_INDEX_BITS, work->digits, work->digit_bits);
}

static size_t block_begin(const sort_work *work, size_t block)
{
    return work->count * block / work->block_count;
}

static uint32_t slice_of(const sort_work *work, uint64_t entry)
{
    return (uint32_t)(entry >> work->slice_shift) & ((1u << work->slice_bits) - 1);
}

static void count_block(void *data, int worker, size_t block)
{
    (void)worker;
    const sort_work *work = data;
    const qm_radix_maker *maker = work->maker;
    uint32_t *count = work->block[block].slice_count, odd[SLICES] = {0};
    memset(count, 0, sizeof odd);
    for (size_t begin = block_begin(work, block), last = block_begin(work, block + 1); begin < last;) {
        size_t end = chunk_end(begin, last);
        if (maker) maker->make(maker->data, begin, end, work->from + begin);
        for (; begin + 1 < end;
             begin += 2) { /* neighbours are often of one slice: none waits for the other */
            count[slice_of(work, work->from[begin])]++;
            odd[slice_of(work, work->from[begin + 1])]++;
        }
        if (begin < end) count[slice_of(work, work->from[begin++])]++;
    }
    for (int slice = 0; slice < SLICES; slice++)
        count[slice] += odd[slice];
}

/** Makes ranges with about as many entries each from runs of slices; slices ends with the last. */
static void make_ranges(sort_work *work, uint32_t slice_begin[MAX_RANGES + 1])
{
    uint32_t total[SLICES] = {0};
    for (size_t b = 0; b < work->block_count; b++)
        for (uint32_t slice = 0; slice < SLICES; slice++)
            total[slice] += work->block[b].slice_count[slice];
    size_t range = 0, begin = 0;
    slice_begin[0] = 0;
    for (uint32_t slice = 0; slice < SLICES; slice++) {
        while (range + 1 < work->range_count && begin >= work->count * (range + 1) / work->range_count) {
            work->range_begin[++range] = begin;
            slice_begin[range] = slice;
        }
        work->range_of[slice] = (uint8_t)range;
        begin += total[slice];
    }
    while (range < work->range_count) {
        work->range_begin[++range] = begin;
        slice_begin[range] = SLICES;
    }
}

/** Tells every block where its entries go. */
static void deal_out(sort_work *work)
{
    uint32_t slice_begin[MAX_RANGES + 1];
    make_ranges(work, slice_begin);
    for (size_t r = 0; r < work->range_count; r++) {
        uint32_t next = (uint32_t)work->range_begin[r];
        for (size_t b = 0; b < work->block_count; b++) {
            work->block[b].place[r] = next;
            for (uint32_t slice = slice_begin[r]; slice < slice_begin[r + 1]; slice++)
                next += work->block[b].slice_count[slice];
        }
    }
}

/** Moves a block's entries to the ranges that they belong to, after those of the blocks before it. */
static void move_block(void *data, int worker, size_t block)
{
    (void)worker;
    const sort_work *work = data;
    uint32_t place[MAX_RANGES];
    memcpy(place, work->block[block].place, sizeof place);
    for (size_t i = block_begin(work, block); i < block_begin(work, block + 1); i++)
        work->to[place[work->range_of[slice_of(work, work->from[i])]]++] = work->from[i];
}

static void sort_range(void *data, int worker, size_t range)
{
    (void)worker;
    const sort_work *work = data;
    size_t begin = work->range_begin[range], end = work->range_begin[range + 1];
    uint64_t *home = work->from + begin;
    sort_alone(work, NULL, work->to + begin, home, home, end - begin);
}

static bool sort_together(qm_context *ctx, sort_work *work)
{
    int bits = work->digits * work->digit_bits;
    work->slice_bits = bits < SLICE_BITS ? bits : SLICE_BITS;
    work->slice_shift = work->low_bit + bits - work->slice_bits;
    work->block_count = clamp(work->count / BLOCK_ENTRIES, (size_t)work->workers, MAX_BLOCKS);
    work->range_count = clamp(work->count / RANGE_ENTRIES, (size_t)work->workers, MAX_RANGES);
    work->block = qm_context_alloc(ctx, work->block_count, sizeof *work->block);
    if (!work->block) return false;
    qm_context_share(ctx, work->workers, work->block_count, count_block, work);
    deal_out(work);
    qm_context_share(ctx, work->workers, work->block_count, move_block, work);
    qm_context_share(ctx, work->workers, work->range_count, sort_range, work);
    qm_context_free(ctx, work->block, work->block_count, sizeof *work->block);
    return true;
}

static void sort(qm_context *ctx, sort_work work)
{
    work.workers = (int)clamp(work.count / MIN_SHARE, 1, clamp((size_t)work.workers, 1, MAX_BLOCKS));
    if (work.workers == 1 || !sort_together(ctx, &work))
        sort_alone(&work, work.maker, work.from, work.to, work.from, work.count);
}

static qm_status sort_with_spare(qm_context *ctx, sort_work work)
{
    if (work.count < 2) return QM_OK;
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
