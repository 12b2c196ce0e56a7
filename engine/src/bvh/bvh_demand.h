/**
 * bvh_demand.h: the triangles of packs as searches take them, made when the first one asks for them. Packs
 * that lie far from all that is asked for never need theirs, and single precision (float_pack.h) settles most
 * of what the others are asked, so that few need them in double precision.
 */
#ifndef QM_BVH_DEMAND_H
#define QM_BVH_DEMAND_H

#include "bvh_tree.h"

/** Make the item of a pack, or wait for the thread that does. */
const qm_float_pack *qm_bvh_make_floats(const qm_bvh *bvh, size_t pack);
const qm_pack *qm_bvh_make_rows(const qm_bvh *bvh, size_t pack, qm_pack *spare);
const qm_pack_twists *qm_bvh_make_twists(const qm_bvh *bvh, size_t pack);

/** Makes the triangles in single precision of a pack whose corners are loaded already. */
void qm_bvh_put_floats(const qm_bvh *bvh, size_t pack, const qm_pack_corners *corners);

/** Triangles of a pack in single precision, of a tree that is a target. */
static inline const qm_float_pack *qm_bvh_floats(const qm_bvh *bvh, size_t pack)
{
    const qm_float_pack *floats = bvh->floats.items;
    if (bvh->has_all_floats) return floats + pack;
    return qm_demand_is_made(&bvh->floats, pack) ? floats + pack : qm_bvh_make_floats(bvh, pack);
}

/** Triangles of a pack in double precision, likewise; in spare when there is no room to keep them. */
static inline const qm_pack *qm_bvh_rows(const qm_bvh *bvh, size_t pack, qm_pack *spare)
{
    unsigned place = qm_demand_place(&bvh->rows, pack);
    const qm_pack *rows = bvh->rows.items;
    return place < QM_DEMAND_STALE ? rows + place : qm_bvh_make_rows(bvh, pack, spare);
}

/** How far the quads of a pack leave their triangles, where qm_bvh_has_twists. */
static inline const float *qm_bvh_twists(const qm_bvh *bvh, size_t pack)
{
    const qm_pack_twists *twists = bvh->twists.items;
    return (qm_demand_is_made(&bvh->twists, pack) ? twists + pack : qm_bvh_make_twists(bvh, pack))->lane;
}

/** Has what depends on the places of vertices made anew for packs from begin on; no search is under way.
 * Several threads may drop items of different packs; the caller clears has_all_floats first. */
static inline void qm_bvh_drop_items(qm_bvh *bvh, size_t begin, size_t end)
{
    qm_demand_drop(&bvh->floats, begin, end);
    qm_demand_drop(&bvh->rows, begin, end);
    qm_demand_drop(&bvh->twists, begin, end);
}

#endif
