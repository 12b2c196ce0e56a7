/**
 * distance.h: the minimum distance between two surfaces, as an interval that is proven to contain it.
 *
 * A best-first search visits pairs of nodes of the two trees by the distance of their boxes; it ends when the
 * nearest remaining pair is no nearer than the best points found.
 *
 * Source: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh, section 4.4.
 */
#ifndef QM_DISTANCE_H
#define QM_DISTANCE_H

#include "qm/hausdorff.h"

typedef struct qm_distance_options {
    qm_quad_reading quads;
    double tolerance; /* > 0, unit of the meshes: upper - lower is at most this, up to rounding */
    double
        limit; /* >= 0: the search stops once it is certain on which side of it the distance is; NAN: none */
} qm_distance_options;

typedef struct qm_distance {
    double lower, upper;       /* both 0 when the surfaces are proven to meet */
    qm_surface_point from, to; /* of a and of b, at the distance upper up to rounding; faces as stored */
    uint64_t pairs;            /* pairs of faces that were measured */
    bool is_converged;         /* upper - lower is at most the tolerance */
    qm_verdict verdict;        /* about the limit */
    double elapsed_ms;
} qm_distance;

/**
 * Measures the minimum distance. With quads as triangles, exact signs decide whether the surfaces meet. Trees
 * for any purpose serve.
 *
 * Ownership: borrows every argument, keeps none.
 * Threads:   only reads the trees; runs on the calling thread.
 * Returns:   QM_OK; QM_E_ARGUMENT (tolerance, limit); QM_E_SCALE (see collide.h); QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_distance_measure(qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                              const qm_distance_options *options, qm_distance *out);

#endif
