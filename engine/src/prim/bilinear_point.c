/**
 * bilinear_point.c: distance from a point to a bilinear patch, certified, and the flatness bound.
 *
 * f = |p - Q|^2 / 2 has f_ss = |Q_s|^2, f_tt = |Q_t|^2 and f_st = K(s, t) - (p - o).w, where
 * K = Q_s.Q_t + (Q - o).w is bilinear, so that over any rectangle the range of f_st is found at its corners.
 * Where |f_st|^2 < f_ss f_tt throughout, f is convex on the rectangle and one minimum is the minimum;
 * elsewhere the rectangle is cut in quarters, each bounded below by its two triangles less |w| ds dt / 4.
 */
#include "bilinear.h"

/* Fraction of the squared size: the cross product of the edges at each corner of a convex quad, as seen along
 * a direction. Its rounding is a millionth of that: a product of three differences is off by at most 12 u of
 * theirs. */
#define MIN_TURN 1e-6
/* Fraction of the size: a difference, a dot product of three terms, a quotient and one more difference and
 * product. */
#define NEEDLE_ROUNDINGS 0x1p-49
#define SQUARE_SPLIT 0x1p-26
#define SQUARED_ROUNDINGS 0x1p-72
#define MIN_CURVATURE 0x1p-50
#define SLOPE_ROUNDINGS 0x1p-49
#define ROOT_STEPS 40             /* of a root between two ends */
#define ROOT_ERROR 0x1p-20        /* of the interval between them */
#define MIN_ROOT_INTERVAL 0x1p-30 /* roots closer to one another are not told apart */
#define MAX_ROOT_DEPTH 31
#define COLLAPSED 0x1p-40 /* of the longest segment: a shorter one is a point, and roots there roundings */
#define MIN_STEP_FRACTION 1e-2
#define REQUIRED_GAIN                                                                                        \
    0.999              /* of the squared distance: the other kinds of step take over when it falls by less */
#define MAX_DEPTH 26   /* quarters: |w| 4^-26 / 4 is below any rounding */
#define MAX_PARTS 4000 /* of one query; the remaining parts only lower the certificate */
#define MAX_STEPS 60   /* of one minimisation; more are never needed when f is convex */

/**
 * Width of the corners across an axis: two points of their hull at one height along it are no farther apart.
 * Edges lead from the lowest corner along the axis to the highest, and lie on both surfaces.
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
 * Twice the distance from a corner to the segment between its neighbours, the smallest of all four. With the
 * corner moved onto the segment the quad is a triangle with a point on a side, which both surfaces fill:
 * lines of the patch run from the sides at that point to the others. The move takes no point of either
 * surface farther than the corner.
 */
