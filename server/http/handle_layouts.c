/**
 * handle_layouts.c: layouts as a resource, and the edits of their curves: strokes and the others.
 */
#include <stdlib.h>
#include <string.h>

#include "handlers.h"
#include "ops/json_layout.h"
#include "ops/json_out.h"
#include "qm/layout_edit.h"
#include "store/store_problem.h"

#define SNAP_SHARE 0.01 /* of the diagonal: snap radius unless the request has one */

/* ---- sessions ---- */

/**
 * The state of one edit of a layout, between its row in the store and the reply. An edit reads the current revision, changes a
 * copy, finds the patches again and stores the copy as the next revision; an edit that lost a race against another one is a
 * conflict (409).
 *
 * before is the layout as it was opened. session_close frees all members, also after a failure.
 */
typedef struct layout_session {
    qm_app *app;
    qm_context ctx;
    qm_store_layout row;
    qm_layout before, layout;
    qm_layout_issues issues;
    qm_mesh_ref *mesh;
    qm_ref_surface source;
} layout_session;

/** An empty session, for a new layout. */
static layout_session session_make(qm_app *app)
{
    return (layout_session){.app = app, .ctx = qm_meshes_context(app->meshes)};
}

static void session_close(layout_session *s)
{
    qm_layout_issues_reset(&s->ctx, &s->issues);
    qm_layout_reset(&s->ctx, &s->before);
    qm_layout_reset(&s->ctx, &s->layout);
    qm_meshes_release(s->app->meshes, s->mesh);
    qm_store_layout_reset(&s->row);
}

/** Makes the problem of a status of the engine; returns false. */
static bool session_fail(const layout_session *s, qm_status status, qm_problem *problem)
{
    *problem = qm_problem_from_status(status, s->ctx.message);
    return false;
}

/** An argument that the engine rejects is a fault of the request. */
static bool outcome(layout_session *s, qm_status status, qm_problem *problem)
{
    if (status == QM_OK) return true;
    if (status == QM_E_ARGUMENT)
        *problem = qm_problem_make(QM_PROBLEM_INVALID_LAYOUT, "%s", s->ctx.message);
    else
        session_fail(s, status, problem);
    return false;
}

/** Acquires the mesh that the row names, and its surface. False with a problem. */
static bool session_take_mesh(layout_session *s, qm_problem *problem)
{
    s->mesh = qm_meshes_acquire(s->app->meshes, s->row.mesh, problem);
    if (!s->mesh) return false;
    qm_status status = qm_ref_surface_init(&s->ctx, qm_mesh_ref_get(s->mesh)->bvh, &s->source);
    return status == QM_OK || session_fail(s, status, problem);
}

/** The row of the layout that the path names. False with a problem. */
static bool find_layout(qm_request *request, qm_store_layout *out, qm_problem *problem)
{
    const char *id = qm_request_id(request);
    qm_stored stored = qm_store_find_layout(qm_request_app(request)->store, id, out);
    if (stored != QM_STORED)
        *problem = qm_store_read_problem(stored, QM_PROBLEM_LAYOUT_NOT_FOUND, "layout %s", id);
    return stored == QM_STORED;
}

/** Opens a session on the layout that the path names. False with a problem. */
static bool session_open(qm_request *request, layout_session *s, qm_problem *problem)
{
    *s = session_make(qm_request_app(request));
    bool has_patches;
    if (!find_layout(request, &s->row, problem) || !session_take_mesh(s, problem)) return false;
    if (!qm_json_read_layout(&s->ctx, s->row.layout, strlen(s->row.layout), NULL, &s->layout, &has_patches,
                             problem))
        return false;
    s->layout.next_id = (uint32_t)s->row.next_curve;
    qm_status status = qm_layout_copy(&s->ctx, &s->layout, &s->before);
    return status == QM_OK || session_fail(s, status, problem);
}

