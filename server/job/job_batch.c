#include "job_batch.h"

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
 * The lock of the jobs guards all from reader on. One task at a time feeds lines, and what stands above is
 * its own.
 */
struct qm_batch {
    qm_jobs *jobs;
    qm_pool *pool;
    qm_blob_writer *upload;
    uint64_t offset; /* of what was not read yet */
    char *piece;     /* PIECE_SIZE bytes, of which those from piece_at on are to be looked at */
    size_t piece_at, piece_size;
    qm_text line;
    uint64_t line_number;
    bool line_is_too_long;

    qm_reader *reader;
    qm_text answers;
    size_t running;
    bool is_feeding, at_end, is_closed, is_cut;
    int references; /* the reader's, the feeding task's, and one for each job */
};

/* ---- life ---- */

/** The caller holds the lock. */
static void drop_reference(qm_batch *batch)
{
    if (--batch->references > 0) return;
    qm_blob_abort(batch->upload);
    free(batch->piece);
    qm_text_reset(&batch->line);
    qm_text_reset(&batch->answers);
    free(batch);
}

static void wake_reader(qm_batch *batch)
{
    qm_reader *reader = batch->reader;
    if (reader) qm_reader_wake(batch->jobs, reader);
}

static void feed(void *data);

/** For another line and its answer. The caller holds the lock. */
static bool has_room(const qm_batch *batch)
{
    return batch->running < (size_t)batch->jobs->limits.workers * LINES_A_WORKER &&
           batch->answers.size < MAX_PENDING;
}

/** No answer will come any more. The caller holds the lock. */
static bool is_over(const qm_batch *batch)
{
    return (batch->at_end || batch->is_cut) && !batch->is_feeding && batch->running == 0;
}

/** Has more lines read when there is room for them. The caller holds the lock. */
static void ask_for_lines(qm_batch *batch)
{
    if (!has_room(batch) || batch->is_feeding || batch->at_end || batch->is_closed || batch->is_cut) return;
    batch->is_feeding = true;
    batch->references++;
    if (qm_pool_submit(batch->pool, feed, batch)) return;
    batch->is_feeding = false;
    batch->is_cut = true;
    batch->references--;
}

qm_batch *qm_batch_create(qm_jobs *jobs, qm_pool *pool, qm_blob_writer *upload, qm_reader *reader)
{
    qm_batch *batch = calloc(1, sizeof *batch);
    char *piece = malloc(PIECE_SIZE);
    if (!batch || !piece) {
        qm_blob_abort(upload);
        free(piece);
        free(batch);
        return NULL;
    }
    *batch = (qm_batch){
        .jobs = jobs, .pool = pool, .upload = upload, .piece = piece, .reader = reader, .references = 1};
    uv_mutex_lock(&jobs->lock);
    qm_readers_add(&jobs->readers, reader);
    uv_mutex_unlock(&jobs->lock);
    return batch;
}

/* ---- answers ---- */

/** members comes without braces. The caller holds the lock. */
static void add_answer(qm_batch *batch, const qm_batch_line *line, const char *state, const char *members)
{
    qm_text_printf(&batch->answers, "{\"key\":%s,\"line\":%llu,\"state\":\"%s\",%s}\n", line->key,
                   (unsigned long long)line->number, state, members);
    wake_reader(batch);
}

void qm_batch_line_reset(qm_batch_line *line)
{
    free(line->key);
    *line = (qm_batch_line){0};
}

void qm_batch_end_line(qm_job *job, qm_job_state state, const char *members)
{
    qm_jobs *jobs = job->jobs;
    qm_batch *batch = job->line.batch;
    uv_mutex_lock(&jobs->lock);
    jobs->running--;
    job->state = state;
    add_answer(batch, &job->line, qm_job_state_name(state), members);
    batch->running--;
    ask_for_lines(batch);
    if (is_over(batch)) wake_reader(batch);
    drop_reference(batch);
    qm_job_unlist(job);
    uv_mutex_unlock(&jobs->lock);
}

/** Memory is out: the reader hears of it by the end that it misses. */
static void give_up(qm_batch *batch)
{
    uv_mutex_lock(&batch->jobs->lock);
    batch->is_cut = true;
    uv_mutex_unlock(&batch->jobs->lock);
}

static void answer(qm_batch *batch, const qm_batch_line *line, const char *state, qm_text *members)
{
    char *text = qm_text_take(members);
    if (!text) {
        give_up(batch);
        return;
    }
    uv_mutex_lock(&batch->jobs->lock);
    add_answer(batch, line, state, text);
    uv_mutex_unlock(&batch->jobs->lock);
    free(text);
}

static void answer_with_problem(qm_batch *batch, const qm_batch_line *line, const qm_problem *problem)
{
    qm_text members = {0};
    qm_text_add_string(&members, "\"problem\":");
    qm_json_write_problem(&members, problem);
    answer(batch, line, "failed", &members);
}

/** Answers from a finished job; false when there is none. */
static bool answer_from_store(qm_batch *batch, const qm_batch_line *line, const char *key,
                              const char *revisions)
{
    qm_job *job = qm_job_find_cached(batch->jobs, key, revisions);
    char *result = job ? qm_job_result_object(batch->jobs, job) : NULL;
    qm_text members = {0};
    if (result) {
        qm_text_add_string(&members, "\"cached\":true,\"result\":");
        qm_text_add_string(&members, result);
        answer(batch, line, "succeeded", &members);
    }
    qm_metrics_add(QM_METRICS_CACHED_ANSWERS, result != NULL);
    free(result);
    qm_jobs_release(batch->jobs, job);
    return result != NULL;
}

