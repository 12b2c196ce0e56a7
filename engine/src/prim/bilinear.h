/**
 * bilinear.h: a bilinear patch: its points, its distance from a point, certified, and bounds of how far it
 * lies from its two triangles, from the hull of its corners and from another triangle.
 *
 * Q(s, t) = o + s e1 + t e2 + s t w over the unit square; w is the twist vector. Nothing here allocates.
 */
#ifndef QM_BILINEAR_H
#define QM_BILINEAR_H

#include "core/vec.h"

typedef struct qm_bilinear {
    qm_vec origin, e1, e2, w;
} qm_bilinear;

/** The corners are given in cyclic order: (0,0), (1,0), (1,1), (0,1). */
static inline qm_bilinear qm_bilinear_make(const qm_vec corner[4])
{
    return (qm_bilinear){
        .origin = corner[0],
        .e1 = qm_vec_sub(corner[1], corner[0]),
        .e2 = qm_vec_sub(corner[3], corner[0]),
        .w = qm_vec_add(qm_vec_sub(corner[0], corner[1]), qm_vec_sub(corner[2], corner[3])),
    };
}

static inline qm_vec qm_bilinear_at(const qm_bilinear *patch, double s, double t)
{
    qm_vec along_s = qm_vec_axpy(patch->e1, t, patch->w);
    return qm_vec_axpy(qm_vec_axpy(patch->origin, t, patch->e2), s, along_s);
}

/** Polar form (blossom) of the patch: linear in each argument, Q(p, p) = Q(p). Of three points of parameters
 * taken in pairs it gives the Bezier points of the part of the patch between them. */
static inline qm_vec qm_bilinear_polar(const qm_bilinear *patch, const double p[2], const double q[2])
{
    qm_vec sum = qm_vec_axpy(patch->origin, 0.5 * (p[0] + q[0]), patch->e1);
    sum = qm_vec_axpy(sum, 0.5 * (p[1] + q[1]), patch->e2);
    return qm_vec_axpy(sum, 0.5 * (p[0] * q[1] + q[0] * p[1]), patch->w);
}

/* ---- the patch and its two triangles ---- */

/**
 * Flatness bound: how far the patch and its two triangles (c0 c1 c2), (c0 c2 c3) are from one another at
 * most, rounded up. It is |w| / 4, or, where the corners make a convex quad as seen along some direction n,
 * the range of their heights along n. In that view both surfaces fill the quad, over each point of it once,
 * and both lie between the lowest and the highest corner. The common normal of the diagonals minimises the
 * range, |w.n| / 2, which is nothing for a flat quad; but any direction proves its own range, so that it need
 * not be exact. Where the quad is not convex, the bound is twice the distance by which a corner misses the
 * segment between its neighbours.
 */
double qm_bilinear_twist(const qm_vec corner[4]);

/** Two triangles that stand for a patch, (c0 c1 c2) and (c0 c2 c3): each point of either surface lies within
 * slack of the other surface. */
typedef struct qm_bilinear_halves {
    qm_vec corner[4];
    double slack;
} qm_bilinear_halves;

/**
 * The triangles between the corners, or these moved by -w / 8. At s >= t the patch is -t (1 - s) w from the
 * first triangle, likewise from the second: between nothing and -w / 4, so that the mean of both is within
 * |w| / 8. Chooses the pair that gives points in a direction the smaller sum of distance and slack; direction
 * is of length 1, or 0 when there is none.
 */
qm_bilinear_halves qm_bilinear_halve(const qm_vec corner[4], qm_vec direction);

/* ---- the hull of the corners ---- */

/** Range of the corners' heights along a direction of length 1, rounded up. */
double qm_bilinear_hull_width(const qm_vec corner[4], qm_vec direction);

/**
 * Lower bound of the distance from p to a patch with these corners: the distance to its two triangles less
 * twist, their flatness bound; or, where that is below enough and the hull of the corners is much thinner
 * than twist (flat, folded and collapsed patches), the distance to the hull.
 *
 * fraction  parameters from 0 to 1 of a point near the footpoint, the nearer the smaller the patch; the
 *           center when the first bound reaches enough
 */
double qm_bilinear_hull_lower(const qm_vec corner[4], qm_vec p, double twist, double enough,
                              double fraction[2]);

/* ---- folds ---- */

/**
 * Jacobian determinant of the patch as seen along n: J(s, t) = n.(Q_s x Q_t) = at + rise.(s, t), linear since
 * w x w = 0. Of a flat patch n is a normal, and J changes its sign at the fold.
 */
typedef struct qm_bilinear_jacobian {
    double at, rise[2];
} qm_bilinear_jacobian;

