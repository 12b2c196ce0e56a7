/**
 * deviation_cut.h: where a piece is cut: along the borders of the facets under it.
 *
 * A new corner is rounded and lies beside the edge that it is on, so that a sliver of the piece is in no
 * part, or in one and in its neighbour too. A coordinate is found by a difference, a product and a sum of
 * numbers of 1 at most: off by 3 u. With l the sum of the edge's extents in both parameters, the sliver has
 * an area of at most l 3 sqrt(2) u / 2 < 4 u l. Besides, a thin part may have turned round, and then counts
 * twice as much as it is large too much. leak is the sum of both: by so much area of parameters the parts may
 * differ from the piece. A middle that is not rounded leaks nothing. As outlines and parts of them are what
 * their corners say, cuts of cuts add up likewise.
 */
#ifndef QM_DEVIATION_CUT_H
#define QM_DEVIATION_CUT_H

#include "deviation_shape.h"

/**
 * Cuts a piece by the facets of a list until each part has one facet that is, at all of its corners, within
 * maker->worth of being the nearest. Returns how many parts, 1 when no cut is worth it; adds to *leak.
 */
int qm_piece_cut_by_facets(const qm_piece_maker *maker, const qm_piece_face *face,
                           const qm_source_piece *piece, const qm_near_facets *near,
                           qm_source_piece part[QM_PIECE_PARTS], double *leak);

/** Halves a piece across its longest edge; adds to *leak. */
void qm_piece_halve(const qm_piece_shape *shape, const qm_source_piece *piece, qm_source_piece part[2],
                    double *leak);

#endif
