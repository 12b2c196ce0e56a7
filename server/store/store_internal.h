/**
 * store_internal.h: what the files of the store share.
 */
#ifndef QM_STORE_INTERNAL_H
#define QM_STORE_INTERNAL_H

#include <pthread.h>
#include <sqlite3.h>

#include "blob.h"
#include "space.h"

#define QM_STORE_STATEMENTS 64

/** A statement that stays prepared; its text is a literal, identified by its address. */
typedef struct qm_store_statement {
    const char *sql;
    sqlite3_stmt *prepared;
} qm_store_statement;

struct qm_store {
    char *folder;
    int lock_file; /* held with flock: one process a folder */
    sqlite3 *database;
    pthread_mutex_t lock; /* guards the database connection and what follows */
    qm_store_statement statements[QM_STORE_STATEMENTS];
    size_t statement_count;
    int measured; /* changes of the database when its size was measured */
    qm_space space;
};

#define QM_STORE_DATABASE "quadmeshd.sqlite"
#define QM_STORE_FRESH                                                                                       \
    "there are files of meshes or results, but no database: put it back from a copy; --adopt "               \
    "makes"                                                                                                  \
    " meshes of the files, --empty moves them away"

/** The layer that gives each page of a database a checksum (store_sums.c), and its name. */
#define QM_STORE_SUMS "quadmeshd-sums"
#define QM_STORE_SUM_SIZE 8 /* bytes at the end of a page */
void qm_store_sums_register(void);

/** File control code: sets a bool, true for a database that has no checksums yet. */
#define QM_STORE_ASK_PLAIN 0x716d70

/** A store of a folder that is neither held nor opened, for qm_store_close; NULL with a message. */
qm_store *qm_store_create(const char *folder, char message[QM_MESSAGE_SIZE]);

/** Opens the database of a folder whose lock is held, and brings it up to date. */
qm_status qm_store_open_database(qm_store *store, qm_store_purpose purpose, char message[QM_MESSAGE_SIZE]);
void qm_store_close_database(qm_store *store);

/** Counts the bytes of the pages in use. The lock is held, or no other thread uses the store. */
void qm_store_measure_database(qm_store *store);

/** Makes an empty database of this version, or without any table. *out is to be closed in either case. */
bool qm_store_make_database(const char *path, sqlite3 **out);
bool qm_store_make_file(const char *path, sqlite3 **out);

/** Makes the database of a store anew of the rows that can be read, and opens it. */
bool qm_store_salvage(qm_store *store, FILE *out);

/** A statement, a literal, with the lock held until qm_store_end; NULL after a fault, with the lock given
 * back.
 */
sqlite3_stmt *qm_store_begin(qm_store *store, const char *sql);

/** How rows of a table are read into structs of the caller. */
typedef struct qm_store_table {
    size_t size;                                      /* of a struct */
    bool (*read)(sqlite3_stmt *statement, void *row); /* false, and nothing to reset: out of memory */
    void (*reset)(void *row);
} qm_store_table;

/** Reads the one row of a statement and ends it; see store.h for the status. NULL for statement is a
 * fault. */
qm_status qm_store_find_row(qm_store *store, sqlite3_stmt *statement, const qm_store_table *table, void *out);

/** Reads the one row of a statement with one string parameter. */
qm_status qm_store_find_row_by(qm_store *store, const char *sql, const char *text,
                               const qm_store_table *table, void *out);

/** A query for pages: SELECT ... FROM ..., its column of sequence numbers, and conditions with a parameter each.
 * Those whose value is NULL are left out; there is an index for each. */
#define QM_STORE_CONDITIONS 3
typedef struct qm_store_listing {
    const char *select, *sequence;
    const char *conditions[QM_STORE_CONDITIONS];
    const char *values[QM_STORE_CONDITIONS];
} qm_store_listing;

/** The rows of a page. */
qm_status qm_store_list_rows(qm_store *store, const qm_store_listing *listing, const qm_store_page *page,
                             const qm_store_table *table, void *out, size_t *count);

/** Runs a statement that deletes the row of an id. */
qm_status qm_store_delete_row(qm_store *store, const char *sql, const char *id);

/** Steps to the next row. False after the last one, and after a fault, which is logged. */
bool qm_store_step(qm_store *store, sqlite3_stmt *statement);

/** Steps a statement that returns no row and ends it. */
qm_status qm_store_execute(qm_store *store, sqlite3_stmt *statement);
void qm_store_end(qm_store *store, sqlite3_stmt *statement);

/**
 * A transaction: begin takes the lock and end gives it back, committing when all went well so far. False
 * after a fault, which is logged; begin has given the lock back then.
 */
bool qm_store_begin_transaction(qm_store *store);
bool qm_store_end_transaction(qm_store *store, bool good);

/** A statement of a transaction, a literal; NULL after a fault, which is logged. */
sqlite3_stmt *qm_store_prepare(qm_store *store, const char *sql);

/** Runs one that returns no row. NULL is a fault. */
bool qm_store_run(qm_store *store, sqlite3_stmt *statement);

/** Parts of transactions: a row of a mesh; the effect of the end of a job, of which QM_E_CANCELED is no fault. */
bool qm_store_add_mesh(qm_store *store, const qm_store_mesh *mesh);
qm_status qm_store_apply_effect(qm_store *store, const qm_store_effect *effect);

/** The idempotency record that a statement with one string finds. */
qm_status qm_store_find_idempotency_record(qm_store *store, const char *sql, const char *key,
                                           qm_store_idempotency_record *out);

/** Copies a column to the heap; NULL for an SQL null. False, with a record in the log: out of memory. */
bool qm_store_copy_text(sqlite3_stmt *statement, int column, char **out);

/** Copies the first size - 1 bytes of a text column. False, with a record in the log: out of memory. */
bool qm_store_read_text(sqlite3_stmt *statement, int column, char *out, size_t size);

/** Binds a string that outlives the statement; NULL binds an SQL null. */
void qm_store_bind_text(sqlite3_stmt *statement, int index, const char *text);

#endif
