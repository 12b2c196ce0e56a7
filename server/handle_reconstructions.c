#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "handlers.h"
#include "json_layout.h"
#include "json_write.h"

static bool find_row(qm_request *request, qm_store_reconstruction *out)
{
    if (qm_store_find_reconstruction(qm_request_app(request)->store, qm_request_id(request), out))
        return true;
    qm_problem problem = qm_problem_make(QM_PROBLEM_RECONSTRUCTION_NOT_FOUND, "there is no reconstruction %s",
                                         qm_request_id(request));
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

static void reply_row(qm_request *request, int status, const qm_store_reconstruction *row)
{
    qm_text out = {0};
    write_row(&out, row, false);
    qm_reply_header(request, "ETag", "\"%s-%lld\"", row->id, (long long)row->revision);
    qm_reply_text(request, status, "application/json", qm_text_take(&out));
}

/** Takes the layout of the request as it is now; false with a problem. */
static bool take_layout(qm_app *app, const qm_json_reconstruction *asked, qm_store_layout *out,
                        qm_problem *problem)
{
    if (qm_store_find_layout(app->store, asked->layout, out)) return true;
    *problem = qm_problem_make(QM_PROBLEM_LAYOUT_NOT_FOUND, "there is no layout of the id given in layout");
    qm_problem_add_pointer(problem, "/layout", "no such layout");
    return false;
}

void qm_handle_reconstruction_create(qm_request *request)
{
    qm_app *app = qm_request_app(request);
    size_t size;
    const char *body = qm_request_body(request, &size);
    qm_json_reconstruction asked;
    qm_problem problem;
    qm_store_layout layout;
    if (!qm_json_read_reconstruction(body, size, &asked, &problem) ||
        !take_layout(app, &asked, &layout, &problem)) {
        qm_reply_problem(request, &problem);
        return;
    }
    qm_store_reconstruction row;
    if (qm_reconstructions_add(app->reconstructions, asked.source[0] ? asked.source : layout.mesh, layout.id,
                               layout.layout, &asked.options, &row, &problem)) {
        qm_reply_header(request, "Location", "/v1/reconstructions/%s", row.id);
        reply_row(request, 201, &row);
        qm_store_reconstruction_reset(&row);
    } else {
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
    size_t count = rows ? qm_store_list_reconstructions(store, after, limit + 1, rows) : 0;
    qm_text out = {0};
    qm_text_add_string(&out, "{");
    qm_json_open(&out, "reconstructions", "[");
    for (size_t i = 0; i < count && i < limit; i++)
        write_row(&out, &rows[i], true);
    if (count > limit)
        qm_text_printf(&out, "],\"next\":\"%lld\"}", (long long)rows[limit - 1].sequence);
    else
        qm_text_add_string(&out, "],\"next\":null}");
    for (size_t i = 0; i < count; i++)
        qm_store_reconstruction_reset(&rows[i]);
    free(rows);
    qm_reply_text(request, 200, "application/json", qm_text_take(&out));
}

void qm_handle_reconstruction_get(qm_request *request)
{
    qm_store_reconstruction row;
    if (!find_row(request, &row)) return;
    reply_row(request, 200, &row);
    qm_store_reconstruction_reset(&row);
}

void qm_handle_reconstruction_delete(qm_request *request)
{
    if (qm_reconstructions_delete(qm_request_app(request)->reconstructions, qm_request_id(request))) {
        qm_reply_empty(request, 204);
        return;
    }
    qm_problem problem = qm_problem_make(QM_PROBLEM_RECONSTRUCTION_NOT_FOUND, "there is no reconstruction %s",
                                         qm_request_id(request));
    qm_reply_problem(request, &problem);
}

/** The mesh is an ordinary one: whoever asks is sent there, with what it was asked as. */
void qm_handle_reconstruction_mesh(qm_request *request)
{
    qm_store_reconstruction row;
    if (!find_row(request, &row)) return;
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
