/**
 * store_sqlite_meshes.c: rows of meshes.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "store_sqlite.h"

#define COLUMNS                                                                                              \
    "id, hash, options, name, document, format, sequence, revision, positions, created, expires, unit,"      \
    " uncertainty, labels"

qm_stored qm_sqlite_add_mesh(qm_store *store, const qm_store_mesh *mesh)
{
    sqlite3_stmt *statement = qm_sqlite_prepare(
        store,
        "INSERT INTO meshes (id, hash, options, name, document, format, revision, positions, created,"
        "  expires, unit, uncertainty, labels) SELECT ?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13"
        " WHERE NOT EXISTS (SELECT 1 FROM meshes WHERE hash = ?2 AND options = ?3)");
    if (!statement) return QM_STORED_FAULT;
    qm_sqlite_bind_text(statement, 1, mesh->id);
    qm_sqlite_bind_text(statement, 2, mesh->hash);
    qm_sqlite_bind_text(statement, 3, mesh->options);
    qm_sqlite_bind_text(statement, 4, mesh->name);
    qm_sqlite_bind_text(statement, 5, mesh->document);
    sqlite3_bind_int(statement, 6, mesh->format);
    sqlite3_bind_int64(statement, 7, (sqlite3_int64)mesh->revision);
    qm_sqlite_bind_text(statement, 8, mesh->positions);
    qm_sqlite_bind_text(statement, 9, mesh->created);
    qm_sqlite_bind_text(statement, 10, mesh->expires);
    qm_sqlite_bind_text(statement, 11, mesh->notes.unit);
    sqlite3_bind_double(statement, 12, mesh->notes.uncertainty);
    qm_sqlite_bind_text(statement, 13, mesh->labels ? mesh->labels : "");
    if (!qm_sqlite_run(store, statement)) return QM_STORED_FAULT;
    return qm_sqlite_has_changed(store) ? QM_STORED : QM_STORED_TAKEN;
}

qm_stored qm_sqlite_put_mesh(qm_store *store, const qm_store_mesh *mesh)
{
    if (!qm_sqlite_begin_transaction(store)) return QM_STORED_FAULT;
    qm_stored stored = qm_sqlite_add_mesh(store, mesh);
    if (stored == QM_STORED_TAKEN && qm_sqlite_has_row(store, "SELECT 1 FROM meshes WHERE id = ?", mesh->id))
        stored = QM_STORED;
    return qm_sqlite_end_transaction(store, stored);
}

static bool read_row(sqlite3_stmt *statement, void *row)
{
    qm_store_mesh *out = row;
    *out = (qm_store_mesh){.format = sqlite3_column_int(statement, 5),
                           .sequence = sqlite3_column_int64(statement, 6),
                           .revision = (uint64_t)sqlite3_column_int64(statement, 7),
                           .notes.uncertainty = sqlite3_column_double(statement, 12)};
    if (qm_sqlite_read_text(statement, 0, out->id, sizeof out->id) &&
        qm_sqlite_read_text(statement, 1, out->hash, sizeof out->hash) &&
        qm_sqlite_copy_text(statement, 2, &out->options) && qm_sqlite_copy_text(statement, 3, &out->name) &&
        qm_sqlite_copy_text(statement, 4, &out->document) &&
        qm_sqlite_read_text(statement, 8, out->positions, sizeof out->positions) &&
        qm_sqlite_copy_text(statement, 9, &out->created) &&
        qm_sqlite_read_text(statement, 10, out->expires, sizeof out->expires) &&
        qm_sqlite_read_text(statement, 11, out->notes.unit, sizeof out->notes.unit) &&
        qm_sqlite_copy_text(statement, 13, &out->labels))
        return true;
    qm_store_mesh_reset(out);
    return false;
}

static void reset_row(void *row)
{
    qm_store_mesh_reset(row);
}

static const qm_sqlite_table table = {sizeof(qm_store_mesh), read_row, reset_row};

qm_stored qm_sqlite_find_mesh(qm_store *store, const char *id, qm_store_mesh *out)
{
    return qm_sqlite_find_row_by(store, "SELECT " COLUMNS " FROM meshes WHERE id = ?", id, &table, out);
}

static bool read_state(sqlite3_stmt *statement, void *row)
{
    qm_store_mesh_state *out = row;
    *out = (qm_store_mesh_state){.is_found = true,
                                 .revision = (uint64_t)sqlite3_column_int64(statement, 0),
                                 .notes.uncertainty = sqlite3_column_double(statement, 2),
                                 .format = sqlite3_column_int(statement, 5)};
    return qm_sqlite_read_text(statement, 1, out->notes.unit, sizeof out->notes.unit) &&
           qm_sqlite_read_text(statement, 3, out->hash, sizeof out->hash) &&
           qm_sqlite_read_text(statement, 4, out->positions, sizeof out->positions);
}

/** The database is in this process: a statement for each costs no trip. */
qm_stored qm_sqlite_find_mesh_states(qm_store *store, const char *const *ids, size_t count,
                                     qm_store_mesh_state *out)
{
    static const qm_sqlite_table states = {sizeof *out, read_state, NULL};
    qm_stored stored = QM_STORED;
    for (size_t i = 0; stored == QM_STORED && i < count; i++) {
        stored = qm_sqlite_find_row_by(
            store, "SELECT revision, unit, uncertainty, hash, positions, format FROM meshes WHERE id = ?",
            ids[i], &states, &out[i]);
        if (stored == QM_STORED_NONE) stored = QM_STORED;
    }
    return stored;
}

