/**
 * deviation_sum.h: what the bounds of all pieces say of the whole: totals, and the share of the surface
 * within a distance. Lengths are local.
 */
#ifndef QM_DEVIATION_SUM_H
#define QM_DEVIATION_SUM_H

#include "deviation_piece.h"
#include "qm/deviation.h"

/** All pieces, and what cuts have leaked: by so much area they differ from the surface, in which no distance
 * is above farthest. */
typedef struct qm_piece_list {
    const qm_piece_bounds *bounds;
    size_t count;
    double leak, farthest;
} qm_piece_list;

#define QM_SHARE_ROWS 10

typedef struct qm_piece_totals {
    qm_interval area, mean, rms;
    double blur; /* mean of what the functions of all pieces leave open: percentiles are about as wide */
} qm_piece_totals;

/** Totals of the pieces. Mean and rms have an upper bound of INFINITY where no area is certain. */
qm_piece_totals qm_piece_sum(qm_piece_list pieces);

/** The greatest distance from the surface of any piece lies between these; both may be negative. */
qm_interval qm_piece_greatest(qm_piece_list pieces);

/**
 * The shares of the area with a distance of x[i] or less, for count ascending x >= 0.
 *
 * On P with d between the linear functions L and H, {H <= x} is part of {d <= x}, which is part of {L <= x};
 * the share of a triangle in which a linear function is at most x is known in closed form. With X the area
 * within x and Y the rest, X / (X + Y) grows with X and falls with Y. What has leaked may be in either.
 *
 * work  QM_SHARE_ROWS * (count + 1) long doubles
 */
void qm_piece_shares(qm_piece_list pieces, const double *x, size_t count, long double *work,
                     qm_interval *share);

/**
 * Percentiles: the least distance within which percent[i] of the area lies; greatest is no less than any
 * distance. Returns QM_OK or QM_E_NO_MEMORY.
 */
qm_status qm_piece_percentiles(qm_context *ctx, qm_piece_list pieces, double greatest, const double *percent,
                               size_t count, qm_interval *out);

/** Shares in the bins [i, i + 1) * greatest / count, the last one closed, however their borders are
 * rounded. */
qm_status qm_piece_histogram(qm_context *ctx, qm_piece_list pieces, double greatest, size_t count,
                             qm_interval *out);

#endif
