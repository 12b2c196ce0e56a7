/**
 * features.h: the creases and boundaries of a mesh, as a graph of its edges.
 */
#ifndef QM_FEATURES_H
#define QM_FEATURES_H

#include "qm/mesh.h"

typedef struct qm_features_options {
    double angle; /* degrees, above 0 up to 180: an edge whose faces differ by more is a crease */
    double
        shortest; /* above 0, in the unit of the mesh: connected features that are shorter together are left out */
    const double *box; /* NULL, or least x y z and greatest x y z: edges beside it are left out */
} qm_features_options;

/** Distinct positions and edges between them. All zero is an empty graph. */
typedef struct qm_features {
    double *points; /* rows of x y z, as in the mesh */
    size_t point_count;
    uint32_t (*edges)[2]; /* indices of points; none is there twice */
    double (*across)
        [3]; /* of each edge: the unit normal of the face on its left as it is seen from outside, less that
                             on its right; 0 0 0 of a boundary, of more than two faces, and of two oriented differently */
    size_t edge_count;
} qm_features;

/**
 * Finds the edges of a mesh where it has a crease, ends, or has more than two faces. Vertices at equal positions count as
 * one, and faces of opposite orientation as oriented alike: so a mesh whose faces have corners of their own, and one
 * that is not oriented, has no more features.
 *
 * So that a rough surface does not fill up with creases, an edge is one only if the faces within 0.23 of the shortest length
 * on both sides of it differ by the angle, too; branches with a loose end that are shorter than the shortest length are left out; and connected creases
 * stay only if together they are that long, and longer: by four times that for each end, loose or at a boundary, by half of it for
 * each bend, by one and a half for each meeting of three or more, and by half of it for each edge at whose ends the line turns by
 * more than 30 degrees to opposite sides: a crease that its mesh makes a staircase of is none.
 *
 * Ownership: *out is the caller's, for qm_features_reset. After an error it is empty.
 * Returns:   QM_OK; QM_E_ARGUMENT (an option); QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_features_find(qm_context *ctx, const qm_mesh *mesh, const qm_features_options *options,
                           qm_features *out);
void qm_features_reset(qm_context *ctx, qm_features *features);

#endif
