/**
 * job_steps.c: what a worker does with a reconstruction_step. The steps are taken in memory, each with an
 * event of its own, and stored together at the end, also when the job was cancelled after some of them: so a
 * daemon that is killed on the way takes them again from where the store is.
 */
#include <stdlib.h>
#include <string.h>

#include "job_internal.h"
#include "json_out.h"
#include "json_refine.h"
#include "parallel.h"

/** Where the steps of a job go. */
typedef struct step_log {
    qm_job *job;
    double diagonal;
    qm_text records; /* objects with commas between */
    size_t count, quads;
} step_log;

static void on_step(void *user, const qm_refine_record *record)
{
    step_log *log = user;
    qm_text line = {0};
    qm_json_add_count(&line, "step", ++log->count);
    qm_json_add_step(&line, record, log->diagonal);
    log->quads = record->step.quads;
    if (log->records.size > 0) qm_text_add_string(&log->records, ",");
    char *members = qm_text_take(&line);
    if (!members) log->records.failed = true;
    qm_text_printf(&log->records, "{%s}", members ? members : "");
    qm_jobs *jobs = log->job->jobs;
    uv_mutex_lock(&jobs->lock);
    if (members && !log->job->line.batch) qm_job_add_event(log->job, "step", members);
    uv_mutex_unlock(&jobs->lock);
    free(members);
}

static void fail(qm_job *job, qm_job_state state, qm_status status, const qm_context *ctx)
{
    qm_problem problem = qm_problem_from_status(status, ctx->message);
    qm_job_finish_with_problem(job, state, &problem);
}

/** Stores the steps and ends the job; false when the store has not followed. */
static bool commit(qm_job *job, qm_refining *refining, step_log *log, qm_job_result *result)
{
    qm_problem problem;
    char *records = qm_text_take(&log->records);
    size_t limit = job->request.goal.max_quads > 0 ? job->request.goal.max_quads : QM_REFINE_MOST_QUADS;
    bool has_records = records || log->count == 0;
    if (!has_records)
        problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "there is no memory for the records");
    bool good =
        has_records && qm_reconstructions_commit(job->jobs->reconstructions, refining, limit, log->count,
                                                 records ? records : "", result->mesh, &problem);
    result->records = records ? records : "";
    result->step_count = log->count;
    result->quads = log->count > 0 ? log->quads : qm_refining_quads(refining);
    if (good)
        qm_job_finish_with_result(job, result->is_canceled ? QM_JOB_CANCELLED : QM_JOB_SUCCEEDED, result);
    else
        qm_job_finish_with_problem(job, QM_JOB_FAILED, &problem);
    free(records);
    return good;
}

/** Takes the steps of a job that has its reconstruction; false when memory and store differ afterwards. */
static bool refine(qm_job *job, qm_refining *refining)
{
    step_log log = {.job = job, .diagonal = refining->source.diagonal};
    const qm_job_refining work = {refining->reconstruction, &refining->source, on_step, &log};
    qm_job_request request = job->request;
    if (request.threads == 0) request.threads = job->jobs->limits.threads;
    request.refining = &work;
    refining->ctx.cancel = &job->cancel;
    refining->ctx.parallel = qm_parallel_run;
    qm_job_result result;
    qm_status status =
        qm_job_answer(&refining->ctx, &request, qm_mesh_ref_get(refining->mesh), NULL, NULL, NULL, &result);
    refining->ctx.cancel = NULL;
    if (status == QM_OK && !(result.is_canceled && !qm_job_is_cancelled(job)))
        return commit(job, refining, &log, &result);
    if (status == QM_OK)
        qm_job_interrupt(job);
    else
        fail(job, QM_JOB_FAILED, status, &refining->ctx);
    qm_text_reset(&log.records);
    return log.count == 0;
}

void qm_job_run_steps(qm_job *job)
{
    qm_reconstructions *reconstructions = job->jobs->reconstructions;
    qm_problem problem;
    qm_refining *refining = qm_reconstructions_take(reconstructions, job->request.a, &problem);
    if (refining)
        qm_reconstructions_release(reconstructions, refining, refine(job, refining));
    else
        qm_job_finish_with_problem(job, QM_JOB_FAILED, &problem);
}
