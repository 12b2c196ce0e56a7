/**
 * job_batch.c: a batch: a task on the pool reads lines and queues jobs, the end of each job adds an answer.
 */
#include "job_batch.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/metrics.h"
#include "job_internal.h"
#include "json_in.h"
#include "ops/json_out.h"

#define LINES_A_WORKER 4         /* jobs at a time for each worker */
#define MAX_LINE (1u << 20)      /* bytes */
#define MAX_PENDING (256u << 10) /* bytes of answers after which no more lines are read */
#define PIECE_SIZE (64u << 10)   /* bytes that are read at a time */
#define LINES_A_TURN 256         /* lines after which the pool gets a chance to do other things */

/**
 * The lock of the jobs guards the members from subscriber on. One task at a time feeds lines; the members
 * above belong to it.
 */
struct qm_batch {
    qm_jobs *jobs;
    qm_pool *pool;
    qm_blob_writer *upload;
    uint64_t offset; /* of the next byte to read */
    char *piece;     /* PIECE_SIZE bytes; those before piece_at are done */
    size_t piece_at, piece_size;
    qm_text line;
    uint64_t line_number;
    bool line_is_too_long;
    char client[QM_CLIENT_SIZE];

    qm_subscriber *subscriber;
    qm_text answers;
    size_t running;
    bool is_feeding, at_end, is_closed, is_cut;
    int references; /* the subscriber's, the feeding task's, and one for each job */
};

/* ---- life ---- */

/** The caller holds the lock. */
static void drop_reference(qm_batch *batch)
{
    QM_ASSERT(qm_jobs_is_locked(batch->jobs) && batch->references > 0);
    if (--batch->references > 0) return;
    qm_blob_abort(batch->upload);
    free(batch->piece);
    qm_text_reset(&batch->line);
    qm_text_reset(&batch->answers);
    free(batch);
}

static void notify_subscriber(qm_batch *batch)
{
    qm_subscriber *subscriber = batch->subscriber;
    if (subscriber) qm_job_events_notify(batch->jobs, subscriber);
}

static void feed(void *data);

/** True when another line and its answer fit. The caller holds the lock. */
static bool has_room(const qm_batch *batch)
{
    return batch->running < (size_t)batch->jobs->limits.workers * LINES_A_WORKER &&
           batch->answers.size < MAX_PENDING;
}

/** True when no answer will follow. The caller holds the lock. */
static bool is_over(const qm_batch *batch)
{
    QM_ASSERT(qm_jobs_is_locked(batch->jobs));
    return (batch->at_end || batch->is_cut) && !batch->is_feeding && batch->running == 0;
}

/** Queues a task that reads lines when there is room for them. The caller holds the lock. */
static void ask_for_lines(qm_batch *batch)
{
    QM_ASSERT(qm_jobs_is_locked(batch->jobs));
    if (!has_room(batch) || batch->is_feeding || batch->at_end || batch->is_closed || batch->is_cut) return;
    batch->is_feeding = true;
    batch->references++;
    if (qm_pool_submit(batch->pool, batch->client, feed, batch)) return;
    batch->is_feeding = false;
    batch->is_cut = true;
    batch->references--;
}

qm_batch *qm_batch_create(qm_jobs *jobs, qm_pool *pool, qm_blob_writer *upload, const char *client,
                          qm_subscriber *subscriber)
{
    qm_batch *batch = calloc(1, sizeof *batch);
    char *piece = malloc(PIECE_SIZE);
    if (!batch || !piece) {
        qm_blob_abort(upload);
        free(piece);
        free(batch);
        return NULL;
    }
    *batch = (qm_batch){.jobs = jobs,
                        .pool = pool,
                        .upload = upload,
                        .piece = piece,
                        .subscriber = subscriber,
                        .references = 1};
    snprintf(batch->client, sizeof batch->client, "%s", client);
    uv_mutex_lock(&jobs->lock);
    qm_job_subscribers_add(&jobs->subscribers, subscriber);
    uv_mutex_unlock(&jobs->lock);
    return batch;
}

/* ---- answers ---- */

/** A line of the batch that is answered, at once or by a job. */
typedef struct batch_line {
    qm_batch *batch;
    uint64_t number; /* from 1 */
    char *key;       /* JSON */
} batch_line;

/** Adds the answer of a line. The caller holds the lock. */
static void add_answer(const batch_line *line, const qm_job_outcome *outcome, bool is_cached)
{
    qm_batch *batch = line->batch;
    QM_ASSERT(qm_jobs_is_locked(batch->jobs) && outcome->state > QM_JOB_RUNNING);
    qm_text_printf(&batch->answers, "{\"key\":%s,\"line\":%llu,\"state\":\"%s\",%s\"%s\":", line->key,
                   (unsigned long long)line->number, qm_job_state_name(outcome->state),
                   is_cached ? "\"cached\":true," : "", outcome->member);
    qm_text_add_string(&batch->answers, outcome->object);
    qm_text_add_string(&batch->answers, "}\n");
    notify_subscriber(batch);
}

