/**
 * store_statement.c: statements of the database, alone or in a transaction, and how their rows are read.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "store_internal.h"

/** Prepared once, which takes longer than running it. There are fewer statements in the code than places. */
sqlite3_stmt *qm_store_prepare(qm_store *store, const char *sql)
{
    for (size_t i = 0; i < store->statement_count; i++)
        if (store->statements[i].sql == sql) return store->statements[i].prepared;
    if (store->statement_count == QM_STORE_STATEMENTS) abort();
    sqlite3_stmt *statement = NULL;
    if (sqlite3_prepare_v2(store->database, sql, -1, &statement, NULL) == SQLITE_OK)
        store->statements[store->statement_count++] = (qm_store_statement){sql, statement};
    else
        qm_log(QM_LOG_ERROR, "database: %s", sqlite3_errmsg(store->database));
    return statement;
}

sqlite3_stmt *qm_store_begin(qm_store *store, const char *sql)
{
    pthread_mutex_lock(&store->lock);
    sqlite3_stmt *statement = qm_store_prepare(store, sql);
    if (!statement) pthread_mutex_unlock(&store->lock);
    return statement;
}

static void put_back(sqlite3_stmt *statement)
{
    sqlite3_reset(statement);
    sqlite3_clear_bindings(statement);
}

void qm_store_end(qm_store *store, sqlite3_stmt *statement)
{
    put_back(statement);
    pthread_mutex_unlock(&store->lock);
}

bool qm_store_run(qm_store *store, sqlite3_stmt *statement)
{
    if (!statement) return false;
    int result = sqlite3_step(statement);
    if (result != SQLITE_DONE) qm_log(QM_LOG_ERROR, "database: %s", sqlite3_errmsg(store->database));
    put_back(statement);
    return result == SQLITE_DONE;
}

static const char begin[] = "BEGIN IMMEDIATE", commit[] = "COMMIT", rollback[] = "ROLLBACK";

/** What ends the transaction is prepared first, so that it does not lack the memory then. */
bool qm_store_begin_transaction(qm_store *store)
{
    pthread_mutex_lock(&store->lock);
    if (qm_store_prepare(store, commit) && qm_store_prepare(store, rollback) &&
        qm_store_run(store, qm_store_prepare(store, begin)))
        return true;
    pthread_mutex_unlock(&store->lock);
    return false;
}

bool qm_store_end_transaction(qm_store *store, bool good)
{
    good = good && qm_store_run(store, qm_store_prepare(store, commit));
    /* Some faults have rolled it back already. */
    if (!good && !sqlite3_get_autocommit(store->database))
        qm_store_run(store, qm_store_prepare(store, rollback));
    pthread_mutex_unlock(&store->lock);
    return good;
}

bool qm_store_step(qm_store *store, sqlite3_stmt *statement)
{
    int result = sqlite3_step(statement);
    if (result != SQLITE_ROW && result != SQLITE_DONE)
        qm_log(QM_LOG_ERROR, "database: %s", sqlite3_errmsg(store->database));
    return result == SQLITE_ROW;
}

qm_status qm_store_execute(qm_store *store, sqlite3_stmt *statement)
{
    bool done = qm_store_run(store, statement);
    pthread_mutex_unlock(&store->lock);
    return done ? QM_OK : QM_E_ARGUMENT;
}

static qm_status status_of(int result)
{
    return result == SQLITE_NOMEM ? QM_E_NO_MEMORY : QM_E_ARGUMENT;
}

qm_status qm_store_find_row(qm_store *store, sqlite3_stmt *statement, const qm_store_table *table, void *out)
{
    if (!statement) return QM_E_NO_MEMORY;
    int result = sqlite3_step(statement);
    qm_status status = QM_E_EMPTY;
    if (result == SQLITE_ROW)
        status = table->read(statement, out) ? QM_OK : QM_E_NO_MEMORY;
    else if (result != SQLITE_DONE)
        status = status_of(result);
    if (status != QM_OK && status != QM_E_EMPTY)
        qm_log(QM_LOG_ERROR, "database: a row cannot be read: %s", sqlite3_errmsg(store->database));
    qm_store_end(store, statement);
    return status;
}

qm_status qm_store_find_row_by(qm_store *store, const char *sql, const char *text,
                               const qm_store_table *table, void *out)
{
    sqlite3_stmt *statement = qm_store_begin(store, sql);
    if (statement) qm_store_bind_text(statement, 1, text);
    return qm_store_find_row(store, statement, table, out);
}

qm_status qm_store_list_rows(qm_store *store, const char *sql, int64_t after, size_t limit,
                             const qm_store_table *table, void *out, size_t *count)
{
    *count = 0;
    sqlite3_stmt *statement = qm_store_begin(store, sql);
    if (!statement) return QM_E_NO_MEMORY;
    sqlite3_bind_int64(statement, 1, after);
    sqlite3_bind_int64(statement, 2, (sqlite3_int64)limit);
    int result = SQLITE_DONE;
    qm_status status = QM_OK;
    while (status == QM_OK && *count < limit && (result = sqlite3_step(statement)) == SQLITE_ROW) {
        status = table->read(statement, (char *)out + *count * table->size) ? QM_OK : QM_E_NO_MEMORY;
        if (status == QM_OK) ++*count;
    }
    if (status == QM_OK && result != SQLITE_ROW && result != SQLITE_DONE) status = status_of(result);
    if (status != QM_OK) {
        qm_log(QM_LOG_ERROR, "database: rows cannot be read: %s", sqlite3_errmsg(store->database));
        while (*count > 0)
            table->reset((char *)out + --*count * table->size);
    }
    qm_store_end(store, statement);
    return status;
}

qm_status qm_store_delete_row(qm_store *store, const char *sql, const char *id)
{
    sqlite3_stmt *statement = qm_store_begin(store, sql);
    if (!statement) return QM_E_NO_MEMORY;
    qm_store_bind_text(statement, 1, id);
    int result = sqlite3_step(statement);
    bool deleted = result == SQLITE_DONE && sqlite3_changes(store->database) > 0;
    if (result != SQLITE_DONE) qm_log(QM_LOG_ERROR, "database: %s", sqlite3_errmsg(store->database));
    qm_store_end(store, statement);
    return deleted ? QM_OK : result == SQLITE_DONE ? QM_E_EMPTY : status_of(result);
}

static bool fail_to_read(void)
{
    qm_log(QM_LOG_ERROR, "database: there is no memory for a row");
    return false;
}

bool qm_store_copy_text(sqlite3_stmt *statement, int column, char **out)
{
    *out = NULL;
    if (sqlite3_column_type(statement, column) == SQLITE_NULL) return true;
    const char *text = (const char *)sqlite3_column_text(statement, column);
    if (text) *out = strdup(text);
    return *out || fail_to_read();
}

bool qm_store_read_text(sqlite3_stmt *statement, int column, char *out, size_t size)
{
    const char *text = (const char *)sqlite3_column_text(statement, column);
    if (!text) return fail_to_read();
    snprintf(out, size, "%s", text);
    return true;
}

void qm_store_bind_text(sqlite3_stmt *statement, int place, const char *text)
{
    sqlite3_bind_text(statement, place, text, -1, SQLITE_STATIC);
}
