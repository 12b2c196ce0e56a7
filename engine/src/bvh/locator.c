/**
 * locator.c: chooses the accelerator of nearest-point searches, and builds it: the tree's boxes, a uniform
 * grid, or offset tetrahedra.
 */
#include "qm/locator.h"

#include "bvh_tree.h"

qm_status qm_locator_build(qm_context *ctx, const qm_bvh *bvh, const qm_tetra *tetra,
                           qm_accelerator accelerator, qm_locator *out)
{
    *out = (qm_locator){0};
    if (!qm_bvh_is_target(bvh, QM_QUADS_TRIANGLES))
        return qm_context_fail(ctx, QM_E_ARGUMENT, "nearest points need a tree that is a target");
    qm_locator locator = {.bvh = bvh};
    qm_status status = QM_OK;
    switch (accelerator) {
    case QM_ACCELERATOR_AUTO:
    case QM_ACCELERATOR_BOXES:
        break;
    case QM_ACCELERATOR_GRID:
        status = qm_grid_build(ctx, bvh, &locator.grid);
        break;
    case QM_ACCELERATOR_TETRA:
        locator.tetra = tetra;
        if (tetra) break;
        status = qm_patch_set_find(ctx, &bvh->mesh, &locator.own_patches);
        if (status == QM_OK) status = qm_tetra_build(ctx, bvh, &locator.own_patches, &locator.own_tetra);
        locator.tetra = locator.own_tetra;
        break;
    default:
        return qm_context_fail(ctx, QM_E_ARGUMENT, "there is no accelerator %d", (int)accelerator);
    }
    if (status == QM_OK)
        *out = locator;
    else
        qm_locator_reset(ctx, &locator);
    return status;
}

void qm_locator_reset(qm_context *ctx, qm_locator *locator)
{
    qm_grid_destroy(ctx, locator->grid);
    qm_tetra_destroy(ctx, locator->own_tetra);
    qm_patch_set_reset(ctx, &locator->own_patches);
    *locator = (qm_locator){0};
}
