/**
 * fit.c: the box of a pack from where its vertices are now, all axes at once.
 */
#include "../bvh_tree.h"
#include "four.h"
#include "kernels.h"

/** Made local, the box in the mesh is that of the local vertices, since rounding keeps order. */
void QM_KERNEL(fit_box)(qm_bvh *bvh, size_t pack)
{
    const qm_pack_lanes *lanes = &bvh->lanes[pack];
    const double *positions = bvh->mesh.positions;
    qm_four low = qm_four_load(positions + 3 * (size_t)lanes->vertex[0]), high = low;
    int count = lanes->vertex_count;
    for (int i = 1; i < count; i++) {
        qm_four p = qm_four_load(positions + 3 * (size_t)lanes->vertex[i]);
        low = qm_four_least(low, p);
        high = qm_four_greatest(high, p);
    }
    const qm_frame *frame = &bvh->frame;
    const qm_four origin = {frame->origin.x, frame->origin.y, frame->origin.z, 0.0};
    qm_four from = (low - origin) * frame->scale, to = (high - origin) * frame->scale;
    qm_box box = {{from[0], from[1], from[2]}, {to[0], to[1], to[2]}};
    qm_box_tree_set(&bvh->boxes, pack, &box);
}
