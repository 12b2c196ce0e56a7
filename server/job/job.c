#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/metrics.h"
#include "job_internal.h"
#include "ops/json_out.h"

/* ---- references ---- */

static void free_job(qm_job *job)
{
    for (size_t i = 0; i < job->event_count; i++)
        free(job->events[i].line);
    free(job->events);
    free(job->last_bounds);
    free(job->document);
    free(job->key);
    qm_job_request_reset(&job->request);
    qm_batch_line_reset(&job->line);
    free(job);
}

void qm_job_drop_reference(qm_job *job)
{
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
        qm_hash_text(written.data, written.size, hash);
        qm_text_printf(&key, "%s %s %s", QM_VERSION, qm_job_type_of(request->kind)->name, hash);
    }
    key.failed |= written.failed;
    qm_text_reset(&written);
    return qm_text_take(&key);
}

qm_job *qm_job_create(qm_jobs *jobs, qm_job_request *request)
{
    qm_job *job = calloc(1, sizeof *job);
    if (!job) return NULL;
    job->jobs = jobs;
    job->key = qm_job_make_key(request);
    job->request = *request;
    request->points = NULL;
    request->point_count = 0;
    qm_id_make('j', job->id);
    qm_time_format(job->created);
    job->references = 1;
    return job;
}

void qm_job_enlist(qm_jobs *jobs, qm_job *job)
{
    uv_mutex_lock(&jobs->lock);
    job->references++;
    job->listed = true;
    job->next = jobs->first;
    jobs->first = job;
    jobs->queued++;
    uv_mutex_unlock(&jobs->lock);
}

void qm_job_withdraw(qm_jobs *jobs, qm_job *job)
{
    uv_mutex_lock(&jobs->lock);
    if (job->state == QM_JOB_QUEUED) {
        jobs->queued--;
        qm_job_unlist(job);
    }
    uv_mutex_unlock(&jobs->lock);
}

bool qm_job_enqueue(qm_jobs *jobs, qm_job *job)
{
    uv_mutex_lock(&jobs->lock);
    job->references++;
    bool queued = qm_pool_submit(jobs->pool, qm_job_run, job);
    if (!queued) qm_job_drop_reference(job);
    uv_mutex_unlock(&jobs->lock);
    return queued;
}

/** A job of the store that has ended, as one in memory that belongs to the caller alone. Its events are read
 * when they are asked for. */
static qm_job *job_from_row(qm_jobs *jobs, const qm_store_job *row)
{
    qm_job *job = calloc(1, sizeof *job);
    if (!job) return NULL;
    job->jobs = jobs;
    memcpy(job->id, row->id, sizeof job->id);
    job->state = (qm_job_state)row->state;
    job->document = row->document ? strdup(row->document) : NULL;
    job->references = 1;
    job->is_stored = true;
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

qm_job *qm_jobs_find(qm_jobs *jobs, const char *id, qm_problem *problem)
{
    qm_store_job row;
    qm_job *job = find_listed(jobs, id);
    if (job) return job;
    qm_status status = qm_store_find_job(jobs->store, id, &row);
    if (status != QM_OK) {
        *problem = qm_problem_from_store(status, QM_PROBLEM_JOB_NOT_FOUND, "job %s", id);
        return NULL;
    }
    /* A row without a document came between the two looks: its job has been listed since. */
    job = row.document ? job_from_row(jobs, &row) : find_listed(jobs, id);
    if (!job) *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "there is no memory for job %s", id);
    qm_store_job_reset(&row);
    return job;
}

static qm_job *find_by_idempotency_key(qm_jobs *jobs, const char *key, const char *request_key,
                                       qm_problem *problem)
{
    qm_store_job row;
    qm_status status = qm_store_find_job_by_idempotency_key(jobs->store, key, &row);
    if (status != QM_OK) {
        if (status != QM_E_EMPTY)
            *problem = qm_problem_from_store(status, QM_PROBLEM_INTERNAL, "jobs of this key");
        return NULL;
    }
    qm_job *job = NULL;
    if (strcmp(row.key, request_key) == 0)
        job = qm_jobs_find(jobs, row.id, problem);
    else
        *problem = qm_problem_make(QM_PROBLEM_IDEMPOTENCY_MISMATCH,
                                   "this Idempotency-Key came with another request");
    qm_store_job_reset(&row);
    return job;
}

