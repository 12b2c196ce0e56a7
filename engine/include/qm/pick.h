/**
 * pick.h: from places in a window to places on a surface, as the viewer sees it.
 *
 * Matrices are those of OpenGL: 16 numbers column by column, the eye looks along -z, clip space goes from -1
 * to
 * 1. Window coordinates are pixels from the top left corner of the viewport's frame, x to the right, y down,
 * as pointer events have them. The same input gives the same bits.
 *
 * Source: Y. Kang, Hausdorff distance computation between triangle mesh and quad mesh, section 6.1.2.
 */
#ifndef QM_PICK_H
#define QM_PICK_H

#include "qm/source.h"

typedef struct qm_camera {
    double view[16], projection[16];
    double viewport[4]; /* left, top, width, height in pixels */
} qm_camera;

/** How points of a set become candidates; not looked at on a mesh. 0 for either: what the discs' size
 * suggests. */
typedef struct qm_pick_options {
    double radius_px; /* points no farther from the cursor than this */
    double depth;     /* of those, points no farther behind the foremost one than this, unit of the points */
} qm_pick_options;

/** A camera ready for picks on one source, both borrowed. */
typedef struct qm_view {
    const qm_source *source;
    double clip[16];    /* local frame of the tree to clip space, row by row */
    double inverse[16]; /* the way back */
    double depth[4];    /* local frame to distance from the eye's plane, unit of the points */
    double viewport[4];
    double radius_px, reach;
} qm_view;

/** Takes next to no time: the tree of the source is the set-up. QM_OK, or QM_E_ARGUMENT for a camera that
 * sees nothing (numbers that are not finite, a matrix without inverse, a viewport without size). */
qm_status qm_view_init(qm_context *ctx, const qm_source *source, const qm_camera *camera,
                       const qm_pick_options *options, qm_view *out);

/**
 * The place under the cursor. On a mesh: the first hit of the view ray. On a point set: of all triangles of
 * candidates whose picture encloses the cursor, that of the smallest perimeter in space, interpolated;
 * without one the cursor at the depth of the nearest candidate.
 *
 * found   false when there is nothing
 * Returns QM_OK or QM_E_NO_MEMORY.
 */
qm_status qm_view_pick(qm_context *ctx, const qm_view *view, const double window[2], double position[3],
                       bool *found);

/**
 * Picks along a stroke: the places found, in turn, without equal neighbours.
 *
 * window      point_count rows of x y
 * positions   the caller's, point_count rows of x y z
 * count       of rows written
 * missed      how many of the stroke's points hit nothing
 */
qm_status qm_view_stroke(qm_context *ctx, const qm_view *view, const double *window, size_t point_count,
                         double *positions, size_t *count, size_t *missed);

#endif
