/**
 * extent.h: the extent of positions along all axes, and the boxes of a tree made from it.
 */
#ifndef QM_KERNEL_EXTENT_H
#define QM_KERNEL_EXTENT_H

#include "bvh/bvh_tree.h"
#include "four.h"

typedef struct extent {
    qm_four low, high;
} extent;

static inline extent extent_of_nothing(void)
{
    const qm_four far = {INFINITY, INFINITY, INFINITY, INFINITY};
    return (extent){far, -far};
}

static inline void extent_add(extent *e, qm_four position)
{
    e->low = qm_four_min(position, e->low);
    e->high = qm_four_max(position, e->high);
}

/** Sets box i of a level from local positions. */
static inline void extent_set_box(qm_bvh *bvh, int level, size_t i, const extent *local)
{
    qm_four_floats low = qm_four_round(local->low - QM_BOX_MARGIN);
    qm_four_floats high = qm_four_round(local->high + QM_BOX_MARGIN);
    qm_box_node *node = &bvh->boxes.groups[level][i / 8];
    for (int k = 0; k < 3; k++) {
        node->low[k][i % 8] = low[k];
        node->high[k][i % 8] = high[k];
    }
}

#endif
