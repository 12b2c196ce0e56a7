/**
 * http_reply_stream.c: replies that are sent while they are made: those that wait for jobs (the stream of one's events or
 * of a batch's answers, or the document or answer of a job once it has ended), and long ones that are made a block at a time.
 *
 * Waiting: a connection with nothing to send is suspended under the lock of the jobs (job.h), and its subscriber is
 * marked as no longer waiting under the lock before the connection is resumed: no wake-up is lost, and no connection is
 * resumed that is not suspended.
 *
 * Blocks: the first block is made by the handler's thread; often it is all there is. For the others the connection is
 * suspended while they are made on the pool of their lane, and then resumed. The next block is made when the last one
 * was sent: a slow client costs one block of memory, and a closed connection is noticed at the next write. While a block
 * is made no other thread touches the reply, as the library ends no suspended connection.
 */
#include <stdlib.h>
#include <string.h>

#include "base/json.h"
#include "base/log.h"
#include "http_internal.h"
#include "job/job_batch.h"
#include "job/job_once.h"

#define BLOCK_SIZE 16384
#define PIECE_SIZE 65536 /* bytes that the library asks for at a time */

/* ---- slots: every reply that is sent while it is made takes one of --streams ---- */

static bool take_slot(qm_app *app)
{
    if (atomic_fetch_add(&app->stream_count, 1) < (int)app->config->streams) return true;
    atomic_fetch_sub(&app->stream_count, 1);
    return false;
}

static void return_slot(qm_app *app)
{
    QM_ASSERT(atomic_load(&app->stream_count) > 0);
    atomic_fetch_sub(&app->stream_count, 1);
}

static void refuse_slot(qm_request *request)
{
    qm_problem problem =
        qm_problem_make(QM_PROBLEM_UNAVAILABLE, "all %.0f streams are in use", request->app->config->streams);
    problem.retry_after_s = 1;
    qm_reply_problem(request, &problem);
}

static void refuse_memory(qm_request *request)
{
    qm_problem problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the reply");
    qm_reply_problem(request, &problem);
}

/* ---- streams that wait for jobs ---- */

/** Where the lines of a stream come from: the events of one job, or the answers of a batch. */
typedef struct line_source {
    /* Adds new lines, or calls suspend and marks the subscriber as waiting. */
    qm_read_status (*read)(void *user, qm_text *out, void (*suspend)(void *user));
    /* After QM_READ_END: the stream lacks lines, and the connection is cut. */
    bool (*is_cut)(void *user);
    void (*end)(void *user, bool has_ended);
    void *user;
} line_source;

typedef struct stream {
    qm_app *app;
    struct MHD_Connection *connection;
    line_source source;
    qm_subscriber subscriber;
    bool has_ended;
    qm_text pending; /* not yet sent */
    size_t sent;
} stream;

static void resume(void *user)
{
    MHD_resume_connection(((stream *)user)->connection);
}

static void suspend(void *user)
{
    MHD_suspend_connection(((stream *)user)->connection);
}

static ssize_t read_stream(void *user, uint64_t position, char *buffer, size_t size)
{
    (void)position;
    stream *s = user;
    if (s->sent == s->pending.size) {
        qm_text_reset(&s->pending);
        s->sent = 0;
        qm_read_status status = s->source.read(s->source.user, &s->pending, suspend);
        if (status == QM_READ_NONE) return 0;
        s->has_ended = status == QM_READ_END;
        bool is_broken = s->pending.failed || (s->has_ended && s->source.is_cut(s->source.user));
        if (is_broken) return MHD_CONTENT_READER_END_WITH_ERROR;
        if (s->has_ended) return MHD_CONTENT_READER_END_OF_STREAM;
    }
    QM_ASSERT(s->sent <= s->pending.size);
    size_t rest = s->pending.size - s->sent, count = rest < size ? rest : size;
    memcpy(buffer, s->pending.data + s->sent, count);
    s->sent += count;
    return (ssize_t)count;
}

