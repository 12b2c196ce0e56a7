/**
 * collide_pairs.h: lists of pairs of faces while they are found, and as they are told.
 */
#ifndef QM_COLLIDE_PAIRS_H
#define QM_COLLIDE_PAIRS_H

#include "qm/collide.h"

#define QM_PAIR_BLOCK 8190 /* pairs; with the rest of the block 64 KB */

typedef struct qm_pair_block {
    struct qm_pair_block *next;
    size_t count;
    qm_face_pair pairs[QM_PAIR_BLOCK];
} qm_pair_block;

/** A list that grows by blocks; pairs lie in no order. All zero is an empty one. */
typedef struct qm_pair_list {
    qm_pair_block *first; /* only this one may have room */
    size_t count;
} qm_pair_list;

/** Puts an empty block first; false when out of memory. */
bool qm_pair_list_grow(qm_context *ctx, qm_pair_list *list);

/** Adds a pair; false when out of memory. */
static inline bool qm_pair_list_add(qm_context *ctx, qm_pair_list *list, qm_face_pair pair)
{
    if ((!list->first || list->first->count == QM_PAIR_BLOCK) && !qm_pair_list_grow(ctx, list)) return false;
    list->first->pairs[list->first->count++] = pair;
    list->count++;
    return true;
}

/** Moves the pairs of other to list. */
void qm_pair_list_join(qm_pair_list *list, qm_pair_list *other);

void qm_pair_list_reset(qm_context *ctx, qm_pair_list *list);

/** Tells every pair of the list once and in order, or the least alone where one is asked for; no face of
 * either mesh is greater than its last one. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_pair_list_finish(qm_context *ctx, const qm_pair_list *list, const uint32_t last_face[2],
                              const qm_collide_options *options, qm_collision *out);

#endif
