/**
 * job_help.h: help for long searches of other nodes: while a worker is free, this node runs parts of one of them
 * (split_search.h). The helper is a job that is not stored, and which no client sees.
 */
#ifndef QM_JOB_HELP_H
#define QM_JOB_HELP_H

#include "job_internal.h"

/** Now and then, when a worker is free, looks for a search with a free part, and queues a helper for it; stops the helper
 * of a search that is over. Called by the pulse in each round. */
void qm_job_help_look(qm_jobs *jobs, bool is_free);

/** The run of a helper with the meshes of its search. b may be a. */
void qm_job_help_run(qm_job *job, const qm_loaded_mesh *a, const qm_loaded_mesh *b);

#endif
