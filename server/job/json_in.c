/**
 * json_in.c: job requests and lines of batches from JSON: a table of the members that a request may have, and
 * the kinds of job that have each.
 */
#include <cjson/cJSON.h>
#include <math.h>
#include <string.h>

#include "base/json.h"
#include "json_in.h"
#include "ops/job_kinds.h"
#include "ops/json_request.h"

#define MAX_STEPS 64

/** A field of a job: its reader, and the text of the error when that returns false. */
typedef struct job_field {
    const char *name;
    unsigned kinds, required; /* a bit for each kind that has it, and that must have it */
    bool (*read)(const struct cJSON *value, qm_job_request *out);
    bool (*read_list)(const struct cJSON *value, qm_job_request *out,
                      qm_json_location *at); /* for arrays, in place of read */
    const char *expected;
} job_field;

static bool read_string(const cJSON *value, const char **out)
{
    *out = cJSON_GetStringValue(value);
    return *out != NULL;
}

static bool read_id(const cJSON *value, char out[QM_ID_SIZE])
{
    const char *id;
    if (!read_string(value, &id) || !id[0] || strlen(id) >= QM_ID_SIZE) return false;
    strcpy(out, id);
    return true;
}

/** The index of a name in a NULL-ended list, or -1. */
static int find_name(const cJSON *value, const char *const *names)
{
    const char *given;
    if (!read_string(value, &given)) return -1;
    for (int i = 0; names[i]; i++)
        if (strcmp(given, names[i]) == 0) return i;
    return -1;
}

#define XX(suffix, name, first, second) " \"" #name "\""
#define TYPE_NAMES QM_JOB_MAP(XX)

static bool read_type(const cJSON *value, qm_job_request *out)
{
    const char *given;
    return read_string(value, &given) && qm_job_kind_find(given, &out->kind);
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
    int index = find_name(value, qm_direction_names);
    if (index >= 0) out->direction = (qm_direction)index;
    return index >= 0;
}

static bool read_quads(const cJSON *value, qm_job_request *out)
{
    int index = find_name(value, qm_quads_names);
    if (index >= 0) out->quads = (qm_quad_reading)index;
    return index >= 0;
}

static bool read_tolerance(const cJSON *value, qm_job_request *out)
{
    return qm_json_read_number(value, &out->tolerance) && out->tolerance > 0.0;
}

static bool read_tolerance_unit(const cJSON *value, qm_job_request *out)
{
    int index = find_name(value, qm_tolerance_unit_names);
    out->tolerance_is_absolute = index == 1;
    return index >= 0;
}

static bool read_threshold(const cJSON *value, qm_job_request *out)
{
    if (cJSON_IsNull(value)) return true;
    return qm_json_read_number(value, &out->threshold) && out->threshold >= 0.0;
}

static bool read_deadline(const cJSON *value, qm_job_request *out)
{
    return qm_json_read_number(value, &out->deadline_ms) && out->deadline_ms > 0.0;
}

static bool read_count(const cJSON *value, double min, double max, size_t *out)
{
    double count;
    if (!qm_json_read_integer(value, min, max, &count)) return false;
    *out = (size_t)count;
    return true;
}

static bool read_memory_limit(const cJSON *value, qm_job_request *out)
{
    return read_count(value, QM_JOB_MIN_MEMORY, QM_JOB_MAX_MEMORY, &out->memory_limit);
}

static bool read_threads(const cJSON *value, qm_job_request *out)
{
    size_t threads;
    if (!read_count(value, 1, QM_JOB_MAX_THREADS, &threads)) return false;
    out->threads = (int)threads;
    return true;
}

static bool read_accuracy(const cJSON *value, qm_job_request *out)
{
    return qm_json_read_number(value, &out->accuracy) && out->accuracy > 0.0;
}

static bool read_pieces(const cJSON *value, qm_job_request *out)
{
    return read_count(value, 0, QM_JOB_MAX_PIECES, &out->pieces);
}

static bool read_steps(const cJSON *value, qm_job_request *out)
{
    return read_count(value, 1, MAX_STEPS, &out->goal.steps);
}