static double collapse_width(const qm_vec corner[4])
{
    double nearest2 = INFINITY, size2 = 0.0;
    for (int i = 0; i < 4; i++) {
        qm_vec before = corner[(i + 3) % 4], gap = qm_vec_sub(corner[i], before);
        qm_vec along = qm_vec_sub(corner[(i + 1) % 4], before);
        double length2 = qm_vec_norm2(along), share = 0.0;
        if (length2 > 0.0) share = qm_clamp(qm_vec_dot(gap, along) / length2, 0.0, 1.0);
        nearest2 = fmin(nearest2, qm_vec_norm2(qm_vec_axpy(gap, -share, along)));
        size2 = fmax(size2, fmax(length2, qm_vec_norm2(gap)));
    }
    return 2.0 * (sqrt(nearest2) + NEEDLE_ROUNDINGS * sqrt(size2));
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
        twist = fmin(twist, qm_bilinear_hull_width(corner, qm_vec_scale(1.0 / length, normal)));
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

/** The query: patch and p - o, and products that do not depend on the rectangle. */
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
    double cross;      /* Q_s.Q_t: f_st without the term of the twist vector */
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

/** Minimum of |e + x w|^2 for x in [low, high]. */
static double min_side2(qm_vec e, double ew, qm_vec w, double ww, double low, double high)
{
    double x = ww > 0.0 ? qm_clamp(-ew / ww, low, high) : low;
    return qm_vec_norm2(qm_vec_axpy(e, x, w));
}

/**
 * Smallest eigenvalue that the second derivative can have on the rectangle; <= 0 when it may not be convex.
 *
 * Roundings, for u = 2^-53. A side e1 + x w is off by 8 u (|e1| + |w|) at most, with the error of its minimal
 * x; k - r.w by 8 u (2 (|e1| + |w|) (|e2| + |w|) + |r| |w|). Squares of a sum are separated by (a + b)^2 <=
 * a^2 (1 + c) + b^2 (1 + 1 / c) with c = 2^-26, so that no root is taken: (8 u)^2 (1 + 2^26) 2 < 2^-72.
 */
static double min_curvature(const query *q, const rectangle *box)
{
    const qm_bilinear *patch = q->patch;
    double ss = min_side2(patch->e1, q->e1w, patch->w, q->ww, box->low[1], box->high[1]);
    double tt = min_side2(patch->e2, q->e2w, patch->w, q->ww, box->low[0], box->high[0]);
    double largest = 0.0;
    for (int corner = 0; corner < 4; corner++) {
        double s = corner & 1 ? box->high[0] : box->low[0], t = corner & 2 ? box->high[1] : box->low[1];
        double k = q->e12 + 2.0 * (s * q->e1w + t * q->e2w + s * t * q->ww);
        largest = fmax(largest, fabs(k - q->rw));
    }
    double first2 = q->e11 + q->ww, second2 = q->e22 + q->ww;
    ss = ss * (1.0 - SQUARE_SPLIT) - SQUARED_ROUNDINGS * first2;
    tt = tt * (1.0 - SQUARE_SPLIT) - SQUARED_ROUNDINGS * second2;
    if (!(ss > 0.0 && tt > 0.0)) return 0.0;
    double cross2 = largest * largest * (1.0 + SQUARE_SPLIT) +
                    SQUARED_ROUNDINGS * (16.0 * first2 * second2 + q->rr * q->ww);
    double determinant = ss * tt * (1.0 - 0x1p-48) - cross2;
    /* The gradient at a point as far as d is off by 10 u d L, L^2 the sides' squares: the quadratic model of
     * twice_gap is good to 10 u of the distance only where the curvature is not below a fraction of them. */
    double curvature = determinant / (ss + tt);
    return curvature > MIN_CURVATURE * (first2 + second2) ? curvature : 0.0;
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

/** Minimises over s for a given t (axis 0), or over t for a given s (axis 1): f is quadratic in each. */
static void minimise_along(const query *q, double x[2], int axis, const rectangle *box)
{
    x[axis] = box->low[axis];
    slope at = slope_at(q, x);
    double curvature = at.hessian[axis == 0 ? 0 : 2];
    double step = curvature > 0.0 ? -at.gradient[axis] / curvature : 0.0;
    x[axis] = qm_clamp(x[axis] + step, box->low[axis], box->high[axis]);
}

/** Gauss-Newton step with backtracking: towards the footpoint on the tangent plane, as far as f falls. Ends
 * long winding valleys, where Newton's matrix is not positive definite and steps along one axis gain little.
 */
static bool step_on_tangent(const query *q, const slope *at, double x[2], const rectangle *box)
{
    const double *h = at->hessian, *g = at->gradient;
    double determinant = h[0] * h[2] * (1.0 + 1e-12) - at->cross * at->cross;
    if (!(determinant > 0.0)) return false;
    double s = -(h[2] * g[0] - at->cross * g[1]) / determinant;
    double t = -(h[0] * g[1] - at->cross * g[0]) / determinant;
    for (double fraction = 1.0; fraction > MIN_STEP_FRACTION; fraction *= 0.25) {
        const double to[2] = {qm_clamp(x[0] + fraction * s, box->low[0], box->high[0]),
                              qm_clamp(x[1] + fraction * t, box->low[1], box->high[1])};
        if (value_at(q, to) < at->distance2 * REQUIRED_GAIN) {
            x[0] = to[0];
            x[1] = to[1];
            return true;
        }
    }
    return false;
}

/** One step of active-set Newton, or of exact alternating minimisation where the second derivative is not
 * safely positive definite. */
static void step_down(const query *q, const slope *at, double x[2], const rectangle *box)
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
static void keep_best(qm_bilinear_footpoint *best, double distance, const double x[2])
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
                              qm_bilinear_footpoint *best)
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
        step_down(q, &at, x, box);
    }
    return lower;
}

