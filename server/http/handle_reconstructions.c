/**
 * handle_reconstructions.c: reconstructions as a resource; their steps are jobs.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/json.h"
#include "handlers.h"
#include "ops/json_layout.h"
#include "store/store_problem.h"

static bool find_row(qm_request *request, const char *id, qm_store_reconstruction *out)
{
    qm_stored stored = qm_store_find_reconstruction(qm_request_app(request)->store, id, out);
    if (stored == QM_STORED) return true;
    qm_problem problem =
        qm_store_read_problem(stored, QM_PROBLEM_RECONSTRUCTION_NOT_FOUND, "reconstruction %s", id);
    qm_reply_problem(request, &problem);
    return false;
}

/** Adds the resource but for the records of its steps, which lists leave out, and for its last brace. */
static void open_row(qm_text *out, const qm_store_reconstruction *row)
{
    qm_json_add_comma(out);
    qm_text_printf(out, "{%s,%s", row->document, row->state);
    qm_json_add_count(out, "revision", (uint64_t)row->revision);
}

/** Replies with the resource; redone_patches is a member of it when not NULL. */
static void reply_row(qm_request *request, int status, const qm_store_reconstruction *row,
                      const size_t *redone_patches)
{
    qm_text out = {0};
    open_row(&out, row);
    qm_json_open(&out, "steps", "[");
    qm_text_add_string(&out, row->records);
    qm_text_add_string(&out, "]");
    if (redone_patches) qm_json_add_count(&out, "redone_patches", *redone_patches);
    qm_text_add_string(&out, "}");
    qm_reply_header(request, "ETag", "\"%s-%lld\"", row->id, (long long)row->revision);
    qm_reply_text(request, status, "application/json", qm_text_take(&out));
}

/** Reads the current revision of a layout; false with a problem. */
static bool take_layout(qm_app *app, const char *id, qm_store_layout *out, qm_problem *problem)
{
    qm_stored stored = qm_store_find_layout(app->store, id, out);
    if (stored == QM_STORED) return true;
    *problem = qm_store_read_problem(stored, QM_PROBLEM_LAYOUT_NOT_FOUND, "layout with the id in `layout`");
    if (stored == QM_STORED_NONE) qm_problem_add_pointer(problem, "/layout", "no such layout");
    return false;
}

/** Replies with the reconstruction that a repeated request has created, or with a problem; false for a new
 * request. */
static bool reply_again(qm_request *request, const qm_store_idempotency *idempotency)
{
    char id[QM_ID_SIZE];
    qm_idempotency outcome = qm_handlers_check_idempotency(
        request, idempotency, qm_store_find_reconstruction_by_idempotency_key, id);
    if (outcome != QM_IDEMPOTENCY_MADE) return outcome == QM_IDEMPOTENCY_REFUSED;
    qm_store_reconstruction row;
    if (!find_row(request, id, &row)) return true;
    qm_reply_header(request, "Location", "/v1/reconstructions/%s", row.id);
    reply_row(request, 201, &row, NULL);
    qm_store_reconstruction_reset(&row);
    return true;
}

/** Creates a reconstruction, unless the client leaves or its deadline comes before: nothing is stored then. False with a problem. */
static bool add_watched(qm_request *request, const qm_json_reconstruction *wanted,
                        const qm_store_layout *layout, const qm_store_idempotency *idempotency,
                        qm_store_reconstruction *out, qm_problem *problem)
{
    qm_app *app = qm_request_app(request);
    qm_http_watch watch;
    qm_context host = {0};
    qm_http_watch_begin(&watch, request, wanted->deadline_ms, &host);
    bool is_added = qm_reconstructions_add(
        app->reconstructions, wanted->source[0] ? wanted->source : layout->mesh, layout->id, layout->layout,
        &wanted->options, &host, idempotency, out, problem);
    qm_http_watch_end(&watch, &host, problem); /* its problem is the reason, if nothing was added */
    return is_added;
}

void qm_handle_reconstruction_create(qm_request *request)
{
    qm_store_idempotency idempotency;
    if (!qm_handlers_read_idempotency(request, &idempotency) || reply_again(request, &idempotency)) return;
    qm_app *app = qm_request_app(request);
    size_t size;
    const char *body = qm_request_body(request, &size);
    qm_json_reconstruction wanted;
    qm_problem problem;
    qm_store_layout layout;
    if (!qm_json_read_reconstruction(body, size, &wanted, &problem) ||
        !take_layout(app, wanted.layout, &layout, &problem)) {
        qm_reply_problem(request, &problem);
        return;
    }
    qm_store_reconstruction row;
    if (add_watched(request, &wanted, &layout, &idempotency, &row, &problem)) {
        qm_reply_header(request, "Location", "/v1/reconstructions/%s", row.id);
        reply_row(request, 201, &row, NULL);
        qm_store_reconstruction_reset(&row);
    } else if (!reply_again(request, &idempotency)) { /* an equal request may have been faster */
        qm_reply_problem(request, &problem);
    }
    qm_store_layout_reset(&layout);
}

