/**
 * store.h: persistent state behind one interface: blobs, meshes, jobs, layouts, reconstructions. The store
 * keeps documents (JSON text made elsewhere) and the columns that it searches; it knows no geometry and no
 * JSON.
 *
 * Find calls return QM_OK, and the row is the caller's to reset; QM_E_EMPTY when there is none;
 * QM_E_FORMAT when it, or what it is found by, is damaged; QM_E_NO_MEMORY or QM_E_ARGUMENT after another fault.
 * List calls write the rows of a page, in order, and their count, which is 0 after a fault; a filter's NULL members
 * let every row pass. Delete calls return QM_OK, QM_E_EMPTY when there was none, or a fault.
 *
 * Durability: a call that returned QM_OK survives a kill -9 and a power cut. Threads: every call may come
 * from any thread; the store takes a lock of its own.
 */
#ifndef QM_STORE_H
#define QM_STORE_H

#include <stdio.h>

#include "base/clock.h"
#include "base/id.h"
#include "base/text.h"
#include "qm/context.h"

typedef struct qm_store qm_store;

/** What a data folder is opened for. */
typedef enum qm_store_purpose {
    QM_STORE_SERVE, /* removes half-written files, and files without a row that are older than a day */
    QM_STORE_ADOPT, /* leaves files without a row, and makes a database when there is none */
    QM_STORE_CHECK  /* leaves everything; refused when there is no database of this version */
} qm_store_purpose;

/**
 * Opens the data folder, and creates it if needed. One process at a time holds a folder. Returns QM_OK, or a
 * status with a message (which may name the folder: for the log only). To serve a folder that has files of
 * meshes or results but no database is refused with QM_E_EMPTY: every one of them would be without a row.
 */
qm_status qm_store_open(const char *folder, qm_store_purpose purpose, qm_store **out,
                        char message[QM_MESSAGE_SIZE]);
void qm_store_close(qm_store *store);

/** What a check has found. */
typedef struct qm_store_findings {
    size_t meshes, jobs, files; /* that were looked at */
    size_t faults, repaired;    /* an array stays a fault until its job is gone */
    size_t orphans;             /* files of meshes that no row names: kept for a day, and no fault */
} qm_store_findings;

/**
 * Compares everything in a folder that no process holds with its hashes and checksums, a line on out for each
 * fault; repairs what can be if asked. The status says whether the folder could be opened.
 */
qm_status qm_store_check(const char *folder, bool repairs, FILE *out, qm_store_findings *found,
                         char message[QM_MESSAGE_SIZE]);

/**
 * Writes all of a folder to one file, while the daemon that holds the folder goes on: everything that was
 * acknowledged before the call, but for deletions since. What is damaged is left out, with a line on out and
 * a fault. QM_E_ARGUMENT with a message: there is no backup.
 */
qm_status qm_store_backup(const char *folder, const char *file, FILE *out, qm_store_findings *found,
                          char message[QM_MESSAGE_SIZE]);

/** Makes a folder of such a file, of this or an earlier version: all of it, or none. The folder must be missing or
 * empty. */
qm_status qm_store_restore(const char *file, const char *folder, FILE *out, qm_store_findings *found,
                           char message[QM_MESSAGE_SIZE]);

/** Moves the files of meshes and results of a folder without a database to a folder beside them, lost/. */
qm_status qm_store_empty(const char *folder, char message[QM_MESSAGE_SIZE]);

/** The files of a data folder, by their kind. */
typedef enum qm_store_files {
    QM_STORE_BLOBS,
    QM_STORE_RESULTS,
    QM_STORE_UPLOADS, /* on their way */
    QM_STORE_FILES_COUNT
} qm_store_files;

/** Bytes in use; space.h says what counts. */
typedef struct qm_store_usage {
    uint64_t files[QM_STORE_FILES_COUNT], database;
    uint64_t total, quota; /* quota 0: none */
} qm_store_usage;

/**
 * Sets how many bytes the files and the database may have. Calls that write files, or rows that begin something,
 * return QM_E_TOO_LARGE when there is no room; what was begun may end, and its rows go beyond the quota. To be
 * called before there are other threads.
 */
void qm_store_set_quota(qm_store *store, uint64_t quota);
void qm_store_measure(qm_store *store, qm_store_usage *out);

/** Up to limit rows after the one with a sequence number; 0: from the first, which is the newest one if asked. */
typedef struct qm_store_page {
    int64_t after;
    bool newest_first;
    size_t limit;
} qm_store_page;

