/**
 * handle_layouts.c: layouts as a resource.
 */
#include <stdlib.h>
#include <string.h>

#include "handlers.h"
#include "layout_session.h"
#include "ops/faced_surface.h"
#include "ops/json_layout.h"
#include "ops/json_out.h"
#include "store/store_problem.h"

static bool store_new(qm_layout_session *s, const qm_store_idempotency *idempotency, qm_problem *problem)
{
    char created[QM_TIME_SIZE];
    qm_clock_format(created);
    qm_id_make('l', s->row.id);
    s->row.created = strdup(created);
    s->row.next_curve = s->layout.next_id;
    s->row.is_complete = s->issues.count == 0;
    bool written = qm_layout_session_write(s, &s->row.layout, &s->row.issues);
    if (!s->row.created || !written) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the layout");
        return false;
    }
    qm_stored stored = qm_store_put_layout(s->app->store, &s->row, idempotency);
    if (stored != QM_STORED) *problem = qm_store_write_problem(stored, "the layout");
    return stored == QM_STORED;
}

/** Patches that the request names stay as they are; else they are found. */
static bool set_patches(qm_layout_session *s, bool has_patches, qm_problem *problem)
{
    qm_status status;
    if (has_patches) {
        status = qm_layout_validate(&s->ctx, &s->layout, s->source.diagonal, &s->source);
        if (status == QM_OK) status = qm_layout_find_crossings(&s->ctx, &s->layout, &s->source, &s->issues);
    } else {
        status = qm_layout_find_patches(&s->ctx, &s->source, &s->layout, &s->issues);
    }
    return status == QM_OK || qm_layout_session_fail(s, status, problem);
}

/** Adds the features of the mesh, if the request wants them. False with a problem. */
static bool add_features(qm_layout_session *s, const qm_layout_features_options *wanted, qm_problem *problem)
{
    size_t added;
    return wanted->angle == 0.0 ||
           qm_layout_session_outcome(
               s, qm_layout_add_features(&s->ctx, &s->layout, &s->source, wanted, &added), problem);
}

/** Makes the layout of quads that are made of the surface, or of one that is made of its points. False with a problem. */
static bool make_of_surface(qm_layout_session *s, const qm_json_quad_layout *wanted, qm_problem *problem)
{
    qm_symmetry_wish symmetry = wanted->symmetry;
    qm_faced_surface faced;
    qm_status status = qm_faced_surface_make(&s->ctx, &s->source, wanted->make_quads.thread_count, &faced);
    if (status == QM_OK)
        status = qm_symmetric_layout_make(&s->ctx, &faced.surface, &symmetry, &wanted->make_quads,
                                          &wanted->options, &s->layout, &s->issues, NULL);
    qm_faced_surface_reset(&s->ctx, &faced);
    return qm_layout_session_outcome(s, status, problem);
}

/** Makes the layout of the quads of a mesh, on the surface of another. False with a problem. */
static bool make_of_quads(qm_layout_session *s, const qm_json_quad_layout *wanted, qm_problem *problem)
{
    qm_mesh_ref *quads = qm_meshes_acquire(s->app->meshes, wanted->quads, problem);
    if (!quads) return false;
    qm_status status = qm_quad_layout_make(&s->ctx, &qm_mesh_ref_get(quads)->mesh, &s->source,
                                           &wanted->options, &s->layout, &s->issues, NULL);
    qm_meshes_release(s->app->meshes, quads);
    return qm_layout_session_outcome(s, status, problem);
}

/** Makes a layout, unless the client leaves or its deadline comes before. False with a problem. */
static bool make_watched(qm_layout_session *s, qm_request *request, const qm_json_quad_layout *wanted,
                         qm_problem *problem)
{
    qm_http_watch watch;
    memcpy(s->row.mesh, wanted->mesh, sizeof s->row.mesh);
    qm_http_watch_begin(&watch, request, wanted->deadline_ms, &s->ctx);
    bool is_made = qm_layout_session_take_mesh(s, problem) &&
                   (wanted->source == QM_LAYOUT_QUADS ? make_of_quads(s, wanted, problem)
                                                      : make_of_surface(s, wanted, problem));
    return qm_http_watch_end(&watch, &s->ctx, problem) && is_made;
}

/** The layout that a request describes, with its patches and issues. False with a problem. */
static bool read_new(qm_layout_session *s, qm_request *request, qm_problem *problem)
{
    qm_json_quad_layout wanted;
    qm_layout_features_options features;
    bool has_patches;
    size_t size;
    const char *body = qm_request_body(request, &size);
    if (!qm_json_read_quad_layout(body, size, &wanted, problem)) return false;
    if (wanted.source != QM_LAYOUT_GIVEN) return make_watched(s, request, &wanted, problem);
    return qm_json_read_layout(&s->ctx, body, size, s->row.mesh, &features, &s->layout, &has_patches,
                               problem) &&
           qm_layout_session_take_mesh(s, problem) && add_features(s, &features, problem) &&
           set_patches(s, has_patches, problem);
}

