/**
 * job_saving.c: events of jobs on their way to the store, and back.
 *
 * While a job runs its events are stored from time to time, those of all jobs at once, and the rest with its
 * end: a short job takes one transaction, and a long one is not forgotten when the daemon is killed. Where a
 * save and the end of a job meet, the end has all events that the save has, and the store keeps the end's.
 */
#include <stdlib.h>
#include <string.h>

#include "job_internal.h"

static const char seq_mark[] = "\"seq\":"; /* the name of an event, before it, has no quotes inside */

/** Takes a line of the store back among the events; false: it is none, or memory is out. */
static bool restore_line(qm_job *job, const char *line, size_t size)
{
    const char *seq = strstr(line, seq_mark);
    if (!seq || seq > line + size) return false;
    return qm_job_put_event(job, strtoull(seq + strlen(seq_mark), NULL, 10), strndup(line, size));
}

qm_status qm_job_restore_events(qm_job *job)
{
    qm_text all = {0};
    qm_status status = qm_store_read_events(job->jobs->store, job->id, &all);
    const char *line = all.data, *end;
    for (; status == QM_OK && line && (end = strchr(line, '\n')); line = end + 1)
        if (!restore_line(job, line, (size_t)(end - line))) status = QM_E_NO_MEMORY;
    job->saved_count = job->event_count;
    qm_text_reset(&all);
    return status;
}

bool qm_job_fetch_events(qm_job *job, qm_problem *problem)
{
    if (!job->is_stored || job->event_count > 0) return true;
    qm_status status = qm_job_restore_events(job);
    if (status != QM_OK)
        *problem = qm_problem_from_store(status, QM_PROBLEM_INTERNAL, "events of job %s", job->id);
    return status == QM_OK;
}

/** Events of a job that are about to be stored. */
typedef struct unsaved {
    qm_job *job; /* a reference */
    size_t end;  /* of its events */
    uint64_t seq;
    qm_text lines;
} unsaved;

/** How many events of a job are to be in the store. That the daemon stops is for those who listen, not for
 * whoever asks when it is back. */
static size_t count_lasting(const qm_job *job)
{
    return job->event_count - (job->interrupted ? 1 : 0);
}

/** Notes what the store lacks of the jobs that run; those are no more than there are workers. */
static size_t gather(qm_jobs *jobs, unsaved *found)
{
    size_t count = 0;
    uv_mutex_lock(&jobs->lock);
    for (qm_job *job = jobs->first; job && count < (size_t)jobs->limits.workers; job = job->next) {
        size_t end = count_lasting(job);
        if (job->state != QM_JOB_RUNNING || job->line.batch || job->saved_count >= end) continue;
        unsaved *next = &found[count++];
        *next = (unsaved){.job = job, .end = end};
        next->seq = qm_job_join_unsaved(job, end, &next->lines);
        job->references++;
    }
    uv_mutex_unlock(&jobs->lock);
    return count;
}

/** False: what was found is to be saved another time. */
static bool store(qm_jobs *jobs, const unsaved *found, size_t count)
{
    qm_store_events *events = calloc(count, sizeof *events);
    bool is_whole = events;
    for (size_t i = 0; is_whole && i < count; i++) {
        events[i] = (qm_store_events){found[i].job->id, found[i].seq, found[i].lines.data};
        is_whole = !found[i].lines.failed;
    }
    bool stored = is_whole && qm_store_append_events(jobs->store, events, count) == QM_OK;
    free(events);
    return stored;
}

static void settle(qm_jobs *jobs, unsaved *found, size_t count, bool is_stored)
{
    uv_mutex_lock(&jobs->lock);
    for (size_t i = 0; i < count; i++) {
        if (is_stored) found[i].job->saved_count = found[i].end;
        qm_job_drop_reference(found[i].job);
        qm_text_reset(&found[i].lines);
    }
    uv_mutex_unlock(&jobs->lock);
}

void qm_jobs_save_events(qm_jobs *jobs)
{
    unsaved *found = calloc((size_t)jobs->limits.workers, sizeof *found);
    if (!found) return;
    uv_mutex_lock(&jobs->saving);
    size_t count = gather(jobs, found);
    if (count > 0) settle(jobs, found, count, store(jobs, found, count));
    uv_mutex_unlock(&jobs->saving);
    free(found);
}