/** A blob that is being written: bytes go to a file of their own while the hash is computed. */
typedef struct qm_blob_writer qm_blob_writer;
/** expected: bytes that will be written, if known; room for them is reserved. */
qm_status qm_blob_begin(qm_store *store, uint64_t expected, qm_blob_writer **out);
qm_status qm_blob_write(qm_blob_writer *writer, const void *bytes, size_t size);
/** Ends the writing; returns the hash. */
qm_status qm_blob_seal(qm_blob_writer *writer, char hash[QM_HASH_SIZE]);
/** Maps the bytes of a sealed blob for reading; release with qm_blob_unmap. */
qm_status qm_blob_map_sealed(const qm_blob_writer *writer, const uint8_t **bytes, size_t *size);
/** Gives a sealed blob the name of its hash: it is on disk afterwards. Frees the writer, also after an
 * error. */
qm_status qm_blob_keep(qm_blob_writer *writer);
/** Bytes written so far, and reading them back from an offset: all of size, or not QM_OK. */
uint64_t qm_blob_size(const qm_blob_writer *writer);
qm_status qm_blob_read(const qm_blob_writer *writer, uint64_t offset, void *bytes, size_t size);
/** Drops a blob that is not kept. NULL is fine. */
void qm_blob_abort(qm_blob_writer *writer);
/**
 * Maps a blob for reading, after its bytes were compared with its hash; release with qm_blob_unmap. QM_E_EMPTY
 * when there is none of this hash; QM_E_FORMAT when it is damaged: its bytes are others, or the disk does not
 * give them; QM_E_NO_MEMORY or QM_E_ARGUMENT after a fault.
 */
qm_status qm_blob_map(qm_store *store, const char *hash, const uint8_t **bytes, size_t *size);
/** The status that qm_blob_map would return. */
qm_status qm_blob_check(qm_store *store, const char *hash);
void qm_blob_unmap(const uint8_t *bytes, size_t size);
/**
 * Calls a function for each blob that no mesh refers to. From now on they are younger than a day. False when a
 * folder cannot be read.
 */
bool qm_blob_each_orphan(qm_store *store, void (*take)(void *user, const char *hash), void *user);
/** Moves a blob to the folder lost/. */
bool qm_blob_move_away(qm_store *store, const char *hash);
/** Removes a blob unless a mesh refers to it. The caller ensures that no thread puts such a mesh. */
void qm_blob_remove(qm_store *store, const char *hash);

/** A row of meshes. Strings of found rows are the caller's, for qm_store_mesh_reset. */
typedef struct qm_store_mesh {
    char id[QM_ID_SIZE];
    char hash[QM_HASH_SIZE]; /* of the blob */
    char *options;           /* name and format: uploads of one hash and one options string are one mesh */
    char *name;
    char *document;               /* the mesh resource */
    char *created;                /* RFC 3339 */
    int format;                   /* qm_format */
    uint64_t revision;            /* deformations so far */
    char positions[QM_HASH_SIZE]; /* of the blob with the vertices of this revision: rows of three doubles
                                     as this machine writes them; "" for those of the file */
    char expires[QM_TIME_SIZE];   /* RFC 3339; "": never */
    int64_t sequence;             /* order of creation; given by the store */
} qm_store_mesh;

qm_status qm_store_put_mesh(qm_store *store, const qm_store_mesh *mesh);
qm_status qm_store_find_mesh(qm_store *store, const char *id, qm_store_mesh *out);
qm_status qm_store_find_mesh_by_content(qm_store *store, const char *hash, const char *options,
                                        qm_store_mesh *out);
typedef struct qm_store_mesh_filter {
    const char *name, *hash;
} qm_store_mesh_filter;
qm_status qm_store_list_meshes(qm_store *store, const qm_store_page *page, const qm_store_mesh_filter *filter,
                               qm_store_mesh *out, size_t *count);
/**
 * Replaces a mesh by its next revision: revision, positions, options, document. Removes the blob of the
 * positions before. QM_E_CANCELED when the mesh is no longer at the revision before, QM_E_EMPTY when it is gone.
 */
qm_status qm_store_deform_mesh(qm_store *store, const qm_store_mesh *mesh);
/** Sets when a mesh expires. QM_E_EMPTY when there is no such mesh. */
qm_status qm_store_set_expiry(qm_store *store, const char *id, const char *expires);
/** Finds a mesh that expired before a time, and that no unfinished job, layout or reconstruction needs. */
qm_status qm_store_find_expired_mesh(qm_store *store, const char *before, qm_store_mesh *out);
/** Removes the row, and its blobs unless another row has them. */
qm_status qm_store_delete_mesh(qm_store *store, const char *id);
void qm_store_mesh_reset(qm_store_mesh *mesh);

