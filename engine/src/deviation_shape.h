/**
 * deviation_shape.h: a piece of the source in the local space of the target: where its corners are, how far
 * it may be from the triangle between them, and how its area is spread.
 */
#ifndef QM_DEVIATION_SHAPE_H
#define QM_DEVIATION_SHAPE_H

#include "bilinear_point.h"
#include "deviation_piece.h"

/** The face that a piece lies on: a patch, or the flat triangle that the piece is on. */
typedef struct qm_piece_face {
    bool is_patch;
    qm_vec corner[4]; /* three of a flat triangle */
    qm_patch patch;   /* of a patch only */
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
