/**
 * store_meshes.c: rows of meshes.
 */
#include <stdio.h>
#include <stdlib.h>

#include "store_internal.h"

#define COLUMNS "id, hash, options, name, document, format, sequence, revision, positions, created, expires"

qm_status qm_store_put_mesh(qm_store *store, const qm_store_mesh *mesh)
{
    sqlite3_stmt *statement = qm_store_begin(
        store, "INSERT INTO meshes (id, hash, options, name, document, format, revision, positions, created,"
               "  expires) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
    if (!statement) return QM_E_ARGUMENT;
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
    return qm_store_execute(store, statement);
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

qm_status qm_store_set_expiry(qm_store *store, const char *id, const char *expires)
{
    sqlite3_stmt *statement = qm_store_begin(store, "UPDATE meshes SET expires = ? WHERE id = ? RETURNING 1");
    if (!statement) return QM_E_ARGUMENT;
    qm_store_bind_text(statement, 1, expires);
    qm_store_bind_text(statement, 2, id);
    int step = sqlite3_step(statement);
    bool is_found = step == SQLITE_ROW;
    if (is_found) step = sqlite3_step(statement);
    qm_store_end(store, statement);
    if (step != SQLITE_DONE) return QM_E_ARGUMENT;
    return is_found ? QM_OK : QM_E_EMPTY;
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

qm_status qm_store_delete_mesh(qm_store *store, const char *id)
{
    qm_store_mesh row;
    qm_status status = qm_store_find_mesh(store, id, &row);
    if (status != QM_OK) return status;
    status = qm_store_delete_row(store, "DELETE FROM meshes WHERE id = ?", id);
    if (status == QM_OK) qm_blob_remove(store, row.hash);
    if (status == QM_OK && row.positions[0]) qm_blob_remove(store, row.positions);
    qm_store_mesh_reset(&row);
    return status;
}

static bool update_revision(qm_store *store, const qm_store_mesh *mesh)
{
    sqlite3_stmt *statement = qm_store_begin(
        store, "UPDATE meshes SET revision = ?, positions = ?, options = ?, document = ? WHERE id = ?");
    if (!statement) return false;
    sqlite3_bind_int64(statement, 1, (sqlite3_int64)mesh->revision);
    qm_store_bind_text(statement, 2, mesh->positions);
    qm_store_bind_text(statement, 3, mesh->options);
    qm_store_bind_text(statement, 4, mesh->document);
    qm_store_bind_text(statement, 5, mesh->id);
    return qm_store_execute(store, statement) == QM_OK;
}

qm_status qm_store_deform_mesh(qm_store *store, const qm_store_mesh *mesh)
{
    qm_store_mesh before;
    if (qm_store_find_mesh(store, mesh->id, &before) != QM_OK) return QM_E_ARGUMENT;
    bool follows = before.revision + 1 == mesh->revision;
    bool updated = follows && update_revision(store, mesh);
    if (updated && before.positions[0]) qm_blob_remove(store, before.positions);
    qm_store_mesh_reset(&before);
    return updated ? QM_OK : QM_E_ARGUMENT;
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
