/**
 * box_tree.h: the inner nodes of a bounding volume hierarchy: an implicit tree of boxes, eight children to a
 * node, over leaves that lie in space-filling order.
 *
 * Level 0 is the leaves; level k holds one node for eight of level k - 1; the top level is the root alone. A
 * node keeps the boxes of its children, not its own:
 *
 *     level 2        [ 0 ........................ ]          one record of eight boxes a node
 *     level 1   [ 0 ....... ][ 1 ....... ] ... [ 7 ]         box j of node i is the box of child 8 i + j
 *     level 0   leaves 0..7    8..15 ...
 */
#ifndef QM_BOX_TREE_H
#define QM_BOX_TREE_H

#include "core/vec.h"

#define QM_TREE_LEVELS 12     /* 8^12 leaves are more than fit in memory */
#define QM_BOX_MARGIN 0x1p-22 /* boxes are enlarged by this, in local lengths */

/** The boxes of up to eight children, in local floats, enlarged by QM_BOX_MARGIN. */
typedef struct qm_box_node {
    _Alignas(32) float low[3][8], high[3][8];
} qm_box_node;

typedef struct qm_box_tree {
    int level_count;                     /* levels of nodes: 1 at least; level k is groups[k], k >= 1 */
    size_t group_count[QM_TREE_LEVELS];  /* nodes of each level; [0] counts the leaves */
    qm_box_node *groups[QM_TREE_LEVELS]; /* the nodes of each level; [0] is NULL */
} qm_box_tree;

/** Allocates the levels over count leaves, 1 or more; boxes past the last child are zero, the caller sets all
 * others. False when out of memory; qm_box_tree_reset frees either way. */
bool qm_box_tree_init(qm_context *ctx, size_t count, qm_box_tree *out);
void qm_box_tree_reset(qm_context *ctx, qm_box_tree *tree);

/** Sets the box of a leaf, in local doubles. */
static inline void qm_box_tree_set(qm_box_tree *tree, size_t leaf, const qm_box *box)
{
    QM_ASSERT(leaf < tree->group_count[0]);
    qm_box_node *node = &tree->groups[1][leaf / 8];
    for (int k = 0; k < 3; k++) {
        node->low[k][leaf % 8] = (float)(box->min[k] - QM_BOX_MARGIN);
        node->high[k][leaf % 8] = (float)(box->max[k] + QM_BOX_MARGIN);
    }
}

/** Number of children (1 to 8) of a node. */
static inline int qm_box_tree_child_count(const qm_box_tree *tree, int level, size_t node)
{
    QM_ASSERT(level >= 1 && level <= tree->level_count && node < tree->group_count[level]);
    size_t rest = tree->group_count[level - 1] - 8 * node;
    return rest < 8 ? (int)rest : 8;
}

/** The box of all leaves. */
qm_box qm_box_tree_bounds(const qm_box_tree *tree);

/** Computes the boxes of levels first (2 or more) and up from those below. */
void qm_box_tree_fill(qm_box_tree *tree, int first);

/** Computes the boxes of children begin to end - 1 at one level, from the nodes of the level below. */
void qm_box_tree_fill_children(qm_box_tree *tree, int level, size_t begin, size_t end);

/** Computes the boxes above the leaves listed, which ascend; uses up the list. Returns the number of
 * boxes. */
size_t qm_box_tree_refill(qm_box_tree *tree, uint32_t *leaves, size_t count);

/** The max coordinate of any box by magnitude, at most 1. */
double qm_box_tree_max_coordinate(const qm_box_tree *tree);

size_t qm_box_tree_memory_size(const qm_box_tree *tree);

#endif
