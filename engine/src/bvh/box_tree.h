/**
 * box_tree.h: an implicit tree of boxes, eight to a node, over members that lie in space-filling order.
 *
 * Level 0 counts the members; level k holds groups of eight members of level k - 1, up to one group.
 *
 *     level 2        [ 0 ........................ ]          one record of eight boxes a group
 *     level 1   [ 0 ....... ][ 1 ....... ] ... [ 7 ]         box j of group g is the box of member 8 g + j
 * below level 0   members 0..7  8..15 ...
 */
#ifndef QM_BOX_TREE_H
#define QM_BOX_TREE_H

#include "core/vec.h"

#define QM_TREE_LEVELS 12     /* 8^12 members are more than fit in memory */
#define QM_BOX_MARGIN 0x1p-22 /* boxes reach this far beyond what they hold, in local lengths */

/** Boxes of up to eight members, in local floats, reaching QM_BOX_MARGIN outward. */
typedef struct qm_box_node {
    _Alignas(32) float low[3][8], high[3][8];
} qm_box_node;

typedef struct qm_box_tree {
    int level_count;                     /* levels of groups: 1 at least; level k is groups[k], k >= 1 */
    size_t group_count[QM_TREE_LEVELS];  /* [0] counts the members */
    qm_box_node *groups[QM_TREE_LEVELS]; /* [0] is NULL */
} qm_box_tree;

/** Allocates the levels over count members, 1 or more; boxes past the last member are zero, all others are to
 * be set. False when out of memory; qm_box_tree_reset frees either way. */
bool qm_box_tree_init(qm_context *ctx, size_t count, qm_box_tree *out);
void qm_box_tree_reset(qm_context *ctx, qm_box_tree *tree);

/** Sets the box of a member of level 0, in local doubles. */
static inline void qm_box_tree_set(qm_box_tree *tree, size_t member, const qm_box *box)
{
    qm_box_node *group = &tree->groups[1][member / 8];
    for (int k = 0; k < 3; k++) {
        group->low[k][member % 8] = (float)(box->min[k] - QM_BOX_MARGIN);
        group->high[k][member % 8] = (float)(box->max[k] + QM_BOX_MARGIN);
    }
}

/** Number of members (1 to 8) of a group. */
static inline int qm_box_tree_child_count(const qm_box_tree *tree, int level, size_t group)
{
    size_t rest = tree->group_count[level - 1] - 8 * group;
    return rest < 8 ? (int)rest : 8;
}

/** The box of everything. */
qm_box qm_box_tree_whole(const qm_box_tree *tree);

/** Makes the boxes of levels first (2 or more) and up from those below. */
void qm_box_tree_fill(qm_box_tree *tree, int first);

/** Makes some boxes of one level alone, from the groups of the level below. */
void qm_box_tree_fill_children(qm_box_tree *tree, int level, size_t begin, size_t end);

/** The same above these members alone, which are ascending; returns how many boxes were made. The list is
 * used up. */
size_t qm_box_tree_refill(qm_box_tree *tree, uint32_t *members, size_t count);

/** The greatest coordinate of any box by magnitude, at most 1. */
double qm_box_tree_reach(const qm_box_tree *tree);

size_t qm_box_tree_memory_size(const qm_box_tree *tree);

#endif
