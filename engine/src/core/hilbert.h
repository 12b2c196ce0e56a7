/**
 * hilbert.h: cells of a Hilbert curve, whose order keeps neighbours in space near in memory. A kernel
 * computes their positions along the curve (kernel/curve.c).
 */
#ifndef QM_HILBERT_H
#define QM_HILBERT_H

#include <stdint.h>

#define QM_HILBERT_BITS 12  /* an axis, at most; keys have three times as many */
#define QM_HILBERT_BATCH 64 /* cells that a kernel takes in one call */

/** Fixed-point coordinates of vertices, three to a word, finer than the cells of the curve: sums of up to
 * four fit their fields, so that the centroid of a face takes a few integer additions. */
enum { QM_FINE_FIELD = 20, QM_FINE_BITS = QM_HILBERT_BITS + 4 };

/** A batch of cells, by axis. Cells beyond the count of a call may hold anything. */
typedef struct qm_hilbert_cells {
    _Alignas(32) uint32_t axis[3][QM_HILBERT_BATCH];
} qm_hilbert_cells;

/** The cell of a coordinate; one beyond [-1, 1] is clamped to the nearest cell. */
static inline uint32_t qm_hilbert_quantise(double local)
{
    double cell = (local + 1.0) * (1 << (QM_HILBERT_BITS - 1)), last = (1 << QM_HILBERT_BITS) - 1;
    cell = cell > 0.0 ? cell : 0.0;
    return (uint32_t)(int32_t)(cell < last ? cell : last);
}

#endif
