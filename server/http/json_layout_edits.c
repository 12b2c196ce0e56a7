/**
 * json_layout_edits.c: the bodies of edits of layouts and of reconstructions.
 */
#include <cjson/cJSON.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ops/json_layout.h"
#include "ops/json_request.h"
#include "qm/layout_edit.h"

#define MAX_MARKED 100000

void qm_layout_edit_reset(qm_layout_edit *edit)
{
    free(edit->points);
    free(edit->curves);
    free(edit->nodes);
    *edit = (qm_layout_edit){0};
}

/** A number of 0 or more that may be absent. */
static bool read_amount(const cJSON *object, const char *name, double *out, qm_problem *problem)
{
    const cJSON *value = cJSON_GetObjectItemCaseSensitive(object, name);
    if (!value) return true;
    if (qm_json_read_number(value, out) && *out >= 0.0) return true;
    char pointer[32];
    snprintf(pointer, sizeof pointer, "/%s", name);
    return qm_json_reject(problem, "must be a number of 0 or more", pointer, 0, 0);
}

static bool read_array(const cJSON *object, const char *name, int count, double *out, qm_problem *problem)
{
    if (qm_json_read_numbers(cJSON_GetObjectItemCaseSensitive(object, name), count, out)) return true;
    char pointer[32], message[48];
    snprintf(pointer, sizeof pointer, "/%s", name);
    snprintf(message, sizeof message, "must be an array of %d finite numbers", count);
    return qm_json_reject(problem, message, pointer, 0, 0);
}

/** Reads the plane of a mirror. */
static bool read_plane(const cJSON *object, double point[3], double normal[3], qm_problem *problem)
{
    if (!read_array(object, "point", 3, point, problem) || !read_array(object, "normal", 3, normal, problem))
        return false;
    if (normal[0] != 0.0 || normal[1] != 0.0 || normal[2] != 0.0) return true;
    return qm_json_reject(problem, "must not be 0 0 0", "/normal", 0, 0);
}

/** Reads the member "mirror" of an edit, which may be absent. */
static bool read_mirror_of_edit(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    static const char *const names[] = {"point", "normal", NULL};
    const cJSON *value = cJSON_GetObjectItemCaseSensitive(object, "mirror");
    if (!value) return true;
    out->has_mirror = true;
    if (!cJSON_IsObject(value))
        return qm_json_reject(problem, "must be an object with point and normal", "/mirror", 0, 0);
    return qm_json_check_members(value, names, problem) &&
           read_plane(value, out->mirror_point, out->mirror_normal, problem);
}

/** Reads the member "features" of a stroke, which may be absent. */
static bool read_features_of_stroke(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    static const char *const names[] = {"angle_deg", "reach", NULL};
    const cJSON *value = cJSON_GetObjectItemCaseSensitive(object, "features");
    if (!value) return true;
    out->has_features = true;
    out->features = qm_layout_features_options_default();
    if (!cJSON_IsObject(value))
        return qm_json_reject(problem, "must be an object with angle_deg and reach", "/features", 0, 0);
    if (!qm_json_check_members(value, names, problem)) return false;
    const cJSON *angle = cJSON_GetObjectItemCaseSensitive(value, "angle_deg"),
                *reach = cJSON_GetObjectItemCaseSensitive(value, "reach");
    if (angle && !(qm_json_read_number(angle, &out->features.angle) && out->features.angle > 0.0 &&
                   out->features.angle <= 180.0))
        return qm_json_reject(problem, "must be a number above 0, and 180 at most", "/features/angle_deg", 0,
                              0);
    if (reach && !(qm_json_read_number(reach, &out->features.radius) && out->features.radius > 0.0))
        return qm_json_reject(problem, "must be a number above 0", "/features/reach", 0, 0);
    return true;
}

