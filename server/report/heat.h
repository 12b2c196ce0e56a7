/**
 * heat.h: a picture of a mesh in the colours of its distance from another one. The distance is that of the very point that
 * is seen at the middle of each pixel, found by projection: corners whose distance is 0 do not hide what lies between them.
 */
#ifndef QM_HEAT_H
#define QM_HEAT_H

#include "png.h"
#include "qm/project.h"
#include "raster.h"
#include "scale.h"

typedef struct qm_heat {
    qm_raster raster;
    double *distance; /* for each pixel; NAN where nothing is seen */
    double *shine;    /* 0.25 to 1; where nothing is seen undefined */
} qm_heat;

/**
 * Draws a mesh. The target is a tree for nearest points, of patches too if quads are read so.
 *
 * Returns QM_OK with a picture for qm_heat_reset, or a status as qm_project_points does.
 */
qm_status qm_heat_draw(qm_context *ctx, const qm_view *view, const qm_mesh *mesh, const qm_bvh *target,
                       qm_quad_reading quads, int thread_count, qm_heat *out);
void qm_heat_reset(qm_context *ctx, qm_heat *heat);

/** Whether a point of the surface is seen, and is not behind a part of it that is nearer. */
bool qm_heat_shows(const qm_heat *heat, const double point[3]);

/** Appends a data: URI of the picture; a dark line is where the limit of the scale is crossed. */
qm_png_status qm_heat_write(const qm_heat *heat, const qm_scale *scale, qm_text *out);

#endif
