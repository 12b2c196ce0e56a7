/**
 * json_in.c: the members of a job request, whatever they are, and the lines of a batch.
 */
#include "json_in.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <string.h>

#include "base/json_write.h"
#include "json_job_fields.h"
#include "ops/json_object.h"

/** Reads one member that is known and given for the first time. */
static void read_member(const qm_json_field *known, const cJSON *member, qm_job_request *out,
                        qm_problem *problem)
{
    qm_json_fault place = {0};
    bool good = known->read ? known->read(member, out) : known->read_list(member, out, &place);
    if (!good) qm_json_complain_of(problem, known->name, &place, known->expected);
}

static void read_members(const cJSON *object, qm_job_request *out, qm_problem *problem)
{
    bool seen[QM_JSON_FIELD_COUNT] = {false};
    /* The type decides what the other members may be. Without a valid one they are held against the
     * default. */
    const cJSON *type = cJSON_GetObjectItemCaseSensitive(object, "type");
    if (type) qm_json_find_field("type", 1u << out->kind)->read(type, out);
    unsigned kind = 1u << out->kind;
    for (const cJSON *member = object->child; member; member = member->next) {
        const qm_json_field *known = qm_json_find_field(member->string, kind);
        if (!known)
            qm_json_complain(problem, member->string, "is not a field of this job");
        else if (seen[known - qm_json_job_fields])
            qm_json_complain(problem, member->string, "is given twice");
        else
            read_member(known, member, out, problem);
        if (known) seen[known - qm_json_job_fields] = true;
    }
    for (size_t i = 0; i < QM_JSON_FIELD_COUNT; i++)
        if ((qm_json_job_fields[i].required & kind) && !seen[i])
            qm_json_complain(problem, qm_json_job_fields[i].name, "is missing");
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
            qm_json_complain(problem, "key", "must be a number or a short string");
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
