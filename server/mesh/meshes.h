/**
 * meshes.h: the table of meshes in memory, each with its bounding volume hierarchy, counted by reference. A
 * mesh that is not in memory is read back from its blob when it is acquired.
 *
 * Meshes and jobs share a budget of memory. When it runs out, meshes without a reference are dropped, the
 * least recently used first; when there is none, the allocation fails (507).
 *
 * Threads: every call may come from any thread.
 */
#ifndef QM_MESHES_H
#define QM_MESHES_H

#include "base/host.h"
#include "ops/mesh_load.h"
#include "ops/problem.h"
#include "store/store.h"

typedef struct qm_meshes qm_meshes;

/** A reference to a mesh, for qm_meshes_release. Until then the mesh stays alive and unchanged, also when it
 * is deleted or deformed. */
typedef struct qm_mesh_ref qm_mesh_ref;

/** memory_limit is in bytes; `threads` threads prepare a mesh that is uploaded or read back. */
qm_meshes *qm_meshes_create(qm_store *store, qm_codec_limits limits, size_t memory_limit, int threads);

/** The budget that meshes and jobs share. */
qm_budget *qm_meshes_budget(qm_meshes *meshes);

/** A context that allocates from the budget. */
qm_context qm_meshes_context(qm_meshes *meshes);

typedef struct qm_meshes_memory {
    size_t used, limit; /* bytes */
    size_t loaded;      /* meshes */
} qm_meshes_memory;
qm_meshes_memory qm_meshes_measure(qm_meshes *meshes);

/** Frees every mesh. No reference may be left. */
void qm_meshes_destroy(qm_meshes *meshes);

#define QM_MESHES_MAX_TTL_S 3155760000.0 /* a hundred years */

/**
 * Makes a mesh of an upload, which it takes over: equal bytes with equal options give the mesh that exists
 * (*is_new false), which then lives for the longer of both times. Decodes on the calling thread.
 *
 * ttl_s  seconds after which the mesh is removed, unless an unfinished job, a layout or a reconstruction needs
 *        it; 0: never
 * out    the caller's, for qm_store_mesh_reset
 *
 * False with a problem, and then nothing of the upload is kept.
 */
bool qm_meshes_add(qm_meshes *meshes, qm_blob_writer *upload, const char *name, qm_format format,
                   double ttl_s, qm_store_mesh *out, bool *is_new, qm_problem *problem);

/** Stores a mesh of an upload, which is_new or stored already, with a row that names it: both, or none. No other thread
 * removes a mesh meanwhile. QM_STORED_TAKEN: the mesh is no longer new; others that are not QM_STORED with a problem. */
typedef qm_stored qm_mesh_put_fn(void *user, const qm_store_mesh *mesh, bool is_new, qm_problem *problem);

/** Makes a mesh of an upload, without a time to live, that put stores. */
bool qm_meshes_add_with(qm_meshes *meshes, qm_blob_writer *upload, const char *name, qm_format format,
                        qm_mesh_put_fn *put, void *user, qm_problem *problem);

/** Makes a mesh without a name of a blob that no mesh has; out is as above. False with a problem. */
bool qm_meshes_adopt(qm_meshes *meshes, const char *hash, qm_store_mesh *out, qm_problem *problem);

/** Takes a reference; reads the mesh from its blob when needed. NULL with a problem. */
qm_mesh_ref *qm_meshes_acquire(qm_meshes *meshes, const char *id, qm_problem *problem);

/** Makes a mesh of bytes that is in no list and no store, and lives as long as its reference. False with a problem. */
bool qm_meshes_load_apart(qm_meshes *meshes, const uint8_t *bytes, size_t size, qm_format format,
                          qm_mesh_ref **out, qm_problem *problem);

/** True when the mesh is in memory at this moment, so that the call above need not wait. */
bool qm_meshes_has_loaded(qm_meshes *meshes, const char *id);
const qm_loaded_mesh *qm_mesh_ref_get(const qm_mesh_ref *ref);
void qm_meshes_release(qm_meshes *meshes, qm_mesh_ref *ref);

/** New positions of vertices: of all, in order, or of some. */
typedef struct qm_moved_vertices {
    uint32_t *indices; /* count; of one that is repeated the last position counts; NULL: all vertices */
    double *positions; /* count rows of x y z; both on the heap */
    size_t count;
} qm_moved_vertices;

void qm_json_reset_moved_vertices(qm_moved_vertices *moved);

typedef struct qm_deformed {
    uint64_t revision;
    size_t updated_nodes; /* number of refitted nodes */
    double refit_ms;      /* time of the refit, without reading and storing */
    char hash[QM_HASH_SIZE];
} qm_deformed;

/**
 * Makes the next revision of a mesh: on disk before it returns, and in memory. Holders of a reference keep
 * their revision. if_match is a list of entity tags, one of which must be the mesh's, or NULL. False with a
 * problem, and then nothing has changed.
 */
bool qm_meshes_deform(qm_meshes *meshes, const char *id, const qm_moved_vertices *moved, const char *if_match,
                      qm_deformed *out, qm_problem *problem);

/**
 * Reads the body of a deformation: "positions" of the vertices in "indices", or of all without it. Returns
 * true and fills *out, for qm_json_reset_moved_vertices; or false and fills *problem (400, 507).
 */
bool qm_json_read_moved_vertices(const char *text, size_t size, qm_moved_vertices *out, qm_problem *problem);

/**
 * Sets the time that a mesh lives from now on, 0: for good; if_match as above. out is the mesh, for
 * qm_store_mesh_reset. False with a problem, and then nothing has changed.
 */
bool qm_meshes_set_ttl(qm_meshes *meshes, const char *id, double ttl_s, const char *if_match,
                       qm_store_mesh *out, qm_problem *problem);

/** Reads {"ttl_seconds": ...}; null is 0. False with a problem (400). */
bool qm_json_read_lifetime(const char *text, size_t size, double *ttl_s, qm_problem *problem);

/** Removes meshes that have expired and that no unfinished job, layout or reconstruction needs. */
void qm_meshes_drop_expired(qm_meshes *meshes);

/** Deletes a mesh; if_match as above. False with a problem, and then nothing has changed. */
bool qm_meshes_delete(qm_meshes *meshes, const char *id, const char *if_match, qm_problem *problem);

#endif
