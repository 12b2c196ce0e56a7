/**
 * handle_layout_edits.c: the edits of layouts: strokes, tools, and those of single curves and nodes.
 */
#include <stdlib.h>
#include <string.h>

#include "handlers.h"
#include "layout_image.h"
#include "layout_session.h"
#include "ops/json_layout.h"
#include "ops/json_out.h"
#include "qm/layout_edit.h"

#define SNAP_SHARE 0.01 /* of the diagonal: snap radius unless the request has one */

/** Makes one edit of a curve or node; more gets members for the reply. */
typedef bool edit_fn(qm_layout_session *s, const qm_layout_edit *edit, uint32_t subject, qm_text *more,
                     qm_problem *problem);

/** The curve or node of the path; false with a 404 when the layout has none of this number. */
static bool find_subject(const qm_request *request, const qm_layout_session *s, qm_edit_subject kind,
                         uint32_t *subject, qm_problem *problem)
{
    if (kind == QM_OF_LAYOUT) return true;
    const char *text = qm_request_second_id(request);
    char *end;
    unsigned long number = strtoul(text, &end, 10);
    *subject = number < QM_NO_INDEX ? (uint32_t)number : QM_NO_INDEX;
    bool is_number = text[0] >= '0' && text[0] <= '9' && !*end;
    if (is_number && (kind == QM_OF_NODE ? *subject < s->layout.node_count
                                         : qm_layout_find_curve(&s->layout, *subject) != QM_NO_INDEX))
        return true;
    *problem = kind == QM_OF_NODE
                   ? qm_problem_make(QM_PROBLEM_NODE_NOT_FOUND, "the layout has no node %s", text)
                   : qm_problem_make(QM_PROBLEM_CURVE_NOT_FOUND, "the layout has no curve %s", text);
    return false;
}

static bool resolve_places(qm_layout_session *s, qm_layout_edit *edit, qm_layout_edit_kind kind,
                           uint32_t subject, qm_text *more, qm_problem *problem);

/** An edit on its way: of what, and how it is made. */
typedef struct edit_call {
    qm_layout_edit_kind kind;
    qm_edit_subject of;
    edit_fn *apply;
} edit_call;

/** Makes an edit on both sides of its plane. */
static bool apply_mirrored(qm_layout_session *s, qm_layout_edit *edit, const edit_call *call,
                           uint32_t subject, qm_text *more, qm_problem *problem)
{
    qm_layout_image image;
    bool good = qm_layout_image_find(s, edit, call->kind, call->of, subject, &image, problem) &&
                call->apply(s, edit, subject, more, problem);
    if (good && qm_layout_image_is_left(s, call->kind, call->of, &image))
        good = call->apply(s, &image.edit, image.subject, more, problem);
    if (good) qm_json_add_bool(more, "mirrored", image.is_found);
    qm_layout_edit_reset(&image.edit);
    return good;
}

/** Makes an edit, and finds the patches after it. */
static bool apply_edit(qm_layout_session *s, qm_layout_edit *edit, const edit_call *call, uint32_t subject,
                       qm_text *more, qm_problem *problem)
{
    /* These mirror what is drawn, and look for no image. */
    bool draws = call->kind == QM_EDIT_STROKE || call->kind == QM_EDIT_RING;
    return resolve_places(s, edit, call->kind, subject, more, problem) &&
           (edit->has_mirror && !draws ? apply_mirrored(s, edit, call, subject, more, problem)
                                       : call->apply(s, edit, subject, more, problem)) &&
           qm_layout_session_find_patches(s, problem);
}

