/**
 * job_help.c: helpers. A node has one at a time, which leaves as soon as a job waits here.
 */
#include "job_help.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "json_in.h"
#include "split_search.h"

#define LOOK_MS 500.0 /* between two looks for a search */

/** The end of a helper. One that cannot help this search is not sent again. The caller holds the lock. */
static void end_help(void *user, const qm_job_outcome *outcome)
{
    qm_job_help *help = user;
    QM_ASSERT(help->job);
    help->job = NULL;
    if (outcome->state != QM_JOB_FAILED) return;
    memcpy(help->refused[help->refusals++ % QM_JOB_HELP_REFUSED], help->helped, sizeof help->helped);
}

/** Queues a helper for the search of a row. */
static void queue_helper(qm_jobs *jobs, const qm_store_job *row)
{
    qm_job_request request;
    qm_problem problem;
    bool is_readable = qm_json_read_job(row->body, strlen(row->body), &request, &problem);
    request.deadline_ms = 0.0; /* the owner has an eye on it */
    qm_job *job = is_readable ? qm_job_create(jobs, &request, "") : NULL;
    qm_job_request_reset(&request);
    if (!job) return;
    uv_mutex_lock(&jobs->lock);
    jobs->help.job = job;
    memcpy(jobs->help.helped, row->id, sizeof row->id);
    uv_mutex_unlock(&jobs->lock);
    job->on_end = end_help;
    job->end_user = &jobs->help;
    job->is_helper = true;
    qm_job_enlist(jobs, job);
    if (!qm_job_enqueue(jobs, job)) {
        qm_job_withdraw(jobs, job);
        uv_mutex_lock(&jobs->lock);
        jobs->help.job = NULL;
        uv_mutex_unlock(&jobs->lock);
    }
    qm_jobs_release(jobs, job);
}

/** Looks for a search that may be helped. */
static void find_search(qm_jobs *jobs)
{
    char refused[QM_JOB_HELP_REFUSED][QM_ID_SIZE];
    uv_mutex_lock(&jobs->lock);
    size_t count = jobs->help.refusals < QM_JOB_HELP_REFUSED ? jobs->help.refusals : QM_JOB_HELP_REFUSED;
    memcpy(refused, jobs->help.refused, sizeof refused);
    uv_mutex_unlock(&jobs->lock);
    qm_store_job row;
    if (qm_store_find_split_job(jobs->store, refused, count, &row) != QM_STORED) return;
    queue_helper(jobs, &row);
    qm_store_job_reset(&row);
}

/** Stops the helper of a search that is over. */
static void check_search(qm_jobs *jobs)
{
    qm_store_bounds bounds;
    char helped[QM_ID_SIZE]; /* only the caller's thread changes it */
    memcpy(helped, jobs->help.helped, sizeof helped);
    if (qm_store_read_bounds(jobs->store, helped, NULL, 0, &bounds) != QM_STORED_NONE) return;
    uv_mutex_lock(&jobs->lock);
    if (jobs->help.job) qm_job_stop(jobs->help.job);
    uv_mutex_unlock(&jobs->lock);
}

void qm_job_help_look(qm_jobs *jobs, bool is_free)
{
    double now = qm_clock_now_ms();
    uv_mutex_lock(&jobs->lock);
    bool looks = now >= jobs->help.next_look_ms && !atomic_load(&jobs->closed), helps = jobs->help.job;
    if (looks) jobs->help.next_look_ms = now + LOOK_MS;
    uv_mutex_unlock(&jobs->lock);
    if (looks && helps)
        check_search(jobs);
    else if (looks && is_free)
        find_search(jobs);
}

/** True when the worker is needed here. */
static bool is_needed(void *user)
{
    qm_jobs *jobs = user;
    uv_mutex_lock(&jobs->lock);
    bool needed = jobs->queued > 0;
    uv_mutex_unlock(&jobs->lock);
    return needed || atomic_load(&jobs->closed);
}

typedef struct help_call {
    qm_job *job;
    bool helps;
} help_call;

static qm_status measure(void *user, qm_context *ctx, const qm_bvh *a, const qm_bvh *b,
                         const qm_hausdorff_options *options, qm_hausdorff_result *out)
{
    help_call *call = user;
    qm_jobs *jobs = call->job->jobs;
    *out = (qm_hausdorff_result){.stop = QM_STOP_CANCELED};
    qm_split split = {.store = jobs->store,
                      .job = jobs->help.helped,
                      .whole_ms = QM_SPLIT_WHOLE_MS,
                      .round_ms = QM_SPLIT_ROUND_MS,
                      .most_pieces = QM_SPLIT_MOST_PIECES};
    call->helps = qm_split_help(&split, ctx, a, b, options, is_needed, jobs);
    return QM_OK;
}

void qm_job_help_run(qm_job *job, const qm_loaded_mesh *a, const qm_loaded_mesh *b)
{
    help_call call = {.job = job};
    const qm_job_search search = {measure, &call};
    qm_context ctx = qm_meshes_context(job->jobs->meshes);
    qm_job_set_context(job, &ctx);
    qm_job_request request = job->request;
    qm_job_set_limits(job, &request);
    request.search = &search;
    qm_job_result result;
    qm_status status = qm_job_execute(&ctx, &request, a, b, NULL, NULL, &result);
    if (status == QM_OK) qm_job_result_reset(&ctx, &result);
    qm_scheduler_leave(job->turn);
    bool is_good = status == QM_OK && call.helps;
    qm_job_end end = {.outcome = {is_good ? QM_JOB_SUCCEEDED : QM_JOB_FAILED, "result", "null"}};
    qm_job_announce_end(job, &end);
}
