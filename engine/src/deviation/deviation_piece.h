/**
 * deviation_piece.h: a piece of the source, and two linear functions between which its distance to the target
 * lies. This is the internal header of the folder:
 *   deviation.c            the call: vertices, pieces or points, the maximum, the result
 *   deviation_refine.c     the rounds: which pieces are cut next
 *   deviation_survey.c     totals, maximum and coarse distribution from the bounds of all pieces
 *   deviation_sum.c        percentiles and histogram
 *   deviation_limits.c     shares within limits
 *   deviation_worst.c      the worst places, apart by a radius
 *   comparison.c           both directions, and the figures that join them
 *   deviation_piece.c      the shape of a piece; how one is bounded and split
 *   deviation_bound.c      its two functions
 *   deviation_cut.c        where it is cut
 *   deviation_facets.c     the facets of the target near it
 *   deviation_feature.c    distances from edges and vertices
 *   deviation_match.c      a piece matched to a bilinear patch
 *   deviation_quadratic.c  heights over a patch, which are quadratic
 *   deviation_integral.c   integrals of both functions
 *   deviation_sides.c      on which side of the target each piece is, and signed figures
 *   heatmap.c              pieces with the distance at their corners
 *   deviation_regions.c    connected parts of the source beyond a limit
 *   deviation_normals.c    the side by normals, of a target that bounds no solid
 *
 * Words (engine/DEVIATION.md has the whole):
 *   piece      a triangle of parameters on a face of the source; part: a piece that a cut makes of another
 *   base       the facet, or the patch, of the target under the piece's centroid: heights are taken over it
 *   height     the signed distance of a point from the base's plane or surface
 *   loss       by how much the distance may be below the height, since another facet is nearer
 *   excess     by how much the distance may be above the height, since the point lies beside the base
 *   invalid    a share of the piece where a function is no bound, because of loss or excess
 *   blur       the integral of the width between both functions, invalid shares included
 *   leak       the area by which rounded cuts may cover a piece twice, or not at all
 *   slack      how far a flat triangle may be from the patch that it stands for
 *   crack      how far a point of the face may be from all pieces, by rounding
 *   mild       (of a rectangle of a target patch) so little bent that matches hold
 *   worth      the gain that a cut must bring: how much farther than the nearest facet a corner's may be
 *
 * A piece is a triangle of parameters on a face of the source. On a flat face it is a triangle P with corners
 * p_i. On a bilinear patch the point of parameters l (barycentric in the piece) is within
 * slack = |w| ds dt / 4 of sum l_i p_i, so that bounds over the flat triangle hold over the piece when they
 * are widened by slack.
 *
 * A patch that bends little is replaced by its two triangles (c0 c1 c2) and (c0 c2 c3), by the last section
 * here: a piece is a flat part of one of them, and its bounds hold for the part of the patch over it, which
 * is within slack. Parameters of the patch would give worse bounds even where it is flat: w, which then lies
 * in its plane, would count as slack.
 *
 * Let T be a facet of the target B, and d the distance to B.
 *
 * Upper. d <= d(., T), which is convex because T is. So over P: d <= the linear function with the values
 * d(p_i, T). Any T will do; the one with the least mean is taken. d(c, B) + r, with c and r as below, is a
 * bound too.
 *
 * Lower, by facets. Let c be the centroid of P, r = max |p_i - c|. The nearest facet of any p of P has
 * d(c, T) <= d(p, T) + r <= d(c, B) + 2 r. So d = min d(., T_k) over the facets within that ball, once all of
 * them are known (deviation_facets.h). Each takes part with a linear function below its distance:
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
 * Both, over the base. Let T be the facet under c, and h the height over its plane, which is the distance
 * where P lies over T and no other facet is nearer. A linear bound by corners carries its error at one corner
 * over all of P, and near a surface P often sticks out over an edge of T by a little. So |h| is integrated,
 * together with its error in the part of P where it has one, and the share of that part:
 *     d <= |h| + o, o the distance from T within its plane;
 *     d >= |h| - sum max(|h| - g_k, 0) over the other facets, on each side of T by itself, g_k a linear
 *         function below the distance to the k-th.
 * Integrals and shares of the positive part of a linear function are known in closed form. h may change its
 * sign: d is then the absolute value of a number near h, and a surface that passes through T need not be cut
 * there.
 *
 * Of a piece of a patch h is quadratic in l, with the heights of the piece's Bezier points as coefficients.
 * So are g_k where it is the height over a plane, and f_k and e_k below; the loss |h| - g_k has the
 * differences of the coefficients, and each is bounded by a linear function above it. No slack is added.
 *
 * For o, let f_k be how far a point lies beyond the plane on edge k of T, and a the least angle of T. Then
 *     o sin a <= sum max(f_k, 0).
 * Where an edge is nearest, o is its f_k. Where a corner of angle b is, p - corner lies between the normals
 * of its edges, at an angle t from the one and pi - b - t from the other, with f = o cos t and
 * o cos(pi - b - t). As long as both are positive their sum is concave in t, so least where one is 0 and the
 * other o sin b; where one is negative the other is at least o sin b. Where b is obtuse both are positive,
 * and 0 <= t <= pi - b makes the sum least at an end: o (1 - cos b) >= o.
 *
 * Near a sharp corner that is far too large for points along an edge. With e_k how far the point is past
 * the ends of edge k, along it, o is no more than f_k + e_k for any f_k > 0, by way of the edge's line.
 *
 * Lower, by corners. d^2(p) - |p|^2 = min over b in B of |b|^2 - 2 b p is concave, so that
 *     d^2(sum l_i p_i) >= sum l_i d_i^2 - sum_{i<j} l_i l_j |p_i - p_j|^2 >= sum l_i (d_i^2 - e^2 / 3),
 * e the longest edge, as sum_{i<j} l_i l_j <= 1 / 3. Where all d_i^2 >= e^2 / 3 the root, being concave, is
 * at least the linear function with the values sqrt(d_i^2 - e^2 / 3). Good where the surfaces are far apart.
 * At the centroid of an equilateral piece over a single point it is the distance itself, 0 when they touch:
 * the d_i are reduced by eta before the root, which would turn an error of eta into sqrt(2 d eta).
 *
 * Lower, by the centroid. d >= d(c, B) - r, a constant.
 *
 * A plane patch of a target is two facets, and the edge between them counts as one beyond which the distance exceeds the
 * height. A piece of a patch bends across it; where the piece is near, the plane patch is one rectangle (is_plane) instead.
 *
 * Facets of a bilinear target stand for rectangles of its patches, within a slack by which their bounds are
 * widened. A mild rectangle is bounded as a patch instead: the height is then that over the patch itself
 * (deviation_match.h), and neither it nor the piece is replaced by triangles.
 *
 * Roundings. Both functions are widened by eta = 384 u S, S the greatest local coordinate. Of that
 *     256 are for a distance or height from a computed point, with the change of both surfaces to local space
 *         (rounding.h);
 *     42 for a corner of a piece. On a flat face (1 - u - v) c0 + u c1 + v c2 is off by 5 u S in each
 *     coordinate: the first weight by 2 u, and each term goes through 3 roundings at most. On a patch
 *     Q_s = e1 + t w is off by 16 u S (e1 2, w 8, product 4, sum 2), s Q_s by 2 more, o + t e2 by 5, and the
 *     sum by 1: 24 sqrt(3) in all;
 *     6 for the slack of a source's patch: w is off by 12 u S in each coordinate, a quarter of it counts. A
 *     Bezier point, which needs no slack, is off by 49, one more than both;
 *     54 for a corner of a rectangle of a target's patch: at most 31 midpoints of midpoints, 1 u S each;
 *     24 for a height above a facet's plane: two differences, and weights of three corners.
 * A distance beyond the base's edges takes an eta of its own (deviation_bound.c).
 * Corners are found from their parameters alone, so that nothing adds up with depth but the leak of the cuts:
 * parts may cover a little of a piece twice or not at all (deviation_cut.c), which the sums over all pieces
 * count (deviation_survey.h). A point of the face may be QM_CRACK_ROUNDINGS u S from all pieces, and a piece so
 * far from the face: one rounding of 3 sqrt(2) u in the parameters, where Q changes by 2 sqrt(6) S each, for
 * each of QM_DEVIATION_PARTS / 2 cuts on each of QM_DEVIATION_DEPTH levels, is 53,207 u S.
 *
 * Triangles that replace a patch. Let n be a unit vector, along which the corners' heights have a range of
 * g, and let N.n be at least j > 0 at the corners of the patch, N = Q_s x Q_t: as it is linear it is so
 * everywhere. Then the quad is convex in a view along n, and there patch and triangles fill it, over each of
 * its points once, both between the lowest and the highest corner: they are g apart at most. Q_s and Q_t
 * change the height by g at most, so that N has no more than e = g (|Q_s| + |Q_t|) at a right angle to n, and
 * |N| is between N.n and N.n + e^2 / (2 j). The doubled area of either triangle is |N| at a corner. So areas
 * over any part of the view are between that of the view and 1 + k times as much, k = e^2 / (2 j^2), and
 * those of patch and triangle differ from one another by no more than such a factor.
 */
