/**
 * http_request.c: what handlers ask of a request, and the checks of a request before its body is received: framing,
 * route, access, parameters, length.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "access.h"
#include "base/metrics.h"
#include "http_internal.h"
#include "media.h"

#define MAX_JSON_BODY (1u << 20)

qm_app *qm_request_app(const qm_request *request)
{
    return request->app;
}

const char *qm_request_id(const qm_request *request)
{
    return request->ids[0];
}

const char *qm_request_second_id(const qm_request *request)
{
    return request->ids[1];
}

bool qm_request_only_reads(const qm_request *request)
{
    return strcmp(request->route->method, "GET") == 0;
}

const char *qm_request_header(const qm_request *request, const char *name)
{
    return MHD_lookup_connection_value(request->connection, MHD_HEADER_KIND, name);
}

const char *qm_request_host(const qm_request *request)
{
    return request->authority[0] ? request->authority : qm_request_header(request, "Host");
}

const char *qm_request_query(const qm_request *request, const char *name)
{
    return MHD_lookup_connection_value(request->connection, MHD_GET_ARGUMENT_KIND, name);
}

bool qm_request_choice(qm_request *request, const char *name, const char *const *choices, int *out)
{
    const char *given = qm_request_query(request, name);
    *out = 0;
    if (!given) return true;
    for (; choices[*out]; (*out)++)
        if (strcmp(given, choices[*out]) == 0) return true;
    qm_problem problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "`%s` must be %s", name, choices[0]);
    for (int i = 1; choices[i]; i++) {
        size_t used = strlen(problem.detail);
        snprintf(problem.detail + used, sizeof problem.detail - used, " or %s", choices[i]);
    }
    qm_reply_problem(request, &problem);
    return false;
}

void qm_request_client(const qm_request *request, char out[QM_CLIENT_SIZE])
{
    const char *given = qm_request_header(request, "Authorization");
    char hash[QM_HASH_SIZE];
    if (given && qm_access_tokens_are_needed(request->app->tokens)) {
        qm_id_hash_text(given, strlen(given), hash);
        snprintf(out, QM_CLIENT_SIZE, "token %.32s", hash);
        return;
    }
    char address[INET6_ADDRSTRLEN];
    qm_request_address(request, address);
    snprintf(out, QM_CLIENT_SIZE, "%s", address);
}

void qm_request_address(const qm_request *request, char out[INET6_ADDRSTRLEN])
{
    const union MHD_ConnectionInfo *info =
        MHD_get_connection_info(request->connection, MHD_CONNECTION_INFO_CLIENT_ADDRESS);
    out[0] = '\0';
    if (!info || !info->client_addr) return;
    bool is_6 = info->client_addr->sa_family == AF_INET6;
    const void *bytes = is_6 ? (const void *)&((const struct sockaddr_in6 *)info->client_addr)->sin6_addr
                             : (const void *)&((const struct sockaddr_in *)info->client_addr)->sin_addr;
    inet_ntop(is_6 ? AF_INET6 : AF_INET, bytes, out, INET6_ADDRSTRLEN);
}

const char *qm_request_media(const qm_request *request)
{
    return request->media;
}

void qm_request_set_media(qm_request *request, const char *media)
{
    request->media = media;
}

qm_array_format qm_request_rows(const qm_request *request)
{
    if (strcmp(request->media, QM_MEDIA_BINARY) == 0) return QM_ARRAY_BINARY;
    return strcmp(request->media, QM_MEDIA_CSV) == 0 ? QM_ARRAY_CSV : QM_ARRAY_JSON;
}

bool qm_request_wants_id(const qm_request *request)
{
    return request->media && strcmp(request->media, QM_MEDIA_TEXT) == 0; /* a DELETE has none */
}

const char *qm_request_body(const qm_request *request, size_t *size)
{
    *size = request->body.size;
    return request->body.data ? request->body.data : "";
}

