/**
 * job_once.c: jobs that are not stored, one for each reader.
 */
#include "job_once.h"

#include <stdlib.h>
#include <string.h>

#include "job_internal.h"

#define LOOK_MS 1000.0

/** The lock of the jobs guards all members but the first. */
struct qm_job_once {
    qm_jobs *jobs;
    qm_job *job; /* a reference */
    qm_subscriber *subscriber;
    bool has_ended, has_result;
    char *object;   /* until it is taken */
    int references; /* the reader's, and the job's until it has ended */
};

/** The caller holds the lock. */
static void drop_reference(qm_job_once *once)
{
    QM_ASSERT(qm_jobs_is_locked(once->jobs) && once->references > 0);
    if (--once->references > 0) return;
    free(once->object);
    free(once);
}

/** A qm_job_end_fn. */
static void note_end(void *user, const qm_job_outcome *outcome)
{
    qm_job_once *once = user;
    once->has_ended = true;
    once->has_result = strcmp(outcome->member, "result") == 0;
    once->object = strdup(outcome->object);
    if (once->subscriber) qm_job_events_notify(once->jobs, once->subscriber);
    drop_reference(once);
}

/** The job with its meshes; NULL when out of memory. */
static qm_job *make_job(qm_jobs *jobs, qm_job_request *request, qm_mesh_ref *const mesh[2],
                        const char *client, qm_job_once *once)
{
    qm_job *job = qm_job_create(jobs, request, client);
    if (!job) return NULL;
    job->given[0] = mesh[0];
    job->given[1] = mesh[1];
    job->on_end = note_end;
    job->end_user = once;
    return job;
}

qm_job_once *qm_job_once_start(qm_jobs *jobs, qm_job_request *request, qm_mesh_ref *const mesh[2],
                               const char *client, qm_subscriber *subscriber, qm_problem *problem)
{
    bool has_room = qm_jobs_count(jobs).queued < (size_t)jobs->limits.queue;
    qm_job_once *once = has_room ? calloc(1, sizeof *once) : NULL;
    qm_job *job = once ? make_job(jobs, request, mesh, client, once) : NULL;
    if (!job) {
        *problem = has_room ? qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the job")
                            : qm_problem_make(QM_PROBLEM_TOO_MANY_JOBS,
                                              "the queue is full: %d jobs are waiting", jobs->limits.queue);
        qm_meshes_release(jobs->meshes, mesh[0]);
        qm_meshes_release(jobs->meshes, mesh[1]);
        qm_job_request_reset(request);
        free(once);
        return NULL;
    }
    *once = (qm_job_once){.jobs = jobs, .job = job, .subscriber = subscriber, .references = 2};
    subscriber->wake_at_ms = qm_clock_now_ms() + LOOK_MS;
    uv_mutex_lock(&jobs->lock);
    qm_job_subscribers_add(&jobs->subscribers, subscriber);
    uv_mutex_unlock(&jobs->lock);
    qm_job_enlist(jobs, job);
    if (qm_job_enqueue(jobs, job)) return once;
    qm_job_withdraw(jobs, job);
    uv_mutex_lock(&jobs->lock);
    qm_job_subscribers_remove(&jobs->subscribers, subscriber);
    uv_mutex_unlock(&jobs->lock);
    qm_jobs_release(jobs, job);
    free(once);
    *problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the job could not be queued");
    return NULL;
}

bool qm_job_once_await(qm_job_once *once, void (*suspend)(void *user))
{
    qm_jobs *jobs = once->jobs;
    uv_mutex_lock(&jobs->lock);
    double now = qm_clock_now_ms();
    bool is_due = now >= once->subscriber->wake_at_ms, returns = once->has_ended || is_due;
    if (is_due) once->subscriber->wake_at_ms = now + LOOK_MS;
    if (!returns) qm_job_wait(jobs, once->subscriber, suspend);
    uv_mutex_unlock(&jobs->lock);
    return returns;
}

bool qm_job_once_take(qm_job_once *once, bool *has_result, char **object)
{
    uv_mutex_lock(&once->jobs->lock);
    bool has_ended = once->has_ended;
    *has_result = once->has_result;
    *object = once->object;
    once->object = NULL;
    uv_mutex_unlock(&once->jobs->lock);
    return has_ended;
}

void qm_job_once_close(qm_job_once *once)
{
    qm_jobs *jobs = once->jobs;
    uv_mutex_lock(&jobs->lock);
    qm_job_subscribers_remove(&jobs->subscribers, once->subscriber);
    once->subscriber = NULL;
    if (!once->has_ended) {
        once->job->is_canceled = true;
        qm_job_stop(once->job);
    }
    qm_job_drop_reference(once->job);
    drop_reference(once);
    uv_mutex_unlock(&jobs->lock);
}
