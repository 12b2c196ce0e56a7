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
#include "qm/transform.h"
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

/** What an upload says of its mesh. Equal bytes with equal ones of these, but for ttl_s, are one mesh. */
typedef struct qm_mesh_options {
    const char *name;   /* for display */
    qm_format format;   /* QM_FORMAT_UNKNOWN: detected */
    qm_notes notes;     /* without a unit: that of the file */
    const char *labels; /* as of qm_store_mesh; NULL: none */
    double ttl_s;
} qm_mesh_options;

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
bool qm_meshes_add(qm_meshes *meshes, qm_blob_writer *upload, const qm_mesh_options *options,
                   qm_store_mesh *out, bool *is_new, qm_problem *problem);

/** Stores a mesh of an upload, which is_new or stored already, with a row that names it: both, or none. No other thread
 * removes a mesh meanwhile. QM_STORED_TAKEN: the mesh is no longer new; others that are not QM_STORED with a problem. */
typedef qm_stored qm_mesh_put_fn(void *user, const qm_store_mesh *mesh, bool is_new, qm_problem *problem);

/**
 * Makes a mesh of one that was made of the mesh `source`, without a time to live, that put stores. It is in the unit of its
 * source, and named after that, or after its maker where the source has no name or is gone. False with a problem.
 */
bool qm_meshes_add_made(qm_meshes *meshes, qm_context *ctx, const qm_mesh *mesh, const qm_mesh_facts *facts,
                        const char *source, const char *maker, qm_mesh_put_fn *put, void *user,
                        qm_problem *problem);

/** Makes a mesh without a name of a blob that no mesh has; out is as above. False with a problem. */
bool qm_meshes_adopt(qm_meshes *meshes, const char *hash, qm_store_mesh *out, qm_problem *problem);

/** Takes a reference; reads the mesh from its blob when needed. NULL with a problem. The second also tells the notes, which may
 * change while the reference is held. */
qm_mesh_ref *qm_meshes_acquire(qm_meshes *meshes, const char *id, qm_problem *problem);
qm_mesh_ref *qm_meshes_acquire_noted(qm_meshes *meshes, const char *id, qm_notes *notes, qm_problem *problem);

/**
 * Takes a reference to a mesh with its positions moved by a transform (qm/transform.h), which passes its check: the mesh of the
 * rounded positions, kept in memory for the next one who asks for the same revision and transform. It
 * counts against the budget, and is dropped as any other. The notes are those of the mesh before it is moved. NULL with a
 * problem.
 */
qm_mesh_ref *qm_meshes_acquire_moved(qm_meshes *meshes, const char *id,
                                     const double transform[QM_TRANSFORM_SIZE], qm_notes *notes,
                                     qm_problem *problem);

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

/** A change of what is known of a mesh; what is not to change has its flag down. */
typedef struct qm_mesh_change {
    bool has_ttl, has_unit, has_uncertainty, has_labels;
    double ttl_s; /* that the mesh lives from now on; 0: for good */
    qm_notes notes;
    char *labels; /* as of qm_store_mesh; on the heap */
} qm_mesh_change;

/**
 * Changes a mesh; if_match as above. One whose unit or uncertainty is set is not found by uploads any more. out is the
 * mesh, for qm_store_mesh_reset. False with a problem, and then nothing has changed.
 */
bool qm_meshes_change(qm_meshes *meshes, const char *id, const qm_mesh_change *change, const char *if_match,
                      qm_store_mesh *out, qm_problem *problem);

/** Reads the body of such a change, for free() of its labels; null is none. False with a problem (400, 507). */
bool qm_json_read_mesh_change(const char *text, size_t size, qm_mesh_change *out, qm_problem *problem);

/** Labels are words of letters, digits and . _ - : /, some of them at most. */
#define QM_MESH_MAX_LABELS 16
#define QM_MESH_LABEL_SIZE 65
#define QM_MESH_LABELS "must be at most 16 words of up to 64 letters, digits and . _ - : /"
/** Adds a label to a list as of qm_store_mesh unless it is there; false when it is not one, or one too many. */
bool qm_mesh_add_label(qm_text *labels, const char *label, size_t length);
struct cJSON;
struct qm_json_location;
/** Reads an array of labels into a list on the heap, NULL for none; false for other values, with the location of the fault. */
bool qm_mesh_read_labels(const struct cJSON *value, char **out, struct qm_json_location *at);
/** Adds the member labels: the array of a list, or of none for NULL. */
void qm_mesh_write_labels(qm_text *out, const char *labels);

/** The body of a request for a moved copy. */
typedef struct qm_moved_copy {
    double transform[QM_TRANSFORM_SIZE];
    char *name; /* on the heap; NULL: none is given */
} qm_moved_copy;

/** Reads {"transform": [...], "name": ...}, the second optional; name is the caller's to free. False with a problem (400). */
bool qm_json_read_copy(const char *text, size_t size, qm_moved_copy *out, qm_problem *problem);

/**
 * Stores a mesh of its own, of a mesh moved by a transform: its binary PLY file, as of an upload with that name. out and
 * is_new are as of qm_meshes_add. False with a problem.
 */
bool qm_meshes_add_copy(qm_meshes *meshes, const char *id, const qm_moved_copy *copy, const char *name,
                        qm_store_mesh *out, bool *is_new, qm_problem *problem);

/** Removes meshes that have expired and that no unfinished job, layout or reconstruction needs. */
void qm_meshes_drop_expired(qm_meshes *meshes);

/** Deletes a mesh; if_match as above. False with a problem, and then nothing has changed. */
bool qm_meshes_delete(qm_meshes *meshes, const char *id, const char *if_match, qm_problem *problem);

#endif
