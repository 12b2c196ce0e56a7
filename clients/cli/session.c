/**
 * session.c: HTTP by libcurl. The library is loaded when a daemon is used, because with its thirty libraries it takes
 * longer to start than most jobs take to run in this process.
 */
#include "cli.h"

#include <curl/curl.h>
#include <dlfcn.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/id.h"
#include "base/json.h"
#include "base/library.h"

#define URL_SIZE 2048

/* ---- libcurl ---- */

/** The functions in use, without the prefix curl_. */
#define CLI_CURL_MAP(XX)                                                                                     \
    XX(global_init)                                                                                          \
    XX(global_cleanup)                                                                                       \
    XX(easy_init)                                                                                            \
    XX(easy_cleanup)                                                                                         \
    XX(easy_reset)                                                                                           \
    XX(easy_setopt)                                                                                          \
    XX(easy_getinfo)                                                                                         \
    XX(easy_perform)                                                                                         \
    XX(easy_escape)                                                                                          \
    XX(easy_strerror)                                                                                        \
    XX(slist_append)                                                                                         \
    XX(slist_free_all)                                                                                       \
    XX(free)

typedef struct curl_library {
#define XX(name) __typeof__(curl_##name) *name;
    CLI_CURL_MAP(XX)
#undef XX
} curl_library;

/* The soname since 2006. */
#define LIBRARY "libcurl.so.4"

/** The library, which stays loaded; NULL with a message. One thread. */
static const curl_library *load_curl(const char **message)
{
    static curl_library curl;
    static bool is_loaded;
    if (!is_loaded) {
        void *library = dlopen(LIBRARY, RTLD_LAZY);
#define XX(name) &&qm_library_find(library, "curl_" #name, &curl.name)
        is_loaded = library CLI_CURL_MAP(XX);
#undef XX
    }
    if (is_loaded) return &curl;
    *message = dlerror();
    return NULL;
}

/* ---- sessions ---- */

struct cli_session {
    const curl_library *curl;
    CURL *handle;
    const char *server;
    bool as_json;
    qm_text body; /* of a plain response, or the incomplete line of a stream */
    bool is_stream;
    FILE *file;    /* receives the body of a successful response; or NULL */
    char job[256]; /* path of the job, "" before its Location is known */
    bool is_canceled;
    cli_bar bar;
    char *result;     /* the result object as the daemon wrote it */
    char *problem;    /* the problem document as the daemon wrote it */
    qm_problem *kept; /* receives problems instead of a report; NULL: none */
};

cli_session *cli_session_open(const char *server, bool as_json)
{
    const char *message = "there is no memory for a connection";
    const curl_library *curl = load_curl(&message);
    cli_session *session = curl ? calloc(1, sizeof *session) : NULL;
    if (session) {
        curl->global_init(CURL_GLOBAL_DEFAULT);
        *session =
            (cli_session){.curl = curl, .handle = curl->easy_init(), .server = server, .as_json = as_json};
        if (session->handle) return session;
        cli_session_close(session);
    }
    qm_problem problem =
        qm_problem_make(curl ? QM_PROBLEM_OUT_OF_MEMORY : QM_PROBLEM_UNAVAILABLE, "%s", message);
    cli_report(server, &problem, as_json);
    return NULL;
}

void cli_session_close(cli_session *session)
{
    if (!session) return;
    session->curl->easy_cleanup(session->handle);
    session->curl->global_cleanup();
    qm_text_reset(&session->body);
    free(session->result);
    free(session->problem);
    free(session);
}

const char *cli_session_job_path(const cli_session *session)
{
    return session->job;
}

void cli_session_keep_problems(cli_session *session, qm_problem *out)
{
    session->kept = out;
}

/** Reports a problem, or keeps it. */
static void tell(const cli_session *session, const char *path, const qm_problem *problem)
{
    if (session->kept)
        *session->kept = *problem;
    else
        cli_report(path, problem, session->as_json);
}

/* ---- responses ---- */

