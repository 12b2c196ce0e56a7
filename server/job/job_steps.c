/**
 * job_steps.c: what a worker does with a reconstruction_step. The steps are taken in memory, each with an
 * event of its own, and stored with the end of the job, also when the job was canceled after some of them: a
 * daemon that is killed on the way takes them again from the stored state.
 */
#include <stdlib.h>
#include <string.h>

#include "base/host.h"
#include "job_internal.h"
#include "ops/json_out.h"
#include "store/store_problem.h"

/** Collects the records of the steps. */
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
    if (members) qm_job_add_event(log->job, "step", members);
    uv_mutex_unlock(&jobs->lock);
    free(members);
}

/** How a job ends: with a result that is stored already, with a problem, or not yet, when the daemon stops it. */
typedef struct step_end {
    enum { WITH_RESULT, WITH_PROBLEM, INTERRUPTED } how;
    qm_job_result result;
    qm_job_end stored;
    qm_problem problem;
    bool keeps; /* memory and store agree about the reconstruction */
} step_end;

static void end_with(step_end *end, qm_problem problem)
{
    end->how = WITH_PROBLEM;
    end->problem = problem;
}

typedef struct commit_task {
    qm_job *job;
    step_end *end;
} commit_task;

/** Stores the end of the job with its effect. */
static qm_stored store_steps(void *user, const char *mesh, const qm_store_effect *effect)
{
    const commit_task *task = user;
    qm_job_result *result = &task->end->result;
    snprintf(result->mesh, sizeof result->mesh, "%s", mesh);
    return qm_job_store_end(task->job, result->is_canceled ? QM_JOB_CANCELED : QM_JOB_SUCCEEDED, result,
                            effect, &task->end->stored);
}

/** Stores the steps with the end of the job: a daemon that is killed takes them again, or has taken them. */
static void commit(qm_job *job, qm_reconstruction_lease *refining, const step_log *log, const char *records,
                   step_end *end)
{
    size_t limit = job->request.goal.max_quads > 0 ? job->request.goal.max_quads : QM_REFINE_MAX_QUADS;
    end->result.records = records;
    end->result.step_count = log->count;
    end->result.quads = log->count > 0 ? log->quads : qm_reconstructions_count_quads(refining);
    commit_task task = {job, end};
    const qm_mesh *settled = end->result.settled_mesh.face_count > 0 ? &end->result.settled_mesh : NULL;
    qm_problem problem;
    do
        end->keeps = qm_reconstructions_commit(job->jobs->reconstructions, refining, limit, log->count,
                                               records, settled, store_steps, &task, &problem);
    while (!end->keeps && qm_job_outlasts(job, &problem));
    if (!end->keeps && qm_job_runs_again(job, &problem))
        end->how = INTERRUPTED;
    else if (!end->keeps)
        end_with(end, problem);
}

/** Takes the steps of a job that holds the lease. */
static void refine(qm_job *job, qm_reconstruction_lease *refining, step_log *log, step_end *end)
{
    const qm_job_refinement work = {refining->reconstruction, &refining->source, on_step, log};
    qm_job_request request = job->request;
    if (request.threads == 0) request.threads = job->jobs->limits.threads;
    request.refining = &work;
    log->diagonal = refining->source.diagonal;
    qm_job_set_context(job, &refining->ctx);
    qm_status status = qm_job_execute(&refining->ctx, &request, qm_mesh_ref_get(refining->mesh), NULL, NULL,
                                      NULL, &end->result);
    refining->ctx.cancel = refining->ctx.pause = NULL;
    qm_scheduler_leave(job->turn);
    bool has_expired = end->result.is_canceled && qm_job_get_expiry(job) != QM_JOB_IN_TIME;
    end->keeps = log->count == 0;
    if (status != QM_OK)
        end_with(end, qm_problem_from_status(status, refining->ctx.message));
    else if (end->result.is_canceled && !has_expired && !qm_job_is_canceled(job))
        end->how = INTERRUPTED;
    else if (log->records.failed)
        end_with(end, qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the records"));
    else
        commit(job, refining, log, log->records.data ? log->records.data : "", end);
    qm_job_result_reset(&refining->ctx, &end->result);
}

/** The lease of the reconstruction, or NULL with a problem. */
static qm_reconstruction_lease *take(qm_job *job, const qm_context *host, qm_problem *problem)
{
    for (;;) {
        qm_reconstruction_lease *lease =
            qm_reconstructions_take(job->jobs->reconstructions, job->request.a, host, problem);
        if (lease) return lease;
        qm_scheduler_leave(job->turn);
        bool again = qm_job_outlasts(job, problem);
        qm_scheduler_return(job->turn);
        if (!again) return NULL;
    }
}

/** Releases the reconstruction before the end of the job is announced, so that the next request of the client finds it free. */
static void run_steps(qm_job *job)
{
    qm_reconstructions *reconstructions = job->jobs->reconstructions;
    step_end end = {.how = WITH_RESULT};
    step_log log = {.job = job};
    qm_context host = qm_context_make();
    qm_job_set_context(job, &host);
    qm_reconstruction_lease *refining = take(job, &host, &end.problem);
    bool canceled = false; /* by the client, before there was a result */
    if (refining) {
        refine(job, refining, &log, &end);
        qm_reconstructions_release(reconstructions, refining, end.keeps);
    } else {
        qm_job_expiry expiry = qm_job_get_expiry(job);
        canceled = qm_job_is_canceled(job);
        end.how = WITH_PROBLEM;
        if (canceled)
            end.problem = qm_problem_make(QM_PROBLEM_CONFLICT, "the job was canceled before its first step");
        else if (expiry != QM_JOB_IN_TIME)
            end.problem = qm_job_expiry_problem(job, expiry);
        else if (atomic_load(&job->cancel) || qm_job_runs_again(job, &end.problem))
            end.how = INTERRUPTED;
    }
    if (end.how == INTERRUPTED)
        qm_job_interrupt(job);
    else if (end.how == WITH_PROBLEM)
        qm_job_finish_with_problem(job, canceled ? QM_JOB_CANCELED : QM_JOB_FAILED, &end.problem);
    else
        qm_job_announce_end(job, &end.stored);
    qm_text_reset(&log.records);
}

static bool check_reconstruction(qm_jobs *jobs, const qm_job_request *request,
                                 char revisions[QM_REVISIONS_SIZE], qm_problem *problem)
{
    qm_store_reconstruction row;
    revisions[0] = '\0';
    qm_stored stored = qm_store_find_reconstruction(jobs->store, request->a, &row);
    if (stored == QM_STORED) {
        bool keeps_curves = request->settles && !row.pull_curves;
        qm_store_reconstruction_reset(&row);
        if (!keeps_curves) return true;
        *problem = qm_problem_make(QM_PROBLEM_INVALID_FIELD, "the reconstruction keeps its curves");
        qm_problem_add_pointer(problem, "/settle", "would move the curves that pull_curves: false keeps");
        return false;
    }
    *problem = qm_store_read_problem(stored, QM_PROBLEM_RECONSTRUCTION_NOT_FOUND,
                                     "reconstruction with the id in `reconstruction`");
    if (stored == QM_STORED_NONE)
        qm_problem_add_pointer(problem, "/reconstruction", "no such reconstruction");
    return false;
}

const qm_job_runner qm_job_steps_runner = {check_reconstruction, run_steps};
