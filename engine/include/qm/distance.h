/**
 * distance.h: the least distance between two surfaces, as an interval that is proven to hold it.
 *
 * Pairs of nodes of the two trees are looked at in the order of the distance of their boxes; the search ends
 * when the nearest pair left is no nearer than the best points found.
 *
 * Source: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh, section 4.4.
 */
#ifndef QM_DISTANCE_H
#define QM_DISTANCE_H

#include "qm/project.h"

typedef struct qm_distance_options {
    qm_quad_reading quads;
    double tolerance; /* > 0, unit of the meshes: upper - lower is at most this, or what rounding leaves */
} qm_distance_options;

typedef struct qm_distance {
    double lower, upper;       /* both 0 when the surfaces are proven to meet */
    qm_surface_point from, to; /* of a and of b, upper apart but for rounding; faces as stored */
    uint64_t pairs;            /* of faces measured */
    bool is_converged;         /* upper - lower is at most the tolerance */
    double elapsed_ms;
} qm_distance;

/**
 * Measures the least distance. With quads as triangles, whether the surfaces meet is decided exactly. Any
 * parts of the trees serve; runs on one thread.
 *
 * Returns: QM_OK; QM_E_ARGUMENT (tolerance); QM_E_SCALE (see collide.h); QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_distance_measure(qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                              const qm_distance_options *options, qm_distance *out);

#endif
