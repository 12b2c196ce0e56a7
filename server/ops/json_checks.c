/**
 * json_checks.c: manifests of checks.
 */
#include "json_checks.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "json_request.h"

#define LOCATION_SIZE 48

const char *const qm_check_meeting_names[] = {"any", "no", "yes", NULL};

qm_check_rule qm_check_rule_default(void)
{
    return (qm_check_rule){.limit = NAN, .limit_in = NAN, .limit_out = NAN, .percent = 100.0};
}

bool qm_check_rule_is_signed(const qm_check_rule *rule)
{
    return !isnan(rule->limit_in) || !isnan(rule->limit_out);
}

bool qm_check_rule_asks(const qm_check_rule *rule)
{
    return !isnan(rule->limit) || qm_check_rule_is_signed(rule) || rule->collides != QM_CHECK_MAY_MEET ||
           rule->self_collides != QM_CHECK_MAY_MEET;
}

/* ---- lists ---- */

static char *copy(const char *string)
{
    return string ? strdup(string) : NULL;
}

bool qm_check_list_add(qm_check_list *list, const char *name, const char *new_path, const char *golden_path,
                       const qm_check_rule *rule)
{
    if (list->count == list->capacity) {
        size_t capacity = 2 * list->capacity + 8;
        qm_check *checks = realloc(list->checks, capacity * sizeof *checks);
        if (!checks) return false;
        list->checks = checks;
        list->capacity = capacity;
    }
    qm_check *check = &list->checks[list->count++];
    *check = (qm_check){.name = copy(name), .path = {copy(new_path), copy(golden_path)}, .rule = *rule};
    return (check->name || !name) && (check->path[0] || !new_path) && (check->path[1] || !golden_path);
}

void qm_check_list_reset(qm_check_list *list)
{
    for (size_t i = 0; i < list->count; i++) {
        free(list->checks[i].name);
        free(list->checks[i].path[0]);
        free(list->checks[i].path[1]);
    }
    free(list->checks);
    *list = (qm_check_list){0};
}

/* ---- manifests ---- */

/** Copies an enum by the place of its name; false for another value. */
static bool read_choice(const cJSON *value, const char *const *names, void *out)
{
    int index = qm_json_find_name(value, names);
    if (index >= 0) memcpy(out, &index, sizeof index);
    return index >= 0;
}

/** One number for both meshes, or one for each. */
static bool read_uncertainties(const cJSON *value, qm_notes notes[2])
{
    double number[2];
    bool is_read = cJSON_IsArray(value) ? qm_json_read_numbers(value, 2, number)
                                        : qm_json_read_number(value, &number[0]);
    if (!cJSON_IsArray(value)) number[1] = number[0];
    if (!is_read || number[0] < 0.0 || number[1] < 0.0) return false;
    for (int side = 0; side < 2; side++)
        notes[side].uncertainty = number[side];
    return true;
}

static bool read_unit(const cJSON *value, qm_notes notes[2])
{
    const char *name = cJSON_GetStringValue(value);
    return name && qm_notes_set_unit(&notes[0], name) && qm_notes_set_unit(&notes[1], name);
}

static bool read_pose(const cJSON *value, qm_job_pose *pose)
{
    qm_json_location at = {0};
    if (!qm_json_read_transform(value, pose->transform, &at)) return false;
    pose->is_given = !qm_transform_is_identity(pose->transform);
    return true;
}

/** Reads what is said of the meshes, as read_rule does. */
static const char *read_note(const cJSON *member, qm_check_rule *rule, bool *is_known)
{
    const char *name = member->string;
    *is_known = true;
    if (strcmp(name, "uncertainty") == 0)
        return read_uncertainties(member, rule->notes) ? NULL : "must be one or two numbers of 0 or more";
    if (strcmp(name, "unit") == 0) return read_unit(member, rule->notes) ? NULL : "must be " QM_NOTES_UNITS;
    *is_known = strcmp(name, "transform") == 0;
    return !*is_known || read_pose(member, &rule->pose)
               ? NULL
               : "must be 16 numbers, the columns of a 4 x 4 matrix that moves a mesh";
}

