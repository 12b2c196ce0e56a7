/**
 * store_sqlite.c: the database of the store. WAL with full synchronisation: a commit that has returned is on
 * disk.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "log.h"
#include "store_internal.h"

#define BUSY_TIMEOUT_MS 5000
#define SCHEMA_VERSION "2"

static const char schema[] =
    "PRAGMA journal_mode = WAL;"
    "PRAGMA synchronous = FULL;"
    "PRAGMA foreign_keys = ON;"
    "CREATE TABLE IF NOT EXISTS meshes ("
    "  sequence INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, hash TEXT NOT NULL,"
    "  options TEXT NOT NULL, name TEXT NOT NULL, document TEXT NOT NULL, format INTEGER NOT NULL);"
    "CREATE INDEX IF NOT EXISTS meshes_by_content ON meshes (hash, options);"
    "CREATE TABLE IF NOT EXISTS jobs ("
    "  sequence INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, key TEXT NOT NULL,"
    "  idempotency_key TEXT UNIQUE, body TEXT NOT NULL, created TEXT NOT NULL, document TEXT, events TEXT,"
    "  state INTEGER NOT NULL);"
    "CREATE INDEX IF NOT EXISTS jobs_by_key ON jobs (key, state);"
    "CREATE INDEX IF NOT EXISTS jobs_unfinished ON jobs (sequence) WHERE document IS NULL;"
    "PRAGMA user_version = " SCHEMA_VERSION ";";

/** A new database tells 0. */
static bool has_known_schema(sqlite3 *database)
{
    sqlite3_stmt *statement = NULL;
    bool known = sqlite3_prepare_v2(database, "PRAGMA user_version", -1, &statement, NULL) == SQLITE_OK &&
                 sqlite3_step(statement) == SQLITE_ROW;
    int version = known ? sqlite3_column_int(statement, 0) : 0;
    sqlite3_finalize(statement);
    return version == 0 || version == atoi(SCHEMA_VERSION);
}

static qm_status open_database(qm_store *store, char message[QM_MESSAGE_SIZE])
{
    char path[4096];
    snprintf(path, sizeof path, "%s/quadmeshd.sqlite", store->folder);
    int result = sqlite3_open_v2(path, &store->database,
                                 SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX, NULL);
    if (result == SQLITE_OK) {
        sqlite3_busy_timeout(store->database, BUSY_TIMEOUT_MS);
        if (!has_known_schema(store->database)) {
            snprintf(message, QM_MESSAGE_SIZE, "database: written by another version of quadmeshd");
            return QM_E_UNSUPPORTED;
        }
        result = sqlite3_exec(store->database, schema, NULL, NULL, NULL);
    }
    if (result == SQLITE_OK) return QM_OK;
    snprintf(message, QM_MESSAGE_SIZE, "database: %s", sqlite3_errmsg(store->database));
    return QM_E_ARGUMENT;
}

static qm_status lock_folder(qm_store *store, char message[QM_MESSAGE_SIZE])
{
    char path[4096];
    snprintf(path, sizeof path, "%s/lock", store->folder);
    store->lock_file = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (store->lock_file >= 0 && flock(store->lock_file, LOCK_EX | LOCK_NB) == 0) return QM_OK;
    snprintf(message, QM_MESSAGE_SIZE,
             errno == EWOULDBLOCK ? "another process uses the folder" : "cannot lock: %s", strerror(errno));
    return QM_E_ARGUMENT;
}

qm_status qm_store_open(const char *folder, qm_store **out, char message[QM_MESSAGE_SIZE])
{
    *out = NULL;
    if (!qm_blob_prepare(folder, message)) return QM_E_ARGUMENT;
    qm_store *store = calloc(1, sizeof *store);
    if (!store) return QM_E_NO_MEMORY;
    store->lock_file = -1;
    store->folder = strdup(folder);
    pthread_mutex_init(&store->lock, NULL);
    qm_status status = store->folder ? lock_folder(store, message) : QM_E_NO_MEMORY;
    if (status == QM_OK) status = open_database(store, message);
    if (status == QM_OK)
        *out = store;
    else
        qm_store_close(store);
    return status;
}

void qm_store_close(qm_store *store)
{
    if (!store) return;
    sqlite3_close(store->database);
    if (store->lock_file >= 0) close(store->lock_file);
    pthread_mutex_destroy(&store->lock);
    free(store->folder);
    free(store);
}

sqlite3_stmt *qm_store_begin(qm_store *store, const char *sql)
{
    sqlite3_stmt *statement = NULL;
    pthread_mutex_lock(&store->lock);
    if (sqlite3_prepare_v2(store->database, sql, -1, &statement, NULL) == SQLITE_OK) return statement;
    qm_log(QM_LOG_ERROR, "database: %s", sqlite3_errmsg(store->database));
    pthread_mutex_unlock(&store->lock);
    return NULL;
}

void qm_store_end(qm_store *store, sqlite3_stmt *statement)
{
    sqlite3_finalize(statement);
    pthread_mutex_unlock(&store->lock);
}

qm_status qm_store_execute(qm_store *store, sqlite3_stmt *statement)
{
    int result = sqlite3_step(statement);
    if (result != SQLITE_DONE) qm_log(QM_LOG_ERROR, "database: %s", sqlite3_errmsg(store->database));
    qm_store_end(store, statement);
    return result == SQLITE_DONE ? QM_OK : QM_E_ARGUMENT;
}

char *qm_store_column_text(sqlite3_stmt *statement, int column)
{
    const char *text = (const char *)sqlite3_column_text(statement, column);
    return text ? strdup(text) : NULL;
}

void qm_store_bind_text(sqlite3_stmt *statement, int place, const char *text)
{
    sqlite3_bind_text(statement, place, text, -1, SQLITE_STATIC);
}
