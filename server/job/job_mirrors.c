/**
 * job_mirrors.c: mirrors. The pulse asks the store for all of them in one look; readers find them in the table of jobs as
 * they find any other.
 */
#include "job_mirrors.h"

#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "job_pulse.h"
#include "json_in.h"
#include "store/store_problem.h"

#define IDLE_MS 3000.0 /* that a mirror is kept without readers: one may come back */

/* ---- one mirror ---- */

qm_job *qm_job_mirrors_make(qm_jobs *jobs, const qm_store_job *row, qm_problem *problem)
{
    qm_job_request request;
    if (!qm_json_read_job(row->body, strlen(row->body), &request, problem)) return NULL;
    qm_job *job = qm_job_create(jobs, &request, "");
    qm_job_request_reset(&request);
    if (!job) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for job %s", row->id);
        return NULL;
    }
    qm_job_set_row(job, row);
    job->is_mirror = true;
    job->state = row->state;
    job->last_progress = row->progress ? strdup(row->progress) : NULL;
    qm_stored stored = qm_job_restore_events(job);
    if (stored == QM_STORED) return job;
    *problem = qm_store_read_problem(stored, QM_PROBLEM_INTERNAL, "events of job %s", row->id);
    qm_jobs_release(jobs, job);
    return NULL;
}

void qm_job_mirrors_list(qm_job *job)
{
    QM_ASSERT(qm_jobs_is_locked(job->jobs) && job->is_mirror);
    if (job->listed || qm_job_is_over(job)) return;
    qm_job_list(job);
    qm_job_pulse_hurry(job->jobs);
}

qm_job *qm_job_mirrors_take(qm_jobs *jobs, const qm_store_job *row)
{
    uv_mutex_lock(&jobs->lock);
    qm_job *job = jobs->first;
    while (job && !(job->is_mirror && strcmp(job->id, row->id) == 0)) /* a run that was lost may end yet */
        job = job->next;
    if (job) {
        job->references++;
        job->is_mirror = false;
        job->state = QM_JOB_QUEUED;
        job->saved_count = job->event_count;
        jobs->queued++;
        qm_job_set_restarts(job, row->restarts);
    }
    uv_mutex_unlock(&jobs->lock);
    return job;
}

/** Ends a mirror with what its row says. */
static void end_mirror(qm_job *job)
{
    qm_jobs *jobs = job->jobs;
    qm_store_job row;
    qm_stored stored = qm_store_find_job(jobs->store, job->id, &row);
    if (stored != QM_STORED && stored != QM_STORED_NONE) return; /* another time */
    uv_mutex_lock(&jobs->lock);
    if (stored == QM_STORED && row.document) {
        job->state = row.state;
        job->document = row.document;
        job->result = row.result;
        row.document = row.result = NULL;
    } else {
        job->interrupted = true; /* it was removed */
    }
    qm_job_notify_all(job);
    qm_job_unlist(job);
    uv_mutex_unlock(&jobs->lock);
    if (stored == QM_STORED) qm_store_job_reset(&row);
}

/* ---- all mirrors ---- */

typedef struct mirror_list {
    qm_job **jobs; /* references */
    qm_store_look *looks;
    size_t count;
    size_t next; /* where the event's job is looked for first */
} mirror_list;

/** True when only the list has the mirror, for some time. */
static bool is_idle(qm_job *job, double now_ms)
{
    if (job->references > 1) job->read_ms = now_ms;
    return now_ms >= job->read_ms + IDLE_MS;
}

/** Takes references to the mirrors that have readers. */
static mirror_list gather(qm_jobs *jobs)
{
    mirror_list list = {0};
    double now = qm_clock_now_ms();
    uv_mutex_lock(&jobs->lock);
    size_t capacity = 0;
    for (qm_job *job = jobs->first, *next; job; job = next) {
        next = job->next;
        if (!job->is_mirror) continue;
        if (is_idle(job, now))
            qm_job_unlist(job);
        else
            capacity++;
    }
    list.jobs = calloc(capacity + 1, sizeof *list.jobs);
    list.looks = calloc(capacity + 1, sizeof *list.looks);
    for (qm_job *job = jobs->first; list.jobs && list.looks && job; job = job->next) {
        if (!job->is_mirror) continue;
        job->references++;
        list.looks[list.count] = (qm_store_look){.job = job->id, .after = qm_job_last_seq(job)};
        list.jobs[list.count++] = job;
    }
    uv_mutex_unlock(&jobs->lock);
    return list;
}

/** Adds an event to its mirror. */
static bool take_event(void *user, const qm_store_event *event)
{
    mirror_list *list = user;
    for (size_t tries = 0; tries < list->count; tries++, list->next++) {
        qm_job *job = list->jobs[list->next % list->count];
        if (strcmp(job->id, event->job) != 0) continue;
        qm_jobs *jobs = job->jobs;
        uv_mutex_lock(&jobs->lock);
        bool added = qm_job_take_event(job, event);
        uv_mutex_unlock(&jobs->lock);
        return added;
    }
    return true;
}

bool qm_job_mirrors_follow(qm_jobs *jobs)
{
    mirror_list list = gather(jobs);
    qm_stored stored = list.count > 0
                           ? qm_store_look_at_jobs(jobs->store, list.looks, list.count, take_event, &list)
                           : QM_STORED;
    for (size_t i = 0; i < list.count; i++) {
        qm_job *job = list.jobs[i];
        const qm_store_look *look = &list.looks[i];
        if (stored == QM_STORED && (look->is_gone || look->state > QM_JOB_RUNNING)) end_mirror(job);
        uv_mutex_lock(&jobs->lock);
        if (stored == QM_STORED && job->listed && !look->is_gone) job->state = look->state;
        qm_job_drop_reference(job);
        uv_mutex_unlock(&jobs->lock);
    }
    bool has_any = list.count > 0;
    free(list.jobs);
    free(list.looks);
    return has_any;
}

void qm_job_mirrors_end(qm_jobs *jobs)
{
    uv_mutex_lock(&jobs->lock);
    for (qm_job *job = jobs->first, *next; job; job = next) {
        next = job->next;
        if (!job->is_mirror) continue;
        qm_job_add_event(job, "server_shutdown",
                         "\"detail\":\"this node is stopping; another one has the job\"");
        job->interrupted = true;
        qm_job_unlist(job);
    }
    uv_mutex_unlock(&jobs->lock);
}
