/**
 * symmetric_layout.c: automatic layouts, on both sides of a plane of symmetry where that is wished.
 */
#include "symmetric_layout.h"

#include <string.h>

#include "qm/symmetry.h"

/** Sets the plane of a wish to the best one that is found. */
static qm_status find_plane(qm_context *ctx, const qm_ref_surface *surface, qm_symmetry_wish *wish)
{
    qm_symmetry_plane plane[QM_SYMMETRY_PLANES];
    size_t count;
    qm_status status = qm_symmetry_find(ctx, surface, QM_SYMMETRY_SHARE, plane, &count);
    if (status != QM_OK) return status;
    if (count == 0)
        return qm_context_fail(
            ctx, QM_E_ARGUMENT,
            "the surface is not its own mirror image at any plane, to a hundredth of its size");
    memcpy(wish->point, plane[0].point, sizeof wish->point);
    memcpy(wish->normal, plane[0].normal, sizeof wish->normal);
    return QM_OK;
}

qm_status qm_symmetric_layout_make(qm_context *ctx, const qm_ref_surface *surface, qm_symmetry_wish *wish,
                                   const qm_quads_options *quads, const qm_quad_layout_options *options,
                                   qm_layout *out, qm_layout_issues *issues, qm_quad_layout_facts *facts)
{
    *out = (qm_layout){0};
    *issues = (qm_layout_issues){0};
    qm_status status = wish->finds ? find_plane(ctx, surface, wish) : QM_OK;
    if (status != QM_OK) return status;
    return wish->finds || wish->is_given
               ? qm_quad_layout_make_symmetric(ctx, surface, wish->point, wish->normal, quads, options, out,
                                               issues, facts)
               : qm_quad_layout_make_of_surface(ctx, surface, quads, NULL, options, out, issues, facts, NULL);
}
