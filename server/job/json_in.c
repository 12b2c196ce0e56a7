/**
 * json_in.c: job requests and lines of batches from JSON: a table of the members that a request may have, and
 * the kinds of job that have each.
 */
#include <cjson/cJSON.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "base/json.h"
#include "json_in.h"
#include "ops/job_kinds.h"
#include "ops/json_request.h"

/** How the value of a field is read. */
typedef enum value_type {
    ID,       /* char[QM_ID_SIZE] */
    POSITIVE, /* double above 0 */
    COUNT,    /* size_t from min to max */
    INTEGER,  /* int from min to max */
    FLAG,     /* bool */
    CHOICE,   /* an enum, by its place among the names */
    OTHER     /* by a function of its own */
} value_type;

/** A field of a job. */
typedef struct job_field {
    const char *name;
    unsigned kinds, required; /* a bit for each kind that has it, and that must have it */
    value_type type;
    size_t offset;            /* of the member of qm_job_request; not of OTHER */
    double min, max;          /* of COUNT and INTEGER */
    const char *const *names; /* of CHOICE, NULL-ended */
    bool (*read)(const cJSON *value, qm_job_request *out, qm_json_location *at); /* of OTHER */
    const char *expected; /* the text of the error, of ID and OTHER; the others make it of their limits */
} job_field;

static bool read_count(const cJSON *value, double min, double max, size_t *out)
{
    double count;
    if (!qm_json_read_integer(value, min, max, &count)) return false;
    *out = (size_t)count;
    return true;
}

/** The index of a name in a NULL-ended list, or -1. */
static int find_name(const cJSON *value, const char *const *names)
{
    const char *given = cJSON_GetStringValue(value);
    for (int i = 0; given && names[i]; i++)
        if (strcmp(given, names[i]) == 0) return i;
    return -1;
}

/* ---- fields that are read by a function of their own ---- */

static bool read_tolerance_unit(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    (void)at;
    int index = find_name(value, qm_tolerance_unit_names);
    out->tolerance_is_absolute = index == 1;
    return index >= 0;
}

static bool read_threshold(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    (void)at;
    if (cJSON_IsNull(value)) return true;
    return qm_json_read_number(value, &out->threshold) && out->threshold >= 0.0;
}

static bool read_until(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    (void)at;
    if (!cJSON_IsObject(value)) return false;
    for (const cJSON *member = value->child; member; member = member->next) {
        bool good = false;
        if (strcmp(member->string, "hausdorff_relative") == 0) {
            good = qm_json_read_number(member, &out->hausdorff_relative) && out->hausdorff_relative > 0.0;
        } else if (strcmp(member->string, "edge_length") == 0) {
            good = qm_json_read_number(member, &out->goal.edge) && out->goal.edge > 0.0;
        } else if (strcmp(member->string, "max_quads") == 0) {
            good = read_count(member, 1, QM_REFINE_MAX_QUADS, &out->goal.max_quads);
        }
        if (!good) return false;
    }
    return true;
}

static bool read_percentiles(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    if (!cJSON_IsArray(value) || cJSON_GetArraySize(value) > QM_JOB_MAX_PERCENTILES) return false;
    out->percentile_count = 0;
    at->depth = 1;
    for (const cJSON *number = value->child; number; number = number->next, at->index[0]++) {
        double *percentile = &out->percentiles[out->percentile_count];
        if (!qm_json_read_number(number, percentile) || !(*percentile > 0.0 && *percentile <= 100.0))
            return false;
        out->percentile_count++;
    }
    return true;
}

static bool read_bounds(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    (void)at;
    int index = find_name(value, qm_bounds_names);
    /* A name past the methods is a second name of the first. */
    if (index >= 0) out->bounds = index == QM_BOUNDS_MATCHING ? QM_BOUNDS_MATCHING : QM_BOUNDS_COVER;
    return index >= 0;
}

static bool read_points(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    return qm_json_read_points(value, &out->points, &out->point_count, at);
}

/* ---- the table ---- */

enum {
    ALL = (1u << QM_JOB_KIND_COUNT) - 1,
    HAUSDORFF = 1u << QM_JOB_HAUSDORFF,
    PROJECT = 1u << QM_JOB_PROJECT,
    DEVIATION = 1u << QM_JOB_DEVIATION,
    COLLISION = 1u << QM_JOB_COLLISION,
    SELF = 1u << QM_JOB_SELF_COLLISION,
    PAIRS = HAUSDORFF | DEVIATION | 1u << QM_JOB_DISTANCE | COLLISION,
    SINGLE = PROJECT | SELF,
    STEP = 1u << QM_JOB_RECONSTRUCTION_STEP
};

/** The accelerators of a kind that has one way to search: the first ones. */
static const char *const box_names[] = {"auto", "boxes", NULL};

