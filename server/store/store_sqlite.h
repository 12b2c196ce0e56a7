/**
 * store_sqlite.h: what the files of the driver for an embedded store share.
 */
#ifndef QM_STORE_SQLITE_H
#define QM_STORE_SQLITE_H

#include <pthread.h>
#include <sqlite3.h>

#include "store_driver.h"

#define QM_STORE_STATEMENTS 96

/** A statement that stays prepared; its text is a literal, identified by its address. */
typedef struct qm_sqlite_statement {
    const char *sql;
    sqlite3_stmt *prepared;
} qm_sqlite_statement;

struct qm_sqlite {
    sqlite3 *database;
    pthread_mutex_t lock; /* guards the database connection and what follows */
    qm_sqlite_statement statements[QM_STORE_STATEMENTS];
    size_t statement_count;
    int measured;       /* changes of the database when its size was measured */
    bool has_claimed;   /* the jobs of an earlier process */
    int64_t next, last; /* sequence numbers of those that are to be handed out */
};

#define QM_STORE_DATABASE "quadmeshd.sqlite"
#define QM_STORE_FRESH                                                                                       \
    "there are files of meshes or results, but no database: put it back from a copy; --adopt "               \
    "makes"                                                                                                  \
    " meshes of the files, --empty moves them away"

/** The layer that gives each page of a database a checksum (store_sqlite_sums.c), and its name. */
#define QM_STORE_SUMS "quadmeshd-sums"
#define QM_STORE_SUM_SIZE 8 /* bytes at the end of a page */
void qm_sqlite_sums_register(void);

/** File control code: sets a bool, true for a database that has no checksums yet. */
#define QM_STORE_ASK_PLAIN 0x716d70

/** Opens the database of a folder whose lock is held, and brings it up to date. */
qm_status qm_sqlite_open_database(qm_store *store, qm_store_purpose purpose, char message[QM_MESSAGE_SIZE]);
void qm_sqlite_close_database(qm_store *store);

/** Counts the bytes of the pages in use. The lock is held, or no other thread uses the store. */
void qm_sqlite_measure_database(qm_store *store);

/** Makes an empty database of this version, or without any table. *out is to be closed in either case. */
bool qm_sqlite_make_database(const char *path, sqlite3 **out);
bool qm_sqlite_make_file(const char *path, sqlite3 **out);

/** Makes the database of a store anew of the rows that can be read, and opens it. */
bool qm_sqlite_salvage(qm_store *store, FILE *out);

/** A statement, a literal, with the lock held until qm_store_end; NULL after a fault, with the lock given
 * back.
 */
sqlite3_stmt *qm_sqlite_begin(qm_store *store, const char *sql);

/** How rows of a table are read into structs of the caller. */
typedef struct qm_sqlite_table {
    size_t size;                                      /* of a struct */
    bool (*read)(sqlite3_stmt *statement, void *row); /* false, and nothing to reset: out of memory */
    void (*reset)(void *row);
} qm_sqlite_table;

/** Reads the one row of a statement and ends it; see store.h for the status. NULL for statement is a
 * fault. */
qm_stored qm_sqlite_find_row(qm_store *store, sqlite3_stmt *statement, const qm_sqlite_table *table,
                             void *out);

/** Reads the one row of a statement with one string parameter. */
qm_stored qm_sqlite_find_row_by(qm_store *store, const char *sql, const char *text,
                                const qm_sqlite_table *table, void *out);

/** A query for pages: SELECT ... FROM ..., its column of sequence numbers, and conditions with a parameter each.
 * Those whose value is NULL are left out; there is an index for each but labels. */
#define QM_STORE_CONDITIONS 4
typedef struct qm_sqlite_listing {
    const char *select, *sequence;
    const char *conditions[QM_STORE_CONDITIONS];
    const char *values[QM_STORE_CONDITIONS];
} qm_sqlite_listing;

/** The rows of a page. */
qm_stored qm_sqlite_list_rows(qm_store *store, const qm_sqlite_listing *listing, const qm_store_page *page,
                              const qm_sqlite_table *table, void *out, size_t *count);

/** Runs a statement that deletes the row of an id. */
qm_stored qm_sqlite_delete_row(qm_store *store, const char *sql, const char *id);

/** Runs a statement that returns a row if it has changed one, and ends it; QM_STORED_NONE when it has not. */
qm_stored qm_sqlite_change_row(qm_store *store, sqlite3_stmt *statement);

/** Steps to the next row. False after the last one, and after a fault, which is logged. */
bool qm_sqlite_step(qm_store *store, sqlite3_stmt *statement);

/** Steps a statement that returns no row and ends it. */
qm_stored qm_sqlite_execute(qm_store *store, sqlite3_stmt *statement);
void qm_sqlite_end(qm_store *store, sqlite3_stmt *statement);

/**
 * A transaction: begin takes the lock, false after a fault, which is logged; then it has given the lock back. End
 * gives the lock back, and commits when all went well so far (QM_STORED); else it undoes all, and returns its argument.
 */