#ifndef QM_DEVIATION_PIECE_H
#define QM_DEVIATION_PIECE_H

#include "deviation_facets.h"
#include "deviation_quadratic.h"
#include "prim/bilinear.h"
#include "qm/project.h"

/** Cuts after which a piece is cut no more. */
#define QM_DEVIATION_DEPTH 40
/** Parts that a piece is cut into at most. */
#define QM_DEVIATION_PARTS 128
#define QM_CRACK_ROUNDINGS 65536.0

typedef struct qm_deviation_piece {
    uint32_t face;
    uint8_t second; /* 1: the triangle (c0 c2 c3) of a quad that is two triangles */
    uint8_t depth;
    bool is_flat;      /* part of a triangle: of the face, or of one of the two that stand for a patch */
    double u[3], v[3]; /* on the face's patch, or weights of the second and third corner of its triangle */
} qm_deviation_piece;

/** The bounds of a piece. Lengths are local to the target, areas times area_unit. */
typedef struct qm_deviation_bounds {
    double low[3], high[3];           /* values at the corners of the linear functions; low may be negative */
    bool is_signed;                   /* the distance is the absolute value of a number between them, */
    qm_quadratic bend;                /* and between these, where bend.cells > 0 */
    double invalid_low, invalid_high; /* shares of the piece where low is too high, and high too low */
    double excess;                    /* by how much high is too low at most */
    double least, most;               /* no distance is less, or greater */
    double area_low, area_high;       /* of the piece itself */
    double density_low, density_high; /* area of the whole piece at the lowest and highest density */
    double mean_low, mean_high;       /* integral of the distance */
    double square_low, square_high;   /* integral of its square */
    double blur; /* integral of the width between low and high, invalid shares included */
} qm_deviation_bounds;

