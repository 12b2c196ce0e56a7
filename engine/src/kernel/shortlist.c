/**
 * shortlist.c: the few facets that matter most for a small piece, side by side in one pack, so that a point
 * is compared with all of them at the price of one pack.
 */
#include "../bvh_pack.h"
#include "float_pack.h"
#include "kernels.h"

enum { LANE_BITS = 3 };

/** The eight packs whose boxes are nearest to p, nearest last. */
static qm_vi nearest_boxes(const qm_near_packs *near, qm_vec p)
{
    qm_box_query query = qm_box_query_point(p);
    qm_vi keys = (qm_vi){0} + QM_NO_KEY;
    for (int first = 0; first < near->count; first += 8)
        keys = qm_vi_keep_least(keys, qm_keys_sorted(qm_box_group_d2(&near->box[first / 8], &query),
                                                     (unsigned)first, qm_first_lanes(near->count - first)));
    return keys;
}

/** Single precision is enough to rank by: what the list decides is decided with its rows in double. */
static inline qm_vf lane_distances(const qm_bvh *bvh, uint32_t pack, qm_vec p)
{
    qm_float_point q = qm_float_point_make(&bvh->float_packs[pack], p);
    return qm_float_pack_d2(&bvh->float_packs[pack], &q);
}

void QM_KERNEL(shortlist)(const qm_bvh *bvh, const qm_near_packs *near, qm_vec p, qm_shortlist *list)
{
    qm_vi boxes = nearest_boxes(near, p), lanes = (qm_vi){0} + QM_NO_KEY;
    for (int i = QM_PACK_LANES - 1; i >= 0 && boxes[i] != QM_NO_KEY; i--) {
        if (boxes[i] > lanes[0]) break;
        unsigned place = qm_key_place(boxes[i]);
        uint32_t pack = near->pack[place];
        lanes = qm_vi_keep_least(lanes, qm_keys_sorted(lane_distances(bvh, pack, p), place << LANE_BITS,
                                                       qm_first_lanes(bvh->lanes[pack].lane_count)));
    }
    qm_pack_corners corners;
    for (int j = 0; j < QM_PACK_LANES; j++) {
        int32_t key = lanes[QM_PACK_LANES - 1 - j];
        unsigned place = qm_key_place(key == QM_NO_KEY ? lanes[QM_PACK_LANES - 1] : key);
        list->origin[j] = near->pack[place >> LANE_BITS];
        list->lane[j] = (uint8_t)(place & ((1 << LANE_BITS) - 1));
        qm_bvh_load_lane(bvh, list->origin[j], list->lane[j], j, &corners);
    }
    QM_KERNEL(fill_pack)(&list->pack, corners.at); /* cheaper than to look rows up, which lie far apart */
}