qm_job *qm_job_find_cached(qm_jobs *jobs, const char *key, const char *revisions)
{
    qm_store_job row;
    if (qm_store_find_job_by_key(jobs->store, key, revisions, QM_JOB_SUCCEEDED, &row) != QM_OK) return NULL;
    qm_job *job = job_from_row(jobs, &row);
    qm_store_job_reset(&row);
    return job;
}

static bool check_mesh(qm_jobs *jobs, const char *id, const char *field, uint64_t *revision,
                       qm_problem *problem)
{
    qm_store_mesh row;
    qm_status status = qm_store_find_mesh(jobs->store, id, &row);
    if (status == QM_OK) {
        *revision = row.revision;
        qm_store_mesh_reset(&row);
        return true;
    }
    char pointer[32];
    snprintf(pointer, sizeof pointer, "/%s", field);
    *problem = qm_problem_from_store(status, QM_PROBLEM_MESH_NOT_FOUND, "mesh of the id given in %s", field);
    if (status == QM_E_EMPTY) qm_problem_add_pointer(problem, pointer, "no such mesh");
    return false;
}

void qm_job_write_revisions(uint64_t a, uint64_t b, char out[QM_REVISIONS_SIZE])
{
    snprintf(out, QM_REVISIONS_SIZE, "%llu %llu", (unsigned long long)a, (unsigned long long)b);
}

static bool check_reconstruction(qm_jobs *jobs, const char *id, qm_problem *problem)
{
    qm_store_reconstruction row;
    qm_status status = qm_store_find_reconstruction(jobs->store, id, &row);
    if (status == QM_OK) {
        qm_store_reconstruction_reset(&row);
        return true;
    }
    *problem =
        qm_problem_from_store(status, QM_PROBLEM_RECONSTRUCTION_NOT_FOUND, "reconstruction of this id");
    if (status == QM_E_EMPTY) qm_problem_add_pointer(problem, "/reconstruction", "no such reconstruction");
    return false;
}

bool qm_job_check_meshes(qm_jobs *jobs, const qm_job_request *request, char revisions[QM_REVISIONS_SIZE],
                         qm_problem *problem)
{
    if (request->kind == QM_JOB_RECONSTRUCTION_STEP) return check_reconstruction(jobs, request->a, problem);
    const char *const *field = qm_job_type_of(request->kind)->mesh_field;
    uint64_t a = 0, b = 0;
    bool are_there = check_mesh(jobs, request->a, field[0], &a, problem) &&
                     (!field[1] || check_mesh(jobs, request->b, field[1], &b, problem));
    qm_job_write_revisions(a, b, revisions);
    return are_there;
}

static bool is_open(qm_jobs *jobs, qm_problem *problem)
{
    if (!atomic_load(&jobs->closed)) return true;
    *problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the daemon is stopping and takes no new jobs");
    return false;
}

static bool has_room(qm_jobs *jobs, qm_problem *problem)
{
    if (qm_jobs_count(jobs).queued < (size_t)jobs->limits.queue) return true;
    *problem = qm_problem_make(QM_PROBLEM_TOO_MANY_JOBS, "%d jobs wait already", jobs->limits.queue);
    return false;
}

static bool store_new(qm_jobs *jobs, qm_job *job, const qm_job_submission *submission)
{
    qm_store_job row = {.key = job->key,
                        .idempotency_key = (char *)submission->idempotency_key,
                        .body = (char *)submission->body,
                        .created = job->created,
                        .state = QM_JOB_QUEUED};
    memcpy(row.id, job->id, sizeof row.id);
    return qm_store_submit_job(jobs->store, &row) == QM_OK;
}

/**
 * A new job: stored before it is queued, so that what is answered with 202 survives the daemon, and listed
 * before it is stored, so that an unfinished job of the store is always found in the table.
 */
