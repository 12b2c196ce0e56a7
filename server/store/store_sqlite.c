/**
 * store_sqlite.c: the database of the store: its schema, its statements, alone or in a transaction, and how
 * rows are read. A write-ahead log with full synchronisation: a commit that has returned is on disk.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/log.h"
#include "base/metrics.h"
#include "result_file.h"
#include "store_sqlite.h"

#define BUSY_TIMEOUT_MS 5000
#define OLDEST_SCHEMA 7
#define FIRST_SUMMED 10 /* schema whose pages have checksums */
#define SCHEMA 16

static const char pragmas[] = "PRAGMA synchronous = FULL; PRAGMA foreign_keys = ON;";

#define CREATE_ARRAYS                                                                                        \
    "CREATE TABLE job_arrays ("                                                                              \
    "  job INTEGER PRIMARY KEY REFERENCES jobs (sequence) ON DELETE CASCADE, count INTEGER NOT NULL,"        \
    "  sums BLOB NOT NULL);"

/** What the filters of lists need. Unfinished jobs have state 0. */
#define CREATE_FILTERS                                                                                       \
    "CREATE TABLE job_subjects ("                                                                            \
    "  job INTEGER NOT NULL REFERENCES jobs (sequence) ON DELETE CASCADE, subject TEXT NOT NULL,"            \
    "  PRIMARY KEY (job, subject)) WITHOUT ROWID;"                                                           \
    "CREATE INDEX job_subjects_by_subject ON job_subjects (subject, job);"                                   \
    "CREATE INDEX jobs_by_state ON jobs (state);"                                                            \
    "CREATE INDEX jobs_by_type ON jobs (type);"                                                              \
    "CREATE INDEX meshes_by_name ON meshes (name);"                                                          \
    "CREATE INDEX layouts_by_mesh ON layouts (mesh);"                                                        \
    "CREATE INDEX reconstructions_by_source ON reconstructions (source);"

#define CREATE_EXPIRY "CREATE INDEX meshes_by_expiry ON meshes (expires) WHERE expires <> '';"

/** Searches in parts (store_parts.h); entries are of store_parts.h's caller. */
#define CREATE_PARTS                                                                                         \
    "CREATE TABLE job_bounds ("                                                                              \
    "  job INTEGER PRIMARY KEY REFERENCES jobs (sequence) ON DELETE CASCADE, engine TEXT NOT NULL,"          \
    "  lower REAL NOT NULL, witness TEXT NOT NULL, discarded REAL NOT NULL, iterations INTEGER NOT NULL,"    \
    "  projections INTEGER NOT NULL);"                                                                       \
    "CREATE TABLE job_parts ("                                                                               \
    "  part INTEGER PRIMARY KEY AUTOINCREMENT,"                                                              \
    "  job INTEGER NOT NULL REFERENCES job_bounds (job) ON DELETE CASCADE, upper REAL NOT NULL,"             \
    "  entries BLOB NOT NULL, epoch INTEGER NOT NULL DEFAULT 0);"                                            \
    "CREATE INDEX job_parts_by_upper ON job_parts (job, upper DESC);"

/** What is known of meshes besides their files; labels stand between line feeds. */
#define ADD_NOTES                                                                                            \
    "ALTER TABLE meshes ADD COLUMN unit TEXT NOT NULL DEFAULT '';"                                           \
    "ALTER TABLE meshes ADD COLUMN uncertainty REAL NOT NULL DEFAULT 0;"                                     \
    "ALTER TABLE meshes ADD COLUMN labels TEXT NOT NULL DEFAULT '';"

#define ADD_JOB_LABELS "ALTER TABLE jobs ADD COLUMN labels TEXT NOT NULL DEFAULT '';"

