/**
 * gather.c: the packs that lie near a box: from the tree once for a neighbourhood, and from that
 * neighbourhood again for each smaller box in it.
 */
#include "kernels.h"
#include "walk.h"

static qm_box_query query_middle(const qm_box *box)
{
    qm_vec middle = {0.5 * (box->min[0] + box->max[0]), 0.5 * (box->min[1] + box->max[1]),
                     0.5 * (box->min[2] + box->max[2])};
    return qm_box_query_point(middle);
}

static void copy_box(qm_near_packs *near, int place, const qm_box_node *from, int member)
{
    qm_box_node *to = &near->box[place / 8];
    for (int k = 0; k < 3; k++) {
        to->low[k][place % 8] = from->low[k][member];
        to->high[k][place % 8] = from->high[k][member];
    }
}

/** How far the packs of a full list lie, and which place is the farthest. */
typedef struct places {
    float distance[QM_NEAR_PACKS];
    int farthest;
} places;

static void find_farthest(places *p)
{
    p->farthest = 0;
    for (int i = 1; i < QM_NEAR_PACKS; i++)
        if (p->distance[i] > p->distance[p->farthest]) p->farthest = i;
}

/** Where a pack at a distance goes: the next free place, or that of the farthest when all are taken; -1 for
 * nowhere. */
static int find_place(qm_near_packs *near, places *p, float here)
{
    bool is_full = near->count == QM_NEAR_PACKS;
    if (is_full && !(here < p->distance[p->farthest])) return -1;
    int place = is_full ? p->farthest : near->count++;
    p->distance[place] = here;
    if (near->count == QM_NEAR_PACKS) find_farthest(p);
    return place;
}

/** True when no pack can take a place any more: the middle lies in the boxes of all, as among many copies of
 * one face. */
static bool is_settled(const qm_near_packs *near, const places *p)
{
    return near->count == QM_NEAR_PACKS && !(p->distance[p->farthest] > 0.0f);
}

void QM_KERNEL(gather)(const qm_bvh *bvh, const qm_box *box, double reach, qm_near_packs *near)
{
    qm_box_query query = qm_box_query_make(box->min, box->max), middle = query_middle(box);
    float limit = qm_box_limit(reach * reach);
    places at_places = {.farthest = 0};
    qm_walk walk;
    near->count = 0;
    qm_walk_start(&walk, &bvh->boxes);
    while (walk.height > 0 && !is_settled(near, &at_places)) {
        qm_stack_entry at = qm_walk_pop(&walk);
        if (at.level > 1) {
            qm_walk_push(&walk, &bvh->boxes, &query, limit, at);
            continue;
        }
        _Alignas(32) float d2[QM_PACK_LANES], middle_d2[QM_PACK_LANES];
        const qm_box_node *group = &bvh->boxes.groups[1][at.index];
        unsigned within = qm_box_node_within(group, &query, limit, d2);
        within &= (1u << qm_box_tree_child_count(&bvh->boxes, 1, at.index)) - 1;
        if (within) qm_box_node_within(group, &middle, limit, middle_d2);
        for (; within; within &= within - 1) {
            int member = __builtin_ctz(within);
            int place = find_place(near, &at_places, middle_d2[member]);
            if (place < 0) continue;
            near->pack[place] = 8 * at.index + (uint32_t)member;
            copy_box(near, place, group, member);
        }
    }
}

int QM_KERNEL(narrow)(const qm_near_packs *near, const qm_box *box, double reach, int capacity,
                      uint32_t *packs)
{
    qm_box_query query = qm_box_query_make(box->min, box->max), middle = query_middle(box);
    float limit = qm_box_limit(reach * reach);
    qm_vi keys = (qm_vi){0} + QM_NO_KEY;
    for (int first = 0; first < near->count; first += 8) {
        const qm_box_node *group = &near->box[first / 8];
        qm_vi within = (qm_box_node_d2(group, &query) <= limit) & qm_first_lanes(near->count - first);
        keys =
            qm_vi_keep_least(keys, qm_keys_sorted(qm_box_node_d2(group, &middle), (unsigned)first, within));
    }
    _Alignas(32) int32_t key[QM_COVER_PACKS];
    memcpy(key, &keys, sizeof key);
    int count = 0;
    for (; count < capacity && key[QM_COVER_PACKS - 1 - count] != QM_NO_KEY; count++)
        packs[count] = near->pack[qm_key_place(key[QM_COVER_PACKS - 1 - count])];
    return count;
}
