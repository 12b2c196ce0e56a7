/**
 * store_postgres_copy.c: rows of a shared store as copies: all that it has of them, read for another store and written
 * from one. Copies of jobs are many, so their commits wait for no disk; qm_postgres_sync makes them durable at the end.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "store_postgres.h"

/* ---- jobs ---- */

static bool read_job_copy(const qm_postgres_rows *rows, int row, void *out)
{
    qm_store_job_copy *copy = out;
    *copy = (qm_store_job_copy){.claims = qm_postgres_integer(rows, row, 15)};
    if (!qm_postgres_read_job(rows, row, &copy->job)) return false;
    copy->job.is_canceled = !copy->job.document && qm_postgres_bool(rows, row, 17);
    if (qm_postgres_copy(rows, row, 13, &copy->type) && qm_postgres_copy(rows, row, 14, &copy->revisions) &&
        qm_postgres_copy(rows, row, 16, &copy->subjects))
        return true;
    qm_store_job_copy_reset(copy);
    return false;
}

static void reset_job_copy(void *row)
{
    qm_store_job_copy_reset(row);
}

qm_stored qm_postgres_list_job_copies(qm_store *store, const qm_store_page *page, qm_store_job_copy *out,
                                      size_t *count)
{
    static const qm_postgres_table table = {sizeof(qm_store_job_copy), read_job_copy, reset_job_copy};
    const qm_postgres_listing listing = {
        .select = "SELECT " QM_POSTGRES_JOB_COLUMNS ", j.type, j.revisions,"
                  " CASE WHEN j.document IS NULL THEN coalesce(r.epoch, q.epoch, 0) ELSE j.restarts + 1 END,"
                  " s.subjects, j.cancel FROM quadmeshd.jobs j" QM_POSTGRES_JOB_PLACES
                  " LEFT JOIN LATERAL (SELECT string_agg(subject, ' ' ORDER BY subject) AS subjects FROM "
                  "quadmeshd.job_subjects"
                  "   WHERE sequence = j.sequence) s ON true",
        .sequence = "j.sequence"};
    return qm_postgres_list_rows(store, &listing, page, &table, out, count);
}

/** When the job was submitted, by the clock of the database. */
#define SUBMITTED QM_POSTGRES_TIME("$5", "$12::text")

/** The parameters 1 to 14: the row of the job, and of its queue. A job without a document waits. */
static void add_job(qm_postgres_query *query, const qm_store_job_copy *copy)
{
    const qm_store_job *job = &copy->job;
    qm_postgres_add_text(query, job->id);
    qm_postgres_add_text(query, job->key);
    qm_postgres_add_text(query, job->idempotency_key);
    qm_postgres_add_text(query, job->body);
    qm_postgres_add_text(query, job->created);
    qm_postgres_add_text(query, copy->type);
    qm_postgres_add_text(query, job->document);
    qm_postgres_add_text(query, job->result);
    qm_postgres_add_text(query, copy->revisions);
    qm_postgres_add_integer(query, job->document ? job->state : QM_JOB_QUEUED);
    qm_postgres_add_integer(query, job->document && copy->claims > 0 ? copy->claims - 1 : 0);
    qm_postgres_add_now(query);
    qm_postgres_add_integer(query, copy->claims);
    qm_postgres_add_integer(query, job->deaths);
}

