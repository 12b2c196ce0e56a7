/**
 * bvh_rows.h: the triangles of a pack in double precision, made when a search first asks for them. Single
 * precision (float_pack.h) settles most of what a search looks at, so that many packs never need theirs.
 * Those that are made lie side by side in the order in which they were asked for, and the rest of the memory
 * that there is for them is never touched.
 */
#ifndef QM_BVH_ROWS_H
#define QM_BVH_ROWS_H

#include <stdatomic.h>

#include "bvh_tree.h"

/** What rows_place says of a pack: where its rows are, or one of these. Several threads may ask at once. */
#define QM_ROWS_NONE UINT32_MAX
#define QM_ROWS_IN_WORK (UINT32_MAX - 1)
#define QM_ROWS_STALE UINT32_C(0x80000000) /* with the place: to be made anew there */

/** Makes the rows of a pack, or waits for the thread that does. */
const qm_pack *qm_bvh_make_rows(const qm_bvh *bvh, size_t pack);

/** Rows of a pack of a tree that is a target. */
static inline const qm_pack *qm_bvh_rows(const qm_bvh *bvh, size_t pack)
{
    unsigned place = atomic_load_explicit(&bvh->rows_place[pack], memory_order_acquire);
    return place < QM_ROWS_STALE ? &bvh->rows[place] : qm_bvh_make_rows(bvh, pack);
}

/** Has the rows of packs from begin on made anew when they are asked for next; no search may be under way, so
 * that reading and writing need not be one step. */
static inline void qm_bvh_drop_rows(qm_bvh *bvh, size_t begin, size_t end)
{
    if (!bvh->rows || atomic_load_explicit(bvh->rows_used, memory_order_relaxed) == 0) return;
    for (size_t pack = begin; pack < end; pack++) {
        unsigned place = atomic_load_explicit(&bvh->rows_place[pack], memory_order_relaxed);
        atomic_store_explicit(&bvh->rows_place[pack], place | QM_ROWS_STALE, memory_order_relaxed);
    }
}

#endif
