#include "job.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <uv.h>

#include "json_in.h"
#include "json_out.h"
#include "log.h"
#include "parallel.h"
#include "pool.h"

#define HEARTBEAT_MS 10000.0

struct qm_job {
    char id[QM_ID_SIZE];
    qm_job_request request;
    char *key;
    char created[QM_TIME_SIZE], started[QM_TIME_SIZE];
    qm_job_state state;
    atomic_bool cancel;
    bool is_drained;  /* cancel was raised by the end of the daemon, not by a client */
    bool interrupted; /* stopped by the end of the daemon: it will run again */
    char **events;    /* lines without a line end; events[i] has seq i + 1 */
    size_t event_count, event_capacity;
    char *last_bounds; /* the newest bounds event's own members, for the document */
    char *document;    /* once it has ended */
    qm_reader *readers;
    int references; /* the table counts as one while it is listed */
    bool listed;
    qm_jobs *jobs;
    qm_job *next;
};

struct qm_jobs {
    qm_store *store;
    qm_meshes *meshes;
    qm_job_limits limits;
    qm_pool *pool;
    uv_mutex_t lock;
    qm_job *first; /* jobs that have not ended, in no order */
    size_t queued, running;
    atomic_bool closed;
};

static const char *const state_names[] = {"queued", "running", "succeeded", "failed", "cancelled"};

double qm_now_ms(void)
{
    return (double)uv_hrtime() * 1e-6;
}

/* ---- references ---- */

static void free_job(qm_job *job)
{
    for (size_t i = 0; i < job->event_count; i++)
        free(job->events[i]);
    free(job->events);
    free(job->last_bounds);
    free(job->document);
    free(job->key);
    free(job);
}

static void drop_reference(qm_job *job)
{
    if (--job->references == 0) free_job(job);
}

void qm_jobs_release(qm_jobs *jobs, qm_job *job)
{
    if (!job) return;
    uv_mutex_lock(&jobs->lock);
    drop_reference(job);
    uv_mutex_unlock(&jobs->lock);
}

static void unlist(qm_jobs *jobs, qm_job *job)
{
    if (!job->listed) return;
    qm_job **link = &jobs->first;
    while (*link != job)
        link = &(*link)->next;
    *link = job->next;
    job->listed = false;
    drop_reference(job);
}

const char *qm_job_id(const qm_job *job)
{
    return job->id;
}

/* ---- events ---- */

static void wake_readers(qm_job *job)
{
    for (qm_reader *reader = job->readers; reader; reader = reader->next) {
        if (!reader->asleep) continue;
        reader->asleep = false;
        reader->wake(reader->user);
    }
}

/** {"event":NAME,"seq":N,MEMBERS}; members comes without braces. NULL: out of memory. */
static char *make_event(const char *name, size_t seq, const char *members)
{
    qm_text line = {0};
    qm_text_printf(&line, "{\"event\":\"%s\",\"seq\":%zu,%s}", name, seq, members);
    return qm_text_take(&line);
}

/** Adds an event and wakes the readers. The caller holds the lock. */
static void add_event(qm_job *job, const char *name, const char *members)
{
    if (job->event_count == job->event_capacity) {
        size_t capacity = job->event_capacity ? 2 * job->event_capacity : 16;
        char **events = realloc(job->events, capacity * sizeof *events);
        if (!events) return;
        job->events = events;
        job->event_capacity = capacity;
    }
    char *line = make_event(name, job->event_count + 1, members);
    if (line) job->events[job->event_count++] = line;
    wake_readers(job);
}

