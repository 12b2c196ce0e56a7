#include "collide_pairs.h"

#include <string.h>

#include "radix.h"

#define FIRST_CAPACITY 1024

static bool reserve(qm_context *ctx, qm_pair_list *list, size_t count)
{
    if (count <= list->capacity) return true;
    size_t capacity = list->capacity > 0 ? list->capacity : FIRST_CAPACITY;
    while (capacity < count)
        capacity *= 2;
    uint64_t *grown = qm_context_resize(ctx, list->pairs, list->capacity, capacity, sizeof *grown);
    if (!grown) return false;
    list->pairs = grown;
    list->capacity = capacity;
    return true;
}

bool qm_pair_list_add(qm_context *ctx, qm_pair_list *list, uint32_t a, uint32_t b)
{
    if (!reserve(ctx, list, list->count + 1)) return false;
    list->pairs[list->count++] = (uint64_t)a << 32 | b;
    return true;
}

bool qm_pair_list_join(qm_context *ctx, qm_pair_list *list, qm_pair_list *other)
{
    if (list->count == 0) {
        qm_pair_list swap = *list;
        *list = *other;
        *other = swap;
    } else if (other->count > 0) {
        if (!reserve(ctx, list, list->count + other->count)) return false;
        memcpy(list->pairs + list->count, other->pairs, other->count * sizeof *other->pairs);
        list->count += other->count;
    }
    qm_pair_list_reset(ctx, other);
    return true;
}

void qm_pair_list_reset(qm_context *ctx, qm_pair_list *list)
{
    qm_context_free(ctx, list->pairs, list->capacity, sizeof *list->pairs);
    *list = (qm_pair_list){0};
}

static int bits_of(uint64_t x)
{
    return x > 0 ? 64 - __builtin_clzll(x) : 0;
}

/** Moves a and b together, so that no time goes into bits that are 0 in all pairs. Returns the bits of b. */
static int squeeze(qm_pair_list *list, int *bit_count)
{
    uint64_t all = 0;
    for (size_t i = 0; i < list->count; i++)
        all |= list->pairs[i];
    int b_bits = bits_of(all & UINT32_MAX);
    for (size_t i = 0; i < list->count; i++)
        list->pairs[i] = list->pairs[i] >> 32 << b_bits | (list->pairs[i] & UINT32_MAX);
    *bit_count = bits_of(all >> 32) + b_bits;
    return b_bits;
}

static void tell(const qm_pair_list *list, int b_bits, qm_collision *out)
{
    uint64_t b_mask = ((uint64_t)1 << b_bits) - 1;
    for (size_t i = 0; i < list->count; i++) {
        uint64_t pair = list->pairs[i];
        if (i > 0 && pair == list->pairs[i - 1]) continue;
        out->pairs[out->pair_count++] = (qm_face_pair){(uint32_t)(pair >> b_bits), (uint32_t)(pair & b_mask)};
    }
}

qm_status qm_pair_list_finish(qm_context *ctx, qm_pair_list *list, const qm_collide_options *options,
                              qm_collision *out)
{
    if (list->count == 0) return QM_OK;
    int bit_count, b_bits = squeeze(list, &bit_count);
    qm_status status = qm_radix_sort_numbers(ctx, list->pairs, list->count, bit_count, options->thread_count);
    if (status != QM_OK) return status;
    size_t different = 1;
    if (options->mode != QM_COLLIDE_ALL) list->count = 1;
    for (size_t i = 1; i < list->count; i++)
        different += list->pairs[i] != list->pairs[i - 1];
    out->pairs = qm_context_alloc(ctx, different, sizeof *out->pairs);
    if (!out->pairs) return QM_E_NO_MEMORY;
    tell(list, b_bits, out);
    return QM_OK;
}
