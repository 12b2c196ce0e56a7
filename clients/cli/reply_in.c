#include "reply_in.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "json_read.h"

#define PATH_SIZE 64
#define COUNT_LIMIT 0x1p53 /* what a double of JSON counts without gaps */

/** A number that null stands for when it is not finite. */
static double bound(const qm_json *json, const char *path)
{
    double value = qm_json_get_number(json, path);
    return isnan(value) ? INFINITY : value;
}

static double number(const qm_json *json, const char *path)
{
    double value = qm_json_get_number(json, path);
    return isnan(value) ? 0.0 : value;
}

/** A count; what is none reads as 0. */
static uint64_t count(const qm_json *json, const char *path)
{
    double value = qm_json_get_number(json, path);
    return value > 0.0 && value < COUNT_LIMIT ? (uint64_t)value : 0;
}

static const char *string(const qm_json *json, const char *path)
{
    const char *value = qm_json_get_string(json, path);
    return value ? value : "";
}

/** PATH.NAME, where a number may stand for a place in an array. */
static const char *join(char out[PATH_SIZE], const char *path, const char *name, int place)
{
    if (place < 0)
        snprintf(out, PATH_SIZE, "%s.%s", path, name);
    else
        snprintf(out, PATH_SIZE, "%s.%s.%d", path, name, place);
    return out;
}

static void read_surface_point(const qm_json *json, const char *path, uint32_t *face, qm_surface_point *out)
{
    char member[PATH_SIZE];
    uint64_t value = count(json, join(member, path, "face", -1));
    *face = value < QM_NO_INDEX ? (uint32_t)value : QM_NO_INDEX;
    for (int i = 0; i < 2; i++)
        out->uv[i] = number(json, join(member, path, "uv", i));
    for (int i = 0; i < 3; i++)
        out->position[i] = number(json, join(member, path, "point", i));
}

static qm_hausdorff_stop read_stop(const qm_json *event)
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
        if (strcmp(string(event, "result.stopped_by"), stops[i].name) == 0) return stops[i].stop;
    return QM_STOP_CANCELED;
}

static int read_verdict(const qm_json *event)
{
    const char *verdict = string(event, "result.verdict");
    return strcmp(verdict, "above") == 0 ? 1 : strcmp(verdict, "below") == 0 ? -1 : 0;
}

static void read_result(const qm_json *event, qm_job_result *out)
{
    qm_hausdorff_result *h = &out->hausdorff;
    h->lower = number(event, "result.lower");
    h->upper = bound(event, "result.upper");
    h->has_witness = qm_json_has(event, "result.witness");
    h->from_side = strcmp(string(event, "result.witness.from.mesh"), "b") == 0;
    read_surface_point(event, "result.witness.from", &out->from_face, &h->from);
    read_surface_point(event, "result.witness.to", &out->to_face, &h->to);
    h->iterations = count(event, "result.iterations");
    h->projections = count(event, "result.projections");
    h->max_queue = (size_t)count(event, "result.max_queue");
    h->elapsed_ms = number(event, "result.elapsed_ms");
    h->stop = read_stop(event);
    h->verdict = read_verdict(event);
    out->tolerance = number(event, "result.tolerance");
    out->prepare_a_ms = number(event, "result.prepare_ms.a");
    out->prepare_b_ms = number(event, "result.prepare_ms.b");
}

static void read_bounds(const qm_json *event, qm_hausdorff_progress *out)
{
    out->elapsed_ms = number(event, "elapsed_ms");
    out->lower = number(event, "lower");
    out->upper = bound(event, "upper");
    out->iterations = count(event, "iterations");
    out->projections = count(event, "projections");
    out->queue_count = (size_t)count(event, "queue");
}

static qm_problem_code code_from_name(const char *name)
{
    for (int code = 0; code < QM_PROBLEM_COUNT; code++)
        if (strcmp(qm_problem_name((qm_problem_code)code), name) == 0) return (qm_problem_code)code;
    return QM_PROBLEM_INTERNAL;
}

/** A line or offset; QM_NO_PLACE when the member is not there. */
static size_t read_place(const qm_json *json, const char *path)
{
    return qm_json_has(json, path) ? (size_t)count(json, path) : QM_NO_PLACE;
}

/** Reads the problem whose members are at prefix ("" or "problem."). */
static bool read_problem(const qm_json *json, const char *prefix, qm_problem *out)
{
    char path[PATH_SIZE];
    snprintf(path, sizeof path, "%stitle", prefix);
    const char *title = string(json, path);
    snprintf(path, sizeof path, "%sdetail", prefix);
    const char *detail = string(json, path);
    snprintf(path, sizeof path, "%scode", prefix);
    *out = qm_problem_make(code_from_name(string(json, path)), "%s", detail[0] ? detail : title);
    for (int i = 0; i < QM_PROBLEM_ERRORS; i++) {
        char error[PATH_SIZE / 2], member[PATH_SIZE];
        snprintf(error, sizeof error, "%serrors.%d", prefix, i);
        if (!qm_json_has(json, error)) break;
        qm_problem_add_pointer(out, string(json, join(member, error, "pointer", -1)), "%s", "");
        qm_problem_error *added = &out->errors[out->error_count - 1];
        snprintf(added->detail, sizeof added->detail, "%s", string(json, join(member, error, "detail", -1)));
        added->line = read_place(json, join(member, error, "line", -1));
        added->offset = read_place(json, join(member, error, "offset", -1));
    }
    return out->detail[0] != '\0';
}

void qm_reply_read_event(const char *line, qm_event *out)
{
    *out = (qm_event){.kind = QM_EVENT_BROKEN};
    qm_json *event = qm_json_parse(line);
    const char *name = string(event, "event");
    if (strcmp(name, "bounds") == 0) {
        out->kind = QM_EVENT_BOUNDS;
        read_bounds(event, &out->progress);
    } else if (strcmp(name, "result") == 0) {
        out->kind = QM_EVENT_RESULT;
        read_result(event, &out->result);
    } else if (strcmp(name, "error") == 0) {
        if (read_problem(event, "problem.", &out->problem)) out->kind = QM_EVENT_ERROR;
    } else if (name[0]) {
        out->kind = QM_EVENT_OTHER;
    }
    qm_json_free(event);
}

bool qm_reply_read_mesh(const char *text, char id[QM_ID_SIZE], double *diagonal)
{
    qm_json *mesh = qm_json_parse(text);
    const char *found = string(mesh, "id");
    bool is_mesh = found[0] && strlen(found) < QM_ID_SIZE;
    if (is_mesh) strcpy(id, found);
    *diagonal = number(mesh, "bounding_box.diagonal");
    qm_json_free(mesh);
    return is_mesh;
}

bool qm_reply_read_problem(const char *text, qm_problem *out)
{
    qm_json *document = qm_json_parse(text);
    bool is_problem = read_problem(document, "", out);
    qm_json_free(document);
    return is_problem;
}
