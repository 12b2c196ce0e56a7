/**
 * job_events.c: the event log of a job: its events in memory, their subscribers, the thread that
 * notifies subscribers, and the way of events to the store and back.
 *
 * While a job runs, its events are stored from time to time, those of all jobs in one transaction, and the
 * remaining ones with its end: a short job takes one transaction, and a long one is not forgotten when the
 * daemon is killed. Where a save and the end of a job meet, the end has all events that the save has, and the
 * store replaces an event by an equal one.
 *
 * One event may have hundreds of subscribers, and to wake one takes a system call. The worker that has the
 * event computes at a low priority: if it woke them itself, under the lock, all would wait for it whenever
 * the machine has something better to do. So it only puts them into a list (due), and a thread of normal
 * priority, the notifier, wakes them.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "former_names.h"
#include "job_internal.h"
#include "job_mirrors.h"
#include "store/store_problem.h"

#define SEQS_OF_A_RUN 1000000000u /* more events than any run has, few enough for exact doubles */

/* ---- events ---- */

void qm_job_set_restarts(qm_job *job, int64_t restarts)
{
    job->restarts = restarts;
    job->seq_base = SEQS_OF_A_RUN * (uint64_t)restarts;
}

uint64_t qm_job_last_seq(const qm_job *job)
{
    return job->event_count > 0 ? job->events[job->event_count - 1]->seq : 0;
}

uint64_t qm_job_next_seq(const qm_job *job)
{
    QM_ASSERT(qm_jobs_is_locked(job->jobs));
    uint64_t last = qm_job_last_seq(job);
    return (last > job->seq_base ? last : job->seq_base) + 1;
}

/** Appends an event to the log; false: out of memory. */
static bool append_event(qm_job *job, uint64_t seq, const char *name, const char *members)
{
    QM_ASSERT(seq > qm_job_last_seq(job) && strlen(name) < QM_EVENT_NAME_SIZE);
    if (job->event_count == job->event_capacity) {
        size_t capacity = job->event_capacity ? 2 * job->event_capacity : 16;
        qm_job_event **events = realloc(job->events, capacity * sizeof *events);
        if (!events) return false;
        job->events = events;
        job->event_capacity = capacity;
    }
    size_t size = strlen(members) + 1;
    qm_job_event *event = malloc(sizeof *event + size);
    if (!event) return false;
    event->seq = seq;
    snprintf(event->name, sizeof event->name, "%s", name);
    memcpy(event->members, members, size);
    QM_ASSERT(job->event_count < job->event_capacity);
    job->events[job->event_count++] = event;
    return true;
}

/** Appends an event that the store has. */
static bool append_stored(qm_job *job, const qm_store_event *event)
{
    if (!append_event(job, event->seq, event->name, event->members)) return false;
    qm_former_names_replace(job->events[job->event_count - 1]->members);
    return true;
}

/** The name of the events that tell progress. */
static const char *progress_name(const qm_job *job)
{
    return job->request.kind == QM_JOB_REMESH ? "stage" : "bounds";
}

bool qm_job_take_event(qm_job *job, const qm_store_event *event)
{
    QM_ASSERT(qm_jobs_is_locked(job->jobs));
    if (!job->is_mirror || event->seq <= qm_job_last_seq(job)) return true;
    if (!append_stored(job, event)) return false;
    int64_t restarts = (int64_t)((event->seq - 1) / SEQS_OF_A_RUN);
    if (restarts > job->restarts) qm_job_set_restarts(job, restarts);
    if (strcmp(event->name, progress_name(job)) == 0) {
        free(job->last_progress);
        job->last_progress = strdup(event->members);
    }
    qm_job_notify_all(job);
    return true;
}

void qm_job_add_event(qm_job *job, const char *name, const char *members)
{
    QM_ASSERT(qm_jobs_is_locked(job->jobs));
    if (job->on_end) return;
    append_event(job, qm_job_next_seq(job), name, members);
    qm_job_notify_all(job);
    for (qm_job *follower = job->followers; follower; follower = follower->next_follower)
        qm_job_add_event(follower, name, members);
}

void qm_job_add_progress(qm_job *job, const char *members)
{
    for (qm_job *each = job; each; each = each == job ? job->followers : each->next_follower) {
        char *kept = strdup(members);
        if (!kept) continue;
        free(each->last_progress);
        each->last_progress = kept;
    }
    qm_job_add_event(job, progress_name(job), members);
}

/* ---- to the store and back ---- */

void qm_job_list_events(const qm_job *job, size_t begin, size_t end, qm_store_event *out)
{
    QM_ASSERT(qm_jobs_is_locked(job->jobs));
    QM_ASSERT(begin <= end && end <= job->event_count);
    for (size_t i = begin; i < end; i++)
        *out++ =
            (qm_store_event){job->id, job->events[i]->seq, job->events[i]->name, job->events[i]->members};
}

