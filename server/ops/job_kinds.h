/**
 * job_kinds.h: what a job asks for and what it finds, as plain structs, and the adapters from one to the
 * other. No HTTP, no JSON, no store: the command line runs jobs in process through the same functions.
 *
 * A kind is a row of QM_JOB_MAP. Three tables follow the list: how it runs (job_kinds.c), what fields it has
 * (json_in.c), how its request and result are written (json_requests.c,
 * json_results.c).
 */
#ifndef QM_JOB_KINDS_H
#define QM_JOB_KINDS_H

#include "base/id.h"
#include "collide_pairs.h"
#include "projections.h"
#include "qm/deviation.h"
#include "qm/distance.h"
#include "qm/hausdorff.h"
#include "refine.h"

#define QM_JOB_MAX_PERCENTILES 64

/** XX(suffix, name in "type", field of the first mesh, field of the second or NULL). */
#define QM_JOB_MAP(XX)                                                                                       \
    XX(HAUSDORFF, hausdorff, "a", "b")                                                                       \
    XX(PROJECT, project, "mesh", NULL)                                                                       \
    XX(DEVIATION, deviation, "a", "b")                                                                       \
    XX(DISTANCE, distance, "a", "b")                                                                         \
    XX(COLLISION, collision, "a", "b")                                                                       \
    XX(SELF_COLLISION, self_collision, "mesh", NULL)                                                         \
    XX(RECONSTRUCTION_STEP, reconstruction_step, "reconstruction", NULL)

typedef enum qm_job_kind {
#define XX(suffix, name, first, second) QM_JOB_##suffix,
    QM_JOB_MAP(XX)
#undef XX
        QM_JOB_KIND_COUNT
} qm_job_kind;

/** What a kind is, whatever it asks for. */
typedef struct qm_job_type {
    const char *name;
    const char *mesh_field[2]; /* where the request names its meshes; [1] is NULL for a kind of one mesh */
    bool is_pure;              /* asked for again, the answer is the same: it may come from a job before */
} qm_job_type;
const qm_job_type *qm_job_type_of(qm_job_kind kind);

/** The kind of this name; false when there is none. */
bool qm_job_kind_find(const char *name, qm_job_kind *out);

/** How the long array of a kind's results is told. */
typedef struct qm_job_array {
    const char *member; /* of the result in JSON */
    const char *header; /* of the rows in CSV; a single column is numbered there */
    int columns;
} qm_job_array;

/** NULL for kinds without one. */
const qm_job_array *qm_job_array_of(qm_job_kind kind);
/** What a reconstruction_step works on, which is no mesh: set by who runs the job. */
typedef struct qm_job_refining {
    qm_reconstruction *reconstruction;
    const qm_source *source;
    qm_refine_fn *on_step; /* after each whole step */
    void *user;
} qm_job_refining;

/** Fields that a kind does not have keep their defaults. */
typedef struct qm_job_request {
    qm_job_kind kind;
    char a[QM_ID_SIZE],
        b[QM_ID_SIZE]; /* ids of meshes, b "" for a kind of one; file names have no place here */
    qm_quad_reading quads;
    int threads; /* 0: as many as the host likes */
    bool detach; /* the job goes on when the client that streams it hangs up */

    /* hausdorff, deviation for its maximum, distance, and collisions of bilinear quads */
    double tolerance;
    bool tolerance_is_absolute; /* else a share of the diagonal of A's box */

    /* hausdorff */
    qm_direction direction;
    double threshold;    /* NAN: none */
    double deadline_ms;  /* 0: none */
    size_t memory_limit; /* of the queue, bytes; 0: as much as the host likes */
    qm_accelerator accelerator;
    qm_bounds bounds;

    /* project */
    double *points; /* point_count rows of x y z; on malloc, the request's own */
    size_t point_count;

    /* deviation */
    double accuracy;
    size_t pieces, bins;
    double percentiles[QM_JOB_MAX_PERCENTILES];
    size_t percentile_count;

    /* collision and self_collision */
    qm_collide_mode mode;
    size_t list_limit; /* pairs that the result object tells */
    bool incremental;  /* self_collision: only what has moved since, where that is known */
    /* reconstruction_step, whose a is the id of the reconstruction */
    qm_refine_goal goal; /* hausdorff is set from the share below when it runs */
    double hausdorff_relative;
    const qm_job_refining *refining;
} qm_job_request;

/** A Hausdorff job: two-sided, triangles, relative tolerance 1e-6, no threshold, no deadline, no points.
 * Deviation: accuracy 1e-2, 2^20 pieces, 50 bins, percentiles 1, 5, 25, 50, 75, 90, 95, 99.
 * Collisions: all pairs, 1000 of them told. */
qm_job_request qm_job_request_default(void);

/** Frees what the request owns. */
void qm_job_request_reset(qm_job_request *request);

typedef struct qm_job_result {
    qm_job_kind kind;
    double diagonal; /* of A's box: what relative figures refer to */
    double prepare_a_ms, prepare_b_ms;
    double elapsed_ms;
    bool is_canceled; /* stopped by the context's flag; what is here holds all the same */

    double tolerance; /* absolute; of kinds that have one */

    /* hausdorff */
    qm_hausdorff_result hausdorff;
    uint32_t from_face, to_face; /* in the numbering of the input files */

    /* project */
    qm_projections feet;

    /* deviation */
    qm_deviation deviation;

    /* distance; its faces in from_face and to_face */
    qm_distance distance;

    /* collision and self_collision */
    qm_told_pairs pairs;
    /* reconstruction_step */
    qm_refine_stop refine_stop;
    char mesh[QM_ID_SIZE]; /* the new mesh; set by who runs the job, with the counts and the records */
    size_t quads, step_count;
    const char *records; /* objects with commas between; borrowed */
} qm_job_result;

/**
 * Answers a request about one mesh or two (b is NULL for a kind of one). ctx carries threads and cancel flag;
 * progress may be NULL, and kinds without bounds on the way do not call it.
 *
 * Returns QM_OK with a result for qm_job_result_reset in the same context, also when it was canceled but has
 * something to tell; QM_E_CANCELED when it has not; or what the engine's call returns. After an error there
 * is nothing to reset.
 */
qm_status qm_job_answer(qm_context *ctx, const qm_job_request *request, const qm_loaded_mesh *a,
                        const qm_loaded_mesh *b, qm_hausdorff_progress_fn *progress, void *progress_user,
                        qm_job_result *out);

/** The array of a result that is too long for documents: a deviation's distances at A's vertices, or the
 * faces of all pairs that collide. NULL when the result has none. */
const double *qm_job_result_array(const qm_job_result *result, size_t *count);

void qm_job_result_reset(qm_context *ctx, qm_job_result *result);

#endif
