/**
 * refine.h: steps of a reconstruction until a goal is reached, with the distance after each one. Shared by
 * the daemon and the command line.
 */
#ifndef QM_REFINE_H
#define QM_REFINE_H

#include "mesh_load.h"
#include "qm/quality.h"
#include "qm/reconstruct.h"

#define QM_REFINE_MOST_QUADS 4000000

/** When to stop: at the first of these that is reached. */
typedef struct qm_refine_goal {
    size_t steps;     /* 0: as many as it takes */
    size_t max_quads; /* the mesh has no more than so many; 0: QM_REFINE_MOST_QUADS */
    double edge;      /* no mean edge of a chord is longer; 0: none */
    double hausdorff; /* the upper bound of the distance is at most this; 0: none. Points that were out of
                         reach of all patches from the start do not count. */
    bool measures;    /* the distance is measured after each step also when it is no goal */
    int thread_count;
} qm_refine_goal;

/**
 * What a step came to. The distance is that to the source: of a mesh two-sided; of a point set from its
 * covered points to the mesh, exactly, and the other way, where half of what lies between the points is
 * added.
 */
typedef struct qm_refine_record {
    qm_reconstruction_record step;
    qm_quality quality;
    bool is_measured;
    double lower, upper; /* the distance that counts */
    double covered; /* of a point set: that of the points within the cover distance that do not lie beyond
                       the rim of all patches, and of the rim as it was drawn */
    double mesh_to_points_lower, mesh_to_points_upper; /* of a point set */
    size_t uncovered;                                  /* points farther away than the cover distance */
    size_t beyond; /* of the others, those beyond the rim of all patches */
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

/** Called after each whole step, with the mesh as it then is. */
typedef void qm_refine_fn(void *user, const qm_refine_record *record);

/**
 * Takes steps. Which ones does not depend on what is measured or on threads, only on max_quads: so the same
 * steps can be taken again with the same limit.
 *
 * Returns QM_OK, also when it was canceled after a whole step (*stop says so); what the engine returns else.
 */
qm_status qm_refine(qm_context *ctx, qm_reconstruction *reconstruction, const qm_source *source,
                    const qm_refine_goal *goal, qm_refine_fn *on_step, void *user, qm_refine_stop *stop);

#endif
