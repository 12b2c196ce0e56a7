/**
 * json_in.c: job requests and lines of batches from JSON, by two tables of fields: that of all kinds, and that of the
 * request's kind (ops/job_kinds_internal.h).
 */
#include <cjson/cJSON.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "base/json.h"
#include "json_in.h"
#include "ops/job_kinds_internal.h"
#include "ops/json_request.h"

static bool read_labels(const cJSON *value, qm_job_request *out, qm_json_location *at)
{
    return cJSON_IsNull(value) || qm_mesh_read_labels(value, &out->labels, at);
}

/** The fields of all kinds. */
static const qm_job_field shared[] = {
    {"type", QM_FIELD_CHOICE, QM_FIELD_AT(kind), .is_required = true, .names = qm_job_kind_names},
    {"threads", QM_FIELD_INTEGER, QM_FIELD_AT(threads), .min = 1, .max = QM_JOB_MAX_THREADS},
    {"detach", QM_FIELD_FLAG, QM_FIELD_AT(detach)},
    {"priority", QM_FIELD_CHOICE, QM_FIELD_AT(priority), .names = qm_priority_names},
    {"deadline_ms", QM_FIELD_POSITIVE, QM_FIELD_AT(deadline_ms)},
    {"labels", QM_FIELD_OTHER, .read = read_labels, .expected = QM_MESH_LABELS},
    {0}};
_Static_assert(sizeof(qm_job_kind) == sizeof(int) && sizeof(qm_direction) == sizeof(int) &&
                   sizeof(qm_quad_reading) == sizeof(int) && sizeof(qm_collide_mode) == sizeof(int) &&
                   sizeof(qm_accelerator) == sizeof(int) && sizeof(qm_priority) == sizeof(int) &&
                   sizeof(qm_bounds) == sizeof(int) && sizeof(qm_align_fit) == sizeof(int) &&
                   sizeof(qm_align_start) == sizeof(int) && sizeof(qm_align_motion) == sizeof(int) &&
                   sizeof(qm_job_align_direction) == sizeof(int),
               "a choice is copied into its enum as an int");

/** Reads a value into its member; false leaves the location of the fault. */
static bool read_value(const qm_job_field *field, const cJSON *value, qm_job_request *out,
                       qm_json_location *at)
{
    void *member = (char *)out + field->offset;
    double number;
    int index;
    switch (field->type) {
    case QM_FIELD_ID:
        return qm_json_read_mesh_name(cJSON_GetStringValue(value), member) && !qm_json_hash_of_name(member);
    case QM_FIELD_MESH:
        return qm_json_read_mesh(value, member, &out->pose[field->offset == offsetof(qm_job_request, b)], at);
    case QM_FIELD_POSITIVE:
        return qm_json_read_number(value, member) && *(double *)member > 0.0;
    case QM_FIELD_LIMIT:
        return cJSON_IsNull(value) || (qm_json_read_number(value, member) && *(double *)member >= 0.0);
    case QM_FIELD_COUNT:
        return qm_json_read_count(value, field->min, field->max, member);
    case QM_FIELD_INTEGER:
        if (!qm_json_read_integer(value, field->min, field->max, &number)) return false;
        *(int *)member = (int)number;
        return true;
    case QM_FIELD_FLAG:
        *(bool *)member = cJSON_IsTrue(value);
        return cJSON_IsBool(value);
    case QM_FIELD_CHOICE:
        index = qm_json_find_name(value, field->names);
        if (field->name_count > 0 && index >= field->name_count) index = 0;
        if (index >= 0) memcpy(member, &index, sizeof index);
        return index >= 0;
    case QM_FIELD_SWITCH:
        index = qm_json_find_name(value, field->names);
        *(bool *)member = index == 1;
        return index >= 0;
    case QM_FIELD_OTHER:
        break;
    }
    return field->read(value, out, at);
}

/** Reports a value that is not as the field needs it; name is that of the member of the request. */
static void report_value(const qm_job_field *field, const char *name, const qm_json_location *at,
                         qm_problem *problem)
{
    char text[192] = "must be ";
    const char *message = field->expected ? field->expected : text;
    size_t used = strlen(text);
    if (!field->expected) switch (field->type) {
        case QM_FIELD_POSITIVE:
            message = "must be a number above 0";
            break;
        case QM_FIELD_LIMIT:
            message = "must be a number of 0 or more, or null";
            break;
        case QM_FIELD_FLAG:
            message = "must be true or false";
            break;
        case QM_FIELD_COUNT:
        case QM_FIELD_INTEGER:
            snprintf(text, sizeof text, "must be an integer from %.15g to %.15g", field->min, field->max);
            break;
        case QM_FIELD_CHOICE:
        case QM_FIELD_SWITCH:
            for (int i = 0; field->names[i] && used < sizeof text; i++)
                used += (size_t)snprintf(text + used, sizeof text - used, "%s\"%s\"",
                                         i == 0                ? ""
                                         : field->names[i + 1] ? ", "
                                                               : " or ",
                                         field->names[i]);
            break;
        case QM_FIELD_ID:
        case QM_FIELD_MESH:
        case QM_FIELD_OTHER:
            break;
        }
    qm_json_report_at(problem, name, at, message);
}

