/**
 * deviation_worst.h: the places that are farthest from the target, apart by a radius.
 */
#ifndef QM_DEVIATION_WORST_H
#define QM_DEVIATION_WORST_H

#include "deviation_refine.h"

/**
 * Sets out->worst: the witness of the maximum, then one place after the other, each the farthest that the search finds
 * among the points that are more than the radius from all places before it.
 *
 * work     as it was left by the rounds; its counts of searches grow
 * is_used  NULL: the places are on pieces; else on the vertices that it marks
 * found    a search for the maximum, with a witness
 *
 * Returns QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED, and there are no places.
 */
qm_status qm_deviation_find_worst(qm_refinement *work, const qm_deviation_options *options,
                                  const uint8_t *is_used, const qm_hausdorff_result *found,
                                  qm_deviation *out);

#endif
