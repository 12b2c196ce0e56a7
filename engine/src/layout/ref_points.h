/**
 * ref_points.h: projection onto the surface of given points, for those who choose the points.
 */
#ifndef QM_REF_POINTS_H
#define QM_REF_POINTS_H

#include "bvh/nearest.h"
#include "qm/source.h"

#define QM_FIT_POINTS 20 /* neighbours that a polynomial of second order is fitted to: it has six unknowns */

/** A point in the local frame: finite, and no farther away than 2^40 sizes of the surface. */
qm_vec qm_ref_surface_local(const qm_ref_surface *surface, const double p[3]);

/** Projects p, local, onto the surface through points near it, one at least. */
void qm_ref_surface_project_to_points(const qm_ref_surface *surface, qm_vec p, const qm_nearest_points *near,
                                      qm_ref_surface_point *out);

/** Sets a projection of p from a position and a normal, all local. */
void qm_ref_surface_set_point(const qm_ref_surface *surface, qm_vec p, qm_vec at, qm_vec normal,
                              qm_ref_surface_point *out);

#endif