static void free_stream(void *user)
{
    stream *s = user;
    s->source.end(s->source.user, s->has_ended);
    return_slot(s->app);
    qm_text_reset(&s->pending);
    free(s);
}

/** A stream with a slot and without a source; NULL after a problem was the reply. */
static stream *make_stream(qm_request *request)
{
    qm_app *app = request->app;
    stream *s = take_slot(app) ? calloc(1, sizeof *s) : NULL;
    if (!s) {
        refuse_slot(request);
        return NULL;
    }
    *s = (stream){.app = app,
                  .connection = request->connection,
                  .subscriber = {.wake = resume,
                                 .user = s,
                                 .wake_at_ms = qm_clock_now_ms() + qm_job_events_heartbeat_ms(app->jobs)}};
    return s;
}

static void reply_stream(qm_request *request, int status, const char *media, stream *s)
{
    qm_reply_set_reader(request, status, MHD_SIZE_UNKNOWN, BLOCK_SIZE, read_stream, s, free_stream);
    qm_reply_header(request, "Content-Type", "%s", media);
    qm_reply_header(request, "Cache-Control", "no-store, no-transform");
    qm_reply_header(request, "X-Accel-Buffering", "no");
}

/* ---- the events of a job ---- */

typedef struct event_source {
    qm_jobs *jobs;
    qm_job *job;
    qm_subscriber *subscriber;
    uint64_t seq;
    qm_framing framing;
    bool owns_job;
} event_source;

static qm_read_status read_events(void *user, qm_text *out, void (*put_to_sleep)(void *user))
{
    event_source *e = user;
    return qm_job_read(e->jobs, e->job, &e->seq, e->framing, out, e->subscriber, put_to_sleep);
}

static bool events_are_cut(void *user)
{
    const event_source *e = user;
    return !qm_job_has_last_event(e->jobs, e->job);
}

static void end_events(void *user, bool has_ended)
{
    event_source *e = user;
    if (e->owns_job && !has_ended) qm_jobs_disown(e->jobs, e->job);
    qm_job_unsubscribe(e->jobs, e->job, e->subscriber);
    qm_jobs_release(e->jobs, e->job);
    free(e);
}

void qm_reply_stream(qm_request *request, int status, qm_job *job, uint64_t after, qm_framing framing,
                     bool owns_job)
{
    qm_jobs *jobs = request->app->jobs;
    qm_problem problem;
    bool is_readable = qm_job_fetch_events(job, &problem);
    event_source *e = is_readable ? malloc(sizeof *e) : NULL;
    stream *s = e ? make_stream(request) : NULL;
    if (!s) {
        if (owns_job) qm_jobs_disown(jobs, job);
        qm_jobs_release(jobs, job);
        if (!is_readable)
            qm_reply_problem(request, &problem);
        else if (!e)
            refuse_memory(request);
        free(e);
        return;
    }
    *e = (event_source){jobs, job, &s->subscriber, after, framing, owns_job};
    s->source = (line_source){read_events, events_are_cut, end_events, e};
    qm_job_subscribe(jobs, job, &s->subscriber);
    reply_stream(request, status, framing == QM_FRAMING_SSE ? QM_MEDIA_SSE : QM_MEDIA_NDJSON, s);
}

/* ---- the answers of a batch ---- */

static qm_read_status read_batch(void *user, qm_text *out, void (*put_to_sleep)(void *user))
{
    return qm_batch_read(user, out, put_to_sleep);
}

static bool batch_is_cut(void *user)
{
    return qm_batch_is_cut(user);
}

static void end_batch(void *user, bool has_ended)
{
    (void)has_ended;
    qm_batch_close(user);
}

