/**
 * collide_pairs.c: lists of pairs, sorted by buckets of their first faces. A face meets few others, so that
 * most buckets hold a few pairs, which a sorting network puts in order.
 */
#include "collide_pairs.h"

#include <assert.h>
#include <string.h>

#include "bvh/kernel.h"
#include "core/radix.h"

bool qm_pair_list_grow(qm_context *ctx, qm_pair_list *list)
{
    qm_pair_block *block = qm_context_alloc(ctx, 1, sizeof *block);
    if (!block) return false;
    block->next = list->first;
    block->count = 0;
    list->first = block;
    return true;
}

void qm_pair_list_append(qm_pair_list *list, qm_pair_list *other)
{
    QM_ASSERT(list != other);
    qm_pair_block **end = &other->first;
    while (*end)
        end = &(*end)->next;
    *end = list->first;
    list->first = other->first;
    list->count += other->count;
    *other = (qm_pair_list){0};
}

void qm_pair_list_reset(qm_context *ctx, qm_pair_list *list)
{
    while (list->first) {
        qm_pair_block *next = list->first->next;
        qm_context_free(ctx, list->first, 1, sizeof *list->first);
        list->first = next;
    }
    list->count = 0;
}

/**
 * A pair is sorted as a number: its first face, then its second one in as few bits as it needs. A bucket is a
 * range of 2^shift first faces, with the smallest shift that makes at most twice as many buckets as pairs.
 */
typedef struct sorter {
    qm_context *ctx;
    const qm_pair_list *list;
    int b_bits, shift; /* a number's bucket is number >> (b_bits + shift) */
    size_t bucket_count;
    size_t *end; /* of each bucket; while the buckets are filled, where its next number goes */
    uint64_t *numbers;
} sorter;

static qm_status sort_buckets(const sorter *s, int thread_count)
{
    const qm_kernel *kernel = qm_kernel_get();
    size_t begin = 0;
    for (size_t i = 0; i < s->bucket_count; i++) {
        uint64_t *bucket = s->numbers + begin;
        size_t count = s->end[i] - begin;
        begin = s->end[i];
        if (count < 2) continue;
        if (count <= QM_SORT_SMALL_MAX) {
            kernel->sort_small(bucket, (int)count);
            continue;
        }
        qm_status status = qm_radix_sort_numbers(s->ctx, bucket, count, s->b_bits + s->shift, thread_count);
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

static qm_status sort_list(qm_context *ctx, const qm_pair_list *list, const uint32_t last_face[2],
                           int thread_count, qm_collision *out)
{
    static_assert(sizeof *out->pairs == sizeof(uint64_t), "numbers become pairs in place");
    size_t count = list->count, written = 0;
    sorter s = {.ctx = ctx, .list = list, .b_bits = last_face[1] > 0 ? 32 - __builtin_clz(last_face[1]) : 0};
    while (last_face[0] >> s.shift >= 2 * count)
        s.shift++;
    s.bucket_count = (last_face[0] >> s.shift) + 1;
    s.end = qm_context_alloc(ctx, s.bucket_count + 1, sizeof *s.end);
    out->pairs = qm_context_alloc(ctx, count, sizeof *out->pairs);
    out->pair_count = out->pairs ? count : 0;
    s.numbers = (uint64_t *)(void *)out->pairs;
    qm_status status = s.end && out->pairs ? QM_OK : QM_E_NO_MEMORY;
    if (status == QM_OK) {
        /* Sort by bucket: count, take the prefix sums, then write each number to the next slot of its bucket. */
        memset(s.end, 0, (s.bucket_count + 1) * sizeof *s.end);
        size_t *start = s.end + 1;
        for (const qm_pair_block *block = s.list->first; block; block = block->next)
            for (size_t i = 0; i < block->count; i++)
                start[block->pairs[i].a >> s.shift]++;
        size_t sum = 0;
        for (size_t i = 0; i <= s.bucket_count; i++) {
            sum += s.end[i];
            s.end[i] = sum;
        }
        for (const qm_pair_block *block = s.list->first; block; block = block->next) {
            for (size_t i = 0; i < block->count; i++) {
                qm_face_pair pair = block->pairs[i];
                QM_ASSERT((uint64_t)pair.b >> s.b_bits == 0);
                s.numbers[s.end[pair.a >> s.shift]++] = (uint64_t)pair.a << s.b_bits | pair.b;
            }
        }
        status = sort_buckets(&s, thread_count);
    }
    qm_context_free(ctx, s.end, s.bucket_count + 1, sizeof *s.end);
    if (status != QM_OK) return status;

    /* The numbers become pairs in place, each once. */
    const uint64_t b_mask = ((uint64_t)1 << s.b_bits) - 1;
    uint64_t last = UINT64_MAX;
    for (size_t i = 0; i < count; i++) {
        uint64_t number = s.numbers[i];
        if (number == last) continue;
        last = number;
        out->pairs[written++] = (qm_face_pair){(uint32_t)(number >> s.b_bits), (uint32_t)(number & b_mask)};
    }
    QM_ASSERT(written > 0 && written <= count);
    if (written < count) {
        qm_face_pair *fitting = qm_context_resize(ctx, out->pairs, count, written, sizeof *fitting);
        if (!fitting) return QM_E_NO_MEMORY;
        out->pairs = fitting;
    }
    out->pair_count = written;
    return QM_OK;
}

qm_status qm_pair_list_finish(qm_context *ctx, const qm_pair_list *list, const uint32_t last_face[2],
                              const qm_collide_options *options, qm_collision *out)
{
    if (list->count == 0) return QM_OK;
    if (options->mode == QM_COLLIDE_ALL) return sort_list(ctx, list, last_face, options->thread_count, out);
    out->pairs = qm_context_alloc(ctx, 1, sizeof *out->pairs);
    if (!out->pairs) return QM_E_NO_MEMORY;
    qm_face_pair first = list->first->pairs[0];
    for (const qm_pair_block *block = list->first; block; block = block->next) {
        for (size_t i = 0; i < block->count; i++) {
            qm_face_pair pair = block->pairs[i];
            if (pair.a < first.a || (pair.a == first.a && pair.b < first.b)) first = pair;
        }
    }
    out->pairs[0] = first;
    out->pair_count = 1;
    return QM_OK;
}
