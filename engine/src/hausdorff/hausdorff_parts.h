/**
 * hausdorff_parts.h: a search that begins with parts of the sources, and returns the parts that it has left.
 */
#ifndef QM_HAUSDORFF_PARTS_H
#define QM_HAUSDORFF_PARTS_H

#include "hausdorff_worker.h"

/** QM_E_ARGUMENT when the trees do not have a part of the search, or a bound is not a number of 0 or more. */
qm_status qm_parts_check(qm_context *ctx, const qm_search *search);

/** Queues the parts that the search begins with. */
void qm_parts_queue(qm_search *search);

/** Gives the caller the parts that are left when all workers have ended. */
void qm_parts_give_rest(const qm_search *search);

#endif
