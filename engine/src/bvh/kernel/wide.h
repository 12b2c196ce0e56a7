/**
 * wide.h: vectors in space for eight lanes at a time, in single precision.
 */
#ifndef QM_KERNEL_WIDE_H
#define QM_KERNEL_WIDE_H

#include "box.h"

typedef struct wide {
    qm_vf x, y, z;
} wide;

static inline qm_vf wide_load_row(const float *p)
{
    return *(const qm_vf *)(const void *)p;
}

static inline void wide_store_row(float *p, qm_vf a)
{
    *(qm_vf *)(void *)p = a;
}

static inline wide wide_load(const float row[3][QM_PACK_LANES])
{
    return (wide){wide_load_row(row[0]), wide_load_row(row[1]), wide_load_row(row[2])};
}

typedef float wide_part __attribute__((vector_size(16)));

/** Joins two rows of four. */
static inline qm_vf wide_join(const float low[4], const float high[4])
{
    return __builtin_shufflevector(*(const wide_part *)(const void *)low,
                                   *(const wide_part *)(const void *)high, 0, 1, 2, 3, 4, 5, 6, 7);
}

/** Transposes eight rows of four to columns; two[i] holds rows i and i + 4. */
static inline void wide_transpose(const qm_vf two[4], qm_vf column[4])
{
    qm_vf xy01 = __builtin_shufflevector(two[0], two[1], 0, 8, 1, 9, 4, 12, 5, 13),
          xy23 = __builtin_shufflevector(two[2], two[3], 0, 8, 1, 9, 4, 12, 5, 13),
          zw01 = __builtin_shufflevector(two[0], two[1], 2, 10, 3, 11, 6, 14, 7, 15),
          zw23 = __builtin_shufflevector(two[2], two[3], 2, 10, 3, 11, 6, 14, 7, 15);
    column[0] = __builtin_shufflevector(xy01, xy23, 0, 1, 8, 9, 4, 5, 12, 13);
    column[1] = __builtin_shufflevector(xy01, xy23, 2, 3, 10, 11, 6, 7, 14, 15);
    column[2] = __builtin_shufflevector(zw01, zw23, 0, 1, 8, 9, 4, 5, 12, 13);
    column[3] = __builtin_shufflevector(zw01, zw23, 2, 3, 10, 11, 6, 7, 14, 15);
}

static inline wide wide_add(wide a, wide b)
{
    return (wide){a.x + b.x, a.y + b.y, a.z + b.z};
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
