/**
 * radix.c: least significant digit first.
 *
 * One worker counts all digits in one pass, then distributes once for each digit. With more workers the
 * entries are in parts, which the workers share: for each digit they count the entries of every part, and
 * then every part distributes its own to where those of the parts before it end.
 */
#include "radix.h"

#include <string.h>

#define MAX_DIGIT_BITS 12
#define MAX_DIGITS 6
#define ENTRY_DIGIT_BITS 10 /* at most: as many counters as the L1 cache holds; or */
#define WIDE_DIGIT_BITS 12  /* for more than MANY_ENTRIES entries, where it saves a pass */
#define MANY_ENTRIES 16384
#define MIN_SHARE 2048 /* entries of a thread: fewer do not pay for its start */
#define CHUNK 512      /* entries that are produced, then counted while they are in the cache */
#define PART_ENTRIES 8192
#define MAX_PARTS 2 /* for each worker: one on a busy processor does fewer */

typedef struct sort_work {
    uint64_t *from, *to;
    size_t count;
    const qm_radix_producer *producer; /* NULL when the entries exist */
    int workers;
    int low_bit, digits, digit_bits; /* the bits to sort by: low_bit is 0 for numbers */
    int digit;                       /* the current one, for several workers */
    size_t part_count;
    uint32_t *counter; /* of each part, by the digit: a count, then the index of the next entry */
} sort_work;

static size_t clamp(size_t a, size_t min, size_t max)
{
    return a < min ? min : a > max ? max : a;
}

static size_t chunk_end(size_t begin, size_t end)
{
    return end - begin < CHUNK ? end : begin + CHUNK;
}

/** Exclusive prefix sum: from counts to the index of the first entry of each digit. */
static inline void prefix_sum(uint32_t *counter, uint64_t last)
{
    uint32_t start = 0;
    for (uint64_t b = 0; b <= last; b++) {
        uint32_t here = counter[b];
        counter[b] = start;
        start += here;
    }
}

/** Sorts by all digits, counted in one pass; the result is in from. */
static inline void sort_digits(const qm_radix_producer *producer, uint64_t *from, uint64_t *to, size_t count,
                               int low_bit, int digits, int digit_bits)
{
    QM_ASSERT(digits <= MAX_DIGITS && digit_bits <= MAX_DIGIT_BITS);
    uint32_t counter[MAX_DIGITS << MAX_DIGIT_BITS];
    const uint64_t mask = (UINT64_C(1) << digit_bits) - 1;
    memset(counter, 0, ((size_t)digits << digit_bits) * sizeof *counter);
    for (size_t begin = 0; begin < count; begin += CHUNK) {
        size_t end = chunk_end(begin, count);
        if (producer) producer->produce(producer->data, begin, end, from + begin);
        for (size_t i = begin; i < end; i++)
            for (int d = 0; d < digits; d++)
                counter[((size_t)d << digit_bits) + (from[i] >> (low_bit + d * digit_bits) & mask)]++;
    }
    for (int d = 0; d < digits; d++) {
        uint32_t *next = counter + ((size_t)d << digit_bits);
        prefix_sum(next, mask);
        for (size_t i = 0; i < count; i++)
            to[next[from[i] >> (low_bit + d * digit_bits) & mask]++] = from[i];
        uint64_t *swap = from;
        from = to;
        to = swap;
    }
    if (digits % 2 == 1) memcpy(to, from, count * sizeof *to);
}

/** The usual widths of entries have loops in which the digits are constants. */
static void sort_serial(const sort_work *work)
{
    const qm_radix_producer *producer = work->producer;
    uint64_t *from = work->from, *to = work->to;
    size_t count = work->count;
    if (work->low_bit == QM_RADIX_INDEX_BITS && work->digits == 2 && work->digit_bits == 9)
        sort_digits(producer, from, to, count, QM_RADIX_INDEX_BITS, 2, 9);
    else if (work->low_bit == QM_RADIX_INDEX_BITS && work->digits == 3 && work->digit_bits == 8)
        sort_digits(producer, from, to, count, QM_RADIX_INDEX_BITS, 3, 8);
    else if (work->low_bit == QM_RADIX_INDEX_BITS && work->digits == 2 && work->digit_bits == WIDE_DIGIT_BITS)
        sort_digits(producer, from, to, count, QM_RADIX_INDEX_BITS, 2, WIDE_DIGIT_BITS);
    else if (work->low_bit == QM_RADIX_INDEX_BITS && work->digits == 3 && work->digit_bits == WIDE_DIGIT_BITS)
        sort_digits(producer, from, to, count, QM_RADIX_INDEX_BITS, 3, WIDE_DIGIT_BITS);
    else if (work->low_bit == QM_RADIX_INDEX_BITS && work->digits == 3 && work->digit_bits == 10)
        sort_digits(producer, from, to, count, QM_RADIX_INDEX_BITS, 3, 10);
    else
        sort_digits(producer, from, to, count, work->low_bit, work->digits, work->digit_bits);
}