void qm_handle_reconstruction_list(qm_request *request)
{
    qm_store_page page;
    if (!qm_handlers_read_paging(request, &page)) return;
    qm_store_page asked = page;
    asked.limit++; /* one more says whether there is a next page */
    qm_store_reconstruction *rows = calloc(asked.limit, sizeof *rows);
    qm_store *store = qm_request_app(request)->store;
    size_t count = 0;
    qm_stored stored =
        rows ? qm_store_list_reconstructions(store, &asked, qm_request_query(request, "mesh"), rows, &count)
             : QM_STORED_NO_MEMORY;
    if (stored != QM_STORED) {
        free(rows);
        qm_problem problem = qm_store_read_problem(stored, QM_PROBLEM_INTERNAL, "reconstructions");
        qm_reply_problem(request, &problem);
        return;
    }
    qm_text out = {0};
    qm_text_add_string(&out, "{");
    qm_json_open(&out, "reconstructions", "[");
    for (size_t i = 0; i < count && i < page.limit; i++) {
        open_row(&out, &rows[i]);
        qm_text_add_string(&out, "}");
    }
    qm_handlers_end_page(&out, count > page.limit ? rows[page.limit - 1].sequence : 0);
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
    qm_stored stored = qm_reconstructions_delete(qm_request_app(request)->reconstructions, id);
    if (stored == QM_STORED) {
        qm_reply_empty(request, 204);
        return;
    }
    qm_problem problem =
        qm_store_read_problem(stored, QM_PROBLEM_RECONSTRUCTION_NOT_FOUND, "reconstruction %s", id);
    qm_reply_problem(request, &problem);
}

/** Replaces the layout by its current revision, and rebuilds the patches that have changed, unless the client leaves or its deadline comes
 * before. */
void qm_handle_reconstruction_edit(qm_request *request)
{
    qm_app *app = qm_request_app(request);
    size_t size;
    const char *body = qm_request_body(request, &size);
    qm_json_reconstruction wanted;
    qm_problem problem;
    qm_store_layout layout;
    double deadline_ms;
    if (!qm_handlers_read_deadline(request, &deadline_ms)) return;
    if (!qm_json_read_layout_choice(body, size, &wanted, &problem) ||
        !take_layout(app, wanted.layout, &layout, &problem)) {
        qm_reply_problem(request, &problem);
        return;
    }
    qm_store_reconstruction row;
    size_t redone;
    qm_http_watch watch;
    qm_context host = {0};
    qm_http_watch_begin(&watch, request, deadline_ms, &host);
    bool is_edited = qm_reconstructions_edit(app->reconstructions, qm_request_id(request), layout.layout,
                                             &host, &row, &redone, &problem);
    qm_http_watch_end(&watch, &host, &problem); /* its problem is the reason, if nothing has changed */
    if (is_edited) {
        reply_row(request, 200, &row, &redone);
        qm_store_reconstruction_reset(&row);
    } else {
        qm_reply_problem(request, &problem);
    }
    qm_store_layout_reset(&layout);
}

/** Redirects to the current mesh, which is an ordinary one, in the requested format. */
void qm_handle_reconstruction_mesh(qm_request *request)
{
    qm_store_reconstruction row;
    qm_format format;
    if (!qm_handlers_read_format(request, &format) || !find_row(request, qm_request_id(request), &row))
        return;
    const char *name = qm_request_query(request, "format");
    qm_reply_header(request, "Location", "/v1/meshes/%s/content%s%s", row.mesh, name ? "?format=" : "",
                    name ? name : "");
    qm_store_reconstruction_reset(&row);
    qm_reply_empty(request, 307);
}

void qm_handle_reconstruction_patches(qm_request *request)
{
    qm_app *app = qm_request_app(request);
    qm_problem problem;
    qm_reconstruction_lease *refining =
        qm_reconstructions_take(app->reconstructions, qm_request_id(request), NULL, &problem);
    if (!refining) {
        qm_reply_problem(request, &problem);
        return;
    }
    qm_text out = {0};
    qm_text_add_string(&out, "{");
    qm_json_add_count(&out, "quads", qm_reconstructions_count_quads(refining));
    qm_reconstructions_add_patches(refining, &out);
    qm_text_add_string(&out, "}");
    qm_reconstructions_release(app->reconstructions, refining, true);
    qm_reply_text(request, 200, "application/json", qm_text_take(&out));
}