static bool restore_event(void *user, const qm_store_event *event)
{
    return append_stored(user, event);
}

qm_stored qm_job_restore_events(qm_job *job)
{
    qm_stored stored =
        qm_store_read_events(job->jobs->store, job->id, qm_job_last_seq(job), restore_event, job);
    job->saved_count = job->event_count;
    if (!qm_store_is_shared(job->jobs->store)) job->durable_count = job->event_count;
    return stored;
}

bool qm_job_fetch_events(qm_job *job, qm_problem *problem)
{
    if (!job->is_from_row || job->event_count > 0) return true;
    qm_stored stored = qm_job_restore_events(job);
    if (stored != QM_STORED)
        *problem = qm_store_read_problem(stored, QM_PROBLEM_INTERNAL, "events of job %s", job->id);
    return stored == QM_STORED;
}

/** A job whose events are about to be stored. */
typedef struct saved_run {
    qm_job *job; /* a reference, which keeps the events alive */
    size_t end;  /* number of its events that the store has afterwards */
} saved_run;

/** The runs of a saving, and their new events. */
typedef struct saving {
    saved_run *runs;
    qm_store_run *rows;
    qm_store_event *events;
    size_t count, capacity, event_count;
} saving;

/** True for a job that the store knows to be this process's, and not to have ended. */
static bool has_run(const qm_job *job)
{
    if (job->is_mirror || job->is_lost || job->on_end || job->state > QM_JOB_RUNNING) return false;
    return job->state == QM_JOB_RUNNING || job->turn || job->leader; /* it is stored before it is queued */
}

/** The newest event of progress of a job, its members, or NULL; they live as long as the job. */
static const char *find_progress(const qm_job *job)
{
    for (size_t i = job->event_count; i > 0; i--)
        if (strcmp(job->events[i - 1]->name, progress_name(job)) == 0) return job->events[i - 1]->members;
    return NULL;
}

/** Lists the jobs with unsaved events, and all that run here of a shared store, which has something to say of them. The
 * lock is held. */
static bool gather(qm_jobs *jobs, saving *out)
{
    bool is_shared = qm_store_is_shared(jobs->store);
    for (qm_job *job = jobs->first; job; job = job->next)
        out->capacity++;
    out->runs = calloc(out->capacity + 1, sizeof *out->runs);
    out->rows = calloc(out->capacity + 1, sizeof *out->rows);
    if (!out->runs || !out->rows) return false;
    for (qm_job *job = jobs->first; job; job = job->next) {
        /* server_shutdown is for the subscribers of this run, not for clients of the next start. */
        size_t end = job->event_count - (job->interrupted ? 1 : 0);
        if (end < job->saved_count) end = job->saved_count; /* there was no memory for server_shutdown */
        if (!has_run(job) || (!is_shared && (job->state == QM_JOB_QUEUED || job->saved_count >= end)))
            continue;
        out->runs[out->count] = (saved_run){job, end};
        out->rows[out->count++] = (qm_store_run){
            .job = job->id, .restarts = job->restarts, .progress = is_shared ? find_progress(job) : NULL};
        out->event_count += end - job->saved_count;
        job->references++;
    }
    out->events = calloc(out->event_count + 1, sizeof *out->events);
    if (!out->events) return false;
    qm_store_event *next = out->events;
    for (size_t i = 0; i < out->count; i++) {
        const saved_run *run = &out->runs[i];
        qm_job_list_events(run->job, run->job->saved_count, run->end, next);
        next += run->end - run->job->saved_count;
    }
    return true;
}

/** Takes note of what the store has said of a run. The lock is held. True when the job is to be canceled. */
static bool note_saved(const saved_run *run, const qm_store_run *row)
{
    run->job->saved_count = run->end;
    if (!qm_store_is_shared(run->job->jobs->store)) run->job->durable_count = run->end;
    if (row->is_lost) qm_job_lose(run->job);
    return row->is_canceled && !row->is_lost;
}

bool qm_job_events_save(qm_jobs *jobs)
{
    saving work = {0};
    bool is_watched = false;
    uv_mutex_lock(&jobs->saving);

    uv_mutex_lock(&jobs->lock);
    bool gathered = gather(jobs, &work);
    uv_mutex_unlock(&jobs->lock);

    /* After a fault they are saved another time. */
    bool is_stored = gathered && work.count > 0 &&
                     qm_store_append_events(jobs->store, work.rows, work.count, work.events,
                                            work.event_count) == QM_STORED;
    for (size_t i = 0; i < work.count; i++) {
        uv_mutex_lock(&jobs->lock);
        bool is_canceled = is_stored && note_saved(&work.runs[i], &work.rows[i]);
        uv_mutex_unlock(&jobs->lock);
        is_watched = is_watched || (is_stored && work.rows[i].is_watched);
        if (is_canceled) qm_job_cancel_noted(jobs, work.runs[i].job);
        qm_jobs_release(jobs, work.runs[i].job);
    }

    uv_mutex_unlock(&jobs->saving);
    free(work.events);
    free(work.rows);
    free(work.runs);
    return is_watched;
}

