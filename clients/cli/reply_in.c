#include "reply_in.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

/** A number member; null stands for what is not finite, and absent members read as fallback. */
static double number(const cJSON *object, const char *name, double fallback)
{
    const cJSON *member = cJSON_GetObjectItemCaseSensitive(object, name);
    if (cJSON_IsNull(member)) return INFINITY;
    return cJSON_IsNumber(member) ? member->valuedouble : fallback;
}

/** A count; what is negative or absent reads as 0. */
static uint64_t count(const cJSON *object, const char *name)
{
    double value = number(object, name, 0.0);
    return value > 0.0 && value < 0x1p64 ? (uint64_t)value : 0;
}

static const char *string(const cJSON *object, const char *name)
{
    const char *value = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(object, name));
    return value ? value : "";
}

static void read_numbers(const cJSON *object, const char *name, double *out, int size)
{
    const cJSON *array = cJSON_GetObjectItemCaseSensitive(object, name);
    for (int i = 0; i < size; i++) {
        const cJSON *item = cJSON_GetArrayItem(array, i);
        out[i] = cJSON_IsNumber(item) ? item->valuedouble : NAN;
    }
}

static void read_surface_point(const cJSON *entry, uint32_t *face, qm_surface_point *out)
{
    uint64_t value = count(entry, "face");
    *face = value < QM_NO_INDEX ? (uint32_t)value : QM_NO_INDEX;
    read_numbers(entry, "uv", out->uv, 2);
    read_numbers(entry, "point", out->position, 3);
}

static qm_hausdorff_stop read_stop(const cJSON *object)
{
    static const struct {
        const char *name;
        qm_hausdorff_stop stop;
    } stops[] = {{"converged", QM_STOP_CONVERGED},
                 {"threshold", QM_STOP_THRESHOLD},
                 {"deadline", QM_STOP_DEADLINE},
                 {"canceled", QM_STOP_CANCELED},
                 {"precision", QM_STOP_PRECISION}};
    for (size_t i = 0; i < sizeof stops / sizeof stops[0]; i++)
        if (strcmp(string(object, "stopped_by"), stops[i].name) == 0) return stops[i].stop;
    return QM_STOP_CANCELED;
}

static int read_verdict(const cJSON *object)
{
    const char *verdict = string(object, "verdict");
    return strcmp(verdict, "above") == 0 ? 1 : strcmp(verdict, "below") == 0 ? -1 : 0;
}

static void read_result(const cJSON *object, qm_job_result *out)
{
    qm_hausdorff_result *h = &out->hausdorff;
    const cJSON *witness = cJSON_GetObjectItemCaseSensitive(object, "witness");
    const cJSON *from = cJSON_GetObjectItemCaseSensitive(witness, "from");
    const cJSON *prepare = cJSON_GetObjectItemCaseSensitive(object, "prepare_ms");
    h->lower = number(object, "lower", 0.0);
    h->upper = number(object, "upper", INFINITY);
    h->has_witness = cJSON_IsObject(witness);
    h->from_side = strcmp(string(from, "mesh"), "b") == 0;
    read_surface_point(from, &out->from_face, &h->from);
    read_surface_point(cJSON_GetObjectItemCaseSensitive(witness, "to"), &out->to_face, &h->to);
    h->iterations = count(object, "iterations");
    h->projections = count(object, "projections");
    h->max_queue = (size_t)count(object, "max_queue");
    h->elapsed_ms = number(object, "elapsed_ms", 0.0);
    h->stop = read_stop(object);
    h->verdict = read_verdict(object);
    out->tolerance = number(object, "tolerance", 0.0);
    out->prepare_a_ms = number(prepare, "a", 0.0);
    out->prepare_b_ms = number(prepare, "b", 0.0);
}

static void read_bounds(const cJSON *object, qm_hausdorff_progress *out)
{
    out->elapsed_ms = number(object, "elapsed_ms", 0.0);
    out->lower = number(object, "lower", 0.0);
    out->upper = number(object, "upper", INFINITY);
    out->iterations = count(object, "iterations");
    out->projections = count(object, "projections");
    out->queue_count = (size_t)count(object, "queue");
}

static qm_problem_code code_from_name(const char *name)
{
    for (int code = 0; code < QM_PROBLEM_COUNT; code++)
        if (strcmp(qm_problem_name((qm_problem_code)code), name) == 0) return (qm_problem_code)code;
    return QM_PROBLEM_INTERNAL;
}

static size_t read_place(const cJSON *error, const char *name)
{
    return cJSON_GetObjectItemCaseSensitive(error, name) ? (size_t)count(error, name) : QM_NO_PLACE;
}

static bool read_problem(const cJSON *object, qm_problem *out)
{
    if (!string(object, "detail")[0] && !string(object, "title")[0]) return false;
    const char *detail = string(object, "detail");
    *out = qm_problem_make(code_from_name(string(object, "code")), "%s",
                           detail[0] ? detail : string(object, "title"));
    const cJSON *error;
    cJSON_ArrayForEach(error, cJSON_GetObjectItemCaseSensitive(object, "errors"))
    {
        if (out->error_count == QM_PROBLEM_ERRORS) break;
        qm_problem_add_pointer(out, string(error, "pointer"), "%s", string(error, "detail"));
        out->errors[out->error_count - 1].line = read_place(error, "line");
        out->errors[out->error_count - 1].offset = read_place(error, "offset");
    }
    return true;
}

void qm_reply_read_event(const char *line, size_t size, qm_event *out)
{
    *out = (qm_event){.kind = QM_EVENT_BROKEN};
    cJSON *tree = cJSON_ParseWithLength(line, size);
    const char *name = string(tree, "event");
    if (strcmp(name, "bounds") == 0) {
        out->kind = QM_EVENT_BOUNDS;
        read_bounds(tree, &out->progress);
    } else if (strcmp(name, "result") == 0) {
        out->kind = QM_EVENT_RESULT;
        read_result(cJSON_GetObjectItemCaseSensitive(tree, "result"), &out->result);
    } else if (strcmp(name, "error") == 0) {
        if (read_problem(cJSON_GetObjectItemCaseSensitive(tree, "problem"), &out->problem))
            out->kind = QM_EVENT_ERROR;
    } else if (name[0]) {
        out->kind = QM_EVENT_OTHER;
    }
    cJSON_Delete(tree);
}

bool qm_reply_read_mesh(const char *text, size_t size, char id[QM_ID_SIZE], double *diagonal)
{
    cJSON *tree = cJSON_ParseWithLength(text, size);
    const char *found = string(tree, "id");
    bool is_mesh = found[0] && strlen(found) < QM_ID_SIZE;
    if (is_mesh) strcpy(id, found);
    *diagonal = number(cJSON_GetObjectItemCaseSensitive(tree, "bounding_box"), "diagonal", 0.0);
    cJSON_Delete(tree);
    return is_mesh;
}

bool qm_reply_read_problem(const char *text, size_t size, qm_problem *out)
{
    cJSON *tree = cJSON_ParseWithLength(text, size);
    bool is_problem = read_problem(tree, out);
    cJSON_Delete(tree);
    return is_problem;
}
