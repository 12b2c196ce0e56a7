#include "json_layout.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "json_object.h"
#include "json_write.h"

#define MAX_ID 2147483647.0

/** Sets an invalid field; the pointer is a printf format with up to two numbers. */
static bool refuse(qm_problem *problem, const char *words, const char *format, size_t i, size_t k)
{
    char pointer[64];
    snprintf(pointer, sizeof pointer, format, i, k);
    *problem = qm_problem_make(QM_PROBLEM_INVALID_FIELD, "%s %s", pointer + 1, words);
    qm_problem_add_pointer(problem, pointer, "%s", words);
    return false;
}

static bool no_memory(qm_problem *problem)
{
    *problem = qm_problem_make(QM_PROBLEM_OUT_OF_MEMORY, "there is no memory for the layout");
    return false;
}

/** Refuses members that are not in the list, which NULL ends. */
static bool check_names(const cJSON *object, const char *const *known, qm_problem *problem)
{
    for (const cJSON *member = object->child; member; member = member->next) {
        size_t i = 0;
        while (known[i] && strcmp(known[i], member->string) != 0)
            i++;
        if (known[i]) continue;
        *problem = qm_problem_make(QM_PROBLEM_INVALID_FIELD, "the request has a field that is not known");
        char pointer[64];
        snprintf(pointer, sizeof pointer, "/%.40s", member->string);
        qm_problem_add_pointer(problem, pointer, "is not a field of this request");
        return false;
    }
    return true;
}

static bool read_number(const cJSON *value, double *out)
{
    *out = cJSON_IsNumber(value) ? value->valuedouble : NAN;
    return isfinite(*out);
}

static bool read_index(const cJSON *value, uint32_t *out)
{
    double number;
    if (!read_number(value, &number) || number < 0.0 || number > MAX_ID || number != floor(number))
        return false;
    *out = (uint32_t)number;
    return true;
}

/** Exactly so many numbers. */
static bool read_numbers(const cJSON *value, int count, double *out)
{
    if (!cJSON_IsArray(value) || cJSON_GetArraySize(value) != count) return false;
    for (const cJSON *number = value->child; number; number = number->next)
        if (!read_number(number, out++)) return false;
    return true;
}

/** Rows of numbers on malloc; format is the pointer to a row. */
static bool read_rows(const cJSON *value, int width, size_t least, const char *name, double **out,
                      size_t *count, qm_problem *problem)
{
    char pointer[48], words[64];
    snprintf(pointer, sizeof pointer, "/%s", name);
    snprintf(words, sizeof words, "must hold %zu rows or more, each of %d finite numbers", least, width);
    size_t rows = cJSON_IsArray(value) ? (size_t)cJSON_GetArraySize(value) : 0;
    if (!cJSON_IsArray(value) || rows < least) return refuse(problem, words, pointer, 0, 0);
    *out = malloc((rows + 1) * (size_t)width * sizeof **out);
    if (!*out) return no_memory(problem);
    *count = 0;
    for (const cJSON *row = value->child; row; row = row->next, ++*count) {
        if (read_numbers(row, width, *out + (size_t)width * *count)) continue;
        free(*out);
        *out = NULL;
        snprintf(pointer, sizeof pointer, "/%s/%%zu", name);
        return refuse(problem, words, pointer, *count, 0);
    }
    return true;
}

/* ---- a whole layout ---- */

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
    if (!read_rows(value, 3, 0, "nodes", &rows, &count, problem)) return false;
    qm_status status = QM_OK;
    for (size_t i = 0; i < count && status == QM_OK; i++)
        status = qm_layout_add_node(ctx, out, rows + 3 * i);
    free(rows);
    return status == QM_OK || fail_with_status(status, ctx, problem);
}