typedef enum qm_job_state {
    QM_JOB_QUEUED,
    QM_JOB_RUNNING,
    QM_JOB_SUCCEEDED,
    QM_JOB_FAILED,
    QM_JOB_CANCELED
} qm_job_state;

/** A row of jobs. */
typedef struct qm_store_job {
    char id[QM_ID_SIZE];
    char *key; /* hash of the canonical request: jobs of one key have one result on the same revisions */
    char *idempotency_key; /* of the client, or NULL */
    char *body;            /* the JSON of the request, to run it again after a restart */
    const char
        *type; /* of a row that is submitted: its kind, and the ids that its request names; NULL else */
    const char *subjects[2];
    char *created;  /* time of submission, RFC 3339 */
    char *document; /* members of the job resource as of its end but for its result; NULL before */
    char *result;   /* the result object; NULL when the job has none */
    qm_job_state state;
    int64_t sequence; /* order of creation; given by the store */
    int64_t restarts; /* number of times that it was claimed, and began again */
    int64_t begun;    /* runs that began, but for the first, since the process was last ended in order */
} qm_store_job;

/** An event of a job. */
#define QM_EVENT_NAME_SIZE 24
typedef struct qm_store_event {
    const char *job; /* its id */
    uint64_t seq;
    const char *name;    /* shorter than QM_EVENT_NAME_SIZE */
    const char *members; /* of its JSON object besides name and seq */
} qm_store_event;

/**
 * A job is submitted once and finished once, also one that is canceled or fails. In between the process that
 * holds the folder runs it, and appends its events from time to time. A submission is QM_E_CANCELED when its
 * idempotency key has another job.
 */
qm_status qm_store_submit_job(qm_store *store, const qm_store_job *job);
/**
 * Appends events of several jobs, of all or of none. An event replaces the one of the same job and seq, so
 * that events which may have been stored are appended again. A job that has ended, or does not exist, stays
 * as it is.
 */
qm_status qm_store_append_events(qm_store *store, const qm_store_event *events, size_t count);
typedef struct qm_store_reconstruction qm_store_reconstruction;

/** What the end of a job changes besides the job: the next revision of a reconstruction. */
typedef struct qm_store_effect {
    const qm_store_reconstruction *next;
    const qm_store_mesh *mesh; /* of it, when that is new; NULL when it is stored already */
} qm_store_effect;

/**
 * Ends a job: writes state, document and result of the row with end's id, the revisions of its meshes as
 * text, and appends its last events; with its effect, or without one for NULL. All of it is stored, or nothing.
 * QM_E_CANCELED: the reconstruction is deleted, or no longer at the revision before.
 */
qm_status qm_store_finish_job(qm_store *store, const qm_store_job *end, const char *revisions,
                              const qm_store_event *events, size_t count, const qm_store_effect *effect);
/** Called for each event; its strings live until it returns. False ends the reading (QM_E_NO_MEMORY). */
typedef bool qm_store_event_fn(void *user, const qm_store_event *event);
/** Reads all events of a job in the order of seq; none of a job that does not exist. The callback runs under
 * the lock of the store. */
qm_status qm_store_read_events(qm_store *store, const char *id, qm_store_event_fn *take, void *user);
qm_status qm_store_find_job(qm_store *store, const char *id, qm_store_job *out);
/** Finds the newest job of a key that ran on these revisions and is in this state. */
qm_status qm_store_find_job_by_key(qm_store *store, const char *key, const char *revisions,
                                   qm_job_state state, qm_store_job *out);
/** Lets a job answer no later request: its result is damaged. */
qm_status qm_store_forget_answer(qm_store *store, const char *id);
qm_status qm_store_find_job_by_idempotency_key(qm_store *store, const char *key, qm_store_job *out);
typedef struct qm_store_job_filter {
    const char *type, *subject; /* a kind; the id of a mesh or reconstruction that the request names */
    const qm_job_state *state;  /* all that have not ended are QM_JOB_QUEUED here */
} qm_store_job_filter;
qm_status qm_store_list_jobs(qm_store *store, const qm_store_page *page, const qm_store_job_filter *filter,
                             qm_store_job *out, size_t *count);
/** Takes over the unfinished jobs of an earlier process: counts one more restart of each. */
qm_status qm_store_claim_jobs(qm_store *store);
/** Counts a run of a claimed job, before it begins. */
qm_status qm_store_begin_job(qm_store *store, const char *id);
/** Ends in order: the unfinished jobs have not ended the process. */
qm_status qm_store_leave_jobs(qm_store *store);
/**
 * Removes up to limit jobs that have ended, the oldest first: jobs that were submitted before a time (RFC
 * 3339), and jobs with at least `kept` newer ones. Writes their ids; returns their number.
 */
