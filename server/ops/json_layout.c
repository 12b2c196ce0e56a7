/**
 * json_layout.c: a layout from JSON and to it.
 */
#include "json_layout.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/json.h"
#include "json_request.h"

static bool fail_with_status(qm_status status, const qm_context *ctx, qm_problem *problem)
{
    *problem = qm_problem_from_status(status, ctx->message);
    return false;
}

static bool read_nodes(qm_context *ctx, const cJSON *value, qm_layout *out, qm_problem *problem)
{
    double *rows;
    size_t count;
    if (!value) return true;
    if (!qm_json_read_table(value, 3, 0, "nodes", &rows, &count, problem)) return false;
    qm_status status = QM_OK;
    for (size_t i = 0; i < count && status == QM_OK; i++)
        status = qm_layout_add_node(ctx, out, rows + 3 * i);
    free(rows);
    return status == QM_OK || fail_with_status(status, ctx, problem);
}

static bool read_corners(qm_context *ctx, const cJSON *value, qm_layout *out, qm_problem *problem)
{
    if (!value) return true;
    if (!cJSON_IsArray(value)) return qm_json_reject(problem, "must be an array", "/corners", 0, 0);
    size_t index = 0;
    for (const cJSON *item = value->child; item; item = item->next, index++) {
        uint32_t node;
        if (!qm_json_read_index(item, &node) || node >= out->node_count)
            return qm_json_reject(problem, "must be an index into nodes", "/corners/%zu", index, 0);
        qm_status status = qm_layout_set_corner(ctx, out, node, true);
        if (status != QM_OK) return fail_with_status(status, ctx, problem);
    }
    return true;
}

bool qm_json_read_mark(const cJSON *value, qm_curve_mark *out)
{
    const char *name = cJSON_GetStringValue(value);
    for (int mark = 0; mark < QM_CURVE_MARK_COUNT && name; mark++) {
        if (strcmp(name, qm_layout_mark_name((qm_curve_mark)mark)) != 0) continue;
        *out = (qm_curve_mark)mark;
        return true;
    }
    return false;
}

/** Whether the curve ends at its nodes, up to the last digits of a decimal file. */
static bool ends_match(const qm_layout *layout, uint32_t from, uint32_t to, const double *points,
                       size_t count)
{
    QM_ASSERT(from < layout->node_count && to < layout->node_count && count >= 2);
    double length = 0.0, gap = 0.0;
    for (int k = 0; k < 3; k++) {
        gap = fmax(gap, fabs(points[k] - layout->nodes[3 * (size_t)from + (size_t)k]));
        gap =
            fmax(gap, fabs(points[3 * (count - 1) + (size_t)k] - layout->nodes[3 * (size_t)to + (size_t)k]));
        for (size_t i = 1; i < count; i++)
            length += fabs(points[3 * i + (size_t)k] - points[3 * i - 3 + (size_t)k]);
    }
    return gap <= 1e-6 * length;
}

static bool read_curve(qm_context *ctx, const cJSON *value, size_t index, qm_layout *out, qm_problem *problem)
{
    static const char *const names[] = {"id", "from", "to", "points", "mark", NULL};
    if (!cJSON_IsObject(value) || !qm_json_check_members(value, names, problem))
        return qm_json_reject(problem, "must be an object with id, from, to and points", "/curves/%zu", index,
                              0);
    uint32_t id, from, to;
    if (!qm_json_read_index(cJSON_GetObjectItemCaseSensitive(value, "id"), &id))
        return qm_json_reject(problem, "must be an integer of 0 or more", "/curves/%zu/id", index, 0);
    if (qm_layout_find_curve(out, id) != QM_NO_INDEX)
        return qm_json_reject(problem, "is the id of an earlier curve", "/curves/%zu/id", index, 0);
    if (!qm_json_read_index(cJSON_GetObjectItemCaseSensitive(value, "from"), &from) ||
        from >= out->node_count)
        return qm_json_reject(problem, "must be an index into nodes", "/curves/%zu/from", index, 0);
    if (!qm_json_read_index(cJSON_GetObjectItemCaseSensitive(value, "to"), &to) || to >= out->node_count)
        return qm_json_reject(problem, "must be an index into nodes", "/curves/%zu/to", index, 0);
    qm_curve_mark mark = QM_CURVE_SMOOTH;
    const cJSON *marked = cJSON_GetObjectItemCaseSensitive(value, "mark");
    if (marked && !qm_json_read_mark(marked, &mark))
        return qm_json_reject(problem, "must be \"smooth\", \"sharp\" or \"fixed\"", "/curves/%zu/mark",
                              index, 0);
    char name[48];
    snprintf(name, sizeof name, "curves/%zu/points", index);
    double *points;
    size_t count;
    if (!qm_json_read_table(cJSON_GetObjectItemCaseSensitive(value, "points"), 3, 2, name, &points, &count,
                            problem))
        return false;
    if (!ends_match(out, from, to, points, count)) {
        free(points);
        return qm_json_reject(problem, "must start and end at its nodes", "/curves/%zu/points", index, 0);
    }
    uint32_t next = out->next_id;
    out->next_id = id;
    qm_status status = qm_layout_add_curve(ctx, out, from, to, points, count);
    free(points);
    if (out->next_id < next) out->next_id = next;
    if (status == QM_OK) out->curves[out->curve_count - 1].mark = mark;
    return status == QM_OK || fail_with_status(status, ctx, problem);
}

