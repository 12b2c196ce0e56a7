/**
 * handle_meshes.c: meshes as a resource: upload, list, document, time to live and notes, removal, and the next revision of one
 * (PATCH /v1/meshes/{id}/vertices).
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/json.h"
#include "format/gzip.h"
#include "handlers.h"
#include "media.h"
#include "mesh/etag.h"
#include "ops/job_kinds.h"
#include "ops/projections.h"
#include "store/store_problem.h"

#define NAME_SIZE 200

/** Reads ?format=, else Content-Type, else the end of the name. False with a problem when a named one is
 * unknown. */
static bool read_format(const qm_request *request, qm_format *format, qm_problem *problem)
{
    const char *named = qm_request_query(request, "format");
    *format = named ? qm_format_from_name(named) : QM_FORMAT_UNKNOWN;
    if (named && *format == QM_FORMAT_UNKNOWN) {
        *problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "`format` must be one of" QM_FORMAT_NAMES);
        return false;
    }
    if (*format != QM_FORMAT_UNKNOWN) return true;
    static const char *const untyped[] = {"application/octet-stream", "application/x-www-form-urlencoded",
                                          "text/plain", "model/mesh"};
    const char *type = qm_request_header(request, "Content-Type");
    if (type) *format = qm_format_from_media_type(type);
    bool is_untyped = !type || *format != QM_FORMAT_UNKNOWN;
    for (size_t i = 0; i < sizeof untyped / sizeof untyped[0]; i++)
        if (type && qm_media_is(type, untyped[i])) is_untyped = true;
    if (!is_untyped) {
        *problem = qm_problem_make(
            QM_PROBLEM_UNSUPPORTED_MEDIA_TYPE,
            "the Content-Type of a mesh must be application/octet-stream or that of its format");
        return false;
    }
    const char *name = qm_request_query(request, "name");
    if (*format == QM_FORMAT_UNKNOWN && name) *format = qm_format_from_path(name);
    return true;
}

/** A name is for display: any text without control characters. */
static bool check_name(const char *name, qm_problem *problem)
{
    bool is_clean = strlen(name) < NAME_SIZE;
    for (const char *c = name; *c; c++)
        if ((unsigned char)*c < 0x20 || *c == 0x7f) is_clean = false;
    if (!is_clean)
        *problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER,
                                   "`name` must have at most %d characters, none of them a control character",
                                   NAME_SIZE - 1);
    return is_clean;
}

static bool read_name(const qm_request *request, const char **name, qm_problem *problem)
{
    const char *given = qm_request_query(request, "name");
    *name = given ? given : "";
    return check_name(*name, problem);
}

/** Reads ?ttl_seconds=; 0 when it is absent. */
static bool read_ttl(const qm_request *request, double *ttl_s, qm_problem *problem)
{
    const char *given = qm_request_query(request, "ttl_seconds");
    char *end;
    *ttl_s = given ? strtod(given, &end) : 0.0;
    if (!given) return true;
    bool is_integer = strspn(given, "0123456789") == strlen(given) && end != given;
    if (is_integer && *ttl_s >= 1.0 && *ttl_s <= QM_MESHES_MAX_TTL_S) return true;
    *problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER,
                               "`ttl_seconds` must be an integer from 1 to %.0f", QM_MESHES_MAX_TTL_S);
    return false;
}

/** Reads ?unit=, ?uncertainty= and ?labels=, which is separated by commas and becomes a list to be freed. */
static bool read_notes(const qm_request *request, qm_notes *notes, char **labels, qm_problem *problem)
{
    const char *unit = qm_request_query(request, "unit"),
               *uncertainty = qm_request_query(request, "uncertainty");
    qm_text list = {0};
    *notes = (qm_notes){0};
    if (unit && !qm_notes_set_unit(notes, unit)) {
        *problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "`unit` must be " QM_NOTES_UNITS);
        return false;
    }
    if (uncertainty && !qm_notes_set_uncertainty(notes, uncertainty)) {
        *problem =
            qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "`uncertainty` must be a number of 0 or more");
        return false;
    }
    for (const char *label = qm_request_query(request, "labels"); label; label = strchr(label, ',')) {
        if (*label == ',') label++;
        if (!qm_mesh_add_label(&list, label, strcspn(label, ","))) {
            qm_text_reset(&list);
            *problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER, "`labels` " QM_MESH_LABELS);
            return false;
        }
    }
    *labels = list.size > 0 ? qm_text_take(&list) : NULL;
    return true;
}

