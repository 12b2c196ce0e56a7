#include "tri_hull.h"

int qm_hull_axis(qm_vec a, qm_vec b, qm_vec c)
{
    for (int axis = 0; axis < 3; axis++)
        if (qm_orient2d(a, b, c, axis) != 0) return axis;
    return -1;
}

qm_hull qm_hull_make(const qm_vec corner[3])
{
    if (qm_hull_axis(corner[0], corner[1], corner[2]) >= 0) return qm_hull_proper(corner);
    qm_vec low = corner[0], high = corner[0];
    for (int i = 1; i < 3; i++) {
        low = qm_vec_compare(corner[i], low) < 0 ? corner[i] : low;
        high = qm_vec_compare(corner[i], high) > 0 ? corner[i] : high;
    }
    return qm_hull_segment(low, high);
}
