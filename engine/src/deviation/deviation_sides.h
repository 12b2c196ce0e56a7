/**
 * deviation_sides.h: on which side of the target each piece lies, and what follows: the signed mean, the shares in bands of signed
 * distances, and the greatest distance on each side.
 *
 * A piece with a least distance above 0 does not meet the target. A connected set that does not meet it is on one side, so that one
 * point tells the side of the piece. Its computed coordinates, and those of the target, are rounded; the least distance is a lower
 * bound for computed points less eta, which is more than both move (winding.h).
 *
 * Two points that are nearer to one another than the one is to the target are on one side: the segment between them does not
 * reach it. As pieces follow their neighbours, most take the side of the piece before.
 *
 * Pieces whose least distance is not above 0 are open. They are cut until little of the surface is in them, or they are no farther
 * from the target than the accuracy.
 */
#ifndef QM_DEVIATION_SIDES_H
#define QM_DEVIATION_SIDES_H

#include "deviation_normals.h"
#include "deviation_refine.h"

/** Sides of pieces. */
enum { QM_PIECE_BEHIND = -1, QM_PIECE_OPEN = 0, QM_PIECE_FRONT = 1, QM_PIECE_UNKNOWN = 2 };

typedef struct qm_deviation_sides {
    qm_refinement *pieces;
    const qm_deviation_options *options;
    bool has_points;              /* the pieces are points, with no parts: those of point */
    const uint32_t *point;        /* the vertex of each */
    qm_deviation_normals normals; /* of NORMAL only */
    int8_t *side;                 /* of each piece, capacity of them allocated */
    size_t capacity;
} qm_deviation_sides;

/** Intervals that hold before anything is known of sides, by the unsigned ones. Returns QM_OK or QM_E_NO_MEMORY. */
qm_status qm_deviation_sides_init(qm_context *ctx, const qm_deviation_options *options, qm_deviation *out);

/**
 * Finds the sides of all pieces, cuts those that are open, and sets the signed figures of *out, whose max is known. sides has its
 * first four members set, the rest zero.
 *
 * Returns QM_OK; QM_E_CANCELED, and the figures hold; QM_E_NO_MEMORY; QM_E_NOT_CLOSED (see qm_deviation_normals_init).
 */
qm_status qm_deviation_sides_measure(qm_deviation_sides *sides, qm_deviation *out);

void qm_deviation_sides_reset(qm_deviation_sides *sides);

#endif
