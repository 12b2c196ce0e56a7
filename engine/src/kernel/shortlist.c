/**
 * shortlist.c: the few facets that matter most for a small piece, side by side in one pack, so that a point
 * is compared with all of them at the price of one pack.
 */
#include "box.h"
#include "kernels.h"

/** Lanes in the order of their distances. */
typedef struct near_lanes {
    int count;
    double d2[QM_PACK_LANES];
    uint32_t pack[QM_PACK_LANES];
    uint8_t lane[QM_PACK_LANES];
} near_lanes;

/** Squared distances of the boxes, infinite past the last one; returns how many groups of eight there are. */
static int box_distances(const qm_near_packs *near, qm_vec p, qm_vf d2[QM_NEAR_PACKS / 8])
{
    qm_box_query query = qm_box_query_point(p);
    int groups = (near->count + 7) / 8;
    for (int g = 0; g < groups; g++)
        qm_box_group_within(&near->box[g], &query, 0.0f, (float *)&d2[g]);
    for (int i = near->count; i < 8 * groups; i++)
        d2[i / 8][i % 8] = __builtin_inff();
    return groups;
}

/** Takes the nearest box out of the list: returns its place and sets its distance to infinity. */
static int take_nearest(qm_vf *d2, int groups, float *least)
{
    qm_vf low = d2[0];
    for (int g = 1; g < groups; g++)
        low = qm_vf_min(low, d2[g]);
    *least = low[0];
    for (int i = 1; i < 8; i++)
        *least = low[i] < *least ? low[i] : *least;
    int g = 0;
    unsigned bits;
    while (!(bits = qm_vi_bits(d2[g] <= (qm_vf){0} + *least)))
        g++;
    int i = __builtin_ctz(bits);
    d2[g][i] = __builtin_inff();
    return 8 * g + i;
}

static void near_add(near_lanes *near, double d2, uint32_t pack, int lane)
{
    int at = near->count < QM_PACK_LANES ? near->count++ : near->count - 1;
    for (; at > 0 && near->d2[at - 1] > d2; at--) {
        near->d2[at] = near->d2[at - 1];
        near->pack[at] = near->pack[at - 1];
        near->lane[at] = near->lane[at - 1];
    }
    near->d2[at] = d2;
    near->pack[at] = pack;
    near->lane[at] = (uint8_t)lane;
}

static inline double near_worst(const near_lanes *near)
{
    return near->count < QM_PACK_LANES ? INFINITY : near->d2[QM_PACK_LANES - 1];
}

static void near_visit(near_lanes *near, const qm_bvh *bvh, uint32_t pack, qm_splat s)
{
    int lane_count = bvh->lanes[pack].lane_count;
    for (int part = 0; part < QM_PARTS; part++) {
        qm_vd d2 = qm_pack_part_d2(&bvh->packs[pack], part, s.x, s.y, s.z);
        unsigned bits = qm_vl_bits(d2 < qm_vd_set(near_worst(near)));
        for (; bits; bits &= bits - 1) {
            int i = __builtin_ctz(bits), lane = part * QM_WIDTH + i;
            if (lane < lane_count && d2[i] < near_worst(near)) near_add(near, d2[i], pack, lane);
        }
    }
}

void QM_KERNEL(shortlist)(const qm_bvh *bvh, const qm_near_packs *near, qm_vec p, qm_shortlist *list)
{
    near_lanes lanes = {.count = 0};
    qm_splat s = qm_splat_make(p);
    qm_vf d2[QM_NEAR_PACKS / 8];
    int groups = box_distances(near, p, d2);
    for (int visit = 0; visit < near->count; visit++) {
        float least;
        int place = take_nearest(d2, groups, &least);
        if (least > qm_box_limit(near_worst(&lanes))) break;
        near_visit(&lanes, bvh, near->pack[place], s);
    }
    list->count = lanes.count;
    for (int j = 0; j < QM_PACK_LANES; j++) {
        int from = j < lanes.count ? j : 0;
        list->origin[j] = lanes.pack[from];
        list->lane[j] = lanes.lane[from];
        const qm_pack *pack = &bvh->packs[list->origin[j]];
        for (int r = 0; r < QM_ROW_COUNT; r++)
            list->pack.row[r][j] = pack->row[r][list->lane[j]];
    }
}
