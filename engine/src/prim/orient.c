#include "orient.h"

/*
 * Relative error bounds: a term of a determinant is rounded at most eight times in three dimensions and four
 * times in two, by 2^-53 each; these are a little above. Underflow adds to a product of three at most a few
 * times 2^-1074 * 2^301 * 2^301, to a product of two a few times 2^-1074, which the second constants cover.
 */
#define ERROR3 1e-15
#define UNDERFLOW3 0x1p-460
#define ERROR2 5e-16
#define UNDERFLOW2 0x1p-1060

static int sign_of(double x)
{
    return (x > 0.0) - (x < 0.0);
}

/* ---- integers of up to SMALL_BITS ---- */

/** Differences then have a bit more, products of two of them twice that, and their differences one more: all
 * fit 128 bits. */
#define SMALL_BITS 60

/** The sign of the sum of part[i] * z[i], in two pieces of which neither overflows. */
static int small_dot_sign(const __int128 part[3], const int64_t z[3])
{
    const int split = 62;
    const __int128 mask = ((__int128)1 << split) - 1;
    __int128 high = 0, low = 0;
    for (int i = 0; i < 3; i++) {
        high += (part[i] >> split) * z[i];
        low += (part[i] & mask) * z[i];
    }
    high += low >> split;
    low &= mask;
    return high > 0 ? 1 : high < 0 ? -1 : low != 0;
}

/** The sign of the determinant of three edges. */
static int small_sign(const int64_t edge[3][3])
{
    __int128 part[3];
    const int64_t z[3] = {edge[0][2], edge[1][2], edge[2][2]};
    for (int i = 0; i < 3; i++) {
        const int64_t *next = edge[(i + 1) % 3], *last = edge[(i + 2) % 3];
        part[i] = (__int128)next[0] * last[1] - (__int128)last[0] * next[1];
    }
    return small_dot_sign(part, z);
}

/* ---- integers of any size ---- */

/** Out = (p - a) of one coordinate, in units of 2^low. */
static void difference(qm_bigint *out, double p, double a, int low)
{
    qm_bigint other;
    qm_bigint_set(out, p, low);
    qm_bigint_set(&other, a, low);
    qm_bigint_add(out, out, &other, 1);
}

/** x0 y1 - x1 y0 */
static void minor(qm_bigint *out, const qm_bigint *x0, const qm_bigint *y0, const qm_bigint *x1,
                  const qm_bigint *y1)
{
    qm_bigint other;
    qm_bigint_multiply(out, x0, y1);
    qm_bigint_multiply(&other, x1, y0);
    qm_bigint_add(out, out, &other, 1);
}

void qm_orient3d_value(const double p[4][3], const int low[3], qm_bigint *out)
{
    qm_bigint edge[3][3], part, product;
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < 3; i++)
            difference(&edge[i][k], p[i + 1][k], p[0][k], low[k]);
    out->sign = out->count = 0;
    for (int i = 0; i < 3; i++) {
        const qm_bigint *next = edge[(i + 1) % 3], *last = edge[(i + 2) % 3];
        minor(&part, &next[0], &next[1], &last[0], &last[1]);
        qm_bigint_multiply(&product, &part, &edge[i][2]);
        qm_bigint_add(out, out, &product, 0);
    }
}

static int large_sign(const double p[4][3], const int low[3])
{
    qm_bigint sum;
    qm_orient3d_value(p, low, &sum);
    return sum.sign;
}

/** Each axis has a unit of its own: that scales the determinant and leaves its sign. */
static int orient3d_exact(const double p[4][3])
{
    int low[3] = {0}, bits = 0;
    for (int k = 0; k < 3; k++) {
        int high;
        const double column[4] = {p[0][k], p[1][k], p[2][k], p[3][k]};
        if (!qm_bigint_span(column, 4, &low[k], &high)) return 0;
        bits = high - low[k] + 1 > bits ? high - low[k] + 1 : bits;
    }
    if (bits > SMALL_BITS) return large_sign(p, low);
    int64_t edge[3][3];
    for (int k = 0; k < 3; k++) {
        int64_t origin = qm_bigint_small(p[0][k], low[k]);
        for (int i = 0; i < 3; i++)
            edge[i][k] = qm_bigint_small(p[i + 1][k], low[k]) - origin;
    }
    return small_sign(edge);
}

/** The sign is 0 without computing where two points coincide: so they do all over meshes whose components
 * share positions, but no vertices. */
