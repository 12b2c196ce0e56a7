/**
 * simd.h: vectors as wide as the instruction set of this compilation. Every width does the same operations in
 * the same order, so that all kernels give the same bits.
 */
#ifndef QM_KERNEL_SIMD_H
#define QM_KERNEL_SIMD_H

#include <stdint.h>

#if defined(__AVX__)
#include <immintrin.h>
#endif

#if defined(__AVX512F__)
#define QM_WIDTH 8
#elif defined(__AVX2__)
#define QM_WIDTH 4
#else
#define QM_WIDTH 2
#endif

/** Doubles of one vector; a pack of eight lanes is QM_PARTS of them. */
#define QM_PARTS (8 / QM_WIDTH)

typedef double qm_vd __attribute__((vector_size(8 * QM_WIDTH)));
typedef int64_t qm_vl __attribute__((vector_size(8 * QM_WIDTH)));

static inline qm_vd qm_vd_set(double x)
{
    return (qm_vd){0} + x;
}

static inline qm_vd qm_vd_load(const double *p)
{
    return *(const qm_vd *)(const void *)p;
}

static inline void qm_vd_store(double *p, qm_vd a)
{
    *(qm_vd *)(void *)p = a;
}

/** a where the mask is all ones, b where it is all zeros */
static inline qm_vd qm_vd_select(qm_vl mask, qm_vd a, qm_vd b)
{
#if defined(__AVX512F__)
    return (qm_vd)_mm512_mask_blend_pd(_mm512_movepi64_mask((__m512i)mask), (__m512d)b, (__m512d)a);
#elif defined(__AVX__)
    return (qm_vd)_mm256_blendv_pd((__m256d)b, (__m256d)a, (__m256d)mask);
#else
    return (qm_vd)(((qm_vl)a & mask) | ((qm_vl)b & ~mask));
#endif
}

/** a < b ? a : b in each lane, so b when either is not a number */
static inline qm_vd qm_vd_min(qm_vd a, qm_vd b)
{
#if defined(__AVX512F__)
    return (qm_vd)_mm512_min_pd((__m512d)a, (__m512d)b);
#elif defined(__AVX__)
    return (qm_vd)_mm256_min_pd((__m256d)a, (__m256d)b);
#else
    return qm_vd_select(a < b, a, b);
#endif
}

static inline qm_vd qm_vd_max(qm_vd a, qm_vd b)
{
#if defined(__AVX512F__)
    return (qm_vd)_mm512_max_pd((__m512d)a, (__m512d)b);
#elif defined(__AVX__)
    return (qm_vd)_mm256_max_pd((__m256d)a, (__m256d)b);
#else
    return qm_vd_select(a > b, a, b);
#endif
}

static inline qm_vd qm_vd_sqrt(qm_vd a)
{
#if defined(__AVX512F__)
    return (qm_vd)_mm512_sqrt_pd((__m512d)a);
#elif defined(__AVX__)
    return (qm_vd)_mm256_sqrt_pd((__m256d)a);
#else
    return (qm_vd){__builtin_sqrt(a[0]), __builtin_sqrt(a[1])};
#endif
}

/** One bit a lane, set where the mask is all ones. */
static inline unsigned qm_vl_bits(qm_vl mask)
{
#if defined(__AVX512F__)
    return (unsigned)_mm512_movepi64_mask((__m512i)mask);
#elif defined(__AVX__)
    return (unsigned)_mm256_movemask_pd((__m256d)mask);
#else
    unsigned bits = 0;
    for (int i = 0; i < QM_WIDTH; i++)
        bits |= (unsigned)(mask[i] & 1) << i;
    return bits;
#endif
}

#endif
