#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/json_write.h"
#include "handlers.h"
#include "ops/json_layout.h"

static bool find_row(qm_request *request, const char *id, qm_store_reconstruction *out)
{
    qm_status status = qm_store_find_reconstruction(qm_request_app(request)->store, id, out);
    if (status == QM_OK) return true;
    qm_problem problem =
        qm_problem_from_store(status, QM_PROBLEM_RECONSTRUCTION_NOT_FOUND, "reconstruction %s", id);
    qm_reply_problem(request, &problem);
    return false;
}

/** The resource; the records of all steps are left out of lists. */
static void write_row(qm_text *out, const qm_store_reconstruction *row, bool is_brief)
{
    qm_json_add_comma(out);
    qm_text_printf(out, "{%s,%s", row->document, row->state);
    qm_json_add_count(out, "revision", (uint64_t)row->revision);
    if (!is_brief) {
        qm_json_open(out, "steps", "[");
        qm_text_add_string(out, row->records);
        qm_text_add_string(out, "]");
    }
    qm_text_add_string(out, "}");
}

/** more, where there is some, is a member besides. */
static void reply_row(qm_request *request, int status, const qm_store_reconstruction *row, const char *more)
{
    qm_text out = {0};
    write_row(&out, row, false);
    if (more && !out.failed) {
        out.size--; /* goes on before the last brace */
        qm_text_printf(&out, ",%s}", more);
    }
    qm_reply_header(request, "ETag", "\"%s-%lld\"", row->id, (long long)row->revision);
    qm_reply_text(request, status, "application/json", qm_text_take(&out));
}

/** Takes a layout as it is now; false with a problem. */
static bool take_layout(qm_app *app, const char *id, qm_store_layout *out, qm_problem *problem)
{
    qm_status status = qm_store_find_layout(app->store, id, out);
    if (status == QM_OK) return true;
    *problem = qm_problem_from_store(status, QM_PROBLEM_LAYOUT_NOT_FOUND, "layout of the id given in layout");
    if (status == QM_E_EMPTY) qm_problem_add_pointer(problem, "/layout", "no such layout");
    return false;
}

/** Replies with what the same request has made before, or with what is wrong; false for a new one. */
static bool reply_again(qm_request *request, const qm_store_idempotency *once)
{
    char id[QM_ID_SIZE];
    qm_idempotency outcome = qm_find_idempotent(request, once, qm_store_find_idempotent_reconstruction, id);
    if (outcome != QM_IDEMPOTENCY_MADE) return outcome == QM_IDEMPOTENCY_REFUSED;
    qm_store_reconstruction row;
    if (!find_row(request, id, &row)) return true;
    qm_reply_header(request, "Location", "/v1/reconstructions/%s", row.id);
    reply_row(request, 201, &row, NULL);
    qm_store_reconstruction_reset(&row);
    return true;
}

void qm_handle_reconstruction_create(qm_request *request)
{
    qm_store_idempotency once;
    if (!qm_read_idempotency(request, &once) || reply_again(request, &once)) return;
    qm_app *app = qm_request_app(request);
    size_t size;
    const char *body = qm_request_body(request, &size);
    qm_json_reconstruction asked;
    qm_problem problem;
    qm_store_layout layout;
    if (!qm_json_read_reconstruction(body, size, &asked, &problem) ||
        !take_layout(app, asked.layout, &layout, &problem)) {
        qm_reply_problem(request, &problem);
        return;
    }
    qm_store_reconstruction row;
    if (qm_reconstructions_add(app->reconstructions, asked.source[0] ? asked.source : layout.mesh, layout.id,
                               layout.layout, &asked.options, &once, &row, &problem)) {
        qm_reply_header(request, "Location", "/v1/reconstructions/%s", row.id);
        reply_row(request, 201, &row, NULL);
        qm_store_reconstruction_reset(&row);
    } else if (!reply_again(request, &once)) { /* its twin may have come first */
        qm_reply_problem(request, &problem);
    }
    qm_store_layout_reset(&layout);
}