/** The layout and its issues as JSON, for the caller to free also after a failure. False: out of memory. */
static bool session_write(const layout_session *s, char **layout, char **issues)
{
    qm_text text = {0}, open = {0};
    qm_text_add_string(&text, "{");
    qm_json_add_layout(&text, &s->layout);
    qm_text_add_string(&text, "}");
    qm_json_add_layout_issues(&open, &s->issues);
    *layout = qm_text_take(&text);
    *issues = qm_text_take(&open);
    return *layout && *issues;
}

/** Adds the members of a layout; without its curves when brief. */
static void write_layout(qm_text *out, const qm_store_layout *row, bool is_brief)
{
    qm_json_add_string(out, "id", row->id);
    qm_json_add_string(out, "mesh", row->mesh);
    qm_json_add_count(out, "revision", (uint64_t)row->revision);
    qm_json_add_bool(out, "can_undo", row->revision > row->first);
    qm_json_add_bool(out, "can_redo", row->revision < row->latest);
    qm_json_add_bool(out, "complete", row->is_complete);
    qm_json_add_string(out, "created", row->created);
    if (is_brief) return;
    qm_json_add_members(out, row->layout);
    qm_json_add_comma(out);
    qm_text_add_string(out, row->issues);
}

/** Replies with a layout and what an edit changed, which may be NULL. */
static void reply_layout(qm_request *request, int status, const qm_store_layout *row, const char *changed)
{
    qm_text out = {0};
    qm_text_add_string(&out, "{");
    write_layout(&out, row, false);
    if (changed) {
        qm_json_add_comma(&out);
        qm_text_add_string(&out, changed);
    }
    qm_text_add_string(&out, "}");
    qm_reply_header(request, "ETag", "\"%s-%lld\"", row->id, (long long)row->revision);
    qm_reply_text(request, status, "application/json", qm_text_take(&out));
}

/** Adds the ids of the curves of one layout that the other lacks, or has with other points. */
static void add_ids(qm_text *out, const char *name, const qm_layout *of, const qm_layout *other, bool changed)
{
    qm_json_open(out, name, "[");
    for (size_t i = 0; i < of->curve_count; i++) {
        uint32_t index = qm_layout_find_curve(other, of->curves[i].id);
        const qm_curve *a = &of->curves[i], *b = index == QM_NO_INDEX ? NULL : &other->curves[index];
        bool is_changed = b && (a->point_count != b->point_count ||
                                memcmp(a->points, b->points, 3 * sizeof(double) * a->point_count) != 0);
        if (changed ? !is_changed : b != NULL) continue;
        qm_json_add_comma(out);
        qm_text_printf(out, "%u", of->curves[i].id);
    }
    qm_text_add_string(out, "]");
}

/** Stores the edited layout as the next revision and replies with it; more has members that the edit adds. */
static void session_finish(qm_request *request, layout_session *s, const char *more)
{
    qm_problem problem;
    qm_status status = qm_layout_find_patches(&s->ctx, &s->source, &s->layout, &s->issues);
    if (status != QM_OK) {
        session_fail(s, status, &problem);
        qm_reply_problem(request, &problem);
        return;
    }
    qm_text changed = {0};
    qm_json_open(&changed, "changed", "{");
    add_ids(&changed, "added_curves", &s->layout, &s->before, false);
    add_ids(&changed, "changed_curves", &s->layout, &s->before, true);
    add_ids(&changed, "removed_curves", &s->before, &s->layout, false);
    qm_text_add_string(&changed, "}");
    if (more[0]) qm_json_add_comma(&changed);
    qm_text_add_string(&changed, more);
    char *layout, *issues, *members = qm_text_take(&changed);
    bool written = session_write(s, &layout, &issues) && members;
    qm_store_layout next = s->row;
    next.layout = layout;
    next.issues = issues;
    next.is_complete = s->issues.count == 0;
    next.next_curve = s->layout.next_id;
    qm_stored stored = written ? qm_store_edit_layout(s->app->store, &next) : QM_STORED_NO_MEMORY;
    if (stored == QM_STORED) {
        next.latest = ++next.revision;
        qm_reply_header(request, "Location", "/v1/layouts/%s", next.id);
        reply_layout(request, 200, &next, members);
    } else {
        problem = stored == QM_STORED_LATE
                      ? qm_problem_make(QM_PROBLEM_CONFLICT, "another client has edited the layout")
                      : qm_store_write_problem(stored, "the layout");
        qm_reply_problem(request, &problem);
    }
    free(layout);
    free(issues);
    free(members);
}

