#include "bilinear_point.h"

#include <stdbool.h>

#include "bilinear_hull.h"

#define GRID 4 /* points a side that a descent looks for valleys from: folded patches have several */
#define LEAST_SHARE 1e-2
#define MUST_GAIN 0.999   /* of the squared distance: less is left to the other ways of going down */
#define DESCENT_GAIN 1e-9 /* of the distance: a step that brings less ends a descent */
#define MAX_DEPTH 26      /* quarters: |w| 4^-26 / 4 is below any rounding */
#define MAX_PARTS 4000    /* of one query; beyond it what is left only lowers the certificate */
#define MAX_STEPS 60      /* of one descent; more are never needed when f is convex */

double qm_patch_twist(const qm_vec corner[4])
{
    qm_patch patch = qm_patch_make(corner);
    double twist = 0.25 * qm_vec_norm(patch.w);
    qm_vec first = qm_vec_sub(corner[2], corner[0]), second = qm_vec_sub(corner[3], corner[1]);
    qm_vec normal = qm_vec_cross(first, second);
    double length = qm_vec_norm(normal), size2 = qm_vec_norm2(first) + qm_vec_norm2(second);
    bool is_convex = length > 1e-6 * size2;
    for (int i = 0; i < 4 && is_convex; i++) {
        qm_vec before = qm_vec_sub(corner[(i + 1) % 4], corner[i]),
               after = qm_vec_sub(corner[(i + 2) % 4], corner[(i + 1) % 4]);
        is_convex = qm_vec_dot(qm_vec_cross(before, after), normal) > 1e-6 * size2 * length;
    }
    if (is_convex)
        twist = fmin(twist, 0.5 * fabs(qm_vec_dot(patch.w, normal)) / length + 0x1p-44 * sqrt(size2));
    return twist * (1.0 + 0x1p-20);
}