/** Of a new database. */
static const char schema[] =
    "CREATE TABLE meshes ("
    "  sequence INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, hash TEXT NOT NULL,"
    "  options TEXT NOT NULL, name TEXT NOT NULL, document TEXT NOT NULL, format INTEGER NOT NULL,"
    "  revision INTEGER NOT NULL, positions TEXT NOT NULL, created TEXT NOT NULL,"
    "  expires TEXT NOT NULL DEFAULT '');"
    "CREATE INDEX meshes_by_content ON meshes (hash, options);"
    "CREATE INDEX meshes_by_positions ON meshes (positions);"
    "CREATE TABLE jobs ("
    "  sequence INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, key TEXT NOT NULL,"
    "  idempotency_key TEXT UNIQUE, body TEXT NOT NULL, created TEXT NOT NULL, document TEXT,"
    "  result TEXT, state INTEGER NOT NULL, revisions TEXT NOT NULL, restarts INTEGER NOT NULL DEFAULT 0,"
    "  begun INTEGER NOT NULL DEFAULT 0, type TEXT NOT NULL DEFAULT '', cancel INTEGER NOT NULL DEFAULT 0);"
    "CREATE INDEX jobs_by_key ON jobs (key, revisions, state);"
    "CREATE INDEX jobs_unfinished ON jobs (sequence) WHERE document IS NULL;"
    "CREATE TABLE job_events ("
    "  job INTEGER NOT NULL REFERENCES jobs (sequence) ON DELETE CASCADE, seq INTEGER NOT NULL,"
    "  name TEXT NOT NULL, members TEXT NOT NULL, PRIMARY KEY (job, seq)) WITHOUT ROWID;"
    "CREATE TABLE layouts ("
    "  sequence INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, mesh TEXT NOT NULL,"
    "  created TEXT NOT NULL, revision INTEGER NOT NULL, idempotency_key TEXT UNIQUE, request TEXT NOT NULL);"
    "CREATE TABLE layout_revisions ("
    "  id TEXT NOT NULL REFERENCES layouts (id) ON DELETE CASCADE, revision INTEGER NOT NULL,"
    "  layout TEXT NOT NULL, issues TEXT NOT NULL, next_curve INTEGER NOT NULL,"
    "  is_complete INTEGER NOT NULL, PRIMARY KEY (id, revision));"
    "CREATE TABLE reconstructions ("
    "  sequence INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, source TEXT NOT NULL,"
    "  layout_id TEXT NOT NULL, mesh TEXT NOT NULL, layout TEXT NOT NULL, document TEXT NOT NULL,"
    "  steps TEXT NOT NULL, records TEXT NOT NULL, state TEXT NOT NULL, revision INTEGER NOT NULL,"
    "  cover_share REAL NOT NULL, pull_curves INTEGER NOT NULL, idempotency_key TEXT UNIQUE,"
    "  request TEXT NOT NULL);" CREATE_ARRAYS CREATE_FILTERS CREATE_EXPIRY CREATE_PARTS ADD_NOTES
        ADD_JOB_LABELS;

/** The step from a version of the schema to the next one; the task runs after the statements, in the same
 * transaction. */
typedef struct migration {
    const char *sql;
    bool (*task)(qm_store *store);
} migration;

static bool add_sums(qm_store *store)
{
    return qm_result_file_add_sums(store, qm_sqlite_add_array);
}

/** From OLDEST_SCHEMA on. A step that was released is never changed. */
static const migration migrations[SCHEMA - OLDEST_SCHEMA] = {
    {CREATE_ARRAYS, add_sums},                                              /* 7 to 8 */
    {"ALTER TABLE jobs ADD COLUMN begun INTEGER NOT NULL DEFAULT 0", NULL}, /* 8 to 9 */
    {"", NULL}, /* 9 to 10: the file was written again, with checksums */
    {"ALTER TABLE jobs ADD COLUMN type TEXT NOT NULL DEFAULT '';"
     "UPDATE jobs SET type = coalesce(json_extract(body, '$.type'), '');" CREATE_FILTERS
     "INSERT OR IGNORE INTO job_subjects (job, subject) SELECT sequence, json_extract(body, f.value)"
     "  FROM jobs, json_each('[\"$.a\", \"$.b\", \"$.mesh\", \"$.reconstruction\"]') f"
     "  WHERE json_extract(body, f.value) IS NOT NULL",
     NULL},                                                                                  /* 10 to 11 */
    {"ALTER TABLE meshes ADD COLUMN expires TEXT NOT NULL DEFAULT '';" CREATE_EXPIRY, NULL}, /* 11 to 12 */
    {CREATE_PARTS, NULL},                                                                    /* 12 to 13 */
    /* 13 to 14. What a search has stored in parts is in another form: it begins anew. */
    {"ALTER TABLE jobs ADD COLUMN cancel INTEGER NOT NULL DEFAULT 0;"
     "DROP TABLE job_parts; DROP TABLE job_bounds;" CREATE_PARTS,
     NULL},
    {ADD_NOTES, NULL},      /* 14 to 15 */
    {ADD_JOB_LABELS, NULL}, /* 15 to 16 */
};

