/**
 * handle_report.c: GET /v1/jobs/{id}/report: the result of a comparison as a page to hand on.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/host.h"
#include "base/json.h"
#include "handlers.h"
#include "report/report.h"
#include "store/store_problem.h"

/** What a report is made of. */
typedef struct report_task {
    qm_app *app;
    qm_report report;
    qm_store_job row;
    char *document, *result;
    qm_store_mesh mesh[2];
    qm_mesh_ref *ref[2];
    double transform[2][QM_TRANSFORM_SIZE];
} report_task;

static void reset_task(report_task *task)
{
    for (int side = 0; side < 2; side++) {
        qm_meshes_release(task->app->meshes, task->ref[side]);
        qm_store_mesh_reset(&task->mesh[side]);
    }
    free(task->document);
    free(task->result);
    qm_store_job_reset(&task->row);
}

/** Reads a number of the query, NAN when it is not given; false after a problem was the reply. */
static bool read_number(qm_request *request, const char *name, bool may_be_zero, double *out)
{
    const char *given = qm_request_query(request, name);
    char *end;
    *out = given ? strtod(given, &end) : (double)NAN;
    if (!given || (end != given && !*end && isfinite(*out) && (may_be_zero ? *out >= 0.0 : *out > 0.0)))
        return true;
    qm_problem problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "`%s` must be a number %s", name,
                                         may_be_zero ? "of 0 or more" : "above 0");
    qm_reply_problem(request, &problem);
    return false;
}

/** Finds the job and its result; false with a problem. */
static bool take_result(report_task *task, const char *id, qm_problem *problem)
{
    qm_job *job = qm_jobs_find(task->app->jobs, id, problem);
    if (!job) return false;
    task->document = qm_job_document(task->app->jobs, job, false);
    task->result = qm_job_result_object(task->app->jobs, job);
    qm_jobs_release(task->app->jobs, job);
    if (!task->result) {
        *problem = qm_problem_make(QM_PROBLEM_CONFLICT, "the job has no result");
        return false;
    }
    qm_stored stored = qm_store_find_job(task->app->store, id, &task->row);
    if (stored != QM_STORED) *problem = qm_store_read_problem(stored, QM_PROBLEM_JOB_NOT_FOUND, "job %s", id);
    return stored == QM_STORED;
}

/** Reads the transform that has moved a mesh; NULL for one that lies as it was uploaded. */
static const double *read_transform(report_task *task, int side, const qm_json *document)
{
    double *transform = task->transform[side];
    for (int i = 0; i < QM_TRANSFORM_SIZE; i++) {
        char path[40];
        snprintf(path, sizeof path, "request.%c.transform.%d", side == 0 ? 'a' : 'b', i);
        if (!qm_json_has(document, path)) return NULL;
        transform[i] = qm_json_get_number(document, path);
    }
    return transform;
}

/** Takes a mesh that the request of the job names; false with a problem. */
static bool take_mesh(report_task *task, int side, const qm_json *document, qm_problem *problem)
{
    const double *transform = read_transform(task, side, document);
    const char *path = side == 0 ? "request.a" : "request.b",
               *moved = side == 0 ? "request.a.mesh" : "request.b.mesh";
    const char *id = qm_json_get_string(document, transform ? moved : path);
    qm_stored stored = qm_store_find_mesh(task->app->store, id ? id : "", &task->mesh[side]);
    if (stored != QM_STORED) {
        *problem = qm_store_read_problem(stored, QM_PROBLEM_MESH_NOT_FOUND, "mesh %s of the comparison",
                                         side == 0 ? "A" : "B");
        return false;
    }
    qm_notes notes;
    qm_meshes *meshes = task->app->meshes;
    task->ref[side] = transform ? qm_meshes_acquire_moved(meshes, id, transform, &notes, problem)
                                : qm_meshes_acquire_noted(meshes, id, &notes, problem);
    if (!task->ref[side]) return false;
    task->report.mesh[side] = (qm_report_mesh){.name = task->mesh[side].name,
                                               .hash = task->mesh[side].hash,
                                               .notes = notes,
                                               .transform = transform,
                                               .loaded = qm_mesh_ref_get(task->ref[side])};
    return true;
}

/** Signed limits are about signed distances; false with a problem. */
static bool has_sides(const report_task *task, const qm_json *document, qm_problem *problem)
{
    const qm_report_limits *limits = &task->report.limits;
    if ((isnan(limits->inside) && isnan(limits->outside)) || qm_json_has(document, "request.sign"))
        return true;
    *problem =
        qm_problem_make(QM_PROBLEM_CONFLICT,
                        "`limit_in` and `limit_out` are of signed distances, and the comparison has no sign");
    return false;
}

/** Takes both meshes, as they were when they were compared; false with a problem. */
static bool take_meshes(report_task *task, qm_problem *problem)
{
    qm_json *document = task->document ? qm_json_parse(task->document) : NULL;
    const char *type = qm_json_get_string(document, "type");
    bool is_comparison = type && strcmp(type, "comparison") == 0, are_taken = false;
    if (!document)
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the report");
    else if (!is_comparison)
        *problem = qm_problem_make(QM_PROBLEM_CONFLICT, "only comparisons have reports");
    else
        are_taken = has_sides(task, document, problem) && take_mesh(task, 0, document, problem) &&
                    take_mesh(task, 1, document, problem);
    task->report.region_limit = qm_json_get_number(document, "request.limit");
    qm_json_free(document);
    if (!are_taken) return false;
    const qm_report_mesh *mesh = task->report.mesh;
    const qm_notes notes[2] = {mesh[0].notes, mesh[1].notes};
    if (qm_job_ran_on(task->app->jobs, &task->row, mesh[0].loaded->revision, mesh[1].loaded->revision, notes))
        return true;
    *problem = qm_problem_make(QM_PROBLEM_CONFLICT,
                               "vertices of a mesh were moved since this comparison: its pictures would not "
                               "show what was compared. Compare again");
    return false;
}

static void reply(qm_request *request, char *text)
{
    qm_reply_header(request, "Content-Security-Policy",
                    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; "
                    "form-action 'none'; frame-ancestors 'none'");
    qm_reply_header(request, "Content-Disposition", "inline; filename=\"%s.html\"", qm_request_id(request));
    qm_reply_text(request, 200, "text/html; charset=utf-8", text);
}

void qm_handle_job_report(qm_request *request)
{
    report_task task = {.app = qm_request_app(request)};
    qm_report *report = &task.report;
    qm_problem problem;
    char now[QM_TIME_SIZE];
    qm_report_limits *limits = &report->limits;
    if (!read_number(request, "limit", true, &limits->distance) ||
        !read_number(request, "limit_in", true, &limits->inside) ||
        !read_number(request, "limit_out", true, &limits->outside) ||
        !read_number(request, "range", false, &report->range))
        return;
    bool is_ready = take_result(&task, qm_request_id(request), &problem) && take_meshes(&task, &problem);
    qm_text out = {0};
    if (is_ready) {
        qm_context ctx = qm_meshes_context(task.app->meshes);
        qm_clock_format(now);
        report->made = now;
        report->result = task.result;
        report->request = task.row.body;
        report->thread_count = (int)task.app->config->job_threads;
        is_ready = qm_report_write(&ctx, report, &out, &problem);
    }
    reset_task(&task);
    if (is_ready) {
        reply(request, qm_text_take(&out));
        return;
    }
    qm_text_reset(&out);
    qm_reply_problem(request, &problem);
}
