/**
 * locator.h: what nearest points are searched with: the box tree, or something built over it.
 *
 * All accelerators give the same answers; they differ in what they cost to build and to ask.
 */
#ifndef QM_LOCATOR_H
#define QM_LOCATOR_H

#include "qm/grid.h"
#include "qm/tetra.h"

typedef enum qm_accelerator {
    QM_ACCELERATOR_AUTO,  /* what measures fastest: the boxes */
    QM_ACCELERATOR_BOXES, /* the box tree itself: nothing to build */
    QM_ACCELERATOR_TETRA, /* offset tetrahedra over the regular patches: cheap to refit after a deformation */
    QM_ACCELERATOR_GRID,  /* a uniform grid: good for points very near to the surface, slow for far ones */
    QM_ACCELERATOR_COUNT
} qm_accelerator;

/** One of the accelerators, ready to be asked. Only read while it is used, by any number of calls at once. */
typedef struct qm_locator {
    const qm_bvh *bvh;
    qm_grid *grid;         /* NULL, or what is searched */
    const qm_tetra *tetra; /* NULL, or what is searched; with neither it is the tree */
    qm_tetra *own_tetra;   /* the same when the locator built it, over patches of its own */
    qm_patch_set own_patches;
} qm_locator;

/**
 * Makes the locator that a choice stands for, over a tree that was built with QM_BVH_TARGET. tetra is a
 * hierarchy over the same tree when one is at hand; with NULL one is built where it is asked for.
 *
 * Ownership: borrows tree and hierarchy, which must outlive the locator unchanged; *out is the caller's, for
 * qm_locator_reset.
 * Returns:   QM_OK; QM_E_ARGUMENT (the tree is no target; no such accelerator); QM_E_UNSUPPORTED (tetra over
 * a point set); QM_E_NO_MEMORY; QM_E_CANCELED. After an error *out holds nothing.
 */
qm_status qm_locator_build(qm_context *ctx, const qm_bvh *bvh, const qm_tetra *tetra,
                           qm_accelerator accelerator, qm_locator *out);

/** Frees what the locator built, with the allocator that built it. The tree is left alone. */
void qm_locator_reset(qm_context *ctx, qm_locator *locator);

#endif
