/**
 * nearest.h: the searches of a kernel, in whatever a locator stands for. See kernel.h for what they promise.
 */
#ifndef QM_NEAREST_H
#define QM_NEAREST_H

#include "kernel.h"
#include "qm/locator.h"

static inline void qm_nearest_triangle(const qm_kernel *kernel, const qm_locator *locator, qm_vec p,
                                       qm_hit *hit)
{
    if (locator->grid)
        kernel->grid_closest(locator->grid, p, hit);
    else if (locator->tetra)
        kernel->tetra_closest(locator->tetra, p, hit);
    else
        kernel->closest(locator->bvh, p, hit);
}

static inline void qm_nearest_patch(const qm_kernel *kernel, const qm_locator *locator, qm_vec p,
                                    uint32_t start, double error, qm_bilinear_hit *hit)
{
    if (locator->grid)
        kernel->grid_closest_patch(locator->grid, p, start, error, hit);
    else if (locator->tetra)
        kernel->tetra_closest_patch(locator->tetra, p, start, error, hit);
    else
        kernel->closest_patch(locator->bvh, p, start, error, hit);
}

static inline void qm_nearest_ties(const qm_kernel *kernel, const qm_locator *locator, qm_vec p,
                                   uint32_t start, qm_ties *ties)
{
    if (locator->grid)
        kernel->grid_closest_ties(locator->grid, p, start, ties);
    else if (locator->tetra)
        kernel->tetra_closest_ties(locator->tetra, p, start, ties);
    else
        kernel->closest_ties(locator->bvh, p, start, ties);
}

#endif
