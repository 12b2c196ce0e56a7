/**
 * store.h: what survives a restart, behind one small interface: blobs, meshes, jobs. The store keeps
 * documents (JSON text made elsewhere) and the columns that it searches by; it knows no geometry and no JSON.
 *
 * What looks for one row returns QM_OK, and the row is the caller's; QM_E_EMPTY when there is none;
 * QM_E_NO_MEMORY or QM_E_ARGUMENT when that cannot be told. What lists rows writes up to limit of them after
 * a sequence number (0: from the first on), in order, and how many; after a fault there are none. What
 * deletes returns QM_OK, QM_E_EMPTY when there was none, or a fault.
 *
 * Durability: a call that returned QM_OK survives a kill -9 and a power cut. Threads: every call may come
 * from any thread; the store takes a lock of its own.
 */
#ifndef QM_STORE_H
#define QM_STORE_H

#include "base/hash.h"
#include "base/id.h"
#include "base/text.h"
#include "qm/context.h"

typedef struct qm_store qm_store;

/**
 * Opens the data folder, makes it when it is not there, sweeps half-written blobs. One process at a time
 * holds a folder. Returns QM_OK, or a status with words in message (may name the folder: it goes to the log
 * only).
 */
qm_status qm_store_open(const char *folder, qm_store **out, char message[QM_MESSAGE_SIZE]);
void qm_store_close(qm_store *store);

/** A blob on its way in: bytes go to a file of their own while the hash is taken. */
typedef struct qm_blob_writer qm_blob_writer;
qm_status qm_blob_begin(qm_store *store, qm_blob_writer **out);
qm_status qm_blob_write(qm_blob_writer *writer, const void *bytes, size_t size);
/** Ends the writing; tells the hash. */
qm_status qm_blob_seal(qm_blob_writer *writer, char hash[QM_HASH_SIZE]);
/** Maps the bytes of a sealed blob for reading; release with qm_blob_unmap. */
qm_status qm_blob_map_sealed(const qm_blob_writer *writer, const uint8_t **bytes, size_t *size);
/** Gives a sealed blob the name of its hash: it is on disk afterwards. The writer is gone, also after an
 * error. */
qm_status qm_blob_keep(qm_blob_writer *writer);
/** Bytes written so far, and reading them back from an offset: all of size, or not QM_OK. */
uint64_t qm_blob_size(const qm_blob_writer *writer);
qm_status qm_blob_read(const qm_blob_writer *writer, uint64_t offset, void *bytes, size_t size);
/** Drops a blob that is not kept. NULL is fine. */
void qm_blob_abort(qm_blob_writer *writer);
/** Maps a blob for reading; release with qm_blob_unmap. QM_E_EMPTY when there is none of this hash. */
qm_status qm_blob_map(qm_store *store, const char *hash, const uint8_t **bytes, size_t *size);
void qm_blob_unmap(const uint8_t *bytes, size_t size);
/** Removes a blob unless a mesh refers to it. The caller sees to it that nobody is about to put such a
 * mesh. */
void qm_blob_remove(qm_store *store, const char *hash);

/** A row of meshes. Strings of found rows are the caller's, for qm_store_mesh_reset. */
typedef struct qm_store_mesh {
    char id[QM_ID_SIZE];
    char hash[QM_HASH_SIZE]; /* of the blob */
    char *options; /* what, with the hash, makes an upload the same (name, format): the content index */
    char *name;
    char *document;               /* the mesh resource */
    char *created;                /* RFC 3339 */
    int format;                   /* qm_format */
    uint64_t revision;            /* deformations so far */
    char positions[QM_HASH_SIZE]; /* of the blob with the vertices of this revision: rows of three doubles
                                     as this machine writes them; "" for those of the file */
    int64_t sequence;             /* order of creation; given by the store */
} qm_store_mesh;

