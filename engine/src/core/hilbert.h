/**
 * hilbert.h: order of points along a Hilbert curve, which keeps neighbours in space near in memory. The
 * places of cells along it are a kernel's (kernel/curve.c).
 */
#ifndef QM_HILBERT_H
#define QM_HILBERT_H

#include <stdint.h>

#define QM_HILBERT_BITS 12     /* an axis at most; keys have three times as many */
#define QM_HILBERT_TOGETHER 64 /* cells that a kernel takes at once */

/** Vertices in whole numbers, three to a word, finer than the cells of the curve: sums of up to four fit
 * their fields, so that the middles of faces come from a few additions. */
enum { QM_FINE_FIELD = 20, QM_FINE_BITS = QM_HILBERT_BITS + 4 };

/** Cells of the curve by axis. Those past the ones that are asked for may hold anything. */
typedef struct qm_hilbert_cells {
    _Alignas(32) uint32_t axis[3][QM_HILBERT_TOGETHER];
} qm_hilbert_cells;

/** The cell of a coordinate; one beyond [-1, 1] counts as in the nearest cell. */
static inline uint32_t qm_hilbert_quantise(double local)
{
    double cell = (local + 1.0) * (1 << (QM_HILBERT_BITS - 1)), last = (1 << QM_HILBERT_BITS) - 1;
    cell = cell > 0.0 ? cell : 0.0;
    return (uint32_t)(int32_t)(cell < last ? cell : last);
}

#endif
