/**
 * job_run.c: what a worker does with a job, and how a job ends.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/metrics.h"
#include "base/parallel.h"
#include "job_internal.h"
#include "ops/json_out.h"
#include "store/result_file.h"

#define MS_PER_S 1e3

/* ---- the end of a job ---- */

/** Stores the document and what events the store lacks, the one to come included. */
static bool store_end(qm_job *job, qm_job_state state, const char *document, const char *name,
                      const char *members)
{
    qm_text lines = {0};
    uv_mutex_lock(&job->jobs->lock);
    uint64_t seq = qm_job_join_unsaved(job, job->event_count, &lines);
    char *last = qm_job_make_event(job, name, members);
    uv_mutex_unlock(&job->jobs->lock);
    qm_text_printf(&lines, "%s\n", last ? last : "");
    bool is_whole = last && !lines.failed;
    qm_store_events events = {job->id, seq, lines.data};
    bool stored =
        is_whole && qm_store_finish_job(job->jobs->store, &events, state, document, job->revisions) == QM_OK;
    qm_text_reset(&lines);
    free(last);
    return stored;
}

/** Stores the outcome, then tells the readers. name and members make the terminal event. Only who runs it
 * ends a job. */
static void finish(qm_job *job, qm_job_state state, const char *name, const char *members)
{
    qm_jobs *jobs = job->jobs;
    qm_metrics_add_job(qm_job_type_of(job->request.kind)->name, qm_job_state_name(state),
                       (qm_now_ms() - job->started_ms) / MS_PER_S);
    if (job->line.batch) {
        qm_batch_end_line(job, state, members);
        return;
    }
    qm_text outcome = {0};
    qm_text_printf(&outcome, "\"state\":\"%s\",%s", qm_job_state_name(state), members);
    char *event = qm_text_take(&outcome);
    uv_mutex_lock(&jobs->lock);
    char *document = qm_job_write_document(job, state, members);
    uv_mutex_unlock(&jobs->lock);
    bool stored = document && event && store_end(job, state, document, name, event);
    if (!stored) qm_log(QM_LOG_ERROR, "the end of job %s could not be stored: it is kept in memory", job->id);
    uv_mutex_lock(&jobs->lock);
    jobs->running--;
    job->state = state;
    job->document = document;
    qm_job_add_event(job, name, event ? event : members);
    if (stored) qm_job_unlist(job);
    uv_mutex_unlock(&jobs->lock);
    free(event);
}

void qm_job_finish_with_problem(qm_job *job, qm_job_state state, const qm_problem *problem)
{
    qm_text members = {0};
    qm_text_add_string(&members, "\"problem\":");
    qm_json_write_problem(&members, problem);
    char *text = qm_text_take(&members);
    finish(job, state, "error", text ? text : "\"problem\":null");
    free(text);
}

void qm_job_finish_with_result(qm_job *job, qm_job_state state, const qm_job_result *result)
{
    qm_text members = {0};
    qm_text_add_string(&members, "\"result\":");
    qm_json_write_result(&members, &job->request, result);
    char *text = qm_text_take(&members);
    finish(job, state, "result", text ? text : "\"result\":null");
    free(text);
}

/** A job of a batch ends with it, as it is not stored. */
static void refuse(qm_job *job)
{
    qm_problem problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the daemon is stopping");
    qm_job_finish_with_problem(job, QM_JOB_CANCELED, &problem);
}

/** The daemon ends: readers are told, the store keeps the job as one that has not run. */
void qm_job_interrupt(qm_job *job)
{
    if (job->line.batch) {
        refuse(job);
        return;
    }
    uv_mutex_lock(&job->jobs->lock);
    job->interrupted = true;
    qm_job_add_event(job, "server_shutdown",
                     "\"detail\":\"the daemon is stopping; the job runs again when it is back\"");
    qm_job_wake_readers(job);
    uv_mutex_unlock(&job->jobs->lock);
}

/* ---- running ---- */

typedef struct progress_target {
    qm_job *job;
    double diagonal;
} progress_target;

/** The members of an object in place: its braces are cut off. */
static char *bare_members(char *object)
{
    object[strlen(object) - 1] = '\0';
    return object + 1;
}

static void on_progress(void *user, const qm_hausdorff_progress *progress)
{
    const progress_target *target = user;
    qm_text line = {0};
    qm_json_write_bounds(&line, progress, target->diagonal);
    char *text = qm_text_take(&line);
    if (!text) return;
    char *members = bare_members(text);
    uv_mutex_lock(&target->job->jobs->lock);
    free(target->job->last_bounds);
    target->job->last_bounds = strdup(members);
    qm_job_add_event(target->job, "bounds", members);
    uv_mutex_unlock(&target->job->jobs->lock);
    free(text);
}

