/**
 * data_mesh.h: real meshes from a data folder, which need not be there: QM_TEST_DATA, or ../shared/data.
 */
#ifndef QM_DATA_MESH_H
#define QM_DATA_MESH_H

#include "qm/mesh.h"

/** The folder; qm_data_is_there tells whether it can be read. */
const char *qm_data_folder(void);
bool qm_data_is_there(void);

/** Reads a mesh by its name in the folder, e.g. "pairs/spot/tri.obj"; a fault ends the test. The mesh is the
 * context's, for qm_mesh_reset. */
void qm_data_mesh_read(qm_context *ctx, const char *name, qm_mesh *mesh);

#endif
