/**
 * json_request.c: JSON of requests to values, with a JSON pointer or byte offset for every fault.
 */
#include "json_request.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/json.h"
#include "qm/reconstruct.h"

#define MAX_INDEX 2147483647.0
#define POINTER_SIZE sizeof(((qm_problem_error *)NULL)->pointer)

/* ---- the object of a body ---- */

static qm_problem malformed_at(size_t offset, const char *message)
{
    qm_problem problem = qm_problem_make(QM_PROBLEM_MALFORMED_JSON, "%s at byte %zu", message, offset);
    qm_problem_add_offset(&problem, offset, message);
    return problem;
}

/** Parses the whole text; NULL with a problem if it is not exactly one JSON value. */
static cJSON *parse(const char *text, size_t size, qm_problem *problem)
{
    const char *end;
    bool no_memory;
    cJSON *tree = qm_json_parse_tree(text, size, &end, &no_memory);
    const char *tail = end;
    while (tree && tail < text + size && *tail && strchr(" \t\r\n", *tail))
        tail++;
    if (tree && tail == text + size) return tree;
    if (no_memory)
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the JSON");
    else
        *problem = malformed_at((size_t)((tree ? tail : end) - text), "the JSON cannot be read");
    cJSON_Delete(tree);
    return NULL;
}

cJSON *qm_json_parse_object(const char *text, size_t size, const char *noun, qm_problem *problem)
{
    *problem = (qm_problem){0};
    size_t offset;
    const char *message;
    if (size == 0) {
        *problem =
            qm_problem_make(QM_PROBLEM_MALFORMED_JSON, "the body is empty; %s must be a JSON object", noun);
        qm_problem_add_offset(problem, 0, "is empty");
        return NULL;
    }
    if (!qm_json_check_text(text, size, &offset, &message)) {
        *problem = malformed_at(offset, message);
        return NULL;
    }
    cJSON *tree = parse(text, size, problem);
    if (!tree || cJSON_IsObject(tree)) return tree;
    *problem = qm_problem_make(QM_PROBLEM_INVALID_FIELD, "%s must be a JSON object", noun);
    qm_problem_add_pointer(problem, "", "must be an object");
    cJSON_Delete(tree);
    return NULL;
}

/* ---- values ---- */

bool qm_json_read_number(const cJSON *value, double *out)
{
    *out = cJSON_GetNumberValue(value);
    return cJSON_IsNumber(value) && isfinite(*out);
}

bool qm_json_read_noise(const cJSON *value, double *out)
{
    if (cJSON_IsString(value) && strcmp(value->valuestring, "automatic") == 0) {
        *out = QM_NOISE_AUTOMATIC;
        return true;
    }
    return qm_json_read_number(value, out) && *out >= 0.0 && *out <= QM_NOISE_MAX;
}

bool qm_json_find_noise(const char *members, double *out)
{
    qm_text text = {0};
    qm_text_add_string(&text, "{");
    qm_text_add_string(&text, members);
    qm_text_add_string(&text, "}");
    char *whole = qm_text_take(&text);
    cJSON *object = whole ? cJSON_Parse(whole) : NULL;
    const cJSON *noise = cJSON_GetObjectItemCaseSensitive(object, "noise");
    *out = 0.0;
    bool is_read = object && (!noise || qm_json_read_noise(noise, out));
    cJSON_Delete(object);
    free(whole);
    return is_read;
}

bool qm_json_read_integer(const cJSON *value, double min, double max, double *out)
{
    QM_ASSERT(min <= max);
    return qm_json_read_number(value, out) && *out >= min && *out <= max && *out == floor(*out);
}

bool qm_json_read_count(const cJSON *value, double min, double max, size_t *out)
{
    double count;
    if (!qm_json_read_integer(value, min, max, &count)) return false;
    *out = (size_t)count;
    return true;
}

int qm_json_find_name(const cJSON *value, const char *const *names)
{
    const char *given = cJSON_GetStringValue(value);
    for (int i = 0; given && names[i]; i++)
        if (strcmp(given, names[i]) == 0) return i;
    return -1;
}