qm_patch_halves qm_patch_halve(const qm_vec corner[4], qm_vec direction)
{
    qm_vec w = qm_patch_make(corner).w;
    double moved = 0.125 * qm_vec_norm(w) * (1.0 + 0x1p-20), share = 0.0;
    qm_patch_halves halves = {.slack = qm_patch_twist(corner)};
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
    const qm_patch *patch;
    qm_vec r;                     /* p - o */
    double rw, e12, e1w, e2w, ww; /* dot products of r, e1, e2, w */
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
    const qm_patch *patch = q->patch;
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

/** Smallest eigenvalue that the second derivative can have on the rectangle; <= 0 when it may not be convex.
 */
static double least_curvature(const query *q, const rectangle *box)
{
    const qm_patch *patch = q->patch;
    double ss = least_side2(patch->e1, q->e1w, patch->w, q->ww, box->low[1], box->high[1]);
    double tt = least_side2(patch->e2, q->e2w, patch->w, q->ww, box->low[0], box->high[0]);
    double greatest = 0.0;
    for (int corner = 0; corner < 4; corner++) {
        double s = corner & 1 ? box->high[0] : box->low[0], t = corner & 2 ? box->high[1] : box->low[1];
        double k = q->e12 + 2.0 * (s * q->e1w + t * q->e2w + s * t * q->ww);
        greatest = fmax(greatest, fabs(k - q->rw));
    }
    double determinant = ss * tt * (1.0 - 1e-9) - greatest * greatest;
    return determinant > 0.0 ? determinant / (ss + tt) : 0.0;
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
    const qm_patch *patch = q->patch;
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
static void keep_best(qm_patch_foot *best, double distance, const double x[2])
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
                              qm_patch_foot *best)
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
 * convex.
 */
static bool minimise_on_side(const query *q, const rectangle *box, qm_patch_foot *best, double *lower)
{
    for (int side = 0; side < 4; side++) {
        int across = side >> 1, along = 1 - across;
        double x[2], g[3], least, greatest;
        x[across] = side & 1 ? box->high[across] : box->low[across];
        for (int i = 0; i < 3; i++) {
            x[along] = box->low[along] + 0.5 * i * (box->high[along] - box->low[along]);
            g[i] = slope_at(q, x).gradient[across];
        }
        quadratic_range(g[0], g[1], g[2], &least, &greatest);
        if (side & 1 ? greatest <= 0.0 : least >= 0.0) {
            minimise_along(q, x, along, box);
            *lower = sqrt(value_at(q, x));
            keep_best(best, *lower, x);
            return true;
        }
    }
    return false;
}

/** Lower bound of the distance to a part; where it is not enough, guess is near to the nearest point, the
 * nearer the smaller the part. */
static double part_lower(const query *q, const rectangle *box, double twist, double enough, double guess[2])
{
    const qm_patch *patch = q->patch;
    const qm_vec c[4] = {
        qm_patch_at(patch, box->low[0], box->low[1]), qm_patch_at(patch, box->high[0], box->low[1]),
        qm_patch_at(patch, box->high[0], box->high[1]), qm_patch_at(patch, box->low[0], box->high[1])};
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
                         qm_patch_foot *best)
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

/** Makes the quarters of a part, the nearest last, and goes down from where they may be nearer than the best.
 */
static void make_quarters(const query *q, const part *whole, double twist, double reach, part quarter[4],
                          qm_patch_foot *best)
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
static bool minimise_whole(const query *q, const part *at, double reach, qm_patch_foot *best, double *lower)
{
    double curvature = least_curvature(q, &at->box);
    if (curvature > 0.0) {
        *lower = fmax(at->lower, minimise_convex(q, &at->box, curvature, reach, best));
        if (*lower >= fmin(best->distance, reach) - q->error) return true;
    }
    return minimise_on_side(q, &at->box, best, lower);
}

/** Certified minimum over parts of the square, depth first, the nearest quarter first. */
static double minimise_parts(const query *q, qm_patch_foot *best, double stop_above)
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

static query query_make(const qm_patch *patch, qm_vec p, double error)
{
    query q = {.patch = patch, .r = qm_vec_sub(p, patch->origin), .error = error};
    q.rw = qm_vec_dot(q.r, patch->w);
    q.e12 = qm_vec_dot(patch->e1, patch->e2);
    q.e1w = qm_vec_dot(patch->e1, patch->w);
    q.e2w = qm_vec_dot(patch->e2, patch->w);
    q.ww = qm_vec_norm2(patch->w);
    return q;
}

qm_patch_foot qm_patch_project(const qm_patch *patch, qm_vec p, double error, double stop_above)
{
    query q = query_make(patch, p, error);
    const rectangle square = {{0.0, 0.0}, {1.0, 1.0}};
    qm_patch_foot best = {.distance = INFINITY};
    double curvature = least_curvature(&q, &square), lower = 0.0;
    if (curvature > 0.0) lower = minimise_convex(&q, &square, curvature, stop_above, &best);
    if (!(best.distance - lower <= error) && lower < stop_above) {
        best = qm_patch_descend(patch, p, stop_above);
        lower = fmax(lower, minimise_parts(&q, &best, stop_above));
    }
    best.lower = fmin(lower, best.distance);
    return best;
}

/** True when no neighbour in the grid of values is lower: a valley, most likely. */
static bool is_grid_minimum(const double value[GRID][GRID], int i, int j)
{
    for (int di = -1; di <= 1; di++) {
        for (int dj = -1; dj <= 1; dj++) {
            int ni = i + di, nj = j + dj;
            if (ni >= 0 && ni < GRID && nj >= 0 && nj < GRID && value[ni][nj] < value[i][j]) return false;
        }
    }
    return true;
}

qm_patch_foot qm_patch_descend(const qm_patch *patch, qm_vec p, double stop_above)
{
    query q = query_make(patch, p, 0.0);
    qm_patch_foot best = {.distance = INFINITY};
    const rectangle square = {{0.0, 0.0}, {1.0, 1.0}};
    double curvature = least_curvature(&q, &square);
    if (curvature > 0.0) {
        descend_from(&q, (const double[]){0.5, 0.5}, curvature, stop_above, &best);
        return best;
    }
    double value[GRID][GRID];
    for (int i = 0; i < GRID; i++)
        for (int j = 0; j < GRID; j++)
            value[i][j] = value_at(&q, (const double[]){i / (GRID - 1.0), j / (GRID - 1.0)});
    for (int i = 0; i < GRID; i++)
        for (int j = 0; j < GRID; j++)
            if (is_grid_minimum(value, i, j))
                descend_from(&q, (const double[]){i / (GRID - 1.0), j / (GRID - 1.0)}, 0.0, INFINITY, &best);
    return best;
}

void qm_patch_polish(const qm_patch *patch, qm_vec p, qm_patch_foot *foot)
{
    query q = query_make(patch, p, 0.0);
    descend_from(&q, (const double[]){foot->uv[0], foot->uv[1]}, 0.0, INFINITY, foot);
}
