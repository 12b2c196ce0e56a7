/**
 * job.h: the table of jobs: submission, cancelation, events and their subscribers.
 *
 * A job's life: queued -> running -> succeeded, failed or canceled. Each job has a list of events with seq 1,
 * 2, 3 ...; the last one is its only result or error. The end of a job is in the store, with its document and
 * events, before any subscriber reads it; the events of a running job are stored from time to time. A job
 * that was interrupted by the end of the daemon runs again at the next start, with higher numbers, and keeps
 * its stored events. See server/ARCHITECTURE.md.
 *
 * Threads: every call may come from any thread. One lock guards the table, states, events and subscribers. A
 * subscriber that finds nothing to read is marked as waiting before the lock is released, and every event is
 * added under the lock: no wake-up is lost.
 */
#ifndef QM_JOB_H
#define QM_JOB_H

#include "base/clock.h"
#include "layout/reconstructions.h"
#include "ops/job_kinds.h"

typedef struct qm_jobs qm_jobs;
typedef struct qm_job qm_job;

/** A connection that waits for a job. The notifier calls wake once for each time that the subscriber was
 * marked as waiting, and never after it has unsubscribed. */
typedef struct qm_subscriber {
    void (*wake)(void *user);
    void *user;
    bool is_waiting;
    double wake_at_ms; /* wake at this time at the latest (qm_clock_now_ms); INFINITY: never */
    struct qm_subscriber *next, *next_due; /* of the same job; in the list of the notifier */
} qm_subscriber;

typedef struct qm_job_limits {
    int workers, queue, threads;
    double max_job_ms;    /* after which a running job ends with what it has; INFINITY: never */
    size_t search_memory; /* of the queue of one search, bytes */
    double grace_ms;
    size_t kept_jobs;    /* number of ended jobs in the store */
    double kept_s;       /* age after which an ended job is removed, seconds; 0: never */
    double heartbeat_ms; /* silence after which a stream sends a heartbeat */
    const char *node;    /* name of this process in a shared store */
} qm_job_limits;

/** Starts the workers and queues the unfinished jobs of the store. NULL: out of memory or threads. */
qm_jobs *qm_jobs_create(qm_store *store, qm_meshes *meshes, qm_reconstructions *reconstructions,
                        qm_job_limits limits);

/**
 * Refuses new jobs and ends the workers: running jobs get their grace time, then stop; unfinished ones run
 * again at the next start. Jobs that have ended can still be read.
 */
void qm_jobs_drain(qm_jobs *jobs);
void qm_jobs_destroy(qm_jobs *jobs);

/**
 * Stores the events of running jobs that the store lacks. Of a shared store it also hears which jobs clients of other
 * nodes have canceled, and which are lost. True when clients of other nodes read the events of one.
 */
bool qm_job_events_save(qm_jobs *jobs);

/** Removes the jobs that have ended and are too old or too many, with their results. */
void qm_jobs_drop_old(qm_jobs *jobs);

/** How a request wants its job. */
typedef struct qm_job_submission {
    qm_job_request *request;     /* a new job takes over its points */
    const char *body;            /* the JSON, to run the job again after a restart */
    const char *idempotency_key; /* or NULL */
    const char *client;          /* whose share of the workers it takes */
    bool use_cache;
    bool owns_job; /* the job is canceled when its last owner leaves: the client streams it without detach */
} qm_job_submission;

/**
 * Queues a job, or finds the one that answers the request already (*is_cached). Returns a counted reference,
 * or NULL with a problem (404, 422, 429, 503).
 */
qm_job *qm_jobs_submit(qm_jobs *jobs, const qm_job_submission *submission, bool *is_cached,
                       qm_problem *problem);

/** A counted reference. A job that has ended is read from the store, without its events. NULL with a problem
 * (404, 503, 507). */
qm_job *qm_jobs_find(qm_jobs *jobs, const char *id, qm_problem *problem);

/** Loads the events of a job that qm_jobs_find has read from the store. Only for the one holder of such a
 * job. False with a problem. */
bool qm_job_fetch_events(qm_job *job, qm_problem *problem);
void qm_jobs_release(qm_jobs *jobs, qm_job *job);

/** Asks a job to stop, also after a death of this process; it ends as canceled with its last bounds. False when it has
 * ended already. */
bool qm_jobs_cancel(qm_jobs *jobs, qm_job *job);

