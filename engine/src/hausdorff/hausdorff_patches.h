/** hausdorff_patches.h: covers of a polygon of the source by patches of the target, cell by cell. */
#ifndef QM_HAUSDORFF_PATCHES_H
#define QM_HAUSDORFF_PATCHES_H

#include "hausdorff_candidates.h"

/**
 * Covers a polygon by cells that are each shown to be within the cutoff of one patch among the candidates. False
 * when something remains: the polygon is then the remainder, its in_reach not set, and *moved is set where that
 * is less than before. The target has patches.
 */
bool qm_patches_cover(const qm_piece_work *work, qm_polygon *polygon, bool *moved);

#endif
