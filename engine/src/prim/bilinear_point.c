#include "bilinear_point.h"

#include <stdbool.h>

#include "bilinear_fold.h"
#include "bilinear_hull.h"

/* Of the size squared: by how much a quad must turn at each corner, as seen along a direction, to be convex.
 * Its rounding is a millionth of that: a product of three differences is off by at most 12 u of theirs. */
#define MIN_TURN 1e-6
/* Of the size: a difference, a dot product of three terms, a quotient and one more difference and product. */
#define NEEDLE_ROUNDINGS 0x1p-49
#define SHARE_OF_SQUARES 0x1p-26
#define SQUARED_ROUNDINGS 0x1p-72
#define LEAST_CURVATURE 0x1p-50
#define SLOPE_ROUNDINGS 0x1p-49
#define HALVINGS 6         /* of the square, to look for valleys: folded patches have several */
#define MAX_TURNED 0.1     /* of the longer of two segments: the part of one along the other */
#define BESIDE_FROM 0x1p-8 /* from the best point: valleys beside it are looked for from here */
#define BESIDE_TO 0x1.cp-6 /* to here, which is almost two of its parts away, */
#define BESIDE_HALVINGS 2  /* at halves of that */
#define MAX_FOLD_WAY 0.25  /* of the square: valleys farther apart are found each by itself */
#define POINT_HALVINGS 20  /* more where segments shrink to a point */
#define MIN_STEPS 2        /* of a descent between two segments, before a small gain ends it */
#define LEAST_SHARE 1e-2
#define MUST_GAIN 0.999   /* of the squared distance: less is left to the other ways of going down */
#define DESCENT_GAIN 1e-9 /* of the distance: a step that brings less ends a descent */
#define MAX_DEPTH 26      /* quarters: |w| 4^-26 / 4 is below any rounding */
#define MAX_PARTS 4000    /* of one query; beyond it what is left only lowers the certificate */
#define MAX_STEPS 60      /* of one descent; more are never needed when f is convex */

/**
 * Width of the corners across an axis: of two points of their hull at one place along it no more than that
 * lies between them. Edges lead from the lowest corner along the axis to the highest, and lie on both
 * surfaces.
 */
static double needle_width(const qm_vec corner[4], qm_vec axis)
{
    double length2 = qm_vec_norm2(axis), width = 0.0, size = 0.0;
    if (!(length2 > 0.0)) return INFINITY;
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < i; k++) {
            qm_vec gap = qm_vec_sub(corner[i], corner[k]);
            qm_vec across = qm_vec_axpy(gap, -qm_vec_dot(gap, axis) / length2, axis);
            width = fmax(width, qm_vec_norm(across));
            size = fmax(size, qm_vec_norm(gap));
        }
    return width + NEEDLE_ROUNDINGS * size;
}

/**
 * Twice the way from a corner to the segment between its neighbours, the shortest of all four. With the
 * corner moved there the quad is a triangle with a point on a side, which both surfaces fill: lines of the
 * patch run from the sides at that point to the others. The move takes no point of either surface farther
 * than the corner.
 */
static double collapse_width(const qm_vec corner[4])
{
    double least2 = INFINITY, size2 = 0.0;
    for (int i = 0; i < 4; i++) {
        qm_vec before = corner[(i + 3) % 4], gap = qm_vec_sub(corner[i], before);
        qm_vec along = qm_vec_sub(corner[(i + 1) % 4], before);
        double length2 = qm_vec_norm2(along), share = 0.0;
        if (length2 > 0.0) share = qm_clamp(qm_vec_dot(gap, along) / length2, 0.0, 1.0);
        least2 = fmin(least2, qm_vec_norm2(qm_vec_axpy(gap, -share, along)));
        size2 = fmax(size2, fmax(length2, qm_vec_norm2(gap)));
    }
    return 2.0 * (sqrt(least2) + NEEDLE_ROUNDINGS * sqrt(size2));
}