qm_blob_writer *qm_request_take_upload(qm_request *request)
{
    qm_blob_writer *upload = request->upload;
    request->upload = NULL;
    return upload;
}

/* ---- checks ---- */

void qm_request_set_problem(qm_request *request, qm_problem problem)
{
    if (request->has_problem) return;
    request->problem = problem;
    request->has_problem = true;
}

size_t qm_request_body_limit(const qm_request *request)
{
    return request->route->body >= QM_BODY_SPOOL ? (size_t)request->app->config->max_body : MAX_JSON_BODY;
}

/** Counts of the headers that frame a request, and of Host; the first fault, or NULL. */
typedef struct header_check {
    int lengths, codings, hosts;
    const char *fault;
} header_check;

/** True for a token (RFC 9110, section 5.6.2). */
static bool is_token(const char *text, size_t size)
{
    static const char letters[] =
        "!#$%&'*+-.^_`|~0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ";
    return size > 0 && strspn(text, letters) == size;
}

static bool has_prefix(const char *text, const char *prefix)
{
    return strncasecmp(text, prefix, strlen(prefix)) == 0;
}

/**
 * Checks a header as the library has read it. Version 0.9.75 takes a blank before the colon for a part of the name,
 * appends a folded line (obs-fold, RFC 9112, section 5.2) to the name of the header before it, and ends a value at a
 * NUL, behind which the bytes that were received still stand: two NULs have replaced a line's CR and LF.
 */
static enum MHD_Result check_header(void *user, enum MHD_ValueKind kind, const char *name, size_t name_size,
                                    const char *value, size_t value_size)
{
    (void)kind;
    static const char length[] = "Content-Length", coding[] = "Transfer-Encoding";
    header_check *check = user;
    bool is_length = strcasecmp(name, length) == 0, is_coding = strcasecmp(name, coding) == 0;
    check->lengths += is_length;
    check->codings += is_coding;
    check->hosts += strcasecmp(name, "Host") == 0;
    if (!is_token(name, name_size))
        check->fault = "the name of a header must be a token";
    else if ((has_prefix(name, length) && !is_length) || (has_prefix(name, coding) && !is_coding))
        check->fault = "a header must not be folded over several lines";
    else if (value && memchr(value, '\r', value_size))
        check->fault = "the value of a header must not have a carriage return";
    else if ((is_length || is_coding) && value &&
             (strlen(value) != value_size || value[value_size + 1] != '\0'))
        check->fault = "the line of a header must end with CR and LF, and have no NUL";
    return check->fault ? MHD_NO : MHD_YES;
}

/** Headers that two readers may read in two ways, two lengths, a coding other than chunked, or two hosts can smuggle a
 * request past a proxy. */
static bool check_framing(qm_request *request)
{
    header_check found = {0};
    MHD_get_connection_values_n(request->connection, MHD_HEADER_KIND, check_header, &found);
    const char *coding = qm_request_header(request, "Transfer-Encoding");
    if (found.fault)
        qm_request_set_problem(request, qm_problem_make(QM_PROBLEM_AMBIGUOUS_LENGTH, "%s", found.fault));
    else if (found.lengths + found.codings > 1)
        qm_request_set_problem(request,
                               qm_problem_make(QM_PROBLEM_AMBIGUOUS_LENGTH,
                                               "the request must have at most one of Content-Length and "
                                               "Transfer-Encoding"));
    else if (coding && strcasecmp(coding, "chunked") != 0)
        qm_request_set_problem(request, qm_problem_make(QM_PROBLEM_AMBIGUOUS_LENGTH,
                                                        "the only supported Transfer-Encoding is chunked"));
    else if (found.hosts > 1 || (found.hosts == 0 && request->needs_host))
        qm_request_set_problem(request, qm_problem_make(QM_PROBLEM_INVALID_PARAMETER,
                                                        "the request must have exactly one Host header"));
    return !request->has_problem;
}

