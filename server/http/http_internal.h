/**
 * http_internal.h: what http.c and http_stream.c share.
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
    bool is_private; /* health and metrics alone, for whoever reaches it */
} qm_listener;

typedef struct qm_reply {
    int status;
    struct MHD_Response *response;
    int header_count;
    char header[QM_REPLY_HEADERS][2][256]; /* so many of them are set */
} qm_reply;

/** A request from its first header to its end; belongs to its connection. */
struct qm_request {
    qm_app *app;
    qm_listener *listener;
    struct MHD_Connection *connection;
    qm_connection *guarded; /* the guard's record, or NULL */
    const qm_route *route;
    char name[QM_REQUEST_ID_SIZE]; /* what the request is called in the log and the reply */
    const char *media;             /* of the route's types, the chosen one */
    char ids[2][QM_ID_SIZE];       /* of the path */
    char method[16], path[256];
    bool needs_host; /* as HTTP/1.1 does */
    double start_ms;
    qm_blob_writer *upload;
    qm_text body;
    size_t body_size, thrown_away; /* bytes that have come; of these, bytes nobody needed */
    bool has_problem;
    enum { RECEIVING, HANDLING, WAITING, DONE } stage;
    qm_job *awaited; /* qm_reply_when_done */
    int status_before;
    qm_reader reader;
    qm_problem problem; /* found before the body had come: sent when it has. Set with has_problem */
    qm_reply reply;
};

/** Finds the route and everything that is wrong before the body has come: sets the problem then. */
void qm_request_check(qm_request *request);

/** Notes a problem, of which the first is sent. */
void qm_request_set_problem(qm_request *request, qm_problem problem);
size_t qm_request_body_limit(const qm_request *request);

/** Sends the reply that the handler has made. */
enum MHD_Result qm_request_send_reply(qm_request *request);

/** Headers that let pages of other origins use the reply, when they may; an OPTIONS request is answered
 * here. */
void qm_request_add_cors(const qm_request *request, struct MHD_Response *response);
void qm_request_answer_options(qm_request *request);

/** Looks whether the awaited job has ended; makes the reply, or goes to sleep and returns false. */
bool qm_request_check_awaited(qm_request *request);

/** Makes the response of a whole body, on malloc, which is given away. */
void qm_request_set_buffer(qm_request *request, int status, char *body, size_t size);

/** Makes the response of a body that is read while it is sent; size may be MHD_SIZE_UNKNOWN. */
void qm_request_set_reader(qm_request *request, int status, uint64_t size, size_t piece_size,
                           MHD_ContentReaderCallback read, void *user, MHD_ContentReaderFreeCallback end);

/**
 * Every reply that is sent while it comes about takes one of --streams places. take: false when all are
 * taken; refuse: replies so.
 */
bool qm_request_take_place(qm_app *app);
void qm_request_leave_place(qm_app *app);
void qm_request_refuse_place(qm_request *request);

/** Replies that there is no memory for the reply. */
void qm_request_refuse_memory(qm_request *request);

#endif
