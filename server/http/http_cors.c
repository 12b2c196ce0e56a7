/**
 * http_cors.c: replies to pages of other origins (WHATWG Fetch, CORS protocol). Off unless origins are named.
 */
#include <string.h>

#include "http_internal.h"
#include "origin.h"

#define MAX_AGE_S "600"

static const char allowed_headers[] =
    "Authorization, Content-Type, Accept, Prefer, Cache-Control, Idempotency-Key, If-Match, If-None-Match, "
    "Last-Event-ID, X-Request-Id";
static const char exposed_headers[] =
    "Location, ETag, Retry-After, Preference-Applied, X-Request-Id, Content-Disposition, Mesh-Displacement, "
    "Mesh-Quantization, Mesh-Cut-Faces, Mesh-Left-Out-Vertices";

void qm_request_add_cors(const qm_request *request, struct MHD_Response *response)
{
    const char *origins = request->app->config->cors_origins;
    const char *origin = qm_request_header(request, "Origin");
    if (!*origins) return;
    MHD_add_response_header(response, "Vary", "Origin");
    if (!origin || !qm_origin_is_listed(origins, origin)) return;
    MHD_add_response_header(response, "Access-Control-Allow-Origin", origin);
    MHD_add_response_header(response, "Access-Control-Expose-Headers", exposed_headers);
}

void qm_request_answer_options(qm_request *request)
{
    const char *origins = request->app->config->cors_origins;
    const char *origin = qm_request_header(request, "Origin");
    qm_reply_empty(request, 204);
    if (!*origins || !origin || !qm_origin_is_listed(origins, origin)) return;
    struct MHD_Response *response = request->reply.response;
    MHD_add_response_header(response, "Access-Control-Allow-Methods", "GET, HEAD, POST, PUT, PATCH, DELETE");
    MHD_add_response_header(response, "Access-Control-Allow-Headers", allowed_headers);
    MHD_add_response_header(response, "Access-Control-Max-Age", MAX_AGE_S);
}