qm_stored qm_postgres_put_job_copy(qm_store *store, const qm_store_job_copy *copy,
                                   const qm_store_event *events, size_t count, const qm_store_array *array)
{
    qm_postgres_query query = {
        .sql =
            "WITH " QM_POSTGRES_RELAXED ","
            " blob AS (UPDATE quadmeshd.blobs SET unneeded = NULL WHERE hash = $21 AND unneeded IS NOT NULL),"
            " made AS (INSERT INTO quadmeshd.jobs (id, key, idempotency_key, body, created, type, document,"
            "     result, revisions, state, restarts, submitted, owners, kept, cancel, labels)"
            "   SELECT $1::text, $2::text, $3::text, $4::text, $5::text, $6::text, $7::text, $8::text,"
            "     $9::text, $10::smallint, $11::int, " SUBMITTED ", 0, true, $22::boolean, $23::text"
            "   FROM relaxed WHERE mode = 'off' ON CONFLICT DO NOTHING RETURNING sequence),"
            " queued AS (INSERT INTO quadmeshd.job_queue (sequence, home, epoch, deaths)"
            "   SELECT sequence, '', $13::int, $14::int FROM made WHERE $7::text IS NULL),"
            " named AS (INSERT INTO quadmeshd.job_subjects (sequence, subject)"
            "   SELECT sequence, subject FROM made, unnest($15::text[]) AS s(subject)),"
            " told AS (INSERT INTO quadmeshd.job_events (sequence, seq, name, members)"
            "   SELECT sequence, e.seq, e.name, e.members FROM made,"
            "     unnest($16::bigint[], $17::text[], $18::text[]) AS e(seq, name, members)),"
            " kept AS (INSERT INTO quadmeshd.job_arrays (sequence, count, sums, hash)"
            "   SELECT sequence, $19::bigint, $20::bytea, $21::text FROM made WHERE $21::text IS NOT NULL)"
            " SELECT sequence FROM made",
        .is_relaxed = true};
    qm_postgres_events arrays = {0};
    qm_text subjects = {0};
    qm_postgres_write_subjects(&subjects, copy->subjects);
    qm_postgres_write_events(&arrays, events, count);
    add_job(&query, copy);
    qm_postgres_add_array(&query, &subjects);
    qm_postgres_add_events(&query, &arrays);
    qm_postgres_add_integer(&query, array ? (int64_t)array->count : 0);
    qm_postgres_add_bytes(&query, array ? array->sums : NULL,
                          array ? qm_store_array_blocks(array->count) * sizeof *array->sums : 0);
    qm_postgres_add_text(&query, array ? array->hash : NULL);
    qm_postgres_add_bool(&query, copy->job.is_canceled);
    qm_postgres_add_text(&query, copy->job.labels ? copy->job.labels : "");
    qm_stored status =
        qm_postgres_create_row(store, &query, "SELECT 1 FROM quadmeshd.jobs WHERE id = $1", copy->job.id);
    qm_text_reset(&subjects);
    qm_postgres_events_reset(&arrays);
    return status;
}

/* ---- layouts ---- */

static void reset_layout(void *row)
{
    qm_store_layout_reset(row);
}

qm_stored qm_postgres_list_layout_revisions(qm_store *store, const char *id, const qm_store_page *page,
                                            qm_store_layout *out, size_t *count)
{
    static const qm_postgres_table table = {sizeof(qm_store_layout), qm_postgres_read_layout, reset_layout};
    const qm_postgres_listing listing = {"SELECT " QM_POSTGRES_LAYOUT_COLUMNS " FROM quadmeshd.layouts l"
                                         " JOIN quadmeshd.layout_revisions r ON r.id = l.id"
                                         "   AND r.revision BETWEEN l.first AND l.latest",
                                         "r.revision",
                                         {"l.id = $"},
                                         {id},
                                         NULL};
    return qm_postgres_list_rows(store, &listing, page, &table, out, count);
}

/** The revisions of a layout as arrays of their columns. */
typedef struct revision_arrays {
    qm_text revisions, layouts, issues, next_curves, are_complete;
} revision_arrays;

static void write_revisions(revision_arrays *arrays, const qm_store_layout *revisions, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        qm_postgres_write_integer(&arrays->revisions, revisions[i].revision);
        qm_postgres_write_text(&arrays->layouts, revisions[i].layout);
        qm_postgres_write_text(&arrays->issues, revisions[i].issues);
        qm_postgres_write_integer(&arrays->next_curves, revisions[i].next_curve);
        qm_postgres_write_integer(&arrays->are_complete, revisions[i].is_complete);
    }
}

