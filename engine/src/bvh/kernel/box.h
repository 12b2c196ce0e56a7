/**
 * box.h: which of the eight boxes of a node come within a distance of a point or box, in single precision and
 * never missing one.
 *
 * The boxes are enlarged by QM_BOX_MARGIN already. The query is enlarged by its own rounding before the
 * subtraction: a float is within half a unit in its last place of the double, and is moved by at least one.
 * So gaps before rounding are at most the true ones, and with v = 2^-24 a computed squared distance is at
 * most (1 + v)^5 < 1 + 4e-7 times the true one: two for the gap, which is rounded and then squared, one for
 * the square and two for the sum of three. Comparing with a limit raised by 1e-6 is safe.
 */
#ifndef QM_KERNEL_BOX_H
#define QM_KERNEL_BOX_H

#include "bvh/kernel.h"
#include "keys.h"

/** A box as a query: its low sides are compared with the high sides of the boxes, and its high sides with the
 * low. */
typedef struct qm_box_query {
    float low[3], high[3];
} qm_box_query;

static inline float qm_float_below(double x)
{
    float f = (float)x;
    return f - (f < 0 ? -f : f) * 0x1p-23f - 0x1p-126f;
}

static inline float qm_float_above(double x)
{
    float f = (float)x;
    return f + (f < 0 ? -f : f) * 0x1p-23f + 0x1p-126f;
}

static inline qm_box_query qm_box_query_make(const double low[3], const double high[3])
{
    qm_box_query query;
    for (int k = 0; k < 3; k++) {
        query.low[k] = qm_float_below(low[k]);
        query.high[k] = qm_float_above(high[k]);
    }
    return query;
}

static inline qm_box_query qm_box_query_point(qm_vec p)
{
    const double point[3] = {p.x, p.y, p.z};
    return qm_box_query_make(point, point);
}

/** A limit for comparisons with computed squared distances to boxes: raised, and rounded up to a float. */
static inline float qm_box_limit(double d2)
{
    double raised = d2 * (1.0 + 1e-6);
    return raised < 3e38 ? qm_float_above(raised) : __builtin_inff();
}

static inline qm_vf qm_vf_max(qm_vf a, qm_vf b)
{
#if defined(__AVX__)
    return (qm_vf)_mm256_max_ps((__m256)a, (__m256)b);
#else
    qm_vi above = a > b;
    return (qm_vf)(((qm_vi)a & above) | ((qm_vi)b & ~above));
#endif
}

static inline qm_vf qm_vf_min(qm_vf a, qm_vf b)
{
#if defined(__AVX__)
    return (qm_vf)_mm256_min_ps((__m256)a, (__m256)b);
#else
    qm_vi below = a < b;
    return (qm_vf)(((qm_vi)a & below) | ((qm_vi)b & ~below));
#endif
}

static inline float qm_vf_max_lane(qm_vf a)
{
    a = qm_vf_max(a, __builtin_shufflevector(a, a, 4, 5, 6, 7, 0, 1, 2, 3));
    a = qm_vf_max(a, __builtin_shufflevector(a, a, 2, 3, 0, 1, 6, 7, 4, 5));
    return a[0] > a[1] ? a[0] : a[1];
}

/** One bit a lane, set where the mask is all ones. */
static inline unsigned qm_vi_bits(qm_vi mask)
{
#if defined(__AVX__)
    return (unsigned)_mm256_movemask_ps((__m256)mask);
#else
    unsigned bits = 0;
    for (int i = 0; i < 8; i++)
        bits |= (unsigned)(mask[i] & 1) << i;
    return bits;
#endif
}

/** Squared distances from the query to the eight boxes. */
static inline qm_vf qm_box_node_d2(const qm_box_node *node, const qm_box_query *query)
{
    qm_vf sum = {0};
    for (int k = 0; k < 3; k++) {
        qm_vf below = *(const qm_vf *)(const void *)node->low[k] - query->high[k];
        qm_vf above = query->low[k] - *(const qm_vf *)(const void *)node->high[k];
        qm_vf gap = qm_vf_max(qm_vf_max(below, above), (qm_vf){0});
        sum += gap * gap;
    }
    return sum;
}

/** Writes the squared distances from the query to the eight boxes, and returns bits of those within the
 * limit.
 */
static inline unsigned qm_box_node_within(const qm_box_node *node, const qm_box_query *query, float limit,
                                          float d2[QM_PACK_LANES])
{
    qm_vf sum = qm_box_node_d2(node, query);
    *(qm_vf *)(void *)d2 = sum;
    return qm_vi_bits(sum <= limit);
}

#endif
