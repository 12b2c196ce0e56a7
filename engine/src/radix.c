#include "radix.h"

#include <assert.h>
#include <string.h>

#define MAX_DIGIT_BITS 12
#define MAX_DIGITS 6
#define ENTRY_DIGIT_BITS 10 /* at most: places that the first caches hold; or */
#define WIDE_DIGIT_BITS 12  /* for so many entries that a pass less is worth it: */
#define MANY_ENTRIES 16384
#define MIN_RUN 8192 /* entries that make it worth to start another thread */

/** Each worker sorts a run of its own; then runs are merged two by two, every worker a slice of the result.
 */
typedef struct sort_work {
    uint64_t *from, *to;
    size_t count, run; /* entries, and the length of the runs that are sorted already */
    int workers;
    int low_bit, digits, digit_bits; /* what is sorted by: entries have a low bit, numbers none */
} sort_work;

static size_t share(size_t count, int worker, int workers)
{
    return count * (size_t)worker / (size_t)workers;
}

/** Least significant digit first, counting all digits in one pass. */
static inline void sort_digits(uint64_t *from, uint64_t *to, size_t count, int low_bit, int digits,
                               int digit_bits)
{
    uint32_t place[MAX_DIGITS][1 << MAX_DIGIT_BITS];
    const uint64_t mask = (UINT64_C(1) << digit_bits) - 1;
    memset(place, 0, (size_t)digits * sizeof place[0]);
    for (size_t i = 0; i < count; i++)
        for (int d = 0; d < digits; d++)
            place[d][from[i] >> (low_bit + d * digit_bits) & mask]++;
    uint64_t *home = from;
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
static void sort_run(const sort_work *work, uint64_t *from, uint64_t *to, size_t count)
{
    if (work->low_bit == 0)
        sort_digits(from, to, count, 0, work->digits, work->digit_bits);
    else if (work->digits == 3 && work->digit_bits == 8)
        sort_digits(from, to, count, QM_RADIX_INDEX_BITS, 3, 8);
    else if (work->digits == 2 && work->digit_bits == WIDE_DIGIT_BITS)
        sort_digits(from, to, count, QM_RADIX_INDEX_BITS, 2, WIDE_DIGIT_BITS);
    else if (work->digits == 3 && work->digit_bits == 10)
        sort_digits(from, to, count, QM_RADIX_INDEX_BITS, 3, 10);
    else
        sort_digits(from, to, count, QM_RADIX_INDEX_BITS, work->digits, work->digit_bits);
}

static void sort_own_run(void *data, int worker)
{
    const sort_work *work = data;
    size_t begin = work->run * (size_t)worker;
    size_t end = begin + work->run < work->count ? begin + work->run : work->count;
    if (begin < end) sort_run(work, work->from + begin, work->to + begin, end - begin);
}

/** How many of the first place entries of a merge come from a; of equal entries those of b come first. */
static size_t merge_rank(const uint64_t *a, size_t a_count, const uint64_t *b, size_t b_count, size_t place)
{
    size_t low = place > b_count ? place - b_count : 0, high = place < a_count ? place : a_count;
    while (low < high) {
        size_t middle = (low + high) / 2;
        if (a[middle] < b[place - middle - 1])
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/** Entries [begin, end) of the merge of a and b. */
static void merge_slice(const uint64_t *a, size_t a_count, const uint64_t *b, size_t b_count, uint64_t *out,
                        size_t begin, size_t end)
{
    size_t i = merge_rank(a, a_count, b, b_count, begin), j = begin - i;
    for (size_t k = begin; k < end; k++)
        out[k] = j == b_count || (i < a_count && a[i] < b[j]) ? a[i++] : b[j++];
}

static void merge_own_slice(void *data, int worker)
{
    const sort_work *work = data;
    size_t begin = share(work->count, worker, work->workers),
           end = share(work->count, worker + 1, work->workers);
    size_t pair = 2 * work->run;
    for (size_t start = begin / pair * pair; start < end; start += pair) {
        size_t left = work->count - start, a_count = left < work->run ? left : work->run;
        size_t b_count = left - a_count < work->run ? left - a_count : work->run;
        size_t first = begin > start ? begin - start : 0;
        size_t last = end - start < a_count + b_count ? end - start : a_count + b_count;
        merge_slice(work->from + start, a_count, work->from + start + a_count, b_count, work->to + start,
                    first, last);
    }
}

static qm_status sort(qm_context *ctx, sort_work work)
{
    if (work.count < 2) return QM_OK;
    uint64_t *entries = work.from, *spare = qm_context_alloc(ctx, work.count, sizeof *spare);
    if (!spare) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory while sorting");
    while (work.workers > 1 && work.count / (size_t)work.workers < MIN_RUN)
        work.workers--;
    work.to = spare;
    work.run = (work.count + (size_t)work.workers - 1) / (size_t)work.workers;
    qm_context_parallel(ctx, work.workers, sort_own_run, &work);
    for (; work.run < work.count; work.run *= 2) {
        qm_context_parallel(ctx, work.workers, merge_own_slice, &work);
        uint64_t *swap = work.from;
        work.from = work.to;
        work.to = swap;
    }
    if (work.from != entries) memcpy(entries, work.from, work.count * sizeof *entries);
    qm_context_free(ctx, spare, work.count, sizeof *spare);
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