/** Writes the value of a pragma; false, and "", after a fault. */
static bool ask(sqlite3 *database, const char *pragma, char out[16])
{
    sqlite3_stmt *statement = NULL;
    bool has_value = sqlite3_prepare_v2(database, pragma, -1, &statement, NULL) == SQLITE_OK &&
                     sqlite3_step(statement) == SQLITE_ROW;
    const char *value = has_value ? (const char *)sqlite3_column_text(statement, 0) : NULL;
    snprintf(out, 16, "%s", value ? value : "");
    sqlite3_finalize(statement);
    return value != NULL;
}

static qm_status fail_to_open(sqlite3 *database, char message[QM_MESSAGE_SIZE])
{
    bool is_damaged = sqlite3_extended_errcode(database) == SQLITE_IOERR_DATA;
    snprintf(message, QM_MESSAGE_SIZE, "database: %s",
             is_damaged ? "a page is not as it was written" : sqlite3_errmsg(database));
    return QM_E_ARGUMENT;
}

/** Runs statements and a task, and sets the version of the schema: all of it, or nothing. */
static bool change_schema(qm_store *store, const migration *change, int version)
{
    char sql[48];
    snprintf(sql, sizeof sql, "PRAGMA user_version = %d", version);
    if (!qm_sqlite_begin_transaction(store)) return false;
    bool good = sqlite3_exec(store->sqlite->database, change->sql, NULL, NULL, NULL) == SQLITE_OK &&
                (!change->task || change->task(store)) &&
                sqlite3_exec(store->sqlite->database, sql, NULL, NULL, NULL) == SQLITE_OK;
    return qm_sqlite_end_transaction(store, good ? QM_STORED : QM_STORED_FAULT) == QM_STORED;
}

/**
 * Writes the database again as a new file, whose pages have checksums, and puts it in its place. The old one is
 * closed, without a log, when the new one is whole and on disk.
 */
static qm_status write_again(qm_store *store, char message[QM_MESSAGE_SIZE])
{
    char path[QM_STORE_PATH_SIZE], new_path[QM_STORE_PATH_SIZE], mode[16];
    snprintf(path, sizeof path, "%s/" QM_STORE_DATABASE, store->folder);
    snprintf(new_path, sizeof new_path, "%s/" QM_STORE_DATABASE ".new", store->folder);
    unlink(new_path);
    sqlite3_stmt *statement = NULL;
    bool written =
        sqlite3_prepare_v2(store->sqlite->database, "VACUUM INTO ?", -1, &statement, NULL) == SQLITE_OK &&
        sqlite3_bind_text(statement, 1, new_path, -1, SQLITE_STATIC) == SQLITE_OK &&
        sqlite3_step(statement) == SQLITE_DONE;
    sqlite3_finalize(statement);
    int file = written ? open(new_path, O_RDONLY | O_CLOEXEC) : -1;
    written = file >= 0 && fsync(file) == 0;
    if (file >= 0) close(file);
    /* Without a log: that of the old file is none of the new one. */
    written = written && ask(store->sqlite->database, "PRAGMA journal_mode = DELETE", mode) &&
              strcmp(mode, "delete") == 0;
    if (!written) return fail_to_open(store->sqlite->database, message);
    qm_sqlite_close_database(store);
    if (rename(new_path, path) == 0 && qm_blob_sync_folder(store->folder)) return QM_OK;
    snprintf(message, QM_MESSAGE_SIZE, "database: cannot replace: %s", strerror(errno));
    return QM_E_ARGUMENT;
}

