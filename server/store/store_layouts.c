/**
 * store_layouts.c: layouts with their revisions.
 */
#include <stdlib.h>

#include "store_internal.h"

#define KEPT_REVISIONS 100 /* of a layout, to go back to */
#define SELECT                                                                                               \
    "SELECT l.id, l.mesh, l.created, r.layout, r.issues, l.revision, r.next_curve, l.sequence,"              \
    "  (SELECT min(revision) FROM layout_revisions WHERE id = l.id),"                                        \
    "  (SELECT max(revision) FROM layout_revisions WHERE id = l.id), r.is_complete"                          \
    " FROM layouts l JOIN layout_revisions r ON r.id = l.id AND r.revision = l.revision "

/* The functions up to those of store.h run in a transaction. */

static bool add_revision(qm_store *store, const qm_store_layout *layout, int64_t revision)
{
    sqlite3_stmt *statement =
        qm_store_prepare(store, "INSERT INTO layout_revisions (id, revision, layout, issues, next_curve, "
                                "is_complete) VALUES (?, ?, ?, ?, ?, ?)");
    if (!statement) return false;
    qm_store_bind_text(statement, 1, layout->id);
    sqlite3_bind_int64(statement, 2, revision);
    qm_store_bind_text(statement, 3, layout->layout);
    qm_store_bind_text(statement, 4, layout->issues);
    sqlite3_bind_int64(statement, 5, layout->next_curve);
    sqlite3_bind_int(statement, 6, layout->is_complete);
    return qm_store_run(store, statement);
}

static bool add_layout(qm_store *store, const qm_store_layout *layout,
                       const qm_store_idempotency *idempotency)
{
    sqlite3_stmt *statement =
        qm_store_prepare(store, "INSERT INTO layouts (id, mesh, created, revision, idempotency_key, request) "
                                "VALUES (?, ?, ?, 0, ?, ?)");
    if (!statement) return false;
    qm_store_bind_text(statement, 1, layout->id);
    qm_store_bind_text(statement, 2, layout->mesh);
    qm_store_bind_text(statement, 3, layout->created);
    qm_store_bind_text(statement, 4, idempotency->key);
    qm_store_bind_text(statement, 5, idempotency->request);
    return qm_store_run(store, statement) && add_revision(store, layout, 0);
}

/** Deletes the undone revisions, and those that are too old to be kept beside the next one. */
static bool drop_revisions(qm_store *store, const qm_store_layout *layout)
{
    sqlite3_stmt *statement = qm_store_prepare(
        store, "DELETE FROM layout_revisions WHERE id = ?1 AND (revision > ?2 OR revision < ?3)");
    if (!statement) return false;
    qm_store_bind_text(statement, 1, layout->id);
    sqlite3_bind_int64(statement, 2, layout->revision);
    sqlite3_bind_int64(statement, 3, layout->revision + 1 - KEPT_REVISIONS);
    return qm_store_run(store, statement);
}

/** Makes `to` the current revision if `from` still is, and sets *moved. */
static bool move(qm_store *store, const char *id, int64_t from, int64_t to, bool *moved)
{
    sqlite3_stmt *statement =
        qm_store_prepare(store, "UPDATE layouts SET revision = ?3 WHERE id = ?1 AND revision = ?2");
    *moved = false;
    if (!statement) return false;
    qm_store_bind_text(statement, 1, id);
    sqlite3_bind_int64(statement, 2, from);
    sqlite3_bind_int64(statement, 3, to);
    bool good = qm_store_run(store, statement);
    *moved = good && sqlite3_changes(store->database) == 1;
    return good;
}

qm_status qm_store_put_layout(qm_store *store, const qm_store_layout *layout,
                              const qm_store_idempotency *idempotency)
{
    qm_status status = qm_space_check(store);
    if (status != QM_OK) return status;
    bool good = qm_store_begin_transaction(store) &&
                qm_store_end_transaction(store, add_layout(store, layout, idempotency));
    return good ? QM_OK : QM_E_ARGUMENT;
}

qm_status qm_store_edit_layout(qm_store *store, const qm_store_layout *layout)
{
    qm_status status = qm_space_check(store);
    if (status != QM_OK) return status;
    if (!qm_store_begin_transaction(store)) return QM_E_ARGUMENT;
    int64_t next = layout->revision + 1;
    bool moved;
    bool good = move(store, layout->id, layout->revision, next, &moved), is_late = good && !moved;
    good = good && moved && drop_revisions(store, layout) && add_revision(store, layout, next);
    good = qm_store_end_transaction(store, good);
    return good ? QM_OK : is_late ? QM_E_CANCELED : QM_E_ARGUMENT;
}

qm_status qm_store_move_layout(qm_store *store, const char *id, int64_t from, int64_t to)
{
    bool moved;
    bool good = qm_store_begin_transaction(store) &&
                qm_store_end_transaction(store, move(store, id, from, to, &moved));
    return !good ? QM_E_ARGUMENT : moved ? QM_OK : QM_E_CANCELED;
}

static bool read_row(sqlite3_stmt *statement, void *row)
{
    qm_store_layout *out = row;
    *out = (qm_store_layout){.revision = sqlite3_column_int64(statement, 5),
                             .next_curve = sqlite3_column_int64(statement, 6),
                             .sequence = sqlite3_column_int64(statement, 7),
                             .first = sqlite3_column_int64(statement, 8),
                             .latest = sqlite3_column_int64(statement, 9),
                             .is_complete = sqlite3_column_int(statement, 10) != 0};
    if (qm_store_read_text(statement, 0, out->id, sizeof out->id) &&
        qm_store_read_text(statement, 1, out->mesh, sizeof out->mesh) &&
        qm_store_copy_text(statement, 2, &out->created) && qm_store_copy_text(statement, 3, &out->layout) &&
        qm_store_copy_text(statement, 4, &out->issues))
        return true;
    qm_store_layout_reset(out);
    return false;
}

static void reset_row(void *row)
{
    qm_store_layout_reset(row);
}

static const qm_store_table table = {sizeof(qm_store_layout), read_row, reset_row};

qm_status qm_store_find_layout(qm_store *store, const char *id, qm_store_layout *out)
{
    return qm_store_find_row_by(store, SELECT "WHERE l.id = ?", id, &table, out);
}

qm_status qm_store_list_layouts(qm_store *store, const qm_store_page *page, const char *mesh,
                                qm_store_layout *out, size_t *count)
{
    const qm_store_listing listing = {SELECT, "l.sequence", {"l.mesh = ?"}, {mesh}};
    return qm_store_list_rows(store, &listing, page, &table, out, count);
}

qm_status qm_store_delete_layout(qm_store *store, const char *id)
{
    return qm_store_delete_row(store, "DELETE FROM layouts WHERE id = ?", id);
}

void qm_store_layout_reset(qm_store_layout *layout)
{
    free(layout->created);
    free(layout->layout);
    free(layout->issues);
    *layout = (qm_store_layout){0};
}

qm_status qm_store_find_layout_by_idempotency_key(qm_store *store, const char *key,
                                                  qm_store_idempotency_record *out)
{
    return qm_store_find_idempotency_record(
        store, "SELECT id, request FROM layouts WHERE idempotency_key = ?", key, out);
}
