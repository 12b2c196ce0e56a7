/**
 * surface.h: footpoints on a surface, with face and parameters, from the packs and faces that searches find.
 */
#ifndef QM_SURFACE_H
#define QM_SURFACE_H

#include "bvh_tree.h"
#include "qm/project.h"

/** The footpoint of p (local frame of the tree) on one triangle lane. */
qm_surface_point qm_surface_triangle_foot(const qm_bvh *bvh, uint32_t pack, uint32_t lane, qm_vec p);

/** The footpoint of p (local) on a face, under the given reading; for quads certified to within error
 * (local). */
qm_surface_point qm_surface_face_foot(const qm_bvh *bvh, qm_quad_reading reading, uint32_t face, qm_vec p,
                                      double error);

/** The point of a quad, as a bilinear patch, with these parameters. */
qm_surface_point qm_surface_patch_point(const qm_bvh *bvh, uint32_t face, const double uv[2]);

#endif
