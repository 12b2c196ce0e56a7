/**
 * target.h: one side of a search without a source, and distances from its target by every facet in turn.
 */
#ifndef QM_TARGET_H
#define QM_TARGET_H

#include "hausdorff/hausdorff_worker.h"

/** Sets a search that allows a distance, and its side, in the target's frame. */
void qm_target_search(qm_search *search, qm_side *side, const qm_bvh *target, double allowed);

/** Distance of a point from the triangles of a target, both local. */
double qm_target_distance(const qm_bvh *target, qm_vec p);

#endif
