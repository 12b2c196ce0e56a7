/**
 * store_postgres.c: opens a shared store.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "store_postgres.h"

static void close_database(qm_store *store)
{
    struct qm_postgres *postgres = store->postgres;
    if (!postgres) return;
    qm_postgres_unwatch(store);
    qm_place_close(postgres->place);
    qm_postgres_close_pool(store);
    pthread_mutex_destroy(&postgres->lock);
    free((char *)postgres->self.version);
    free(postgres->homes);
    free(postgres->claims);
    free(postgres);
    store->postgres = NULL;
}

const qm_store_driver qm_postgres_driver = {
    .close = close_database,
    .put_mesh = qm_postgres_put_mesh,
    .find_mesh = qm_postgres_find_mesh,
    .find_mesh_states = qm_postgres_find_mesh_states,
    .find_undeformed = qm_postgres_find_undeformed,
    .find_mesh_by_content = qm_postgres_find_mesh_by_content,
    .list_meshes = qm_postgres_list_meshes,
    .revise_mesh = qm_postgres_revise_mesh,
    .set_notes = qm_postgres_set_notes,
    .set_expiry = qm_postgres_set_expiry,
    .find_expired_mesh = qm_postgres_find_expired_mesh,
    .delete_mesh = qm_postgres_delete_mesh,
    .submit_job = qm_postgres_submit_job,
    .claim_jobs = qm_postgres_claim_jobs,
    .begin_job = qm_postgres_begin_job,
    .note_cancel = qm_postgres_note_cancel,
    .append_events = qm_postgres_append_events,
    .finish_job = qm_postgres_finish_job,
    .leave_jobs = qm_postgres_leave_jobs,
    .read_events = qm_postgres_read_events,
    .find_job = qm_postgres_find_job,
    .find_job_by_key = qm_postgres_find_job_by_key,
    .find_job_by_idempotency_key = qm_postgres_find_job_by_idempotency_key,
    .set_job_labels = qm_postgres_set_job_labels,
    .forget_answer = qm_postgres_forget_answer,
    .list_jobs = qm_postgres_list_jobs,
    .drop_old_jobs = qm_postgres_drop_old_jobs,
    .delete_job = qm_postgres_delete_job,
    .put_array = qm_postgres_put_array,
    .find_array = qm_postgres_find_array,
    .open_parts = qm_postgres_open_parts,
    .claim_parts = qm_postgres_claim_parts,
    .finish_parts = qm_postgres_finish_parts,
    .raise_lower = qm_postgres_raise_lower,
    .read_bounds = qm_postgres_read_bounds,
    .find_split_job = qm_postgres_find_split_job,
    .put_layout = qm_postgres_put_layout,
    .find_layout = qm_postgres_find_layout,
    .find_layout_by_idempotency_key = qm_postgres_find_layout_by_idempotency_key,
    .list_layouts = qm_postgres_list_layouts,
    .edit_layout = qm_postgres_edit_layout,
    .move_layout = qm_postgres_move_layout,
    .delete_layout = qm_postgres_delete_layout,
    .put_reconstruction = qm_postgres_put_reconstruction,
    .find_reconstruction = qm_postgres_find_reconstruction,
    .find_reconstruction_by_idempotency_key = qm_postgres_find_reconstruction_by_idempotency_key,
    .list_reconstructions = qm_postgres_list_reconstructions,
    .update_reconstruction = qm_postgres_update_reconstruction,
    .delete_reconstruction = qm_postgres_delete_reconstruction,
    .beat = qm_postgres_beat,
    .join = qm_postgres_join,
    .reap = qm_postgres_reap,
    .find_home = qm_postgres_find_home,
    .cancel_job = qm_postgres_cancel_job,
    .hold_job = qm_postgres_hold_job,
    .look_at_jobs = qm_postgres_look_at_jobs,
    .put_blob = qm_postgres_put_blob,
    .get_blob = qm_postgres_get_blob,
    .clean_blobs = qm_postgres_clean_blobs,
    .list_orphans = qm_postgres_list_orphans,
    .list_job_copies = qm_postgres_list_job_copies,
    .put_job_copy = qm_postgres_put_job_copy,
    .list_layout_revisions = qm_postgres_list_layout_revisions,
    .put_layout_copy = qm_postgres_put_layout_copy,
    .find_layout_origin = qm_postgres_find_layout_origin,
    .find_reconstruction_origin = qm_postgres_find_reconstruction_origin,
    .sync = qm_postgres_sync,
    .identify = qm_postgres_identify,
    .watch = qm_postgres_watch,
    .unwatch = qm_postgres_unwatch,
};

static bool create_postgres(qm_store *store, const qm_store_node *self)
{
    struct qm_postgres *postgres = calloc(1, sizeof *postgres);
    char *version = strdup(self->version);
    if (!postgres || !version) {
        free(postgres);
        free(version);
        return false;
    }
    postgres->self = *self;
    postgres->self.version = version;
    pthread_mutex_init(&postgres->lock, NULL);
    store->postgres = postgres;
    return true;
}

/** Only this process has the folder, but not the only copy of what is in it: nothing but half-written files is swept. */
static qm_stored take_folder(qm_store *store, char message[QM_MESSAGE_SIZE])
{
    if (!qm_blob_make_folders(store->folder, message)) return QM_STORED_FAULT;
    if (qm_store_lock_folder(store, message) != QM_OK) return QM_STORED_FAULT;
    qm_blob_sweep(store->folder);
    qm_space_count(store);
    return QM_STORED;
}

