/**
 * job_list.c: the jobs of the store: their list, a page at a time, and the end of old ones.
 */
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "job_internal.h"
#include "ops/json_out.h"
#include "store/result_file.h"

#define DROP_STEP 64
#define LIST_STEP 8              /* documents may be large: so many are in memory twice */
#define MAX_PAGE_SIZE (8u << 20) /* bytes of documents after which a page ends before its limit */

/** The document of a row: as stored, or that of the job as it is now. NULL: out of memory. */
static char *document_of_row(qm_jobs *jobs, const qm_store_job *row)
{
    if (row->document) return strdup(row->document);
    qm_problem problem;
    qm_job *job = qm_jobs_find(jobs, row->id, &problem);
    char *document = job ? qm_job_document(jobs, job, false) : NULL;
    qm_jobs_release(jobs, job);
    return document;
}

/** A page that is made: its end is the limit of jobs or of bytes, whichever comes first. */
typedef struct job_page {
    qm_text *out;
    size_t start; /* of the page in out */
    size_t rest;  /* jobs that may follow */
    int64_t after;
} job_page;

static bool has_room_for_more(const job_page *page)
{
    return page->rest > 0 && page->out->size - page->start < MAX_PAGE_SIZE && !page->out->failed;
}

/** Adds the next few jobs; false when there are no more. */
static bool list_step(qm_jobs *jobs, job_page *page)
{
    qm_store_job rows[LIST_STEP];
    size_t count;
    if (qm_store_list_jobs(jobs->store, page->after, LIST_STEP, rows, &count) != QM_OK)
        page->out->failed = true;
    for (size_t i = 0; i < count; i++) {
        if (has_room_for_more(page)) {
            char *document = document_of_row(jobs, &rows[i]);
            qm_json_add_comma(page->out);
            qm_text_add_string(page->out, document ? document : "");
            if (!document) page->out->failed = true;
            free(document);
            page->after = rows[i].sequence;
            page->rest--;
        }
        qm_store_job_reset(&rows[i]);
    }
    return count > 0;
}

bool qm_jobs_list(qm_jobs *jobs, int64_t after, size_t limit, qm_text *out, int64_t *next)
{
    job_page page = {.out = out, .start = out->size, .rest = limit, .after = after};
    while (has_room_for_more(&page) && list_step(jobs, &page))
        continue;
    qm_store_job following;
    size_t count;
    if (qm_store_list_jobs(jobs->store, page.after, 1, &following, &count) != QM_OK) out->failed = true;
    bool is_last = count == 0;
    if (!is_last) qm_store_job_reset(&following);
    *next = is_last ? 0 : page.after;
    return !out->failed;
}

void qm_jobs_drop_old(qm_jobs *jobs)
{
    char ids[DROP_STEP][QM_ID_SIZE], before[QM_TIME_SIZE] = "";
    size_t total = 0, count;
    if (jobs->limits.kept_s > 0.0) qm_time_format_past(jobs->limits.kept_s, before);
    do {
        count = qm_store_drop_old_jobs(jobs->store, jobs->limits.kept_jobs, before, DROP_STEP, ids);
        for (size_t i = 0; i < count; i++)
            qm_result_file_remove(jobs->store, ids[i]);
        total += count;
    } while (count == DROP_STEP);
    if (total > 0) qm_log(QM_LOG_INFO, "%zu old jobs removed", total);
}