/** Answers a line whose job has ended, and frees it (qm_job_end_fn). */
static void end_line(void *user, const qm_job_outcome *outcome)
{
    batch_line *line = user;
    qm_batch *batch = line->batch;
    QM_ASSERT(batch->running > 0);
    add_answer(line, outcome, false);
    batch->running--;
    ask_for_lines(batch);
    if (is_over(batch)) notify_subscriber(batch);
    drop_reference(batch);
    free(line->key);
    free(line);
}

/** Out of memory: the connection is cut, so that the client misses the end. */
static void give_up(qm_batch *batch)
{
    uv_mutex_lock(&batch->jobs->lock);
    batch->is_cut = true;
    uv_mutex_unlock(&batch->jobs->lock);
}

/** Answers a line without a job: from the store, or with a problem. Frees the object, which is NULL when
 * memory ran out. */
static void answer(const batch_line *line, qm_job_state state, const char *member, char *object)
{
    if (object) {
        uv_mutex_lock(&line->batch->jobs->lock);
        add_answer(line, &(qm_job_outcome){state, member, object}, state == QM_JOB_SUCCEEDED);
        uv_mutex_unlock(&line->batch->jobs->lock);
    } else {
        give_up(line->batch);
    }
    free(object);
}

/** Answers from a finished job; false when there is none. */
static bool answer_from_store(const batch_line *line, const char *key, const char *revisions)
{
    qm_jobs *jobs = line->batch->jobs;
    qm_job *job = qm_job_find_cached(jobs, key, revisions, NULL);
    char *result = job ? qm_job_result_object(jobs, job) : NULL;
    qm_metrics_add(QM_METRICS_CACHED_ANSWERS, result != NULL);
    if (result) answer(line, QM_JOB_SUCCEEDED, "result", result);
    qm_jobs_release(jobs, job);
    return result != NULL;
}

/* ---- lines ---- */

/** Queues a job for a line; it takes over the line's key and the request. */
static bool queue_line(batch_line *line, qm_job_request *request)
{
    qm_batch *batch = line->batch;
    qm_jobs *jobs = batch->jobs;
    batch_line *owned = malloc(sizeof *owned);
    qm_job *job = owned ? qm_job_create(jobs, request, batch->client) : NULL;
    if (!job) {
        free(owned);
        return false;
    }
    *owned = *line;
    job->on_end = end_line;
    job->end_user = owned;
    uv_mutex_lock(&jobs->lock);
    batch->running++;
    batch->references++;
    uv_mutex_unlock(&jobs->lock);
    qm_job_enlist(jobs, job);
    bool queued = qm_job_enqueue(jobs, job);
    if (queued) {
        line->key = NULL;
    } else {
        qm_job_withdraw(jobs, job);
        uv_mutex_lock(&jobs->lock);
        batch->running--;
        drop_reference(batch);
        uv_mutex_unlock(&jobs->lock);
        free(owned);
    }
    qm_jobs_release(jobs, job);
    return queued;
}

/** Answers a request from the store or queues it; false with a problem. */
static bool take_request(batch_line *line, qm_job_request *request, qm_problem *problem)
{
    char revisions[QM_REVISIONS_SIZE];
    if (!qm_job_resolve(line->batch->jobs, request, problem)) return false;
    char *key = qm_job_make_key(request);
    *problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the job could not be queued");
    bool is_pure = qm_job_type_of(request->kind)->is_pure;
    bool taken = key &&
                 qm_job_runner_of(request->kind)->check(line->batch->jobs, request, revisions, problem) &&
                 ((is_pure && answer_from_store(line, key, revisions)) || queue_line(line, request));
    free(key);
    return taken;
}

static void take_line(qm_batch *batch)
{
    qm_text key = {0};
    qm_job_request request = qm_job_request_default();
    qm_problem problem;
    batch_line line = {.batch = batch, .number = batch->line_number};
    bool taken = false;
    qm_metrics_add(QM_METRICS_BATCH_LINES, 1);
    if (batch->line_is_too_long) {
        problem = qm_problem_make(QM_PROBLEM_TOO_LARGE, "a line must not exceed %u bytes", MAX_LINE);
        qm_text_add_string(&key, "null");
        line.key = qm_text_take(&key);
    } else {
        bool readable = qm_json_read_batch_line(batch->line.data, batch->line.size, &key, &request, &problem);
        line.key = qm_text_take(&key);
        taken = readable && line.key && take_request(&line, &request, &problem);
    }
    if (!taken && line.key) {
        qm_text object = {0};
        qm_json_write_problem(&object, &problem);
        answer(&line, QM_JOB_FAILED, "problem", qm_text_take(&object));
    } else if (!taken) {
        give_up(batch);
    }
    free(line.key);
    qm_job_request_reset(&request);
}