double qm_bilinear_twist(const qm_vec corner[4])
{
    double twist = 0.25 * qm_vec_norm(qm_bilinear_make(corner).w);
    qm_vec first = qm_vec_sub(corner[2], corner[0]), second = qm_vec_sub(corner[3], corner[1]);
    qm_vec normal = qm_vec_cross(first, second);
    double length = qm_vec_norm(normal), size2 = qm_vec_norm2(first) + qm_vec_norm2(second);
    bool is_convex = length > MIN_TURN * size2;
    for (int i = 0; i < 4 && is_convex; i++) {
        qm_vec before = qm_vec_sub(corner[(i + 1) % 4], corner[i]),
               after = qm_vec_sub(corner[(i + 2) % 4], corner[(i + 1) % 4]);
        is_convex = qm_vec_dot(qm_vec_cross(before, after), normal) > MIN_TURN * size2 * length;
    }
    if (is_convex)
        twist = fmin(twist, qm_hull_width(corner, qm_vec_scale(1.0 / length, normal)));
    else
        twist = fmin(twist,
                     fmin(collapse_width(corner),
                          needle_width(corner, qm_vec_norm2(first) > qm_vec_norm2(second) ? first : second)));
    return twist * (1.0 + 0x1p-20);
}

qm_bilinear_halves qm_bilinear_halve(const qm_vec corner[4], qm_vec direction)
{
    qm_vec w = qm_bilinear_make(corner).w;
    double moved = 0.125 * qm_vec_norm(w) * (1.0 + 0x1p-20), share = 0.0;
    qm_bilinear_halves halves = {.slack = qm_bilinear_twist(corner)};
    if (moved + 0.125 * qm_vec_dot(w, direction) < halves.slack) {
        halves.slack = moved;
        share = -0.125;
    }
    for (int i = 0; i < 4; i++)
        halves.corner[i] = qm_vec_axpy(corner[i], share, w);
    return halves;
}

/** Parameter rectangle [low, high] in s and t. */
typedef struct rectangle {
    double low[2], high[2];
} rectangle;

/** The query: patch and p - o, and what does not depend on the rectangle. */
typedef struct query {
    const qm_bilinear *patch;
    qm_vec r;                     /* p - o */
    double rw, e12, e1w, e2w, ww; /* dot products of r, e1, e2, w */
    double e11, e22, rr;
    double error;
} query;

/** f and its derivatives at a point. */
typedef struct slope {
    double distance2;
    double gradient[2];
    double hessian[3]; /* ss, st, tt */
    double cross;      /* Q_s.Q_t: the st of a patch without its bend */
} slope;

static slope slope_at(const query *q, const double x[2])
{
    const qm_bilinear *patch = q->patch;
    qm_vec along_s = qm_vec_axpy(patch->e1, x[1], patch->w);
    qm_vec along_t = qm_vec_axpy(patch->e2, x[0], patch->w);
    qm_vec gap = qm_vec_sub(qm_vec_axpy(qm_vec_scale(x[1], patch->e2), x[0], along_s), q->r);
    double cross = qm_vec_dot(along_s, along_t);
    return (slope){
        .distance2 = qm_vec_norm2(gap),
        .gradient = {qm_vec_dot(gap, along_s), qm_vec_dot(gap, along_t)},
        .hessian = {qm_vec_norm2(along_s), cross + qm_vec_dot(gap, patch->w), qm_vec_norm2(along_t)},
        .cross = cross,
    };
}

/** Least |e + x w|^2 for x in [low, high]. */
static double least_side2(qm_vec e, double ew, qm_vec w, double ww, double low, double high)
{
    double x = ww > 0.0 ? qm_clamp(-ew / ww, low, high) : low;
    return qm_vec_norm2(qm_vec_axpy(e, x, w));
}

