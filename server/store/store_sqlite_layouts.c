/**
 * store_sqlite_layouts.c: layouts with their revisions.
 */
#include <stdlib.h>

#include "store_sqlite.h"

#define KEPT_REVISIONS 100 /* of a layout, to go back to */
#define SELECT                                                                                               \
    "SELECT " QM_SQLITE_LAYOUT_COLUMNS                                                                       \
    " FROM layouts l JOIN layout_revisions r ON r.id = l.id AND r.revision = l.revision "

/* The functions up to the verbs run in a transaction. */

bool qm_sqlite_add_revision(qm_store *store, const qm_store_layout *layout, int64_t revision)
{
    sqlite3_stmt *statement =
        qm_sqlite_prepare(store, "INSERT INTO layout_revisions (id, revision, layout, issues, next_curve, "
                                 "is_complete) VALUES (?, ?, ?, ?, ?, ?)");
    if (!statement) return false;
    qm_sqlite_bind_text(statement, 1, layout->id);
    sqlite3_bind_int64(statement, 2, revision);
    qm_sqlite_bind_text(statement, 3, layout->layout);
    qm_sqlite_bind_text(statement, 4, layout->issues);
    sqlite3_bind_int64(statement, 5, layout->next_curve);
    sqlite3_bind_int(statement, 6, layout->is_complete);
    return qm_sqlite_run(store, statement);
}

static qm_stored add_layout(qm_store *store, const qm_store_layout *layout,
                            const qm_store_idempotency *idempotency)
{
    sqlite3_stmt *statement = qm_sqlite_prepare(
        store, "INSERT INTO layouts (id, mesh, created, revision, idempotency_key, request) "
               "VALUES (?, ?, ?, 0, ?, ?) ON CONFLICT DO NOTHING");
    if (!statement) return QM_STORED_FAULT;
    qm_sqlite_bind_text(statement, 1, layout->id);
    qm_sqlite_bind_text(statement, 2, layout->mesh);
    qm_sqlite_bind_text(statement, 3, layout->created);
    qm_sqlite_bind_text(statement, 4, idempotency->key);
    qm_sqlite_bind_text(statement, 5, idempotency->request);
    if (!qm_sqlite_run(store, statement)) return QM_STORED_FAULT;
    if (qm_sqlite_has_changed(store))
        return qm_sqlite_add_revision(store, layout, 0) ? QM_STORED : QM_STORED_FAULT;
    return qm_sqlite_has_row(store, "SELECT 1 FROM layouts WHERE id = ?", layout->id) ? QM_STORED
                                                                                      : QM_STORED_TAKEN;
}

/** Deletes the undone revisions, and those that are too old to be kept beside the next one. */
static bool drop_revisions(qm_store *store, const qm_store_layout *layout)
{
    sqlite3_stmt *statement = qm_sqlite_prepare(
        store, "DELETE FROM layout_revisions WHERE id = ?1 AND (revision > ?2 OR revision < ?3)");
    if (!statement) return false;
    qm_sqlite_bind_text(statement, 1, layout->id);
    sqlite3_bind_int64(statement, 2, layout->revision);
    sqlite3_bind_int64(statement, 3, layout->revision + 1 - KEPT_REVISIONS);
    return qm_sqlite_run(store, statement);
}

/** Makes `to` the current revision if `from` still is. */
static qm_stored move(qm_store *store, const char *id, int64_t from, int64_t to)
{
    sqlite3_stmt *statement =
        qm_sqlite_prepare(store, "UPDATE layouts SET revision = ?3 WHERE id = ?1 AND revision = ?2");
    if (!statement) return QM_STORED_FAULT;
    qm_sqlite_bind_text(statement, 1, id);
    sqlite3_bind_int64(statement, 2, from);
    sqlite3_bind_int64(statement, 3, to);
    if (!qm_sqlite_run(store, statement)) return QM_STORED_FAULT;
    return qm_sqlite_has_changed(store) ? QM_STORED : QM_STORED_LATE;
}

qm_stored qm_sqlite_put_layout(qm_store *store, const qm_store_layout *layout,
                               const qm_store_idempotency *idempotency)
{
    if (!qm_space_has_room(store)) return QM_STORED_FULL;
    if (!qm_sqlite_begin_transaction(store)) return QM_STORED_FAULT;
    return qm_sqlite_end_transaction(store, add_layout(store, layout, idempotency));
}

qm_stored qm_sqlite_edit_layout(qm_store *store, const qm_store_layout *layout)
{
    if (!qm_space_has_room(store)) return QM_STORED_FULL;
    if (!qm_sqlite_begin_transaction(store)) return QM_STORED_FAULT;
    int64_t next = layout->revision + 1;
    qm_stored stored = move(store, layout->id, layout->revision, next);
    if (stored == QM_STORED &&
        (!drop_revisions(store, layout) || !qm_sqlite_add_revision(store, layout, next)))
        stored = QM_STORED_FAULT;
    return qm_sqlite_end_transaction(store, stored);
}

qm_stored qm_sqlite_move_layout(qm_store *store, const char *id, int64_t from, int64_t to)
{
    if (!qm_sqlite_begin_transaction(store)) return QM_STORED_FAULT;
    return qm_sqlite_end_transaction(store, move(store, id, from, to));
}

bool qm_sqlite_read_layout(sqlite3_stmt *statement, void *row)
{
    qm_store_layout *out = row;
    *out = (qm_store_layout){.revision = sqlite3_column_int64(statement, 5),
                             .next_curve = sqlite3_column_int64(statement, 6),
                             .sequence = sqlite3_column_int64(statement, 7),
                             .first = sqlite3_column_int64(statement, 8),
                             .latest = sqlite3_column_int64(statement, 9),
                             .is_complete = sqlite3_column_int(statement, 10) != 0};
    if (qm_sqlite_read_text(statement, 0, out->id, sizeof out->id) &&
        qm_sqlite_read_text(statement, 1, out->mesh, sizeof out->mesh) &&
        qm_sqlite_copy_text(statement, 2, &out->created) && qm_sqlite_copy_text(statement, 3, &out->layout) &&
        qm_sqlite_copy_text(statement, 4, &out->issues))
        return true;
    qm_store_layout_reset(out);
    return false;
}

static void reset_row(void *row)
{
    qm_store_layout_reset(row);
}

static const qm_sqlite_table table = {sizeof(qm_store_layout), qm_sqlite_read_layout, reset_row};

qm_stored qm_sqlite_find_layout(qm_store *store, const char *id, qm_store_layout *out)
{
    return qm_sqlite_find_row_by(store, SELECT "WHERE l.id = ?", id, &table, out);
}

qm_stored qm_sqlite_list_layouts(qm_store *store, const qm_store_page *page, const char *mesh,
                                 qm_store_layout *out, size_t *count)
{
    const qm_sqlite_listing listing = {SELECT, "l.sequence", {"l.mesh = ?"}, {mesh}};
    return qm_sqlite_list_rows(store, &listing, page, &table, out, count);
}

qm_stored qm_sqlite_delete_layout(qm_store *store, const char *id)
{
    return qm_sqlite_delete_row(store, "DELETE FROM layouts WHERE id = ?", id);
}

qm_stored qm_sqlite_find_layout_by_idempotency_key(qm_store *store, const char *key,
                                                   qm_store_idempotency_record *out)
{
    return qm_sqlite_find_idempotency_record(
        store, "SELECT id, request FROM layouts WHERE idempotency_key = ?", key, out);
}
