/**
 * reconstructions.h: reconstructions by id. What the store holds is enough to make one again: the source, the
 * layout, and the limits that its steps were taken with. Those in use, and a few that were last, are kept in
 * memory as they are, so that the next step goes on from there.
 *
 * One at a time works on a reconstruction; whoever comes second is told.
 */
#ifndef QM_RECONSTRUCTIONS_H
#define QM_RECONSTRUCTIONS_H

#include "mesh/meshes.h"
#include "ops/refine.h"

typedef struct qm_reconstructions qm_reconstructions;

qm_reconstructions *qm_reconstructions_create(qm_store *store, qm_meshes *meshes);
void qm_reconstructions_destroy(qm_reconstructions *reconstructions);

/** A reconstruction taken for work: released with qm_refining_release. */
typedef struct qm_refining {
    char id[QM_ID_SIZE];
    char source_id[QM_ID_SIZE];
    qm_context ctx;
    qm_source source;
    qm_reconstruction *reconstruction;
    qm_mesh_ref *mesh; /* of the source */
} qm_refining;

/**
 * Starts a reconstruction and stores it with its first mesh. layout_text is {nodes, curves, patches}. out is
 * the caller's, for qm_store_reconstruction_reset. False with a problem.
 */
bool qm_reconstructions_add(qm_reconstructions *reconstructions, const char *source, const char *layout_id,
                            const char *layout_text, const qm_reconstruction_options *options,
                            const qm_store_idempotency *once, qm_store_reconstruction *out,
                            qm_problem *problem);

/** Takes one for work, making it again when it is not in memory. NULL with a problem (404; 409: in work). */
qm_refining *qm_reconstructions_take(qm_reconstructions *reconstructions, const char *id,
                                     qm_problem *problem);
/** Without keeps it is dropped from memory: it has gone where the store has not, and is made again when
 * needed. */
void qm_reconstructions_release(qm_reconstructions *reconstructions, qm_refining *refining, bool keeps);

/**
 * Stores the steps that were taken with a limit of quads, with their records (objects with commas between),
 * and the mesh as it now is, whose id goes to mesh. Nothing is stored when no step was taken.
 */
bool qm_reconstructions_commit(qm_reconstructions *reconstructions, qm_refining *refining, size_t max_quads,
                               size_t step_count, const char *records, char mesh[QM_ID_SIZE],
                               qm_problem *problem);

/**
 * Goes over to an edited layout, in which only what the edit has touched is made anew: redone tells how many
 * patches. Stores it with its mesh. out as above. False with a problem; nothing has changed then.
 */
bool qm_reconstructions_edit(qm_reconstructions *reconstructions, const char *id, const char *layout_text,
                             qm_store_reconstruction *out, size_t *redone, qm_problem *problem);

qm_status qm_reconstructions_delete(qm_reconstructions *reconstructions, const char *id);

/** Quads of the mesh as it is now. */
size_t qm_refining_quads(const qm_refining *refining);

/** Adds what the patches are now, as members. */
void qm_refining_add_patches(const qm_refining *refining, qm_text *out);

#endif
