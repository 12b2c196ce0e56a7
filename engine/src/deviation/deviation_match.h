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
 * Along the normals. Where surfaces nearly coincide, heights change their sign, and D has a component along the
 * patch that is as long as it is high: c above is then no small part of the distance. So let N = Q_s x Q_t at
 * b, n = N / |N|, h = n.D the height over the tangent plane, and omega the greatest |n.w|. N is linear in the
 * parameters, so in l too, and N.w = (e1 x e2).w is constant. Let b + z be parameters nearer to the foot of P,
 * e the greatest length of D - J z less its component along n, plus |w| k y^2 / 2, y the greatest |M z|, and U
 * be round all b + z too. For parameters b + z + v of R, with V = |M v|,
 *     P - Q(b + z) = h' n + p with h' = h - omega z_1 z_2 and a tangent p, |p| <= e;
 *     |h| - omega k y^2 / 2 <= |h'| <= |h| + omega k y^2 / 2, as 2 |z_1 z_2| <= k y^2;
 *     X = |Q(b + z + v) - Q(b + z)| >= (1 - r) V;
 *     its component along n is n.w (z_1 v_2 + z_2 v_1 + v_1 v_2), at most omega k (y V + V^2 / 2): a symmetric
 *         bilinear form is bounded as its quadratic form is.
 * So |P - Q(b + z + v)|^2 >= h'^2 + (X - e)^2 - 2 |h'| a X - B X^2, a = omega k y / (1 - r) and
 * B = |h'| omega k / (1 - r)^2. If B < 1 this is
 *     h'^2 - |h'| c' + (1 - B) (X - E / (1 - B))^2, E = e + |h'| a,
 *     c' = (2 e a + |h'| a^2 + e^2 omega k / (1 - r)^2) / (1 - B),
 * and d(P, R) >= |h'| - c' >= |h| - c, c = c' + omega k y^2 / 2. Where b + z is beyond an edge of R, X exceeds
 * E / (1 - B) by Y / sqrt(1 - B), Y = sqrt(1 - B) (1 - r) det / |B| times how far it is beyond, or |A| for the
 * other parameter, less E / sqrt(1 - B): the bound with slope t above holds with h for n.D. c is about the
 * curvature of the patch times the squares of e and y, which are small parts of the distance.
 *
 * Upper. J at b + z turns v into a vector whose part at a right angle to n is at least (1 - r - omega k y) V
 * long. So a v with V <= e / (1 - r - omega k y) turns into p, and where b + z + v is in the square
 *     d(P, Q) <= |h| + omega k (y^2 / 2 + y V) + |w| k V^2 / 2;
 * elsewhere o is added, b + z being as far inside of the edges as v may lead.
 *
 * Here U need be round b and b + z alone: J is taken at no other parameters.
 *
 * Planes. For a vector m no longer than 1, and a and b the least and the greatest m.q of the patch's corners q, the
 * patch lies between the planes m.x = a and m.x = b, and d(P, R) >= |m.P - (a + b) / 2| - (b - a) / 2. m.P is
 * quadratic in l, as H is: |H| is above this by no more than the greatest difference of their coefficients, or of those of
 * H and -m.P, and half of b - a. The distance is no more than so much below H with its cubic part if the greatest value
 * of that is added.
 *
 * z is quadratic in l: 0 at the corners, and so that between two of them it leads to the foot, to first order.
 * The component of D - J z at a right angle to n is no longer than D - J z - q N for any number q. Where q is
 * quadratic in l, near h / |N|, the greatest of the coefficients of this cubic vector function bounds it.
 *
 * h is no polynomial. Let m be a unit vector with m.N_i > 0 at the corners, and L linear with values |N_i| there,
 * less half of the greatest |N_i| - m.N_i: |N| is between sum l_i m.N_i and sum l_i |N_i|, so that it differs
 * from L by that half at most. For any quadratic H, with G = N.D - H L, which is cubic,
 *     h = H + G / |N| + H (L - |N|) / |N|.
 * H is such that G is 0 at the corners and its coefficients of l_i^2 l_j and l_i l_j^2 are opposite numbers. Its
 * quotient by a constant, the middle of the bounds of |N|, is the cubic part of the height: integrals include
 * it, as its mean is small. The functions low and high of a piece do not, and are opened by its bound.
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
 * a = det / (|A|^2 + |B|^2)^(1/2) no more than the least singular value of M. N is off by
 * eta (|Q_s| + |Q_t|), and h by |D| / |N| times that and eta |N_i| / |N|; D - J z - q N by
 * 2 eta (1 + |z_1| + |z_2|) and |q| times the error of N. b + z, from -3/2 to 5/2, is off by 2^-51.
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
    qm_vec normal;          /* n, or m */
    double slope[10][2];    /* coefficients of F */
    double height[6];       /* coefficients of n.D, or of H */
    double low[3], high[3]; /* linear functions below and above the height */
    double slack;           /* how far the source may be from P */
    double off;             /* how far the height may be from the quadratic function, */
    double cubic[4];        /* and how far, less cubic_most, from a cubic one (deviation_quadratic.h); */
    double cubic_most;      /* 0 where there is none */
    double normal_w;        /* omega, of heights along the normals, */
    double step[3][2];      /* and the coefficients 01 12 20 of z: the others are 0 */
    double foot[6][2];      /* coefficients of b + z, or of b */
    double beside;          /* e */
    double least;           /* of |n.D| over the piece; 0 when it may change its sign */
    double greatest;        /* of |D| */
    double over;            /* by how much |D| may be above |n.D| */
    bool is_clamped;        /* some parameters are on an edge of the square that footpoints would be beyond */
    bool along_normals;     /* heights are along the normals of the patch, else along n */
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

