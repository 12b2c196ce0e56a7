/**
 * deviation_match.h: a piece of the source against a bilinear patch of the target, point by point: linear
 * bounds whose error falls with the square of the piece's size, and with the distance itself.
 *
 * Let P(l) be the point of the piece at barycentric weights l, Q(s, t) = o + s e1 + t e2 + s t w the patch,
 * also beyond its edges, and b(l) = sum l_i b_i any affine map from the piece to parameters of Q. The
 * difference D(l) = P(l) - Q(b(l)) is quadratic in l, with coefficients D_ij in the Bernstein basis:
 * D = sum l_i l_j D_ij. A bound of the coefficients is a bound everywhere.
 *
 * Upper. d(P(l), Q) <= |D(l)| where b(l) is in the unit square, and elsewhere |D(l)| + o, with o the distance
 * from Q(b) to Q at the nearest parameters of the square: at most the sum over the square's edges of how far
 * b is beyond the edge, times the greatest |Q_s| or |Q_t|.
 *
 * Lower. Let b + z be parameters of a rectangle R of Q, U a rectangle round R and all b, h_1 and h_2 half its
 * sides, J = (Q_s Q_t) at b, J0 = (A B) that at the centre of U, J0 = O M with O two orthonormal columns,
 * det = |A x B| that of M. For x = Q(b + z) - Q(b) = J z + w z_1 z_2 and y = |M z|:
 *     |z_1| <= y |B| / det, |z_2| <= y |A| / det: rows of the inverse of M;
 *     2 |z_1 z_2| <= k y^2, k = (|A| |B| + |A.B|) / det^2: a product of two linear forms;
 *     |x - J0 z| = |w| |z_1 v_2 + z_2 v_1| <= r y, r = |w| (h_2 |B| + h_1 |A|) / det: v_i is how far the mean
 *         of the parameters b_i and b_i + z_i is from the centre of U;
 *     D.x = F.z + D.w z_1 z_2 <= f y + g k y^2 / 2, F = J^T D, f the greatest |M^-T F|, g that of |D.w|: F is
 *         cubic in l, D.w quadratic.
 * So |P - Q(b + z)|^2 = |D|^2 - 2 D.x + |x|^2 >= |D|^2 - 2 f y + m y^2, m = (1 - r)^2 - g k. When m > 0 this
 * is at least |D|^2 - f^2 / m, and d(P(l), R) >= |D(l)| - c, c = min(f / sqrt(m), f^2 / (m min |D|)). f is 0
 * at footpoints, so that with the footpoints of the corners as b_i it is of second order, and c of fourth.
 * m > 0 if the radius of curvature of R exceeds the distance, and its tangents turn little within U.
 *
 * Where b is beyond an edge of R by e(l), linear in l, y is at least e det / |B|, or / |A|. Then, with
 * Y = sqrt(m) times that, less f / sqrt(m), |P - Q(b + z)|^2 >= |D|^2 + max(Y, 0)^2 - f^2 / m, so that
 *     d(P(l), R) >= (n.D + t Y) / sqrt(1 + t^2) - c for any t >= 0 and unit vector n.
 * This bounds a patch beside the one under the piece, whose surface, continued beyond its edge, may be nearer
 * than the patch is.
 *
 * On an edge of the square, where the nearest parameters of points beside the patch are, D.J z is at most 0
 * across the edge if D points away from it: then only the negative part of that component of F counts, f
 * being |F| / a.
 *
 * As a graph. D may be long compared with its height n.D: then f is as long, and so is c. But if Q is almost
 * a plane, the part of D along it matters little. Let U' be the b and the part of U that is no farther from
 * them than 2 |D| / ((1 - r) y) times the |z_i| above: any other x has |x| > 2 |D|, so that its point of R is
 * no nearer than |D|. Let Q_s x Q_t have a positive component along n at the corners of U': then Q over U' is
 * the graph of a function over a convex part of the plane normal to n, and of slope g, the greatest ratio of
 * the other components to that one at the corners. With e the greatest length of D along the plane, and v the
 * vector along it from Q(b) to a point of R,
 *     |P - Q(b + z)|^2 >= max(0, |n.D| - g |v|)^2 + (|v| - e)^2, and so
 *     d(P, R) >= (|n.D| - g e) / sqrt(1 + g^2) >= |n.D| - g e - g^2 / 2 |n.D|.
 * And where P is over the part V of Q that U' and the unit square have in common, d <= |n.D| + g e;
 * elsewhere, with o the distance along the plane from there, |n.D| + g e + (1 + g) o. In the view along n, V
 * is a convex quad, and o no more than the sum over its edges of how far P is beyond them, divided by the
 * sine of its least acute angle (deviation_piece.h).
 *
 * Flat. If P is a triangle that stands for a patch within slack, all bounds are widened by slack.
 *
 * Linear. For a unit vector n: |D| >= |n.D|, |D| <= |n.D| + min(p, p^2 / (2 min |n.D|)), p the greatest
 * length of the component of D normal to n. n.D is above the linear function with its values at the corners
 * by the sum of 2 l_i l_j E_ij over i < j, E_ij = n.D_ij - (n.D_ii + n.D_jj) / 2: at most 2 / 3 of the
 * greatest E_ij, and half the sum of the positive ones, as l_i l_j is 1 / 4 at most, and their sum 1 / 3. The
 * same holds below, and for |D|, which the combination of the |D_ij| bounds.
 *
 * Roundings, in units of u S, S the greatest local coordinate (rounding.h, deviation_piece.h). b_i are exact,
 * from -1/2 to 3/2. A point of the source or a coefficient of it is off by 49, one of Q by 182 (w by 12 in
 * each coordinate, times 9/4; products and sums of up to 16 S), D by 240 in all with the errors of both
 * surfaces in local space, n.D by 32 more as |D| is at most 4 S, and by 40 at the corners of cells
 * (deviation_quadratic.h), whose weights and sums are off by 10 u: less than the 384 of eta. J is off by 38
 * in each column, J0 too, which eta / a in r and eta (|J| + |D|) / a in f cover,
 * a = det / (|A|^2 + |B|^2)^(1/2) no more than the least singular value of M.
 */
