/**
 * store_driver.h: what a store is made of, and the table of functions that each kind of database fills.
 *
 * Two drivers: store_sqlite*.c for a folder that one process holds, store_postgres*.c for a database that nodes
 * share. store.c calls them; each function does what the verb of store.h with its name says. The same contract test
 * runs on both (tests/unit/test_store_contract.c).
 */
#ifndef QM_STORE_DRIVER_H
#define QM_STORE_DRIVER_H

#include "base/clock.h"
#include "base/failpoint.h"
#include "blob.h"
#include "space.h"
#include "store.h"
#include "store_parts.h"

#define QM_STORE_IDENTITY_SIZE 48 /* of a shared store: three numbers */

typedef struct qm_store_driver {
    void (*close)(qm_store *store);

    qm_stored (*put_mesh)(qm_store *store, const qm_store_mesh *mesh);
    qm_stored (*find_mesh)(qm_store *store, const char *id, qm_store_mesh *out);
    qm_stored (*find_mesh_states)(qm_store *store, const char *const *ids, size_t count,
                                  qm_store_mesh_state *out);
    qm_stored (*find_undeformed)(qm_store *store, const char *const *hashes, size_t count,
                                 char (*ids)[QM_ID_SIZE]);
    qm_stored (*find_mesh_by_content)(qm_store *store, const char *hash, const char *options,
                                      qm_store_mesh *out);
    qm_stored (*list_meshes)(qm_store *store, const qm_store_page *page, const qm_store_mesh_filter *filter,
                             qm_store_mesh *out, size_t *count);
    qm_stored (*revise_mesh)(qm_store *store, const qm_store_mesh *mesh);
    qm_stored (*set_notes)(qm_store *store, const qm_store_mesh *mesh);
    qm_stored (*set_expiry)(qm_store *store, const char *id, const char *expires);
    qm_stored (*find_expired_mesh)(qm_store *store, const char *before, qm_store_mesh *out);
    qm_stored (*delete_mesh)(qm_store *store, const char *id);

    qm_stored (*submit_job)(qm_store *store, const qm_store_submission *submission);
    qm_stored (*claim_jobs)(qm_store *store, const qm_store_wish *wish, qm_store_job *out, size_t *count);
    qm_stored (*begin_job)(qm_store *store, const char *id);
    qm_stored (*note_cancel)(qm_store *store, const char *id);
    qm_stored (*append_events)(qm_store *store, qm_store_run *runs, size_t run_count,
                               const qm_store_event *events, size_t count);
    qm_stored (*finish_job)(qm_store *store, const qm_store_job *end, const char *revisions,
                            const qm_store_event *events, size_t count, const qm_store_effect *effect);
    qm_stored (*leave_jobs)(qm_store *store);
    qm_stored (*read_events)(qm_store *store, const char *id, uint64_t after, qm_store_event_fn *take,
                             void *user);
    qm_stored (*find_job)(qm_store *store, const char *id, qm_store_job *out);
    qm_stored (*find_job_by_key)(qm_store *store, const char *key, const char *revisions, qm_job_state state,
                                 qm_store_job *out);
    qm_stored (*find_job_by_idempotency_key)(qm_store *store, const char *key, qm_store_job *out);
    qm_stored (*set_job_labels)(qm_store *store, const char *id, const char *labels);
    qm_stored (*forget_answer)(qm_store *store, const char *id);
    qm_stored (*list_jobs)(qm_store *store, const qm_store_page *page, const qm_store_job_filter *filter,
                           qm_store_job *out, size_t *count);
    qm_stored (*drop_old_jobs)(qm_store *store, size_t kept, double kept_s, size_t limit,
                               char (*ids)[QM_ID_SIZE], size_t *count);
    qm_stored (*delete_job)(qm_store *store, const char *id);
    qm_stored (*put_array)(qm_store *store, const char *job_id, const qm_store_array *array);
    qm_stored (*find_array)(qm_store *store, const char *job_id, qm_store_array *out);

    qm_stored (*put_layout)(qm_store *store, const qm_store_layout *layout,
                            const qm_store_idempotency *idempotency);
    qm_stored (*find_layout)(qm_store *store, const char *id, qm_store_layout *out);
    qm_stored (*find_layout_by_idempotency_key)(qm_store *store, const char *key,
                                                qm_store_idempotency_record *out);
    qm_stored (*list_layouts)(qm_store *store, const qm_store_page *page, const char *mesh,
                              qm_store_layout *out, size_t *count);
    qm_stored (*edit_layout)(qm_store *store, const qm_store_layout *layout);
    qm_stored (*move_layout)(qm_store *store, const char *id, int64_t from, int64_t to);
    qm_stored (*delete_layout)(qm_store *store, const char *id);

    qm_stored (*put_reconstruction)(qm_store *store, const qm_store_reconstruction *reconstruction,
                                    const qm_store_mesh *mesh, const qm_store_idempotency *idempotency);
    qm_stored (*find_reconstruction)(qm_store *store, const char *id, qm_store_reconstruction *out);
    qm_stored (*find_reconstruction_by_idempotency_key)(qm_store *store, const char *key,
                                                        qm_store_idempotency_record *out);
    qm_stored (*list_reconstructions)(qm_store *store, const qm_store_page *page, const char *source,
                                      qm_store_reconstruction *out, size_t *count);
    qm_stored (*update_reconstruction)(qm_store *store, const qm_store_effect *effect);
    qm_stored (*delete_reconstruction)(qm_store *store, const char *id);

    qm_stored (*list_job_copies)(qm_store *store, const qm_store_page *page, qm_store_job_copy *out,
                                 size_t *count);
    qm_stored (*put_job_copy)(qm_store *store, const qm_store_job_copy *copy, const qm_store_event *events,
                              size_t count, const qm_store_array *array);
    qm_stored (*list_layout_revisions)(qm_store *store, const char *id, const qm_store_page *page,
                                       qm_store_layout *out, size_t *count);
    qm_stored (*put_layout_copy)(qm_store *store, const qm_store_layout *revisions, size_t count,
                                 int64_t current, const qm_store_idempotency *idempotency);
    qm_stored (*find_layout_origin)(qm_store *store, const char *id, qm_store_origin *out);
    qm_stored (*find_reconstruction_origin)(qm_store *store, const char *id, qm_store_origin *out);
    qm_stored (*sync)(qm_store *store);
    qm_stored (*open_parts)(qm_store *store, const char *job, int64_t restarts, const qm_store_bounds *bounds,
                            const qm_store_part *parts, size_t count);
    qm_stored (*claim_parts)(qm_store *store, const char *job, size_t limit, qm_store_part *out,
                             size_t *count);
    qm_stored (*finish_parts)(qm_store *store, const char *job, const qm_store_part *parts, size_t count,
                              const qm_store_bounds *found, const qm_store_part *rest, size_t rest_count);
    qm_stored (*raise_lower)(qm_store *store, const char *job, double lower, const char *witness);
    qm_stored (*read_bounds)(qm_store *store, const char *job, const qm_store_part *claimed, size_t count,
                             qm_store_bounds *out);

    /* Of an embedded store, whose folder has all files; NULL in the driver of a shared one. */
    bool (*needs_blob)(qm_store *store, const char *hash); /* a mesh has it; true after a fault */
    bool (*has_job)(qm_store *store, const char *id);      /* true after a fault */

    /* Of a shared store; NULL in the driver of an embedded one. */
    qm_stored (*beat)(qm_store *store, size_t free_workers, qm_store_cluster *out, qm_store_durable_fn *take,
                      void *user);
    qm_stored (*join)(qm_store *store);
    qm_stored (*reap)(qm_store *store, double silence_s, size_t *count);
    qm_stored (*find_home)(qm_store *store, const char *id, char out[QM_NODE_NAME_SIZE]);
    qm_stored (*cancel_job)(qm_store *store, const char *id, const char *document,
                            const qm_store_event *last);
    qm_stored (*hold_job)(qm_store *store, const char *id, int owners, bool is_kept, bool *is_unwanted);
    qm_stored (*look_at_jobs)(qm_store *store, qm_store_look *looks, size_t count, qm_store_event_fn *take,
                              void *user);
    /** Stores the bytes of an open file under their hash, for all nodes, where they are missing or is_repair says that
     * they are damaged. */
    qm_stored (*put_blob)(qm_store *store, const char *hash, int file, bool is_repair);
    /** Writes the bytes of a blob to an open file in place of what it has; the caller compares them with the hash. */
    qm_stored (*get_blob)(qm_store *store, const char *hash, int file);
    qm_stored (*clean_blobs)(qm_store *store, double delay_s);
    /** Blobs that no row names, in the order of their hashes, up to limit after one. */
    qm_stored (*list_orphans)(qm_store *store, const char *after, size_t limit, char (*hashes)[QM_HASH_SIZE],
                              size_t *count);
    /** Writes what tells the database from all others, and stays when a standby takes over. */
    qm_stored (*identify)(qm_store *store, char out[QM_STORE_IDENTITY_SIZE]);
    void (*watch)(qm_store *store, qm_store_news_fn *tell, void *user);
    void (*unwatch)(qm_store *store);
    qm_stored (*find_split_job)(qm_store *store, const char (*except)[QM_ID_SIZE], size_t count,
                                qm_store_job *out);
} qm_store_driver;