static bool read_id(sqlite3_stmt *statement, void *row)
{
    return qm_sqlite_read_text(statement, 0, row, QM_ID_SIZE);
}

qm_stored qm_sqlite_find_undeformed(qm_store *store, const char *const *hashes, size_t count,
                                    char (*ids)[QM_ID_SIZE])
{
    static const qm_sqlite_table names = {QM_ID_SIZE, read_id, NULL};
    qm_stored stored = QM_STORED;
    for (size_t i = 0; stored == QM_STORED && i < count; i++) {
        stored = qm_sqlite_find_row_by(
            store, "SELECT id FROM meshes WHERE hash = ? AND revision = 0 ORDER BY sequence DESC LIMIT 1",
            hashes[i], &names, ids[i]);
        if (stored == QM_STORED_NONE) stored = QM_STORED;
    }
    return stored;
}

qm_stored qm_sqlite_find_mesh_by_content(qm_store *store, const char *hash, const char *options,
                                         qm_store_mesh *out)
{
    sqlite3_stmt *statement =
        qm_sqlite_begin(store, "SELECT " COLUMNS " FROM meshes WHERE hash = ? AND options = ? LIMIT 1");
    if (statement) qm_sqlite_bind_text(statement, 1, hash);
    if (statement) qm_sqlite_bind_text(statement, 2, options);
    return qm_sqlite_find_row(store, statement, &table, out);
}

qm_stored qm_sqlite_list_meshes(qm_store *store, const qm_store_page *page,
                                const qm_store_mesh_filter *filter, qm_store_mesh *out, size_t *count)
{
    const qm_sqlite_listing listing = {
        "SELECT " COLUMNS " FROM meshes",
        "sequence",
        {"name = ?", "hash = ?", "instr(labels, char(10) || ? || char(10)) > 0"},
        {filter->name, filter->hash, filter->label}};
    return qm_sqlite_list_rows(store, &listing, page, &table, out, count);
}

qm_stored qm_sqlite_set_notes(qm_store *store, const qm_store_mesh *mesh)
{
    sqlite3_stmt *statement = qm_sqlite_begin(
        store,
        "UPDATE meshes SET unit = ?, uncertainty = ?, labels = ?, options = ? WHERE id = ? RETURNING 1");
    if (!statement) return QM_STORED_FAULT;
    qm_sqlite_bind_text(statement, 1, mesh->notes.unit);
    sqlite3_bind_double(statement, 2, mesh->notes.uncertainty);
    qm_sqlite_bind_text(statement, 3, mesh->labels ? mesh->labels : "");
    qm_sqlite_bind_text(statement, 4, mesh->options);
    qm_sqlite_bind_text(statement, 5, mesh->id);
    return qm_sqlite_change_row(store, statement);
}

