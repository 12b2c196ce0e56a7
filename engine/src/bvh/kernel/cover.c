/**
 * cover.c: upper bounds without a nearest point. A convex set of points is within reach of the target as soon
 * as it is covered by convex sets {x : d(x, T_k) <= allowed_k}, whichever facets T_k are chosen: the distance
 * to a convex facet is convex, so it is enough to look at corners. Labels only decide how tight the cover is,
 * never whether it holds.
 */
#include <math.h>

#include "float_pack.h"
#include "kernels.h"
#include "reach.h"

#define MAX_CUTS 48 /* parts cut off a piece before it is given back */
#define ROUNDS 2    /* of looking where a label ends: one alone cuts too little where distances hardly vary */
#define STEPS (QM_PACK_LANES - 1) /* between the places along a line that single precision looks at */
#define MIN_MARGINS 16            /* of single precision that an cutoff distance must have */
#define MIN_PROGRESS 0.02         /* share of an edge that a cut must gain, or the label is not tried again */
#define CUT_TRIES 3               /* of a cut point, each nearer to the corner that is known to be in reach */
#define CUT_RETREAT 0.99

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

uint64_t QM_KERNEL(in_reach)(const qm_candidates *candidates, qm_vec p)
{
    qm_splat s = qm_splat_make(p);
    uint64_t bits = 0;
    for (int k = 0; k < candidates->count; k++) {
        unsigned here = 0;
        for (int part = 0; part < QM_PARTS; part++) {
            qm_vd d2 = qm_pack_part_d2(candidates->pack[k], part, s.x, s.y, s.z);
            qm_vd cutoff2 = qm_vd_load(&candidates->cutoff2[k][part * QM_WIDTH]);
            here |= qm_vl_bits(d2 <= cutoff2) << (part * QM_WIDTH);
        }
        bits |= (uint64_t)here << (8 * k);
    }
    return bits;
}

/** In single precision: the lanes of one pack, and the squared distances that are certain to be cutoff. */
typedef struct float_labels {
    const qm_float_pack *pack;
    qm_float_frames frames;
    qm_vf cutoff2;
} float_labels;

/** What a polygon is covered with: candidates, or labels in single precision. */
typedef struct cover_work {
    const qm_candidates *candidates;
    const float_labels *floats;
} cover_work;

static inline uint64_t labels_at(const cover_work *work, qm_vec p)
{
    if (!work->floats) return QM_KERNEL(in_reach)(work->candidates, p);
    qm_float_point q = qm_float_point_make(work->floats->pack, p);
    return qm_vi_bits(qm_float_point_d2(&work->floats->frames, &q) <= work->floats->cutoff2);
}

/**
 * How far from a (within reach of the lane) towards b (beyond it) the lane still reaches at least: a
 * parameter in [0, 1]. The squared distance is convex along the way, so between two places where it is known
 * it lies below the chord. That holds with a margin m on computed distances c too: where the chord of c^2 is
 * at (r - m)^2, the chord of (c + m)^2 is at r^2 at most, since the root is concave.
 */
static inline double float_reach_along(const float_labels *labels, int lane, qm_vec a, qm_vec b)
{
    const qm_vf place = {0.0f,         1.0f / STEPS, 2.0f / STEPS, 3.0f / STEPS,
                         4.0f / STEPS, 5.0f / STEPS, 6.0f / STEPS, 1.0f};
    const qm_float_frames frame = qm_float_frames_lane(&labels->frames, lane);
    const qm_float_point from = qm_float_point_make(labels->pack, a);
    const float step[3] = {(float)(b.x - a.x), (float)(b.y - a.y), (float)(b.z - a.z)};
    const float reach2 = labels->cutoff2[lane];
    float start = 0.0f, length = 1.0f, share = 0.0f;
    for (int round = 0; round < ROUNDS; round++) {
        qm_vf t = start + length * place;
        qm_vf d2 =
            qm_float_frames_d2(&frame, from.x + t * step[0], from.y + t * step[1], from.z + t * step[2]);
        int beyond = __builtin_ctz(~qm_vi_bits(d2 <= qm_vf_set(reach2)));
        if (beyond == 0) break;
        if (beyond == QM_PACK_LANES) return (double)(start + length);
        start = t[beyond - 1];
        length = t[beyond] - start;
        share = (reach2 - d2[beyond - 1]) / (d2[beyond] - d2[beyond - 1]);
    }
    return (double)(start + share * length) * (1.0 - 0x1p-20);
}

