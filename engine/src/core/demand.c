/**
 * demand.c: claims of slots by compare and exchange; a thread that waits for another one yields.
 */
#include "demand.h"

#include <threads.h>

bool qm_demand_init(qm_context *ctx, size_t count, size_t room, size_t width, qm_demand *out)
{
    QM_ASSERT(count < QM_DEMAND_STALE && room <= count);
    bool in_place = room == 0;
    if (in_place) room = count;
    *out = (qm_demand){.count = count, .room = room, .width = width, .in_place = in_place};
    out->slot = qm_context_alloc(ctx, count + 1, sizeof *out->slot);
    out->items = qm_context_alloc_aligned(ctx, room, width);
    if (!out->slot || !out->items) return false;
    for (size_t i = 0; i < count; i++)
        atomic_init(&out->slot[i], QM_DEMAND_NONE);
    out->used = out->slot + count;
    atomic_init(out->used, 0);
    return true;
}

void qm_demand_reset(qm_context *ctx, qm_demand *demand)
{
    qm_context_free_aligned(ctx, demand->items, demand->room, demand->width);
    qm_context_free(ctx, demand->slot, demand->count + 1, sizeof *demand->slot);
    *demand = (qm_demand){0};
}

size_t qm_demand_memory_size(const qm_demand *demand)
{
    return demand->items ? demand->room * demand->width + demand->count * sizeof *demand->slot : 0;
}

/** Takes a slot for a member that is in work: its own index, or the next one. */
static qm_demand_claim_result take_slot(const qm_demand *demand, size_t member, unsigned *slot)
{
    *slot = atomic_fetch_add(demand->used, 1);
    if (demand->in_place) *slot = (unsigned)member;
    if (*slot < demand->room) return QM_DEMAND_WANTED;
    atomic_fetch_sub(demand->used, 1);
    qm_demand_publish(demand, member, QM_DEMAND_NONE);
    return QM_DEMAND_FULL;
}

qm_demand_claim_result qm_demand_claim(const qm_demand *demand, size_t member, unsigned *slot)
{
    QM_ASSERT(member < demand->count);
    for (;;) {
        unsigned found = qm_demand_slot(demand, member);
        *slot = found;
        if (found < QM_DEMAND_STALE) return QM_DEMAND_MADE;
        if (found == QM_DEMAND_NONE &&
            atomic_load_explicit(demand->used, memory_order_relaxed) >= demand->room)
            return QM_DEMAND_FULL;
        if (found == QM_DEMAND_IN_WORK ||
            !atomic_compare_exchange_strong(&demand->slot[member], &found, QM_DEMAND_IN_WORK)) {
            thrd_yield();
            continue;
        }
        if (found == QM_DEMAND_NONE) return take_slot(demand, member, slot);
        *slot = found & ~QM_DEMAND_STALE;
        return QM_DEMAND_WANTED;
    }
}

void qm_demand_publish(const qm_demand *demand, size_t member, unsigned slot)
{
    atomic_store_explicit(&demand->slot[member], slot, memory_order_release);
}

/** Load and store need not be one atomic step: no other thread runs. QM_DEMAND_NONE has the stale bit
 * already. */
void qm_demand_drop(qm_demand *demand, size_t begin, size_t end)
{
    QM_ASSERT(begin <= end);
    if (!demand->items || atomic_load_explicit(demand->used, memory_order_relaxed) == 0) return;
    for (size_t i = begin; i < end; i++) {
        unsigned slot = atomic_load_explicit(&demand->slot[i], memory_order_relaxed);
        atomic_store_explicit(&demand->slot[i], slot | QM_DEMAND_STALE, memory_order_relaxed);
    }
}
