/**
 * deviation_feature.h: an edge or a vertex of the target, and a cubic function near the distance of a piece from
 * it. Where a surface lies apart from a curved one, on the side to which that is convex, most of it is nearest to
 * edges and vertices: there the distance is no height over a plane, but smooth all the same.
 *
 * Let o be the vertex, or an end of the edge, and M v = v, or v less its component along the edge. For a point p
 * let x = M (p - o), so that f = |x| is its distance from the vertex, or from the line of the edge.
 *
 * Upper. d <= f + (how far p is past an end of the edge, along it), by way of the line.
 *
 * Lower. Let q = p - x: the vertex, or the foot of p on the line. For a point y of the target, x being at a right
 * angle to q - o and x = M x,
 *     f |p - y| >= x.(p - y) = x.(x - (y - q)) = f^2 - x.M (y - o).
 * Let y be in the hull of corners t_i, as the points of a facet, or of a rectangle of a patch, are: with
 * A = max x.M (t_i - o)
 *     d(p, hull) >= f - max(A, 0) / f.
 * A <= 0 is the normal cone of the hull in o, so that the facets round an edge or a vertex take nothing off where
 * that is the nearest. x.M (t_i - o) is linear over a flat piece, and quadratic over one of a patch.
 *
 * Cubic. x is quadratic in the weights l of a piece of a patch, with the Bezier points as coefficients, and f^2 is
 * of degree four. For any cubic function c with coefficients of at least c_0 > 0, let R be the greatest
 * coefficient, in the Bernstein basis of degree six, of c^2 - f^2. Then |c^2 - f^2| <= R everywhere, and, with
 * f_0^2 = c_0^2 - R > 0,
 *     f >= f_0,   |c - f| = |c^2 - f^2| / (c + f) <= R / (c_0 + f_0).
 * c interpolates f at the ten points with weights of thirds; it is off by a term of fourth order in the size of
 * the piece over its distance. A piece as large as the distance is within about a hundredth part of it, one of half
 * that size within a sixteenth of that.
 *
 * Roundings, in units of u S. A coefficient of the piece is off by 49, a corner of a facet or patch by 54 at most
 * (deviation_piece.h), and both by the change to local space, 64 each (rounding.h); x and M (t_i - o) by 32 more: a
 * difference of 4 S, and its component along a unit vector that is off by 4 u. All of it is less than eta = 384: f is
 * off by eta, and A by eta (|x| + |M (t_i - o)|). As the line itself may be any, it costs nothing that it is not
 * quite that of the edge: upper bounds are for its points between the ends, which are as near to the edge as these.
 * A coefficient of c^2 or f^2 is a mean of at most 20 products of coefficients, each of which goes through 12
 * roundings at most, and so are the sums: ROUNDING times the greatest squares. All lengths have an eta of their own.
 */
#ifndef QM_DEVIATION_FEATURE_H
#define QM_DEVIATION_FEATURE_H

#include "deviation_piece.h"

typedef struct qm_deviation_feature {
    qm_vec origin; /* o */
    qm_vec along;  /* of the edge: a unit vector; of a vertex 0 */
    double length; /* of the edge */
} qm_deviation_feature;

/** The edge or vertex of a facet that is nearest to a point; false when a point within it is. */
bool qm_deviation_feature_of_triangle(const qm_triangle *triangle, qm_vec p, qm_deviation_feature *out);

/** The same of a patch, searched from these parameters. */
bool qm_deviation_feature_of_patch(const qm_bilinear *patch, const double start[2], qm_vec p,
                                   qm_deviation_feature *out);

/** The same of a facet of a list, or of the patch that it is of. */
bool qm_deviation_feature_under(const qm_deviation_facets *near, int facet, qm_vec p,
                                qm_deviation_feature *out);

/** x. */
static inline qm_vec qm_deviation_feature_offset(const qm_deviation_feature *feature, qm_vec p)
{
    qm_vec x = qm_vec_sub(p, feature->origin);
    return qm_vec_axpy(x, -qm_vec_dot(x, feature->along), feature->along);
}

/** How far a point is past each end of the edge, along it; negative between them. */
static inline void qm_deviation_feature_past(const qm_deviation_feature *feature, qm_vec p, double past[2])
{
    double at = qm_vec_dot(qm_vec_sub(p, feature->origin), feature->along);
    past[0] = -at;
    past[1] = at - feature->length;
}

/** The cubic function near the distance over a piece with these Bezier points: q + e of deviation_quadratic.h. */
typedef struct qm_feature_distance {
    double value[6], cubic[4], cubic_most;
    double off;   /* by how much the distance may differ from it */
    double least; /* of the distance: f_0 */
} qm_feature_distance;

/** False when the piece is too near for its size. */
bool qm_deviation_feature_distance(const qm_deviation_setup *setup, const qm_deviation_feature *feature,
                                   const qm_vec at[6], qm_feature_distance *out);

#endif