/** Returns the text of the object that is the last member of a line {..., "name":{...}}, for free(). */
static char *last_member(const char *line, const char *name)
{
    char key[32];
    snprintf(key, sizeof key, "\"%s\":", name);
    const char *start = strstr(line, key);
    if (!start) return NULL;
    start += strlen(key);
    return strndup(start, strlen(start) - 1);
}

static size_t on_bytes(char *bytes, size_t width, size_t count, void *user)
{
    cli_session *session = user;
    size_t size = width * count;
    long status = 0;
    session->curl->easy_getinfo(session->handle, CURLINFO_RESPONSE_CODE, &status);
    if (session->file && status == 200) return fwrite(bytes, 1, size, session->file);
    qm_text_add(&session->body, bytes, size);
    char *end;
    while (session->is_stream && !session->body.failed &&
           (end = memchr(session->body.data, '\n', session->body.size))) {
        *end = '\0';
        qm_json *event = qm_json_parse(session->body.data);
        const char *name = qm_json_get_string(event, "event");
        if (!name) name = "";
        if (strcmp(name, "bounds") == 0)
            cli_bar_show(&session->bar, qm_json_get_number(event, "lower"),
                         qm_json_get_number(event, "upper"), qm_json_get_number(event, "elapsed_ms"),
                         qm_json_get_number(event, "iterations"));
        double distance = qm_json_get_number(event, "hausdorff.upper");
        if (strcmp(name, "stage") == 0)
            cli_bar_tell(&session->bar, qm_json_get_string(event, "stage"),
                         qm_json_get_number(event, "quads"), distance);
        if (strcmp(name, "result") == 0) session->result = last_member(session->body.data, "result");
        if (strcmp(name, "error") == 0) session->problem = last_member(session->body.data, "problem");
        qm_json_free(event);
        size_t used = (size_t)(end + 1 - session->body.data);
        session->body.size -= used;
        memmove(session->body.data, end + 1, session->body.size + 1);
    }
    return session->body.failed ? 0 : size;
}

/** Keeps the location of the job, to be able to stop it. */
static size_t on_header(char *bytes, size_t width, size_t count, void *user)
{
    static const char name[] = "Location: ";
    cli_session *session = user;
    size_t size = width * count, skip = sizeof name - 1;
    if (session->is_stream && size > skip && strncasecmp(bytes, name, skip) == 0) {
        size_t length = strcspn(bytes + skip, "\r\n");
        if (length < sizeof session->job)
            snprintf(session->job, sizeof session->job, "%.*s", (int)length, bytes + skip);
    }
    return size;
}

/* ---- requests ---- */

/** Joins the server's address and a path by one slash. */
static void make_url(const cli_session *session, const char *path, char *url, size_t size)
{
    size_t length = strlen(session->server);
    while (length > 0 && session->server[length - 1] == '/')
        length--;
    snprintf(url, size, "%.*s%s", (int)length, session->server, path);
}

static size_t ignore_bytes(char *bytes, size_t width, size_t count, void *user)
{
    (void)bytes, (void)user;
    return width * count;
}

/** Stops the job; its stream then ends with the bounds reached. */
static bool cancel_job(const cli_session *session)
{
    char url[URL_SIZE];
    CURL *handle = session->curl->easy_init();
    if (!handle) return false;
    make_url(session, session->job, url, sizeof url);
    session->curl->easy_setopt(handle, CURLOPT_URL, url);
    session->curl->easy_setopt(handle, CURLOPT_CUSTOMREQUEST, "DELETE");
    session->curl->easy_setopt(handle, CURLOPT_WRITEFUNCTION, ignore_bytes);
    CURLcode code = session->curl->easy_perform(handle);
    session->curl->easy_cleanup(handle);
    return code == CURLE_OK;
}

