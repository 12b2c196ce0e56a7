/**
 * hausdorff_exact.h: a proof that a surface is within a distance of another one, without any rounding, for distances
 * that lie exactly at a limit: copies whose faces are in another order, and shifted copies.
 */
#ifndef QM_HAUSDORFF_EXACT_H
#define QM_HAUSDORFF_EXACT_H

#include "qm/hausdorff.h"

/**
 * Tries to prove that all points of the source are within the limit of the target. The proof needs, for each face, one
 * facet of the target that all of its corners are near to; a surface may be within the limit without one, so that false
 * proves nothing. It fails at the first face without such a facet, and takes a search and some exact tests for each of the others, as a rule.
 *
 * limit     >= 0, unit of the meshes
 * until_ms  when to give up, by the engine's clock; INFINITY: never
 *
 * Returns QM_OK; QM_E_CANCELED, and *is_proven is false.
 */
qm_status qm_hausdorff_prove_within(qm_context *ctx, const qm_bvh *source, const qm_bvh *target,
                                    qm_quad_reading reading, double limit, double until_ms, bool *is_proven);

#endif
