/**
 * corners.c: the corners of a whole pack from where its vertices are now, each of which is loaded once.
 */
#include "four.h"
#include "kernels.h"

void QM_KERNEL(load_corners)(const qm_bvh *bvh, size_t pack, qm_pack_corners *out)
{
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    const qm_frame *frame = &bvh->frame;
    const qm_four origin = {frame->origin.x, frame->origin.y, frame->origin.z, 0.0};
    qm_four vertex[3 * QM_PACK_LANES];
    for (int i = 0; i < lanes->vertex_count; i++)
        vertex[i] =
            (qm_four_position(bvh->mesh.positions + 3 * (size_t)lanes->vertex[i]) - origin) * frame->scale;
    for (int lane = 0; lane < QM_PACK_LANES; lane++) {
        const uint8_t *place = lanes->corner[lane < lanes->lane_count ? lane : 0];
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++)
                out->at[i][k][lane] = vertex[place[i]][k];
    }
}