#define AT(member) .offset = offsetof(qm_job_request, member)

static const job_field job_fields[] = {
    {"type", ALL, ALL, CHOICE, AT(kind), .names = qm_job_kind_names},
    {"a", PAIRS, PAIRS, ID, AT(a), .expected = "must be the id of a mesh"},
    {"b", PAIRS, PAIRS, ID, AT(b), .expected = "must be the id of a mesh"},
    {"mesh", SINGLE, SINGLE, ID, AT(a), .expected = "must be the id of a mesh"},
    {"points", PROJECT, PROJECT, OTHER, .read = read_points,
     .expected = "must be an array of points, each an array of three finite numbers"},
    {"direction", HAUSDORFF, 0, CHOICE, AT(direction), .names = qm_direction_names},
    {"reconstruction", STEP, STEP, ID, AT(a), .expected = "must be the id of a reconstruction"},
    {"steps", STEP, 0, COUNT, AT(goal.steps), .min = 1, .max = QM_JOB_MAX_STEPS},
    {"until", STEP, 0, OTHER, .read = read_until,
     .expected =
         "must be an object with one or more of hausdorff_relative, max_quads and edge_length, each above 0"},
    {"measure", STEP, 0, FLAG, AT(goal.measures)},
    {"quads", ALL & ~STEP, 0, CHOICE, AT(quads), .names = qm_quads_names},
    {"tolerance", PAIRS | SELF, 0, POSITIVE, AT(tolerance)},
    {"tolerance_unit", PAIRS | SELF, 0, OTHER, .read = read_tolerance_unit,
     .expected = "must be \"relative\" or \"absolute\""},
    {"threshold", HAUSDORFF, 0, OTHER, .read = read_threshold,
     .expected = "must be a number of 0 or more, or null"},
    {"memory_limit", HAUSDORFF, 0, COUNT, AT(memory_limit), .min = QM_JOB_MIN_MEMORY,
     .max = QM_JOB_MAX_MEMORY},
    {"accuracy", DEVIATION, 0, POSITIVE, AT(accuracy)},
    {"pieces", DEVIATION, 0, COUNT, AT(pieces), .max = QM_JOB_MAX_PIECES},
    {"bins", DEVIATION, 0, COUNT, AT(bins), .max = QM_JOB_MAX_BINS},
    {"percentiles", DEVIATION, 0, OTHER, .read = read_percentiles,
     .expected = "must be an array of at most 64 numbers above 0 and at most 100"},
    {"mode", COLLISION | SELF, 0, CHOICE, AT(mode), .names = qm_collide_mode_names},
    {"limit", COLLISION | SELF, 0, COUNT, AT(list_limit), .max = QM_JOB_MAX_LISTED},
    {"incremental", SELF, 0, FLAG, AT(incremental)},
    {"threads", ALL, 0, INTEGER, AT(threads), .min = 1, .max = QM_JOB_MAX_THREADS},
    {"detach", ALL, 0, FLAG, AT(detach)},
    {"priority", ALL, 0, CHOICE, AT(priority), .names = qm_priority_names},
    {"deadline_ms", ALL, 0, POSITIVE, AT(deadline_ms)},
    {"accelerator", HAUSDORFF | PROJECT, 0, CHOICE, AT(accelerator), .names = qm_accelerator_names},
    {"accelerator", ALL & ~(HAUSDORFF | PROJECT | STEP), 0, CHOICE, AT(accelerator), .names = box_names},
    {"bounds", HAUSDORFF, 0, OTHER, .read = read_bounds, .expected = "must be \"cover\" or \"matching\""},
};
_Static_assert(QM_JOB_MAX_PERCENTILES == 64, "the text of percentiles names the limit");
_Static_assert(sizeof(qm_job_kind) == sizeof(int) && sizeof(qm_direction) == sizeof(int) &&
                   sizeof(qm_quad_reading) == sizeof(int) && sizeof(qm_collide_mode) == sizeof(int) &&
                   sizeof(qm_accelerator) == sizeof(int) && sizeof(qm_priority) == sizeof(int),
               "a choice is copied into its enum as an int");

#define FIELD_COUNT (sizeof job_fields / sizeof *job_fields)

/** The field that a kind of job, given as its bit, has under this name, or NULL. */
static const job_field *find_field(const char *name, unsigned kind)
{
    for (size_t i = 0; i < FIELD_COUNT; i++)
        if ((job_fields[i].kinds & kind) && strcmp(job_fields[i].name, name) == 0) return &job_fields[i];
    return NULL;
}