static bool read_window(const cJSON *object, size_t min_points, qm_layout_edit *out, qm_problem *problem)
{
    static const char *const names[] = {"points", "view", "projection", "viewport", "radius_px",
                                        "depth",  "snap", "mirror",     "features", NULL};
    out->in_window = true;
    return qm_json_check_members(object, names, problem) &&
           read_array(object, "view", 16, out->camera.view, problem) &&
           read_array(object, "projection", 16, out->camera.projection, problem) &&
           read_array(object, "viewport", 4, out->camera.viewport, problem) &&
           read_amount(object, "radius_px", &out->pick.radius_px, problem) &&
           read_amount(object, "depth", &out->pick.depth, problem) &&
           read_amount(object, "snap", &out->radius, problem) && read_mirror_of_edit(object, out, problem) &&
           read_features_of_stroke(object, out, problem) &&
           qm_json_read_table(cJSON_GetObjectItemCaseSensitive(object, "points"), 2, min_points, "points",
                              &out->points, &out->point_count, problem);
}

static bool read_stroke(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    return read_window(object, 2, out, problem);
}

static bool read_ring(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    if (cJSON_GetObjectItemCaseSensitive(object, "features"))
        return qm_json_reject(problem, "is not a field of this request", "/features", 0, 0);
    return read_window(object, 1, out, problem);
}

static bool read_fill(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    static const char *const names[] = {"point", NULL};
    out->has_point = cJSON_HasObjectItem(object, "point");
    return qm_json_check_members(object, names, problem) &&
           (!out->has_point || read_array(object, "point", 3, out->point, problem));
}

static bool read_mirror(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    static const char *const names[] = {"point", "normal", "radius", NULL};
    return qm_json_check_members(object, names, problem) &&
           read_plane(object, out->point, out->normal, problem) &&
           read_amount(object, "radius", &out->radius, problem);
}

static bool read_move(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    static const char *const names[] = {"point", "mirror", NULL};
    if (cJSON_GetObjectItemCaseSensitive(object, "view")) return read_window(object, 1, out, problem);
    return qm_json_check_members(object, names, problem) && read_mirror_of_edit(object, out, problem) &&
           read_array(object, "point", 3, out->point, problem);
}

static bool read_slide(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    static const char *const names[] = {"from", "to", "mirror", NULL};
    if (cJSON_GetObjectItemCaseSensitive(object, "view")) return read_window(object, 2, out, problem);
    return qm_json_check_members(object, names, problem) && read_mirror_of_edit(object, out, problem) &&
           read_array(object, "from", 3, out->from, problem) &&
           read_array(object, "to", 3, out->point, problem);
}

static bool read_split_chord(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    static const char *const names[] = {"parts", "mirror", NULL};
    const cJSON *parts = cJSON_GetObjectItemCaseSensitive(object, "parts");
    out->parts = 2;
    if (!qm_json_check_members(object, names, problem) || !read_mirror_of_edit(object, out, problem))
        return false;
    if (!parts ||
        (qm_json_read_index(parts, &out->parts) && out->parts >= 2 && out->parts <= QM_CHORD_PARTS_MAX))
        return true;
    return qm_json_reject(problem, "must be a whole number from 2 to 16", "/parts", 0, 0);
}

static bool read_split(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    static const char *const names[] = {"point", "mirror", NULL};
    return qm_json_check_members(object, names, problem) && read_mirror_of_edit(object, out, problem) &&
           read_array(object, "point", 3, out->point, problem);
}

static bool read_snap(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    static const char *const names[] = {"end", "point", "radius", NULL};
    if (!qm_json_check_members(object, names, problem) ||
        !read_array(object, "point", 3, out->point, problem) ||
        !read_amount(object, "radius", &out->radius, problem))
        return false;
    const char *end = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(object, "end"));
    if (!end || (strcmp(end, "from") != 0 && strcmp(end, "to") != 0))
        return qm_json_reject(problem, "must be \"from\" or \"to\"", "/end", 0, 0);
    out->end = strcmp(end, "to") == 0;
    return true;
}

