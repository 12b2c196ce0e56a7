/**
 * demand.h: items that are made when they are first asked for, one for each of many members. In place, each
 * lies at the place of its member, so that a reader loads it without waiting for its place; else they lie in
 * the order in which they were asked for, so that few take little memory, and there may be room for fewer
 * items than members: whoever asks for one more makes it for himself alone. Memory of items that nobody asks
 * for is never touched. Any number of threads may ask at once.
 */
#ifndef QM_DEMAND_H
#define QM_DEMAND_H

#include <stdatomic.h>

#include "qm/context.h"

/** What a place says of a member: where its item is, or one of these. */
#define QM_DEMAND_NONE UINT32_MAX
#define QM_DEMAND_IN_WORK (UINT32_MAX - 1)
/* With the place: to be made anew there; the least of the three */
#define QM_DEMAND_STALE UINT32_C(0x80000000)

typedef struct qm_demand {
    void *items;        /* NULL: there are none to ask for */
    atomic_uint *place; /* of each member */
    atomic_uint *made;  /* how many items there are; one past the places */
    size_t count, room, width;
    bool in_place;
} qm_demand;

/** Room for so many items of count members, fewer than 2^31, on lines of their own; 0: for all of them, in
 * place. False when out of memory; qm_demand_reset frees either way. */
bool qm_demand_init(qm_context *ctx, size_t count, size_t room, size_t width, qm_demand *out);
void qm_demand_reset(qm_context *ctx, qm_demand *demand);

/** With all items made that there is room for. */
size_t qm_demand_memory_size(const qm_demand *demand);

/** The place of a member's item; QM_DEMAND_STALE or more when there is none yet. */
static inline unsigned qm_demand_place(const qm_demand *demand, size_t member)
{
    return atomic_load_explicit(&demand->place[member], memory_order_acquire);
}

/** True when a member has its item, which lies at its own place when they are in place. */
static inline bool qm_demand_is_made(const qm_demand *demand, size_t member)
{
    return __builtin_expect(qm_demand_place(demand, member) < QM_DEMAND_STALE, 1);
}

typedef enum qm_demand_answer {
    QM_DEMAND_MADE,   /* the item is at *place by now, for another thread has made it */
    QM_DEMAND_WANTED, /* the caller is to make it at *place, and then to call qm_demand_publish */
    QM_DEMAND_FULL,   /* there is no room for it */
} qm_demand_answer;

/** Asks for the item of a member that qm_demand_place has no place for. */
qm_demand_answer qm_demand_claim(const qm_demand *demand, size_t member, unsigned *place);
void qm_demand_publish(const qm_demand *demand, size_t member, unsigned place);

/** Has the items of members from begin on made anew when they are asked for next; nobody asks meanwhile. */
void qm_demand_drop(qm_demand *demand, size_t begin, size_t end);

#endif
