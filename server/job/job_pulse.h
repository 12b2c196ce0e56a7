/**
 * job_pulse.h: the thread that keeps a node in the cluster of a shared store: it tells that the node lives, takes jobs
 * from the queue, stores the events of those that run here, and reads those of jobs that run elsewhere
 * (job_mirrors.h). An embedded store needs none of it: all jobs are in memory.
 *
 * A node whose last beat is older than QM_JOB_PULSE_ISOLATION_MS does not know what the others decide, nor whether the
 * database that it reads is still the one that they use: it answers no request about what is stored.
 */
#ifndef QM_JOB_PULSE_H
#define QM_JOB_PULSE_H

#include "job_internal.h"

#define QM_JOB_PULSE_ISOLATION_MS 6000.0

/** Starts the pulse of jobs in a shared store; false: out of memory or threads. */
bool qm_job_pulse_start(qm_jobs *jobs);

/** Takes no more jobs from the queue; the rest goes on. */
void qm_job_pulse_close(qm_jobs *jobs);

/** Ends the thread; does nothing without one. */
void qm_job_pulse_stop(qm_jobs *jobs);

/** A worker has become free: the next pulse begins at once when jobs may wait for one. */
void qm_job_pulse_free_worker(qm_jobs *jobs);

/** Has the next pulse begin at once: there is something to look at. */
void qm_job_pulse_hurry(qm_jobs *jobs);

#endif
