/**
 * http.c: the life of a request, from the first header to the log line.
 *
 * libmicrohttpd's own threads receive and send. A handler that may wait (route.h) runs on one of the app's
 * pools while its connection is suspended; the connection is then resumed and the reply queued. A fault that
 * is known before the body has come is answered at once where the library lets us, else when the body has
 * been read and thrown away.
 */
#include "http_internal.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "json_out.h"
#include "log.h"
#include "media.h"

#define MAX_JSON_BODY (1u << 20)
#define MAX_THROWN_AWAY (16u << 20)
#define CONNECTION_MEMORY (128u << 10)
#define CONNECTION_THREADS 2
#define LINGER_MS 1000.0

struct qm_http {
    qm_app *app;
    struct MHD_Daemon *daemon;
    int port;
};

qm_app *qm_request_app(const qm_request *request)
{
    return request->app;
}

const char *qm_request_id(const qm_request *request)
{
    return request->id;
}

bool qm_request_only_reads(const qm_request *request)
{
    return strcmp(request->route->method, "GET") == 0;
}

const char *qm_request_header(const qm_request *request, const char *name)
{
    return MHD_lookup_connection_value(request->connection, MHD_HEADER_KIND, name);
}

const char *qm_request_query(const qm_request *request, const char *name)
{
    return MHD_lookup_connection_value(request->connection, MHD_GET_ARGUMENT_KIND, name);
}

bool qm_request_choice(qm_request *request, const char *name, const char *const *choices, int *out)
{
    const char *given = qm_request_query(request, name);
    *out = 0;
    if (!given) return true;
    for (; choices[*out]; (*out)++)
        if (strcmp(given, choices[*out]) == 0) return true;
    qm_problem problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "%s is %s", name, choices[0]);
    for (int i = 1; choices[i]; i++) {
        size_t used = strlen(problem.detail);
        snprintf(problem.detail + used, sizeof problem.detail - used, " or %s", choices[i]);
    }
    qm_reply_problem(request, &problem);
    return false;
}

const char *qm_request_media(const qm_request *request)
{
    return request->media;
}

const char *qm_request_body(const qm_request *request, size_t *size)
{
    *size = request->body.size;
    return request->body.data ? request->body.data : "";
}

qm_blob_writer *qm_request_take_upload(qm_request *request)
{
    qm_blob_writer *upload = request->upload;
    request->upload = NULL;
    return upload;
}

/* ---- replies ---- */

static void set_reply(qm_request *request, int status, const char *content_type, void *body, size_t size,
                      enum MHD_ResponseMemoryMode mode)
{
    request->reply.status = status;
    request->reply.response = MHD_create_response_from_buffer(size, body, mode);
    if (content_type) qm_reply_header(request, "Content-Type", "%s", content_type);
}

void qm_reply_text(qm_request *request, int status, const char *content_type, char *body)
{
    if (body) {
        set_reply(request, status, content_type, body, strlen(body), MHD_RESPMEM_MUST_FREE);
        return;
    }
    qm_problem problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "there is no memory for the reply");
    qm_reply_problem(request, &problem);
}

void qm_reply_static(qm_request *request, int status, const char *content_type, const char *body)
{
    set_reply(request, status, content_type, (void *)(uintptr_t)body, strlen(body), MHD_RESPMEM_PERSISTENT);
}

void qm_reply_empty(qm_request *request, int status)
{
    set_reply(request, status, NULL, (void *)(uintptr_t) "", 0, MHD_RESPMEM_PERSISTENT);
}

void qm_request_set_reader(qm_request *request, int status, uint64_t size, size_t piece_size,
                           MHD_ContentReaderCallback read, void *user, MHD_ContentReaderFreeCallback end)
{
    request->reply.status = status;
    request->reply.response = MHD_create_response_from_callback(size, piece_size, read, user, end);
    /* libmicrohttpd 0.9.75 ends a chunked reply to HEAD with a last chunk, which the client takes for the
     * start of the next reply. */
    if (strcmp(request->method, "HEAD") == 0 && size == MHD_SIZE_UNKNOWN)
        MHD_set_response_options(request->reply.response, MHD_RF_HTTP_1_0_COMPATIBLE_STRICT, MHD_RO_END);
}

