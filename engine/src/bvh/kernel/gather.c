/**
 * gather.c: the packs near a box: from the tree once for a neighborhood, and from that neighborhood again for
 * each smaller box in it.
 */
#include "kernels.h"
#include "traversal.h"

static qm_box_query query_center(const qm_box *box)
{
    qm_vec center = {0.5 * (box->min[0] + box->max[0]), 0.5 * (box->min[1] + box->max[1]),
                     0.5 * (box->min[2] + box->max[2])};
    return qm_box_query_point(center);
}

static void copy_box(qm_near_packs *near, int slot, const qm_box_node *from, int child)
{
    qm_box_node *to = &near->box[slot / 8];
    for (int k = 0; k < 3; k++) {
        to->low[k][slot % 8] = from->low[k][child];
        to->high[k][slot % 8] = from->high[k][child];
    }
}

/** The distances of the packs of a list, and once it is full the slot of the farthest. */
typedef struct near_distances {
    float distance[QM_NEAR_PACKS];
    int farthest;
} near_distances;

static void find_farthest(near_distances *p)
{
    p->farthest = 0;
    for (int i = 1; i < QM_NEAR_PACKS; i++)
        if (p->distance[i] > p->distance[p->farthest]) p->farthest = i;
}

/** The slot for a pack at a distance: the next free one, or that of the farthest when all are taken; -1 when
 * that is nearer. */
static int find_slot(qm_near_packs *near, near_distances *p, float here)
{
    bool is_full = near->count == QM_NEAR_PACKS;
    if (is_full && !(here < p->distance[p->farthest])) return -1;
    int slot = is_full ? p->farthest : near->count++;
    p->distance[slot] = here;
    if (near->count == QM_NEAR_PACKS) find_farthest(p);
    return slot;
}

/** True when no further pack can enter the list: the center lies in the boxes of all, as among many copies of
 * one face. */
static bool is_final(const qm_near_packs *near, const near_distances *p)
{
    return near->count == QM_NEAR_PACKS && !(p->distance[p->farthest] > 0.0f);
}

void QM_KERNEL(gather)(const qm_bvh *bvh, const qm_box *box, double reach, qm_near_packs *near)
{
    qm_box_query query = qm_box_query_make(box->min, box->max), center = query_center(box);
    float limit = qm_box_limit(reach * reach);
    near_distances distances = {.farthest = 0};
    qm_traversal traversal;
    near->count = 0;
    qm_traversal_start(&traversal, &bvh->boxes);
    while (traversal.height > 0 && !is_final(near, &distances)) {
        qm_stack_entry at = qm_traversal_pop(&traversal);
        if (at.level > 1) {
            qm_traversal_push(&traversal, &bvh->boxes, &query, limit, at);
            continue;
        }
        _Alignas(32) float d2[QM_PACK_LANES], center_d2[QM_PACK_LANES];
        const qm_box_node *node = &bvh->boxes.groups[1][at.index];
        unsigned within = qm_box_node_within(node, &query, limit, d2);
        within &= (1u << qm_box_tree_child_count(&bvh->boxes, 1, at.index)) - 1;
        if (within) qm_box_node_within(node, &center, limit, center_d2);
        for (; within; within &= within - 1) {
            int child = __builtin_ctz(within);
            int slot = find_slot(near, &distances, center_d2[child]);
            if (slot < 0) continue;
            near->pack[slot] = 8 * at.index + (uint32_t)child;
            copy_box(near, slot, node, child);
        }
    }
}

int QM_KERNEL(narrow)(const qm_near_packs *near, const qm_box *box, double reach, int capacity,
                      uint32_t *packs)
{
    qm_box_query query = qm_box_query_make(box->min, box->max), center = query_center(box);
    float limit = qm_box_limit(reach * reach);
    qm_vi keys = (qm_vi){0} + QM_NO_KEY;
    for (int first = 0; first < near->count; first += 8) {
        const qm_box_node *node = &near->box[first / 8];
        qm_vi within = (qm_box_node_d2(node, &query) <= limit) & qm_first_lanes(near->count - first);
        keys = qm_vi_keep_min(keys, qm_keys_sorted(qm_box_node_d2(node, &center), (unsigned)first, within));
    }
    QM_ASSERT(near->count <= QM_NEAR_PACKS && capacity <= QM_COVER_PACKS);
    _Alignas(32) int32_t key[QM_COVER_PACKS];
    memcpy(key, &keys, sizeof key);
    int count = 0;
    for (; count < capacity && key[QM_COVER_PACKS - 1 - count] != QM_NO_KEY; count++)
        packs[count] = near->pack[qm_key_index(key[QM_COVER_PACKS - 1 - count])];
    return count;
}
