/**
 * four.h: vectors of four doubles on every instruction set: a position and one more number, or a third of
 * four positions; and vectors of eight.
 */
#ifndef QM_KERNEL_FOUR_H
#define QM_KERNEL_FOUR_H

#include "simd.h"

typedef double qm_four __attribute__((vector_size(32)));
typedef int64_t qm_four_mask __attribute__((vector_size(32)));
typedef float qm_four_floats __attribute__((vector_size(16)));
typedef double qm_eight __attribute__((vector_size(64)));

static inline qm_four qm_four_set(double x)
{
    return (qm_four){0} + x;
}

/** a where the mask is all ones, b where it is all zeros */
static inline qm_four qm_four_select(qm_four_mask mask, qm_four a, qm_four b)
{
#if defined(__AVX__)
    return (qm_four)_mm256_blendv_pd((__m256d)b, (__m256d)a, (__m256d)mask);
#else
    return (qm_four)(((qm_four_mask)a & mask) | ((qm_four_mask)b & ~mask));
#endif
}

/** a < b ? a : b in each lane, so b when either is not a number */
static inline qm_four qm_four_min(qm_four a, qm_four b)
{
#if defined(__AVX__)
    return (qm_four)_mm256_min_pd((__m256d)a, (__m256d)b);
#else
    return qm_four_select(a < b, a, b);
#endif
}

static inline qm_four qm_four_max(qm_four a, qm_four b)
{
#if defined(__AVX__)
    return (qm_four)_mm256_max_pd((__m256d)a, (__m256d)b);
#else
    return qm_four_select(a > b, a, b);
#endif
}

/** x, y, z and 0 */
static inline qm_four qm_four_position(const double *p)
{
#if defined(__AVX2__)
    return (qm_four)_mm256_maskload_pd(p, _mm256_set_epi64x(0, -1, -1, -1));
#else
    return (qm_four){p[0], p[1], p[2], 0.0};
#endif
}

/** Rounded to single precision. */
static inline qm_four_floats qm_four_round(qm_four a)
{
#if defined(__AVX__)
    return (qm_four_floats)_mm256_cvtpd_ps((__m256d)a);
#else
    return (qm_four_floats){(float)a[0], (float)a[1], (float)a[2], (float)a[3]};
#endif
}

/** The max magnitude of each coordinate; the first argument is a magnitude already. */
static inline qm_four_floats qm_four_max_magnitude(qm_four_floats magnitude, qm_four_floats a)
{
    typedef int32_t mask __attribute__((vector_size(16)));
    qm_four_floats other = (qm_four_floats)((mask)a & INT32_MAX);
#if defined(__AVX__)
    return (qm_four_floats)_mm_max_ps((__m128)magnitude, (__m128)other);
#else
    mask above = magnitude > other;
    return (qm_four_floats)(((mask)magnitude & above) | ((mask)other & ~above));
#endif
}

#endif
