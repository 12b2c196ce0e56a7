#include "json_in.h"

#include <cjson/cJSON.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "utf8.h"

#define MAX_THREADS 256

/**
 * The place where nesting goes too deep, or size. Looked for before the parser sees the text, because it
 * recurses. Brackets inside strings do not count.
 */
static size_t find_too_deep(const char *text, size_t size)
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
            if (++depth > QM_JSON_MAX_DEPTH) return i;
        } else if (c == '}' || c == ']') {
            depth--;
        }
    }
    return size;
}

/** One field that a job may have: reads the value or says what it should be. */
typedef struct field {
    const char *name;
    bool is_required;
    bool (*read)(const cJSON *value, qm_job_request *out);
    const char *expected;
    const char *const
        *later; /* values that the API knows and this version cannot serve; NULL-ended, or NULL */
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

static const char *const later_accelerators[] = {"grid", "tetra", NULL};
static const char *const later_bounds[] = {"matching", NULL};

static const field fields[] = {
    {"type", true, read_type, "must be \"hausdorff\"", NULL},
    {"a", true, read_a, "must be the id of a mesh", NULL},
    {"b", true, read_b, "must be the id of a mesh", NULL},
    {"direction", false, read_direction, "must be \"two_sided\", \"a_to_b\" or \"b_to_a\"", NULL},
    {"quads", false, read_quads, "must be \"triangles\" or \"bilinear\"", NULL},
    {"tolerance", false, read_tolerance, "must be a number above 0", NULL},
    {"tolerance_unit", false, read_tolerance_unit, "must be \"relative\" or \"absolute\"", NULL},
    {"threshold", false, read_threshold, "must be a number of 0 or more, or null", NULL},
    {"deadline_ms", false, read_deadline, "must be a number above 0", NULL},
    {"threads", false, read_threads, "must be a whole number from 1 to 256", NULL},
    {"detach", false, read_detach, "must be true or false", NULL},
    {"accelerator", false, read_accelerator, "must be \"auto\" or \"boxes\"", later_accelerators},
    {"bounds", false, read_bounds, "must be \"cells\"", later_bounds},
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

/** Adds a fault. The problem as a whole takes code and words from its first one; a fault that is plainly
 * invalid takes over from values that are only not available, as the request would stay refused. */
static void complain(qm_problem *problem, qm_problem_code code, const char *name, const char *words)
{
    char pointer[96];
    make_pointer(pointer, name);
    bool takes_over = code == QM_PROBLEM_INVALID_FIELD && problem->code != code;
    if (problem->error_count == 0 || takes_over) {
        problem->code = code;
        snprintf(problem->detail, sizeof problem->detail, "%s %s", pointer + 1, words);
    }
    qm_problem_add_pointer(problem, pointer, "%s", words);
}

/** Reads one member that is known and given for the first time. */
static void read_member(const field *known, const cJSON *member, qm_job_request *out, qm_problem *problem)
{
    if (known->later && find_name(member, known->later) >= 0)
        complain(problem, QM_PROBLEM_UNSUPPORTED_FEATURE, known->name,
                 "has a value that is not available yet");
    else if (!known->read(member, out))
        complain(problem, QM_PROBLEM_INVALID_FIELD, known->name, known->expected);
}

static void read_members(const cJSON *object, qm_job_request *out, qm_problem *problem)
{
    bool seen[FIELD_COUNT] = {false};
    for (const cJSON *member = object->child; member; member = member->next) {
        const field *known = find_field(member->string);
        if (!known)
            complain(problem, QM_PROBLEM_INVALID_FIELD, member->string, "is not a field of a job");
        else if (seen[known - fields])
            complain(problem, QM_PROBLEM_INVALID_FIELD, member->string, "is given twice");
        else
            read_member(known, member, out, problem);
        if (known) seen[known - fields] = true;
    }
    for (size_t i = 0; i < FIELD_COUNT; i++)
        if (fields[i].is_required && !seen[i])
            complain(problem, QM_PROBLEM_INVALID_FIELD, fields[i].name, "is missing");
}

/** The place of the first byte that is not UTF-8, or size. */
static size_t find_bad_utf8(const char *text, size_t size)
{
    for (size_t i = 0; i < size;) {
        size_t length = qm_utf8_length(text + i, size - i);
        if (length == 0) return i;
        i += length;
    }
    return size;
}

/** The place of an escaped NUL, where the parser would cut the string off, or size. */
static size_t find_escaped_nul(const char *text, size_t size)
{
    for (size_t i = 0; i + 1 < size; i++) {
        if (text[i] != '\\') continue;
        if (size - i >= 6 && memcmp(text + i, "\\u0000", 6) == 0) return i;
        i++;
    }
    return size;
}

static qm_problem malformed_at(size_t place, const char *words)
{
    qm_problem problem = qm_problem_make(QM_PROBLEM_MALFORMED_JSON, "%s at byte %zu", words, place);
    problem.error_count = 1;
    problem.errors[0] = (qm_problem_error){.line = QM_NO_PLACE, .offset = place};
    snprintf(problem.errors[0].detail, sizeof problem.errors[0].detail, "%s", words);
    return problem;
}

/** What the parser must not see. */
static bool check_text(const char *text, size_t size, qm_problem *problem)
{
    size_t place;
    if ((place = find_bad_utf8(text, size)) < size)
        *problem = malformed_at(place, "the body is not UTF-8");
    else if ((place = find_too_deep(text, size)) < size)
        *problem = malformed_at(place, "the JSON is nested too deep");
    else if ((place = find_escaped_nul(text, size)) < size)
        *problem = malformed_at(place, "a string holds a NUL character");
    else
        return true;
    return false;
}

/** Parses the whole text; NULL with a problem when it is not one JSON value. */
static cJSON *parse(const char *text, size_t size, qm_problem *problem)
{
    const char *end = text;
    cJSON *tree = cJSON_ParseWithLengthOpts(text, size, &end, false);
    const char *rest = end;
    while (tree && rest < text + size && *rest && strchr(" \t\r\n", *rest))
        rest++;
    if (tree && rest == text + size) return tree;
    *problem = malformed_at((size_t)((tree ? rest : end) - text), "the JSON cannot be read");
    cJSON_Delete(tree);
    return NULL;
}

bool qm_json_read_job(const char *text, size_t size, qm_job_request *out, qm_problem *problem)
{
    *out = qm_job_request_default();
    *problem = (qm_problem){0};
    if (!check_text(text, size, problem)) return false;
    cJSON *tree = parse(text, size, problem);
    if (!tree) return false;
    if (cJSON_IsObject(tree)) {
        read_members(tree, out, problem);
    } else {
        *problem = qm_problem_make(QM_PROBLEM_INVALID_FIELD, "a job is a JSON object");
        qm_problem_add_pointer(problem, "", "must be an object");
    }
    cJSON_Delete(tree);
    return problem->error_count == 0;
}
