/**
 * search.c: nearest triangle or patch, by descent from the root, nearest box first.
 *
 * Source: Roussopoulos, Kelley, Vincent, Nearest Neighbor Queries, SIGMOD 1995.
 */
#include "kernels.h"
#include "visit.h"
#include "walk.h"

void QM_KERNEL(pack_distances)(const qm_pack *pack, qm_vec p, double d2[QM_PACK_LANES])
{
    _Alignas(64) double row[QM_PACK_LANES];
    qm_pack_d2(pack, p, row);
    for (int lane = 0; lane < QM_PACK_LANES; lane++)
        d2[lane] = row[lane];
}

void QM_KERNEL(closest)(const qm_bvh *bvh, qm_vec p, qm_hit *hit)
{
    qm_splat splat = qm_splat_make(p);
    qm_box_query query = qm_box_query_point(p);
    uint32_t start = hit->pack;
    hit->lane = QM_PACK_LANES;
    qm_visit_pack(bvh, start, splat, hit);
    float limit = qm_box_limit(hit->d2);
    qm_walk walk;
    qm_walk_start(&walk, &bvh->boxes);
    while (walk.height > 0) {
        qm_stop at = qm_walk_pop(&walk);
        if (!(at.d2 <= limit)) continue;
        if (at.level > 0) {
            qm_walk_push(&walk, &bvh->boxes, &query, limit, at);
        } else if (at.index != start && !qm_pack_is_far(bvh, at.index, p, sqrt(hit->d2))) {
            qm_visit_pack(bvh, at.index, splat, hit);
            limit = qm_box_limit(hit->d2);
        }
    }
}

void QM_KERNEL(closest_patch)(const qm_bvh *bvh, qm_vec p, uint32_t start, double error, qm_patch_hit *hit)
{
    qm_box_query query = qm_box_query_point(p);
    *hit = (qm_patch_hit){.distance = INFINITY, .lower = INFINITY, .face = QM_NO_INDEX};
    qm_visit_patches(bvh, start, p, error, hit);
    float limit = qm_box_limit(hit->distance * hit->distance);
    qm_walk walk;
    qm_walk_start(&walk, &bvh->boxes);
    while (walk.height > 0) {
        qm_stop at = qm_walk_pop(&walk);
        if (!(at.d2 <= limit)) continue;
        if (at.level > 0) {
            qm_walk_push(&walk, &bvh->boxes, &query, limit, at);
        } else if (at.index != start) {
            qm_visit_patches(bvh, at.index, p, error, hit);
            limit = qm_box_limit(hit->distance * hit->distance);
        }
    }
    hit->lower = fmin(hit->lower, hit->distance);
}
