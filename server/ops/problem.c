/**
 * problem.c: the table of problem codes, and conversions to problems.
 */
#include "problem.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

typedef struct problem_row {
    int status;
    const char *name, *title;
} problem_row;

static const problem_row rows[] = {
#define XX(suffix, status, code, title) {status, code, title},
    QM_PROBLEM_MAP(XX)
#undef XX
};

/** The texts of the pages at /problems/CODE: the cause, and the remedy. */
static const char *const explanations[QM_PROBLEM_COUNT] = {
    [QM_PROBLEM_MALFORMED_JSON] =
        "The body could not be read as JSON. The detail names the byte at which reading failed.",
    [QM_PROBLEM_INVALID_FIELD] =
        "A field is unknown, missing, given twice, or has a value that it cannot have. errors names each one "
        "by a JSON pointer. Fields that are not known are errors, so that a misspelt one is not ignored.",
    [QM_PROBLEM_INVALID_PARAMETER] = "A query parameter or a header is unknown, given twice, or has a value "
                                     "that it cannot have. The detail names it.",
    [QM_PROBLEM_AMBIGUOUS_LENGTH] =
        "Two readers of the request could see its end in two places. Send one Content-Length, or "
        "Transfer-Encoding: chunked, in plain lines. The connection is closed.",
    [QM_PROBLEM_MALFORMED_BODY] = "A body of numbers or lines has another length or form than its type says. "
                                  "The detail says which one is needed.",
    [QM_PROBLEM_UNAUTHORIZED] = "The daemon has tokens. Send one of them as Authorization: Bearer TOKEN.",
    [QM_PROBLEM_FORBIDDEN] =
        "The token only allows reading, or a page of another origin sent the request, or Host names another "
        "server. An operator can allow origins by --cors-origins and names by --hosts.",
    [QM_PROBLEM_NOT_FOUND] = "The path names nothing. /docs lists all paths.",
    [QM_PROBLEM_MESH_NOT_FOUND] = "No mesh has this id. It may have been deleted. GET /v1/meshes lists all.",
    [QM_PROBLEM_JOB_NOT_FOUND] = "No job has this id. Jobs that have ended are kept for a time and a number "
                                 "that the operator sets (--kept-jobs, --kept-hours).",
    [QM_PROBLEM_LAYOUT_NOT_FOUND] = "No layout has this id. GET /v1/layouts lists all.",
    [QM_PROBLEM_NODE_NOT_FOUND] = "Nodes are numbered from 0 in the order of nodes; an edit may have "
                                  "renumbered them. GET the layout again.",
    [QM_PROBLEM_CURVE_NOT_FOUND] =
        "The layout has no curve of this number. An edit may have removed or split it.",
    [QM_PROBLEM_RECONSTRUCTION_NOT_FOUND] =
        "No reconstruction has this id. GET /v1/reconstructions lists all.",
    [QM_PROBLEM_METHOD_NOT_ALLOWED] =
        "The path exists, but not with this method. The header Allow lists its methods.",
    [QM_PROBLEM_NOT_ACCEPTABLE] =
        "The resource exists in none of the media types that Accept names. The detail lists its types.",
    [QM_PROBLEM_CONFLICT] =
        "The resource is in a state that does not allow the request: for example a job that has ended "
        "already, or a reconstruction that another request is working on. Read it again and decide.",
    [QM_PROBLEM_PRECONDITION_FAILED] =
        "If-Match or If-None-Match did not hold: another client has changed the resource. Read it again, and "
        "repeat the request with its new ETag.",
    [QM_PROBLEM_TOO_LARGE] = "The body, the mesh or a count is above a limit of the daemon. GET /v1/info "
                             "lists the limits; an operator can raise them.",
    [QM_PROBLEM_UNSUPPORTED_MEDIA_TYPE] =
        "Content-Type or Content-Encoding names a type that this resource does not take.",
    [QM_PROBLEM_MALFORMED_FILE] =
        "The file breaks the rules of its format. The detail and errors name the line or the byte.",
    [QM_PROBLEM_UNSUPPORTED_FEATURE] =
        "The file is valid, but uses a part of its format that the daemon does not read; or the request asks "
        "for something that this mesh does not have. The detail names it.",
    [QM_PROBLEM_EMPTY_MESH] = "The file has neither faces nor points, or each face has lost its area.",
    [QM_PROBLEM_NOT_FINITE] =
        "A coordinate is infinite, not a number, or beyond the range that distances can be computed in.",
    [QM_PROBLEM_INDEX_OUT_OF_RANGE] =
        "A face names a vertex that the file does not have. The detail names the line or the byte.",
    [QM_PROBLEM_SCALE_OUT_OF_RANGE] = "One mesh is so much larger than the other, or so far away, that "
                                      "double precision proves nothing about their distance.",
    [QM_PROBLEM_UNITS_DIFFER] = "Both meshes have a unit, and not the same, so that a distance between them "
                                "would mean nothing. Scale one of them, or "
                                "correct the unit of the one that is wrong with PATCH.",
    [QM_PROBLEM_INVALID_LAYOUT] = "The curves do not bound patches with four sides each, or name nodes that "
                                  "do not exist. The detail names the curve or the patch.",
    [QM_PROBLEM_NOT_CLOSED] =
        "Only a mesh that is closed, consistently oriented and does not meet itself has an inside. The "
        "detail names "
        "an edge or a pair of faces that is in the way. A deviation from an open mesh has signs by \"sign\": "
        "\"normal\", which are not proven.",
    [QM_PROBLEM_IDEMPOTENCY_MISMATCH] =
        "This Idempotency-Key came with another request before. Use a new key for a new request.",
    [QM_PROBLEM_TOO_MANY_JOBS] =
        "The queue of jobs is full. Repeat the request after the time in Retry-After.",
    [QM_PROBLEM_INTERNAL] =
        "The daemon failed, and the request is not to blame. The log has more under the id in instance.",
    [QM_PROBLEM_BLOB_DAMAGED] =
        "The bytes of the file that the daemon has stored are not the bytes that were uploaded: a disk has "
        "changed or lost them. Upload the file again, which repairs the mesh under its old id. quadmeshd "
        "--check lists all damage.",
    [QM_PROBLEM_RECORD_DAMAGED] =
        "A part of the database or of a stored result does not have its checksum: a disk has changed or lost "
        "it. quadmeshd --check lists all damage, and quadmeshd --repair mends what can be.",
    [QM_PROBLEM_UNAVAILABLE] = "The daemon cannot do this now: it stops, its disk is full, or too many "
                               "streams are open. Repeat the request after the time in Retry-After.",
    [QM_PROBLEM_STORE_UNAVAILABLE] =
        "The database that the daemon shares with others, or the place of its blobs, cannot be reached, or "
        "did not say in time whether it has "
        "done this. Repeat the request after the time in Retry-After: with an "
        "Idempotency-Key or If-Match it has "
        "its effect once.",
    [QM_PROBLEM_DEADLINE_EXCEEDED] =
        "The time that the request (deadline_ms) or the operator (--max-job-seconds) allows a job was over "
        "before it had a result. Searches for bounds end with the bounds that they have instead.",
    [QM_PROBLEM_OUT_OF_MEMORY] = "The mesh or the search does not fit into the memory that the daemon may "
                                 "use. An operator can raise it by --memory-budget.",
    [QM_PROBLEM_MALFORMED_REQUEST] = "The bytes of the request break the rules of HTTP/1.1 (RFC 9112): its "
                                     "first line, a header or a chunk of "
                                     "its body is malformed. The connection is closed.",
    [QM_PROBLEM_URI_TOO_LONG] =
        "The path and the query of the request have more bytes than a connection has memory for.",
    [QM_PROBLEM_HEADERS_TOO_LARGE] =
        "The headers of the request have more bytes than a connection has memory for.",
    [QM_PROBLEM_UNSUPPORTED_VERSION] = "The daemon speaks HTTP/1.0 and HTTP/1.1.",
    [QM_PROBLEM_STORAGE_FULL] =
        "What is stored has reached the quota of the data folder, or would exceed it. Delete meshes and "
        "ended "
        "jobs that nobody needs, or let meshes expire by ttl_seconds; an operator can raise the quota by "
        "--max-data-bytes. Of a store that daemons share: the disk of its database, or of the place of its "
        "blobs, is full. "
        "Nothing that was stored is lost.",
};

