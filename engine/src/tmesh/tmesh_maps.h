/**
 * tmesh_maps.h: maps of the patches of a layout onto the unit square, over the triangles of the surface.
 *
 * The curves are laid along those that were drawn, as paths that cannot meet (tmesh_route.h), so that each patch is a disc of triangles.
 * Its border goes to that of the square, by length, and its inside to means of neighbours, which does not fold. Where the square
 * gets too little of the surface, as the tip of an ear does, the links between neighbours become weaker, a few times.
 *
 * Source: Kraevoy, Sheffer, Cross-parameterization and compatible remeshing of 3D models, 2004; Tutte, How to draw a graph, 1963;
 *         Yoshizawa, Belyaev, Seidel, A fast and simple stretch-minimizing mesh parameterization, 2004.
 */
#ifndef QM_TMESH_MAPS_H
#define QM_TMESH_MAPS_H

#include "tmesh/tmesh.h"

typedef struct qm_tmesh_maps qm_tmesh_maps;

/**
 * Makes the maps of all patches.
 *
 * layout   its patches bound all of the surface, or all between its boundaries
 * guides   by curve: points along it, near the surface
 * is_rough by curve: its points leave the surface, and it is laid straight between the curves beside it; receives also which paths were too
 *          far from the points
 *
 * Ownership: *out is the caller's, for qm_tmesh_maps_destroy; NULL, without an error, where the curves are no such paths or a patch is no disc.
 * Returns:   QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED.
 */
qm_status qm_tmesh_maps_make(qm_context *ctx, const qm_ref_surface *surface, const qm_layout *layout,
                             const qm_tmesh_guides *guides, bool *is_rough, qm_tmesh_maps **out);
void qm_tmesh_maps_destroy(qm_context *ctx, qm_tmesh_maps *maps);

/**
 * Finds the point of the surface at a place of a patch.
 *
 * u, v      from 0 to 1: along side 0 and along side 1 of the patch
 * triangle  of a place near it, 0 at first; receives that of this place
 *
 * Returns: false outside the square, as far as rounding tells.
 */
bool qm_tmesh_maps_at(const qm_tmesh_maps *maps, size_t patch, double u, double v, uint32_t *triangle,
                      qm_vec *at);

/** The points of the path of a rough curve, rows of x y z; they are the maps'. */
const double *qm_tmesh_maps_path(const qm_tmesh_maps *maps, size_t curve, size_t *count);

#endif
