/**
 * wide.h: vectors of 113 bits (wide) and of 64 (long double), for references that are to be far more exact
 * than the engine. Nothing but the four operations of each is used, so no library is needed for wide.
 */
#ifndef QM_WIDE_H
#define QM_WIDE_H

#include <math.h>
#include <stdbool.h>

typedef __float128 qm_wide;
typedef long double qm_long;

/** A vector type of a number, and its operations, named with a prefix. */
#define QM_DEFINE_VECTOR(number, vector, prefix)                                                             \
    typedef struct vector {                                                                                  \
        number x, y, z;                                                                                      \
    } vector;                                                                                                \
    static inline vector prefix##_add(vector a, vector b)                                                    \
    {                                                                                                        \
        return (vector){a.x + b.x, a.y + b.y, a.z + b.z};                                                    \
    }                                                                                                        \
    static inline vector prefix##_sub(vector a, vector b)                                                    \
    {                                                                                                        \
        return (vector){a.x - b.x, a.y - b.y, a.z - b.z};                                                    \
    }                                                                                                        \
    static inline vector prefix##_scale(number t, vector a)                                                  \
    {                                                                                                        \
        return (vector){t * a.x, t * a.y, t * a.z};                                                          \
    }                                                                                                        \
    static inline vector prefix##_axpy(vector a, number t, vector b)                                         \
    {                                                                                                        \
        return (vector){a.x + t * b.x, a.y + t * b.y, a.z + t * b.z};                                        \
    }                                                                                                        \
    static inline vector prefix##_lerp(vector a, vector b, number t)                                         \
    {                                                                                                        \
        return prefix##_axpy(a, t, prefix##_sub(b, a));                                                      \
    }                                                                                                        \
    static inline number prefix##_dot(vector a, vector b)                                                    \
    {                                                                                                        \
        return a.x * b.x + a.y * b.y + a.z * b.z;                                                            \
    }                                                                                                        \
    static inline vector prefix##_cross(vector a, vector b)                                                  \
    {                                                                                                        \
        return (vector){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};                \
    }                                                                                                        \
    static inline number prefix##_clamp(number t)                                                            \
    {                                                                                                        \
        return t < 0 ? 0 : t > 1 ? 1 : t;                                                                    \
    }                                                                                                        \
    static inline number prefix##_least(number a, number b)                                                  \
    {                                                                                                        \
        return a < b ? a : b;                                                                                \
    }                                                                                                        \
    static inline number prefix##_greatest(number a, number b)                                               \
    {                                                                                                        \
        return a > b ? a : b;                                                                                \
    }

QM_DEFINE_VECTOR(qm_wide, qm_wide_vec, qm_wide)
QM_DEFINE_VECTOR(qm_long, qm_long_vec, qm_long)

/** The square root, to 2^-110 of itself: both formats have the same exponents, and one step of Newton's
 * doubles the 64 bits that sqrtl gives. */
static inline qm_wide qm_wide_sqrt(qm_wide x)
{
    if (!(x > 0)) return 0;
    qm_wide root = sqrtl((qm_long)x);
    return (root + x / root) / 2;
}

static inline qm_wide qm_wide_length(qm_wide_vec a)
{
    return qm_wide_sqrt(qm_wide_dot(a, a));
}

static inline qm_long qm_long_length(qm_long_vec a)
{
    return sqrtl(qm_long_dot(a, a));
}

static inline qm_long_vec qm_wide_round(qm_wide_vec a)
{
    return (qm_long_vec){(qm_long)a.x, (qm_long)a.y, (qm_long)a.z};
}

static inline qm_wide_vec qm_long_widen(qm_long_vec a)
{
    return (qm_wide_vec){a.x, a.y, a.z};
}

#endif
