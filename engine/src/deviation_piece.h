/**
 * deviation_piece.h: two linear functions that hold the distance to a target between them over a piece of the
 * source.
 *
 * A piece is a triangle of parameters on a face of the source. On a flat face it is a triangle P with corners
 * p_i. On a bilinear patch the point of parameters l (barycentric in the piece) is within slack = |w| ds dt /
 * 4 of sum l_i p_i, so that bounds over the flat triangle hold over the piece when opened by slack.
 *
 * Let T be a facet of the target B, and d the distance to B.
 *
 * Upper. d <= d(., T), which is convex because T is. So over P: d <= the linear function with the values
 * d(p_i, T). Any T will do; the one with the least mean is taken. The maximum over all of the source is a
 * bound too.
 *
 * Lower, by facets. Let c be the middle of P, r = max |p_i - c|. The nearest facet of any p of P has d(c, T)
 * <= d(p, T) + r <= d(c, B) + 2 r. So d = min d(., T_k) over the facets within that ball, once all of them
 * are known (deviation_near.h). Each takes part with a linear function below its distance:
 *     the height over its plane, on the side of c: the distance to a plane is no more than that to T;
 *     g p - max g t over the corners t of T, g a unit vector: T lies behind the plane at a right angle to g
 *     through its corner that is farthest along g. With g the direction from the foot of a point x to x it is
 *     d(x, T) itself at x, as T is convex; a rounded g costs as little as it is off, and proves as much.
 * The least of linear functions is concave, so it is at least the linear function with its values at the
 * corners. A facet with d(c, T) - r >= m, where the least of the others is at most m at every corner, changes
 * nothing there and is left out.
 *
 * Lower, by corners. d^2(p) - |p|^2 = min over b in B of |b|^2 - 2 b p is concave, so that
 *     d^2(sum l_i p_i) >= sum l_i d_i^2 - sum_{i<j} l_i l_j |p_i - p_j|^2 >= sum l_i (d_i^2 - e^2 / 3),
 * e the longest edge, as sum_{i<j} l_i l_j <= 1 / 3. Where all d_i^2 >= e^2 / 3 the root, being concave, is
 * at least the linear function with the values sqrt(d_i^2 - e^2 / 3). Good where the surfaces are far apart.
 *
 * Lower, by the middle. d >= d(c, B) - r, a constant.
 *
 * Facets of a bilinear target stand for rectangles of its patches, within a slack by which their bounds are
 * opened.
 *
 * Roundings: every distance and height is off by at most eta (hausdorff.c), by which both functions are
 * opened.
 */
#ifndef QM_DEVIATION_PIECE_H
#define QM_DEVIATION_PIECE_H

#include "deviation_near.h"

/** Cuts after which a piece is cut no more. */
#define QM_PIECE_DEPTH 40
/** Parts that a piece is cut into at most. */
#define QM_PIECE_PARTS 128

typedef struct qm_source_piece {
    uint32_t face;
    uint8_t second; /* of a flat quad: the triangle (c0 c2 c3) */
    uint8_t depth;
    double u[3], v[3]; /* on the face's patch, or weights of the second and third corner of its triangle */
} qm_source_piece;

/** What is known of a piece. Areas and integrals are in local units of the target. */
typedef struct qm_piece_bounds {
    double low[3], high[3];           /* values at the corners of the linear functions; low may be negative */
    double area_low, area_high;       /* of the piece itself */
    double density_low, density_high; /* what a whole piece would have if its area were spread like there */
    double mean_low, mean_high;       /* integral of the distance */
    double square_low, square_high;   /* integral of its square */
} qm_piece_bounds;

/** What the bounds of all pieces share. */
typedef struct qm_piece_maker {
    const qm_bvh *source, *target;
    const qm_kernel *kernel;
    bool source_patches, target_patches;
    double reach;       /* greatest local coordinate of either surface */
    double eta;         /* local */
    double greatest;    /* no point of the source is farther from the target */
    double patch_error; /* what the cutting of patches may cost, local */
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

/** Bounds a piece. */
void qm_piece_bound(const qm_piece_maker *maker, const qm_source_piece *piece, qm_piece_desk *desk,
                    qm_piece_bounds *out);

/** Bounds of a single point of weight 1, at a distance known to within eta. */
qm_piece_bounds qm_piece_bound_point(double distance, double eta);

/**
 * Cuts a piece into parts and bounds them; returns how many, 2 to QM_PIECE_PARTS. The piece has depth to
 * spare.
 *
 * A piece is cut along the borders of the facets under it, so that each part lies over one facet and on one
 * side of it, where both bounds are tight. Where no such cut brings anything it is halved across its longest
 * edge, and so is every piece on every fourth level, which brings any piece to an end.
 */
int qm_piece_split(const qm_piece_maker *maker, const qm_source_piece *piece, qm_piece_desk *desk,
                   qm_source_piece part[QM_PIECE_PARTS], qm_piece_bounds bounds[QM_PIECE_PARTS]);

#endif