/**
 * Smallest eigenvalue that the second derivative can have on the rectangle; <= 0 when it may not be convex.
 *
 * Roundings, for u = 2^-53. A side e1 + x w is off by 8 u (|e1| + |w|) at most, with what its least x is off
 * by; k - r.w by 8 u (2 (|e1| + |w|) (|e2| + |w|) + |r| |w|). Squares of a sum are separated by (a + b)^2 <=
 * a^2 (1 + c) + b^2 (1 + 1 / c) with c = 2^-26, so that no root is taken: (8 u)^2 (1 + 2^26) 2 < 2^-72.
 */
static double least_curvature(const query *q, const rectangle *box)
{
    const qm_bilinear *patch = q->patch;
    double ss = least_side2(patch->e1, q->e1w, patch->w, q->ww, box->low[1], box->high[1]);
    double tt = least_side2(patch->e2, q->e2w, patch->w, q->ww, box->low[0], box->high[0]);
    double greatest = 0.0;
    for (int corner = 0; corner < 4; corner++) {
        double s = corner & 1 ? box->high[0] : box->low[0], t = corner & 2 ? box->high[1] : box->low[1];
        double k = q->e12 + 2.0 * (s * q->e1w + t * q->e2w + s * t * q->ww);
        greatest = fmax(greatest, fabs(k - q->rw));
    }
    double first2 = q->e11 + q->ww, second2 = q->e22 + q->ww;
    ss = ss * (1.0 - SHARE_OF_SQUARES) - SQUARED_ROUNDINGS * first2;
    tt = tt * (1.0 - SHARE_OF_SQUARES) - SQUARED_ROUNDINGS * second2;
    if (!(ss > 0.0 && tt > 0.0)) return 0.0;
    double cross2 = greatest * greatest * (1.0 + SHARE_OF_SQUARES) +
                    SQUARED_ROUNDINGS * (16.0 * first2 * second2 + q->rr * q->ww);
    double determinant = ss * tt * (1.0 - 0x1p-48) - cross2;
    /* The gradient at a point as far as d is off by 10 u d L, L^2 the sides' squares: the quadratic model of
     * twice_gap is good to 10 u of the distance only where the curvature is not less than a share of them. */
    double curvature = determinant / (ss + tt);
    return curvature > LEAST_CURVATURE * (first2 + second2) ? curvature : 0.0;
}

/** Twice the most that f can fall below its value at x, by the linear and the quadratic lower model. */
static double twice_gap(const slope *at, const double x[2], const rectangle *box, double curvature)
{
    double linear = 0.0, steep2 = 0.0;
    for (int i = 0; i < 2; i++) {
        double g = at->gradient[i];
        double room = g > 0.0 ? x[i] - box->low[i] : box->high[i] - x[i];
        linear += fabs(g) * room;
        if (room > 0.0) steep2 += g * g;
    }
    return fmin(2.0 * linear, steep2 / curvature);
}

static double value_at(const query *q, const double x[2])
{
    const qm_bilinear *patch = q->patch;
    qm_vec along_s = qm_vec_axpy(patch->e1, x[1], patch->w);
    return qm_vec_norm2(qm_vec_sub(qm_vec_axpy(qm_vec_scale(x[1], patch->e2), x[0], along_s), q->r));
}

/** Best s for a given t (axis 0) or best t for a given s (axis 1): f is quadratic in each. */
static void minimise_along(const query *q, double x[2], int axis, const rectangle *box)
{
    x[axis] = box->low[axis];
    slope at = slope_at(q, x);
    double curvature = at.hessian[axis == 0 ? 0 : 2];
    double step = curvature > 0.0 ? -at.gradient[axis] / curvature : 0.0;
    x[axis] = qm_clamp(x[axis] + step, box->low[axis], box->high[axis]);
}

/** Goes along the line to the nearest point of a tangent plane, as far as that helps. Ends long winding
 * valleys, where Newton's matrix is not safe and single axes gain next to nothing. */
