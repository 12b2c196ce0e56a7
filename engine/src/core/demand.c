#include "demand.h"

#include <threads.h>

bool qm_demand_init(qm_context *ctx, size_t count, size_t room, size_t width, qm_demand *out)
{
    bool in_place = room == 0;
    if (in_place) room = count;
    *out = (qm_demand){.count = count, .room = room, .width = width, .in_place = in_place};
    out->place = qm_context_alloc(ctx, count + 1, sizeof *out->place);
    out->items = qm_context_alloc_aligned(ctx, room, width);
    if (!out->place || !out->items) return false;
    for (size_t i = 0; i < count; i++)
        atomic_init(&out->place[i], QM_DEMAND_NONE);
    out->made = out->place + count;
    atomic_init(out->made, 0);
    return true;
}

void qm_demand_reset(qm_context *ctx, qm_demand *demand)
{
    qm_context_free_aligned(ctx, demand->items, demand->room, demand->width);
    qm_context_free(ctx, demand->place, demand->count + 1, sizeof *demand->place);
    *demand = (qm_demand){0};
}

size_t qm_demand_memory_size(const qm_demand *demand)
{
    return demand->items ? demand->room * demand->width + demand->count * sizeof *demand->place : 0;
}

/** Takes a place for a member that is in work: its own, or the next one. */
static qm_demand_answer take_place(const qm_demand *demand, size_t member, unsigned *place)
{
    *place = atomic_fetch_add(demand->made, 1);
    if (demand->in_place) *place = (unsigned)member;
    if (*place < demand->room) return QM_DEMAND_WANTED;
    atomic_fetch_sub(demand->made, 1);
    qm_demand_publish(demand, member, QM_DEMAND_NONE);
    return QM_DEMAND_FULL;
}

qm_demand_answer qm_demand_claim(const qm_demand *demand, size_t member, unsigned *place)
{
    for (;;) {
        unsigned found = qm_demand_place(demand, member);
        *place = found;
        if (found < QM_DEMAND_STALE) return QM_DEMAND_MADE;
        if (found == QM_DEMAND_NONE &&
            atomic_load_explicit(demand->made, memory_order_relaxed) >= demand->room)
            return QM_DEMAND_FULL;
        if (found == QM_DEMAND_IN_WORK ||
            !atomic_compare_exchange_strong(&demand->place[member], &found, QM_DEMAND_IN_WORK)) {
            thrd_yield();
            continue;
        }
        if (found == QM_DEMAND_NONE) return take_place(demand, member, place);
        *place = found & ~QM_DEMAND_STALE;
        return QM_DEMAND_WANTED;
    }
}

void qm_demand_publish(const qm_demand *demand, size_t member, unsigned place)
{
    atomic_store_explicit(&demand->place[member], place, memory_order_release);
}

/** Reading and writing need not be one step: nobody asks. What there is not yet stays so. */
void qm_demand_drop(qm_demand *demand, size_t begin, size_t end)
{
    if (!demand->items || atomic_load_explicit(demand->made, memory_order_relaxed) == 0) return;
    for (size_t i = begin; i < end; i++) {
        unsigned place = atomic_load_explicit(&demand->place[i], memory_order_relaxed);
        atomic_store_explicit(&demand->place[i], place | QM_DEMAND_STALE, memory_order_relaxed);
    }
}
