/**
 * ref_samples.h: samples of a mesh, in proportion to area.
 */
#ifndef QM_REF_SAMPLES_H
#define QM_REF_SAMPLES_H

#include "qm/mesh.h"

/**
 * Takes samples at equal steps of the cumulative area: each face gets samples in proportion to its area.
 *
 * positions  count rows of x y z
 * normals    count rows of x y z, of the faces; NULL: not wanted
 *
 * Returns the number of samples: count, or one less for the roundings of the area.
 */
size_t qm_ref_surface_sample(const qm_mesh *mesh, size_t count, double *positions, float *normals);

#endif
