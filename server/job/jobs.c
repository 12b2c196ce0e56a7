/**
 * jobs.c: the table of jobs: references, submission, and cancelation; its start, which queues the unfinished jobs of the
 * store, and its stop, which interrupts running ones.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/metrics.h"
#include "former_names.h"
#include "job_internal.h"
#include "job_mirrors.h"
#include "job_pulse.h"
#include "json_in.h"
#include "ops/json_out.h"
#include "store/store_problem.h"

#define JOB_NICENESS 5
#define DRAIN_STEP_MS 10
#define RESUME_STEP 64
#define ALONE_MS 10e3 /* for which a job that may kill the daemon begins alone */

/* ---- references ---- */

static void free_job(qm_job *job)
{
    for (size_t i = 0; i < job->event_count; i++)
        free(job->events[i]);
    free(job->events);
    free(job->last_progress);
    free(job->document);
    free(job->result);
    free(job->labels);
    free(job->key);
    qm_job_request_reset(&job->request);
    for (int i = 0; i < 2; i++) /* of a job that has not run */
        qm_meshes_release(job->jobs->meshes, job->given[i]);
    free(job);
}

void qm_job_drop_reference(qm_job *job)
{
    QM_ASSERT(qm_jobs_is_locked(job->jobs) && job->references > 0);
    if (--job->references == 0) free_job(job);
}

void qm_jobs_release(qm_jobs *jobs, qm_job *job)
{
    if (!job) return;
    uv_mutex_lock(&jobs->lock);
    qm_job_drop_reference(job);
    uv_mutex_unlock(&jobs->lock);
}

void qm_job_unlist(qm_job *job)
{
    QM_ASSERT(qm_jobs_is_locked(job->jobs));
    if (!job->listed) return;
    qm_job **link = &job->jobs->first;
    while (*link != job)
        link = &(*link)->next;
    *link = job->next;
    job->listed = false;
    qm_job_drop_reference(job);
}

const char *qm_job_id(const qm_job *job)
{
    return job->id;
}

/* ---- submitting ---- */

/* A request may hold many points: its hash stands for it. */
char *qm_job_make_key(const qm_job_request *request)
{
    qm_text written = {0}, key = {0};
    char hash[QM_HASH_SIZE];
    qm_json_write_request(&written, request);
    if (!written.failed) {
        qm_id_hash_text(written.data, written.size, hash);
        qm_text_printf(&key, "%s %s %s", QM_VERSION, qm_job_type_of(request->kind)->name, hash);
    }
    key.failed |= written.failed;
    qm_text_reset(&written);
    return qm_text_take(&key);
}

qm_job *qm_job_create(qm_jobs *jobs, qm_job_request *request, const char *client)
{
    qm_job *job = calloc(1, sizeof *job);
    if (!job) return NULL;
    job->jobs = jobs;
    job->key = qm_job_make_key(request);
    job->request = qm_job_request_take(request);
    job->labels = job->request.labels; /* which may change, and are no part of the request any more */
    job->request.labels = NULL;
    qm_id_make('j', job->id);
    qm_clock_format(job->created);
    job->submitted_ms = qm_clock_now_ms();
    snprintf(job->client, sizeof job->client, "%s", client);
    job->references = 1;
    return job;
}

void qm_job_list(qm_job *job)
{
    QM_ASSERT(qm_jobs_is_locked(job->jobs) && !job->listed);
    job->references++;
    job->listed = true;
    job->next = job->jobs->first;
    job->jobs->first = job;
}

void qm_job_enlist(qm_jobs *jobs, qm_job *job)
{
    QM_ASSERT(job->state == QM_JOB_QUEUED);
    uv_mutex_lock(&jobs->lock);
    qm_job_list(job);
    jobs->queued++;
    uv_mutex_unlock(&jobs->lock);
}

void qm_job_withdraw(qm_jobs *jobs, qm_job *job)
{
    uv_mutex_lock(&jobs->lock);
    if (job->state == QM_JOB_QUEUED) {
        QM_ASSERT(jobs->queued > 0);
        jobs->queued--;
        qm_job_unlist(job);
    }
    uv_mutex_unlock(&jobs->lock);
}

