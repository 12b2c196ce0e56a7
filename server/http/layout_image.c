/**
 * layout_image.c: the mirror image of an edit of a layout.
 */
#include "layout_image.h"

#include <stdlib.h>
#include <string.h>

#include "qm/layout_edit.h"

bool qm_layout_image_read_plane(qm_request *request, qm_layout_edit *out)
{
    const char *mirror = qm_request_query(request, "mirror");
    out->has_mirror = mirror && qm_json_read_plane_text(mirror, out->mirror_point, out->mirror_normal);
    if (!mirror || out->has_mirror) return true;
    qm_problem problem = qm_problem_make(QM_PROBLEM_INVALID_PARAMETER,
                                         "`mirror` must be six numbers between commas: a point and a normal "
                                         "of a plane, which is not 0,0,0");
    qm_reply_problem(request, &problem);
    return false;
}

static uint32_t image_of_node(const qm_layout_session *s, const qm_layout_edit *edit, uint32_t node)
{
    if (node >= s->layout.node_count) return QM_NO_INDEX; /* the edit itself tells of it */
    return qm_layout_find_image_node(&s->layout, &s->source, edit->mirror_point, edit->mirror_normal, node,
                                     QM_IMAGE_SHARE * s->source.diagonal);
}

static uint32_t image_of_curve(const qm_layout_session *s, const qm_layout_edit *edit, uint32_t id)
{
    bool is_reversed;
    if (qm_layout_find_curve(&s->layout, id) == QM_NO_INDEX) return QM_NO_INDEX;
    return qm_layout_find_image_curve(&s->layout, &s->source, edit->mirror_point, edit->mirror_normal, id,
                                      QM_IMAGE_SHARE * s->source.diagonal, &is_reversed);
}

/** The images of a list; those that have none are left out. False: out of memory. */
static bool image_of_list(const qm_layout_session *s, const qm_layout_edit *edit, bool of_nodes,
                          const uint32_t *list, size_t count, uint32_t **out, size_t *out_count)
{
    *out = NULL;
    *out_count = 0;
    if (count == 0) return true;
    *out = malloc(count * sizeof **out);
    for (size_t i = 0; i < count && *out; i++) {
        uint32_t image = of_nodes ? image_of_node(s, edit, list[i]) : image_of_curve(s, edit, list[i]);
        if (image != QM_NO_INDEX) (*out)[(*out_count)++] = image;
    }
    return *out != NULL;
}

/** Takes the part of a motion across the plane away. */
static void flatten(const qm_layout_edit *edit, const double from[3], double to[3])
{
    const double *n = edit->mirror_normal;
    double length2 = 0.0, across = 0.0;
    for (int k = 0; k < 3; k++) {
        length2 += n[k] * n[k];
        across += n[k] * (to[k] - from[k]);
    }
    for (int k = 0; k < 3; k++)
        to[k] -= n[k] * across / length2;
}

static bool copy_points(const qm_layout_edit *edit, qm_layout_edit *out)
{
    out->points = NULL;
    if (edit->point_count == 0) return true;
    size_t size = 3 * edit->point_count * sizeof *out->points;
    out->points = malloc(size);
    if (out->points) memcpy(out->points, edit->points, size);
    return out->points != NULL;
}

bool qm_layout_image_find(const qm_layout_session *s, qm_layout_edit *edit, qm_layout_edit_kind kind,
                          qm_edit_subject of, uint32_t subject, qm_layout_image *out, qm_problem *problem)
{
    const double *point = edit->mirror_point, *normal = edit->mirror_normal;
    qm_layout_edit *image = &out->edit;
    *out = (qm_layout_image){.edit = *edit, .subject = QM_NO_INDEX};
    image->curves = image->nodes = NULL;
    bool has_memory =
        copy_points(edit, image) &&
        image_of_list(s, edit, false, edit->curves, edit->curve_count, &image->curves, &image->curve_count) &&
        image_of_list(s, edit, true, edit->nodes, edit->node_count, &image->nodes, &image->node_count);
    if (!has_memory) {
        *problem =
            qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the mirror image of the edit");
        return false;
    }
    if (of != QM_OF_LAYOUT) {
        out->subject = of == QM_OF_NODE ? image_of_node(s, edit, subject) : image_of_curve(s, edit, subject);
        out->is_found = out->subject != QM_NO_INDEX;
        out->is_own = out->subject == subject;
    } else if (kind == QM_EDIT_CURVES || kind == QM_EDIT_NODES) {
        bool of_nodes = kind == QM_EDIT_NODES;
        image->first = of_nodes ? image_of_node(s, edit, edit->first) : image_of_curve(s, edit, edit->first);
        image->second =
            of_nodes ? image_of_node(s, edit, edit->second) : image_of_curve(s, edit, edit->second);
        out->is_found = image->first != QM_NO_INDEX && image->second != QM_NO_INDEX;
        out->is_own = (image->first == edit->first && image->second == edit->second) ||
                      (image->first == edit->second && image->second == edit->first);
    } else {
        out->is_found = image->curve_count + image->node_count > 0;
    }
    if (out->is_own && kind == QM_EDIT_SLIDE) flatten(edit, edit->from, edit->point);
    if (out->is_own && kind == QM_EDIT_MOVE) flatten(edit, point, edit->point);
    if (!out->is_found || out->is_own) return true;
    qm_layout_reflect(&s->source, point, normal, image->from, 1);
    qm_layout_reflect(&s->source, point, normal, image->point, 1);
    if (image->point_count > 0)
        qm_layout_reflect(&s->source, point, normal, image->points, image->point_count);
    return true;
}

/** True if a curve is as it was when the session was opened. */
static bool is_unchanged(const qm_layout_session *s, uint32_t id)
{
    uint32_t was = qm_layout_find_curve(&s->before, id), is = qm_layout_find_curve(&s->layout, id);
    if (was == QM_NO_INDEX || is == QM_NO_INDEX) return false;
    const qm_curve *a = &s->before.curves[was], *b = &s->layout.curves[is];
    return a->point_count == b->point_count &&
           memcmp(a->points, b->points, 3 * sizeof *a->points * a->point_count) == 0;
}

/** The present number of a node; false if it is not where it was. */
static bool find_again(const qm_layout_session *s, uint32_t *node)
{
    const double *was = s->before.nodes + 3 * (size_t)*node;
    for (uint32_t i = 0; i < s->layout.node_count; i++) {
        if (memcmp(was, s->layout.nodes + 3 * (size_t)i, 3 * sizeof *was) != 0) continue;
        *node = i;
        return true;
    }
    return false;
}

bool qm_layout_image_is_left(const qm_layout_session *s, qm_layout_edit_kind kind, qm_edit_subject of,
                             qm_layout_image *image)
{
    if (!image->is_found || image->is_own) return false;
    if (of == QM_OF_NODE) return find_again(s, &image->subject);
    if (of == QM_OF_CURVE) return is_unchanged(s, image->subject);
    if (kind == QM_EDIT_NODES) return find_again(s, &image->edit.first) && find_again(s, &image->edit.second);
    if (kind == QM_EDIT_CURVES)
        return is_unchanged(s, image->edit.first) && is_unchanged(s, image->edit.second);
    return true;
}