static inline double reach_along(const cover_work *work, int label, qm_vec a, qm_vec b)
{
    int lane = label % QM_PACK_LANES, k = label / QM_PACK_LANES;
    if (work->floats) return float_reach_along(work->floats, lane, a, b);
    return qm_pack_reach_along(work->candidates->pack[k], lane, work->candidates->cutoff2[k][lane], a, b);
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

/** A point with the labels that reach it. */
typedef struct cut_point {
    qm_vec at;
    uint64_t in_reach;
} cut_point;

/**
 * The point a share of the way from a (within reach of the label) to b. The part that is cut off is within
 * reach because this point is: that is measured, not derived from the share, and the point moves back where
 * rounding has put it beyond.
 */
static inline cut_point cut_at(const cover_work *work, int label, qm_vec a, qm_vec b, double share)
{
    for (int tries = 0; tries < CUT_TRIES; tries++) {
        cut_point cut = {.at = qm_vec_mix(a, b, share)};
        cut.in_reach = labels_at(work, cut.at);
        if (cut.in_reach >> label & 1) return cut;
        share *= CUT_RETREAT;
    }
    return (cut_point){a, labels_at(work, a)};
}

/** Replaces the run's corners by the two cut points. */
static inline void cut_off(qm_polygon *p, corner_run run, cut_point before, cut_point after)
{
    qm_polygon rest;
    rest.count = 0;
    rest.cuts_left = p->cuts_left - 1;
    for (int i = run.length; i < p->count; i++) {
        int from = (run.first + i) % p->count;
        rest.corner[rest.count] = p->corner[from];
        rest.in_reach[rest.count++] = p->in_reach[from];
    }
    rest.corner[rest.count] = before.at;
    rest.in_reach[rest.count++] = before.in_reach;
    rest.corner[rest.count] = after.at;
    rest.in_reach[rest.count++] = after.in_reach;
    *p = rest;
}

static inline bool cover(const cover_work *work, qm_polygon *p, bool *moved)
{
    uint64_t banned = 0;
    for (int cut = 0; cut < MAX_CUTS; cut++) {
        corner_run best = longest_run(p, banned);
        if (best.length == p->count) return true;
        if (best.length == 0 || p->count - best.length + 2 > QM_COVER_CORNERS || p->cuts_left == 0)
            return false;
        int label = __builtin_ctzll(best.labels);
        int first = best.first, last = (best.first + best.length - 1) % p->count;
        int previous = (first + p->count - 1) % p->count, next = (last + 1) % p->count;
        double back = reach_along(work, label, p->corner[first], p->corner[previous]);
        double forth = reach_along(work, label, p->corner[last], p->corner[next]);
        if (back < MIN_PROGRESS && forth < MIN_PROGRESS) {
            banned |= UINT64_C(1) << label;
            continue;
        }
        cut_off(p, best, cut_at(work, label, p->corner[first], p->corner[previous], back),
                cut_at(work, label, p->corner[last], p->corner[next], forth));
        *moved = true;
    }
    return false;
}

bool QM_KERNEL(cover)(const qm_candidates *candidates, qm_polygon *p, bool *moved)
{
    return cover(&(cover_work){.candidates = candidates}, p, moved);
}

/** The margin that holds for all of a polygon, and for what is cut off it. */
static inline float greatest_margin(const qm_float_pack *pack, const qm_polygon *p)
{
    float greatest = 0.0f;
    for (int i = 0; i < p->count; i++) {
        float margin = qm_float_point_make(pack, p->corner[i]).margin;
        greatest = margin > greatest ? margin : greatest;
    }
    return greatest;
}

qm_float_verdict QM_KERNEL(float_cover)(const qm_float_pack *pack, const float *twist, double cutoff,
                                        qm_polygon *p, bool *moved)
{
    float margin = greatest_margin(pack, p), rest = qm_float_below(cutoff) - margin;
    if (!(rest > MIN_MARGINS * margin)) return QM_FLOAT_TOO_COARSE;
    qm_vf reach = qm_vf_set(rest) - (twist ? qm_vf_load(twist) : (qm_vf){0});
    const float_labels labels = {pack, qm_float_frames_make(pack), qm_float_reach2(reach)};
    const cover_work work = {.floats = &labels};
    uint64_t common = ~UINT64_C(0);
    for (int i = 0; i < p->count; i++)
        common &= p->in_reach[i] = labels_at(&work, p->corner[i]);
    bool is_covered = common != 0 || (p->count == 3 && cover(&work, p, moved));
    return is_covered ? QM_FLOAT_COVERED : QM_FLOAT_OPEN;
}
