/**
 * http.c: the life of a request, from the first header to the log line.
 *
 * libmicrohttpd's own threads receive and send. A handler that may wait (route.h) runs on the app's pool
 * while its connection is suspended; the connection is then resumed and the reply queued. A fault that is
 * known before the body has come is answered at once where the library lets us, else when the body has been
 * read and thrown away.
 */
#include "http_internal.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "json_out.h"
#include "log.h"

#define MAX_JSON_BODY (1u << 20)
#define CONNECTION_MEMORY (128u << 10)
#define CONNECTION_THREADS 2

struct qm_http {
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

const char *qm_request_header(const qm_request *request, const char *name)
{
    return MHD_lookup_connection_value(request->connection, MHD_HEADER_KIND, name);
}

bool qm_request_accepts(const qm_request *request, const char *type)
{
    const char *accept = qm_request_header(request, "Accept");
    if (!accept || strstr(accept, "*/*")) return true;
    char group[64];
    snprintf(group, sizeof group, "%.*s*", (int)(strcspn(type, "/") + 1), type);
    return strcasestr(accept, type) || strcasestr(accept, group);
}

const char *qm_request_query(const qm_request *request, const char *name)
{
    return MHD_lookup_connection_value(request->connection, MHD_GET_ARGUMENT_KIND, name);
}

const char *qm_request_body(const qm_request *request, size_t *size)
{
    *size = request->body.size;
    return request->body.data ? request->body.data : "";
}

qm_status qm_request_finish_upload(qm_request *request, char hash[QM_HASH_SIZE], size_t *size)
{
    qm_blob_writer *upload = request->upload;
    request->upload = NULL;
    return qm_blob_finish(upload, hash, size);
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

/** Two lengths, or a coding other than chunked, are how requests are smuggled past a proxy. */
static bool check_framing(qm_request *request)
{
    const char *coding = qm_request_header(request, "Transfer-Encoding");
    if (!coding) return true;
    if (qm_request_header(request, "Content-Length"))
        set_problem(request, qm_problem_make(QM_PROBLEM_AMBIGUOUS_LENGTH,
                                             "the request has both Content-Length and Transfer-Encoding"));
    else if (strcasecmp(coding, "chunked") != 0)
        set_problem(request, qm_problem_make(QM_PROBLEM_AMBIGUOUS_LENGTH,
                                             "the only Transfer-Encoding taken is chunked"));
    if (request->has_problem) qm_reply_header(request, "Connection", "close");
    return !request->has_problem;
}

static void check_accept(qm_request *request)
{
    const char *type = request->route->type;
    if (!type || qm_request_accepts(request, type)) return;
    set_problem(request, qm_problem_make(QM_PROBLEM_NOT_ACCEPTABLE, "this resource comes as %s", type));
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
    check_accept(request);
    check_length(request);
    if (!request->has_problem && request->route->body == QM_BODY_SPOOL &&
        qm_blob_begin(request->app->store, &request->upload) != QM_OK)
        set_problem(request, qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the upload cannot be written"));
}

static void receive(qm_request *request, const char *bytes, size_t size)
{
    request->body_size += size;
    if (request->has_problem || request->route->body == QM_BODY_NONE) return;
    if (request->body_size > body_limit(request)) {
        set_problem(request, qm_problem_make(QM_PROBLEM_TOO_LARGE, "the body may have %zu bytes",
                                             body_limit(request)));
    } else if (request->upload) {
        if (qm_blob_write(request->upload, bytes, size) != QM_OK)
            set_problem(request, qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the upload cannot be written"));
    } else {
        qm_text_add(&request->body, bytes, size);
    }
}

/* ---- handling ---- */

static void run_on_pool(void *data)
{
    qm_request *request = data;
    request->route->handle(request);
    request->stage = WAITING;
    MHD_resume_connection(request->connection);
}

static enum MHD_Result handle(qm_request *request)
{
    if (request->has_problem) {
        qm_reply_problem(request, &request->problem);
    } else if (!request->route->waits) {
        request->route->handle(request);
    } else {
        request->stage = HANDLING;
        MHD_suspend_connection(request->connection);
        if (qm_pool_submit(request->app->pool, run_on_pool, request)) return MHD_YES;
        MHD_resume_connection(request->connection);
        qm_problem problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the request cannot be queued");
        qm_reply_problem(request, &problem);
    }
    return send_reply(request);
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
        begin(request);
        /* Without a body to come this is the only moment to answer before the client sends one. */
        return request->has_problem ? handle(request) : MHD_YES;
    }
    if (*size > 0) {
        receive(request, data, *size);
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
    qm_log("info", "%s %s %d %.1f ms%s", request->method, request->path, request->reply.status,
           qm_now_ms() - request->start_ms, code == MHD_REQUEST_TERMINATED_COMPLETED_OK ? "" : " (cut off)");
    if (request->awaited) {
        qm_job_leave(request->app->jobs, request->awaited, &request->reader);
        qm_jobs_release(request->app->jobs, request->awaited);
    }
    if (request->upload) qm_blob_abort(request->upload);
    if (request->reply.response) MHD_destroy_response(request->reply.response);
    qm_text_reset(&request->body);
    free(request);
    *state = NULL;
}

/* ---- the daemon ---- */

static void on_library_log(void *cls, const char *format, va_list arguments)
{
    (void)cls;
    char line[256];
    vsnprintf(line, sizeof line, format, arguments);
    qm_log("warn", "http: %s", line);
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
        qm_log("error", "cannot listen on %s", app->config->listen);
        free(http);
        return NULL;
    }
    unsigned flags = MHD_USE_EPOLL_INTERNAL_THREAD | MHD_ALLOW_SUSPEND_RESUME | MHD_USE_ERROR_LOG;
    if (address.ss_family == AF_INET6) flags |= MHD_USE_IPv6;
    http->daemon = MHD_start_daemon(
        flags, 0, NULL, NULL, on_request, app, MHD_OPTION_EXTERNAL_LOGGER, on_library_log, NULL,
        MHD_OPTION_SOCK_ADDR, (struct sockaddr *)&address, MHD_OPTION_THREAD_POOL_SIZE, CONNECTION_THREADS,
        MHD_OPTION_CONNECTION_LIMIT, (unsigned)app->config->connections, MHD_OPTION_CONNECTION_TIMEOUT,
        (unsigned)app->config->idle_timeout, MHD_OPTION_CONNECTION_MEMORY_LIMIT, (size_t)CONNECTION_MEMORY,
        MHD_OPTION_NOTIFY_COMPLETED, on_completed, NULL, MHD_OPTION_END);
    if (!http->daemon) {
        qm_log("error", "cannot listen on %s port %.0f", app->config->listen, app->config->port);
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
    MHD_stop_daemon(http->daemon);
    free(http);
}
