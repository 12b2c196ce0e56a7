#include "layout_work.h"

#include <string.h>

enum { ROW = 3 * sizeof(double) };

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
    for (size_t i = 0; i < layout->curve_count; i++)
        qm_context_free(ctx, layout->curves[i].points, layout->curves[i].point_count, ROW);
    qm_context_free(ctx, layout->curves, layout->curve_count, sizeof *layout->curves);
    qm_context_free(ctx, layout->nodes, layout->node_count, ROW);
    qm_layout_clear_patches(ctx, layout);
    *layout = (qm_layout){0};
}

qm_status qm_layout_add_node(qm_context *ctx, qm_layout *layout, const double position[3])
{
    double *nodes = qm_context_resize(ctx, layout->nodes, layout->node_count, layout->node_count + 1, ROW);
    if (!nodes) return no_memory(ctx);
    layout->nodes = nodes;
    memcpy(nodes + 3 * layout->node_count++, position, ROW);
    return QM_OK;
}

/** Adds a curve with a copy of its points; the id and ends are the caller's to set. */
static qm_status append_curve(qm_context *ctx, qm_layout *layout, const double *points, size_t point_count)
{
    double *copy = qm_context_alloc(ctx, point_count, ROW);
    if (!copy) return no_memory(ctx);
    qm_curve *curves = qm_context_resize(ctx, layout->curves, layout->curve_count, layout->curve_count + 1,
                                         sizeof *layout->curves);
    if (!curves) {
        qm_context_free(ctx, copy, point_count, ROW);
        return no_memory(ctx);
    }
    memcpy(copy, points, point_count * ROW);
    layout->curves = curves;
    curves[layout->curve_count++] = (qm_curve){.points = copy, .point_count = point_count};
    return QM_OK;
}

qm_status qm_layout_add_curve(qm_context *ctx, qm_layout *layout, uint32_t from, uint32_t to,
                              const double *points, size_t point_count)
{
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
    memcpy(curve->points, layout->nodes + 3 * (size_t)from, ROW);
    memcpy(curve->points + 3 * (point_count - 1), layout->nodes + 3 * (size_t)to, ROW);
    return QM_OK;
}

static qm_status copy_into(qm_context *ctx, const qm_layout *layout, qm_layout *out)
{
    if (layout->node_count > 0 && !(out->nodes = qm_context_alloc(ctx, layout->node_count, ROW)))
        return no_memory(ctx);
    out->node_count = layout->node_count;
    if (out->node_count > 0) memcpy(out->nodes, layout->nodes, layout->node_count * ROW);
    for (size_t i = 0; i < layout->curve_count; i++) {
        const qm_curve *curve = &layout->curves[i];
        qm_status status = append_curve(ctx, out, curve->points, curve->point_count);
        if (status != QM_OK) return status;
        out->curves[i].id = curve->id;
        out->curves[i].from = curve->from;
        out->curves[i].to = curve->to;
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
    *out = (qm_layout){.next_id = layout->next_id};
    qm_status status = copy_into(ctx, layout, out);
    if (status != QM_OK) qm_layout_reset(ctx, out);
    return status;
}

uint32_t qm_layout_find_curve(const qm_layout *layout, uint32_t id)
{
    for (size_t i = 0; i < layout->curve_count; i++)
        if (layout->curves[i].id == id) return (uint32_t)i;
    return QM_NO_INDEX;
}

/** Follows the four curves round from one end of the first. False with the side that does not go on. */
static bool follow_sides(const qm_layout *layout, qm_layout_patch *patch, bool first_against, int *broken)
{
    const qm_curve *first = &layout->curves[patch->side[0]];
    uint32_t start = first_against ? first->to : first->from, at = first_against ? first->from : first->to;
    patch->against[0] = first_against;
    for (int side = 1; side < 4; side++) {
        const qm_curve *curve = &layout->curves[patch->side[side]];
        *broken = side;
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
            return qm_context_fail(ctx, QM_E_ARGUMENT, "patch %zu names curve %u, which is not there",
                                   layout->patch_count, id[side]);
    }
    int broken, broken_against;
    if (!follow_sides(layout, &patch, false, &broken) &&
        !follow_sides(layout, &patch, true, &broken_against)) {
        int side = broken > broken_against ? broken : broken_against;
        return qm_context_fail(ctx, QM_E_ARGUMENT, "patch %zu does not close at its side %d, curve %u",
                               layout->patch_count, side, id[side]);
    }
    return qm_layout_append_patch(ctx, layout, &patch);
}

double qm_curve_length(const qm_curve *curve)
{
    double length = 0.0;
    for (size_t i = 1; i < curve->point_count; i++)
        length += qm_vec_distance(qm_vec_load(curve->points + 3 * i), qm_vec_load(curve->points + 3 * i - 3));
    return length;
}
