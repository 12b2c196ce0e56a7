/**
 * raster.h: which point of a mesh is seen at each pixel of a picture: a depth buffer with the face and its parameters,
 * from which the caller makes colours. Parallel projection; no colour is known here.
 *
 * Lengths are divided by the size of what is looked at before anything is multiplied, so that meshes of any size and place
 * are drawn alike.
 */
#ifndef QM_RASTER_H
#define QM_RASTER_H

#include "qm/mesh.h"

typedef struct qm_view {
    int width, height;                  /* pixels */
    double right[3], up[3], towards[3]; /* unit vectors of the picture, and towards the viewer */
    double centre[3];                   /* is in the middle of the picture */
    double size;                        /* a length of the scene, above 0 */
    double scale;                       /* pixels for this length */
} qm_view;

/** A view of a box from the side that `towards` points to, with the axis `up` upright; fits the box until the scale is
 * set otherwise. Neither needs unit length, and they are not parallel. */
qm_view qm_raster_view(const qm_box *box, const double towards[3], const double up[3], int width, int height);

/** Where a point is in the picture: pixels to the right and down, and towards the viewer. Pixel (x, y) is the square from
 * there to x + 1, y + 1. */
void qm_raster_project(const qm_view *view, const double point[3], double out[3]);

typedef struct qm_raster {
    qm_view view;
    double *depth;  /* of the surface at the middle of each pixel, towards the viewer; -DBL_MAX: nothing */
    uint32_t *face; /* of the mesh as stored, of a point set the vertex; QM_NO_INDEX: nothing */
    double *uv;     /* two parameters for each pixel */
} qm_raster;

/** Makes an empty picture for qm_raster_reset; false when memory ran out, and then it needs none. */
bool qm_raster_init(qm_context *ctx, const qm_view *view, qm_raster *out);
void qm_raster_reset(qm_context *ctx, qm_raster *raster);

/**
 * Draws a valid mesh: what is nearest to the viewer at the middle of each pixel. Faces thinner than a pixel are drawn as
 * lines besides, so that a needle is seen as well, and points as small squares.
 */
void qm_raster_draw(qm_raster *raster, const qm_mesh *mesh, qm_quad_reading quads);

/** The point and the unit normal (0 0 0 where there is none) of a face at its parameters. */
void qm_raster_position(const qm_mesh *mesh, qm_quad_reading quads, uint32_t face, const double uv[2],
                        double out[3]);
void qm_raster_normal(const qm_mesh *mesh, qm_quad_reading quads, uint32_t face, const double uv[2],
                      double out[3]);

/** How bright a face is, 0.25 to 1: by the angle to a light beside the viewer, alike on both of its sides. */
double qm_raster_shine(const qm_view *view, const double normal[3]);

#endif