static bool read_redraw(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    static const char *const names[] = {"points", "mirror", NULL};
    if (cJSON_GetObjectItemCaseSensitive(object, "view")) return read_stroke(object, out, problem);
    return qm_json_check_members(object, names, problem) && read_mirror_of_edit(object, out, problem) &&
           qm_json_read_table(cJSON_GetObjectItemCaseSensitive(object, "points"), 3, 2, "points",
                              &out->points, &out->point_count, problem);
}

static bool read_curve(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    static const char *const names[] = {"points", "mark", "snap", NULL};
    const cJSON *mark = cJSON_GetObjectItemCaseSensitive(object, "mark");
    if (!qm_json_check_members(object, names, problem) || !read_amount(object, "snap", &out->radius, problem))
        return false;
    if (mark && !qm_json_read_mark(mark, &out->mark))
        return qm_json_reject(problem, "must be \"smooth\", \"sharp\" or \"fixed\"", "/mark", 0, 0);
    return qm_json_read_table(cJSON_GetObjectItemCaseSensitive(object, "points"), 3, 2, "points",
                              &out->points, &out->point_count, problem);
}

static bool read_pair(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    static const char *const names[] = {"first", "second", "mirror", NULL};
    if (!qm_json_check_members(object, names, problem) || !read_mirror_of_edit(object, out, problem))
        return false;
    if (!qm_json_read_index(cJSON_GetObjectItemCaseSensitive(object, "first"), &out->first))
        return qm_json_reject(problem, "must be a whole number of 0 or more", "/first", 0, 0);
    if (!qm_json_read_index(cJSON_GetObjectItemCaseSensitive(object, "second"), &out->second))
        return qm_json_reject(problem, "must be a whole number of 0 or more", "/second", 0, 0);
    return true;
}

static bool read_features(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    return qm_json_read_features(object, "", &out->features, problem);
}

/** Reads an array of ids or indices, with at least one. */
static bool read_list(const cJSON *value, const char *name, uint32_t **out, size_t *count,
                      qm_problem *problem)
{
    char pointer[32];
    snprintf(pointer, sizeof pointer, "/%s", name);
    int size = cJSON_IsArray(value) ? cJSON_GetArraySize(value) : 0;
    if (size < 1 || size > MAX_MARKED)
        return qm_json_reject(problem, "must be an array of 1 to 100000 whole numbers", pointer, 0, 0);
    *out = malloc((size_t)size * sizeof **out);
    if (!*out) {
        *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "out of memory for the request");
        return false;
    }
    for (const cJSON *item = value->child; item; item = item->next) {
        snprintf(pointer, sizeof pointer, "/%s/%%zu", name);
        if (!qm_json_read_index(item, &(*out)[*count]))
            return qm_json_reject(problem, "must be a whole number of 0 or more", pointer, *count, 0);
        ++*count;
    }
    return true;
}

static bool read_marks(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    static const char *const names[] = {"curves", "mark", "nodes", "corner", "mirror", NULL};
    const cJSON *curves = cJSON_GetObjectItemCaseSensitive(object, "curves"),
                *mark = cJSON_GetObjectItemCaseSensitive(object, "mark"),
                *nodes = cJSON_GetObjectItemCaseSensitive(object, "nodes"),
                *corner = cJSON_GetObjectItemCaseSensitive(object, "corner");
    if (!qm_json_check_members(object, names, problem) || !read_mirror_of_edit(object, out, problem))
        return false;
    if (mark && !qm_json_read_mark(mark, &out->mark))
        return qm_json_reject(problem, "must be \"smooth\", \"sharp\" or \"fixed\"", "/mark", 0, 0);
    if (corner && !cJSON_IsBool(corner))
        return qm_json_reject(problem, "must be true or false", "/corner", 0, 0);
    if (!curves && !nodes) return qm_json_reject(problem, "curves or nodes must be named", "/curves", 0, 0);
    if (!curves != !mark) return qm_json_reject(problem, "goes with curves", "/mark", 0, 0);
    if (!nodes != !corner) return qm_json_reject(problem, "goes with nodes", "/corner", 0, 0);
    out->is_corner = cJSON_IsTrue(corner);
    return (!curves || read_list(curves, "curves", &out->curves, &out->curve_count, problem)) &&
           (!nodes || read_list(nodes, "nodes", &out->nodes, &out->node_count, problem));
}

