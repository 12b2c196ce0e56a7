/**
 * tmesh_route.h: the curves of a layout as paths on the surface that cannot meet.
 *
 * Where drawn curves still cross after all mending, they are laid anew, one after the other, each through triangles of the surface that
 * no curve cuts off: from node to node, between those of its neighbours round the node that lie already. The edges that it passes are
 * divided, so that it is a path of edges, and there is room for the next one beside it. The curves of a spanning tree go first, as they
 * divide nothing; then those, two for each handle, that are neither of it nor of a tree of the faces, along paths that divide nothing
 * (tmesh_route_handle.c); those of the tree of the faces last, each of which divides a disc in two. So there is always a path, where the layout has
 * the shape of the surface. Then each curve becomes the straight line in a chart of its two faces, which the others bound.
 *
 * Source: Kraevoy, Sheffer, Cross-parameterization and compatible remeshing of 3D models, 2004; Tutte, How to draw a graph, 1963.
 */
#ifndef QM_TMESH_ROUTE_H
#define QM_TMESH_ROUTE_H

#include "qm/layout.h"
#include "tmesh/tmesh.h"

/**
 * Lays the curves of a layout.
 *
 * layout    the order of its curves round its nodes, by its patches; its ids number its curves
 * is_fixed  by node: it stays where it is
 * is_line   by curve: it runs along a feature, and stays as it is laid
 * guides    by curve: about where it shall be, from node to node
 * grids     of its patches (QM_LAYOUT_GRID); those of the new layout, when it is made
 * out       empty; the same layout with other curves; the caller's, also after an error
 *
 * Returns: QM_OK, with *is_made false, *out empty and the grids as before where a curve finds no path, or paths wind round each other without end; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_tmesh_route(qm_arena *arena, const qm_tmesh_triangles *triangles, const qm_layout *layout,
                         const bool *is_fixed, const bool *is_line, const qm_tmesh_guides *guides,
                         double *grids, qm_layout *out, bool *is_made);

#endif