bool qm_job_enqueue_locked(qm_job *job)
{
    qm_jobs *jobs = job->jobs;
    QM_ASSERT(qm_jobs_is_locked(jobs));
    job->references++;
    int threads = job->request.threads > 0 ? job->request.threads : jobs->limits.threads;
    const qm_task task = {.run = qm_job_run,
                          .data = job,
                          .threads = threads,
                          .priority = job->request.priority,
                          .client = job->client,
                          .alone_ms = job->is_suspect ? ALONE_MS : 0.0};
    bool queued = qm_scheduler_submit(jobs->scheduler, &task, &job->turn);
    if (!queued) qm_job_drop_reference(job);
    return queued;
}

bool qm_job_enqueue(qm_jobs *jobs, qm_job *job)
{
    uv_mutex_lock(&jobs->lock);
    bool queued = qm_job_enqueue_locked(job);
    uv_mutex_unlock(&jobs->lock);
    return queued;
}

/** The job of a row that has ended; only the caller has it. qm_job_fetch_events loads its events. */
static qm_job *job_from_row(qm_jobs *jobs, const qm_store_job *row)
{
    qm_job *job = calloc(1, sizeof *job);
    if (!job) return NULL;
    job->jobs = jobs;
    memcpy(job->id, row->id, sizeof job->id);
    job->state = row->state;
    job->document = row->document ? strdup(row->document) : NULL;
    job->result = row->result ? strdup(row->result) : NULL;
    job->labels = row->labels ? strdup(row->labels) : NULL;
    qm_former_names_replace(job->document);
    qm_former_names_replace(job->result);
    job->references = 1;
    job->is_from_row = true;
    qm_job_set_restarts(job, row->restarts);
    return job;
}

static qm_job *find_listed(qm_jobs *jobs, const char *id)
{
    uv_mutex_lock(&jobs->lock);
    qm_job *job = jobs->first;
    while (job && strcmp(job->id, id) != 0)
        job = job->next;
    if (job) job->references++;
    uv_mutex_unlock(&jobs->lock);
    return job;
}

bool qm_job_is_listed(qm_jobs *jobs, const char *id)
{
    uv_mutex_lock(&jobs->lock);
    const qm_job *job = jobs->first;
    while (job && strcmp(job->id, id) != 0)
        job = job->next;
    uv_mutex_unlock(&jobs->lock);
    return job;
}

/** Puts labels in the place of those of a job in memory. */
static void replace_labels(qm_job *job, const char *labels)
{
    char *own = labels ? strdup(labels) : NULL;
    uv_mutex_lock(&job->jobs->lock);
    free(job->labels);
    job->labels = own;
    uv_mutex_unlock(&job->jobs->lock);
}

/** Reads the labels of a listed job, which another node may have changed. */
static void refresh_labels(qm_job *job)
{
    qm_store_job row;
    if (qm_store_find_job(job->jobs->store, job->id, &row) != QM_STORED) return;
    replace_labels(job, row.labels);
    qm_store_job_reset(&row);
}

bool qm_jobs_set_labels(qm_jobs *jobs, qm_job *job, const char *labels, qm_problem *problem)
{
    qm_stored stored = qm_store_set_job_labels(jobs->store, job->id, labels ? labels : "");
    if (stored == QM_STORED)
        replace_labels(job, labels);
    else
        *problem = stored == QM_STORED_NONE
                       ? qm_store_read_problem(stored, QM_PROBLEM_JOB_NOT_FOUND, "job %s", job->id)
                       : qm_store_write_problem(stored, "the labels of the job");
    return stored == QM_STORED;
}