qm_status qm_store_put_mesh(qm_store *store, const qm_store_mesh *mesh);
qm_status qm_store_find_mesh(qm_store *store, const char *id, qm_store_mesh *out);
qm_status qm_store_find_mesh_by_content(qm_store *store, const char *hash, const char *options,
                                        qm_store_mesh *out);
qm_status qm_store_list_meshes(qm_store *store, int64_t after, size_t limit, qm_store_mesh *out,
                               size_t *count);
/**
 * Puts the next revision of a mesh in the place of the one before it: revision, positions, options, document.
 * The blob of the positions before is removed. QM_E_ARGUMENT when the mesh has another revision by now.
 */
qm_status qm_store_deform_mesh(qm_store *store, const qm_store_mesh *mesh);
/** Removes the row, and the blobs when no other row has them. */
qm_status qm_store_delete_mesh(qm_store *store, const char *id);
void qm_store_mesh_reset(qm_store_mesh *mesh);

/** A row of jobs. */
typedef struct qm_store_job {
    char id[QM_ID_SIZE];
    char *key;             /* canonical request, meshes' hashes: jobs with one key have one answer */
    char *idempotency_key; /* of the client, or NULL */
    char *body;            /* the request as it came, to run it again after a restart */
    char *created;         /* when it was asked for, RFC 3339 */
    char *document;        /* the job resource as of its end; NULL while it is queued or runs */
    int state;             /* qm_job_state of job.h */
    int64_t sequence;      /* order of creation; given by the store */
    int64_t restarts;      /* how often it was claimed: it begins anew each time */
} qm_store_job;

/** Some events of a job that follow one another. */
typedef struct qm_store_events {
    const char *job;   /* its id */
    uint64_t seq;      /* of the first one */
    const char *lines; /* NDJSON */
} qm_store_events;

/**
 * A job is submitted once and finished once: also one that is canceled, or fails. Between the two it is the
 * process that holds the folder which runs it, and appends what events it has from time to time.
 */
qm_status qm_store_submit_job(qm_store *store, const qm_store_job *job);
/**
 * Appends events of several jobs, of all or of none. Events of a job with the same first seq take the place
 * of those before, so that what could not be known to be stored is appended once more. A job that has ended,
 * or that is not there, stays as it is.
 */
qm_status qm_store_append_events(qm_store *store, const qm_store_events *events, size_t count);
/** Writes state, document and the revisions of the meshes, as text, of a job that has ended, and appends its
 * last events. */
qm_status qm_store_finish_job(qm_store *store, const qm_store_events *last, int state, const char *document,
                              const char *revisions);
/** Adds all events of a job to out, a line each; none of a job that is not there. */
qm_status qm_store_read_events(qm_store *store, const char *id, qm_text *out);
qm_status qm_store_find_job(qm_store *store, const char *id, qm_store_job *out);
/** The newest job of a key that ran on these revisions, in the given state. */
qm_status qm_store_find_job_by_key(qm_store *store, const char *key, const char *revisions, int state,
                                   qm_store_job *out);
qm_status qm_store_find_job_by_idempotency_key(qm_store *store, const char *key, qm_store_job *out);
qm_status qm_store_list_jobs(qm_store *store, int64_t after, size_t limit, qm_store_job *out, size_t *count);
/** Takes over the jobs that have not ended when their process did: counts one more restart of each. */
qm_status qm_store_claim_jobs(qm_store *store);
/** The rows of those, to be run. */
qm_status qm_store_list_unfinished_jobs(qm_store *store, int64_t after, size_t limit, qm_store_job *out,
                                        size_t *count);
/**
 * Removes up to limit jobs that have ended, the oldest first: those asked for before a time (RFC 3339), and
 * those that more than kept others are newer than. Writes their ids; returns how many.
 */
size_t qm_store_drop_old_jobs(qm_store *store, size_t kept, const char *before, size_t limit,
                              char (*ids)[QM_ID_SIZE]);
