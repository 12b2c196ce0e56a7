/**
 * deviation_regions.h: the connected parts of the source that are, or may be, farther from the target than a limit.
 *
 * A piece whose greatest distance is no more than the limit has no point beyond. The others may, and a connected set of points beyond
 * the limit is covered by pieces of which each touches another: it lies in one component of the graph of touching pieces. A piece whose
 * least distance is above the limit is beyond as a whole, so that touching ones are parts of one connected set.
 *
 * Cuts are rounded, so that neighbours may be a crack apart (deviation_piece.h), and points in the crack are a crack farther than a piece.
 * Pieces touch when they are no more than JOINT apart, which is more than a crack; the limit is lowered by as much for what may be
 * beyond, and raised for what surely is.
 */
#ifndef QM_DEVIATION_REGIONS_H
#define QM_DEVIATION_REGIONS_H

#include "deviation_refine.h"

/**
 * Cuts pieces on both sides of the limit until little of the surface is in them, and sets the regions of *out, whose max is known.
 *
 * Returns QM_OK; QM_E_CANCELED, and has_regions is not set; QM_E_NO_MEMORY.
 */
qm_status qm_deviation_regions_find(qm_refinement *pieces, const qm_deviation_options *options,
                                    qm_deviation *out);

#endif
