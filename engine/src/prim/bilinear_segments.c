/**
 * bilinear_segments.c: proves that a patch lies beyond a distance from a point, segment by segment.
 *
 * The patch is a family of segments, from a(s) to a(s) + d(s), where a is a side and d is linear in s, both
 * relative to p. The squared distance from p to the line of a segment is |a x d|^2 / |d|^2, so that all lines
 * of an interval are beyond r when the quartic
 *     |a x d|^2 - r^2 |d|^2
 * has no negative Bernstein coefficient there. Nor does the line count where its footpoint is before the
 * segment, a.d >= 0, or behind it, -a.d >= |d|^2, as the nearest point of the segment is on a side then. What
 * neither settles is halved: near the minimum of the distance, down to the root of what r is short of it.
 *
 * Roundings, for u = 2^-53 and S the greatest coordinate. A computed a is off by 11 u S and a + d by 21: the
 * differences, products and sums of which they are have lengths of 2 sqrt(3) S at most, w twice that. So the
 * ends that are computed for an interval belong to a patch that is within 21 u S of this one, as all computed
 * points do (rounding.h). From these on, a x d is off by 2 sqrt(2) u |a| |d|, the middle coefficient by u
 * more; products of such vectors by 3 u, and sums of them with their weights by 3 u more; r^2 |d|^2 in all by
 * 8 u. So with c the longest a x d, and f = 6 u |a| |d|, coefficients are off by less than
 * 2 f |c| + f^2 + 16 u |c|^2 + 16 u r^2 |d|^2, those of a.d by f. That is 10 u of |a| and of the distance
 * where d is as long as elsewhere.
 *
 * A side, from a on along e: the dot product is off by 3 u |a| |e|, the quotient by 4 u of itself, so that the foot is
 * off by 7 u |a| along the side, at most; the vector to it by u (|a| + |e|), its length by 3 u |a|, and the difference
 * from that by u |a|: 12 u |a| + u |e|, below SIDE_ROUNDINGS of both. So where the coordinates' differences are exact, a
 * proof does not go beyond the distance from a side at all, and elsewhere by what they are off.
 */
#include "bilinear.h"

#include "core/rounding.h"

#define CROSS_ROUNDINGS 6.0
#define SQUARE_ROUNDINGS 16.0
#define SIDE_ROUNDINGS 16.0  /* of the coordinates: the distance to a side */
#define MAX_INTERVALS 200    /* of one proof: 40 are usual */
#define MIN_INTERVAL 0x1p-40 /* of s */
#define MAX_HEIGHT (40 + 2)  /* of the stack: one half of each level, and both of the last one */

/** The segments from one side to another. */
typedef struct segments {
    qm_vec side, along_side; /* a = side + s along_side, d = across + s turn */
    qm_vec across, turn;
    double distance, square;
    bool side_is_beyond[2];
} segments;

static double most(double a, double b, double c)
{
    return qm_max(a, qm_max(b, c));
}

/** Whether a side, all of it, is beyond the distance. */
static bool is_side_beyond(qm_vec from, qm_vec along, double distance)
{
    double length2 = qm_vec_norm2(along);
    double share = length2 > 0.0 ? qm_clamp(-qm_vec_dot(from, along) / length2, 0.0, 1.0) : 0.0;
    double rounding = SIDE_ROUNDINGS * QM_UNIT_ROUNDING * (qm_vec_norm(from) + sqrt(length2));
    return qm_vec_norm(qm_vec_axpy(from, share, along)) - rounding >= distance;
}

/** The shortest vector d of a family, as a part of the longest one, squared. */
static double shrinkage(qm_vec across, qm_vec turn)
{
    double length2 = qm_vec_norm2(turn), first = qm_vec_norm2(across);
    double last = qm_vec_norm2(qm_vec_add(across, turn));
    double share = length2 > 0.0 ? qm_clamp(-qm_vec_dot(across, turn) / length2, 0.0, 1.0) : 0.0;
    double least = qm_vec_norm2(qm_vec_axpy(across, share, turn));
    return least > 0.0 ? least / qm_max(first, last) : 0.0;
}

/** The family whose segments shrink less: what lines tell of short segments is poor. */
static segments segments_make(const qm_bilinear *patch, qm_vec p, double distance)
{
    qm_vec r = qm_vec_sub(patch->origin, p);
    segments all = {r, patch->e1, patch->e2, patch->w, distance, distance * distance, {false, false}};
    if (shrinkage(patch->e1, patch->w) > shrinkage(patch->e2, patch->w)) {
        all.along_side = patch->e2;
        all.across = patch->e1;
    }
    all.side_is_beyond[0] = is_side_beyond(r, all.along_side, distance);
    all.side_is_beyond[1] =
        is_side_beyond(qm_vec_add(r, all.across), qm_vec_add(all.along_side, all.turn), distance);
    return all;
}