static bool read_curves(qm_context *ctx, const cJSON *value, qm_layout *out, qm_problem *problem)
{
    if (!value) return true;
    if (!cJSON_IsArray(value)) return qm_json_reject(problem, "must be an array", "/curves", 0, 0);
    size_t index = 0;
    for (const cJSON *curve = value->child; curve; curve = curve->next)
        if (!read_curve(ctx, curve, index++, out, problem)) return false;
    return true;
}

static bool read_patches(qm_context *ctx, const cJSON *value, qm_layout *out, qm_problem *problem)
{
    if (!value) return true;
    if (!cJSON_IsArray(value)) return qm_json_reject(problem, "must be an array", "/patches", 0, 0);
    size_t index = 0;
    for (const cJSON *row = value->child; row; row = row->next, index++) {
        uint32_t id[4];
        bool is_valid = cJSON_IsArray(row) && cJSON_GetArraySize(row) == 4;
        for (int k = 0; k < 4 && is_valid; k++)
            is_valid = qm_json_read_index(cJSON_GetArrayItem(row, k), &id[k]);
        if (!is_valid)
            return qm_json_reject(problem, "must be an array of the ids of four curves", "/patches/%zu",
                                  index, 0);
        qm_status status = qm_layout_add_patch(ctx, out, id);
        if (status == QM_E_ARGUMENT) return qm_json_reject(problem, ctx->message, "/patches/%zu", index, 0);
        if (status != QM_OK) return fail_with_status(status, ctx, problem);
    }
    return true;
}

bool qm_json_read_layout(qm_context *ctx, const char *text, size_t size, char mesh[QM_ID_SIZE],
                         qm_layout_features_options *features, qm_layout *out, bool *has_patches,
                         qm_problem *problem)
{
    static const char *const with_mesh[] = {"nodes", "corners",  "curves", "patches",
                                            "mesh",  "features", NULL};
    static const char *const alone[] = {"nodes", "corners", "curves", "patches", NULL};
    *out = (qm_layout){0};
    cJSON *object = qm_json_parse_object(text, size, "a layout", problem);
    if (!object) return false;
    const cJSON *patches = cJSON_GetObjectItemCaseSensitive(object, "patches");
    *has_patches = patches != NULL;
    const cJSON *wanted = cJSON_GetObjectItemCaseSensitive(object, "features");
    if (features) *features = (qm_layout_features_options){0};
    bool is_valid = qm_json_check_members(object, mesh ? with_mesh : alone, problem) &&
                    (!wanted || qm_json_read_features(wanted, "features", features, problem)) &&
                    (!wanted || !patches ||
                     qm_json_reject(problem, "patches are found after features were added: name none",
                                    "/patches", 0, 0)) &&
                    (!mesh || qm_json_read_id(object, "mesh", mesh, problem)) &&
                    read_nodes(ctx, cJSON_GetObjectItemCaseSensitive(object, "nodes"), out, problem) &&
                    read_corners(ctx, cJSON_GetObjectItemCaseSensitive(object, "corners"), out, problem) &&
                    read_curves(ctx, cJSON_GetObjectItemCaseSensitive(object, "curves"), out, problem) &&
                    read_patches(ctx, patches, out, problem);
    cJSON_Delete(object);
    if (!is_valid) qm_layout_reset(ctx, out);
    return is_valid;
}

