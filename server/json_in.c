#include "json_in.h"

#include <cjson/cJSON.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAX_THREADS 256

/** Depth of nesting before the parser sees the text: cJSON recurses. Brackets inside strings do not count. */
static bool is_too_deep(const char *text, size_t size)
{
    int depth = 0;
    bool in_string = false;
    for (size_t i = 0; i < size; i++) {
        char c = text[i];
        if (in_string) {
            if (c == '\\') i++;
            if (c == '"') in_string = false;
        } else if (c == '"') {
            in_string = true;
        } else if (c == '{' || c == '[') {
            if (++depth > QM_JSON_MAX_DEPTH) return true;
        } else if (c == '}' || c == ']') {
            depth--;
        }
    }
    return false;
}

/** One field that a job may have: reads the value or says what it should be. */
typedef struct field {
    const char *name;
    bool is_required;
    bool (*read)(const cJSON *value, qm_job_request *out);
    const char *expected;
} field;

static bool read_string(const cJSON *value, const char **out)
{
    *out = cJSON_GetStringValue(value);
    return *out != NULL;
}

static bool read_number(const cJSON *value, double *out)
{
    *out = cJSON_GetNumberValue(value);
    return cJSON_IsNumber(value) && isfinite(*out);
}

static bool read_id(const cJSON *value, char out[QM_ID_SIZE])
{
    const char *id;
    if (!read_string(value, &id) || !id[0] || strlen(id) >= QM_ID_SIZE) return false;
    strcpy(out, id);
    return true;
}

/** The place of a name in a NULL-ended list, or -1. */
static int find_name(const cJSON *value, const char *const *names)
{
    const char *given;
    if (!read_string(value, &given)) return -1;
    for (int i = 0; names[i]; i++)
        if (strcmp(given, names[i]) == 0) return i;
    return -1;
}

static bool read_type(const cJSON *value, qm_job_request *out)
{
    static const char *const names[] = {"hausdorff", NULL};
    out->kind = QM_JOB_HAUSDORFF;
    return find_name(value, names) >= 0;
}

static bool read_a(const cJSON *value, qm_job_request *out)
{
    return read_id(value, out->a);
}

static bool read_b(const cJSON *value, qm_job_request *out)
{
    return read_id(value, out->b);
}

static bool read_direction(const cJSON *value, qm_job_request *out)
{
    static const char *const names[] = {"two_sided", "a_to_b", "b_to_a", NULL};
    static const qm_direction directions[] = {QM_TWO_SIDED, QM_A_TO_B, QM_B_TO_A};
    int place = find_name(value, names);
    if (place >= 0) out->direction = directions[place];
    return place >= 0;
}

static bool read_quads(const cJSON *value, qm_job_request *out)
{
    static const char *const names[] = {"triangles", "bilinear", NULL};
    int place = find_name(value, names);
    if (place >= 0) out->quads = place == 1 ? QM_QUADS_BILINEAR : QM_QUADS_TRIANGLES;
    return place >= 0;
}

static bool read_tolerance(const cJSON *value, qm_job_request *out)
{
    return read_number(value, &out->tolerance) && out->tolerance > 0.0;
}

static bool read_tolerance_unit(const cJSON *value, qm_job_request *out)
{
    static const char *const names[] = {"relative", "absolute", NULL};
    int place = find_name(value, names);
    out->tolerance_is_absolute = place == 1;
    return place >= 0;
}

static bool read_threshold(const cJSON *value, qm_job_request *out)
{
    if (cJSON_IsNull(value)) return true;
    return read_number(value, &out->threshold) && out->threshold >= 0.0;
}

static bool read_deadline(const cJSON *value, qm_job_request *out)
{
    return read_number(value, &out->deadline_ms) && out->deadline_ms > 0.0;
}

static bool read_threads(const cJSON *value, qm_job_request *out)
{
    double threads;
    if (!read_number(value, &threads) || !(threads >= 1.0 && threads <= MAX_THREADS) ||
        threads != floor(threads))
        return false;
    out->threads = (int)threads;
    return true;
}

static bool read_detach(const cJSON *value, qm_job_request *out)
{
    out->detach = cJSON_IsTrue(value);
    return cJSON_IsBool(value);
}

static bool read_accelerator(const cJSON *value, qm_job_request *out)
{
    static const char *const names[] = {"auto", "boxes", NULL};
    (void)out;
    return find_name(value, names) >= 0;
}

static bool read_bounds(const cJSON *value, qm_job_request *out)
{
    static const char *const names[] = {"cells", NULL};
    (void)out;
    return find_name(value, names) >= 0;
}