/** Adds the resource of a mesh: its document, and what of it may change. */
static void add_mesh(qm_text *out, const qm_store_mesh *mesh)
{
    size_t length = strlen(mesh->document);
    QM_ASSERT(length > 2 && mesh->document[length - 1] == '}');
    qm_text_add(out, mesh->document, length - 1);
    if (mesh->notes.unit[0])
        qm_json_add_string(out, "unit", mesh->notes.unit);
    else
        qm_json_add_word(out, "unit", "null");
    qm_json_add_number(out, "uncertainty", mesh->notes.uncertainty);
    qm_mesh_write_labels(out, mesh->labels);
    if (mesh->expires[0]) qm_json_add_string(out, "expires_at", mesh->expires);
    qm_text_add_string(out, "}");
}

/** Whether a body whose Content-Encoding is gzip is so: else a proxy may have inflated it and left the header. */
static bool check_packed(const qm_blob_writer *upload, qm_problem *problem)
{
    uint8_t start[QM_GZIP_MAGIC_SIZE];
    bool is_packed = qm_blob_size(upload) >= sizeof start &&
                     qm_blob_read(upload, 0, start, sizeof start) == QM_OK &&
                     qm_gzip_is_packed(start, sizeof start);
    if (!is_packed)
        *problem =
            qm_problem_make(QM_PROBLEM_MALFORMED_FILE,
                            "the Content-Encoding is gzip, but the body does not start like gzip data");
    return is_packed;
}

/** The resource, or the id alone where that is what the client asks for. */
static void reply_mesh(qm_request *request, int status, qm_store_mesh *mesh)
{
    qm_reply_header(request, "Location", "/v1/meshes/%s", mesh->id);
    if (qm_request_wants_id(request)) {
        qm_reply_id(request, status, mesh->id);
    } else {
        qm_text out = {0};
        add_mesh(&out, mesh);
        qm_reply_text(request, status, QM_MEDIA_JSON, qm_text_take(&out));
    }
    qm_store_mesh_reset(mesh);
}

/** Replies with a mesh of an upload or a copy, to which conditions like If-Match do not apply. */
static void reply_stored(qm_request *request, bool is_new, qm_store_mesh *mesh)
{
    char tag[QM_ETAG_SIZE];
    qm_etag_write_mesh(mesh->hash, mesh->revision, "", tag);
    qm_reply_header(request, "ETag", "%s", tag);
    reply_mesh(request, is_new ? 201 : 200, mesh);
}

void qm_handle_mesh_create(qm_request *request)
{
    qm_app *app = qm_request_app(request);
    qm_problem problem;
    qm_mesh_options options = {0};
    qm_store_mesh mesh;
    bool is_new;
    char *labels = NULL;
    if (atomic_load(&app->draining)) {
        problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the daemon is stopping and takes no new meshes");
        qm_reply_problem(request, &problem);
        return;
    }
    if (!read_format(request, &options.format, &problem) || !read_name(request, &options.name, &problem) ||
        !read_ttl(request, &options.ttl_s, &problem) ||
        !read_notes(request, &options.notes, &labels, &problem)) {
        qm_reply_problem(request, &problem);
        return;
    }
    options.labels = labels;
    qm_blob_writer *upload = qm_request_take_upload(request);
    bool is_added = false;
    if (qm_request_is_packed(request) && !check_packed(upload, &problem))
        qm_blob_abort(upload);
    else
        is_added = qm_meshes_add(app->meshes, upload, &options, &mesh, &is_new, &problem);
    free(labels);
    if (!is_added) {
        qm_reply_problem(request, &problem);
        return;
    }
    reply_stored(request, is_new, &mesh);
}

