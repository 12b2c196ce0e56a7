/**
 * wide.h: vectors of space for eight lanes at a time, in single precision.
 */
#ifndef QM_KERNEL_WIDE_H
#define QM_KERNEL_WIDE_H

#include "box.h"

typedef struct wide {
    qm_vf x, y, z;
} wide;

static inline qm_vf wide_row(const float *p)
{
    return *(const qm_vf *)(const void *)p;
}

static inline void wide_store_row(float *p, qm_vf a)
{
    *(qm_vf *)(void *)p = a;
}

static inline wide wide_load(const float row[3][QM_PACK_LANES])
{
    return (wide){wide_row(row[0]), wide_row(row[1]), wide_row(row[2])};
}

static inline wide wide_sub(wide a, wide b)
{
    return (wide){a.x - b.x, a.y - b.y, a.z - b.z};
}

static inline wide wide_cross(wide a, wide b)
{
    return (wide){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

static inline qm_vf wide_dot(wide a, wide b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

#endif
