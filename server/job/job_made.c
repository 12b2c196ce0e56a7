/**
 * job_made.c: the stages and the end of a job that makes a mesh. The mesh is stored with the end of the job, all or nothing: a
 * daemon that is killed on the way makes it again.
 */
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/json.h"
#include "job_internal.h"
#include "ops/json_out.h"
#include "store/store_problem.h"

void qm_job_tell_stage(void *user, const qm_remesh_stage *stage)
{
    const qm_job_stages *stages = user;
    qm_text text = {0};
    qm_json_add_ms(&text, "elapsed_ms", qm_clock_now_ms() - stages->start_ms);
    qm_json_add_string(&text, "stage", qm_remesh_work_names[stage->work]);
    qm_json_add_count(&text, "quads", stage->quads);
    if (stage->upper > 0.0)
        qm_json_add_interval(&text, "hausdorff", (qm_interval){stage->lower, stage->upper}, stages->diagonal);
    char *members = qm_text_take(&text);
    if (!members) return;
    uv_mutex_lock(&stages->job->jobs->lock);
    qm_job_add_progress(stages->job, members);
    uv_mutex_unlock(&stages->job->jobs->lock);
    free(members);
}

/** A job with its result, on its way to the store with the mesh. */
typedef struct end_task {
    qm_job *job;
    qm_job_result *result;
    qm_job_end end;
} end_task;

static qm_stored put_with_end(void *user, const qm_store_mesh *mesh, bool is_new, qm_problem *problem)
{
    end_task *task = user;
    const qm_store_effect effect = {NULL, is_new ? mesh : NULL};
    memcpy(task->result->mesh, mesh->id, sizeof task->result->mesh);
    qm_stored stored = qm_job_store_end(task->job, QM_JOB_SUCCEEDED, task->result, &effect, &task->end);
    if (stored != QM_STORED) *problem = qm_store_write_problem(stored, "the mesh");
    /* A mesh that was new, and has a row by now, is looked for again. */
    return is_new && stored == QM_STORED_LATE ? QM_STORED_TAKEN : stored;
}

void qm_job_finish_with_mesh(qm_job *job, qm_context *ctx, qm_job_result *result)
{
    end_task task = {.job = job, .result = result};
    const qm_mesh_facts *facts;
    const qm_mesh *mesh = qm_job_result_mesh(result, &facts);
    qm_problem problem;
    bool is_added;
    do
        is_added = qm_meshes_add_made(job->jobs->meshes, ctx, mesh, facts, job->request.a, job->id,
                                      put_with_end, &task, &problem);
    while (!is_added && qm_job_outlasts(job, &problem));
    if (is_added)
        qm_job_announce_end(job, &task.end);
    else if (qm_job_runs_again(job, &problem))
        qm_job_interrupt(job);
    else
        qm_job_finish_with_problem(job, QM_JOB_FAILED, &problem);
}