/** The functions of a signed piece, seen from the other side. */
static inline void qm_deviation_bounds_flip(const qm_deviation_bounds *bounds, double low[3], double high[3])
{
    for (int i = 0; i < 3; i++) {
        low[i] = -bounds->high[i];
        high[i] = -bounds->low[i];
    }
}

/** A lower bound of the distance at a corner, of a piece without an invalid share of low. */
static inline double qm_deviation_bounds_corner_least(const qm_deviation_bounds *bounds, int corner)
{
    double low = bounds->low[corner];
    return bounds->is_signed ? qm_max(low, -bounds->high[corner]) : low;
}

/** The data and settings that the bounds of all pieces share. */
typedef struct qm_deviation_setup {
    const qm_bvh *source, *target;
    const qm_kernel *kernel;
    bool source_patches, target_patches;
    double extent;      /* greatest local coordinate of either surface */
    double eta;         /* local */
    double area_unit;   /* areas are multiplied by it, so that no square overflows */
    double patch_error; /* flatness bound below which the target's patches are not cut, local */
    double base_margin; /* widens functions over a base: a smaller loss is no invalid share, local */
    double bend_error;  /* linear error that each cell of a quadratic height may have, local */
    double flat_error;  /* patches of the source this near to their triangles, local, */
    double flat_spread; /* and whose areas differ by this share at most, are replaced by them */
    double worth;       /* a cut must bring a corner this much nearer to its facet, local */
    int part_limit;     /* of a piece: 3 to QM_DEVIATION_PARTS */
    double cell_area;   /* smaller parts need a greater gain, so that all contribute alike to the width */
} qm_deviation_setup;

