/**
 * store_postgres_jobs.c: rows of jobs, as they are found, listed and removed, and their arrays.
 */
#include <stdlib.h>
#include <string.h>

#include "store_postgres.h"

#define SELECT "SELECT " QM_POSTGRES_JOB_COLUMNS " FROM quadmeshd.jobs j" QM_POSTGRES_JOB_PLACES

/* Of the cleaner, among nodes: any number that nobody else in the database uses. */
#define LOCK "7019267140411326"

bool qm_postgres_read_job(const qm_postgres_rows *rows, int row, void *out)
{
    qm_store_job *job = out;
    *job = (qm_store_job){.state = (qm_job_state)qm_postgres_integer(rows, row, 5),
                          .sequence = qm_postgres_integer(rows, row, 6),
                          .restarts = qm_postgres_integer(rows, row, 8),
                          .deaths = qm_postgres_integer(rows, row, 10)};
    qm_postgres_read(rows, row, 0, job->id, sizeof job->id);
    if (qm_postgres_copy(rows, row, 1, &job->key) && qm_postgres_copy(rows, row, 2, &job->idempotency_key) &&
        qm_postgres_copy(rows, row, 3, &job->body) && qm_postgres_copy(rows, row, 4, &job->created) &&
        qm_postgres_copy(rows, row, 7, &job->document) && qm_postgres_copy(rows, row, 9, &job->result) &&
        qm_postgres_copy(rows, row, 11, &job->progress) && qm_postgres_copy(rows, row, 12, &job->labels))
        return true;
    qm_store_job_reset(job);
    return false;
}

static void reset_row(void *row)
{
    qm_store_job_reset(row);
}

static const qm_postgres_table table = {sizeof(qm_store_job), qm_postgres_read_job, reset_row};

qm_stored qm_postgres_find_job(qm_store *store, const char *id, qm_store_job *out)
{
    return qm_postgres_find_row_by(store, SELECT " WHERE j.id = $1", id, &table, out);
}

qm_stored qm_postgres_find_job_by_key(qm_store *store, const char *key, const char *revisions,
                                      qm_job_state state, qm_store_job *out)
{
    qm_postgres_query query = {.sql =
                                   SELECT " WHERE j.key = $1 AND j.revisions = $2 AND j.state = $3::smallint"
                                          " ORDER BY j.sequence DESC LIMIT 1"};
    qm_postgres_add_text(&query, key);
    qm_postgres_add_text(&query, revisions);
    qm_postgres_add_integer(&query, state);
    return qm_postgres_find_row(store, &query, &table, out);
}

qm_stored qm_postgres_find_job_by_idempotency_key(qm_store *store, const char *key, qm_store_job *out)
{
    qm_stored status =
        qm_postgres_find_row_by(store, SELECT " WHERE j.idempotency_key = $1", key, &table, out);
    if (status != QM_STORED) return status;
    status = qm_postgres_confirm(store, QM_STORED);
    if (status != QM_STORED) qm_store_job_reset(out);
    return status;
}

qm_stored qm_postgres_list_jobs(qm_store *store, const qm_store_page *page, const qm_store_job_filter *filter,
                                qm_store_job *out, size_t *count)
{
    static const char *const conditions[] = {"q.sequence IS NOT NULL", "r.sequence IS NOT NULL",
                                             "j.state = 2", "j.state = 3", "j.state = 4"};
    qm_postgres_listing listing = {
        .select = SELECT,
        .sequence = "j.sequence",
        .conditions = {"j.type = $", NULL, "strpos(j.labels, chr(10) || $ || chr(10)) > 0"},
        .values = {filter->type, NULL, filter->label}};
    if (filter->subject) { /* in the order of its index */
        listing.select = "SELECT " QM_POSTGRES_JOB_COLUMNS " FROM quadmeshd.job_subjects s"
                         " JOIN quadmeshd.jobs j ON j.sequence = s.sequence" QM_POSTGRES_JOB_PLACES;
        listing.sequence = "s.sequence";
        listing.conditions[1] = "s.subject = $";
        listing.values[1] = filter->subject;
    }
    if (filter->state) listing.condition = conditions[*filter->state];
    return qm_postgres_list_rows(store, &listing, page, &table, out, count);
}

qm_stored qm_postgres_set_job_labels(qm_store *store, const char *id, const char *labels)
{
    qm_postgres_query query = {.sql = "UPDATE quadmeshd.jobs SET labels = $2 WHERE id = $1 RETURNING 1"};
    qm_postgres_add_text(&query, id);
    qm_postgres_add_text(&query, labels);
    return qm_postgres_change_row(store, &query);
}

qm_stored qm_postgres_forget_answer(qm_store *store, const char *id)
{
    qm_postgres_query query = {
        .sql = "UPDATE quadmeshd.jobs SET revisions = '' WHERE id = $1 AND document IS NOT NULL RETURNING 1"};
    qm_postgres_add_text(&query, id);
    qm_stored status = qm_postgres_change_row(store, &query);
    return status == QM_STORED_NONE ? QM_STORED : status;
}

