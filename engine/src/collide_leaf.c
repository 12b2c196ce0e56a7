#include "collide_leaf.h"

#include <string.h>

#include "collide_search.h"
#include "kernel.h"

/** The same for equal positions, and hardly ever for others. (0 and -0 differ, so that such corners take the
 * long way.) */
static uint32_t mix_position(const double *position)
{
    uint64_t x[3];
    memcpy(x, position, sizeof x);
    uint64_t mixed = (x[0] * 3 + x[1]) * 5 + x[2];
    mixed *= UINT64_C(0x9e3779b97f4a7c15);
    return (uint32_t)(mixed >> 32);
}

/** Fetches the positions of a pack all at once; they lie anywhere. */
static void prefetch_vertices(const qm_bvh *bvh, const qm_pack_lanes *lanes)
{
    for (int i = 0; i < lanes->vertex_count; i++)
        __builtin_prefetch(bvh->mesh.positions + 3 * (size_t)lanes->vertex[i]);
}

/** Any point in the midst of a leaf serves as its middle: the first vertex is at hand. */
static void load_vertices(const qm_bvh *bvh, const qm_frame *frame, qm_collide_kind kind,
                          const qm_pack_lanes *lanes, qm_leaf *out, float (*vertex)[4])
{
    out->middle = qm_frame_local(frame, bvh->mesh.positions + 3 * (size_t)lanes->vertex[0]);
    for (int i = 0; i < lanes->vertex_count; i++) {
        const double *position = bvh->mesh.positions + 3 * (size_t)lanes->vertex[i];
        uint32_t mark = kind == QM_COLLIDE_TWO ? mix_position(position) : lanes->vertex[i];
        qm_vec v = qm_frame_local(frame, position);
        vertex[i][0] = (float)(v.x - out->middle.x);
        vertex[i][1] = (float)(v.y - out->middle.y);
        vertex[i][2] = (float)(v.z - out->middle.z);
        memcpy(&vertex[i][3], &mark, sizeof mark);
    }
}

void qm_leaf_fill(const qm_bvh *bvh, const qm_frame *frame, qm_collide_kind kind, uint32_t pack, qm_leaf *out)
{
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    _Alignas(16) float vertex[3 * QM_PACK_LANES][4];
    uint8_t place[QM_PACK_LANES][3];
    prefetch_vertices(bvh, lanes);
    load_vertices(bvh, frame, kind, lanes, out, vertex);
    memcpy(place, lanes->corner, sizeof place);
    for (int lane = lanes->lane_count; lane < QM_PACK_LANES; lane++)
        memcpy(place[lane], place[0], sizeof place[0]);
    for (int lane = 0; lane < lanes->lane_count; lane++)
        out->face[lane] = qm_mesh_input_face(&bvh->mesh, lanes->face[lane]);
    out->pack = pack;
    out->lane_count = lanes->lane_count;
    qm_kernel_get()->fill_leaf(out, vertex, place);
}
