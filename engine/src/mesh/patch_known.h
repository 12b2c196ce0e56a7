/**
 * patch_known.h: patches of a mesh that tells the grids it was made of.
 */
#ifndef QM_PATCH_KNOWN_H
#define QM_PATCH_KNOWN_H

#include "qm/patch.h"

/** True when the grids of a mesh take all of its faces, and neighbours in them share their corners. */
bool qm_patch_grids_hold(const qm_mesh *mesh);

/** The patches are the grids, which hold. QM_OK or QM_E_NO_MEMORY, with nothing to free. */
qm_status qm_patch_set_from_grids(qm_context *ctx, const qm_mesh *mesh, qm_patch_set *out);

#endif
