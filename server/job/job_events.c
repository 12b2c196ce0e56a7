/**
 * job_events.c: the events of a job, those who read them, and the job as a document.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "job_internal.h"
#include "ops/json_out.h"

#define SEQS_OF_A_RUN 1000000000u /* more events than any run has, few enough for exact doubles */

/* ---- events ---- */

void qm_job_wake_readers(qm_job *job)
{
    for (qm_reader *reader = job->readers; reader; reader = reader->next)
        qm_reader_wake(job->jobs, reader);
}

void qm_job_set_restarts(qm_job *job, int64_t restarts)
{
    job->seq_base = SEQS_OF_A_RUN * (uint64_t)restarts;
}

static uint64_t last_seq(const qm_job *job)
{
    return job->event_count > 0 ? job->events[job->event_count - 1].seq : 0;
}

static uint64_t next_seq(const qm_job *job)
{
    uint64_t last = last_seq(job);
    return (last > job->seq_base ? last : job->seq_base) + 1;
}

char *qm_job_make_event(const qm_job *job, const char *name, const char *members)
{
    qm_text line = {0};
    qm_text_printf(&line, "{\"event\":\"%s\",\"seq\":%llu,%s}", name, (unsigned long long)next_seq(job),
                   members);
    return qm_text_take(&line);
}

static bool make_room(qm_job *job)
{
    if (job->event_count < job->event_capacity) return true;
    size_t capacity = job->event_capacity ? 2 * job->event_capacity : 16;
    qm_job_event *events = realloc(job->events, capacity * sizeof *events);
    if (!events) return false;
    job->events = events;
    job->event_capacity = capacity;
    return true;
}

bool qm_job_put_event(qm_job *job, uint64_t seq, char *line)
{
    bool has_place = line && make_room(job);
    if (has_place)
        job->events[job->event_count++] = (qm_job_event){seq, line};
    else
        free(line);
    return has_place;
}

void qm_job_add_event(qm_job *job, const char *name, const char *members)
{
    qm_job_put_event(job, next_seq(job), qm_job_make_event(job, name, members));
    qm_job_wake_readers(job);
}

uint64_t qm_job_join_unsaved(const qm_job *job, size_t end, qm_text *out)
{
    for (size_t i = job->saved_count; i < end; i++)
        qm_text_printf(out, "%s\n", job->events[i].line);
    return job->saved_count < end ? job->events[job->saved_count].seq : next_seq(job);
}

