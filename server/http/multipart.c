/**
 * multipart.c: finds the boundaries in a body of multipart/form-data, and reads the headers of its parts.
 */
#include "multipart.h"

#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "media.h"

#define MAX_LINE 1024 /* bytes of a header of a part */
#define MAX_HEADERS 16

/** The place in a body that is read. */
typedef struct reader {
    const uint8_t *body;
    size_t size, at;
    char mark[QM_MULTIPART_BOUNDARY_SIZE + 4]; /* CRLF, two hyphens, the boundary */
    size_t mark_size;
    qm_problem *problem;
} reader;

static bool fail(reader *r, const char *message)
{
    *r->problem = qm_problem_make(QM_PROBLEM_MALFORMED_BODY, "%s", message);
    qm_problem_add_offset(r->problem, r->at, message);
    return false;
}

/* ---- parameters: "; name=value" ---- */

/** Reads a value: a word, or text in quotes with backslashes before quotes and backslashes. Returns what follows; NULL when it has no
 * end, or no room in out. */
static const char *read_value(const char *text, char *out, size_t room)
{
    size_t length = 0;
    bool is_quoted = *text == '"';
    if (is_quoted) text++;
    for (; *text && (is_quoted ? *text != '"' : !strchr("; \t", *text)); text++) {
        if (is_quoted && *text == '\\' && (text[1] == '"' || text[1] == '\\')) text++;
        if (length + 1 == room) return NULL;
        out[length++] = *text;
    }
    out[length] = '\0';
    if (is_quoted && *text != '"') return NULL;
    return is_quoted ? text + 1 : text;
}

/** Writes the value of a parameter, or "" when there is none; false when the parameters do not follow the form. */
static bool find_parameter(const char *text, const char *name, char *out, size_t room)
{
    char value[QM_MULTIPART_NAME_SIZE];
    bool is_found = false;
    out[0] = '\0';
    text += strcspn(text, ";");
    while (*text == ';') {
        text += strspn(text, "; \t");
        size_t length = strcspn(text, "=; \t");
        const char *own = text;
        if (length == 0 && !*text) return true;
        if (text[length] != '=') return false;
        text = read_value(text + length + 1, value, sizeof value);
        if (!text) return false;
        if (!is_found && length == strlen(name) && strncasecmp(own, name, length) == 0) {
            if (strlen(value) >= room) return false;
            snprintf(out, room, "%s", value);
            is_found = true;
        }
        text += strspn(text, " \t");
    }
    return *text == '\0';
}

bool qm_multipart_read_boundary(const char *content_type, char out[QM_MULTIPART_BOUNDARY_SIZE])
{
    return content_type && qm_media_is(content_type, "multipart/form-data") &&
           find_parameter(content_type, "boundary", out, QM_MULTIPART_BOUNDARY_SIZE) && out[0];
}

/* ---- parts ---- */

/** Reads a line that ends with CRLF; false with a problem. */
static bool read_line(reader *r, char line[MAX_LINE])
{
    const uint8_t *start = r->body + r->at;
    size_t rest = r->size - r->at, most = rest < MAX_LINE ? rest : MAX_LINE;
    const uint8_t *end = memmem(start, most, "\r\n", 2);
    if (!end)
        return fail(r, rest < MAX_LINE ? "a header of a part has no end" : "a header of a part is too long");
    size_t length = (size_t)(end - start);
    if (memchr(start, '\0', length)) return fail(r, "a header of a part has a byte 0");
    memcpy(line, start, length);
    line[length] = '\0';
    r->at += length + 2;
    return true;
}

/** The value of a header line of this name, or NULL. */
static const char *value_of(const char *line, const char *name)
{
    size_t length = strlen(name);
    if (strncasecmp(line, name, length) != 0 || line[length] != ':') return NULL;
    line += length + 1;
    return line + strspn(line, " \t");
}