qm_stored qm_sqlite_set_expiry(qm_store *store, const char *id, const char *expires)
{
    sqlite3_stmt *statement =
        qm_sqlite_begin(store, "UPDATE meshes SET expires = ? WHERE id = ? RETURNING 1");
    if (!statement) return QM_STORED_FAULT;
    qm_sqlite_bind_text(statement, 1, expires);
    qm_sqlite_bind_text(statement, 2, id);
    return qm_sqlite_change_row(store, statement);
}

qm_stored qm_sqlite_find_expired_mesh(qm_store *store, const char *before, qm_store_mesh *out)
{
    return qm_sqlite_find_row_by(
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
static qm_stored delete_row(qm_store *store, const char *id, char hash[QM_HASH_SIZE],
                            char positions[QM_HASH_SIZE])
{
    sqlite3_stmt *statement =
        qm_sqlite_begin(store, "DELETE FROM meshes WHERE id = ? RETURNING hash, positions");
    if (!statement) return QM_STORED_FAULT;
    qm_sqlite_bind_text(statement, 1, id);
    int step = sqlite3_step(statement);
    bool is_found = step == SQLITE_ROW, is_read = true;
    if (is_found) {
        is_read = qm_sqlite_read_text(statement, 0, hash, QM_HASH_SIZE) &&
                  qm_sqlite_read_text(statement, 1, positions, QM_HASH_SIZE);
        step = sqlite3_step(statement);
    }
    qm_sqlite_end(store, statement);
    if (step != SQLITE_DONE) return QM_STORED_FAULT;
    if (!is_read) hash[0] = positions[0] = '\0'; /* they are swept at a later start */
    return is_found ? QM_STORED : QM_STORED_NONE;
}

qm_stored qm_sqlite_delete_mesh(qm_store *store, const char *id)
{
    char hash[QM_HASH_SIZE], positions[QM_HASH_SIZE];
    qm_stored status = delete_row(store, id, hash, positions);
    if (status == QM_STORED && hash[0]) qm_blob_remove(store, hash);
    if (status == QM_STORED && positions[0]) qm_blob_remove(store, positions);
    return status;
}

/** QM_STORED_LATE when the mesh is not at the revision before. */
static qm_stored update_revision(qm_store *store, const qm_store_mesh *mesh)
{
    sqlite3_stmt *statement =
        qm_sqlite_begin(store, "UPDATE meshes SET revision = ?, positions = ?, options = ?, document = ?"
                               " WHERE id = ? AND revision = ? RETURNING 1");
    if (!statement) return QM_STORED_FAULT;
    sqlite3_bind_int64(statement, 1, (sqlite3_int64)mesh->revision);
    qm_sqlite_bind_text(statement, 2, mesh->positions);
    qm_sqlite_bind_text(statement, 3, mesh->options);
    qm_sqlite_bind_text(statement, 4, mesh->document);
    qm_sqlite_bind_text(statement, 5, mesh->id);
    sqlite3_bind_int64(statement, 6, (sqlite3_int64)mesh->revision - 1);
    qm_stored stored = qm_sqlite_change_row(store, statement);
    return stored == QM_STORED_NONE ? QM_STORED_LATE : stored;
}

qm_stored qm_sqlite_revise_mesh(qm_store *store, const qm_store_mesh *mesh)
{
    qm_store_mesh before;
    qm_stored stored = qm_sqlite_find_mesh(store, mesh->id, &before);
    if (stored != QM_STORED) return stored;
    bool is_done = before.revision == mesh->revision && strcmp(before.positions, mesh->positions) == 0;
    /* A row that the update finds is the one that was read: each revision is written once. */
    if (!is_done)
        stored = before.revision + 1 == mesh->revision ? update_revision(store, mesh) : QM_STORED_LATE;
    if (!is_done && stored == QM_STORED && before.positions[0]) qm_blob_remove(store, before.positions);
    qm_store_mesh_reset(&before);
    return stored;
}

bool qm_sqlite_needs_blob(qm_store *store, const char *hash)
{
    sqlite3_stmt *statement =
        qm_sqlite_begin(store, "SELECT 1 FROM meshes WHERE hash = ?1 OR positions = ?1 LIMIT 1");
    if (!statement) return true;
    qm_sqlite_bind_text(statement, 1, hash);
    bool needed = sqlite3_step(statement) != SQLITE_DONE;
    qm_sqlite_end(store, statement);
    return needed;
}
