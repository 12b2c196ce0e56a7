/**
 * quality.h: the shape of the quads of a mesh.
 */
#ifndef QM_QUALITY_H
#define QM_QUALITY_H

#include "qm/mesh.h"

/** Over the quads of a mesh; triangles do not count. All zero when there is no quad. */
typedef struct qm_quality {
    size_t quads, folded; /* folded: with a corner whose sine is not above 0 */
    size_t turned; /* that look away from three or more of those beside them in their grid of the mesh; 0
                      without grids */
    double least_jacobian; /* scaled: the least sine at a corner, seen along its quad's normal; 1 is best */
    double mean_angle, max_angle;           /* how far the corners' angles are from 90 degrees, in degrees */
    double mean_edge_ratio, max_edge_ratio; /* of the longest edge of a quad to its shortest; 1 is best */
    double mean_warp,
        max_warp; /* distance between the diagonals, as a share of their mean length; 0 is planar */
} qm_quality;

/**
 * Measures the quads. The mesh is valid. A quad with two corners in one place counts as folded, its ratio of
 * edges as QM_QUALITY_MOST_RATIO, which no ratio exceeds.
 */
#define QM_QUALITY_MOST_RATIO 1e9
void qm_quality_measure(const qm_mesh *mesh, qm_quality *out);

#endif