bool qm_sqlite_begin_transaction(qm_store *store);
qm_stored qm_sqlite_end_transaction(qm_store *store, qm_stored stored);

/** A statement of a transaction, a literal; NULL after a fault, which is logged. */
sqlite3_stmt *qm_sqlite_prepare(qm_store *store, const char *sql);

/** Runs one that returns no row. NULL is a fault. */
bool qm_sqlite_run(qm_store *store, sqlite3_stmt *statement);

/** True when the last statement has changed a row. */
bool qm_sqlite_has_changed(qm_store *store);

/** True when a statement with one string finds a row. */
bool qm_sqlite_has_row(qm_store *store, const char *sql, const char *text);

/** Parts of transactions: a row of a mesh; the effect of the end of a job; the array of a job. */
qm_stored qm_sqlite_add_mesh(qm_store *store, const qm_store_mesh *mesh);
qm_stored qm_sqlite_apply_effect(qm_store *store, const qm_store_effect *effect);
bool qm_sqlite_add_array(qm_store *store, const char *job_id, const qm_store_array *array);
/** The same: what the request of a job names; NULL and "" are nothing. */
bool qm_sqlite_add_subjects(qm_store *store, const char *job_id, const char *subjects);

/** The columns of a job, and how they are read into a qm_store_job. */
#define QM_SQLITE_JOB_COLUMNS                                                                                \
    "id, key, idempotency_key, body, created, state, sequence, document, restarts, result, begun, cancel, "  \
    "labels"
bool qm_sqlite_read_job(sqlite3_stmt *statement, void *row);

/** The columns of a layout l at its revision r, and how they are read into a qm_store_layout. */
#define QM_SQLITE_LAYOUT_COLUMNS                                                                             \
    "l.id, l.mesh, l.created, r.layout, r.issues, r.revision, r.next_curve, l.sequence,"                     \
    " (SELECT min(revision) FROM layout_revisions WHERE id = l.id),"                                         \
    " (SELECT max(revision) FROM layout_revisions WHERE id = l.id), r.is_complete"
bool qm_sqlite_read_layout(sqlite3_stmt *statement, void *row);

/** Part of a transaction: a revision of a layout. */
bool qm_sqlite_add_revision(qm_store *store, const qm_store_layout *layout, int64_t revision);

/** The idempotency record that a statement with one string finds. */
qm_stored qm_sqlite_find_idempotency_record(qm_store *store, const char *sql, const char *key,
                                            qm_store_idempotency_record *out);

/** Copies a column to the heap; NULL for an SQL null. False, with a record in the log: out of memory. */
bool qm_sqlite_copy_text(sqlite3_stmt *statement, int column, char **out);

/** Copies the first size - 1 bytes of a text column. False, with a record in the log: out of memory. */
bool qm_sqlite_read_text(sqlite3_stmt *statement, int column, char *out, size_t size);

/** Binds a string that outlives the statement; NULL binds an SQL null. */
void qm_sqlite_bind_text(sqlite3_stmt *statement, int index, const char *text);

/* The verbs of the driver (store_driver.h). */
qm_stored qm_sqlite_put_mesh(qm_store *store, const qm_store_mesh *mesh);
qm_stored qm_sqlite_find_mesh(qm_store *store, const char *id, qm_store_mesh *out);
qm_stored qm_sqlite_find_mesh_states(qm_store *store, const char *const *ids, size_t count,
                                     qm_store_mesh_state *out);
qm_stored qm_sqlite_find_undeformed(qm_store *store, const char *const *hashes, size_t count,
                                    char (*ids)[QM_ID_SIZE]);
qm_stored qm_sqlite_find_mesh_by_content(qm_store *store, const char *hash, const char *options,
                                         qm_store_mesh *out);
qm_stored qm_sqlite_list_meshes(qm_store *store, const qm_store_page *page,
                                const qm_store_mesh_filter *filter, qm_store_mesh *out, size_t *count);
qm_stored qm_sqlite_revise_mesh(qm_store *store, const qm_store_mesh *mesh);
qm_stored qm_sqlite_set_notes(qm_store *store, const qm_store_mesh *mesh);
qm_stored qm_sqlite_set_expiry(qm_store *store, const char *id, const char *expires);
qm_stored qm_sqlite_find_expired_mesh(qm_store *store, const char *before, qm_store_mesh *out);
qm_stored qm_sqlite_delete_mesh(qm_store *store, const char *id);
qm_stored qm_sqlite_submit_job(qm_store *store, const qm_store_submission *submission);
qm_stored qm_sqlite_claim_jobs(qm_store *store, const qm_store_wish *wish, qm_store_job *out, size_t *count);
qm_stored qm_sqlite_begin_job(qm_store *store, const char *id);
qm_stored qm_sqlite_note_cancel(qm_store *store, const char *id);
qm_stored qm_sqlite_append_events(qm_store *store, qm_store_run *runs, size_t run_count,
                                  const qm_store_event *events, size_t count);
qm_stored qm_sqlite_finish_job(qm_store *store, const qm_store_job *end, const char *revisions,
                               const qm_store_event *events, size_t count, const qm_store_effect *effect);
