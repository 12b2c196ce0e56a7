/**
 * handle_deform.c: PATCH /v1/meshes/{id}/vertices: the next revision of a mesh.
 */
#include <stdlib.h>
#include <string.h>

#include "base/json.h"
#include "handlers.h"
#include "job/json_in.h"
#include "media.h"
#include "mesh/etag.h"
#include "ops/projections.h"

/** Reads the body into a block of `times` its size, with a zero after it; NULL with a problem. */
static char *read_body(const qm_blob_writer *upload, size_t times, size_t *size, qm_problem *problem)
{
    *size = (size_t)qm_blob_size(upload);
    char *bytes = malloc(times * *size + 1);
    if (!bytes) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the vertices");
        return NULL;
    }
    bytes[*size] = '\0';
    if (qm_blob_read(upload, 0, bytes, *size) == QM_OK) return bytes;
    free(bytes);
    *problem = qm_problem_make(QM_PROBLEM_INTERNAL, "the body cannot be read back");
    return NULL;
}

/** Converts a binary body to doubles of this machine, in place; takes over the bytes, which have room for
 * doubles. False with a problem. */
static bool read_numbers(char *bytes, size_t size, bool is_float, qm_moved_vertices *out, qm_problem *problem)
{
    size_t width = is_float ? sizeof(float) : sizeof(double);
    *out = (qm_moved_vertices){.count = size / (3 * width)};
    if (size == 0 || size % (3 * width) != 0) {
        free(bytes);
        *problem =
            qm_problem_make(QM_PROBLEM_MALFORMED_BODY,
                            "the body has %zu bytes; it must be a multiple of %zu above 0", size, 3 * width);
        return false;
    }
    out->positions = (double *)(void *)bytes;
    (is_float ? qm_projections_widen : qm_array_swap_bytes)(out->positions, 3 * out->count);
    return true;
}

static bool read_moved(qm_request *request, const qm_blob_writer *upload, bool is_float,
                       qm_moved_vertices *out, qm_problem *problem)
{
    const char *type = qm_request_header(request, "Content-Type");
    bool is_json = type && qm_media_is(type, "application/json");
    *out = (qm_moved_vertices){0};
    if (type && !is_json && !qm_media_is(type, "application/octet-stream")) {
        *problem = qm_problem_make(QM_PROBLEM_UNSUPPORTED_MEDIA_TYPE,
                                   "the Content-Type of vertices must be application/json, or "
                                   "application/octet-stream for all vertices");
        return false;
    }
    size_t size;
    char *bytes = read_body(upload, is_float ? 2 : 1, &size, problem);
    if (!bytes) return false;
    if (!is_json) return read_numbers(bytes, size, is_float, out, problem);
    bool read = qm_json_read_moved_vertices(bytes, size, out, problem);
    free(bytes);
    return read;
}

static void reply(qm_request *request, const qm_deformed *deformed)
{
    char tag[QM_ETAG_SIZE];
    qm_etag_write_mesh(deformed->hash, deformed->revision, "", tag);
    qm_reply_header(request, "ETag", "%s", tag);
    qm_text out = {0};
    qm_text_add_string(&out, "{");
    qm_json_add_count(&out, "revision", deformed->revision);
    qm_json_add_count(&out, "updated_nodes", deformed->updated_nodes);
    qm_json_add_ms(&out, "refit_ms", deformed->refit_ms);
    qm_text_add_string(&out, "}");
    qm_reply_text(request, 200, "application/json", qm_text_take(&out));
}

void qm_handle_mesh_deform(qm_request *request)
{
    static const char *const types[] = {"f64", "f32", NULL};
    int type;
    if (!qm_request_choice(request, "dtype", types, &type)) return;
    qm_blob_writer *upload = qm_request_take_upload(request);
    qm_moved_vertices moved;
    qm_problem problem;
    qm_deformed deformed;
    bool done = read_moved(request, upload, type == 1, &moved, &problem) &&
                qm_meshes_deform(qm_request_app(request)->meshes, qm_request_id(request), &moved,
                                 qm_request_header(request, "If-Match"), &deformed, &problem);
    qm_moved_vertices_reset(&moved);
    qm_blob_abort(upload);
    if (done)
        reply(request, &deformed);
    else
        qm_reply_problem(request, &problem);
}
