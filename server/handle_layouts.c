/**
 * handle_layouts.c: layouts and their edits. Every edit reads the layout as it is, changes a copy, finds the
 * patches again and stores the copy as the next revision; one that lost a race against another edit is a
 * conflict.
 */
#include <stdlib.h>
#include <string.h>

#include "handlers.h"
#include "json_layout.h"
#include "json_out.h"
#include "qm/layout_edit.h"

#define SNAP_SHARE 0.01 /* of the diagonal: how far ends snap unless the request tells */

/** A layout at work: its row, its curves, the surface under it. */
typedef struct desk {
    qm_app *app;
    qm_context ctx;
    qm_store_layout row;
    qm_layout before, layout;
    qm_layout_issues issues;
    qm_mesh_ref *mesh;
    qm_source source;
} desk;

static void close_desk(desk *d)
{
    qm_layout_issues_reset(&d->ctx, &d->issues);
    qm_layout_reset(&d->ctx, &d->before);
    qm_layout_reset(&d->ctx, &d->layout);
    qm_meshes_release(d->app->meshes, d->mesh);
    qm_store_layout_reset(&d->row);
}

static bool fail(const desk *d, qm_status status, qm_problem *problem)
{
    *problem = qm_problem_from_status(status, d->ctx.message);
    return false;
}

static bool take_mesh(desk *d, qm_problem *problem)
{
    d->mesh = qm_meshes_acquire(d->app->meshes, d->row.mesh, QM_MESH_NEAREST, problem);
    if (!d->mesh) return false;
    qm_status status = qm_source_init(&d->ctx, qm_mesh_ref_get(d->mesh)->bvh, &d->source);
    return status == QM_OK || fail(d, status, problem);
}

static bool find_row(qm_request *request, qm_store_layout *out, qm_problem *problem)
{
    const char *id = qm_request_id(request);
    qm_status status = qm_store_find_layout(qm_request_app(request)->store, id, out);
    if (status != QM_OK)
        *problem = qm_problem_from_store(status, QM_PROBLEM_LAYOUT_NOT_FOUND, "layout %s", id);
    return status == QM_OK;
}

/** Lays out what an edit needs. False with a problem; close_desk either way. */
static bool open_desk(qm_request *request, desk *d, qm_problem *problem)
{
    *d = (desk){.app = qm_request_app(request)};
    d->ctx = qm_meshes_context(d->app->meshes);
    bool has_patches;
    if (!find_row(request, &d->row, problem) || !take_mesh(d, problem)) return false;
    if (!qm_json_read_layout(&d->ctx, d->row.layout, strlen(d->row.layout), NULL, &d->layout, &has_patches,
                             problem))
        return false;
    d->layout.next_id = (uint32_t)d->row.next_curve;
    qm_status status = qm_layout_copy(&d->ctx, &d->layout, &d->before);
    return status == QM_OK || fail(d, status, problem);
}

/* ---- replies ---- */

static char *layout_text(const qm_layout *layout)
{
    qm_text text = {0};
    qm_text_add_string(&text, "{");
    qm_json_add_layout(&text, layout);
    qm_text_add_string(&text, "}");
    return qm_text_take(&text);
}

static char *issues_text(const qm_layout_issues *issues)
{
    qm_text text = {0};
    qm_json_add_layout_issues(&text, issues);
    return qm_text_take(&text);
}

/** The members of a stored object, without its braces. */
static void add_members(qm_text *out, const char *object)
{
    qm_json_add_comma(out);
    qm_text_add(out, object + 1, strlen(object) - 2);
}

static void write_layout(qm_text *out, const qm_store_layout *row, bool is_brief)
{
    qm_json_add_string(out, "id", row->id);
    qm_json_add_string(out, "mesh", row->mesh);
    qm_json_add_count(out, "revision", (uint64_t)row->revision);
    qm_json_add_bool(out, "can_undo", row->revision > row->first);
    qm_json_add_bool(out, "can_redo", row->revision < row->latest);
    qm_json_add_bool(out, "complete", strcmp(row->issues, "\"issues\":[]") == 0);
    qm_json_add_string(out, "created", row->created);
    if (is_brief) return;
    add_members(out, row->layout);
    qm_json_add_comma(out);
    qm_text_add_string(out, row->issues);
}