qm_job *qm_jobs_find(qm_jobs *jobs, const char *id, qm_problem *problem)
{
    QM_ASSERT(id && problem);
    qm_store_job row;
    qm_job *job = find_listed(jobs, id);
    if (job && qm_store_is_shared(jobs->store)) refresh_labels(job);
    if (job) return job;
    qm_stored stored = qm_store_find_job(jobs->store, id, &row);
    if (stored != QM_STORED) {
        *problem = qm_store_read_problem(stored, QM_PROBLEM_JOB_NOT_FOUND, "job %s", id);
        return NULL;
    }
    *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for job %s", id);
    if (row.document)
        job = job_from_row(jobs, &row);
    else if (qm_store_is_shared(jobs->store))
        job = qm_job_mirrors_make(jobs, &row, problem);
    else /* it was inserted after the first search: its job has been listed since */
        job = find_listed(jobs, id);
    qm_store_job_reset(&row);
    return job;
}

/** True for a stored request with this key: its own may be of a version that wrote requests in other words. */
static bool has_key(const qm_store_job *row, const char *key)
{
    qm_job_request request;
    qm_problem problem;
    if (strcmp(row->key, key) == 0) return true;
    if (!row->body || !qm_json_read_job(row->body, strlen(row->body), &request, &problem)) return false;
    char *today = qm_job_make_key(&request);
    bool is_same = today && strcmp(today, key) == 0;
    free(today);
    qm_job_request_reset(&request);
    return is_same;
}

static qm_job *find_by_idempotency_key(qm_jobs *jobs, const char *key, const char *request_key,
                                       qm_problem *problem)
{
    qm_store_job row;
    qm_stored stored = qm_store_find_job_by_idempotency_key(jobs->store, key, &row);
    if (stored != QM_STORED) {
        if (stored != QM_STORED_NONE)
            *problem =
                qm_store_read_problem(stored, QM_PROBLEM_INTERNAL, "the jobs with this Idempotency-Key");
        return NULL;
    }
    qm_job *job = NULL;
    if (has_key(&row, request_key))
        job = qm_jobs_find(jobs, row.id, problem);
    else
        *problem = qm_problem_make(QM_PROBLEM_IDEMPOTENCY_MISMATCH,
                                   "the Idempotency-Key was used for a different request");
    qm_store_job_reset(&row);
    return job;
}

/** True when a list has all labels of another one. */
static bool has_labels(const char *list, const char *wanted)
{
    for (const char *at = wanted; at && *at && at[1]; at += 1 + strcspn(at + 1, "\n")) {
        char line[QM_MESH_LABEL_SIZE + 2];
        snprintf(line, sizeof line, "\n%.*s\n", (int)strcspn(at + 1, "\n"), at + 1);
        if (!list || !strstr(list, line)) return false;
    }
    return true;
}

qm_job *qm_job_find_cached(qm_jobs *jobs, const char *key, const char *revisions, const char *labels)
{
    qm_store_job row;
    if (qm_store_find_job_by_key(jobs->store, key, revisions, QM_JOB_SUCCEEDED, &row) != QM_STORED)
        return NULL;
    qm_job *job = has_labels(row.labels, labels) ? job_from_row(jobs, &row) : NULL;
    qm_store_job_reset(&row);
    return job;
}

/** A job of the table that computes the answer of this request, and may be waited for; NULL when there is none. The
 * caller holds the lock. */
static qm_job *find_leader(qm_jobs *jobs, const char *key, const char *revisions)
{
    for (qm_job *job = jobs->first; job; job = job->next)
        if (!qm_job_is_over(job) && !job->is_canceled && !job->is_lost && !job->on_end && !job->leader &&
            job->turn && job->expiry == QM_JOB_IN_TIME && strcmp(job->key, key) == 0 &&
            strcmp(job->submitted_revisions, revisions) == 0)
            return job;
    return NULL;
}

/** Lets a listed job follow one that computes the same; false when there is none. */
static bool follow(qm_jobs *jobs, qm_job *job)
{
    uv_mutex_lock(&jobs->lock);
    qm_job *leader = find_leader(jobs, job->key, job->submitted_revisions);
    if (leader) {
        job->leader = leader;
        job->next_follower = leader->followers;
        leader->followers = job;
        job->references++;
        if (leader->last_progress) qm_job_add_progress(job, leader->last_progress);
    }
    uv_mutex_unlock(&jobs->lock);
    return leader != NULL;
}

