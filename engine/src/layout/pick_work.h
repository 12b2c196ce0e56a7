/**
 * pick_work.h: what the files of picking share: pick.c (camera, strokes), pick_mesh.c (rays), pick_cloud.c
 * (triangles of points). All places are in the local frame of the source's tree.
 */
#ifndef QM_PICK_WORK_H
#define QM_PICK_WORK_H

#include "core/vec.h"
#include "qm/pick.h"

/** Row k of a matrix times the point (p, 1). */
static inline double qm_view_row(const double *matrix, int k, qm_vec p)
{
    const double *row = matrix + 4 * k;
    return row[0] * p.x + row[1] * p.y + row[2] * p.z + row[3];
}

/** Window coordinates as clip coordinates from -1 to 1. */
static inline double qm_view_clip_x(const qm_view *view, double x)
{
    return 2.0 * (x - view->viewport[0]) / view->viewport[2] - 1.0;
}
static inline double qm_view_clip_y(const qm_view *view, double y)
{
    return 1.0 - 2.0 * (y - view->viewport[1]) / view->viewport[3];
}

/** The point at clip coordinates, after the division. */
qm_vec qm_view_unproject(const qm_view *view, double x, double y, double z);

bool qm_pick_mesh(const qm_view *view, const double window[2], qm_vec *out);
qm_status qm_pick_cloud(qm_context *ctx, const qm_view *view, const double window[2], qm_vec *out,
                        bool *found);

#endif