struct qm_store {
    const qm_store_driver *driver;
    char *folder;
    int lock_file; /* held with flock: one process a folder */
    qm_space space;
    struct qm_sqlite *sqlite;     /* of an embedded store, or NULL */
    struct qm_postgres *postgres; /* of a shared one, or NULL */
};

extern const qm_store_driver qm_sqlite_driver, qm_postgres_driver;

/** Counts the time of a verb of a shared store. */
void qm_store_count_verb(const qm_store *store, const char *verb, qm_stored stored, double start_ms);

/** The body of a verb: calls the driver, and counts the time. */
#define QM_STORE_RETURN_VERB(store, verb, ...)                                                               \
    double start_ms = qm_clock_now_ms();                                                                     \
    QM_FAILPOINT_BEGIN(#verb);                                                                               \
    qm_stored stored = (store)->driver->verb(__VA_ARGS__);                                                   \
    QM_FAILPOINT_END();                                                                                      \
    qm_store_count_verb(store, #verb, stored, start_ms);                                                     \
    return stored

/** The status of a call on files that depends on rows; QM_E_CANCELED: the database is away. */
qm_status qm_store_status(qm_stored stored);

/** A store of a folder that is neither held nor opened, for qm_store_close; NULL with a message. */
qm_store *qm_store_create(const char *folder, char message[QM_MESSAGE_SIZE]);

/**
 * Plans a data folder that is filled beside its place, under its name with an ending, so that one that is half filled
 * looks like none: writes both names. False with a message when there is something in its place or beside it.
 */
bool qm_store_plan_folder(const char *folder, const char *ending, char name[QM_STORE_FOLDER_SIZE],
                          char path[QM_STORE_FOLDER_SIZE], char message[QM_MESSAGE_SIZE]);

/** Makes a file or folder durable, gives it its name, and makes that durable. */
bool qm_store_put_in_place(const char *path, const char *name);

/** Removes a folder with all that is in it. */
void qm_store_remove_folder(const char *path);

/** Takes the lock of the folder; or a status with a message. */
qm_status qm_store_lock_folder(qm_store *store, char message[QM_MESSAGE_SIZE]);

#endif
