/**
 * bilinear_over.c: how far a triangle lies from a bilinear patch, as one bound.
 */
#include "bilinear.h"

/*
 * As a fraction of the longest Bezier point: what computing the bound from them may lose; the points
 * themselves are off by roundings of the coordinates, which are in eta (rounding.h). n is of length 1 to 4 u,
 * a height along it off by 3 u more, the component across by 5 u. The quadratic's six terms add 14 u, both
 * squares and the root 3 u: below 32 u.
 */
#define ROUNDINGS 0x1p-48

/** Bezier points of the difference: 0 to 2 at the corners, 3 + i across from corner i. */
typedef struct difference {
    qm_vec at[6];
} difference;

/** Maximum along an edge with Bezier points a, b, c where it lies inside; else the lower end. */
static double edge_max(double a, double b, double c)
{
    double bend = a - 2.0 * b + c, x = (a - b) / bend;
    if (!(bend < 0.0 && x > 0.0 && x < 1.0)) return qm_min(a, c);
    return a + x * (b - a);
}

/**
 * Value of a quadratic on a triangle at its stationary point, if that is inside; else that of a corner. It is
 * the value of all six terms at that point, which an error of the point changes by its square only: along a
 * ridge the point is ill-conditioned, but the ridge is as high all along, and reaches an edge.
 */
static double stationary_value(const double g[6])
{
    /* g = g0 + 2 (r, s).(x, y) + (x, y) M (x, y) over the weights x, y of corners 1 and 2 */
    double r = g[5] - g[0], s = g[4] - g[0];
    double xx = g[1] - 2.0 * g[5] + g[0], yy = g[2] - 2.0 * g[4] + g[0], xy = g[3] - g[4] - g[5] + g[0];
    double determinant = xx * yy - xy * xy;
    double x = (xy * s - yy * r) / determinant, y = (xy * r - xx * s) / determinant;
    if (!(x > 0.0 && y > 0.0 && x + y < 1.0)) return g[0];
    return g[0] + 2.0 * (r * x + s * y) + xx * x * x + 2.0 * xy * x * y + yy * y * y;
}

double qm_bilinear_triangle_upper(const qm_bilinear *patch, const qm_vec corner[3], const double uv[3][2])
{
    difference d;
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        d.at[i] = qm_vec_sub(corner[i], qm_bilinear_polar(patch, uv[i], uv[i]));
        d.at[3 + i] =
            qm_vec_sub(qm_vec_mix(corner[j], corner[k], 0.5), qm_bilinear_polar(patch, uv[j], uv[k]));
    }
    qm_vec mean = {0, 0, 0};
    double size2 = 0.0;
    for (int i = 0; i < 6; i++) {
        mean = qm_vec_axpy(mean, i < 3 ? 1.0 : 2.0, d.at[i]);
        size2 = qm_max(size2, qm_vec_norm2(d.at[i]));
    }
    double size = sqrt(size2), length = qm_vec_norm(mean);
    if (!(length > 0.0)) return size;
    qm_vec n = qm_vec_scale(1.0 / length, mean);
    double along[6], across2 = 0.0, farthest = 0.0;
    for (int i = 0; i < 6; i++) {
        along[i] = qm_vec_dot(d.at[i], n);
        across2 = qm_max(across2, qm_vec_norm2(qm_vec_axpy(d.at[i], -along[i], n)));
        farthest = qm_max(farthest, -along[i]);
    }
    /* The maximum of the quadratic on the triangle. */
    double highest = stationary_value(along);
    for (int i = 0; i < 3; i++) {
        highest = qm_max(highest, along[i]);
        highest = qm_max(highest, edge_max(along[(i + 1) % 3], along[3 + i], along[(i + 2) % 3]));
    }
    farthest = qm_max(farthest, highest);
    return sqrt(farthest * farthest + across2) + ROUNDINGS * size;
}
