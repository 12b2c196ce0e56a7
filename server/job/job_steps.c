/**
 * job_steps.c: what a worker does with a reconstruction_step. The steps are taken in memory, each with an
 * event of its own, and stored together at the end, also when the job was canceled after some of them: so a
 * daemon that is killed on the way takes them again from where the store is.
 */
#include <stdlib.h>
#include <string.h>

#include "base/parallel.h"
#include "job_internal.h"
#include "ops/json_out.h"
#include "ops/json_refine.h"

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
    log->records.failed |= !members;
    qm_text_printf(&log->records, "{%s}", members ? members : "");
    qm_jobs *jobs = log->job->jobs;
    uv_mutex_lock(&jobs->lock);
    if (members && !log->job->line.batch) qm_job_add_event(log->job, "step", members);
    uv_mutex_unlock(&jobs->lock);
    free(members);
}

/** How a job ends: with a result, with a problem, or not yet, when the daemon stops it. */
typedef struct ending {
    enum { WITH_RESULT, WITH_PROBLEM, INTERRUPTED } how;
    qm_job_result result;
    qm_problem problem;
    bool keeps; /* memory and store agree about the reconstruction */
} ending;

static void end_with(ending *end, qm_problem problem)
{
    end->how = WITH_PROBLEM;
    end->problem = problem;
}

/** Stores the steps. records is the result's own text from then on. */
static void commit(const qm_job *job, qm_refining *refining, const step_log *log, const char *records,
                   ending *end)
{
    size_t limit = job->request.goal.max_quads > 0 ? job->request.goal.max_quads : QM_REFINE_MOST_QUADS;
    end->result.records = records;
    end->result.step_count = log->count;
    end->result.quads = log->count > 0 ? log->quads : qm_refining_quads(refining);
    qm_problem problem;
    end->keeps = qm_reconstructions_commit(job->jobs->reconstructions, refining, limit, log->count, records,
                                           end->result.mesh, &problem);
    if (!end->keeps) end_with(end, problem);
}

/** Takes the steps of a job that has its reconstruction. */
static void refine(qm_job *job, qm_refining *refining, step_log *log, ending *end)
{
    const qm_job_refining work = {refining->reconstruction, &refining->source, on_step, log};
    qm_job_request request = job->request;
    if (request.threads == 0) request.threads = job->jobs->limits.threads;
    request.refining = &work;
    log->diagonal = refining->source.diagonal;
    refining->ctx.cancel = &job->cancel;
    refining->ctx.parallel = qm_parallel_run;
    qm_status status = qm_job_answer(&refining->ctx, &request, qm_mesh_ref_get(refining->mesh), NULL, NULL,
                                     NULL, &end->result);
    refining->ctx.cancel = NULL;
    end->keeps = log->count == 0;
    if (status != QM_OK)
        end_with(end, qm_problem_from_status(status, refining->ctx.message));
    else if (end->result.is_canceled && !qm_job_is_canceled(job))
        end->how = INTERRUPTED;
    else if (log->records.failed)
        end_with(end, qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "there is no memory for the records"));
    else
        commit(job, refining, log, log->records.data ? log->records.data : "", end);
}

/** The reconstruction is free again before anybody hears of the end, so that the next request finds it so. */
void qm_job_run_steps(qm_job *job)
{
    qm_reconstructions *reconstructions = job->jobs->reconstructions;
    ending end = {.how = WITH_RESULT};
    step_log log = {.job = job};
    qm_refining *refining = qm_reconstructions_take(reconstructions, job->request.a, &end.problem);
    if (refining) {
        refine(job, refining, &log, &end);
        qm_reconstructions_release(reconstructions, refining, end.keeps);
    } else {
        end.how = WITH_PROBLEM;
    }
    if (end.how == INTERRUPTED)
        qm_job_interrupt(job);
    else if (end.how == WITH_PROBLEM)
        qm_job_finish_with_problem(job, QM_JOB_FAILED, &end.problem);
    else
        qm_job_finish_with_result(job, end.result.is_canceled ? QM_JOB_CANCELED : QM_JOB_SUCCEEDED,
                                  &end.result);
    qm_text_reset(&log.records);
}