static void check_accept(qm_request *request)
{
    const char *const *offers = request->route->produces;
    if (!offers) return;
    if (offers[1]) qm_reply_header(request, "Vary", "Accept");
    int chosen = qm_media_choose(qm_request_header(request, "Accept"), offers);
    if (chosen >= 0) {
        request->media = offers[chosen];
        return;
    }
    qm_problem problem =
        qm_problem_make(QM_PROBLEM_NOT_ACCEPTABLE, "this resource is available as %s", offers[0]);
    for (size_t i = 1; offers[i]; i++) {
        size_t used = strlen(problem.detail);
        snprintf(problem.detail + used, sizeof problem.detail - used, " or %s", offers[i]);
    }
    qm_request_set_problem(request, problem);
}

/** A search of the query for unknown and repeated parameters. */
typedef struct query_check {
    const char *const *known;
    unsigned seen; /* a bit for each of these */
    const char *name, *fault;
} query_check;

static enum MHD_Result check_argument(void *user, enum MHD_ValueKind kind, const char *name,
                                      const char *value)
{
    (void)kind;
    query_check *check = user;
    if (!name[0] && !value) return MHD_YES; /* an empty part between ampersands */
    unsigned index = 0;
    while (check->known[index] && strcmp(check->known[index], name) != 0)
        index++;
    bool is_known = check->known[index];
    if (is_known && !(check->seen & 1u << index)) {
        check->seen |= 1u << index;
        return MHD_YES;
    }
    check->name = name;
    check->fault = is_known ? "is given more than once" : "is not a parameter of this operation";
    return MHD_NO;
}

/** A misspelt parameter must not be ignored: the reply would be to another request. */
static void check_query(qm_request *request)
{
    query_check check = {.known = request->route->query};
    if (!check.known) return;
    MHD_get_connection_values(request->connection, MHD_GET_ARGUMENT_KIND, check_argument, &check);
    if (!check.fault) return;
    qm_problem problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "`%.60s` %s", check.name, check.fault);
    for (size_t i = 0; check.known[i]; i++) {
        size_t used = strlen(problem.detail);
        snprintf(problem.detail + used, sizeof problem.detail - used, "%s %s",
                 i > 0 ? "," : "; its parameters are", check.known[i]);
    }
    qm_request_set_problem(request, problem);
}

/** x-gzip is an old name of it (RFC 9110, 8.4.1.3). */
static bool is_gzip(const char *encoding)
{
    return strcasecmp(encoding, "gzip") == 0 || strcasecmp(encoding, "x-gzip") == 0;
}

bool qm_request_is_packed(const qm_request *request)
{
    const char *encoding = qm_request_header(request, "Content-Encoding");
    return encoding && is_gzip(encoding);
}

/** Checks what the headers say of the body. */
static void check_body(qm_request *request)
{
    const char *encoding = qm_request_header(request, "Content-Encoding");
    const bool takes_gzip = request->route->body == QM_BODY_FILE;
    if (encoding && strcasecmp(encoding, "identity") != 0 && !(takes_gzip && is_gzip(encoding))) {
        qm_reply_header(request, "Accept-Encoding", takes_gzip ? "gzip" : "identity");
        qm_request_set_problem(
            request, qm_problem_make(QM_PROBLEM_UNSUPPORTED_MEDIA_TYPE,
                                     takes_gzip ? "the Content-Encoding of a mesh must be gzip or identity"
                                                : "the body must not have a Content-Encoding"));
    }
    const char *length = qm_request_header(request, "Content-Length");
    if (length && strtoull(length, NULL, 10) > qm_request_body_limit(request))
        qm_request_set_problem(request,
                               qm_problem_make(QM_PROBLEM_TOO_LARGE, "the body must not exceed %zu bytes",
                                               qm_request_body_limit(request)));
}

