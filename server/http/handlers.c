/**
 * handlers.c: what several handlers need: the mesh of the path with its entity tag, idempotency records, and
 * pages of lists.
 */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/id.h"
#include "handlers.h"
#include "mesh/etag.h"
#include "store/store_problem.h"

#define MAX_KEY_LENGTH 255
#define DEFAULT_LIMIT 100
#define MAX_LIMIT 1000

/* ---- the mesh of the path ---- */

bool qm_handlers_find_mesh(qm_request *request, qm_store_mesh *out)
{
    const char *id = qm_request_id(request);
    qm_stored stored = qm_store_find_mesh(qm_request_app(request)->store, id, out);
    if (stored == QM_STORED) return true;
    qm_problem problem = qm_store_read_problem(stored, QM_PROBLEM_MESH_NOT_FOUND, "mesh %s", id);
    qm_reply_problem(request, &problem);
    return false;
}

/** True when the client has this representation. */
static bool is_known(const qm_request *request, const char *tag)
{
    return qm_request_only_reads(request) &&
           qm_etag_is_listed(qm_request_header(request, "If-None-Match"), tag, true);
}

static bool check_tag(qm_request *request, const char *tag)
{
    const char *wanted = qm_request_header(request, "If-Match");
    if (wanted && !qm_etag_is_listed(wanted, tag, false)) {
        qm_problem problem = qm_problem_make(QM_PROBLEM_PRECONDITION_FAILED,
                                             "If-Match does not match the current revision of the mesh");
        qm_reply_problem(request, &problem);
        return false;
    }
    qm_reply_header(request, "ETag", "%s", tag);
    if (!is_known(request, tag)) return true;
    qm_reply_empty(request, 304);
    return false;
}

bool qm_handlers_check_mesh_tag(qm_request *request, const qm_store_mesh *mesh)
{
    char tag[QM_ETAG_SIZE];
    qm_etag_write_mesh(mesh->hash, mesh->revision, "", tag);
    return check_tag(request, tag);
}

qm_mesh_ref *qm_handlers_take_mesh(qm_request *request, const char *suffix)
{
    qm_meshes *meshes = qm_request_app(request)->meshes;
    qm_store_mesh row;
    qm_problem problem;
    qm_mesh_ref *mesh = NULL;
    char tag[QM_ETAG_SIZE];
    if (!qm_handlers_find_mesh(request, &row)) return NULL;
    qm_etag_write_mesh(row.hash, row.revision, suffix, tag);
    /* A client that has the revision gets its 304 without reading the mesh. Another thread may make a new
     * revision after the row was read: the tag that is sent is that of the acquired one. */
    bool known = is_known(request, tag);
    if (!known && (mesh = qm_meshes_acquire(meshes, qm_request_id(request), &problem)))
        qm_etag_write_mesh(row.hash, qm_mesh_ref_get(mesh)->revision, suffix, tag);
    qm_store_mesh_reset(&row);
    if (!known && !mesh) {
        qm_reply_problem(request, &problem);
        return NULL;
    }
    if (check_tag(request, tag)) return mesh;
    qm_meshes_release(meshes, mesh);
    return NULL;
}

/* ---- idempotency ---- */

bool qm_handlers_read_idempotency_key(qm_request *request, const char **key)
{
    *key = qm_request_header(request, "Idempotency-Key");
    if (!*key || (**key && strlen(*key) <= MAX_KEY_LENGTH)) return true;
    qm_problem problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER,
                                         "Idempotency-Key must have 1 to %d characters", MAX_KEY_LENGTH);
    qm_reply_problem(request, &problem);
    return false;
}

bool qm_handlers_read_idempotency(qm_request *request, qm_store_idempotency *out)
{
    size_t size;
    const char *body = qm_request_body(request, &size);
    *out = (qm_store_idempotency){0};
    if (!qm_handlers_read_idempotency_key(request, &out->key)) return false;
    if (out->key) qm_id_hash_text(body, size, out->request);
    return true;
}

qm_idempotency qm_handlers_check_idempotency(qm_request *request, const qm_store_idempotency *idempotency,
                                             qm_find_idempotency_record *find, char id[QM_ID_SIZE])
{
    qm_store_idempotency_record made;
    qm_problem problem;
    qm_stored stored =
        idempotency->key ? find(qm_request_app(request)->store, idempotency->key, &made) : QM_STORED_NONE;
    if (stored == QM_STORED_NONE) return QM_IDEMPOTENCY_NEW;
    if (stored != QM_STORED) {
        problem =
            qm_store_read_problem(stored, QM_PROBLEM_INTERNAL, "the requests with this Idempotency-Key");
    } else if (strcmp(made.request, idempotency->request) != 0) {
        problem = qm_problem_make(QM_PROBLEM_IDEMPOTENCY_MISMATCH,
                                  "the Idempotency-Key was used for a different request");
    } else {
        memcpy(id, made.id, QM_ID_SIZE);
        return QM_IDEMPOTENCY_MADE;
    }
    qm_reply_problem(request, &problem);
    return QM_IDEMPOTENCY_REFUSED;
}

/* ---- pages ---- */

static bool refuse_parameter(qm_request *request, qm_problem problem)
{
    qm_reply_problem(request, &problem);
    return false;
}

bool qm_handlers_read_format(qm_request *request, qm_format *out)
{
    const char *name = qm_request_query(request, "format");
    *out = name ? qm_format_from_name(name) : QM_FORMAT_UNKNOWN;
    if (!name || *out != QM_FORMAT_UNKNOWN) return true;
    return refuse_parameter(
        request, qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "`format` must be one of" QM_FORMAT_NAMES));
}

bool qm_handlers_read_paging(qm_request *request, qm_store_page *out)
{
    const char *limit = qm_request_query(request, "limit"), *cursor = qm_request_query(request, "cursor"),
               *order = qm_request_query(request, "order");
    char *end;
    *out = (qm_store_page){.limit = DEFAULT_LIMIT};
    if (limit) {
        long value = strtol(limit, &end, 10);
        if (end == limit || *end || value < 1 || value > MAX_LIMIT)
            return refuse_parameter(request,
                                    qm_problem_make(QM_PROBLEM_INVALID_PARAMETER,
                                                    "`limit` must be an integer from 1 to %d", MAX_LIMIT));
        out->limit = (size_t)value;
    }
    if (cursor) {
        errno = 0;
        long long value = strtoll(cursor, &end, 10);
        if (end == cursor || *end || value < 0 || errno)
            return refuse_parameter(
                request, qm_problem_make(QM_PROBLEM_INVALID_PARAMETER,
                                         "`cursor` must be the `next` of an earlier page of this list"));
        out->after = value;
    }
    if (order) {
        out->newest_first = strcmp(order, "newest") == 0;
        if (!out->newest_first && strcmp(order, "oldest") != 0)
            return refuse_parameter(
                request, qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "`order` must be oldest or newest"));
    }
    return true;
}

void qm_handlers_end_page(qm_text *out, int64_t next)
{
    if (next > 0)
        qm_text_printf(out, "],\"next\":\"%lld\"}", (long long)next);
    else
        qm_text_add_string(out, "],\"next\":null}");
}

bool qm_handlers_read_deadline(qm_request *request, double *deadline_ms)
{
    const char *text = qm_request_query(request, "deadline_ms");
    char *end;
    *deadline_ms = 0.0;
    if (!text) return true;
    *deadline_ms = strtod(text, &end);
    if (end != text && !*end && isfinite(*deadline_ms) && *deadline_ms > 0.0) return true;
    return refuse_parameter(
        request, qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "`deadline_ms` must be a number above 0"));
}
