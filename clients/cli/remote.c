#include "remote.h"

#include <curl/curl.h>
#include <stdlib.h>
#include <string.h>

#include "json_out.h"
#include "reply_in.h"

#define URL_SIZE 2048
#define CONNECT_TIMEOUT_S 10L
#define LOCATION_SIZE 128
#define FIRST_REFUSAL 300 /* the first status that is not a success */

struct qm_remote {
    char url[URL_SIZE]; /* without a slash at the end */
    char error[CURL_ERROR_SIZE];
};

/** A request on its way: the reply's text, or the lines of its stream. */
typedef struct exchange {
    qm_remote *remote;
    CURL *curl;
    qm_text reply;
    char location[LOCATION_SIZE];
    const atomic_bool *cancel;
    bool asked_to_cancel;
    bool has_result, has_problem;
    qm_hausdorff_progress_fn *progress;
    void *progress_user;
    qm_job_result *out;
    qm_problem *problem;
} exchange;

qm_remote *qm_remote_create(const char *url)
{
    qm_remote *remote = calloc(1, sizeof *remote);
    if (!remote || strlen(url) >= URL_SIZE || curl_global_init(CURL_GLOBAL_DEFAULT) != CURLE_OK) {
        free(remote);
        return NULL;
    }
    strcpy(remote->url, url);
    size_t length = strlen(url);
    while (length > 0 && remote->url[length - 1] == '/')
        remote->url[--length] = '\0';
    return remote;
}

void qm_remote_destroy(qm_remote *remote)
{
    if (remote) curl_global_cleanup();
    free(remote);
}

/** A handle for one request; path is put behind the daemon's address. NULL when out of memory. */
static CURL *begin(qm_remote *remote, const char *path)
{
    char url[2 * URL_SIZE];
    CURL *curl = curl_easy_init();
    if (!curl) return NULL;
    snprintf(url, sizeof url, "%s%s", remote->url, path);
    remote->error[0] = '\0';
    curl_easy_setopt(curl, CURLOPT_URL, url);
    curl_easy_setopt(curl, CURLOPT_ERRORBUFFER, remote->error);
    curl_easy_setopt(curl, CURLOPT_PROTOCOLS_STR, "http,https");
    curl_easy_setopt(curl, CURLOPT_CONNECTTIMEOUT, CONNECT_TIMEOUT_S);
    curl_easy_setopt(curl, CURLOPT_USERAGENT, "quadmesh/" QM_VERSION);
    curl_easy_setopt(curl, CURLOPT_NOSIGNAL, 1L);
    return curl;
}

static size_t gather(char *bytes, size_t width, size_t count, void *user)
{
    qm_text_add(user, bytes, width * count);
    return ((qm_text *)user)->failed ? 0 : width * count;
}

/** Performs a request; false with a problem when it did not get through or was refused. */
static bool perform(qm_remote *remote, CURL *curl, const qm_text *reply, qm_problem *problem)
{
    long status = 0;
    CURLcode code = curl_easy_perform(curl);
    if (code != CURLE_OK) {
        *problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "%s: %s", remote->url,
                                   remote->error[0] ? remote->error : curl_easy_strerror(code));
        return false;
    }
    curl_easy_getinfo(curl, CURLINFO_RESPONSE_CODE, &status);
    if (status < FIRST_REFUSAL) return true;
    if (!reply->data || !qm_reply_read_problem(reply->data, problem))
        *problem = qm_problem_make(QM_PROBLEM_INTERNAL, "%s answered with status %ld", remote->url, status);
    return false;
}

/** "/v1/meshes?name=NAME", the name escaped. */
static bool make_upload_path(CURL *curl, const char *name, char out[URL_SIZE])
{
    char *escaped = curl_easy_escape(curl, name, 0);
    int length = escaped ? snprintf(out, URL_SIZE, "/v1/meshes?name=%s", escaped) : URL_SIZE;
    curl_free(escaped);
    return length < URL_SIZE;
}