qm_stored qm_sqlite_leave_jobs(qm_store *store);
qm_stored qm_sqlite_read_events(qm_store *store, const char *id, uint64_t after, qm_store_event_fn *take,
                                void *user);
qm_stored qm_sqlite_find_job(qm_store *store, const char *id, qm_store_job *out);
qm_stored qm_sqlite_find_job_by_key(qm_store *store, const char *key, const char *revisions,
                                    qm_job_state state, qm_store_job *out);
qm_stored qm_sqlite_find_job_by_idempotency_key(qm_store *store, const char *key, qm_store_job *out);
qm_stored qm_sqlite_set_job_labels(qm_store *store, const char *id, const char *labels);
qm_stored qm_sqlite_forget_answer(qm_store *store, const char *id);
qm_stored qm_sqlite_list_jobs(qm_store *store, const qm_store_page *page, const qm_store_job_filter *filter,
                              qm_store_job *out, size_t *count);
qm_stored qm_sqlite_drop_old_jobs(qm_store *store, size_t kept, double kept_s, size_t limit,
                                  char (*ids)[QM_ID_SIZE], size_t *count);
qm_stored qm_sqlite_delete_job(qm_store *store, const char *id);
qm_stored qm_sqlite_put_array(qm_store *store, const char *job_id, const qm_store_array *array);
qm_stored qm_sqlite_find_array(qm_store *store, const char *job_id, qm_store_array *out);
qm_stored qm_sqlite_put_layout(qm_store *store, const qm_store_layout *layout,
                               const qm_store_idempotency *idempotency);
qm_stored qm_sqlite_find_layout(qm_store *store, const char *id, qm_store_layout *out);
qm_stored qm_sqlite_find_layout_by_idempotency_key(qm_store *store, const char *key,
                                                   qm_store_idempotency_record *out);
qm_stored qm_sqlite_list_layouts(qm_store *store, const qm_store_page *page, const char *mesh,
                                 qm_store_layout *out, size_t *count);
qm_stored qm_sqlite_edit_layout(qm_store *store, const qm_store_layout *layout);
qm_stored qm_sqlite_move_layout(qm_store *store, const char *id, int64_t from, int64_t to);
qm_stored qm_sqlite_delete_layout(qm_store *store, const char *id);
qm_stored qm_sqlite_put_reconstruction(qm_store *store, const qm_store_reconstruction *reconstruction,
                                       const qm_store_mesh *mesh, const qm_store_idempotency *idempotency);
qm_stored qm_sqlite_find_reconstruction(qm_store *store, const char *id, qm_store_reconstruction *out);
qm_stored qm_sqlite_find_reconstruction_by_idempotency_key(qm_store *store, const char *key,
                                                           qm_store_idempotency_record *out);
qm_stored qm_sqlite_list_reconstructions(qm_store *store, const qm_store_page *page, const char *source,
                                         qm_store_reconstruction *out, size_t *count);
qm_stored qm_sqlite_update_reconstruction(qm_store *store, const qm_store_effect *effect);
qm_stored qm_sqlite_delete_reconstruction(qm_store *store, const char *id);
qm_stored qm_sqlite_list_job_copies(qm_store *store, const qm_store_page *page, qm_store_job_copy *out,
                                    size_t *count);
qm_stored qm_sqlite_put_job_copy(qm_store *store, const qm_store_job_copy *copy, const qm_store_event *events,
                                 size_t count, const qm_store_array *array);
qm_stored qm_sqlite_list_layout_revisions(qm_store *store, const char *id, const qm_store_page *page,
                                          qm_store_layout *out, size_t *count);
qm_stored qm_sqlite_put_layout_copy(qm_store *store, const qm_store_layout *revisions, size_t count,
                                    int64_t current, const qm_store_idempotency *idempotency);
qm_stored qm_sqlite_find_layout_origin(qm_store *store, const char *id, qm_store_origin *out);
qm_stored qm_sqlite_find_reconstruction_origin(qm_store *store, const char *id, qm_store_origin *out);
qm_stored qm_sqlite_sync(qm_store *store);
qm_stored qm_sqlite_open_parts(qm_store *store, const char *job, int64_t restarts,
                               const qm_store_bounds *bounds, const qm_store_part *parts, size_t count);
qm_stored qm_sqlite_claim_parts(qm_store *store, const char *job, size_t limit, qm_store_part *out,
                                size_t *count);
qm_stored qm_sqlite_finish_parts(qm_store *store, const char *job, const qm_store_part *parts, size_t count,
                                 const qm_store_bounds *found, const qm_store_part *rest, size_t rest_count);
qm_stored qm_sqlite_raise_lower(qm_store *store, const char *job, double lower, const char *witness);
qm_stored qm_sqlite_read_bounds(qm_store *store, const char *job, const qm_store_part *claimed, size_t count,
                                qm_store_bounds *out);
bool qm_sqlite_needs_blob(qm_store *store, const char *hash);
bool qm_sqlite_has_job(qm_store *store, const char *id);

#endif