static qm_stored check_durability(qm_store *store, bool is_unsafe, char message[QM_MESSAGE_SIZE])
{
    qm_postgres_query query = {.sql = "SELECT " QM_POSTGRES_DURABILITY};
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    bool is_durable = status == QM_STORED && qm_postgres_integer(&rows, 0, 0) != QM_STORE_UNSAFE;
    qm_postgres_free(&rows);
    if (status != QM_STORED) snprintf(message, QM_MESSAGE_SIZE, "database: its settings cannot be read");
    if (status != QM_STORED || is_durable || is_unsafe) return status;
    snprintf(message, QM_MESSAGE_SIZE,
             "database: it loses what it has acknowledged when its machine fails: fsync, full_page_writes or "
             "synchronous_commit is off");
    return QM_STORED_FULL;
}

static qm_stored open_database(qm_store *store, const char *address, bool is_unsafe,
                               char message[QM_MESSAGE_SIZE])
{
    qm_stored status = qm_postgres_open_pool(store, address, false, message);
    if (status == QM_STORED) status = check_durability(store, is_unsafe, message);
    if (status == QM_STORED) status = qm_postgres_set_up(store, false, message);
    if (status == QM_STORED) status = qm_postgres_open_place(store, message);
    if (status != QM_STORED) return status;
    qm_store_cluster cluster;
    status = qm_postgres_join(store);
    if (status == QM_STORED) status = qm_postgres_beat(store, 0, &cluster, NULL, NULL);
    if (status != QM_STORED) snprintf(message, QM_MESSAGE_SIZE, "database: this node cannot join the others");
    return status;
}

/** The end of a call that opens a store: gives the store to the caller, or closes it. */
static qm_stored give(qm_store *store, qm_stored status, qm_store **out)
{
    *out = status == QM_STORED ? store : NULL;
    if (status != QM_STORED) qm_store_close(store);
    return status;
}

/** A store without connections. */
static qm_stored create_store(const qm_store_node *self, const char *folder, qm_store **out,
                              char message[QM_MESSAGE_SIZE])
{
    *out = NULL;
    if (!qm_postgres_load_library(message)) return QM_STORED_AWAY;
    qm_store *store = qm_store_create(folder, message);
    if (!store) return QM_STORED_NO_MEMORY;
    store->driver = &qm_postgres_driver;
    if (create_postgres(store, self)) {
        *out = store;
        return QM_STORED;
    }
    snprintf(message, QM_MESSAGE_SIZE, "%s", qm_status_text(QM_E_NO_MEMORY));
    qm_store_close(store);
    return QM_STORED_NO_MEMORY;
}

qm_stored qm_postgres_visit(const char *address, const qm_store_node *self, const char *folder,
                            bool is_reader, qm_store **out, char message[QM_MESSAGE_SIZE])
{
    qm_store *store;
    *out = NULL;
    qm_stored status = create_store(self, folder, &store, message);
    if (status != QM_STORED) return status;
    status = qm_postgres_open_pool(store, address, is_reader, message);
    return give(store, status, out);
}

/** Takes a snapshot of tables of this version. */
static qm_stored begin_reading(qm_store *store, char message[QM_MESSAGE_SIZE])
{
    int64_t version;
    qm_stored status = qm_postgres_begin_snapshot(store);
    if (status == QM_STORED) status = qm_postgres_find_version(store, &version);
    if (status != QM_STORED)
        snprintf(message, QM_MESSAGE_SIZE, "database: its tables cannot be read; the log has more");
    else if (version == 0)
        snprintf(message, QM_MESSAGE_SIZE, "database: it has no tables of quadmeshd");
    else if (!qm_postgres_knows(version))
        snprintf(message, QM_MESSAGE_SIZE,
                 "database: tables of version %d were made by another version of quadmeshd", (int)version);
    else
        return QM_STORED;
    return status == QM_STORED ? QM_STORED_NONE : status;
}

qm_stored qm_store_visit_to_read(const char *address, const qm_store_node *self, const char *folder,
                                 qm_store **out, char message[QM_MESSAGE_SIZE])
{
    qm_store *store;
    *out = NULL;
    qm_stored status = qm_postgres_visit(address, self, folder ? folder : "", true, &store, message);
    if (status != QM_STORED) return status;
    bool has_folder = !folder || qm_blob_make_folders(folder, message);
    status = has_folder ? begin_reading(store, message) : QM_STORED_FAULT;
    if (status == QM_STORED) status = qm_postgres_open_place_to_read(store, message);
    return give(store, status, out);
}

qm_stored qm_store_visit_to_write(const char *address, const qm_store_node *self, bool is_unsafe,
                                  qm_store **out, char message[QM_MESSAGE_SIZE])
{
    qm_store *store;
    *out = NULL;
    qm_stored status = qm_postgres_visit(address, self, "", false, &store, message);
    if (status != QM_STORED) return status;
    status = check_durability(store, is_unsafe, message);
    if (status == QM_STORED) status = qm_postgres_set_up(store, false, message);
    if (status == QM_STORED) status = qm_postgres_open_place(store, message);
    return give(store, status, out);
}

qm_stored qm_store_open_shared(const char *address, const char *folder, const qm_store_node *self,
                               bool is_unsafe, qm_store **out, char message[QM_MESSAGE_SIZE])
{
    qm_store *store;
    *out = NULL;
    qm_stored status = create_store(self, folder, &store, message);
    if (status != QM_STORED) return status;
    status = take_folder(store, message);
    if (status == QM_STORED) status = open_database(store, address, is_unsafe, message);
    return give(store, status, out);
}

qm_stored qm_store_migrate(const char *address, const qm_store_node *self, char message[QM_MESSAGE_SIZE])
{
    qm_store *store;
    qm_stored status = qm_postgres_visit(address, self, "", false, &store, message);
    if (status != QM_STORED) return status;
    status = qm_postgres_set_up(store, true, message);
    qm_store_close(store);
    return status;
}
