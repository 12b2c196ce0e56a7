/**
 * job_internal.h: what the files of the job table share: jobs.c (table, submission, start and stop), job_events.c (event
 * log, subscribers, notifier), job_mirrors.c and job_pulse.c (jobs of other nodes, and the node among them), jobs_list.c
 * (resources and lists), job_run.c (what a worker does with a job on meshes, and how jobs end), job_steps.c (the same
 * for reconstruction steps), job_matrix.c (the same for a set of meshes), job_made.c (for a job that makes a mesh), job_help.c (parts of searches of other nodes), job_batch.c (jobs that are lines of a file), job_once.c (jobs about meshes that
 * are not stored).
 *
 * "The lock" is qm_jobs.lock. A job is either stored, with a row, events and a document, or it lives in
 * memory alone and its end goes to on_end.
 */
#ifndef QM_JOB_INTERNAL_H
#define QM_JOB_INTERNAL_H

#include <uv.h>

#include "base/pool.h"
#include "job.h"

#define MS_PER_S 1e3
#define QM_REVISIONS_SIZE 128 /* of two meshes, with their notes: all that changes answers about them */

/** Never changed, and alive as long as its job: a holder of a reference to the job may read it without the
 * lock. */
typedef struct qm_job_event {
    uint64_t seq;
    char name[QM_EVENT_NAME_SIZE];
    char members[]; /* of its JSON object besides name and seq */
} qm_job_event;

/** How a job ended. */
typedef struct qm_job_outcome {
    qm_job_state state;
    const char *member; /* of the document: "result" or "problem" */
    const char *object; /* its value as JSON */
} qm_job_outcome;

/** Called at the end of a job that is not stored, under the lock. */
typedef void qm_job_end_fn(void *user, const qm_job_outcome *outcome);

/** Jobs that have begun and not ended: each keeps its meshes and its memory while it waits for a worker. */
#define QM_JOBS_BEGUN 64

/** Why the daemon ends a job. */
typedef enum qm_job_expiry { QM_JOB_IN_TIME, QM_JOB_PAST_DEADLINE, QM_JOB_PAST_LIMIT } qm_job_expiry;

struct qm_job {
    char id[QM_ID_SIZE];
    qm_job_request request;
    char *key;
    char created[QM_TIME_SIZE], started[QM_TIME_SIZE];
    double submitted_ms, started_ms; /* qm_clock_now_ms; the latter when it was marked as running */
    qm_job_expiry expiry;
    /* A job whose request equals that of one in the table follows it, in place of being computed: it is queued, but has
     * no turn, gets the events of its leader, and ends with its result. The leader has a reference. */
    qm_job *leader, *followers, *next_follower;
    char submitted_revisions[QM_REVISIONS_SIZE]; /* revisions of the meshes when it was submitted */
    qm_turn *turn; /* its place among the workers; NULL before it was queued and after it has ended */
    char client[QM_CLIENT_SIZE];
    qm_job_state state;
    atomic_bool cancel; /* polled by the engine: set by a client or by the end of the daemon */
    bool is_canceled;   /* by a client */
    bool is_loading;    /* its meshes are being read, which cannot be stopped: who clears this ends the job */
    qm_job *next_expired;  /* in a list of qm_job_events_tick */
    bool interrupted;      /* by the end of the daemon: it will run again */
    bool is_suspect;       /* one more death, and it is given up: it begins alone */
    int64_t restarts;      /* interrupted runs so far */
    uint64_t seq_base;     /* events up to this number belong to them */
    qm_job_event **events; /* by seq */
    size_t event_count, event_capacity;
    size_t saved_count;   /* the first ones, which the store has taken */
    size_t durable_count; /* the first of these, which no failure of a server takes away any more */
    bool is_from_row;     /* made of a row of the store, without events until qm_job_fetch_events */
    char *last_progress;  /* the newest event's own members of those that tell progress, for the document */
    char *document;       /* members of the resource but for the result, once the job has ended */
    char *result;         /* the result object, or NULL */
    char *labels;         /* as of a mesh, or NULL */
    qm_mesh_ref
        *given[2]; /* meshes that no store has, in place of those that the request names; NULL: none */
    qm_job_end_fn *on_end; /* of a job that is not stored; NULL for stored ones */
    void *end_user;
    char revisions[QM_REVISIONS_SIZE]; /* of the meshes that it runs on; "" before */
    qm_subscriber *subscribers;
    int owners;     /* clients that stream it; it is canceled when the last one leaves */
    bool is_kept;   /* submitted without a stream: it runs on whichever client leaves */
    int references; /* the table counts as one while it is listed */
    bool listed;
    bool is_helper; /* runs parts of another node's search (job_help.h) */
    bool is_mirror; /* another node has the job (job_mirrors.h) */
    bool is_lost;   /* another node has taken the job over: nothing of this run may be stored or told */
    double read_ms; /* when a mirror was last seen to have a reader */
    int disowners;  /* owners that have left, which the store is to hear of */
    qm_jobs *jobs;
    qm_job *next, *next_disowned;
};

