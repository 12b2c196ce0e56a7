/**
 * bvh_demand.h: the triangles of packs as searches read them, made when the first search asks for them. Packs
 * far from all queries never need theirs, and single precision decides most queries of the others, so that
 * few packs need theirs in double precision.
 */
#ifndef QM_BVH_DEMAND_H
#define QM_BVH_DEMAND_H

#include "bvh_tree.h"

/** Make the item of a pack, or wait for the thread that does. */
const qm_float_pack *qm_bvh_make_float_pack(const qm_bvh *bvh, size_t pack);
const qm_pack *qm_bvh_make_pack(const qm_bvh *bvh, size_t pack, qm_pack *spare);
const qm_pack_twists *qm_bvh_make_twists(const qm_bvh *bvh, size_t pack);

/** Makes the float pack of a pack whose corners are loaded already. */
void qm_bvh_put_float_pack(const qm_bvh *bvh, size_t pack, const qm_pack_corners *corners);

/** Triangles of a pack in single precision; the tree is a target. */
static inline const qm_float_pack *qm_bvh_float_pack(const qm_bvh *bvh, size_t pack)
{
    QM_ASSERT(pack < bvh->pack_count);
    const qm_float_pack *floats = bvh->floats.items;
    if (bvh->has_all_floats) return floats + pack;
    const unsigned slot = qm_demand_slot(&bvh->floats, pack);
    return slot < QM_DEMAND_STALE ? floats + slot : qm_bvh_make_float_pack(bvh, pack);
}

/** Triangles of a pack in double precision; the tree is a target. They are in *spare when there is no room to
 * keep them. */
static inline const qm_pack *qm_bvh_pack(const qm_bvh *bvh, size_t pack, qm_pack *spare)
{
    QM_ASSERT(pack < bvh->pack_count);
    unsigned slot = qm_demand_slot(&bvh->rows, pack);
    const qm_pack *packs = bvh->rows.items;
    return slot < QM_DEMAND_STALE ? packs + slot : qm_bvh_make_pack(bvh, pack, spare);
}

/** Flatness bounds of the quads of a pack; the tree has twists (qm_bvh_has_twists). */
static inline const float *qm_bvh_twists(const qm_bvh *bvh, size_t pack)
{
    QM_ASSERT(pack < bvh->pack_count);
    const qm_pack_twists *twists = bvh->twists.items;
    return (qm_demand_is_made(&bvh->twists, pack) ? twists + pack : qm_bvh_make_twists(bvh, pack))->lane;
}

/** Invalidates what depends on the vertex positions of packs begin to end - 1; no search is running. Several
 * threads may drop items of different packs; the caller clears has_all_floats first. */
static inline void qm_bvh_drop_items(qm_bvh *bvh, size_t begin, size_t end)
{
    qm_demand_drop(&bvh->floats, begin, end);
    qm_demand_drop(&bvh->rows, begin, end);
    qm_demand_drop(&bvh->twists, begin, end);
}

#endif