static void check_token(qm_request *request)
{
    qm_scope needed = request->route->scope;
    if (needed == QM_SCOPE_NONE) return;
    const char *given = qm_request_header(request, "Authorization");
    qm_scope scope = qm_access_tokens_check(request->app->tokens, given, request->token);
    if (scope >= needed) return;
    qm_metrics_add(QM_METRICS_REFUSED_TOKENS, 1);
    if (scope != QM_SCOPE_NONE) {
        qm_reply_header(request, "WWW-Authenticate", "Bearer error=\"insufficient_scope\", scope=\"write\"");
        qm_request_set_problem(request,
                               qm_problem_make(QM_PROBLEM_FORBIDDEN, "this token only allows reading"));
        return;
    }
    qm_reply_header(request, "WWW-Authenticate", given ? "Bearer error=\"invalid_token\"" : "Bearer");
    qm_request_set_problem(request,
                           qm_problem_make(QM_PROBLEM_UNAUTHORIZED,
                                           given ? "the token is not valid"
                                                 : "the request needs a token: Authorization: Bearer TOKEN"));
}

/**
 * Without tokens the daemon trusts every client, and a browser on this machine reaches it for every page
 * that it shows. So Host must be the daemon's address, and pages of other origins may not change anything.
 */
static void check_page(qm_request *request)
{
    const char *host = qm_request_host(request), *origin = qm_request_header(request, "Origin");
    char name[256] = "";
    if (host) snprintf(name, sizeof name, "%.*s", (int)strcspn(host, ":"), host);
    if (!qm_access_host_is_plain(host) && !qm_access_origin_is_listed(request->app->config->hosts, name))
        qm_request_set_problem(
            request, qm_problem_make(QM_PROBLEM_FORBIDDEN, "the Host header does not name this server"));
    bool is_strange = origin && !qm_access_origin_is_host(origin, host) &&
                      !qm_access_origin_is_listed(request->app->config->cors_origins, origin);
    if (is_strange && strcmp(request->route->method, "GET") != 0)
        qm_request_set_problem(request,
                               qm_problem_make(QM_PROBLEM_FORBIDDEN, "pages of this Origin are not allowed"));
}

/** OPTIONS replies with the methods of the path's routes. */
static const qm_route options_route = {.method = "OPTIONS", .path = "", .handle = qm_reply_options};

static bool find_route(qm_request *request)
{
    qm_problem problem;
    request->route = qm_route_find(request->method, request->path, request->ids, &problem);
    if (!request->route && strcmp(request->method, "OPTIONS") == 0 && problem.allow[0]) {
        qm_reply_header(request, "Allow", "%s, OPTIONS", problem.allow);
        request->route = &options_route;
    }
    bool is_served = !request->listener->is_private;
    static const char *const private_paths[] = {"/healthz", "/readyz", "/metrics"};
    for (size_t i = 0; request->route && i < sizeof private_paths / sizeof *private_paths; i++)
        if (strcmp(request->route->path, private_paths[i]) == 0) is_served = true;
    if (request->route && !is_served) {
        request->route = NULL;
        problem = qm_problem_make(QM_PROBLEM_NOT_FOUND, "there is no resource at this path");
    }
    if (!request->route) qm_request_set_problem(request, problem);
    return request->route;
}

/** Begins the file of a body; without room for it the request is refused before the body comes. */
static void begin_upload(qm_request *request)
{
    const char *length = qm_request_header(request, "Content-Length");
    uint64_t expected = length ? strtoull(length, NULL, 10) : 0;
    qm_status status = qm_blob_begin(request->app->store, expected, &request->upload);
    if (status != QM_OK) qm_request_set_problem(request, qm_problem_from_write(status, "the body"));
}

void qm_request_check(qm_request *request)
{
    if (!check_framing(request) || !find_route(request) || request->route == &options_route) return;
    if (!request->listener->is_private) {
        if (qm_access_tokens_are_needed(request->app->tokens))
            check_token(request);
        else
            check_page(request);
    }
    check_query(request);
    if (request->route->body != QM_BODY_NONE) check_body(request);
    check_accept(request);
    if (!request->has_problem && request->route->body >= QM_BODY_SPOOL) begin_upload(request);
}