static bool step_on_tangent(const query *q, const slope *at, double x[2], const rectangle *box)
{
    const double *h = at->hessian, *g = at->gradient;
    double determinant = h[0] * h[2] * (1.0 + 1e-12) - at->cross * at->cross;
    if (!(determinant > 0.0)) return false;
    double s = -(h[2] * g[0] - at->cross * g[1]) / determinant;
    double t = -(h[0] * g[1] - at->cross * g[0]) / determinant;
    for (double share = 1.0; share > LEAST_SHARE; share *= 0.25) {
        const double to[2] = {qm_clamp(x[0] + share * s, box->low[0], box->high[0]),
                              qm_clamp(x[1] + share * t, box->low[1], box->high[1])};
        if (value_at(q, to) < at->distance2 * MUST_GAIN) {
            x[0] = to[0];
            x[1] = to[1];
            return true;
        }
    }
    return false;
}

/** One step of active-set Newton, or of exact alternating minimisation where the second derivative is not
 * safe. */
static void descend(const query *q, const slope *at, double x[2], const rectangle *box)
{
    const double *h = at->hessian, *g = at->gradient;
    double determinant = h[0] * h[2] - h[1] * h[1];
    if (determinant > 1e-12 * h[0] * h[2]) {
        double s = x[0] - (h[2] * g[0] - h[1] * g[1]) / determinant;
        double t = x[1] - (h[0] * g[1] - h[1] * g[0]) / determinant;
        bool inside = s >= box->low[0] && s <= box->high[0] && t >= box->low[1] && t <= box->high[1];
        double newton[2] = {s, t};
        if (inside && value_at(q, newton) <= at->distance2) {
            x[0] = s;
            x[1] = t;
            return;
        }
        double first[2] = {qm_clamp(s, box->low[0], box->high[0]), x[1]};
        double second[2] = {x[0], qm_clamp(t, box->low[1], box->high[1])};
        minimise_along(q, first, 1, box);
        minimise_along(q, second, 0, box);
        const double *better = value_at(q, first) < value_at(q, second) ? first : second;
        if (value_at(q, better) < at->distance2) {
            x[0] = better[0];
            x[1] = better[1];
            return;
        }
    }
    if (step_on_tangent(q, at, x, box)) return;
    minimise_along(q, x, 0, box);
    minimise_along(q, x, 1, box);
}

/** Keeps the best point found so far. */
static void keep_best(qm_bilinear_foot *best, double distance, const double x[2])
{
    if (distance < best->distance) {
        best->distance = distance;
        best->uv[0] = x[0];
        best->uv[1] = x[1];
    }
}

/**
 * Minimises a convex f over the rectangle, unless it is proven to lie beyond stop_above; returns a certified
 * lower bound of the distance to that part.
 */
static double minimise_convex(const query *q, const rectangle *box, double curvature, double stop_above,
                              qm_bilinear_foot *best)
{
    double x[2] = {0.5 * (box->low[0] + box->high[0]), 0.5 * (box->low[1] + box->high[1])};
    double lower = 0.0;
    for (int step = 0; step < MAX_STEPS; step++) {
        slope at = slope_at(q, x);
        double distance = sqrt(at.distance2);
        keep_best(best, distance, x);
        double below = at.distance2 - twice_gap(&at, x, box, curvature);
        if (below > 0.0) lower = fmax(lower, sqrt(below));
        if (distance - lower <= q->error || lower >= stop_above) break;
        descend(q, &at, x, box);
    }
    return lower;
}

/** The least and greatest Bernstein coefficient of a quadratic with these values at the ends and in the
 * middle. */
static void quadratic_range(double first, double middle, double last, double *least, double *greatest)
{
    double control = 2.0 * middle - 0.5 * (first + last);
    *least = fmin(control, fmin(first, last));
    *greatest = fmax(control, fmax(first, last));
}

/**
 * Where f only rises, or only falls, across the rectangle along one axis, its minimum lies on one side, along
 * which f is a convex quadratic. The derivative along an axis rises with that axis, and is quadratic in the
 * other: so its sign on a side settles the whole rectangle. This ends minima on the border where f is not
 * convex. A derivative is off by 16 u of the squared lengths that it comes from, at most, and f may fall by
 * so much times the width of the rectangle: for a point that is very near that is too much, and it is cut.
 */