/** True when all parameters are within the unit square. */
static inline bool qm_deviation_match_is_inside(const qm_deviation_match *match)
{
    bool is_inside = true;
    for (int i = 0; i < 6; i++)
        is_inside &= match->at[i / 2][i % 2] >= 0.0 && match->at[i / 2][i % 2] <= 1.0;
    return is_inside;
}

/** The terms of the bounds for a rectangle of a patch. */
typedef struct qm_match_margin {
    double loss;       /* c, or INFINITY */
    double stretch[2]; /* Y by how far parameters are beyond an edge, */
    double offset;     /* less this */
} qm_match_margin;

qm_match_margin qm_deviation_match_margin(const qm_deviation_setup *setup, const qm_deviation_match *match,
                                          const qm_uv_box *box);

/** By how much the distance may be above the height, where the parameters are so far inside of all edges of the square. */
typedef struct qm_match_rise {
    double over; /* or INFINITY */
    double foot[2];
} qm_match_rise;

qm_match_rise qm_deviation_match_rise(const qm_deviation_setup *setup, const qm_deviation_match *match);

/** By how much the distance to any part of the patch may be below the height, as all of the patch is near one plane: see
 * Planes above. */
double qm_deviation_match_plane_loss(const qm_deviation_setup *setup, const qm_deviation_match *match,
                                     const qm_vec bezier[6]);

/** By how much less than |D| the distance to a rectangle of the patch may be: c, or INFINITY. */
static inline double qm_deviation_match_loss(const qm_deviation_setup *setup, const qm_deviation_match *match,
                                             const qm_uv_box *box)
{
    return qm_deviation_match_margin(setup, match, box).loss;
}

/** Values of Y at the corners, for the edge of the rectangle that the piece is farthest beyond. */
void qm_deviation_match_beyond(const qm_deviation_match *match, const qm_uv_box *box,
                               const qm_match_margin *margin, double beyond[6]);

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

/**
 * The same for a piece of a patch that is matched to the same parameters of another patch, counted from its nearest
 * corner: for two patches that nearly coincide, however they are folded. False where the sum of the values would be no
 * less than enough, which the three corners tell: of most patches, as they do not coincide.
 */
bool qm_deviation_match_aligned_upper(const qm_deviation_setup *setup, const qm_deviation_face *face,
                                      const qm_deviation_piece *piece, const qm_bilinear *patch,
                                      double enough, double high[3]);

/** How far the corners' parameters are beyond lines that are foot inside of the four edges of the unit
 * square, as lengths; negative within. */
void qm_deviation_match_edges(const qm_deviation_setup *setup, const qm_deviation_match *match,
                              const double foot[2], double beyond[4][3]);

#endif
