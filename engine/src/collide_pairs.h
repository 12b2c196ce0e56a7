/**
 * collide_pairs.h: lists of pairs of faces while they are found, and as they are told.
 */
#ifndef QM_COLLIDE_PAIRS_H
#define QM_COLLIDE_PAIRS_H

#include "qm/collide.h"

/** A growing list; a pair is a << 32 | b. All zero is an empty one. */
typedef struct qm_pair_list {
    uint64_t *pairs;
    size_t count, capacity;
} qm_pair_list;

/** Adds a pair; false when out of memory. */
bool qm_pair_list_add(qm_context *ctx, qm_pair_list *list, uint32_t a, uint32_t b);

/** Adds the pairs of other to list and frees other; false when out of memory. */
bool qm_pair_list_join(qm_context *ctx, qm_pair_list *list, qm_pair_list *other);

void qm_pair_list_reset(qm_context *ctx, qm_pair_list *list);

/** Sorts the list and tells every pair once, or the least alone where one is asked for; the list is then of
 * no more use. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_pair_list_finish(qm_context *ctx, qm_pair_list *list, const qm_collide_options *options,
                              qm_collision *out);

#endif