void qm_reply_batch(qm_request *request, qm_blob_writer *upload)
{
    qm_app *app = request->app;
    stream *s = make_stream(request);
    if (!s) {
        qm_blob_abort(upload);
        return;
    }
    char client[QM_CLIENT_SIZE];
    qm_request_client(request, client);
    qm_batch *batch = qm_batch_create(app->jobs, app->pools[QM_LANE_SHORT], upload, client, &s->subscriber);
    if (!batch) {
        return_slot(app);
        free(s);
        refuse_memory(request);
        return;
    }
    s->source = (line_source){read_batch, batch_is_cut, end_batch, batch};
    reply_stream(request, 200, QM_MEDIA_NDJSON, s);
}

/* ---- the document of a job once it has ended ---- */

static void resume_request(void *user)
{
    MHD_resume_connection(((qm_request *)user)->connection);
}

static void suspend_request(void *user)
{
    MHD_suspend_connection(((qm_request *)user)->connection);
}

void qm_reply_when_done(qm_request *request, qm_job *job, double wait_ms, int status_before)
{
    request->awaited = job;
    request->status_before = status_before;
    request->subscriber =
        (qm_subscriber){.wake = resume_request, .user = request, .wake_at_ms = qm_clock_now_ms() + wait_ms};
    qm_job_subscribe(request->app->jobs, job, &request->subscriber);
}

bool qm_reply_check_awaited(qm_request *request)
{
    qm_jobs *jobs = request->app->jobs;
    qm_job *job = request->awaited;
    if (!qm_job_await_end(jobs, job, &request->subscriber, suspend_request)) return false;
    qm_job_unsubscribe(jobs, job, &request->subscriber);
    request->awaited = NULL;
    bool ended;
    char *document = qm_job_document_now(jobs, job, &ended);
    int status = ended ? 200 : request->status_before;
    if (qm_request_wants_id(request))
        qm_reply_id(request, status, qm_job_id(job));
    else
        qm_reply_text(request, status, QM_MEDIA_JSON, document);
    if (qm_request_wants_id(request)) free(document);
    qm_jobs_release(jobs, job);
    return true;
}

/* ---- the answer of a job that is not stored ---- */

void qm_reply_once(qm_request *request, qm_job_request *job, qm_mesh_ref *const mesh[2])
{
    char client[QM_CLIENT_SIZE];
    qm_problem problem;
    qm_request_client(request, client);
    request->subscriber = (qm_subscriber){.wake = resume_request, .user = request};
    request->once = qm_job_once_start(request->app->jobs, job, mesh, client, &request->subscriber, &problem);
    if (!request->once) qm_reply_problem(request, &problem);
}

void qm_reply_end_once(qm_request *request)
{
    qm_job_once_close(request->once);
    request->once = NULL;
}

/** Replies with a problem document, which lacks the instance. */
static void reply_document(qm_request *request, const char *document)
{
    qm_json *problem = qm_json_parse(document);
    double status = problem ? qm_json_get_number(problem, "status") : 500.0;
    qm_json_free(problem);
    qm_text out = {0};
    qm_text_add_string(&out, "{");
    qm_json_add_members(&out, document);
    qm_text_printf(&out, ",\"instance\":\"urn:request:%s\"}", request->name);
    qm_reply_text(request, (int)status, "application/problem+json", qm_text_take(&out));
}

bool qm_reply_check_once(qm_request *request)
{
    bool has_result, has_ended = false, is_gone = false;
    char *object = NULL;
    while (!has_ended && !is_gone) {
        if (!qm_job_once_await(request->once, suspend_request)) return false;
        has_ended = qm_job_once_take(request->once, &has_result, &object);
        is_gone = !has_ended && qm_http_has_left(request);
    }
    qm_reply_end_once(request);
    if (has_ended && object && !has_result) {
        reply_document(request, object);
        free(object);
    } else if (has_ended) {
        qm_reply_text(request, 200, "application/json", object);
    } else {
        qm_problem problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the client has left");
        qm_reply_problem(request, &problem);
    }
    return true;
}

/* ---- blocks ---- */

