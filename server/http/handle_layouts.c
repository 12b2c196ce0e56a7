/**
 * handle_layouts.c: layouts as a resource; their edits are in handle_layout_edits.c.
 */
#include <stdlib.h>
#include <string.h>

#include "layout_session.h"
#include "ops/json_layout.h"
#include "ops/json_out.h"

static bool store_new(qm_layout_session *s, const qm_store_idempotency *idempotency, qm_problem *problem)
{
    char created[QM_TIME_SIZE];
    qm_time_format(created);
    qm_id_make('l', s->row.id);
    s->row.created = strdup(created);
    s->row.next_curve = s->layout.next_id;
    s->row.is_complete = s->issues.count == 0;
    bool written = qm_layout_session_write(s, &s->row.layout, &s->row.issues);
    if (!s->row.created || !written) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the layout");
        return false;
    }
    if (qm_store_put_layout(s->app->store, &s->row, idempotency) == QM_OK) return true;
    *problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the layout could not be stored");
    return false;
}

/** Patches that the request names stay as they are; else they are found. */
static bool set_patches(qm_layout_session *s, bool has_patches, qm_problem *problem)
{
    qm_status status;
    if (has_patches) {
        status = qm_layout_validate(&s->ctx, &s->layout, s->source.diagonal);
        if (status == QM_OK) status = qm_layout_find_crossings(&s->ctx, &s->layout, &s->issues);
    } else {
        status = qm_layout_find_patches(&s->ctx, &s->source, &s->layout, &s->issues);
    }
    return status == QM_OK || qm_layout_session_fail(s, status, problem);
}

/** Replies with the layout that a repeated request has created, or with a problem; false for a new one. */
static bool reply_again(qm_request *request, const qm_store_idempotency *idempotency)
{
    char id[QM_ID_SIZE];
    qm_idempotency outcome =
        qm_check_idempotency(request, idempotency, qm_store_find_layout_by_idempotency_key, id);
    if (outcome != QM_IDEMPOTENCY_MADE) return outcome == QM_IDEMPOTENCY_REFUSED;
    qm_store_layout row;
    qm_status status = qm_store_find_layout(qm_request_app(request)->store, id, &row);
    if (status == QM_OK) {
        qm_reply_header(request, "Location", "/v1/layouts/%s", row.id);
        qm_reply_layout(request, 201, &row, NULL);
        qm_store_layout_reset(&row);
    } else {
        qm_problem problem = qm_problem_from_store(status, QM_PROBLEM_LAYOUT_NOT_FOUND, "layout %s", id);
        qm_reply_problem(request, &problem);
    }
    return true;
}

void qm_handle_layout_create(qm_request *request)
{
    qm_store_idempotency idempotency;
    if (!qm_read_idempotency(request, &idempotency) || reply_again(request, &idempotency)) return;
    qm_layout_session s = qm_layout_session_make(qm_request_app(request));
    size_t size;
    const char *body = qm_request_body(request, &size);
    qm_problem problem;
    bool has_patches;
    if (qm_json_read_layout(&s.ctx, body, size, s.row.mesh, &s.layout, &has_patches, &problem) &&
        qm_layout_session_take_mesh(&s, &problem) && set_patches(&s, has_patches, &problem) &&
        store_new(&s, &idempotency, &problem)) {
        qm_reply_header(request, "Location", "/v1/layouts/%s", s.row.id);
        qm_reply_layout(request, 201, &s.row, NULL);
    } else if (!reply_again(request, &idempotency)) { /* an equal request may have been faster */
        qm_reply_problem(request, &problem);
    }
    qm_layout_session_close(&s);
}

void qm_handle_layout_list(qm_request *request)
{
    size_t limit;
    int64_t after;
    if (!qm_read_paging(request, &limit, &after)) return;
    qm_store_layout *rows = calloc(limit + 1, sizeof *rows);
    size_t count = 0;
    qm_store *store = qm_request_app(request)->store;
    qm_status status = rows ? qm_store_list_layouts(store, after, limit + 1, rows, &count) : QM_E_NO_MEMORY;
    if (status != QM_OK) {
        free(rows);
        qm_problem problem = qm_problem_from_store(status, QM_PROBLEM_INTERNAL, "layouts");
        qm_reply_problem(request, &problem);
        return;
    }
    qm_text out = {0};
    qm_text_add_string(&out, "{");
    qm_json_open(&out, "layouts", "[");
    for (size_t i = 0; i < count && i < limit; i++) {
        qm_json_add_comma(&out);
        qm_text_add_string(&out, "{");
        qm_write_layout(&out, &rows[i], true);
        qm_text_add_string(&out, "}");
    }
    qm_end_page(&out, count > limit ? rows[limit - 1].sequence : 0);
    for (size_t i = 0; i < count; i++)
        qm_store_layout_reset(&rows[i]);
    free(rows);
    qm_reply_text(request, 200, "application/json", qm_text_take(&out));
}

void qm_handle_layout_get(qm_request *request)
{
    qm_store_layout row;
    qm_problem problem;
    if (!qm_find_layout(request, &row, &problem)) {
        qm_reply_problem(request, &problem);
        return;
    }
    qm_reply_layout(request, 200, &row, NULL);
    qm_store_layout_reset(&row);
}

void qm_handle_layout_delete(qm_request *request)
{
    const char *id = qm_request_id(request);
    qm_status status = qm_store_delete_layout(qm_request_app(request)->store, id);
    if (status == QM_OK) {
        qm_reply_empty(request, 204);
        return;
    }
    qm_problem problem = qm_problem_from_store(status, QM_PROBLEM_LAYOUT_NOT_FOUND, "layout %s", id);
    qm_reply_problem(request, &problem);
}

/** Goes one revision back or forth. */
static void step_revision(qm_request *request, int step)
{
    qm_app *app = qm_request_app(request);
    qm_store_layout row;
    qm_problem problem;
    if (!qm_find_layout(request, &row, &problem)) {
        qm_reply_problem(request, &problem);
        return;
    }
    int64_t to = row.revision + step;
    qm_status status = to < row.first || to > row.latest
                           ? QM_E_ARGUMENT
                           : qm_store_move_layout(app->store, row.id, row.revision, to);
    qm_store_layout_reset(&row);
    if (status == QM_E_CANCELED)
        problem = qm_problem_make(QM_PROBLEM_CONFLICT, "another client has edited the layout");
    else if (status != QM_OK)
        problem = qm_problem_make(QM_PROBLEM_CONFLICT, "there is nothing to %s", step < 0 ? "undo" : "redo");
    else if (qm_find_layout(request, &row, &problem)) {
        qm_reply_layout(request, 200, &row, NULL);
        qm_store_layout_reset(&row);
        return;
    }
    qm_reply_problem(request, &problem);
}

void qm_handle_layout_undo(qm_request *request)
{
    step_revision(request, -1);
}

void qm_handle_layout_redo(qm_request *request)
{
    step_revision(request, 1);
}
