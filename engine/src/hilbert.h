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

/** Two levels of the curve at once: next[state][cell] and key[state][cell], cell = x1 x0 y1 y0 z1 z0. */
typedef struct qm_hilbert_table {
    uint8_t key[QM_HILBERT_STATES][64];
    uint8_t next[QM_HILBERT_STATES][64];
} qm_hilbert_table;

/** Fills the table; takes a few microseconds, so that callers can keep it on their stack. */
void qm_hilbert_table_init(qm_hilbert_table *table);

/** Place along the curve of a cell; x, y, z below 2^QM_HILBERT_BITS. */
static inline uint64_t qm_hilbert_key(const qm_hilbert_table *table, uint32_t x, uint32_t y, uint32_t z)
{
    uint64_t key = 0;
    unsigned state = 0;
    for (int shift = QM_HILBERT_BITS - 2; shift >= 0; shift -= 2) {
        unsigned cell = ((x >> shift) & 3) << 4 | ((y >> shift) & 3) << 2 | ((z >> shift) & 3);
        key = key << 6 | table->key[state][cell];
        state = table->next[state][cell];
    }
    return key;
}

static inline uint32_t qm_hilbert_quantise(double local)
{
    double cell = (local + 1.0) * (1 << (QM_HILBERT_BITS - 1));
    return (uint32_t)qm_clamp(cell, 0.0, (1 << QM_HILBERT_BITS) - 1);
}

/** Place along the curve of a point; coordinates beyond [-1, 1] count as the nearest cell. */
static inline uint64_t qm_hilbert_point_key(const qm_hilbert_table *table, qm_vec p)
{
    return qm_hilbert_key(table, qm_hilbert_quantise(p.x), qm_hilbert_quantise(p.y),
                          qm_hilbert_quantise(p.z));
}

#endif