static bool minimise_on_side(const query *q, const rectangle *box, qm_bilinear_foot *best, double *lower)
{
    double steep = SLOPE_ROUNDINGS * (q->e11 + q->e22 + q->ww + q->rr);
    for (int side = 0; side < 4; side++) {
        int across = side >> 1, along = 1 - across;
        double x[2], g[3], least, greatest, width = box->high[across] - box->low[across];
        x[across] = side & 1 ? box->high[across] : box->low[across];
        for (int i = 0; i < 3; i++) {
            x[along] = box->low[along] + 0.5 * i * (box->high[along] - box->low[along]);
            g[i] = slope_at(q, x).gradient[across];
        }
        quadratic_range(g[0], g[1], g[2], &least, &greatest);
        if (!(side & 1 ? greatest <= 0.0 : least >= 0.0)) continue;
        minimise_along(q, x, along, box);
        double distance2 = value_at(q, x), distance = sqrt(distance2);
        keep_best(best, distance, x);
        *lower = sqrt(fmax(0.0, distance2 - 2.0 * steep * width));
        if (distance - *lower <= q->error) return true;
    }
    return false;
}

/** Lower bound of the distance to a part; where it is not enough, guess is near to the nearest point, the
 * nearer the smaller the part. */
static double part_lower(const query *q, const rectangle *box, double twist, double enough, double guess[2])
{
    const qm_bilinear *patch = q->patch;
    const qm_vec c[4] = {
        qm_bilinear_at(patch, box->low[0], box->low[1]), qm_bilinear_at(patch, box->high[0], box->low[1]),
        qm_bilinear_at(patch, box->high[0], box->high[1]), qm_bilinear_at(patch, box->low[0], box->high[1])};
    double share[2], asked = twist > q->error ? enough : 0.0;
    double lower = qm_hull_lower(c, qm_vec_add(patch->origin, q->r), twist, asked, share);
    for (int i = 0; i < 2; i++)
        guess[i] = box->low[i] + share[i] * (box->high[i] - box->low[i]);
    return lower;
}

/**
 * Goes down over the whole square as long as that helps, keeping the best point. Where f is convex on all of
 * it (curvature > 0) the way ends once nothing is found to lie within stop_above.
 */
static void descend_from(const query *q, const double start[2], double curvature, double stop_above,
                         qm_bilinear_foot *best)
{
    const rectangle square = {{0.0, 0.0}, {1.0, 1.0}};
    double x[2] = {start[0], start[1]}, last = INFINITY;
    for (int step = 0; step < MAX_STEPS; step++) {
        slope at = slope_at(q, x);
        double distance = sqrt(at.distance2);
        keep_best(best, distance, x);
        if (distance >= last * (1.0 - DESCENT_GAIN)) break;
        if (curvature > 0.0 &&
            at.distance2 - twice_gap(&at, x, &square, curvature) >= stop_above * stop_above)
            break;
        last = distance;
        descend(q, &at, x, &square);
    }
}

/** A part of the square that may hold the nearest point. */
typedef struct part {
    rectangle box;
    int depth;
    double lower; /* of the distance to it */
} part;

/** Makes the quarters of a part, the nearest last, and goes down from where they may be nearer than the
 * best. */
static void make_quarters(const query *q, const part *whole, double twist, double reach, part quarter[4],
                          qm_bilinear_foot *best)
{
    const rectangle *box = &whole->box;
    const double middle[2] = {0.5 * (box->low[0] + box->high[0]), 0.5 * (box->low[1] + box->high[1])};
    for (int k = 0; k < 4; k++) {
        part made = {.box = *box, .depth = whole->depth + 1};
        double guess[2];
        for (int i = 0; i < 2; i++)
            *(k >> i & 1 ? &made.box.low[i] : &made.box.high[i]) = middle[i];
        double enough = fmin(best->distance, reach) - q->error;
        made.lower = part_lower(q, &made.box, ldexp(twist, -2 * made.depth), enough, guess);
        if (made.lower < enough && sqrt(value_at(q, guess)) < best->distance)
            descend_from(q, guess, 0.0, INFINITY, best);
        int place = k;
        for (; place > 0 && quarter[place - 1].lower < made.lower; place--)
            quarter[place] = quarter[place - 1];
        quarter[place] = made;
    }
}

