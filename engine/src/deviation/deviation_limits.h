/**
 * deviation_limits.h: the share of the surface within each of a few limits.
 */
#ifndef QM_DEVIATION_LIMITS_H
#define QM_DEVIATION_LIMITS_H

#include "deviation_sum.h"

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

#endif