/* ---- lines ---- */

/** Puts a line among the jobs; takes over its key and the request. */
static bool queue_line(qm_batch *batch, qm_batch_line *line, qm_job_request *request)
{
    qm_jobs *jobs = batch->jobs;
    qm_job *job = qm_job_create(jobs, request);
    if (!job) return false;
    job->line = *line;
    uv_mutex_lock(&jobs->lock);
    batch->running++;
    batch->references++;
    uv_mutex_unlock(&jobs->lock);
    qm_job_enlist(jobs, job);
    bool queued = qm_job_enqueue(jobs, job);
    if (!queued) {
        job->line = (qm_batch_line){0};
        qm_job_withdraw(jobs, job);
        uv_mutex_lock(&jobs->lock);
        batch->running--;
        drop_reference(batch);
        uv_mutex_unlock(&jobs->lock);
    } else {
        *line = (qm_batch_line){0};
    }
    qm_jobs_release(jobs, job);
    return queued;
}

/** Answers a request or puts it among the jobs; false with a problem. */
static bool take_request(qm_batch *batch, qm_batch_line *line, qm_job_request *request, qm_problem *problem)
{
    char *key = qm_job_make_key(request), revisions[QM_REVISIONS_SIZE];
    *problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the job could not be queued");
    bool is_pure = qm_job_type_of(request->kind)->is_pure;
    bool taken =
        key && qm_job_check_meshes(batch->jobs, request, revisions, problem) &&
        ((is_pure && answer_from_store(batch, line, key, revisions)) || queue_line(batch, line, request));
    free(key);
    return taken;
}

static void take_line(qm_batch *batch)
{
    qm_text key = {0};
    qm_job_request request = qm_job_request_default();
    qm_problem problem;
    qm_batch_line line = {.batch = batch, .number = batch->line_number};
    bool taken = false;
    qm_metrics_add(QM_METRICS_BATCH_LINES, 1);
    if (batch->line_is_too_long) {
        problem = qm_problem_make(QM_PROBLEM_TOO_LARGE, "a line may have %u bytes", MAX_LINE);
        qm_text_add_string(&key, "null");
        line.key = qm_text_take(&key);
    } else {
        bool readable = qm_json_read_batch_line(batch->line.data, batch->line.size, &key, &request, &problem);
        line.key = qm_text_take(&key);
        taken = readable && line.key && take_request(batch, &line, &request, &problem);
    }
    if (!taken && line.key)
        answer_with_problem(batch, &line, &problem);
    else if (!taken)
        give_up(batch);
    qm_batch_line_reset(&line);
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

static void keep_part(qm_batch *batch, const char *part, size_t size)
{
    if (batch->line.size + size > MAX_LINE) batch->line_is_too_long = true;
    if (!batch->line_is_too_long) qm_text_add(&batch->line, part, size);
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
        const char *part = batch->piece + batch->piece_at;
        size_t rest = batch->piece_size - batch->piece_at;
        const char *end = memchr(part, '\n', rest);
        size_t size = end ? (size_t)(end - part) : rest;
        keep_part(batch, part, size);
        batch->piece_at += end ? size + 1 : size;
        if (end) return true;
    }
}

static bool is_blank(const qm_text *line)
{
    return line->size == 0 || strspn(line->data, " \t\r") == line->size;
}

/** Looks whether another line is to be read. */
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
        if (!at_end && (batch->line_is_too_long || !is_blank(&batch->line))) take_line(batch);
    }
    qm_jobs *jobs = batch->jobs;
    uv_mutex_lock(&jobs->lock);
    batch->is_feeding = false;
    batch->at_end |= at_end;
    batch->is_cut |= batch->line.failed;
    ask_for_lines(batch);
    if (is_over(batch)) wake_reader(batch);
    drop_reference(batch);
    uv_mutex_unlock(&jobs->lock);
}

/* ---- the reader ---- */

static void take_answers(qm_batch *batch, qm_text *out)
{
    qm_text_add(out, batch->answers.data, batch->answers.size);
    batch->answers.size = 0;
    if (batch->answers.capacity > 4 * MAX_PENDING) qm_text_reset(&batch->answers);
}

qm_news qm_batch_read(qm_batch *batch, qm_text *out, void (*suspend)(void *user))
{
    qm_jobs *jobs = batch->jobs;
    qm_reader *reader = batch->reader;
    qm_news news = QM_NEWS_SOME;
    uv_mutex_lock(&jobs->lock);
    double now = qm_now_ms();
    batch->is_cut |= batch->answers.failed;
    if (batch->answers.size > 0 && !batch->answers.failed) {
        take_answers(batch, out);
        reader->wake_at_ms = now + jobs->limits.heartbeat_ms;
        ask_for_lines(batch);
    } else if (ask_for_lines(batch), is_over(batch)) {
        news = QM_NEWS_END;
    } else if (now >= reader->wake_at_ms) {
        qm_text_add_string(out, "{\"event\":\"heartbeat\"}\n");
        reader->wake_at_ms = now + jobs->limits.heartbeat_ms;
    } else {
        news = QM_NEWS_NONE;
        reader->asleep = true;
        suspend(reader->user);
    }
    uv_mutex_unlock(&jobs->lock);
    return news;
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
    qm_readers_remove(&jobs->readers, batch->reader);
    batch->reader = NULL;
    batch->is_closed = true;
    for (qm_job *job = jobs->first; job; job = job->next) {
        if (job->line.batch != batch) continue;
        job->is_canceled = true;
        atomic_store(&job->cancel, true);
    }
    drop_reference(batch);
    uv_mutex_unlock(&jobs->lock);
}