/** Checks the version first: a database of a newer version, or of one too old, is left as it is. */
static qm_status set_up(qm_store *store, qm_store_purpose purpose, char message[QM_MESSAGE_SIZE])
{
    sqlite3 *database = store->sqlite->database;
    char text[16], mode[16];
    if (!ask(database, "PRAGMA user_version", text)) return fail_to_open(database, message);
    int version = atoi(text);
    if (version != 0 && (version < OLDEST_SCHEMA || version > SCHEMA)) {
        snprintf(message, QM_MESSAGE_SIZE,
                 "database: schema %d was written by another version of quadmeshd; this one reads %d to %d",
                 version, OLDEST_SCHEMA, SCHEMA);
        return QM_E_UNSUPPORTED;
    }
    if (version == 0 && purpose == QM_STORE_SERVE && qm_blob_has_files(store->folder)) {
        snprintf(message, QM_MESSAGE_SIZE, QM_STORE_FRESH);
        return QM_E_EMPTY;
    }
    if (version < SCHEMA && purpose == QM_STORE_CHECK) {
        snprintf(message, QM_MESSAGE_SIZE,
                 "database: schema %d is brought up to date by the next start of the daemon, not by a check",
                 version);
        return QM_E_UNSUPPORTED;
    }
    if (!ask(database, "PRAGMA journal_mode = WAL", mode)) return fail_to_open(database, message);
    if (strcmp(mode, "wal") != 0) {
        snprintf(message, QM_MESSAGE_SIZE, "database: the file system does not allow a write-ahead log");
        return QM_E_UNSUPPORTED;
    }
    bool is_plain = false;
    sqlite3_file_control(database, "main", QM_STORE_ASK_PLAIN, &is_plain);
    if (is_plain && version >= FIRST_SUMMED) {
        snprintf(message, QM_MESSAGE_SIZE, "database: its header is damaged");
        return QM_E_FORMAT;
    }
    bool good = sqlite3_exec(database, pragmas, NULL, NULL, NULL) == SQLITE_OK;
    bool is_unmade = is_plain && version == 0; /* by an earlier version that was killed */
    if (good && !is_unmade && version == 0)
        good = change_schema(store, &(migration){schema, NULL}, version = SCHEMA);
    for (; good && version < SCHEMA; version++) {
        if (is_unmade || (version + 1 == FIRST_SUMMED && is_plain)) {
            qm_status status = write_again(store, message);
            return status == QM_OK ? qm_sqlite_open_database(store, purpose, message) : status;
        }
        qm_log(QM_LOG_INFO, "database: schema %d becomes %d", version, version + 1);
        good = change_schema(store, &migrations[version - OLDEST_SCHEMA], version + 1);
    }
    if (good && purpose == QM_STORE_FILL)
        good = sqlite3_exec(database, "PRAGMA synchronous = OFF", NULL, NULL, NULL) == SQLITE_OK;
    return good ? QM_OK : fail_to_open(database, message);
}

/** Makes a store one of this driver; false: out of memory. */
static bool make_driver(qm_store *store)
{
    if (store->sqlite) return true;
    store->sqlite = calloc(1, sizeof *store->sqlite);
    if (!store->sqlite) return false;
    pthread_mutex_init(&store->sqlite->lock, NULL);
    store->driver = &qm_sqlite_driver;
    return true;
}

#ifdef QM_FAILPOINTS
/** All is written but the commit. */
static int meet_commit(void *unused)
{
    (void)unused;
    QM_FAILPOINT("before");
    return 0;
}
#endif

qm_status qm_sqlite_open_database(qm_store *store, qm_store_purpose purpose, char message[QM_MESSAGE_SIZE])
{
    char path[QM_STORE_PATH_SIZE];
    int flags = SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX;
    if (purpose != QM_STORE_CHECK) flags |= SQLITE_OPEN_CREATE;
    snprintf(path, sizeof path, "%s/" QM_STORE_DATABASE, store->folder);
    int reserved = QM_STORE_SUM_SIZE;
    if (!make_driver(store)) {
        snprintf(message, QM_MESSAGE_SIZE, "%s", qm_status_text(QM_E_NO_MEMORY));
        return QM_E_NO_MEMORY;
    }
    qm_sqlite_sums_register();
    if (sqlite3_open_v2(path, &store->sqlite->database, flags, QM_STORE_SUMS) != SQLITE_OK ||
        sqlite3_file_control(store->sqlite->database, "main", SQLITE_FCNTL_RESERVE_BYTES, &reserved) !=
            SQLITE_OK)
        return fail_to_open(store->sqlite->database, message);
    sqlite3_busy_timeout(store->sqlite->database, BUSY_TIMEOUT_MS);
#ifdef QM_FAILPOINTS
    sqlite3_commit_hook(store->sqlite->database, meet_commit, NULL);
#endif
    return set_up(store, purpose, message);
}