void qm_reply_problem(qm_request *request, const qm_problem *problem)
{
    static const char fallback[] = "{\"type\":\"about:blank\",\"title\":\"Out of memory\",\"status\":507}";
    qm_text text = {0};
    qm_json_write_problem(&text, problem);
    char *body = qm_text_take(&text);
    if (problem->allow[0]) qm_reply_header(request, "Allow", "%s", problem->allow);
    if (problem->retry_after_s) qm_reply_header(request, "Retry-After", "%d", problem->retry_after_s);
    if (body)
        set_reply(request, qm_problem_status(problem->code), "application/problem+json", body, strlen(body),
                  MHD_RESPMEM_MUST_FREE);
    else
        qm_reply_static(request, 507, "application/problem+json", fallback);
}

void qm_reply_header(qm_request *request, const char *name, const char *format, ...)
{
    qm_reply *reply = &request->reply;
    QM_ASSERT(reply->header_count < QM_REPLY_HEADERS);
    char(*header)[256] = reply->header[reply->header_count++];
    snprintf(header[0], sizeof header[0], "%s", name);
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(header[1], sizeof header[1], format, arguments);
    va_end(arguments);
}

static enum MHD_Result send_reply(qm_request *request)
{
    qm_reply *reply = &request->reply;
    if (!reply->response) return MHD_NO;
    for (int i = 0; i < reply->header_count; i++)
        MHD_add_response_header(reply->response, reply->header[i][0], reply->header[i][1]);
    MHD_add_response_header(reply->response, "X-Content-Type-Options", "nosniff");
    enum MHD_Result result =
        MHD_queue_response(request->connection, (unsigned)reply->status, reply->response);
    MHD_destroy_response(reply->response);
    reply->response = NULL;
    request->stage = DONE;
    return result;
}

/* ---- receiving ---- */

static void set_problem(qm_request *request, qm_problem problem)
{
    if (request->has_problem) return;
    request->problem = problem;
    request->has_problem = true;
}

static size_t body_limit(const qm_request *request)
{
    return request->route->body == QM_BODY_SPOOL ? (size_t)request->app->config->max_body : MAX_JSON_BODY;
}

/** How often a request tells its length, and how. */
typedef struct length_headers {
    int lengths, codings;
} length_headers;

static enum MHD_Result count_header(void *user, enum MHD_ValueKind kind, const char *name, const char *value)
{
    (void)kind;
    (void)value;
    length_headers *found = user;
    if (strcasecmp(name, "Content-Length") == 0) found->lengths++;
    if (strcasecmp(name, "Transfer-Encoding") == 0) found->codings++;
    return MHD_YES;
}

/** Two lengths, or a coding other than chunked, are how requests are smuggled past a proxy. */
static bool check_framing(qm_request *request)
{
    length_headers found = {0};
    MHD_get_connection_values(request->connection, MHD_HEADER_KIND, count_header, &found);
    const char *coding = qm_request_header(request, "Transfer-Encoding");
    if (found.lengths + found.codings > 1)
        set_problem(request, qm_problem_make(QM_PROBLEM_AMBIGUOUS_LENGTH,
                                             "the request has more than one of Content-Length and "
                                             "Transfer-Encoding"));
    else if (coding && strcasecmp(coding, "chunked") != 0)
        set_problem(request, qm_problem_make(QM_PROBLEM_AMBIGUOUS_LENGTH,
                                             "the only Transfer-Encoding taken is chunked"));
    return !request->has_problem;
}

static void check_accept(qm_request *request)
{
    const char *const *offers = request->route->produces;
    if (!offers) return;
    int chosen = qm_media_choose(qm_request_header(request, "Accept"), offers);
    if (chosen >= 0) {
        request->media = offers[chosen];
        return;
    }
    qm_problem problem = qm_problem_make(QM_PROBLEM_NOT_ACCEPTABLE, "this comes as %s", offers[0]);
    for (size_t i = 1; offers[i]; i++) {
        size_t used = strlen(problem.detail);
        snprintf(problem.detail + used, sizeof problem.detail - used, " or %s", offers[i]);
    }
    set_problem(request, problem);
}

static void check_length(qm_request *request)
{
    const char *length = qm_request_header(request, "Content-Length");
    if (!length || request->route->body == QM_BODY_NONE) return;
    if (strtoull(length, NULL, 10) > body_limit(request))
        set_problem(request, qm_problem_make(QM_PROBLEM_TOO_LARGE, "the body may have %zu bytes",
                                             body_limit(request)));
}