size_t qm_store_drop_old_jobs(qm_store *store, size_t kept, const char *before, size_t limit,
                              char (*ids)[QM_ID_SIZE]);
qm_status qm_store_delete_job(qm_store *store, const char *id);
void qm_store_job_reset(qm_store_job *job);

/** Identifies a request that creates something when it is repeated. */
typedef struct qm_store_idempotency {
    const char *key; /* of the client; NULL: each request creates something */
    char request[QM_HASH_SIZE];
} qm_store_idempotency;

/** What such a request has created, and the hash of that request. */
typedef struct qm_store_idempotency_record {
    char id[QM_ID_SIZE];
    char request[QM_HASH_SIZE];
} qm_store_idempotency_record;
qm_status qm_store_find_layout_by_idempotency_key(qm_store *store, const char *key,
                                                  qm_store_idempotency_record *out);
qm_status qm_store_find_reconstruction_by_idempotency_key(qm_store *store, const char *key,
                                                          qm_store_idempotency_record *out);

/**
 * A layout at one of its revisions, which are numbered from 0. Undo and redo move between the revisions that
 * are kept. Strings of found rows are the caller's, for qm_store_layout_reset.
 */
typedef struct qm_store_layout {
    char id[QM_ID_SIZE];
    char mesh[QM_ID_SIZE];
    char *created;
    int64_t revision, first, latest; /* the current one; undo and redo reach first to latest */
    char *layout;                    /* {nodes, curves, patches} */
    char *issues;                    /* "issues":[...] */
    bool is_complete;                /* there are no issues */
    int64_t next_curve;              /* id */
    int64_t sequence;
} qm_store_layout;

/** Stores a new layout with its revision 0; a fault when its idempotency key has created another one. */
qm_status qm_store_put_layout(qm_store *store, const qm_store_layout *layout,
                              const qm_store_idempotency *idempotency);
qm_status qm_store_find_layout(qm_store *store, const char *id, qm_store_layout *out);
/** mesh: of one mesh only, or NULL. */
qm_status qm_store_list_layouts(qm_store *store, const qm_store_page *page, const char *mesh,
                                qm_store_layout *out, size_t *count);
/** Adds the revision after layout->revision and drops the undone ones. QM_E_CANCELED when the current
 * revision is another one. */
qm_status qm_store_edit_layout(qm_store *store, const qm_store_layout *layout);
/** Moves from one revision to another that is kept; QM_E_CANCELED when `from` is not the current one. */
qm_status qm_store_move_layout(qm_store *store, const char *id, int64_t from, int64_t to);
qm_status qm_store_delete_layout(qm_store *store, const char *id);
void qm_store_layout_reset(qm_store_layout *layout);

/** A reconstruction: its source and layout, the steps that it has taken, and its current mesh. */
struct qm_store_reconstruction {
    char id[QM_ID_SIZE];
    char source[QM_ID_SIZE], layout_id[QM_ID_SIZE], mesh[QM_ID_SIZE];
    char *layout;   /* {nodes, curves, patches}: a line for its start and one for each edit */
    char *document; /* members of the resource that do not change */
    char *steps;    /* words: LIMIT:COUNT for COUNT steps with a limit of quads, EDIT for the next layout */
    char *records;  /* of the steps: JSON objects with commas between */
    char *state;    /* members of the resource that steps change */
    double cover_share;
    bool pull_curves;
    int64_t revision; /* number of changes */
    int64_t sequence;
};

/** Stores a new one, with its mesh, or with NULL when that is stored already: both, or none. A fault when its
 * idempotency key has created another one. */
qm_status qm_store_put_reconstruction(qm_store *store, const qm_store_reconstruction *reconstruction,
                                      const qm_store_mesh *mesh, const qm_store_idempotency *idempotency);
qm_status qm_store_find_reconstruction(qm_store *store, const char *id, qm_store_reconstruction *out);
/** source: of one mesh only, or NULL. */
qm_status qm_store_list_reconstructions(qm_store *store, const qm_store_page *page, const char *source,
                                        qm_store_reconstruction *out, size_t *count);
/** Writes mesh, layout, steps, records, state and revision, with a new mesh or NULL, as the end of a job does. */
qm_status qm_store_update_reconstruction(qm_store *store, const qm_store_effect *effect);
qm_status qm_store_delete_reconstruction(qm_store *store, const char *id);
void qm_store_reconstruction_reset(qm_store_reconstruction *reconstruction);

#endif