bool qm_sqlite_make_file(const char *path, sqlite3 **out)
{
    int reserved = QM_STORE_SUM_SIZE;
    qm_sqlite_sums_register();
    return sqlite3_open_v2(path, out, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX,
                           QM_STORE_SUMS) == SQLITE_OK &&
           sqlite3_file_control(*out, "main", SQLITE_FCNTL_RESERVE_BYTES, &reserved) == SQLITE_OK;
}

bool qm_sqlite_make_database(const char *path, sqlite3 **out)
{
    char sql[48];
    snprintf(sql, sizeof sql, "PRAGMA user_version = %d", SCHEMA);
    return qm_sqlite_make_file(path, out) && sqlite3_exec(*out, schema, NULL, NULL, NULL) == SQLITE_OK &&
           sqlite3_exec(*out, sql, NULL, NULL, NULL) == SQLITE_OK;
}

void qm_sqlite_close_database(qm_store *store)
{
    for (size_t i = 0; i < store->sqlite->statement_count; i++)
        sqlite3_finalize(store->sqlite->statements[i].prepared);
    store->sqlite->statement_count = 0;
    sqlite3_close(store->sqlite->database);
    store->sqlite->database = NULL;
}

static void close_store(qm_store *store)
{
    qm_sqlite_close_database(store);
    pthread_mutex_destroy(&store->sqlite->lock);
    free(store->sqlite);
}

const qm_store_driver qm_sqlite_driver = {
    .close = close_store,
    .put_mesh = qm_sqlite_put_mesh,
    .find_mesh = qm_sqlite_find_mesh,
    .find_mesh_states = qm_sqlite_find_mesh_states,
    .find_undeformed = qm_sqlite_find_undeformed,
    .find_mesh_by_content = qm_sqlite_find_mesh_by_content,
    .list_meshes = qm_sqlite_list_meshes,
    .revise_mesh = qm_sqlite_revise_mesh,
    .set_notes = qm_sqlite_set_notes,
    .set_expiry = qm_sqlite_set_expiry,
    .find_expired_mesh = qm_sqlite_find_expired_mesh,
    .delete_mesh = qm_sqlite_delete_mesh,
    .submit_job = qm_sqlite_submit_job,
    .claim_jobs = qm_sqlite_claim_jobs,
    .begin_job = qm_sqlite_begin_job,
    .note_cancel = qm_sqlite_note_cancel,
    .append_events = qm_sqlite_append_events,
    .finish_job = qm_sqlite_finish_job,
    .leave_jobs = qm_sqlite_leave_jobs,
    .read_events = qm_sqlite_read_events,
    .find_job = qm_sqlite_find_job,
    .find_job_by_key = qm_sqlite_find_job_by_key,
    .find_job_by_idempotency_key = qm_sqlite_find_job_by_idempotency_key,
    .set_job_labels = qm_sqlite_set_job_labels,
    .forget_answer = qm_sqlite_forget_answer,
    .list_jobs = qm_sqlite_list_jobs,
    .drop_old_jobs = qm_sqlite_drop_old_jobs,
    .delete_job = qm_sqlite_delete_job,
    .put_array = qm_sqlite_put_array,
    .find_array = qm_sqlite_find_array,
    .put_layout = qm_sqlite_put_layout,
    .find_layout = qm_sqlite_find_layout,
    .find_layout_by_idempotency_key = qm_sqlite_find_layout_by_idempotency_key,
    .list_layouts = qm_sqlite_list_layouts,
    .edit_layout = qm_sqlite_edit_layout,
    .move_layout = qm_sqlite_move_layout,
    .delete_layout = qm_sqlite_delete_layout,
    .put_reconstruction = qm_sqlite_put_reconstruction,
    .find_reconstruction = qm_sqlite_find_reconstruction,
    .find_reconstruction_by_idempotency_key = qm_sqlite_find_reconstruction_by_idempotency_key,
    .list_reconstructions = qm_sqlite_list_reconstructions,
    .update_reconstruction = qm_sqlite_update_reconstruction,
    .delete_reconstruction = qm_sqlite_delete_reconstruction,
    .list_job_copies = qm_sqlite_list_job_copies,
    .put_job_copy = qm_sqlite_put_job_copy,
    .list_layout_revisions = qm_sqlite_list_layout_revisions,
    .put_layout_copy = qm_sqlite_put_layout_copy,
    .find_layout_origin = qm_sqlite_find_layout_origin,
    .find_reconstruction_origin = qm_sqlite_find_reconstruction_origin,
    .sync = qm_sqlite_sync,
    .open_parts = qm_sqlite_open_parts,
    .claim_parts = qm_sqlite_claim_parts,
    .finish_parts = qm_sqlite_finish_parts,
    .raise_lower = qm_sqlite_raise_lower,
    .read_bounds = qm_sqlite_read_bounds,
    .needs_blob = qm_sqlite_needs_blob,
    .has_job = qm_sqlite_has_job,
};

