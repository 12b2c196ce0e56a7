/**
 * store_sqlite.c: the database of the store. A write-ahead log with full synchronisation: a commit that has
 * returned is on disk.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

#include "store_internal.h"

#define BUSY_TIMEOUT_MS 5000
#define SCHEMA_VERSION "6"

static const char schema[] =
    "PRAGMA synchronous = FULL;"
    "PRAGMA foreign_keys = ON;"
    "CREATE TABLE IF NOT EXISTS meshes ("
    "  sequence INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, hash TEXT NOT NULL,"
    "  options TEXT NOT NULL, name TEXT NOT NULL, document TEXT NOT NULL, format INTEGER NOT NULL,"
    "  revision INTEGER NOT NULL, positions TEXT NOT NULL, created TEXT NOT NULL);"
    "CREATE INDEX IF NOT EXISTS meshes_by_content ON meshes (hash, options);"
    "CREATE INDEX IF NOT EXISTS meshes_by_positions ON meshes (positions);"
    "CREATE TABLE IF NOT EXISTS jobs ("
    "  sequence INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, key TEXT NOT NULL,"
    "  idempotency_key TEXT UNIQUE, body TEXT NOT NULL, created TEXT NOT NULL, document TEXT,"
    "  state INTEGER NOT NULL, revisions TEXT NOT NULL, restarts INTEGER NOT NULL DEFAULT 0);"
    "CREATE INDEX IF NOT EXISTS jobs_by_key ON jobs (key, revisions, state);"
    "CREATE INDEX IF NOT EXISTS jobs_unfinished ON jobs (sequence) WHERE document IS NULL;"
    "CREATE TABLE IF NOT EXISTS job_events ("
    "  job INTEGER NOT NULL REFERENCES jobs (sequence) ON DELETE CASCADE, seq INTEGER NOT NULL,"
    "  lines TEXT NOT NULL, PRIMARY KEY (job, seq)) WITHOUT ROWID;"
    "CREATE TABLE IF NOT EXISTS layouts ("
    "  sequence INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, mesh TEXT NOT NULL,"
    "  created TEXT NOT NULL, revision INTEGER NOT NULL, idempotency_key TEXT UNIQUE, request TEXT NOT NULL);"
    "CREATE TABLE IF NOT EXISTS layout_revisions ("
    "  id TEXT NOT NULL REFERENCES layouts (id) ON DELETE CASCADE, revision INTEGER NOT NULL,"
    "  layout TEXT NOT NULL, issues TEXT NOT NULL, next_curve INTEGER NOT NULL, PRIMARY KEY (id, revision));"
    "CREATE TABLE IF NOT EXISTS reconstructions ("
    "  sequence INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, source TEXT NOT NULL,"
    "  layout_id TEXT NOT NULL, mesh TEXT NOT NULL, layout TEXT NOT NULL, document TEXT NOT NULL,"
    "  steps TEXT NOT NULL, records TEXT NOT NULL, state TEXT NOT NULL, revision INTEGER NOT NULL,"
    "  cover_share REAL NOT NULL, pull_curves INTEGER NOT NULL, idempotency_key TEXT UNIQUE,"
    "  request TEXT NOT NULL);"
    "PRAGMA user_version = " SCHEMA_VERSION ";";

/** What a pragma answers, in out; false, and "" in out, after a fault. */
static bool ask(sqlite3 *database, const char *pragma, char out[16])
{
    sqlite3_stmt *statement = NULL;
    bool answered = sqlite3_prepare_v2(database, pragma, -1, &statement, NULL) == SQLITE_OK &&
                    sqlite3_step(statement) == SQLITE_ROW;
    const char *answer = answered ? (const char *)sqlite3_column_text(statement, 0) : NULL;
    snprintf(out, 16, "%s", answer ? answer : "");
    sqlite3_finalize(statement);
    return answer != NULL;
}

static qm_status fail_to_open(sqlite3 *database, char message[QM_MESSAGE_SIZE])
{
    snprintf(message, QM_MESSAGE_SIZE, "database: %s", sqlite3_errmsg(database));
    return QM_E_ARGUMENT;
}