static void reply_row(qm_request *request, int status, const qm_store_layout *row, const char *changed)
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

static bool same_points(const qm_curve *a, const qm_curve *b)
{
    return a->point_count == b->point_count &&
           memcmp(a->points, b->points, 3 * sizeof(double) * a->point_count) == 0;
}

/** Adds the ids of the curves of one layout that the other lacks, or has with other points. */
static void add_ids(qm_text *out, const char *name, const qm_layout *of, const qm_layout *other, bool changed)
{
    qm_json_open(out, name, "[");
    for (size_t i = 0; i < of->curve_count; i++) {
        uint32_t place = qm_layout_find_curve(other, of->curves[i].id);
        bool is_meant = changed ? place != QM_NO_INDEX && !same_points(&of->curves[i], &other->curves[place])
                                : place == QM_NO_INDEX;
        if (!is_meant) continue;
        qm_json_add_comma(out);
        qm_text_printf(out, "%u", of->curves[i].id);
    }
    qm_text_add_string(out, "]");
}

static void add_changes(qm_text *out, const desk *d)
{
    qm_json_open(out, "changed", "{");
    add_ids(out, "added_curves", &d->layout, &d->before, false);
    add_ids(out, "changed_curves", &d->layout, &d->before, true);
    add_ids(out, "removed_curves", &d->before, &d->layout, false);
    qm_text_add_string(out, "}");
}

/** Stores the edited layout as the next revision and replies with it; more is what the edit has to say
 * itself. */
static void finish_edit(qm_request *request, desk *d, const char *more)
{
    qm_problem problem;
    qm_status status = qm_layout_find_patches(&d->ctx, &d->source, &d->layout, &d->issues);
    if (status != QM_OK) {
        fail(d, status, &problem);
        qm_reply_problem(request, &problem);
        return;
    }
    qm_text changed = {0};
    add_changes(&changed, d);
    if (more[0]) qm_json_add_comma(&changed);
    qm_text_add_string(&changed, more);
    char *layout = layout_text(&d->layout), *issues = issues_text(&d->issues),
         *words = qm_text_take(&changed);
    qm_store_layout next = d->row;
    next.layout = layout;
    next.issues = issues;
    next.next_curve = d->layout.next_id;
    status = layout && issues && words ? qm_store_edit_layout(d->app->store, &next) : QM_E_NO_MEMORY;
    if (status == QM_OK) {
        next.latest = ++next.revision;
        qm_reply_header(request, "Location", "/v1/layouts/%s", next.id);
        reply_row(request, 200, &next, words);
    } else {
        problem =
            status == QM_E_CANCELED
                ? qm_problem_make(QM_PROBLEM_CONFLICT, "the layout was edited by somebody else meanwhile")
                : qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the layout could not be stored");
        qm_reply_problem(request, &problem);
    }
    free(layout);
    free(issues);
    free(words);
}

/* ---- the resource ---- */

static bool store_new(desk *d, qm_problem *problem)
{
    char created[QM_TIME_SIZE];
    qm_format_time(created);
    qm_make_id('l', d->row.id);
    d->row.created = strdup(created);
    d->row.layout = layout_text(&d->layout);
    d->row.issues = issues_text(&d->issues);
    d->row.next_curve = d->layout.next_id;
    if (!d->row.created || !d->row.layout || !d->row.issues) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "there is no memory for the layout");
        return false;
    }
    if (qm_store_put_layout(d->app->store, &d->row) == QM_OK) return true;
    *problem = qm_problem_make(QM_PROBLEM_UNAVAILABLE, "the layout could not be stored");
    return false;
}

