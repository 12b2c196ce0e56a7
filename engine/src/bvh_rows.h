/**
 * bvh_rows.h: the triangles of a pack in double precision, made when a search first asks for them. Single
 * precision (float_pack.h) settles most of what a search looks at, so that many packs never need theirs.
 */
#ifndef QM_BVH_ROWS_H
#define QM_BVH_ROWS_H

#include <stdatomic.h>

#include "bvh_tree.h"

/** How far the rows of a pack are. Several threads may ask for them at once. */
enum { QM_ROWS_NONE, QM_ROWS_IN_WORK, QM_ROWS_MADE };

/** Makes the rows of a pack, or waits for the thread that does. */
const qm_pack *qm_bvh_make_rows(const qm_bvh *bvh, size_t pack);

/** Rows of a pack of a tree that is a target. */
static inline const qm_pack *qm_bvh_rows(const qm_bvh *bvh, size_t pack)
{
    unsigned char state = atomic_load_explicit(&bvh->rows_state[pack], memory_order_acquire);
    return state == QM_ROWS_MADE ? &bvh->rows[pack] : qm_bvh_make_rows(bvh, pack);
}

/** Has the rows of a pack made anew when they are asked for next; no search may be under way. */
static inline void qm_bvh_drop_rows(qm_bvh *bvh, size_t pack)
{
    if (bvh->rows) atomic_store_explicit(&bvh->rows_state[pack], QM_ROWS_NONE, memory_order_relaxed);
}

#endif