/** The one helper of a node. */
#define QM_JOB_HELP_REFUSED 16
typedef struct qm_job_help {
    qm_job *job;                                   /* that runs as the helper, or NULL */
    char helped[QM_ID_SIZE];                       /* job whose search the helper runs parts of */
    char refused[QM_JOB_HELP_REFUSED][QM_ID_SIZE]; /* the last jobs that it could not help */
    size_t refusals;
    double next_look_ms;
} qm_job_help;

struct qm_jobs {
    qm_store *store;
    qm_meshes *meshes;
    qm_reconstructions *reconstructions;
    qm_job_limits limits;
    qm_scheduler *scheduler;
    /* Two outer locks, taken before the lock: one submission at a time looks for an answer, else queues; one
     * thread at a time saves events. */
    uv_mutex_t submitting, saving;
    uv_mutex_t lock;
    qm_job *first;              /* jobs that have not ended, in no order */
    qm_subscriber *subscribers; /* of batches */
    qm_subscriber *due;         /* no longer waiting, and not yet woken */
    uv_cond_t has_due;
    uv_thread_t notifier;
    bool has_notifier, notifier_ends;
    size_t queued, running;
    qm_job *disowned;           /* jobs with disowners, a reference each */
    struct qm_job_pulse *pulse; /* of a shared store, or NULL */
    qm_job_help help;
    atomic_bool closed;
};

/** True while any thread holds the lock; for assertions of functions whose caller holds it. */
static inline bool qm_jobs_is_locked(qm_jobs *jobs)
{
    if (uv_mutex_trylock(&jobs->lock) != 0) return true;
    uv_mutex_unlock(&jobs->lock);
    return false;
}

/** The thread that notifies subscribers; ended by qm_job_events_stop_notifier. */
bool qm_job_events_start_notifier(qm_jobs *jobs);

/** Has the subscriber notified if it waits. The caller holds the lock. */
void qm_job_events_notify(qm_jobs *jobs, qm_subscriber *subscriber);

/** Calls suspend, until the subscriber is notified. The caller holds the lock. */
void qm_job_wait(qm_jobs *jobs, qm_subscriber *subscriber, void (*suspend)(void *user));

/** The key of a request: requests with one key have one result on the same revisions of their meshes. NULL:
 * out of memory. */
char *qm_job_make_key(const qm_job_request *request);

/** A new job of a client, not yet in the table; takes over the points of the request. NULL: out of memory. */
qm_job *qm_job_create(qm_jobs *jobs, qm_job_request *request, const char *client);

/** Lists a job, with a reference. The caller holds the lock. */
void qm_job_list(qm_job *job);

/** Sets what a row says of a job that was made of its request. */
void qm_job_set_row(qm_job *job, const qm_store_job *row);

/** Queues the job of a row that this process has claimed. */
void qm_jobs_resume(qm_jobs *jobs, const qm_store_job *row);

/** Ends the run of a job that is no longer this node's. The caller holds the lock. */
void qm_job_lose(qm_job *job);

/** Adds a queued job to the table; gives a listed one to the workers (false: it will not run); removes one
 * that will not run from the table. */
void qm_job_enlist(qm_jobs *jobs, qm_job *job);
bool qm_job_enqueue(qm_jobs *jobs, qm_job *job);
bool qm_job_enqueue_locked(qm_job *job); /* the same for a caller who holds the lock */
void qm_job_withdraw(qm_jobs *jobs, qm_job *job);

