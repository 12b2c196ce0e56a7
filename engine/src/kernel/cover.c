/**
 * cover.c: upper bounds without a nearest point. A convex set of points is within reach of the target as soon
 * as it is covered by convex sets {x : d(x, T_k) <= allowed_k}, whichever facets T_k are chosen: the distance
 * to a convex facet is convex, so it is enough to look at corners. Labels only decide how tight the cover is,
 * never whether it holds.
 */
#include <math.h>

#include "kernels.h"

#define MAX_CUTS 48       /* parts cut off a piece before it is given back */
#define MIN_PROGRESS 0.02 /* share of an edge that a cut must gain, or the label is not tried again */

uint64_t QM_KERNEL(in_reach)(const qm_candidates *candidates, qm_vec p)
{
    qm_splat s = qm_splat_make(p);
    uint64_t bits = 0;
    for (int k = 0; k < candidates->count; k++) {
        unsigned here = 0;
        for (int part = 0; part < QM_PARTS; part++) {
            qm_vd d2 = qm_pack_part_d2(candidates->pack[k], part, s.x, s.y, s.z);
            qm_vd allowed2 = qm_vd_load(&candidates->allowed2[k][part * QM_WIDTH]);
            here |= qm_vl_bits(d2 <= allowed2) << (part * QM_WIDTH);
        }
        bits |= (uint64_t)here << (8 * k);
    }
    return bits;
}

double QM_KERNEL(hull_upper)(const qm_candidates *candidates, const qm_vec *point, int count, int *place)
{
    double upper = INFINITY;
    *place = 0;
    for (int k = 0; k < candidates->count; k++) {
        for (int part = 0; part < QM_PARTS; part++) {
            qm_vd greatest2 = qm_vd_set(0.0);
            for (int i = 0; i < count; i++) {
                qm_splat s = qm_splat_make(point[i]);
                greatest2 = qm_vd_max(qm_pack_part_d2(candidates->pack[k], part, s.x, s.y, s.z), greatest2);
            }
            for (int lane = 0; lane < QM_WIDTH; lane++) {
                double here = sqrt(greatest2[lane]) + candidates->twist[k][part * QM_WIDTH + lane];
                if (here < upper) {
                    upper = here;
                    *place = k;
                }
            }
        }
    }
    return upper;
}

/**
 * How far from a (within reach of the lane) towards b (beyond it) the lane still reaches at least: a parameter
 * in [0, 1]. The squared distance is convex along the way, so between two places where it is known it lies
 * below the chord.
 */
static double reach_along(const qm_pack *pack, int lane, double reach2, qm_vec a, qm_vec b)
{
    enum { STEPS = QM_PACK_LANES - 1 };
    _Alignas(64) static const double place[QM_PACK_LANES] = {0.0,         1.0 / STEPS, 2.0 / STEPS, 3.0 / STEPS,
                                                             4.0 / STEPS, 5.0 / STEPS, 6.0 / STEPS, 1.0};
    _Alignas(64) double d2[QM_PACK_LANES];
    qm_vec step = qm_vec_sub(b, a);
    unsigned within = 0;
    for (int at = 0; at < QM_PACK_LANES; at += QM_WIDTH) {
        qm_vd t = qm_vd_load(place + at);
        qm_vd here = qm_pack_lanes_d2(pack, (qm_pack_lanes_of){lane, true}, a.x + t * step.x,
                                      a.y + t * step.y, a.z + t * step.z);
        qm_vd_store(d2 + at, here);
        within |= qm_vl_bits(here <= reach2) << at;
    }
    int first = __builtin_ctz(~within);
    if (first == QM_PACK_LANES) return 1.0;
    if (first == 0) return 0.0;
    double share = (reach2 - d2[first - 1]) / (d2[first] - d2[first - 1]);
    return (place[first - 1] + share * (1.0 / STEPS)) * (1.0 - 0x1p-40);
}

/** The longest run of neighbouring corners that one label reaches. */
typedef struct corner_run {
    int first, length;
    uint64_t labels;
} corner_run;

static corner_run longest_run(const qm_polygon *p, uint64_t banned)
{
    corner_run best = {0, 0, 0};
    for (int first = 0; first < p->count; first++) {
        uint64_t labels = p->in_reach[first] & ~banned;
        int length = 0;
        uint64_t kept = 0;
        for (int i = first; labels && length < p->count; i = i + 1 == p->count ? 0 : i + 1) {
            kept = labels;
            length++;
            labels &= p->in_reach[i + 1 == p->count ? 0 : i + 1];
        }
        if (length > best.length) best = (corner_run){first, length, kept};
    }
    return best;
}

/** Replaces the run's corners by the two cut points. */
static void cut_off(const qm_candidates *candidates, qm_polygon *p, corner_run run, qm_vec before,
                    qm_vec after)
{
    qm_polygon rest;
    rest.count = 0;
    for (int i = run.length; i < p->count; i++) {
        int from = (run.first + i) % p->count;
        rest.corner[rest.count] = p->corner[from];
        rest.in_reach[rest.count++] = p->in_reach[from];
    }
    rest.corner[rest.count] = before;
    rest.in_reach[rest.count++] = QM_KERNEL(in_reach)(candidates, before);
    rest.corner[rest.count] = after;
    rest.in_reach[rest.count++] = QM_KERNEL(in_reach)(candidates, after);
    *p = rest;
}

bool QM_KERNEL(cover)(const qm_candidates *candidates, qm_polygon *p, bool *moved)
{
    uint64_t banned = 0;
    for (int cut = 0; cut < MAX_CUTS; cut++) {
        corner_run best = longest_run(p, banned);
        if (best.length == p->count) return true;
        if (best.length == 0 || p->count - best.length + 2 > QM_COVER_CORNERS) return false;
        int label = __builtin_ctzll(best.labels), lane = label % QM_PACK_LANES;
        const qm_pack *pack = candidates->pack[label / QM_PACK_LANES];
        double allowed2 = candidates->allowed2[label / QM_PACK_LANES][lane];
        int first = best.first, last = (best.first + best.length - 1) % p->count;
        int previous = (first + p->count - 1) % p->count, next = (last + 1) % p->count;
        double back = reach_along(pack, lane, allowed2, p->corner[first], p->corner[previous]);
        double forth = reach_along(pack, lane, allowed2, p->corner[last], p->corner[next]);
        if (back < MIN_PROGRESS && forth < MIN_PROGRESS) {
            banned |= UINT64_C(1) << label;
            continue;
        }
        qm_vec before = qm_vec_mix(p->corner[first], p->corner[previous], back);
        qm_vec after = qm_vec_mix(p->corner[last], p->corner[next], forth);
        cut_off(candidates, p, best, before, after);
        *moved = true;
    }
    return false;
}
