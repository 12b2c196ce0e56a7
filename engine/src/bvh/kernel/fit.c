/**
 * fit.c: the boxes of packs from the current positions of their vertices, all axes at once.
 */
#include "bvh/bvh_tree.h"
#include "extent.h"
#include "kernels.h"

#define AHEAD 512 /* list entries ahead whose vertices are prefetched: they lie all over the mesh */

/** The extent of the vertices of a list. Prefetches the vertex ahead entries later, unless ahead is 0. */
static inline extent find_extent(const double *positions, const uint32_t *vertex, size_t count, size_t ahead)
{
    extent e = extent_of_nothing();
    for (size_t i = 0; i < count; i++) {
        if (ahead > 0) __builtin_prefetch(positions + 3 * (size_t)vertex[i + ahead]);
        qm_four p = qm_four_position(positions + 3 * (size_t)vertex[i]);
        extent_add(&e, p);
    }
    return e;
}

/** Sets box i of a level. The box in the mesh, made local, equals that of the local vertices, since rounding
 * is monotone; so the box of a node may be made from the extent of all of its packs. */
static inline void set_box(qm_bvh *bvh, int level, size_t i, const extent *e)
{
    const qm_frame *frame = &bvh->frame;
    const qm_four origin = {frame->origin.x, frame->origin.y, frame->origin.z, 0.0};
    const extent local = {(e->low - origin) * frame->scale, (e->high - origin) * frame->scale};
    extent_set_box(bvh, level, i, &local);
}

void QM_KERNEL(fit_box)(qm_bvh *bvh, size_t pack, const uint32_t *vertices, size_t count)
{
    extent e = find_extent(bvh->mesh.positions, vertices, count, 0);
    set_box(bvh, 1, pack, &e);
}

void QM_KERNEL(fit_nodes)(qm_bvh *bvh, const qm_deformer *deformer, size_t begin, size_t end)
{
    for (size_t node = begin; node < end; node++) {
        const uint32_t *start = deformer->pack_start + 8 * node;
        int children = qm_box_tree_child_count(&bvh->boxes, 1, node);
        size_t ahead = start[children] + AHEAD <= deformer->pack_vertex_count ? AHEAD : 0;
        extent all = extent_of_nothing();
        for (int i = 0; i < children; i++) {
            extent e = find_extent(bvh->mesh.positions, deformer->pack_vertices + start[i],
                                   start[i + 1] - start[i], ahead);
            set_box(bvh, 1, 8 * node + (size_t)i, &e);
            all.low = qm_four_min(e.low, all.low);
            all.high = qm_four_max(e.high, all.high);
        }
        if (bvh->boxes.level_count > 1) set_box(bvh, 2, node, &all);
    }
}
