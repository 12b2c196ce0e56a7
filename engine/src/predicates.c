#include "predicates.h"

#include "whole.h"

/*
 * Relative error bounds, a little above (7 + 56 u) u and (3 + 16 u) u for u = 2^-53. Underflow adds to a
 * product of three at most a few times 2^-1074 * 2^301 * 2^301, which the second constants cover.
 */
#define ERROR3 8e-16
#define UNDERFLOW3 0x1p-460
#define ERROR2 4e-16
#define UNDERFLOW2 0x1p-760

static int sign_of(double x)
{
    return (x > 0.0) - (x < 0.0);
}

/** Out = (p - a) of one coordinate, in units of 2^low. */
static void difference(qm_whole *out, double p, double a, int low)
{
    qm_whole other;
    qm_whole_set(out, p, low);
    qm_whole_set(&other, a, low);
    qm_whole_add(out, out, &other, 1);
}

/** x0 y1 - x1 y0 */
static void minor(qm_whole *out, const qm_whole *x0, const qm_whole *y0, const qm_whole *x1,
                  const qm_whole *y1)
{
    qm_whole other;
    qm_whole_multiply(out, x0, y1);
    qm_whole_multiply(&other, x1, y0);
    qm_whole_add(out, out, &other, 1);
}

/** Each axis has a unit of its own: that scales the determinant and leaves its sign. */
static int orient3d_exact(const double p[4][3])
{
    qm_whole edge[3][3], part, product, sum;
    for (int k = 0; k < 3; k++) {
        int low = 0, high;
        const double column[4] = {p[0][k], p[1][k], p[2][k], p[3][k]};
        if (!qm_whole_span(column, 4, &low, &high)) return 0;
        for (int i = 0; i < 3; i++)
            difference(&edge[i][k], p[i + 1][k], p[0][k], low);
    }
    sum.sign = sum.count = 0;
    for (int i = 0; i < 3; i++) {
        const qm_whole *next = edge[(i + 1) % 3], *last = edge[(i + 2) % 3];
        minor(&part, &next[0], &next[1], &last[0], &last[1]);
        qm_whole_multiply(&product, &part, &edge[i][2]);
        qm_whole_add(&sum, &sum, &product, 0);
    }
    return sum.sign;
}

int qm_orient3d(qm_vec a, qm_vec b, qm_vec c, qm_vec d)
{
    qm_vec u = qm_vec_sub(b, a), v = qm_vec_sub(c, a), w = qm_vec_sub(d, a);
    double vxwy = v.x * w.y, wxvy = w.x * v.y;
    double wxuy = w.x * u.y, uxwy = u.x * w.y;
    double uxvy = u.x * v.y, vxuy = v.x * u.y;
    double det = u.z * (vxwy - wxvy) + v.z * (wxuy - uxwy) + w.z * (uxvy - vxuy);
    double size = fabs(u.z) * (fabs(vxwy) + fabs(wxvy)) + fabs(v.z) * (fabs(wxuy) + fabs(uxwy)) +
                  fabs(w.z) * (fabs(uxvy) + fabs(vxuy));
    double bound = ERROR3 * size + UNDERFLOW3;
    if (det > bound || -det > bound) return sign_of(det);
    const double p[4][3] = {{a.x, a.y, a.z}, {b.x, b.y, b.z}, {c.x, c.y, c.z}, {d.x, d.y, d.z}};
    return orient3d_exact(p);
}

static int orient2d_exact(const double p[3][2])
{
    qm_whole edge[2][2], sum;
    for (int k = 0; k < 2; k++) {
        int low = 0, high;
        const double column[3] = {p[0][k], p[1][k], p[2][k]};
        if (!qm_whole_span(column, 3, &low, &high)) return 0;
        for (int i = 0; i < 2; i++)
            difference(&edge[i][k], p[i + 1][k], p[0][k], low);
    }
    minor(&sum, &edge[0][0], &edge[0][1], &edge[1][0], &edge[1][1]);
    return sum.sign;
}

int qm_orient2d(qm_vec a, qm_vec b, qm_vec c, int dropped_axis)
{
    const double from[3][3] = {{a.x, a.y, a.z}, {b.x, b.y, b.z}, {c.x, c.y, c.z}};
    int x = (dropped_axis + 1) % 3, y = (dropped_axis + 2) % 3;
    const double p[3][2] = {{from[0][x], from[0][y]}, {from[1][x], from[1][y]}, {from[2][x], from[2][y]}};
    double left = (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]);
    double right = (p[2][0] - p[0][0]) * (p[1][1] - p[0][1]);
    double det = left - right, bound = ERROR2 * (fabs(left) + fabs(right)) + UNDERFLOW2;
    if (det > bound || -det > bound) return sign_of(det);
    return orient2d_exact(p);
}