static bool send_file(qm_remote *remote, const qm_cli_file *file, qm_text *reply, qm_problem *problem)
{
    char path[URL_SIZE];
    bool is_named = make_upload_path(NULL, file->name, path);
    CURL *curl = is_named ? begin(remote, path) : NULL;
    if (!curl) {
        *problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "%s: the name is too long", file->path);
        return false;
    }
    struct curl_slist *headers = curl_slist_append(NULL, "Content-Type: application/octet-stream");
    curl_easy_setopt(curl, CURLOPT_HTTPHEADER, headers);
    curl_easy_setopt(curl, CURLOPT_POSTFIELDSIZE_LARGE, (curl_off_t)file->size);
    curl_easy_setopt(curl, CURLOPT_POSTFIELDS, file->bytes ? (const char *)file->bytes : "");
    curl_easy_setopt(curl, CURLOPT_WRITEFUNCTION, gather);
    curl_easy_setopt(curl, CURLOPT_WRITEDATA, reply);
    bool is_sent = perform(remote, curl, reply, problem);
    curl_slist_free_all(headers);
    curl_easy_cleanup(curl);
    return is_sent;
}

bool qm_remote_upload(qm_remote *remote, const char *path, char id[QM_ID_SIZE], double *diagonal,
                      qm_problem *problem)
{
    qm_cli_file file;
    if (!qm_cli_read_file(path, &file, problem)) return false;
    qm_text reply = {0};
    bool is_done = send_file(remote, &file, &reply, problem);
    if (!is_done) {
        qm_cli_name_file(problem, path);
    } else if (!qm_reply_read_mesh(reply.data ? reply.data : "", id, diagonal)) {
        *problem = qm_problem_make(QM_PROBLEM_INTERNAL, "%s did not answer with a mesh", remote->url);
        is_done = false;
    }
    free(file.bytes);
    qm_text_reset(&reply);
    return is_done;
}

/* ---- the stream of a job ---- */

static void take_line(exchange *e, const char *line)
{
    qm_event event;
    qm_reply_read_event(line, &event);
    if (event.kind == QM_EVENT_BOUNDS) {
        e->progress(e->progress_user, &event.progress);
    } else if (event.kind == QM_EVENT_RESULT) {
        double diagonal = e->out->diagonal;
        *e->out = event.result;
        e->out->diagonal = diagonal;
        e->has_result = true;
    } else if (event.kind == QM_EVENT_ERROR) {
        *e->problem = event.problem;
        e->has_problem = true;
    }
}

/** Takes whole lines out of what has come so far. */
static size_t on_stream(char *bytes, size_t width, size_t count, void *user)
{
    exchange *e = user;
    qm_text_add(&e->reply, bytes, width * count);
    if (e->reply.failed) return 0;
    long status = 0;
    curl_easy_getinfo(e->curl, CURLINFO_RESPONSE_CODE, &status);
    if (status >= FIRST_REFUSAL) return width * count;
    size_t start = 0;
    for (char *end; (end = memchr(e->reply.data + start, '\n', e->reply.size - start));) {
        *end = '\0';
        take_line(e, e->reply.data + start);
        start = (size_t)(end + 1 - e->reply.data);
    }
    memmove(e->reply.data, e->reply.data + start, e->reply.size - start + 1);
    e->reply.size -= start;
    return width * count;
}

/** Keeps Location: the job is cancelled there. */
static size_t on_header(char *bytes, size_t width, size_t count, void *user)
{
    static const char name[] = "location:";
    exchange *e = user;
    size_t size = width * count, skip = sizeof name - 1;
    if (size <= skip || strncasecmp(bytes, name, skip) != 0) return size;
    while (skip < size && bytes[skip] == ' ')
        skip++;
    while (size > skip && strchr("\r\n ", bytes[size - 1]))
        size--;
    if (size - skip < LOCATION_SIZE) {
        memcpy(e->location, bytes + skip, size - skip);
        e->location[size - skip] = '\0';
    }
    return width * count;
}