/** Replies with the layout that a repeated request has created, or with a problem; false for a new one. */
static bool reply_again(qm_request *request, const qm_store_idempotency *idempotency)
{
    char id[QM_ID_SIZE];
    qm_idempotency outcome =
        qm_handlers_check_idempotency(request, idempotency, qm_store_find_layout_by_idempotency_key, id);
    if (outcome != QM_IDEMPOTENCY_MADE) return outcome == QM_IDEMPOTENCY_REFUSED;
    qm_store_layout row;
    qm_stored stored = qm_store_find_layout(qm_request_app(request)->store, id, &row);
    if (stored == QM_STORED) {
        qm_reply_header(request, "Location", "/v1/layouts/%s", row.id);
        qm_layout_session_reply(request, 201, &row, NULL);
        qm_store_layout_reset(&row);
    } else {
        qm_problem problem = qm_store_read_problem(stored, QM_PROBLEM_LAYOUT_NOT_FOUND, "layout %s", id);
        qm_reply_problem(request, &problem);
    }
    return true;
}

bool qm_handle_layout_computes(const qm_request *request)
{
    size_t size;
    const char *body = qm_request_body(request, &size);
    return body && (memmem(body, size, "\"auto\"", 6) || memmem(body, size, "\"quads\"", 7));
}

void qm_handle_layout_create(qm_request *request)
{
    qm_store_idempotency idempotency;
    if (!qm_handlers_read_idempotency(request, &idempotency) || reply_again(request, &idempotency)) return;
    qm_layout_session s = qm_layout_session_make(qm_request_app(request));
    qm_problem problem;
    if (read_new(&s, request, &problem) && store_new(&s, &idempotency, &problem)) {
        qm_reply_header(request, "Location", "/v1/layouts/%s", s.row.id);
        qm_layout_session_reply(request, 201, &s.row, NULL);
    } else if (!reply_again(request, &idempotency)) { /* an equal request may have been faster */
        qm_reply_problem(request, &problem);
    }
    qm_layout_session_close(&s);
}

void qm_handle_layout_list(qm_request *request)
{
    qm_store_page page;
    if (!qm_handlers_read_paging(request, &page)) return;
    qm_store_page asked = page;
    asked.limit++; /* one more says whether there is a next page */
    qm_store_layout *rows = calloc(asked.limit, sizeof *rows);
    size_t count = 0;
    qm_store *store = qm_request_app(request)->store;
    qm_stored stored =
        rows ? qm_store_list_layouts(store, &asked, qm_request_query(request, "mesh"), rows, &count)
             : QM_STORED_NO_MEMORY;
    if (stored != QM_STORED) {
        free(rows);
        qm_problem problem = qm_store_read_problem(stored, QM_PROBLEM_INTERNAL, "layouts");
        qm_reply_problem(request, &problem);
        return;
    }
    qm_text out = {0};
    qm_text_add_string(&out, "{");
    qm_json_open(&out, "layouts", "[");
    for (size_t i = 0; i < count && i < page.limit; i++) {
        qm_json_add_comma(&out);
        qm_text_add_string(&out, "{");
        qm_layout_session_describe(&out, &rows[i], true);
        qm_text_add_string(&out, "}");
    }
    qm_handlers_end_page(&out, count > page.limit ? rows[page.limit - 1].sequence : 0);
    for (size_t i = 0; i < count; i++)
        qm_store_layout_reset(&rows[i]);
    free(rows);
    qm_reply_text(request, 200, "application/json", qm_text_take(&out));
}

void qm_handle_layout_get(qm_request *request)
{
    qm_store_layout row;
    qm_problem problem;
    if (!qm_layout_session_find(request, &row, &problem)) {
        qm_reply_problem(request, &problem);
        return;
    }
    qm_layout_session_reply(request, 200, &row, NULL);
    qm_store_layout_reset(&row);
}

void qm_handle_layout_delete(qm_request *request)
{
    const char *id = qm_request_id(request);
    qm_stored stored = qm_store_delete_layout(qm_request_app(request)->store, id);
    if (stored == QM_STORED) {
        qm_reply_empty(request, 204);
        return;
    }
    qm_problem problem = qm_store_read_problem(stored, QM_PROBLEM_LAYOUT_NOT_FOUND, "layout %s", id);
    qm_reply_problem(request, &problem);
}

/** Goes one revision back or forth. */
static void step_revision(qm_request *request, int step)
{
    qm_app *app = qm_request_app(request);
    qm_store_layout row;
    qm_problem problem;
    if (!qm_layout_session_find(request, &row, &problem)) {
        qm_reply_problem(request, &problem);
        return;
    }
    int64_t to = row.revision + step;
    bool is_kept = row.first <= to && to <= row.latest;
    qm_stored stored = is_kept ? qm_store_move_layout(app->store, row.id, row.revision, to) : QM_STORED_NONE;
    qm_store_layout_reset(&row);
    if (!is_kept)
        problem = qm_problem_make(QM_PROBLEM_CONFLICT, "there is nothing to %s", step < 0 ? "undo" : "redo");
    else if (stored == QM_STORED_LATE)
        problem = qm_problem_make(QM_PROBLEM_CONFLICT, "another client has edited the layout");
    else if (stored != QM_STORED)
        problem = qm_store_write_problem(stored, "the layout");
    else if (qm_layout_session_find(request, &row, &problem)) {
        qm_layout_session_reply(request, 200, &row, NULL);
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