/* ---- the resource ---- */

static bool store_new(layout_session *s, const qm_store_idempotency *idempotency, qm_problem *problem)
{
    char created[QM_TIME_SIZE];
    qm_clock_format(created);
    qm_id_make('l', s->row.id);
    s->row.created = strdup(created);
    s->row.next_curve = s->layout.next_id;
    s->row.is_complete = s->issues.count == 0;
    bool written = session_write(s, &s->row.layout, &s->row.issues);
    if (!s->row.created || !written) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the layout");
        return false;
    }
    qm_stored stored = qm_store_put_layout(s->app->store, &s->row, idempotency);
    if (stored != QM_STORED) *problem = qm_store_write_problem(stored, "the layout");
    return stored == QM_STORED;
}

/** Patches that the request names stay as they are; else they are found. */
static bool set_patches(layout_session *s, bool has_patches, qm_problem *problem)
{
    qm_status status;
    if (has_patches) {
        status = qm_layout_validate(&s->ctx, &s->layout, s->source.diagonal, &s->source);
        if (status == QM_OK) status = qm_layout_find_crossings(&s->ctx, &s->layout, &s->source, &s->issues);
    } else {
        status = qm_layout_find_patches(&s->ctx, &s->source, &s->layout, &s->issues);
    }
    return status == QM_OK || session_fail(s, status, problem);
}

/** Makes the layout of quads that are made of the surface. False with a problem. */
static bool make_of_surface(layout_session *s, const qm_json_quad_layout *wanted, qm_problem *problem)
{
    qm_status status = qm_quad_layout_make_of_surface(&s->ctx, &s->source, &wanted->make_quads,
                                                      &wanted->options, &s->layout, &s->issues, NULL, NULL);
    return outcome(s, status, problem);
}

/** Makes the layout of the quads of a mesh, on the surface of another. False with a problem. */
static bool make_of_quads(layout_session *s, const qm_json_quad_layout *wanted, qm_problem *problem)
{
    qm_mesh_ref *quads = qm_meshes_acquire(s->app->meshes, wanted->quads, problem);
    if (!quads) return false;
    qm_status status = qm_quad_layout_make(&s->ctx, &qm_mesh_ref_get(quads)->mesh, &s->source,
                                           &wanted->options, &s->layout, &s->issues, NULL);
    qm_meshes_release(s->app->meshes, quads);
    return outcome(s, status, problem);
}

/** Makes a layout, unless the client leaves or its deadline comes before. False with a problem. */
static bool make_watched(layout_session *s, qm_request *request, const qm_json_quad_layout *wanted,
                         qm_problem *problem)
{
    qm_http_watch watch;
    memcpy(s->row.mesh, wanted->mesh, sizeof s->row.mesh);
    qm_http_watch_begin(&watch, request, wanted->deadline_ms, &s->ctx);
    bool is_made = session_take_mesh(s, problem) &&
                   (wanted->source == QM_LAYOUT_QUADS ? make_of_quads(s, wanted, problem)
                                                      : make_of_surface(s, wanted, problem));
    return qm_http_watch_end(&watch, &s->ctx, problem) && is_made;
}