/** Range of the Bernstein coefficients of a quadratic, from its values at both ends and the midpoint. */
static void quadratic_range(double first, double midpoint, double last, double *min, double *max)
{
    double control = 2.0 * midpoint - 0.5 * (first + last);
    *min = fmin(control, fmin(first, last));
    *max = fmax(control, fmax(first, last));
}

/**
 * Where f only rises, or only falls, across the rectangle along one axis, its minimum lies on one side, along
 * which f is a convex quadratic. The derivative along an axis rises with that axis, and is quadratic in the
 * other: so its sign on a side decides for all of the rectangle. This finds minima on the border where f is
 * not convex. A derivative is off by at most 16 u of the squared lengths that it comes from, and f may fall
 * by that error times the width of the rectangle: for a point that is very near this is too much, and the
 * rectangle is cut.
 */
static bool minimise_on_side(const query *q, const rectangle *box, qm_bilinear_footpoint *best, double *lower)
{
    double steep = SLOPE_ROUNDINGS * (q->e11 + q->e22 + q->ww + q->rr);
    for (int side = 0; side < 4; side++) {
        int across = side >> 1, along = 1 - across;
        double x[2], g[3], min, max, width = box->high[across] - box->low[across];
        x[across] = side & 1 ? box->high[across] : box->low[across];
        for (int i = 0; i < 3; i++) {
            x[along] = box->low[along] + 0.5 * i * (box->high[along] - box->low[along]);
            g[i] = slope_at(q, x).gradient[across];
        }
        quadratic_range(g[0], g[1], g[2], &min, &max);
        if (!(side & 1 ? max <= 0.0 : min >= 0.0)) continue;
        minimise_along(q, x, along, box);
        double distance2 = value_at(q, x), distance = sqrt(distance2);
        keep_best(best, distance, x);
        *lower = sqrt(fmax(0.0, distance2 - 2.0 * steep * width));
        if (distance - *lower <= q->error) return true;
    }
    return false;
}

/** Lower bound of the distance to a part; where it is below enough, guess is near the footpoint, the nearer
 * the smaller the part. */
static double part_lower(const query *q, const rectangle *box, double twist, double enough, double guess[2])
{
    const qm_bilinear *patch = q->patch;
    const qm_vec c[4] = {
        qm_bilinear_at(patch, box->low[0], box->low[1]), qm_bilinear_at(patch, box->high[0], box->low[1]),
        qm_bilinear_at(patch, box->high[0], box->high[1]), qm_bilinear_at(patch, box->low[0], box->high[1])};
    double fraction[2], required = twist > q->error ? enough : 0.0;
    double lower = qm_bilinear_hull_lower(c, qm_vec_add(patch->origin, q->r), twist, required, fraction);
    for (int i = 0; i < 2; i++)
        guess[i] = box->low[i] + fraction[i] * (box->high[i] - box->low[i]);
    return lower;
}

/**
 * How much the squared distance falls in a step of Newton's, of the free coordinates: those not at an end of the square
 * that it rises from. INFINITY where f is not convex in them.
 */
