/**
 * store_postgres_reconstructions.c: rows of reconstructions.
 */
#include <stdlib.h>
#include <string.h>

#include "store_postgres.h"

#define COLUMNS                                                                                              \
    "id, source, layout_id, mesh, layout, document, steps, records, state, revision, sequence, cover_share," \
    " pull_curves"

/** Why nothing was stored, as one of two rows was there: one of an equal call, of the key, or of the mesh's content. */
static qm_stored explain_conflict(qm_store *store, const qm_store_reconstruction *r,
                                  const qm_store_idempotency *idempotency)
{
    qm_postgres_query query = {
        .sql = "SELECT id = $1 FROM quadmeshd.reconstructions WHERE id = $1 OR idempotency_key = $2"
               " ORDER BY 1 DESC"};
    qm_postgres_add_text(&query, r->id);
    qm_postgres_add_text(&query, idempotency->key);
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    if (status == QM_STORED && rows.count == 0)
        status = QM_STORED_LATE;
    else if (status == QM_STORED)
        status = qm_postgres_confirm(store, qm_postgres_bool(&rows, 0, 0) ? QM_STORED : QM_STORED_TAKEN);
    qm_postgres_free(&rows);
    return status;
}

qm_stored qm_postgres_put_reconstruction(qm_store *store, const qm_store_reconstruction *r,
                                         const qm_store_mesh *mesh, const qm_store_idempotency *idempotency)
{
    qm_postgres_query query = {
        .sql = "WITH " QM_POSTGRES_MESH_BLOBS ","
               " mesh AS (INSERT INTO quadmeshd.meshes (" QM_POSTGRES_MESH_COLUMNS
               ")   SELECT " QM_POSTGRES_MESH_VALUES " WHERE $1::text IS NOT NULL)"
               " INSERT INTO quadmeshd.reconstructions (id, source, layout_id, mesh, layout, document, steps,"
               "  records, state, revision, cover_share, pull_curves, idempotency_key, request)"
               " VALUES ($15, $16, $17, $18, $19, $20, $21, $22, $23, $24, $25, $26, $27, $28)"};
    const char *const texts[] = {r->id,       r->source, r->layout_id, r->mesh, r->layout,
                                 r->document, r->steps,  r->records,   r->state};
    qm_postgres_add_mesh(&query, mesh);
    for (int i = 0; i < 9; i++)
        qm_postgres_add_text(&query, texts[i]);
    qm_postgres_add_integer(&query, r->revision);
    qm_postgres_add_real(&query, r->cover_share);
    qm_postgres_add_bool(&query, r->pull_curves);
    qm_postgres_add_text(&query, idempotency->key);
    qm_postgres_add_text(&query, idempotency->request);
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    qm_postgres_free(&rows);
    return status == QM_STORED_TAKEN ? explain_conflict(store, r, idempotency) : status;
}

void qm_postgres_add_effect(qm_postgres_query *query, const qm_store_effect *effect)
{
    bool has_next = effect && effect->next;
    const qm_store_reconstruction none = {0}, *r = has_next ? effect->next : &none;
    qm_postgres_add_mesh(query, effect ? effect->mesh : NULL);
    qm_postgres_add_text(query, has_next ? r->id : NULL);
    qm_postgres_add_integer(query, r->revision);
    qm_postgres_add_text(query, has_next ? r->mesh : NULL);
    qm_postgres_add_text(query, r->layout);
    qm_postgres_add_text(query, r->steps);
    qm_postgres_add_text(query, r->records);
    qm_postgres_add_text(query, r->state);
}

static bool read_row(const qm_postgres_rows *rows, int row, void *out)
{
    qm_store_reconstruction *r = out;
    *r = (qm_store_reconstruction){.revision = qm_postgres_integer(rows, row, 9),
                                   .sequence = qm_postgres_integer(rows, row, 10),
                                   .cover_share = qm_postgres_real(rows, row, 11),
                                   .pull_curves = qm_postgres_bool(rows, row, 12)};
    qm_postgres_read(rows, row, 0, r->id, sizeof r->id);
    qm_postgres_read(rows, row, 1, r->source, sizeof r->source);
    qm_postgres_read(rows, row, 2, r->layout_id, sizeof r->layout_id);
    qm_postgres_read(rows, row, 3, r->mesh, sizeof r->mesh);
    if (qm_postgres_copy(rows, row, 4, &r->layout) && qm_postgres_copy(rows, row, 5, &r->document) &&
        qm_postgres_copy(rows, row, 6, &r->steps) && qm_postgres_copy(rows, row, 7, &r->records) &&
        qm_postgres_copy(rows, row, 8, &r->state))
        return true;
    qm_store_reconstruction_reset(r);
    return false;
}

static void reset_row(void *row)
{
    qm_store_reconstruction_reset(row);
}

static const qm_postgres_table table = {sizeof(qm_store_reconstruction), read_row, reset_row};

qm_stored qm_postgres_find_reconstruction(qm_store *store, const char *id, qm_store_reconstruction *out)
{
    return qm_postgres_find_row_by(store, "SELECT " COLUMNS " FROM quadmeshd.reconstructions WHERE id = $1",
                                   id, &table, out);
}

qm_stored qm_postgres_list_reconstructions(qm_store *store, const qm_store_page *page, const char *source,
                                           qm_store_reconstruction *out, size_t *count)
{
    const qm_postgres_listing listing = {
        "SELECT " COLUMNS " FROM quadmeshd.reconstructions", "sequence", {"source = $"}, {source}, NULL};
    return qm_postgres_list_rows(store, &listing, page, &table, out, count);
}

/** After an update that found another revision: QM_STORED when the first of two attempts has made it. */
static qm_stored explain_update(qm_store *store, const qm_store_reconstruction *next)
{
    qm_store_reconstruction now;
    qm_stored status = qm_postgres_find_reconstruction(store, next->id, &now);
    if (status != QM_STORED) return status == QM_STORED_NONE ? QM_STORED_LATE : status;
    bool is_done = now.revision == next->revision && strcmp(now.mesh, next->mesh) == 0 &&
                   strcmp(now.steps, next->steps) == 0 && strcmp(now.state, next->state) == 0;
    qm_store_reconstruction_reset(&now);
    return is_done ? qm_postgres_confirm(store, QM_STORED) : QM_STORED_LATE;
}

qm_stored qm_postgres_update_reconstruction(qm_store *store, const qm_store_effect *effect)
{
    qm_postgres_query query = {.sql = "WITH " QM_POSTGRES_EFFECT_TARGET ", ready AS (SELECT id FROM target),"
                                      " " QM_POSTGRES_EFFECT " SELECT 1 FROM ready"};
    qm_postgres_add_effect(&query, effect);
    qm_stored status = qm_postgres_change_row(store, &query);
    bool is_late = status == QM_STORED_NONE || status == QM_STORED_TAKEN; /* or the mesh's content is */
    if (!is_late) return status;
    return query.is_repeated ? explain_update(store, effect->next) : QM_STORED_LATE;
}

qm_stored qm_postgres_delete_reconstruction(qm_store *store, const char *id)
{
    return qm_postgres_delete_row(store, "DELETE FROM quadmeshd.reconstructions WHERE id = $1 RETURNING 1",
                                  id);
}

qm_stored qm_postgres_find_reconstruction_by_idempotency_key(qm_store *store, const char *key,
                                                             qm_store_idempotency_record *out)
{
    return qm_postgres_find_record(
        store, "SELECT id, request FROM quadmeshd.reconstructions WHERE idempotency_key = $1", key, out);
}
