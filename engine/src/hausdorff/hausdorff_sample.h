/**
 * hausdorff_sample.h: distances of single points: upper bounds, and samples, which raise the lower bound.
 */
#ifndef QM_HAUSDORFF_SAMPLE_H
#define QM_HAUSDORFF_SAMPLE_H

#include "hausdorff_worker.h"

/** A point of a pack of the source, in local space: the centre of a face halfway along the pack. */
qm_vec qm_sample_pack_centre(const qm_side *side, uint32_t pack, uint32_t *face);

/** Upper bound (local) of the distance of p, by the triangles of one pack of the target alone. */
double qm_sample_pack_upper(const qm_kernel *kernel, const qm_side *side, uint32_t pack, qm_vec p);

/**
 * Upper bound (local) of the distance of p by one search in single precision that starts at the pack hint;
 * hint becomes the pack found. The search ends as soon as the bound is at most enough. Where the twist leaves
 * it open whether p is within reach, the patch found is measured.
 */
double qm_sample_upper(const qm_kernel *kernel, const qm_side *side, qm_vec p, double enough, double reach,
                       uint32_t *hint);

/**
 * Upper bound of the distance of p, as qm_sample_upper. A point that this worker has searched for recently,
 * for as much, is not searched for again: over many copies of one face each search visits all of them, and the
 * copies of a source have the same few points.
 */
double qm_sample_known_upper(qm_worker *worker, const qm_side *side, qm_vec p, double enough, double reach,
                             uint32_t *hint);

/**
 * Samples a point: an upper bound of its distance (local), and, where the point may raise the lower bound, a
 * certified distance that raises it. face is the face of the source that p is on, slack how far p may be from
 * its surface. enough is at most the lower bound: an upper bound at or below it ends the search.
 */
double qm_sample_point(qm_worker *worker, const qm_side *side, qm_vec p, double slack, uint32_t face,
                       double enough, uint32_t *hint);

/**
 * Raises the lower bound by a sparse sample of the source and a denser one where that is farthest, with all
 * workers; keeps the sample as the side's seeds when there is memory for them. Returns a hint.
 */
uint32_t qm_sample_seeds(qm_context *ctx, qm_search *search, qm_side *side);

/** Frees the seeds. */
void qm_sample_free_seeds(qm_context *ctx, qm_side *side);

#endif
