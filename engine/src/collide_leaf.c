#include "collide_leaf.h"

#include <string.h>

#include "collide_search.h"
#include "kernel.h"

/** Any point in the midst of a leaf serves as its middle: the first vertex is at hand. */
static void load_vertices(const qm_bvh *bvh, const qm_frame *frame, const qm_pack_lanes *lanes, qm_leaf *out,
                          float (*vertex)[4])
{
    out->middle = qm_frame_local(frame, bvh->mesh.positions + 3 * (size_t)lanes->vertex[0]);
    for (int i = 0; i < lanes->vertex_count; i++) {
        uint32_t index = lanes->vertex[i];
        qm_vec v = qm_frame_local(frame, bvh->mesh.positions + 3 * (size_t)index);
        vertex[i][0] = (float)(v.x - out->middle.x);
        vertex[i][1] = (float)(v.y - out->middle.y);
        vertex[i][2] = (float)(v.z - out->middle.z);
        memcpy(&vertex[i][3], &index, sizeof index);
    }
}

void qm_leaf_fill(const qm_bvh *bvh, const qm_frame *frame, uint32_t pack, qm_leaf *out)
{
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    _Alignas(16) float vertex[3 * QM_PACK_LANES][4];
    uint8_t place[QM_PACK_LANES][3];
    load_vertices(bvh, frame, lanes, out, vertex);
    memcpy(place, lanes->corner, sizeof place);
    for (int lane = lanes->lane_count; lane < QM_PACK_LANES; lane++)
        memcpy(place[lane], place[0], sizeof place[0]);
    out->pack = pack;
    out->lane_count = lanes->lane_count;
    qm_kernel_get()->fill_leaf(out, vertex, place);
}