static void begin(qm_request *request)
{
    qm_problem problem;
    if (!check_framing(request)) return;
    request->route = qm_route_find(request->method, request->path, request->id, &problem);
    if (!request->route) {
        set_problem(request, problem);
        return;
    }
    check_length(request);
    check_accept(request);
    if (!request->has_problem && request->route->body == QM_BODY_SPOOL &&
        qm_blob_begin(request->app->store, &request->upload) != QM_OK)
        set_problem(request, qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the upload cannot be written"));
}

static void drop_upload(qm_request *request)
{
    qm_blob_abort(request->upload);
    request->upload = NULL;
}

/** Where the bytes of a body go. */
static void keep(qm_request *request, const char *bytes, size_t size)
{
    if (request->body_size > body_limit(request)) {
        set_problem(request, qm_problem_make(QM_PROBLEM_TOO_LARGE, "the body may have %zu bytes",
                                             body_limit(request)));
    } else if (request->upload) {
        if (qm_blob_write(request->upload, bytes, size) != QM_OK)
            set_problem(request, qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the upload cannot be written"));
    } else {
        qm_text_add(&request->body, bytes, size);
        if (request->body.failed)
            set_problem(request,
                        qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "there is no memory for the body"));
    }
}

/**
 * Takes a part of the body. Once a reply is due that does not need the rest, the library lets us send it only
 * after that rest, which is thrown away: up to a limit, beyond which the connection is cut (false).
 */
static bool receive(qm_request *request, const char *bytes, size_t size)
{
    request->body_size += size;
    if (request->has_problem || request->route->body == QM_BODY_NONE)
        request->thrown_away += size;
    else
        keep(request, bytes, size);
    if (request->has_problem) drop_upload(request);
    return request->thrown_away <= MAX_THROWN_AWAY;
}

/* ---- handling ---- */

/** Hands a suspended request with its reply back to the thread of its connection. */
static void hand_back(qm_request *request)
{
    request->stage = WAITING;
    MHD_resume_connection(request->connection);
}

static void run_on_pool(void *data)
{
    qm_request *request = data;
    request->route->handle(request);
    hand_back(request);
}

/** The pool takes nothing any more: the daemon stops, or memory is out. */
static void refuse(qm_request *request)
{
    qm_problem problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the request cannot be queued");
    qm_reply_problem(request, &problem);
    hand_back(request);
}

static qm_pool *pool_of(const qm_request *request)
{
    return request->route->runs == QM_RUNS_LONG ? request->app->long_pool : request->app->pool;
}

static enum MHD_Result handle(qm_request *request)
{
    if (request->has_problem) {
        qm_reply_problem(request, &request->problem);
    } else if (request->route->runs == QM_RUNS_AT_ONCE) {
        request->route->handle(request);
    } else {
        request->stage = HANDLING;
        MHD_suspend_connection(request->connection);
        if (!qm_pool_submit(pool_of(request), run_on_pool, request)) refuse(request);
        return MHD_YES;
    }
    return send_reply(request);
}

static bool has_body(const qm_request *request)
{
    const char *length = qm_request_header(request, "Content-Length");
    return (length && strcmp(length, "0") != 0) || qm_request_header(request, "Transfer-Encoding");
}

static enum MHD_Result on_request(void *cls, struct MHD_Connection *connection, const char *url,
                                  const char *method, const char *version, const char *data, size_t *size,
                                  void **state)
{
    (void)version;
    qm_request *request = *state;
    if (!request) {
        request = calloc(1, sizeof *request);
        if (!request) return MHD_NO;
        request->app = cls;
        request->connection = connection;
        request->start_ms = qm_now_ms();
        snprintf(request->method, sizeof request->method, "%s", method);
        snprintf(request->path, sizeof request->path, "%s", url);
        *state = request;
        atomic_fetch_add(&request->app->request_count, 1);
        begin(request);
        if (!request->has_problem) return MHD_YES;
        /* The body has not come yet; what follows on this connection is not to be taken for a request. */
        if (has_body(request)) qm_reply_header(request, "Connection", "close");
        return handle(request);
    }
    if (*size > 0) {
        if (!receive(request, data, *size)) return MHD_NO;
        *size = 0;
        return MHD_YES;
    }
    if (request->stage == RECEIVING) return handle(request);
    if (request->stage != WAITING) return MHD_YES;
    if (request->awaited && !qm_request_check_awaited(request)) return MHD_YES;
    return send_reply(request);
}

static void on_completed(void *cls, struct MHD_Connection *connection, void **state,
                         enum MHD_RequestTerminationCode code)
{
    (void)cls;
    (void)connection;
    qm_request *request = *state;
    if (!request) return;
    qm_log(QM_LOG_INFO, "%s %s %d %.1f ms%s", request->method, request->path, request->reply.status,
           qm_now_ms() - request->start_ms, code == MHD_REQUEST_TERMINATED_COMPLETED_OK ? "" : " (cut off)");
    if (request->awaited) {
        qm_job_leave(request->app->jobs, request->awaited, &request->reader);
        qm_jobs_release(request->app->jobs, request->awaited);
    }
    drop_upload(request);
    if (request->reply.response) MHD_destroy_response(request->reply.response);
    qm_text_reset(&request->body);
    atomic_fetch_sub(&request->app->request_count, 1);
    free(request);
    *state = NULL;
}

/* ---- the daemon ---- */

static void on_library_log(void *cls, const char *format, va_list arguments)
{
    (void)cls;
    char line[256];
    vsnprintf(line, sizeof line, format, arguments);
    qm_log(QM_LOG_WARN, "http: %s", line);
}

static bool make_address(const qm_config *config, struct sockaddr_storage *address)
{
    memset(address, 0, sizeof *address);
    struct sockaddr_in *v4 = (struct sockaddr_in *)address;
    struct sockaddr_in6 *v6 = (struct sockaddr_in6 *)address;
    if (inet_pton(AF_INET, config->listen, &v4->sin_addr) == 1) {
        v4->sin_family = AF_INET;
        v4->sin_port = htons((uint16_t)config->port);
        return true;
    }
    if (inet_pton(AF_INET6, config->listen, &v6->sin6_addr) == 1) {
        v6->sin6_family = AF_INET6;
        v6->sin6_port = htons((uint16_t)config->port);
        return true;
    }
    return false;
}

qm_http *qm_http_start(qm_app *app)
{
    struct sockaddr_storage address;
    qm_http *http = calloc(1, sizeof *http);
    if (!http || !make_address(app->config, &address)) {
        qm_log(QM_LOG_ERROR, "cannot listen on %s", app->config->listen);
        free(http);
        return NULL;
    }
    http->app = app;
    unsigned flags = MHD_USE_EPOLL_INTERNAL_THREAD | MHD_ALLOW_SUSPEND_RESUME | MHD_USE_ERROR_LOG;
    if (address.ss_family == AF_INET6) flags |= MHD_USE_IPv6;
    http->daemon = MHD_start_daemon(
        flags, 0, NULL, NULL, on_request, app, MHD_OPTION_EXTERNAL_LOGGER, on_library_log, NULL,
        MHD_OPTION_SOCK_ADDR, (struct sockaddr *)&address, MHD_OPTION_THREAD_POOL_SIZE, CONNECTION_THREADS,
        MHD_OPTION_CONNECTION_LIMIT, (unsigned)app->config->connections, MHD_OPTION_CONNECTION_TIMEOUT,
        (unsigned)app->config->idle_timeout, MHD_OPTION_CONNECTION_MEMORY_LIMIT, (size_t)CONNECTION_MEMORY,
        MHD_OPTION_NOTIFY_COMPLETED, on_completed, NULL, MHD_OPTION_END);
    if (!http->daemon) {
        qm_log(QM_LOG_ERROR, "cannot listen on %s port %.0f", app->config->listen, app->config->port);
        free(http);
        return NULL;
    }
    http->port = MHD_get_daemon_info(http->daemon, MHD_DAEMON_INFO_BIND_PORT)->port;
    return http;
}

int qm_http_port(const qm_http *http)
{
    return http->port;
}

void qm_http_quiesce(qm_http *http)
{
    MHD_socket socket = MHD_quiesce_daemon(http->daemon);
    if (socket != MHD_INVALID_SOCKET) close(socket);
}

void qm_http_stop(qm_http *http)
{
    if (!http) return;
    /* What is on its way out, the last lines of streams above all, may still arrive. */
    double end = qm_now_ms() + LINGER_MS;
    while (atomic_load(&http->app->request_count) > 0 && qm_now_ms() < end)
        usleep(1000);
    MHD_stop_daemon(http->daemon);
    free(http);
}