bool qm_json_read_index(const cJSON *value, uint32_t *out)
{
    double number;
    if (!qm_json_read_integer(value, 0.0, MAX_INDEX, &number)) return false;
    *out = (uint32_t)number;
    return true;
}

bool qm_json_read_numbers(const cJSON *value, int count, double *out)
{
    if (!cJSON_IsArray(value) || cJSON_GetArraySize(value) != count) return false;
    for (const cJSON *number = value->child; number; number = number->next)
        if (!qm_json_read_number(number, out++)) return false;
    return true;
}

/** Reads an array of records of width finite numbers; the rules of qm_json_read_points hold. */
static bool read_records(const cJSON *value, int width, double **out, size_t *count, qm_json_location *at)
{
    QM_ASSERT(!*out && *count == 0);
    if (!cJSON_IsArray(value)) return false;
    size_t capacity = (size_t)cJSON_GetArraySize(value);
    if (capacity == 0) return true;
    *out = malloc(capacity * (size_t)width * sizeof **out);
    if (!*out) {
        at->no_memory = true;
        return false;
    }
    for (const cJSON *record = value->child; record; record = record->next) {
        *at = (qm_json_location){.depth = 1, .index = {*count}};
        if (!cJSON_IsArray(record) || cJSON_GetArraySize(record) != width) return false;
        at->depth = 2;
        for (const cJSON *number = record->child; number; number = number->next, at->index[1]++)
            if (!qm_json_read_number(number, &(*out)[(size_t)width * *count + at->index[1]])) return false;
        ++*count;
    }
    QM_ASSERT(*count == capacity);
    return true;
}

bool qm_json_read_points(const cJSON *value, double **points, size_t *count, qm_json_location *at)
{
    return read_records(value, 3, points, count, at);
}

/* ---- reports ---- */

#define MAX_NAME 64 /* characters of a name in a pointer */

/** Adds a name to a pointer: its ~ and / become ~0 and ~1; a long one is cut off, and control characters and non-ASCII bytes
 * become "?". Returns the new length. */
static size_t point_to(char out[POINTER_SIZE], size_t length, const char *name)
{
    size_t room = POINTER_SIZE - 4; /* for a slash, a character of two, and the end */
    size_t end = length + MAX_NAME < room ? length + MAX_NAME : room;
    out[length++] = '/';
    for (const char *c = name; *c && length < end; c++) {
        if ((unsigned char)*c < 0x20 || (unsigned char)*c >= 0x7f) {
            out[length++] = '?';
        } else if (*c == '~' || *c == '/') {
            out[length++] = '~';
            out[length++] = *c == '~' ? '0' : '1';
        } else {
            out[length++] = *c;
        }
    }
    out[length] = '\0';
    return length;
}

/** A JSON pointer to a member, or to an entry of it. */
static void make_pointer(char out[POINTER_SIZE], const char *name, const qm_json_location *at)
{
    QM_ASSERT(at->depth <= 2);
    size_t length = point_to(out, 0, name);
    for (int i = 0; i <= at->depth; i++) {
        if (at->member && i == at->member_depth) length = point_to(out, length, at->member);
        if (i < at->depth)
            length += (size_t)snprintf(out + length, POINTER_SIZE - length, "/%zu", at->index[i]);
    }
}

void qm_json_report_at(qm_problem *problem, const char *name, const qm_json_location *at, const char *message)
{
    char pointer[POINTER_SIZE];
    make_pointer(pointer, name, at);
    if (at->detail[0]) message = at->detail;
    if (at->no_memory) message = "does not fit in memory";
    qm_problem_code code = at->no_memory ? QM_PROBLEM_OUT_OF_MEMORY : QM_PROBLEM_INVALID_FIELD;
    bool overrides = code == QM_PROBLEM_INVALID_FIELD && problem->code != code;
    if (problem->error_count == 0 || overrides) {
        problem->code = code;
        snprintf(problem->detail, sizeof problem->detail, "%s %s", pointer + 1, message);
    }
    qm_problem_add_pointer(problem, pointer, "%s", message);
}

