/**
 * store_reconstructions.c: rows of reconstructions.
 */
#include <stdlib.h>

#include "store_internal.h"

#define COLUMNS                                                                                              \
    "id, source, layout_id, mesh, layout, document, steps, records, state, revision, sequence, cover_share," \
    " pull_curves"

static bool insert(qm_store *store, const qm_store_reconstruction *r, const qm_store_idempotency *idempotency)
{
    sqlite3_stmt *statement = qm_store_prepare(
        store,
        "INSERT INTO reconstructions (id, source, layout_id, mesh, layout, document, steps, records, state,"
        " revision, cover_share, pull_curves, idempotency_key, request)"
        " VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
    if (!statement) return false;
    const char *const texts[] = {r->id,       r->source, r->layout_id, r->mesh, r->layout,
                                 r->document, r->steps,  r->records,   r->state};
    for (int i = 0; i < 9; i++)
        qm_store_bind_text(statement, i + 1, texts[i]);
    sqlite3_bind_int64(statement, 10, r->revision);
    sqlite3_bind_double(statement, 11, r->cover_share);
    sqlite3_bind_int(statement, 12, r->pull_curves);
    qm_store_bind_text(statement, 13, idempotency->key);
    qm_store_bind_text(statement, 14, idempotency->request);
    return qm_store_run(store, statement);
}

qm_status qm_store_put_reconstruction(qm_store *store, const qm_store_reconstruction *r,
                                      const qm_store_mesh *mesh, const qm_store_idempotency *idempotency)
{
    qm_status status = qm_space_check(store);
    if (status != QM_OK) return status;
    if (!qm_store_begin_transaction(store)) return QM_E_ARGUMENT;
    bool good = (!mesh || qm_store_add_mesh(store, mesh)) && insert(store, r, idempotency);
    return qm_store_end_transaction(store, good) ? QM_OK : QM_E_ARGUMENT;
}

qm_status qm_store_apply_effect(qm_store *store, const qm_store_effect *effect)
{
    const qm_store_reconstruction *r = effect->next;
    if (effect->mesh && !qm_store_add_mesh(store, effect->mesh)) return QM_E_ARGUMENT;
    sqlite3_stmt *statement = qm_store_prepare(
        store, "UPDATE reconstructions SET mesh = ?, layout = ?, steps = ?, records = ?, state = ?,"
               " revision = ? WHERE id = ? AND revision = ?");
    if (!statement) return QM_E_ARGUMENT;
    const char *const texts[] = {r->mesh, r->layout, r->steps, r->records, r->state};
    for (int i = 0; i < 5; i++)
        qm_store_bind_text(statement, i + 1, texts[i]);
    sqlite3_bind_int64(statement, 6, r->revision);
    qm_store_bind_text(statement, 7, r->id);
    sqlite3_bind_int64(statement, 8, r->revision - 1);
    if (!qm_store_run(store, statement)) return QM_E_ARGUMENT;
    return sqlite3_changes(store->database) == 1 ? QM_OK : QM_E_CANCELED;
}

qm_status qm_store_update_reconstruction(qm_store *store, const qm_store_effect *effect)
{
    if (!qm_store_begin_transaction(store)) return QM_E_ARGUMENT;
    qm_status status = qm_store_apply_effect(store, effect);
    return qm_store_end_transaction(store, status == QM_OK) || status != QM_OK ? status : QM_E_ARGUMENT;
}

static bool read_row(sqlite3_stmt *statement, void *row)
{
    qm_store_reconstruction *out = row;
    *out = (qm_store_reconstruction){.revision = sqlite3_column_int64(statement, 9),
                                     .sequence = sqlite3_column_int64(statement, 10),
                                     .cover_share = sqlite3_column_double(statement, 11),
                                     .pull_curves = sqlite3_column_int(statement, 12) != 0};
    if (qm_store_read_text(statement, 0, out->id, sizeof out->id) &&
        qm_store_read_text(statement, 1, out->source, sizeof out->source) &&
        qm_store_read_text(statement, 2, out->layout_id, sizeof out->layout_id) &&
        qm_store_read_text(statement, 3, out->mesh, sizeof out->mesh) &&
        qm_store_copy_text(statement, 4, &out->layout) && qm_store_copy_text(statement, 5, &out->document) &&
        qm_store_copy_text(statement, 6, &out->steps) && qm_store_copy_text(statement, 7, &out->records) &&
        qm_store_copy_text(statement, 8, &out->state))
        return true;
    qm_store_reconstruction_reset(out);
    return false;
}

static void reset_row(void *row)
{
    qm_store_reconstruction_reset(row);
}

static const qm_store_table table = {sizeof(qm_store_reconstruction), read_row, reset_row};

qm_status qm_store_find_reconstruction(qm_store *store, const char *id, qm_store_reconstruction *out)
{
    return qm_store_find_row_by(store, "SELECT " COLUMNS " FROM reconstructions WHERE id = ?", id, &table,
                                out);
}

qm_status qm_store_list_reconstructions(qm_store *store, const qm_store_page *page, const char *source,
                                        qm_store_reconstruction *out, size_t *count)
{
    const qm_store_listing listing = {
        "SELECT " COLUMNS " FROM reconstructions", "sequence", {"source = ?"}, {source}};
    return qm_store_list_rows(store, &listing, page, &table, out, count);
}

qm_status qm_store_delete_reconstruction(qm_store *store, const char *id)
{
    return qm_store_delete_row(store, "DELETE FROM reconstructions WHERE id = ?", id);
}

void qm_store_reconstruction_reset(qm_store_reconstruction *r)
{
    free(r->layout);
    free(r->document);
    free(r->steps);
    free(r->records);
    free(r->state);
    *r = (qm_store_reconstruction){0};
}

qm_status qm_store_find_reconstruction_by_idempotency_key(qm_store *store, const char *key,
                                                          qm_store_idempotency_record *out)
{
    return qm_store_find_idempotency_record(
        store, "SELECT id, request FROM reconstructions WHERE idempotency_key = ?", key, out);
}
