/**
 * job_internal.h: what the files of the job table share: jobs.c (start and stop), job.c (table and
 * submission), job_list.c (what the store has), job_events.c (events, readers, documents), job_saving.c
 * (events on their way to the store and back), job_run.c (what a worker does with a job), job_waker.c. "The
 * lock" is qm_jobs.lock.
 */
#ifndef QM_JOB_INTERNAL_H
#define QM_JOB_INTERNAL_H

#include <uv.h>

#include "job_batch.h"

/** Where a job of a batch comes from. */
typedef struct qm_batch_line {
    qm_batch *batch; /* NULL: the job is none of a batch */
    uint64_t number; /* from 1 */
    char *key;       /* JSON */
} qm_batch_line;
void qm_batch_line_reset(qm_batch_line *line);

#define QM_REVISIONS_SIZE 44 /* two numbers of up to 20 digits */

typedef struct qm_job_event {
    uint64_t seq;
    char *line; /* without a line end */
} qm_job_event;

struct qm_job {
    char id[QM_ID_SIZE];
    qm_job_request request;
    char *key;
    char created[QM_TIME_SIZE], started[QM_TIME_SIZE];
    double started_ms; /* qm_now_ms when a worker or its end took it */
    qm_job_state state;
    atomic_bool cancel;   /* what the engine looks at: raised by a client or by the end of the daemon */
    bool is_canceled;     /* by a client */
    bool interrupted;     /* stopped by the end of the daemon: it will run again */
    uint64_t seq_base;    /* events up to this number belong to runs that the daemon's end has cut short */
    qm_job_event *events; /* by seq */
    size_t event_count, event_capacity;
    size_t saved_count; /* so many of them are in the store */
    bool is_stored;     /* made of a row of the store, without events until they are asked for */
    char *last_bounds;  /* the newest bounds event's own members, for the document */
    char *document;     /* once it has ended */
    char revisions[QM_REVISIONS_SIZE]; /* of the meshes that it runs on; "" before */
    qm_reader *readers;
    int owners;     /* clients that stream it and whose leaving ends it */
    bool is_kept;   /* somebody wants it who does not stream it: nobody's leaving ends it */
    int references; /* the table counts as one while it is listed */
    bool listed;
    qm_batch_line line;
    qm_jobs *jobs;
    qm_job *next;
};

struct qm_jobs {
    qm_store *store;
    qm_meshes *meshes;
    qm_reconstructions *reconstructions;
    qm_job_limits limits;
    qm_pool *pool;
    uv_mutex_t
        submitting;    /* taken before the lock: one submission at a time looks for an answer, else queues */
    uv_mutex_t saving; /* taken before the lock: events are saved by one thread at a time */
    uv_mutex_t lock;
    qm_job *first;      /* jobs that have not ended, in no order */
    qm_reader *readers; /* those of batches */
    qm_reader *awake;   /* no longer asleep, but not told so yet */
    uv_cond_t has_awake;
    uv_thread_t waker;
    bool has_waker, waker_ends;
    size_t queued, running;
    atomic_bool closed;
};

/** The thread that wakes readers (job_waker.c); ended by qm_jobs_settle. */
bool qm_waker_start(qm_jobs *jobs);

/** Has a reader woken that sleeps. The caller holds the lock. */
void qm_reader_wake(qm_jobs *jobs, qm_reader *reader);

/** What jobs of the same answer have in common; NULL: out of memory. */
char *qm_job_make_key(const qm_job_request *request);

/** A job that nobody knows yet; takes over what the request owns. */
qm_job *qm_job_create(qm_jobs *jobs, qm_job_request *request);

/** Puts a queued job into the table, hands a listed one to the workers (false: it will not run), and takes
 * one that will not run out of the table again. */
void qm_job_enlist(qm_jobs *jobs, qm_job *job);
bool qm_job_enqueue(qm_jobs *jobs, qm_job *job);
void qm_job_withdraw(qm_jobs *jobs, qm_job *job);

/** False with a problem when a mesh of the request does not exist. */
bool qm_job_check_meshes(qm_jobs *jobs, const qm_job_request *request, char revisions[QM_REVISIONS_SIZE],
                         qm_problem *problem);

/** Revisions of both meshes as text; 0 for a mesh that there is not. */
void qm_job_write_revisions(uint64_t a, uint64_t b, char out[QM_REVISIONS_SIZE]);

/** A finished job of the same key, or NULL. */
qm_job *qm_job_find_cached(qm_jobs *jobs, const char *key, const char *revisions);

/** Ends a job of a batch that is marked as running; members is what its answer says besides the state. */
void qm_batch_end_line(qm_job *job, qm_job_state state, const char *members);

/** Readers as a list. The caller holds the lock. */
void qm_readers_add(qm_reader **list, qm_reader *reader);
void qm_readers_remove(qm_reader **list, qm_reader *reader);

/** The caller of these holds the lock. */
void qm_job_drop_reference(qm_job *job);
void qm_job_unlist(qm_job *job);
void qm_job_mark_running(qm_job *job);

/** Looks again at what the sleeping readers wait for. The caller holds the lock. */
void qm_job_wake_readers(qm_job *job);

/** Adds an event and wakes the readers; members comes without braces. The caller holds the lock. */
void qm_job_add_event(qm_job *job, const char *name, const char *members);

/** Puts an event behind the others and takes over its line, which may be NULL; false: out of memory. The
 * caller holds the lock. */
bool qm_job_put_event(qm_job *job, uint64_t seq, char *line);

/** {"event":NAME,"seq":N,MEMBERS} of the event to come, for the caller to free; NULL: out of memory. The
 * caller holds the lock. */
char *qm_job_make_event(const qm_job *job, const char *name, const char *members);

/** Adds the lines of the events from saved_count up to end to out; returns the seq of the first, or of the
 * event to come. The caller holds the lock. */
uint64_t qm_job_join_unsaved(const qm_job *job, size_t end, qm_text *out);

/** Reads the events of a job back that the store has; not QM_OK: those that could be read are there. */
qm_status qm_job_restore_events(qm_job *job);

/** Sets where the job's events are counted from: each run of it has numbers of its own, so that a reader of
 * one run goes on with the next. */
void qm_job_set_restarts(qm_job *job, int64_t restarts);

const char *qm_job_state_name(qm_job_state state);

/** The resource in a state; outcome is the members that only the end brings, or NULL. The caller holds the
 * lock. */
char *qm_job_write_document(const qm_job *job, qm_job_state state, const char *outcome);

/** No event will be added any more. The caller holds the lock. */
static inline bool qm_job_is_over(const qm_job *job)
{
    return job->state > QM_JOB_RUNNING || job->interrupted;
}

/** Runs a reconstruction_step that is marked as running to its end. */
void qm_job_run_steps(qm_job *job);

/** The end of a job with a result; it is stored before anybody hears of it. */
void qm_job_finish_with_result(qm_job *job, qm_job_state state, const qm_job_result *result);

/** The end of a job that the end of the daemon stopped: it runs again at the next start. */
void qm_job_interrupt(qm_job *job);

/** True when a client has asked the job to stop. */
bool qm_job_is_canceled(qm_job *job);

/** The task of a worker: runs the job if it is still to run, and gives back the worker's reference. */
void qm_job_run(void *job);

/** Ends a job that is marked as running with a problem. */
void qm_job_finish_with_problem(qm_job *job, qm_job_state state, const qm_problem *problem);

#endif