static bool read_until(const cJSON *value, qm_job_request *out)
{
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

static bool read_measure(const cJSON *value, qm_job_request *out)
{
    out->goal.measures = cJSON_IsTrue(value);
    return cJSON_IsBool(value);
}

static bool read_bins(const cJSON *value, qm_job_request *out)
{
    return read_count(value, 0, QM_JOB_MAX_BINS, &out->bins);
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

static bool read_mode(const cJSON *value, qm_job_request *out)
{
    int index = find_name(value, qm_collide_mode_names);
    if (index >= 0) out->mode = (qm_collide_mode)index;
    return index >= 0;
}

static bool read_limit(const cJSON *value, qm_job_request *out)
{
    return read_count(value, 0, QM_JOB_MAX_LISTED, &out->list_limit);
}

static bool read_incremental(const cJSON *value, qm_job_request *out)
{
    out->incremental = cJSON_IsTrue(value);
    return cJSON_IsBool(value);
}

static bool read_detach(const cJSON *value, qm_job_request *out)
{
    out->detach = cJSON_IsTrue(value);
    return cJSON_IsBool(value);
}

static bool read_accelerator(const cJSON *value, qm_job_request *out)
{
    int index = find_name(value, qm_accelerator_names);
    if (index >= 0) out->accelerator = (qm_accelerator)index;
    return index >= 0;
}

/** For a kind that has one way to search. */
static bool read_boxes(const cJSON *value, qm_job_request *out)
{
    return read_accelerator(value, out) && out->accelerator <= QM_ACCELERATOR_BOXES;
}

static bool read_bounds(const cJSON *value, qm_job_request *out)
{
    int index = find_name(value, qm_bounds_names);
    /* A name past the methods is a second name of the first. */
    if (index >= 0) out->bounds = index == QM_BOUNDS_MATCHING ? QM_BOUNDS_MATCHING : QM_BOUNDS_COVER;
    return index >= 0;
}

static bool read_points(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    return qm_json_read_points(value, &out->points, &out->point_count, at);
}

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

static const job_field job_fields[] = {
    {"type", ALL, ALL, read_type, NULL, "must be one of" TYPE_NAMES},
    {"a", PAIRS, PAIRS, read_a, NULL, "must be the id of a mesh"},
    {"b", PAIRS, PAIRS, read_b, NULL, "must be the id of a mesh"},
    {"mesh", SINGLE, SINGLE, read_a, NULL, "must be the id of a mesh"},
    {"points", PROJECT, PROJECT, NULL, read_points,
     "must be an array of points, each an array of three finite numbers"},
    {"direction", HAUSDORFF, 0, read_direction, NULL, "must be \"two_sided\", \"a_to_b\" or \"b_to_a\""},
    {"reconstruction", STEP, STEP, read_a, NULL, "must be the id of a reconstruction"},
    {"steps", STEP, 0, read_steps, NULL, "must be a whole number from 1 to 64"},
    {"until", STEP, 0, read_until, NULL,
     "must be an object with one or more of hausdorff_relative, max_quads and edge_length, each above 0"},
    {"measure", STEP, 0, read_measure, NULL, "must be true or false"},
    {"quads", ALL & ~STEP, 0, read_quads, NULL, "must be \"triangles\" or \"bilinear\""},
    {"tolerance", PAIRS | SELF, 0, read_tolerance, NULL, "must be a number above 0"},
    {"tolerance_unit", PAIRS | SELF, 0, read_tolerance_unit, NULL, "must be \"relative\" or \"absolute\""},
    {"threshold", HAUSDORFF, 0, read_threshold, NULL, "must be a number of 0 or more, or null"},
    {"deadline_ms", HAUSDORFF, 0, read_deadline, NULL, "must be a number above 0"},
    {"memory_limit", HAUSDORFF, 0, read_memory_limit, NULL,
     "must be a whole number from 65536 to 1099511627776"},
    {"accuracy", DEVIATION, 0, read_accuracy, NULL, "must be a number above 0"},
    {"pieces", DEVIATION, 0, read_pieces, NULL, "must be a whole number from 0 to 10000000"},
    {"bins", DEVIATION, 0, read_bins, NULL, "must be a whole number from 0 to 10000"},
    {"percentiles", DEVIATION, 0, NULL, read_percentiles,
     "must be an array of at most 64 numbers above 0 and at most 100"},
    {"mode", COLLISION | SELF, 0, read_mode, NULL, "must be \"all\", \"first\" or \"any\""},
    {"limit", COLLISION | SELF, 0, read_limit, NULL, "must be a whole number from 0 to 100000"},
    {"incremental", SELF, 0, read_incremental, NULL, "must be true or false"},
    {"threads", ALL, 0, read_threads, NULL, "must be a whole number from 1 to 256"},
    {"detach", ALL, 0, read_detach, NULL, "must be true or false"},
    {"accelerator", HAUSDORFF | PROJECT, 0, read_accelerator, NULL,
     "must be \"auto\", \"boxes\", \"tetra\" or \"grid\""},
    {"accelerator", ALL & ~(HAUSDORFF | PROJECT | STEP), 0, read_boxes, NULL,
     "must be \"auto\" or \"boxes\""},
    {"bounds", HAUSDORFF, 0, read_bounds, NULL, "must be \"cover\" or \"matching\""},
};

#define FIELD_COUNT (sizeof job_fields / sizeof *job_fields)

/** The field that a kind of job, given as its bit, has under this name, or NULL. */
static const job_field *find_field(const char *name, unsigned kind)
{
    for (size_t i = 0; i < FIELD_COUNT; i++)
        if ((job_fields[i].kinds & kind) && strcmp(job_fields[i].name, name) == 0) return &job_fields[i];
    return NULL;
}

/* ---- requests ---- */

/** Reads one member that is known and given for the first time. */
static void read_member(const job_field *known, const cJSON *member, qm_job_request *out, qm_problem *problem)
{
    qm_json_location at = {0};
    bool good = known->read ? known->read(member, out) : known->read_list(member, out, &at);
    if (!good) qm_json_report_at(problem, known->name, &at, known->expected);
}

static void read_members(const cJSON *object, qm_job_request *out, qm_problem *problem)
{
    bool seen[FIELD_COUNT] = {false};
    /* The type decides which other members are allowed. Without a valid one they are checked against the
     * default. */
    const cJSON *type = cJSON_GetObjectItemCaseSensitive(object, "type");
    if (type) find_field("type", 1u << out->kind)->read(type, out);
    unsigned kind = 1u << out->kind;
    for (const cJSON *member = object->child; member; member = member->next) {
        const job_field *known = find_field(member->string, kind);
        if (!known)
            qm_json_report(problem, member->string, "is not a field of this job");
        else if (seen[known - job_fields])
            qm_json_report(problem, member->string, "is given more than once");
        else
            read_member(known, member, out, problem);
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