static bool take_header(reader *r, const char *line, qm_multipart_part *out)
{
    const char *disposition = value_of(line, "Content-Disposition"), *type = value_of(line, "Content-Type"),
               *encoding = value_of(line, "Content-Transfer-Encoding");
    if (encoding && strcasecmp(encoding, "binary") != 0 && strcasecmp(encoding, "8bit") != 0 &&
        strcasecmp(encoding, "7bit") != 0)
        return fail(r, "the Content-Transfer-Encoding of a part must be binary");
    if (type) snprintf(out->type, sizeof out->type, "%s", type);
    if (!disposition) return true;
    if (strncasecmp(disposition, "form-data", strlen("form-data")) != 0 ||
        !find_parameter(disposition, "name", out->name, sizeof out->name) ||
        !find_parameter(disposition, "filename", out->file_name, sizeof out->file_name))
        return fail(r,
                    "the Content-Disposition of a part must be form-data with names of less than 200 bytes");
    return true;
}

/** Reads the headers of a part up to the empty line, and its content up to the next boundary. */
static bool read_part(reader *r, qm_multipart_part *out)
{
    char line[MAX_LINE];
    *out = (qm_multipart_part){.size = 0};
    for (int i = 0; i <= MAX_HEADERS; i++) {
        if (!read_line(r, line)) return false;
        if (!line[0]) break;
        if (i == MAX_HEADERS) return fail(r, "a part has too many headers");
        if (!take_header(r, line, out)) return false;
    }
    if (!out->name[0]) return fail(r, "a part has no name");
    out->offset = r->at;
    /* An empty content shares its line end with that of the headers. */
    size_t from = r->at - 2;
    const uint8_t *end = memmem(r->body + from, r->size - from, r->mark, r->mark_size);
    if (!end) {
        r->at = r->size;
        return fail(r, "the last part has no end");
    }
    size_t mark_at = (size_t)(end - r->body);
    out->size = mark_at > out->offset ? mark_at - out->offset : 0;
    r->at = mark_at + r->mark_size;
    return true;
}

/** Reads what follows a boundary: two hyphens after the last part (*is_last), else the end of the line. */
static bool read_end_of_mark(reader *r, bool *is_last)
{
    const uint8_t *text = r->body + r->at;
    size_t rest = r->size - r->at;
    *is_last = rest >= 2 && memcmp(text, "--", 2) == 0;
    if (*is_last) return true;
    size_t blanks = 0;
    while (blanks < rest && (text[blanks] == ' ' || text[blanks] == '\t'))
        blanks++;
    if (rest - blanks < 2 || memcmp(text + blanks, "\r\n", 2) != 0)
        return fail(r, "a boundary must end its line");
    r->at += blanks + 2;
    return true;
}

bool qm_multipart_split(const uint8_t *body, size_t size, const char *boundary, qm_multipart_part *out,
                        size_t room, size_t *count, qm_problem *problem)
{
    reader r = {.body = body, .size = size, .problem = problem};
    *count = 0;
    r.mark_size = (size_t)snprintf(r.mark, sizeof r.mark, "\r\n--%s", boundary);
    QM_ASSERT(r.mark_size < sizeof r.mark);
    /* The first boundary may begin the body; what is before it is not for us. */
    if (size == 0) return fail(&r, "the body is empty");
    const uint8_t *first = size >= r.mark_size - 2 && memcmp(body, r.mark + 2, r.mark_size - 2) == 0
                               ? body
                               : memmem(body, size, r.mark, r.mark_size);
    if (!first) return fail(&r, "the body does not have the boundary that its Content-Type names");
    r.at = (size_t)(first - body) + (first == body && body[0] == '-' ? r.mark_size - 2 : r.mark_size);
    for (;;) {
        bool is_last;
        if (!read_end_of_mark(&r, &is_last)) return false;
        if (is_last) return true;
        if (*count == room) return fail(&r, "the body has too many parts");
        if (!read_part(&r, &out[*count])) return false;
        (*count)++;
    }
}
