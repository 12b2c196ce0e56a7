/**
 * deviation_piece.h: two linear functions that hold the distance to a target between them over a piece of the
 * source.
 *
 * A piece is a triangle of parameters on a face of the source. On a flat face it is a triangle P with corners
 * p_i. On a bilinear patch the point of parameters l (barycentric in the piece) is within slack = |w| ds dt /
 * 4 of sum l_i p_i, so that bounds over the flat triangle hold over the piece when opened by slack.
 *
 * Where a patch bends little, its two triangles (c0 c1 c2) and (c0 c2 c3) stand for it (deviation_shape.h): a
 * piece is a flat part of one of them, and its bounds hold for the part of the patch over it, which is within
 * slack. Parameters of the patch give worse bounds even where it is flat: w, which lies in its plane, would
 * count as slack.
 *
 * Let T be a facet of the target B, and d the distance to B.
 *
 * Upper. d <= d(., T), which is convex because T is. So over P: d <= the linear function with the values
 * d(p_i, T). Any T will do; the one with the least mean is taken. d(c, B) + r, with c and r as below, is a
 * bound too.
 *
 * Lower, by facets. Let c be the middle of P, r = max |p_i - c|. The nearest facet of any p of P has d(c, T)
 * <= d(p, T) + r <= d(c, B) + 2 r. So d = min d(., T_k) over the facets within that ball, once all of them
 * are known (deviation_near.h). Each takes part with a linear function below its distance:
 *     the height over its plane, on the side of c: the distance to a plane is no more than that to T;
 *     g p - max g t over the corners t of T, g a unit vector: T lies behind the plane at a right angle to g
 *     through its corner that is farthest along g. With g the direction from the foot of a point x to x it is
 *     d(x, T) itself at x, as T is convex; a rounded g costs as little as it is off, and proves as much.
 *     the height over the plane through a corner of T that is parallel to the facet under c: along a ridge T
 *     lies behind it, and the height is that over the facet under c, however flat the ridge.
 * The least of linear functions is concave, so it is at least the linear function with its values at the
 * corners. A facet with d(c, T) - r >= m, where the least of the others is at most m at every corner, changes
 * nothing there and is left out.
 *
 * Both, over the ground. Let T be the facet under c, and h the height over its plane, which is the distance
 * where P lies over T and no other facet is nearer. A linear bound by corners loses on all of P what is wrong
 * at one of them, and near a surface P often sticks out over an edge of T by a little. So |h| is integrated,
 * with what is wrong in a part of P, and how large that part is:
 *     d <= |h| + o, o the distance from T within its plane;
 *     d >= |h| - sum max(|h| - g_k, 0) over the other facets, on each side of T by itself, g_k a linear
 * function below the distance to the k-th. Integrals and shares of what is positive of a linear function are
 * known in closed form. h may change its sign: d is then the size of a number near h, and a surface that
 * passes through T need not be cut there.
 *
 * For o, let f_k be how far a point lies beyond the wall on edge k of T, and a the least angle of T. Then
 *     o sin a <= sum max(f_k, 0).
 * Where an edge is nearest, o is its f_k. Where a corner of angle b is, p - corner lies between the normals
 * of its edges, at an angle t from the one and pi - b - t from the other, with f = o cos t and o cos(pi - b -
 * t). As long as both are positive their sum is concave in t, so least where one is 0 and the other o sin b;
 * where one is negative the other is at least o sin b. Where b is obtuse both are positive, and 0 <= t <= pi
 * - b makes the sum least at an end: o (1 - cos b) >= o.
 *
 * Near a sharp corner that is far too much for points along an edge. With e_k how far the point is past
 * the ends of edge k, along it, o is no more than f_k + e_k for any f_k > 0, by way of the edge's line.
 *
 * Lower, by corners. d^2(p) - |p|^2 = min over b in B of |b|^2 - 2 b p is concave, so that
 *     d^2(sum l_i p_i) >= sum l_i d_i^2 - sum_{i<j} l_i l_j |p_i - p_j|^2 >= sum l_i (d_i^2 - e^2 / 3),
 * e the longest edge, as sum_{i<j} l_i l_j <= 1 / 3. Where all d_i^2 >= e^2 / 3 the root, being concave, is
 * at least the linear function with the values sqrt(d_i^2 - e^2 / 3). Good where the surfaces are far apart.
 * At the middle of an equilateral piece over a single point it is the distance itself, 0 when they touch: the
 * d_i are opened before the root, which would make sqrt(2 d eta) of what they are off.
 *
 * Lower, by the middle. d >= d(c, B) - r, a constant.
 *
 * Facets of a bilinear target stand for rectangles of its patches, within a slack by which their bounds are
 * opened. Where a rectangle bends little, its patch takes their place: the height is then that over the patch
 * itself (deviation_match.h), and neither it nor the piece is taken for flat.
 *
 * Roundings. Both functions are opened by eta = 384 u S, S the greatest local coordinate. Of that
 *     256 are for a distance or height from a computed point, both surfaces' way into the frame included
 *         (rounding.h);
 *     42 for a corner of a piece. On a flat face (1 - u - v) c0 + u c1 + v c2 is off by 5 u S in each
 *     coordinate: the first weight by 2 u, and each term goes through 3 roundings at most. On a patch
 *     Q_s = e1 + t w is off by 16 u S (e1 2, w 8, product 4, sum 2), s Q_s by 2 more, o + t e2 by 5, and the
 *     sum by 1: 24 sqrt(3) in all;
 *     6 for the slack of a source's patch: w is off by 12 u S in each coordinate, a quarter of it counts;
 *     54 for a corner of a rectangle of a target's patch: at most 31 midpoints of midpoints, 1 u S each;
 *     24 for what a height is above a facet's plane: two differences, and weights of three corners.
 * A distance over the ground's walls takes an eta of its own (deviation_bound.c).
 * Corners are found from their parameters alone, so that nothing adds up with depth but what the cuts leak:
 * parts may cover a little of a piece twice or not at all (deviation_cut.h), which the sums over all pieces
 * count (deviation_sum.h). A point of the face may be QM_CRACK_ROUNDINGS u S from all pieces, and a piece so
 * far from the face: one rounding of 3 sqrt(2) u in the parameters, where Q changes by 2 sqrt(6) S each, for
 * each of QM_PIECE_PARTS / 2 cuts on each of QM_PIECE_DEPTH levels, is 53,207 u S.
 */