/** Sets the labels of a job, a list as of a mesh, NULL for none. False with a problem. */
bool qm_jobs_set_labels(qm_jobs *jobs, qm_job *job, const char *labels, qm_problem *problem);

/** Removes a job that has ended, with its events and result. False with a problem. */
bool qm_jobs_remove(qm_jobs *jobs, qm_job *job, qm_problem *problem);

/** An owner of the job (qm_job_submission) has left: cancels the job when it was the last one, and no client
 * without a stream has submitted it. */
void qm_jobs_disown(qm_jobs *jobs, qm_job *job);

const char *qm_job_id(const qm_job *job);

/** The job resource, for the caller to free; is_cached marks it as one. NULL: out of memory. */
char *qm_job_document(qm_jobs *jobs, qm_job *job, bool is_cached);

/** The job resource, and whether the job had ended at that moment. */
char *qm_job_document_now(qm_jobs *jobs, qm_job *job, bool *has_ended);

/** The result object, for the caller to free; NULL when the job has none (yet), or out of memory. */
char *qm_job_result_object(qm_jobs *jobs, qm_job *job);

/** Whether a job that has ended is known to have run on these revisions of its meshes: true for those of files that were
 * never moved, else for the newest job of its question, with these notes. */
bool qm_job_ran_on(qm_jobs *jobs, const qm_store_job *row, uint64_t a, uint64_t b, const qm_notes notes[2]);

/** Writes the state of a name; false when there is none of this name. */
bool qm_job_state_find(const char *name, qm_job_state *out);

/**
 * Adds the resources of a page of jobs to the JSON array that out ends in. A page of large resources ends
 * before its limit. *next is 0 on the last page. False: out of memory.
 */
bool qm_jobs_list(qm_jobs *jobs, qm_store_page page, const qm_store_job_filter *filter, qm_text *out,
                  int64_t *next);

/** How an event is framed. */
typedef enum qm_framing { QM_FRAMING_NDJSON, QM_FRAMING_SSE } qm_framing;

/** QM_READ_SOME: events were added. QM_READ_NONE: none yet, the subscriber waits. QM_READ_END: none will
 * come. */
typedef enum qm_read_status { QM_READ_SOME, QM_READ_NONE, QM_READ_END } qm_read_status;

/**
 * Adds the events after *seq to out, framed, and advances *seq; a *seq past the last event reads the run from
 * its first event. With none to add and the job not over, calls suspend under the lock and marks the
 * subscriber as waiting.
 */
qm_read_status qm_job_read(qm_jobs *jobs, qm_job *job, uint64_t *seq, qm_framing framing, qm_text *out,
                           qm_subscriber *subscriber, void (*suspend)(void *user));

/** False when there was no memory for the last event of a job: readers are to ask again. */
bool qm_job_has_last_event(qm_jobs *jobs, qm_job *job);

/** True when the job is over, or wake_at_ms has passed; else calls suspend, and the subscriber waits. */
bool qm_job_await_end(qm_jobs *jobs, qm_job *job, qm_subscriber *subscriber, void (*suspend)(void *user));

/** Between the two calls the job notifies the subscriber and stays alive. */
void qm_job_subscribe(qm_jobs *jobs, qm_job *job, qm_subscriber *subscriber);
void qm_job_unsubscribe(qm_jobs *jobs, qm_job *job, qm_subscriber *subscriber);

double qm_job_events_heartbeat_ms(const qm_jobs *jobs);

/** Notifies subscribers whose wake_at_ms has passed, and ends jobs whose time is over; called by the loop's timer. */
void qm_job_events_tick(qm_jobs *jobs, double now_ms);

/** Notifies all that are due and ends the notifier: from now on wake is called at once, under the lock. For
 * the time between the end of the pools and the end of the connections. */
void qm_job_events_stop_notifier(qm_jobs *jobs);

typedef struct qm_job_counts {
    size_t queued, running, paused; /* those that are paused are running, too */
} qm_job_counts;
qm_job_counts qm_jobs_count(qm_jobs *jobs);

/** True when the node of a shared store has not reached it for some seconds: what it knows may be out of date. */
bool qm_jobs_is_isolated(qm_jobs *jobs);

/** Writes the cluster as the last beat has seen it, and how old that is; false for an embedded store. */
bool qm_jobs_read_cluster(qm_jobs *jobs, qm_store_cluster *out, double *beat_age_s);

#endif
