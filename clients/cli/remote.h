/**
 * remote.h: a daemon as seen from the command line: uploads, and jobs whose events are streamed.
 */
#ifndef QM_REMOTE_H
#define QM_REMOTE_H

#include "cli.h"

typedef struct qm_remote qm_remote;

/** url is the daemon's address, such as http://127.0.0.1:7878. NULL when it is too long or memory ran
 * out. */
qm_remote *qm_remote_create(const char *url);
void qm_remote_destroy(qm_remote *remote);

/** Sends a file; its mesh's id and the diagonal of its box come back. False with a problem. */
bool qm_remote_upload(qm_remote *remote, const char *path, char id[QM_ID_SIZE], double *diagonal,
                      qm_problem *problem);

/**
 * Runs a job of two uploaded meshes and calls progress with the bounds on the way. When *cancel is raised the
 * daemon is asked to stop the job, which then ends with the bounds that it has. False with a problem.
 */
bool qm_remote_run(qm_remote *remote, const qm_job_request *request, const atomic_bool *cancel,
                   qm_hausdorff_progress_fn *progress, void *progress_user, qm_job_result *out,
                   qm_problem *problem);

#endif
