/**
 * traversal.h: the stack of a traversal of a box tree, nearest box on top.
 *
 * The children of a node that are near enough are sorted and pushed together without a branch: their number
 * and order cannot be predicted.
 */
#ifndef QM_KERNEL_WALK_H
#define QM_KERNEL_WALK_H

#include <assert.h>

#include "box.h"

enum {
    QM_TRAVERSAL_CHILD_BITS = 3,
    QM_TRAVERSAL_LEVEL_BITS = 4,
    QM_TRAVERSAL_INDEX_BITS = 32 - QM_TRAVERSAL_LEVEL_BITS
};
static_assert(QM_TREE_LEVELS < 1 << QM_TRAVERSAL_LEVEL_BITS, "levels fit their bits");

#define QM_TRAVERSAL_SIZE (8 * (QM_TREE_LEVELS + 1))

/** The stack. Each entry has a key, the bits of a squared distance with the index of a child in its last
 * bits, and the level and index of the first of the eight children. */
typedef struct qm_traversal {
    int height;
    uint32_t start;  /* bottom-up: the pack that the traversal started at */
    int start_level; /* and the level up to which all siblings of its ancestors have been pushed */
    int32_t key[QM_TRAVERSAL_SIZE];
    uint32_t first[QM_TRAVERSAL_SIZE];
} qm_traversal;

/** A pack (level 0) or a node, with a lower bound of its squared distance. */
typedef struct qm_stack_entry {
    float d2;
    uint32_t level, index;
} qm_stack_entry;

static inline void qm_traversal_start(qm_traversal *traversal, const qm_box_tree *boxes)
{
    traversal->height = 1;
    traversal->key[0] = 0;
    traversal->first[0] = (uint32_t)boxes->level_count << QM_TRAVERSAL_INDEX_BITS;
}

static inline qm_stack_entry qm_traversal_pop(qm_traversal *traversal)
{
    QM_ASSERT(traversal->height > 0);
    const int32_t mask = (1 << QM_TRAVERSAL_CHILD_BITS) - 1;
    int32_t key = traversal->key[--traversal->height], bits = key & ~mask;
    uint32_t first = traversal->first[traversal->height];
    qm_stack_entry entry = {.level = first >> QM_TRAVERSAL_INDEX_BITS,
                            .index =
                                (first & ((1u << QM_TRAVERSAL_INDEX_BITS) - 1)) + (uint32_t)(key & mask)};
    memcpy(&entry.d2, &bits, sizeof bits);
    return entry;
}

enum { QM_NO_CHILD = 8 };

/** Pushes the children of a node that are within the limit, except one, nearest on top. */
static inline void qm_traversal_push_others(qm_traversal *traversal, const qm_box_tree *boxes,
                                            const qm_box_query *query, float limit, qm_stack_entry at,
                                            int excluded)
{
    const qm_vi child = {0, 1, 2, 3, 4, 5, 6, 7};
    qm_vf d2 = qm_box_node_d2(&boxes->groups[at.level][at.index], query);
    qm_vi there = (child < qm_box_tree_child_count(boxes, (int)at.level, at.index)) & (child != excluded);
    qm_vi within = (d2 <= limit) & there;
    qm_vi keys = (((qm_vi)d2 & ~child[7]) | child) & within;
    keys = qm_vi_sort(keys | ~within); /* all ones sorts below any key */
    uint32_t first_child = (at.level - 1) << QM_TRAVERSAL_INDEX_BITS | 8 * at.index;
    qm_vi first = (qm_vi){0} + (int32_t)first_child;
    QM_ASSERT(traversal->height + 8 <= QM_TRAVERSAL_SIZE);
    memcpy(traversal->key + traversal->height, &keys, sizeof keys);
    memcpy(traversal->first + traversal->height, &first, sizeof first);
    traversal->height += __builtin_popcount(qm_vi_bits(within));
}

static inline void qm_traversal_push(qm_traversal *traversal, const qm_box_tree *boxes,
                                     const qm_box_query *query, float limit, qm_stack_entry at)
{
    qm_traversal_push_others(traversal, boxes, query, limit, at, QM_NO_CHILD);
}

/** Starts bottom-up at a pack, which counts as visited. */
static inline void qm_traversal_start_at(qm_traversal *traversal, uint32_t pack)
{
    traversal->height = 0;
    traversal->start = pack;
    traversal->start_level = 0;
}

/** Climbs until the stack has an entry; false when nothing is left in the whole tree. */
static inline bool qm_traversal_climb(qm_traversal *traversal, const qm_box_tree *boxes,
                                      const qm_box_query *query, float limit)
{
    while (traversal->height == 0 && traversal->start_level < boxes->level_count) {
        int below = 3 * traversal->start_level++;
        qm_stack_entry at = {.level = (uint32_t)traversal->start_level,
                             .index = traversal->start >> (below + 3)};
        qm_traversal_push_others(traversal, boxes, query, limit, at, (int)(traversal->start >> below & 7));
    }
    return traversal->height > 0;
}

#endif
