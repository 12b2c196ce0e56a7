/**
 * deviation_levels.h: levels of the distance, equally many for each power of two: a level is the exponent of a double and
 * the leading bits of its mantissa.
 */
#ifndef QM_DEVIATION_LEVELS_H
#define QM_DEVIATION_LEVELS_H

#include <math.h>
#include <string.h>

#include "core/vec.h"

/** count levels up to a greatest distance. Level 0 begins at 0, and the last one has no end. */
typedef struct qm_levels {
    int shift;      /* bits of a double that a level leaves out */
    size_t count;   /* of levels */
    uint64_t first; /* the leading bits of the distances of level 0 */
} qm_levels;

static inline uint64_t qm_levels_leading_bits(const qm_levels *levels, double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits >> levels->shift;
}

/** Levels with 2^bits of them for each power of two; greatest is positive. */
static inline qm_levels qm_levels_make(double greatest, int bits, size_t count)
{
    QM_ASSERT(greatest > 0.0);
    qm_levels levels = {.shift = 52 - bits, .count = count};
    uint64_t top = qm_levels_leading_bits(&levels, greatest) + 1;
    levels.first = top > count ? top - count : 0;
    return levels;
}

/** The level of a distance. */
static inline size_t qm_levels_find(const qm_levels *levels, double x)
{
    if (!(x > 0.0)) return 0;
    uint64_t bits = qm_levels_leading_bits(levels, x);
    if (bits < levels->first) return 0;
    return bits - levels->first < levels->count ? (size_t)(bits - levels->first) : levels->count - 1;
}

/** The least distance of a level, which is the upper end of the one before it. */
static inline double qm_levels_begin(const qm_levels *levels, size_t level)
{
    if (level == 0) return 0.0;
    if (level == levels->count) return INFINITY;
    uint64_t bits = (levels->first + level) << levels->shift;
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

#endif