static double expected_gain(const slope *at, const double x[2])
{
    const double *h = at->hessian, *g = at->gradient;
    bool is_free[2];
    for (int k = 0; k < 2; k++)
        is_free[k] = !(x[k] == 0.0 && g[k] >= 0.0) && !(x[k] == 1.0 && g[k] <= 0.0);
    if (is_free[0] && is_free[1]) {
        double determinant = h[0] * h[2] - h[1] * h[1];
        if (!(determinant > 1e-12 * h[0] * h[2])) return INFINITY;
        return (h[2] * g[0] * g[0] - 2.0 * h[1] * g[0] * g[1] + h[0] * g[1] * g[1]) / determinant;
    }
    if (is_free[0]) return h[0] > 0.0 ? g[0] * g[0] / h[0] : INFINITY;
    if (is_free[1]) return h[2] > 0.0 ? g[1] * g[1] / h[2] : INFINITY;
    return 0.0;
}

/**
 * Minimises over the square from a start until a step gains less than a share of the distance, and keeps the best
 * point. Where f is convex on
 * all of it (curvature > 0) it ends once the patch is proven to lie beyond stop_above.
 */
static void minimise_from(const query *q, const double start[2], double curvature, double stop_above,
                          double gain, qm_bilinear_footpoint *best)
{
    const rectangle square = {{0.0, 0.0}, {1.0, 1.0}};
    double x[2] = {start[0], start[1]}, last = INFINITY;
    for (int step = 0; step < MAX_STEPS; step++) {
        slope at = slope_at(q, x);
        double distance = sqrt(at.distance2);
        keep_best(best, distance, x);
        if (distance >= last * (1.0 - gain) || expected_gain(&at, x) <= 2.0 * gain * at.distance2) break;
        if (curvature > 0.0 &&
            at.distance2 - twice_gap(&at, x, &square, curvature) >= stop_above * stop_above)
            break;
        last = distance;
        step_down(q, &at, x, &square);
    }
}

/** A part of the square that may hold the nearest point. */
typedef struct part {
    rectangle box;
    int depth;
    double lower; /* of the distance to it */
} part;

/** Makes the quarters of a part, the nearest last, and minimises from guesses in those that may hold a nearer
 * point than the best. */
static void make_quarters(const query *q, const part *parent, double twist, double stop_above,
                          part quarter[4], qm_bilinear_footpoint *best)
{
    const rectangle *box = &parent->box;
    const double center[2] = {0.5 * (box->low[0] + box->high[0]), 0.5 * (box->low[1] + box->high[1])};
    for (int k = 0; k < 4; k++) {
        part made = {.box = *box, .depth = parent->depth + 1};
        double guess[2];
        for (int i = 0; i < 2; i++)
            *(k >> i & 1 ? &made.box.low[i] : &made.box.high[i]) = center[i];
        double enough = fmin(best->distance, stop_above) - q->error;
        made.lower = part_lower(q, &made.box, ldexp(twist, -2 * made.depth), enough, guess);
        if (made.lower < enough && sqrt(value_at(q, guess)) < best->distance)
            minimise_from(q, guess, 0.0, INFINITY, QM_FINE_GAIN, best);
        int slot = k;
        for (; slot > 0 && quarter[slot - 1].lower < made.lower; slot--)
            quarter[slot] = quarter[slot - 1];
        quarter[slot] = made;
    }
}

/** Finds the minimum of a part without cutting it, where possible: *lower is then a bound. */
static bool minimise_part(const query *q, const part *at, double stop_above, qm_bilinear_footpoint *best,
                          double *lower)
{
    double curvature = min_curvature(q, &at->box);
    if (curvature > 0.0) {
        *lower = fmax(at->lower, minimise_convex(q, &at->box, curvature, stop_above, best));
        if (*lower >= fmin(best->distance, stop_above) - q->error) return true;
    }
    return minimise_on_side(q, &at->box, best, lower);
}

