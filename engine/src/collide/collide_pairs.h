/**
 * collide_pairs.h: lists of pairs of faces, unsorted while a search finds them, sorted in its result.
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

/** A list that grows by blocks, in no order. All zero is an empty list. */
typedef struct qm_pair_list {
    qm_pair_block *first; /* the only one that pairs are added to */
    size_t count;
} qm_pair_list;

/** Puts an empty block first; false when out of memory. */
bool qm_pair_list_grow(qm_context *ctx, qm_pair_list *list);

/** Returns room for count pairs, at most QM_PAIR_BLOCK; qm_pair_list_commit adds those that were written.
 * NULL when out of memory. */
static inline qm_face_pair *qm_pair_list_reserve(qm_context *ctx, qm_pair_list *list, size_t count)
{
    QM_ASSERT(count <= QM_PAIR_BLOCK);
    if ((!list->first || list->first->count + count > QM_PAIR_BLOCK) && !qm_pair_list_grow(ctx, list))
        return NULL;
    return list->first->pairs + list->first->count;
}

static inline void qm_pair_list_commit(qm_pair_list *list, size_t count)
{
    QM_ASSERT(list->first && list->first->count + count <= QM_PAIR_BLOCK);
    list->first->count += count;
    list->count += count;
}

/** Adds a pair; false when out of memory. */
static inline bool qm_pair_list_add(qm_context *ctx, qm_pair_list *list, qm_face_pair pair)
{
    qm_face_pair *room = qm_pair_list_reserve(ctx, list, 1);
    if (!room) return false;
    *room = pair;
    qm_pair_list_commit(list, 1);
    return true;
}

/** Moves the pairs of other to list. */
void qm_pair_list_append(qm_pair_list *list, qm_pair_list *other);

void qm_pair_list_reset(qm_context *ctx, qm_pair_list *list);

/** Writes the pairs of the list to out, sorted and each once; only the first one unless the mode is ALL.
 * last_face bounds the indices of either mesh. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_pair_list_finish(qm_context *ctx, const qm_pair_list *list, const uint32_t last_face[2],
                              const qm_collide_options *options, qm_collision *out);

#endif
