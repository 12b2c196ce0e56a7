/**
 * jobs_list.c: jobs as documents: the resource of one, the list a page at a time, and the removal of old
 * ones.
 */
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "former_names.h"
#include "job_internal.h"
#include "ops/json_out.h"
#include "store/result_file.h"
#include "store/store_problem.h"

#define DROP_STEP 64
#define LIST_STEP 8              /* documents that are in memory twice: they may be large */
#define MAX_PAGE_SIZE (8u << 20) /* bytes of documents after which a page ends before its limit */

/* ---- one job ---- */

static const char *const state_names[] = {"queued", "running", "succeeded", "failed", "canceled"};
enum { STATES = sizeof state_names / sizeof *state_names };

const char *qm_job_state_name(qm_job_state state)
{
    QM_ASSERT((size_t)state < STATES);
    return state_names[state];
}

bool qm_job_state_find(const char *name, qm_job_state *out)
{
    for (int i = 0; i < STATES; i++) {
        if (strcmp(state_names[i], name) != 0) continue;
        *out = (qm_job_state)i;
        return true;
    }
    return false;
}

char *qm_job_write_members(const qm_job *job, qm_job_state state, const char *problem)
{
    QM_ASSERT(qm_jobs_is_locked(job->jobs));
    qm_text out = {0};
    char now[QM_TIME_SIZE];
    qm_clock_format(now);
    qm_text_printf(&out, "\"id\":\"%s\",\"type\":\"%s\",\"state\":\"%s\",\"created\":\"%s\"", job->id,
                   qm_job_type_of(job->request.kind)->name, qm_job_state_name(state), job->created);
    const char *started = job->leader ? job->leader->started : job->started;
    if (started[0]) qm_text_printf(&out, ",\"started\":\"%s\"", started);
    if (state > QM_JOB_RUNNING) qm_text_printf(&out, ",\"ended\":\"%s\"", now);
    qm_text_add_string(&out, ",\"request\":");
    qm_json_write_request_briefly(&out, &job->request);
    if (job->last_progress) qm_text_printf(&out, ",\"progress\":{%s}", job->last_progress);
    if (problem) qm_text_printf(&out, ",\"problem\":%s", problem);
    return qm_text_take(&out);
}

/** The resource of its members, with its labels, and a result and the mark of a cached one when there are. */
static char *join_document(const char *members, const char *labels, const char *result, bool is_cached)
{
    qm_text out = {0};
    qm_text_add_string(&out, "{");
    qm_text_add_string(&out, members);
    qm_mesh_write_labels(&out, labels);
    if (result) {
        qm_text_add_string(&out, ",\"result\":");
        qm_text_add_string(&out, result);
    }
    qm_text_add_string(&out, is_cached ? ",\"cached\":true}" : "}");
    return qm_text_take(&out);
}

static char *write_document(qm_jobs *jobs, const qm_job *job, bool is_cached, bool *has_ended)
{
    uv_mutex_lock(&jobs->lock);
    const qm_job *runs = job->leader ? job->leader : job;
    char *now = job->document ? NULL : qm_job_write_members(job, runs->state, NULL);
    const char *members = job->document ? job->document : now;
    char *document = members ? join_document(members, job->labels, job->result, is_cached) : NULL;
    *has_ended = job->state > QM_JOB_RUNNING;
    uv_mutex_unlock(&jobs->lock);
    free(now);
    return document;
}

char *qm_job_document_now(qm_jobs *jobs, qm_job *job, bool *has_ended)
{
    return write_document(jobs, job, false, has_ended);
}

char *qm_job_document(qm_jobs *jobs, qm_job *job, bool is_cached)
{
    bool has_ended;
    return write_document(jobs, job, is_cached, &has_ended);
}

char *qm_job_result_object(qm_jobs *jobs, qm_job *job)
{
    uv_mutex_lock(&jobs->lock);
    char *result = job->result ? strdup(job->result) : NULL;
    uv_mutex_unlock(&jobs->lock);
    return result;
}

/* ---- all jobs ---- */

/** The document of a row: as stored, or that of the job as it is now. NULL: out of memory. */
static char *document_of_row(qm_jobs *jobs, const qm_store_job *row)
{
    if (row->document) {
        qm_former_names_replace(row->document);
        qm_former_names_replace(row->result);
        return join_document(row->document, row->labels, row->result, false);
    }
    qm_problem problem;
    qm_job *job = qm_jobs_find(jobs, row->id, &problem);
    char *document = job ? qm_job_document(jobs, job, false) : NULL;
    qm_jobs_release(jobs, job);
    return document;
}