bool qm_json_read_features(const cJSON *object, const char *name, qm_layout_features_options *out,
                           qm_problem *problem)
{
    static const char *const names[] = {"angle_deg", "shortest", "snap", NULL};
    *out = qm_layout_features_options_default();
    char pointer[48];
    snprintf(pointer, sizeof pointer, "/%s", name);
    if (!cJSON_IsObject(object)) return qm_json_reject(problem, "must be an object", pointer, 0, 0);
    if (!qm_json_check_members(object, names, problem)) return false;
    double *const into[] = {&out->angle, &out->shortest, &out->radius};
    for (int k = 0; names[k]; k++) {
        const cJSON *value = cJSON_GetObjectItemCaseSensitive(object, names[k]);
        if (!value) continue;
        bool is_number = qm_json_read_number(value, into[k]) && *into[k] >= 0.0;
        snprintf(pointer, sizeof pointer, "%s%s/%s", name[0] ? "/" : "", name, names[k]);
        if (k == 0 && !(is_number && out->angle > 0.0 && out->angle <= 180.0))
            return qm_json_reject(problem, "must be a number above 0, and 180 at most", pointer, 0, 0);
        if (!is_number) return qm_json_reject(problem, "must be a number of 0 or more", pointer, 0, 0);
    }
    return true;
}

/** Members of a layout that is made; names are those that are allowed. */
static bool read_made_layout(const cJSON *object, const char *const *names, double *crease_angle,
                             qm_json_quad_layout *out, qm_problem *problem)
{
    static const char *const of_features[] = {"angle_deg", NULL};
    const cJSON *patches = cJSON_GetObjectItemCaseSensitive(object, "patches"),
                *angle = cJSON_GetObjectItemCaseSensitive(object, "crease_angle"),
                *features = cJSON_GetObjectItemCaseSensitive(object, "features");
    if (!qm_json_check_members(object, names, problem) ||
        !qm_json_read_id(object, "mesh", out->mesh, problem))
        return false;
    if (patches && !qm_json_read_count(patches, 1, 1e5, &out->options.patches))
        return qm_json_reject(problem, "must be an integer from 1 to 100000", "/patches", 0, 0);
    if (angle && !(qm_json_read_number(angle, crease_angle) && *crease_angle >= 0 && *crease_angle <= 180))
        return qm_json_reject(problem, "must be a number from 0 to 180", "/crease_angle", 0, 0);
    if (features) {
        const cJSON *given = cJSON_GetObjectItemCaseSensitive(features, "angle_deg");
        if (angle)
            return qm_json_reject(problem, "is an older form of features: give one of both", "/crease_angle",
                                  0, 0);
        if (!cJSON_IsObject(features)) return qm_json_reject(problem, "must be an object", "/features", 0, 0);
        if (!qm_json_check_members(features, of_features, problem)) return false;
        *crease_angle = qm_layout_features_options_default().angle;
        if (given &&
            !(qm_json_read_number(given, crease_angle) && *crease_angle >= 0 && *crease_angle <= 180))
            return qm_json_reject(problem, "must be a number from 0 to 180", "/features/angle_deg", 0, 0);
    }
    return qm_json_read_deadline(object, &out->deadline_ms, problem);
}

static bool read_quad_layout(const cJSON *object, qm_json_quad_layout *out, qm_problem *problem)
{
    static const char *const names[] = {"mesh",     "quads",       "patches", "crease_angle",
                                        "features", "deadline_ms", NULL};
    out->source = QM_LAYOUT_QUADS;
    return read_made_layout(object, names, &out->options.crease_angle, out, problem) &&
           qm_json_read_id(object, "quads", out->quads, problem);
}

bool qm_json_read_plane_text(const char *text, double point[3], double normal[3])
{
    for (int k = 0; k < 6; k++) {
        char *end;
        double value = strtod(text, &end);
        if (end == text || !isfinite(value) || *end != (k < 5 ? ',' : '\0')) return false;
        (k < 3 ? point : normal)[k % 3] = value;
        text = end + 1;
    }
    return normal[0] != 0.0 || normal[1] != 0.0 || normal[2] != 0.0;
}