bool qm_json_read_layout_edit(const char *text, size_t size, qm_layout_edit_kind kind, qm_layout_edit *out,
                              qm_problem *problem)
{
    static bool (*const readers[])(const cJSON *, qm_layout_edit *, qm_problem *) = {
        [QM_EDIT_STROKE] = read_stroke,     [QM_EDIT_SPLIT] = read_split,
        [QM_EDIT_SNAP] = read_snap,         [QM_EDIT_REDRAW] = read_redraw,
        [QM_EDIT_CURVES] = read_pair,       [QM_EDIT_NODES] = read_pair,
        [QM_EDIT_RING] = read_ring,         [QM_EDIT_FILL] = read_fill,
        [QM_EDIT_MIRROR] = read_mirror,     [QM_EDIT_MOVE] = read_move,
        [QM_EDIT_SLIDE] = read_slide,       [QM_EDIT_SPLIT_CHORD] = read_split_chord,
        [QM_EDIT_FEATURES] = read_features, [QM_EDIT_MARKS] = read_marks,
        [QM_EDIT_CURVE] = read_curve};
    *out = (qm_layout_edit){0};
    cJSON *object = qm_json_parse_object(text, size, "an edit", problem);
    if (!object) return false;
    bool good = readers[kind](object, out, problem);
    cJSON_Delete(object);
    if (!good) qm_layout_edit_reset(out);
    return good;
}

/* ---- reconstructions ---- */

static bool read_options(const cJSON *object, qm_reconstruction_options *out, qm_problem *problem)
{
    const cJSON *share = cJSON_GetObjectItemCaseSensitive(object, "cover_share");
    const cJSON *pull = cJSON_GetObjectItemCaseSensitive(object, "pull_curves");
    const cJSON *noise = cJSON_GetObjectItemCaseSensitive(object, "noise");
    *out = qm_reconstruction_options_default();
    if (noise && !qm_json_read_noise(noise, &out->noise_share))
        return qm_json_reject(problem, "must be \"automatic\" or a number from 0 to 0.1", "/noise", 0, 0);
    if (share && (!qm_json_read_number(share, &out->cover_share) || !(out->cover_share > 0.0)))
        return qm_json_reject(problem, "must be a number above 0", "/cover_share", 0, 0);
    if (pull && !cJSON_IsBool(pull))
        return qm_json_reject(problem, "must be true or false", "/pull_curves", 0, 0);
    if (pull) out->pull_curves = cJSON_IsTrue(pull);
    return true;
}

bool qm_json_read_reconstruction(const char *text, size_t size, qm_json_reconstruction *out,
                                 qm_problem *problem)
{
    static const char *const names[] = {"source", "layout",      "cover_share", "pull_curves",
                                        "noise",  "deadline_ms", NULL};
    *out = (qm_json_reconstruction){0};
    cJSON *object = qm_json_parse_object(text, size, "a reconstruction", problem);
    if (!object) return false;
    bool has_source = cJSON_HasObjectItem(object, "source");
    bool good = qm_json_check_members(object, names, problem) &&
                qm_json_read_id(object, "layout", out->layout, problem) &&
                (!has_source || qm_json_read_id(object, "source", out->source, problem)) &&
                read_options(object, &out->options, problem) &&
                qm_json_read_deadline(object, &out->deadline_ms, problem);
    cJSON_Delete(object);
    return good;
}

bool qm_json_read_layout_choice(const char *text, size_t size, qm_json_reconstruction *out,
                                qm_problem *problem)
{
    static const char *const names[] = {"layout", NULL};
    *out = (qm_json_reconstruction){0};
    cJSON *object = qm_json_parse_object(text, size, "the choice of a layout", problem);
    if (!object) return false;
    bool good = qm_json_check_members(object, names, problem) &&
                qm_json_read_id(object, "layout", out->layout, problem);
    cJSON_Delete(object);
    return good;
}