qm_stored qm_postgres_drop_old_jobs(qm_store *store, size_t kept, double kept_s, size_t limit,
                                    char (*ids)[QM_ID_SIZE], size_t *count)
{
    qm_postgres_query query = {
        .sql =
            "WITH cleaner AS MATERIALIZED (SELECT pg_try_advisory_xact_lock(" LOCK ") AS is_me),"
            " old AS (SELECT j.sequence FROM quadmeshd.jobs j, cleaner WHERE is_me AND j.document IS NOT NULL"
            "   AND (($2::float8 > 0 AND j.submitted < clock_timestamp() - " QM_POSTGRES_SECONDS(
                "$2") ")"
                      "     OR j.sequence <= (SELECT sequence FROM quadmeshd.jobs ORDER BY sequence DESC"
                      "       OFFSET $1::bigint LIMIT 1)) ORDER BY j.sequence LIMIT $3::bigint)"
                      " DELETE FROM quadmeshd.jobs j USING old WHERE j.sequence = old.sequence RETURNING "
                      "j.id"};
    qm_postgres_add_integer(&query, kept > INT32_MAX ? INT32_MAX : (int64_t)kept);
    qm_postgres_add_real(&query, kept_s);
    qm_postgres_add_integer(&query, limit > INT32_MAX ? INT32_MAX : (int64_t)limit);
    qm_postgres_rows rows;
    *count = 0;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    for (int i = 0; i < rows.count; i++)
        qm_postgres_read(&rows, i, 0, ids[(*count)++], QM_ID_SIZE);
    qm_postgres_free(&rows);
    return status;
}

qm_stored qm_postgres_delete_job(qm_store *store, const char *id)
{
    return qm_postgres_delete_row(store, "DELETE FROM quadmeshd.jobs WHERE id = $1 RETURNING 1", id);
}

/* ---- arrays ---- */

qm_stored qm_postgres_put_array(qm_store *store, const char *job_id, const qm_store_array *array)
{
    qm_postgres_query query = {
        .sql = "WITH blob AS (UPDATE quadmeshd.blobs SET unneeded = NULL WHERE hash = $5 AND unneeded IS NOT "
               "NULL),"
               " lease AS (SELECT r.sequence FROM quadmeshd.jobs j JOIN quadmeshd.job_runs r USING (sequence)"
               "   WHERE j.id = $1 AND r.node = $2 FOR UPDATE OF r)"
               " INSERT INTO quadmeshd.job_arrays (sequence, count, sums, hash)"
               "  SELECT sequence, $3::bigint, $4::bytea, $5::text FROM lease"
               " ON CONFLICT (sequence) DO UPDATE SET count = EXCLUDED.count, sums = EXCLUDED.sums,"
               "  hash = EXCLUDED.hash RETURNING 1"};
    char node[QM_NODE_NAME_SIZE + 16];
    qm_postgres_name_node(store, node);
    qm_postgres_add_text(&query, job_id);
    qm_postgres_add_text(&query, node);
    qm_postgres_add_integer(&query, (int64_t)array->count);
    qm_postgres_add_bytes(&query, array->sums, qm_store_array_blocks(array->count) * sizeof *array->sums);
    qm_postgres_add_text(&query, array->hash);
    qm_stored status = qm_postgres_change_row(store, &query);
    return status == QM_STORED_NONE ? QM_STORED_LOST : status;
}

static bool read_array(const qm_postgres_rows *rows, int row, void *out)
{
    qm_store_array *array = out;
    *array = (qm_store_array){.count = (uint64_t)qm_postgres_integer(rows, row, 0)};
    qm_postgres_read(rows, row, 2, array->hash, sizeof array->hash);
    size_t size = qm_postgres_size(rows, row, 1);
    if (array->count > INT64_MAX / sizeof(double) ||
        size != qm_store_array_blocks(array->count) * sizeof *array->sums)
        return true; /* without sums */
    array->sums = malloc(size + 1);
    if (array->sums && size > 0) memcpy(array->sums, qm_postgres_text(rows, row, 1), size);
    return array->sums;
}

qm_stored qm_postgres_find_array(qm_store *store, const char *job_id, qm_store_array *out)
{
    static const qm_postgres_table arrays = {sizeof(qm_store_array), read_array, NULL};
    qm_postgres_query query = {.sql = "SELECT a.count::text, a.sums, a.hash FROM quadmeshd.jobs j"
                                      " JOIN quadmeshd.job_arrays a USING (sequence) WHERE j.id = $1",
                               .is_binary = true};
    qm_postgres_add_text(&query, job_id);
    qm_stored status = qm_postgres_find_row(store, &query, &arrays, out);
    return status == QM_STORED && !out->sums ? QM_STORED_DAMAGED : status;
}
