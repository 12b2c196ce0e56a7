/**
 * handle_page.c: the page at /, its modules under /dashboard/, the API's description, which are text files of one
 * folder, and a page for each problem code.
 */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/id.h"
#include "handlers.h"
#include "mesh/etag.h"

/** Only files of these kinds are served. The route ensures that no path leads out of the folder. */
static const struct {
    const char *ending, *type;
} kinds[] = {
    {".html", "text/html; charset=utf-8"},
    {".js", "text/javascript; charset=utf-8"},
    {".css", "text/css; charset=utf-8"},
    {".svg", "image/svg+xml"},
};

static const char *type_of(const char *path)
{
    const char *ending = strrchr(path, '.');
    for (size_t i = 0; ending && i < sizeof kinds / sizeof kinds[0]; i++)
        if (strcmp(kinds[i].ending, ending) == 0) return kinds[i].type;
    return NULL;
}

/** Outcome of reading a file. */
typedef enum reading { READ, NOT_THERE, NO_MEMORY } reading;

/** The text of an installed file, malloc'ed. */
static reading read_file(const char *path, char **text)
{
    errno = 0;
    FILE *file = fopen(path, "rb");
    if (!file) return errno == ENOMEM ? NO_MEMORY : NOT_THERE;
    struct stat facts;
    size_t room = fstat(fileno(file), &facts) == 0 ? (size_t)facts.st_size : 0;
    *text = malloc(room + 1);
    size_t size = *text ? fread(*text, 1, room, file) : 0;
    if (*text) (*text)[size] = '\0';
    fclose(file);
    return *text ? READ : NO_MEMORY;
}

/** Takes over the text. Browsers revalidate it each time, and get a 304 for an unchanged one. */
static void reply_file(qm_request *request, const char *content_type, char *text)
{
    char hash[QM_HASH_SIZE], tag[QM_HASH_SIZE + 2];
    qm_id_hash_text(text, strlen(text), hash);
    snprintf(tag, sizeof tag, "\"%s\"", hash);
    qm_reply_header(request, "Cache-Control", "no-cache");
    qm_reply_header(request, "ETag", "%s", tag);
    if (!qm_etag_is_listed(qm_request_header(request, "If-None-Match"), tag, true)) {
        qm_reply_text(request, 200, content_type, text);
        return;
    }
    free(text);
    qm_reply_empty(request, 304);
}

static void reply_missing(qm_request *request, reading why)
{
    qm_problem problem = why == NO_MEMORY
                             ? qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the reply")
                             : qm_problem_make(QM_PROBLEM_NOT_FOUND, "there is no resource at this path");
    qm_reply_problem(request, &problem);
}

/** Replies with a file of the folder. */
static reading read_named(const qm_request *request, const char *name, char **text)
{
    char path[4096];
    const char *folder = qm_request_app(request)->config->dashboard;
    snprintf(path, sizeof path, "%s/%s", folder, name);
    return folder[0] ? read_file(path, text) : NOT_THERE;
}

void qm_handle_openapi(qm_request *request)
{
    char *text;
    reading outcome = read_named(request, "openapi.yaml", &text);
    if (outcome == READ)
        reply_file(request, "application/yaml", text);
    else
        reply_missing(request, outcome);
}

/** Allows the daemon's own scripts, and the one import map in the page, which cannot be a file. */
static void add_policy(qm_request *request, const char *page)
{
    static const char before[] = "<script type=\"importmap\">";
    const char *map = strstr(page, before), *end = map ? strstr(map, "</script>") : NULL;
    char script[QM_HASH_BASE64_SIZE + 16] = "";
    if (end) {
        char hash[QM_HASH_BASE64_SIZE];
        map += strlen(before);
        qm_id_hash_text_base64(map, (size_t)(end - map), hash);
        snprintf(script, sizeof script, " 'sha256-%s'", hash);
    }
    qm_reply_header(request, "Content-Security-Policy",
                    "default-src 'self'; script-src 'self'%s; img-src 'self' blob:; object-src 'none'; "
                    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
                    script);
    qm_reply_header(request, "Referrer-Policy", "no-referrer");
}

/** The viewer sets styles of elements; only scripts of the daemon run. */
void qm_handle_docs(qm_request *request)
{
    char *text;
    reading outcome = read_named(request, "docs.html", &text);
    if (outcome != READ) {
        reply_missing(request, outcome);
        return;
    }
    qm_reply_header(
        request, "Content-Security-Policy",
        "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; base-uri 'none'; "
        "form-action 'none'; frame-ancestors 'none'");
    reply_file(request, type_of("docs.html"), text);
}

/** The texts have no character that HTML would read as markup. */
void qm_handle_problem(qm_request *request)
{
    qm_problem_code code;
    if (!qm_problem_find(qm_request_id(request), &code)) {
        reply_missing(request, NOT_THERE);
        return;
    }
    qm_text out = {0};
    qm_text_printf(&out,
                   "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n"
                   "<meta name=\"viewport\" content=\"width=device-width\">\n<title>%s</title>\n"
                   "<h1>%s</h1>\n<p><code>%s</code>, status %d</p>\n<p>%s</p>\n<p><a href=\"/docs\">All of "
                   "the API</a></p>\n",
                   qm_problem_name(code), qm_problem_title(code), qm_problem_name(code),
                   qm_problem_status(code), qm_problem_explanation(code));
    qm_reply_header(request, "Content-Security-Policy",
                    "default-src 'none'; base-uri 'none'; frame-ancestors 'none'");
    qm_reply_text(request, 200, "text/html; charset=utf-8", qm_text_take(&out));
}

void qm_handle_page(qm_request *request)
{
    const char *id = qm_request_id(request), *name = id[0] ? id : "index.html", *type = type_of(name);
    char *text;
    reading outcome = type ? read_named(request, name, &text) : NOT_THERE;
    if (outcome != READ) {
        reply_missing(request, outcome);
        return;
    }
    if (strcmp(name, "index.html") == 0) add_policy(request, text);
    reply_file(request, type, text);
}
