/**
 * reconstructions.h: the table of reconstructions. The store has enough to rebuild one: the source, the
 * layout, and the limits that its steps were taken with. Reconstructions in use, and a few that were used
 * last, stay in memory, so that the next step continues from there.
 *
 * A reconstruction is leased to one thread at a time; a second one gets a problem (409). Every call may come
 * from any thread.
 */
#ifndef QM_RECONSTRUCTIONS_H
#define QM_RECONSTRUCTIONS_H

#include "mesh/meshes.h"
#include "ops/refine.h"

typedef struct qm_reconstructions qm_reconstructions;

qm_reconstructions *qm_reconstructions_create(qm_store *store, qm_meshes *meshes);
void qm_reconstructions_destroy(qm_reconstructions *reconstructions);

/** A reconstruction that its holder alone works on, until qm_reconstructions_release. */
typedef struct qm_reconstruction_lease {
    char id[QM_ID_SIZE];
    char source_id[QM_ID_SIZE];
    qm_context ctx;
    qm_ref_surface source;
    qm_reconstruction *reconstruction;
    qm_mesh_ref *mesh; /* of the source */
} qm_reconstruction_lease;

/**
 * Creates a reconstruction, with the flags of host, and stores it with its first mesh. layout_text is {nodes, curves, patches}. out is
 * the caller's, for qm_store_reconstruction_reset. False with a problem, and then nothing is stored.
 */
bool qm_reconstructions_add(qm_reconstructions *reconstructions, const char *source, const char *layout_id,
                            const char *layout_text, const qm_reconstruction_options *options,
                            const qm_context *host, const qm_store_idempotency *idempotency,
                            qm_store_reconstruction *out, qm_problem *problem);

/**
 * Leases a reconstruction, which is rebuilt when it is not in memory: with the flags of host, or, for NULL, to its end.
 * NULL with a problem (404; 409: leased, or canceled while it was rebuilt).
 */
qm_reconstruction_lease *qm_reconstructions_take(qm_reconstructions *reconstructions, const char *id,
                                                 const qm_context *host, qm_problem *problem);
/** Ends a lease. Without keeps the reconstruction is dropped from memory: its state is not the stored one. */
void qm_reconstructions_release(qm_reconstructions *reconstructions, qm_reconstruction_lease *refining,
                                bool keeps);

/** Stores the end of the steps with their effect, NULL when there were none; mesh is the id of the current mesh. */
typedef qm_stored qm_reconstructions_end_fn(void *user, const char *mesh, const qm_store_effect *effect);

/**
 * Has the steps that were taken with a limit of quads stored by end, with their records (objects with commas
 * between) and their mesh: all of it, or nothing. settled is that mesh with vertices that have moved, or NULL; the next
 * steps do not start from it. False with a problem.
 */
bool qm_reconstructions_commit(qm_reconstructions *reconstructions, qm_reconstruction_lease *refining,
                               size_t max_quads, size_t step_count, const char *records,
                               const qm_mesh *settled, qm_reconstructions_end_fn *end, void *user,
                               qm_problem *problem);

/**
 * Replaces the layout by an edited one, rebuilds the patches that the edit has changed (redone is their
 * number), with the flags of host, and stores it with its mesh. out as above. False with a problem, and then nothing has changed.
 */
bool qm_reconstructions_edit(qm_reconstructions *reconstructions, const char *id, const char *layout_text,
                             const qm_context *host, qm_store_reconstruction *out, size_t *redone,
                             qm_problem *problem);

qm_stored qm_reconstructions_delete(qm_reconstructions *reconstructions, const char *id);

/** Number of quads of the current mesh. */
size_t qm_reconstructions_count_quads(const qm_reconstruction_lease *refining);

/** Adds the current patches as a JSON member. */
void qm_reconstructions_add_patches(const qm_reconstruction_lease *refining, qm_text *out);

#endif
