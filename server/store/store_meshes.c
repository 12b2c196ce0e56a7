/**
 * store_meshes.c: rows of meshes.
 */
#include <stdio.h>
#include <stdlib.h>

#include "store_internal.h"

#define COLUMNS "id, hash, options, name, document, format, sequence, revision, positions, created, expires"

bool qm_store_add_mesh(qm_store *store, const qm_store_mesh *mesh)
{
    sqlite3_stmt *statement = qm_store_prepare(
        store, "INSERT INTO meshes (id, hash, options, name, document, format, revision, positions, created,"
               "  expires) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
    if (!statement) return false;
    qm_store_bind_text(statement, 1, mesh->id);
    qm_store_bind_text(statement, 2, mesh->hash);
    qm_store_bind_text(statement, 3, mesh->options);
    qm_store_bind_text(statement, 4, mesh->name);
    qm_store_bind_text(statement, 5, mesh->document);
    sqlite3_bind_int(statement, 6, mesh->format);
    sqlite3_bind_int64(statement, 7, (sqlite3_int64)mesh->revision);
    qm_store_bind_text(statement, 8, mesh->positions);
    qm_store_bind_text(statement, 9, mesh->created);
    qm_store_bind_text(statement, 10, mesh->expires);
    return qm_store_run(store, statement);
}

qm_status qm_store_put_mesh(qm_store *store, const qm_store_mesh *mesh)
{
    if (!qm_store_begin_transaction(store)) return QM_E_ARGUMENT;
    return qm_store_end_transaction(store, qm_store_add_mesh(store, mesh)) ? QM_OK : QM_E_ARGUMENT;
}

static bool read_row(sqlite3_stmt *statement, void *row)
{
    qm_store_mesh *out = row;
    *out = (qm_store_mesh){.format = sqlite3_column_int(statement, 5),
                           .sequence = sqlite3_column_int64(statement, 6),
                           .revision = (uint64_t)sqlite3_column_int64(statement, 7)};
    if (qm_store_read_text(statement, 0, out->id, sizeof out->id) &&
        qm_store_read_text(statement, 1, out->hash, sizeof out->hash) &&
        qm_store_copy_text(statement, 2, &out->options) && qm_store_copy_text(statement, 3, &out->name) &&
        qm_store_copy_text(statement, 4, &out->document) &&
        qm_store_read_text(statement, 8, out->positions, sizeof out->positions) &&
        qm_store_copy_text(statement, 9, &out->created) &&
        qm_store_read_text(statement, 10, out->expires, sizeof out->expires))
        return true;
    qm_store_mesh_reset(out);
    return false;
}

static void reset_row(void *row)
{
    qm_store_mesh_reset(row);
}

static const qm_store_table table = {sizeof(qm_store_mesh), read_row, reset_row};

qm_status qm_store_find_mesh(qm_store *store, const char *id, qm_store_mesh *out)
{
    return qm_store_find_row_by(store, "SELECT " COLUMNS " FROM meshes WHERE id = ?", id, &table, out);
}

qm_status qm_store_find_mesh_by_content(qm_store *store, const char *hash, const char *options,
                                        qm_store_mesh *out)
{
    sqlite3_stmt *statement =
        qm_store_begin(store, "SELECT " COLUMNS " FROM meshes WHERE hash = ? AND options = ? LIMIT 1");
    if (statement) qm_store_bind_text(statement, 1, hash);
    if (statement) qm_store_bind_text(statement, 2, options);
    return qm_store_find_row(store, statement, &table, out);
}

qm_status qm_store_list_meshes(qm_store *store, const qm_store_page *page, const qm_store_mesh_filter *filter,
                               qm_store_mesh *out, size_t *count)
{
    const qm_store_listing listing = {
        "SELECT " COLUMNS " FROM meshes", "sequence", {"name = ?", "hash = ?"}, {filter->name, filter->hash}};
    return qm_store_list_rows(store, &listing, page, &table, out, count);
}

/** Runs a statement that returns a row if it has changed one; QM_E_EMPTY when it has not. */
static qm_status change_row(qm_store *store, sqlite3_stmt *statement)
{
    int step = sqlite3_step(statement);
    bool is_found = step == SQLITE_ROW;
    if (is_found) step = sqlite3_step(statement);
    qm_store_end(store, statement);
    if (step != SQLITE_DONE) return QM_E_ARGUMENT;
    return is_found ? QM_OK : QM_E_EMPTY;
}

qm_status qm_store_set_expiry(qm_store *store, const char *id, const char *expires)
{
    sqlite3_stmt *statement = qm_store_begin(store, "UPDATE meshes SET expires = ? WHERE id = ? RETURNING 1");
    if (!statement) return QM_E_ARGUMENT;
    qm_store_bind_text(statement, 1, expires);
    qm_store_bind_text(statement, 2, id);
    return change_row(store, statement);
}

qm_status qm_store_find_expired_mesh(qm_store *store, const char *before, qm_store_mesh *out)
{
    return qm_store_find_row_by(
        store,
        "SELECT " COLUMNS " FROM meshes WHERE expires <> '' AND expires < ?"
        "  AND NOT EXISTS (SELECT 1 FROM job_subjects JOIN jobs ON jobs.sequence = job_subjects.job"
        "    WHERE job_subjects.subject = meshes.id AND jobs.state = 0)"
        "  AND NOT EXISTS (SELECT 1 FROM layouts WHERE layouts.mesh = meshes.id)"
        "  AND NOT EXISTS (SELECT 1 FROM reconstructions"
        "    WHERE reconstructions.source = meshes.id OR reconstructions.mesh = meshes.id)"
        "  ORDER BY expires LIMIT 1",
        before, &table, out);
}

/** Deletes a row and reads which blobs it had, in one statement. */
static qm_status delete_row(qm_store *store, const char *id, char hash[QM_HASH_SIZE],
                            char positions[QM_HASH_SIZE])
{
    sqlite3_stmt *statement =
        qm_store_begin(store, "DELETE FROM meshes WHERE id = ? RETURNING hash, positions");
    if (!statement) return QM_E_ARGUMENT;
    qm_store_bind_text(statement, 1, id);
    int step = sqlite3_step(statement);
    bool is_found = step == SQLITE_ROW, is_read = true;
    if (is_found) {
        is_read = qm_store_read_text(statement, 0, hash, QM_HASH_SIZE) &&
                  qm_store_read_text(statement, 1, positions, QM_HASH_SIZE);
        step = sqlite3_step(statement);
    }
    qm_store_end(store, statement);
    if (step != SQLITE_DONE) return QM_E_ARGUMENT;
    if (!is_read) hash[0] = positions[0] = '\0'; /* they are swept at a later start */
    return is_found ? QM_OK : QM_E_EMPTY;
}

qm_status qm_store_delete_mesh(qm_store *store, const char *id)
{
    char hash[QM_HASH_SIZE], positions[QM_HASH_SIZE];
    qm_status status = delete_row(store, id, hash, positions);
    if (status == QM_OK && hash[0]) qm_blob_remove(store, hash);
    if (status == QM_OK && positions[0]) qm_blob_remove(store, positions);
    return status;
}

/** QM_E_CANCELED when the mesh is not at the revision before. */
static qm_status update_revision(qm_store *store, const qm_store_mesh *mesh)
{
    sqlite3_stmt *statement =
        qm_store_begin(store, "UPDATE meshes SET revision = ?, positions = ?, options = ?, document = ?"
                              " WHERE id = ? AND revision = ? RETURNING 1");
    if (!statement) return QM_E_ARGUMENT;
    sqlite3_bind_int64(statement, 1, (sqlite3_int64)mesh->revision);
    qm_store_bind_text(statement, 2, mesh->positions);
    qm_store_bind_text(statement, 3, mesh->options);
    qm_store_bind_text(statement, 4, mesh->document);
    qm_store_bind_text(statement, 5, mesh->id);
    sqlite3_bind_int64(statement, 6, (sqlite3_int64)mesh->revision - 1);
    qm_status status = change_row(store, statement);
    return status == QM_E_EMPTY ? QM_E_CANCELED : status;
}

qm_status qm_store_deform_mesh(qm_store *store, const qm_store_mesh *mesh)
{
    qm_store_mesh before;
    qm_status status = qm_store_find_mesh(store, mesh->id, &before);
    if (status != QM_OK) return status;
    /* A row that the update finds is the one that was read: each revision is written once. */
    status = before.revision + 1 == mesh->revision ? update_revision(store, mesh) : QM_E_CANCELED;
    if (status == QM_OK && before.positions[0]) qm_blob_remove(store, before.positions);
    qm_store_mesh_reset(&before);
    return status;
}

bool qm_store_needs_blob(qm_store *store, const char *hash)
{
    sqlite3_stmt *statement =
        qm_store_begin(store, "SELECT 1 FROM meshes WHERE hash = ?1 OR positions = ?1 LIMIT 1");
    if (!statement) return true;
    qm_store_bind_text(statement, 1, hash);
    bool needed = sqlite3_step(statement) != SQLITE_DONE;
    qm_store_end(store, statement);
    return needed;
}

void qm_store_mesh_reset(qm_store_mesh *mesh)
{
    free(mesh->options);
    free(mesh->name);
    free(mesh->document);
    free(mesh->created);
    *mesh = (qm_store_mesh){0};
}
