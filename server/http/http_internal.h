/**
 * http_internal.h: what the files that see libmicrohttpd share: http.c (life of a request), http_request.c (what a
 * request has, and its checks before the body), http_reply.c (replies of whole bodies), http_reply_stream.c (replies
 * that are sent while they are made), http_guard.c (slow connections).
 */
#ifndef QM_HTTP_INTERNAL_H
#define QM_HTTP_INTERNAL_H

#include <arpa/inet.h>
#include <microhttpd.h>
#include <netinet/in.h>
#include <stdatomic.h>
#include <sys/socket.h>
#include <unistd.h>
#include <uv.h>

#include "route.h"

/* ---- connections that keep the daemon waiting (http_guard.c) ---- */

typedef enum qm_connection_stage {
    QM_CONNECTION_IDLE,
    QM_CONNECTION_RECEIVING,
    QM_CONNECTION_BUSY
} qm_connection_stage;

typedef struct qm_connection {
    MHD_socket socket;
    qm_connection_stage stage;
    double since_ms;        /* of the stage */
    atomic_size_t received; /* bytes of the body, while receiving */
    struct qm_connection *previous, *next;
} qm_connection;

/** lock guards the list and the stages. */
typedef struct qm_guard {
    uv_mutex_t lock;
    qm_connection *first;
    size_t count;
    double idle_ms;
    double least_rate; /* bytes a second; 0: any */
} qm_guard;

void qm_guard_init(qm_guard *guard, double idle_ms, double least_rate);
void qm_guard_reset(qm_guard *guard);

/** The library's hook for connections that come and go; cls is the guard. */
void qm_guard_on_connection(void *cls, struct MHD_Connection *connection, void **socket_context,
                            enum MHD_ConnectionNotificationCode code);

/** The guard's record of a connection; NULL when there was no memory for one. */
qm_connection *qm_guard_find(struct MHD_Connection *connection);

/** NULL is fine. */
void qm_guard_set_stage(qm_guard *guard, qm_connection *connection, qm_connection_stage stage);

size_t qm_guard_count(qm_guard *guard);

/** Ends the connections that are over time; called now and then. */
void qm_guard_tick(qm_guard *guard, double now_ms);

/* ---- requests and replies ---- */

#define QM_REQUEST_ID_SIZE 65

/** An address that is listened on. */
typedef struct qm_listener {
    qm_app *app;
    qm_guard guard;
    struct MHD_Daemon *daemon;
    atomic_bool is_quiet;             /* takes no connection any more */
    bool is_private;                  /* health and metrics only, without a token */
    atomic_uint_least64_t log_second; /* of the library's last message, and its messages in that second */
    atomic_uint log_count;
} qm_listener;

typedef struct qm_reply {
    int status;
    struct MHD_Response *response;
    int header_count;
    char header[QM_REPLY_HEADERS][2][256]; /* the first header_count are set */
} qm_reply;

/** A request from its first header to its end; belongs to its connection. */
struct qm_request {
    qm_app *app;
    qm_listener *listener;
    struct MHD_Connection *connection;
    qm_connection *guarded; /* the guard's record, or NULL */
    const qm_route *route;
    char name[QM_REQUEST_ID_SIZE]; /* the request's id in the log and the reply */
    const char *media;             /* the negotiated type */
    char ids[2][QM_HASH_SIZE];     /* of the path */
    char method[16], path[256];
    char client[QM_CLIENT_SIZE];     /* whose turn it is in a pool; "" until then */
    char token[QM_ACCESS_NAME_SIZE]; /* the name of its token in the log; "" without a valid one */
    char authority[256];             /* of a target in absolute form, which goes before Host; else "" */
    bool needs_host;                 /* as HTTP/1.1 does */
    double start_ms;
    qm_blob_writer *upload;
    qm_text body;
    size_t body_size, discarded; /* bytes received; bytes of these that were discarded */
    bool has_problem;
    enum { RECEIVING, HANDLING, WAITING, DONE } stage;
    qm_job *awaited; /* qm_reply_when_done */
    int status_before;
    struct qm_job_once *once; /* qm_reply_once */
    qm_subscriber subscriber; /* of either */
    qm_problem problem;       /* found before the body was received, sent after it; set with has_problem */
    qm_reply reply;
};

/** Queues a reply, as MHD_queue_response of the library does (http_library.c). */
enum MHD_Result qm_http_queue(struct MHD_Connection *connection, unsigned status,
                              struct MHD_Response *response);

/** The address of the client; "" when it is not known. */
void qm_request_address(const qm_request *request, char out[INET6_ADDRSTRLEN]);

/** True once the client of a suspended connection has closed it. */
bool qm_http_has_left(const qm_request *request);

/** The host that the request is for: "name:port" or "name"; NULL when it names none. */
const char *qm_request_host(const qm_request *request);

/** Finds the route and checks the headers; sets the problem. */
void qm_request_check(qm_request *request);

/** Sets the problem of the request; the first one stays. */
void qm_request_set_problem(qm_request *request, qm_problem problem);
size_t qm_request_body_limit(const qm_request *request);

/** Sends the reply that the handler has made. */
enum MHD_Result qm_reply_send(qm_request *request);

/** The reply to OPTIONS, for pages of other origins. */
void qm_reply_options(qm_request *request);

/** Makes the reply when the awaited job is over; else suspends the connection and returns false. */
bool qm_reply_check_awaited(qm_request *request);

/** The same for a job that is not stored. */
bool qm_reply_check_once(qm_request *request);

/** Ends such a job, whose client has left. */
void qm_reply_end_once(qm_request *request);

/** Makes the response of a whole body, which is malloc'ed and taken over. */
void qm_reply_set_buffer(qm_request *request, int status, char *body, size_t size);

/** Makes the response of a body that is read while it is sent; size may be MHD_SIZE_UNKNOWN. */
void qm_reply_set_reader(qm_request *request, int status, uint64_t size, size_t piece_size,
                         MHD_ContentReaderCallback read, void *user, MHD_ContentReaderFreeCallback end);

#endif
