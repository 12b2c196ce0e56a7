/**
 * walk.h: the stack of a descent through a tree of boxes, nearest box on top.
 *
 * The members of a group that are near enough are sorted and pushed together without a branch: how many there
 * are and in which order is what a processor cannot predict.
 */
#ifndef QM_KERNEL_WALK_H
#define QM_KERNEL_WALK_H

#include <assert.h>

#include "box.h"

enum { QM_WALK_CHILD_BITS = 3, QM_WALK_LEVEL_BITS = 4, QM_WALK_INDEX_BITS = 32 - QM_WALK_LEVEL_BITS };
static_assert(QM_TREE_LEVELS < 1 << QM_WALK_LEVEL_BITS, "levels fit their bits");

#define QM_WALK_SIZE (8 * (QM_TREE_LEVELS + 1))

/** Entries: the bits of a squared distance, in its last ones the place among eight, and of these eight the
 * level and the index of the first. */
typedef struct qm_walk {
    int height;
    uint32_t start;  /* climbing: the pack that the walk started at, */
    int start_level; /* and the level up to which all of its siblings have been pushed */
    int32_t key[QM_WALK_SIZE];
    uint32_t place[QM_WALK_SIZE];
} qm_walk;

/** A pack (level 0) or a group, with a lower bound of its squared distance. */
typedef struct qm_stack_entry {
    float d2;
    uint32_t level, index;
} qm_stack_entry;

static inline void qm_walk_start(qm_walk *walk, const qm_box_tree *boxes)
{
    walk->height = 1;
    walk->key[0] = 0;
    walk->place[0] = (uint32_t)boxes->level_count << QM_WALK_INDEX_BITS;
}

static inline qm_stack_entry qm_walk_pop(qm_walk *walk)
{
    const int32_t members = (1 << QM_WALK_CHILD_BITS) - 1;
    int32_t key = walk->key[--walk->height], bits = key & ~members;
    uint32_t place = walk->place[walk->height];
    qm_stack_entry stop = {.level = place >> QM_WALK_INDEX_BITS,
                           .index = (place & ((1u << QM_WALK_INDEX_BITS) - 1)) + (uint32_t)(key & members)};
    memcpy(&stop.d2, &bits, sizeof bits);
    return stop;
}

enum { QM_NO_MEMBER = 8 };

/** Pushes the members of a group that are within the limit but one, nearest on top. */
static inline void qm_walk_push_others(qm_walk *walk, const qm_box_tree *boxes, const qm_box_query *query,
                                       float limit, qm_stack_entry at, int but)
{
    const qm_vi member = {0, 1, 2, 3, 4, 5, 6, 7};
    qm_vf d2 = qm_box_node_d2(&boxes->groups[at.level][at.index], query);
    qm_vi there = (member < qm_box_tree_child_count(boxes, (int)at.level, at.index)) & (member != but);
    qm_vi within = (d2 <= limit) & there;
    qm_vi keys = (((qm_vi)d2 & ~member[7]) | member) & within;
    keys = qm_vi_sort(keys | ~within); /* all ones is less than any key */
    uint32_t first = (at.level - 1) << QM_WALK_INDEX_BITS | 8 * at.index;
    qm_vi place = (qm_vi){0} + (int32_t)first;
    memcpy(walk->key + walk->height, &keys, sizeof keys);
    memcpy(walk->place + walk->height, &place, sizeof place);
    walk->height += __builtin_popcount(qm_vi_bits(within));
}

static inline void qm_walk_push(qm_walk *walk, const qm_box_tree *boxes, const qm_box_query *query,
                                float limit, qm_stack_entry at)
{
    qm_walk_push_others(walk, boxes, query, limit, at, QM_NO_MEMBER);
}

/** Starts at a pack, which itself is taken to be looked at already. */
static inline void qm_walk_start_at(qm_walk *walk, uint32_t pack)
{
    walk->height = 0;
    walk->start = pack;
    walk->start_level = 0;
}

/** Climbs to where there is something left to look at; false when there is nothing in the whole tree. */
static inline bool qm_walk_climb(qm_walk *walk, const qm_box_tree *boxes, const qm_box_query *query,
                                 float limit)
{
    while (walk->height == 0 && walk->start_level < boxes->level_count) {
        int below = 3 * walk->start_level++;
        qm_stack_entry at = {.level = (uint32_t)walk->start_level, .index = walk->start >> (below + 3)};
        qm_walk_push_others(walk, boxes, query, limit, at, (int)(walk->start >> below & 7));
    }
    return walk->height > 0;
}

#endif
