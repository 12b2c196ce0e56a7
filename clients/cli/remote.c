#include "remote.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/json_read.h"
#include "curl.h"

#define URL_SIZE 2048

struct cli_talk {
    const cli_curl *curl;
    CURL *handle;
    const char *server;
    bool as_json;
    qm_text body; /* of a plain answer, or the unfinished line of a stream */
    bool is_stream;
    FILE *file;    /* where the body of a good answer goes, or NULL */
    char job[256]; /* path of the job, once the daemon has told */
    bool is_canceled;
    cli_bar bar;
    char *result;  /* the result object as the daemon wrote it */
    char *problem; /* the problem document likewise */
};

cli_talk *cli_talk_open(const char *server, bool as_json)
{
    const char *why = "there is no memory for a connection";
    const cli_curl *curl = cli_curl_load(&why);
    cli_talk *talk = curl ? calloc(1, sizeof *talk) : NULL;
    if (talk) {
        curl->global_init(CURL_GLOBAL_DEFAULT);
        *talk = (cli_talk){.curl = curl, .handle = curl->easy_init(), .server = server, .as_json = as_json};
        if (talk->handle) return talk;
        cli_talk_close(talk);
    }
    qm_problem problem = qm_problem_make(curl ? QM_PROBLEM_OUT_OF_MEMORY : QM_PROBLEM_UNAVAILABLE, "%s", why);
    cli_complain(server, &problem, as_json);
    return NULL;
}

void cli_talk_close(cli_talk *talk)
{
    if (!talk) return;
    talk->curl->easy_cleanup(talk->handle);
    talk->curl->global_cleanup();
    qm_text_reset(&talk->body);
    free(talk->result);
    free(talk->problem);
    free(talk);
}

const char *cli_talk_job_path(const cli_talk *talk)
{
    return talk->job;
}

/* ---- what comes ---- */

/** The text of an object that is the last member of a line {..., "name":{...}}. */
static char *last_member(const char *line, const char *name)
{
    char key[32];
    snprintf(key, sizeof key, "\"%s\":", name);
    const char *start = strstr(line, key);
    if (!start) return NULL;
    start += strlen(key);
    return strndup(start, strlen(start) - 1);
}

static void read_line(cli_talk *talk, const char *line)
{
    qm_json *event = qm_json_parse(line);
    const char *name = qm_json_get_string(event, "event");
    if (!name) name = "";
    if (strcmp(name, "bounds") == 0)
        cli_bar_show(&talk->bar, qm_json_get_number(event, "lower"), qm_json_get_number(event, "upper"),
                     qm_json_get_number(event, "elapsed_ms"), qm_json_get_number(event, "iterations"));
    if (strcmp(name, "result") == 0) talk->result = last_member(line, "result");
    if (strcmp(name, "error") == 0) talk->problem = last_member(line, "problem");
    qm_json_free(event);
}

static bool is_good(const cli_talk *talk)
{
    long status = 0;
    talk->curl->easy_getinfo(talk->handle, CURLINFO_RESPONSE_CODE, &status);
    return status == 200;
}

static size_t on_bytes(char *bytes, size_t width, size_t count, void *user)
{
    cli_talk *talk = user;
    size_t size = width * count;
    if (talk->file && is_good(talk)) return fwrite(bytes, 1, size, talk->file);
    qm_text_add(&talk->body, bytes, size);
    char *end;
    while (talk->is_stream && !talk->body.failed && (end = memchr(talk->body.data, '\n', talk->body.size))) {
        *end = '\0';
        read_line(talk, talk->body.data);
        size_t used = (size_t)(end + 1 - talk->body.data);
        talk->body.size -= used;
        memmove(talk->body.data, end + 1, talk->body.size + 1);
    }
    return talk->body.failed ? 0 : size;
}

