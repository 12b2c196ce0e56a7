/**
 * store_postgres_meshes.c: rows of meshes. A foreign key keeps the blobs that they name; nobody removes these at once,
 * so that jobs on an earlier revision can still read its positions (store_postgres_blobs.c).
 */
#include <string.h>

#include "store_postgres.h"

#define COLUMNS                                                                                              \
    "id, hash, options, name, document, format, sequence, revision, positions, created,"                     \
    " to_char(expires AT TIME ZONE 'UTC', 'YYYY-MM-DD\"T\"HH24:MI:SS.MS\"Z\"'), unit, uncertainty, labels"

void qm_postgres_add_mesh(qm_postgres_query *query, const qm_store_mesh *mesh)
{
    const qm_store_mesh none = {0};
    const qm_store_mesh *row = mesh ? mesh : &none;
    qm_postgres_add_text(query, mesh ? row->id : NULL);
    qm_postgres_add_text(query, mesh ? row->hash : NULL);
    qm_postgres_add_text(query, row->options);
    qm_postgres_add_text(query, row->name);
    qm_postgres_add_text(query, row->document);
    qm_postgres_add_integer(query, row->format);
    qm_postgres_add_integer(query, (int64_t)row->revision);
    qm_postgres_add_text(query, mesh ? row->positions : NULL);
    qm_postgres_add_text(query, row->created);
    qm_postgres_add_text(query, mesh ? row->expires : NULL);
    qm_postgres_add_now(query);
    qm_postgres_add_text(query, mesh ? row->notes.unit : NULL); /* texts live until the statement has run */
    qm_postgres_add_real(query, row->notes.uncertainty);
    qm_postgres_add_text(query, row->labels ? row->labels : "");
}

static const char has_mesh[] = "SELECT 1 FROM quadmeshd.meshes WHERE id = $1";

qm_stored qm_postgres_put_mesh(qm_store *store, const qm_store_mesh *mesh)
{
    qm_postgres_query query = {.sql = "WITH " QM_POSTGRES_MESH_BLOBS
                                      " INSERT INTO quadmeshd.meshes (" QM_POSTGRES_MESH_COLUMNS
                                      ") VALUES (" QM_POSTGRES_MESH_VALUES ")"
                                      " ON CONFLICT DO NOTHING RETURNING 1"};
    qm_postgres_add_mesh(&query, mesh);
    return qm_postgres_create_row(store, &query, has_mesh, mesh->id);
}

static bool read_row(const qm_postgres_rows *rows, int row, void *out)
{
    qm_store_mesh *mesh = out;
    *mesh = (qm_store_mesh){.format = (int)qm_postgres_integer(rows, row, 5),
                            .sequence = qm_postgres_integer(rows, row, 6),
                            .revision = (uint64_t)qm_postgres_integer(rows, row, 7),
                            .notes.uncertainty = qm_postgres_real(rows, row, 12)};
    qm_postgres_read(rows, row, 0, mesh->id, sizeof mesh->id);
    qm_postgres_read(rows, row, 1, mesh->hash, sizeof mesh->hash);
    qm_postgres_read(rows, row, 8, mesh->positions, sizeof mesh->positions);
    qm_postgres_read(rows, row, 10, mesh->expires, sizeof mesh->expires);
    qm_postgres_read(rows, row, 11, mesh->notes.unit, sizeof mesh->notes.unit);
    if (qm_postgres_copy(rows, row, 2, &mesh->options) && qm_postgres_copy(rows, row, 3, &mesh->name) &&
        qm_postgres_copy(rows, row, 4, &mesh->document) && qm_postgres_copy(rows, row, 9, &mesh->created) &&
        qm_postgres_copy(rows, row, 13, &mesh->labels))
        return true;
    qm_store_mesh_reset(mesh);
    return false;
}

static void reset_row(void *row)
{
    qm_store_mesh_reset(row);
}

static const qm_postgres_table table = {sizeof(qm_store_mesh), read_row, reset_row};

