/**
 * problem.h: errors as RFC 9457 problem documents. One struct carries an error from where it occurs to the reply.
 */
#ifndef QM_PROBLEM_H
#define QM_PROBLEM_H

#include "base/text.h"
#include "format/codec.h"

/** Every code that a client can receive: XX(suffix, HTTP status, stable code, title). */
#define QM_PROBLEM_MAP(XX)                                                                                   \
    XX(MALFORMED_JSON, 400, "malformed_json", "The request body is not valid JSON")                          \
    XX(INVALID_FIELD, 400, "invalid_field", "A field of the request is not valid")                           \
    XX(INVALID_PARAMETER, 400, "invalid_parameter", "A query parameter or header is not valid")              \
    XX(AMBIGUOUS_LENGTH, 400, "ambiguous_length", "The request gives its length in two ways")                \
    XX(MALFORMED_BODY, 400, "malformed_body", "The request body does not have the required form")            \
    XX(MALFORMED_REQUEST, 400, "malformed_request", "The request does not follow HTTP")                      \
    XX(UNAUTHORIZED, 401, "unauthorized", "The request has no valid token")                                  \
    XX(FORBIDDEN, 403, "forbidden", "The request is not allowed to do this")                                 \
    XX(NOT_FOUND, 404, "not_found", "There is no such resource")                                             \
    XX(MESH_NOT_FOUND, 404, "mesh_not_found", "There is no such mesh")                                       \
    XX(JOB_NOT_FOUND, 404, "job_not_found", "There is no such job")                                          \
    XX(LAYOUT_NOT_FOUND, 404, "layout_not_found", "There is no such layout")                                 \
    XX(CURVE_NOT_FOUND, 404, "curve_not_found", "The layout has no such curve")                              \
    XX(NODE_NOT_FOUND, 404, "node_not_found", "The layout has no such node")                                 \
    XX(RECONSTRUCTION_NOT_FOUND, 404, "reconstruction_not_found", "There is no such reconstruction")         \
    XX(METHOD_NOT_ALLOWED, 405, "method_not_allowed", "The resource does not have this method")              \
    XX(NOT_ACCEPTABLE, 406, "not_acceptable", "No representation fits the Accept header")                    \
    XX(CONFLICT, 409, "conflict", "The state of the resource does not allow this")                           \
    XX(PRECONDITION_FAILED, 412, "precondition_failed", "The resource is not in the required state")         \
    XX(TOO_LARGE, 413, "too_large", "The input is larger than a limit allows")                               \
    XX(URI_TOO_LONG, 414, "uri_too_long", "The target of the request is too long")                           \
    XX(UNSUPPORTED_MEDIA_TYPE, 415, "unsupported_media_type", "The body has a type that is not supported")   \
    XX(MALFORMED_FILE, 422, "malformed_file", "The file does not follow its format")                         \
    XX(UNSUPPORTED_FEATURE, 422, "unsupported_feature", "The file or request uses an unsupported feature")   \
    XX(EMPTY_MESH, 422, "empty_mesh", "The mesh holds no surface and no point")                              \
    XX(NOT_FINITE, 422, "not_finite", "A coordinate is not a finite number")                                 \
    XX(INDEX_OUT_OF_RANGE, 422, "index_out_of_range", "An index names a vertex that does not exist")         \
    XX(SCALE_OUT_OF_RANGE, 422, "scale_out_of_range", "The sizes of the meshes differ beyond precision")     \
    XX(UNITS_DIFFER, 422, "units_differ", "The meshes of the job have different units")                      \
    XX(INVALID_LAYOUT, 422, "invalid_layout", "The layout does not bound patches of four sides")             \
    XX(NOT_CLOSED, 422, "not_closed", "The mesh does not bound a solid, so that it has no inside")           \
    XX(IDEMPOTENCY_MISMATCH, 422, "idempotency_mismatch", "The key was used for another request")            \
    XX(TOO_MANY_JOBS, 429, "too_many_jobs", "The queue of jobs is full")                                     \
    XX(HEADERS_TOO_LARGE, 431, "headers_too_large", "The headers of the request are too large")              \
    XX(BLOB_DAMAGED, 500, "blob_damaged", "The stored file of a mesh is damaged or missing")                 \
    XX(RECORD_DAMAGED, 500, "record_damaged", "The stored data of this resource is damaged or missing")      \
    XX(INTERNAL, 500, "internal", "The daemon failed to process the request")                                \
    XX(UNAVAILABLE, 503, "unavailable", "The daemon cannot process the request now")                         \
    XX(STORE_UNAVAILABLE, 503, "store_unavailable", "The database of the daemon does not answer")            \
    XX(DEADLINE_EXCEEDED, 504, "deadline_exceeded", "The time for the job was over before it had a result")  \
    XX(UNSUPPORTED_VERSION, 505, "unsupported_version", "The version of HTTP is not supported")              \
    XX(OUT_OF_MEMORY, 507, "out_of_memory", "There is not enough memory for this")                           \
    XX(STORAGE_FULL, 507, "storage_full", "There is not enough room in the data folder for this")

typedef enum qm_problem_code {
#define XX(suffix, status, code, title) QM_PROBLEM_##suffix,
    QM_PROBLEM_MAP(XX)
#undef XX
        QM_PROBLEM_COUNT
} qm_problem_code;

#define QM_PROBLEM_ERRORS 8

/** One error with its location: a JSON pointer, or a line (from 1) or byte offset (from 0) of a file. */
typedef struct qm_problem_error {
    char pointer[96];    /* "" if the location is not in JSON */
    size_t line, offset; /* QM_NO_LOCATION when absent */
    char detail[QM_CODEC_DETAIL_SIZE];
} qm_problem_error;

typedef struct qm_problem {
    qm_problem_code code;
    char detail[QM_CODEC_DETAIL_SIZE];
    qm_problem_error errors[QM_PROBLEM_ERRORS];
    size_t error_count;
    int retry_after_s; /* Retry-After, set by the code; 0: no header */
    char allow[64];    /* methods for a 405, else "" */
} qm_problem;

int qm_problem_status(qm_problem_code code);
const char *qm_problem_name(qm_problem_code code);
const char *qm_problem_title(qm_problem_code code);

/** The cause and the remedy, in sentences. */
const char *qm_problem_explanation(qm_problem_code code);

/** Finds a code by its name; false if there is none. */
bool qm_problem_find(const char *name, qm_problem_code *out);

/** A problem with a detail. Returned by value, so that a check reads: return qm_problem_make(...). */
qm_problem qm_problem_make(qm_problem_code code, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

/** Adds an error at a location of the request's JSON, e.g. "/tolerance"; dropped beyond QM_PROBLEM_ERRORS. */
void qm_problem_add_pointer(qm_problem *problem, const char *pointer, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/** Adds an error at a byte of a body or file. */
void qm_problem_add_offset(qm_problem *problem, size_t offset, const char *message);

/** Converts a status of the engine, with the context's message. */
qm_problem qm_problem_from_status(qm_status status, const char *message);

/** Converts the status of a failed write to a file of the store: of what, "the upload". */
qm_problem qm_problem_from_write(qm_status status, const char *noun);

/** Converts the report of a decoder, with the line or byte of the fault. */
qm_problem qm_problem_from_codec(qm_status status, const qm_codec_report *report);

#endif