typedef struct block_reply {
    qm_app *app;
    qm_pool *pool; /* makes the blocks */
    char client[QM_CLIENT_SIZE];
    struct MHD_Connection *connection;
    qm_block_source source;
    qm_text block;
    size_t sent; /* of block */
    qm_block state;
} block_reply;

/** The source's next block; QM_BLOCK_FAILED also when the block is out of memory. */
static qm_block next_block(qm_block_source source, qm_text *out, qm_problem *problem)
{
    qm_block state = source.next(source.user, out, problem);
    if (!out->failed) return state;
    *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the reply");
    return QM_BLOCK_FAILED;
}

static void make_block(void *user)
{
    block_reply *reply = user;
    qm_problem problem;
    reply->state = next_block(reply->source, &reply->block, &problem);
    if (reply->state == QM_BLOCK_FAILED) qm_log(QM_LOG_ERROR, "a reply is cut: %s", problem.detail);
    MHD_resume_connection(reply->connection);
}

/** Cuts the reply when the pool is closed because the daemon stops. */
static void ask_for_block(block_reply *reply)
{
    reply->block.size = 0;
    reply->sent = 0;
    MHD_suspend_connection(reply->connection);
    if (qm_pool_submit(reply->pool, reply->client, make_block, reply)) return;
    reply->state = QM_BLOCK_FAILED;
    MHD_resume_connection(reply->connection);
}

static ssize_t read_block(void *user, uint64_t position, char *buffer, size_t size)
{
    (void)position;
    block_reply *reply = user;
    size_t rest = reply->block.size - reply->sent, count = rest < size ? rest : size;
    if (reply->state == QM_BLOCK_FAILED) return MHD_CONTENT_READER_END_WITH_ERROR;
    if (rest == 0 && reply->state == QM_BLOCK_LAST) return MHD_CONTENT_READER_END_OF_STREAM;
    if (rest == 0) {
        ask_for_block(reply);
        return 0;
    }
    memcpy(buffer, reply->block.data + reply->sent, count);
    reply->sent += count;
    return (ssize_t)count;
}

static void free_blocks(void *user)
{
    block_reply *reply = user;
    reply->source.end(reply->source.user);
    return_slot(reply->app);
    qm_text_reset(&reply->block);
    free(reply);
}

void qm_reply_blocks(qm_request *request, int status, const char *content_type, uint64_t size,
                     qm_block_source source)
{
    qm_app *app = request->app;
    qm_text first = {0};
    qm_block state = QM_BLOCK_MORE;
    qm_problem problem;
    if (strcmp(request->method, "HEAD") != 0) state = next_block(source, &first, &problem);
    if (state != QM_BLOCK_MORE) {
        source.end(source.user);
        if (state == QM_BLOCK_FAILED) {
            qm_text_reset(&first);
            request->reply.header_count = 0; /* they describe the failed reply */
            qm_reply_problem(request, &problem);
            return;
        }
        size_t first_size = first.size;
        qm_reply_set_buffer(request, status, qm_text_take(&first), first_size);
        qm_reply_header(request, "Content-Type", "%s", content_type);
        return;
    }
    block_reply *reply = take_slot(app) ? calloc(1, sizeof *reply) : NULL;
    if (!reply) {
        qm_text_reset(&first);
        source.end(source.user);
        refuse_slot(request);
        return;
    }
    QM_ASSERT(app->pools[request->route->lane]);
    *reply = (block_reply){.app = app,
                           .pool = app->pools[request->route->lane],
                           .connection = request->connection,
                           .source = source,
                           .block = first,
                           .state = state};
    memcpy(reply->client, request->client, sizeof reply->client);
    qm_reply_set_reader(request, status, size == QM_SIZE_UNKNOWN ? MHD_SIZE_UNKNOWN : size, PIECE_SIZE,
                        read_block, reply, free_blocks);
    qm_reply_header(request, "Content-Type", "%s", content_type);
    qm_reply_header(request, "X-Accel-Buffering", "no");
}
