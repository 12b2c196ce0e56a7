#include "tri_distance.h"

#include "tri_point.h"

/** The nearest corner of the other triangle to this one. */
static void try_corners(const qm_vec triangle[3], const qm_vec other[3], int side, qm_tri_gap *gap)
{
    qm_triangle frame = qm_triangle_make(triangle[0], triangle[1], triangle[2]);
    for (int i = 0; i < 3; i++) {
        double distance = sqrt(qm_triangle_distance2(&frame, other[i]));
        if (!(distance < gap->distance)) continue;
        gap->distance = distance;
        qm_triangle_footpoint(&frame, other[i], gap->weight[side]);
        for (int k = 0; k < 3; k++)
            gap->weight[1 - side][k] = k == i;
    }
}

static void set_edge(double weight[3], int i, double t)
{
    weight[i] = 1.0 - t;
    weight[(i + 1) % 3] = t;
    weight[(i + 2) % 3] = 0.0;
}

/**
 * Edges i of a and k of b where both are nearest inside; else a corner is as near. With h the angle of the
 * edges the place on a is off by some u / h, since the cross product is; the foot of that place on b is then
 * off by as much along b, so that the two stay opposite each other and their distance grows by h times u / h.
 * (Two places found each by itself would be off by u / h from each other.)
 */
static void try_edges(const qm_vec a[3], int i, const qm_vec b[3], int k, qm_tri_gap *gap)
{
    qm_vec u = qm_vec_sub(a[(i + 1) % 3], a[i]), v = qm_vec_sub(b[(k + 1) % 3], b[k]);
    qm_vec n = qm_vec_cross(u, v), r = qm_vec_sub(b[k], a[i]);
    double size = qm_vec_norm2(n), length2 = qm_vec_norm2(v);
    if (!(size > 0.0)) return;
    double s = qm_clamp(qm_vec_dot(qm_vec_cross(r, v), n) / size, 0.0, 1.0);
    qm_vec from_b = qm_vec_sub(qm_vec_scale(s, u), r);
    double t = qm_clamp(qm_vec_dot(from_b, v) / length2, 0.0, 1.0);
    double distance = qm_vec_norm(qm_vec_axpy(from_b, -t, v));
    if (!(distance < gap->distance)) return;
    gap->distance = distance;
    set_edge(gap->weight[0], i, s);
    set_edge(gap->weight[1], k, t);
}

qm_tri_gap qm_tri_tri_distance(const qm_vec a[3], const qm_vec b[3])
{
    qm_tri_gap gap = {.distance = INFINITY};
    try_corners(a, b, 0, &gap);
    try_corners(b, a, 1, &gap);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            try_edges(a, i, b, k, &gap);
    return gap;
}
