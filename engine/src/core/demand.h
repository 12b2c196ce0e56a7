/**
 * demand.h: an array of items that threads create lazily, one for each of many members, when they first need
 * them.
 *
 * In place, each item has the index of its member, so that a reader loads it without waiting for its slot.
 * Otherwise items are stored in the order of their creation, so that a few of them take little memory; then
 * there may be fewer slots than members, and a caller that finds them full creates the item in memory of its
 * own. The memory of slots without an item is never touched. Any number of threads may call at once, but for
 * qm_demand_drop.
 */
#ifndef QM_DEMAND_H
#define QM_DEMAND_H

#include <stdatomic.h>

#include "qm/context.h"

/** The slot of a member: the index of its item, or one of these. */
#define QM_DEMAND_NONE UINT32_MAX
#define QM_DEMAND_IN_WORK (UINT32_MAX - 1)
/* Flag on a slot: its item must be created again. The smallest of the three. */
#define QM_DEMAND_STALE UINT32_C(0x80000000)

typedef struct qm_demand {
    void *items;       /* NULL: this array is not in use */
    atomic_uint *slot; /* of each member */
    atomic_uint *used; /* number of slots in use; stored behind the last slot */
    size_t count, room, width;
    bool in_place;
} qm_demand;

/** Makes room for items of count members, fewer than 2^31, aligned to cache lines; room 0: for all of them,
 * in place. False when out of memory; qm_demand_reset frees either way. */
bool qm_demand_init(qm_context *ctx, size_t count, size_t room, size_t width, qm_demand *out);
void qm_demand_reset(qm_context *ctx, qm_demand *demand);

/** Bytes when all slots are in use. */
size_t qm_demand_memory_size(const qm_demand *demand);

/** The slot of a member's item; QM_DEMAND_STALE or more when it has none yet. */
static inline unsigned qm_demand_slot(const qm_demand *demand, size_t member)
{
    return atomic_load_explicit(&demand->slot[member], memory_order_acquire);
}

/** True when a member has its item; in place, it is the item of the member's index. */
static inline bool qm_demand_is_made(const qm_demand *demand, size_t member)
{
    return __builtin_expect(qm_demand_slot(demand, member) < QM_DEMAND_STALE, 1);
}

typedef enum qm_demand_claim_result {
    QM_DEMAND_MADE,   /* another thread has created the item at *slot */
    QM_DEMAND_WANTED, /* the caller must create it at *slot, then call qm_demand_publish */
    QM_DEMAND_FULL,   /* no slot is free */
} qm_demand_claim_result;

/** Claims the item of a member that has no slot, or a stale one. */
qm_demand_claim_result qm_demand_claim(const qm_demand *demand, size_t member, unsigned *slot);
void qm_demand_publish(const qm_demand *demand, size_t member, unsigned slot);

/** Marks the items of members begin to end as stale: the next claim creates them again. No other thread may
 * use the array meanwhile. */
void qm_demand_drop(qm_demand *demand, size_t begin, size_t end);

#endif