/* ---- requests ---- */

#define MAX_FIELDS 32   /* of one kind */
#define ENGINE "engine" /* the object of those that are the engine's own */

/** True for fields that read the same member of the request: one, or two names of one. */
static bool is_same(const qm_job_field *a, const qm_job_field *b)
{
    bool have_members = a->type != QM_FIELD_OTHER && b->type != QM_FIELD_OTHER;
    return a == b || (have_members && a->offset == b->offset);
}

/** Reports the required fields of a table that were not seen. */
static void report_missing(const qm_job_field *fields, const qm_job_field *const *seen, size_t count,
                           qm_problem *problem)
{
    for (; fields->name; fields++) {
        size_t i = 0;
        while (i < count && seen[i] != fields)
            i++;
        if (fields->is_required && i == count) qm_json_report(problem, fields->name, "is missing");
    }
}

/** A request while it is read: the fields that were seen. */
typedef struct reading {
    const qm_job_field *own; /* fields of the kind */
    const qm_job_field *seen[MAX_FIELDS];
    size_t count;
    qm_job_request *out;
    qm_problem *problem;
} reading;

/** Reads a member whose field is known, or NULL for none; in the object `engine`, or beside it. */
static void read_member(reading *r, const qm_job_field *known, const cJSON *member, bool is_in_engine)
{
    qm_json_location here = {.member = is_in_engine ? member->string : NULL}, at = here;
    const char *name = is_in_engine ? ENGINE : member->string;
    size_t i = 0;
    while (known && i < r->count && !is_same(r->seen[i], known))
        i++;
    if (!known)
        qm_json_report_at(r->problem, name, &here, "is not a field of this job");
    else if (i < r->count)
        qm_json_report_at(r->problem, name, &here, "is given more than once");
    else if (!read_value(known, member, r->out, &at))
        report_value(known, name, &at, r->problem);
    if (known && i == r->count) {
        QM_ASSERT(r->count < MAX_FIELDS);
        r->seen[r->count++] = known;
    }
}

/** True when a kind has fields that belong to `engine`. */
static bool has_engine(const qm_job_field *fields)
{
    while (fields->name && !fields->is_engine)
        fields++;
    return fields->name;
}

static void read_engine(reading *r, const cJSON *object)
{
    if (!cJSON_IsObject(object)) {
        qm_json_report(r->problem, ENGINE, "must be an object");
        return;
    }
    for (const cJSON *member = object->child; member; member = member->next) {
        const qm_job_field *known = qm_job_find_field(r->own, member->string);
        read_member(r, known && known->is_engine ? known : NULL, member, true);
    }
}

static void read_members(const cJSON *object, qm_job_request *out, qm_problem *problem)
{
    reading r = {.out = out, .problem = problem};
    /* The type decides which other members are allowed. Without a valid one they are checked against the
     * default. */
    int given = qm_json_find_name(cJSON_GetObjectItemCaseSensitive(object, "type"), qm_job_kind_names);
    if (given >= 0) out->kind = (qm_job_kind)given;
    r.own = qm_job_hooks_of(out->kind)->fields;
    bool has_read_engine = false;
    for (const cJSON *member = object->child; member; member = member->next) {
        if (strcmp(member->string, ENGINE) == 0 && !has_read_engine && has_engine(r.own)) {
            read_engine(&r, member);
            has_read_engine = true;
            continue;
        }
        const qm_job_field *known = qm_job_find_field(shared, member->string);
        if (!known) known = qm_job_find_field(r.own, member->string);
        if (!known && has_read_engine && strcmp(member->string, ENGINE) == 0)
            qm_json_report(problem, ENGINE, "is given more than once");
        else
            read_member(&r, known, member, false);
    }
    report_missing(shared, r.seen, r.count, problem);
    report_missing(r.own, r.seen, r.count, problem);
    const qm_job_hooks *hooks = qm_job_hooks_of(out->kind);
    if (problem->error_count == 0 && hooks->check) hooks->check(out, problem);
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

bool qm_json_read_labels(const char *text, size_t size, char **out, qm_problem *problem)
{
    static const char *const known[] = {"labels", NULL};
    cJSON *object = qm_json_parse_object(text, size, "a change of a job", problem);
    *out = NULL;
    if (!object) return false;
    const cJSON *labels = cJSON_GetObjectItemCaseSensitive(object, "labels");
    qm_json_location at = {0};
    bool is_read = qm_json_check_members(object, known, problem);
    if (is_read) *problem = (qm_problem){.code = QM_PROBLEM_COUNT};
    if (is_read && !labels)
        qm_json_report(problem, "labels", "is missing");
    else if (is_read && !cJSON_IsNull(labels) && !qm_mesh_read_labels(labels, out, &at))
        qm_json_report_at(problem, "labels", &at, QM_MESH_LABELS);
    cJSON_Delete(object);
    return is_read && problem->error_count == 0;
}