/** All events and the terminal one to come, a line each. */
static char *join_events(const qm_job *job, const char *name, const char *members)
{
    qm_text all = {0};
    for (size_t i = 0; i < job->event_count; i++)
        qm_text_printf(&all, "%s\n", job->events[i]);
    char *last = members ? make_event(name, job->event_count + 1, members) : NULL;
    if (last) qm_text_printf(&all, "%s\n", last);
    free(last);
    return qm_text_take(&all);
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

static bool has_ended(const qm_job *job)
{
    return job->state > QM_JOB_RUNNING || job->interrupted;
}

qm_news qm_job_read(qm_jobs *jobs, qm_job *job, uint64_t *seq, qm_framing framing, qm_text *out,
                    qm_reader *reader, void (*suspend)(void *user))
{
    uv_mutex_lock(&jobs->lock);
    qm_news news = QM_NEWS_SOME;
    double now = qm_now_ms();
    if (*seq < job->event_count) {
        for (; *seq < job->event_count; ++*seq)
            frame(out, framing, *seq + 1, job->events[*seq]);
        reader->wake_at_ms = now + HEARTBEAT_MS;
    } else if (has_ended(job)) {
        news = QM_NEWS_END;
    } else if (now >= reader->wake_at_ms) {
        if (framing == QM_FRAMING_NDJSON)
            qm_text_printf(out, "{\"event\":\"heartbeat\",\"seq\":%llu}\n", (unsigned long long)*seq);
        else
            qm_text_add_string(out, ": heartbeat\n\n");
        reader->wake_at_ms = now + HEARTBEAT_MS;
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
    bool is_over = has_ended(job) || qm_now_ms() >= reader->wake_at_ms;
    if (!is_over) go_to_sleep(reader, suspend);
    uv_mutex_unlock(&jobs->lock);
    return is_over;
}

void qm_job_join(qm_jobs *jobs, qm_job *job, qm_reader *reader)
{
    uv_mutex_lock(&jobs->lock);
    job->references++;
    reader->asleep = false;
    reader->next = job->readers;
    job->readers = reader;
    uv_mutex_unlock(&jobs->lock);
}

void qm_job_leave(qm_jobs *jobs, qm_job *job, qm_reader *reader)
{
    uv_mutex_lock(&jobs->lock);
    qm_reader **link = &job->readers;
    while (*link && *link != reader)
        link = &(*link)->next;
    if (*link) *link = reader->next;
    drop_reference(job);
    uv_mutex_unlock(&jobs->lock);
}

void qm_jobs_tick(qm_jobs *jobs, double now_ms)
{
    uv_mutex_lock(&jobs->lock);
    for (qm_job *job = jobs->first; job; job = job->next) {
        for (qm_reader *reader = job->readers; reader; reader = reader->next) {
            if (!reader->asleep || now_ms < reader->wake_at_ms) continue;
            reader->asleep = false;
            reader->wake(reader->user);
        }
    }
    uv_mutex_unlock(&jobs->lock);
}

/* ---- documents ---- */

/** Writes the resource; outcome is the members that only the end brings, or NULL. The caller holds the lock.
 */
static char *write_document(const qm_job *job, qm_job_state state, const char *outcome)
{
    qm_text out = {0};
    char now[QM_TIME_SIZE];
    qm_format_time(now);
    qm_text_printf(&out, "{\"id\":\"%s\",\"type\":\"hausdorff\",\"state\":\"%s\",\"created\":\"%s\"", job->id,
                   state_names[state], job->created);
    if (job->started[0]) qm_text_printf(&out, ",\"started\":\"%s\"", job->started);
    if (state > QM_JOB_RUNNING) qm_text_printf(&out, ",\"ended\":\"%s\"", now);
    qm_text_add_string(&out, ",\"request\":");
    qm_json_write_request(&out, &job->request);
    if (job->last_bounds) qm_text_printf(&out, ",\"progress\":{%s}", job->last_bounds);
    if (outcome) qm_text_printf(&out, ",%s", outcome);
    qm_text_add_string(&out, "}");
    return qm_text_take(&out);
}

char *qm_job_document_now(qm_jobs *jobs, qm_job *job, bool *ended)
{
    uv_mutex_lock(&jobs->lock);
    char *document = job->document ? strdup(job->document) : write_document(job, job->state, NULL);
    *ended = has_ended(job);
    uv_mutex_unlock(&jobs->lock);
    return document;
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

/* ---- the end of a job ---- */

/** Stores the outcome, then tells the readers. name and members make the terminal event. Only who runs it
 * ends a job. */
static void finish(qm_job *job, qm_job_state state, const char *name, const char *members)
{
    qm_jobs *jobs = job->jobs;
    qm_text outcome = {0};
    qm_text_printf(&outcome, "\"state\":\"%s\",%s", state_names[state], members);
    char *event = qm_text_take(&outcome);
    uv_mutex_lock(&jobs->lock);
    char *document = write_document(job, state, members);
    char *events = join_events(job, name, event);
    uv_mutex_unlock(&jobs->lock);
    if (!document || !events || qm_store_finish_job(jobs->store, job->id, state, document, events) != QM_OK)
        qm_log("error", "the end of job %s could not be stored", job->id);
    uv_mutex_lock(&jobs->lock);
    jobs->running--;
    job->state = state;
    job->document = document;
    add_event(job, name, event ? event : members);
    unlist(jobs, job);
    uv_mutex_unlock(&jobs->lock);
    free(events);
    free(event);
}

static void finish_with_problem(qm_job *job, qm_job_state state, const qm_problem *problem)
{
    qm_text members = {0};
    qm_text_add_string(&members, "\"problem\":");
    qm_json_write_problem(&members, problem);
    char *text = qm_text_take(&members);
    finish(job, state, "error", text ? text : "\"problem\":null");
    free(text);
}

static void finish_with_result(qm_job *job, qm_job_state state, const qm_job_result *result)
{
    qm_text members = {0};
    qm_text_add_string(&members, "\"result\":");
    qm_json_write_result(&members, &job->request, result);
    char *text = qm_text_take(&members);
    finish(job, state, "result", text ? text : "\"result\":null");
    free(text);
}

/** The daemon ends: readers are told, the store keeps the job as one that has not run. */
static void interrupt(qm_job *job)
{
    uv_mutex_lock(&job->jobs->lock);
    job->interrupted = true;
    add_event(job, "server_shutdown",
              "\"detail\":\"the daemon is stopping; the job runs again when it is back\"");
    wake_readers(job);
    uv_mutex_unlock(&job->jobs->lock);
}

/* ---- running ---- */

typedef struct progress_target {
    qm_job *job;
    double diagonal;
} progress_target;

/** The members of an object in place: its braces are cut off. */
static char *bare_members(char *object)
{
    object[strlen(object) - 1] = '\0';
    return object + 1;
}

static void on_progress(void *user, const qm_hausdorff_progress *progress)
{
    const progress_target *target = user;
    qm_text line = {0};
    qm_json_write_bounds(&line, progress, target->diagonal);
    char *text = qm_text_take(&line);
    if (!text) return;
    char *members = bare_members(text);
    uv_mutex_lock(&target->job->jobs->lock);
    free(target->job->last_bounds);
    target->job->last_bounds = strdup(members);
    add_event(target->job, "bounds", members);
    uv_mutex_unlock(&target->job->jobs->lock);
    free(text);
}

static bool is_drained(qm_job *job)
{
    uv_mutex_lock(&job->jobs->lock);
    bool is_so = job->is_drained;
    uv_mutex_unlock(&job->jobs->lock);
    return is_so;
}

static void measure(qm_job *job, const qm_loaded_mesh *a, const qm_loaded_mesh *b)
{
    qm_context ctx = qm_context_make();
    ctx.cancel = &job->cancel;
    ctx.parallel = qm_parallel_run;
    qm_job_request request = job->request;
    if (request.threads == 0) request.threads = job->jobs->limits.threads;
    progress_target target = {job, a->diagonal};
    qm_job_result result;
    qm_status status = qm_job_run_hausdorff(&ctx, &request, a, b, on_progress, &target, &result);
    bool canceled = status == QM_OK && result.hausdorff.stop == QM_STOP_CANCELED;
    if (canceled && is_drained(job)) {
        interrupt(job);
    } else if (status == QM_OK) {
        finish_with_result(job, canceled ? QM_JOB_CANCELLED : QM_JOB_SUCCEEDED, &result);
    } else {
        qm_problem problem = qm_problem_from_status(status, ctx.message);
        finish_with_problem(job, QM_JOB_FAILED, &problem);
    }
}

static void mark_running(qm_job *job)
{
    job->state = QM_JOB_RUNNING;
    job->jobs->queued--;
    job->jobs->running++;
}

/** Moves a queued job to running. False when it is not to run: cancelled meanwhile, or the daemon ends. */
static bool start(qm_job *job)
{
    qm_jobs *jobs = job->jobs;
    uv_mutex_lock(&jobs->lock);
    bool runs = job->state == QM_JOB_QUEUED && !jobs->closed;
    if (runs) {
        mark_running(job);
        qm_format_time(job->started);
    }
    bool stays = job->state == QM_JOB_QUEUED && jobs->closed;
    uv_mutex_unlock(&jobs->lock);
    if (stays) interrupt(job);
    return runs;
}

static void run_job(void *data)
{
    qm_job *job = data;
    qm_jobs *jobs = job->jobs;
    if (start(job)) {
        qm_problem problem;
        qm_mesh_ref *a = qm_meshes_acquire(jobs->meshes, job->request.a, &problem);
        qm_mesh_ref *b = a ? qm_meshes_acquire(jobs->meshes, job->request.b, &problem) : NULL;
        if (a && b)
            measure(job, qm_mesh_ref_get(a), qm_mesh_ref_get(b));
        else
            finish_with_problem(job, QM_JOB_FAILED, &problem);
        qm_meshes_release(jobs->meshes, a);
        qm_meshes_release(jobs->meshes, b);
    }
    qm_jobs_release(jobs, job);
}

/* ---- submitting ---- */

static char *make_key(const qm_job_request *request)
{
    qm_text key = {0};
    qm_text_printf(&key, "%s ", QM_VERSION);
    qm_json_write_request(&key, request);
    return qm_text_take(&key);
}

static qm_job *job_create(qm_jobs *jobs, const qm_job_request *request)
{
    qm_job *job = calloc(1, sizeof *job);
    if (!job) return NULL;
    job->jobs = jobs;
    job->request = *request;
    job->key = make_key(request);
    qm_make_id('j', job->id);
    qm_format_time(job->created);
    job->references = 1;
    return job;
}

/** Lists a job and hands it to the workers; the caller keeps its own reference. The lock is held. */
static bool enqueue(qm_jobs *jobs, qm_job *job)
{
    job->references += 2; /* the table's and the worker's */
    if (!qm_pool_submit(jobs->pool, run_job, job)) {
        job->references -= 2;
        return false;
    }
    job->listed = true;
    job->next = jobs->first;
    jobs->first = job;
    jobs->queued++;
    return true;
}

/** Splits stored NDJSON back into events. */
static void restore_events(qm_job *job, const char *lines)
{
    for (const char *line = lines, *end; line && (end = strchr(line, '\n')); line = end + 1) {
        char **events = realloc(job->events, (job->event_count + 1) * sizeof *events);
        if (!events) return;
        job->events = events;
        if (!(events[job->event_count] = strndup(line, (size_t)(end - line)))) return;
        job->event_count++;
    }
    job->event_capacity = job->event_count;
}

/** A job of the store that has ended, as one in memory that belongs to the caller alone. */
static qm_job *job_from_row(qm_jobs *jobs, const qm_store_job *row)
{
    qm_job *job = calloc(1, sizeof *job);
    if (!job) return NULL;
    job->jobs = jobs;
    memcpy(job->id, row->id, sizeof job->id);
    job->state = (qm_job_state)row->state;
    job->document = row->document ? strdup(row->document) : NULL;
    job->references = 1;
    restore_events(job, row->events);
    return job;
}

static qm_job *find_listed(qm_jobs *jobs, const char *id)
{
    for (qm_job *job = jobs->first; job; job = job->next)
        if (strcmp(job->id, id) == 0) return job;
    return NULL;
}

qm_job *qm_jobs_find(qm_jobs *jobs, const char *id)
{
    uv_mutex_lock(&jobs->lock);
    qm_job *job = find_listed(jobs, id);
    if (job) job->references++;
    uv_mutex_unlock(&jobs->lock);
    qm_store_job row;
    if (job || !qm_store_find_job(jobs->store, id, &row)) return job;
    job = job_from_row(jobs, &row);
    qm_store_job_reset(&row);
    return job;
}

static qm_job *find_by_idempotency_key(qm_jobs *jobs, const char *key, const char *request_key,
                                       qm_problem *problem)
{
    qm_store_job row;
    if (!qm_store_find_job_by_idempotency_key(jobs->store, key, &row)) return NULL;
    qm_job *job = NULL;
    if (strcmp(row.key, request_key) == 0)
        job = qm_jobs_find(jobs, row.id);
    else
        *problem = qm_problem_make(QM_PROBLEM_IDEMPOTENCY_MISMATCH,
                                   "this Idempotency-Key came with another request");
    qm_store_job_reset(&row);
    return job;
}

static qm_job *find_cached(qm_jobs *jobs, const char *key)
{
    qm_store_job row;
    if (!qm_store_find_job_by_key(jobs->store, key, QM_JOB_SUCCEEDED, &row)) return NULL;
    qm_job *job = job_from_row(jobs, &row);
    qm_store_job_reset(&row);
    return job;
}

static bool check_mesh(qm_jobs *jobs, const char *id, const char *pointer, qm_problem *problem)
{
    qm_store_mesh row;
    if (qm_store_find_mesh(jobs->store, id, &row)) {
        qm_store_mesh_reset(&row);
        return true;
    }
    *problem =
        qm_problem_make(QM_PROBLEM_MESH_NOT_FOUND, "there is no mesh of the id given in %s", pointer + 1);
    qm_problem_add_pointer(problem, pointer, "no such mesh");
    return false;
}

static bool has_room(qm_jobs *jobs, qm_problem *problem)
{
    uv_mutex_lock(&jobs->lock);
    bool closed = jobs->closed, full = jobs->queued >= (size_t)jobs->limits.queue;
    uv_mutex_unlock(&jobs->lock);
    if (closed)
        *problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the daemon is stopping and takes no new jobs");
    if (full)
        *problem = qm_problem_make(QM_PROBLEM_TOO_MANY_JOBS, "%d jobs wait already", jobs->limits.queue);
    if (closed || full) problem->retry_after_s = closed ? 5 : 1;
    return !closed && !full;
}

/** Stores a new job, then queues it: what is answered with 202 survives the daemon. */
static bool store_and_enqueue(qm_jobs *jobs, qm_job *job, const qm_job_submission *submission)
{
    qm_store_job row = {.key = job->key,
                        .idempotency_key = (char *)submission->idempotency_key,
                        .body = (char *)submission->body,
                        .state = QM_JOB_QUEUED};
    memcpy(row.id, job->id, sizeof row.id);
    if (!job->key || qm_store_submit_job(jobs->store, &row) != QM_OK) return false;
    uv_mutex_lock(&jobs->lock);
    bool queued = enqueue(jobs, job);
    uv_mutex_unlock(&jobs->lock);
    if (!queued) qm_store_delete_job(jobs->store, job->id);
    return queued;
}

/** The job that answers a request already. NULL with a problem when the request cannot be answered at all. */
static qm_job *find_answer(qm_jobs *jobs, const qm_job_submission *submission, const char *key,
                           bool *is_cached, qm_problem *problem)
{
    if (submission->idempotency_key) {
        qm_job *same = find_by_idempotency_key(jobs, submission->idempotency_key, key, problem);
        if (same || problem->code != QM_PROBLEM_COUNT) return same;
    }
    if (!check_mesh(jobs, submission->request->a, "/a", problem) ||
        !check_mesh(jobs, submission->request->b, "/b", problem))
        return NULL;
    qm_job *cached = submission->use_cache ? find_cached(jobs, key) : NULL;
    *is_cached = cached != NULL;
    return cached;
}

qm_job *qm_jobs_submit(qm_jobs *jobs, const qm_job_submission *submission, bool *is_cached,
                       qm_problem *problem)
{
    *is_cached = false;
    *problem = (qm_problem){.code = QM_PROBLEM_COUNT};
    if (!has_room(jobs, problem)) return NULL;
    qm_job *job = job_create(jobs, submission->request);
    if (!job || !job->key) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "there is no memory for the job");
        qm_jobs_release(jobs, job);
        return NULL;
    }
    qm_job *answer = find_answer(jobs, submission, job->key, is_cached, problem);
    if (!answer && problem->code == QM_PROBLEM_COUNT) {
        if (store_and_enqueue(jobs, job, submission)) return job;
        *problem = qm_problem_make(QM_PROBLEM_INTERNAL, "the job could not be stored");
    }
    qm_jobs_release(jobs, job);
    return answer;
}

bool qm_jobs_cancel(qm_jobs *jobs, qm_job *job)
{
    uv_mutex_lock(&jobs->lock);
    bool ended = has_ended(job), queued = job->state == QM_JOB_QUEUED;
    atomic_store(&job->cancel, true);
    if (queued) mark_running(job); /* so that no worker takes it */
    uv_mutex_unlock(&jobs->lock);
    if (ended) return false;
    if (queued) {
        qm_problem problem = qm_problem_make(QM_PROBLEM_CONFLICT, "the job was cancelled before it ran");
        finish_with_problem(job, QM_JOB_CANCELLED, &problem);
    }
    return true;
}

bool qm_jobs_list(qm_jobs *jobs, int64_t after, size_t limit, qm_text *out, int64_t *next)
{
    qm_store_job *rows = calloc(limit + 1, sizeof *rows);
    if (!rows) return false;
    size_t count = qm_store_list_jobs(jobs->store, after, limit + 1, rows);
    *next = 0;
    for (size_t i = 0; i < count; i++) {
        qm_job *job = i < limit ? qm_jobs_find(jobs, rows[i].id) : NULL;
        char *document = job ? qm_job_document(jobs, job, false) : NULL;
        if (document) qm_text_printf(out, "%s%s", i > 0 ? "," : "", document);
        free(document);
        qm_jobs_release(jobs, job);
        if (i + 1 == limit && count > limit) *next = rows[i].sequence;
        qm_store_job_reset(&rows[i]);
    }
    free(rows);
    return true;
}

qm_job_counts qm_jobs_count(qm_jobs *jobs)
{
    uv_mutex_lock(&jobs->lock);
    qm_job_counts counts = {jobs->queued, jobs->running};
    uv_mutex_unlock(&jobs->lock);
    return counts;
}

/* ---- start and stop ---- */

/** A row that was queued or running when the daemon last ended. */
static void resume_row(qm_jobs *jobs, const qm_store_job *row)
{
    qm_job_request request;
    qm_problem problem;
    if (!qm_json_read_job(row->body, strlen(row->body), &request, &problem)) {
        qm_log("error", "job %s cannot be read back", row->id);
        return;
    }
    qm_job *job = job_create(jobs, &request);
    if (!job) return;
    memcpy(job->id, row->id, sizeof job->id);
    uv_mutex_lock(&jobs->lock);
    enqueue(jobs, job);
    drop_reference(job);
    uv_mutex_unlock(&jobs->lock);
}

static void resume_unfinished(qm_jobs *jobs)
{
    size_t limit = (size_t)jobs->limits.queue;
    qm_store_job *rows = calloc(limit, sizeof *rows);
    if (!rows) return;
    size_t count = qm_store_list_unfinished_jobs(jobs->store, limit, rows);
    for (size_t i = 0; i < count; i++) {
        resume_row(jobs, &rows[i]);
        qm_store_job_reset(&rows[i]);
    }
    if (count > 0) qm_log("info", "%zu unfinished jobs queued again", count);
    free(rows);
}

qm_jobs *qm_jobs_create(qm_store *store, qm_meshes *meshes, qm_job_limits limits)
{
    qm_jobs *jobs = calloc(1, sizeof *jobs);
    if (!jobs) return NULL;
    jobs->store = store;
    jobs->meshes = meshes;
    jobs->limits = limits;
    uv_mutex_init(&jobs->lock);
    jobs->pool = qm_pool_create(limits.workers);
    if (!jobs->pool) {
        qm_jobs_destroy(jobs);
        return NULL;
    }
    resume_unfinished(jobs);
    return jobs;
}

void qm_jobs_close(qm_jobs *jobs)
{
    uv_mutex_lock(&jobs->lock);
    atomic_store(&jobs->closed, true);
    uv_mutex_unlock(&jobs->lock);
}

void qm_jobs_drain(qm_jobs *jobs)
{
    qm_jobs_close(jobs);
    double end = qm_now_ms() + jobs->limits.grace_ms;
    while (qm_jobs_count(jobs).running > 0 && qm_now_ms() < end)
        uv_sleep(10);
    uv_mutex_lock(&jobs->lock);
    for (qm_job *job = jobs->first; job; job = job->next)
        job->is_drained = !atomic_exchange(&job->cancel, true);
    uv_mutex_unlock(&jobs->lock);
    qm_pool_destroy(jobs->pool);
    jobs->pool = NULL;
}

void qm_jobs_destroy(qm_jobs *jobs)
{
    if (!jobs) return;
    if (jobs->pool) qm_jobs_drain(jobs);
    while (jobs->first)
        unlist(jobs, jobs->first);
    uv_mutex_destroy(&jobs->lock);
    free(jobs);
}
