/**
 * http_stream.c: replies that wait for a job: the stream of its events, or the answer once it has ended.
 *
 * A connection with nothing to send is suspended under the lock of the jobs (job.h) and resumed under it, so
 * that no wake-up is lost and nothing is resumed that is not suspended.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "http_internal.h"

#define BLOCK_SIZE 16384
#define HEARTBEAT_MS 10000.0

typedef struct stream {
    qm_app *app;
    struct MHD_Connection *connection;
    qm_job *job;
    qm_reader reader;
    uint64_t seq;
    qm_framing framing;
    bool owns_job, has_ended;
    qm_text pending; /* framed, not yet sent */
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
        qm_news news =
            qm_job_read(s->app->jobs, s->job, &s->seq, s->framing, &s->pending, &s->reader, suspend);
        if (news == QM_NEWS_NONE) return 0;
        s->has_ended = news == QM_NEWS_END;
        if (s->has_ended) return MHD_CONTENT_READER_END_OF_STREAM;
        if (s->pending.failed) return MHD_CONTENT_READER_END_WITH_ERROR;
    }
    size_t rest = s->pending.size - s->sent, count = rest < size ? rest : size;
    memcpy(buffer, s->pending.data + s->sent, count);
    s->sent += count;
    return (ssize_t)count;
}

static void free_stream(void *user)
{
    stream *s = user;
    if (s->owns_job && !s->has_ended) qm_jobs_disown(s->app->jobs, s->job);
    qm_job_leave(s->app->jobs, s->job, &s->reader);
    qm_jobs_release(s->app->jobs, s->job);
    qm_request_leave_place(s->app);
    qm_text_reset(&s->pending);
    free(s);
}

bool qm_request_take_place(qm_app *app)
{
    if (atomic_fetch_add(&app->stream_count, 1) < (int)app->config->streams) return true;
    atomic_fetch_sub(&app->stream_count, 1);
    return false;
}

void qm_request_leave_place(qm_app *app)
{
    atomic_fetch_sub(&app->stream_count, 1);
}

void qm_request_refuse_place(qm_request *request)
{
    qm_problem problem =
        qm_problem_make(QM_PROBLEM_UNAVAILABLE, "all %.0f streams are taken", request->app->config->streams);
    problem.retry_after_s = 1;
    qm_reply_problem(request, &problem);
}

void qm_reply_stream(qm_request *request, int status, qm_job *job, uint64_t after, qm_framing framing,
                     bool owns_job)
{
    qm_app *app = request->app;
    stream *s = qm_request_take_place(app) ? calloc(1, sizeof *s) : NULL;
    if (!s) {
        if (owns_job) qm_jobs_disown(app->jobs, job);
        qm_jobs_release(app->jobs, job);
        qm_request_refuse_place(request);
        return;
    }
    *s = (stream){.app = app,
                  .connection = request->connection,
                  .job = job,
                  .seq = after,
                  .framing = framing,
                  .owns_job = owns_job,
                  .reader = {.wake = resume, .user = s, .wake_at_ms = qm_now_ms() + HEARTBEAT_MS}};
    qm_job_join(app->jobs, job, &s->reader);
    qm_request_set_reader(request, status, MHD_SIZE_UNKNOWN, BLOCK_SIZE, read_stream, s, free_stream);
    qm_reply_header(request, "Content-Type", "%s",
                    framing == QM_FRAMING_SSE ? QM_MEDIA_SSE : QM_MEDIA_NDJSON);
    qm_reply_header(request, "Cache-Control", "no-store, no-transform");
    qm_reply_header(request, "X-Accel-Buffering", "no");
}

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
    request->reader =
        (qm_reader){.wake = resume_request, .user = request, .wake_at_ms = qm_now_ms() + wait_ms};
    qm_job_join(request->app->jobs, job, &request->reader);
}

bool qm_request_check_awaited(qm_request *request)
{
    qm_jobs *jobs = request->app->jobs;
    qm_job *job = request->awaited;
    if (!qm_job_await_end(jobs, job, &request->reader, suspend_request)) return false;
    qm_job_leave(jobs, job, &request->reader);
    request->awaited = NULL;
    bool ended;
    char *document = qm_job_document_now(jobs, job, &ended);
    qm_jobs_release(jobs, job);
    qm_reply_text(request, ended ? 200 : request->status_before, "application/json", document);
    return true;
}
