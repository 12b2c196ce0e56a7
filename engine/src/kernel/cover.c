/**
 * cover.c: upper bounds without a nearest point. A convex set of points is within reach of the target as soon
 * as it is covered by convex sets {x : d(x, T_k) <= allowed_k}, whichever facets T_k are chosen: the distance
 * to a convex facet is convex, so it is enough to look at corners. Labels only decide how tight the cover is,
 * never whether it holds.
 */
#include "kernels.h"

#define MAX_CUTS 48       /* parts cut off a piece before it is given back */
#define MIN_PROGRESS 0.02 /* share of an edge that a cut must gain, or the label is not tried again */
#define ROOT_STEPS 5

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

/** One lane as seen from a segment: coordinates in the triangle's frame run linearly from start to start +
 * step. */
typedef struct lane_segment {
    double start[3], step[3];
    double length, cx, cy, inverse_c2, inverse_d2;
} lane_segment;

static lane_segment lane_segment_make(const qm_pack *pack, int lane, qm_vec a, qm_vec b)
{
#define ROW(name) pack->row[QM_ROW_##name][lane]
    qm_vec d = {a.x - ROW(OX), a.y - ROW(OY), a.z - ROW(OZ)};
    qm_vec e = qm_vec_sub(b, a);
    lane_segment s;
    for (int k = 0; k < 3; k++) {
        qm_vec axis = {pack->row[QM_ROW_XX + 3 * k][lane], pack->row[QM_ROW_XY + 3 * k][lane],
                       pack->row[QM_ROW_XZ + 3 * k][lane]};
        s.start[k] = qm_vec_dot(d, axis);
        s.step[k] = qm_vec_dot(e, axis);
    }
    s.length = ROW(L);
    s.cx = ROW(CX);
    s.cy = ROW(CY);
    s.inverse_c2 = ROW(INVERSE_C2);
    s.inverse_d2 = ROW(INVERSE_D2);
    return s;
#undef ROW
}

static double least(double a, double b)
{
    return a < b ? a : b;
}

static double lane_segment_d2(const lane_segment *s, double t)
{
    double x = s->start[0] + t * s->step[0], y = s->start[1] + t * s->step[1],
           z = s->start[2] + t * s->step[2];
    double ex = s->cx - s->length, xl = x - s->length;
    if (y > 0.0 && s->cy * x - s->cx * y > 0.0 && ex * y - s->cy * xl > 0.0) return z * z;
    double ax = x - qm_clamp(x, 0.0, s->length);
    double r = qm_clamp((x * s->cx + y * s->cy) * s->inverse_c2, 0.0, 1.0);
    double bx = x - r * s->cx, by = y - r * s->cy;
    double q = qm_clamp((xl * ex + y * s->cy) * s->inverse_d2, 0.0, 1.0);
    double gx = xl - q * ex, gy = y - q * s->cy;
    double edge2 = least(ax * ax + y * y, least(bx * bx + by * by, gx * gx + gy * gy));
    return edge2 + z * z;
}

/**
 * How far from a (within reach of the lane) towards b (beyond it) the lane still reaches: a parameter t in
 * [0, 1) whose point is within reach as far as rounding lets it. The distance is convex along the segment, so
 * the chord's root lies inside; Illinois weighting keeps the far end moving too.
 */
static double reach_along(const qm_pack *pack, int lane, double allowed2, qm_vec a, qm_vec b)
{
    lane_segment s = lane_segment_make(pack, lane, a, b);
    double allowed = sqrt(allowed2);
    double inside = 0.0, outside = 1.0;
    double f_inside = sqrt(lane_segment_d2(&s, 0.0)) - allowed,
           f_outside = sqrt(lane_segment_d2(&s, 1.0)) - allowed;
    for (int step = 0; step < ROOT_STEPS; step++) {
        double slope = f_outside - f_inside;
        double t = slope > 0.0 ? inside - f_inside * (outside - inside) / slope : 0.5 * (inside + outside);
        if (!(t > inside && t < outside)) break;
        double f = sqrt(lane_segment_d2(&s, t)) - allowed;
        if (f <= 0.0) {
            inside = t;
            f_inside = f;
            if (f > -1e-3 * allowed) break;
            f_outside *= 0.5;
        } else {
            outside = t;
            f_outside = f;
            f_inside *= 0.5;
        }
    }
    return inside;
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
    *moved = false;
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