qm_stored qm_postgres_find_mesh(qm_store *store, const char *id, qm_store_mesh *out)
{
    return qm_postgres_find_row_by(store, "SELECT " COLUMNS " FROM quadmeshd.meshes WHERE id = $1", id,
                                   &table, out);
}

/** Asks about an array of texts. The first column of the rows is the place of one, from 1. */
static qm_stored ask_for_all(qm_store *store, const char *sql, const char *const *texts, size_t count,
                             qm_postgres_rows *rows)
{
    qm_postgres_query query = {.sql = sql};
    qm_text array = {0};
    for (size_t i = 0; i < count; i++)
        qm_postgres_write_text(&array, texts[i]);
    qm_postgres_add_array(&query, &array);
    qm_stored status = qm_postgres_run(store, &query, rows);
    qm_text_reset(&array);
    return status;
}

qm_stored qm_postgres_find_mesh_states(qm_store *store, const char *const *ids, size_t count,
                                       qm_store_mesh_state *out)
{
    qm_postgres_rows rows;
    qm_stored status =
        ask_for_all(store,
                    "SELECT a.n, m.revision, m.uncertainty, m.format, m.unit, m.hash, m.positions"
                    " FROM unnest($1::text[]) WITH ORDINALITY AS a(id, n)"
                    " JOIN quadmeshd.meshes m ON m.id = a.id",
                    ids, count, &rows);
    for (int row = 0; row < rows.count; row++) {
        qm_store_mesh_state *state = &out[qm_postgres_integer(&rows, row, 0) - 1];
        *state = (qm_store_mesh_state){.is_found = true,
                                       .revision = (uint64_t)qm_postgres_integer(&rows, row, 1),
                                       .notes.uncertainty = qm_postgres_real(&rows, row, 2),
                                       .format = (int)qm_postgres_integer(&rows, row, 3)};
        qm_postgres_read(&rows, row, 4, state->notes.unit, sizeof state->notes.unit);
        qm_postgres_read(&rows, row, 5, state->hash, sizeof state->hash);
        qm_postgres_read(&rows, row, 6, state->positions, sizeof state->positions);
    }
    qm_postgres_free(&rows);
    return status;
}

qm_stored qm_postgres_find_undeformed(qm_store *store, const char *const *hashes, size_t count,
                                      char (*ids)[QM_ID_SIZE])
{
    qm_postgres_rows rows;
    qm_stored status = ask_for_all(store,
                                   "SELECT DISTINCT ON (a.n) a.n, m.id"
                                   " FROM unnest($1::text[]) WITH ORDINALITY AS a(hash, n)"
                                   " JOIN quadmeshd.meshes m ON m.hash = a.hash WHERE m.revision = 0"
                                   " ORDER BY a.n, m.sequence DESC",
                                   hashes, count, &rows);
    for (int row = 0; row < rows.count; row++)
        qm_postgres_read(&rows, row, 1, ids[qm_postgres_integer(&rows, row, 0) - 1], QM_ID_SIZE);
    qm_postgres_free(&rows);
    return status;
}

qm_stored qm_postgres_find_mesh_by_content(qm_store *store, const char *hash, const char *options,
                                           qm_store_mesh *out)
{
    qm_postgres_query query = {.sql = "SELECT " COLUMNS
                                      " FROM quadmeshd.meshes WHERE hash = $1 AND options = $2"};
    qm_postgres_add_text(&query, hash);
    qm_postgres_add_text(&query, options);
    return qm_postgres_find_row(store, &query, &table, out);
}

qm_stored qm_postgres_list_meshes(qm_store *store, const qm_store_page *page,
                                  const qm_store_mesh_filter *filter, qm_store_mesh *out, size_t *count)
{
    const qm_postgres_listing listing = {
        "SELECT " COLUMNS " FROM quadmeshd.meshes",
        "sequence",
        {"name = $", "hash = $", "strpos(labels, chr(10) || $ || chr(10)) > 0"},
        {filter->name, filter->hash, filter->label},
        NULL};
    return qm_postgres_list_rows(store, &listing, page, &table, out, count);
}

