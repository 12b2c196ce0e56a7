/**
 * float_pack.h: distances from a point to the eight triangles of a float pack, all at once. See the margin in
 * ../float_pack.h.
 */
#ifndef QM_KERNEL_FLOAT_PACK_H
#define QM_KERNEL_FLOAT_PACK_H

#include "box.h"
#include "kernels.h"

#define QM_FLOAT_MARGIN (64.0f * 0x1p-24f)
#define QM_FLOAT_LEAST 0x1p-60f /* squares of less may underflow */

/** A point as a float pack sees it. */
typedef struct qm_float_point {
    float x, y, z;
    float margin; /* no computed distance to a lane is off by more */
} qm_float_point;

static inline qm_vf qm_vf_set(float x)
{
    return (qm_vf){0} + x;
}

static inline qm_vf qm_vf_load(const float *p)
{
    qm_vf a;
    memcpy(&a, p, sizeof a);
    return a;
}

static inline qm_vf qm_vf_select(qm_vi mask, qm_vf a, qm_vf b)
{
#if defined(__AVX__)
    return (qm_vf)_mm256_blendv_ps((__m256)b, (__m256)a, (__m256)mask);
#else
    return (qm_vf)(((qm_vi)a & mask) | ((qm_vi)b & ~mask));
#endif
}

static inline qm_vf qm_vf_sqrt(qm_vf a)
{
#if defined(__AVX__)
    return (qm_vf)_mm256_sqrt_ps((__m256)a);
#else
    for (int i = 0; i < 8; i++)
        a[i] = __builtin_sqrtf(a[i]);
    return a;
#endif
}

static inline float qm_vf_least(qm_vf a)
{
    a = qm_vf_min(a, __builtin_shufflevector(a, a, 4, 5, 6, 7, 0, 1, 2, 3));
    a = qm_vf_min(a, __builtin_shufflevector(a, a, 2, 3, 0, 1, 6, 7, 4, 5));
    return a[0] < a[1] ? a[0] : a[1];
}

static inline qm_float_point qm_float_point_make(const qm_float_pack *pack, qm_vec p)
{
    qm_float_point q = {(float)(p.x - (double)pack->middle[0]), (float)(p.y - (double)pack->middle[1]),
                        (float)(p.z - (double)pack->middle[2]), 0.0f};
    float sum = __builtin_fabsf(q.x) + __builtin_fabsf(q.y) + __builtin_fabsf(q.z) + pack->radius;
    q.margin = QM_FLOAT_MARGIN * sum + QM_FLOAT_LEAST;
    return q;
}

static inline qm_vf qm_vf_clamp01(qm_vf t)
{
    return qm_vf_min(qm_vf_max(t, (qm_vf){0}), qm_vf_set(1.0f));
}

/** Squared distance from (x, y) to the segment from the origin to (ex, ey). */
static inline qm_vf qm_float_segment2(qm_vf x, qm_vf y, qm_vf ex, qm_vf ey)
{
    qm_vf length2 = qm_vf_max(ex * ex + ey * ey, qm_vf_set(0x1p-126f));
    qm_vf t = qm_vf_clamp01((x * ex + y * ey) / length2);
    qm_vf dx = x - t * ex, dy = y - t * ey;
    return dx * dx + dy * dy;
}

/** Squared distances to the lanes; see kernel/pack.h for the cases. */
static inline qm_vf qm_float_pack_d2(const qm_float_pack *pack, const qm_float_point *q)
{
#define ROW(name) qm_vf_load(pack->row[QM_FLOAT_##name])
    const qm_vf zero = {0};
    qm_vf rx = q->x - ROW(OX), ry = q->y - ROW(OY), rz = q->z - ROW(OZ);
    qm_vf xx = ROW(XX), xy = ROW(XY), xz = ROW(XZ), yx = ROW(YX), yy = ROW(YY), yz = ROW(YZ);
    qm_vf x = rx * xx + ry * xy + rz * xz, y = rx * yx + ry * yy + rz * yz;
    qm_vf z = rx * (xy * yz - xz * yy) + ry * (xz * yx - xx * yz) + rz * (xx * yy - xy * yx);
    qm_vf length = ROW(L), cx = ROW(CX), cy = ROW(CY);

    qm_vf ax = x - qm_vf_min(qm_vf_max(x, zero), length);
    qm_vf edge2 = ax * ax + y * y;
    qm_vf ex = cx - length, xl = x - length;
    edge2 = qm_vf_min(edge2, qm_float_segment2(x, y, cx, cy));
    edge2 = qm_vf_min(edge2, qm_float_segment2(xl, y, ex, cy));

    qm_vi inside = (y > zero) & (cy * x - cx * y > zero) & (ex * y - cy * xl > zero);
    return qm_vf_select(inside, zero, edge2) + z * z;
#undef ROW
}

#endif