void qm_job_unfollow(qm_job *job)
{
    QM_ASSERT(qm_jobs_is_locked(job->jobs) && job->leader);
    qm_job **link = &job->leader->followers;
    while (*link != job)
        link = &(*link)->next_follower;
    *link = job->next_follower;
    job->leader = NULL;
}

/** True when this node is to run a job at once: an equal one runs here, or it is the home of what the job works on and
 * has a free worker. Writes the home. */
static bool claims_at_once(qm_jobs *jobs, const qm_job *job, bool may_follow, char home[QM_NODE_NAME_SIZE])
{
    if (qm_store_find_home(jobs->store, job->request.a, home) != QM_STORED) home[0] = '\0';
    uv_mutex_lock(&jobs->lock);
    bool has_leader = may_follow && find_leader(jobs, job->key, job->submitted_revisions);
    bool is_free = jobs->running + jobs->queued < (size_t)jobs->limits.workers;
    uv_mutex_unlock(&jobs->lock);
    return has_leader || (is_free && strcmp(home, jobs->limits.node) == 0);
}

/** What a client is told whose job is not stored. */
static qm_problem problem_from_submission(qm_jobs *jobs, qm_stored stored)
{
    if (stored == QM_STORED_FULL && qm_store_is_shared(jobs->store))
        return qm_problem_make(QM_PROBLEM_TOO_MANY_JOBS, "the queue is full: %d jobs are waiting",
                               jobs->limits.queue);
    return qm_store_write_problem(stored == QM_STORED ? QM_STORED_FAULT : stored, "the job");
}

/** The ids that a request names, separated by blanks; NULL: out of memory. */
static char *list_subjects(const qm_job_request *request)
{
    qm_text out = {0};
    qm_text_printf(&out, "%s %s", request->a, request->b);
    for (size_t i = 1; i < request->mesh_count; i++)
        qm_text_printf(&out, "%s%s", i > 1 ? " " : "", request->meshes[i].name);
    return qm_text_take(&out);
}

/**
 * Creates a job: stored before it is queued, so that a job which was accepted with 202 survives the daemon,
 * and listed before it is stored, so that an unfinished job of an embedded store is always in the table. One that waits
 * in the queue of a shared store is a mirror here.
 */
static qm_job *submit_new(qm_jobs *jobs, const qm_job_submission *submission, const char *revisions,
                          qm_problem *problem)
{
    qm_job *job = qm_job_create(jobs, submission->request, submission->client);
    if (!job) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the job");
        return NULL;
    }
    snprintf(job->submitted_revisions, sizeof job->submitted_revisions, "%s", revisions);
    bool may_follow = submission->use_cache && qm_job_type_of(job->request.kind)->is_pure;
    char home[QM_NODE_NAME_SIZE] = "";
    job->is_mirror = qm_store_is_shared(jobs->store) && !claims_at_once(jobs, job, may_follow, home);
    if (!job->is_mirror) qm_job_enlist(jobs, job);
    char *subjects = list_subjects(&job->request);
    qm_store_job row = {.key = job->key,
                        .idempotency_key = (char *)submission->idempotency_key,
                        .body = (char *)submission->body,
                        .type = qm_job_type_of(job->request.kind)->name,
                        .subjects = subjects,
                        .created = job->created,
                        .labels = job->labels,
                        .state = QM_JOB_QUEUED};
    memcpy(row.id, job->id, sizeof row.id);
    const qm_store_submission stored_submission = {.job = &row,
                                                   .home = home,
                                                   .limit = (size_t)jobs->limits.queue,
                                                   .is_claimed = !job->is_mirror,
                                                   .is_kept = !submission->owns_job};
    qm_stored stored = subjects ? qm_store_submit_job(jobs->store, &stored_submission) : QM_STORED_NO_MEMORY;
    free(subjects);
    bool is_stored = stored == QM_STORED;
    if (is_stored && (job->is_mirror || (may_follow && follow(jobs, job)) || qm_job_enqueue(jobs, job)))
        return job;
    if (is_stored) qm_store_delete_job(jobs->store, job->id);
    if (!job->is_mirror) qm_job_withdraw(jobs, job);
    qm_job *same = NULL; /* of a submission with the same idempotency key that was stored first */
    if (stored == QM_STORED_TAKEN)
        same = find_by_idempotency_key(jobs, submission->idempotency_key, job->key, problem);
    else
        *problem = problem_from_submission(jobs, stored);
    qm_jobs_release(jobs, job);
    return same;
}