/** Patches that the request names stay as they are; else they are found. */
static bool set_patches(desk *d, bool has_patches, qm_problem *problem)
{
    qm_status status;
    if (has_patches) {
        status = qm_layout_validate(&d->ctx, &d->layout, d->source.diagonal);
        if (status == QM_OK) status = qm_layout_find_crossings(&d->ctx, &d->layout, &d->issues);
    } else {
        status = qm_layout_find_patches(&d->ctx, &d->source, &d->layout, &d->issues);
    }
    return status == QM_OK || fail(d, status, problem);
}

void qm_handle_layout_create(qm_request *request)
{
    desk d = {.app = qm_request_app(request)};
    d.ctx = qm_meshes_context(d.app->meshes);
    size_t size;
    const char *body = qm_request_body(request, &size);
    qm_problem problem;
    bool has_patches;
    if (qm_json_read_layout(&d.ctx, body, size, d.row.mesh, &d.layout, &has_patches, &problem) &&
        take_mesh(&d, &problem) && set_patches(&d, has_patches, &problem) && store_new(&d, &problem)) {
        qm_reply_header(request, "Location", "/v1/layouts/%s", d.row.id);
        reply_row(request, 201, &d.row, NULL);
    } else {
        qm_reply_problem(request, &problem);
    }
    close_desk(&d);
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
        write_layout(&out, &rows[i], true);
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
    if (!find_row(request, &row, &problem)) {
        qm_reply_problem(request, &problem);
        return;
    }
    reply_row(request, 200, &row, NULL);
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
    if (!find_row(request, &row, &problem)) {
        qm_reply_problem(request, &problem);
        return;
    }
    int64_t to = row.revision + step;
    qm_status status = to < row.first || to > row.latest
                           ? QM_E_ARGUMENT
                           : qm_store_move_layout(app->store, row.id, row.revision, to);
    qm_store_layout_reset(&row);
    if (status == QM_OK && find_row(request, &row, &problem)) {
        reply_row(request, 200, &row, NULL);
        qm_store_layout_reset(&row);
        return;
    }
    problem =
        status == QM_E_CANCELED
            ? qm_problem_make(QM_PROBLEM_CONFLICT, "the layout was edited by somebody else meanwhile")
            : qm_problem_make(QM_PROBLEM_CONFLICT, "there is nothing to %s", step < 0 ? "undo" : "redo");
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
typedef bool edit_fn(desk *d, const qm_layout_edit *edit, uint32_t curve, qm_text *more, qm_problem *problem);

/** The curve of the path; false with a 404 when the layout has none of this id. */
static bool find_curve(const qm_request *request, const desk *d, uint32_t *curve, qm_problem *problem)
{
    const char *text = qm_request_second_id(request);
    char *end;
    unsigned long number = strtoul(text, &end, 10);
    *curve = number < QM_NO_INDEX ? (uint32_t)number : QM_NO_INDEX;
    if (text[0] >= '0' && text[0] <= '9' && !*end && qm_layout_find_curve(&d->layout, *curve) != QM_NO_INDEX)
        return true;
    *problem = qm_problem_make(QM_PROBLEM_CURVE_NOT_FOUND, "the layout has no curve %s", text);
    return false;
}

static void make_edit(qm_request *request, const qm_layout_edit *edit, bool has_curve, edit_fn *apply)
{
    desk d;
    qm_problem problem;
    uint32_t curve = QM_NO_INDEX;
    qm_text more = {0};
    if (open_desk(request, &d, &problem) && (!has_curve || find_curve(request, &d, &curve, &problem)) &&
        apply(&d, edit, curve, &more, &problem)) {
        char *words = qm_text_take(&more);
        finish_edit(request, &d, words ? words : "");
        free(words);
    } else {
        qm_text_reset(&more);
        qm_reply_problem(request, &problem);
    }
    close_desk(&d);
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

/** What the engine refuses of an edit is the request's fault. */
static bool outcome(desk *d, qm_status status, qm_problem *problem)
{
    if (status == QM_OK) return true;
    if (status == QM_E_ARGUMENT)
        *problem = qm_problem_make(QM_PROBLEM_INVALID_LAYOUT, "%s", d->ctx.message);
    else
        fail(d, status, problem);
    return false;
}

static double snap_radius(const desk *d, const qm_layout_edit *edit)
{
    return edit->radius > 0.0 ? edit->radius : SNAP_SHARE * d->source.diagonal;
}

/** The places of a stroke on the surface. */
typedef struct picked {
    double *points; /* rows of x y z, on malloc */
    size_t count, missed;
} picked;

static bool pick_stroke(desk *d, const qm_layout_edit *edit, picked *out, qm_problem *problem)
{
    *out = (picked){0};
    qm_view view;
    qm_status status = qm_view_init(&d->ctx, &d->source, &edit->camera, &edit->pick, &view);
    if (status != QM_OK) return outcome(d, status, problem);
    out->points = malloc(edit->point_count * 3 * sizeof *out->points);
    if (!out->points) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "there is no memory for the stroke");
        return false;
    }
    status = qm_view_stroke(&d->ctx, &view, edit->points, edit->point_count, out->points, &out->count,
                            &out->missed);
    if (status == QM_OK && out->count < 2)
        status =
            qm_context_fail(&d->ctx, QM_E_ARGUMENT, "the stroke meets the surface at %zu of its %zu points",
                            edit->point_count - out->missed, edit->point_count);
    return outcome(d, status, problem);
}

