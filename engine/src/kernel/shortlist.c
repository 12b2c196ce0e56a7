/**
 * shortlist.c: the few candidates that matter most for a small piece, side by side in one pack, so that a
 * point is compared with all of them at the price of one pack.
 */
#include "kernels.h"

/** Lanes in order of their distance, as places 8 * candidate + lane. */
typedef struct near_lanes {
    int count;
    double d2[QM_PACK_LANES];
    unsigned place[QM_PACK_LANES];
} near_lanes;

static void near_add(near_lanes *near, double d2, unsigned place)
{
    int at = near->count < QM_PACK_LANES ? near->count++ : near->count - 1;
    for (; at > 0 && near->d2[at - 1] > d2; at--) {
        near->d2[at] = near->d2[at - 1];
        near->place[at] = near->place[at - 1];
    }
    near->d2[at] = d2;
    near->place[at] = place;
}

static near_lanes find_near_lanes(const qm_candidates *all, qm_vec p)
{
    near_lanes near = {0};
    qm_splat s = qm_splat_make(p);
    for (int k = 0; k < all->count; k++) {
        for (int part = 0; part < QM_PARTS; part++) {
            qm_vd d2 = qm_pack_part_d2(all->pack[k], part, s.x, s.y, s.z);
            qm_vl usable = qm_vd_load(&all->allowed2[k][part * QM_WIDTH]) >= qm_vd_set(0.0);
            double worst = near.count < QM_PACK_LANES ? INFINITY : near.d2[QM_PACK_LANES - 1];
            unsigned bits = qm_vl_bits((d2 < qm_vd_set(worst)) & usable);
            for (; bits; bits &= bits - 1) {
                unsigned lane = (unsigned)__builtin_ctz(bits);
                if (near.count < QM_PACK_LANES || d2[lane] < near.d2[QM_PACK_LANES - 1])
                    near_add(&near, d2[lane], 8 * (unsigned)k + (unsigned)part * QM_WIDTH + lane);
            }
        }
    }
    return near;
}

bool QM_KERNEL(shortlist)(const qm_candidates *all, qm_vec p, qm_pack *pack, qm_candidates *near, double *upper)
{
    near_lanes lanes = find_near_lanes(all, p);
    if (lanes.count == 0) return false;
    near->count = 1; *upper=sqrt(lanes.d2[0]);
    near->pack[0] = pack;
    for (int j = 0; j < QM_PACK_LANES; j++) {
        unsigned place = lanes.place[j < lanes.count ? j : 0];
        const qm_pack *from = all->pack[place / 8];
        for (int r = 0; r < QM_ROW_COUNT; r++)
            pack->row[r][j] = from->row[r][place % 8];
        near->allowed2[0][j] = j < lanes.count ? all->allowed2[place / 8][place % 8] : -1.0;
        near->twist[0][j] = all->twist[place / 8][place % 8];
    }
    return true;
}