/** The job that answers a request already, or NULL; with a problem when the request has a fault. */
static qm_job *find_answer(qm_jobs *jobs, const qm_job_submission *submission, const char *key,
                           char revisions[QM_REVISIONS_SIZE], bool *is_cached, qm_problem *problem)
{
    if (submission->idempotency_key) {
        qm_job *same = find_by_idempotency_key(jobs, submission->idempotency_key, key, problem);
        if (same || problem->code != QM_PROBLEM_COUNT) return same;
    }
    if (!qm_job_runner_of(submission->request->kind)->check(jobs, submission->request, revisions, problem))
        return NULL;
    bool may_be_cached = submission->use_cache && qm_job_type_of(submission->request->kind)->is_pure;
    qm_job *cached =
        may_be_cached ? qm_job_find_cached(jobs, key, revisions, submission->request->labels) : NULL;
    *is_cached = cached != NULL;
    return cached;
}

/** The request as the store has it; NULL: out of memory. */
static char *write_body(const qm_job_request *request)
{
    qm_text body = {0};
    qm_json_write_request(&body, request);
    return qm_text_take(&body);
}

qm_job *qm_jobs_submit(qm_jobs *jobs, const qm_job_submission *submission, bool *is_cached,
                       qm_problem *problem)
{
    QM_ASSERT(submission && submission->request && submission->body && is_cached && problem);
    *is_cached = false;
    bool has_hash = qm_job_names_hash(submission->request);
    if (!qm_job_resolve(jobs, submission->request, problem)) return NULL;
    *problem = (qm_problem){.code = QM_PROBLEM_COUNT};
    char *key = qm_job_make_key(submission->request);
    /* Whoever runs the job later reads the meshes that were meant now. */
    qm_job_submission resolved = *submission;
    char *body = has_hash ? write_body(submission->request) : NULL;
    if (body) resolved.body = body;
    if (!key || (has_hash && !body)) {
        free(key);
        free(body);
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the job");
        return NULL;
    }
    qm_job *job = NULL;
    bool is_new = false, is_shared = qm_store_is_shared(jobs->store), is_unwanted;
    char revisions[QM_REVISIONS_SIZE];
    uv_mutex_lock(&jobs->submitting);
    if (atomic_load(&jobs->closed))
        *problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the daemon is stopping and takes no new jobs");
    else
        job = find_answer(jobs, submission, key, revisions, is_cached, problem);
    if (!job && problem->code == QM_PROBLEM_COUNT) {
        is_new = is_shared || qm_jobs_count(jobs).queued < (size_t)jobs->limits.queue;
        if (is_new)
            job = submit_new(jobs, &resolved, revisions, problem);
        else
            *problem = qm_problem_make(QM_PROBLEM_TOO_MANY_JOBS, "the queue is full: %d jobs are waiting",
                                       jobs->limits.queue);
    }
    if (*is_cached) qm_metrics_add(QM_METRICS_CACHED_ANSWERS, 1);
    if (job && is_shared && !is_new)
        qm_store_hold_job(jobs->store, job->id, submission->owns_job ? 1 : 0, !submission->owns_job,
                          &is_unwanted);
    uv_mutex_lock(&jobs->lock);
    if (job && submission->owns_job) job->owners++;
    if (job && !submission->owns_job) job->is_kept = true; /* it runs on when all owners leave */
    uv_mutex_unlock(&jobs->lock);
    uv_mutex_unlock(&jobs->submitting);
    free(body);
    free(key);
    return job;
}

void qm_job_stop(qm_job *job)
{
    QM_ASSERT(qm_jobs_is_locked(job->jobs));
    atomic_store(&job->cancel, true);
    if (job->turn) qm_scheduler_hurry(job->turn);
}