/** Asks the daemon to end the job; what it answers does not matter, the stream tells how it ended. */
static void cancel_job(exchange *e)
{
    qm_text ignored = {0};
    CURL *curl = begin(e->remote, e->location);
    if (curl) {
        curl_easy_setopt(curl, CURLOPT_CUSTOMREQUEST, "DELETE");
        curl_easy_setopt(curl, CURLOPT_WRITEFUNCTION, gather);
        curl_easy_setopt(curl, CURLOPT_WRITEDATA, &ignored);
        curl_easy_perform(curl);
        curl_easy_cleanup(curl);
    }
    qm_text_reset(&ignored);
}

/** Called by the library about once a second and whenever data comes. */
static int on_tick(void *user, curl_off_t download, curl_off_t downloaded, curl_off_t upload,
                   curl_off_t uploaded)
{
    (void)download, (void)downloaded, (void)upload, (void)uploaded;
    exchange *e = user;
    if (e->asked_to_cancel || !atomic_load(e->cancel) || !e->location[0]) return 0;
    e->asked_to_cancel = true;
    cancel_job(e);
    return 0;
}

static void set_stream_options(exchange *e, struct curl_slist *headers, const qm_text *body)
{
    curl_easy_setopt(e->curl, CURLOPT_HTTPHEADER, headers);
    curl_easy_setopt(e->curl, CURLOPT_POSTFIELDSIZE_LARGE, (curl_off_t)body->size);
    curl_easy_setopt(e->curl, CURLOPT_POSTFIELDS, body->data);
    curl_easy_setopt(e->curl, CURLOPT_WRITEFUNCTION, on_stream);
    curl_easy_setopt(e->curl, CURLOPT_WRITEDATA, e);
    curl_easy_setopt(e->curl, CURLOPT_HEADERFUNCTION, on_header);
    curl_easy_setopt(e->curl, CURLOPT_HEADERDATA, e);
    curl_easy_setopt(e->curl, CURLOPT_XFERINFOFUNCTION, on_tick);
    curl_easy_setopt(e->curl, CURLOPT_XFERINFODATA, e);
    curl_easy_setopt(e->curl, CURLOPT_NOPROGRESS, 0L);
}

static bool run_stream(exchange *e, const qm_text *body)
{
    struct curl_slist *headers = curl_slist_append(NULL, "Content-Type: application/json");
    struct curl_slist *accept = headers ? curl_slist_append(headers, "Accept: application/x-ndjson") : NULL;
    e->curl = accept && !body->failed ? begin(e->remote, "/v1/jobs") : NULL;
    bool is_done = false;
    if (e->curl) {
        set_stream_options(e, headers, body);
        is_done = perform(e->remote, e->curl, &e->reply, e->problem);
        curl_easy_cleanup(e->curl);
    } else {
        *e->problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "there is no memory for the request");
    }
    curl_slist_free_all(headers);
    return is_done;
}

bool qm_remote_run(qm_remote *remote, const qm_job_request *request, const atomic_bool *cancel,
                   qm_hausdorff_progress_fn *progress, void *progress_user, qm_job_result *out,
                   qm_problem *problem)
{
    exchange e = {.remote = remote,
                  .cancel = cancel,
                  .progress = progress,
                  .progress_user = progress_user,
                  .out = out,
                  .problem = problem};
    qm_text body = {0};
    qm_json_write_request(&body, request);
    bool is_done = run_stream(&e, &body);
    qm_text_reset(&body);
    qm_text_reset(&e.reply);
    if (is_done && !e.has_result && !e.has_problem)
        *problem =
            qm_problem_make(QM_PROBLEM_UNAVAILABLE, "%s: the stream ended without a result", remote->url);
    return is_done && e.has_result;
}
