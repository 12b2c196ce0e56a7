/**
 * source.h: the reference surface of a layout and of a reconstruction: a mesh, or a point set as samples of a
 * surface.
 */
#ifndef QM_SOURCE_H
#define QM_SOURCE_H

#include "qm/bvh.h"

/** A reference surface. Calls only read it, so any number of them may use it at once. */
typedef struct qm_ref_surface {
    const qm_bvh *bvh;
    bool is_cloud;
    double diagonal; /* of the surface's box */
} qm_ref_surface;

/**
 * Makes a reference surface of a mesh or point set.
 *
 * bvh  was built with QM_BVH_TARGET
 *
 * Ownership: borrows the tree, which must outlive it.
 * Returns:   QM_OK; QM_E_ARGUMENT (no target); QM_E_EMPTY (the surface has no extent); QM_E_SCALE (its coordinates are beyond
 *            2^310, or its diagonal below the inverse).
 */
qm_status qm_ref_surface_init(qm_context *ctx, const qm_bvh *bvh, qm_ref_surface *out);

/** A point of the surface. */
typedef struct qm_ref_surface_point {
    double position[3];
    double normal
        [3]; /* of length 1; of the face on a mesh; without orientation on a point set; 0 when undefined */
    double distance; /* from the projected point */
    double spacing;  /* on a point set: largest distance of the fitted points from position; on a mesh 0 */
} qm_ref_surface_point;

/**
 * Projects a point onto the surface: on a mesh to the nearest point, on a point set to a quadratic surface
 * fitted to the points around (moving least squares), which follows curvature between the points and averages
 * noise.
 *
 * p  x y z, finite, in the frame of the surface
 *
 * Source: Levin, Mesh-independent surface interpolation, 2003 (one step of the projection).
 */
void qm_ref_surface_project(const qm_ref_surface *source, const double p[3], qm_ref_surface_point *out);

/**
 * As qm_ref_surface_project, onto the wall that looks one way: of a mesh the faces whose normals are within a right
 * angle of a direction, of a point set with normals the points whose normals are within 78 degrees of it, if there are
 * several walls. So a point between two walls, or off a thin one, comes to the wall that it belongs to.
 *
 * direction  of any length above 0
 * reach      above 0, in the unit of the surface
 *
 * Returns: true; false where no such wall is within reach, and on a point set without normals: *out is then the
 *          projection of qm_ref_surface_project.
 */
bool qm_ref_surface_project_toward(const qm_ref_surface *source, const double p[3], const double direction[3],
                                   double reach, qm_ref_surface_point *out);

/**
 * As qm_ref_surface_project, for a point of a curve. On a point set with normals it keeps sharp edges and corners: a
 * point within their spacing and a reach of one comes to it, where the smooth surface would be rounded off. Of two
 * walls the nearer one counts.
 *
 * reach  0 or more, in the unit of the surface
 */
void qm_ref_surface_project_curve(const qm_ref_surface *source, const double p[3], double reach,
                                  qm_ref_surface_point *out);

/**
 * True if two points of a surface lie on walls that look away from or at each other, as those of a thin sheet or of
 * a gap. False where normals are unknown.
 */
bool qm_ref_surface_is_between_walls(const qm_ref_surface *source, const double a[3], const double b[3]);

/**
 * True if a mesh connects the nearest points of it to a and to b within a ball: over sides and corners that triangles have in
 * common, by their places. Sheets that touch, meet or pass through each other there without such are apart. True also where
 * more triangles are in the ball than are looked at.
 *
 * source  a mesh
 * middle, reach  of the ball, which holds a and b
 */
bool qm_ref_surface_connects(const qm_ref_surface *source, const double a[3], const double b[3],
                             const double middle[3], double reach);

/**
 * True if the nearest point of a mesh to p lies on its boundary: on a side that no other triangle has, by the places of its ends.
 * False where more triangles meet there than are looked at.
 *
 * source  a mesh
 */
bool qm_ref_surface_ends_at(const qm_ref_surface *source, const double p[3]);

/**
 * Radius of the discs that draw the points of a set: 0.15 (V / n)^(1/3), where V is the volume of its box,
 * whose thin sides count as a hundredth of its diagonal. 0 for a mesh.
 *
 * Source: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh, section 6.1.1.
 */
double qm_ref_surface_disc_radius(const qm_mesh *mesh);

/**
 * Estimates the normals of a point set: of the plane through the neighbours of each point, oriented
 * consistently in each connected component; the highest point of a component along z is oriented towards +z.
 *
 * normals  the caller's, a row of x y z for each vertex; 0 0 0 where the neighbours lie on a line
 *
 * Returns: QM_OK; QM_E_ARGUMENT (not a point set); QM_E_NO_MEMORY; QM_E_CANCELED.
 * Source: Hoppe, DeRose, Duchamp, McDonald, Stuetzle, Surface reconstruction from unorganized points, 1992.
 */
qm_status qm_ref_surface_estimate_normals(qm_context *ctx, const qm_ref_surface *source, double *normals);

#endif
