/**
 * store_sqlite_reconstructions.c: rows of reconstructions.
 */
#include <stdlib.h>

#include "store_sqlite.h"

#define COLUMNS                                                                                              \
    "id, source, layout_id, mesh, layout, document, steps, records, state, revision, sequence, cover_share," \
    " pull_curves"

static qm_stored insert(qm_store *store, const qm_store_reconstruction *r,
                        const qm_store_idempotency *idempotency)
{
    sqlite3_stmt *statement = qm_sqlite_prepare(
        store,
        "INSERT INTO reconstructions (id, source, layout_id, mesh, layout, document, steps, records, state,"
        " revision, cover_share, pull_curves, idempotency_key, request)"
        " VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT (idempotency_key) DO NOTHING");
    if (!statement) return QM_STORED_FAULT;
    const char *const texts[] = {r->id,       r->source, r->layout_id, r->mesh, r->layout,
                                 r->document, r->steps,  r->records,   r->state};
    for (int i = 0; i < 9; i++)
        qm_sqlite_bind_text(statement, i + 1, texts[i]);
    sqlite3_bind_int64(statement, 10, r->revision);
    sqlite3_bind_double(statement, 11, r->cover_share);
    sqlite3_bind_int(statement, 12, r->pull_curves);
    qm_sqlite_bind_text(statement, 13, idempotency->key);
    qm_sqlite_bind_text(statement, 14, idempotency->request);
    if (!qm_sqlite_run(store, statement)) return QM_STORED_FAULT;
    return qm_sqlite_has_changed(store) ? QM_STORED : QM_STORED_TAKEN;
}

/** The mesh of a reconstruction: its content may have another row by now. */
static qm_stored add_mesh(qm_store *store, const qm_store_mesh *mesh)
{
    qm_stored stored = mesh ? qm_sqlite_add_mesh(store, mesh) : QM_STORED;
    return stored == QM_STORED_TAKEN ? QM_STORED_LATE : stored;
}

qm_stored qm_sqlite_put_reconstruction(qm_store *store, const qm_store_reconstruction *r,
                                       const qm_store_mesh *mesh, const qm_store_idempotency *idempotency)
{
    if (!qm_space_has_room(store)) return QM_STORED_FULL;
    if (!qm_sqlite_begin_transaction(store)) return QM_STORED_FAULT;
    qm_stored stored = QM_STORED;
    if (!qm_sqlite_has_row(store, "SELECT 1 FROM reconstructions WHERE id = ?", r->id)) {
        stored = insert(store, r, idempotency);
        if (stored == QM_STORED) stored = add_mesh(store, mesh);
    }
    return qm_sqlite_end_transaction(store, stored);
}

qm_stored qm_sqlite_apply_effect(qm_store *store, const qm_store_effect *effect)
{
    const qm_store_reconstruction *r = effect->next;
    qm_stored stored = add_mesh(store, effect->mesh);
    if (stored != QM_STORED || !r) return stored;
    sqlite3_stmt *statement = qm_sqlite_prepare(
        store, "UPDATE reconstructions SET mesh = ?, layout = ?, steps = ?, records = ?, state = ?,"
               " revision = ? WHERE id = ? AND revision = ?");
    if (!statement) return QM_STORED_FAULT;
    const char *const texts[] = {r->mesh, r->layout, r->steps, r->records, r->state};
    for (int i = 0; i < 5; i++)
        qm_sqlite_bind_text(statement, i + 1, texts[i]);
    sqlite3_bind_int64(statement, 6, r->revision);
    qm_sqlite_bind_text(statement, 7, r->id);
    sqlite3_bind_int64(statement, 8, r->revision - 1);
    if (!qm_sqlite_run(store, statement)) return QM_STORED_FAULT;
    return qm_sqlite_has_changed(store) ? QM_STORED : QM_STORED_LATE;
}

qm_stored qm_sqlite_update_reconstruction(qm_store *store, const qm_store_effect *effect)
{
    if (!qm_sqlite_begin_transaction(store)) return QM_STORED_FAULT;
    return qm_sqlite_end_transaction(store, qm_sqlite_apply_effect(store, effect));
}

static bool read_row(sqlite3_stmt *statement, void *row)
{
    qm_store_reconstruction *out = row;
    *out = (qm_store_reconstruction){.revision = sqlite3_column_int64(statement, 9),
                                     .sequence = sqlite3_column_int64(statement, 10),
                                     .cover_share = sqlite3_column_double(statement, 11),
                                     .pull_curves = sqlite3_column_int(statement, 12) != 0};
    if (qm_sqlite_read_text(statement, 0, out->id, sizeof out->id) &&
        qm_sqlite_read_text(statement, 1, out->source, sizeof out->source) &&
        qm_sqlite_read_text(statement, 2, out->layout_id, sizeof out->layout_id) &&
        qm_sqlite_read_text(statement, 3, out->mesh, sizeof out->mesh) &&
        qm_sqlite_copy_text(statement, 4, &out->layout) &&
        qm_sqlite_copy_text(statement, 5, &out->document) && qm_sqlite_copy_text(statement, 6, &out->steps) &&
        qm_sqlite_copy_text(statement, 7, &out->records) && qm_sqlite_copy_text(statement, 8, &out->state))
        return true;
    qm_store_reconstruction_reset(out);
    return false;
}

static void reset_row(void *row)
{
    qm_store_reconstruction_reset(row);
}

static const qm_sqlite_table table = {sizeof(qm_store_reconstruction), read_row, reset_row};

qm_stored qm_sqlite_find_reconstruction(qm_store *store, const char *id, qm_store_reconstruction *out)
{
    return qm_sqlite_find_row_by(store, "SELECT " COLUMNS " FROM reconstructions WHERE id = ?", id, &table,
                                 out);
}

qm_stored qm_sqlite_list_reconstructions(qm_store *store, const qm_store_page *page, const char *source,
                                         qm_store_reconstruction *out, size_t *count)
{
    const qm_sqlite_listing listing = {
        "SELECT " COLUMNS " FROM reconstructions", "sequence", {"source = ?"}, {source}};
    return qm_sqlite_list_rows(store, &listing, page, &table, out, count);
}

qm_stored qm_sqlite_delete_reconstruction(qm_store *store, const char *id)
{
    return qm_sqlite_delete_row(store, "DELETE FROM reconstructions WHERE id = ?", id);
}

qm_stored qm_sqlite_find_reconstruction_by_idempotency_key(qm_store *store, const char *key,
                                                           qm_store_idempotency_record *out)
{
    return qm_sqlite_find_idempotency_record(
        store, "SELECT id, request FROM reconstructions WHERE idempotency_key = ?", key, out);
}