/** Certified minimum over parts of the square, depth first, the nearest quarter first. */
static double minimise_parts(const query *q, qm_bilinear_footpoint *best, double stop_above)
{
    part stack[3 * MAX_DEPTH + 4];
    int height = 0;
    double twist = 0.25 * sqrt(q->ww), lower = INFINITY;
    stack[height++] = (part){.box = {{0.0, 0.0}, {1.0, 1.0}}};
    for (int visited = 0; height > 0; visited++) {
        const part at = stack[--height];
        bool is_far = at.lower >= fmin(best->distance, stop_above) - q->error;
        double here = at.lower;
        if (is_far || at.depth == MAX_DEPTH || visited > MAX_PARTS ||
            minimise_part(q, &at, stop_above, best, &here)) {
            lower = fmin(lower, here);
            continue;
        }
        QM_ASSERT(height + 4 <= 3 * MAX_DEPTH + 4);
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

qm_bilinear_footpoint qm_bilinear_project(const qm_bilinear *patch, qm_vec p, double error, double stop_above)
{
    query q = query_make(patch, p, error);
    const rectangle square = {{0.0, 0.0}, {1.0, 1.0}};
    qm_bilinear_footpoint best = {.distance = INFINITY};
    double curvature = min_curvature(&q, &square), lower = 0.0;
    if (curvature > 0.0) lower = minimise_convex(&q, &square, curvature, stop_above, &best);
    if (!(best.distance - lower <= error) && lower < stop_above) {
        best = qm_bilinear_minimise(patch, p, stop_above);
        double enough = fmin(best.distance, stop_above) - 0.25 * error;
        lower = fmax(lower, qm_bilinear_is_beyond(patch, p, enough) ? enough
                                                                    : minimise_parts(&q, &best, stop_above));
    }
    best.lower = fmin(lower, best.distance);
    QM_ASSERT(!(best.lower > best.distance));
    return best;
}

/** Keeps the footpoint on the segment s = const, where that is nearer than the best. */
static void minimise_on_segment(const query *q, double s, qm_bilinear_footpoint *best)
{
    const qm_bilinear *patch = q->patch;
    qm_vec along = qm_vec_axpy(patch->e2, s, patch->w), from = qm_vec_axpy(q->r, -s, patch->e1);
    double length2 = qm_vec_norm2(along);
    double t = length2 > 0.0 ? qm_clamp(qm_vec_dot(from, along) / length2, 0.0, 1.0) : 0.0;
    keep_best(best, qm_vec_norm(qm_vec_axpy(from, -t, along)), (const double[]){s, t});
}

/**
 * The derivative of the squared distance from p to the line that contains the segment s = const, in powers of
 * x = s - from. With a = r - s e1, d = e2 + s w, N = a.d and D = d.d the squared distance is |a|^2 - N^2 / D;
 * half of its derivative times D^2 is the quintic
 *     N (N D' / 2 - N' D) - D^2 a.e1.
 * The segments are shortest at from. Where they shrink to nearly a point several roots lie close to it, which
 * coefficients in powers of s would not tell apart. Where they shrink to a point but for roundings, as in a bow-tie, it
 * has a fourfold root there, which roundings would make four of.
 */
typedef struct line_slope {
    double from, power[6];
} line_slope;

static line_slope line_slope_make(const query *q)
{
    const qm_bilinear *patch = q->patch;
    double from = q->ww > 0.0 ? qm_clamp(-q->e2w / q->ww, 0.0, 1.0) : 0.0;
    qm_vec a = qm_vec_axpy(q->r, -from, patch->e1), d = qm_vec_axpy(patch->e2, from, patch->w);
    if (qm_vec_norm2(d) < COLLAPSED * COLLAPSED * (q->e22 + q->ww)) d = (qm_vec){0, 0, 0};
    double n0 = qm_vec_dot(a, d), n1 = qm_vec_dot(a, patch->w) - qm_vec_dot(patch->e1, d), n2 = -q->e1w;
    double d0 = qm_vec_norm2(d), d1 = qm_vec_dot(d, patch->w), d2 = q->ww; /* D = d0 + 2 d1 x + d2 x^2 */
    const double n[] = {n0, n1, n2};
    const double m[] = {n0 * d1 - n1 * d0, n0 * d2 - n1 * d1 - 2.0 * n2 * d0, -3.0 * n2 * d1, -n2 * d2};
    const double c[] = {-qm_vec_dot(a, patch->e1), q->e11};
    const double dd[] = {d0 * d0, 4.0 * d0 * d1, 2.0 * d0 * d2 + 4.0 * d1 * d1, 4.0 * d1 * d2, d2 * d2};
    line_slope lines = {.from = from};
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 4; k++)
            lines.power[i + k] += n[i] * m[k];
    for (int i = 0; i < 5; i++)
        for (int k = 0; k < 2; k++)
            lines.power[i + k] += dd[i] * c[k];
    return lines;
}

/** A quintic over [0, 1] by its Bernstein coefficients: it has no more roots there than they change signs. */
typedef struct quintic {
    double b[6];
    double first, last; /* the ends, as fractions of the interval that was cut */
} quintic;

/** The quintic from x = 0 to x = length, positive where the distance rises along the way. */
static quintic quintic_make(const line_slope *lines, double length)
{
    static const double share[6][6] = {
        {1}, {1, 0.2}, {1, 0.4, 0.1}, {1, 0.6, 0.3, 0.1}, {1, 0.8, 0.6, 0.4, 0.2}, {1, 1, 1, 1, 1, 1}};
    quintic made = {.last = 1.0};
    double power[6], factor = length;
    for (int k = 0; k < 6; k++, factor *= length)
        power[k] = lines->power[k] * factor;
    for (int i = 0; i < 6; i++)
        for (int k = 0; k <= i; k++)
            made.b[i] += share[i][k] * power[k];
    return made;
}

/** By de Casteljau's algorithm. */
static void quintic_halve(const quintic *whole, quintic half[2])
{
    double c0 = whole->b[0], c1 = whole->b[1], c2 = whole->b[2], c3 = whole->b[3], c4 = whole->b[4],
           c5 = whole->b[5], center = 0.5 * (whole->first + whole->last);
    double d0 = 0.5 * (c0 + c1), d1 = 0.5 * (c1 + c2), d2 = 0.5 * (c2 + c3), d3 = 0.5 * (c3 + c4),
           d4 = 0.5 * (c4 + c5);
    double e0 = 0.5 * (d0 + d1), e1 = 0.5 * (d1 + d2), e2 = 0.5 * (d2 + d3), e3 = 0.5 * (d3 + d4);
    double f0 = 0.5 * (e0 + e1), f1 = 0.5 * (e1 + e2), f2 = 0.5 * (e2 + e3);
    double g0 = 0.5 * (f0 + f1), g1 = 0.5 * (f1 + f2), h = 0.5 * (g0 + g1);
    half[0] = (quintic){{c0, d0, e0, f0, g0, h}, whole->first, center};
    half[1] = (quintic){{h, g1, f2, e3, d4, c5}, center, whole->last};
}

static int quintic_sign_changes(const quintic *q)
{
    int changes = 0;
    for (int i = 0; i < 5; i++)
        changes += (q->b[i] < 0.0) != (q->b[i + 1] < 0.0);
    return changes;
}

/** The root of a quintic that is negative at 0 and not at 1 and has but one, by Newton's steps or bisection. */
static double quintic_root(const quintic *q)
{
    const double *b = q->b;
    double d0 = b[1] - b[0], d1 = b[2] - b[1], d2 = b[3] - b[2], d3 = b[4] - b[3], d4 = b[5] - b[4];
    double e0 = d1 - d0, e1 = d2 - d1, e2 = d3 - d2, e3 = d4 - d3, f0 = e1 - e0, f1 = e2 - e1, f2 = e3 - e2;
    double g0 = f1 - f0, g1 = f2 - f1;
    double c1 = 5.0 * d0, c2 = 10.0 * e0, c3 = 10.0 * f0, c4 = 5.0 * g0, c5 = g1 - g0;
    double low = 0.0, high = 1.0, x = b[0] / (b[0] - b[5]);
    for (int step = 0; step < ROOT_STEPS; step++) {
        double value = b[0] + x * (c1 + x * (c2 + x * (c3 + x * (c4 + x * c5))));
        double rise = c1 + x * (2.0 * c2 + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)));
        *(value < 0.0 ? &low : &high) = x;
        double next = x - value / rise;
        if (!(rise > 0.0 && next > low && next < high)) next = 0.5 * (low + high);
        double moved = fabs(next - x);
        x = next;
        if (moved < ROOT_ERROR) break;
    }
    return q->first + x * (q->last - q->first);
}

