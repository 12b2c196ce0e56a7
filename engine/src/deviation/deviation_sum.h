/**
 * deviation_sum.h: totals and distribution from the bounds of all pieces: mean, rms, area, and the share of
 * the surface within a distance. Lengths are local.
 */
#ifndef QM_DEVIATION_SUM_H
#define QM_DEVIATION_SUM_H

#include "deviation_piece.h"
#include "qm/deviation.h"

/** All pieces; leak, the area by which they may differ from the surface; and farthest, which no distance
 * exceeds. */
typedef struct qm_deviation_piece_list {
    const qm_deviation_bounds *bounds;
    size_t count;
    double leak, farthest;
} qm_deviation_piece_list;

#define QM_SHARE_ROWS 10

typedef struct qm_deviation_totals {
    qm_interval area, mean, rms;
    double blur; /* mean blur of all pieces: percentiles are about as wide */
} qm_deviation_totals;

/** Totals of the pieces. Mean and rms have an upper bound of INFINITY where no area is certain. */
qm_deviation_totals qm_deviation_sum(qm_deviation_piece_list pieces);

/** The interval of the greatest distance over all pieces; both ends may be negative. */
qm_interval qm_deviation_max(qm_deviation_piece_list pieces);

/**
 * The shares of the area with a distance of x[i] or less, for count ascending x >= 0.
 *
 * On P with d between the linear functions L and H, {H <= x} is part of {d <= x}, which is part of {L <= x};
 * the share of a triangle in which a linear function is at most x is known in closed form. With X the area
 * within x and Y the rest, X / (X + Y) grows with X and falls with Y. The leak may belong to either.
 *
 * work  QM_SHARE_ROWS * (count + 1) long doubles
 */
void qm_deviation_shares(qm_deviation_piece_list pieces, const double *x, size_t count, long double *work,
                         qm_interval *share);

/**
 * Percentiles: the least distance within which percent[i] of the area lies; max is no less than any
 * distance. Returns QM_OK or QM_E_NO_MEMORY.
 */
qm_status qm_deviation_percentiles(qm_context *ctx, qm_deviation_piece_list pieces, double max,
                                   const double *percent, size_t count, qm_interval *out);

/** Shares in the bins [i, i + 1) * max / count, the last one closed, however their borders are
 * rounded. */
qm_status qm_deviation_histogram(qm_context *ctx, qm_deviation_piece_list pieces, double max, size_t count,
                                 qm_interval *out);

#endif
