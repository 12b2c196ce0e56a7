/**
 * handle_compare.c: POST /v1/compare: two files in, one answer out, and nothing is kept. The parts of the body are decoded where they
 * lie, in the file that the body was received in.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/json.h"
#include "handlers.h"
#include "job/json_in.h"
#include "media.h"
#include "multipart.h"

enum { MAX_PARTS = 8 };

/** The body, and what of it is the question. */
typedef struct comparison {
    const uint8_t *body;
    size_t size;
    qm_multipart_part parts[MAX_PARTS];
    size_t count;
    const qm_multipart_part *mesh[2], *options; /* the last may be NULL */
} comparison;

static bool reject(qm_problem *problem, const char *name, const char *message)
{
    char pointer[96];
    snprintf(pointer, sizeof pointer, "/%.60s", name);
    *problem = qm_problem_make(QM_PROBLEM_INVALID_FIELD, "part `%.60s` %s", name, message);
    qm_problem_add_pointer(problem, pointer, "%s", message);
    return false;
}

/** Finds the parts by their names. */
static bool name_parts(comparison *out, qm_problem *problem)
{
    for (size_t i = 0; i < out->count; i++) {
        const qm_multipart_part *part = &out->parts[i];
        const qm_multipart_part **place = strcmp(part->name, "a") == 0         ? &out->mesh[0]
                                          : strcmp(part->name, "b") == 0       ? &out->mesh[1]
                                          : strcmp(part->name, "options") == 0 ? &out->options
                                                                               : NULL;
        if (!place) return reject(problem, part->name, "is none of a, b and options");
        if (*place) return reject(problem, part->name, "is given more than once");
        *place = part;
    }
    if (!out->mesh[0]) return reject(problem, "a", "is missing");
    return out->mesh[1] || reject(problem, "b", "is missing");
}

/** Splits the body of the upload; false with a problem. */
static bool read_body(const qm_request *request, qm_blob_writer *upload, comparison *out, qm_problem *problem)
{
    char boundary[QM_MULTIPART_BOUNDARY_SIZE], hash[QM_HASH_SIZE];
    if (!qm_multipart_read_boundary(qm_request_header(request, "Content-Type"), boundary)) {
        *problem = qm_problem_make(QM_PROBLEM_UNSUPPORTED_MEDIA_TYPE,
                                   "the Content-Type must be multipart/form-data with a boundary");
        return false;
    }
    qm_status status = qm_blob_seal(upload, hash);
    if (status == QM_OK && qm_blob_size(upload) > 0)
        status = qm_blob_map_sealed(upload, &out->body, &out->size);
    if (status != QM_OK) {
        *problem = qm_problem_from_write(status, "the body");
        return false;
    }
    return qm_multipart_split(out->body, out->size, boundary, out->parts, MAX_PARTS, &out->count, problem) &&
           name_parts(out, problem);
}

/* ---- the question ---- */

/** True unless the options name a kind of job that is not one of two meshes; else false with a problem. */
static bool check_type(const char *type, qm_problem *problem)
{
    static const char message[] = "must be a kind of job of two meshes";
    qm_job_kind kind;
    if (!type || !qm_job_kind_find(type, &kind) || qm_job_type_of(kind)->mesh_field[1]) return true;
    *problem = qm_problem_make(QM_PROBLEM_INVALID_FIELD, "type %s", message);
    qm_problem_add_pointer(problem, "/type", "%s", message);
    return false;
}

/** The options as a request of a job: its meshes get names, and its type the default. NULL: out of memory. */
static char *write_request(const char *options, bool has_type)
{
    const char *rest = strchr(options, '{') + 1;
    bool is_empty = rest[strspn(rest, " \t\r\n")] == '}';
    qm_text out = {0};
    qm_text_printf(&out, "{\"a\":\"a\",\"b\":\"b\"%s%s", has_type ? "" : ",\"type\":\"comparison\"",
                   is_empty ? "" : ",");
    qm_text_add_string(&out, rest);
    return qm_text_take(&out);
}