/** Reads the next piece of the upload; false at its end, and when it cannot be read. */
static bool read_piece(qm_batch *batch)
{
    uint64_t rest = qm_blob_size(batch->upload) - batch->offset;
    batch->piece_at = 0;
    batch->piece_size = rest < PIECE_SIZE ? (size_t)rest : PIECE_SIZE;
    if (rest == 0) return false;
    if (qm_blob_read(batch->upload, batch->offset, batch->piece, batch->piece_size) != QM_OK) {
        batch->line.failed = true;
        return false;
    }
    batch->offset += batch->piece_size;
    return true;
}

/** Reads the next line into batch->line; false when there is none. */
static bool read_line(qm_batch *batch)
{
    batch->line.size = 0;
    batch->line_is_too_long = false;
    batch->line_number++;
    for (;;) {
        if (batch->piece_at == batch->piece_size && !read_piece(batch))
            return !batch->line.failed && (batch->line.size > 0 || batch->line_is_too_long);
        QM_ASSERT(batch->piece_at < batch->piece_size && batch->piece_size <= PIECE_SIZE);
        const char *part = batch->piece + batch->piece_at;
        size_t rest = batch->piece_size - batch->piece_at;
        const char *end = memchr(part, '\n', rest);
        size_t size = end ? (size_t)(end - part) : rest;
        if (batch->line.size + size > MAX_LINE) batch->line_is_too_long = true;
        if (!batch->line_is_too_long) qm_text_add(&batch->line, part, size);
        batch->piece_at += end ? size + 1 : size;
        if (end) return true;
    }
}

/** True when another line is to be read. */
static bool wants_line(qm_batch *batch)
{
    uv_mutex_lock(&batch->jobs->lock);
    if (atomic_load(&batch->jobs->closed)) batch->is_cut = true;
    bool wants = !batch->is_closed && !batch->is_cut && !batch->at_end && has_room(batch);
    uv_mutex_unlock(&batch->jobs->lock);
    return wants;
}

static void feed(void *data)
{
    qm_batch *batch = data;
    bool at_end = false;
    for (int lines = 0; lines < LINES_A_TURN && !at_end && wants_line(batch); lines++) {
        at_end = !read_line(batch);
        bool is_blank = batch->line.size == 0 || strspn(batch->line.data, " \t\r") == batch->line.size;
        if (!at_end && (batch->line_is_too_long || !is_blank)) take_line(batch);
    }
    qm_jobs *jobs = batch->jobs;
    uv_mutex_lock(&jobs->lock);
    batch->is_feeding = false;
    batch->at_end |= at_end;
    batch->is_cut |= batch->line.failed;
    ask_for_lines(batch);
    if (is_over(batch)) notify_subscriber(batch);
    drop_reference(batch);
    uv_mutex_unlock(&jobs->lock);
}

/* ---- the subscriber ---- */

qm_read_status qm_batch_read(qm_batch *batch, qm_text *out, void (*suspend)(void *user))
{
    qm_jobs *jobs = batch->jobs;
    qm_subscriber *subscriber = batch->subscriber;
    qm_read_status status = QM_READ_SOME;
    uv_mutex_lock(&jobs->lock);
    double now = qm_clock_now_ms();
    batch->is_cut |= batch->answers.failed;
    if (batch->answers.size > 0 && !batch->answers.failed) {
        qm_text_add(out, batch->answers.data, batch->answers.size);
        batch->answers.size = 0;
        if (batch->answers.capacity > 4 * MAX_PENDING) qm_text_reset(&batch->answers);
        subscriber->wake_at_ms = now + jobs->limits.heartbeat_ms;
        ask_for_lines(batch);
    } else if (ask_for_lines(batch), is_over(batch)) {
        status = QM_READ_END;
    } else if (now >= subscriber->wake_at_ms) {
        qm_text_add_string(out, "{\"event\":\"heartbeat\"}\n");
        subscriber->wake_at_ms = now + jobs->limits.heartbeat_ms;
    } else {
        status = QM_READ_NONE;
        qm_job_wait(jobs, subscriber, suspend);
    }
    uv_mutex_unlock(&jobs->lock);
    return status;
}

bool qm_batch_is_cut(qm_batch *batch)
{
    uv_mutex_lock(&batch->jobs->lock);
    bool is_cut = batch->is_cut;
    uv_mutex_unlock(&batch->jobs->lock);
    return is_cut;
}

void qm_batch_close(qm_batch *batch)
{
    qm_jobs *jobs = batch->jobs;
    uv_mutex_lock(&jobs->lock);
    qm_job_subscribers_remove(&jobs->subscribers, batch->subscriber);
    batch->subscriber = NULL;
    batch->is_closed = true;
    for (qm_job *job = jobs->first; job; job = job->next) {
        if (job->on_end != end_line || ((const batch_line *)job->end_user)->batch != batch) continue;
        job->is_canceled = true;
        qm_job_stop(job);
    }
    drop_reference(batch);
    uv_mutex_unlock(&jobs->lock);
}
