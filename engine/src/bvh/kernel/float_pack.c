/**
 * float_pack.c: float packs, upper bounds of distances from them, and the approximate nearest triangle.
 */
#include "float_pack.h"

#include "bvh/bvh_demand.h"
#include "four.h"
#include "traversal.h"

#define APPROXIMATE_RATIO2 0.7 /* of the min squared distance so far: boxes that are not nearer are pruned */

#include <math.h>

#define WIDE qm_vf
#define WIDE_MASK qm_vi
#define WIDE_SET(x) qm_vf_set((float)(x))
#define WIDE_SQRT(a) qm_vf_sqrt(a)
#define WIDE_SELECT(mask, a, b) qm_vf_select(mask, a, b)
#define WIDE_FLAT 0x1p-21
#define WIDE_SHORT 0x1p-120
#include "frames.inc"

/** Loads a corner of all lanes relative to the center of the pack. */
static inline wide_vec load(const float center[3], const double corner[3][QM_PACK_LANES])
{
    qm_vf relative[3];
    for (int k = 0; k < 3; k++) {
        qm_eight row;
        memcpy(&row, corner[k], sizeof row);
        relative[k] = __builtin_convertvector(row - (double)center[k], qm_vf);
    }
    return (wide_vec){relative[0], relative[1], relative[2]};
}

void QM_KERNEL(fill_float)(qm_float_pack *pack, const double corner[3][3][QM_PACK_LANES])
{
    for (int k = 0; k < 3; k++)
        pack->middle[k] = (float)((corner[0][k][0] + corner[0][k][QM_PACK_LANES / 2]) * 0.5);
    wide_vec a = load(pack->middle, corner[0]), b = load(pack->middle, corner[1]),
             c = load(pack->middle, corner[2]);
    wide_frame f = wide_frame_make(a, b, c);
    const qm_vf component[QM_FLOAT_PACK_COMPONENTS] = {
        f.origin.x, f.origin.y, f.origin.z, f.x.x, f.x.y, f.x.z, f.y.x, f.y.y, f.y.z, f.length, f.cx, f.cy};
    memcpy(pack->row, component, sizeof component);
    qm_vf far2 = qm_vf_max(wide_dot(a, a), qm_vf_max(wide_dot(b, b), wide_dot(c, c)));
    pack->radius = 1.000001f * __builtin_sqrtf(qm_vf_max_lane(far2));
}

/** Distances to the lanes' surfaces; twist may be NULL. */
static inline qm_vf lane_distances(const qm_float_pack *pack, const float *twist, const qm_float_point *q)
{
    qm_vf distance = qm_vf_sqrt(qm_float_pack_d2(pack, q));
    return twist ? distance + qm_vf_load(twist) : distance;
}

double QM_KERNEL(float_upper)(const qm_float_pack *pack, const float *twist, qm_vec p)
{
    qm_float_point q = qm_float_point_make(pack, p);
    double upper =
        ((double)qm_vf_min_lane(lane_distances(pack, twist, &q)) + (double)q.margin) * (1.0 + 0x1p-22);
    return upper < INFINITY ? upper : INFINITY;
}

/** Loads points relative to the center of a pack; returns the margin that holds for all of them. */
static inline float points_from_center(const qm_float_pack *pack, const qm_vec *point, unsigned wanted,
                                       float (*at)[4])
{
    const qm_four center = {(double)pack->middle[0], (double)pack->middle[1], (double)pack->middle[2], 0.0};
    qm_four_floats far = {0};
    for (; wanted; wanted &= wanted - 1) {
        int i = __builtin_ctz(wanted);
        qm_four_floats q = qm_four_round(qm_four_position(&point[i].x) - center);
        memcpy(at[i], &q, sizeof q);
        far = qm_four_max_magnitude(far, q);
    }
    float sum = far[0] + far[1] + far[2] + pack->radius;
    return QM_FLOAT_MARGIN * sum + QM_FLOAT_UNDERFLOW;
}

void QM_KERNEL(float_reach)(const qm_float_pack *pack, const float *twist, double cutoff, const qm_vec *point,
                            unsigned wanted, qm_float_bits *bits)
{
    const qm_float_frames frames = qm_float_frames_make(pack);
    const qm_vf widening = twist ? qm_vf_load(twist) : (qm_vf){0};
    float at[3 * QM_PACK_LANES][4];
    float margin = points_from_center(pack, point, wanted, at);
    qm_vf within2 = qm_float_reach2(qm_float_below(cutoff) - margin - widening),
          about2 = qm_float_reach2(qm_float_above(cutoff) + margin - widening);
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
    const qm_float_pack *pack = qm_bvh_float_pack(search->bvh, index);
    qm_float_point q = qm_float_point_make(pack, search->p);
    qm_vf d2 = qm_float_pack_d2(pack, &q);
    float min = qm_vf_min_lane(d2);
    double upper = (double)__builtin_sqrtf(min) + (double)q.margin;
    if (!(upper < search->hit->upper)) return;
    unsigned lanes = qm_vi_bits(d2 == qm_vf_set(min));
    *search->hit = (qm_float_hit){upper, index, (uint32_t)__builtin_ctz(lanes)};
}

void QM_KERNEL(float_closest)(const qm_bvh *bvh, qm_vec p, double stop_below, qm_float_hit *hit)
{
    const float_search search = {bvh, p, hit};
    qm_box_query query = qm_box_query_point(p);
    uint32_t start = hit->pack;
    *hit = (qm_float_hit){INFINITY, start, 0};
    visit(&search, start);
    float limit = qm_box_limit(APPROXIMATE_RATIO2 * hit->upper * hit->upper);
    qm_traversal traversal;
    qm_traversal_start_at(&traversal, start);
    while (hit->upper > stop_below && qm_traversal_climb(&traversal, &bvh->boxes, &query, limit)) {
        qm_stack_entry at = qm_traversal_pop(&traversal);
        if (!(at.d2 <= limit)) continue;
        if (at.level > 0) {
            qm_traversal_push(&traversal, &bvh->boxes, &query, limit, at);
        } else {
            visit(&search, at.index);
            limit = qm_box_limit(APPROXIMATE_RATIO2 * hit->upper * hit->upper);
        }
    }
}