/** Reads a member of a rule. Returns NULL, or what the value must be; *is_known is false for another member. */
static const char *read_rule(const cJSON *member, qm_check_rule *rule, bool *is_known)
{
    const char *name = member->string;
    *is_known = true;
    double *const limits[] = {&rule->limit, &rule->limit_in, &rule->limit_out};
    static const char *const limit_names[] = {"limit", "limit_in", "limit_out"};
    for (int i = 0; i < 3; i++)
        if (strcmp(name, limit_names[i]) == 0)
            return qm_json_read_number(member, limits[i]) && *limits[i] >= 0.0
                       ? NULL
                       : "must be a number of 0 or more";
    if (strcmp(name, "percent") == 0)
        return qm_json_read_number(member, &rule->percent) && rule->percent > 0.0 && rule->percent <= 100.0
                   ? NULL
                   : "must be a number above 0 and at most 100";
    if (strcmp(name, "direction") == 0)
        return read_choice(member, qm_direction_names, &rule->direction)
                   ? NULL
                   : "must be \"two_sided\", \"a_to_b\" or \"b_to_a\"";
    if (strcmp(name, "quads") == 0)
        return read_choice(member, qm_quads_names, &rule->quads) ? NULL
                                                                 : "must be \"triangles\" or \"bilinear\"";
    bool is_self = strcmp(name, "self_collides") == 0;
    if (!is_self && strcmp(name, "collides") != 0) return read_note(member, rule, is_known);
    return read_choice(member, qm_check_meeting_names, is_self ? &rule->self_collides : &rule->collides)
               ? NULL
               : "must be \"any\", \"no\" or \"yes\"";
}

static bool reject(qm_problem *problem, const char *place, const char *name, const char *message)
{
    char pointer[sizeof problem->errors[0].pointer];
    snprintf(pointer, sizeof pointer, "%s/%.32s", place, name);
    *problem = qm_problem_make(QM_PROBLEM_INVALID_FIELD, "%s %s", pointer + 1, message);
    qm_problem_add_pointer(problem, pointer, "%s", message);
    return false;
}

/** A path of the manifest, for free(). */
static char *join(const char *folder, const char *path)
{
    if (path[0] == '/') folder = "";
    size_t size = strlen(folder) + strlen(path) + 1;
    char *out = malloc(size);
    if (out) snprintf(out, size, "%s%s", folder, path);
    return out;
}

/** Adds the check of an object. */
static bool read_check(const cJSON *object, const char *place, const char *folder, qm_check_rule rule,
                       qm_check_list *list, qm_problem *problem)
{
    static const char *const path_names[2] = {"new", "golden"};
    const char *name = NULL, *given[2] = {NULL, NULL};
    if (!cJSON_IsObject(object)) return reject(problem, place, "", "must be an object");
    for (const cJSON *member = object->child; member; member = member->next) {
        if (qm_json_is_repeated(object, member))
            return reject(problem, place, member->string, "is given more than once");
        const char *text = cJSON_GetStringValue(member);
        bool is_known = false;
        for (int i = 0; i < 2; i++)
            if (strcmp(member->string, path_names[i]) == 0) {
                is_known = true;
                given[i] = text;
                if (!text || !*text)
                    return reject(problem, place, path_names[i], "must be the path of a mesh");
            }
        if (strcmp(member->string, "name") == 0) {
            is_known = true;
            name = text;
            if (!text || !*text) return reject(problem, place, "name", "must be a text");
        }
        if (is_known) continue;
        const char *expected = read_rule(member, &rule, &is_known);
        if (!is_known) return reject(problem, place, member->string, "is not a field of a check");
        if (expected) return reject(problem, place, member->string, expected);
    }
    for (int i = 0; i < 2; i++)
        if (!given[i]) return reject(problem, place, path_names[i], "is missing");
    if (!qm_check_rule_asks(&rule)) return reject(problem, place, "limit", "is missing");
    char *path[2] = {join(folder, given[0]), join(folder, given[1])};
    bool is_added =
        path[0] && path[1] && qm_check_list_add(list, name ? name : given[0], path[0], path[1], &rule);
    free(path[0]);
    free(path[1]);
    if (!is_added) *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the manifest");
    return is_added;
}

static bool read_manifest(const cJSON *object, const char *folder, qm_check_rule rule, qm_check_list *list,
                          qm_problem *problem)
{
    const cJSON *checks = NULL;
    for (const cJSON *member = object->child; member; member = member->next) {
        bool is_known;
        if (qm_json_is_repeated(object, member))
            return reject(problem, "", member->string, "is given more than once");
        if (strcmp(member->string, "checks") == 0) {
            checks = member;
            continue;
        }
        const char *expected = read_rule(member, &rule, &is_known);
        if (!is_known) return reject(problem, "", member->string, "is not a field of a manifest");
        if (expected) return reject(problem, "", member->string, expected);
    }
    if (!cJSON_IsArray(checks) || !checks->child)
        return reject(problem, "", "checks", "must be an array of one check or more");
    size_t i = 0;
    for (const cJSON *check = checks->child; check; check = check->next, i++) {
        char place[LOCATION_SIZE];
        snprintf(place, sizeof place, "/checks/%zu", i);
        if (!read_check(check, place, folder, rule, list, problem)) return false;
    }
    return true;
}

bool qm_checks_read(const char *text, size_t size, const char *folder, const qm_check_rule *rule,
                    qm_check_list *list, qm_problem *problem)
{
    cJSON *object = qm_json_parse_object(text, size, "a manifest", problem);
    bool is_read = object && read_manifest(object, folder, *rule, list, problem);
    cJSON_Delete(object);
    return is_read;
}