/** The place of the first event after a number. */
static size_t find_after(const qm_job *job, uint64_t seq)
{
    size_t low = 0, high = job->event_count;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (job->events[middle].seq <= seq)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

static void frame(qm_text *out, qm_framing framing, uint64_t seq, const char *line)
{
    if (framing == QM_FRAMING_NDJSON) {
        qm_text_printf(out, "%s\n", line);
        return;
    }
    const char *name = line + strlen("{\"event\":\"");
    qm_text_printf(out, "id: %llu\nevent: %.*s\ndata: %s\n\n", (unsigned long long)seq,
                   (int)strcspn(name, "\""), name, line);
}

static void go_to_sleep(qm_reader *reader, void (*suspend)(void *user))
{
    reader->asleep = true;
    suspend(reader->user);
}

qm_news qm_job_read(qm_jobs *jobs, qm_job *job, uint64_t *seq, qm_framing framing, qm_text *out,
                    qm_reader *reader, void (*suspend)(void *user))
{
    uv_mutex_lock(&jobs->lock);
    qm_news news = QM_NEWS_SOME;
    double now = qm_now_ms();
    /* Whoever has read what the store lacks of an earlier run, or says so of events that never were, reads
     * all of this one. */
    if (*seq > last_seq(job)) *seq = job->seq_base;
    if (*seq < last_seq(job)) {
        for (size_t i = find_after(job, *seq); i < job->event_count; i++)
            frame(out, framing, job->events[i].seq, job->events[i].line);
        *seq = last_seq(job);
        reader->wake_at_ms = now + jobs->limits.heartbeat_ms;
    } else if (qm_job_is_over(job)) {
        news = QM_NEWS_END;
    } else if (now >= reader->wake_at_ms) {
        if (framing == QM_FRAMING_NDJSON)
            qm_text_printf(out, "{\"event\":\"heartbeat\",\"seq\":%llu}\n", (unsigned long long)*seq);
        else
            qm_text_add_string(out, ": heartbeat\n\n");
        reader->wake_at_ms = now + jobs->limits.heartbeat_ms;
    } else {
        news = QM_NEWS_NONE;
        go_to_sleep(reader, suspend);
    }
    uv_mutex_unlock(&jobs->lock);
    return news;
}

bool qm_job_await_end(qm_jobs *jobs, qm_job *job, qm_reader *reader, void (*suspend)(void *user))
{
    uv_mutex_lock(&jobs->lock);
    bool is_over = qm_job_is_over(job) || qm_now_ms() >= reader->wake_at_ms;
    if (!is_over) go_to_sleep(reader, suspend);
    uv_mutex_unlock(&jobs->lock);
    return is_over;
}

void qm_readers_add(qm_reader **list, qm_reader *reader)
{
    reader->asleep = false;
    reader->next = *list;
    *list = reader;
}

void qm_readers_remove(qm_reader **list, qm_reader *reader)
{
    while (*list && *list != reader)
        list = &(*list)->next;
    if (*list) *list = reader->next;
}

void qm_job_join(qm_jobs *jobs, qm_job *job, qm_reader *reader)
{
    uv_mutex_lock(&jobs->lock);
    job->references++;
    qm_readers_add(&job->readers, reader);
    uv_mutex_unlock(&jobs->lock);
}

void qm_job_leave(qm_jobs *jobs, qm_job *job, qm_reader *reader)
{
    uv_mutex_lock(&jobs->lock);
    qm_readers_remove(&job->readers, reader);
    qm_job_drop_reference(job);
    uv_mutex_unlock(&jobs->lock);
}

double qm_jobs_heartbeat_ms(const qm_jobs *jobs)
{
    return jobs->limits.heartbeat_ms;
}

static void tick_readers(qm_jobs *jobs, qm_reader *first, double now_ms)
{
    for (qm_reader *reader = first; reader; reader = reader->next)
        if (now_ms >= reader->wake_at_ms) qm_reader_wake(jobs, reader);
}

void qm_jobs_tick(qm_jobs *jobs, double now_ms)
{
    uv_mutex_lock(&jobs->lock);
    tick_readers(jobs, jobs->readers, now_ms);
    for (qm_job *job = jobs->first; job; job = job->next)
        tick_readers(jobs, job->readers, now_ms);
    uv_mutex_unlock(&jobs->lock);
}

/* ---- documents ---- */

const char *qm_job_state_name(qm_job_state state)
{
    static const char *const names[] = {"queued", "running", "succeeded", "failed", "canceled"};
    return names[state];
}

char *qm_job_write_document(const qm_job *job, qm_job_state state, const char *outcome)
{
    qm_text out = {0};
    char now[QM_TIME_SIZE];
    qm_time_format(now);
    qm_text_printf(&out, "{\"id\":\"%s\",\"type\":\"%s\",\"state\":\"%s\",\"created\":\"%s\"", job->id,
                   qm_job_type_of(job->request.kind)->name, qm_job_state_name(state), job->created);
    if (job->started[0]) qm_text_printf(&out, ",\"started\":\"%s\"", job->started);
    if (state > QM_JOB_RUNNING) qm_text_printf(&out, ",\"ended\":\"%s\"", now);
    qm_text_add_string(&out, ",\"request\":");
    qm_json_write_request_briefly(&out, &job->request);
    if (job->last_bounds) qm_text_printf(&out, ",\"progress\":{%s}", job->last_bounds);
    if (outcome) qm_text_printf(&out, ",%s", outcome);
    qm_text_add_string(&out, "}");
    return qm_text_take(&out);
}

char *qm_job_document_now(qm_jobs *jobs, qm_job *job, bool *has_ended)
{
    uv_mutex_lock(&jobs->lock);
    char *document = job->document ? strdup(job->document) : qm_job_write_document(job, job->state, NULL);
    *has_ended = job->state > QM_JOB_RUNNING;
    uv_mutex_unlock(&jobs->lock);
    return document;
}

char *qm_job_result_object(qm_jobs *jobs, qm_job *job)
{
    static const char name[] = ",\"result\":";
    bool has_ended;
    char *document = qm_job_document_now(jobs, job, &has_ended), *result = NULL;
    /* The outcome is the last member: strings before it hold no bare quotes. */
    const char *start = document && has_ended ? strstr(document, name) : NULL;
    if (start) start += strlen(name);
    if (start) result = strndup(start, strlen(start) - 1);
    free(document);
    return result;
}

char *qm_job_document(qm_jobs *jobs, qm_job *job, bool is_cached)
{
    bool ended;
    char *document = qm_job_document_now(jobs, job, &ended);
    if (!document || !is_cached) return document;
    qm_text marked = {0};
    qm_text_add(&marked, document, strlen(document) - 1);
    qm_text_add_string(&marked, ",\"cached\":true}");
    free(document);
    return qm_text_take(&marked);
}
