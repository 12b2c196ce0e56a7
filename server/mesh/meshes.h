/**
 * meshes.h: meshes in memory by id, each with its tree, counted by reference. One that is not in memory is
 * read back from its blob when it is asked for.
 *
 * All of it, and what jobs need besides, stays within a budget of memory: meshes that nobody uses are dropped
 * when it runs out, the least recently used first. What does not fit all the same is out of memory (507).
 */
#ifndef QM_MESHES_H
#define QM_MESHES_H

#include "ops/mesh_load.h"
#include "ops/problem.h"
#include "store/store.h"

typedef struct qm_meshes qm_meshes;

/** A mesh in use; released with qm_meshes_release. It stays alive and unchanged until then, also when it is
 * deleted. */
typedef struct qm_mesh_ref qm_mesh_ref;

/** memory_limit in bytes; threads prepare a mesh that has come in, or comes back from its blob. */
qm_meshes *qm_meshes_create(qm_store *store, qm_codec_limits limits, size_t memory_limit, int threads);

/** A context whose memory counts in the budget. */
qm_context qm_meshes_context(qm_meshes *meshes);

typedef struct qm_meshes_memory {
    size_t used, limit; /* bytes */
    size_t loaded;      /* meshes */
} qm_meshes_memory;
qm_meshes_memory qm_meshes_measure(qm_meshes *meshes);

/** Frees every mesh. No reference is left. */
void qm_meshes_destroy(qm_meshes *meshes);

/**
 * Takes an upload in, which is gone afterwards: the same bytes with the same options give the mesh that is
 * there (*is_new false). Decodes on the calling thread. Nothing of the upload is kept after a
 * fault. out is the caller's, for qm_store_mesh_reset.
 */
bool qm_meshes_add(qm_meshes *meshes, qm_blob_writer *upload, const char *name, qm_format format,
                   qm_store_mesh *out, bool *is_new, qm_problem *problem);

/** Takes a reference; reads the mesh from its blob when needed. NULL with a problem when there is none. */
qm_mesh_ref *qm_meshes_acquire(qm_meshes *meshes, const char *id, qm_problem *problem);
const qm_loaded_mesh *qm_mesh_ref_get(const qm_mesh_ref *ref);
void qm_meshes_release(qm_meshes *meshes, qm_mesh_ref *ref);

/** New places of vertices: of all, in order, or of some. */
typedef struct qm_moved_vertices {
    uint32_t *indices; /* count, each once or more, the last place counts; NULL: all vertices */
    double *positions; /* count rows of x y z; both on the heap */
    size_t count;
} qm_moved_vertices;

void qm_moved_vertices_reset(qm_moved_vertices *moved);

typedef struct qm_deformed {
    uint64_t revision;
    size_t updated_nodes; /* boxes and radii that were found anew */
    double refit_ms;      /* to find them; reading and storing left out */
    char hash[QM_HASH_SIZE];
} qm_deformed;

/**
 * Makes the next revision of a mesh: on disk before it returns, and in memory. Who holds a reference keeps
 * the revision that it has. if_match is a list of entity tags that the mesh must be among, or NULL. False
 * with a problem, and then nothing has changed.
 */
bool qm_meshes_deform(qm_meshes *meshes, const char *id, const qm_moved_vertices *moved, const char *if_match,
                      qm_deformed *out, qm_problem *problem);

/**
 * Reads the body of a deformation: rows "positions", for the vertices named by "indices", or without them for
 * all. Returns true and fills *out, for qm_moved_vertices_reset; or false and fills *problem (400, 507).
 */
bool qm_json_read_moved_vertices(const char *text, size_t size, qm_moved_vertices *out, qm_problem *problem);

/** Deletes a mesh; if_match as above. False with a problem, and then nothing has changed. */
bool qm_meshes_delete(qm_meshes *meshes, const char *id, const char *if_match, qm_problem *problem);

#endif
