/**
 * store_sqlite_check.c: compares all that is stored with its hashes and checksums, and repairs what can be.
 *
 * The database is asked whether its pages, rows and indices agree; one where they do not is made anew of its
 * rows (store_sqlite_salvage.c). The row of a mesh whose file is damaged
 * stays: an upload of the same bytes repairs it. A job whose array is damaged answers no later request, so that
 * an equal one is computed again.
 */
#include <stdlib.h>
#include <string.h>

#include "result_file.h"
#include "store_sqlite.h"

typedef struct check {
    qm_store *store;
    bool repairs;
    FILE *out;
    qm_store_findings found;
} check;

static void tell(check *work, bool is_repaired, const char *what, const char *id, const char *state)
{
    work->found.faults++;
    work->found.repaired += is_repaired;
    fprintf(work->out, "%s %s %s%s\n", what, id, state, is_repaired ? ": repaired" : "");
}

/** What the database says of itself; true when it finds nothing. */
static bool check_database(check *work, const char *pragma)
{
    sqlite3_stmt *statement = qm_sqlite_begin(work->store, pragma);
    bool good = statement;
    int result = SQLITE_DONE;
    while (statement && (result = sqlite3_step(statement)) == SQLITE_ROW) {
        const char *line = (const char *)sqlite3_column_text(statement, 0);
        if (line && strcmp(line, "ok") == 0) continue;
        tell(work, false, "database:", line ? line : "a row", "");
        good = false;
    }
    if (!statement || result != SQLITE_DONE) {
        tell(work, false, "database:", sqlite3_errmsg(work->store->sqlite->database), "");
        good = false;
    }
    if (statement) qm_sqlite_end(work->store, statement);
    return good;
}

static void check_blob(check *work, const char *mesh, const char *hash)
{
    qm_status status = hash[0] ? qm_blob_check(work->store, hash) : QM_OK;
    work->found.files += hash[0] != '\0';
    if (status == QM_OK) return;
    char what[QM_HASH_SIZE + 64];
    snprintf(what, sizeof what, "mesh %s: file %s", mesh, hash);
    tell(work, false, what, "is", status == QM_E_EMPTY ? "missing" : "damaged");
}

static void check_meshes(check *work)
{
    qm_store_mesh row;
    size_t count;
    qm_stored stored;
    qm_store_page page = {.limit = 1};
    const qm_store_mesh_filter all = {0};
    while ((stored = qm_store_list_meshes(work->store, &page, &all, &row, &count)) == QM_STORED &&
           count > 0) {
        page.after = row.sequence;
        work->found.meshes++;
        check_blob(work, row.id, row.hash);
        check_blob(work, row.id, row.positions);
        qm_store_mesh_reset(&row);
    }
    if (stored != QM_STORED) tell(work, false, "meshes", "cannot", "be read");
}

static qm_status read_array(qm_store *store, const char *job)
{
    double block[QM_RESULT_BLOCK];
    qm_result_file *file;
    qm_status status = qm_result_file_open(store, job, &file);
    uint64_t count = status == QM_OK ? qm_result_file_count(file) : 0;
    for (uint64_t done = 0; status == QM_OK && done < count; done += QM_RESULT_BLOCK) {
        uint64_t rest = count - done;
        status =
            qm_result_file_read(file, done, block, rest < QM_RESULT_BLOCK ? (size_t)rest : QM_RESULT_BLOCK);
    }
    qm_result_file_close(file);
    return status;
}

static void check_arrays(check *work)
{
    qm_store_job row;
    size_t count;
    qm_stored stored;
    qm_store_page page = {.limit = 1};
    const qm_store_job_filter all = {0};
    while ((stored = qm_store_list_jobs(work->store, &page, &all, &row, &count)) == QM_STORED && count > 0) {
        page.after = row.sequence;
        work->found.jobs++;
        qm_status status = row.document ? read_array(work->store, row.id) : QM_E_EMPTY;
        if (status != QM_OK && status != QM_E_EMPTY) {
            bool repaired = work->repairs && qm_store_forget_answer(work->store, row.id) == QM_STORED;
            tell(work, repaired, "job", row.id, "has a damaged array");
        }
        qm_store_job_reset(&row);
    }
    if (stored != QM_STORED) tell(work, false, "jobs", "cannot", "be read");
}

static void count_orphan(void *user, const char *hash)
{
    check *work = user;
    fprintf(work->out, "file %s belongs to no mesh\n", hash);
    work->found.orphans++;
}

qm_status qm_store_check(const char *folder, bool repairs, FILE *out, qm_store_findings *found,
                         char message[QM_MESSAGE_SIZE])
{
    check work = {.repairs = repairs, .out = out};
    qm_status status = qm_store_open(folder, QM_STORE_CHECK, &work.store, message);
    if (status == QM_OK) {
        bool is_good = check_database(&work, "PRAGMA integrity_check") &&
                       check_database(&work, "PRAGMA foreign_key_check");
        if (!is_good && repairs && qm_sqlite_salvage(work.store, out))
            work.found.repaired = work.found.faults;
        check_meshes(&work);
        check_arrays(&work);
        qm_blob_each_orphan(work.store, count_orphan, &work);
    }
    *found = work.found;
    qm_store_close(work.store);
    return status;
}