int qm_problem_status(qm_problem_code code)
{
    QM_ASSERT(code < QM_PROBLEM_COUNT);
    return rows[code].status;
}

const char *qm_problem_name(qm_problem_code code)
{
    return rows[code].name;
}

const char *qm_problem_title(qm_problem_code code)
{
    return rows[code].title;
}

const char *qm_problem_explanation(qm_problem_code code)
{
    QM_ASSERT(code < QM_PROBLEM_COUNT && explanations[code]);
    return explanations[code];
}

bool qm_problem_find(const char *name, qm_problem_code *out)
{
    for (int code = 0; code < QM_PROBLEM_COUNT; code++) {
        if (strcmp(rows[code].name, name) != 0) continue;
        *out = (qm_problem_code)code;
        return true;
    }
    return false;
}

/** Conditions that pass may be retried: a full queue soon, a database after its restart, a daemon after its own. */
static int retry_after(qm_problem_code code)
{
    return code == QM_PROBLEM_TOO_MANY_JOBS       ? 1
           : code == QM_PROBLEM_STORE_UNAVAILABLE ? 2
           : code == QM_PROBLEM_UNAVAILABLE       ? 5
                                                  : 0;
}

qm_problem qm_problem_make(qm_problem_code code, const char *format, ...)
{
    qm_problem problem = {.code = code, .retry_after_s = retry_after(code)};
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(problem.detail, sizeof problem.detail, format, arguments);
    va_end(arguments);
    return problem;
}

