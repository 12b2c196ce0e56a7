/**
 * bilinear_match.h: one part of a bilinear patch over another patch, matched rectangle by rectangle.
 */
#ifndef QM_BILINEAR_MATCH_H
#define QM_BILINEAR_MATCH_H

#include <stdbool.h>

#include "bilinear.h"

/** A rectangle of parameters of a patch. */
typedef struct qm_uv_box {
    double low[2], high[2];
} qm_uv_box;

/** The corners in cyclic order: (low, low), (high, low), (high, high), (low, high). */
static inline void qm_uv_box_corners(const qm_bilinear *patch, const qm_uv_box *box, qm_vec corner[4])
{
    for (int i = 0; i < 4; i++)
        corner[i] = qm_bilinear_at(patch, i == 1 || i == 2 ? box->high[0] : box->low[0],
                                   i >= 2 ? box->high[1] : box->low[1]);
}

/** The rectangles by which a rectangle exceeds a part of it: with the part they fill it. Returns their number. */
static inline int qm_uv_box_strips(const qm_uv_box *whole, const qm_uv_box *part, qm_uv_box strip[4])
{
    int count = 0;
    qm_uv_box rest = *whole;
    for (int k = 0; k < 4; k++) {
        int axis = k / 2;
        double cut = k % 2 ? part->high[axis] : part->low[axis];
        double *side = k % 2 ? &rest.high[axis] : &rest.low[axis];
        if (cut == *side) continue;
        strip[count] = rest;
        *(k % 2 ? &strip[count].low[axis] : &strip[count].high[axis]) = cut;
        *side = cut;
        count++;
    }
    return count;
}

/**
 * Upper bound of the distance of all points of a rectangle of a source patch from a target patch, given the parameters
 * uv of points of the target under the four corners: the footpoints, or others.
 *
 * The rectangle of parameters is cut along a diagonal. In either triangle the parameters of the target are interpolated,
 * so that both surfaces are quadratic there, and so is their difference, which is bounded as in
 * qm_bilinear_triangle_upper. Interpolated parameters are in the unit square, which is convex. So each point of the
 * rectangle has a point of the target within the bound. Under four corners that have been moved each in a way of its own
 * this is less than what a rectangle of the target leaves, whose corners have only four sides to move.
 *
 * The Bezier points of the source are off by roundings of the coordinates as those of the target are: 20 u R, for which
 * the distance of a point from a patch leaves room (rounding.h).
 */
double qm_bilinear_rectangle_upper(const qm_bilinear *source, const qm_uv_box *box, const qm_bilinear *target,
                                   const double uv[4][2]);

/** Called for each rectangle of the source that is not covered. */
typedef void qm_bilinear_remainder_fn(void *user, const qm_uv_box *remainder);

/**
 * Covers a rectangle of a source patch by a target patch: every covered point lies within the cutoff
 * of the target. Calls remainder for the rectangles that are not covered; covered and not, they fill the
 * rectangle.
 *
 * Proof. Let the points of a rectangle of the source be matched to those of a rectangle of the target, sides
 * to sides, linearly in each parameter. The difference of matched points is then bilinear, and its length is
 * maximal at a corner. So four points prove a rectangle, however the rectangle of the target was found: by
 * least squares of the four differences, from near the footpoint of the center. A rectangle that four points
 * do not prove is cut in halves or quarters, as long as that makes progress.
 *
 * Patches that nearly coincide need this. Where they are folded, footpoints jump from one sheet to the other,
 * and bounds from them fail along the whole fold; the matched rectangle stays on its sheet.
 *
 * center  parameters of a point of the target near the center of the rectangle
 *
 * Returns false, without calling remainder, when nothing was covered.
 */
bool qm_bilinear_match(const qm_bilinear *source, const qm_uv_box *box, const qm_bilinear *target,
                       const double center[2], double cutoff, qm_bilinear_remainder_fn *remainder,
                       void *user);

/** As qm_bilinear_match for patches whose corners nearly coincide, from equal parameters; returns false at
 * little cost for other patches. */
bool qm_bilinear_match_coincident(const qm_bilinear *source, const qm_uv_box *box, const qm_bilinear *target,
                                  double cutoff, qm_bilinear_remainder_fn *remainder, void *user);

#endif