static uint32_t *part_counters(const sort_work *work, size_t part)
{
    return work->counter + (part << work->digit_bits);
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
    uint32_t *counter = part_counters(work, part);
    memset(counter, 0, (mask + 1) * sizeof *counter);
    size_t begin, end;
    part_range(work, part, &begin, &end);
    for (size_t next; begin < end; begin = next) {
        next = chunk_end(begin, end);
        if (work->producer) work->producer->produce(work->producer->data, begin, next, work->from + begin);
        for (size_t i = begin; i < next; i++)
            counter[from[i] >> shift & mask]++;
    }
}

/** Exclusive prefix sum over digits, and over parts within a digit. */
static void prefix_sum_parts(const sort_work *work)
{
    uint32_t start = 0;
    for (size_t value = 0; value >> work->digit_bits == 0; value++) {
        for (size_t part = 0; part < work->part_count; part++) {
            uint32_t *counter = part_counters(work, part) + value, here = *counter;
            *counter = start;
            start += here;
        }
    }
}

static void distribute_part(void *data, int worker, size_t part)
{
    (void)worker;
    const sort_work *work = data;
    const uint64_t *from = work->from, mask = (UINT64_C(1) << work->digit_bits) - 1;
    const int shift = work->low_bit + work->digit * work->digit_bits;
    uint32_t *counter = part_counters(work, part);
    uint64_t *to = work->to;
    size_t begin, end;
    part_range(work, part, &begin, &end);
    for (size_t i = begin; i < end; i++)
        to[counter[from[i] >> shift & mask]++] = from[i];
}

static void copy_part(void *data, int worker, size_t part)
{
    (void)worker;
    const sort_work *work = data;
    size_t begin, end;
    part_range(work, part, &begin, &end);
    memcpy(work->to + begin, work->from + begin, (end - begin) * sizeof *work->to);
}

/** Sorts with several workers. False when there is no memory for the counters. */
static bool sort_parallel(qm_context *ctx, sort_work work)
{
    size_t workers = (size_t)work.workers;
    work.part_count = clamp(work.count / PART_ENTRIES, workers, MAX_PARTS * workers);
    size_t counters = work.part_count << work.digit_bits;
    work.counter = qm_context_alloc(ctx, counters, sizeof *work.counter);
    if (!work.counter) return false;
    for (; work.digit < work.digits; work.digit++) {
        qm_context_parallel_for(ctx, work.workers, work.part_count, count_part, &work);
        prefix_sum_parts(&work);
        qm_context_parallel_for(ctx, work.workers, work.part_count, distribute_part, &work);
        uint64_t *swap = work.from;
        work.from = work.to;
        work.to = swap;
        work.producer = NULL; /* the entries exist now */
    }
    if (work.digits % 2 == 1) qm_context_parallel_for(ctx, work.workers, work.part_count, copy_part, &work);
    qm_context_free(ctx, work.counter, counters, sizeof *work.counter);
    return true;
}

static void sort(qm_context *ctx, sort_work work)
{
    work.workers = (int)clamp(work.count / MIN_SHARE, 1, clamp((size_t)work.workers, 1, work.count));
    if (work.workers == 1 || !sort_parallel(ctx, work)) sort_serial(&work);
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
    bool is_wide = key_bits % WIDE_DIGIT_BITS == 0 && count > MANY_ENTRIES;
    int max_bits = is_wide ? WIDE_DIGIT_BITS : ENTRY_DIGIT_BITS,
        digits = (key_bits + max_bits - 1) / max_bits;
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

void qm_radix_sort_produced(qm_context *ctx, uint64_t *entries, uint64_t *spare, size_t count, int key_bits,
                            int workers, const qm_radix_producer *producer)
{
    sort_work work = entry_work(entries, count, key_bits, workers);
    work.to = spare;
    work.producer = producer;
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
