/**
 * http.h: requests and replies as the handlers see them. libmicrohttpd is visible in http*.c only.
 */
#ifndef QM_HTTP_H
#define QM_HTTP_H

#include "access.h"
#include "base/config.h"
#include "base/pool.h"
#include "base/text.h"
#include "job/job.h"
#include "layout/reconstructions.h"
#include "ops/problem.h"

/**
 * Where a handler runs: on its connection's own thread, or with the connection suspended on one of the pools, each
 * with threads of its own, so that requests of one kind do not wait for those of another.
 */
typedef enum qm_lane {
    QM_LANE_AT_ONCE,  /* neither waits nor computes: the connection's thread */
    QM_LANE_SHORT,    /* waits for the disk */
    QM_LANE_QUERY,    /* answers a question about a mesh in memory */
    QM_LANE_EDIT,     /* moves vertices, edits layouts and reconstructions */
    QM_LANE_DOWNLOAD, /* encodes a mesh, at a lower priority */
    QM_LANE_DECODE,   /* decodes and prepares a mesh, at a lower priority */
    QM_LANE_COUNT
} qm_lane;

/** The parts of the daemon that a handler may use; created by main.c, alive as long as the daemon. */
typedef struct qm_app {
    const qm_config *config;
    qm_store *store;
    qm_store_node node; /* of a shared store */
    qm_meshes *meshes;
    qm_jobs *jobs;
    qm_reconstructions *reconstructions;
    qm_pool *pools[QM_LANE_COUNT]; /* NULL at QM_LANE_AT_ONCE */
    qm_tokens *tokens;             /* empty: every client may do everything */
    struct qm_http *http;
    atomic_bool draining;
    atomic_int stream_count, request_count; /* open now */
} qm_app;

typedef struct qm_request qm_request;

qm_app *qm_request_app(const qm_request *request);

/** Ends a computation of a handler before its end: when its client has left, at its deadline, or after the time that the daemon
 * allows a job (http_watch.c). */
typedef struct qm_http_watch {
    qm_request *request;
    double deadline_ms, end_ms;
    bool has_own_deadline; /* else the daemon's */
    atomic_bool cancel, looks;
    atomic_uint_least64_t next_look; /* ms of qm_clock_now_ms */
    _Atomic enum { QM_WATCH_NOTHING, QM_WATCH_LEFT, QM_WATCH_LATE } cause;
} qm_http_watch;

/** Sets the flags of a context until the end of the watch; deadline_ms counts from the start of the request, 0: none. */
void qm_http_watch_begin(qm_http_watch *watch, qm_request *request, double deadline_ms, qm_context *ctx);
/** Takes them back. False with a problem when the computation was ended. */
bool qm_http_watch_end(const qm_http_watch *watch, qm_context *ctx, qm_problem *problem);

/** The part of the path that stands for {id}; "" when the route has none. */
const char *qm_request_id(const qm_request *request);

/** The part that stands for a second name in braces; "" likewise. */
const char *qm_request_second_id(const qm_request *request);

/** True for GET and HEAD. */
bool qm_request_only_reads(const qm_request *request);

/** Whether Content-Encoding says that the body is compressed with gzip. */
bool qm_request_is_packed(const qm_request *request);

/** A header or query parameter, or NULL. Lives as long as the request. */
const char *qm_request_header(const qm_request *request, const char *name);
const char *qm_request_query(const qm_request *request, const char *name);

/** Who asks: a name made of the token when there is one, else of the address. */
void qm_request_client(const qm_request *request, char out[QM_CLIENT_SIZE]);

/** The media type that the client prefers among those of the route (media.h). */
#define QM_MEDIA_JSON "application/json"
#define QM_MEDIA_TEXT "text/plain"
#define QM_MEDIA_BINARY "application/octet-stream"
#define QM_MEDIA_CSV "text/csv"
#define QM_MEDIA_PLY "application/x-ply"
#define QM_MEDIA_NDJSON "application/x-ndjson"
#define QM_MEDIA_SSE "text/event-stream"
const char *qm_request_media(const qm_request *request);