/** Visits the segments from x = 0 to x = length where the distance to their lines has a local minimum. */
static void minimise_on_lines(const query *q, const line_slope *lines, double length,
                              qm_bilinear_footpoint *best)
{
    quintic stack[MAX_ROOT_DEPTH + 1];
    int height = 0;
    stack[height++] = quintic_make(lines, length);
    while (height > 0) {
        quintic at = stack[--height];
        int changes = quintic_sign_changes(&at);
        bool is_low = at.b[0] < 0.0, is_minimum = is_low && at.b[5] >= 0.0;
        if (changes == 0 || (changes == 1 && !is_minimum)) continue;
        if (changes == 1)
            minimise_on_segment(q, lines->from + length * quintic_root(&at), best);
        else if (at.last - at.first <= MIN_ROOT_INTERVAL)
            minimise_on_segment(q, lines->from + length * at.first, best);
        else {
            QM_ASSERT(height + 2 <= MAX_ROOT_DEPTH + 1);
            quintic_halve(&at, stack + height);
            height += 2;
        }
    }
}

/**
 * Where f is not convex it may have several local minima, and curved valleys along folds. The patch is a
 * family of segments, s = const. Its footpoint is an end of its segment, on one of two sides of the patch, or
 * on the first or last segment, or a footpoint on the segment's line, where the distance to the lines has a
 * local minimum.
 */