/** Reads a value into its member; false leaves the location of the fault. */
static bool read_value(const job_field *field, const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    void *member = (char *)out + field->offset;
    const char *text = cJSON_GetStringValue(value);
    double number;
    int index;
    switch (field->type) {
    case ID:
        if (!text || !text[0] || strlen(text) >= QM_ID_SIZE) return false;
        strcpy(member, text);
        return true;
    case POSITIVE:
        return qm_json_read_number(value, member) && *(double *)member > 0.0;
    case COUNT:
        return read_count(value, field->min, field->max, member);
    case INTEGER:
        if (!qm_json_read_integer(value, field->min, field->max, &number)) return false;
        *(int *)member = (int)number;
        return true;
    case FLAG:
        *(bool *)member = cJSON_IsTrue(value);
        return cJSON_IsBool(value);
    case CHOICE:
        index = find_name(value, field->names);
        if (index >= 0) memcpy(member, &index, sizeof index);
        return index >= 0;
    case OTHER:
        break;
    }
    return field->read(value, out, at);
}

/** Reports a value that is not as the field needs it. */
static void report_value(const job_field *field, const qm_json_location *at, qm_problem *problem)
{
    char text[192] = "must be ";
    const char *message = field->expected ? field->expected : text;
    size_t used = strlen(text);
    switch (field->type) {
    case POSITIVE:
        message = "must be a number above 0";
        break;
    case FLAG:
        message = "must be true or false";
        break;
    case COUNT:
    case INTEGER:
        snprintf(text, sizeof text, "must be an integer from %.15g to %.15g", field->min, field->max);
        break;
    case CHOICE:
        for (int i = 0; field->names[i] && used < sizeof text; i++)
            used += (size_t)snprintf(text + used, sizeof text - used, "%s\"%s\"",
                                     i == 0                ? ""
                                     : field->names[i + 1] ? ", "
                                                           : " or ",
                                     field->names[i]);
        break;
    case ID:
    case OTHER:
        break;
    }
    qm_json_report_at(problem, field->name, at, message);
}

/* ---- requests ---- */

static void read_members(const cJSON *object, qm_job_request *out, qm_problem *problem)
{
    bool seen[FIELD_COUNT] = {false};
    /* The type decides which other members are allowed. Without a valid one they are checked against the
     * default. */
    int given = find_name(cJSON_GetObjectItemCaseSensitive(object, "type"), qm_job_kind_names);
    if (given >= 0) out->kind = (qm_job_kind)given;
    unsigned kind = 1u << out->kind;
    for (const cJSON *member = object->child; member; member = member->next) {
        const job_field *known = find_field(member->string, kind);
        qm_json_location at = {0};
        if (!known)
            qm_json_report(problem, member->string, "is not a field of this job");
        else if (seen[known - job_fields])
            qm_json_report(problem, member->string, "is given more than once");
        else if (!read_value(known, member, out, &at))
            report_value(known, &at, problem);
        if (known) seen[known - job_fields] = true;
    }
    for (size_t i = 0; i < FIELD_COUNT; i++)
        if ((job_fields[i].required & kind) && !seen[i])
            qm_json_report(problem, job_fields[i].name, "is missing");
}

/** Reads the members and gives the tree back. */
static bool read_request(cJSON *object, qm_job_request *out, qm_problem *problem)
{
    read_members(object, out, problem);
    cJSON_Delete(object);
    if (problem->error_count == 0) return true;
    qm_job_request_reset(out);
    return false;
}

bool qm_json_read_job(const char *text, size_t size, qm_job_request *out, qm_problem *problem)
{
    *out = qm_job_request_default();
    cJSON *object = qm_json_parse_object(text, size, "a job", problem);
    return object && read_request(object, out, problem);
}

/** Takes the key out of the object. */
static void take_key(cJSON *object, qm_text *key, qm_problem *problem)
{
    cJSON *member = object ? cJSON_DetachItemFromObjectCaseSensitive(object, "key") : NULL;
    const char *string = cJSON_GetStringValue(member);
    char number[QM_NUMBER_SIZE];
    if (string && strlen(string) <= QM_JSON_MAX_KEY) {
        qm_json_add_quoted(key, string);
    } else {
        if (member && !cJSON_IsNumber(member) && !cJSON_IsNull(member))
            qm_json_report(problem, "key", "must be a number or a string of at most 255 bytes");
        double value = cJSON_IsNumber(member) ? cJSON_GetNumberValue(member) : NAN;
        qm_text_add_string(key, qm_text_number(value, number));
    }
    cJSON_Delete(member);
}

bool qm_json_read_batch_line(const char *text, size_t size, qm_text *key, qm_job_request *out,
                             qm_problem *problem)
{
    *out = qm_job_request_default();
    cJSON *object = qm_json_parse_object(text, size, "a job", problem);
    take_key(object, key, problem);
    return object && read_request(object, out, problem);
}
