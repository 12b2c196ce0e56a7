/**
 * patch_merge.h: blocks of quads joined where they share a whole side.
 */
#ifndef QM_PATCH_MERGE_H
#define QM_PATCH_MERGE_H

#include "patch_grid.h"

/**
 * Takes cuts away between blocks that share a whole side, longest side first, until no two do. block has
 * count entries, owner tells the block of each face; both are used up on the way.
 *
 * Returns QM_OK, QM_E_NO_MEMORY or QM_E_CANCELED.
 */
qm_status qm_patch_merge(qm_context *ctx, qm_patch_links *links, qm_quad_cell_block *block, size_t count,
                         uint32_t *owner);

#endif
