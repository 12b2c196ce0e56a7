/**
 * jobs.c: start and stop of the job table: queues the unfinished jobs of the store, and interrupts running
 * ones.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "job_internal.h"
#include "json_in.h"

#define JOB_NICENESS 5
#define DRAIN_STEP_MS 10
#define RESUME_STEP 64

/** Queues the job of a row that was queued or running when the daemon last ended. */
static void resume_row(qm_jobs *jobs, const qm_store_job *row)
{
    qm_job_request request;
    qm_problem problem;
    bool readable = qm_json_read_job(row->body, strlen(row->body), &request, &problem);
    qm_job *job = qm_job_create(jobs, &request);
    qm_job_request_reset(&request);
    if (!job) {
        qm_log(QM_LOG_ERROR, "out of memory: job %s cannot run again", row->id);
        return;
    }
    memcpy(job->id, row->id, sizeof job->id);
    snprintf(job->created, sizeof job->created, "%s", row->created);
    qm_job_set_restarts(job, row->restarts);
    job->is_kept = true; /* its streams ended with the daemon: no client owns it */
    if (qm_job_restore_events(job) != QM_OK)
        qm_log(QM_LOG_ERROR, "the events of job %s so far cannot be read", job->id);
    qm_job_enlist(jobs, job);
    uv_mutex_lock(&jobs->lock);
    qm_job_add_event(job, "server_restart",
                     "\"detail\":\"the daemon was started again; the job begins anew\"");
    uv_mutex_unlock(&jobs->lock);
    if (!readable) {
        uv_mutex_lock(&jobs->lock);
        qm_job_mark_running(job);
        uv_mutex_unlock(&jobs->lock);
        qm_job_finish_with_problem(job, QM_JOB_FAILED, &problem);
    } else if (!qm_job_enqueue(jobs, job)) {
        qm_job_withdraw(jobs, job);
    }
    qm_jobs_release(jobs, job);
}

static void resume_unfinished(qm_jobs *jobs)
{
    qm_store_job rows[RESUME_STEP];
    int64_t after = 0;
    size_t total = 0, count;
    qm_status status;
    if (qm_store_claim_jobs(jobs->store) != QM_OK)
        qm_log(QM_LOG_ERROR,
               "the jobs that run again could not be counted: their events may have old numbers");
    while ((status = qm_store_list_unfinished_jobs(jobs->store, after, RESUME_STEP, rows, &count)) == QM_OK &&
           count > 0) {
        after = rows[count - 1].sequence;
        for (size_t i = 0; i < count; i++) {
            resume_row(jobs, &rows[i]);
            qm_store_job_reset(&rows[i]);
        }
        total += count;
    }
    if (status != QM_OK)
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
    jobs->pool = qm_pool_create(limits.workers, JOB_NICENESS);
    if (!qm_jobs_start_notifier(jobs) || !jobs->pool) {
        qm_jobs_destroy(jobs);
        return NULL;
    }
    resume_unfinished(jobs);
    return jobs;
}

void qm_jobs_drain(qm_jobs *jobs)
{
    uv_mutex_lock(&jobs->submitting); /* no submission is half done */
    atomic_store(&jobs->closed, true);
    uv_mutex_unlock(&jobs->submitting);
    double end = qm_now_ms() + jobs->limits.grace_ms;
    while (qm_jobs_count(jobs).running > 0 && qm_now_ms() < end) {
        uv_sleep(DRAIN_STEP_MS);
        qm_jobs_tick(jobs, qm_now_ms());
    }
    uv_mutex_lock(&jobs->lock);
    for (qm_job *job = jobs->first; job; job = job->next)
        atomic_store(&job->cancel, true);
    uv_mutex_unlock(&jobs->lock);
    qm_pool_close(jobs->pool);
    qm_jobs_save_events(jobs);
}

void qm_jobs_destroy(qm_jobs *jobs)
{
    if (!jobs) return;
    if (jobs->pool && !atomic_load(&jobs->closed)) qm_jobs_drain(jobs);
    qm_pool_destroy(jobs->pool);
    qm_jobs_stop_notifier(jobs);
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
