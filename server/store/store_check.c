/**
 * store_check.c: compares the rows of any store with its files, and a shared store as a whole.
 */
#include "store_check.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "result_file.h"
#include "store_driver.h"

#define CACHE 1073741824u /* bytes of blobs that a check of a shared store keeps on disk */
#define ORPHANS 64        /* that are asked for at once */

void qm_store_check_tell(qm_store_checking *work, bool is_repaired, const char *what, const char *id,
                         const char *state)
{
    work->found.faults++;
    work->found.repaired += is_repaired;
    fprintf(work->out, "%s %s %s%s\n", what, id, state, is_repaired ? ": repaired" : "");
}

/** A shared store copies what it checks to its folder. */
static void trim(qm_store *store)
{
    if (qm_store_is_shared(store)) qm_blob_trim_cache(store, CACHE);
}

static void check_blob(qm_store_checking *work, const char *mesh, const char *hash)
{
    qm_status status = hash[0] ? qm_blob_check(work->store, hash) : QM_OK;
    work->found.files += hash[0] != '\0';
    if (status == QM_OK) return;
    char what[QM_HASH_SIZE + 64];
    snprintf(what, sizeof what, "mesh %s: file %s", mesh, hash);
    qm_store_check_tell(work, false, what, "is", status == QM_E_EMPTY ? "missing" : "damaged");
}

static void check_meshes(qm_store_checking *work)
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
        trim(work->store);
    }
    if (stored != QM_STORED) qm_store_check_tell(work, false, "meshes", "cannot", "be read");
}

static qm_status check_array(qm_store *store, const char *job)
{
    qm_result_file *file;
    qm_status status = qm_result_file_open(store, job, &file);
    if (status == QM_OK) status = qm_result_file_check(file);
    qm_result_file_close(file);
    return status;
}

static void check_arrays(qm_store_checking *work)
{
    qm_store_job row;
    size_t count;
    qm_stored stored;
    qm_store_page page = {.limit = 1};
    const qm_store_job_filter all = {0};
    while ((stored = qm_store_list_jobs(work->store, &page, &all, &row, &count)) == QM_STORED && count > 0) {
        page.after = row.sequence;
        work->found.jobs++;
        qm_status status = row.document ? check_array(work->store, row.id) : QM_E_EMPTY;
        if (status != QM_OK && status != QM_E_EMPTY) {
            bool repaired = work->repairs && qm_store_forget_answer(work->store, row.id) == QM_STORED;
            qm_store_check_tell(work, repaired, "job", row.id, "has a damaged array");
        }
        qm_store_job_reset(&row);
        trim(work->store);
    }
    if (stored != QM_STORED) qm_store_check_tell(work, false, "jobs", "cannot", "be read");
}

void qm_store_check_rows(qm_store_checking *work)
{
    check_meshes(work);
    check_arrays(work);
}

/** The blobs of a shared store that no row names are removed after a day: none of them is missed when it is damaged, but
 * an upload may take one up before. */
static void check_orphans(qm_store_checking *work)
{
    char hashes[ORPHANS][QM_HASH_SIZE], after[QM_HASH_SIZE] = "";
    qm_stored stored = QM_STORED;
    for (size_t count = ORPHANS; stored == QM_STORED && count == ORPHANS;) {
        stored = work->store->driver->list_orphans(work->store, after, ORPHANS, hashes, &count);
        for (size_t i = 0; i < count; i++) {
            memcpy(after, hashes[i], sizeof after);
            work->found.orphans++;
            if (qm_blob_check(work->store, hashes[i]) != QM_OK)
                qm_store_check_tell(work, false, "file", hashes[i], "is damaged");
            trim(work->store);
        }
    }
    if (stored != QM_STORED) qm_store_check_tell(work, false, "files", "cannot", "be listed");
}

qm_stored qm_store_check_shared(const char *address, const qm_store_node *self, FILE *out,
                                qm_store_findings *found, char message[QM_MESSAGE_SIZE])
{
    const char *parent = getenv("TMPDIR");
    char folder[QM_STORE_FOLDER_SIZE];
    qm_store_checking work = {.out = out};
    *found = work.found;
    int length =
        snprintf(folder, sizeof folder, "%s/quadmeshd-XXXXXX", parent && parent[0] ? parent : "/tmp");
    if (length >= (int)sizeof folder || !mkdtemp(folder)) {
        snprintf(message, QM_MESSAGE_SIZE, "cannot make %.200s: %s", folder, strerror(errno));
        return QM_STORED_FAULT;
    }
    qm_stored stored = qm_store_visit_to_read(address, self, folder, &work.store, message);
    if (stored == QM_STORED) {
        qm_store_check_rows(&work);
        check_orphans(&work);
    }
    *found = work.found;
    qm_store_close(work.store);
    qm_store_remove_folder(folder);
    return stored;
}