/* ---- statements ---- */

/** Prepared once, which takes longer than running it. The code has fewer statements than the table has
 * entries. */
sqlite3_stmt *qm_sqlite_prepare(qm_store *store, const char *sql)
{
    for (size_t i = 0; i < store->sqlite->statement_count; i++)
        if (store->sqlite->statements[i].sql == sql) return store->sqlite->statements[i].prepared;
    QM_ASSERT(store->sqlite->statement_count <= QM_STORE_STATEMENTS);
    if (store->sqlite->statement_count == QM_STORE_STATEMENTS) abort();
    sqlite3_stmt *statement = NULL;
    if (sqlite3_prepare_v2(store->sqlite->database, sql, -1, &statement, NULL) == SQLITE_OK)
        store->sqlite->statements[store->sqlite->statement_count++] = (qm_sqlite_statement){sql, statement};
    else
        qm_log(QM_LOG_ERROR, "database: %s", sqlite3_errmsg(store->sqlite->database));
    return statement;
}

sqlite3_stmt *qm_sqlite_begin(qm_store *store, const char *sql)
{
    pthread_mutex_lock(&store->sqlite->lock);
    sqlite3_stmt *statement = qm_sqlite_prepare(store, sql);
    if (!statement) pthread_mutex_unlock(&store->sqlite->lock);
    return statement;
}

static void put_back(sqlite3_stmt *statement)
{
    sqlite3_reset(statement);
    sqlite3_clear_bindings(statement);
}

static uint64_t read_number(qm_store *store, const char *pragma)
{
    sqlite3_stmt *statement = qm_sqlite_prepare(store, pragma);
    uint64_t number =
        statement && sqlite3_step(statement) == SQLITE_ROW ? (uint64_t)sqlite3_column_int64(statement, 0) : 0;
    if (statement) sqlite3_reset(statement);
    return number;
}

void qm_sqlite_measure_database(qm_store *store)
{
    static const char count[] = "PRAGMA page_count", free_count[] = "PRAGMA freelist_count",
                      page[] = "PRAGMA page_size";
    uint64_t pages = read_number(store, count), free_pages = read_number(store, free_count);
    qm_space_set_database(store,
                          (pages - (free_pages < pages ? free_pages : pages)) * read_number(store, page));
    store->sqlite->measured = sqlite3_total_changes(store->sqlite->database);
}

/** Gives the lock back. */
static void leave(qm_store *store)
{
    if (sqlite3_total_changes(store->sqlite->database) != store->sqlite->measured) {
        QM_FAILPOINT("after");
        qm_sqlite_measure_database(store);
    }
    pthread_mutex_unlock(&store->sqlite->lock);
}

void qm_sqlite_end(qm_store *store, sqlite3_stmt *statement)
{
    put_back(statement);
    leave(store);
}

bool qm_sqlite_run(qm_store *store, sqlite3_stmt *statement)
{
    QM_ASSERT(pthread_mutex_trylock(&store->sqlite->lock) != 0);
    if (!statement) return false;
    int result = sqlite3_step(statement);
    if (result != SQLITE_DONE) qm_log(QM_LOG_ERROR, "database: %s", sqlite3_errmsg(store->sqlite->database));
    put_back(statement);
    return result == SQLITE_DONE;
}

static const char begin[] = "BEGIN IMMEDIATE", commit[] = "COMMIT", rollback[] = "ROLLBACK";

/** Prepares the statements that end the transaction first, so that they cannot run out of memory then. */
bool qm_sqlite_begin_transaction(qm_store *store)
{
    pthread_mutex_lock(&store->sqlite->lock);
    if (qm_sqlite_prepare(store, commit) && qm_sqlite_prepare(store, rollback) &&
        qm_sqlite_run(store, qm_sqlite_prepare(store, begin)))
        return true;
    pthread_mutex_unlock(&store->sqlite->lock);
    return false;
}