/** The text of the options, for free(); NULL with a problem when it is no object. */
static char *copy_options(const comparison *parts, qm_problem *problem)
{
    const qm_multipart_part *options = parts->options;
    size_t size = options ? options->size : strlen("{}");
    char *text = malloc(size + 1);
    if (!text) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the options");
        return NULL;
    }
    memcpy(text, options ? (const char *)parts->body + options->offset : "{}", size);
    text[size] = '\0';
    if (strlen(text) == size && text[strspn(text, " \t\r\n")] == '{') return text;
    free(text);
    reject(problem, "options", "must be a JSON object");
    return NULL;
}

/** Reads what is asked: a job of two meshes. What is no JSON is read as it is, so that its fault is found where it is. False with a
 * problem. */
static bool read_request(const comparison *parts, qm_job_request *out, qm_problem *problem)
{
    char *options = copy_options(parts, problem);
    if (!options) return false;
    qm_json *given = qm_json_parse(options);
    bool is_json = given != NULL,
         is_right = !is_json || check_type(qm_json_get_string(given, "type"), problem);
    char *text = is_json ? write_request(options, qm_json_has(given, "type")) : strdup(options);
    qm_json_free(given);
    free(options);
    bool is_read = is_right && text && qm_json_read_job(text, strlen(text), out, problem);
    /* What can be parsed now, and could not before, had no memory. */
    bool had_no_memory =
        is_right && !is_read && (!text || (!is_json && problem->code == QM_PROBLEM_INVALID_FIELD));
    free(text);
    if (had_no_memory) *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the options");
    out->a[0] = out->b[0] = '\0'; /* the meshes have no ids */
    return is_read;
}

/* ---- the meshes ---- */

/** The format of a part by the name of its file, else by its type; else it is detected. */
static qm_format format_of(const qm_multipart_part *part)
{
    qm_format format = qm_format_from_path(part->file_name);
    return format == QM_FORMAT_UNKNOWN && part->type[0] ? qm_format_from_media_type(part->type) : format;
}

/** Decodes both files; false with a problem, which names the part. */
static bool load_meshes(qm_meshes *meshes, const comparison *parts, qm_mesh_ref *out[2], qm_problem *problem)
{
    for (int i = 0; i < 2; i++) {
        const qm_multipart_part *part = parts->mesh[i];
        if (qm_meshes_load_apart(meshes, parts->body + part->offset, part->size, format_of(part), &out[i],
                                 problem))
            continue;
        size_t length = strlen(problem->detail), most = sizeof problem->detail - sizeof "a: ";
        memmove(problem->detail + 3, problem->detail, length < most ? length : most);
        memcpy(problem->detail, i == 0 ? "a: " : "b: ", 3);
        problem->detail[3 + (length < most ? length : most)] = '\0';
        if (i == 1) qm_meshes_release(meshes, out[0]);
        return false;
    }
    return true;
}

void qm_handle_compare(qm_request *request)
{
    qm_app *app = qm_request_app(request);
    qm_problem problem;
    qm_blob_writer *upload = qm_request_take_upload(request);
    comparison parts = {.count = 0};
    qm_job_request job = qm_job_request_default();
    qm_mesh_ref *mesh[2];
    bool is_ready = false;
    if (atomic_load(&app->draining))
        problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the daemon is stopping and takes no new jobs");
    else
        is_ready = read_body(request, upload, &parts, &problem) && read_request(&parts, &job, &problem);
    if (is_ready && !load_meshes(app->meshes, &parts, mesh, &problem)) {
        qm_job_request_reset(&job);
        is_ready = false;
    }
    qm_blob_unmap(parts.body, parts.size);
    qm_blob_abort(upload);
    if (is_ready)
        qm_reply_once(request, &job, mesh);
    else
        qm_reply_problem(request, &problem);
}