#ifndef QM_DEVIATION_MATCH_H
#define QM_DEVIATION_MATCH_H

#include "deviation_piece.h"
#include "prim/bilinear_match.h"

/** A piece matched to a patch. */
typedef struct qm_deviation_match {
    const qm_bilinear *patch;
    double at[3][2];        /* parameters of the patch for the corners of the piece */
    qm_vec difference[6];   /* D_ij: 00 11 22, then 01 12 20 */
    qm_vec along[2][3];     /* Q_s and Q_t at the corners' parameters */
    qm_vec normal;          /* n */
    double slope[10][2];    /* coefficients of F */
    double height[6];       /* coefficients of n.D */
    double low[3], high[3]; /* linear functions below and above it */
    double slack;           /* how far the source may be from P */
    double beside;          /* e */
    double least;           /* of |n.D| over the piece; 0 when it may change its sign */
    double greatest;        /* of |D| */
    double over;            /* by how much |D| may be above |n.D| */
    bool is_clamped;        /* some parameters are on an edge of the square that footpoints would be beyond */
    bool holds;             /* the match was found, and all of the above is set */
} qm_deviation_match;

/** Parameters of about the point of a patch nearest to p, from those in at on: of its surface, up to half a
 * patch beyond its edges, or of the patch alone. */
void qm_deviation_match_foot(const qm_bilinear *patch, qm_vec p, bool within, double at[2]);

/**
 * Matches the corners of a piece to the points of a patch nearest to them, near to start: of all of its
 * surface, also beyond its edges, or of the patch alone.
 */
