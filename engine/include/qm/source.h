/**
 * source.h: the surface that a layout is drawn on and a reconstruction is held against: a mesh, or a point
 * set read as samples of a surface.
 */
#ifndef QM_SOURCE_H
#define QM_SOURCE_H

#include "qm/bvh.h"

/** Only read while it is used, by any number of calls at once. */
typedef struct qm_source {
    const qm_bvh *bvh;
    bool is_cloud;
    double diagonal; /* of the surface's box */
} qm_source;

/**
 * Makes a source of a mesh or point set; the tree was built with QM_BVH_TARGET and outlives it.
 * Returns QM_OK; QM_E_ARGUMENT (no target); QM_E_EMPTY (the surface has no size).
 */
qm_status qm_source_init(qm_context *ctx, const qm_bvh *bvh, qm_source *out);

/** A place of the surface. */
typedef struct qm_foothold {
    double position[3];
    double normal[3]; /* of length 1; a face's own on a mesh; of no certain side on a point set; 0 where none
                         can be told */
    double distance;  /* from the point asked about */
    double spacing;   /* on a point set: how far the fitted points reach from the place; on a mesh 0 */
} qm_foothold;

/**
 * Pulls a point onto the surface. On a mesh it goes to the nearest point. On a point set it goes to a
 * surface of second order fitted to the points around (moving least squares): this follows curvature
 * between the points and takes noise away, where the nearest point would do neither.
 *
 * p is finite. Source: Levin, Mesh-independent surface interpolation, 2003 (one step of the projection).
 */
void qm_source_pull(const qm_source *source, const double p[3], qm_foothold *out);

/** Radius to draw the points of a set with as discs: 0.15 (V / n)^(1/3), V the volume of its box, whose
 * thin sides count as a hundredth of its diagonal. 0 for a mesh. Source: Kang, section 6.1.1. */
double qm_mesh_disc_radius(const qm_mesh *mesh);

/**
 * Normals of a point set: each that of the plane through its neighbours, all of a connected part on one side;
 * in each part the point highest along z looks up.
 *
 * normals   rows of x y z, one a vertex; 0 0 0 where the neighbours lie on a line
 *
 * Returns QM_OK; QM_E_ARGUMENT (not a point set); QM_E_NO_MEMORY; QM_E_CANCELED.
 * Source: Hoppe, DeRose, Duchamp, McDonald, Stuetzle, Surface reconstruction from unorganized points, 1992.
 */
qm_status qm_source_estimate_normals(qm_context *ctx, const qm_source *source, double *normals);

#endif
