/**
 * search.c: nearest triangle or patch, by traversal from the root, nearest box first.
 *
 * Source: Roussopoulos, Kelley, Vincent, Nearest Neighbor Queries, SIGMOD 1995.
 */
#include "kernels.h"
#include "traversal.h"
#include "visit.h"

void QM_KERNEL(pack_distances)(const qm_pack *pack, qm_vec p, double d2[QM_PACK_LANES])
{
    _Alignas(64) double aligned[QM_PACK_LANES];
    qm_pack_d2(pack, p, aligned);
    for (int lane = 0; lane < QM_PACK_LANES; lane++)
        d2[lane] = aligned[lane];
}

void QM_KERNEL(closest)(const qm_bvh *bvh, qm_vec p, qm_hit *hit)
{
    qm_splat splat = qm_splat_make(p);
    qm_box_query query = qm_box_query_point(p);
    uint32_t start = hit->pack;
    hit->lane = QM_PACK_LANES;
    qm_visit_pack(bvh, start, splat, hit);
    float limit = qm_box_limit(hit->d2);
    qm_traversal traversal;
    qm_traversal_start(&traversal, &bvh->boxes);
    while (traversal.height > 0) {
        qm_stack_entry at = qm_traversal_pop(&traversal);
        if (!(at.d2 <= limit)) continue;
        if (at.level > 0) {
            qm_traversal_push(&traversal, &bvh->boxes, &query, limit, at);
        } else if (at.index != start && !qm_pack_is_far(bvh, at.index, p, sqrt(hit->d2))) {
            qm_visit_pack(bvh, at.index, splat, hit);
            limit = qm_box_limit(hit->d2);
        }
    }
}

/** True when a pack need not be visited. */
typedef bool is_far_fn(const void *best, uint32_t pack);

/** Visits every pack whose box comes within the distance that the last visit returned, the pack start
 * first, until that is at most enough. */
__attribute__((always_inline)) static inline void traverse(const qm_bvh *bvh, qm_vec p, uint32_t start,
                                                           double enough, is_far_fn *is_far,
                                                           qm_visit_fn *visit, void *best)
{
    qm_box_query query = qm_box_query_point(p);
    double distance = visit(best, start);
    float limit = qm_box_limit(distance * distance);
    qm_traversal traversal;
    qm_traversal_start(&traversal, &bvh->boxes);
    while (traversal.height > 0 && distance > enough) {
        qm_stack_entry at = qm_traversal_pop(&traversal);
        if (!(at.d2 <= limit)) continue;
        if (at.level > 0) {
            qm_traversal_push(&traversal, &bvh->boxes, &query, limit, at);
        } else if (at.index != start && !is_far(best, at.index)) {
            distance = visit(best, at.index);
            limit = qm_box_limit(distance * distance);
        }
    }
}

static inline bool is_never_far(const void *best, uint32_t pack)
{
    (void)best;
    (void)pack;
    return false;
}

#define NONE_IS_ENOUGH (-1.0)

static inline void search_patches(const qm_bvh *bvh, qm_vec p, uint32_t start, double error, double enough,
                                  qm_bilinear_hit *hit)
{
    *hit = (qm_bilinear_hit){.distance = INFINITY, .lower = INFINITY, .face = QM_NO_INDEX};
    qm_patch_search search = {bvh, p, error, hit, {.is_set = false}};
    traverse(bvh, p, start, enough, is_never_far, qm_visit_all_patches, &search);
}

void QM_KERNEL(closest_patch)(const qm_bvh *bvh, qm_vec p, uint32_t start, double error, qm_bilinear_hit *hit)
{
    search_patches(bvh, p, start, error, NONE_IS_ENOUGH, hit);
    hit->lower = fmin(hit->lower, hit->distance);
}

void QM_KERNEL(near_patch)(const qm_bvh *bvh, qm_vec p, uint32_t start, double enough, qm_bilinear_hit *hit)
{
    search_patches(bvh, p, start, INFINITY, enough, hit);
    hit->lower = 0.0;
}

static inline bool is_beyond_ties(const void *best, uint32_t pack)
{
    const qm_tie_search *search = best;
    return qm_pack_is_far(search->bvh, pack, search->p, search->ties->reach);
}

void QM_KERNEL(closest_ties)(const qm_bvh *bvh, qm_vec p, uint32_t start, qm_ties *ties)
{
    qm_tie_search search = {bvh, qm_splat_make(p), p, ties};
    if (ties->error > 0.0)
        traverse(bvh, p, start, NONE_IS_ENOUGH, is_never_far, qm_visit_tied_patches, &search);
    else
        traverse(bvh, p, start, NONE_IS_ENOUGH, is_beyond_ties, qm_visit_tied_triangles, &search);
}
