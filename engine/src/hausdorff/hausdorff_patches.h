/** hausdorff_patches.h: covers of a part of the source by patches of the target, cell by cell. */
#ifndef QM_HAUSDORFF_PATCHES_H
#define QM_HAUSDORFF_PATCHES_H

#include "hausdorff_candidates.h"
#include "prim/bilinear_match.h"

typedef enum qm_patches_cover {
    QM_PATCHES_NONE,   /* nothing is covered, */
    QM_PATCHES_COARSE, /* though one bent patch is near all corners: of smaller parts the bound would be less */
    QM_PATCHES_SOME,   /* the polygon is now the remainder */
    QM_PATCHES_ALL
} qm_patches_cover;

/**
 * Covers a polygon by cells that are each shown to be within the cutoff of one patch among the candidates. When some is
 * covered and some is not, in_reach is not set. The target has patches.
 */
qm_patches_cover qm_patches_cover_polygon(const qm_piece_work *work, qm_polygon *polygon);

/**
 * Finds a rectangle in the middle of the piece, which is a rectangle of source, that one patch of the target is shown to
 * cover: up to where the lines through the centre leave it. quad is that patch, near the centre. False when there is
 * none, it is small beside the piece, or it leaves thin strips of the piece, as copies of one face do.
 */
bool qm_patches_cover_middle(const qm_piece_work *work, const qm_bilinear *source, qm_vec centre,
                             qm_near_quad *quad, qm_uv_box *middle);

#endif