/** True for a request that names a mesh by the hash of its file. */
bool qm_job_names_hash(const qm_job_request *request);

/** Puts ids in the place of such hashes. False with a problem. */
bool qm_job_resolve(qm_jobs *jobs, qm_job_request *request, qm_problem *problem);

/** What a kind of job works on decides how the daemon checks its request and runs it. */
typedef struct qm_job_runner {
    /** False with a problem when something that the request names does not exist; else writes the revisions
     * of the meshes as text. */
    bool (*check)(qm_jobs *jobs, const qm_job_request *request, char revisions[QM_REVISIONS_SIZE],
                  qm_problem *problem);
    /** Runs a job that is marked as running to its end. */
    void (*run)(qm_job *job);
} qm_job_runner;
extern const qm_job_runner qm_job_steps_runner, qm_job_matrix_runner;
const qm_job_runner *qm_job_runner_of(qm_job_kind kind);

/** True for a job in memory, one that runs here or a mirror. */
bool qm_job_is_listed(qm_jobs *jobs, const char *id);

/** A finished job of this key that ran on these revisions and has these labels, or NULL. */
qm_job *qm_job_find_cached(qm_jobs *jobs, const char *key, const char *revisions, const char *labels);

/** Subscribers as a list. The caller holds the lock. */
void qm_job_subscribers_add(qm_subscriber **list, qm_subscriber *subscriber);
void qm_job_subscribers_remove(qm_subscriber **list, qm_subscriber *subscriber);

/** The caller of these holds the lock. */
void qm_job_drop_reference(qm_job *job);
void qm_job_unlist(qm_job *job);
void qm_job_mark_running(qm_job *job);

/** True, after a moment, when a run that met this problem is to try again: a shared store did not answer, and the job may
 * go on. The caller has left its worker. */
bool qm_job_outlasts(qm_job *job, const qm_problem *problem);

/** True when a run that met this problem has no end: the store did not answer, and the job runs again, as the daemon stops
 * or another node has the job. */
bool qm_job_runs_again(qm_job *job, const qm_problem *problem);

/** Takes a job that follows another one away from it, with the reference that the leader had. */
void qm_job_unfollow(qm_job *job);

/** Ends a job whose time is over; called now and then. */
void qm_job_check_time(qm_job *job, double now_ms);

/** Raises the cancel flag; a job that is paused or waits goes on at once, to its end. */
void qm_job_stop(qm_job *job);
/** qm_jobs_cancel without a note in the store, which knows already or need not know. */
bool qm_job_cancel_noted(qm_jobs *jobs, qm_job *job);

/** Notifies all subscribers of a job. The caller holds the lock. */
void qm_job_notify_all(qm_job *job);

/** Adds an event and notifies the subscribers; does nothing for a job that is not stored. The caller holds
 * the lock. */
void qm_job_add_event(qm_job *job, const char *name, const char *members);

/** Adds an event of progress, of the name that these have for the kind of the job, and keeps its members for the document. The
 * caller holds the lock. */
void qm_job_add_progress(qm_job *job, const char *members);

/** The number of the event to come. The caller holds the lock. */
uint64_t qm_job_next_seq(const qm_job *job);

/** The number of the last event, or 0. */
uint64_t qm_job_last_seq(const qm_job *job);

/** Adds an event that the store has to a mirror; false: out of memory. The caller holds the lock. */
bool qm_job_take_event(qm_job *job, const qm_store_event *event);

/** Writes the events from one up to another one. They live as long as the job. The caller holds the lock. */
void qm_job_list_events(const qm_job *job, size_t begin, size_t end, qm_store_event *out);

/** Takes note of the events of a job that a shared store has for good: their number, and that of the last one. Others that it
 * had taken are saved again. A qm_store_durable_fn with the jobs as its user. */
void qm_job_events_note_durable(void *jobs, const char *id, size_t count, uint64_t last);

/** Reads the stored events of a job back. After an error the job has those that could be read. */
qm_stored qm_job_restore_events(qm_job *job);

/** Sets where events are numbered from: each run has numbers of its own, so that a client which has read
 * events of one run continues with the next. */
void qm_job_set_restarts(qm_job *job, int64_t restarts);

const char *qm_job_state_name(qm_job_state state);

