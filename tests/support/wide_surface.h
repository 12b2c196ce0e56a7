/**
 * wide_surface.h: a mesh in 113 bits, and certified distances to it. Shares no code or formula with the
 * engine.
 *
 * A surface is held in a frame of its own: moved by the first vertex and scaled by a power of two, both
 * without rounding worth a mention (2^-113 of a coordinate), so that it measures about 1 wherever its mesh
 * lies.
 */
#ifndef QM_WIDE_SURFACE_H
#define QM_WIDE_SURFACE_H

#include "qm/mesh.h"
#include "wide.h"

/** frame coordinate = scale * (coordinate - origin). */
typedef struct qm_wide_frame {
    qm_wide_vec origin;
    qm_wide scale; /* a power of two */
} qm_wide_frame;

/** A point, a triangle or a bilinear patch. A quad read as triangles is two facets of one face. */
typedef struct qm_wide_facet {
    int corner_count; /* 1, 3 or 4 */
    uint32_t face;    /* of the mesh */
    qm_wide_vec corner[4];
    qm_long_vec rounded[4]; /* the same corners in long double */
    qm_long_vec centre;     /* about */
    qm_long radius;         /* the facet lies within, roundings included */
    qm_wide size;           /* longest side or diagonal */
} qm_wide_facet;

typedef struct qm_wide_surface {
    qm_wide_facet *facets;
    size_t count;
} qm_wide_surface;

/** The frame in which both meshes (b may be NULL) lie within [-1, 1]^3. */
qm_wide_frame qm_wide_frame_make(const qm_mesh *a, const qm_mesh *b);

qm_wide_vec qm_wide_local(const qm_wide_frame *frame, const double p[3]);

/** Makes the surface; free it with qm_wide_surface_free. Running out of memory aborts. */
qm_wide_surface qm_wide_surface_make(const qm_wide_frame *frame, const qm_mesh *mesh,
                                     qm_quad_reading reading);
void qm_wide_surface_free(qm_wide_surface *surface);

/** The point of a facet at parameters in the sense of mesh.h (a patch's u, v; weights of corners 1 and 2). */
qm_wide_vec qm_wide_facet_at(const qm_wide_facet *facet, qm_wide u, qm_wide v);

/** An interval that holds a distance; upper is that of a point of the surface. */
typedef struct qm_wide_distance {
    qm_wide lower, upper;
    size_t facet; /* of the point */
    qm_wide uv[2];
} qm_wide_distance;

/** Distance to a facet. lower is at least the lesser of enough and upper - eps, but for folds at the limit of
 * 113 bits. */
qm_wide_distance qm_wide_facet_distance(const qm_wide_facet *facet, qm_wide_vec p, qm_wide eps,
                                        qm_wide enough);

/** Distance to the surface, to within eps. */
qm_wide_distance qm_wide_surface_distance(const qm_wide_surface *surface, qm_wide_vec p, qm_wide eps);

/**
 * A point of a facet that is near p, in long double: uv holds where to start and then where it lies. Returns
 * its distance, which is off by a few roundings of long double and so bounds the facet's from above, whatever
 * the search did.
 */
qm_long qm_wide_facet_near(const qm_wide_facet *facet, qm_long_vec p, qm_long uv[2]);

#endif