qm_status qm_store_delete_job(qm_store *store, const char *id);
void qm_store_job_reset(qm_store_job *job);

/** How a request that makes something is known when it comes again. */
typedef struct qm_store_idempotency {
    const char *key; /* of the client; NULL: it is not to be known */
    char request[QM_HASH_SIZE];
} qm_store_idempotency;

/** What such a request has made. */
typedef struct qm_store_idempotent {
    char id[QM_ID_SIZE];
    char request[QM_HASH_SIZE];
} qm_store_idempotent;
qm_status qm_store_find_idempotent_layout(qm_store *store, const char *key, qm_store_idempotent *out);
qm_status qm_store_find_idempotent_reconstruction(qm_store *store, const char *key, qm_store_idempotent *out);

/**
 * A layout as of one of its revisions, which are numbered from 0. Undo and redo go back and forth between
 * those that are kept. Strings of found rows are the caller's, for qm_store_layout_reset.
 */
typedef struct qm_store_layout {
    char id[QM_ID_SIZE];
    char mesh[QM_ID_SIZE];
    char *created;
    int64_t revision, first, latest; /* the one at hand, and those that can be gone to */
    char *layout;                    /* {nodes, curves, patches} */
    char *issues;                    /* [...] */
    int64_t next_curve;              /* id */
    int64_t sequence;
} qm_store_layout;

/** Stores a new layout with its revision 0; not when its key has made another. */
qm_status qm_store_put_layout(qm_store *store, const qm_store_layout *layout,
                              const qm_store_idempotency *once);
qm_status qm_store_find_layout(qm_store *store, const char *id, qm_store_layout *out);
qm_status qm_store_list_layouts(qm_store *store, int64_t after, size_t limit, qm_store_layout *out,
                                size_t *count);
/** Adds the revision after layout->revision, in place of what was undone. QM_E_CANCELED when the layout has
 * been edited meanwhile. */
qm_status qm_store_edit_layout(qm_store *store, const qm_store_layout *layout);
/** Goes from one revision to another that is kept; QM_E_CANCELED as above. */
qm_status qm_store_move_layout(qm_store *store, const char *id, int64_t from, int64_t to);
qm_status qm_store_delete_layout(qm_store *store, const char *id);
void qm_store_layout_reset(qm_store_layout *layout);

/** A reconstruction: what it was made of, the steps it has taken, and its mesh now. */
typedef struct qm_store_reconstruction {
    char id[QM_ID_SIZE];
    char source[QM_ID_SIZE], layout_id[QM_ID_SIZE], mesh[QM_ID_SIZE];
    char *layout;   /* {nodes, curves, patches}, a line as of its start and one for each edit since */
    char *document; /* members of the resource that do not change */
    char *steps; /* words: LIMIT:COUNT for so many steps with that limit of quads, EDIT for the next layout */
    char *records; /* what came of the steps: objects with commas between */
    char *state;   /* members of the resource that steps change */
    double cover_share;
    bool pull_curves;
    int64_t revision; /* counts its changes */
    int64_t sequence;
} qm_store_reconstruction;

/** Stores a new one; not when its key has made another. */
qm_status qm_store_put_reconstruction(qm_store *store, const qm_store_reconstruction *reconstruction,
                                      const qm_store_idempotency *once);
qm_status qm_store_find_reconstruction(qm_store *store, const char *id, qm_store_reconstruction *out);
qm_status qm_store_list_reconstructions(qm_store *store, int64_t after, size_t limit,
                                        qm_store_reconstruction *out, size_t *count);
/** Writes mesh, layout, steps, records, state and revision. */
qm_status qm_store_update_reconstruction(qm_store *store, const qm_store_reconstruction *reconstruction);
qm_status qm_store_delete_reconstruction(qm_store *store, const char *id);
void qm_store_reconstruction_reset(qm_store_reconstruction *reconstruction);

#endif