void qm_handle_mesh_copy(qm_request *request)
{
    qm_app *app = qm_request_app(request);
    size_t size;
    const char *body = qm_request_body(request, &size);
    qm_problem problem;
    qm_moved_copy copy = {.name = NULL};
    qm_store_mesh source, mesh;
    bool is_new, is_stored = false;
    if (!qm_handlers_find_mesh(request, &source)) return;
    if (qm_json_read_copy(body, size, &copy, &problem)) {
        const char *name = copy.name ? copy.name : source.name;
        is_stored = check_name(name, &problem) &&
                    qm_meshes_add_copy(app->meshes, source.id, &copy, name, &mesh, &is_new, &problem);
    }
    free(copy.name);
    qm_store_mesh_reset(&source);
    if (is_stored)
        reply_stored(request, is_new, &mesh);
    else
        qm_reply_problem(request, &problem);
}

void qm_handle_mesh_list(qm_request *request)
{
    qm_app *app = qm_request_app(request);
    qm_store_page page;
    if (!qm_handlers_read_paging(request, &page)) return;
    qm_store_page asked = page;
    asked.limit++; /* one more says whether there is a next page */
    const qm_store_mesh_filter filter = {qm_request_query(request, "name"),
                                         qm_request_query(request, "content_hash"),
                                         qm_request_query(request, "label")};
    qm_store_mesh *rows = calloc(asked.limit, sizeof *rows);
    size_t count = 0;
    qm_stored stored =
        rows ? qm_store_list_meshes(app->store, &asked, &filter, rows, &count) : QM_STORED_NO_MEMORY;
    if (stored != QM_STORED) {
        free(rows);
        qm_problem problem = qm_store_read_problem(stored, QM_PROBLEM_INTERNAL, "meshes");
        qm_reply_problem(request, &problem);
        return;
    }
    qm_text out = {0};
    qm_text_add_string(&out, "{\"meshes\":[");
    for (size_t i = 0; i < count && i < page.limit; i++) {
        if (i > 0) qm_text_add_string(&out, ",");
        add_mesh(&out, &rows[i]);
    }
    qm_handlers_end_page(&out, count > page.limit ? rows[page.limit - 1].sequence : 0);
    for (size_t i = 0; i < count; i++)
        qm_store_mesh_reset(&rows[i]);
    free(rows);
    qm_reply_text(request, 200, "application/json", qm_text_take(&out));
}

void qm_handle_mesh_get(qm_request *request)
{
    qm_store_mesh mesh;
    if (!qm_handlers_find_mesh(request, &mesh)) return;
    if (qm_handlers_check_mesh_tag(request, &mesh))
        reply_mesh(request, 200, &mesh);
    else
        qm_store_mesh_reset(&mesh);
}

/** Writes the id of the newest mesh with this content that was not deformed; false with a problem. */
static bool find_by_hash(qm_store *store, const char *hash, char id[1][QM_ID_SIZE], qm_problem *problem)
{
    if (!qm_json_is_hash(hash)) {
        *problem =
            qm_problem_make(QM_PROBLEM_INVALID_PARAMETER,
                            "a hash of a file must be the 64 digits of its SHA-256 in hex, in lower case");
        return false;
    }
    qm_stored stored = qm_store_find_undeformed(store, &hash, 1, id);
    if (stored == QM_STORED && id[0][0]) return true;
    *problem = qm_store_read_problem(stored == QM_STORED ? QM_STORED_NONE : stored, QM_PROBLEM_MESH_NOT_FOUND,
                                     "mesh with this content");
    return false;
}

