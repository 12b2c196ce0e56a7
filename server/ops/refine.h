/**
 * refine.h: steps of a reconstruction until a goal is reached, with the distance after each step. Shared by the daemon
 * and the command line.
 */
#ifndef QM_REFINE_H
#define QM_REFINE_H

#include "mesh_load.h"
#include "qm/quality.h"
#include "qm/reconstruct.h"

#define QM_REFINE_MAX_QUADS 4000000
#define QM_REFINE_DEFAULT_QUADS 10000 /* the limit of a refinement without any goal */

/** Goals: the refinement stops when it reaches the first of them. */
typedef struct qm_refine_goal {
    size_t steps; /* 0: any number */
    size_t
        max_quads; /* upper limit of the mesh; 0: QM_REFINE_MAX_QUADS, or the default if there is no goal at all */
    double edge; /* longest mean edge of a chord; 0: none */
    double
        hausdorff; /* upper bound of the distance; 0: none. Points that no patch reached at the start do not count. */
    bool measures; /* measures the distance after each step even if it is no goal */
    int thread_count;
} qm_refine_goal;

/**
 * The outcome of a step. The distance is that to the source: two-sided for a mesh; for a point set exactly from its
 * covered points to the mesh, and in the other direction with half of the point spacing added.
 */
typedef struct qm_refine_record {
    qm_reconstruction_record step;
    qm_quality quality;
    bool is_measured;
    double lower, upper; /* of the distance */
    /* Of a point set: max over the points within the cover distance that do not lie beyond the boundary of the
     * layout, and over that boundary as it was drawn. */
    double covered;
    double mesh_to_points_lower, mesh_to_points_upper; /* of a point set */
    size_t uncovered;                                  /* points beyond the cover distance */
    size_t beyond; /* of the others, points beyond the boundary of the layout */
    double step_ms, measure_ms;
} qm_refine_record;

typedef enum qm_refine_stop {
    QM_REFINE_STEPS,
    QM_REFINE_QUADS,
    QM_REFINE_EDGE,
    QM_REFINE_HAUSDORFF,
    QM_REFINE_CANCELED
} qm_refine_stop;
const char *qm_refine_stop_name(qm_refine_stop stop);

/**
 * Measures the Hausdorff distance between the source, A, and a mesh, B, until its bounds are within a fraction of the
 * diagonal, and of the goal's distance where there is one; for 20 s at most.
 *
 * mesh  with QM_BVH_TARGET
 *
 * Returns as qm_hausdorff_measure; the bounds hold also when the time ended it.
 */
qm_status qm_refine_measure(qm_context *ctx, const qm_ref_surface *source, const qm_bvh *mesh,
                            qm_direction direction, double tolerance, const qm_refine_goal *goal,
                            double *lower, double *upper);

/** Called after each complete step; the reconstruction then holds its mesh. */
typedef void qm_refine_fn(void *user, const qm_refine_record *record);

/**
 * Takes steps. They depend on max_quads only, not on measurements or threads, so that they can be repeated with the same
 * limit.
 *
 * Returns QM_OK, also if it was canceled after a complete step (*stop is then QM_REFINE_CANCELED); else the status of
 * the engine's call.
 */
qm_status qm_refine(qm_context *ctx, qm_reconstruction *reconstruction, const qm_ref_surface *source,
                    const qm_refine_goal *goal, qm_refine_fn *on_step, void *user, qm_refine_stop *stop);

#endif