void qm_problem_add_pointer(qm_problem *problem, const char *pointer, const char *format, ...)
{
    if (problem->error_count == QM_PROBLEM_ERRORS) return;
    qm_problem_error *error = &problem->errors[problem->error_count++];
    *error = (qm_problem_error){.line = QM_NO_LOCATION, .offset = QM_NO_LOCATION};
    snprintf(error->pointer, sizeof error->pointer, "%s", pointer);
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(error->detail, sizeof error->detail, format, arguments);
    va_end(arguments);
}

void qm_problem_add_offset(qm_problem *problem, size_t offset, const char *message)
{
    if (problem->error_count == QM_PROBLEM_ERRORS) return;
    qm_problem_error *error = &problem->errors[problem->error_count++];
    *error = (qm_problem_error){.line = QM_NO_LOCATION, .offset = offset};
    snprintf(error->detail, sizeof error->detail, "%s", message);
}

qm_problem qm_problem_from_write(qm_status status, const char *noun)
{
    if (status == QM_E_TOO_LARGE)
        return qm_problem_make(QM_PROBLEM_STORAGE_FULL, "the data folder has no room for %s", noun);
    if (status == QM_E_NO_MEMORY)
        return qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for %s", noun);
    return qm_problem_make(QM_PROBLEM_UNAVAILABLE, "%s could not be stored", noun);
}

/** The problem code of each status of the engine. */
static const qm_problem_code code_of_status[] = {
    [QM_OK] = QM_PROBLEM_INTERNAL,
    [QM_E_ARGUMENT] = QM_PROBLEM_INVALID_FIELD,
    [QM_E_NO_MEMORY] = QM_PROBLEM_OUT_OF_MEMORY,
    [QM_E_CANCELED] = QM_PROBLEM_CONFLICT,
    [QM_E_NOT_FINITE] = QM_PROBLEM_NOT_FINITE,
    [QM_E_EMPTY] = QM_PROBLEM_EMPTY_MESH,
    [QM_E_INDEX] = QM_PROBLEM_INDEX_OUT_OF_RANGE,
    [QM_E_FORMAT] = QM_PROBLEM_MALFORMED_FILE,
    [QM_E_UNSUPPORTED] = QM_PROBLEM_UNSUPPORTED_FEATURE,
    [QM_E_TOO_LARGE] = QM_PROBLEM_TOO_LARGE,
    [QM_E_SCALE] = QM_PROBLEM_SCALE_OUT_OF_RANGE,
    [QM_E_LAYOUT] = QM_PROBLEM_INVALID_LAYOUT,
    [QM_E_NOT_CLOSED] = QM_PROBLEM_NOT_CLOSED,
};
_Static_assert(sizeof code_of_status / sizeof code_of_status[0] == QM_STATUS_COUNT,
               "a status has no problem code");

qm_problem qm_problem_from_status(qm_status status, const char *message)
{
    QM_ASSERT(status < QM_STATUS_COUNT);
    return qm_problem_make(code_of_status[status], "%s", message[0] ? message : qm_status_text(status));
}

qm_problem qm_problem_from_codec(qm_status status, const qm_codec_report *report)
{
    qm_problem problem = qm_problem_from_status(status, report->detail);
    if (report->line == QM_NO_LOCATION && report->offset == QM_NO_LOCATION) return problem;
    problem.error_count = 1;
    problem.errors[0] = (qm_problem_error){.line = report->line, .offset = report->offset};
    snprintf(problem.errors[0].detail, sizeof problem.errors[0].detail, "%s", problem.detail);
    return problem;
}
