/**
 * quality.h: shape measures of the quads of a mesh.
 */
#ifndef QM_QUALITY_H
#define QM_QUALITY_H

#include "qm/mesh.h"

/** Measures over the quads of a mesh; triangles do not count. All zero when there is no quad. */
typedef struct qm_quality {
    size_t quads;
    size_t folded; /* quads with a corner whose sine is not above 0 */
    size_t turned; /* inverted: three or more neighbours in their grid of the mesh face away; 0 without */
    double least_jacobian; /* minimum scaled Jacobian: sine at a corner, seen along the normal; 1 is best */
    double mean_angle, max_angle;           /* differences of the corners' angles from 90, in degrees */
    double mean_edge_ratio, max_edge_ratio; /* of the longest edge of a quad to its shortest; 1 is best */
    double mean_warp, max_warp; /* distance between the diagonals over their mean length; 0 is planar */
} qm_quality;

/** Edge ratios are cut off here. */
#define QM_QUALITY_MAX_RATIO 1e9

/**
 * Measures the quads of a valid mesh. A quad with two coincident corners counts as folded, with the ratio
 * QM_QUALITY_MAX_RATIO.
 *
 * Source: scaled Jacobian: P. Knupp, Algebraic mesh quality metrics, 2001.
 */
void qm_quality_measure(const qm_mesh *mesh, qm_quality *out);

#endif
