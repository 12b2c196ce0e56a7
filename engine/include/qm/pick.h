/**
 * pick.h: from positions in a window to positions on a surface, as the viewer sees it.
 *
 * Matrices follow OpenGL: 16 numbers column by column, the eye looks along -z, clip space goes from -1 to 1.
 * Window coordinates are pixels from the top left corner of the viewport's frame, x to the right, y down, as
 * in pointer events. Equal input gives equal bits.
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

/** Which points of a set become candidates; unused for a mesh. 0 for either: a default from the size of the
 * discs. */
typedef struct qm_pick_options {
    double radius_px; /* largest distance from the cursor in pixels */
    double depth;     /* largest distance behind the foremost of these points, unit of the points */
} qm_pick_options;

/** A camera ready for picks on one source, both borrowed. */
typedef struct qm_pick_view {
    const qm_ref_surface *source;
    double clip[16];    /* local frame of the tree to clip space, row by row */
    double inverse[16]; /* inverse of clip */
    double depth[4];    /* local frame to distance from the eye's plane, unit of the points */
    double viewport[4];
    double radius_px, reach; /* qm_pick_options or their defaults; reach is depth */
} qm_pick_view;

/** Prepares picks in constant time. Returns QM_OK, or QM_E_ARGUMENT for a degenerate camera (numbers that are
 * not finite, a matrix without inverse, a viewport without size). */
qm_status qm_pick_view_init(qm_context *ctx, const qm_ref_surface *source, const qm_camera *camera,
                            const qm_pick_options *options, qm_pick_view *out);

/**
 * Finds the position under the cursor. On a mesh: the first hit of the view ray. On a point set: of all
 * triangles of candidates whose projection encloses the cursor, interpolates in the one of smallest perimeter
 * in space; without one, takes the cursor at the depth of the nearest candidate.
 *
 * window    x y
 * position  x y z in the frame of the surface
 * found     false when there is no surface under the cursor
 *
 * Returns: QM_OK or QM_E_NO_MEMORY.
 */
qm_status qm_pick_point(qm_context *ctx, const qm_pick_view *view, const double window[2], double position[3],
                        bool *found);

/**
 * Picks along a stroke: writes the positions found, in order, without consecutive equal ones.
 *
 * window     point_count rows of x y
 * positions  the caller's, point_count rows of x y z
 * count      number of rows written
 * missed     number of the stroke's points without a surface under them
 *
 * Returns: QM_OK or QM_E_NO_MEMORY.
 */
qm_status qm_pick_stroke(qm_context *ctx, const qm_pick_view *view, const double *window, size_t point_count,
                         double *positions, size_t *count, size_t *missed);

/** The normal of the plane through two places along the direction in which the viewer sees their middle. False if both are
 * the same, or the camera is degenerate. */
bool qm_pick_plane(const qm_camera *camera, const double a[3], const double b[3], double normal[3]);

#endif