/** Reads the plane of symmetry: "found", or a point and a normal. */
static bool read_symmetry(const cJSON *value, qm_symmetry_wish *out, qm_problem *problem)
{
    static const char *const names[] = {"point", "normal", NULL};
    const char *word = cJSON_GetStringValue(value);
    if (word && strcmp(word, "found") == 0) return *out = (qm_symmetry_wish){.finds = true}, true;
    bool is_plane = cJSON_IsObject(value) && qm_json_check_members(value, names, problem);
    if (cJSON_IsObject(value) && !is_plane) return false;
    is_plane = is_plane &&
               qm_json_read_numbers(cJSON_GetObjectItemCaseSensitive(value, "point"), 3, out->point) &&
               qm_json_read_numbers(cJSON_GetObjectItemCaseSensitive(value, "normal"), 3, out->normal);
    out->is_given = is_plane && (out->normal[0] != 0.0 || out->normal[1] != 0.0 || out->normal[2] != 0.0);
    return out->is_given ||
           qm_json_reject(problem, "must be \"found\", or a plane: a point and a normal, which is not 0 0 0",
                          "/symmetry", 0, 0);
}

static bool read_auto_layout(const cJSON *object, qm_json_quad_layout *out, qm_problem *problem)
{
    static const char *const names[] = {"mesh",     "auto",     "quad_count",  "patches", "crease_angle",
                                        "features", "symmetry", "deadline_ms", NULL};
    const cJSON *count = cJSON_GetObjectItemCaseSensitive(object, "quad_count"),
                *symmetry = cJSON_GetObjectItemCaseSensitive(object, "symmetry");
    out->source = QM_LAYOUT_SURFACE;
    if (!read_made_layout(object, names, &out->make_quads.crease_angle, out, problem)) return false;
    if (!cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(object, "auto")))
        return qm_json_reject(problem, "must be true", "/auto", 0, 0);
    if (count && !qm_json_read_count(count, 1, 1e5, &out->make_quads.quads))
        return qm_json_reject(problem, "must be an integer from 1 to 100000", "/quad_count", 0, 0);
    return !symmetry || read_symmetry(symmetry, &out->symmetry, problem);
}

bool qm_json_read_quad_layout(const char *text, size_t size, qm_json_quad_layout *out, qm_problem *problem)
{
    *out = (qm_json_quad_layout){.options = qm_quad_layout_options_default(),
                                 .make_quads = qm_quads_options_default()};
    cJSON *object = qm_json_parse_object(text, size, "a layout", problem);
    if (!object) return false;
    bool is_valid = true;
    if (cJSON_GetObjectItemCaseSensitive(object, "auto"))
        is_valid = read_auto_layout(object, out, problem);
    else if (cJSON_GetObjectItemCaseSensitive(object, "quads"))
        is_valid = read_quad_layout(object, out, problem);
    cJSON_Delete(object);
    return is_valid;
}

void qm_json_add_layout(qm_text *out, const qm_layout *layout)
{
    qm_json_open(out, "nodes", "[");
    for (size_t i = 0; i < layout->node_count; i++)
        qm_json_add_array(out, layout->nodes + 3 * i, 3);
    qm_text_add_string(out, "]");
    if (layout->corner_count > 0) {
        qm_json_open(out, "corners", "[");
        for (size_t i = 0; i < layout->corner_count; i++) {
            qm_json_add_comma(out);
            qm_text_printf(out, "%u", layout->corners[i]);
        }
        qm_text_add_string(out, "]");
    }
    qm_json_open(out, "curves", "[");
    for (size_t i = 0; i < layout->curve_count; i++) {
        const qm_curve *curve = &layout->curves[i];
        qm_json_add_comma(out);
        qm_text_add_string(out, "{");
        qm_json_add_count(out, "id", curve->id);
        qm_json_add_count(out, "from", curve->from);
        qm_json_add_count(out, "to", curve->to);
        if (curve->mark != QM_CURVE_SMOOTH) qm_json_add_string(out, "mark", qm_layout_mark_name(curve->mark));
        qm_json_open(out, "points", "[");
        for (size_t k = 0; k < curve->point_count; k++)
            qm_json_add_array(out, curve->points + 3 * k, 3);
        qm_text_add_string(out, "]}");
    }
    qm_text_add_string(out, "]");
    qm_json_open(out, "patches", "[");
    for (size_t i = 0; i < layout->patch_count; i++) {
        const uint32_t *side = layout->patches[i].side;
        qm_json_add_comma(out);
        qm_text_printf(out, "[%u,%u,%u,%u]", layout->curves[side[0]].id, layout->curves[side[1]].id,
                       layout->curves[side[2]].id, layout->curves[side[3]].id);
    }
    qm_text_add_string(out, "]");
}

