/**
 * remote.c: the same question asked of a daemon: both files are uploaded, the job is streamed.
 */
#include <curl/curl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli.h"
#include "json_read.h"

typedef struct conversation {
    CURL *curl;
    const cli_question *question;
    qm_text body; /* of a plain answer, or the unfinished line of a stream */
    bool is_stream;
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

static int on_tick(void *user, curl_off_t a, curl_off_t b, curl_off_t c, curl_off_t d)
{
    (void)user, (void)a, (void)b, (void)c, (void)d;
    return atomic_load(&cli_interrupted) ? 1 : 0;
}

/** Posts bytes; returns the HTTP status, or 0 after words on stderr. */
static long post(conversation *talk, const char *path, const void *bytes, size_t size, const char *header)
{
    char url[2048];
    snprintf(url, sizeof url, "%s%s", talk->question->server, path);
    struct curl_slist *headers = curl_slist_append(NULL, header);
    headers = curl_slist_append(headers, strstr(path, "/jobs") ? "Content-Type: application/json"
                                                               : "Content-Type: application/octet-stream");
    qm_text_reset(&talk->body);
    curl_easy_setopt(talk->curl, CURLOPT_URL, url);
    curl_easy_setopt(talk->curl, CURLOPT_POSTFIELDS, bytes);
    curl_easy_setopt(talk->curl, CURLOPT_POSTFIELDSIZE_LARGE, (curl_off_t)size);
    curl_easy_setopt(talk->curl, CURLOPT_HTTPHEADER, headers);
    curl_easy_setopt(talk->curl, CURLOPT_WRITEFUNCTION, on_bytes);
    curl_easy_setopt(talk->curl, CURLOPT_WRITEDATA, talk);
    curl_easy_setopt(talk->curl, CURLOPT_XFERINFOFUNCTION, on_tick);
    curl_easy_setopt(talk->curl, CURLOPT_NOPROGRESS, 0L);
    CURLcode code = curl_easy_perform(talk->curl);
    long status = 0;
    if (code == CURLE_OK)
        curl_easy_getinfo(talk->curl, CURLINFO_RESPONSE_CODE, &status);
    else
        fprintf(stderr, "quadmesh: %s: %s\n", url, curl_easy_strerror(code));
    curl_slist_free_all(headers);
    return status;
}

static void print_problem(const conversation *talk, const char *path, const char *document)
{
    if (talk->question->as_json) {
        puts(document);
        return;
    }
    qm_json *problem = qm_json_parse(document);
    const char *detail = qm_json_get_string(problem, "detail");
    fprintf(stderr, "quadmesh: %s: %s\n", path, detail ? detail : document);
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
    long status = post(talk, target, bytes, size, "Accept: application/json");
    free(bytes);
    bool stored = status == 200 || status == 201;
    if (stored) {
        qm_json *mesh = qm_json_parse(talk->body.data);
        const char *given = qm_json_get_string(mesh, "id");
        snprintf(id, QM_ID_SIZE, "%s", given ? given : "");
        if (talk->diagonal == 0.0) talk->diagonal = qm_json_get_number(mesh, "bounding_box.diagonal");
        qm_json_free(mesh);
    } else if (status != 0) {
        print_problem(talk, path, talk->body.data ? talk->body.data : "");
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
    talk->bar = cli_bar_make(request->tolerance * (request->tolerance_is_absolute ? 1.0 : talk->diagonal));
    long status = post(talk, "/v1/jobs", body, strlen(body), "Accept: application/x-ndjson");
    cli_bar_clear(&talk->bar);
    free(body);
    if (talk->result) return cli_print_result(talk->result, talk->question->as_json);
    if (status != 0)
        print_problem(talk, talk->question->server,
                      talk->problem     ? talk->problem
                      : talk->body.data ? talk->body.data
                                        : "the stream was cut");
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
