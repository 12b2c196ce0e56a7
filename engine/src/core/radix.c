#include "radix.h"

#include <assert.h>
#include <string.h>

#define MAX_DIGIT_BITS 12
#define MAX_DIGITS 6
#define ENTRY_DIGIT_BITS 10 /* at most: places that the first caches hold; or */
#define WIDE_DIGIT_BITS 12  /* for so many entries that a pass less is worth it: */
#define MANY_ENTRIES 16384
#define MIN_SHARE 2048 /* entries that make it worth to start another thread */
#define CHUNK 512      /* entries that are made, then counted while they are at hand */
#define PART_ENTRIES 8192
#define MOST_PARTS 2 /* for each worker: one on a busy processor does fewer */

/**
 * With more workers than one the entries are sorted by parts, which the workers share: for each digit they
 * are counted in every part, and then every part puts its own where those of the parts before it end.
 */
typedef struct sort_work {
    uint64_t *from, *to;
    size_t count;
    const qm_radix_maker *maker; /* writes the entries; NULL when they are there */
    int workers;
    int low_bit, digits, digit_bits; /* what is sorted by: entries have a low bit, numbers none */
    int digit;                       /* at hand, where workers share */
    size_t part_count;
    uint32_t
        *place; /* of each part, by the digit: how many entries there are, then where the next one goes */
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

/** Least significant digit first, counting all digits in one pass; back to from. */
static inline void sort_digits(const qm_radix_maker *maker, uint64_t *from, uint64_t *to, size_t count,
                               int low_bit, int digits, int digit_bits)
{
    uint32_t place[MAX_DIGITS << MAX_DIGIT_BITS];
    const uint64_t mask = (UINT64_C(1) << digit_bits) - 1;
    memset(place, 0, ((size_t)digits << digit_bits) * sizeof *place);
    for (size_t begin = 0; begin < count; begin += CHUNK) {
        size_t end = chunk_end(begin, count);
        if (maker) maker->make(maker->data, begin, end, from + begin);
        for (size_t i = begin; i < end; i++)
            for (int d = 0; d < digits; d++)
                place[((size_t)d << digit_bits) + (from[i] >> (low_bit + d * digit_bits) & mask)]++;
    }
    for (int d = 0; d < digits; d++) {
        uint32_t *next = place + ((size_t)d << digit_bits);
        sum_up(next, mask);
        for (size_t i = 0; i < count; i++)
            to[next[from[i] >> (low_bit + d * digit_bits) & mask]++] = from[i];
        uint64_t *swap = from;
        from = to;
        to = swap;
    }
    if (digits % 2 == 1) memcpy(to, from, count * sizeof *to);
}

/** Entries have loops of their own, in which the compiler knows the digits. */
static void sort_alone(const sort_work *work)
{
    const qm_radix_maker *maker = work->maker;
    uint64_t *from = work->from, *to = work->to;
    size_t count = work->count;
    if (work->low_bit == QM_RADIX_INDEX_BITS && work->digits == 2 && work->digit_bits == 9)
        sort_digits(maker, from, to, count, QM_RADIX_INDEX_BITS, 2, 9);
    else if (work->low_bit == QM_RADIX_INDEX_BITS && work->digits == 3 && work->digit_bits == 8)
        sort_digits(maker, from, to, count, QM_RADIX_INDEX_BITS, 3, 8);
    else if (work->low_bit == QM_RADIX_INDEX_BITS && work->digits == 2 && work->digit_bits == WIDE_DIGIT_BITS)
        sort_digits(maker, from, to, count, QM_RADIX_INDEX_BITS, 2, WIDE_DIGIT_BITS);
    else if (work->low_bit == QM_RADIX_INDEX_BITS && work->digits == 3 && work->digit_bits == 10)
        sort_digits(maker, from, to, count, QM_RADIX_INDEX_BITS, 3, 10);
    else
        sort_digits(maker, from, to, count, work->low_bit, work->digits, work->digit_bits);
}

static uint32_t *part_places(const sort_work *work, size_t part)
{
    return work->place + (part << work->digit_bits);
}

static void part_range(const sort_work *work, size_t part, size_t *begin, size_t *end)
{
    *begin = work->count * part / work->part_count;
    *end = work->count * (part + 1) / work->part_count;
}

static void count_part(void *data, int worker, size_t part)
{
    (void)worker;
    const sort_work *work = data;
    const uint64_t *from = work->from, mask = (UINT64_C(1) << work->digit_bits) - 1;
    const int shift = work->low_bit + work->digit * work->digit_bits;
    uint32_t *place = part_places(work, part);
    memset(place, 0, (mask + 1) * sizeof *place);
    size_t begin, end;
    part_range(work, part, &begin, &end);
    for (size_t next; begin < end; begin = next) {
        next = chunk_end(begin, end);
        if (work->maker) work->maker->make(work->maker->data, begin, next, work->from + begin);
        for (size_t i = begin; i < next; i++)
            place[from[i] >> shift & mask]++;
    }
}

/** From the counts of all parts to the places of the first entries of each. */
static void sum_up_parts(const sort_work *work)
{
    uint32_t start = 0;
    for (size_t value = 0; value >> work->digit_bits == 0; value++) {
        for (size_t part = 0; part < work->part_count; part++) {
            uint32_t *place = part_places(work, part) + value, here = *place;
            *place = start;
            start += here;
        }
    }
}

static void deal_part(void *data, int worker, size_t part)
{
    (void)worker;
    const sort_work *work = data;
    const uint64_t *from = work->from, mask = (UINT64_C(1) << work->digit_bits) - 1;
    const int shift = work->low_bit + work->digit * work->digit_bits;
    uint32_t *place = part_places(work, part);
    uint64_t *to = work->to;
    size_t begin, end;
    part_range(work, part, &begin, &end);
    for (size_t i = begin; i < end; i++)
        to[place[from[i] >> shift & mask]++] = from[i];
}

static void copy_part(void *data, int worker, size_t part)
{
    (void)worker;
    const sort_work *work = data;
    size_t begin, end;
    part_range(work, part, &begin, &end);
    memcpy(work->to + begin, work->from + begin, (end - begin) * sizeof *work->to);
}

static bool sort_together(qm_context *ctx, sort_work work)
{
    size_t workers = (size_t)work.workers;
    work.part_count = clamp(work.count / PART_ENTRIES, workers, MOST_PARTS * workers);
    size_t places = work.part_count << work.digit_bits;
    work.place = qm_context_alloc(ctx, places, sizeof *work.place);
    if (!work.place) return false;
    for (; work.digit < work.digits; work.digit++) {
        qm_context_share(ctx, work.workers, work.part_count, count_part, &work);
        sum_up_parts(&work);
        qm_context_share(ctx, work.workers, work.part_count, deal_part, &work);
        uint64_t *swap = work.from;
        work.from = work.to;
        work.to = swap;
        work.maker = NULL; /* they are there now */
    }
    if (work.digits % 2 == 1) qm_context_share(ctx, work.workers, work.part_count, copy_part, &work);
    qm_context_free(ctx, work.place, places, sizeof *work.place);
    return true;
}

static void sort(qm_context *ctx, sort_work work)
{
    work.workers = (int)clamp(work.count / MIN_SHARE, 1, clamp((size_t)work.workers, 1, work.count));
    if (work.workers == 1 || !sort_together(ctx, work)) sort_alone(&work);
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
