/**
 * deviation_shape.h: a piece of the source in the local space of the target: where its corners are, how far
 * it may be from the triangle between them, and how its area is spread.
 *
 * Triangles that stand for a patch. Let n be a unit vector, along which the corners' heights have a range of
 * g, and let N.n be at least j > 0 at the corners of the patch, N = Q_s x Q_t: as it is linear it is so
 * everywhere. Then the quad is convex in a view along n, and there patch and triangles fill it, over each of
 * its points once, both between the lowest and the highest corner: they are g apart at most. Q_s and Q_t
 * change the height by g at most, so that N has no more than e = g (|Q_s| + |Q_t|) at a right angle to n, and
 * |N| is between N.n and N.n + e^2 / (2 j). The doubled area of either triangle is |N| at a corner. So areas
 * over any part of the view are between that of the view and 1 + k times as much, k = e^2 / (2 j^2), and
 * those of patch and triangle differ from one another by no more than such a factor.
 */
#ifndef QM_DEVIATION_SHAPE_H
#define QM_DEVIATION_SHAPE_H

#include "deviation_piece.h"
#include "prim/bilinear_point.h"

/** The face that a piece lies on: a patch, or the flat triangle that the piece is on. */
typedef struct qm_piece_face {
    bool is_patch;
    qm_vec corner[4];  /* three of a flat triangle */
    qm_bilinear patch; /* of a patch only */
    double slack;      /* how far a patch may be from the triangle that stands for it, */
    double spread;     /* and by what share their areas may differ */
} qm_piece_face;

typedef struct qm_piece_shape {
    qm_vec corner[3], middle;
    double radius, longest2; /* greatest distance of a corner from the middle; longest edge squared */
    double slack;            /* how far the piece may be from its flat triangle */
    /* Areas that the whole piece would have if it were spread as at its corners, from below and above. */
    double low[3], high[3];
    bool is_uniform; /* spread alike everywhere */
    double rounding; /* of the area that high stands for */
} qm_piece_shape;

/** True when pieces of a face are flat: of a triangle, or of a patch that its triangles stand for. */
bool qm_piece_face_is_flat(const qm_piece_maker *maker, uint32_t face);

qm_piece_face qm_piece_face_load(const qm_piece_maker *maker, const qm_source_piece *piece);

/** Twice the area of a piece in its parameters, by which error it may be off. Negative when its corners have
 * turned round. */
double qm_piece_parameter_area2(const qm_source_piece *piece, double *error);

/** The most area that a face has for an area of its parameters. */
double qm_piece_face_density(const qm_piece_maker *maker, const qm_piece_face *face);

/** The point of the face at parameters of the piece. */
qm_vec qm_piece_face_at(const qm_piece_face *face, double u, double v);

qm_piece_shape qm_piece_shape_make(const qm_piece_maker *maker, const qm_piece_face *face,
                                   const qm_source_piece *piece);

#endif
