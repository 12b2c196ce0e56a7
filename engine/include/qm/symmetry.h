/**
 * symmetry.h: planes at which a surface is its own mirror image, nearly.
 */
#ifndef QM_SYMMETRY_H
#define QM_SYMMETRY_H

#include "qm/source.h"

#define QM_SYMMETRY_PLANES 3

typedef struct qm_symmetry_plane {
    double point[3], normal[3]; /* normal of length 1 */
    double lower,
        upper; /* of the Hausdorff distance between the surface and its mirror image, quads as triangles; of a point set
                            the greatest distance of a sample's image from the surface, twice */
} qm_symmetry_plane;

/**
 * Finds planes of symmetry: the principal planes of the surface and others through its centroid, each brought to where the mirror
 * images of samples lie nearest to the surface, and accepted if the distance is at most a share of the diagonal.
 *
 * share  above 0
 * out    receives up to QM_SYMMETRY_PLANES planes, the best first; count how many
 *
 * Returns: QM_OK; QM_E_ARGUMENT; QM_E_NO_MEMORY; QM_E_CANCELED.
 * Source: P. Besl, N. McKay, A method for registration of 3-D shapes, 1992, with a reflection in place of the motion.
 */
qm_status qm_symmetry_find(qm_context *ctx, const qm_ref_surface *surface, double share,
                           qm_symmetry_plane out[QM_SYMMETRY_PLANES], size_t *count);

#endif