void qm_job_lose(qm_job *job)
{
    QM_ASSERT(qm_jobs_is_locked(job->jobs));
    if (job->is_lost || qm_job_is_over(job)) return;
    job->is_lost = true;
    if (job->leader) { /* it gets a turn of its own, in which it ends */
        qm_job_unfollow(job);
        qm_job_enqueue_locked(job);
        qm_job_drop_reference(job);
    }
    qm_job_stop(job);
}

void qm_job_check_time(qm_job *job, double now_ms)
{
    if (job->is_mirror || qm_job_is_over(job) || job->expiry != QM_JOB_IN_TIME) return;
    if (job->request.deadline_ms > 0.0 && now_ms - job->submitted_ms >= job->request.deadline_ms)
        job->expiry = QM_JOB_PAST_DEADLINE;
    else if (job->state == QM_JOB_RUNNING && now_ms - job->started_ms >= job->jobs->limits.max_job_ms)
        job->expiry = QM_JOB_PAST_LIMIT;
    if (job->expiry == QM_JOB_IN_TIME) return;
    if (job->leader) { /* it gets a turn of its own, in which it ends */
        qm_job_unfollow(job);
        qm_job_enqueue_locked(job);
        qm_job_drop_reference(job);
    }
    qm_job_stop(job);
}

/** Asks the node that has a job to end it, or ends it where it waits. */
static bool cancel_mirror(qm_jobs *jobs, qm_job *job)
{
    const qm_problem problem = qm_problem_make(QM_PROBLEM_CONFLICT, "the job was canceled before it ran");
    qm_text object = {0}, last = {0};
    qm_json_write_problem(&object, &problem);
    char *text = qm_text_take(&object);
    if (text)
        qm_text_printf(&last, "\"state\":\"%s\",\"problem\":%s", qm_job_state_name(QM_JOB_CANCELED), text);
    char *members = qm_text_take(&last);
    uv_mutex_lock(&jobs->lock);
    char *document = text ? qm_job_write_members(job, QM_JOB_CANCELED, text) : NULL;
    const qm_store_event event = {job->id, qm_job_next_seq(job), "error", members};
    uv_mutex_unlock(&jobs->lock);
    qm_stored stored = text && members && document
                           ? qm_store_cancel_job(jobs->store, job->id, document, &event)
                           : QM_STORED_NO_MEMORY;
    free(text);
    free(members);
    free(document);
    qm_job_pulse_hurry(jobs);
    return stored == QM_STORED || stored == QM_STORED_LATE;
}

bool qm_job_cancel_noted(qm_jobs *jobs, qm_job *job)
{
    uv_mutex_lock(&jobs->lock);
    bool is_mirror = job->is_mirror && !qm_job_is_over(job);
    uv_mutex_unlock(&jobs->lock);
    if (is_mirror) return cancel_mirror(jobs, job);
    uv_mutex_lock(&jobs->lock);
    bool over = qm_job_is_over(job), queued = job->state == QM_JOB_QUEUED && !over;
    bool ends_here = queued || (job->is_loading && !over);
    if (!over) {
        job->is_canceled = true;
        qm_job_stop(job);
    }
    bool follows = queued && job->leader;
    if (follows) qm_job_unfollow(job);
    if (queued) qm_job_mark_running(job); /* so that no worker takes it */
    job->is_loading = false;
    uv_mutex_unlock(&jobs->lock);
    if (ends_here) {
        qm_problem problem = qm_problem_make(QM_PROBLEM_CONFLICT, "the job was canceled before it ran");
        qm_job_finish_with_problem(job, QM_JOB_CANCELED, &problem);
    }
    if (follows) qm_jobs_release(jobs, job);
    return !over;
}

bool qm_jobs_cancel(qm_jobs *jobs, qm_job *job)
{
    uv_mutex_lock(&jobs->lock);
    bool is_own = !job->is_mirror && !job->on_end;
    uv_mutex_unlock(&jobs->lock);
    bool is_asked = qm_job_cancel_noted(jobs, job);
    if (is_asked && is_own && qm_store_note_cancel(jobs->store, job->id) != QM_STORED)
        qm_log(QM_LOG_WARN, "job %s was canceled, which a restart would forget until the job has ended",
               job->id);
    return is_asked;
}

