/**
 * deviation_limits.h: the share of the surface within each of a few limits, or in bands of signed distances.
 */
#ifndef QM_DEVIATION_LIMITS_H
#define QM_DEVIATION_LIMITS_H

#include "deviation_sum.h"

/** Sides of pieces. */
enum {
    QM_PIECE_BEHIND = -1,
    QM_PIECE_OPEN = 0,
    QM_PIECE_FRONT = 1,
    QM_PIECE_UNKNOWN = 2,
    QM_PIECE_SIDES = 3
};

/** The side of each piece, and the sums of their areas, low and high, from BEHIND to FRONT. */
typedef struct qm_deviation_groups {
    const int8_t *side;
    long double area[QM_PIECE_SIDES][2];
} qm_deviation_groups;

/**
 * Sets out->share, of which there are as many as limits, from pieces, or from a survey alone where pieces is NULL.
 *
 * A limit that is no less than out->max.upper has all of the surface within it, and one that is less than out->least
 * nothing: these shares are exact, and so are those of a surface that coincides with the target.
 *
 * scale  from the unit of the meshes to local lengths, a power of two
 *
 * Returns QM_OK; QM_E_CANCELED, and the shares are those of the survey; QM_E_NO_MEMORY.
 */
qm_status qm_deviation_limit_shares(qm_context *ctx, const qm_deviation_piece_list *pieces,
                                    const qm_deviation_survey *survey, double scale, const double *limit,
                                    qm_deviation *out);

/**
 * The shares in count bands of local signed distances, positive in front. A piece that is on neither side for sure counts as either
 * in every interval.
 *
 * Returns QM_OK; QM_E_CANCELED or QM_E_NO_MEMORY, and share is as before.
 */
qm_status qm_deviation_band_shares(qm_context *ctx, qm_deviation_piece_list pieces,
                                   const qm_deviation_groups *groups, const qm_interval *band, size_t count,
                                   qm_interval *share);

#endif