static void minimise_by_lines(const query *q, qm_bilinear_footpoint *best)
{
    const rectangle square = {{0.0, 0.0}, {1.0, 1.0}};
    minimise_on_segment(q, 0.0, best);
    minimise_on_segment(q, 1.0, best);
    for (int side = 0; side < 2; side++) {
        double x[2] = {0.0, side};
        minimise_along(q, x, 0, &square);
        keep_best(best, sqrt(value_at(q, x)), x);
    }
    line_slope lines = line_slope_make(q);
    if (lines.from < 1.0) minimise_on_lines(q, &lines, 1.0 - lines.from, best);
    if (lines.from > 0.0) minimise_on_lines(q, &lines, -lines.from, best);
    minimise_from(q, (const double[]){best->uv[0], best->uv[1]}, 0.0, INFINITY, QM_FINE_GAIN, best);
}

qm_bilinear_footpoint qm_bilinear_minimise(const qm_bilinear *patch, qm_vec p, double stop_above)
{
    query q = query_make(patch, p, 0.0);
    qm_bilinear_footpoint best = {.distance = INFINITY};
    const rectangle square = {{0.0, 0.0}, {1.0, 1.0}};
    double curvature = min_curvature(&q, &square);
    if (curvature > 0.0)
        minimise_from(&q, (const double[]){0.5, 0.5}, curvature, stop_above, QM_FINE_GAIN, &best);
    else
        minimise_by_lines(&q, &best);
    return best;
}

void qm_bilinear_polish(const qm_bilinear *patch, qm_vec p, double gain, qm_bilinear_footpoint *foot)
{
    query q = query_make(patch, p, 0.0);
    minimise_from(&q, (const double[]){foot->uv[0], foot->uv[1]}, 0.0, INFINITY, gain, foot);
}
