/**
 * codec_welder.c: merges vertices with equal positions while a mesh is being decoded.
 */
#include "codec_welder.h"

#include <sys/random.h>

#define MIN_SLOT_COUNT ((size_t)1024)

/** A quarter of the slots are used, and at most half before the table grows: fuller ones need more probes, whose number
 * the processor predicts worse. */
static qm_status make_slots(qm_welder *welder, size_t vertex_count)
{
    welder->slot_count = MIN_SLOT_COUNT;
    while (welder->slot_count / 4 < vertex_count)
        welder->slot_count *= 2;
    welder->slots = qm_context_alloc(welder->builder->ctx, welder->slot_count, sizeof *welder->slots);
    if (!welder->slots) return QM_E_NO_MEMORY;
    memset(welder->slots, 0xff, welder->slot_count * sizeof *welder->slots);
    return QM_OK;
}

qm_status qm_welder_create(qm_builder *builder, size_t vertex_count, qm_welder *welder)
{
    *welder = (qm_welder){.builder = builder};
    if (builder->only_counts) return QM_OK;
    if (getrandom(&welder->seed, sizeof welder->seed, GRND_NONBLOCK) < 0) welder->seed = (uintptr_t)welder;
    return make_slots(welder, vertex_count);
}

void qm_welder_destroy(qm_welder *welder)
{
    qm_context_free(welder->builder->ctx, welder->slots, welder->slot_count, sizeof *welder->slots);
}

/** Folds the 128-bit product, so that every bit of the input affects every bit of the hash. */
static uint64_t mix(uint64_t a, uint64_t b)
{
    unsigned __int128 product = (unsigned __int128)a * b;
    return (uint64_t)product ^ (uint64_t)(product >> 64);
}

/** The first slot to probe for a position. */
static size_t first_slot(const qm_welder *welder, const double position[3])
{
    uint64_t bits[3];
    memcpy(bits, position, sizeof bits);
    uint64_t hash = mix(bits[0] ^ welder->seed, 0x9e3779b97f4a7c15u);
    hash = mix(bits[1] ^ hash, 0xd6e8feb86659fd93u ^ welder->seed);
    return (size_t)mix(bits[2] ^ hash, 0xa0761d6478bd642fu) & (welder->slot_count - 1);
}

static size_t find_slot(const qm_welder *welder, size_t slot, const double position[3])
{
    const double *positions = welder->builder->positions;
    while (welder->slots[slot] != QM_NO_INDEX &&
           memcmp(positions + 3 * (size_t)welder->slots[slot], position, 3 * sizeof *position) != 0)
        slot = (slot + 1) & (welder->slot_count - 1);
    return slot;
}

/** Rehashes all vertices into a table for vertex_count of them. */
static qm_status add_slots(qm_welder *welder, size_t vertex_count)
{
    qm_welder grown = *welder;
    qm_status status = make_slots(&grown, vertex_count);
    if (status != QM_OK) return status;
    for (size_t i = 0; i < welder->builder->vertex_count; ++i) {
        const double *position = welder->builder->positions + 3 * i;
        grown.slots[find_slot(&grown, first_slot(&grown, position), position)] = (uint32_t)i;
    }
    qm_welder_destroy(welder);
    *welder = grown;
    return QM_OK;
}

/** Prefetches the slots of all positions, then the vertices in them, so that the cache misses overlap. */
static qm_status find_batch(qm_welder *welder, const double *positions, size_t count, uint32_t *vertices,
                            size_t *done)
{
    double plain[QM_WELDER_BATCH][3];
    size_t slots[QM_WELDER_BATCH];
    for (size_t i = 0; i < count; ++i) {
        /* Adding zero turns -0 into 0: equal coordinates then have equal bits. */
        for (int k = 0; k < 3; ++k)
            plain[i][k] = positions[3 * i + (size_t)k] + 0.0;
        slots[i] = first_slot(welder, plain[i]);
        __builtin_prefetch(&welder->slots[slots[i]]);
    }
    for (size_t i = 0; i < count; ++i) {
        uint32_t vertex = welder->slots[slots[i]];
        if (vertex != QM_NO_INDEX) __builtin_prefetch(welder->builder->positions + 3 * (size_t)vertex);
    }
    for (size_t i = 0; i < count; ++i, ++*done) {
        const size_t slot = find_slot(welder, slots[i], plain[i]);
        vertices[i] = welder->slots[slot];
        if (vertices[i] != QM_NO_INDEX) continue;
        vertices[i] = (uint32_t)welder->builder->vertex_count;
        qm_status status = qm_builder_add_vertex(welder->builder, plain[i]);
        if (status != QM_OK) return status;
        welder->slots[slot] = vertices[i];
    }
    return QM_OK;
}

qm_status qm_welder_find(qm_welder *welder, const double *positions, size_t count, uint32_t *vertices,
                         size_t *done)
{
    qm_status status = QM_OK;
    if (welder->builder->only_counts) {
        /* How many are equal is not known without storing them. */
        for (*done = 0; *done < count; ++*done)
            vertices[*done] = 0;
        welder->builder->counts_are_low = true;
        return QM_OK;
    }
    for (*done = 0; *done < count && status == QM_OK;) {
        size_t batch = count - *done < QM_WELDER_BATCH ? count - *done : QM_WELDER_BATCH;
        size_t most = welder->builder->vertex_count + batch;
        if (most > welder->slot_count / 2) status = add_slots(welder, most);
        if (status == QM_OK)
            status = find_batch(welder, positions + 3 * *done, batch, vertices + *done, done);
    }
    return status;
}
