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

/** Coordinates along a segment in a triangle's frame: start + t step. */
typedef struct line {
    double x, y, z;    /* start */
    double ex, ey, ez; /* step */
} line;

static line line_in_lane(const qm_pack *pack, int lane, qm_vec a, qm_vec b)
{
#define AXIS(name)                                                                                           \
    ((qm_vec){pack->row[QM_ROW_##name##X][lane], pack->row[QM_ROW_##name##Y][lane],                          \
              pack->row[QM_ROW_##name##Z][lane]})
    qm_vec start = qm_vec_sub(a, AXIS(O)), step = qm_vec_sub(b, a);
    return (line){qm_vec_dot(start, AXIS(X)), qm_vec_dot(start, AXIS(Y)), qm_vec_dot(start, AXIS(Z)),
                  qm_vec_dot(step, AXIS(X)),  qm_vec_dot(step, AXIS(Y)),  qm_vec_dot(step, AXIS(Z))};
#undef AXIS
}

/** The part [from, to] of a line that lies in a convex set; empty when from > to. */
typedef struct span {
    double from, to;
} span;

/** Where a t^2 + 2 b t + c <= 0, a >= 0. */
static span quadratic_span(double a, double b, double c)
{
    double discriminant = b * b - a * c;
    if (!(discriminant >= 0.0)) return (span){1.0, 0.0};
    if (!(a > 0.0)) return c <= 0.0 ? (span){-INFINITY, INFINITY} : (span){1.0, 0.0};
    double root = sqrt(discriminant);
    return (span){(-b - root) / a, (-b + root) / a};
}

/** Cuts a span down to where k + m t >= 0. */
static span clip(span s, double k, double m)
{
    if (m > 0.0 && -k / m > s.from) s.from = -k / m;
    if (m < 0.0 && -k / m < s.to) s.to = -k / m;
    if (m == 0.0 && k < 0.0) s.to = -INFINITY;
    return s;
}

static span around_corner(const line *l, double x, double y, double reach2)
{
    double dx = l->x - x, dy = l->y - y;
    return quadratic_span(l->ex * l->ex + l->ey * l->ey + l->ez * l->ez,
                          dx * l->ex + dy * l->ey + l->z * l->ez, dx * dx + dy * dy + l->z * l->z - reach2);
}

/** Round the edge from (x, y) by (ux, uy), between its ends. */
static span around_edge(const line *l, double x, double y, double ux, double uy, double inverse_u2,
                        double reach2)
{
    if (inverse_u2 == 0.0) return (span){1.0, 0.0};
    double dx = l->x - x, dy = l->y - y;
    double k = ux * dy - uy * dx,
           m = ux * l->ey - uy * l->ex; /* height over the edge in the plane, times |u| */
    span s = quadratic_span(m * m * inverse_u2 + l->ez * l->ez, k * m * inverse_u2 + l->z * l->ez,
                            k * k * inverse_u2 + l->z * l->z - reach2);
    double along = (ux * dx + uy * dy) * inverse_u2, step = (ux * l->ex + uy * l->ey) * inverse_u2;
    return clip(clip(s, along, step), 1.0 - along, -step);
}

/** Over the inside of the triangle, both ways. */
static span over_inside(const line *l, double length, double cx, double cy, double reach)
{
    double ex = cx - length;
    if (!(cy > 0.0))
        return (span){1.0, 0.0}; /* no inside: the conditions below would let a half space through */
    span s = clip(clip((span){-INFINITY, INFINITY}, reach - l->z, -l->ez), reach + l->z, l->ez);
    s = clip(s, l->y, l->ey);
    s = clip(s, cy * l->x - cx * l->y, cy * l->ex - cx * l->ey);
    return clip(s, ex * l->y - cy * (l->x - length), ex * l->ey - cy * l->ex);
}

static double farther(double reached, span s)
{
    return s.from <= s.to && s.to > reached ? s.to : reached;
}

/**
 * How far from a (within reach of the lane) towards b (beyond it) the lane still reaches: a parameter in [0,
 * 1]. What lies within reach of a triangle is the union of a prism, three cylinders and three balls, and
 * convex; so the line leaves it where it leaves the last of them.
 */
static double reach_along(const qm_pack *pack, int lane, double reach2, qm_vec a, qm_vec b)
{
#define ROW(name) pack->row[QM_ROW_##name][lane]
    double length = ROW(L), cx = ROW(CX), cy = ROW(CY);
    double inverse_length2 = length > 0.0 ? 1.0 / (length * length) : 0.0;
    line l = line_in_lane(pack, lane, a, b);
    double reached = farther(0.0, over_inside(&l, length, cx, cy, sqrt(reach2)));
    reached = farther(reached, around_edge(&l, 0.0, 0.0, length, 0.0, inverse_length2, reach2));
    reached = farther(reached, around_edge(&l, 0.0, 0.0, cx, cy, ROW(INVERSE_C2), reach2));
    reached = farther(reached, around_edge(&l, length, 0.0, cx - length, cy, ROW(INVERSE_D2), reach2));
    reached = farther(reached, around_corner(&l, 0.0, 0.0, reach2));
    reached = farther(reached, around_corner(&l, length, 0.0, reach2));
    reached = farther(reached, around_corner(&l, cx, cy, reach2));
    return reached < 1.0 ? reached * (1.0 - 0x1p-40) : 1.0;
#undef ROW
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
