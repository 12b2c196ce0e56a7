/**
 * deviation_sum.h: the distribution over all pieces: shares of the surface within a distance, percentiles and
 * histogram. Lengths are local.
 */
#ifndef QM_DEVIATION_SUM_H
#define QM_DEVIATION_SUM_H

#include "deviation_survey.h"

#define QM_SHARE_ROWS 10

/** Areas of some pieces with a distance of x or less, and of more: bounds of both that hold together. */
typedef struct qm_deviation_areas {
    long double least_within, most_beyond, most_within, least_beyond;
} qm_deviation_areas;

/**
 * The areas within count ascending x >= 0 and beyond them, of the pieces whose group is wanted; of all with group NULL. work as
 * below. The leak is not in them.
 *
 * Returns QM_OK; QM_E_CANCELED, and areas are undefined.
 */
qm_status qm_deviation_find_areas(qm_context *ctx, qm_deviation_piece_list pieces, const int8_t *group,
                                  int8_t wanted, const double *x, size_t count, long double *work,
                                  qm_deviation_areas *areas);

/** Orders doubles, for qsort and bsearch. */
int qm_deviation_compare_numbers(const void *a, const void *b);

/** What roundings may add to a share of the area of so many pieces, or take from it. */
double qm_deviation_share_error(size_t piece_count);

/** The share of the area within, of areas that are those of all pieces together; the leak may belong to either. */
qm_interval qm_deviation_share(const qm_deviation_areas *areas, double leak, size_t piece_count);

/**
 * The shares of the area with a distance of x[i] or less, for count ascending x >= 0.
 *
 * On P with d between the linear functions L and H, {H <= x} is part of {d <= x}, which is part of {L <= x};
 * the share of a triangle in which a linear function is at most x is known in closed form. With X the area
 * within x and Y the rest, X / (X + Y) grows with X and falls with Y. The leak may belong to either.
 *
 * work  QM_SHARE_ROWS * (count + 1) long doubles
 *
 * Returns QM_OK; QM_E_CANCELED or QM_E_NO_MEMORY, and share is undefined.
 */
qm_status qm_deviation_shares(qm_context *ctx, qm_deviation_piece_list pieces, const double *x, size_t count,
                              long double *work, qm_interval *share);

/**
 * Percentiles: the least distance within which percent[i] of the area lies; max is no less than any
 * distance. They start from a survey of the pieces, so that a canceled call leaves intervals that hold; with
 * pieces NULL they come from the survey alone.
 * Returns QM_OK, QM_E_CANCELED or QM_E_NO_MEMORY.
 */
qm_status qm_deviation_percentiles(qm_context *ctx, const qm_deviation_piece_list *pieces,
                                   const qm_deviation_survey *survey, double max, const double *percent,
                                   size_t count, qm_interval *out);

/** Shares in the bins [i, i + 1) * max / count, the last one closed, however their borders are
 * rounded. As above. */
qm_status qm_deviation_histogram(qm_context *ctx, const qm_deviation_piece_list *pieces,
                                 const qm_deviation_survey *survey, double max, size_t count,
                                 qm_interval *out);

#endif