static qm_job *submit_new(qm_jobs *jobs, const qm_job_submission *submission, qm_problem *problem)
{
    qm_job *job = qm_job_create(jobs, submission->request);
    if (!job) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "there is no memory for the job");
        return NULL;
    }
    qm_job_enlist(jobs, job);
    bool stored = store_new(jobs, job, submission);
    if (stored && qm_job_enqueue(jobs, job)) return job;
    if (stored) qm_store_delete_job(jobs->store, job->id);
    qm_job_withdraw(jobs, job);
    qm_jobs_release(jobs, job);
    *problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the job could not be stored");
    return NULL;
}

/** The job that answers a request already. NULL with a problem when the request cannot be answered at all. */
static qm_job *find_answer(qm_jobs *jobs, const qm_job_submission *submission, const char *key,
                           bool *is_cached, qm_problem *problem)
{
    if (submission->idempotency_key) {
        qm_job *same = find_by_idempotency_key(jobs, submission->idempotency_key, key, problem);
        if (same || problem->code != QM_PROBLEM_COUNT) return same;
    }
    char revisions[QM_REVISIONS_SIZE];
    if (!qm_job_check_meshes(jobs, submission->request, revisions, problem)) return NULL;
    bool may_be_cached = submission->use_cache && qm_job_type_of(submission->request->kind)->is_pure;
    qm_job *cached = may_be_cached ? qm_job_find_cached(jobs, key, revisions) : NULL;
    *is_cached = cached != NULL;
    return cached;
}

/** Notes whether the leaving of the one who asks is to end the job. */
static void add_owner(qm_jobs *jobs, qm_job *job, bool owns)
{
    uv_mutex_lock(&jobs->lock);
    if (owns)
        job->owners++;
    else
        job->is_kept = true;
    uv_mutex_unlock(&jobs->lock);
}

qm_job *qm_jobs_submit(qm_jobs *jobs, const qm_job_submission *submission, bool *is_cached,
                       qm_problem *problem)
{
    *is_cached = false;
    *problem = (qm_problem){.code = QM_PROBLEM_COUNT};
    char *key = qm_job_make_key(submission->request);
    if (!key) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "there is no memory for the job");
        return NULL;
    }
    qm_job *job = NULL;
    uv_mutex_lock(&jobs->submitting);
    if (is_open(jobs, problem)) job = find_answer(jobs, submission, key, is_cached, problem);
    if (!job && problem->code == QM_PROBLEM_COUNT && has_room(jobs, problem))
        job = submit_new(jobs, submission, problem);
    if (*is_cached) qm_metrics_add(QM_METRICS_CACHED_ANSWERS, 1);
    if (job) add_owner(jobs, job, submission->owns_job);
    uv_mutex_unlock(&jobs->submitting);
    free(key);
    return job;
}

bool qm_jobs_cancel(qm_jobs *jobs, qm_job *job)
{
    uv_mutex_lock(&jobs->lock);
    bool over = qm_job_is_over(job), queued = job->state == QM_JOB_QUEUED && !over;
    if (!over) job->is_canceled = true;
    atomic_store(&job->cancel, true);
    if (queued) qm_job_mark_running(job); /* so that no worker takes it */
    uv_mutex_unlock(&jobs->lock);
    if (queued) {
        qm_problem problem = qm_problem_make(QM_PROBLEM_CONFLICT, "the job was canceled before it ran");
        qm_job_finish_with_problem(job, QM_JOB_CANCELED, &problem);
    }
    return !over;
}

void qm_jobs_disown(qm_jobs *jobs, qm_job *job)
{
    uv_mutex_lock(&jobs->lock);
    bool ends = --job->owners == 0 && !job->is_kept;
    uv_mutex_unlock(&jobs->lock);
    if (ends) qm_jobs_cancel(jobs, job);
}

qm_job_counts qm_jobs_count(qm_jobs *jobs)
{
    uv_mutex_lock(&jobs->lock);
    qm_job_counts counts = {jobs->queued, jobs->running};
    uv_mutex_unlock(&jobs->lock);
    return counts;
}
