/**
 * json_mesh_edits.c: the bodies of requests that change a mesh or copy it: new positions of its vertices, its time to live,
 * and where the copy lies.
 */
#include <cjson/cJSON.h>
#include <stdlib.h>
#include <string.h>

#include "meshes.h"
#include "ops/json_request.h"

void qm_json_reset_moved_vertices(qm_moved_vertices *moved)
{
    free(moved->indices);
    free(moved->positions);
    *moved = (qm_moved_vertices){0};
}

static bool read_indices(const cJSON *value, qm_moved_vertices *out, size_t *count, qm_json_location *at)
{
    if (!cJSON_IsArray(value)) return false;
    size_t size = (size_t)cJSON_GetArraySize(value);
    out->indices = malloc((size + 1) * sizeof *out->indices);
    at->no_memory = !out->indices;
    if (at->no_memory) return false;
    at->depth = 1;
    for (const cJSON *number = value->child; number; number = number->next, at->index[0]++) {
        double index;
        if (!qm_json_read_integer(number, 0, UINT32_MAX, &index)) return false;
        out->indices[(*count)++] = (uint32_t)index;
    }
    return true;
}

static void read_moved(const cJSON *object, qm_moved_vertices *out, qm_problem *problem)
{
    size_t index_count = 0;
    bool has_positions = false;
    for (const cJSON *member = object->child; member; member = member->next) {
        qm_json_location at = {0};
        bool is_indices = strcmp(member->string, "indices") == 0;
        bool is_positions = strcmp(member->string, "positions") == 0;
        if ((!is_indices && !is_positions) || (is_indices && out->indices) || (is_positions && has_positions))
            qm_json_report(problem, member->string,
                           "is not a field of a deformation, or is given more than once");
        else if (is_indices && !read_indices(member, out, &index_count, &at))
            qm_json_report_at(problem, "indices", &at, "must be an array of integers of 0 or more");
        else if (is_positions && !qm_json_read_points(member, &out->positions, &out->count, &at))
            qm_json_report_at(problem, "positions", &at,
                              "must be an array of positions, each an array of three finite numbers");
        has_positions |= is_positions;
    }
    if (!has_positions) qm_json_report(problem, "positions", "is missing");
    if (problem->error_count == 0 && out->indices && index_count != out->count)
        qm_json_report(problem, "positions", "must have as many positions as there are indices");
}

bool qm_json_read_moved_vertices(const char *text, size_t size, qm_moved_vertices *out, qm_problem *problem)
{
    *out = (qm_moved_vertices){0};
    cJSON *object = qm_json_parse_object(text, size, "a deformation", problem);
    if (!object) return false;
    *problem = (qm_problem){.code = QM_PROBLEM_INVALID_FIELD};
    read_moved(object, out, problem);
    cJSON_Delete(object);
    if (problem->error_count == 0) return true;
    qm_json_reset_moved_vertices(out);
    return false;
}

bool qm_json_read_lifetime(const char *text, size_t size, double *ttl_s, qm_problem *problem)
{
    static const char *const known[] = {"ttl_seconds", NULL};
    cJSON *object = qm_json_parse_object(text, size, "a change of a mesh", problem);
    if (!object) return false;
    const cJSON *ttl = cJSON_GetObjectItemCaseSensitive(object, known[0]);
    *ttl_s = 0.0;
    bool is_read = qm_json_check_members(object, known, problem);
    if (is_read && !cJSON_IsNull(ttl) && !qm_json_read_integer(ttl, 1, QM_MESHES_MAX_TTL_S, ttl_s)) {
        *problem = (qm_problem){.code = QM_PROBLEM_INVALID_FIELD};
        qm_json_report(problem, known[0], "must be an integer from 1 to 3155760000, or null");
        is_read = false;
    }
    cJSON_Delete(object);
    return is_read;
}

bool qm_json_read_copy(const char *text, size_t size, qm_moved_copy *out, qm_problem *problem)
{
    static const char *const known[] = {"transform", "name", NULL};
    *out = (qm_moved_copy){.name = NULL};
    cJSON *object = qm_json_parse_object(text, size, "a copy", problem);
    if (!object) return false;
    const cJSON *transform = cJSON_GetObjectItemCaseSensitive(object, known[0]);
    const cJSON *name = cJSON_GetObjectItemCaseSensitive(object, known[1]);
    qm_json_location at = {0};
    bool is_read = qm_json_check_members(object, known, problem);
    if (is_read) {
        *problem = (qm_problem){.code = QM_PROBLEM_INVALID_FIELD};
        if (!transform)
            qm_json_report(problem, known[0], "is missing");
        else if (!qm_json_read_transform(transform, out->transform, &at))
            qm_json_report_at(problem, known[0], &at, "");
        if (name && !cJSON_IsString(name)) qm_json_report(problem, known[1], "must be a string");
        is_read = problem->error_count == 0;
    }
    if (is_read && name) {
        out->name = strdup(cJSON_GetStringValue(name));
        is_read = out->name != NULL;
        if (!is_read) *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the name");
    }
    cJSON_Delete(object);
    return is_read;
}
