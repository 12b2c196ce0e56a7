/**
 * cloud_points.h: the points that a surface is known by, with what is off it.
 *
 *   cloud_noise.c      the noise of points, and outliers among them
 *   cloud_guide.c      a smooth surface through noisy points, that lattices are made on
 */
#ifndef QM_CLOUD_POINTS_H
#define QM_CLOUD_POINTS_H

#include "qm/source.h"

typedef struct qm_noise_points {
    size_t count, capacity;
    double *positions; /* rows of x y z */
    float *normals;    /* rows of x y z of any length, or NULL */
} qm_noise_points;

void qm_noise_points_reset(qm_context *ctx, qm_noise_points *points);

/** Chooses about `wanted` points by a hash of their index, or all where there are no more. normals may be NULL. *out is the
 * caller's, for qm_noise_points_reset. QM_OK or QM_E_NO_MEMORY. */
qm_status qm_noise_points_thin(qm_context *ctx, const double *positions, const float *normals, size_t count,
                               size_t wanted, qm_noise_points *out);

/** Drops the marked points. */
void qm_noise_points_drop(qm_noise_points *points, const bool *is_marked);

/** Builds a tree to search for the points' neighbours. It borrows them. */
qm_status qm_noise_points_build_tree(qm_context *ctx, const qm_noise_points *points, int thread_count,
                                     qm_bvh **out);

/** True if the normals of most neighbours agree, so that they tell sides. Those that are opposed do where they lie behind each other as the
 * two walls of a sheet, or of a gap, do, and not beside each other as normals of random signs. */
bool qm_noise_points_have_sides(const qm_noise_points *points, const qm_bvh *tree);

/** The standard deviation of the points from their surface, in their unit; 0 where they are exact, or where noise cannot be told
 * from shape. QM_OK; QM_E_NO_MEMORY; QM_E_CANCELED. */
qm_status qm_noise_estimate(qm_context *ctx, const qm_noise_points *points, double diagonal, int thread_count,
                            double *sigma);

/** True if the neighbours of most points lie on a line. */
bool qm_noise_are_lines(const qm_noise_points *points, const qm_bvh *tree);

/** The median distance of points from polynomials over their neighbours, in their unit and to the radius: with noise as wide as their
 * spacing, or for points that fill space, 0.4. False where most neighbours define no plane. */
bool qm_noise_probe(const qm_noise_points *points, const qm_bvh *tree, double *residual, double *flatness);

/** The standard deviation of the points' normals, in radians along each tangent; their signs do not matter. QM_OK; QM_E_NO_MEMORY;
 * QM_E_CANCELED. */
qm_status qm_noise_estimate_turn(qm_context *ctx, const qm_noise_points *points, int thread_count,
                                 double *turn);

/** Of the distance of an outlier from its neighbours to theirs: so sure that the points that are left out can be told. */
#define QM_OUTLIER_RATIO 3.0

/** Marks the points that do not belong to the surface of the others, which have noise sigma. QM_OK; QM_E_NO_MEMORY;
 * QM_E_CANCELED. */
qm_status qm_noise_find_outliers(qm_context *ctx, const qm_noise_points *points, double sigma, double ratio,
                                 int thread_count, bool *is_outlier, size_t *count);

/** True if a position is farther from all points of a tree than these are from each other there. */
bool qm_cloud_is_in_gap(const qm_bvh *tree, const double position[3]);

/** A smooth surface that stands for noisy points. */
typedef struct qm_guide qm_guide;

/**
 * Finds the noise and the outliers of a surface. Where there is noise, *out is a guide with one reference for
 * qm_guide_release, else NULL.
 *
 * share  as the option noise_share of a reconstruction
 * outliers  becomes the share of the points of a point set that are outliers
 */
qm_status qm_guide_create(qm_context *ctx, const qm_ref_surface *surface, double share, int thread_count,
                          qm_guide **out, double *outliers);
qm_guide *qm_guide_keep(qm_guide *guide);
void qm_guide_release(qm_context *ctx, qm_guide *guide);

const qm_ref_surface *qm_guide_surface(const qm_guide *guide);

/** The points, with their noise but without outliers; the noise in their unit, and that of their normals in radians, 0 if these are
 * unknown or follow from the points. */
const qm_noise_points *qm_guide_points(const qm_guide *guide, double *sigma, double *turn);

#endif