void qm_job_events_note_durable(void *user, const char *id, size_t count, uint64_t last)
{
    qm_jobs *jobs = user;
    uv_mutex_lock(&jobs->lock);
    qm_job *job = jobs->first;
    while (job && strcmp(job->id, id) != 0)
        job = job->next;
    if (job && has_run(job)) {
        /* A failure takes the newest ones; but others may have come since. */
        bool is_whole = count == 0 || (count <= job->event_count && job->events[count - 1]->seq == last);
        if (is_whole) job->durable_count = count;
        size_t kept = is_whole ? count : job->durable_count;
        if (job->saved_count > kept) job->saved_count = kept;
        if (job->durable_count > job->saved_count) job->durable_count = job->saved_count;
    }
    uv_mutex_unlock(&jobs->lock);
}

/* ---- reading ---- */

/** The index of the first event after a number. */
static size_t find_after(const qm_job *job, uint64_t seq)
{
    size_t low = 0, high = job->event_count;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (job->events[middle]->seq <= seq)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

static void frame(qm_text *out, qm_framing framing, const qm_job_event *event)
{
    unsigned long long seq = event->seq;
    if (framing == QM_FRAMING_SSE) qm_text_printf(out, "id: %llu\nevent: %s\ndata: ", seq, event->name);
    qm_text_printf(out, "{\"event\":\"%s\",\"seq\":%llu,", event->name, seq);
    qm_text_add_string(out, event->members);
    qm_text_add_string(out, framing == QM_FRAMING_SSE ? "}\n\n" : "}\n");
}

void qm_job_wait(qm_jobs *jobs, qm_subscriber *subscriber, void (*suspend)(void *user))
{
    QM_ASSERT(qm_jobs_is_locked(jobs) && !subscriber->is_waiting);
    (void)jobs;
    subscriber->is_waiting = true;
    suspend(subscriber->user);
}

qm_read_status qm_job_read(qm_jobs *jobs, qm_job *job, uint64_t *seq, qm_framing framing, qm_text *out,
                           qm_subscriber *subscriber, void (*suspend)(void *user))
{
    QM_ASSERT(seq && out && subscriber && suspend);
    uv_mutex_lock(&jobs->lock);
    qm_read_status status = QM_READ_SOME;
    double now = qm_clock_now_ms();
    /* A client that names a number past the last event has read events of an earlier run which were not
     * stored, or of none: it gets all events of this run. Of a mirror it may have read them where the job runs. */
    bool is_known = job->is_mirror && *seq > job->seq_base && *seq <= job->seq_base + SEQS_OF_A_RUN;
    if (*seq > qm_job_last_seq(job) && !is_known) *seq = job->seq_base;
    if (*seq < qm_job_last_seq(job)) {
        for (size_t i = find_after(job, *seq); i < job->event_count; i++)
            frame(out, framing, job->events[i]);
        *seq = qm_job_last_seq(job);
        subscriber->wake_at_ms = now + jobs->limits.heartbeat_ms;
    } else if (qm_job_is_over(job)) {
        status = QM_READ_END;
    } else if (now >= subscriber->wake_at_ms) {
        if (framing == QM_FRAMING_NDJSON)
            qm_text_printf(out, "{\"event\":\"heartbeat\",\"seq\":%llu}\n", (unsigned long long)*seq);
        else
            qm_text_add_string(out, ": heartbeat\n\n");
        subscriber->wake_at_ms = now + jobs->limits.heartbeat_ms;
    } else {
        status = QM_READ_NONE;
        qm_job_wait(jobs, subscriber, suspend);
    }
    uv_mutex_unlock(&jobs->lock);
    return status;
}

bool qm_job_has_last_event(qm_jobs *jobs, qm_job *job)
{
    static const char *const names[] = {"result", "error", "server_shutdown"};
    bool is_last = false;
    uv_mutex_lock(&jobs->lock);
    const char *name = job->event_count > 0 ? job->events[job->event_count - 1]->name : "";
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        is_last = is_last || strcmp(name, names[i]) == 0;
    uv_mutex_unlock(&jobs->lock);
    return is_last;
}

bool qm_job_await_end(qm_jobs *jobs, qm_job *job, qm_subscriber *subscriber, void (*suspend)(void *user))
{
    uv_mutex_lock(&jobs->lock);
    bool is_over = qm_job_is_over(job) || qm_clock_now_ms() >= subscriber->wake_at_ms;
    if (!is_over) qm_job_wait(jobs, subscriber, suspend);
    uv_mutex_unlock(&jobs->lock);
    return is_over;
}

/* ---- subscribers ---- */

void qm_job_subscribers_add(qm_subscriber **list, qm_subscriber *subscriber)
{
    subscriber->is_waiting = false;
    subscriber->next = *list;
    *list = subscriber;
}

void qm_job_subscribers_remove(qm_subscriber **list, qm_subscriber *subscriber)
{
    while (*list && *list != subscriber)
        list = &(*list)->next;
    if (*list) *list = subscriber->next;
}

void qm_job_subscribe(qm_jobs *jobs, qm_job *job, qm_subscriber *subscriber)
{
    uv_mutex_lock(&jobs->lock);
    job->references++;
    if (job->is_mirror) qm_job_mirrors_list(job);
    qm_job_subscribers_add(&job->subscribers, subscriber);
    uv_mutex_unlock(&jobs->lock);
}

void qm_job_unsubscribe(qm_jobs *jobs, qm_job *job, qm_subscriber *subscriber)
{
    uv_mutex_lock(&jobs->lock);
    qm_job_subscribers_remove(&job->subscribers, subscriber);
    qm_job_drop_reference(job);
    uv_mutex_unlock(&jobs->lock);
}

double qm_job_events_heartbeat_ms(const qm_jobs *jobs)
{
    return jobs->limits.heartbeat_ms;
}

static void notify_late(qm_jobs *jobs, qm_subscriber *first, double now_ms)
{
    for (qm_subscriber *subscriber = first; subscriber; subscriber = subscriber->next)
        if (now_ms >= subscriber->wake_at_ms) qm_job_events_notify(jobs, subscriber);
}

void qm_job_events_tick(qm_jobs *jobs, double now_ms)
{
    qm_job *expired = NULL; /* while their meshes are being read */
    uv_mutex_lock(&jobs->lock);
    notify_late(jobs, jobs->subscribers, now_ms);
    for (qm_job *job = jobs->first; job; job = job->next) {
        notify_late(jobs, job->subscribers, now_ms);
        qm_job_check_time(job, now_ms);
        if (!job->is_loading || job->expiry == QM_JOB_IN_TIME) continue;
        job->is_loading = false;
        job->references++;
        job->next_expired = expired;
        expired = job;
    }
    uv_mutex_unlock(&jobs->lock);
    for (qm_job *next; expired; expired = next) {
        next = expired->next_expired;
        qm_problem problem = qm_job_expiry_problem(expired, expired->expiry);
        qm_job_finish_with_problem(expired, QM_JOB_FAILED, &problem);
        qm_jobs_release(jobs, expired);
    }
}

/* ---- the notifier ---- */

void qm_job_events_notify(qm_jobs *jobs, qm_subscriber *subscriber)
{
    QM_ASSERT(qm_jobs_is_locked(jobs));
    if (!subscriber->is_waiting) return;
    subscriber->is_waiting = false;
    if (jobs->notifier_ends) {
        subscriber->wake(subscriber->user);
        return;
    }
    subscriber->next_due = jobs->due;
    jobs->due = subscriber;
    uv_cond_signal(&jobs->has_due);
}

void qm_job_notify_all(qm_job *job)
{
    for (qm_subscriber *subscriber = job->subscribers; subscriber; subscriber = subscriber->next)
        qm_job_events_notify(job->jobs, subscriber);
}

static void notify_due(void *data)
{
    qm_jobs *jobs = data;
    uv_mutex_lock(&jobs->lock);
    while (jobs->due || !jobs->notifier_ends) {
        qm_subscriber *subscriber = jobs->due;
        jobs->due = NULL;
        if (!subscriber) {
            uv_cond_wait(&jobs->has_due, &jobs->lock);
            continue;
        }
        uv_mutex_unlock(&jobs->lock);
        for (qm_subscriber *next; subscriber; subscriber = next) {
            next = subscriber->next_due; /* a subscriber that was woken may be gone at once */
            subscriber->wake(subscriber->user);
        }
        uv_mutex_lock(&jobs->lock);
    }
    uv_mutex_unlock(&jobs->lock);
}

bool qm_job_events_start_notifier(qm_jobs *jobs)
{
    uv_cond_init(&jobs->has_due);
    jobs->has_notifier = uv_thread_create(&jobs->notifier, notify_due, jobs) == 0;
    return jobs->has_notifier;
}

void qm_job_events_stop_notifier(qm_jobs *jobs)
{
    if (!jobs->has_notifier) return;
    uv_mutex_lock(&jobs->lock);
    jobs->notifier_ends = true;
    uv_cond_signal(&jobs->has_due);
    uv_mutex_unlock(&jobs->lock);
    uv_thread_join(&jobs->notifier);
    jobs->has_notifier = false;
}
