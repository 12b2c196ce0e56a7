/**
 * solids.h: a cache of what is known of a mesh in memory as a solid, for each reading of quads. It ends when the mesh is evicted
 * from memory, and with any moved vertex.
 *
 * Threads: all functions may be called from any thread.
 */
#ifndef QM_SOLIDS_H
#define QM_SOLIDS_H

#include "qm/solid.h"

typedef struct qm_solids qm_solids;

/** NULL if memory runs out. */
qm_solids *qm_solids_create(void);
void qm_solids_destroy(qm_solids *cache);

/** Forgets what is known: vertices have moved. */
void qm_solids_forget(qm_solids *cache);

/** What qm_solid_check says of the mesh, which is asked once; always without a cache (NULL). Its status. */
qm_status qm_solids_check(qm_solids *cache, qm_context *ctx, const qm_bvh *bvh, qm_quad_reading reading,
                          int thread_count, qm_solid *out);

#endif
