/**
 * handle_batches.c: POST /v1/batches: lines of jobs in, lines of answers out.
 *
 * The library cannot answer before the whole body has come, so the lines wait in a file.
 */
#include "handlers.h"
#include "media.h"

/** curl says form data when it is not told otherwise. */
static bool is_lines(const char *type)
{
    return !type || qm_media_is(type, QM_MEDIA_NDJSON) || qm_media_is(type, QM_MEDIA_BINARY) ||
           qm_media_is(type, "application/x-www-form-urlencoded");
}

void qm_handle_batch_create(qm_request *request)
{
    qm_problem problem;
    if (atomic_load(&qm_request_app(request)->draining)) {
        problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the daemon is stopping and takes no new jobs");
        qm_reply_problem(request, &problem);
        return;
    }
    if (is_lines(qm_request_header(request, "Content-Type"))) {
        qm_reply_batch(request, qm_request_take_upload(request));
        return;
    }
    problem = qm_problem_make(QM_PROBLEM_UNSUPPORTED_MEDIA_TYPE,
                              "a batch is lines of JSON in application/x-ndjson");
    qm_reply_problem(request, &problem);
}
