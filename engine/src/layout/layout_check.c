#include "layout_work.h"

#include <string.h>

#define NO_LENGTH 1e-9 /* of the diagonal: a shorter curve counts as none */

static qm_status check_curve(qm_context *ctx, const qm_layout *layout, const qm_curve *curve, double diagonal)
{
    for (size_t i = 0; i < 3 * curve->point_count; i++)
        if (!isfinite(curve->points[i]))
            return qm_context_fail(ctx, QM_E_NOT_FINITE, "point %zu of curve %u is not finite", i / 3,
                                   curve->id);
    const size_t bytes = 3 * sizeof(double);
    if (memcmp(curve->points, layout->nodes + 3 * (size_t)curve->from, bytes) != 0 ||
        memcmp(curve->points + 3 * (curve->point_count - 1), layout->nodes + 3 * (size_t)curve->to, bytes) !=
            0)
        return qm_context_fail(ctx, QM_E_LAYOUT, "curve %u does not end at its nodes", curve->id);
    if (!(qm_curve_length(curve) > NO_LENGTH * diagonal))
        return qm_context_fail(ctx, QM_E_LAYOUT, "curve %u has no length", curve->id);
    return QM_OK;
}

static qm_status check_patch(qm_context *ctx, const qm_layout *layout, size_t place)
{
    const qm_layout_patch *patch = &layout->patches[place];
    for (int side = 0; side < 4; side++) {
        const qm_curve *curve = &layout->curves[patch->side[side]];
        uint32_t end = patch->against[side] ? curve->from : curve->to;
        if (end != qm_layout_corner(layout, patch, (side + 1) % 4))
            return qm_context_fail(ctx, QM_E_LAYOUT, "patch %zu does not close at its side %d, curve %u",
                                   place, side, curve->id);
    }
    return QM_OK;
}

/** How many sides of patches a curve is. */
static size_t count_sides(const qm_layout *layout, size_t curve)
{
    size_t count = 0;
    for (size_t p = 0; p < layout->patch_count; p++)
        for (int side = 0; side < 4; side++)
            count += layout->patches[p].side[side] == curve;
    return count;
}

static qm_status check_crossings(qm_context *ctx, const qm_layout *layout)
{
    qm_layout_issues issues = {0};
    qm_status status = qm_layout_find_crossings(ctx, layout, &issues);
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

qm_status qm_layout_validate(qm_context *ctx, const qm_layout *layout, double diagonal)
{
    qm_status status = QM_OK;
    for (size_t i = 0; i < layout->curve_count && status == QM_OK; i++)
        status = check_curve(ctx, layout, &layout->curves[i], diagonal);
    for (size_t p = 0; p < layout->patch_count && status == QM_OK; p++)
        status = check_patch(ctx, layout, p);
    for (size_t i = 0; i < layout->curve_count && status == QM_OK; i++)
        if (count_sides(layout, i) > 2)
            status = qm_context_fail(ctx, QM_E_LAYOUT, "curve %u is a side of more than two patches",
                                     layout->curves[i].id);
    return status == QM_OK ? check_crossings(ctx, layout) : status;
}