/** Called periodically during a transfer. An interrupt stops the job, or the transfer if there is no job. */
static int on_tick(void *user, curl_off_t a, curl_off_t b, curl_off_t c, curl_off_t d)
{
    (void)a, (void)b, (void)c, (void)d;
    cli_session *session = user;
    if (!atomic_load(&cli_interrupted) || session->is_canceled) return 0;
    if (!session->is_stream || !session->job[0] || !cancel_job(session)) return 1;
    session->is_canceled = true;
    return 0;
}

static void report_transfer(const cli_session *session, const char *url, CURLcode code)
{
    bool is_interrupted = code == CURLE_ABORTED_BY_CALLBACK;
    qm_problem problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "%s",
                                         is_interrupted ? "interrupted" : session->curl->easy_strerror(code));
    tell(session, url, &problem);
}

/** Posts bytes, or gets if they are NULL; returns the HTTP status, or 0 after a report. */
static long transfer(cli_session *session, const char *path, const void *bytes, size_t size,
                     const char *accept, const char *type)
{
    char url[URL_SIZE];
    make_url(session, path, url, sizeof url);
    struct curl_slist *headers = session->curl->slist_append(NULL, accept);
    if (bytes) headers = session->curl->slist_append(headers, type);
    qm_text_reset(&session->body);
    session->curl->easy_reset(session->handle);
    session->curl->easy_setopt(session->handle, CURLOPT_URL, url);
    if (bytes) {
        session->curl->easy_setopt(session->handle, CURLOPT_POSTFIELDS, bytes);
        session->curl->easy_setopt(session->handle, CURLOPT_POSTFIELDSIZE_LARGE, (curl_off_t)size);
    }
    session->curl->easy_setopt(session->handle, CURLOPT_HTTPHEADER, headers);
    session->curl->easy_setopt(session->handle, CURLOPT_WRITEFUNCTION, on_bytes);
    session->curl->easy_setopt(session->handle, CURLOPT_WRITEDATA, session);
    session->curl->easy_setopt(session->handle, CURLOPT_HEADERFUNCTION, on_header);
    session->curl->easy_setopt(session->handle, CURLOPT_HEADERDATA, session);
    session->curl->easy_setopt(session->handle, CURLOPT_XFERINFOFUNCTION, on_tick);
    session->curl->easy_setopt(session->handle, CURLOPT_XFERINFODATA, session);
    session->curl->easy_setopt(session->handle, CURLOPT_NOPROGRESS, 0L);
    CURLcode code = session->curl->easy_perform(session->handle);
    session->curl->slist_free_all(headers);
    long status = 0;
    if (code == CURLE_OK)
        session->curl->easy_getinfo(session->handle, CURLINFO_RESPONSE_CODE, &status);
    else if (!session->result ||
             !session->is_stream) /* a broken stream is complete if it has brought the result */
        report_transfer(session, url, code);
    return status;
}

/** Reports a response without a problem document: a broken stream, or another kind of server. */
static void report_response(const cli_session *session, const char *path, long status)
{
    bool is_cut = session->is_stream && status == 200;
    qm_problem problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE,
                                         is_cut ? "the stream ended without a result"
                                                : "the response, with status %ld, is not from quadmeshd",
                                         status);
    tell(session, path, &problem);
}

/** Reports a problem document as cli_report does a problem. */
static void report_document(const cli_session *session, const char *path, const char *document, long status)
{
    qm_json *json = document ? qm_json_parse(document) : NULL;
    const char *detail = qm_json_get_string(json, "detail");
    if (!detail) {
        report_response(session, path, status);
    } else if (session->as_json && !session->kept) {
        puts(document);
    } else {
        qm_problem problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "%s", detail);
        double line = qm_json_get_number(json, "errors.0.line"),
               offset = qm_json_get_number(json, "errors.0.offset");
        problem.error_count = line >= 0.0 || offset >= 0.0;
        problem.errors[0].line = line >= 0.0 ? (size_t)line : QM_NO_LOCATION;
        problem.errors[0].offset = offset >= 0.0 ? (size_t)offset : QM_NO_LOCATION;
        tell(session, path, &problem);
    }
    qm_json_free(json);
}