/** Finishes a part without cutting it, where its minimum can be found directly: *lower is a bound then. */
static bool minimise_whole(const query *q, const part *at, double reach, qm_bilinear_foot *best,
                           double *lower)
{
    double curvature = least_curvature(q, &at->box);
    if (curvature > 0.0) {
        *lower = fmax(at->lower, minimise_convex(q, &at->box, curvature, reach, best));
        if (*lower >= fmin(best->distance, reach) - q->error) return true;
    }
    return minimise_on_side(q, &at->box, best, lower);
}

/** Certified minimum over parts of the square, depth first, the nearest quarter first. */
static double minimise_parts(const query *q, qm_bilinear_foot *best, double stop_above)
{
    part stack[3 * MAX_DEPTH + 4];
    int height = 0;
    double twist = 0.25 * sqrt(q->ww), lower = INFINITY;
    stack[height++] = (part){.box = {{0.0, 0.0}, {1.0, 1.0}}};
    for (int looked = 0; height > 0; looked++) {
        const part at = stack[--height];
        bool is_far = at.lower >= fmin(best->distance, stop_above) - q->error;
        double here = at.lower;
        if (is_far || at.depth == MAX_DEPTH || looked > MAX_PARTS ||
            minimise_whole(q, &at, stop_above, best, &here)) {
            lower = fmin(lower, here);
            continue;
        }
        make_quarters(q, &at, twist, stop_above, stack + height, best);
        height += 4;
    }
    return lower;
}

static query query_make(const qm_bilinear *patch, qm_vec p, double error)
{
    query q = {.patch = patch, .r = qm_vec_sub(p, patch->origin), .error = error};
    q.rw = qm_vec_dot(q.r, patch->w);
    q.e11 = qm_vec_norm2(patch->e1);
    q.e22 = qm_vec_norm2(patch->e2);
    q.rr = qm_vec_norm2(q.r);
    q.e12 = qm_vec_dot(patch->e1, patch->e2);
    q.e1w = qm_vec_dot(patch->e1, patch->w);
    q.e2w = qm_vec_dot(patch->e2, patch->w);
    q.ww = qm_vec_norm2(patch->w);
    return q;
}

qm_bilinear_foot qm_bilinear_project(const qm_bilinear *patch, qm_vec p, double error, double stop_above)
{
    query q = query_make(patch, p, error);
    const rectangle square = {{0.0, 0.0}, {1.0, 1.0}};
    qm_bilinear_foot best = {.distance = INFINITY};
    double curvature = least_curvature(&q, &square), lower = 0.0;
    if (curvature > 0.0) lower = minimise_convex(&q, &square, curvature, stop_above, &best);
    if (!(best.distance - lower <= error) && lower < stop_above) {
        best = qm_bilinear_descend(patch, p, stop_above);
        lower = fmax(lower, minimise_parts(&q, &best, stop_above));
    }
    best.lower = fmin(lower, best.distance);
    return best;
}

/** The point of the segment s = const that is nearest, and how its squared distance changes with s. */
typedef struct segment_foot {
    double s, t, distance2;
    double slope, bend; /* of half the squared distance, along the nearest points of neighbouring segments */
} segment_foot;

