/**
 * shortlist.c: the few facets that matter most for a small piece, side by side in one pack, so that comparing
 * a point with all of them costs one pack.
 *
 * Float packs are copied, moved to the center of the first; their margin (bvh_tree.h) has room for the two
 * roundings of that, and the radius grows by the distance of the centers.
 */
#include "bvh/bvh_demand.h"
#include "float_pack.h"
#include "kernels.h"

enum { LANE_BITS = 3 };

/** Keys of the eight packs whose boxes are nearest to p, nearest last. */
static qm_vi nearest_boxes(const qm_near_packs *near, qm_vec p)
{
    QM_ASSERT(near->count >= 1 && near->count <= QM_NEAR_PACKS);
    qm_box_query query = qm_box_query_point(p);
    qm_vi keys = (qm_vi){0} + QM_NO_KEY;
    for (int first = 0; first < near->count; first += 8)
        keys = qm_vi_keep_min(keys, qm_keys_sorted(qm_box_node_d2(&near->box[first / 8], &query),
                                                   (unsigned)first, qm_first_lanes(near->count - first)));
    return keys;
}

/**
 * Squared distances that rank the lanes, in single precision: to the largest rectangle on the longest edge
 * inside each triangle, at a third of the cost of the triangle itself. Patches cover less than their
 * triangles, and small pieces over them stay uncovered for long where the nearest patch is not on the list:
 * with patches the triangles themselves are ranked.
 */
static inline qm_vf lane_ranks(const qm_bvh *bvh, uint32_t index, qm_vec p)
{
    const qm_float_pack *pack = qm_bvh_float_pack(bvh, index);
    qm_float_point q = qm_float_point_make(pack, p);
    if (qm_bvh_has_twists(bvh)) return qm_float_pack_d2(pack, &q);
#define COMPONENT(name) qm_vf_load(pack->row[QM_FLOAT_PACK_##name])
    const qm_vf zero = {0};
    qm_vf rx = q.x - COMPONENT(OX), ry = q.y - COMPONENT(OY), rz = q.z - COMPONENT(OZ);
    qm_vf x = rx * COMPONENT(XX) + ry * COMPONENT(XY) + rz * COMPONENT(XZ),
          y = rx * COMPONENT(YX) + ry * COMPONENT(YY) + rz * COMPONENT(YZ);
    qm_vf height2 = qm_vf_max(rx * rx + ry * ry + rz * rz - x * x - y * y, zero);
    qm_vf left = 0.5f * COMPONENT(CX), right = left + 0.5f * COMPONENT(L), top = 0.5f * COMPONENT(CY);
    qm_vf dx = x - qm_vf_min(qm_vf_max(x, left), right), dy = y - qm_vf_min(qm_vf_max(y, zero), top);
    return height2 + dx * dx + dy * dy;
#undef COMPONENT
}

void QM_KERNEL(shortlist)(const qm_bvh *bvh, const qm_near_packs *near, qm_vec p, qm_shortlist *list)
{
    qm_vi boxes = nearest_boxes(near, p), lanes = (qm_vi){0} + QM_NO_KEY;
    for (int i = QM_PACK_LANES - 1; i >= 0 && boxes[i] != QM_NO_KEY; i--) {
        if (boxes[i] > lanes[0]) break;
        unsigned slot = qm_key_index(boxes[i]);
        uint32_t pack = near->pack[slot];
        lanes = qm_vi_keep_min(lanes, qm_keys_sorted(lane_ranks(bvh, pack, p), slot << LANE_BITS,
                                                     qm_first_lanes(bvh->lanes[pack].lane_count)));
    }
    for (int j = 0; j < QM_PACK_LANES; j++) {
        int32_t key = lanes[QM_PACK_LANES - 1 - j];
        unsigned index = qm_key_index(key == QM_NO_KEY ? lanes[QM_PACK_LANES - 1] : key);
        list->pack[j] = near->pack[index >> LANE_BITS];
        list->lane[j] = (uint8_t)(index & ((1 << LANE_BITS) - 1));
    }
}

void QM_KERNEL(shortlist_pack)(const qm_bvh *bvh, const qm_shortlist *list, qm_pack *pack)
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
    QM_KERNEL(fill_pack)(pack, corners.at); /* cheaper than gathering the frames, which lie far apart */
}

void QM_KERNEL(shortlist_float_pack)(const qm_bvh *bvh, const qm_shortlist *list, qm_float_pack *pack)
{
    const qm_float_pack *first = qm_bvh_float_pack(bvh, list->pack[0]);
    memcpy(pack->middle, first->middle, sizeof pack->middle);
    pack->radius = first->radius;
    for (int j = 0; j < QM_PACK_LANES; j++) {
        const qm_float_pack *from = qm_bvh_float_pack(bvh, list->pack[j]);
        for (int i = 0; i < QM_FLOAT_PACK_COMPONENTS; i++)
            pack->row[i][j] = from->row[i][list->lane[j]];
        float offset = 0.0f;
        for (int k = 0; k < 3; k++) {
            float shift = from->middle[k] - pack->middle[k];
            pack->row[QM_FLOAT_PACK_OX + k][j] += shift;
            offset += __builtin_fabsf(shift);
        }
        if (pack->radius < from->radius + offset) pack->radius = from->radius + offset;
    }
}