/* ---- what a session offers ---- */

/** A smaller file takes hardly longer to send than to ask for. */
#define HASHED_FROM (256u << 10)

#define MEMBER_SIZE 64

static double number_of(const qm_json *json, const char *mesh, const char *member)
{
    char path[MEMBER_SIZE];
    snprintf(path, sizeof path, "%s%s", mesh, member);
    return qm_json_get_number(json, path);
}

static const char *string_of(const qm_json *json, const char *mesh, const char *member)
{
    char path[MEMBER_SIZE];
    snprintf(path, sizeof path, "%s%s", mesh, member);
    const char *value = qm_json_get_string(json, path);
    return value ? value : "";
}

/** Reads id and diagonal of a mesh; its path is "" for the whole document. */
static void read_mesh(const qm_json *json, const char *mesh, char id[QM_ID_SIZE], double *diagonal)
{
    snprintf(id, QM_ID_SIZE, "%s", string_of(json, mesh, "id"));
    if (diagonal) *diagonal = number_of(json, mesh, "bounding_box.diagonal");
}

/**
 * Finds the mesh that an upload of these bytes would give, without sending them; none that was deformed or expires. A file
 * that names its unit is found only where the notes name it too. *is_down is set after a report: no answer came.
 */
static bool find_uploaded(cli_session *session, const char *name, const uint8_t *bytes, size_t size,
                          const qm_notes *notes, char id[QM_ID_SIZE], double *diagonal, bool *is_down)
{
    char target[1024], hash[QM_HASH_SIZE], mesh[MEMBER_SIZE / 2];
    uint8_t digest[QM_DIGEST_SIZE];
    qm_id_hash_bytes(bytes, size, digest);
    qm_id_hash_print(digest, hash);
    snprintf(target, sizeof target, "/v1/meshes?content_hash=%s&name=%.900s", hash, name);
    long status = transfer(session, target, NULL, 0, "Accept: application/json", NULL);
    *is_down = status == 0;
    bool is_found = false;
    qm_json *page = status == 200 ? qm_json_parse(session->body.data) : NULL;
    for (size_t i = 0; !is_found; i++) {
        snprintf(mesh, sizeof mesh, "meshes.%zu.", i);
        if (!string_of(page, mesh, "id")[0]) break;
        is_found = number_of(page, mesh, "revision") == 0.0 && !string_of(page, mesh, "expires_at")[0] &&
                   strcmp(string_of(page, mesh, "unit"), notes->unit) == 0 &&
                   number_of(page, mesh, "uncertainty") == notes->uncertainty;
        if (is_found) read_mesh(page, mesh, id, diagonal);
    }
    qm_json_free(page);
    return is_found;
}

/** Uploads bytes; false after a report, which names the file at path. */
static bool send_mesh(cli_session *session, const char *path, const char *name, const uint8_t *bytes,
                      size_t size, const qm_notes *notes, char id[QM_ID_SIZE], double *diagonal)
{
    char target[1024], number[QM_NUMBER_SIZE];
    size_t used = (size_t)snprintf(target, sizeof target, "/v1/meshes?name=%.900s", name);
    if (notes->unit[0])
        used += (size_t)snprintf(target + used, sizeof target - used, "&unit=%s", notes->unit);
    if (notes->uncertainty > 0.0)
        snprintf(target + used, sizeof target - used, "&uncertainty=%s",
                 qm_text_number(notes->uncertainty, number));
    long status = transfer(session, target, bytes, size, "Accept: application/json",
                           "Content-Type: application/octet-stream");
    bool is_stored = status == 200 || status == 201;
    if (is_stored) {
        qm_json *mesh = qm_json_parse(session->body.data);
        read_mesh(mesh, "", id, diagonal);
        qm_json_free(mesh);
    } else if (status != 0) {
        report_document(session, path, session->body.data, status);
    }
    return is_stored;
}