/** Keeps the place of the job, so that it can be stopped. */
static size_t on_header(char *bytes, size_t width, size_t count, void *user)
{
    static const char name[] = "Location: ";
    cli_talk *talk = user;
    size_t size = width * count, skip = sizeof name - 1;
    if (talk->is_stream && size > skip && strncasecmp(bytes, name, skip) == 0) {
        size_t length = strcspn(bytes + skip, "\r\n");
        if (length < sizeof talk->job)
            snprintf(talk->job, sizeof talk->job, "%.*s", (int)length, bytes + skip);
    }
    return size;
}

/* ---- what goes ---- */

/** The server's address with a path, without a slash too many. */
static void make_url(const cli_talk *talk, const char *path, char *url, size_t size)
{
    size_t length = strlen(talk->server);
    while (length > 0 && talk->server[length - 1] == '/')
        length--;
    snprintf(url, size, "%.*s%s", (int)length, talk->server, path);
}

static size_t ignore_bytes(char *bytes, size_t width, size_t count, void *user)
{
    (void)bytes, (void)user;
    return width * count;
}

/** Asks the daemon to stop the job; its stream then ends with the bracket so far. */
static bool cancel_job(const cli_talk *talk)
{
    char url[URL_SIZE];
    CURL *handle = talk->curl->easy_init();
    if (!handle) return false;
    make_url(talk, talk->job, url, sizeof url);
    talk->curl->easy_setopt(handle, CURLOPT_URL, url);
    talk->curl->easy_setopt(handle, CURLOPT_CUSTOMREQUEST, "DELETE");
    talk->curl->easy_setopt(handle, CURLOPT_WRITEFUNCTION, ignore_bytes);
    CURLcode code = talk->curl->easy_perform(handle);
    talk->curl->easy_cleanup(handle);
    return code == CURLE_OK;
}

/** Called now and then during a transfer. An interrupt stops the job; where none runs, the transfer. */
static int on_tick(void *user, curl_off_t a, curl_off_t b, curl_off_t c, curl_off_t d)
{
    (void)a, (void)b, (void)c, (void)d;
    cli_talk *talk = user;
    if (!atomic_load(&cli_interrupted) || talk->is_canceled) return 0;
    if (!talk->is_stream || !talk->job[0] || !cancel_job(talk)) return 1;
    talk->is_canceled = true;
    return 0;
}

static void complain_of_transfer(const cli_talk *talk, const char *url, CURLcode code)
{
    bool is_interrupted = code == CURLE_ABORTED_BY_CALLBACK;
    qm_problem problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "%s",
                                         is_interrupted ? "interrupted" : talk->curl->easy_strerror(code));
    cli_complain(url, &problem, talk->as_json);
}

/** Posts bytes, or gets when they are NULL; returns the HTTP status, or 0 after words or a problem. */
static long transfer(cli_talk *talk, const char *path, const void *bytes, size_t size, const char *accept,
                     const char *type)
{
    char url[URL_SIZE];
    make_url(talk, path, url, sizeof url);
    struct curl_slist *headers = talk->curl->slist_append(NULL, accept);
    if (bytes) headers = talk->curl->slist_append(headers, type);
    qm_text_reset(&talk->body);
    talk->curl->easy_reset(talk->handle);
    talk->curl->easy_setopt(talk->handle, CURLOPT_URL, url);
    if (bytes) {
        talk->curl->easy_setopt(talk->handle, CURLOPT_POSTFIELDS, bytes);
        talk->curl->easy_setopt(talk->handle, CURLOPT_POSTFIELDSIZE_LARGE, (curl_off_t)size);
    }
    talk->curl->easy_setopt(talk->handle, CURLOPT_HTTPHEADER, headers);
    talk->curl->easy_setopt(talk->handle, CURLOPT_WRITEFUNCTION, on_bytes);
    talk->curl->easy_setopt(talk->handle, CURLOPT_WRITEDATA, talk);
    talk->curl->easy_setopt(talk->handle, CURLOPT_HEADERFUNCTION, on_header);
    talk->curl->easy_setopt(talk->handle, CURLOPT_HEADERDATA, talk);
    talk->curl->easy_setopt(talk->handle, CURLOPT_XFERINFOFUNCTION, on_tick);
    talk->curl->easy_setopt(talk->handle, CURLOPT_XFERINFODATA, talk);
    talk->curl->easy_setopt(talk->handle, CURLOPT_NOPROGRESS, 0L);
    CURLcode code = talk->curl->easy_perform(talk->handle);
    talk->curl->slist_free_all(headers);
    long status = 0;
    if (code == CURLE_OK)
        talk->curl->easy_getinfo(talk->handle, CURLINFO_RESPONSE_CODE, &status);
    else if (!talk->result || !talk->is_stream) /* else all that was wanted of the stream is there */
        complain_of_transfer(talk, url, code);
    return status;
}

