/**
 * measured.h: the engine's Hausdorff distance of two meshes in one call, trees and context included.
 */
#ifndef QM_MEASURED_H
#define QM_MEASURED_H

#include "qm/hausdorff.h"

/** The greatest coordinate of both meshes, by absolute value. */
double qm_measured_size(const qm_mesh *a, const qm_mesh *b);

/** Measures on malloc, with real threads when more than one is requested; an error fails the test. */
qm_hausdorff_result qm_measured(const qm_mesh *a, const qm_mesh *b, const qm_hausdorff_options *options);

#endif
