/**
 * job_once.h: a job about meshes that no store has, for one reader. Nothing of it is stored: it ends when its reader leaves, and
 * its meshes with it.
 */
#ifndef QM_JOB_ONCE_H
#define QM_JOB_ONCE_H

#include "job.h"

typedef struct qm_job_once qm_job_once;

/**
 * Queues a job of two meshes; takes over the references of both and what the request owns, also after an error. Uses the
 * subscriber until qm_job_once_close. NULL with a problem (429, 503, 507).
 */
qm_job_once *qm_job_once_start(qm_jobs *jobs, qm_job_request *request, qm_mesh_ref *const mesh[2],
                               const char *client, qm_subscriber *subscriber, qm_problem *problem);

/** True when the job has ended, and once a second, so that the reader can look whether its client is there; else calls suspend,
 * and the subscriber waits. */
bool qm_job_once_await(qm_job_once *once, void (*suspend)(void *user));

/** The end of the job: false before it. *object is the result, or the problem of a job that has none, as JSON, for the caller to
 * free; NULL when out of memory. */
bool qm_job_once_take(qm_job_once *once, bool *has_result, char **object);

/** The reader leaves: cancels the job unless it has ended. */
void qm_job_once_close(qm_job_once *once);

#endif
