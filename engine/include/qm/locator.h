/**
 * locator.h: accelerators of nearest-point searches: the box tree, or a structure built over it.
 *
 * All accelerators give equal results; they differ in the cost of building and of searching.
 */
#ifndef QM_LOCATOR_H
#define QM_LOCATOR_H

#include "qm/grid.h"
#include "qm/tetra.h"

typedef enum qm_accelerator {
    QM_ACCELERATOR_AUTO,  /* the fastest one in measurements: the boxes */
    QM_ACCELERATOR_BOXES, /* the box tree itself: nothing to build */
    QM_ACCELERATOR_TETRA, /* offset tetrahedra over the regular patches: cheap to refit after a deformation */
    QM_ACCELERATOR_GRID,  /* a uniform grid: fast for points very near the surface, slow for far ones */
    QM_ACCELERATOR_COUNT
} qm_accelerator;

/** An accelerator that is ready to search. Searches only read it, so any number of calls may use it at once.
 */
typedef struct qm_locator {
    const qm_bvh *bvh;
    qm_grid *grid;         /* searched when not NULL */
    const qm_tetra *tetra; /* searched when not NULL; with neither, bvh is searched */
    qm_tetra *own_tetra;   /* tetra, when the locator built it over own_patches */
    qm_patch_set own_patches;
} qm_locator;

/**
 * Builds a locator.
 *
 * bvh    was built with QM_BVH_TARGET
 * tetra  a hierarchy over bvh, for QM_ACCELERATOR_TETRA; NULL: the call builds one
 *
 * Ownership: borrows tree and hierarchy, which must outlive the locator unchanged; *out is the caller's, for
 *            qm_locator_reset.
 * Returns:   QM_OK; QM_E_ARGUMENT (the tree is no target; unknown accelerator); QM_E_UNSUPPORTED (tetra over
 *            a point set); QM_E_NO_MEMORY; QM_E_CANCELED. After an error *out is empty.
 */
qm_status qm_locator_build(qm_context *ctx, const qm_bvh *bvh, const qm_tetra *tetra,
                           qm_accelerator accelerator, qm_locator *out);

/** Frees the structures that the locator built, with the allocator that built them. */
void qm_locator_reset(qm_context *ctx, qm_locator *locator);

#endif
