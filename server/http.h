/**
 * http.h: requests and replies as the handlers see them. Everything of libmicrohttpd stays in http.c and
 * http_stream.c.
 */
#ifndef QM_HTTP_H
#define QM_HTTP_H

#include "config.h"
#include "job.h"
#include "pool.h"
#include "problem.h"

/** What a handler may use; made by main.c, alive as long as the daemon. */
typedef struct qm_app {
    const qm_config *config;
    qm_store *store;
    qm_meshes *meshes;
    qm_jobs *jobs;
    qm_pool *pool; /* runs the handlers that may wait for the disk or decode */
    atomic_bool draining;
    atomic_int stream_count;
} qm_app;

typedef struct qm_request qm_request;

qm_app *qm_request_app(const qm_request *request);

/** The part of the path that stands for {id}; "" when the route has none. */
const char *qm_request_id(const qm_request *request);

/** A header or query parameter, or NULL. Lives as long as the request. */
const char *qm_request_header(const qm_request *request, const char *name);
const char *qm_request_query(const qm_request *request, const char *name);

/** True when the Accept header takes the type, as a whole, by its group or by anything; absent takes all. */
bool qm_request_accepts(const qm_request *request, const char *type);

/** The body of a route that keeps it in memory; never NULL. */
const char *qm_request_body(const qm_request *request, size_t *size);

/** Ends the upload of a route that spools: the blob is then stored under its hash. */
qm_status qm_request_finish_upload(qm_request *request, char hash[QM_HASH_SIZE], size_t *size);

/** A reply. body is malloc'ed and given away, or static. */
void qm_reply_text(qm_request *request, int status, const char *content_type, char *body);
void qm_reply_static(qm_request *request, int status, const char *content_type, const char *body);
void qm_reply_problem(qm_request *request, const qm_problem *problem);
void qm_reply_empty(qm_request *request, int status);

/** Adds a header to the reply; the value is copied. At most QM_REPLY_HEADERS, more are a bug. */
#define QM_REPLY_HEADERS 8
void qm_reply_header(qm_request *request, const char *name, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/**
 * Replies with the stream of a job's events after seq; takes over the reference to the job. When owns_job is
 * set and the client leaves before the end, the job is cancelled.
 */
void qm_reply_stream(qm_request *request, int status, qm_job *job, uint64_t after, qm_framing framing,
                     bool owns_job);

/**
 * Replies with the job's document when it ends (200) or when the time is up (202); takes over the reference.
 */
void qm_reply_when_done(qm_request *request, qm_job *job, double wait_ms);

/** Serves until qm_http_stop. Returns NULL with a log line when the address cannot be used. */
typedef struct qm_http qm_http;
qm_http *qm_http_start(qm_app *app);
int qm_http_port(const qm_http *http);

/** No new connections. */
void qm_http_quiesce(qm_http *http);

/** Ends all connections; every stream has been woken before, because its job has ended or was interrupted. */
void qm_http_stop(qm_http *http);

#endif