/** The layout that a request describes, with its patches and issues. False with a problem. */
static bool read_new(layout_session *s, qm_request *request, qm_problem *problem)
{
    qm_json_quad_layout wanted;
    bool has_patches;
    size_t size;
    const char *body = qm_request_body(request, &size);
    if (!qm_json_read_quad_layout(body, size, &wanted, problem)) return false;
    if (wanted.source != QM_LAYOUT_GIVEN) return make_watched(s, request, &wanted, problem);
    return qm_json_read_layout(&s->ctx, body, size, s->row.mesh, &s->layout, &has_patches, problem) &&
           session_take_mesh(s, problem) && set_patches(s, has_patches, problem);
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
        reply_layout(request, 201, &row, NULL);
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
    layout_session s = session_make(qm_request_app(request));
    qm_problem problem;
    if (read_new(&s, request, &problem) && store_new(&s, &idempotency, &problem)) {
        qm_reply_header(request, "Location", "/v1/layouts/%s", s.row.id);
        reply_layout(request, 201, &s.row, NULL);
    } else if (!reply_again(request, &idempotency)) { /* an equal request may have been faster */
        qm_reply_problem(request, &problem);
    }
    session_close(&s);
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
        write_layout(&out, &rows[i], true);
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
    if (!find_layout(request, &row, &problem)) {
        qm_reply_problem(request, &problem);
        return;
    }
    reply_layout(request, 200, &row, NULL);
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
    if (!find_layout(request, &row, &problem)) {
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
    else if (find_layout(request, &row, &problem)) {
        reply_layout(request, 200, &row, NULL);
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

/* ---- edits ---- */

/** Makes one edit; more gets members for the reply. */
typedef bool edit_fn(layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                     qm_problem *problem);

/** The curve of the path; false with a 404 when the layout has none of this id. */
static bool find_curve(const qm_request *request, const layout_session *s, uint32_t *curve,
                       qm_problem *problem)
{
    const char *text = qm_request_second_id(request);
    char *end;
    unsigned long number = strtoul(text, &end, 10);
    *curve = number < QM_NO_INDEX ? (uint32_t)number : QM_NO_INDEX;
    if (text[0] >= '0' && text[0] <= '9' && !*end && qm_layout_find_curve(&s->layout, *curve) != QM_NO_INDEX)
        return true;
    *problem = qm_problem_make(QM_PROBLEM_CURVE_NOT_FOUND, "the layout has no curve %s", text);
    return false;
}

static void make_edit(qm_request *request, const qm_layout_edit *edit, bool has_curve, edit_fn *apply)
{
    layout_session s;
    qm_problem problem;
    uint32_t curve = QM_NO_INDEX;
    qm_text more = {0};
    if (session_open(request, &s, &problem) && (!has_curve || find_curve(request, &s, &curve, &problem)) &&
        apply(&s, edit, curve, &more, &problem)) {
        char *members = qm_text_take(&more);
        session_finish(request, &s, members ? members : "");
        free(members);
    } else {
        qm_text_reset(&more);
        qm_reply_problem(request, &problem);
    }
    session_close(&s);
}

/** Reads the body of an edit, and makes it. */
static void edit_by_body(qm_request *request, qm_layout_edit_kind kind, bool has_curve, edit_fn *apply)
{
    size_t size;
    const char *body = qm_request_body(request, &size);
    qm_layout_edit edit;
    qm_problem problem;
    if (!qm_json_read_layout_edit(body, size, kind, &edit, &problem)) {
        qm_reply_problem(request, &problem);
        return;
    }
    make_edit(request, &edit, has_curve, apply);
    qm_layout_edit_reset(&edit);
}

static double snap_radius(const layout_session *s, const qm_layout_edit *edit)
{
    return edit->radius > 0.0 ? edit->radius : SNAP_SHARE * s->source.diagonal;
}

/** The places of a stroke on the surface. */
typedef struct picked_stroke {
    double *points; /* rows of x y z, on malloc */
    size_t count, missed;
} picked_stroke;

static bool pick_stroke(layout_session *s, const qm_layout_edit *edit, picked_stroke *out,
                        qm_problem *problem)
{
    *out = (picked_stroke){0};
    qm_pick_view view;
    qm_status status = qm_pick_view_init(&s->ctx, &s->source, &edit->camera, &edit->pick, &view);
    if (status != QM_OK) return outcome(s, status, problem);
    out->points = malloc(edit->point_count * 3 * sizeof *out->points);
    if (!out->points) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the stroke");
        return false;
    }
    status = qm_pick_stroke(&s->ctx, &view, edit->points, edit->point_count, out->points, &out->count,
                            &out->missed);
    if (status == QM_OK && out->count < 2)
        status =
            qm_context_fail(&s->ctx, QM_E_ARGUMENT, "the stroke meets the surface at %zu of its %zu points",
                            edit->point_count - out->missed, edit->point_count);
    return outcome(s, status, problem);
}

static void add_stroke_facts(qm_text *out, uint32_t curve, const picked_stroke *stroke)
{
    qm_json_open(out, "stroke", "{");
    qm_json_add_count(out, "curve", curve);
    qm_json_add_count(out, "points", stroke->count);
    qm_json_add_count(out, "missed_points", stroke->missed);
    qm_text_add_string(out, "}");
}

static bool apply_stroke(layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                         qm_problem *problem)
{
    (void)curve;
    picked_stroke stroke;
    uint32_t id = QM_NO_INDEX;
    bool good = pick_stroke(s, edit, &stroke, problem) &&
                outcome(s,
                        qm_layout_add_stroke(&s->ctx, &s->layout, &s->source, stroke.points, stroke.count,
                                             snap_radius(s, edit), &id),
                        problem);
    if (good) add_stroke_facts(more, id, &stroke);
    free(stroke.points);
    return good;
}

static bool apply_split(layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                        qm_problem *problem)
{
    (void)more;
    return outcome(s, qm_layout_split_curve(&s->ctx, &s->layout, curve, edit->point), problem);
}

static bool apply_snap(layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                       qm_problem *problem)
{
    (void)more;
    return outcome(
        s, qm_layout_snap_end(&s->ctx, &s->layout, curve, edit->end, edit->point, snap_radius(s, edit)),
        problem);
}

static bool redraw(layout_session *s, uint32_t curve, const double *points, size_t count, qm_problem *problem)
{
    return outcome(s, qm_layout_redraw_curve(&s->ctx, &s->layout, curve, points, count), problem);
}

static bool apply_redraw(layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                         qm_problem *problem)
{
    if (!edit->in_window) return redraw(s, curve, edit->points, edit->point_count, problem);
    picked_stroke stroke;
    bool good =
        pick_stroke(s, edit, &stroke, problem) && redraw(s, curve, stroke.points, stroke.count, problem);
    if (good) add_stroke_facts(more, curve, &stroke);
    free(stroke.points);
    return good;
}

static bool apply_merge(layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                        qm_problem *problem)
{
    (void)curve;
    (void)more;
    return outcome(s, qm_layout_merge_curves(&s->ctx, &s->layout, edit->first, edit->second), problem);
}

static bool apply_delete(layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                         qm_problem *problem)
{
    (void)edit;
    (void)more;
    return outcome(s, qm_layout_delete_curve(&s->ctx, &s->layout, curve), problem);
}

void qm_handle_layout_stroke(qm_request *request)
{
    edit_by_body(request, QM_EDIT_STROKE, false, apply_stroke);
}

void qm_handle_curve_merge(qm_request *request)
{
    edit_by_body(request, QM_EDIT_MERGE, false, apply_merge);
}

void qm_handle_curve_split(qm_request *request)
{
    edit_by_body(request, QM_EDIT_SPLIT, true, apply_split);
}

void qm_handle_curve_snap(qm_request *request)
{
    edit_by_body(request, QM_EDIT_SNAP, true, apply_snap);
}

void qm_handle_curve_redraw(qm_request *request)
{
    edit_by_body(request, QM_EDIT_REDRAW, true, apply_redraw);
}

void qm_handle_curve_delete(qm_request *request)
{
    make_edit(request, NULL, true, apply_delete);
}