void qm_jobs_disown(qm_jobs *jobs, qm_job *job)
{
    bool is_shared = qm_store_is_shared(jobs->store);
    uv_mutex_lock(&jobs->lock);
    QM_ASSERT(job->owners > 0);
    bool ends = --job->owners == 0 && !job->is_kept && !is_shared;
    if (is_shared &&
        job->disowners++ == 0) { /* the pulse tells the store, which knows the owners at other nodes */
        job->references++;
        job->next_disowned = jobs->disowned;
        jobs->disowned = job;
    }
    uv_mutex_unlock(&jobs->lock);
    if (ends) qm_job_cancel_noted(jobs, job);
}

qm_job_counts qm_jobs_count(qm_jobs *jobs)
{
    uv_mutex_lock(&jobs->lock);
    qm_job_counts counts = {jobs->queued, jobs->running, qm_scheduler_count_paused(jobs->scheduler)};
    uv_mutex_unlock(&jobs->lock);
    return counts;
}

/* ---- start and stop ---- */

void qm_job_set_row(qm_job *job, const qm_store_job *row)
{
    free(job->labels);
    job->labels = row->labels ? strdup(row->labels) : NULL;
    memcpy(job->id, row->id, sizeof job->id);
    snprintf(job->created, sizeof job->created, "%s", row->created);
    qm_job_set_restarts(job, row->restarts);
}

/** A job of a row, with its events so far, queued; NULL: out of memory. */
static qm_job *job_of_claim(qm_jobs *jobs, const qm_store_job *row, bool *is_readable, qm_problem *problem)
{
    qm_job_request request;
    qm_job *job = qm_job_mirrors_take(jobs, row);
    *is_readable = true;
    if (job) return job;
    *is_readable = qm_json_read_job(row->body, strlen(row->body), &request, problem);
    job = qm_job_create(jobs, &request, "");
    qm_job_request_reset(&request);
    if (!job) return NULL;
    qm_job_set_row(job, row);
    if (qm_job_restore_events(job) != QM_STORED)
        qm_log(QM_LOG_ERROR, "the events of job %s so far cannot be read", job->id);
    qm_job_enlist(jobs, job);
    return job;
}

void qm_jobs_resume(qm_jobs *jobs, const qm_store_job *row)
{
    qm_problem problem;
    bool is_readable;
    qm_job *job = job_of_claim(jobs, row, &is_readable, &problem);
    if (!job) {
        qm_log(QM_LOG_ERROR, "out of memory: job %s cannot run again", row->id);
        return;
    }
    uv_mutex_lock(&jobs->lock);
    job->is_kept = true; /* its streams ended with the daemon: no client owns it */
    job->is_suspect = row->deaths == QM_STORE_MAX_DEATHS - 1;
    /* Its deadline counts from the submission, which another node may have taken. */
    job->submitted_ms = qm_clock_now_ms() - MS_PER_S * row->waited_s;
    if (row->restarts > 0)
        qm_job_add_event(job, "server_restart",
                         qm_store_is_shared(jobs->store)
                             ? "\"detail\":\"another node goes on with the job: with the bounds of a long "
                               "search, else from its beginning\""
                             : "\"detail\":\"the daemon was restarted; the job goes on: with the bounds of a "
                               "long search, else from its beginning\"");
    uv_mutex_unlock(&jobs->lock);
    bool is_given_up = is_readable && row->deaths >= QM_STORE_MAX_DEATHS;
    if (is_given_up)
        problem = qm_problem_make(QM_PROBLEM_INTERNAL,
                                  "the daemon was killed %d times while the job ran: it is not started again",
                                  QM_STORE_MAX_DEATHS);
    if (is_given_up) qm_log(QM_LOG_ERROR, "job %s is given up: %s", job->id, problem.detail);
    if (!is_readable || is_given_up) {
        uv_mutex_lock(&jobs->lock);
        qm_job_mark_running(job);
        uv_mutex_unlock(&jobs->lock);
        qm_job_finish_with_problem(job, QM_JOB_FAILED, &problem);
    } else if (!qm_job_enqueue(jobs, job)) {
        qm_job_withdraw(jobs, job);
    } else if (row->is_canceled) {
        qm_job_cancel_noted(jobs, job);
    }
    qm_jobs_release(jobs, job);
}