void qm_deviation_match_make(const qm_deviation_setup *setup, const qm_deviation_face *face,
                             const qm_deviation_piece *piece, const qm_bilinear *patch, const double start[2],
                             bool within, qm_deviation_match *match);

/** Matches a piece of a patch to the same parameters of another patch, counted from its nearest corner: for
 * two patches that nearly coincide, however they are folded. */
void qm_deviation_match_aligned(const qm_deviation_setup *setup, const qm_deviation_face *face,
                                const qm_deviation_piece *piece, const qm_bilinear *patch,
                                qm_deviation_match *match);

/** True when all parameters are within the unit square. */
static inline bool qm_deviation_match_is_inside(const qm_deviation_match *match)
{
    bool is_inside = true;
    for (int i = 0; i < 6; i++)
        is_inside &= match->at[i / 2][i % 2] >= 0.0 && match->at[i / 2][i % 2] <= 1.0;
    return is_inside;
}

/** The terms of the lower bound for a rectangle of a patch. */
typedef struct qm_match_margin {
    double loss;       /* the lesser of c and the loss of the graph, or INFINITY */
    double tilted;     /* c */
    double stretch[2]; /* Y by how far parameters are beyond an edge, */
    double offset;     /* less this */
} qm_match_margin;

/** A patch as a graph. */
typedef struct qm_match_graph {
    bool holds;
    double loss, over; /* by how much the distance may be less than |n.D|, and more */
    double slope;      /* g */
    qm_uv_box view;    /* V */
} qm_match_graph;

qm_match_margin qm_deviation_match_margin(const qm_deviation_setup *setup, const qm_deviation_match *match,
                                          const qm_uv_box *box);

/** The rectangle of a patch as a graph. */
qm_match_graph qm_deviation_match_graph(const qm_deviation_setup *setup, const qm_deviation_match *match,
                                        const qm_uv_box *box);

/** Bounds from above how far the corners are beyond each edge of V, in the view. Returns the factor for the
 * sum over all four edges; INFINITY when rounding leaves open whether V is a convex quad. */
double qm_deviation_match_view_edges(const qm_deviation_setup *setup, const qm_deviation_face *face,
                                     const qm_deviation_piece *piece, const qm_deviation_match *match,
                                     const qm_match_graph *graph, double beyond[4][3]);

/** By how much less than |D| the distance to a rectangle of the patch may be: c, or INFINITY. */
static inline double qm_deviation_match_loss(const qm_deviation_setup *setup, const qm_deviation_match *match,
                                             const qm_uv_box *box)
{
    return qm_deviation_match_margin(setup, match, box).loss;
}

/** Values of Y at the corners, for the edge of the rectangle that the piece is farthest beyond. */
void qm_deviation_match_beyond(const qm_deviation_match *match, const qm_uv_box *box,
                               const qm_match_margin *margin, double beyond[3]);

/** Values at the corners of four linear functions that the distance to a rectangle of the patch is at least:
 * how far the piece is beyond each edge, along the plane normal to a unit vector. All of a rectangle is in
 * the hull of its corners, and behind a plane that these are behind. Off by 182 u S for a corner, 49 for a
 * coefficient of the piece, and 2 * 6 for the products with the unit vector: less than the eta by which the
 * function that loses is opened. */
void qm_deviation_match_beside(const qm_deviation_face *face, const qm_deviation_piece *piece,
                               const qm_bilinear *patch, const qm_uv_box *box, qm_vec normal,
                               double height[4][3]);

/** Values at the corners of a linear function that the distance to the patch is at most; the parameters are
 * all within the unit square. */
void qm_deviation_match_upper(const qm_deviation_match *match, double high[3]);

/** How far the corners' parameters are beyond the four edges of the unit square, as lengths; negative
 * within. */
void qm_deviation_match_edges(const qm_deviation_setup *setup, const qm_deviation_match *match,
                              double beyond[4][3]);

#endif