/** A curve's ends in the file are the nodes', or so near to them that only the last digit differs. */
static bool ends_match(const qm_layout *layout, uint32_t from, uint32_t to, const double *points,
                       size_t count)
{
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

static bool read_curve(qm_context *ctx, const cJSON *value, size_t place, qm_layout *out, qm_problem *problem)
{
    static const char *const names[] = {"id", "from", "to", "points", NULL};
    if (!cJSON_IsObject(value) || !check_names(value, names, problem))
        return refuse(problem, "must be an object of id, from, to and points", "/curves/%zu", place, 0);
    uint32_t id, from, to;
    if (!read_index(cJSON_GetObjectItemCaseSensitive(value, "id"), &id))
        return refuse(problem, "must be a whole number of 0 or more", "/curves/%zu/id", place, 0);
    if (qm_layout_find_curve(out, id) != QM_NO_INDEX)
        return refuse(problem, "is the id of an earlier curve", "/curves/%zu/id", place, 0);
    if (!read_index(cJSON_GetObjectItemCaseSensitive(value, "from"), &from) || from >= out->node_count)
        return refuse(problem, "must be a place in nodes", "/curves/%zu/from", place, 0);
    if (!read_index(cJSON_GetObjectItemCaseSensitive(value, "to"), &to) || to >= out->node_count)
        return refuse(problem, "must be a place in nodes", "/curves/%zu/to", place, 0);
    char name[48];
    snprintf(name, sizeof name, "curves/%zu/points", place);
    double *points;
    size_t count;
    if (!read_rows(cJSON_GetObjectItemCaseSensitive(value, "points"), 3, 2, name, &points, &count, problem))
        return false;
    if (!ends_match(out, from, to, points, count)) {
        free(points);
        return refuse(problem, "must start and end at its nodes", "/curves/%zu/points", place, 0);
    }
    uint32_t next = out->next_id;
    out->next_id = id;
    qm_status status = qm_layout_add_curve(ctx, out, from, to, points, count);
    free(points);
    if (out->next_id < next) out->next_id = next;
    return status == QM_OK || fail_with_status(status, ctx, problem);
}

static bool read_curves(qm_context *ctx, const cJSON *value, qm_layout *out, qm_problem *problem)
{
    if (!value) return true;
    if (!cJSON_IsArray(value)) return refuse(problem, "must be an array", "/curves", 0, 0);
    size_t place = 0;
    for (const cJSON *curve = value->child; curve; curve = curve->next)
        if (!read_curve(ctx, curve, place++, out, problem)) return false;
    return true;
}

static bool read_patches(qm_context *ctx, const cJSON *value, qm_layout *out, qm_problem *problem)
{
    if (!value) return true;
    if (!cJSON_IsArray(value)) return refuse(problem, "must be an array", "/patches", 0, 0);
    size_t place = 0;
    for (const cJSON *row = value->child; row; row = row->next, place++) {
        uint32_t id[4];
        bool is_good = cJSON_IsArray(row) && cJSON_GetArraySize(row) == 4;
        for (int k = 0; k < 4 && is_good; k++)
            is_good = read_index(cJSON_GetArrayItem(row, k), &id[k]);
        if (!is_good) return refuse(problem, "must hold the ids of four curves", "/patches/%zu", place, 0);
        qm_status status = qm_layout_add_patch(ctx, out, id);
        if (status == QM_E_ARGUMENT) return refuse(problem, ctx->message, "/patches/%zu", place, 0);
        if (status != QM_OK) return fail_with_status(status, ctx, problem);
    }
    return true;
}

static bool read_id(const cJSON *object, const char *name, char out[QM_LAYOUT_MESH_SIZE], qm_problem *problem)
{
    const char *id = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(object, name));
    char pointer[32], words[48];
    snprintf(pointer, sizeof pointer, "/%s", name);
    snprintf(words, sizeof words, "must be the id of a %s", strcmp(name, "layout") == 0 ? name : "mesh");
    if (!id || !*id || strlen(id) >= QM_LAYOUT_MESH_SIZE) return refuse(problem, words, pointer, 0, 0);
    snprintf(out, QM_LAYOUT_MESH_SIZE, "%s", id);
    return true;
}

