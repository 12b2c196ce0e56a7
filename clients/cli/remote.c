/**
 * remote.c: the same question asked of a daemon: both files are uploaded, the job is streamed.
 */
#include <curl/curl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "cli.h"
#include "json_read.h"

#define URL_SIZE 2048

typedef struct conversation {
    CURL *curl;
    const cli_question *question;
    qm_text body; /* of a plain answer, or the unfinished line of a stream */
    bool is_stream;
    char job[256]; /* path of the job, once the daemon has told */
    bool is_cancelled;
    cli_bar bar;
    char *result;    /* the result object as the daemon wrote it */
    char *problem;   /* the problem document likewise */
    double diagonal; /* of A */
} conversation;

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

static void read_line(conversation *talk, const char *line)
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

static size_t on_bytes(char *bytes, size_t width, size_t count, void *user)
{
    conversation *talk = user;
    size_t size = width * count;
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
    conversation *talk = user;
    size_t size = width * count, skip = sizeof name - 1;
    if (talk->is_stream && size > skip && strncasecmp(bytes, name, skip) == 0) {
        size_t length = strcspn(bytes + skip, "\r\n");
        if (length < sizeof talk->job)
            snprintf(talk->job, sizeof talk->job, "%.*s", (int)length, bytes + skip);
    }
    return size;
}

/** The server's address with a path, without a slash too many. */
static void make_url(const conversation *talk, const char *path, char *url, size_t size)
{
    const char *server = talk->question->server;
    size_t length = strlen(server);
    while (length > 0 && server[length - 1] == '/')
        length--;
    snprintf(url, size, "%.*s%s", (int)length, server, path);
}

static size_t ignore_bytes(char *bytes, size_t width, size_t count, void *user)
{
    (void)bytes, (void)user;
    return width * count;
}

/** Asks the daemon to stop the job; its stream then ends with the bracket so far. */
static bool cancel_job(const conversation *talk)
{
    char url[URL_SIZE];
    CURL *curl = curl_easy_init();
    if (!curl) return false;
    make_url(talk, talk->job, url, sizeof url);
    curl_easy_setopt(curl, CURLOPT_URL, url);
    curl_easy_setopt(curl, CURLOPT_CUSTOMREQUEST, "DELETE");
    curl_easy_setopt(curl, CURLOPT_WRITEFUNCTION, ignore_bytes);
    CURLcode code = curl_easy_perform(curl);
    curl_easy_cleanup(curl);
    return code == CURLE_OK;
}

/** Called now and then during a transfer. An interrupt stops the job; before there is one, the transfer. */
static int on_tick(void *user, curl_off_t a, curl_off_t b, curl_off_t c, curl_off_t d)
{
    (void)a, (void)b, (void)c, (void)d;
    conversation *talk = user;
    if (!atomic_load(&cli_interrupted) || talk->is_cancelled) return 0;
    if (!talk->job[0] || !cancel_job(talk)) return 1;
    talk->is_cancelled = true;
    return 0;
}

static void complain_of_transfer(const conversation *talk, const char *url, CURLcode code)
{
    bool is_interrupted = code == CURLE_ABORTED_BY_CALLBACK;
    qm_problem problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "%s",
                                         is_interrupted ? "interrupted" : curl_easy_strerror(code));
    cli_complain(url, &problem, talk->question->as_json);
}

/** Posts bytes; returns the HTTP status, or 0 after words or a problem. */
static long post(conversation *talk, const char *path, const void *bytes, size_t size, const char *accept,
                 const char *type)
{
    char url[URL_SIZE];
    make_url(talk, path, url, sizeof url);
    struct curl_slist *headers = curl_slist_append(NULL, accept);
    headers = curl_slist_append(headers, type);
    qm_text_reset(&talk->body);
    curl_easy_setopt(talk->curl, CURLOPT_URL, url);
    curl_easy_setopt(talk->curl, CURLOPT_POSTFIELDS, bytes);
    curl_easy_setopt(talk->curl, CURLOPT_POSTFIELDSIZE_LARGE, (curl_off_t)size);
    curl_easy_setopt(talk->curl, CURLOPT_HTTPHEADER, headers);
    curl_easy_setopt(talk->curl, CURLOPT_WRITEFUNCTION, on_bytes);
    curl_easy_setopt(talk->curl, CURLOPT_WRITEDATA, talk);
    curl_easy_setopt(talk->curl, CURLOPT_HEADERFUNCTION, on_header);
    curl_easy_setopt(talk->curl, CURLOPT_HEADERDATA, talk);
    curl_easy_setopt(talk->curl, CURLOPT_XFERINFOFUNCTION, on_tick);
    curl_easy_setopt(talk->curl, CURLOPT_XFERINFODATA, talk);
    curl_easy_setopt(talk->curl, CURLOPT_NOPROGRESS, 0L);
    CURLcode code = curl_easy_perform(talk->curl);
    curl_slist_free_all(headers);
    long status = 0;
    if (code == CURLE_OK)
        curl_easy_getinfo(talk->curl, CURLINFO_RESPONSE_CODE, &status);
    else if (!talk->result) /* all that was wanted of the stream is there */
        complain_of_transfer(talk, url, code);
    return status;
}