void qm_layout_issue_text(const qm_layout_issue *issue, char out[QM_ISSUE_TEXT])
{
    if (issue->fault == QM_LAYOUT_APART)
        snprintf(out, QM_ISSUE_TEXT,
                 "curve %u and what it is connected with lie apart from other curves: join them",
                 issue->curve[0]);
    else if (issue->fault == QM_LAYOUT_DANGLING_END)
        snprintf(out, QM_ISSUE_TEXT, "curve %u ends at node %u, where no other curve begins", issue->curve[0],
                 issue->node);
    else if (issue->fault == QM_LAYOUT_CELL_SIDES)
        snprintf(out, QM_ISSUE_TEXT, "the cell beside curve %u has %u sides, not four", issue->curve[0],
                 issue->sides);
    else
        snprintf(out, QM_ISSUE_TEXT, "curves %u and %u cross without a node", issue->curve[0],
                 issue->curve[1]);
}

const char *qm_json_warning_name(qm_reconstruction_warning_kind kind)
{
    static const char *const names[] = {"spans_hole", "uncovered", "one_sided",         "inside_out",
                                        "noise",      "outliers",  "estimated_normals", "fills_hole"};
    _Static_assert(sizeof names / sizeof names[0] == QM_RECONSTRUCTION_WARNING_COUNT, "a name for each kind");
    QM_ASSERT(kind < QM_RECONSTRUCTION_WARNING_COUNT);
    return names[kind];
}

void qm_json_warning_text(const qm_reconstruction_warning *warning, char out[QM_WARNING_TEXT])
{
    if (warning->kind == QM_RECONSTRUCTION_SPANS_HOLE)
        snprintf(out, QM_WARNING_TEXT, "patch %zu spans a hole of the surface", warning->patch);
    else if (warning->kind == QM_RECONSTRUCTION_UNCOVERED)
        snprintf(out, QM_WARNING_TEXT, "no patch covers %.1f %% of the surface", 100.0 * warning->share);
    else if (warning->kind == QM_RECONSTRUCTION_ONE_SIDED)
        snprintf(out, QM_WARNING_TEXT, "the patches have no common orientation: the layout is one-sided");
    else if (warning->kind == QM_RECONSTRUCTION_NOISE)
        snprintf(out, QM_WARNING_TEXT,
                 "the points are off the surface by %.2g of the diagonal: the mesh is fitted to them",
                 warning->share);
    else if (warning->kind == QM_RECONSTRUCTION_OUTLIERS)
        snprintf(out, QM_WARNING_TEXT, "%.2g %% of the points are outliers and do not count",
                 100.0 * warning->share);
    else if (warning->kind == QM_RECONSTRUCTION_NORMALS)
        snprintf(out, QM_WARNING_TEXT, "the points have no normals that agree: normals are estimated");
    else if (warning->kind == QM_RECONSTRUCTION_FILLS_HOLE)
        snprintf(out, QM_WARNING_TEXT, "%.2g %% of the mesh lies in holes of the surface, which are filled",
                 100.0 * warning->share);
    else
        snprintf(out, QM_WARNING_TEXT,
                 "the faces look inward, as those of the surface: the mesh is inside out");
}

static bool has_share(qm_reconstruction_warning_kind kind)
{
    return kind == QM_RECONSTRUCTION_UNCOVERED || kind == QM_RECONSTRUCTION_NOISE ||
           kind == QM_RECONSTRUCTION_OUTLIERS || kind == QM_RECONSTRUCTION_FILLS_HOLE;
}

