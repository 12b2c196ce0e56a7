/**
 * job.h: the table of jobs: queue, run, cancel, events and those who read them.
 *
 * A job's life: queued -> running -> succeeded, failed or canceled. Each job has a list of events, one JSON
 * object a line with seq 1, 2, 3 ...; the last one is a result or an error, and there is exactly one of
 * these. A job that has ended is in the store with its document and events before anybody hears of it; the
 * events of one that runs are stored from time to time. One that the end of the daemon has cut short runs
 * again, with higher numbers, and keeps the events that were stored.
 *
 * Lock rule: one lock guards the table, the jobs' states and events, and the readers' lists. Readers are
 * woken under the lock, so that a reader which found nothing and went to sleep under the same lock is never
 * forgotten.
 */
#ifndef QM_JOB_H
#define QM_JOB_H

#include "base/clock.h"
#include "layout/reconstructions.h"
#include "ops/job_kinds.h"

typedef enum qm_job_state {
    QM_JOB_QUEUED,
    QM_JOB_RUNNING,
    QM_JOB_SUCCEEDED,
    QM_JOB_FAILED,
    QM_JOB_CANCELED
} qm_job_state;

typedef struct qm_jobs qm_jobs;
typedef struct qm_job qm_job;

/** Somebody who waits for news of a job. wake is called from a thread of its own, once for each time it went
 * to sleep and before it leaves. */
typedef struct qm_reader {
    void (*wake)(void *user);
    void *user;
    bool asleep;
    double wake_at_ms;                   /* wake at this time at the latest (qm_now_ms), INFINITY for never */
    struct qm_reader *next, *next_awake; /* of the same job; of those that are about to be woken */
} qm_reader;

typedef struct qm_job_limits {
    int workers, queue, threads;
    size_t search_memory; /* of the queue of one search, bytes */
    double grace_ms;
    size_t kept_jobs;    /* that have ended */
    double kept_s;       /* seconds that a job is kept; 0: any time */
    double heartbeat_ms; /* of silence after which a stream says that it lives */
} qm_job_limits;

/** Starts the workers and queues again what the store holds unfinished. */
qm_jobs *qm_jobs_create(qm_store *store, qm_meshes *meshes, qm_reconstructions *reconstructions,
                        qm_job_limits limits);

/**
 * Takes no new work from now on and ends the workers: running jobs get their grace time, then stop;
 * unfinished ones run again at the next start. What has ended can still be asked for.
 */
void qm_jobs_drain(qm_jobs *jobs);
void qm_jobs_destroy(qm_jobs *jobs);

/** Stores the events that running jobs have so far. */
void qm_jobs_save_events(qm_jobs *jobs);

/** Removes the jobs that have ended and are too old or too many, with their results. */
void qm_jobs_drop_old(qm_jobs *jobs);

/** How a request wants its job. */
typedef struct qm_job_submission {
    qm_job_request *request;     /* what it owns goes over to a new job */
    const char *body;            /* as it came */
    const char *idempotency_key; /* or NULL */
    bool use_cache;
    bool owns_job; /* the job ends when the client leaves: it streams it and has not said detach */
} qm_job_submission;

/**
 * Queues a job, or finds the one that answers the request already (*is_cached). Returns a counted reference,
 * or NULL with a problem (404, 422, 429, 503).
 */
qm_job *qm_jobs_submit(qm_jobs *jobs, const qm_job_submission *submission, bool *is_cached,
                       qm_problem *problem);

/** A counted reference; jobs that have ended come back from the store, without their events. NULL with a
 * problem. */
qm_job *qm_jobs_find(qm_jobs *jobs, const char *id, qm_problem *problem);

/** Sees to it that the events of a job which nobody else has can be read. False with a problem. */
bool qm_job_fetch_events(qm_job *job, qm_problem *problem);
void qm_jobs_release(qm_jobs *jobs, qm_job *job);

/** A job asked to stop; it ends as canceled with its last bounds. False when it had ended before. */
bool qm_jobs_cancel(qm_jobs *jobs, qm_job *job);

/** A client that owns the job (see the submission) has left: cancels it when nobody else wants it. */
void qm_jobs_disown(qm_jobs *jobs, qm_job *job);

const char *qm_job_id(const qm_job *job);

/** The job resource as it is now, for the caller to free; with the cached mark when asked for. NULL: out of
 * memory. */
char *qm_job_document(qm_jobs *jobs, qm_job *job, bool is_cached);

/** The same without the mark, and whether the job had ended at that moment. */
char *qm_job_document_now(qm_jobs *jobs, qm_job *job, bool *has_ended);

/** The result object of a job that has one, for the caller to free; NULL otherwise. */
char *qm_job_result_object(qm_jobs *jobs, qm_job *job);

/**
 * The documents of a page of jobs after a sequence number, as members of the JSON array that out ends in. A
 * page of large documents ends before its limit. *next is 0 on the last page. False: out of memory.
 */
bool qm_jobs_list(qm_jobs *jobs, int64_t after, size_t limit, qm_text *out, int64_t *next);

/** How an event is framed. */
typedef enum qm_framing { QM_FRAMING_NDJSON, QM_FRAMING_SSE } qm_framing;

/** What a look at the events found. */
typedef enum qm_news { QM_NEWS_SOME, QM_NEWS_NONE, QM_NEWS_END } qm_news;

/**
 * Adds the events after *seq to out, framed, and moves *seq on; from the first one if there are not so many.
 * With none to add and the job still going, puts the reader to sleep by calling suspend under the lock.
 */
qm_news qm_job_read(qm_jobs *jobs, qm_job *job, uint64_t *seq, qm_framing framing, qm_text *out,
                    qm_reader *reader, void (*suspend)(void *user));

/** True when the job has ended; else puts the reader to sleep likewise until it does or wake_at_ms comes. */
bool qm_job_await_end(qm_jobs *jobs, qm_job *job, qm_reader *reader, void (*suspend)(void *user));

/** A reader is with the job from join to leave. */
void qm_job_join(qm_jobs *jobs, qm_job *job, qm_reader *reader);
void qm_job_leave(qm_jobs *jobs, qm_job *job, qm_reader *reader);

double qm_jobs_heartbeat_ms(const qm_jobs *jobs);

/** Wakes the readers whose time has come; called by the loop's timer. */
void qm_jobs_tick(qm_jobs *jobs, double now_ms);

/** Wakes whoever is to be woken still, and from now on everybody at once: called when the pools are closed,
 * before the connections end. */
void qm_jobs_settle(qm_jobs *jobs);

typedef struct qm_job_counts {
    size_t queued, running;
} qm_job_counts;
qm_job_counts qm_jobs_count(qm_jobs *jobs);

#endif
