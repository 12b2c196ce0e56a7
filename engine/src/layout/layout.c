/**
 * layout.c: the arrays of a layout, its patches by curve ids, and the checks of qm_layout_validate.
 */
#include "layout_internal.h"

#include <string.h>

#define MIN_LENGTH 1e-9 /* of the surface's diagonal: a shorter curve counts as one without length */

enum { POINT_SIZE = 3 * sizeof(double) };

static qm_status no_memory(qm_context *ctx)
{
    return qm_context_fail(ctx, QM_E_NO_MEMORY, "out of memory for the layout");
}

void qm_layout_clear_patches(qm_context *ctx, qm_layout *layout)
{
    qm_context_free(ctx, layout->patches, layout->patch_count, sizeof *layout->patches);
    layout->patches = NULL;
    layout->patch_count = 0;
}

void qm_layout_reset(qm_context *ctx, qm_layout *layout)
{
    QM_ASSERT(ctx && layout);
    for (size_t i = 0; i < layout->curve_count; i++)
        qm_context_free(ctx, layout->curves[i].points, layout->curves[i].point_count, POINT_SIZE);
    qm_context_free(ctx, layout->curves, layout->curve_count, sizeof *layout->curves);
    qm_context_free(ctx, layout->nodes, layout->node_count, POINT_SIZE);
    qm_context_free(ctx, layout->corners, layout->corner_count, sizeof *layout->corners);
    qm_layout_clear_patches(ctx, layout);
    *layout = (qm_layout){0};
}

qm_status qm_layout_add_node(qm_context *ctx, qm_layout *layout, const double position[3])
{
    double *nodes =
        qm_context_resize(ctx, layout->nodes, layout->node_count, layout->node_count + 1, POINT_SIZE);
    if (!nodes) return no_memory(ctx);
    layout->nodes = nodes;
    memcpy(nodes + 3 * layout->node_count++, position, POINT_SIZE);
    return QM_OK;
}

/** Adds a curve with a copy of its points. The caller sets its id and its nodes. */
static qm_status append_curve(qm_context *ctx, qm_layout *layout, const double *points, size_t point_count)
{
    double *copy = qm_context_alloc(ctx, point_count, POINT_SIZE);
    if (!copy) return no_memory(ctx);
    qm_curve *curves = qm_context_resize(ctx, layout->curves, layout->curve_count, layout->curve_count + 1,
                                         sizeof *layout->curves);
    if (!curves) {
        qm_context_free(ctx, copy, point_count, POINT_SIZE);
        return no_memory(ctx);
    }
    memcpy(copy, points, point_count * POINT_SIZE);
    layout->curves = curves;
    curves[layout->curve_count++] = (qm_curve){.points = copy, .point_count = point_count};
    return QM_OK;
}

qm_status qm_layout_add_curve(qm_context *ctx, qm_layout *layout, uint32_t from, uint32_t to,
                              const double *points, size_t point_count)
{
    QM_ASSERT(ctx && layout && points);
    if (point_count < 2)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "a curve has two points or more, got %zu", point_count);
    if (from >= layout->node_count || to >= layout->node_count)
        return qm_context_fail(ctx, QM_E_ARGUMENT, "a curve from node %u to %u, but there are %zu nodes",
                               from, to, layout->node_count);
    qm_status status = append_curve(ctx, layout, points, point_count);
    if (status != QM_OK) return status;
    qm_curve *curve = &layout->curves[layout->curve_count - 1];
    curve->id = layout->next_id++;
    curve->from = from;
    curve->to = to;
    memcpy(curve->points, layout->nodes + 3 * (size_t)from, POINT_SIZE);
    memcpy(curve->points + 3 * (point_count - 1), layout->nodes + 3 * (size_t)to, POINT_SIZE);
    return QM_OK;
}

static qm_status copy_arrays(qm_context *ctx, const qm_layout *layout, qm_layout *out)
{
    if (layout->node_count > 0 && !(out->nodes = qm_context_alloc(ctx, layout->node_count, POINT_SIZE)))
        return no_memory(ctx);
    out->node_count = layout->node_count;
    if (out->node_count > 0) memcpy(out->nodes, layout->nodes, layout->node_count * POINT_SIZE);
    for (size_t i = 0; i < layout->curve_count; i++) {
        const qm_curve *curve = &layout->curves[i];
        qm_status status = append_curve(ctx, out, curve->points, curve->point_count);
        if (status != QM_OK) return status;
        out->curves[i].id = curve->id;
        out->curves[i].from = curve->from;
        out->curves[i].to = curve->to;
        out->curves[i].mark = curve->mark;
    }
    if (layout->corner_count > 0) {
        out->corners = qm_context_alloc(ctx, layout->corner_count, sizeof *out->corners);
        if (!out->corners) return no_memory(ctx);
        out->corner_count = layout->corner_count;
        memcpy(out->corners, layout->corners, layout->corner_count * sizeof *out->corners);
    }
    if (layout->patch_count == 0) return QM_OK;
    out->patches = qm_context_alloc(ctx, layout->patch_count, sizeof *out->patches);
    if (!out->patches) return no_memory(ctx);
    out->patch_count = layout->patch_count;
    memcpy(out->patches, layout->patches, layout->patch_count * sizeof *out->patches);
    return QM_OK;
}