/** Members of the resource in a state but for the result; problem is an object, or NULL. NULL: out of memory.
 * The caller holds the lock. */
char *qm_job_write_members(const qm_job *job, qm_job_state state, const char *problem);

/** No event will be added any more. The caller holds the lock. */
static inline bool qm_job_is_over(const qm_job *job)
{
    return job->state > QM_JOB_RUNNING || job->interrupted;
}

/** Ends a job with a result; it is stored before any subscriber is notified. */
void qm_job_finish_with_result(qm_job *job, qm_job_state state, const qm_job_result *result);

/** The end of a job in two steps: stored with an effect, then announced. */
typedef struct qm_job_end {
    qm_job_outcome outcome;
    char *object, *event; /* the outcome's object, and the members of the last event */
    qm_store_job row;     /* document and result are the job's once it is announced */
    bool is_stored;
} qm_job_end;

/** Stores the end of a job with a result and an effect or NULL, all or nothing. Unless it is QM_STORED there is no
 * end. */
qm_stored qm_job_store_end(qm_job *job, qm_job_state state, const qm_job_result *result,
                           const qm_store_effect *effect, qm_job_end *end);
/** Ends the job, notifies its subscribers, and frees end. */
void qm_job_announce_end(qm_job *job, qm_job_end *end);

/** Stores the mesh that the result of a running job brings together with the job's end, and announces it; or ends the job with the
 * problem of that. */
void qm_job_finish_with_mesh(qm_job *job, qm_context *ctx, qm_job_result *result);

/** Tells each stage of a remeshing as progress. */
typedef struct qm_job_stages {
    qm_job *job;
    double diagonal, start_ms;
} qm_job_stages;
void qm_job_tell_stage(void *stages, const qm_remesh_stage *stage);

/** Ends the run of a job because the daemon stops: a stored one runs again at the next start, one that is not
 * stored ends as canceled. */
void qm_job_interrupt(qm_job *job);

/** Marks a running job as one whose meshes are being read. Until the end of that, another thread may end it. */
void qm_job_begin_loading(qm_job *job);

/** False when the job has been ended meanwhile, and its caller has nothing more to do for it. */
bool qm_job_end_loading(qm_job *job);

/** True when a client has canceled the job. */
bool qm_job_is_canceled(qm_job *job);

/** The task of a worker: runs the job if it is still queued, and drops the worker's reference. */
void qm_job_run(void *job);

/** Why the daemon has ended the run of a job that no client has canceled, and the problem of a job that has no result. */
qm_job_expiry qm_job_get_expiry(qm_job *job);
qm_problem qm_job_expiry_problem(const qm_job *job, qm_job_expiry expiry);

/** Sets the threads and the memory of a request that names none, or too much. */
void qm_job_set_limits(const qm_job *job, qm_job_request *request);

/** Lets the engine poll the job's flags, and use the host's threads. */
void qm_job_set_context(qm_job *job, qm_context *ctx);

/** Begins the run of a job on meshes: fills the context, and returns the request with what is left of its time. */
qm_job_request qm_job_begin_run(qm_job *job, qm_context *ctx);

/** Ends it with a result or a status; fault is the problem behind the status, or NULL. Frees the result. */
void qm_job_end_run(qm_job *job, qm_context *ctx, qm_status status, qm_job_result *result,
                    const qm_problem *fault);

/** Takes a mesh where a request has it: moved when it has a pose. NULL with a problem. */
qm_mesh_ref *qm_job_acquire(qm_meshes *meshes, const char *id, const qm_job_pose *pose, qm_notes *notes,
                            qm_problem *problem);

/** How many meshes a request names; the pointer to one of them in its JSON. */
#define QM_JOB_POINTER_SIZE 40
size_t qm_job_count_meshes(const qm_job_request *request);
void qm_job_point_to_mesh(const qm_job_request *request, size_t i, char pointer[QM_JOB_POINTER_SIZE]);

/** Finds the states of all of them, in one step of the store; false with a problem, which points to one that there is not. */
bool qm_job_find_meshes(qm_jobs *jobs, const qm_job_request *request, qm_store_mesh_state *out,
                        qm_problem *problem);

/** Ends a job that is marked as running with a problem. */
void qm_job_finish_with_problem(qm_job *job, qm_job_state state, const qm_problem *problem);

#endif