qm_stored qm_sqlite_end_transaction(qm_store *store, qm_stored stored)
{
    if (stored == QM_STORED && !qm_sqlite_run(store, qm_sqlite_prepare(store, commit)))
        stored = QM_STORED_FAULT;
    /* Some faults have rolled it back already. */
    if (stored != QM_STORED && !sqlite3_get_autocommit(store->sqlite->database))
        qm_sqlite_run(store, qm_sqlite_prepare(store, rollback));
    leave(store);
    return stored;
}

bool qm_sqlite_has_changed(qm_store *store)
{
    return sqlite3_changes(store->sqlite->database) > 0;
}

bool qm_sqlite_has_row(qm_store *store, const char *sql, const char *text)
{
    sqlite3_stmt *statement = qm_sqlite_prepare(store, sql);
    if (!statement) return false;
    qm_sqlite_bind_text(statement, 1, text);
    bool found = qm_sqlite_step(store, statement);
    put_back(statement);
    return found;
}

bool qm_sqlite_step(qm_store *store, sqlite3_stmt *statement)
{
    int result = sqlite3_step(statement);
    if (result != SQLITE_ROW && result != SQLITE_DONE)
        qm_log(QM_LOG_ERROR, "database: %s", sqlite3_errmsg(store->sqlite->database));
    return result == SQLITE_ROW;
}

qm_stored qm_sqlite_execute(qm_store *store, sqlite3_stmt *statement)
{
    bool done = qm_sqlite_run(store, statement);
    leave(store);
    return done ? QM_STORED : QM_STORED_FAULT;
}

/** Of the fault that the database has just had. */
static qm_stored status_of(qm_store *store)
{
    int code = sqlite3_extended_errcode(store->sqlite->database);
    bool is_damaged = code == SQLITE_IOERR_DATA || code == SQLITE_IOERR_READ ||
                      (code & 0xff) == SQLITE_CORRUPT || code == SQLITE_NOTADB;
    if (is_damaged) qm_metrics_add(QM_METRICS_DAMAGES, 1);
    return is_damaged                      ? QM_STORED_DAMAGED
           : (code & 0xff) == SQLITE_NOMEM ? QM_STORED_NO_MEMORY
                                           : QM_STORED_FAULT;
}

qm_stored qm_sqlite_find_row(qm_store *store, sqlite3_stmt *statement, const qm_sqlite_table *table,
                             void *out)
{
    if (!statement) return QM_STORED_NO_MEMORY;
    int result = sqlite3_step(statement);
    qm_stored status = QM_STORED_NONE;
    if (result == SQLITE_ROW)
        status = table->read(statement, out) ? QM_STORED : QM_STORED_NO_MEMORY;
    else if (result != SQLITE_DONE)
        status = status_of(store);
    if (status != QM_STORED && status != QM_STORED_NONE)
        qm_log(QM_LOG_ERROR, "database: a row cannot be read: %s", sqlite3_errmsg(store->sqlite->database));
    qm_sqlite_end(store, statement);
    return status;
}

qm_stored qm_sqlite_find_row_by(qm_store *store, const char *sql, const char *text,
                                const qm_sqlite_table *table, void *out)
{
    sqlite3_stmt *statement = qm_sqlite_begin(store, sql);
    if (statement) qm_sqlite_bind_text(statement, 1, text);
    return qm_sqlite_find_row(store, statement, table, out);
}

qm_stored qm_sqlite_change_row(qm_store *store, sqlite3_stmt *statement)
{
    int step = sqlite3_step(statement);
    bool is_found = step == SQLITE_ROW;
    if (is_found) step = sqlite3_step(statement);
    qm_sqlite_end(store, statement);
    if (step != SQLITE_DONE) return QM_STORED_FAULT;
    return is_found ? QM_STORED : QM_STORED_NONE;
}

