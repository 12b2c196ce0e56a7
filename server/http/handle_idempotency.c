/**
 * handle_idempotency.c: requests with an Idempotency-Key, which make something once however often they come.
 */
#include <string.h>

#include "base/hash.h"
#include "handlers.h"

#define MAX_KEY_LENGTH 255

bool qm_read_idempotency_key(qm_request *request, const char **key)
{
    *key = qm_request_header(request, "Idempotency-Key");
    if (!*key || (**key && strlen(*key) <= MAX_KEY_LENGTH)) return true;
    qm_problem problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER,
                                         "Idempotency-Key has 1 to %d characters", MAX_KEY_LENGTH);
    qm_reply_problem(request, &problem);
    return false;
}

bool qm_read_idempotency(qm_request *request, qm_store_idempotency *out)
{
    size_t size;
    const char *body = qm_request_body(request, &size);
    *out = (qm_store_idempotency){0};
    if (!qm_read_idempotency_key(request, &out->key)) return false;
    if (out->key) qm_hash_text(body, size, out->request);
    return true;
}

qm_idempotency qm_find_idempotent(qm_request *request, const qm_store_idempotency *once,
                                  qm_find_idempotent_made *find, char id[QM_ID_SIZE])
{
    qm_store_idempotent made;
    qm_problem problem;
    qm_status status = once->key ? find(qm_request_app(request)->store, once->key, &made) : QM_E_EMPTY;
    if (status == QM_E_EMPTY) return QM_IDEMPOTENCY_NEW;
    if (status != QM_OK) {
        problem = qm_problem_from_store(status, QM_PROBLEM_INTERNAL, "requests of this key");
    } else if (strcmp(made.request, once->request) != 0) {
        problem = qm_problem_make(QM_PROBLEM_IDEMPOTENCY_MISMATCH,
                                  "this Idempotency-Key came with another request");
    } else {
        memcpy(id, made.id, QM_ID_SIZE);
        return QM_IDEMPOTENCY_MADE;
    }
    qm_reply_problem(request, &problem);
    return QM_IDEMPOTENCY_REFUSED;
}