/** Makes an edit, unless the client leaves or its deadline comes before: nothing has changed then. */
static void make_edit(qm_request *request, qm_layout_edit *edit, const edit_call *call)
{
    qm_layout_session s;
    qm_problem problem;
    uint32_t subject = QM_NO_INDEX;
    double deadline_ms;
    qm_text more = {0};
    if (!qm_handlers_read_deadline(request, &deadline_ms)) return;
    bool good = qm_layout_session_open(request, &s, &problem) &&
                find_subject(request, &s, call->of, &subject, &problem);
    if (good) {
        qm_http_watch watch;
        qm_http_watch_begin(&watch, request, deadline_ms, &s.ctx);
        good = apply_edit(&s, edit, call, subject, &more, &problem);
        good = qm_http_watch_end(&watch, &s.ctx, &problem) && good;
    }
    if (good) {
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
static void edit_by_body(qm_request *request, qm_layout_edit_kind kind, qm_edit_subject of, edit_fn *apply)
{
    size_t size;
    const char *body = qm_request_body(request, &size);
    qm_layout_edit edit;
    qm_problem problem;
    if (!qm_json_read_layout_edit(body, size, kind, &edit, &problem)) {
        qm_reply_problem(request, &problem);
        return;
    }
    make_edit(request, &edit, &(edit_call){kind, of, apply});
    qm_layout_edit_reset(&edit);
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

static bool pick_stroke(qm_layout_session *s, const qm_layout_edit *edit, size_t least, picked_stroke *out,
                        qm_problem *problem)
{
    *out = (picked_stroke){0};
    qm_pick_view view;
    qm_status status = qm_pick_view_init(&s->ctx, &s->source, &edit->camera, &edit->pick, &view);
    if (status != QM_OK) return qm_layout_session_outcome(s, status, problem);
    out->points = malloc(edit->point_count * 3 * sizeof *out->points);
    if (!out->points) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the stroke");
        return false;
    }
    status = qm_pick_stroke(&s->ctx, &view, edit->points, edit->point_count, out->points, &out->count,
                            &out->missed);
    if (status == QM_OK && out->count < least)
        status =
            qm_context_fail(&s->ctx, QM_E_ARGUMENT, "the stroke meets the surface at %zu of its %zu points",
                            edit->point_count - out->missed, edit->point_count);
    return qm_layout_session_outcome(s, status, problem);
}

static void add_stroke_facts(qm_text *out, uint32_t curve, const picked_stroke *stroke)
{
    qm_json_open(out, "stroke", "{");
    qm_json_add_count(out, "curve", curve);
    qm_json_add_count(out, "points", stroke->count);
    qm_json_add_count(out, "missed_points", stroke->missed);
    qm_text_add_string(out, "}");
}

/** Replaces the places in the window of an edit other than a stroke or ring by those of the surface. */
static bool resolve_places(qm_layout_session *s, qm_layout_edit *edit, qm_layout_edit_kind kind,
                           uint32_t subject, qm_text *more, qm_problem *problem)
{
    if (!edit->in_window || kind == QM_EDIT_STROKE || kind == QM_EDIT_RING) return true;
    picked_stroke stroke;
    if (!pick_stroke(s, edit, kind == QM_EDIT_REDRAW ? 2 : 1, &stroke, problem)) {
        free(stroke.points);
        return false;
    }
    memcpy(edit->from, stroke.points, sizeof edit->from);
    memcpy(edit->point, stroke.points + 3 * (stroke.count - 1), sizeof edit->point);
    if (kind == QM_EDIT_REDRAW) add_stroke_facts(more, subject, &stroke);
    free(edit->points);
    edit->points = stroke.points;
    edit->point_count = stroke.count;
    edit->in_window = false;
    return true;
}

static bool add_stroke(qm_layout_session *s, const qm_layout_edit *edit, const picked_stroke *stroke,
                       uint32_t *id, qm_problem *problem)
{
    double reach = edit->features.radius > 0.0 ? edit->features.radius : SNAP_SHARE * s->source.diagonal;
    qm_status status =
        edit->has_features
            ? qm_layout_add_snapped_stroke(&s->ctx, &s->layout, &s->source, stroke->points, stroke->count,
                                           snap_radius(s, edit), edit->features.angle, reach, id)
            : qm_layout_add_stroke(&s->ctx, &s->layout, &s->source, stroke->points, stroke->count,
                                   snap_radius(s, edit), id);
    return qm_layout_session_outcome(s, status, problem);
}

static bool apply_stroke(qm_layout_session *s, const qm_layout_edit *edit, uint32_t subject, qm_text *more,
                         qm_problem *problem)
{
    (void)subject;
    picked_stroke stroke;
    uint32_t id = QM_NO_INDEX, image;
    bool good = pick_stroke(s, edit, 2, &stroke, problem) && add_stroke(s, edit, &stroke, &id, problem);
    if (good) add_stroke_facts(more, id, &stroke);
    if (good && edit->has_mirror) {
        qm_layout_reflect(&s->source, edit->mirror_point, edit->mirror_normal, stroke.points, stroke.count);
        good = add_stroke(s, edit, &stroke, &image, problem);
    }
    free(stroke.points);
    return good;
}

static bool add_ring(qm_layout_session *s, const qm_layout_edit *edit, const double through[3],
                     const double *plane, uint32_t *id, qm_problem *problem)
{
    return qm_layout_session_outcome(
        s, qm_layout_add_ring(&s->ctx, &s->layout, &s->source, through, plane, snap_radius(s, edit), id),
        problem);
}

/** Adds a ring through the middle of a stroke: in the plane of its ends and the direction of view, or without a length the
 * shortest. */
static bool apply_ring(qm_layout_session *s, const qm_layout_edit *edit, uint32_t subject, qm_text *more,
                       qm_problem *problem)
{
    (void)subject;
    picked_stroke stroke;
    if (!pick_stroke(s, edit, 1, &stroke, problem)) {
        free(stroke.points);
        return false;
    }
    double *through = stroke.points + 3 * (stroke.count / 2), plane[3];
    bool has_plane = stroke.count > 1 && qm_pick_plane(&edit->camera, stroke.points,
                                                       stroke.points + 3 * (stroke.count - 1), plane);
    uint32_t id = QM_NO_INDEX, image;
    bool good = add_ring(s, edit, through, has_plane ? plane : NULL, &id, problem);
    if (good) add_stroke_facts(more, id, &stroke);
    if (good && edit->has_mirror) {
        double middle[3];
        if (has_plane) qm_layout_reflect_direction(edit->mirror_normal, plane);
        memcpy(middle, through, sizeof middle);
        qm_layout_reflect(&s->source, edit->mirror_point, edit->mirror_normal, middle, 1);
        good = add_ring(s, edit, middle, has_plane ? plane : NULL, &image, problem);
    }
    free(stroke.points);
    return good;
}

static bool apply_tube(qm_layout_session *s, const qm_layout_edit *edit, uint32_t subject, qm_text *more,
                       qm_problem *problem)
{
    (void)subject;
    (void)more;
    return qm_layout_session_outcome(
        s, qm_layout_add_tube(&s->ctx, &s->layout, &s->source, edit->first, edit->second), problem);
}

static bool apply_fill(qm_layout_session *s, const qm_layout_edit *edit, uint32_t subject, qm_text *more,
                       qm_problem *problem)
{
    (void)subject;
    size_t filled;
    bool good = qm_layout_session_outcome(
        s, qm_layout_fill(&s->ctx, &s->layout, &s->source, edit->has_point ? edit->point : NULL, &filled),
        problem);
    if (good) qm_json_add_count(more, "filled_cells", filled);
    return good;
}

static bool apply_mirror(qm_layout_session *s, const qm_layout_edit *edit, uint32_t subject, qm_text *more,
                         qm_problem *problem)
{
    (void)subject;
    (void)more;
    return qm_layout_session_outcome(
        s, qm_layout_mirror(&s->ctx, &s->layout, &s->source, edit->point, edit->normal, snap_radius(s, edit)),
        problem);
}

static bool apply_features(qm_layout_session *s, const qm_layout_edit *edit, uint32_t subject, qm_text *more,
                           qm_problem *problem)
{
    (void)subject;
    size_t added;
    bool good = qm_layout_session_outcome(
        s, qm_layout_add_features(&s->ctx, &s->layout, &s->source, &edit->features, &added), problem);
    if (good) qm_json_add_count(more, "added_features", added);
    return good;
}

static bool apply_curve(qm_layout_session *s, const qm_layout_edit *edit, uint32_t subject, qm_text *more,
                        qm_problem *problem)
{
    (void)subject;
    (void)more;
    uint32_t id;
    return qm_layout_session_outcome(s,
                                     qm_layout_add_marked_stroke(&s->ctx, &s->layout, &s->source,
                                                                 edit->points, edit->point_count,
                                                                 snap_radius(s, edit), edit->mark, &id),
                                     problem);
}

static bool apply_marks(qm_layout_session *s, const qm_layout_edit *edit, uint32_t subject, qm_text *more,
                        qm_problem *problem)
{
    (void)subject;
    (void)more;
    qm_status status =
        qm_layout_mark_curves(&s->ctx, &s->layout, edit->curves, edit->curve_count, edit->mark);
    if (status == QM_OK)
        status = qm_layout_mark_nodes(&s->ctx, &s->layout, edit->nodes, edit->node_count, edit->is_corner);
    return qm_layout_session_outcome(s, status, problem);
}

static bool apply_merge_nodes(qm_layout_session *s, const qm_layout_edit *edit, uint32_t subject,
                              qm_text *more, qm_problem *problem)
{
    (void)subject;
    (void)more;
    return qm_layout_session_outcome(
        s, qm_layout_merge_nodes(&s->ctx, &s->layout, &s->source, edit->first, edit->second), problem);
}

static bool apply_link(qm_layout_session *s, const qm_layout_edit *edit, uint32_t subject, qm_text *more,
                       qm_problem *problem)
{
    (void)subject;
    (void)more;
    return qm_layout_session_outcome(
        s, qm_layout_add_link(&s->ctx, &s->layout, &s->source, edit->first, edit->second), problem);
}

static bool apply_move(qm_layout_session *s, const qm_layout_edit *edit, uint32_t node, qm_text *more,
                       qm_problem *problem)
{
    (void)more;
    return qm_layout_session_outcome(
        s, qm_layout_move_node(&s->ctx, &s->layout, &s->source, node, edit->point), problem);
}

static bool apply_slide(qm_layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                        qm_problem *problem)
{
    (void)more;
    return qm_layout_session_outcome(
        s, qm_layout_slide_curve(&s->ctx, &s->layout, &s->source, curve, edit->from, edit->point), problem);
}

static bool apply_split_chord(qm_layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                              qm_problem *problem)
{
    (void)more;
    return qm_layout_session_outcome(
        s, qm_layout_split_chord(&s->ctx, &s->layout, &s->source, curve, edit->parts), problem);
}

static bool apply_split(qm_layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                        qm_problem *problem)
{
    (void)more;
    return qm_layout_session_outcome(s, qm_layout_split_curve(&s->ctx, &s->layout, curve, edit->point),
                                     problem);
}

static bool apply_snap(qm_layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                       qm_problem *problem)
{
    (void)more;
    return qm_layout_session_outcome(
        s, qm_layout_snap_end(&s->ctx, &s->layout, curve, edit->end, edit->point, snap_radius(s, edit)),
        problem);
}

static bool apply_redraw(qm_layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                         qm_problem *problem)
{
    (void)more;
    return qm_layout_session_outcome(
        s, qm_layout_redraw_curve(&s->ctx, &s->layout, curve, edit->points, edit->point_count), problem);
}

static bool apply_merge(qm_layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                        qm_problem *problem)
{
    (void)curve;
    (void)more;
    return qm_layout_session_outcome(
        s, qm_layout_merge_curves(&s->ctx, &s->layout, edit->first, edit->second), problem);
}

static bool apply_delete(qm_layout_session *s, const qm_layout_edit *edit, uint32_t curve, qm_text *more,
                         qm_problem *problem)
{
    (void)edit;
    (void)more;
    return qm_layout_session_outcome(s, qm_layout_delete_curve(&s->ctx, &s->layout, curve), problem);
}

void qm_handle_layout_stroke(qm_request *request)
{
    edit_by_body(request, QM_EDIT_STROKE, QM_OF_LAYOUT, apply_stroke);
}

void qm_handle_curve_merge(qm_request *request)
{
    edit_by_body(request, QM_EDIT_CURVES, QM_OF_LAYOUT, apply_merge);
}

void qm_handle_curve_split(qm_request *request)
{
    edit_by_body(request, QM_EDIT_SPLIT, QM_OF_CURVE, apply_split);
}

void qm_handle_curve_snap(qm_request *request)
{
    edit_by_body(request, QM_EDIT_SNAP, QM_OF_CURVE, apply_snap);
}

void qm_handle_curve_redraw(qm_request *request)
{
    edit_by_body(request, QM_EDIT_REDRAW, QM_OF_CURVE, apply_redraw);
}

void qm_handle_curve_delete(qm_request *request)
{
    qm_layout_edit edit = {0};
    if (!qm_layout_image_read_plane(request, &edit)) return;
    make_edit(request, &edit, &(edit_call){QM_EDIT_DELETE, QM_OF_CURVE, apply_delete});
}

void qm_handle_layout_ring(qm_request *request)
{
    edit_by_body(request, QM_EDIT_RING, QM_OF_LAYOUT, apply_ring);
}

void qm_handle_layout_tube(qm_request *request)
{
    edit_by_body(request, QM_EDIT_CURVES, QM_OF_LAYOUT, apply_tube);
}

void qm_handle_layout_fill(qm_request *request)
{
    edit_by_body(request, QM_EDIT_FILL, QM_OF_LAYOUT, apply_fill);
}

void qm_handle_layout_mirror(qm_request *request)
{
    edit_by_body(request, QM_EDIT_MIRROR, QM_OF_LAYOUT, apply_mirror);
}

void qm_handle_layout_features(qm_request *request)
{
    edit_by_body(request, QM_EDIT_FEATURES, QM_OF_LAYOUT, apply_features);
}

void qm_handle_layout_mark(qm_request *request)
{
    edit_by_body(request, QM_EDIT_MARKS, QM_OF_LAYOUT, apply_marks);
}

void qm_handle_curve_add(qm_request *request)
{
    edit_by_body(request, QM_EDIT_CURVE, QM_OF_LAYOUT, apply_curve);
}

void qm_handle_node_merge(qm_request *request)
{
    edit_by_body(request, QM_EDIT_NODES, QM_OF_LAYOUT, apply_merge_nodes);
}

void qm_handle_node_move(qm_request *request)
{
    edit_by_body(request, QM_EDIT_MOVE, QM_OF_NODE, apply_move);
}

void qm_handle_curve_slide(qm_request *request)
{
    edit_by_body(request, QM_EDIT_SLIDE, QM_OF_CURVE, apply_slide);
}

void qm_handle_chord_split(qm_request *request)
{
    edit_by_body(request, QM_EDIT_SPLIT_CHORD, QM_OF_CURVE, apply_split_chord);
}

void qm_handle_layout_link(qm_request *request)
{
    edit_by_body(request, QM_EDIT_NODES, QM_OF_LAYOUT, apply_link);
}
