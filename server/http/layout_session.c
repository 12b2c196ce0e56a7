/**
 * layout_session.c: one edit of a layout, from its row in the store to the reply.
 */
#include "layout_session.h"

#include <stdlib.h>
#include <string.h>

#include "handlers.h"
#include "ops/json_layout.h"
#include "ops/json_out.h"
#include "store/store_problem.h"

/** An empty session, for a new layout. */
qm_layout_session qm_layout_session_make(qm_app *app)
{
    return (qm_layout_session){.app = app, .ctx = qm_meshes_context(app->meshes)};
}

void qm_layout_session_close(qm_layout_session *s)
{
    qm_layout_issues_reset(&s->ctx, &s->issues);
    qm_layout_reset(&s->ctx, &s->before);
    qm_layout_reset(&s->ctx, &s->layout);
    qm_meshes_release(s->app->meshes, s->mesh);
    qm_store_layout_reset(&s->row);
}

/** Makes the problem of a status of the engine; returns false. */
bool qm_layout_session_fail(const qm_layout_session *s, qm_status status, qm_problem *problem)
{
    *problem = qm_problem_from_status(status, s->ctx.message);
    return false;
}

/** An argument that the engine rejects is a fault of the request. */
bool qm_layout_session_outcome(qm_layout_session *s, qm_status status, qm_problem *problem)
{
    if (status == QM_OK) return true;
    if (status == QM_E_ARGUMENT)
        *problem = qm_problem_make(QM_PROBLEM_INVALID_LAYOUT, "%s", s->ctx.message);
    else
        qm_layout_session_fail(s, status, problem);
    return false;
}

/** Acquires the mesh that the row names, and its surface. False with a problem. */
bool qm_layout_session_take_mesh(qm_layout_session *s, qm_problem *problem)
{
    s->mesh = qm_meshes_acquire(s->app->meshes, s->row.mesh, problem);
    if (!s->mesh) return false;
    qm_status status = qm_ref_surface_init(&s->ctx, qm_mesh_ref_get(s->mesh)->bvh, &s->source);
    return status == QM_OK || qm_layout_session_fail(s, status, problem);
}

/** The row of the layout that the path names. False with a problem. */
bool qm_layout_session_find(qm_request *request, qm_store_layout *out, qm_problem *problem)
{
    const char *id = qm_request_id(request);
    qm_stored stored = qm_store_find_layout(qm_request_app(request)->store, id, out);
    if (stored != QM_STORED)
        *problem = qm_store_read_problem(stored, QM_PROBLEM_LAYOUT_NOT_FOUND, "layout %s", id);
    return stored == QM_STORED;
}

/** Opens a session on the layout that the path names. False with a problem. */
bool qm_layout_session_open(qm_request *request, qm_layout_session *s, qm_problem *problem)
{
    *s = qm_layout_session_make(qm_request_app(request));
    bool has_patches;
    if (!qm_layout_session_find(request, &s->row, problem) || !qm_layout_session_take_mesh(s, problem))
        return false;
    if (!qm_json_read_layout(&s->ctx, s->row.layout, strlen(s->row.layout), NULL, NULL, &s->layout,
                             &has_patches, problem))
        return false;
    s->layout.next_id = (uint32_t)s->row.next_curve;
    qm_status status = qm_layout_copy(&s->ctx, &s->layout, &s->before);
    return status == QM_OK || qm_layout_session_fail(s, status, problem);
}

/** The layout and its issues as JSON, for the caller to free also after a failure. False: out of memory. */
bool qm_layout_session_write(const qm_layout_session *s, char **layout, char **issues)
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
void qm_layout_session_describe(qm_text *out, const qm_store_layout *row, bool is_brief)
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
void qm_layout_session_reply(qm_request *request, int status, const qm_store_layout *row, const char *changed)
{
    qm_text out = {0};
    qm_text_add_string(&out, "{");
    qm_layout_session_describe(&out, row, false);
    if (changed) {
        qm_json_add_comma(&out);
        qm_text_add_string(&out, changed);
    }
    qm_text_add_string(&out, "}");
    qm_reply_header(request, "ETag", "\"%s-%lld\"", row->id, (long long)row->revision);
    qm_reply_text(request, status, "application/json", qm_text_take(&out));
}

/** Adds the ids of the curves of one layout that the other lacks, or has with other points or another mark. */
static void add_ids(qm_text *out, const char *name, const qm_layout *of, const qm_layout *other, bool changed)
{
    qm_json_open(out, name, "[");
    for (size_t i = 0; i < of->curve_count; i++) {
        uint32_t index = qm_layout_find_curve(other, of->curves[i].id);
        const qm_curve *a = &of->curves[i], *b = index == QM_NO_INDEX ? NULL : &other->curves[index];
        bool is_changed = b && (a->mark != b->mark || a->point_count != b->point_count ||
                                memcmp(a->points, b->points, 3 * sizeof(double) * a->point_count) != 0);
        if (changed ? !is_changed : b != NULL) continue;
        qm_json_add_comma(out);
        qm_text_printf(out, "%u", of->curves[i].id);
    }
    qm_text_add_string(out, "]");
}

bool qm_layout_session_find_patches(qm_layout_session *s, qm_problem *problem)
{
    qm_status status = qm_layout_find_patches(&s->ctx, &s->source, &s->layout, &s->issues);
    return status == QM_OK || qm_layout_session_fail(s, status, problem);
}

/** Stores the edited layout as the next revision and replies with it; more has members that the edit adds. */
void qm_layout_session_finish(qm_request *request, qm_layout_session *s, const char *more)
{
    qm_problem problem;
    qm_text changed = {0};
    qm_json_open(&changed, "changed", "{");
    add_ids(&changed, "added_curves", &s->layout, &s->before, false);
    add_ids(&changed, "changed_curves", &s->layout, &s->before, true);
    add_ids(&changed, "removed_curves", &s->before, &s->layout, false);
    qm_text_add_string(&changed, "}");
    if (more[0]) qm_json_add_comma(&changed);
    qm_text_add_string(&changed, more);
    char *layout, *issues, *members = qm_text_take(&changed);
    bool written = qm_layout_session_write(s, &layout, &issues) && members;
    qm_store_layout next = s->row;
    next.layout = layout;
    next.issues = issues;
    next.is_complete = s->issues.count == 0;
    next.next_curve = s->layout.next_id;
    qm_stored stored = written ? qm_store_edit_layout(s->app->store, &next) : QM_STORED_NO_MEMORY;
    if (stored == QM_STORED) {
        next.latest = ++next.revision;
        qm_reply_header(request, "Location", "/v1/layouts/%s", next.id);
        qm_layout_session_reply(request, 200, &next, members);
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
