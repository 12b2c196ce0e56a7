/**
 * hilbert.h: order of points along a Hilbert curve, which keeps neighbours in space near in memory.
 *
 * Source: C. Hamilton, Compact Hilbert Indices, Dalhousie University, CS-2006-07, 2006 (entry points,
 * directions).
 */
#ifndef QM_HILBERT_H
#define QM_HILBERT_H

#include <stdint.h>

#include "vec.h"

#define QM_HILBERT_BITS 12 /* an axis; keys have three times as many */
#define QM_HILBERT_STATES 24

/** Two levels of the curve at once, by state and cell (x1 y1 z1 x0 y0 z0): the key's six bits, above them the
 * next state. */
typedef struct qm_hilbert_table {
    uint16_t step[QM_HILBERT_STATES * 64];
    uint32_t spread[64]; /* bit i of the index at bit 3 i */
} qm_hilbert_table;

/** Fills the table; takes about a microsecond, so that callers can keep it on their stack. */
void qm_hilbert_table_init(qm_hilbert_table *table);

/** The low 12 bits of x, two zeros after each. */
static inline uint64_t qm_hilbert_spread(const qm_hilbert_table *table, uint32_t x)
{
    return (uint64_t)table->spread[x >> 6 & 63] << 18 | table->spread[x & 63];
}

/** Place along the curve of a cell; x, y, z below 2^bits, an even number up to QM_HILBERT_BITS. */
static inline uint64_t qm_hilbert_key(const qm_hilbert_table *table, uint32_t x, uint32_t y, uint32_t z,
                                      int bits)
{
    uint64_t cells =
        qm_hilbert_spread(table, x) << 2 | qm_hilbert_spread(table, y) << 1 | qm_hilbert_spread(table, z);
    uint64_t key = 0;
    unsigned state = 0;
    for (int shift = 3 * bits - 6; shift >= 0; shift -= 6) {
        unsigned step = table->step[state | (unsigned)(cells >> shift & 63)];
        key = key << 6 | (step & 63);
        state = step & ~63u;
    }
    return key;
}

static inline uint32_t qm_hilbert_quantise(double local)
{
    double cell = (local + 1.0) * (1 << (QM_HILBERT_BITS - 1)), last = (1 << QM_HILBERT_BITS) - 1;
    cell = cell > 0.0 ? cell : 0.0;
    return (uint32_t)(int32_t)(cell < last ? cell : last);
}

/** Place along the curve of a point; coordinates beyond [-1, 1] count as the nearest cell. */
static inline uint64_t qm_hilbert_point_key(const qm_hilbert_table *table, qm_vec p)
{
    return qm_hilbert_key(table, qm_hilbert_quantise(p.x), qm_hilbert_quantise(p.y), qm_hilbert_quantise(p.z),
                          QM_HILBERT_BITS);
}

#endif
