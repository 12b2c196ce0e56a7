/**
 * store_sqlite_check.c: compares all that is stored with its hashes and checksums, and repairs what can be.
 *
 * The database is asked whether its pages, rows and indices agree; one where they do not is made anew of its
 * rows (store_sqlite_salvage.c). The row of a mesh whose file is damaged
 * stays: an upload of the same bytes repairs it. A job whose array is damaged answers no later request, so that
 * an equal one is computed again.
 */
#include <string.h>

#include "store_check.h"
#include "store_sqlite.h"

/** What the database says of itself; true when it finds nothing. */
static bool check_database(qm_store_checking *work, const char *pragma)
{
    sqlite3_stmt *statement = qm_sqlite_begin(work->store, pragma);
    bool good = statement;
    int result = SQLITE_DONE;
    while (statement && (result = sqlite3_step(statement)) == SQLITE_ROW) {
        const char *line = (const char *)sqlite3_column_text(statement, 0);
        if (line && strcmp(line, "ok") == 0) continue;
        qm_store_check_tell(work, false, "database:", line ? line : "a row", "");
        good = false;
    }
    if (!statement || result != SQLITE_DONE) {
        qm_store_check_tell(work, false, "database:", sqlite3_errmsg(work->store->sqlite->database), "");
        good = false;
    }
    if (statement) qm_sqlite_end(work->store, statement);
    return good;
}

static void count_orphan(void *user, const char *hash)
{
    qm_store_checking *work = user;
    fprintf(work->out, "file %s belongs to no mesh\n", hash);
    work->found.orphans++;
}

qm_status qm_store_check(const char *folder, bool repairs, FILE *out, qm_store_findings *found,
                         char message[QM_MESSAGE_SIZE])
{
    qm_store_checking work = {.repairs = repairs, .out = out};
    qm_status status = qm_store_open(folder, QM_STORE_CHECK, &work.store, message);
    if (status == QM_OK) {
        bool is_good = check_database(&work, "PRAGMA integrity_check") &&
                       check_database(&work, "PRAGMA foreign_key_check");
        if (!is_good && repairs && qm_sqlite_salvage(work.store, out))
            work.found.repaired = work.found.faults;
        qm_store_check_rows(&work);
        qm_blob_each_orphan(work.store, count_orphan, &work);
    }
    *found = work.found;
    qm_store_close(work.store);
    return status;
}
