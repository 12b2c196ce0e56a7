/**
 * deviation_limits.c: shares of the surface within limits, in the order in which the limits are given.
 *
 * The sums over pieces take ascending distances. A limit becomes a local length by a power of two, which is exact
 * unless the length is below the least normal number; it is then off by 2^-1074 at most. Functions of pieces are widened
 * by eta, of which 2 u S are to spare (deviation_piece.h), and S is never as small as that.
 */
#include "deviation_limits.h"

#include <math.h>
#include <stdlib.h>

/** A limit as a local length, and its place among the limits. */
typedef struct local_limit {
    double length;
    size_t index;
} local_limit;

static int compare_limits(const void *a, const void *b)
{
    double x = ((const local_limit *)a)->length, y = ((const local_limit *)b)->length;
    return (x > y) - (x < y);
}

/** The shares within ascending lengths: of the pieces, or where there are none or the call is canceled, of the
 * survey, which counts distances below a length. */
static qm_status find_shares(qm_context *ctx, const qm_deviation_piece_list *pieces,
                             const qm_deviation_survey *survey, const double *length, size_t count,
                             long double *work, qm_interval *share)
{
    qm_status status = pieces ? qm_deviation_shares(ctx, *pieces, length, count, work, share) : QM_OK;
    for (size_t i = 0; (!pieces || status != QM_OK) && i < count; i++)
        share[i] = (qm_interval){qm_deviation_survey_share(survey, length[i]).lower,
                                 qm_deviation_survey_share(survey, nextafter(length[i], INFINITY)).upper};
    return status;
}

qm_status qm_deviation_limit_shares(qm_context *ctx, const qm_deviation_piece_list *pieces,
                                    const qm_deviation_survey *survey, double scale, const double *limit,
                                    qm_deviation *out)
{
    size_t count = out->limit_count;
    if (count == 0) return QM_OK;
    local_limit *local = qm_context_alloc(ctx, count, sizeof *local);
    double *length = qm_context_alloc(ctx, count, sizeof *length);
    qm_interval *share = qm_context_alloc(ctx, count, sizeof *share);
    long double *work = qm_context_alloc(ctx, QM_SHARE_ROWS * (count + 1), sizeof *work);
    qm_status status = QM_E_NO_MEMORY;
    if (local && length && share && work) {
        for (size_t i = 0; i < count; i++)
            local[i] = (local_limit){limit[i] * scale, i};
        qsort(local, count, sizeof *local, compare_limits);
        for (size_t i = 0; i < count; i++)
            length[i] = local[i].length;
        status = find_shares(ctx, pieces, survey, length, count, work, share);
        for (size_t i = 0; i < count; i++) {
            double x = limit[local[i].index];
            out->share[local[i].index] = x >= out->max.upper ? (qm_interval){1.0, 1.0}
                                         : x < out->least    ? (qm_interval){0.0, 0.0}
                                                             : share[i];
        }
    }
    qm_context_free(ctx, local, count, sizeof *local);
    qm_context_free(ctx, length, count, sizeof *length);
    qm_context_free(ctx, share, count, sizeof *share);
    qm_context_free(ctx, work, QM_SHARE_ROWS * (count + 1), sizeof *work);
    return status == QM_E_NO_MEMORY ? qm_context_fail(ctx, status, "out of memory for the shares") : status;
}