/** Why a mesh is not at the revision before that of `mesh`: this one may have been stored by an equal call. */
static qm_stored explain_revision(qm_store *store, const qm_store_mesh *mesh)
{
    qm_store_mesh now;
    qm_stored status = qm_postgres_find_mesh(store, mesh->id, &now);
    if (status != QM_STORED) return status;
    bool is_done = now.revision == mesh->revision && strcmp(now.positions, mesh->positions) == 0;
    qm_store_mesh_reset(&now);
    return is_done ? qm_postgres_confirm(store, QM_STORED) : QM_STORED_LATE;
}

qm_stored qm_postgres_revise_mesh(qm_store *store, const qm_store_mesh *mesh)
{
    qm_postgres_query query = {
        .sql = "WITH blob AS (UPDATE quadmeshd.blobs SET unneeded = NULL"
               "   WHERE hash = $3 AND unneeded IS NOT NULL)"
               " UPDATE quadmeshd.meshes SET revision = $2::bigint, positions = nullif($3, ''), options = $4,"
               "  document = $5 WHERE id = $1 AND revision = $2::bigint - 1 RETURNING 1"};
    qm_postgres_add_text(&query, mesh->id);
    qm_postgres_add_integer(&query, (int64_t)mesh->revision);
    qm_postgres_add_text(&query, mesh->positions);
    qm_postgres_add_text(&query, mesh->options);
    qm_postgres_add_text(&query, mesh->document);
    qm_stored status = qm_postgres_change_row(store, &query);
    return status == QM_STORED_NONE ? explain_revision(store, mesh) : status;
}

qm_stored qm_postgres_set_notes(qm_store *store, const qm_store_mesh *mesh)
{
    qm_postgres_query query = {
        .sql = "UPDATE quadmeshd.meshes SET unit = $2, uncertainty = $3::float8, labels = $4,"
               " options = $5 WHERE id = $1 RETURNING 1"};
    qm_postgres_add_text(&query, mesh->id);
    qm_postgres_add_text(&query, mesh->notes.unit);
    qm_postgres_add_real(&query, mesh->notes.uncertainty);
    qm_postgres_add_text(&query, mesh->labels ? mesh->labels : "");
    qm_postgres_add_text(&query, mesh->options);
    return qm_postgres_change_row(store, &query);
}

qm_stored qm_postgres_set_expiry(qm_store *store, const char *id, const char *expires)
{
    qm_postgres_query query = {.sql = "UPDATE quadmeshd.meshes SET expires = " QM_POSTGRES_TIME(
                                   "nullif($2::text, '')", "$3::text") " WHERE id = $1 RETURNING 1"};
    qm_postgres_add_text(&query, id);
    qm_postgres_add_text(&query, expires);
    qm_postgres_add_now(&query);
    return qm_postgres_change_row(store, &query);
}

qm_stored qm_postgres_find_expired_mesh(qm_store *store, const char *before, qm_store_mesh *out)
{
    qm_postgres_query query = {
        .sql = "SELECT " COLUMNS " FROM quadmeshd.meshes m WHERE expires < " QM_POSTGRES_TIME(
            "$1::text",
            "$2::text") "  AND NOT EXISTS (SELECT FROM quadmeshd.job_subjects s JOIN quadmeshd.jobs j USING "
                        "(sequence)"
                        "    WHERE s.subject = m.id AND j.state = 0)"
                        "  AND NOT EXISTS (SELECT FROM quadmeshd.layouts l WHERE l.mesh = m.id)"
                        "  AND NOT EXISTS (SELECT FROM quadmeshd.reconstructions r WHERE r.source = m.id)"
                        "  AND NOT EXISTS (SELECT FROM quadmeshd.reconstructions r WHERE r.mesh = m.id)"
                        "  ORDER BY expires LIMIT 1"};
    qm_postgres_add_text(&query, before);
    qm_postgres_add_now(&query);
    return qm_postgres_find_row(store, &query, &table, out);
}

qm_stored qm_postgres_delete_mesh(qm_store *store, const char *id)
{
    return qm_postgres_delete_row(store, "DELETE FROM quadmeshd.meshes WHERE id = $1 RETURNING 1", id);
}
