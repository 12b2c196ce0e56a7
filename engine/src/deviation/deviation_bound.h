/**
 * deviation_bound.h: the two linear functions of a piece, from the facets near it (deviation_piece.h has the
 * proofs).
 */
#ifndef QM_DEVIATION_BOUND_H
#define QM_DEVIATION_BOUND_H

#include "deviation_shape.h"

/** The reach at which a list of facets is complete for a piece whose middle is this far from the target. */
static inline double qm_piece_reach(const qm_piece_maker *maker, const qm_piece_shape *shape, double distance)
{
    return distance + 2.0 * (shape->radius + shape->slack) + 8.0 * maker->eta;
}

/** Searches the target for its distance from a point: an upper bound, and a lower one through *certain. */
double qm_piece_search(const qm_piece_maker *maker, qm_piece_desk *desk, qm_vec p, double *certain);

/** Lists the facets near a piece on the desk. */
void qm_piece_list_near(const qm_piece_maker *maker, const qm_piece_shape *shape, qm_piece_desk *desk);

/** Bounds a piece by a list on the desk that was made for it, or, when complete, for one that it is part
 * of. */
void qm_piece_bound_near(const qm_piece_maker *maker, const qm_piece_face *face, const qm_source_piece *piece,
                         const qm_piece_shape *shape, qm_piece_desk *desk, qm_piece_bounds *out);

#endif
