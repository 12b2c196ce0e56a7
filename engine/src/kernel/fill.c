/**
 * fill.c: corners of eight triangles to a pack (bvh_tree.h tells the rows), QM_WIDTH at a time. The same
 * steps as qm_triangle_make, with selections in place of branches.
 */
#include "kernels.h"

typedef struct wide_vec {
    qm_vd x, y, z;
} wide_vec;

static inline wide_vec wide_sub(wide_vec a, wide_vec b)
{
    return (wide_vec){a.x - b.x, a.y - b.y, a.z - b.z};
}

static inline wide_vec wide_scale(qm_vd s, wide_vec a)
{
    return (wide_vec){s * a.x, s * a.y, s * a.z};
}

static inline wide_vec wide_axpy(wide_vec a, qm_vd s, wide_vec b)
{
    return (wide_vec){a.x + s * b.x, a.y + s * b.y, a.z + s * b.z};
}

static inline qm_vd wide_dot(wide_vec a, wide_vec b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static inline wide_vec wide_cross(wide_vec a, wide_vec b)
{
    return (wide_vec){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

static inline wide_vec wide_select(qm_vl mask, wide_vec a, wide_vec b)
{
    return (wide_vec){qm_vd_select(mask, a.x, b.x), qm_vd_select(mask, a.y, b.y),
                      qm_vd_select(mask, a.z, b.z)};
}

static inline wide_vec wide_load(const double corner[3][QM_PACK_LANES], int at)
{
    return (wide_vec){qm_vd_load(corner[0] + at), qm_vd_load(corner[1] + at), qm_vd_load(corner[2] + at)};
}

/** 1 / a, and 0 where a is 0 */
static inline qm_vd inverse_or_zero(qm_vd a)
{
    const qm_vd zero = qm_vd_set(0.0), one = qm_vd_set(1.0);
    qm_vl positive = a > zero;
    return qm_vd_select(positive, one / qm_vd_select(positive, a, one), zero);
}

/** Unit vector at a right angle to the unit vector x. */
static inline wide_vec any_perpendicular(wide_vec x)
{
    const qm_vd zero = qm_vd_set(0.0);
    qm_vl small = x.x * x.x < qm_vd_set(0.36);
    wide_vec y = wide_select(small, (wide_vec){zero, x.z, -x.y}, (wide_vec){-x.z, zero, x.x});
    return wide_scale(qm_vd_set(1.0) / qm_vd_sqrt(wide_dot(y, y)), y);
}

static inline wide_vec height_direction(wide_vec third, wide_vec x, qm_vd length)
{
    const qm_vd one = qm_vd_set(1.0);
    wide_vec y = wide_axpy(third, -wide_dot(third, x), x);
    qm_vd height = qm_vd_sqrt(wide_dot(y, y));
    qm_vl is_tall = height > qm_vd_set(0x1p-50) * length;
    y = wide_scale(one / qm_vd_select(is_tall, height, one), y);
    y = wide_axpy(y, -wide_dot(y, x), x);
    qm_vd norm = qm_vd_sqrt(wide_dot(y, y));
    y = wide_scale(one / qm_vd_select(is_tall, norm, one), y);
    return wide_select(is_tall, y, any_perpendicular(x));
}

void QM_KERNEL(fill_pack)(qm_pack *pack, const double corner[3][3][QM_PACK_LANES])
{
    for (int at = 0; at < QM_PACK_LANES; at += QM_WIDTH) {
        wide_vec a = wide_load(corner[0], at), b = wide_load(corner[1], at), c = wide_load(corner[2], at);
        wide_vec ab = wide_sub(b, a), bc = wide_sub(c, b), ca = wide_sub(a, c);
        qm_vd longest2 = wide_dot(ab, ab), bc2 = wide_dot(bc, bc), ca2 = wide_dot(ca, ca);
        qm_vl from_b = bc2 > longest2;
        longest2 = qm_vd_select(from_b, bc2, longest2);
        qm_vl from_c = ca2 > longest2;
        longest2 = qm_vd_select(from_c, ca2, longest2);
        wide_vec origin = wide_select(from_c, c, wide_select(from_b, b, a));
        wide_vec second = wide_select(from_c, a, wide_select(from_b, c, b));
        wide_vec third = wide_sub(wide_select(from_c, b, wide_select(from_b, a, c)), origin);

        const qm_vd zero = qm_vd_set(0.0), one = qm_vd_set(1.0);
        qm_vd length = qm_vd_sqrt(longest2);
        qm_vl is_long = length > zero;
        wide_vec x = wide_scale(one / qm_vd_select(is_long, length, one), wide_sub(second, origin));
        x.x = qm_vd_select(is_long, x.x, one);
        wide_vec y = height_direction(third, x, length), z = wide_cross(x, y);
        qm_vd cx = wide_dot(third, x), cy = wide_dot(third, y), dx = cx - length;
        const qm_vd row[QM_ROW_COUNT] = {
            origin.x,
            origin.y,
            origin.z,
            x.x,
            x.y,
            x.z,
            y.x,
            y.y,
            y.z,
            z.x,
            z.y,
            z.z,
            length,
            cx,
            cy,
            inverse_or_zero(cx * cx + cy * cy),
            inverse_or_zero(dx * dx + cy * cy),
        };
        for (int r = 0; r < QM_ROW_COUNT; r++)
            qm_vd_store(&pack->row[r][at], row[r]);
    }
}
