#include "layout_desk.h"

#include <stdlib.h>
#include <string.h>

#include "ops/json_layout.h"
#include "ops/json_out.h"

qm_desk qm_desk_make(qm_app *app)
{
    return (qm_desk){.app = app, .ctx = qm_meshes_context(app->meshes)};
}

void qm_desk_close(qm_desk *d)
{
    qm_layout_issues_reset(&d->ctx, &d->issues);
    qm_layout_reset(&d->ctx, &d->before);
    qm_layout_reset(&d->ctx, &d->layout);
    qm_meshes_release(d->app->meshes, d->mesh);
    qm_store_layout_reset(&d->row);
}

bool qm_desk_fail(const qm_desk *d, qm_status status, qm_problem *problem)
{
    *problem = qm_problem_from_status(status, d->ctx.message);
    return false;
}

bool qm_desk_take_mesh(qm_desk *d, qm_problem *problem)
{
    d->mesh = qm_meshes_acquire(d->app->meshes, d->row.mesh, problem);
    if (!d->mesh) return false;
    qm_status status = qm_source_init(&d->ctx, qm_mesh_ref_get(d->mesh)->bvh, &d->source);
    return status == QM_OK || qm_desk_fail(d, status, problem);
}

bool qm_find_layout(qm_request *request, qm_store_layout *out, qm_problem *problem)
{
    const char *id = qm_request_id(request);
    qm_status status = qm_store_find_layout(qm_request_app(request)->store, id, out);
    if (status != QM_OK)
        *problem = qm_problem_from_store(status, QM_PROBLEM_LAYOUT_NOT_FOUND, "layout %s", id);
    return status == QM_OK;
}

bool qm_desk_open(qm_request *request, qm_desk *d, qm_problem *problem)
{
    *d = qm_desk_make(qm_request_app(request));
    bool has_patches;
    if (!qm_find_layout(request, &d->row, problem) || !qm_desk_take_mesh(d, problem)) return false;
    if (!qm_json_read_layout(&d->ctx, d->row.layout, strlen(d->row.layout), NULL, &d->layout, &has_patches,
                             problem))
        return false;
    d->layout.next_id = (uint32_t)d->row.next_curve;
    qm_status status = qm_layout_copy(&d->ctx, &d->layout, &d->before);
    return status == QM_OK || qm_desk_fail(d, status, problem);
}

bool qm_desk_write(const qm_desk *d, char **layout, char **issues)
{
    qm_text text = {0}, open = {0};
    qm_text_add_string(&text, "{");
    qm_json_add_layout(&text, &d->layout);
    qm_text_add_string(&text, "}");
    qm_json_add_layout_issues(&open, &d->issues);
    *layout = qm_text_take(&text);
    *issues = qm_text_take(&open);
    return *layout && *issues;
}

/** The members of a stored object, without its braces. */
static void add_members(qm_text *out, const char *object)
{
    qm_json_add_comma(out);
    qm_text_add(out, object + 1, strlen(object) - 2);
}

void qm_write_layout(qm_text *out, const qm_store_layout *row, bool is_brief)
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

void qm_reply_layout(qm_request *request, int status, const qm_store_layout *row, const char *changed)
{
    qm_text out = {0};
    qm_text_add_string(&out, "{");
    qm_write_layout(&out, row, false);
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

static void add_changes(qm_text *out, const qm_desk *d)
{
    qm_json_open(out, "changed", "{");
    add_ids(out, "added_curves", &d->layout, &d->before, false);
    add_ids(out, "changed_curves", &d->layout, &d->before, true);
    add_ids(out, "removed_curves", &d->before, &d->layout, false);
    qm_text_add_string(out, "}");
}

void qm_desk_finish(qm_request *request, qm_desk *d, const char *more)
{
    qm_problem problem;
    qm_status status = qm_layout_find_patches(&d->ctx, &d->source, &d->layout, &d->issues);
    if (status != QM_OK) {
        qm_desk_fail(d, status, &problem);
        qm_reply_problem(request, &problem);
        return;
    }
    qm_text changed = {0};
    add_changes(&changed, d);
    if (more[0]) qm_json_add_comma(&changed);
    qm_text_add_string(&changed, more);
    char *layout, *issues, *words = qm_text_take(&changed);
    bool written = qm_desk_write(d, &layout, &issues) && words;
    qm_store_layout next = d->row;
    next.layout = layout;
    next.issues = issues;
    next.next_curve = d->layout.next_id;
    status = written ? qm_store_edit_layout(d->app->store, &next) : QM_E_NO_MEMORY;
    if (status == QM_OK) {
        next.latest = ++next.revision;
        qm_reply_header(request, "Location", "/v1/layouts/%s", next.id);
        qm_reply_layout(request, 200, &next, words);
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
