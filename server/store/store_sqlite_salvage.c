/**
 * store_sqlite_salvage.c: makes a database anew of the rows that can be read in a damaged one: each by its number, so
 * that one which cannot be read costs no other, and without the indices, which are made again. A page that leads
 * to others costs these.
 */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "store_sqlite.h"

#define UNKNOWN_LAST (1 << 18) /* row to end with when neither table nor counter can be read */

/** Two connections: a fault of reading would undo a transaction of the one on which it occurs. */
typedef struct salvage {
    sqlite3 *damaged, *database;
    size_t copied, failed;
} salvage;

/** The number, or text, that a query gives; false when it gives none. */
static bool ask_text(sqlite3 *database, const char *sql, const char *argument, char *out, size_t size)
{
    sqlite3_stmt *statement = NULL;
    bool given = sqlite3_prepare_v2(database, sql, -1, &statement, NULL) == SQLITE_OK &&
                 sqlite3_bind_text(statement, 1, argument, -1, SQLITE_STATIC) == SQLITE_OK &&
                 sqlite3_step(statement) == SQLITE_ROW && sqlite3_column_type(statement, 0) != SQLITE_NULL;
    if (given) snprintf(out, size, "%s", (const char *)sqlite3_column_text(statement, 0));
    sqlite3_finalize(statement);
    return given;
}

static int64_t find_last(sqlite3 *database, const char *table, const char *key)
{
    char sql[128], text[32];
    snprintf(sql, sizeof sql, "SELECT coalesce(max(%s), 0) FROM %s WHERE ?1 != ''", key, table);
    if (ask_text(database, sql, table, text, sizeof text)) return atoll(text);
    const char *counter = "SELECT seq FROM sqlite_sequence WHERE name = ?";
    return ask_text(database, counter, table, text, sizeof text) ? atoll(text) : UNKNOWN_LAST;
}

/** Copies the rows that a statement finds for one number. */
static void copy_rows(salvage *work, sqlite3_stmt *from, sqlite3_stmt *to, int64_t number)
{
    int result;
    sqlite3_bind_int64(from, 1, number);
    while ((result = sqlite3_step(from)) == SQLITE_ROW) {
        for (int i = 0; i < sqlite3_column_count(from); i++)
            sqlite3_bind_value(to, i + 1, sqlite3_column_value(from, i));
        sqlite3_step(to);
        work->copied += sqlite3_reset(to) == SQLITE_OK;
    }
    work->failed += result != SQLITE_DONE;
    sqlite3_reset(from);
}

/** Copies what has each number of a key. */
static bool copy_table(salvage *work, const char *table, const char *key)
{
    char columns[512], places[64] = "", sql[768];
    sqlite3_stmt *from = NULL, *to = NULL;
    const char *names = "SELECT group_concat(name, ', ') FROM pragma_table_info(?)";
    const char *marks = "SELECT group_concat('?') FROM pragma_table_info(?)";
    if (!ask_text(work->database, names, table, columns, sizeof columns) ||
        !ask_text(work->database, marks, table, places, sizeof places))
        return false;
    snprintf(sql, sizeof sql, "SELECT %s FROM %s NOT INDEXED WHERE %s = ?", columns, table, key);
    bool good = sqlite3_prepare_v2(work->damaged, sql, -1, &from, NULL) == SQLITE_OK;
    snprintf(sql, sizeof sql, "INSERT OR IGNORE INTO %s (%s) VALUES (%s)", table, columns, places);
    good = good && sqlite3_prepare_v2(work->database, sql, -1, &to, NULL) == SQLITE_OK;
    int64_t last = good ? find_last(work->damaged, table, key) : 0;
    for (int64_t number = 1; number <= last; number++)
        copy_rows(work, from, to, number);
    sqlite3_finalize(from);
    sqlite3_finalize(to);
    return good;
}

/** Removes what has lost the row that it belongs to. */
static const char clean[] =
    "DELETE FROM job_events WHERE job NOT IN (SELECT sequence FROM jobs);"
    "DELETE FROM job_arrays WHERE job NOT IN (SELECT sequence FROM jobs);"
    "DELETE FROM job_subjects WHERE job NOT IN (SELECT sequence FROM jobs);"
    "DELETE FROM layouts WHERE NOT EXISTS"
    "  (SELECT 1 FROM layout_revisions r WHERE r.id = layouts.id AND r.revision = layouts.revision);"
    "DELETE FROM layout_revisions WHERE id NOT IN (SELECT id FROM layouts);";

static bool copy_all(salvage *work, const char *path)
{
    static const char *const tables[][2] = {
        {"meshes", "rowid"},           {"jobs", "rowid"},
        {"layouts", "rowid"},          {"reconstructions", "rowid"},
        {"layout_revisions", "rowid"}, {"job_arrays", "rowid"},
        {"job_events", "job"},         {"job_subjects", "job"},
    };
    bool good = sqlite3_open_v2(path, &work->damaged, SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX,
                                QM_STORE_SUMS) == SQLITE_OK &&
                sqlite3_exec(work->database, "BEGIN", NULL, NULL, NULL) == SQLITE_OK;
    for (size_t i = 0; good && i < sizeof tables / sizeof *tables; i++)
        good = copy_table(work, tables[i][0], tables[i][1]);
    return good && sqlite3_exec(work->database, clean, NULL, NULL, NULL) == SQLITE_OK &&
           sqlite3_exec(work->database, "COMMIT", NULL, NULL, NULL) == SQLITE_OK;
}

/** Puts the new database in the place of the damaged one, which keeps another name. */
static bool replace(const qm_store *store, const char *path, const char *new_path)
{
    static const char *const endings[] = {"-wal", "-shm", ""};
    char from[QM_STORE_PATH_SIZE], to[QM_STORE_PATH_SIZE];
    for (size_t i = 0; i < sizeof endings / sizeof *endings; i++) {
        snprintf(from, sizeof from, "%s%s", path, endings[i]);
        snprintf(to, sizeof to, "%s/" QM_STORE_DATABASE ".damaged%s", store->folder, endings[i]);
        if (rename(from, to) != 0 && errno != ENOENT) return false;
    }
    return rename(new_path, path) == 0 && qm_blob_sync_folder(store->folder);
}

bool qm_sqlite_salvage(qm_store *store, FILE *out)
{
    char path[QM_STORE_PATH_SIZE], new_path[QM_STORE_PATH_SIZE], message[QM_MESSAGE_SIZE];
    snprintf(path, sizeof path, "%s/" QM_STORE_DATABASE, store->folder);
    snprintf(new_path, sizeof new_path, "%s/" QM_STORE_DATABASE ".new", store->folder);
    unlink(new_path);
    qm_sqlite_close_database(store);
    salvage work = {0};
    bool good = qm_sqlite_make_database(new_path, &work.database) && copy_all(&work, path);
    sqlite3_close(work.damaged);
    sqlite3_close(work.database);
    good = good && replace(store, path, new_path);
    if (good)
        fprintf(
            out,
            "database: made anew of %zu rows; %zu could not be looked for; the old one is " QM_STORE_DATABASE
            ".damaged\n",
            work.copied, work.failed);
    else
        unlink(new_path);
    return qm_sqlite_open_database(store, QM_STORE_CHECK, message) == QM_OK && good;
}
