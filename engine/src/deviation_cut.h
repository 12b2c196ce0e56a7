/**
 * deviation_cut.h: where a piece is cut: along the borders of the facets under it.
 */
#ifndef QM_DEVIATION_CUT_H
#define QM_DEVIATION_CUT_H

#include "deviation_shape.h"

/**
 * Cuts a piece by the facets of a list until each part has one facet that is, at all of its corners, within
 * maker->worth of being the nearest. Returns how many parts, 1 when no cut is worth it.
 */
int qm_piece_cut_by_facets(const qm_piece_maker *maker, const qm_piece_face *face,
                           const qm_source_piece *piece, const qm_near_facets *near,
                           qm_source_piece part[QM_PIECE_PARTS]);

/** Halves a piece across its longest edge. */
void qm_piece_halve(const qm_piece_shape *shape, const qm_source_piece *piece, qm_source_piece part[2]);

#endif