void qm_json_report(qm_problem *problem, const char *name, const char *message)
{
    qm_json_report_at(problem, name, &(qm_json_location){0}, message);
}

bool qm_json_read_transform(const cJSON *value, double out[QM_TRANSFORM_SIZE], qm_json_location *at)
{
    snprintf(at->detail, sizeof at->detail, "must be 16 finite numbers, the columns of a 4 x 4 matrix");
    if (!cJSON_IsArray(value) || cJSON_GetArraySize(value) != QM_TRANSFORM_SIZE) return false;
    at->depth++;
    int i = 0;
    for (const cJSON *number = value->child; number; number = number->next, i++) {
        at->index[at->depth - 1] = (size_t)i;
        if (!qm_json_read_number(number, &out[i])) return false;
    }
    at->depth--;
    qm_context ctx = qm_context_make();
    if (qm_transform_check(&ctx, out) != QM_OK) {
        snprintf(at->detail, sizeof at->detail, "cannot move a mesh: %.100s", ctx.message);
        return false;
    }
    at->detail[0] = '\0';
    return true;
}

bool qm_json_reject(qm_problem *problem, const char *message, const char *format, size_t i, size_t k)
{
    char pointer[64];
    snprintf(pointer, sizeof pointer, format, i, k);
    QM_ASSERT(pointer[0] == '/');
    *problem = qm_problem_make(QM_PROBLEM_INVALID_FIELD, "%s %s", pointer + 1, message);
    qm_problem_add_pointer(problem, pointer, "%s", message);
    return false;
}

bool qm_json_is_repeated(const cJSON *object, const cJSON *member)
{
    const cJSON *first = object->child;
    while (strcmp(first->string, member->string) != 0)
        first = first->next;
    return first != member;
}

bool qm_json_check_members(const cJSON *object, const char *const *known, qm_problem *problem)
{
    for (const cJSON *member = object->child; member; member = member->next) {
        size_t i = 0;
        while (known[i] && strcmp(known[i], member->string) != 0)
            i++;
        if (known[i]) continue;
        *problem = (qm_problem){.code = QM_PROBLEM_INVALID_FIELD};
        qm_json_report(problem, member->string, "is not a field of this request");
        return false;
    }
    return true;
}

bool qm_json_read_table(const cJSON *value, int width, size_t min_count, const char *name, double **out,
                        size_t *count, qm_problem *problem)
{
    char pointer[48], message[64];
    snprintf(pointer, sizeof pointer, "/%s", name);
    snprintf(message, sizeof message, "must be an array of %zu or more arrays of %d finite numbers",
             min_count, width);
    *out = NULL;
    *count = 0;
    if (!cJSON_IsArray(value) || (size_t)cJSON_GetArraySize(value) < min_count)
        return qm_json_reject(problem, message, pointer, 0, 0);
    qm_json_location at = {0};
    if (read_records(value, width, out, count, &at)) return true;
    free(*out);
    *out = NULL;
    if (at.no_memory) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the layout");
        return false;
    }
    snprintf(pointer, sizeof pointer, "/%s/%%zu", name);
    return qm_json_reject(problem, message, pointer, at.index[0], 0);
}

bool qm_json_read_deadline(const cJSON *object, double *out, qm_problem *problem)
{
    const cJSON *value = cJSON_GetObjectItemCaseSensitive(object, "deadline_ms");
    *out = 0.0;
    if (!value || (qm_json_read_number(value, out) && *out > 0.0)) return true;
    return qm_json_reject(problem, "must be a number above 0", "/deadline_ms", 0, 0);
}

bool qm_json_read_id(const cJSON *object, const char *name, char out[QM_ID_SIZE], qm_problem *problem)
{
    const char *id = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(object, name));
    char pointer[32], message[48];
    snprintf(pointer, sizeof pointer, "/%s", name);
    snprintf(message, sizeof message, "must be the id of a %s", strcmp(name, "layout") == 0 ? name : "mesh");
    if (!id || !*id || strlen(id) >= QM_ID_SIZE) return qm_json_reject(problem, message, pointer, 0, 0);
    snprintf(out, QM_ID_SIZE, "%s", id);
    return true;
}
