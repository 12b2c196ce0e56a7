/**
 * shapes.h: test meshes by formula.
 *
 * Every mesh is on malloc and is given back with qm_shape_free. Running out of memory ends the test program.
 */
#ifndef QM_SHAPES_H
#define QM_SHAPES_H

#include "qm/mesh.h"
#include "random.h"

void qm_shape_free(qm_mesh *mesh);

/** A mesh of these sizes; positions zero, faces unset. */
qm_mesh qm_shape_make(size_t vertex_count, size_t face_count);

/** Point of a surface at parameters u, v from 0 to 1. */
typedef void qm_shape_fn(const void *user, double u, double v, double out[3]);

/**
 * Quads over a function: columns along u, rows along v. A wrapped side joins its end to its start, and then
 * the function is not called at 1.
 */
qm_mesh qm_shape_grid(int columns, int rows, bool wrap_u, bool wrap_v, qm_shape_fn *at, const void *user);

/** Unit sphere of 100 x 48 quads without caps: latitudes pi i / 50, i = 1..49, longitudes turned by turn. */
qm_mesh qm_shape_sphere(double turn);

/** Torus round the z axis; the tube of radius minor runs at the distance major. */
qm_mesh qm_shape_torus(int columns, int rows, double major, double minor);

/** n x n quads on z = x y over [-1, 1]^2. */
qm_mesh qm_shape_saddle(int n);

/** A strip of length 4 and width 1 along x, twisted by this angle from end to end. */
qm_mesh qm_shape_strip(int columns, int rows, double twist);

/** n x n quads in the plane z = height over [0, 1]^2. */
qm_mesh qm_shape_plane(int n, double height);

/** n x n quads on waves of this height over [0, 1]^2, shifted by the angle turn. */
qm_mesh qm_shape_waves(int n, double height, double turn);

/** The six sides of [0, sx] x [0, sy] x [0, sz], eight shared corners; sz = 0 gives a flat box. */
qm_mesh qm_shape_box(double sx, double sy, double sz);

/** The cube from -half to half on each axis. */
qm_mesh qm_shape_cube(double half);

/** The surface of [-1, 1]^3 of n x n quads a side, with shared vertices; faces side by side, row by row. */
qm_mesh qm_shape_cube_grid(int n);

/** One face of its own corners: count is 3 or 4. */
qm_mesh qm_shape_face(int count, const double corners[][3]);

/** count points in [-1, 1]^3. */
qm_mesh qm_shape_points(qm_random *random, size_t count);

/** count copies of one triangle with shared corners. */
qm_mesh qm_shape_copies(size_t count);

typedef enum qm_soup_corners {
    QM_SOUP_TRIANGLES,
    QM_SOUP_QUADS,
    QM_SOUP_MIXED,
} qm_soup_corners;

/** How the faces of a soup lie. */
typedef enum qm_soup_style {
    QM_SOUP_APART,      /* faces with corners of their own */
    QM_SOUP_POOLED,     /* corners from a small pool: shared edges and corners, faces over each other */
    QM_SOUP_LATTICE,    /* pool of small whole numbers: ties, coplanar and coincident parts */
    QM_SOUP_COPLANAR,   /* pool in one plane */
    QM_SOUP_DEGENERATE, /* pool with collinear points; faces that repeat corners */
    QM_SOUP_NEEDLES,    /* very long and thin faces */
    QM_SOUP_STYLE_COUNT
} qm_soup_style;

/** A soup of face_count faces in about [-1, 1]^3. Apart quads have |w| of up to twist edge lengths. */
qm_mesh qm_shape_soup(qm_random *random, size_t face_count, qm_soup_corners corners, qm_soup_style style,
                      double twist);

qm_mesh qm_shape_copy(const qm_mesh *mesh);

/** The same surface from other arrays: the faces, or the points of a set, in reverse order. */
qm_mesh qm_shape_reversed(const qm_mesh *mesh);

/** Every quad cut into its two triangles. */
qm_mesh qm_shape_triangulated(const qm_mesh *mesh);

/** Every triangle of a mesh of triangles cut into four at its midpoints, which neighbours share. */
qm_mesh qm_shape_refined(const qm_mesh *mesh);

/** Both meshes as one. */
qm_mesh qm_shape_joined(const qm_mesh *a, const qm_mesh *b);

/** The mesh with unused vertices before and after its own. */
qm_mesh qm_shape_with_unused(const qm_mesh *mesh, size_t count, const double position[3]);

/** position = scale * position + shift, in place. */
void qm_shape_move(qm_mesh *mesh, double scale, const double shift[3]);

/** Adds noise of up to amplitude to every coordinate, in place. */
void qm_shape_shake(qm_mesh *mesh, qm_random *random, double amplitude);

#endif
