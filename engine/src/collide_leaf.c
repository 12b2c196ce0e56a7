#include "collide_leaf.h"

#include "collide_search.h"
#include "kernel.h"

/** The vertices of a pack in the frame, and the middle of their box. */
static qm_vec load_vertices(const qm_bvh *bvh, const qm_frame *frame, const qm_pack_lanes *lanes,
                            qm_vec *vertex)
{
    int count = 0;
    do
        vertex[count] = qm_frame_local(frame, bvh->mesh.positions + 3 * (size_t)lanes->vertex[count]);
    while (++count < lanes->vertex_count);
    qm_box box = qm_vec_box(vertex, count);
    return (qm_vec){0.5 * (box.min[0] + box.max[0]), 0.5 * (box.min[1] + box.max[1]),
                    0.5 * (box.min[2] + box.max[2])};
}

void qm_leaf_fill(const qm_bvh *bvh, const qm_frame *frame, uint32_t pack, qm_leaf *out)
{
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    qm_vec vertex[3 * QM_PACK_LANES];
    float from_middle[3 * QM_PACK_LANES][3];
    out->middle = load_vertices(bvh, frame, lanes, vertex);
    for (int i = 0; i < lanes->vertex_count; i++) {
        qm_vec v = qm_vec_sub(vertex[i], out->middle);
        from_middle[i][0] = (float)v.x;
        from_middle[i][1] = (float)v.y;
        from_middle[i][2] = (float)v.z;
    }
    for (int lane = 0; lane < QM_PACK_LANES; lane++) {
        const uint8_t *corner = lanes->corner[lane < lanes->lane_count ? lane : 0];
        for (int c = 0; c < 3; c++) {
            out->vertex[c][lane] = lanes->vertex[corner[c]];
            for (int k = 0; k < 3; k++)
                out->corner[c][k][lane] = from_middle[corner[c]][k];
        }
    }
    out->pack = pack;
    out->lane_count = lanes->lane_count;
    qm_kernel_get()->finish_leaf(out);
}
