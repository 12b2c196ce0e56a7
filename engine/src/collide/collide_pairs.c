/**
 * collide_pairs.c: pairs are put in order by buckets of their first faces, most of which hold a few pairs.
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

void qm_pair_list_join(qm_pair_list *list, qm_pair_list *other)
{
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
 * How pairs are sorted. A pair is a number: its first face, then its second one in as few bits as do. Buckets
 * are as many first faces each as it takes to have no more buckets than twice the pairs.
 */
typedef struct sorter {
    qm_context *ctx;
    const qm_pair_list *list;
    int b_bits, shift; /* a bucket is what is left of a number shifted down by both */
    size_t bucket_count;
    size_t *end; /* of each bucket; while the numbers are dealt out, where its next goes */
    uint64_t *numbers;
} sorter;

static int bits_of(uint32_t x)
{
    return x > 0 ? 32 - __builtin_clz(x) : 0;
}

static sorter make_sorter(qm_context *ctx, const qm_pair_list *list, const uint32_t last_face[2])
{
    sorter s = {.ctx = ctx, .list = list, .b_bits = bits_of(last_face[1])};
    while (last_face[0] >> s.shift >= 2 * list->count)
        s.shift++;
    s.bucket_count = (last_face[0] >> s.shift) + 1;
    return s;
}

/** Sorts by bucket: counts, then puts every number where its bucket's next one goes. */
static void deal_out(sorter *s)
{
    memset(s->end, 0, (s->bucket_count + 1) * sizeof *s->end);
    size_t *start = s->end + 1;
    for (const qm_pair_block *block = s->list->first; block; block = block->next)
        for (size_t i = 0; i < block->count; i++)
            start[block->pairs[i].a >> s->shift]++;
    size_t sum = 0;
    for (size_t i = 0; i <= s->bucket_count; i++) {
        sum += s->end[i];
        s->end[i] = sum;
    }
    for (const qm_pair_block *block = s->list->first; block; block = block->next) {
        for (size_t i = 0; i < block->count; i++) {
            qm_face_pair pair = block->pairs[i];
            s->numbers[s->end[pair.a >> s->shift]++] = (uint64_t)pair.a << s->b_bits | pair.b;
        }
    }
}

static qm_status sort_buckets(const sorter *s, int thread_count)
{
    const qm_kernel *kernel = qm_kernel_get();
    size_t begin = 0;
    for (size_t i = 0; i < s->bucket_count; i++) {
        uint64_t *bucket = s->numbers + begin;
        size_t count = s->end[i] - begin;
        begin = s->end[i];
        if (count < 2) continue;
        if (count <= QM_SORT_FEW) {
            kernel->sort_few(bucket, (int)count);
            continue;
        }
        qm_status status = qm_radix_sort_numbers(s->ctx, bucket, count, s->b_bits + s->shift, thread_count);
        if (status != QM_OK) return status;
    }
    return QM_OK;
}

/** Writes the different numbers as pairs over themselves; returns how many there are. */
static size_t tell(const sorter *s, size_t count, qm_face_pair *pairs)
{
    const uint64_t b_mask = ((uint64_t)1 << s->b_bits) - 1;
    uint64_t last = UINT64_MAX;
    size_t told = 0;
    for (size_t i = 0; i < count; i++) {
        uint64_t number = s->numbers[i];
        if (number == last) continue;
        last = number;
        pairs[told++] = (qm_face_pair){(uint32_t)(number >> s->b_bits), (uint32_t)(number & b_mask)};
    }
    return told;
}

static qm_face_pair find_least(const qm_pair_list *list)
{
    qm_face_pair least = list->first->pairs[0];
    for (const qm_pair_block *block = list->first; block; block = block->next) {
        for (size_t i = 0; i < block->count; i++) {
            qm_face_pair pair = block->pairs[i];
            if (pair.a < least.a || (pair.a == least.a && pair.b < least.b)) least = pair;
        }
    }
    return least;
}

static qm_status sort_pairs(sorter *s, int thread_count, qm_collision *out)
{
    size_t count = s->list->count;
    deal_out(s);
    qm_status status = sort_buckets(s, thread_count);
    if (status != QM_OK) return status;
    size_t told = tell(s, count, out->pairs);
    if (told < count) {
        qm_face_pair *fitting = qm_context_resize(s->ctx, out->pairs, count, told, sizeof *fitting);
        if (!fitting) return QM_E_NO_MEMORY;
        out->pairs = fitting;
    }
    out->pair_count = told;
    return QM_OK;
}

static qm_status tell_all(qm_context *ctx, const qm_pair_list *list, const uint32_t last_face[2],
                          int thread_count, qm_collision *out)
{
    static_assert(sizeof *out->pairs == sizeof(uint64_t), "numbers become pairs in place");
    sorter s = make_sorter(ctx, list, last_face);
    s.end = qm_context_alloc(ctx, s.bucket_count + 1, sizeof *s.end);
    out->pairs = qm_context_alloc(ctx, list->count, sizeof *out->pairs);
    out->pair_count = list->count;
    s.numbers = (uint64_t *)(void *)out->pairs;
    qm_status status = s.end && out->pairs ? sort_pairs(&s, thread_count, out) : QM_E_NO_MEMORY;
    qm_context_free(ctx, s.end, s.bucket_count + 1, sizeof *s.end);
    return status;
}

qm_status qm_pair_list_finish(qm_context *ctx, const qm_pair_list *list, const uint32_t last_face[2],
                              const qm_collide_options *options, qm_collision *out)
{
    if (list->count == 0) return QM_OK;
    if (options->mode == QM_COLLIDE_ALL) return tell_all(ctx, list, last_face, options->thread_count, out);
    out->pairs = qm_context_alloc(ctx, 1, sizeof *out->pairs);
    if (!out->pairs) return QM_E_NO_MEMORY;
    out->pairs[0] = find_least(list);
    out->pair_count = 1;
    return QM_OK;
}