void qm_json_add_warnings(qm_text *out, const qm_reconstruction *reconstruction)
{
    qm_reconstruction_warning warning[100];
    size_t most = sizeof warning / sizeof *warning,
           count = qm_reconstruction_find_warnings(reconstruction, warning, most);
    qm_json_open(out, "warnings", "[");
    for (size_t i = 0; i < count && i < most; i++) {
        char text[QM_WARNING_TEXT];
        qm_json_warning_text(&warning[i], text);
        qm_json_add_comma(out);
        qm_text_add_string(out, "{");
        qm_json_add_string(out, "kind", qm_json_warning_name(warning[i].kind));
        if (warning[i].kind == QM_RECONSTRUCTION_SPANS_HOLE)
            qm_json_add_count(out, "patch", warning[i].patch);
        if (has_share(warning[i].kind)) qm_json_add_number(out, "share", warning[i].share);
        qm_json_add_string(out, "detail", text);
        qm_text_add_string(out, "}");
    }
    qm_text_add_string(out, "]");
}

static void write_issue(qm_text *out, const qm_layout_issue *issue)
{
    static const char *const names[] = {"dangling_end", "cell_sides", "apart", "crossing"};
    _Static_assert(sizeof names / sizeof names[0] == QM_LAYOUT_FAULT_COUNT, "a name for each fault");
    QM_ASSERT(issue->fault < QM_LAYOUT_FAULT_COUNT);
    char message[QM_ISSUE_TEXT];
    qm_layout_issue_text(issue, message);
    qm_json_add_string(out, "kind", names[issue->fault]);
    qm_json_add_count(out, "curve", issue->curve[0]);
    if (issue->fault == QM_LAYOUT_CROSSING) qm_json_add_count(out, "other_curve", issue->curve[1]);
    if (issue->fault != QM_LAYOUT_CROSSING) qm_json_add_count(out, "node", issue->node);
    if (issue->fault == QM_LAYOUT_CELL_SIDES) qm_json_add_count(out, "sides", issue->sides);
    qm_json_add_numbers(out, "point", issue->position, 3);
    qm_json_add_string(out, "detail", message);
}

void qm_json_add_layout_issues(qm_text *out, const qm_layout_issues *issues)
{
    qm_json_open(out, "issues", "[");
    for (size_t i = 0; i < issues->count; i++) {
        qm_json_add_comma(out);
        qm_text_add_string(out, "{");
        write_issue(out, &issues->items[i]);
        qm_text_add_string(out, "}");
    }
    qm_text_add_string(out, "]");
}

void qm_json_add_suggestions(qm_text *out, const qm_layout_suggestions *suggestions)
{
    static const char *const names[] = {"feature", "end", "join", "divide", "image"};
    _Static_assert(sizeof names / sizeof names[0] == QM_SUGGEST_KIND_COUNT, "a name for each kind");
    qm_json_open(out, "suggestions", "[");
    for (size_t i = 0; i < suggestions->count; i++) {
        const qm_layout_suggestion *one = &suggestions->items[i];
        char detail[80];
        if (one->kind == QM_SUGGEST_FEATURE)
            snprintf(detail, sizeof detail, "a crease or boundary that no curve runs along");
        else if (one->kind == QM_SUGGEST_END)
            snprintf(detail, sizeof detail, "goes on from an end where no other curve begins");
        else if (one->kind == QM_SUGGEST_JOIN)
            snprintf(detail, sizeof detail, "joins two parts that no curve connects");
        else if (one->kind == QM_SUGGEST_IMAGE)
            snprintf(detail, sizeof detail, "the mirror image of a curve that has none");
        else
            snprintf(detail, sizeof detail, "divides a cell of %u sides", one->sides);
        qm_json_add_comma(out);
        qm_text_add_string(out, "{");
        qm_json_add_string(out, "kind", names[one->kind]);
        if (one->mark != QM_CURVE_SMOOTH) qm_json_add_string(out, "mark", qm_layout_mark_name(one->mark));
        qm_json_open(out, "points", "[");
        for (size_t k = 0; k < one->point_count; k++)
            qm_json_add_array(out, one->points + 3 * k, 3);
        qm_text_add_string(out, "]");
        qm_json_add_string(out, "detail", detail);
        qm_text_add_string(out, "}");
    }
    qm_text_add_string(out, "]");
}
