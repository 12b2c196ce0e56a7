#include "qm/locator.h"

#include "bvh_tree.h"

qm_status qm_locator_build(qm_context *ctx, const qm_bvh *bvh, qm_accelerator accelerator, qm_locator *out)
{
    *out = (qm_locator){0};
    if (!bvh->packs)
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
        status = qm_patch_set_find(ctx, &bvh->mesh, &locator.patches);
        if (status == QM_OK) status = qm_tetra_build(ctx, bvh, &locator.patches, &locator.tetra);
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
    qm_tetra_destroy(ctx, locator->tetra);
    qm_patch_set_reset(ctx, &locator->patches);
    *locator = (qm_locator){0};
}