/** There is no problem document to pass on: the stream was cut, or some other server answers. */
static void complain_of_answer(const conversation *talk, const char *path, long status)
{
    bool is_cut = talk->is_stream && status == 200;
    qm_problem problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE,
                                         is_cut ? "the stream ended without a result"
                                                : "the answer, with status %ld, is not quadmeshd's",
                                         status);
    cli_complain(path, &problem, talk->question->as_json);
}

/** Tells of a problem document as cli_complain does of a problem. */
static void print_problem(const conversation *talk, const char *path, const char *document, long status)
{
    qm_json *problem = document ? qm_json_parse(document) : NULL;
    const char *detail = qm_json_get_string(problem, "detail");
    if (!detail)
        complain_of_answer(talk, path, status);
    else if (talk->question->as_json)
        puts(document);
    else
        cli_print_problem(path, qm_json_get_number(problem, "errors.line"),
                          qm_json_get_number(problem, "errors.offset"), detail);
    qm_json_free(problem);
}

/** Uploads a file and writes its id; false after words or a problem. */
static bool upload(conversation *talk, const char *path, char id[QM_ID_SIZE])
{
    size_t size;
    uint8_t *bytes = cli_read_file(path, &size, talk->question->as_json);
    if (!bytes) return false;
    char target[1024];
    char *name = curl_easy_escape(talk->curl, cli_base_name(path), 0);
    snprintf(target, sizeof target, "/v1/meshes?name=%s", name ? name : "");
    curl_free(name);
    long status =
        post(talk, target, bytes, size, "Accept: application/json", "Content-Type: application/octet-stream");
    free(bytes);
    bool stored = status == 200 || status == 201;
    if (stored) {
        qm_json *mesh = qm_json_parse(talk->body.data);
        const char *given = qm_json_get_string(mesh, "id");
        snprintf(id, QM_ID_SIZE, "%s", given ? given : "");
        if (talk->diagonal == 0.0) talk->diagonal = qm_json_get_number(mesh, "bounding_box.diagonal");
        qm_json_free(mesh);
    } else if (status != 0) {
        print_problem(talk, path, talk->body.data, status);
    }
    return stored;
}

static int stream_job(conversation *talk, const qm_job_request *request)
{
    qm_text text = {0};
    qm_json_write_request(&text, request);
    char *body = qm_text_take(&text);
    if (!body) return EXIT_BAD_INPUT;
    talk->is_stream = true;
    talk->bar = cli_bar_make(request->tolerance * (request->tolerance_is_absolute ? 1.0 : talk->diagonal),
                             talk->question->shows_progress);
    long status = post(talk, "/v1/jobs", body, strlen(body), "Accept: application/x-ndjson",
                       "Content-Type: application/json");
    cli_bar_clear(&talk->bar);
    free(body);
    if (talk->result) return cli_print_result(talk->result, talk->question->as_json);
    if (status != 0)
        print_problem(talk, talk->question->server, talk->problem ? talk->problem : talk->body.data, status);
    return atomic_load(&cli_interrupted) ? EXIT_NOT_CONVERGED : EXIT_BAD_INPUT;
}

int cli_measure_there(const cli_question *question)
{
    curl_global_init(CURL_GLOBAL_DEFAULT);
    conversation talk = {.curl = curl_easy_init(), .question = question};
    qm_job_request request = question->request;
    int status = EXIT_BAD_INPUT;
    if (talk.curl && upload(&talk, question->path_a, request.a) && upload(&talk, question->path_b, request.b))
        status = stream_job(&talk, &request);
    curl_easy_cleanup(talk.curl);
    curl_global_cleanup();
    qm_text_reset(&talk.body);
    free(talk.result);
    free(talk.problem);
    return status;
}
