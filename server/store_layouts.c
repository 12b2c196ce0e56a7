#include <stdlib.h>

#include "store_internal.h"

#define KEPT_REVISIONS 100 /* of a layout, to go back to */
#define SELECT                                                                                               \
    "SELECT l.id, l.mesh, l.created, r.layout, r.issues, l.revision, r.next_curve, l.sequence,"              \
    "  (SELECT min(revision) FROM layout_revisions WHERE id = l.id),"                                        \
    "  (SELECT max(revision) FROM layout_revisions WHERE id = l.id)"                                         \
    " FROM layouts l JOIN layout_revisions r ON r.id = l.id AND r.revision = l.revision "

/** Runs one statement of a transaction; the lock is held by qm_store_begin's caller for each. */
static bool run(qm_store *store, const char *sql, const char *id, int64_t number, int64_t other)
{
    sqlite3_stmt *statement = NULL;
    if (sqlite3_prepare_v2(store->database, sql, -1, &statement, NULL) != SQLITE_OK) return false;
    int places = sqlite3_bind_parameter_count(statement);
    if (places > 0) qm_store_bind_text(statement, 1, id);
    if (places > 1) sqlite3_bind_int64(statement, 2, number);
    if (places > 2) sqlite3_bind_int64(statement, 3, other);
    bool done = sqlite3_step(statement) == SQLITE_DONE;
    sqlite3_finalize(statement);
    return done;
}

static bool add_revision(qm_store *store, const qm_store_layout *layout, int64_t revision)
{
    sqlite3_stmt *statement = NULL;
    static const char sql[] =
        "INSERT INTO layout_revisions (id, revision, layout, issues, next_curve) VALUES (?, ?, ?, ?, ?)";
    if (sqlite3_prepare_v2(store->database, sql, -1, &statement, NULL) != SQLITE_OK) return false;
    qm_store_bind_text(statement, 1, layout->id);
    sqlite3_bind_int64(statement, 2, revision);
    qm_store_bind_text(statement, 3, layout->layout);
    qm_store_bind_text(statement, 4, layout->issues);
    sqlite3_bind_int64(statement, 5, layout->next_curve);
    bool done = sqlite3_step(statement) == SQLITE_DONE;
    sqlite3_finalize(statement);
    return done;
}

static bool add_layout(qm_store *store, const qm_store_layout *layout, const qm_store_once *once)
{
    sqlite3_stmt *statement = NULL;
    static const char sql[] = "INSERT INTO layouts (id, mesh, created, revision, idempotency_key, request) "
                              "VALUES (?, ?, ?, 0, ?, ?)";
    if (sqlite3_prepare_v2(store->database, sql, -1, &statement, NULL) != SQLITE_OK) return false;
    qm_store_bind_text(statement, 1, layout->id);
    qm_store_bind_text(statement, 2, layout->mesh);
    qm_store_bind_text(statement, 3, layout->created);
    qm_store_bind_text(statement, 4, once->key);
    qm_store_bind_text(statement, 5, once->request);
    bool done = sqlite3_step(statement) == SQLITE_DONE;
    sqlite3_finalize(statement);
    return done && add_revision(store, layout, 0);
}

/** Ends the transaction one way or the other. */
static bool close_transaction(qm_store *store, bool good)
{
    good = good && run(store, "COMMIT", NULL, 0, 0);
    if (!good) run(store, "ROLLBACK", NULL, 0, 0);
    return good;
}

qm_status qm_store_put_layout(qm_store *store, const qm_store_layout *layout, const qm_store_once *once)
{
    pthread_mutex_lock(&store->lock);
    bool good = run(store, "BEGIN IMMEDIATE", NULL, 0, 0) &&
                close_transaction(store, add_layout(store, layout, once));
    pthread_mutex_unlock(&store->lock);
    return good ? QM_OK : QM_E_ARGUMENT;
}

/** Makes `to` the current revision if `from` still is; *moved tells. */
static bool move(qm_store *store, const char *id, int64_t from, int64_t to, bool *moved)
{
    bool good = run(store, "UPDATE layouts SET revision = ?3 WHERE id = ?1 AND revision = ?2", id, from, to);
    *moved = good && sqlite3_changes(store->database) == 1;
    return good;
}

qm_status qm_store_edit_layout(qm_store *store, const qm_store_layout *layout)
{
    int64_t next = layout->revision + 1;
    bool moved = false;
    pthread_mutex_lock(&store->lock);
    bool good = run(store, "BEGIN IMMEDIATE", NULL, 0, 0);
    if (good) {
        good = run(store, "DELETE FROM layout_revisions WHERE id = ?1 AND (revision > ?2 OR revision < ?3)",
                   layout->id, layout->revision, next - KEPT_REVISIONS) &&
               add_revision(store, layout, next) && move(store, layout->id, layout->revision, next, &moved);
        good = close_transaction(store, good && moved);
    }
    pthread_mutex_unlock(&store->lock);
    return good ? QM_OK : moved ? QM_E_ARGUMENT : QM_E_CANCELED;
}

qm_status qm_store_move_layout(qm_store *store, const char *id, int64_t from, int64_t to)
{
    bool moved = false;
    pthread_mutex_lock(&store->lock);
    bool good = move(store, id, from, to, &moved);
    pthread_mutex_unlock(&store->lock);
    return !good ? QM_E_ARGUMENT : moved ? QM_OK : QM_E_CANCELED;
}

static bool read_row(sqlite3_stmt *statement, void *row)
{
    qm_store_layout *out = row;
    *out = (qm_store_layout){.revision = sqlite3_column_int64(statement, 5),
                             .next_curve = sqlite3_column_int64(statement, 6),
                             .sequence = sqlite3_column_int64(statement, 7),
                             .first = sqlite3_column_int64(statement, 8),
                             .latest = sqlite3_column_int64(statement, 9)};
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

qm_status qm_store_list_layouts(qm_store *store, int64_t after, size_t limit, qm_store_layout *out,
                                size_t *count)
{
    return qm_store_list_rows(store, SELECT "WHERE l.sequence > ? ORDER BY l.sequence LIMIT ?", after, limit,
                              &table, out, count);
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
