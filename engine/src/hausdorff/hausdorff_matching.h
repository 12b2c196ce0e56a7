/**
 * hausdorff_matching.h: the lower stage of the thesis's own bounds, in two files.
 *
 *   hausdorff_matching.c         pieces: measured at their corners, let go, queued, cut in four
 *   hausdorff_matching_upper.c   upper bounds from the facets under the corners
 */
#ifndef QM_HAUSDORFF_MATCHING_H
#define QM_HAUSDORFF_MATCHING_H

#include "hausdorff_search.h"
#include "prim/bilinear_point.h"

/** The facet of a pack that is nearest to a point, as QM_PACK_LANES * pack + lane: a patch by its first
 * lane. */
uint32_t qm_matching_facet(const qm_search *search, const qm_side *side, uint32_t pack, qm_vec p);

/**
 * Upper bound (local) of the distance of any point of a piece, whose corners have their facets and distances.
 * Not looked at any further once it is small enough to let the piece go.
 */
double qm_matching_upper(const qm_search *search, const qm_side *side, const qm_piece *piece);

/** The midpoints of the sides (i to i + 1), and the centre. */
static inline qm_vec qm_matching_middles(const qm_piece *piece, qm_vec middle[4])
{
    int count = piece->corner_count;
    qm_vec centre = {0, 0, 0};
    for (int i = 0; i < count; i++) {
        middle[i] = qm_vec_mix(piece->corner[i], piece->corner[(i + 1) % count], 0.5);
        centre = qm_vec_axpy(centre, 1.0 / count, piece->corner[i]);
    }
    return centre;
}

#endif