/** Queues the jobs that were queued or running when the daemon last ended. */
static void resume_unfinished(qm_jobs *jobs)
{
    qm_store_job rows[RESUME_STEP];
    const qm_store_wish wish = {.free = RESUME_STEP};
    size_t total = 0, count;
    qm_stored stored;
    while ((stored = qm_store_claim_jobs(jobs->store, &wish, rows, &count)) == QM_STORED && count > 0) {
        for (size_t i = 0; i < count; i++) {
            qm_jobs_resume(jobs, &rows[i]);
            qm_store_job_reset(&rows[i]);
        }
        total += count;
    }
    if (stored != QM_STORED)
        qm_log(QM_LOG_ERROR, "there may be more unfinished jobs: the next start looks for them");
    if (total > 0) qm_log(QM_LOG_INFO, "%zu unfinished jobs queued again", total);
}

qm_jobs *qm_jobs_create(qm_store *store, qm_meshes *meshes, qm_reconstructions *reconstructions,
                        qm_job_limits limits)
{
    qm_jobs *jobs = calloc(1, sizeof *jobs);
    if (!jobs) return NULL;
    jobs->store = store;
    jobs->meshes = meshes;
    jobs->reconstructions = reconstructions;
    jobs->limits = limits;
    uv_mutex_init(&jobs->submitting);
    uv_mutex_init(&jobs->saving);
    uv_mutex_init(&jobs->lock);
    size_t begun = limits.workers < QM_JOBS_BEGUN ? QM_JOBS_BEGUN : (size_t)limits.workers;
    jobs->scheduler = qm_scheduler_create(limits.workers, begun, JOB_NICENESS);
    if (!qm_job_events_start_notifier(jobs) || !jobs->scheduler) {
        qm_jobs_destroy(jobs);
        return NULL;
    }
    bool is_shared = qm_store_is_shared(store);
    if (is_shared && !qm_job_pulse_start(jobs)) {
        qm_jobs_destroy(jobs);
        return NULL;
    }
    if (!is_shared) resume_unfinished(jobs);
    return jobs;
}

void qm_jobs_drain(qm_jobs *jobs)
{
    uv_mutex_lock(&jobs->submitting); /* no submission is half done */
    atomic_store(&jobs->closed, true);
    uv_mutex_unlock(&jobs->submitting);
    qm_job_pulse_close(jobs);
    double end = qm_clock_now_ms() + jobs->limits.grace_ms;
    while (qm_jobs_count(jobs).running > 0 && qm_clock_now_ms() < end) {
        uv_sleep(DRAIN_STEP_MS);
        qm_job_events_tick(jobs, qm_clock_now_ms());
    }
    uv_mutex_lock(&jobs->lock);
    for (qm_job *job = jobs->first; job; job = job->next)
        qm_job_stop(job);
    uv_mutex_unlock(&jobs->lock);
    qm_scheduler_close(jobs->scheduler);
    qm_job_events_save(jobs);
    qm_job_mirrors_end(jobs);
    if (qm_store_leave_jobs(jobs->store) != QM_STORED)
        qm_log(QM_LOG_ERROR, "the end could not be noted: it counts as a kill for the jobs that run");
}

void qm_jobs_destroy(qm_jobs *jobs)
{
    if (!jobs) return;
    if (jobs->scheduler && !atomic_load(&jobs->closed)) qm_jobs_drain(jobs);
    qm_job_pulse_stop(jobs);
    qm_scheduler_destroy(jobs->scheduler);
    qm_job_events_stop_notifier(jobs);
    uv_mutex_lock(&jobs->lock);
    while (jobs->first)
        qm_job_unlist(jobs->first);
    uv_mutex_unlock(&jobs->lock);
    uv_cond_destroy(&jobs->has_due);
    uv_mutex_destroy(&jobs->lock);
    uv_mutex_destroy(&jobs->saving);
    uv_mutex_destroy(&jobs->submitting);
    free(jobs);
}