bool cli_session_upload(cli_session *session, const char *path, const qm_notes *notes, char id[QM_ID_SIZE],
                        double *diagonal)
{
    size_t size;
    qm_problem problem;
    uint8_t *bytes = cli_try_file(path, &size, &problem);
    if (!bytes) {
        tell(session, path, &problem);
        return false;
    }
    char *escaped = session->curl->easy_escape(session->handle, cli_base_name(path), 0);
    const char *name = escaped ? escaped : "";
    bool is_down = false;
    bool is_stored =
        size >= HASHED_FROM && find_uploaded(session, name, bytes, size, notes, id, diagonal, &is_down);
    if (!is_stored && !is_down) is_stored = send_mesh(session, path, name, bytes, size, notes, id, diagonal);
    session->curl->free(escaped);
    free(bytes);
    return is_stored;
}

char *cli_session_run_job(cli_session *session, const qm_job_request *request, cli_bar bar)
{
    qm_text text = {0};
    qm_json_write_request(&text, request);
    char *body = qm_text_take(&text);
    if (!body) return NULL;
    session->is_stream = true;
    session->bar = bar;
    long status = transfer(session, "/v1/jobs", body, strlen(body), "Accept: application/x-ndjson",
                           "Content-Type: application/json");
    cli_bar_clear(&session->bar);
    free(body);
    if (!session->result && status != 0)
        report_document(session, session->server, session->problem ? session->problem : session->body.data,
                        status);
    session->is_stream = false;
    char *result = session->result;
    session->result = NULL;
    return result;
}

bool cli_session_fetch(cli_session *session, const char *path, const void *bytes, size_t size,
                       const char *media, const char *subject, FILE *out)
{
    char accept[96];
    snprintf(accept, sizeof accept, "Accept: %s", media);
    session->file = out;
    long status = transfer(session, path, bytes, size, accept, "Content-Type: application/octet-stream");
    session->file = NULL;
    if (status != 0 && status != 200) report_document(session, subject, session->body.data, status);
    return status == 200;
}

bool cli_session_fetch_numbers(cli_session *session, const char *server, double **numbers, size_t *count)
{
    char path[300];
    FILE *file = tmpfile();
    *numbers = NULL;
    *count = 0;
    if (!file) {
        perror("quadmesh: no temporary file");
        return false;
    }
    snprintf(path, sizeof path, "%s/result", cli_session_job_path(session));
    bool is_read = cli_session_fetch(session, path, NULL, 0, "application/octet-stream", server, file);
    long size = is_read ? ftell(file) : 0;
    rewind(file);
    *count = (size_t)size / sizeof(double);
    *numbers = malloc((size_t)size + 1);
    is_read = is_read && *numbers && fread(*numbers, sizeof(double), *count, file) == *count;
    fclose(file);
    if (is_read) qm_text_swap_bytes(*numbers, *count);
    return is_read;
}

bool cli_session_fetch_report(cli_session *session, const qm_report_limits *limits, double range,
                              qm_text *out)
{
    const struct {
        const char *name;
        double value;
    } query[] = {{"limit", limits->distance},
                 {"limit_in", limits->inside},
                 {"limit_out", limits->outside},
                 {"range", range}};
    char path[400], number[QM_NUMBER_SIZE], *bytes = NULL;
    size_t size = 0;
    int used = snprintf(path, sizeof path, "%s/report?", cli_session_job_path(session));
    for (size_t i = 0; i < sizeof query / sizeof *query; i++)
        if (!isnan(query[i].value))
            used += snprintf(path + used, sizeof path - (size_t)used, "%s=%s&", query[i].name,
                             qm_text_number(query[i].value, number));
    path[used - 1] = '\0';
    FILE *file = open_memstream(&bytes, &size);
    bool is_fetched = file && cli_session_fetch(session, path, NULL, 0, "text/html", session->server, file);
    if (file && fclose(file) != 0) is_fetched = false;
    if (is_fetched) qm_text_add(out, bytes, size);
    free(bytes);
    return is_fetched && !out->failed;
}
