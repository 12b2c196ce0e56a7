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
    qm_pair_block *first; /* this one alone is added to */
    size_t count;
} qm_pair_list;

/** Puts an empty block first; false when out of memory. */
bool qm_pair_list_grow(qm_context *ctx, qm_pair_list *list);

/** Room for count pairs, at most QM_PAIR_BLOCK, which qm_pair_list_take then adds as many of as there are;
 * NULL when out of memory. */
static inline qm_face_pair *qm_pair_list_room(qm_context *ctx, qm_pair_list *list, size_t count)
{
    if ((!list->first || list->first->count + count > QM_PAIR_BLOCK) && !qm_pair_list_grow(ctx, list))
        return NULL;
    return list->first->pairs + list->first->count;
}

static inline void qm_pair_list_take(qm_pair_list *list, size_t count)
{
    list->first->count += count;
    list->count += count;
}

/** Adds a pair; false when out of memory. */
static inline bool qm_pair_list_add(qm_context *ctx, qm_pair_list *list, qm_face_pair pair)
{
    qm_face_pair *room = qm_pair_list_room(ctx, list, 1);
    if (!room) return false;
    *room = pair;
    qm_pair_list_take(list, 1);
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