/** There is no problem document to pass on: the stream was cut, or some other server answers. */
static void complain_of_answer(const cli_talk *talk, const char *path, long status)
{
    bool is_cut = talk->is_stream && status == 200;
    qm_problem problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE,
                                         is_cut ? "the stream ended without a result"
                                                : "the answer, with status %ld, is not quadmeshd's",
                                         status);
    cli_complain(path, &problem, talk->as_json);
}

/** Tells of a problem document as cli_complain does of a problem. */
static void print_problem(const cli_talk *talk, const char *path, const char *document, long status)
{
    qm_json *problem = document ? qm_json_parse(document) : NULL;
    const char *detail = qm_json_get_string(problem, "detail");
    if (!detail)
        complain_of_answer(talk, path, status);
    else if (talk->as_json)
        puts(document);
    else
        cli_print_problem(path, qm_json_get_number(problem, "errors.line"),
                          qm_json_get_number(problem, "errors.offset"), detail);
    qm_json_free(problem);
}

/* ---- what is asked ---- */

bool cli_talk_upload(cli_talk *talk, const char *path, char id[QM_ID_SIZE], double *diagonal)
{
    size_t size;
    uint8_t *bytes = cli_read_file(path, &size, talk->as_json);
    if (!bytes) return false;
    char target[1024];
    char *name = talk->curl->easy_escape(talk->handle, cli_base_name(path), 0);
    snprintf(target, sizeof target, "/v1/meshes?name=%s", name ? name : "");
    talk->curl->free(name);
    long status = transfer(talk, target, bytes, size, "Accept: application/json",
                           "Content-Type: application/octet-stream");
    free(bytes);
    bool stored = status == 200 || status == 201;
    if (stored) {
        qm_json *mesh = qm_json_parse(talk->body.data);
        const char *given = qm_json_get_string(mesh, "id");
        snprintf(id, QM_ID_SIZE, "%s", given ? given : "");
        if (diagonal) *diagonal = qm_json_get_number(mesh, "bounding_box.diagonal");
        qm_json_free(mesh);
    } else if (status != 0) {
        print_problem(talk, path, talk->body.data, status);
    }
    return stored;
}

char *cli_talk_run_job(cli_talk *talk, const qm_job_request *request, cli_bar bar)
{
    qm_text text = {0};
    qm_json_write_request(&text, request);
    char *body = qm_text_take(&text);
    if (!body) return NULL;
    talk->is_stream = true;
    talk->bar = bar;
    long status = transfer(talk, "/v1/jobs", body, strlen(body), "Accept: application/x-ndjson",
                           "Content-Type: application/json");
    cli_bar_clear(&talk->bar);
    free(body);
    if (!talk->result && status != 0)
        print_problem(talk, talk->server, talk->problem ? talk->problem : talk->body.data, status);
    talk->is_stream = false;
    char *result = talk->result;
    talk->result = NULL;
    return result;
}

bool cli_talk_fetch(cli_talk *talk, const char *path, const void *bytes, size_t size, const char *media,
                    const char *path_told, FILE *out)
{
    char accept[96];
    snprintf(accept, sizeof accept, "Accept: %s", media);
    talk->file = out;
    long status = transfer(talk, path, bytes, size, accept, "Content-Type: application/octet-stream");
    talk->file = NULL;
    if (status != 0 && status != 200) print_problem(talk, path_told, talk->body.data, status);
    return status == 200;
}
