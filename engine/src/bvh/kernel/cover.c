/**
 * cover.c: upper bounds without a nearest point. A convex set of points is within the cutoff of the target as
 * soon as it is covered by convex sets {x : d(x, T_k) <= cutoff_k}, whichever facets T_k are chosen: the
 * distance to a convex facet is convex, so it suffices to test corners. The choice of facets only decides how
 * tight the cover is, never whether it holds.
 */
#include <math.h>

#include "float_pack.h"
#include "kernels.h"
#include "pack.h"
#include "reach.h"

#define MAX_CUTS 48 /* parts cut off a piece before its remainder is returned */
#define ROUNDS 2 /* of narrowing down where a facet ends: one cuts too little where distances hardly vary */
#define STEPS (QM_PACK_LANES - 1) /* between the points of a line that single precision samples */
#define MIN_MARGINS 16            /* that a cutoff must exceed in single precision */
#define MIN_PROGRESS 0.02 /* fraction of an edge that a cut must gain, or the facet is not tried again */
#define CUT_TRIES 3       /* of a cut point, each nearer to the corner that is within the cutoff */
#define CUT_RETREAT 0.99
#define NOT_LESS (1.0 + 0x1p-50) /* a square below another one times this may have the smaller root */

double QM_KERNEL(hull_upper)(const qm_candidates *candidates, const qm_vec *point, int count, int *nearest)
{
    QM_ASSERT(candidates->count <= QM_COVER_PACKS);
    double upper = INFINITY;
    *nearest = 0;
    for (int k = 0; k < candidates->count; k++) {
        for (int part = 0; part < QM_PARTS; part++) {
            qm_vd max2 = qm_vd_set(0.0), best2 = qm_vd_set(upper * upper * NOT_LESS);
            bool is_open =
                true; /* some lane may be nearer than the best: mostly one point shows that none is */
            for (int i = 0; i < count && is_open; i++) {
                qm_splat s = qm_splat_make(point[i]);
                max2 = qm_vd_max(qm_pack_part_d2(candidates->pack[k], part, s.x, s.y, s.z), max2);
                is_open = qm_vl_bits(max2 < best2) != 0;
            }
            for (int lane = 0; is_open && lane < QM_WIDTH; lane++) {
                double here = sqrt(max2[lane]) + candidates->twist[k][part * QM_WIDTH + lane];
                if (here < upper) {
                    upper = here;
                    *nearest = k;
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

/** In single precision: the lanes of one pack, and the squared distances that are certainly within the
 * cutoff. */
typedef struct float_lanes {
    const qm_float_pack *pack;
    qm_float_frames frames;
    qm_vf cutoff2;
} float_lanes;

/** What covers a polygon: candidates, or the lanes of a float pack. */
typedef struct cover_work {
    const qm_candidates *candidates;
    const float_lanes *floats;
} cover_work;

static inline uint64_t lanes_at(const cover_work *work, qm_vec p)
{
    if (!work->floats) return QM_KERNEL(in_reach)(work->candidates, p);
    qm_float_point q = qm_float_point_make(work->floats->pack, p);
    return qm_vi_bits(qm_float_point_d2(&work->floats->frames, &q) <= work->floats->cutoff2);
}

/**
 * Lower bound of the parameter in [0, 1] at which the line from a (within the cutoff of the lane) to b
 * (beyond it) leaves the set within the cutoff. The squared distance is convex along the line, so between two
 * samples it lies below the chord. That holds with a margin m on computed distances c too: where the chord of
 * c^2 is at (r - m)^2, the chord of (c + m)^2 is at r^2 at most, since the root is concave.
 */
static inline double float_reach_along(const float_lanes *lanes, int lane, qm_vec a, qm_vec b)
{
    const qm_vf sample = {0.0f,         1.0f / STEPS, 2.0f / STEPS, 3.0f / STEPS,
                          4.0f / STEPS, 5.0f / STEPS, 6.0f / STEPS, 1.0f};
    const qm_float_frames frame = qm_float_frames_lane(&lanes->frames, lane);
    const qm_float_point from = qm_float_point_make(lanes->pack, a);
    const float step[3] = {(float)(b.x - a.x), (float)(b.y - a.y), (float)(b.z - a.z)};
    const float reach2 = lanes->cutoff2[lane];
    float start = 0.0f, length = 1.0f, fraction = 0.0f;
    for (int round = 0; round < ROUNDS; round++) {
        qm_vf t = start + length * sample;
        qm_vf d2 =
            qm_float_frames_d2(&frame, from.x + t * step[0], from.y + t * step[1], from.z + t * step[2]);
        int beyond = __builtin_ctz(~qm_vi_bits(d2 <= qm_vf_set(reach2)));
        if (beyond == 0) break;
        if (beyond == QM_PACK_LANES) return (double)(start + length);
        start = t[beyond - 1];
        length = t[beyond] - start;
        fraction = (reach2 - d2[beyond - 1]) / (d2[beyond] - d2[beyond - 1]);
    }
    return (double)(start + fraction * length) * (1.0 - 0x1p-20);
}

static inline double reach_along(const cover_work *work, int facet, qm_vec a, qm_vec b)
{
    int lane = facet % QM_PACK_LANES, k = facet / QM_PACK_LANES;
    if (work->floats) return float_reach_along(work->floats, lane, a, b);
    return qm_pack_reach_along(work->candidates->pack[k], lane, work->candidates->cutoff2[k][lane], a, b);
}

/** The longest run of consecutive corners within the cutoff of one facet. */
typedef struct corner_run {
    int first, length;
    uint64_t lanes;
} corner_run;

static corner_run longest_run(const qm_polygon *p, uint64_t banned)
{
    corner_run best = {0, 0, 0};
    for (int first = 0; first < p->count; first++) {
        uint64_t lanes = p->in_reach[first] & ~banned;
        int length = 0;
        uint64_t kept = 0;
        for (int i = first; lanes && length < p->count; i = i + 1 == p->count ? 0 : i + 1) {
            kept = lanes;
            length++;
            lanes &= p->in_reach[i + 1 == p->count ? 0 : i + 1];
        }
        if (length > best.length) best = (corner_run){first, length, kept};
    }
    return best;
}

/** A point with the bits of the facets that it is within the cutoff of. */
typedef struct cut_point {
    qm_vec at;
    uint64_t in_reach;
} cut_point;

/**
 * The point a fraction of the way from a (within the cutoff of the facet) to b. The part cut off is within
 * the cutoff because this point is: that is measured, not derived from the fraction, and the point moves back
 * where rounding has put it beyond.
 */
static inline cut_point cut_at(const cover_work *work, int facet, qm_vec a, qm_vec b, double fraction)
{
    for (int tries = 0; tries < CUT_TRIES; tries++) {
        cut_point cut = {.at = qm_vec_mix(a, b, fraction)};
        cut.in_reach = lanes_at(work, cut.at);
        if (cut.in_reach >> facet & 1) return cut;
        fraction *= CUT_RETREAT;
    }
    return (cut_point){a, lanes_at(work, a)};
}

/** Replaces the run's corners by the two cut points. */
static inline void cut_off(qm_polygon *p, corner_run run, cut_point before, cut_point after)
{
    QM_ASSERT(p->count - run.length + 2 <= QM_COVER_CORNERS && p->cuts_left > 0);
    qm_polygon remainder;
    remainder.count = 0;
    remainder.is_hull = false;
    remainder.cuts_left = p->cuts_left - 1;
    for (int i = run.length; i < p->count; i++) {
        int from = (run.first + i) % p->count;
        remainder.corner[remainder.count] = p->corner[from];
        remainder.in_reach[remainder.count++] = p->in_reach[from];
    }
    remainder.corner[remainder.count] = before.at;
    remainder.in_reach[remainder.count++] = before.in_reach;
    remainder.corner[remainder.count] = after.at;
    remainder.in_reach[remainder.count++] = after.in_reach;
    *p = remainder;
}

static inline bool cover(const cover_work *work, qm_polygon *p, bool *moved)
{
    uint64_t banned = 0;
    for (int cut = 0; cut < MAX_CUTS; cut++) {
        corner_run best = longest_run(p, banned);
        if (best.length == p->count) return true;
        if (best.length == 0 || p->count - best.length + 2 > QM_COVER_CORNERS || p->cuts_left == 0)
            return false;
        int facet = __builtin_ctzll(best.lanes);
        int first = best.first, last = (best.first + best.length - 1) % p->count;
        int previous = (first + p->count - 1) % p->count, next = (last + 1) % p->count;
        double back = reach_along(work, facet, p->corner[first], p->corner[previous]);
        double forth = reach_along(work, facet, p->corner[last], p->corner[next]);
        if (back < MIN_PROGRESS && forth < MIN_PROGRESS) {
            banned |= UINT64_C(1) << facet;
            continue;
        }
        cut_off(p, best, cut_at(work, facet, p->corner[first], p->corner[previous], back),
                cut_at(work, facet, p->corner[last], p->corner[next], forth));
        *moved = true;
    }
    return false;
}

bool QM_KERNEL(cover)(const qm_candidates *candidates, qm_polygon *p, bool *moved)
{
    return cover(&(cover_work){.candidates = candidates}, p, moved);
}

/** The margin that holds for all of a polygon, and for any part of it. */
static inline float max_margin(const qm_float_pack *pack, const qm_polygon *p)
{
    float max = 0.0f;
    for (int i = 0; i < p->count; i++) {
        float margin = qm_float_point_make(pack, p->corner[i]).margin;
        max = margin > max ? margin : max;
    }
    return max;
}

qm_float_verdict QM_KERNEL(float_cover)(const qm_float_pack *pack, const float *twist, double cutoff,
                                        qm_polygon *p, bool *moved)
{
    float margin = max_margin(pack, p), exact = qm_float_below(cutoff) - margin;
    if (!(exact > MIN_MARGINS * margin)) return QM_FLOAT_TOO_COARSE;
    qm_vf reach = qm_vf_set(exact) - (twist ? qm_vf_load(twist) : (qm_vf){0});
    const float_lanes lanes = {pack, qm_float_frames_make(pack), qm_float_reach2(reach)};
    const cover_work work = {.floats = &lanes};
    uint64_t common = ~UINT64_C(0);
    for (int i = 0; i < p->count; i++)
        common &= p->in_reach[i] = lanes_at(&work, p->corner[i]);
    bool is_covered = common != 0 || (!p->is_hull && cover(&work, p, moved));
    return is_covered ? QM_FLOAT_COVERED : QM_FLOAT_OPEN;
}
