/**
 * hausdorff.h: the Hausdorff distance between two surfaces, as an interval that is proven to hold it.
 *
 * h(A, B) is the greatest distance from a point of A to the surface B; H(A, B) the greater of h(A, B) and
 * h(B, A). The search keeps pieces of A in a queue by their upper bounds, splits the topmost, and ends when
 * no piece can hold a point farther than the tolerance above the best point found. Both bounds hold at every
 * moment.
 *
 * Source: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh, chapter 5 (pieces in
 * one queue, matching); Tang, Lee, Kim, Interactive Hausdorff distance computation for general polygonal
 * models, 2009.
 */
#ifndef QM_HAUSDORFF_H
#define QM_HAUSDORFF_H

#include "qm/bvh.h"
#include "qm/project.h"

typedef enum qm_direction { QM_TWO_SIDED, QM_A_TO_B, QM_B_TO_A } qm_direction;

/** Upper bounds of a part of the source. Both are proven; they differ in how soon they are tight. */
typedef enum qm_bounds {
    QM_BOUNDS_CELLS,   /* covers a part by cells, each near to one of many facets of the target around it */
    QM_BOUNDS_MATCHING /* matches a part to the facets under its corners: chapter 5 of the source */
} qm_bounds;

/** Why a search ended. */
typedef enum qm_hausdorff_stop {
    QM_STOP_CONVERGED, /* upper - lower <= tolerance */
    QM_STOP_THRESHOLD, /* the side of the threshold is certain */
    QM_STOP_DEADLINE,  /* deadline_ms or work_limit is used up */
    QM_STOP_CANCELED,  /* the context's flag was raised */
    QM_STOP_PRECISION, /* the tolerance is below what double precision can prove here */
    QM_STOP_WORK,      /* the search's own bound of parts was reached, see QM_HAUSDORFF_BASE_WORK */
    QM_STOP_MEMORY     /* the queue would have passed memory_limit, or the allocator had no more for it */
} qm_hausdorff_stop;

/**
 * A search looks at no more parts than QM_HAUSDORFF_BASE_WORK and QM_HAUSDORFF_FACE_WORK for each face of the
 * meshes in each direction, unless work_limit says otherwise. Ordinary meshes need less than one part for
 * two faces. More is needed only where surfaces nearly coincide that no cover fits well, such as folded
 * patches of two meshes whose grids do not match.
 */
#define QM_HAUSDORFF_BASE_WORK 16384
#define QM_HAUSDORFF_FACE_WORK 32

/** Bytes that the queues of a search take at most, unless memory_limit says otherwise. */
#define QM_HAUSDORFF_MEMORY ((size_t)1 << 30)

/** The state of a search: bounds in the unit of the meshes, both valid now and from here on only tighter. */
typedef struct qm_hausdorff_progress {
    double elapsed_ms;
    double lower, upper;  /* upper is INFINITY until a first bound is known */
    uint64_t iterations;  /* nodes, packs and parts of faces looked at so far; overlays count as so many parts
                             as take their time */
    uint64_t projections; /* searches of a nearest point so far */
    size_t queue_count;   /* pieces and nodes waiting */
} qm_hausdorff_progress;

/** Called on one thread at a time, at the first bounds, at each halving of the gap, and at least every 100
 * ms. */
typedef void qm_hausdorff_progress_fn(void *user, const qm_hausdorff_progress *progress);

typedef struct qm_hausdorff_options {
    qm_direction direction;
    qm_quad_reading quads;
    double tolerance;           /* > 0, unit of the meshes */
    double threshold;           /* >= 0: stop once it is certain on which side the distance lies; NAN: none */
    double deadline_ms;         /* > 0: stop after this time; 0: none */
    uint64_t work_limit;        /* > 0: stop after so many iterations; 0: the search's own bound */
    size_t memory_limit;        /* > 0: bytes that the queues may take; 0: QM_HAUSDORFF_MEMORY */
    int thread_count;           /* 1 or more */
    qm_accelerator accelerator; /* of nearest points; one that has to be built is built by the call */
    const qm_tetra *tetra[2];   /* over a and over b, for QM_ACCELERATOR_TETRA, when at hand; or NULL */
    qm_bounds bounds;
    qm_hausdorff_progress_fn *progress; /* NULL: none */
    void *progress_user;
} qm_hausdorff_options;

/** Two-sided, triangles, tolerance 0 (to be set), no threshold, no limits, one thread. */
qm_hausdorff_options qm_hausdorff_options_default(void);

typedef struct qm_hausdorff_result {
    double lower, upper;       /* lower <= distance <= upper */
    int from_side;             /* 0: the witness point lies on A and is projected on B; 1: the other way */
    qm_surface_point from, to; /* witness, rounded to doubles: |from - to| is lower to within a share of the
                                  tolerance and the roundings of its coordinates */
    bool has_witness;          /* false only when the source is empty */
    uint64_t iterations, projections;
    size_t max_queue;
    double elapsed_ms;
    qm_hausdorff_stop stop;
    int verdict; /* against the threshold: 1 above, -1 not above, 0 not known or not asked */
} qm_hausdorff_result;

/**
 * Measures the distance between the meshes of two trees. Where both meshes hold the same arrays, bit by bit,
 * it is 0, told at once: no search, no accelerator and no report of progress.
 *
 * Ownership: borrows everything; nothing of the call is left behind.
 * Returns:   QM_OK, also when the search was stopped early (out->stop says why, the bounds hold), for want of
 *            memory for the queue too;
 *            QM_E_ARGUMENT (tolerance, threshold, threads; a tree that lacks the parts of a target);
 *            QM_E_UNSUPPORTED (the accelerator); QM_E_NO_MEMORY; QM_E_SCALE.
 */
qm_status qm_hausdorff_measure(qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                               const qm_hausdorff_options *options, qm_hausdorff_result *out);

#endif
