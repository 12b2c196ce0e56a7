/**
 * float_pack.c: upper bounds of distances from packs in single precision.
 */
#include "float_pack.h"

#include "bvh/bvh_demand.h"
#include "four.h"
#include "walk.h"

#define NEARLY_SHARE2 0.7 /* of the least squared distance so far: no box is looked at that is not nearer */

#include <math.h>

#define WIDE qm_vf
#define WIDE_MASK qm_vi
#define WIDE_SET(x) qm_vf_set((float)(x))
#define WIDE_SQRT(a) qm_vf_sqrt(a)
#define WIDE_SELECT(mask, a, b) qm_vf_select(mask, a, b)
#define WIDE_FLAT 0x1p-21
#define WIDE_SHORT 0x1p-120
#include "frames.inc"

/** A corner of all lanes about the middle of the pack. */
static inline wide_vec load(const float middle[3], const double corner[3][QM_PACK_LANES])
{
    qm_vf about[3];
    for (int k = 0; k < 3; k++) {
        qm_eight row;
        memcpy(&row, corner[k], sizeof row);
        about[k] = __builtin_convertvector(row - (double)middle[k], qm_vf);
    }
    return (wide_vec){about[0], about[1], about[2]};
}

void QM_KERNEL(fill_float)(qm_float_pack *pack, const double corner[3][3][QM_PACK_LANES])
{
    for (int k = 0; k < 3; k++)
        pack->middle[k] = (float)((corner[0][k][0] + corner[0][k][QM_PACK_LANES / 2]) * 0.5);
    wide_vec a = load(pack->middle, corner[0]), b = load(pack->middle, corner[1]),
             c = load(pack->middle, corner[2]);
    wide_frame f = wide_frame_make(a, b, c);
    const qm_vf row[QM_FLOAT_ROW_COUNT] = {f.origin.x, f.origin.y, f.origin.z, f.x.x,    f.x.y, f.x.z,
                                           f.y.x,      f.y.y,      f.y.z,      f.length, f.cx,  f.cy};
    memcpy(pack->row, row, sizeof row);
    qm_vf far2 = qm_vf_max(wide_dot(a, a), qm_vf_max(wide_dot(b, b), wide_dot(c, c)));
    pack->radius = 1.000001f * __builtin_sqrtf(qm_vf_max_lane(far2));
}

/** Distances to the lanes' surfaces; twist may be NULL. */
static inline qm_vf distance_row(const qm_float_pack *pack, const float *twist, const qm_float_point *q)
{
    qm_vf row = qm_vf_sqrt(qm_float_pack_d2(pack, q));
    return twist ? row + qm_vf_load(twist) : row;
}

double QM_KERNEL(float_upper)(const qm_float_pack *pack, const float *twist, qm_vec p)
{
    qm_float_point q = qm_float_point_make(pack, p);
    double upper = ((double)qm_vf_least(distance_row(pack, twist, &q)) + (double)q.margin) * (1.0 + 0x1p-22);
    return upper < INFINITY ? upper : INFINITY;
}

/** Points from the middle of a pack; returns the margin that holds for all of them. */
static inline float points_from_middle(const qm_float_pack *pack, const qm_vec *point, unsigned wanted,
                                       float (*at)[4])
{
    const qm_four middle = {(double)pack->middle[0], (double)pack->middle[1], (double)pack->middle[2], 0.0};
    qm_four_floats far = {0};
    for (; wanted; wanted &= wanted - 1) {
        int i = __builtin_ctz(wanted);
        qm_four_floats q = qm_four_round(qm_four_position(&point[i].x) - middle);
        memcpy(at[i], &q, sizeof q);
        far = qm_four_farther(far, q);
    }
    float sum = far[0] + far[1] + far[2] + pack->radius;
    return QM_FLOAT_MARGIN * sum + QM_FLOAT_LEAST;
}

void QM_KERNEL(float_reach)(const qm_float_pack *pack, const float *twist, double cutoff, const qm_vec *point,
                            unsigned wanted, qm_float_bits *bits)
{
    const qm_float_frames frames = qm_float_frames_make(pack);
    const qm_vf leave = twist ? qm_vf_load(twist) : (qm_vf){0};
    float at[3 * QM_PACK_LANES][4];
    float margin = points_from_middle(pack, point, wanted, at);
    qm_vf within2 = qm_float_reach2(qm_float_below(cutoff) - margin - leave),
          about2 = qm_float_reach2(qm_float_above(cutoff) + margin - leave);
    for (; wanted; wanted &= wanted - 1) {
        int i = __builtin_ctz(wanted);
        const qm_float_point q = {at[i][0], at[i][1], at[i][2], margin};
        qm_vf d2 = qm_float_point_d2(&frames, &q);
        bits[i] = (qm_float_bits)(qm_vi_bits(d2 <= within2) | qm_vi_bits(d2 <= about2) << 8);
    }
}

typedef struct float_search {
    const qm_bvh *bvh;
    qm_vec p;
    qm_float_hit *hit;
} float_search;

static inline void visit(const float_search *search, uint32_t index)
{
    const qm_float_pack *pack = qm_bvh_floats(search->bvh, index);
    qm_float_point q = qm_float_point_make(pack, search->p);
    qm_vf d2 = qm_float_pack_d2(pack, &q);
    float least = qm_vf_least(d2);
    double upper = (double)__builtin_sqrtf(least) + (double)q.margin;
    if (!(upper < search->hit->upper)) return;
    unsigned lanes = qm_vi_bits(d2 == qm_vf_set(least));
    *search->hit = (qm_float_hit){upper, index, (uint32_t)__builtin_ctz(lanes)};
}

void QM_KERNEL(float_closest)(const qm_bvh *bvh, qm_vec p, double enough, qm_float_hit *hit)
{
    const float_search search = {bvh, p, hit};
    qm_box_query query = qm_box_query_point(p);
    uint32_t start = hit->pack;
    *hit = (qm_float_hit){INFINITY, start, 0};
    visit(&search, start);
    float limit = qm_box_limit(NEARLY_SHARE2 * hit->upper * hit->upper);
    qm_walk walk;
    qm_walk_start_at(&walk, start);
    while (hit->upper > enough && qm_walk_climb(&walk, &bvh->boxes, &query, limit)) {
        qm_stack_entry at = qm_walk_pop(&walk);
        if (!(at.d2 <= limit)) continue;
        if (at.level > 0) {
            qm_walk_push(&walk, &bvh->boxes, &query, limit, at);
        } else {
            visit(&search, at.index);
            limit = qm_box_limit(NEARLY_SHARE2 * hit->upper * hit->upper);
        }
    }
}
