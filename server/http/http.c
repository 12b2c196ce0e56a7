/**
 * http.c: the life of a request, from the first header to the log line.
 *
 * libmicrohttpd's own threads receive and send. A handler that may wait (route.h) runs on one of the app's
 * pools while its connection is suspended; the connection is then resumed and the reply queued. A fault that
 * is known before the body is received is the reply at once where the library allows it, else after the body
 * was read and discarded.
 */
#include "handlers.h"
#include "http_internal.h"

#include <math.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/log.h"
#include "base/metrics.h"

#define MAX_DISCARDED (16u << 20) /* bytes of a body that nothing needs, after which the connection is cut */
#define MAX_READ_AND_DROPPED (64u << 10) /* of the body of a request that is refused by its headers */
#define CONNECTION_MEMORY (256u << 10)   /* of which half is what is read of a body at once */
#define CONNECTION_THREADS 2
#define HEALTH_CONNECTIONS 64
#define MAX_LOG_RATE 5 /* messages of the library that are logged in a second */
#define LINGER_MS 1000.0
#define MS_PER_S 1e3

/* ---- receiving ---- */

static void drop_upload(qm_request *request)
{
    qm_blob_abort(request->upload);
    request->upload = NULL;
}

/** Appends bytes of a body to the upload or the memory of the request. */
static void keep(qm_request *request, const char *bytes, size_t size)
{
    if (request->body_size > qm_request_body_limit(request)) {
        qm_request_set_problem(request,
                               qm_problem_make(QM_PROBLEM_TOO_LARGE, "the body must not exceed %zu bytes",
                                               qm_request_body_limit(request)));
    } else if (request->upload) {
        qm_status status = qm_blob_write(request->upload, bytes, size);
        if (status != QM_OK) qm_request_set_problem(request, qm_problem_from_write(status, "the body"));
    } else {
        qm_text_add(&request->body, bytes, size);
        if (request->body.failed)
            qm_request_set_problem(request,
                                   qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the body"));
    }
}

/**
 * Receives a part of the body. A reply that does not need the remainder can only be sent after it, by the
 * rules of the library. The remainder is discarded, up to a limit beyond which the connection is cut (false).
 */
static bool receive(qm_request *request, const char *bytes, size_t size)
{
    request->body_size += size;
    if (request->guarded) atomic_fetch_add(&request->guarded->received, size);
    if (request->has_problem || request->route->body == QM_BODY_NONE)
        request->discarded += size;
    else
        keep(request, bytes, size);
    if (request->has_problem) drop_upload(request);
    return request->discarded <= MAX_DISCARDED;
}

/* ---- handling ---- */

/** Hands a suspended request with its reply back to the thread of its connection. */
static void hand_back(qm_request *request)
{
    QM_ASSERT(request->stage == HANDLING);
    request->stage = WAITING;
    MHD_resume_connection(request->connection);
}

static void run_on_pool(void *data)
{
    qm_request *request = data;
    qm_problem problem;
    if (qm_jobs_is_isolated(request->app->jobs)) {
        problem = qm_problem_make(QM_PROBLEM_STORE_UNAVAILABLE,
                                  "this node has not reached the database for some seconds");
        qm_reply_problem(request, &problem);
    } else {
        request->route->handle(request);
    }
    hand_back(request);
}

/**
 * A query or download of a mesh that is not in memory decodes it first, and does so in the lane of decoders. A layout that
 * is made takes seconds, and goes there too.
 */
static qm_lane choose_lane(const qm_request *request)
{
    qm_lane lane = request->route->lane;
    bool loads = (lane == QM_LANE_QUERY || lane == QM_LANE_DOWNLOAD) &&
                 !qm_meshes_has_loaded(request->app->meshes, request->ids[0]);
    bool computes = request->route->handle == qm_handle_layout_create && qm_handle_layout_computes(request);
    return loads || computes ? QM_LANE_DECODE : lane;
}

static enum MHD_Result handle(qm_request *request)
{
    QM_ASSERT(request->stage == RECEIVING && (request->route || request->has_problem));
    qm_guard_set_stage(&request->listener->guard, request->guarded, QM_CONNECTION_BUSY);
    if (request->has_problem) {
        qm_reply_problem(request, &request->problem);
    } else if (request->route->lane == QM_LANE_AT_ONCE) {
        request->route->handle(request);
    } else {
        request->stage = HANDLING;
        qm_request_client(request, request->client);
        MHD_suspend_connection(request->connection);
        if (qm_pool_submit(request->app->pools[choose_lane(request)], request->client, run_on_pool, request))
            return MHD_YES;
        /* The pool is closed because the daemon stops, or memory ran out. */
        qm_problem problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the request cannot be queued");
        qm_reply_problem(request, &problem);
        hand_back(request);
        return MHD_YES;
    }
    return qm_reply_send(request);
}

/**
 * True for a small body, after which the problem is sent: unread bytes make the system reset a connection
 * when it is closed, and the reply may be lost with that.
 */
static bool has_little_body(const qm_request *request)
{
    const char *length = qm_request_header(request, "Content-Length");
    if (!length || request->problem.code == QM_PROBLEM_AMBIGUOUS_LENGTH ||
        qm_request_header(request, "Expect"))
        return false;
    return strtoull(length, NULL, 10) <= MAX_READ_AND_DROPPED;
}

/** Takes the client's id for the request, or makes one. */
static void set_name(qm_request *request)
{
    /* These may be repeated in a header, a log and JSON as they are. */
    static const char plain[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-";
    const char *given = qm_request_header(request, "X-Request-Id");
    size_t length = given ? strlen(given) : 0;
    if (length > 0 && length < QM_REQUEST_ID_SIZE && strspn(given, plain) == length) {
        snprintf(request->name, sizeof request->name, "%s", given);
        return;
    }
    char id[QM_ID_SIZE];
    qm_id_make('r', id);
    snprintf(request->name, sizeof request->name, "%s", id);
}

/** Splits a target in absolute form, http://host:port/path, which every server must accept (RFC 9112, section 3.2.2). */
static void set_target(qm_request *request, const char *url)
{
    const char *host = strncasecmp(url, "http://", 7) == 0    ? url + 7
                       : strncasecmp(url, "https://", 8) == 0 ? url + 8
                                                              : NULL;
    size_t length = host ? strcspn(host, "/") : 0;
    const char *path = host ? host + length : url;
    snprintf(request->authority, sizeof request->authority, "%.*s", (int)length, host ? host : "");
    snprintf(request->path, sizeof request->path, "%s", host && !*path ? "/" : path);
}

static qm_request *begin(qm_listener *listener, struct MHD_Connection *connection, const char *url,
                         const char *method)
{
    qm_request *request = malloc(sizeof *request);
    if (!request) return NULL;
    /* Leaves out the large buffers of the problem and the headers, which most requests do not use. */
    memset(request, 0, offsetof(qm_request, problem));
    request->reply.status = 0;
    request->reply.response = NULL;
    request->reply.header_count = 0;
    request->app = listener->app;
    request->listener = listener;
    request->connection = connection;
    request->guarded = qm_guard_find(connection);
    request->start_ms = qm_clock_now_ms();
    snprintf(request->method, sizeof request->method, "%s", method);
    set_target(request, url);
    set_name(request);
    atomic_fetch_add(&request->app->request_count, 1);
    qm_guard_set_stage(&listener->guard, request->guarded, QM_CONNECTION_RECEIVING);
    return request;
}

static enum MHD_Result on_request(void *cls, struct MHD_Connection *connection, const char *url,
                                  const char *method, const char *version, const char *data, size_t *size,
                                  void **state)
{
    qm_request *request = *state;
    if (!request) {
        *state = request = begin(cls, connection, url, method);
        if (!request) return MHD_NO;
        request->needs_host = strcmp(version, "HTTP/1.0") != 0;
        qm_request_check(request);
        if (!request->has_problem) return MHD_YES;
        /* The body was not received yet, or its length is not certain: the bytes that follow must not be read as a
         * request. */
        const char *length = qm_request_header(request, "Content-Length");
        bool has_body = (length && strcmp(length, "0") != 0) ||
                        qm_request_header(request, "Transfer-Encoding") ||
                        request->problem.code == QM_PROBLEM_AMBIGUOUS_LENGTH;
        if (has_body) qm_reply_header(request, "Connection", "close");
        return has_little_body(request) ? MHD_YES : handle(request);
    }
    if (*size > 0) {
        if (!receive(request, data, *size)) return MHD_NO;
        *size = 0;
        return MHD_YES;
    }
    if (request->stage == RECEIVING) return handle(request);
    if (request->stage != WAITING) return MHD_YES;
    if (request->awaited && !qm_reply_check_awaited(request)) return MHD_YES;
    if (request->once && !qm_reply_check_once(request)) return MHD_YES;
    return qm_reply_send(request);
}

static void log_request(const qm_request *request, bool is_whole)
{
    double ms = qm_clock_now_ms() - request->start_ms;
    char address[INET6_ADDRSTRLEN];
    qm_request_address(request, address);
    const qm_log_field fields[] = {
        {"request_id", request->name, 0},
        {"client", address, 0},
        {"token", request->token[0] ? request->token : "-", 0},
        {"method", request->method, 0},
        {"path", request->path, 0},
        {"status", NULL, request->reply.status},
        {"duration_ms", NULL, rint(1e3 * ms) / 1e3},
        {"received_bytes", NULL, (double)request->body_size},
        {"cut_off", "true", 0},
    };
    qm_log_fields(QM_LOG_INFO, "request", fields, sizeof fields / sizeof fields[0] - is_whole);
    qm_metrics_add_request(request->method, request->route ? request->route->path : "", request->reply.status,
                           ms / 1e3);
    qm_metrics_add(QM_METRICS_UPLOADED_BYTES, request->body_size);
}

static void on_completed(void *cls, struct MHD_Connection *connection, void **state,
                         enum MHD_RequestTerminationCode code)
{
    (void)cls;
    (void)connection;
    qm_request *request = *state;
    if (!request) return;
    log_request(request, code == MHD_REQUEST_TERMINATED_COMPLETED_OK);
    qm_guard_set_stage(&request->listener->guard, request->guarded, QM_CONNECTION_IDLE);
    if (request->awaited) {
        qm_job_unsubscribe(request->app->jobs, request->awaited, &request->subscriber);
        qm_jobs_release(request->app->jobs, request->awaited);
    }
    if (request->once) qm_reply_end_once(request);
    drop_upload(request);
    if (request->reply.response) MHD_destroy_response(request->reply.response);
    qm_text_reset(&request->body);
    atomic_fetch_sub(&request->app->request_count, 1);
    free(request);
    *state = NULL;
}

/* ---- the daemon ---- */

struct qm_http {
    qm_app *app;
    qm_listener everything, health; /* the second only with --health-port */
    int port;
};

/** Logs a message of the library. When descriptors run out it has thousands a second: a few of each second are shown,
 * and how many were not. */
static void on_library_log(void *cls, const char *format, va_list arguments)
{
    qm_listener *listener = cls;
    uint64_t second = (uint64_t)(qm_clock_now_ms() / MS_PER_S);
    if (atomic_exchange(&listener->log_second, second) != second) {
        unsigned count = atomic_exchange(&listener->log_count, 0);
        if (count > MAX_LOG_RATE)
            qm_log(QM_LOG_WARN, "http: %u more messages in that second", count - MAX_LOG_RATE);
    }
    if (atomic_fetch_add(&listener->log_count, 1) >= MAX_LOG_RATE) return;
    char line[256];
    vsnprintf(line, sizeof line, format, arguments);
    line[strcspn(line, "\n")] = '\0';
    qm_log(QM_LOG_WARN, "http: %s", line);
}

/**
 * Takes no connection any more once the daemon stops. MHD_quiesce_daemon would close the port, but of version 0.9.75
 * it races with the threads of its pool for the listening socket, and the loser ends the process.
 */
static enum MHD_Result on_accept(void *cls, const struct sockaddr *address, socklen_t size)
{
    const qm_listener *listener = cls;
    (void)address;
    (void)size;
    return atomic_load(&listener->is_quiet) ? MHD_NO : MHD_YES;
}

static bool make_address(const char *name, double port, struct sockaddr_storage *address)
{
    memset(address, 0, sizeof *address);
    struct sockaddr_in *v4 = (struct sockaddr_in *)address;
    struct sockaddr_in6 *v6 = (struct sockaddr_in6 *)address;
    if (inet_pton(AF_INET, name, &v4->sin_addr) == 1) {
        v4->sin_family = AF_INET;
        v4->sin_port = htons((uint16_t)port);
        return true;
    }
    if (inet_pton(AF_INET6, name, &v6->sin6_addr) == 1) {
        v6->sin6_family = AF_INET6;
        v6->sin6_port = htons((uint16_t)port);
        return true;
    }
    return false;
}

/** Listens on an address; false with a record in the log. */
static bool start_listener(qm_listener *listener, qm_app *app, const char *name, double port,
                           unsigned connections)
{
    const qm_config *config = app->config;
    struct sockaddr_storage address;
    listener->app = app;
    qm_guard_init(&listener->guard, MS_PER_S * config->idle_timeout, config->min_upload_rate);
    /* One address leaves a fifth of the connections to others. */
    unsigned client_connections =
        config->client_connections > 0 ? (unsigned)config->client_connections : connections - connections / 5;
    unsigned flags = MHD_USE_EPOLL_INTERNAL_THREAD | MHD_ALLOW_SUSPEND_RESUME | MHD_USE_ERROR_LOG;
    if (make_address(name, port, &address)) {
        if (address.ss_family == AF_INET6) flags |= MHD_USE_IPv6;
        listener->daemon = MHD_start_daemon(
            flags, 0, on_accept, listener, on_request, listener, MHD_OPTION_EXTERNAL_LOGGER, on_library_log,
            listener, MHD_OPTION_SOCK_ADDR, (struct sockaddr *)&address, MHD_OPTION_THREAD_POOL_SIZE,
            (unsigned)(listener->is_private ? 0 : CONNECTION_THREADS), MHD_OPTION_CONNECTION_LIMIT,
            connections, MHD_OPTION_PER_IP_CONNECTION_LIMIT, client_connections,
            MHD_OPTION_CONNECTION_TIMEOUT, (unsigned)config->idle_timeout, MHD_OPTION_CONNECTION_MEMORY_LIMIT,
            (size_t)CONNECTION_MEMORY, MHD_OPTION_NOTIFY_CONNECTION, qm_guard_on_connection, &listener->guard,
            MHD_OPTION_NOTIFY_COMPLETED, on_completed, NULL, MHD_OPTION_END);
    }
    if (listener->daemon) return true;
    qm_log(QM_LOG_ERROR, "cannot listen on %s port %.0f", name, port);
    qm_guard_reset(&listener->guard);
    return false;
}

static void stop_listener(qm_listener *listener)
{
    if (!listener->daemon) return;
    MHD_stop_daemon(listener->daemon);
    qm_guard_reset(&listener->guard);
}

qm_http *qm_http_start(qm_app *app)
{
    qm_http *http = calloc(1, sizeof *http);
    if (!http) return NULL;
    http->app = app;
    app->http = http;
    const qm_config *config = app->config;
    http->health.is_private = true;
    if (!start_listener(&http->everything, app, config->listen, config->port,
                        (unsigned)config->connections) ||
        (config->health_port != 0 && !start_listener(&http->health, app, config->health_listen,
                                                     config->health_port, HEALTH_CONNECTIONS))) {
        app->http = NULL;
        stop_listener(&http->everything);
        free(http);
        return NULL;
    }
    http->port = MHD_get_daemon_info(http->everything.daemon, MHD_DAEMON_INFO_BIND_PORT)->port;
    return http;
}

int qm_http_port(const qm_http *http)
{
    return http->port;
}

size_t qm_http_count_connections(qm_http *http)
{
    return qm_guard_count(&http->everything.guard);
}

void qm_http_tick(qm_http *http, double now_ms)
{
    qm_guard_tick(&http->everything.guard, now_ms);
    if (http->health.daemon) qm_guard_tick(&http->health.guard, now_ms);
}

void qm_http_quiesce(qm_http *http)
{
    atomic_store(&http->everything.is_quiet, true);
}

void qm_http_stop(qm_http *http)
{
    if (!http) return;
    /* What is on its way out, the last lines of streams above all, may still arrive. */
    double end = qm_clock_now_ms() + LINGER_MS;
    while (atomic_load(&http->app->request_count) > 0 && qm_clock_now_ms() < end)
        usleep(1000);
    stop_listener(&http->everything);
    stop_listener(&http->health);
    free(http);
}