/** A page: it ends at the limit of jobs or of bytes, whichever comes first. */
typedef struct job_page {
    qm_text *out;
    size_t start; /* of the page in out */
    size_t rest;  /* jobs that may follow */
    const qm_store_job_filter *filter;
    qm_store_page rows; /* those to read next */
} job_page;

static bool has_room_for_more(const job_page *page)
{
    return page->rest > 0 && page->out->size - page->start < MAX_PAGE_SIZE && !page->out->failed;
}

/** True when an unfinished job of a row is in a state: that of an embedded store, which the table has, says no more than
 * queued. */
static bool is_in_state(qm_jobs *jobs, const qm_store_job *row, const qm_job_state *state)
{
    if (!state || *state > QM_JOB_RUNNING || qm_store_is_shared(jobs->store)) return true;
    qm_problem problem;
    qm_job *job = qm_jobs_find(jobs, row->id, &problem);
    if (!job) return false;
    uv_mutex_lock(&jobs->lock);
    qm_job_state now = job->leader ? job->leader->state : job->state;
    uv_mutex_unlock(&jobs->lock);
    qm_jobs_release(jobs, job);
    return now == *state;
}

/** Adds the next few jobs; false when there are no more. */
static bool list_step(qm_jobs *jobs, job_page *page)
{
    QM_ASSERT(page->rest > 0);
    qm_store_job rows[LIST_STEP];
    size_t count;
    if (qm_store_list_jobs(jobs->store, &page->rows, page->filter, rows, &count) != QM_STORED)
        page->out->failed = true;
    for (size_t i = 0; i < count; i++) {
        if (has_room_for_more(page)) {
            page->rows.after = rows[i].sequence;
            if (is_in_state(jobs, &rows[i], page->filter->state)) {
                char *document = document_of_row(jobs, &rows[i]);
                qm_json_add_comma(page->out);
                qm_text_add_string(page->out, document ? document : "");
                if (!document) page->out->failed = true;
                free(document);
                page->rest--;
            }
        }
        qm_store_job_reset(&rows[i]);
    }
    return count > 0;
}

bool qm_jobs_list(qm_jobs *jobs, qm_store_page page, const qm_store_job_filter *filter, qm_text *out,
                  int64_t *next)
{
    job_page work = {out, out->size, page.limit, filter, page};
    work.rows.limit = LIST_STEP;
    while (has_room_for_more(&work) && list_step(jobs, &work))
        continue;
    qm_store_job following;
    size_t count;
    work.rows.limit = 1;
    if (qm_store_list_jobs(jobs->store, &work.rows, filter, &following, &count) != QM_STORED)
        out->failed = true;
    bool is_last = count == 0;
    if (!is_last) qm_store_job_reset(&following);
    *next = is_last ? 0 : work.rows.after;
    return !out->failed;
}

bool qm_jobs_remove(qm_jobs *jobs, qm_job *job, qm_problem *problem)
{
    uv_mutex_lock(&jobs->lock);
    bool has_ended = job->state > QM_JOB_RUNNING;
    uv_mutex_unlock(&jobs->lock);
    if (!has_ended) {
        *problem = qm_problem_make(QM_PROBLEM_CONFLICT, "the job has not ended");
        return false;
    }
    qm_stored stored = qm_store_delete_job(jobs->store, job->id);
    if (stored != QM_STORED) {
        *problem = qm_store_read_problem(stored, QM_PROBLEM_JOB_NOT_FOUND, "job %s", job->id);
        return false;
    }
    qm_result_file_remove(jobs->store, job->id);
    uv_mutex_lock(&jobs->lock);
    qm_job_unlist(job); /* one whose end could not be stored */
    uv_mutex_unlock(&jobs->lock);
    return true;
}

void qm_jobs_drop_old(qm_jobs *jobs)
{
    char ids[DROP_STEP][QM_ID_SIZE];
    size_t total = 0, count;
    do {
        qm_store_drop_old_jobs(jobs->store, jobs->limits.kept_jobs, jobs->limits.kept_s, DROP_STEP, ids,
                               &count);
        for (size_t i = 0; i < count; i++)
            qm_result_file_remove(jobs->store, ids[i]);
        total += count;
    } while (count == DROP_STEP);
    if (total > 0) qm_log(QM_LOG_INFO, "%zu old jobs removed", total);
}