/** A worker's memory for one piece after the other. */
typedef struct qm_deviation_workspace {
    uint32_t hint;     /* a pack of the target to start from */
    uint64_t searches; /* of the target's tree, so far */
    qm_deviation_facets near;
} qm_deviation_workspace;

/**
 * Sets up the data of a source and a target; the settings for cuts are the most accurate ones. Returns QM_OK;
 * QM_E_ARGUMENT (the tree of the target was built without the data of a target); QM_E_SCALE.
 */
qm_status qm_deviation_setup_init(qm_context *ctx, const qm_bvh *a, const qm_bvh *b, qm_quad_reading reading,
                                  qm_deviation_setup *setup);

/** The first piece of a triangle of the source: flat, or half of the parameters of a patch; second is the
 * other half of a quad. */
qm_deviation_piece qm_deviation_piece_first(const qm_deviation_setup *setup, uint32_t face, bool second);

/** Parameters of a face as mesh.h has them, for those of one of its pieces: a triangle of a quad is half of its square. */
void qm_deviation_piece_parameters(const qm_deviation_setup *setup, const qm_deviation_piece *piece, double u,
                                   double v, double uv[2]);

/** The local point of a piece at its own parameters, and what it is as a point of the source. */
qm_vec qm_deviation_piece_point(const qm_deviation_setup *setup, const qm_deviation_piece *piece, double u,
                                double v, qm_surface_point *out);

/** The point of the target that is nearest to a local one. */
qm_surface_point qm_deviation_foot(const qm_deviation_setup *setup, qm_quad_reading quads, qm_vec p);

/** How much of the upper bound of a piece's area rounding makes. */
double qm_deviation_piece_area_rounding(const qm_deviation_setup *setup, const qm_deviation_piece *piece);

/** Bounds a piece. */
void qm_deviation_piece_bound(const qm_deviation_setup *setup, const qm_deviation_piece *piece,
                              qm_deviation_workspace *workspace, qm_deviation_bounds *out);

/** The values at the corners of two linear functions between which the distance lies everywhere on a piece; low may be negative. */
void qm_deviation_piece_envelope(const qm_deviation_setup *setup, const qm_deviation_piece *piece,
                                 qm_deviation_workspace *workspace, double low[3], double high[3]);

/** Bounds of a single point of weight 1 whose distance to the target is no more than this; or, to a target
 * without patches, is this to within eta. */
qm_deviation_bounds qm_deviation_point_bound(const qm_deviation_setup *setup, const double position[3],
                                             double distance);

/**
 * Cuts a piece into parts and bounds them; returns how many, 2 to QM_DEVIATION_PARTS. The piece has depth to
 * spare. *leak is by how much area the parts may differ from the piece.
 *
 * A piece is cut along the borders of the facets under it, so that each part lies over one facet and on one
 * side of it, where both bounds are tight. Where no such cut brings anything it is halved across its longest
 * edge, and so is every piece on every fourth level, which brings any piece to an end.
 */
int qm_deviation_piece_split(const qm_deviation_setup *setup, const qm_deviation_piece *piece,
                             qm_deviation_workspace *workspace, qm_deviation_piece part[QM_DEVIATION_PARTS],
                             qm_deviation_bounds bounds[QM_DEVIATION_PARTS], double *leak);

/* ---- shape: deviation_piece.c ---- */