/** The version is looked at first: a database of another one is left as it is. */
static qm_status set_up(sqlite3 *database, char message[QM_MESSAGE_SIZE])
{
    char version[16], mode[16];
    if (!ask(database, "PRAGMA user_version", version)) return fail_to_open(database, message);
    if (strcmp(version, "0") != 0 && strcmp(version, SCHEMA_VERSION) != 0) {
        snprintf(message, QM_MESSAGE_SIZE, "database: written by another version of quadmeshd");
        return QM_E_UNSUPPORTED;
    }
    if (!ask(database, "PRAGMA journal_mode = WAL", mode)) return fail_to_open(database, message);
    if (strcmp(mode, "wal") != 0) {
        snprintf(message, QM_MESSAGE_SIZE, "database: the file system does not allow a write-ahead log");
        return QM_E_UNSUPPORTED;
    }
    bool made = sqlite3_exec(database, schema, NULL, NULL, NULL) == SQLITE_OK;
    return made ? QM_OK : fail_to_open(database, message);
}

static qm_status open_database(qm_store *store, char message[QM_MESSAGE_SIZE])
{
    char path[QM_STORE_PATH_SIZE];
    snprintf(path, sizeof path, "%s/quadmeshd.sqlite", store->folder);
    int result = sqlite3_open_v2(path, &store->database,
                                 SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX, NULL);
    if (result != SQLITE_OK) return fail_to_open(store->database, message);
    sqlite3_busy_timeout(store->database, BUSY_TIMEOUT_MS);
    return set_up(store->database, message);
}

static qm_status lock_folder(qm_store *store, char message[QM_MESSAGE_SIZE])
{
    char path[QM_STORE_PATH_SIZE];
    snprintf(path, sizeof path, "%s/lock", store->folder);
    store->lock_file = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (store->lock_file >= 0 && flock(store->lock_file, LOCK_EX | LOCK_NB) == 0) return QM_OK;
    snprintf(message, QM_MESSAGE_SIZE,
             errno == EWOULDBLOCK ? "another process uses the folder" : "cannot lock: %s", strerror(errno));
    return QM_E_ARGUMENT;
}

/** Takes the folder over: nothing in it is touched before the lock is held. */
static qm_status take_folder(qm_store *store, char message[QM_MESSAGE_SIZE])
{
    if (!qm_blob_make_folders(store->folder, message)) return QM_E_ARGUMENT;
    qm_status status = lock_folder(store, message);
    if (status != QM_OK) return status;
    qm_blob_sweep(store->folder);
    status = open_database(store, message);
    if (status == QM_OK) qm_blob_sweep_orphans(store);
    return status;
}

/** A store with a folder that nobody looked at yet; NULL: out of memory. */
static qm_store *create(const char *folder)
{
    qm_store *store = calloc(1, sizeof *store);
    if (!store) return NULL;
    store->lock_file = -1;
    pthread_mutex_init(&store->lock, NULL);
    size_t length = strlen(folder);
    while (length > 1 && folder[length - 1] == '/')
        length--;
    store->folder = strndup(folder, length);
    if (store->folder) return store;
    qm_store_close(store);
    return NULL;
}

qm_status qm_store_open(const char *folder, qm_store **out, char message[QM_MESSAGE_SIZE])
{
    *out = NULL;
    if (strlen(folder) >= QM_STORE_FOLDER_SIZE) {
        snprintf(message, QM_MESSAGE_SIZE, "the name of the folder is too long");
        return QM_E_ARGUMENT;
    }
    qm_store *store = create(folder);
    if (!store) {
        snprintf(message, QM_MESSAGE_SIZE, "%s", qm_status_text(QM_E_NO_MEMORY));
        return QM_E_NO_MEMORY;
    }
    qm_status status = take_folder(store, message);
    if (status == QM_OK)
        *out = store;
    else
        qm_store_close(store);
    return status;
}

const char *qm_store_folder(const qm_store *store)
{
    return store->folder;
}

void qm_store_close(qm_store *store)
{
    if (!store) return;
    for (size_t i = 0; i < store->statement_count; i++)
        sqlite3_finalize(store->statements[i].prepared);
    sqlite3_close(store->database);
    if (store->lock_file >= 0) close(store->lock_file);
    pthread_mutex_destroy(&store->lock);
    free(store->folder);
    free(store);
}
