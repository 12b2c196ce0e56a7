/**
 * http_reply.c: replies of whole bodies, their headers, and the headers for pages of other origins (WHATWG Fetch, CORS
 * protocol), which are off unless origins are named.
 */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "access.h"
#include "http_internal.h"
#include "ops/json_out.h"

#define MAX_AGE_S "600"

static const char allowed_headers[] =
    "Authorization, Content-Type, Accept, Prefer, Cache-Control, Idempotency-Key, If-Match, If-None-Match, "
    "Last-Event-ID, X-Request-Id";
static const char exposed_headers[] =
    "Location, ETag, Retry-After, Preference-Applied, X-Request-Id, Content-Disposition, Mesh-Displacement, "
    "Mesh-Quantization, Mesh-Cut-Faces, Mesh-Left-Out-Vertices";

static void set_reply(qm_request *request, int status, const char *content_type, void *body, size_t size,
                      enum MHD_ResponseMemoryMode mode)
{
    request->reply.status = status;
    request->reply.response = MHD_create_response_from_buffer(size, body, mode);
    /* Without a response the connection is closed. */
    if (!request->reply.response && mode == MHD_RESPMEM_MUST_FREE) free(body);
    if (content_type) qm_reply_header(request, "Content-Type", "%s", content_type);
}

void qm_reply_set_buffer(qm_request *request, int status, char *body, size_t size)
{
    set_reply(request, status, NULL, body, size, MHD_RESPMEM_MUST_FREE);
}

void qm_reply_text(qm_request *request, int status, const char *content_type, char *body)
{
    if (body) {
        set_reply(request, status, content_type, body, strlen(body), MHD_RESPMEM_MUST_FREE);
        return;
    }
    qm_problem problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the reply");
    qm_reply_problem(request, &problem);
}

void qm_reply_id(qm_request *request, int status, const char *id)
{
    qm_text text = {0};
    qm_text_printf(&text, "%s\n", id);
    qm_reply_text(request, status, QM_MEDIA_TEXT, qm_text_take(&text));
}

void qm_reply_static(qm_request *request, int status, const char *content_type, const char *body)
{
    set_reply(request, status, content_type, (void *)(uintptr_t)body, strlen(body), MHD_RESPMEM_PERSISTENT);
}

void qm_reply_empty(qm_request *request, int status)
{
    set_reply(request, status, NULL, (void *)(uintptr_t) "", 0, MHD_RESPMEM_PERSISTENT);
}

void qm_reply_set_reader(qm_request *request, int status, uint64_t size, size_t piece_size,
                         MHD_ContentReaderCallback read, void *user, MHD_ContentReaderFreeCallback end)
{
    request->reply.status = status;
    request->reply.response = MHD_create_response_from_callback(size, piece_size, read, user, end);
    if (!request->reply.response) {
        end(user);
        return;
    }
    /* libmicrohttpd 0.9.75 ends a chunked reply to HEAD with a last chunk, which the client takes for the
     * start of the next reply. */
    if (strcmp(request->method, "HEAD") == 0 && size == MHD_SIZE_UNKNOWN)
        MHD_set_response_options(request->reply.response, MHD_RF_HTTP_1_0_COMPATIBLE_STRICT, MHD_RO_END);
}

void qm_reply_problem(qm_request *request, const qm_problem *problem)
{
    static const char fallback[] = "{\"type\":\"about:blank\",\"title\":\"Out of memory\",\"status\":507}";
    qm_text text = {0};
    qm_text_add_string(&text, "{");
    qm_json_add_problem(&text, problem);
    qm_text_printf(&text, ",\"instance\":\"urn:request:%s\"}", request->name);
    char *body = qm_text_take(&text);
    /* A tag that the handler has set before it failed is not that of the problem. */
    qm_reply *reply = &request->reply;
    int kept = 0;
    for (int i = 0; i < reply->header_count; i++)
        if (strcmp(reply->header[i][0], "ETag") != 0)
            memmove(reply->header[kept++], reply->header[i], sizeof reply->header[i]);
    reply->header_count = kept;
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

/* ---- sending, and pages of other origins ---- */

/** Headers that let pages of other origins use the reply, if they may. */
static void add_cors(const qm_request *request, struct MHD_Response *response)
{
    const char *origins = request->app->config->cors_origins;
    const char *origin = qm_request_header(request, "Origin");
    if (!*origins) return;
    MHD_add_response_header(response, "Vary", "Origin");
    if (!origin || !qm_access_origin_is_listed(origins, origin)) return;
    MHD_add_response_header(response, "Access-Control-Allow-Origin", origin);
    MHD_add_response_header(response, "Access-Control-Expose-Headers", exposed_headers);
}

enum MHD_Result qm_reply_send(qm_request *request)
{
    qm_reply *reply = &request->reply;
    if (!reply->response) return MHD_NO;
    for (int i = 0; i < reply->header_count; i++)
        MHD_add_response_header(reply->response, reply->header[i][0], reply->header[i][1]);
    MHD_add_response_header(reply->response, "X-Content-Type-Options", "nosniff");
    MHD_add_response_header(reply->response, "X-Request-Id", request->name);
    add_cors(request, reply->response);
    enum MHD_Result result = qm_http_queue(request->connection, (unsigned)reply->status, reply->response);
    MHD_destroy_response(reply->response);
    reply->response = NULL;
    request->stage = DONE;
    return result;
}

void qm_reply_options(qm_request *request)
{
    const char *origins = request->app->config->cors_origins;
    const char *origin = qm_request_header(request, "Origin");
    qm_reply_empty(request, 204);
    if (!*origins || !origin || !qm_access_origin_is_listed(origins, origin)) return;
    struct MHD_Response *response = request->reply.response;
    MHD_add_response_header(response, "Access-Control-Allow-Methods", "GET, HEAD, POST, PUT, PATCH, DELETE");
    MHD_add_response_header(response, "Access-Control-Allow-Headers", allowed_headers);
    MHD_add_response_header(response, "Access-Control-Max-Age", MAX_AGE_S);
}