static segment_foot segment_foot_at(const query *q, double s)
{
    const qm_bilinear *patch = q->patch;
    qm_vec along_t = qm_vec_axpy(patch->e2, s, patch->w);
    qm_vec from = qm_vec_sub(q->r, qm_vec_scale(s, patch->e1));
    double length2 = qm_vec_norm2(along_t);
    double t = length2 > 0.0 ? qm_vec_dot(from, along_t) / length2 : 0.0;
    bool is_inside = t > 0.0 && t < 1.0;
    t = qm_clamp(t, 0.0, 1.0);
    qm_vec along_s = qm_vec_axpy(patch->e1, t, patch->w);
    qm_vec gap = qm_vec_sub(qm_vec_scale(t, along_t), from);
    double ss = qm_vec_norm2(along_s), st = qm_vec_dot(along_s, along_t) + qm_vec_dot(gap, patch->w);
    return (segment_foot){
        .s = s,
        .t = t,
        .distance2 = qm_vec_norm2(gap),
        .slope = qm_vec_dot(gap, along_s),
        .bend = is_inside ? ss - st * st / length2 : ss,
    };
}

static void keep_foot(qm_bilinear_foot *best, const segment_foot *foot)
{
    const double x[2] = {foot->s, foot->t};
    keep_best(best, sqrt(foot->distance2), x);
}

/**
 * The least between two segments, from one where it falls to one where it rises: Newton's steps, or halves. A
 * coordinate of the gap is off by some u of the lengths that it comes from, and the squared distance by that
 * much times the gap: near the patch that is a larger share of it than the gain that ends the steps.
 */
static void minimise_between(const query *q, segment_foot low, segment_foot high, qm_bilinear_foot *best)
{
    double roundings = SLOPE_ROUNDINGS * sqrt(q->e11 + q->e22 + q->ww + q->rr);
    segment_foot at = low.distance2 < high.distance2 ? low : high;
    for (int step = 0; step < MAX_STEPS; step++) {
        double s = at.s - at.slope / at.bend;
        if (!(at.bend > 0.0 && s > low.s && s < high.s)) s = 0.5 * (low.s + high.s);
        double before = at.distance2;
        if (s == at.s || s == low.s || s == high.s) break;
        at = segment_foot_at(q, s);
        keep_foot(best, &at);
        if (at.slope == 0.0) break;
        *(at.slope < 0.0 ? &low : &high) = at;
        double least_gain = qm_max(DESCENT_GAIN * before, roundings * sqrt(before));
        if (fabs(before - at.distance2) <= least_gain && step >= MIN_STEPS) break;
    }
}

/** Whether the segments between two shrink to about a point and turn round. */
static bool turn_round(const qm_bilinear *patch, const segment_foot *low, const segment_foot *high)
{
    qm_vec first = qm_vec_axpy(patch->e2, low->s, patch->w), last = qm_vec_axpy(patch->e2, high->s, patch->w);
    double longer2 = qm_max(qm_vec_norm2(first), qm_vec_norm2(last));
    return qm_vec_dot(first, last) <= MAX_TURNED * longer2;
}

/**
 * Looks for valleys between two segments: at halves, as long as there may be a point nearer than the best,
 * since the distance changes by no more than the ends of the segments move. Valleys are the narrower the
 * shorter the segments are, so that round those that shrink to a point it looks ever closer.
 */
static void look_between(const query *q, const segment_foot *low, const segment_foot *high, double speed,
                         int depth, double stop_above, qm_bilinear_foot *best)
{
    double nearest = 0.5 * (sqrt(low->distance2) + sqrt(high->distance2) - speed * (high->s - low->s));
    if (nearest >= qm_min(best->distance, stop_above)) return;
    if (depth <= 0) {
        /* Where the best point lies between these two, a way down has led to it from segments farther
         * apart. */
        bool is_known = depth < 0 && best->uv[0] > low->s && best->uv[0] < high->s;
        if (!is_known && low->slope < 0.0 && high->slope > 0.0) minimise_between(q, *low, *high, best);
        if (depth == -POINT_HALVINGS || !turn_round(q->patch, low, high)) return;
    }
    segment_foot middle = segment_foot_at(q, 0.5 * (low->s + high->s));
    keep_foot(best, &middle);
    bool is_low_nearer = low->distance2 < high->distance2;
    for (int half = 0; half < 2; half++)
        if ((half == 0) == is_low_nearer)
            look_between(q, low, &middle, speed, depth - 1, stop_above, best);
        else
            look_between(q, &middle, high, speed, depth - 1, stop_above, best);
}

