/**
 * bilinear_point.h: distance from a point to a bilinear patch, certified.
 *
 * Q(s, t) = o + s e1 + t e2 + s t w over the unit square. f = |p - Q|^2 / 2 has f_ss = |Q_s|^2, f_tt =
 * |Q_t|^2 and f_st = K(s, t) - (p - o).w with K = Q_s.Q_t + (Q - o).w bilinear, so that over any rectangle
 * the range of f_st is found at its corners. Where |f_st|^2 < f_ss f_tt throughout, f is convex on the
 * rectangle and one minimum is the minimum; elsewhere the rectangle is cut in quarters, each bounded below by
 * its two triangles less |w| ds dt / 4.
 */
#ifndef QM_BILINEAR_POINT_H
#define QM_BILINEAR_POINT_H

#include "core/vec.h"

typedef struct qm_bilinear {
    qm_vec origin, e1, e2, w;
} qm_bilinear;

/** Corners in turn: (0,0), (1,0), (1,1), (0,1). */
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

/**
 * How far the patch and its two triangles (c0 c1 c2), (c0 c2 c3) are from one another at most, rounded up:
 * |w| / 4, or, where the corners make a convex quad as seen along some direction n, the range of their
 * heights along n. In that view both surfaces fill the quad, over each point of it once, and both lie between
 * the lowest and the highest corner. The common normal of the diagonals makes the range least, |w.n| / 2,
 * nothing for a flat quad; but any direction proves its own range, so that it need not be exact. Where it is
 * not convex, twice the distance by which a corner misses the segment between its neighbours.
 */
double qm_bilinear_twist(const qm_vec corner[4]);

/** Two triangles for a patch, (c0 c1 c2) and (c0 c2 c3): of each point of either surface the other is within
 * slack. */
typedef struct qm_bilinear_halves {
    qm_vec corner[4];
    double slack;
} qm_bilinear_halves;

/**
 * The triangles between the corners, or these moved by -w / 8. At s >= t the patch is -t (1 - s) w from the
 * first triangle, likewise from the second: between nothing and -w / 4, so that the middle of both is within
 * |w| / 8. Those that tell points in a direction the least distance together with the slack; direction is of
 * length 1, or 0 when there is none.
 */
qm_bilinear_halves qm_bilinear_halve(const qm_vec corner[4], qm_vec direction);

/** Of the greatest coordinate: the least error of a certified distance that is worth to ask for. Both ends of
 * its interval are rounded by up to 60 u (rounding.h), so that half of this is spent on roundings. */
#define QM_BILINEAR_MIN_ERROR 0x1p-46

/** A point of the patch and what it proves: lower <= d(p, patch) <= distance = |p - Q(uv)|. */
typedef struct qm_bilinear_foot {
    double distance, lower;
    double uv[2];
} qm_bilinear_foot;

/**
 * Nearest point of the patch with distance - lower <= error, unless the patch is proven to lie beyond
 * stop_above, or short of it by no more than error: then lower >= stop_above - error is all that is promised.
 * error is at least QM_BILINEAR_MIN_ERROR of the coordinates.
 */
qm_bilinear_foot qm_bilinear_project(const qm_bilinear *patch, qm_vec p, double error, double stop_above);

/**
 * A good point of the patch, by descent into each valley that sixteen points show, or into the only one there
 * is: distance is valid, lower is 0. Of a patch that is found to lie beyond stop_above any point.
 */
qm_bilinear_foot qm_bilinear_descend(const qm_bilinear *patch, qm_vec p, double stop_above);

/** Goes down from a point of the patch as far as it goes: distance and uv get better, lower stays. */
void qm_bilinear_polish(const qm_bilinear *patch, qm_vec p, qm_bilinear_foot *foot);

#endif
