/**
 * http_library.c: errors of libmicrohttpd as problem documents. To a request that it does not hand over (its line is
 * malformed, its headers are too large) version 0.9.75 replies with a page of HTML, and has no option for another. It queues
 * that page by its public function, through the dynamic linker; so the definition here takes the place of the function, and
 * the daemon's own replies call the library's. If a later version queues its pages directly, they come as they are.
 */
#include <dlfcn.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "base/id.h"
#include "base/library.h"
#include "http_internal.h"
#include "ops/json_out.h"

typedef enum MHD_Result queue_fn(struct MHD_Connection *connection, unsigned status,
                                 struct MHD_Response *response);

static queue_fn *queue;

static void find_queue(void)
{
    qm_library_find(RTLD_NEXT, "MHD_queue_response", &queue);
}

enum MHD_Result qm_http_queue(struct MHD_Connection *connection, unsigned status,
                              struct MHD_Response *response)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, find_queue);
    return queue(connection, status, response);
}

/** The problem of each status that the library replies with. */
static const struct {
    unsigned status;
    qm_problem_code code;
    const char *detail;
} errors[] = {
    {400, QM_PROBLEM_MALFORMED_REQUEST, "the request line, a header or a chunk of the body is malformed"},
    {413, QM_PROBLEM_TOO_LARGE, "the body, or a chunk of it, is larger than any limit"},
    {414, QM_PROBLEM_URI_TOO_LONG, "the target of the request is too long"},
    {431, QM_PROBLEM_HEADERS_TOO_LARGE, "the headers of the request are too large"},
    {505, QM_PROBLEM_UNSUPPORTED_VERSION, "the version must be HTTP/1.0 or HTTP/1.1"},
};

static char *write_document(unsigned status)
{
    for (size_t i = 0; i < sizeof errors / sizeof *errors; i++) {
        if (errors[i].status != status) continue;
        qm_problem problem = qm_problem_make(errors[i].code, "%s", errors[i].detail);
        char id[QM_ID_SIZE];
        qm_text out = {0};
        qm_id_make('r', id);
        qm_text_add_string(&out, "{");
        qm_json_add_problem(&out, &problem);
        qm_text_printf(&out, ",\"instance\":\"urn:request:%s\"}", id);
        return qm_text_take(&out);
    }
    return NULL;
}

/** Called by the library alone. */
enum MHD_Result MHD_queue_response(struct MHD_Connection *connection, unsigned status,
                                   struct MHD_Response *page)
{
    char *document = write_document(status);
    if (!document) return qm_http_queue(connection, status, page);
    struct MHD_Response *response =
        MHD_create_response_from_buffer(strlen(document), document, MHD_RESPMEM_MUST_FREE);
    if (!response) {
        free(document);
        return qm_http_queue(connection, status, page);
    }
    MHD_add_response_header(response, MHD_HTTP_HEADER_CONTENT_TYPE, "application/problem+json");
    enum MHD_Result queued = qm_http_queue(connection, status, response);
    MHD_destroy_response(response);
    return queued;
}