bool qm_json_read_layout(qm_context *ctx, const char *text, size_t size, char mesh[QM_LAYOUT_MESH_SIZE],
                         qm_layout *out, bool *has_patches, qm_problem *problem)
{
    static const char *const with_mesh[] = {"nodes", "curves", "patches", "mesh", NULL};
    static const char *const alone[] = {"nodes", "curves", "patches", NULL};
    *out = (qm_layout){0};
    cJSON *object = qm_json_parse_object(text, size, "a layout", problem);
    if (!object) return false;
    const cJSON *patches = cJSON_GetObjectItemCaseSensitive(object, "patches");
    *has_patches = patches != NULL;
    bool good = check_names(object, mesh ? with_mesh : alone, problem) &&
                (!mesh || read_id(object, "mesh", mesh, problem)) &&
                read_nodes(ctx, cJSON_GetObjectItemCaseSensitive(object, "nodes"), out, problem) &&
                read_curves(ctx, cJSON_GetObjectItemCaseSensitive(object, "curves"), out, problem) &&
                read_patches(ctx, patches, out, problem);
    cJSON_Delete(object);
    if (!good) qm_layout_reset(ctx, out);
    return good;
}

void qm_json_add_layout(qm_text *out, const qm_layout *layout)
{
    qm_json_open(out, "nodes", "[");
    for (size_t i = 0; i < layout->node_count; i++)
        qm_json_add_array(out, layout->nodes + 3 * i, 3);
    qm_text_add_string(out, "]");
    qm_json_open(out, "curves", "[");
    for (size_t i = 0; i < layout->curve_count; i++) {
        const qm_curve *curve = &layout->curves[i];
        qm_json_add_comma(out);
        qm_text_add_string(out, "{");
        qm_json_add_count(out, "id", curve->id);
        qm_json_add_count(out, "from", curve->from);
        qm_json_add_count(out, "to", curve->to);
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

static void write_issue(qm_text *out, const qm_layout_issue *issue)
{
    static const char *const names[] = {"dangling_end", "cell_sides", "crossing"};
    _Static_assert(sizeof names / sizeof names[0] == QM_LAYOUT_FAULT_COUNT, "a name for each fault");
    char words[160];
    if (issue->fault == QM_LAYOUT_DANGLING_END)
        snprintf(words, sizeof words, "curve %u ends at node %u, where no other curve begins",
                 issue->curve[0], issue->node);
    else if (issue->fault == QM_LAYOUT_CELL_SIDES)
        snprintf(words, sizeof words, "the cell beside curve %u has %u sides, not four", issue->curve[0],
                 issue->sides);
    else
        snprintf(words, sizeof words, "curves %u and %u cross without a node", issue->curve[0],
                 issue->curve[1]);
    qm_json_add_string(out, "kind", names[issue->fault]);
    qm_json_add_count(out, "curve", issue->curve[0]);
    if (issue->fault == QM_LAYOUT_CROSSING) qm_json_add_count(out, "other_curve", issue->curve[1]);
    if (issue->fault != QM_LAYOUT_CROSSING) qm_json_add_count(out, "node", issue->node);
    if (issue->fault == QM_LAYOUT_CELL_SIDES) qm_json_add_count(out, "sides", issue->sides);
    qm_json_add_numbers(out, "point", issue->position, 3);
    qm_json_add_string(out, "detail", words);
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

/* ---- edits ---- */

void qm_layout_edit_reset(qm_layout_edit *edit)
{
    free(edit->points);
    *edit = (qm_layout_edit){0};
}

/** A number of 0 or more that may be absent. */
static bool read_amount(const cJSON *object, const char *name, double *out, qm_problem *problem)
{
    const cJSON *value = cJSON_GetObjectItemCaseSensitive(object, name);
    if (!value) return true;
    if (read_number(value, out) && *out >= 0.0) return true;
    char pointer[32];
    snprintf(pointer, sizeof pointer, "/%s", name);
    return refuse(problem, "must be a number of 0 or more", pointer, 0, 0);
}

static bool read_array(const cJSON *object, const char *name, int count, double *out, qm_problem *problem)
{
    if (read_numbers(cJSON_GetObjectItemCaseSensitive(object, name), count, out)) return true;
    char pointer[32], words[48];
    snprintf(pointer, sizeof pointer, "/%s", name);
    snprintf(words, sizeof words, "must hold %d finite numbers", count);
    return refuse(problem, words, pointer, 0, 0);
}

static bool read_stroke(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    static const char *const names[] = {"points",    "view",  "projection", "viewport",
                                        "radius_px", "depth", "snap",       NULL};
    out->in_window = true;
    return check_names(object, names, problem) && read_array(object, "view", 16, out->camera.view, problem) &&
           read_array(object, "projection", 16, out->camera.projection, problem) &&
           read_array(object, "viewport", 4, out->camera.viewport, problem) &&
           read_amount(object, "radius_px", &out->pick.radius_px, problem) &&
           read_amount(object, "depth", &out->pick.depth, problem) &&
           read_amount(object, "snap", &out->radius, problem) &&
           read_rows(cJSON_GetObjectItemCaseSensitive(object, "points"), 2, 2, "points", &out->points,
                     &out->point_count, problem);
}

static bool read_split(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    static const char *const names[] = {"point", NULL};
    return check_names(object, names, problem) && read_array(object, "point", 3, out->point, problem);
}

static bool read_snap(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    static const char *const names[] = {"end", "point", "radius", NULL};
    if (!check_names(object, names, problem) || !read_array(object, "point", 3, out->point, problem) ||
        !read_amount(object, "radius", &out->radius, problem))
        return false;
    const char *end = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(object, "end"));
    if (!end || (strcmp(end, "from") != 0 && strcmp(end, "to") != 0))
        return refuse(problem, "must be \"from\" or \"to\"", "/end", 0, 0);
    out->end = strcmp(end, "to") == 0;
    return true;
}

static bool read_redraw(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    static const char *const names[] = {"points", NULL};
    if (cJSON_GetObjectItemCaseSensitive(object, "view")) return read_stroke(object, out, problem);
    return check_names(object, names, problem) &&
           read_rows(cJSON_GetObjectItemCaseSensitive(object, "points"), 3, 2, "points", &out->points,
                     &out->point_count, problem);
}

static bool read_merge(const cJSON *object, qm_layout_edit *out, qm_problem *problem)
{
    static const char *const names[] = {"first", "second", NULL};
    if (!check_names(object, names, problem)) return false;
    if (!read_index(cJSON_GetObjectItemCaseSensitive(object, "first"), &out->first))
        return refuse(problem, "must be the id of a curve", "/first", 0, 0);
    if (!read_index(cJSON_GetObjectItemCaseSensitive(object, "second"), &out->second))
        return refuse(problem, "must be the id of a curve", "/second", 0, 0);
    return true;
}

bool qm_json_read_layout_edit(const char *text, size_t size, qm_layout_edit_kind kind, qm_layout_edit *out,
                              qm_problem *problem)
{
    static bool (*const readers[])(const cJSON *, qm_layout_edit *,
                                   qm_problem *) = {[QM_EDIT_STROKE] = read_stroke,
                                                    [QM_EDIT_SPLIT] = read_split,
                                                    [QM_EDIT_SNAP] = read_snap,
                                                    [QM_EDIT_REDRAW] = read_redraw,
                                                    [QM_EDIT_MERGE] = read_merge};
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
    *out = qm_reconstruction_options_default();
    if (share && (!read_number(share, &out->cover_share) || !(out->cover_share > 0.0)))
        return refuse(problem, "must be a number above 0", "/cover_share", 0, 0);
    if (pull && !cJSON_IsBool(pull)) return refuse(problem, "must be true or false", "/pull_curves", 0, 0);
    if (pull) out->pull_curves = cJSON_IsTrue(pull);
    return true;
}

bool qm_json_read_reconstruction(const char *text, size_t size, qm_json_reconstruction *out,
                                 qm_problem *problem)
{
    static const char *const names[] = {"source", "layout", "cover_share", "pull_curves", NULL};
    *out = (qm_json_reconstruction){0};
    cJSON *object = qm_json_parse_object(text, size, "a reconstruction", problem);
    if (!object) return false;
    bool has_source = cJSON_HasObjectItem(object, "source");
    bool good = check_names(object, names, problem) && read_id(object, "layout", out->layout, problem) &&
                (!has_source || read_id(object, "source", out->source, problem)) &&
                read_options(object, &out->options, problem);
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
    bool good = check_names(object, names, problem) && read_id(object, "layout", out->layout, problem);
    cJSON_Delete(object);
    return good;
}
