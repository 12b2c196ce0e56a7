/**
 * store_postgres_layouts.c: layouts with their revisions. The row of a layout says which revisions are kept; rows of
 * others may be left over from edits that were undone, until an edit writes them again.
 */
#include <stdlib.h>
#include <string.h>

#include "store_postgres.h"

#define KEPT_REVISIONS "100" /* of a layout, to go back to */
#define SELECT                                                                                               \
    "SELECT " QM_POSTGRES_LAYOUT_COLUMNS " FROM quadmeshd.layouts l"                                         \
    "  JOIN quadmeshd.layout_revisions r ON r.id = l.id AND r.revision = l.revision"

static const char has_layout[] = "SELECT 1 FROM quadmeshd.layouts WHERE id = $1";

qm_stored qm_postgres_put_layout(qm_store *store, const qm_store_layout *layout,
                                 const qm_store_idempotency *idempotency)
{
    qm_postgres_query query = {
        .sql =
            "WITH made AS (INSERT INTO quadmeshd.layouts"
            "   (id, mesh, created, revision, first, latest, idempotency_key, request)"
            "   VALUES ($1, $2, $3, 0, 0, 0, $4, $5) ON CONFLICT DO NOTHING RETURNING id)"
            " INSERT INTO quadmeshd.layout_revisions (id, revision, layout, issues, next_curve, is_complete)"
            "  SELECT id, 0, $6::text, $7::text, $8::bigint, $9::bool FROM made RETURNING 1"};
    qm_postgres_add_text(&query, layout->id);
    qm_postgres_add_text(&query, layout->mesh);
    qm_postgres_add_text(&query, layout->created);
    qm_postgres_add_text(&query, idempotency->key);
    qm_postgres_add_text(&query, idempotency->request);
    qm_postgres_add_text(&query, layout->layout);
    qm_postgres_add_text(&query, layout->issues);
    qm_postgres_add_integer(&query, layout->next_curve);
    qm_postgres_add_bool(&query, layout->is_complete);
    return qm_postgres_create_row(store, &query, has_layout, layout->id);
}

bool qm_postgres_read_layout(const qm_postgres_rows *rows, int row, void *out)
{
    qm_store_layout *layout = out;
    *layout = (qm_store_layout){.revision = qm_postgres_integer(rows, row, 5),
                                .next_curve = qm_postgres_integer(rows, row, 6),
                                .sequence = qm_postgres_integer(rows, row, 7),
                                .first = qm_postgres_integer(rows, row, 8),
                                .latest = qm_postgres_integer(rows, row, 9),
                                .is_complete = qm_postgres_bool(rows, row, 10)};
    qm_postgres_read(rows, row, 0, layout->id, sizeof layout->id);
    qm_postgres_read(rows, row, 1, layout->mesh, sizeof layout->mesh);
    if (qm_postgres_copy(rows, row, 2, &layout->created) && qm_postgres_copy(rows, row, 3, &layout->layout) &&
        qm_postgres_copy(rows, row, 4, &layout->issues))
        return true;
    qm_store_layout_reset(layout);
    return false;
}

static void reset_row(void *row)
{
    qm_store_layout_reset(row);
}

static const qm_postgres_table table = {sizeof(qm_store_layout), qm_postgres_read_layout, reset_row};

qm_stored qm_postgres_find_layout(qm_store *store, const char *id, qm_store_layout *out)
{
    return qm_postgres_find_row_by(store, SELECT " WHERE l.id = $1", id, &table, out);
}

qm_stored qm_postgres_list_layouts(qm_store *store, const qm_store_page *page, const char *mesh,
                                   qm_store_layout *out, size_t *count)
{
    const qm_postgres_listing listing = {SELECT, "l.sequence", {"l.mesh = $"}, {mesh}, NULL};
    return qm_postgres_list_rows(store, &listing, page, &table, out, count);
}

/** After an edit that found another revision: QM_STORED when the first of two attempts has made it. */
static qm_stored explain_edit(qm_store *store, const qm_store_layout *layout)
{
    qm_store_layout now;
    qm_stored status = qm_postgres_find_layout(store, layout->id, &now);
    if (status != QM_STORED) return status == QM_STORED_NONE ? QM_STORED_LATE : status;
    bool is_done = now.revision == layout->revision + 1 && strcmp(now.layout, layout->layout) == 0;
    qm_store_layout_reset(&now);
    return is_done ? qm_postgres_confirm(store, QM_STORED) : QM_STORED_LATE;
}

qm_stored qm_postgres_edit_layout(qm_store *store, const qm_store_layout *layout)
{
    qm_postgres_query query = {
        .sql =
            "WITH moved AS (UPDATE quadmeshd.layouts SET revision = $2::bigint + 1, latest = $2::bigint + 1,"
            "   first = greatest(first, $2::bigint + 1 - " KEPT_REVISIONS ")"
            "   WHERE id = $1 AND revision = $2::bigint RETURNING id, first),"
            " dropped AS (DELETE FROM quadmeshd.layout_revisions r USING moved m"
            "   WHERE r.id = m.id AND (r.revision > $2::bigint + 1 OR r.revision < m.first))"
            " INSERT INTO quadmeshd.layout_revisions (id, revision, layout, issues, next_curve, is_complete)"
            "  SELECT id, $2::bigint + 1, $3::text, $4::text, $5::bigint, $6::bool FROM moved"
            " ON CONFLICT (id, revision) DO UPDATE SET layout = EXCLUDED.layout, issues = EXCLUDED.issues,"
            "  next_curve = EXCLUDED.next_curve, is_complete = EXCLUDED.is_complete RETURNING 1"};
    qm_postgres_add_text(&query, layout->id);
    qm_postgres_add_integer(&query, layout->revision);
    qm_postgres_add_text(&query, layout->layout);
    qm_postgres_add_text(&query, layout->issues);
    qm_postgres_add_integer(&query, layout->next_curve);
    qm_postgres_add_bool(&query, layout->is_complete);
    qm_stored status = qm_postgres_change_row(store, &query);
    if (status != QM_STORED_NONE) return status;
    return query.is_repeated ? explain_edit(store, layout) : QM_STORED_LATE;
}

qm_stored qm_postgres_move_layout(qm_store *store, const char *id, int64_t from, int64_t to)
{
    qm_postgres_query query = {.sql = "UPDATE quadmeshd.layouts SET revision = $3::bigint WHERE id = $1"
                                      " AND (revision = $2::bigint OR $4::bool AND revision = $3::bigint)"
                                      " AND $3::bigint BETWEEN first AND latest RETURNING 1"};
    qm_postgres_add_text(&query, id);
    qm_postgres_add_integer(&query, from);
    qm_postgres_add_integer(&query, to);
    qm_postgres_add_repeated(&query);
    qm_stored status = qm_postgres_change_row(store, &query);
    return status == QM_STORED_NONE ? QM_STORED_LATE : status;
}

qm_stored qm_postgres_delete_layout(qm_store *store, const char *id)
{
    return qm_postgres_delete_row(store, "DELETE FROM quadmeshd.layouts WHERE id = $1 RETURNING 1", id);
}

qm_stored qm_postgres_find_layout_by_idempotency_key(qm_store *store, const char *key,
                                                     qm_store_idempotency_record *out)
{
    return qm_postgres_find_record(
        store, "SELECT id, request FROM quadmeshd.layouts WHERE idempotency_key = $1", key, out);
}