static inline qm_bilinear_jacobian qm_bilinear_jacobian_make(const qm_bilinear *patch)
{
    qm_vec flat = qm_vec_cross(patch->e1, patch->e2), by_s = qm_vec_cross(patch->e1, patch->w),
           by_t = qm_vec_cross(patch->w, patch->e2);
    qm_vec n = qm_vec_longer(flat, qm_vec_longer(by_s, by_t));
    return (qm_bilinear_jacobian){qm_vec_dot(n, flat), {qm_vec_dot(n, by_s), qm_vec_dot(n, by_t)}};
}

static inline double qm_bilinear_jacobian_at(const qm_bilinear_jacobian *jacobian, const double x[2])
{
    return jacobian->at + jacobian->rise[0] * x[0] + jacobian->rise[1] * x[1];
}

/* ---- sides ---- */

/**
 * On which side of the patch a point inside of the tetrahedron of the corners lies, exactly: with l its weights of the corners,
 * the sign of l0 l2 - l1 l3. It is 0 on the patch, whose own weights are (1 - s)(1 - t), s (1 - t), s t and (1 - s) t; 1 on the
 * side of the diagonal c0 c2, where the triangles (c0 c1 c2) and (c0 c2 c3) are; and -1 on that of the other one. Coordinates as
 * in orient.h.
 */
int qm_bilinear_side(const qm_vec corner[4], qm_vec p);

/* ---- the distance from a point ---- */

/** Smallest error that a certified distance may have, as a fraction of the largest coordinate. Both
 * ends of its interval are rounded by up to 60 u (rounding.h), so that half of this is spent on roundings. */
#define QM_BILINEAR_MIN_ERROR 0x1p-46

/** A point of the patch and what it proves: lower <= d(p, patch) <= distance = |p - Q(uv)|. */
typedef struct qm_bilinear_footpoint {
    double distance, lower;
    double uv[2];
} qm_bilinear_footpoint;

/**
 * Finds the footpoint with distance - lower <= error, unless the patch is proven to lie beyond stop_above, or
 * short of it by no more than error: then the only promise is lower >= stop_above - error. error is at least
 * QM_BILINEAR_MIN_ERROR of the coordinates.
 */
qm_bilinear_footpoint qm_bilinear_project(const qm_bilinear *patch, qm_vec p, double error,
                                          double stop_above);

/**
 * True where the patch is proven to lie at least this far from p: with the roundings of a certified distance,
 * and a few more of both lengths, so that distances short of the true one by a hundred roundings of the
 * coordinates are proven but on patches whose segments shrink to nearly a point both ways.
 */
bool qm_bilinear_is_beyond(const qm_bilinear *patch, qm_vec p, double distance);

/**
 * Finds a good candidate for the footpoint by minimising in each local minimum, or in the only one that there
 * is: distance is valid, lower is 0. Where f may have several, the patch is a family of segments, and the
 * local minima of the distance to their lines are roots of a quintic. Returns any point of a patch that it
 * finds to lie beyond stop_above.
 */
qm_bilinear_footpoint qm_bilinear_minimise(const qm_bilinear *patch, qm_vec p, double stop_above);

#define QM_FINE_GAIN 1e-9  /* of the distance: a step that gains less ends a minimisation */
#define QM_ROUGH_GAIN 1e-5 /* the same, where a point near the footpoint does */

/** Minimises from a point of the patch on, until a step gains less than a share of the distance: distance and uv
 * get better, lower stays. */
void qm_bilinear_polish(const qm_bilinear *patch, qm_vec p, double gain, qm_bilinear_footpoint *foot);

/* ---- a triangle over the patch ---- */

/**
 * Upper bound of the distance of all points of a triangle from the patch, given the parameters uv of points
 * of the patch under the three corners: the footpoints, or others. The parameters under all other points are
 * interpolated, so that the difference of the surfaces is quadratic. The component along its mean direction
 * is bounded exactly, the component across by its Bezier points. Under the footpoints the component across
 * falls with the square of the triangle's size and counts by its square: the bound exceeds the distance by
 * the fourth power of the size.
 */
double qm_bilinear_triangle_upper(const qm_bilinear *patch, const qm_vec corner[3], const double uv[3][2]);

/**
 * The same for a convex plane polygon of count corners, seen along its normal and that of the patch as well: where
 * the patch, or the rectangle of it under the corners, stands over the polygon like a hill, what the interpolation
 * loses in the plane of the view counts by the slope of the hill only. Bounds above enough are improved by more
 * work.
 */
double qm_bilinear_polygon_upper(const qm_bilinear *patch, int count, const qm_vec corner[],
                                 const double uv[][2], double enough);

#endif
