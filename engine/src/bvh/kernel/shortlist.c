/**
 * shortlist.c: the few facets that matter most for a small piece, side by side in one pack, so that a point
 * is compared with all of them at the price of one pack.
 *
 * Float packs are copied, moved to the middle of the first; their margin (../float_pack.h) has room for the
 * two roundings of that, and the radius grows by how far the middles lie apart.
 */
#include "bvh/bvh_demand.h"
#include "float_pack.h"
#include "kernels.h"

enum { LANE_BITS = 3 };

/** The eight packs whose boxes are nearest to p, nearest last. */
static qm_vi nearest_boxes(const qm_near_packs *near, qm_vec p)
{
    qm_box_query query = qm_box_query_point(p);
    qm_vi keys = (qm_vi){0} + QM_NO_KEY;
    for (int first = 0; first < near->count; first += 8)
        keys = qm_vi_keep_least(keys, qm_keys_sorted(qm_box_node_d2(&near->box[first / 8], &query),
                                                     (unsigned)first, qm_first_lanes(near->count - first)));
    return keys;
}

/**
 * Squared distances by which lanes are ranked, in single precision as the rows decide: to the greatest
 * rectangle on the longest edge inside each triangle, at a third of the price of the triangle's own. Patches
 * reach less far than their triangles, and small pieces over them are not covered for long where the nearest
 * is not on the list: there the triangles themselves are ranked.
 */
static inline qm_vf lane_ranks(const qm_bvh *bvh, uint32_t index, qm_vec p)
{
    const qm_float_pack *pack = qm_bvh_floats(bvh, index);
    qm_float_point q = qm_float_point_make(pack, p);
    if (qm_bvh_has_twists(bvh)) return qm_float_pack_d2(pack, &q);
#define ROW(name) qm_vf_load(pack->row[QM_FLOAT_##name])
    const qm_vf zero = {0};
    qm_vf rx = q.x - ROW(OX), ry = q.y - ROW(OY), rz = q.z - ROW(OZ);
    qm_vf x = rx * ROW(XX) + ry * ROW(XY) + rz * ROW(XZ), y = rx * ROW(YX) + ry * ROW(YY) + rz * ROW(YZ);
    qm_vf height2 = qm_vf_max(rx * rx + ry * ry + rz * rz - x * x - y * y, zero);
    qm_vf left = 0.5f * ROW(CX), right = left + 0.5f * ROW(L), top = 0.5f * ROW(CY);
    qm_vf dx = x - qm_vf_min(qm_vf_max(x, left), right), dy = y - qm_vf_min(qm_vf_max(y, zero), top);
    return height2 + dx * dx + dy * dy;
#undef ROW
}

void QM_KERNEL(shortlist)(const qm_bvh *bvh, const qm_near_packs *near, qm_vec p, qm_shortlist *list)
{
    qm_vi boxes = nearest_boxes(near, p), lanes = (qm_vi){0} + QM_NO_KEY;
    for (int i = QM_PACK_LANES - 1; i >= 0 && boxes[i] != QM_NO_KEY; i--) {
        if (boxes[i] > lanes[0]) break;
        unsigned place = qm_key_place(boxes[i]);
        uint32_t pack = near->pack[place];
        lanes = qm_vi_keep_least(lanes, qm_keys_sorted(lane_ranks(bvh, pack, p), place << LANE_BITS,
                                                       qm_first_lanes(bvh->lanes[pack].lane_count)));
    }
    for (int j = 0; j < QM_PACK_LANES; j++) {
        int32_t key = lanes[QM_PACK_LANES - 1 - j];
        unsigned place = qm_key_place(key == QM_NO_KEY ? lanes[QM_PACK_LANES - 1] : key);
        list->pack[j] = near->pack[place >> LANE_BITS];
        list->lane[j] = (uint8_t)(place & ((1 << LANE_BITS) - 1));
    }
}

void QM_KERNEL(shortlist_rows)(const qm_bvh *bvh, const qm_shortlist *list, qm_pack *rows)
{
    qm_pack_corners corners;
    for (int j = 0; j < QM_PACK_LANES; j++) {
        qm_vec corner[3];
        qm_bvh_load_triangle(bvh, list->pack[j], list->lane[j], corner);
        for (int i = 0; i < 3; i++) {
            corners.at[i][0][j] = corner[i].x;
            corners.at[i][1][j] = corner[i].y;
            corners.at[i][2][j] = corner[i].z;
        }
    }
    QM_KERNEL(fill_pack)(rows, corners.at); /* cheaper than to look rows up, which lie far apart */
}

void QM_KERNEL(shortlist_floats)(const qm_bvh *bvh, const qm_shortlist *list, qm_float_pack *rows)
{
    const qm_float_pack *first = qm_bvh_floats(bvh, list->pack[0]);
    memcpy(rows->middle, first->middle, sizeof rows->middle);
    rows->radius = first->radius;
    for (int j = 0; j < QM_PACK_LANES; j++) {
        const qm_float_pack *from = qm_bvh_floats(bvh, list->pack[j]);
        for (int row = 0; row < QM_FLOAT_ROW_COUNT; row++)
            rows->row[row][j] = from->row[row][list->lane[j]];
        float offset = 0.0f;
        for (int k = 0; k < 3; k++) {
            float shift = from->middle[k] - rows->middle[k];
            rows->row[QM_FLOAT_OX + k][j] += shift;
            offset += __builtin_fabsf(shift);
        }
        if (rows->radius < from->radius + offset) rows->radius = from->radius + offset;
    }
}