/** The face that a piece lies on: a patch, or the flat triangle that the piece is on. */
typedef struct qm_deviation_face {
    bool is_patch;
    qm_vec corner[4];  /* three of a flat triangle */
    qm_bilinear patch; /* of a patch only */
    double slack;      /* how far a patch may be from the triangle that stands for it, */
    double spread;     /* and the share by which their areas may differ */
} qm_deviation_face;

typedef struct qm_deviation_shape {
    qm_vec corner[3], centroid;
    double radius, longest2; /* greatest distance of a corner from the centroid; longest edge squared */
    double slack;            /* how far the piece may be from its flat triangle */
    /* Areas that the whole piece would have if it were spread as at its corners, from below and above. */
    double low[3], high[3];
    bool is_uniform; /* spread alike everywhere */
    double rounding; /* of the area that high stands for */
} qm_deviation_shape;

/** True when pieces of a face are flat: of a triangle, or of a patch that its triangles stand for. */
bool qm_deviation_face_is_flat(const qm_deviation_setup *setup, uint32_t face);

qm_deviation_face qm_deviation_face_load(const qm_deviation_setup *setup, const qm_deviation_piece *piece);

/** Twice the area of a piece in its parameters, by which error it may be off. Negative when its corners have
 * turned round. */
double qm_deviation_parameter_area2(const qm_deviation_piece *piece, double *error);

/** The most area that a face has for an area of its parameters. */
double qm_deviation_face_density(const qm_deviation_setup *setup, const qm_deviation_face *face);

/** The point of the face at parameters of the piece. */
qm_vec qm_deviation_face_at(const qm_deviation_face *face, double u, double v);

/** The Bezier points of a piece: 00 11 22, its corners, then 01 12 20; a linear function of its points has its
 * values there as coefficients. */
void qm_deviation_piece_coefficients(const qm_deviation_face *face, const qm_deviation_piece *piece,
                                     qm_vec at[6]);

qm_deviation_shape qm_deviation_shape_make(const qm_deviation_setup *setup, const qm_deviation_face *face,
                                           const qm_deviation_piece *piece);

/* ---- bounds: deviation_bound.c ---- */

/** The radius within which a list of facets must be complete for a piece whose centroid is this far from the
 * target. */
static inline double qm_deviation_search_radius(const qm_deviation_setup *setup,
                                                const qm_deviation_shape *shape, double distance)
{
    return distance + 2.0 * (shape->radius + shape->slack) + 8.0 * setup->eta;
}

/** Searches the target for its distance from a point: an upper bound, and a lower one through *certain. */
double qm_deviation_search(const qm_deviation_setup *setup, qm_deviation_workspace *workspace, qm_vec p,
                           double *certain);

/** Lists the facets near a piece on the workspace; those of mild rectangles as they are, unless cuts_all. */
void qm_deviation_list_facets(const qm_deviation_setup *setup, const qm_deviation_shape *shape, bool cuts_all,
                              qm_deviation_workspace *workspace);

/** Bounds a piece by a list on the workspace that was made for it, or, when complete, for one that it is part
 * of. */
void qm_deviation_piece_bound_near(const qm_deviation_setup *setup, const qm_deviation_face *face,
                                   const qm_deviation_piece *piece, const qm_deviation_shape *shape,
                                   qm_deviation_workspace *workspace, qm_deviation_bounds *out);

/* ---- cuts: deviation_cut.c ---- */

/**
 * Cuts a piece by the facets of a list, or the patches that they are of, until each part has one that is, at all
 * of its corners, within setup->worth of being the nearest. Returns how many parts, 1 when no cut is worth it; adds to *leak.
 */
int qm_deviation_piece_cut(const qm_deviation_setup *setup, const qm_deviation_face *face,
                           const qm_deviation_piece *piece, const qm_deviation_facets *near,
                           qm_deviation_piece part[QM_DEVIATION_PARTS], double *leak);

/** Halves a piece across its longest edge; adds to *leak. */
void qm_deviation_piece_halve(const qm_deviation_shape *shape, const qm_deviation_piece *piece,
                              qm_deviation_piece part[2], double *leak);

#endif
