/**
 * handle_layout_edits.c: strokes and the other edits of the curves of a layout.
 */
#include <stdlib.h>

#include "layout_session.h"
#include "ops/json_layout.h"
#include "ops/json_out.h"

#define SNAP_SHARE 0.01 /* of the diagonal: snap radius unless the request has one */

/** Makes one edit; more gets members for the reply. */
typedef bool edit_fn(qm_layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                     qm_problem *problem);

/** The curve of the path; false with a 404 when the layout has none of this id. */
static bool find_curve(const qm_request *request, const qm_layout_session *s, uint32_t *curve,
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
    qm_layout_session s;
    qm_problem problem;
    uint32_t curve = QM_NO_INDEX;
    qm_text more = {0};
    if (qm_layout_session_open(request, &s, &problem) &&
        (!has_curve || find_curve(request, &s, &curve, &problem)) &&
        apply(&s, edit, curve, &more, &problem)) {
        char *members = qm_text_take(&more);
        qm_layout_session_finish(request, &s, members ? members : "");
        free(members);
    } else {
        qm_text_reset(&more);
        qm_reply_problem(request, &problem);
    }
    qm_layout_session_close(&s);
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

/** An argument that the engine rejects is a fault of the request. */
static bool outcome(qm_layout_session *s, qm_status status, qm_problem *problem)
{
    if (status == QM_OK) return true;
    if (status == QM_E_ARGUMENT)
        *problem = qm_problem_make(QM_PROBLEM_INVALID_LAYOUT, "%s", s->ctx.message);
    else
        qm_layout_session_fail(s, status, problem);
    return false;
}

static double snap_radius(const qm_layout_session *s, const qm_layout_edit *edit)
{
    return edit->radius > 0.0 ? edit->radius : SNAP_SHARE * s->source.diagonal;
}

/** The places of a stroke on the surface. */
typedef struct picked_stroke {
    double *points; /* rows of x y z, on malloc */
    size_t count, missed;
} picked_stroke;

static bool pick_stroke(qm_layout_session *s, const qm_layout_edit *edit, picked_stroke *out,
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

static bool apply_stroke(qm_layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                         qm_problem *problem)
{
    (void)curve;
    picked_stroke stroke;
    uint32_t id = QM_NO_INDEX;
    bool good = pick_stroke(s, edit, &stroke, problem) &&
                outcome(s,
                        qm_layout_add_stroke(&s->ctx, &s->layout, stroke.points, stroke.count,
                                             snap_radius(s, edit), &id),
                        problem);
    if (good) add_stroke_facts(more, id, &stroke);
    free(stroke.points);
    return good;
}

static bool apply_split(qm_layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                        qm_problem *problem)
{
    (void)more;
    return outcome(s, qm_layout_split_curve(&s->ctx, &s->layout, curve, edit->point), problem);
}

static bool apply_snap(qm_layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                       qm_problem *problem)
{
    (void)more;
    return outcome(
        s, qm_layout_snap_end(&s->ctx, &s->layout, curve, edit->end, edit->point, snap_radius(s, edit)),
        problem);
}

static bool redraw(qm_layout_session *s, uint32_t curve, const double *points, size_t count,
                   qm_problem *problem)
{
    return outcome(s, qm_layout_redraw_curve(&s->ctx, &s->layout, curve, points, count), problem);
}

static bool apply_redraw(qm_layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
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

static bool apply_merge(qm_layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                        qm_problem *problem)
{
    (void)curve;
    (void)more;
    return outcome(s, qm_layout_merge_curves(&s->ctx, &s->layout, edit->first, edit->second), problem);
}

static bool apply_delete(qm_layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
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