/** Sets it to one that the route offers, which the query asks for. */
void qm_request_set_media(qm_request *request, const char *media);

/** The rows of that type; JSON for every other. */
qm_array_format qm_request_rows(const qm_request *request);

/** True when the client asks for the id of what it makes alone, and a reply with it, which a shell takes as it is. */
bool qm_request_wants_id(const qm_request *request);
void qm_reply_id(qm_request *request, int status, const char *id);

/** Reads a query parameter that is one of a NULL-ended list and writes its index; 0 when it is absent. False,
 * and a problem is the reply, for any other value. */
bool qm_request_choice(qm_request *request, const char *name, const char *const *choices, int *out);

/** The body of a route that keeps it in memory; never NULL. */
const char *qm_request_body(const qm_request *request, size_t *size);

/** Hands over the upload of a route that spools, complete. */
qm_blob_writer *qm_request_take_upload(qm_request *request);

/** Replies. A text is malloc'ed and taken over, NULL when memory ran out; a static body is not freed. */
void qm_reply_text(qm_request *request, int status, const char *content_type, char *body);
void qm_reply_static(qm_request *request, int status, const char *content_type, const char *body);
void qm_reply_problem(qm_request *request, const qm_problem *problem);
void qm_reply_empty(qm_request *request, int status);

/** Adds a header to the reply; the value is copied. At most QM_REPLY_HEADERS, more are a bug. */
#define QM_REPLY_HEADERS 12
void qm_reply_header(qm_request *request, const char *name, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/**
 * Replies with the stream of a job's events after seq; takes over the reference to the job. When owns_job is
 * set, the client owns the job (qm_job_submission) and its leaving may end it.
 */
void qm_reply_stream(qm_request *request, int status, qm_job *job, uint64_t after, qm_framing framing,
                     bool owns_job);

/** Replies with the answers of a batch of jobs as they end (job_batch.h); takes over the upload. */
void qm_reply_batch(qm_request *request, qm_blob_writer *upload);

/**
 * Replies with the job's document when it ends (200) or when the time is up (status_before); takes over the
 * reference.
 */
void qm_reply_when_done(qm_request *request, qm_job *job, double wait_ms, int status_before);

/**
 * Replies with the result of a job of two meshes that no store has, or with its problem; takes over the references and what the
 * job's request owns. A client that leaves cancels the job.
 */
void qm_reply_once(qm_request *request, qm_job_request *job, qm_mesh_ref *const mesh[2]);

/** State of a source of blocks after each one. */
typedef enum qm_block { QM_BLOCK_MORE, QM_BLOCK_LAST, QM_BLOCK_FAILED } qm_block;

/** Makes the body of a reply a block at a time. */
typedef struct qm_block_source {
    /** Adds bytes to the empty out, on the pool of its lane; QM_BLOCK_FAILED with the problem. */
    qm_block (*next)(void *user, qm_text *out, qm_problem *problem);
    void (*end)(void *user); /* called once, whether all was sent or not */
    void *user;
} qm_block_source;

/**
 * Replies with the blocks of a source, one in memory at a time. size is that of the whole body, or
 * QM_SIZE_UNKNOWN. A failure of the first block replies with its problem; a later one cuts the connection, so
 * that the client sees the end missing, and the problem goes to the log.
 */
#define QM_SIZE_UNKNOWN UINT64_MAX
void qm_reply_blocks(qm_request *request, int status, const char *content_type, uint64_t size,
                     qm_block_source source);

/** Serves until qm_http_stop. Returns NULL with a log line when the address cannot be used. */
typedef struct qm_http qm_http;
qm_http *qm_http_start(qm_app *app);
int qm_http_port(const qm_http *http);
size_t qm_http_count_connections(qm_http *http);

/** Ends the connections that keep the daemon waiting; called every second or so. */
void qm_http_tick(qm_http *http, double now_ms);

/** No new connections. */
void qm_http_quiesce(qm_http *http);

/**
 * Ends all connections, after a moment for the replies on their way. No request is suspended any more: every
 * job has ended or was interrupted, which woke its streams, and the pools are closed.
 */
void qm_http_stop(qm_http *http);

#endif