static const field fields[] = {
    {"type", true, read_type, "must be \"hausdorff\""},
    {"a", true, read_a, "must be the id of a mesh"},
    {"b", true, read_b, "must be the id of a mesh"},
    {"direction", false, read_direction, "must be \"two_sided\", \"a_to_b\" or \"b_to_a\""},
    {"quads", false, read_quads, "must be \"triangles\" or \"bilinear\""},
    {"tolerance", false, read_tolerance, "must be a number above 0"},
    {"tolerance_unit", false, read_tolerance_unit, "must be \"relative\" or \"absolute\""},
    {"threshold", false, read_threshold, "must be a number of 0 or more, or null"},
    {"deadline_ms", false, read_deadline, "must be a number above 0"},
    {"threads", false, read_threads, "must be a whole number from 1 to 256"},
    {"detach", false, read_detach, "must be true or false"},
    {"accelerator", false, read_accelerator, "must be \"auto\" or \"boxes\""},
    {"bounds", false, read_bounds, "must be \"cells\""},
};
enum { FIELD_COUNT = sizeof fields / sizeof fields[0] };

static const field *find_field(const char *name)
{
    for (size_t i = 0; i < FIELD_COUNT; i++)
        if (strcmp(fields[i].name, name) == 0) return &fields[i];
    return NULL;
}

/** A JSON pointer to a member: ~ and / of the name are written ~0 and ~1; long names and odd bytes are
 * shortened. */
static void make_pointer(char out[96], const char *name)
{
    size_t length = 0;
    out[length++] = '/';
    for (const char *c = name; *c && length < 64; c++) {
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
}

static void complain(qm_problem *problem, const char *name, const char *words)
{
    char pointer[96];
    make_pointer(pointer, name);
    if (problem->error_count == 0)
        *problem = qm_problem_make(QM_PROBLEM_INVALID_FIELD, "%s %s", pointer + 1, words);
    qm_problem_add_pointer(problem, pointer, "%s", words);
}

static void read_members(const cJSON *object, qm_job_request *out, qm_problem *problem)
{
    bool seen[FIELD_COUNT] = {false};
    for (const cJSON *member = object->child; member; member = member->next) {
        const field *known = find_field(member->string);
        if (!known)
            complain(problem, member->string, "is not a field of a job");
        else if (seen[known - fields])
            complain(problem, member->string, "is given twice");
        else if (!known->read(member, out))
            complain(problem, member->string, known->expected);
        if (known) seen[known - fields] = true;
    }
    for (size_t i = 0; i < FIELD_COUNT; i++)
        if (fields[i].is_required && !seen[i]) complain(problem, fields[i].name, "is missing");
}

static bool is_utf8(const char *text, size_t size)
{
    for (size_t i = 0; i < size;) {
        unsigned char c = (unsigned char)text[i++];
        int more = c < 0x80                ? 0
                   : c >= 0xc2 && c < 0xe0 ? 1
                   : c >= 0xe0 && c < 0xf0 ? 2
                   : c >= 0xf0 && c < 0xf5 ? 3
                                           : -1;
        if (more < 0) return false;
        for (; more > 0; more--, i++)
            if (i == size || ((unsigned char)text[i] & 0xc0) != 0x80) return false;
    }
    return true;
}

bool qm_json_read_job(const char *text, size_t size, qm_job_request *out, qm_problem *problem)
{
    *out = qm_job_request_default();
    *problem = (qm_problem){0};
    if (is_too_deep(text, size) || !is_utf8(text, size)) {
        *problem = qm_problem_make(QM_PROBLEM_MALFORMED_JSON,
                                   "the body must be UTF-8, nested at most %d deep", QM_JSON_MAX_DEPTH);
        return false;
    }
    const char *end = NULL;
    cJSON *tree = cJSON_ParseWithLengthOpts(text, size, &end, false);
    const char *rest = end;
    while (tree && rest < text + size && strchr(" \t\r\n", *rest) && *rest)
        rest++;
    if (!tree || rest != text + size) {
        size_t place = end ? (size_t)(end - text) : 0;
        *problem =
            qm_problem_make(QM_PROBLEM_MALFORMED_JSON, "the JSON ends to make sense at byte %zu", place);
        problem->error_count = 1;
        problem->errors[0] =
            (qm_problem_error){.line = QM_NO_PLACE, .offset = place, .detail = "unexpected text"};
    } else if (!cJSON_IsObject(tree)) {
        *problem = qm_problem_make(QM_PROBLEM_INVALID_FIELD, "a job is a JSON object");
        qm_problem_add_pointer(problem, "", "must be an object");
    } else {
        read_members(tree, out, problem);
    }
    cJSON_Delete(tree);
    return problem->detail[0] == '\0';
}
