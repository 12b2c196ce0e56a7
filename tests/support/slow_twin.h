/**
 * slow_twin.h: the engine's questions answered again by the plainest means that are still certain, to check
 * the engine against. Nothing here shares code or formulas with the engine; everything is computed in long
 * double (in 113 bits where a thin triangle needs it), so its own rounding is far below any requested tolerance
 * for. Small meshes only. Running out of memory ends the test program.
 */
#ifndef QM_SLOW_TWIN_H
#define QM_SLOW_TWIN_H

#include "qm/hausdorff.h"
#include "random.h"

/** An interval that holds the true value. */
typedef struct qm_slow_bracket {
    double lower, upper;
    bool finished; /* upper - lower is at most the requested eps; otherwise a limit of work ended it */
} qm_slow_bracket;

/** Distance from a point to a triangle, which may be a segment or a point. */
double qm_slow_triangle_distance(const double p[3], const double a[3], const double b[3], const double c[3]);

/** True only when the triangle is farther from p than distance: what a search for the nearest need not measure. */
bool qm_slow_triangle_is_beyond(const double p[3], const double corner[3][3], double distance);

/** Distance from a point to the bilinear patch with corners c0 c1 c2 c3 (mesh.h). */
qm_slow_bracket qm_slow_patch_distance(const double p[3], const double corners[4][3], double eps);

/** Distance from a point to one face, or to one vertex of a point set. */
qm_slow_bracket qm_slow_face_distance(const qm_mesh *mesh, size_t face, qm_quad_reading reading,
                                      const double p[3], double eps);

/** True when the face is surely within reach of p; false when it is surely beyond, or so by less than 1e-9 of
 * reach. */
bool qm_slow_face_within(const qm_mesh *mesh, size_t face, qm_quad_reading reading, const double p[3],
                         double reach);

/** Distance from a point to the whole surface: the least over all faces. */
qm_slow_bracket qm_slow_distance(const qm_mesh *mesh, qm_quad_reading reading, const double p[3], double eps);

/** The point of a face at parameters u, v, by the definition in mesh.h. */
void qm_slow_position(const qm_mesh *mesh, size_t face, qm_quad_reading reading, const double uv[2],
                      double out[3]);

/**
 * Hausdorff distance by subdividing the source until eps is reached or cell_limit cells have been made. The
 * bracket holds in any case. Unused vertices are no part of a surface; both meshes have at least one face or
 * are point sets with at least one point.
 */
qm_slow_bracket qm_slow_hausdorff(const qm_mesh *a, const qm_mesh *b, qm_direction direction,
                                  qm_quad_reading reading, double eps, size_t cell_limit);

/**
 * count points of the surface, row by row in out: spread over the faces by area, random within a face, in
 * the order of the faces.
 */
void qm_slow_sample(const qm_mesh *mesh, qm_quad_reading reading, qm_random *random, size_t count,
                    double *out);

#endif
