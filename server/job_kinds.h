/**
 * job_kinds.h: what a job asks for and what it finds, as plain structs, and the adapters from one to the
 * other. No HTTP, no JSON, no store: the command line runs jobs in process through the same functions.
 */
#ifndef QM_JOB_KINDS_H
#define QM_JOB_KINDS_H

#include "mesh_load.h"
#include "qm/hausdorff.h"

#define QM_ID_SIZE 40

typedef enum qm_job_kind { QM_JOB_HAUSDORFF } qm_job_kind;

typedef struct qm_job_request {
    qm_job_kind kind;
    char a[QM_ID_SIZE], b[QM_ID_SIZE]; /* ids of meshes; file names have no place here */
    qm_direction direction;
    qm_quad_reading quads;
    double tolerance;
    bool tolerance_is_absolute; /* else a share of the diagonal of A's box */
    double threshold;           /* NAN: none */
    double deadline_ms;         /* 0: none */
    int threads;                /* 0: as many as the host likes */
    bool detach;                /* the job goes on when the client that streams it hangs up */
} qm_job_request;

/** Two-sided, triangles, relative tolerance 1e-6, no threshold, no deadline. */
qm_job_request qm_job_request_default(void);

typedef struct qm_job_result {
    qm_hausdorff_result hausdorff;
    double diagonal;  /* of A's box: what relative figures refer to */
    double tolerance; /* absolute */
    double prepare_a_ms, prepare_b_ms;
    uint32_t from_face, to_face; /* in the numbering of the input files */
} qm_job_result;

/**
 * Runs a Hausdorff job over two meshes. ctx carries threads and cancel flag; progress may be NULL. A diagonal
 * of 0 (a single point) makes a relative tolerance absolute.
 *
 * Returns what qm_hausdorff_measure returns.
 */
qm_status qm_job_run_hausdorff(qm_context *ctx, const qm_job_request *request, const qm_loaded_mesh *a,
                               const qm_loaded_mesh *b, qm_hausdorff_progress_fn *progress,
                               void *progress_user, qm_job_result *out);

#endif