/**
 * Near a fold a point has two valleys, one on each sheet, that lie too near to one another for the segments
 * looked at. So goes down from the other side of the fold, too: the two points of one place lie about as far
 * from it on both sides, in the direction k with Q_s k_s + Q_t k_t = 0.
 */
static void look_across_fold(const query *q, qm_bilinear_foot *best)
{
    const double x[2] = {best->uv[0], best->uv[1]};
    qm_fold_area area = qm_fold_area_make(q->patch);
    slope at = slope_at(q, x);
    bool is_s = at.hessian[2] > at.hessian[0];
    const double k[2] = {is_s ? at.hessian[2] : -at.cross, is_s ? -at.cross : at.hessian[0]};
    double way = -2.0 * qm_fold_area_at(&area, x) / (area.rise[0] * k[0] + area.rise[1] * k[1]);
    const double far[2] = {way * k[0], way * k[1]};
    if (!(fabs(far[0]) < MAX_FOLD_WAY && fabs(far[1]) < MAX_FOLD_WAY)) return;
    const double across[2] = {qm_clamp(x[0] + far[0], 0.0, 1.0), qm_clamp(x[1] + far[1], 0.0, 1.0)};
    descend_from(q, across, 0.0, INFINITY, best);
}

/** Two valleys between neighbouring segments show no rise between them: so looks closer on both sides of the
 * best point. */
static void look_beside_best(const query *q, double speed, double stop_above, qm_bilinear_foot *best)
{
    double s = best->uv[0];
    for (int side = -1; side <= 1; side += 2) {
        segment_foot near = segment_foot_at(q, qm_clamp(s + side * BESIDE_FROM, 0.0, 1.0));
        segment_foot far = segment_foot_at(q, qm_clamp(s + side * BESIDE_TO, 0.0, 1.0));
        const segment_foot *low = side < 0 ? &far : &near, *high = side < 0 ? &near : &far;
        look_between(q, low, high, speed, BESIDE_HALVINGS, stop_above, best);
    }
}

/**
 * Over a patch that is not convex as seen from the point, which may have several valleys, curved ones along
 * folds: the patch is a family of segments, s = const. The nearest point of each is known, so that one
 * parameter is left.
 */
static void descend_by_segments(const query *q, double stop_above, qm_bilinear_foot *best)
{
    const qm_bilinear *patch = q->patch;
    double speed = qm_max(qm_vec_norm(patch->e1), qm_vec_norm(qm_vec_add(patch->e1, patch->w)));
    segment_foot first = segment_foot_at(q, 0.0), last = segment_foot_at(q, 1.0);
    keep_foot(best, &first);
    keep_foot(best, &last);
    look_between(q, &first, &last, speed, HALVINGS, stop_above, best);
    look_across_fold(q, best);
    look_beside_best(q, speed, stop_above, best);
}

qm_bilinear_foot qm_bilinear_descend(const qm_bilinear *patch, qm_vec p, double stop_above)
{
    query q = query_make(patch, p, 0.0);
    qm_bilinear_foot best = {.distance = INFINITY};
    const rectangle square = {{0.0, 0.0}, {1.0, 1.0}};
    double curvature = least_curvature(&q, &square);
    if (curvature > 0.0)
        descend_from(&q, (const double[]){0.5, 0.5}, curvature, stop_above, &best);
    else
        descend_by_segments(&q, stop_above, &best);
    return best;
}

void qm_bilinear_polish(const qm_bilinear *patch, qm_vec p, qm_bilinear_foot *foot)
{
    query q = query_make(patch, p, 0.0);
    descend_from(&q, (const double[]){foot->uv[0], foot->uv[1]}, 0.0, INFINITY, foot);
}