static void add_stroke_facts(qm_text *out, uint32_t curve, const picked *stroke)
{
    qm_json_open(out, "stroke", "{");
    qm_json_add_count(out, "curve", curve);
    qm_json_add_count(out, "points", stroke->count);
    qm_json_add_count(out, "missed_points", stroke->missed);
    qm_text_add_string(out, "}");
}

static bool apply_stroke(desk *d, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                         qm_problem *problem)
{
    (void)curve;
    picked stroke;
    uint32_t id = QM_NO_INDEX;
    bool good = pick_stroke(d, edit, &stroke, problem) &&
                outcome(d,
                        qm_layout_add_stroke(&d->ctx, &d->layout, stroke.points, stroke.count,
                                             snap_radius(d, edit), &id),
                        problem);
    if (good) add_stroke_facts(more, id, &stroke);
    free(stroke.points);
    return good;
}

static bool apply_split(desk *d, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                        qm_problem *problem)
{
    (void)more;
    return outcome(d, qm_layout_split_curve(&d->ctx, &d->layout, curve, edit->point), problem);
}

static bool apply_snap(desk *d, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                       qm_problem *problem)
{
    (void)more;
    return outcome(
        d, qm_layout_snap_end(&d->ctx, &d->layout, curve, edit->end, edit->point, snap_radius(d, edit)),
        problem);
}

static bool redraw(desk *d, uint32_t curve, const double *points, size_t count, qm_problem *problem)
{
    return outcome(d, qm_layout_redraw_curve(&d->ctx, &d->layout, curve, points, count), problem);
}

static bool apply_redraw(desk *d, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                         qm_problem *problem)
{
    if (!edit->in_window) return redraw(d, curve, edit->points, edit->point_count, problem);
    picked stroke;
    bool good =
        pick_stroke(d, edit, &stroke, problem) && redraw(d, curve, stroke.points, stroke.count, problem);
    if (good) add_stroke_facts(more, curve, &stroke);
    free(stroke.points);
    return good;
}

static bool apply_merge(desk *d, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                        qm_problem *problem)
{
    (void)curve;
    (void)more;
    return outcome(d, qm_layout_merge_curves(&d->ctx, &d->layout, edit->first, edit->second), problem);
}

static bool apply_delete(desk *d, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                         qm_problem *problem)
{
    (void)edit;
    (void)more;
    return outcome(d, qm_layout_delete_curve(&d->ctx, &d->layout, curve), problem);
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
