/**
 * json_mesh_edits.c: the bodies of requests that change a mesh or copy it: new positions of its vertices, what is known of it, and
 * where the copy lies.
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

bool qm_mesh_read_labels(const cJSON *value, char **out, qm_json_location *at)
{
    qm_text labels = {0};
    *out = NULL;
    bool is_good = cJSON_IsArray(value);
    at->depth = is_good;
    for (const cJSON *label = is_good ? value->child : NULL; label; label = label->next, at->index[0]++) {
        const char *text = cJSON_GetStringValue(label);
        is_good = text && qm_mesh_add_label(&labels, text, strlen(text));
        if (!is_good) break;
    }
    if (is_good && labels.size > 0) {
        *out = qm_text_take(&labels);
        at->no_memory = !*out;
        return *out;
    }
    qm_text_reset(&labels);
    return is_good;
}

static void read_change(const cJSON *object, qm_mesh_change *out, qm_problem *problem)
{
    const cJSON *ttl = cJSON_GetObjectItemCaseSensitive(object, "ttl_seconds");
    const cJSON *unit = cJSON_GetObjectItemCaseSensitive(object, "unit");
    const cJSON *uncertainty = cJSON_GetObjectItemCaseSensitive(object, "uncertainty");
    const cJSON *labels = cJSON_GetObjectItemCaseSensitive(object, "labels");
    *out = (qm_mesh_change){
        .has_ttl = ttl, .has_unit = unit, .has_uncertainty = uncertainty, .has_labels = labels};
    qm_json_location at = {0};
    const char *name = cJSON_GetStringValue(unit);
    if (ttl && !cJSON_IsNull(ttl) && !qm_json_read_integer(ttl, 1, QM_MESHES_MAX_TTL_S, &out->ttl_s))
        qm_json_report(problem, "ttl_seconds", "must be an integer from 1 to 3155760000, or null");
    if (unit && !cJSON_IsNull(unit) && !(name && qm_notes_set_unit(&out->notes, name)))
        qm_json_report(problem, "unit", "must be " QM_NOTES_UNITS ", or null");
    if (uncertainty && !cJSON_IsNull(uncertainty) &&
        !(qm_json_read_number(uncertainty, &out->notes.uncertainty) && out->notes.uncertainty >= 0.0))
        qm_json_report(problem, "uncertainty", "must be a number of 0 or more, or null");
    if (labels && !cJSON_IsNull(labels) && !qm_mesh_read_labels(labels, &out->labels, &at))
        qm_json_report_at(problem, "labels", &at, QM_MESH_LABELS);
    if (!ttl && !unit && !uncertainty && !labels)
        qm_json_report(problem, "ttl_seconds", "is missing, and every other field, too");
}

bool qm_json_read_mesh_change(const char *text, size_t size, qm_mesh_change *out, qm_problem *problem)
{
    static const char *const known[] = {"ttl_seconds", "unit", "uncertainty", "labels", NULL};
    *out = (qm_mesh_change){0};
    cJSON *object = qm_json_parse_object(text, size, "a change of a mesh", problem);
    if (!object) return false;
    bool is_read = qm_json_check_members(object, known, problem);
    if (is_read) {
        *problem = (qm_problem){.code = QM_PROBLEM_INVALID_FIELD};
        read_change(object, out, problem);
        is_read = problem->error_count == 0;
    }
    cJSON_Delete(object);
    if (is_read) return true;
    free(out->labels);
    out->labels = NULL;
    return false;
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
