/**
 * cloud.h: a mesh of triangles from a point set, for all that needs a surface with faces.
 */
#ifndef QM_CLOUD_H
#define QM_CLOUD_H

#include "qm/source.h"

typedef struct qm_cloud_options {
    double
        noise_share; /* of the diagonal, as of a reconstruction: below 0 it is found from the points, 0: they are exact */
    int thread_count; /* 1 or more; the result does not depend on it */
} qm_cloud_options;

/** -1, 1. */
qm_cloud_options qm_cloud_options_default(void);

/** What was found of the points, and what was made of them. */
typedef struct qm_cloud_record {
    size_t points;   /* of different places, without outliers */
    size_t outliers; /* points that are not of the surface */
    double noise;    /* standard deviation of the points from the surface, in their unit; 0: they are exact */
    double spacing;  /* the median distance between neighbours, about, in their unit */
    bool has_own_normals; /* the points' normals agree and were used; else normals were estimated */
    size_t components;
    size_t holes_filled; /* places without points that the surface spans */
    double filled_share; /* of the area, that is there */
    double
        thin_share; /* of the points, whose normals the surface does not have: their walls are too near, and may be lost */
    size_t borders; /* closed lines at which the surface ends, as the points do */
} qm_cloud_record;

/**
 * Makes a mesh of triangles of a point set: a smooth signed distance is fitted to the points and their normals, on a grid that is as fine
 * as they are dense, and its zeros are moved onto the surface of the nearest points (moving least squares). The surface is closed where
 * points are or holes are small, and ends where points end. Triangles look as the normals do; outward where these were estimated and
 * the surface is closed. Every edge has at most two triangles.
 *
 * cloud   a point set
 * record  may be NULL
 *
 * Ownership: *out is the caller's, for qm_mesh_reset; empty after an error.
 * Returns:   QM_OK; QM_E_ARGUMENT (not a point set); QM_E_EMPTY (too few points, or none with a plane through its neighbours: points
 *            of a line); QM_E_NO_MEMORY; QM_E_CANCELED.
 * Source:    F. Calakli, G. Taubin, SSD: smooth signed distance surface reconstruction, 2011; H. Hoppe, T. DeRose, T. Duchamp, J.
 *            McDonald, W. Stuetzle, Surface reconstruction from unorganized points, 1992 (orientation).
 */
qm_status qm_cloud_make_surface(qm_context *ctx, const qm_ref_surface *cloud, const qm_cloud_options *options,
                                qm_mesh *out, qm_cloud_record *record);

#endif