qm_status qm_layout_copy(qm_context *ctx, const qm_layout *layout, qm_layout *out)
{
    QM_ASSERT(ctx && layout && out && layout != out);
    *out = (qm_layout){.next_id = layout->next_id};
    qm_status status = copy_arrays(ctx, layout, out);
    if (status != QM_OK) qm_layout_reset(ctx, out);
    return status;
}

/** The place of a node among the corners, or where it would be. */
static size_t corner_place(const qm_layout *layout, uint32_t node)
{
    size_t low = 0, high = layout->corner_count;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (layout->corners[middle] < node)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

bool qm_layout_is_corner(const qm_layout *layout, uint32_t node)
{
    size_t place = corner_place(layout, node);
    return place < layout->corner_count && layout->corners[place] == node;
}

qm_status qm_layout_set_corner(qm_context *ctx, qm_layout *layout, uint32_t node, bool is_corner)
{
    QM_ASSERT(ctx && layout && node < layout->node_count);
    size_t place = corner_place(layout, node), count = layout->corner_count;
    bool was_corner = place < count && layout->corners[place] == node;
    if (is_corner == was_corner) return QM_OK;
    size_t next = is_corner ? count + 1 : count - 1;
    uint32_t *corners = NULL;
    if (next > 0) {
        corners = qm_context_alloc(ctx, next, sizeof *corners);
        if (!corners) return no_memory(ctx);
        for (size_t i = 0; i < place; i++)
            corners[i] = layout->corners[i];
        if (is_corner) corners[place] = node;
        for (size_t i = place + was_corner; i < count; i++)
            corners[i + is_corner - was_corner] = layout->corners[i];
    }
    qm_context_free(ctx, layout->corners, count, sizeof *corners);
    layout->corners = corners;
    layout->corner_count = next;
    return QM_OK;
}

const char *qm_layout_mark_name(qm_curve_mark mark)
{
    static const char *const names[] = {"smooth", "sharp", "fixed"};
    _Static_assert(sizeof names / sizeof names[0] == QM_CURVE_MARK_COUNT, "a name for each mark");
    QM_ASSERT(mark < QM_CURVE_MARK_COUNT);
    return names[mark];
}

uint32_t qm_layout_find_curve(const qm_layout *layout, uint32_t id)
{
    /* Layouts that were made number their curves in order: the place is known without a search. */
    size_t guess = layout->curve_count > 0 ? id - (size_t)layout->curves[0].id : 0;
    if (guess < layout->curve_count && layout->curves[guess].id == id) return (uint32_t)guess;
    for (size_t i = 0; i < layout->curve_count; i++)
        if (layout->curves[i].id == id) return (uint32_t)i;
    return QM_NO_INDEX;
}

/**
 * Sets patch->against so that each side starts where the one before it ends, given the direction of the
 * first. False if the sides do not close; *open_side is then the side at which they fail to.
 */
static bool close_sides(const qm_layout *layout, qm_layout_patch *patch, bool first_against, int *open_side)
{
    const qm_curve *first = &layout->curves[patch->side[0]];
    uint32_t start = first_against ? first->to : first->from, at = first_against ? first->from : first->to;
    patch->against[0] = first_against;
    for (int side = 1; side < 4; side++) {
        const qm_curve *curve = &layout->curves[patch->side[side]];
        *open_side = side;
        if (curve->from != at && curve->to != at) return false;
        patch->against[side] = curve->from != at;
        at = patch->against[side] ? curve->from : curve->to;
    }
    return at == start;
}

qm_status qm_layout_append_patch(qm_context *ctx, qm_layout *layout, const qm_layout_patch *patch)
{
    qm_layout_patch *patches = qm_context_resize(ctx, layout->patches, layout->patch_count,
                                                 layout->patch_count + 1, sizeof *layout->patches);
    if (!patches) return no_memory(ctx);
    layout->patches = patches;
    patches[layout->patch_count++] = *patch;
    return QM_OK;
}

qm_status qm_layout_add_issue(qm_context *ctx, qm_layout_issues *issues, const qm_layout_issue *issue)
{
    qm_layout_issue *items =
        qm_context_resize(ctx, issues->items, issues->count, issues->count + 1, sizeof *items);
    if (!items) return no_memory(ctx);
    issues->items = items;
    items[issues->count++] = *issue;
    return QM_OK;
}

void qm_layout_issues_reset(qm_context *ctx, qm_layout_issues *issues)
{
    qm_context_free(ctx, issues->items, issues->count, sizeof *issues->items);
    *issues = (qm_layout_issues){0};
}

qm_status qm_layout_add_patch(qm_context *ctx, qm_layout *layout, const uint32_t id[4])
{
    qm_layout_patch patch;
    for (int side = 0; side < 4; side++) {
        patch.side[side] = qm_layout_find_curve(layout, id[side]);
        if (patch.side[side] == QM_NO_INDEX)
            return qm_context_fail(ctx, QM_E_ARGUMENT, "patch %zu names curve %u, which does not exist",
                                   layout->patch_count, id[side]);
    }
    int open_side = 0, open_side_against = 0;
    if (!close_sides(layout, &patch, false, &open_side) &&
        !close_sides(layout, &patch, true, &open_side_against)) {
        int side = open_side > open_side_against ? open_side : open_side_against;
        return qm_context_fail(ctx, QM_E_ARGUMENT, "patch %zu does not close at its side %d, curve %u",
                               layout->patch_count, side, id[side]);
    }
    return qm_layout_append_patch(ctx, layout, &patch);
}

double qm_layout_points_length(const double *points, size_t count)
{
    double length = 0.0;
    for (size_t i = 1; i < count; i++)
        length += qm_vec_distance(qm_vec_load(points + 3 * i), qm_vec_load(points + 3 * i - 3));
    return length;
}

double qm_layout_curve_length(const qm_curve *curve)
{
    return qm_layout_points_length(curve->points, curve->point_count);
}

static qm_status check_curve(qm_context *ctx, const qm_layout *layout, const qm_curve *curve, double diagonal)
{
    QM_ASSERT(curve->point_count >= 2 && curve->from < layout->node_count && curve->to < layout->node_count);
    for (size_t i = 0; i < 3 * curve->point_count; i++)
        if (!isfinite(curve->points[i]))
            return qm_context_fail(ctx, QM_E_NOT_FINITE, "point %zu of curve %u is not finite", i / 3,
                                   curve->id);
    const double *first = curve->points, *last = curve->points + 3 * (curve->point_count - 1);
    if (memcmp(first, layout->nodes + 3 * (size_t)curve->from, POINT_SIZE) != 0 ||
        memcmp(last, layout->nodes + 3 * (size_t)curve->to, POINT_SIZE) != 0)
        return qm_context_fail(ctx, QM_E_LAYOUT, "curve %u does not end at its nodes", curve->id);
    if (!(qm_layout_curve_length(curve) > MIN_LENGTH * diagonal))
        return qm_context_fail(ctx, QM_E_LAYOUT, "curve %u has no length", curve->id);
    return QM_OK;
}

static qm_status check_crossings(qm_context *ctx, const qm_layout *layout, const qm_ref_surface *surface)
{
    qm_layout_issues issues = {0};
    qm_status status = qm_layout_find_crossings(ctx, layout, surface, &issues);
    if (status == QM_OK && issues.count > 0) {
        const qm_layout_issue *issue = &issues.items[0];
        const double *at = issue->position;
        status = qm_context_fail(ctx, QM_E_LAYOUT, "curves %u and %u cross at %g %g %g without a node",
                                 issue->curve[0], issue->curve[1], at[0], at[1], at[2]);
        if (issue->curve[0] == issue->curve[1])
            qm_context_fail(ctx, status, "curve %u crosses itself at %g %g %g", issue->curve[0], at[0], at[1],
                            at[2]);
    }
    qm_layout_issues_reset(ctx, &issues);
    return status;
}

qm_status qm_layout_validate_patches(qm_context *ctx, const qm_layout *layout, double diagonal)
{
    QM_ASSERT(ctx && layout);
    qm_status status = QM_OK;
    for (size_t i = 0; i < layout->curve_count && status == QM_OK; i++)
        status = check_curve(ctx, layout, &layout->curves[i], diagonal);
    for (size_t p = 0; p < layout->patch_count; p++) {
        const qm_layout_patch *patch = &layout->patches[p];
        for (int side = 0; side < 4 && status == QM_OK; side++) {
            const qm_curve *curve = &layout->curves[patch->side[side]];
            uint32_t end = patch->against[side] ? curve->from : curve->to;
            if (end != qm_layout_corner(layout, patch, (side + 1) % 4))
                status =
                    qm_context_fail(ctx, QM_E_LAYOUT, "patch %zu does not close at its side %d, curve %u", p,
                                    side, curve->id);
        }
    }
    for (size_t i = 0; i < layout->curve_count && status == QM_OK; i++) {
        size_t side_count = 0;
        for (size_t p = 0; p < layout->patch_count; p++)
            for (int side = 0; side < 4; side++)
                side_count += layout->patches[p].side[side] == i;
        if (side_count > 2)
            status = qm_context_fail(ctx, QM_E_LAYOUT, "curve %u is a side of more than two patches",
                                     layout->curves[i].id);
    }
    return status;
}

qm_status qm_layout_validate(qm_context *ctx, const qm_layout *layout, double diagonal,
                             const qm_ref_surface *surface)
{
    qm_status status = qm_layout_validate_patches(ctx, layout, diagonal);
    return status == QM_OK ? check_crossings(ctx, layout, surface) : status;
}