bool qm_job_is_canceled(qm_job *job)
{
    uv_mutex_lock(&job->jobs->lock);
    bool canceled = job->is_canceled;
    uv_mutex_unlock(&job->jobs->lock);
    return canceled;
}

/** Puts the long array of a result, if it has one, where it is read from. Nobody could ask for one of a
 * batch, whose jobs have no id. */
static bool store_array(const qm_job *job, const qm_job_result *result)
{
    size_t count;
    const double *numbers = job->line.batch ? NULL : qm_job_result_array(result, &count);
    return !numbers || qm_result_file_write(job->jobs->store, job->id, numbers, count) == QM_OK;
}

/** b is NULL for a kind of one mesh. */
static void answer(qm_job *job, const qm_loaded_mesh *a, const qm_loaded_mesh *b)
{
    qm_context ctx = qm_meshes_context(job->jobs->meshes);
    ctx.cancel = &job->cancel;
    ctx.parallel = qm_parallel_run;
    qm_job_request request = job->request;
    qm_job_write_revisions(a->revision, b ? b->revision : 0, job->revisions);
    if (request.threads == 0) request.threads = job->jobs->limits.threads;
    if (request.memory_limit == 0 || request.memory_limit > job->jobs->limits.search_memory)
        request.memory_limit = job->jobs->limits.search_memory;
    progress_target target = {job, a->diagonal};
    qm_hausdorff_progress_fn *progress = job->line.batch ? NULL : on_progress;
    qm_job_result result;
    qm_status status = qm_job_answer(&ctx, &request, a, b, progress, &target, &result);
    bool canceled = status == QM_E_CANCELED || (status == QM_OK && result.is_canceled);
    if (canceled && !qm_job_is_canceled(job)) {
        qm_job_interrupt(job);
    } else if (status == QM_OK && !store_array(job, &result)) {
        qm_problem problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the result could not be stored");
        qm_job_finish_with_problem(job, QM_JOB_FAILED, &problem);
    } else if (status == QM_OK) {
        qm_job_finish_with_result(job, canceled ? QM_JOB_CANCELED : QM_JOB_SUCCEEDED, &result);
    } else {
        qm_problem problem = qm_problem_from_status(status, ctx.message);
        qm_job_finish_with_problem(job, canceled ? QM_JOB_CANCELED : QM_JOB_FAILED, &problem);
    }
    if (status == QM_OK) qm_job_result_reset(&ctx, &result);
}

void qm_job_mark_running(qm_job *job)
{
    job->state = QM_JOB_RUNNING;
    job->started_ms = qm_now_ms();
    job->jobs->queued--;
    job->jobs->running++;
}

/** Moves a queued job to running. False when it is not to run: canceled meanwhile, or the daemon ends. */
static bool start(qm_job *job)
{
    qm_jobs *jobs = job->jobs;
    uv_mutex_lock(&jobs->lock);
    bool is_queued = job->state == QM_JOB_QUEUED;
    /* Nobody waits any more for what the reader of a batch has left behind. */
    bool is_wanted = !jobs->closed && !(job->line.batch && job->is_canceled);
    bool is_refused = is_queued && !is_wanted && job->line.batch;
    if (is_queued && (is_wanted || is_refused)) {
        qm_job_mark_running(job);
        qm_time_format(job->started);
    }
    uv_mutex_unlock(&jobs->lock);
    if (is_refused)
        refuse(job);
    else if (is_queued && !is_wanted)
        qm_job_interrupt(job);
    return is_queued && is_wanted;
}

static void run_on_meshes(qm_job *job)
{
    qm_jobs *jobs = job->jobs;
    qm_problem problem;
    qm_mesh_ref *a = qm_meshes_acquire(jobs->meshes, job->request.a, &problem);
    bool has_b = qm_job_type_of(job->request.kind)->mesh_field[1];
    /* A mesh held against itself is one revision of it. */
    bool is_same = has_b && strcmp(job->request.a, job->request.b) == 0;
    qm_mesh_ref *b =
        a && has_b && !is_same ? qm_meshes_acquire(jobs->meshes, job->request.b, &problem) : NULL;
    if (a && (b || !has_b || is_same))
        answer(job, qm_mesh_ref_get(a), b ? qm_mesh_ref_get(b) : is_same ? qm_mesh_ref_get(a) : NULL);
    else
        qm_job_finish_with_problem(job, QM_JOB_FAILED, &problem);
    qm_meshes_release(jobs->meshes, a);
    qm_meshes_release(jobs->meshes, b);
}

void qm_job_run(void *data)
{
    qm_job *job = data;
    qm_jobs *jobs = job->jobs;
    if (start(job)) (job->request.kind == QM_JOB_RECONSTRUCTION_STEP ? qm_job_run_steps : run_on_meshes)(job);
    qm_jobs_release(jobs, job);
}
