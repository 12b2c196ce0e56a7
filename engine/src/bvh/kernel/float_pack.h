/**
 * float_pack.h: distances from a point to the eight triangles of a float pack, all at once. bvh_tree.h
 * derives the margin.
 */
#ifndef QM_KERNEL_FLOAT_PACK_H
#define QM_KERNEL_FLOAT_PACK_H

#include "box.h"
#include "kernels.h"

#define QM_FLOAT_MARGIN (64.0f * 0x1p-24f)
#define QM_FLOAT_UNDERFLOW 0x1p-60f /* squares of smaller numbers may underflow */

/** A point relative to the center of a float pack. */
typedef struct qm_float_point {
    float x, y, z;
    float margin; /* max error of a computed distance to a lane */
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

static inline float qm_vf_min_lane(qm_vf a)
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
    q.margin = QM_FLOAT_MARGIN * sum + QM_FLOAT_UNDERFLOW;
    return q;
}

static inline qm_vf qm_vf_clamp01(qm_vf t)
{
    return qm_vf_min(qm_vf_max(t, (qm_vf){0}), qm_vf_set(1.0f));
}

/** The squared cutoffs of distances: -1 where no distance passes, and never so large that an overflowing
 * square passes. */
static inline qm_vf qm_float_reach2(qm_vf reach)
{
    qm_vf square = qm_vf_min(reach * reach, qm_vf_set(0x1p127f));
    return qm_vf_select(reach > (qm_vf){0}, square, qm_vf_set(-1.0f));
}

/** The triangles of a pack, with what comparing many points needs: the normal, and the edges that end at the
 * third corner as (x, y), both also divided by their squared lengths. */
typedef struct qm_float_frames {
    qm_vf ox, oy, oz, xx, xy, xz, yx, yy, yz, zx, zy, zz;
    qm_vf length, cx, cy, ex;
    qm_vf cx_ratio, cy_ratio, ex_ratio, ey_ratio;
} qm_float_frames;

static inline qm_vf qm_float_inverse(qm_vf length2)
{
    return qm_vf_set(1.0f) / qm_vf_max(length2, qm_vf_set(0x1p-126f));
}

static inline qm_float_frames qm_float_frames_make(const qm_float_pack *pack)
{
#define COMPONENT(name) qm_vf_load(pack->row[QM_FLOAT_PACK_##name])
    qm_float_frames f = {.ox = COMPONENT(OX),
                         .oy = COMPONENT(OY),
                         .oz = COMPONENT(OZ),
                         .xx = COMPONENT(XX),
                         .xy = COMPONENT(XY)};
    f.xz = COMPONENT(XZ);
    f.yx = COMPONENT(YX);
    f.yy = COMPONENT(YY);
    f.yz = COMPONENT(YZ);
    f.zx = f.xy * f.yz - f.xz * f.yy;
    f.zy = f.xz * f.yx - f.xx * f.yz;
    f.zz = f.xx * f.yy - f.xy * f.yx;
    f.length = COMPONENT(L);
    f.cx = COMPONENT(CX);
    f.cy = COMPONENT(CY);
    f.ex = f.cx - f.length;
#undef COMPONENT
    qm_vf inverse_c2 = qm_float_inverse(f.cx * f.cx + f.cy * f.cy),
          inverse_e2 = qm_float_inverse(f.ex * f.ex + f.cy * f.cy);
    f.cx_ratio = f.cx * inverse_c2;
    f.cy_ratio = f.cy * inverse_c2;
    f.ex_ratio = f.ex * inverse_e2;
    f.ey_ratio = f.cy * inverse_e2;
    return f;
}

/** Squared distance from (x, y) to the segment from the origin to (ex, ey). */
static inline qm_vf qm_float_segment2(qm_vf x, qm_vf y, qm_vf ex, qm_vf ey, qm_vf ex_ratio, qm_vf ey_ratio)
{
    qm_vf t = qm_vf_clamp01(x * ex_ratio + y * ey_ratio);
    qm_vf dx = x - t * ex, dy = y - t * ey;
    return dx * dx + dy * dy;
}

/** Broadcasts one lane's triangle to all lanes. */
static inline qm_float_frames qm_float_frames_lane(const qm_float_frames *all, int lane)
{
#define BROADCAST(name) .name = qm_vf_set(all->name[lane])
    return (qm_float_frames){
        BROADCAST(ox), BROADCAST(oy),       BROADCAST(oz),       BROADCAST(xx),       BROADCAST(xy),
        BROADCAST(xz), BROADCAST(yx),       BROADCAST(yy),       BROADCAST(yz),       BROADCAST(zx),
        BROADCAST(zy), BROADCAST(zz),       BROADCAST(length),   BROADCAST(cx),       BROADCAST(cy),
        BROADCAST(ex), BROADCAST(cx_ratio), BROADCAST(cy_ratio), BROADCAST(ex_ratio), BROADCAST(ey_ratio),
    };
#undef BROADCAST
}

/** Squared distances from a point in each lane to the triangles; pack.h has the cases. */
static inline qm_vf qm_float_frames_d2(const qm_float_frames *f, qm_vf px, qm_vf py, qm_vf pz)
{
    const qm_vf zero = {0};
    qm_vf rx = px - f->ox, ry = py - f->oy, rz = pz - f->oz;
    qm_vf x = rx * f->xx + ry * f->xy + rz * f->xz, y = rx * f->yx + ry * f->yy + rz * f->yz;
    qm_vf z = rx * f->zx + ry * f->zy + rz * f->zz;

    qm_vf ax = x - qm_vf_min(qm_vf_max(x, zero), f->length);
    qm_vf edge2 = ax * ax + y * y;
    qm_vf xl = x - f->length;
    edge2 = qm_vf_min(edge2, qm_float_segment2(x, y, f->cx, f->cy, f->cx_ratio, f->cy_ratio));
    edge2 = qm_vf_min(edge2, qm_float_segment2(xl, y, f->ex, f->cy, f->ex_ratio, f->ey_ratio));

    qm_vi inside = (y > zero) & (f->cy * x - f->cx * y > zero) & (f->ex * y - f->cy * xl > zero);
    return qm_vf_select(inside, zero, edge2) + z * z;
}

/** Squared distances from one point to all triangles. */
static inline qm_vf qm_float_point_d2(const qm_float_frames *f, const qm_float_point *q)
{
    return qm_float_frames_d2(f, qm_vf_set(q->x), qm_vf_set(q->y), qm_vf_set(q->z));
}

/** Squared distances from one point to the lanes of a pack. */
static inline qm_vf qm_float_pack_d2(const qm_float_pack *pack, const qm_float_point *q)
{
    qm_float_frames frames = qm_float_frames_make(pack);
    return qm_float_point_d2(&frames, q);
}

#endif
