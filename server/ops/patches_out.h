/**
 * patches_out.h: the regular patches of a mesh as text. Shared by the daemon and the command line.
 */
#ifndef QM_PATCHES_OUT_H
#define QM_PATCHES_OUT_H

#include "base/text.h"
#include "mesh_load.h"

/** The document of GET /v1/meshes/{id}/patches: rows, columns and faces (indices of the file, row by row) of each. */
void qm_patches_write_json(qm_text *out, const qm_loaded_mesh *mesh);

/** A record "face,patch,row,column" for each face of a patch, after a line with these names. */
void qm_patches_write_csv(qm_text *out, const qm_loaded_mesh *mesh);

#endif