void qm_handle_mesh_find(qm_request *request)
{
    qm_store *store = qm_request_app(request)->store;
    char id[1][QM_ID_SIZE];
    qm_problem problem;
    qm_store_mesh mesh;
    if (!find_by_hash(store, qm_request_id(request), id, &problem)) {
        qm_reply_problem(request, &problem);
        return;
    }
    qm_stored stored = qm_store_find_mesh(store, id[0], &mesh);
    if (stored != QM_STORED) { /* deleted meanwhile, or the store is away */
        problem = qm_store_read_problem(stored, QM_PROBLEM_MESH_NOT_FOUND, "mesh %s", id[0]);
        qm_reply_problem(request, &problem);
    } else if (qm_handlers_check_mesh_tag(request, &mesh)) {
        reply_mesh(request, 200, &mesh);
    } else {
        qm_store_mesh_reset(&mesh);
    }
}

void qm_handle_mesh_patch(qm_request *request)
{
    size_t size;
    const char *body = qm_request_body(request, &size);
    qm_problem problem;
    qm_mesh_change change;
    qm_store_mesh mesh;
    bool is_changed = qm_json_read_mesh_change(body, size, &change, &problem) &&
                      qm_meshes_change(qm_request_app(request)->meshes, qm_request_id(request), &change,
                                       qm_request_header(request, "If-Match"), &mesh, &problem);
    free(change.labels);
    if (!is_changed) {
        qm_reply_problem(request, &problem);
        return;
    }
    char tag[QM_ETAG_SIZE];
    qm_etag_write_mesh(mesh.hash, mesh.revision, "", tag);
    qm_reply_header(request, "ETag", "%s", tag);
    reply_mesh(request, 200, &mesh);
}

void qm_handle_mesh_delete(qm_request *request)
{
    qm_problem problem;
    if (qm_meshes_delete(qm_request_app(request)->meshes, qm_request_id(request),
                         qm_request_header(request, "If-Match"), &problem))
        qm_reply_empty(request, 204);
    else
        qm_reply_problem(request, &problem);
}

/* ---- deformation ---- */

/** Bytes that a body becomes, with its numbers: those of JSON stand beside its text. */
static size_t size_in_memory(const qm_blob_writer *upload, bool is_json, bool is_float)
{
    return (is_json || is_float ? 2 : 1) * (size_t)qm_blob_size(upload) + 1;
}

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
    (is_float ? qm_projections_widen : qm_text_swap_bytes)(out->positions, 3 * out->count);
    return true;
}

/** Reads the vertices; *reserved is what they take of the budget, also after a problem. */
static bool read_moved(qm_request *request, const qm_blob_writer *upload, bool is_float,
                       qm_moved_vertices *out, size_t *reserved, qm_problem *problem)
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
    size_t size, needed = size_in_memory(upload, is_json, is_float);
    qm_budget *budget = qm_meshes_budget(qm_request_app(request)->meshes);
    if (!qm_host_budget_reserve(budget, needed)) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the vertices");
        return false;
    }
    *reserved = needed;
    char *bytes = read_body(upload, is_float ? 2 : 1, &size, problem);
    if (!bytes) return false;
    if (!is_json) return read_numbers(bytes, size, is_float, out, problem);
    bool read = qm_json_read_moved_vertices(bytes, size, out, problem);
    free(bytes);
    return read;
}

static void reply_deformed(qm_request *request, const qm_deformed *deformed)
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
    size_t reserved = 0;
    bool done = read_moved(request, upload, type == 1, &moved, &reserved, &problem) &&
                qm_meshes_deform(qm_request_app(request)->meshes, qm_request_id(request), &moved,
                                 qm_request_header(request, "If-Match"), &deformed, &problem);
    qm_json_reset_moved_vertices(&moved);
    qm_host_budget_release(qm_meshes_budget(qm_request_app(request)->meshes), reserved);
    qm_blob_abort(upload);
    if (done)
        reply_deformed(request, &deformed);
    else
        qm_reply_problem(request, &problem);
}
