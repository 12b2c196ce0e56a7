/**
 * http_internal.h: what the files that see libmicrohttpd share: http.c (life of a request), http_checks.c
 * (before the body), http_request.c (replies), http_stream.c (replies that wait for jobs), http_blocks.c
 * (long replies).
 */
#ifndef QM_HTTP_INTERNAL_H
#define QM_HTTP_INTERNAL_H

#include <arpa/inet.h>
#include <microhttpd.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include "http_guard.h"
#include "route.h"

#define QM_REQUEST_ID_SIZE 65

/** An address that is listened on. */
typedef struct qm_listener {
    qm_app *app;
    qm_guard guard;
    struct MHD_Daemon *daemon;
    bool is_private; /* health and metrics only, without a token */
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
    char ids[2][QM_ID_SIZE];       /* of the path */
    char method[16], path[256];
    bool needs_host; /* as HTTP/1.1 does */
    double start_ms;
    qm_blob_writer *upload;
    qm_text body;
    size_t body_size, discarded; /* bytes received; bytes of these that were discarded */
    bool has_problem;
    enum { RECEIVING, HANDLING, WAITING, DONE } stage;
    qm_job *awaited; /* qm_reply_when_done */
    int status_before;
    qm_subscriber subscriber;
    qm_problem problem; /* found before the body was received, sent after it; set with has_problem */
    qm_reply reply;
};

/** Finds the route and checks the headers; sets the problem. */
void qm_request_check(qm_request *request);

/** Sets the problem of the request; the first one stays. */
void qm_request_set_problem(qm_request *request, qm_problem problem);
size_t qm_request_body_limit(const qm_request *request);

/** Sends the reply that the handler has made. */
enum MHD_Result qm_request_send_reply(qm_request *request);

/** Headers that let pages of other origins use the reply, when they may; an OPTIONS request is answered
 * here. */
void qm_request_add_cors(const qm_request *request, struct MHD_Response *response);
void qm_request_answer_options(qm_request *request);

/** Makes the reply when the awaited job is over; else suspends the connection and returns false. */
bool qm_request_check_awaited(qm_request *request);

/** Makes the response of a whole body, which is malloc'ed and taken over. */
void qm_request_set_buffer(qm_request *request, int status, char *body, size_t size);

/** Makes the response of a body that is read while it is sent; size may be MHD_SIZE_UNKNOWN. */
void qm_request_set_reader(qm_request *request, int status, uint64_t size, size_t piece_size,
                           MHD_ContentReaderCallback read, void *user, MHD_ContentReaderFreeCallback end);

/**
 * Every reply that is sent while it is made takes one of the --streams slots. take: false when all are in
 * use; refuse: replies with that problem.
 */
bool qm_request_take_stream_slot(qm_app *app);
void qm_request_return_stream_slot(qm_app *app);
void qm_request_refuse_stream_slot(qm_request *request);

/** Replies that out of memory for the reply. */
void qm_request_refuse_memory(qm_request *request);

#endif