/** Prepares the query for a page; NULL after a fault. */
static sqlite3_stmt *prepare_page(qm_store *store, const qm_sqlite_listing *listing,
                                  const qm_store_page *page)
{
    qm_text sql = {0};
    const char *order = page->newest_first ? "DESC" : "ASC";
    /* From the last one down, when no row came before. */
    int64_t after = page->newest_first && page->after == 0 ? INT64_MAX : page->after;
    qm_text_printf(&sql, "%s WHERE %s %c ?", listing->select, listing->sequence,
                   page->newest_first ? '<' : '>');
    for (int i = 0; i < QM_STORE_CONDITIONS; i++)
        if (listing->values[i]) qm_text_printf(&sql, " AND %s", listing->conditions[i]);
    qm_text_printf(&sql, " ORDER BY %s %s LIMIT %zu", listing->sequence, order, page->limit);
    char *text = qm_text_take(&sql);
    sqlite3_stmt *statement = NULL;
    if (text && sqlite3_prepare_v2(store->sqlite->database, text, -1, &statement, NULL) == SQLITE_OK) {
        int index = 1;
        sqlite3_bind_int64(statement, index++, after);
        for (int i = 0; i < QM_STORE_CONDITIONS; i++)
            if (listing->values[i]) qm_sqlite_bind_text(statement, index++, listing->values[i]);
    }
    free(text);
    return statement;
}

qm_stored qm_sqlite_list_rows(qm_store *store, const qm_sqlite_listing *listing, const qm_store_page *page,
                              const qm_sqlite_table *table, void *out, size_t *count)
{
    *count = 0;
    pthread_mutex_lock(&store->sqlite->lock);
    sqlite3_stmt *statement = prepare_page(store, listing, page);
    int result = SQLITE_DONE;
    qm_stored status = statement ? QM_STORED : status_of(store);
    while (status == QM_STORED && *count < page->limit && (result = sqlite3_step(statement)) == SQLITE_ROW) {
        status = table->read(statement, (char *)out + *count * table->size) ? QM_STORED : QM_STORED_NO_MEMORY;
        if (status == QM_STORED) ++*count;
    }
    if (status == QM_STORED && result != SQLITE_ROW && result != SQLITE_DONE) status = status_of(store);
    if (status != QM_STORED) {
        qm_log(QM_LOG_ERROR, "database: rows cannot be read: %s", sqlite3_errmsg(store->sqlite->database));
        while (*count > 0)
            table->reset((char *)out + --*count * table->size);
    }
    QM_ASSERT(*count <= page->limit);
    sqlite3_finalize(statement);
    pthread_mutex_unlock(&store->sqlite->lock);
    return status;
}

qm_stored qm_sqlite_delete_row(qm_store *store, const char *sql, const char *id)
{
    sqlite3_stmt *statement = qm_sqlite_begin(store, sql);
    if (!statement) return QM_STORED_NO_MEMORY;
    qm_sqlite_bind_text(statement, 1, id);
    int result = sqlite3_step(statement);
    bool deleted = result == SQLITE_DONE && sqlite3_changes(store->sqlite->database) > 0;
    if (result != SQLITE_DONE) qm_log(QM_LOG_ERROR, "database: %s", sqlite3_errmsg(store->sqlite->database));
    qm_stored status = deleted ? QM_STORED : result == SQLITE_DONE ? QM_STORED_NONE : status_of(store);
    qm_sqlite_end(store, statement);
    return status;
}

static bool fail_to_read(void)
{
    qm_log(QM_LOG_ERROR, "database: there is no memory for a row");
    return false;
}

bool qm_sqlite_copy_text(sqlite3_stmt *statement, int column, char **out)
{
    *out = NULL;
    if (sqlite3_column_type(statement, column) == SQLITE_NULL) return true;
    const char *text = (const char *)sqlite3_column_text(statement, column);
    if (text) *out = strdup(text);
    return *out || fail_to_read();
}

bool qm_sqlite_read_text(sqlite3_stmt *statement, int column, char *out, size_t size)
{
    const char *text = (const char *)sqlite3_column_text(statement, column);
    if (!text) return fail_to_read();
    snprintf(out, size, "%s", text);
    return true;
}

void qm_sqlite_bind_text(sqlite3_stmt *statement, int index, const char *text)
{
    QM_ASSERT(statement && index > 0);
    sqlite3_bind_text(statement, index, text, -1, SQLITE_STATIC);
}

static bool read_record(sqlite3_stmt *statement, void *row)
{
    qm_store_idempotency_record *out = row;
    return qm_sqlite_read_text(statement, 0, out->id, sizeof out->id) &&
           qm_sqlite_read_text(statement, 1, out->request, sizeof out->request);
}

static const qm_sqlite_table record_table = {sizeof(qm_store_idempotency_record), read_record, NULL};

qm_stored qm_sqlite_find_idempotency_record(qm_store *store, const char *sql, const char *key,
                                            qm_store_idempotency_record *out)
{
    return qm_sqlite_find_row_by(store, sql, key, &record_table, out);
}
