/**
 * quad_topology.h: what a mesh of quads is, by the definitions: made without the engine's code.
 */
#ifndef QM_TEST_QUAD_TOPOLOGY_H
#define QM_TEST_QUAD_TOPOLOGY_H

#include "qm/mesh.h"

typedef struct qm_topology {
    ptrdiff_t euler;
    size_t components, boundary_edges, irregular;
    bool is_manifold, is_oriented, is_all_quads;
} qm_topology;

/** A vertex without a face, or a corner that is no vertex, ends the test. */
qm_topology qm_topology_find(const qm_mesh *m);

/** Quads whose least sine at a corner, seen along the cross product of the diagonals, is not above 0. */
size_t qm_topology_count_folded(const qm_mesh *m);

/** The least scaled Jacobian of all quads; -1 if a side has no length. */
double qm_topology_least_sine(const qm_mesh *m);

#endif