#ifndef QM_DEVIATION_PIECE_H
#define QM_DEVIATION_PIECE_H

#include "deviation_bend.h"
#include "deviation_near.h"

/** Cuts after which a piece is cut no more. */
#define QM_PIECE_DEPTH 40
/** Parts that a piece is cut into at most. */
#define QM_PIECE_PARTS 128
#define QM_CRACK_ROUNDINGS 65536.0

typedef struct qm_source_piece {
    uint32_t face;
    uint8_t second; /* of a quad that is two triangles: (c0 c2 c3) */
    uint8_t depth;
    bool is_flat;      /* part of a triangle: of the face, or of one of the two that stand for a patch */
    double u[3], v[3]; /* on the face's patch, or weights of the second and third corner of its triangle */
} qm_source_piece;

/** What is known of a piece. Lengths are local to the target, areas times area_unit. */
typedef struct qm_piece_bounds {
    double low[3], high[3];           /* values at the corners of the linear functions; low may be negative */
    bool is_signed;                   /* the distance is the size of a number between them, */
    qm_bend bend;                     /* and between these, where bend.cells > 0 */
    double stray_low, stray_high;     /* shares of the piece where low is too high, and high too low */
    double excess;                    /* by how much high is too low at most */
    double area_low, area_high;       /* of the piece itself */
    double density_low, density_high; /* what a whole piece would have if its area were spread like there */
    double mean_low, mean_high;       /* integral of the distance */
    double square_low, square_high;   /* integral of its square */
    double blur;                      /* integral of what low and high leave open, strays included */
} qm_piece_bounds;

/** The functions of a signed piece, seen from the other side. */
static inline void qm_piece_bounds_turn(const qm_piece_bounds *bounds, double low[3], double high[3])
{
    for (int i = 0; i < 3; i++) {
        low[i] = -bounds->high[i];
        high[i] = -bounds->low[i];
    }
}

/** What the bounds of all pieces share. */
typedef struct qm_piece_maker {
    const qm_bvh *source, *target;
    const qm_kernel *kernel;
    bool source_patches, target_patches;
    double reach;       /* greatest local coordinate of either surface */
    double eta;         /* local */
    double area_unit;   /* areas are told in times this, so that no square overflows */
    double patch_error; /* what the cutting of patches may cost, local */
    double stray_error; /* what functions over a ground are opened by, so that less does not stray, local */
    double bend_error;  /* what linear functions may leave open in each cell of a height that bends, local */
    double flat_error;  /* patches of the source that are this near to their triangles, local, */
    double flat_spread; /* and whose areas differ by this share at most, are taken for them */
    double worth;       /* cuts that bring corners nearer to their facets by less are not made, local */
    int part_limit;     /* of a piece: 3 to QM_PIECE_PARTS */
    double cell_area;   /* smaller parts than this may be off by more, so that all leave alike */
} qm_piece_maker;

/** What a worker needs for each piece anew. */
typedef struct qm_piece_desk {
    uint32_t hint;     /* a pack of the target to start from */
    uint64_t searches; /* of the target's tree so far */
    qm_near_facets near;
} qm_piece_desk;

/**
 * Sets up what the bounds of a source and a target share; the settings for cuts stand for the closest ones.
 * Returns QM_OK; QM_E_ARGUMENT (the target's tree lacks what this takes); QM_E_SCALE.
 */
qm_status qm_piece_maker_init(qm_context *ctx, const qm_bvh *a, const qm_bvh *b, qm_quad_reading reading,
                              qm_piece_maker *maker);

/** The first piece of a triangle of the source: flat, or half of the parameters of a patch; second is the
 * other half of a quad. */
qm_source_piece qm_piece_first(const qm_piece_maker *maker, uint32_t face, bool second);

/** How much of the upper bound of a piece's area rounding makes. */
double qm_piece_area_rounding(const qm_piece_maker *maker, const qm_source_piece *piece);

/** Bounds a piece. */
void qm_piece_bound(const qm_piece_maker *maker, const qm_source_piece *piece, qm_piece_desk *desk,
                    qm_piece_bounds *out);

/** Bounds of a single point of weight 1 whose distance to the target is no more than this; or, to a target
 * without patches, is this to within eta. */
qm_piece_bounds qm_piece_bound_point(const qm_piece_maker *maker, const double position[3], double distance);

/**
 * Cuts a piece into parts and bounds them; returns how many, 2 to QM_PIECE_PARTS. The piece has depth to
 * spare. *leak is by how much area the parts may differ from the piece.
 *
 * A piece is cut along the borders of the facets under it, so that each part lies over one facet and on one
 * side of it, where both bounds are tight. Where no such cut brings anything it is halved across its longest
 * edge, and so is every piece on every fourth level, which brings any piece to an end.
 */
int qm_piece_split(const qm_piece_maker *maker, const qm_source_piece *piece, qm_piece_desk *desk,
                   qm_source_piece part[QM_PIECE_PARTS], qm_piece_bounds bounds[QM_PIECE_PARTS],
                   double *leak);

#endif