void qm_handle_reconstruction_list(qm_request *request)
{
    size_t limit;
    int64_t after;
    if (!qm_read_paging(request, &limit, &after)) return;
    qm_store_reconstruction *rows = calloc(limit + 1, sizeof *rows);
    qm_store *store = qm_request_app(request)->store;
    size_t count = 0;
    qm_status status =
        rows ? qm_store_list_reconstructions(store, after, limit + 1, rows, &count) : QM_E_NO_MEMORY;
    if (status != QM_OK) {
        free(rows);
        qm_problem problem = qm_problem_from_store(status, QM_PROBLEM_INTERNAL, "reconstructions");
        qm_reply_problem(request, &problem);
        return;
    }
    qm_text out = {0};
    qm_text_add_string(&out, "{");
    qm_json_open(&out, "reconstructions", "[");
    for (size_t i = 0; i < count && i < limit; i++)
        write_row(&out, &rows[i], true);
    qm_end_page(&out, count > limit ? rows[limit - 1].sequence : 0);
    for (size_t i = 0; i < count; i++)
        qm_store_reconstruction_reset(&rows[i]);
    free(rows);
    qm_reply_text(request, 200, "application/json", qm_text_take(&out));
}

void qm_handle_reconstruction_get(qm_request *request)
{
    qm_store_reconstruction row;
    if (!find_row(request, qm_request_id(request), &row)) return;
    reply_row(request, 200, &row, NULL);
    qm_store_reconstruction_reset(&row);
}

void qm_handle_reconstruction_delete(qm_request *request)
{
    const char *id = qm_request_id(request);
    qm_status status = qm_reconstructions_delete(qm_request_app(request)->reconstructions, id);
    if (status == QM_OK) {
        qm_reply_empty(request, 204);
        return;
    }
    qm_problem problem =
        qm_problem_from_store(status, QM_PROBLEM_RECONSTRUCTION_NOT_FOUND, "reconstruction %s", id);
    qm_reply_problem(request, &problem);
}

/** The layout may have been edited since: what that has touched is made anew. */
void qm_handle_reconstruction_edit(qm_request *request)
{
    qm_app *app = qm_request_app(request);
    size_t size;
    const char *body = qm_request_body(request, &size);
    qm_json_reconstruction asked;
    qm_problem problem;
    qm_store_layout layout;
    if (!qm_json_read_layout_choice(body, size, &asked, &problem) ||
        !take_layout(app, asked.layout, &layout, &problem)) {
        qm_reply_problem(request, &problem);
        return;
    }
    qm_store_reconstruction row;
    size_t redone;
    if (qm_reconstructions_edit(app->reconstructions, qm_request_id(request), layout.layout, &row, &redone,
                                &problem)) {
        char more[48];
        snprintf(more, sizeof more, "\"redone_patches\":%zu", redone);
        reply_row(request, 200, &row, more);
        qm_store_reconstruction_reset(&row);
    } else {
        qm_reply_problem(request, &problem);
    }
    qm_store_layout_reset(&layout);
}

/** The mesh is an ordinary one: whoever asks is sent there, with what it was asked as. */
void qm_handle_reconstruction_mesh(qm_request *request)
{
    qm_store_reconstruction row;
    if (!find_row(request, qm_request_id(request), &row)) return;
    const char *format = qm_request_query(request, "format");
    bool is_name = format && qm_format_from_name(format) != QM_FORMAT_UNKNOWN;
    qm_reply_header(request, "Location", "/v1/meshes/%s/content%s%s", row.mesh, is_name ? "?format=" : "",
                    is_name ? format : "");
    qm_store_reconstruction_reset(&row);
    qm_reply_empty(request, 307);
}

void qm_handle_reconstruction_patches(qm_request *request)
{
    qm_app *app = qm_request_app(request);
    qm_problem problem;
    qm_refining *refining = qm_reconstructions_take(app->reconstructions, qm_request_id(request), &problem);
    if (!refining) {
        qm_reply_problem(request, &problem);
        return;
    }
    qm_text out = {0};
    qm_text_add_string(&out, "{");
    qm_json_add_count(&out, "quads", qm_refining_quads(refining));
    qm_refining_add_patches(refining, &out);
    qm_text_add_string(&out, "}");
    qm_reconstructions_release(app->reconstructions, refining, true);
    qm_reply_text(request, 200, "application/json", qm_text_take(&out));
}