qm_stored qm_postgres_put_layout_copy(qm_store *store, const qm_store_layout *revisions, size_t count,
                                      int64_t current, const qm_store_idempotency *idempotency)
{
    qm_postgres_query query = {
        .sql =
            "WITH made AS (INSERT INTO quadmeshd.layouts"
            "   (id, mesh, created, revision, first, latest, idempotency_key, request)"
            "   VALUES ($1, $2, $3, $4::bigint, $5::bigint, $6::bigint, $7, $8)"
            "   ON CONFLICT DO NOTHING RETURNING id)"
            " INSERT INTO quadmeshd.layout_revisions (id, revision, layout, issues, next_curve, is_complete)"
            "  SELECT id, revision, layout, issues, next_curve, is_complete = 1 FROM made,"
            "   unnest($9::bigint[], $10::text[], $11::text[], $12::bigint[], $13::int[])"
            "     AS r(revision, layout, issues, next_curve, is_complete) RETURNING 1"};
    revision_arrays arrays = {0};
    write_revisions(&arrays, revisions, count);
    qm_postgres_add_text(&query, revisions->id);
    qm_postgres_add_text(&query, revisions->mesh);
    qm_postgres_add_text(&query, revisions->created);
    qm_postgres_add_integer(&query, current);
    qm_postgres_add_integer(&query, revisions[0].revision);
    qm_postgres_add_integer(&query, revisions[count - 1].revision);
    qm_postgres_add_text(&query, idempotency->key);
    qm_postgres_add_text(&query, idempotency->request);
    qm_postgres_add_array(&query, &arrays.revisions);
    qm_postgres_add_array(&query, &arrays.layouts);
    qm_postgres_add_array(&query, &arrays.issues);
    qm_postgres_add_array(&query, &arrays.next_curves);
    qm_postgres_add_array(&query, &arrays.are_complete);
    qm_stored status =
        qm_postgres_create_row(store, &query, "SELECT 1 FROM quadmeshd.layouts WHERE id = $1", revisions->id);
    qm_text_reset(&arrays.revisions);
    qm_text_reset(&arrays.layouts);
    qm_text_reset(&arrays.issues);
    qm_text_reset(&arrays.next_curves);
    qm_text_reset(&arrays.are_complete);
    return status;
}

/* ---- the rest ---- */

static bool read_origin(const qm_postgres_rows *rows, int row, void *out)
{
    qm_store_origin *origin = out;
    qm_postgres_read(rows, row, 1, origin->request, sizeof origin->request);
    return qm_postgres_copy(rows, row, 0, &origin->key);
}

static const qm_postgres_table origins = {sizeof(qm_store_origin), read_origin, NULL};

qm_stored qm_postgres_find_layout_origin(qm_store *store, const char *id, qm_store_origin *out)
{
    return qm_postgres_find_row_by(
        store, "SELECT idempotency_key, request FROM quadmeshd.layouts WHERE id = $1", id, &origins, out);
}

qm_stored qm_postgres_find_reconstruction_origin(qm_store *store, const char *id, qm_store_origin *out)
{
    return qm_postgres_find_row_by(
        store, "SELECT idempotency_key, request FROM quadmeshd.reconstructions WHERE id = $1", id, &origins,
        out);
}

qm_stored qm_postgres_identify(qm_store *store, char out[QM_STORE_IDENTITY_SIZE])
{
    qm_postgres_query query = {
        .sql =
            "SELECT format('%s %s %s', c.system_identifier, d.oid, n.oid)" /* tables made anew are others */
            " FROM pg_catalog.pg_control_system() c, pg_catalog.pg_database d, pg_catalog.pg_namespace n"
            " WHERE d.datname = current_database() AND n.nspname = 'quadmeshd'"};
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    if (status == QM_STORED) qm_postgres_read(&rows, 0, 0, out, QM_STORE_IDENTITY_SIZE);
    qm_postgres_free(&rows);
    return status;
}

qm_stored qm_postgres_sync(qm_store *store)
{
    return qm_postgres_confirm(store, QM_STORED);
}
