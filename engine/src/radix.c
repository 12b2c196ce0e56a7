#include "radix.h"

#include <assert.h>
#include <string.h>

#define DIGIT_BITS 9
enum { DIGITS = (64 - QM_RADIX_INDEX_BITS) / DIGIT_BITS, BUCKETS = 1 << DIGIT_BITS };
static_assert(DIGITS % 2 == 0, "an even number of passes ends where it began");
static_assert(DIGITS * DIGIT_BITS == 64 - QM_RADIX_INDEX_BITS, "the digits make up the key");

#define MIN_RUN 8192 /* entries that make it worth to start another thread */

/** Each worker sorts a run of its own; then runs are merged two by two, every worker a slice of the result.
 */
typedef struct sort_work {
    uint64_t *from, *to;
    size_t count, run; /* entries, and the length of the runs that are sorted already */
    int workers;
} sort_work;

static size_t share(size_t count, int worker, int workers)
{
    return count * (size_t)worker / (size_t)workers;
}

static unsigned digit(uint64_t entry, int d)
{
    return (unsigned)(entry >> (QM_RADIX_INDEX_BITS + d * DIGIT_BITS)) & (BUCKETS - 1);
}

/** Least significant digit first, counting all digits in one pass. */
static void sort_run(uint64_t *from, uint64_t *to, size_t count)
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

static void sort_own_run(void *data, int worker)
{
    const sort_work *work = data;
    size_t begin = work->run * (size_t)worker;
    size_t end = begin + work->run < work->count ? begin + work->run : work->count;
    if (begin < end) sort_run(work->from + begin, work->to + begin, end - begin);
}

/** How many of the first place entries of a merge come from a; equal entries do not occur. */
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

qm_status qm_radix_sort(qm_context *ctx, uint64_t *entries, size_t count, int workers)
{
    if (count < 2) return QM_OK;
    uint64_t *spare = qm_context_alloc(ctx, count, sizeof *spare);
    if (!spare) return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory while sorting");
    while (workers > 1 && count / (size_t)workers < MIN_RUN)
        workers--;
    sort_work work = {.from = entries, .to = spare, .count = count, .workers = workers};
    work.run = (count + (size_t)workers - 1) / (size_t)workers;
    qm_context_parallel(ctx, workers, sort_own_run, &work);
    for (; work.run < count; work.run *= 2) {
        qm_context_parallel(ctx, workers, merge_own_slice, &work);
        uint64_t *swap = work.from;
        work.from = work.to;
        work.to = swap;
    }
    if (work.from != entries) memcpy(entries, work.from, count * sizeof *entries);
    qm_context_free(ctx, spare, count, sizeof *spare);
    return QM_OK;
}
