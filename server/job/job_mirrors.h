/**
 * job_mirrors.h: mirrors, the jobs in memory that another node of a shared store has: they have its events, for the
 * readers of this node. A mirror follows its job while it is listed, which it is from its first subscriber on.
 */
#ifndef QM_JOB_MIRRORS_H
#define QM_JOB_MIRRORS_H

#include "job_internal.h"

/** A mirror of a row, with the events so far; only the caller has it. NULL with a problem. */
qm_job *qm_job_mirrors_make(qm_jobs *jobs, const qm_store_job *row, qm_problem *problem);

/** Lists a mirror that has a reader. The caller holds the lock. */
void qm_job_mirrors_list(qm_job *job);

/** Makes the mirror of a job that this node has claimed a job that is queued here, with a reference; NULL: there is no
 * mirror. To be called by the pulse, after it has brought all mirrors up to date. */
qm_job *qm_job_mirrors_take(qm_jobs *jobs, const qm_store_job *row);

/** Brings all listed mirrors up to date, and drops those without readers. True while there are any. */
bool qm_job_mirrors_follow(qm_jobs *jobs);

/** Ends all mirrors, since the daemon stops: their readers go on at another node. */
void qm_job_mirrors_end(qm_jobs *jobs);

#endif