typedef enum verdict { BEYOND, NEARER, OPEN } verdict;

/** Bernstein coefficients over an interval. */
typedef struct coefficients {
    double beyond[5]; /* of the quartic, less its rounding */
    double along[3];  /* of -a.d, */
    double length[3]; /* and of |d|^2 */
    double rounding;  /* of both */
} coefficients;

static coefficients find_coefficients(const segments *all, double low, double high)
{
    const qm_vec a0 = qm_vec_axpy(all->side, low, all->along_side),
                 d0 = qm_vec_axpy(all->across, low, all->turn);
    const qm_vec a1 = qm_vec_axpy(all->side, high, all->along_side),
                 d1 = qm_vec_axpy(all->across, high, all->turn);
    const qm_vec c0 = qm_vec_cross(a0, d0), c2 = qm_vec_cross(a1, d1);
    const qm_vec c1 = qm_vec_scale(0.5, qm_vec_add(qm_vec_cross(a0, d1), qm_vec_cross(a1, d0)));
    double l0 = qm_vec_norm2(d0), l1 = qm_vec_dot(d0, d1), l2 = qm_vec_norm2(d1);
    double s0 = qm_vec_norm2(c0), s1 = qm_vec_norm2(c1), s2 = qm_vec_norm2(c2);
    double length2 = qm_max(l0, l2), cross2 = most(s0, s1, s2);
    double cross =
        CROSS_ROUNDINGS * QM_UNIT_ROUNDING * sqrt(qm_max(qm_vec_norm2(a0), qm_vec_norm2(a1)) * length2);
    double off = 2.0 * cross * sqrt(cross2) + cross * cross +
                 SQUARE_ROUNDINGS * QM_UNIT_ROUNDING * (cross2 + all->square * length2);
    return (coefficients){
        .beyond = {s0 - all->square * l0 - off, qm_vec_dot(c0, c1) - all->square * (0.5 * (l0 + l1)) - off,
                   (2.0 * s1 + qm_vec_dot(c0, c2)) / 3.0 - all->square * ((l0 + 4.0 * l1 + l2) / 6.0) - off,
                   qm_vec_dot(c1, c2) - all->square * (0.5 * (l1 + l2)) - off, s2 - all->square * l2 - off},
        .along = {-qm_vec_dot(a0, d0), -0.5 * (qm_vec_dot(a0, d1) + qm_vec_dot(a1, d0)), -qm_vec_dot(a1, d1)},
        .length = {l0, l1, l2},
        .rounding = cross + SQUARE_ROUNDINGS * QM_UNIT_ROUNDING * length2,
    };
}

static verdict judge(const segments *all, double low, double high)
{
    const coefficients of = find_coefficients(all, low, high);
    const double *p = of.beyond, *n = of.along, *l = of.length;
    if (qm_min(qm_min(p[0], p[1]), qm_min(p[2], qm_min(p[3], p[4]))) >= 0.0) return BEYOND;
    if (most(n[0], n[1], n[2]) <= -of.rounding) return all->side_is_beyond[0] ? BEYOND : NEARER;
    if (most(l[0] - n[0], l[1] - n[1], l[2] - n[2]) <= -of.rounding)
        return all->side_is_beyond[1] ? BEYOND : NEARER;
    bool is_nearer = (p[0] < 0.0 && n[0] > 0.0 && n[0] < l[0]) || (p[4] < 0.0 && n[2] > 0.0 && n[2] < l[2]);
    return is_nearer ? NEARER : OPEN;
}

bool qm_bilinear_is_beyond(const qm_bilinear *patch, qm_vec p, double distance)
{
    if (!(distance > 0.0)) return true;
    const segments all = segments_make(patch, p, distance);
    double stack[MAX_HEIGHT][2] = {{0.0, 1.0}};
    int height = 1;
    for (int visited = 0; height > 0; visited++) {
        const double low = stack[height - 1][0], high = stack[height - 1][1], middle = 0.5 * (low + high);
        verdict here = judge(&all, low, high);
        if (here == NEARER || (here == OPEN && (visited == MAX_INTERVALS || high - low <= MIN_INTERVAL)))
            return false;
        if (here == BEYOND) {
            height--;
            continue;
        }
        QM_ASSERT(height < MAX_HEIGHT);
        stack[height - 1][1] = stack[height][0] = middle;
        stack[height][1] = high;
        height++;
    }
    return true;
}