static int exact_side(const qm_vec plane[3], qm_vec p)
{
    if (qm_vec_equal(p, plane[0]) || qm_vec_equal(p, plane[1]) || qm_vec_equal(p, plane[2])) return 0;
    if (qm_vec_equal(plane[0], plane[1]) || qm_vec_equal(plane[1], plane[2]) ||
        qm_vec_equal(plane[2], plane[0]))
        return 0;
    const double points[4][3] = {{plane[0].x, plane[0].y, plane[0].z},
                                 {plane[1].x, plane[1].y, plane[1].z},
                                 {plane[2].x, plane[2].y, plane[2].z},
                                 {p.x, p.y, p.z}};
    return orient3d_exact(points);
}

void qm_orient3d_sides(const qm_vec plane[3], const qm_vec *point, int count, int *side)
{
    qm_vec u = qm_vec_sub(plane[1], plane[0]), v = qm_vec_sub(plane[2], plane[0]);
    double yz = u.y * v.z, zy = u.z * v.y, zx = u.z * v.x, xz = u.x * v.z, xy = u.x * v.y, yx = u.y * v.x;
    qm_vec normal = {yz - zy, zx - xz, xy - yx};
    qm_vec size = {fabs(yz) + fabs(zy), fabs(zx) + fabs(xz), fabs(xy) + fabs(yx)};
    for (int i = 0; i < count; i++) {
        qm_vec w = qm_vec_sub(point[i], plane[0]);
        double det = qm_vec_dot(normal, w);
        double bound = ERROR3 * (size.x * fabs(w.x) + size.y * fabs(w.y) + size.z * fabs(w.z)) + UNDERFLOW3;
        side[i] = det > bound || -det > bound ? sign_of(det) : exact_side(plane, point[i]);
    }
}

int qm_orient3d(qm_vec a, qm_vec b, qm_vec c, qm_vec d)
{
    const qm_vec plane[3] = {a, b, c};
    int side;
    qm_orient3d_sides(plane, &d, 1, &side);
    return side;
}

static int orient2d_exact(const double p[3][2])
{
    int low[2] = {0}, bits = 0;
    for (int k = 0; k < 2; k++) {
        int high;
        const double column[3] = {p[0][k], p[1][k], p[2][k]};
        if (!qm_bigint_span(column, 3, &low[k], &high)) return 0;
        bits = high - low[k] + 1 > bits ? high - low[k] + 1 : bits;
    }
    if (bits > SMALL_BITS) {
        qm_bigint edge[2][2], sum;
        for (int k = 0; k < 2; k++)
            for (int i = 0; i < 2; i++)
                difference(&edge[i][k], p[i + 1][k], p[0][k], low[k]);
        minor(&sum, &edge[0][0], &edge[0][1], &edge[1][0], &edge[1][1]);
        return sum.sign;
    }
    int64_t edge[2][2];
    for (int k = 0; k < 2; k++)
        for (int i = 0; i < 2; i++)
            edge[i][k] = qm_bigint_small(p[i + 1][k], low[k]) - qm_bigint_small(p[0][k], low[k]);
    __int128 det = (__int128)edge[0][0] * edge[1][1] - (__int128)edge[1][0] * edge[0][1];
    return (det > 0) - (det < 0);
}

int qm_orient2d(qm_vec a, qm_vec b, qm_vec c, int dropped_axis)
{
    const double from[3][3] = {{a.x, a.y, a.z}, {b.x, b.y, b.z}, {c.x, c.y, c.z}};
    int x = (dropped_axis + 1) % 3, y = (dropped_axis + 2) % 3;
    const double p[3][2] = {{from[0][x], from[0][y]}, {from[1][x], from[1][y]}, {from[2][x], from[2][y]}};
    double ux = p[1][0] - p[0][0], uy = p[1][1] - p[0][1], vx = p[2][0] - p[0][0], vy = p[2][1] - p[0][1];
    double left = ux * vy, right = vx * uy;
    double det = left - right, bound = ERROR2 * (fabs(left) + fabs(right)) + UNDERFLOW2;
    if (det > bound || -det > bound) return sign_of(det);
    /* A difference is 0 only when it is exactly: edges along the axes are common. */
    if ((ux == 0.0 || vy == 0.0) && (vx == 0.0 || uy == 0.0)) return 0;
    return orient2d_exact(p);
}

/* ---- a point beside the given one ---- */

int qm_orient3d_nudged(qm_vec a, qm_vec b, qm_vec c, qm_vec d)
{
    int side = qm_orient3d(a, b, c, d);
    /* The determinant changes with d by the normal of the plane, whose components are signs in two dimensions. */
    for (int axis = 0; side == 0 && axis < 3; axis++)
        side = qm_orient2d(a, b, c, axis);
    return side;
}

int qm_orient2d_nudged(qm_vec a, qm_vec b, qm_vec c)
{
    int side = qm_orient2d(a, b, c, 2);
    /* It changes with c by (a.y - b.y, b.x - a.x). */
    if (side == 0) side = sign_of(a.y - b.y);
    return side != 0 ? side : sign_of(b.x - a.x);
}
