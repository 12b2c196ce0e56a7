/**
 * store_postgres_parts.c: rows of searches in parts, which the nodes share.
 *
 * A part is free unless a node has it that takes work: so parts of a node that leaves, or is declared dead, are free in
 * the same moment as its jobs are. A claim that a node has made without hearing the answer is its own, and so free for it.
 */
#include <stdlib.h>
#include <string.h>

#include "store_postgres.h"

/** A condition on job_parts p: the node of this parameter may claim it. */
#define IS_FREE(node)                                                                                        \
    "(p.node IS NULL OR p.node = " node                                                                      \
    " OR NOT EXISTS (SELECT FROM quadmeshd.nodes n WHERE n.id = p.node AND n.state = 0))"

/** Inserts the parts of the parameters from `first` on for the sequence of a member of WITH. */
#define INSERT_PARTS(from, upper, start, size, bytes)                                                        \
    "INSERT INTO quadmeshd.job_parts (sequence, upper, entries)"                                             \
    " SELECT r.sequence, a.upper, substring(" bytes "::bytea FROM a.start FOR a.size) FROM " from            \
    " r, unnest(" upper "::float8[], " start "::int[], " size "::int[])"                                     \
    " AS a(upper, start, size)"

/** Parts as arrays, and their entries one after the other. */
typedef struct part_arrays {
    qm_text uppers, starts, sizes, entries;
} part_arrays;

static void add_parts(qm_postgres_query *query, part_arrays *arrays, const qm_store_part *parts, size_t count)
{
    char number[QM_NUMBER_SIZE];
    for (size_t i = 0; i < count; i++) {
        qm_text_number(parts[i].upper, number);
        qm_postgres_write_text(&arrays->uppers, number);
        qm_postgres_write_integer(&arrays->starts, (int64_t)arrays->entries.size + 1);
        qm_postgres_write_integer(&arrays->sizes, (int64_t)parts[i].size);
        qm_text_add(&arrays->entries, parts[i].entries, parts[i].size);
    }
    query->failed |= arrays->entries.failed;
    qm_postgres_add_array(query, &arrays->uppers);
    qm_postgres_add_array(query, &arrays->starts);
    qm_postgres_add_array(query, &arrays->sizes);
    qm_postgres_add_bytes(query, arrays->entries.data ? arrays->entries.data : "", arrays->entries.size);
}

static void reset_parts(part_arrays *arrays)
{
    qm_text_reset(&arrays->uppers);
    qm_text_reset(&arrays->starts);
    qm_text_reset(&arrays->sizes);
    qm_text_reset(&arrays->entries);
}

static void add_found(qm_postgres_query *query, const qm_store_bounds *found)
{
    qm_postgres_add_real(query, found->discarded);
    qm_postgres_add_real(query, found->lower);
    qm_postgres_add_text(query, found->witness);
    qm_postgres_add_integer(query, (int64_t)found->iterations);
    qm_postgres_add_integer(query, (int64_t)found->projections);
}

qm_stored qm_postgres_open_parts(qm_store *store, const char *job, int64_t restarts,
                                 const qm_store_bounds *bounds, const qm_store_part *parts, size_t count)
{
    qm_postgres_query query = {
        .sql =
            "WITH lease AS (SELECT r.sequence FROM quadmeshd.jobs j JOIN quadmeshd.job_runs r USING "
            "(sequence)"
            "   WHERE j.id = $1 AND r.node = $2 AND r.epoch = $3::int + 1 FOR UPDATE OF r),"
            " old AS (DELETE FROM quadmeshd.job_parts p USING lease, quadmeshd.job_bounds b"
            "   WHERE p.sequence = lease.sequence AND b.sequence = lease.sequence AND b.engine <> $9),"
            " made AS (INSERT INTO quadmeshd.job_bounds AS b"
            "   (sequence, discarded, lower, witness, iterations, projections, engine)"
            "   SELECT sequence, $4::float8, $5::float8, $6::text, $7::bigint, $8::bigint, $9::text FROM "
            "lease"
            "   ON CONFLICT (sequence) DO UPDATE SET discarded = EXCLUDED.discarded, lower = EXCLUDED.lower,"
            "     witness = EXCLUDED.witness, iterations = EXCLUDED.iterations,"
            "     projections = EXCLUDED.projections, engine = EXCLUDED.engine"
            "   WHERE b.engine <> EXCLUDED.engine RETURNING sequence),"
            " added AS (" INSERT_PARTS("made", "$10", "$11", "$12", "$13") ")"
                                                                           " SELECT 1 FROM lease"};
    char node[QM_NODE_NAME_SIZE + 16];
    part_arrays arrays = {0};
    qm_postgres_name_node(store, node);
    qm_postgres_add_text(&query, job);
    qm_postgres_add_text(&query, node);
    qm_postgres_add_integer(&query, restarts);
    add_found(&query, bounds);
    qm_postgres_add_text(&query, bounds->engine);
    add_parts(&query, &arrays, parts, count);
    qm_stored status = qm_postgres_change_row(store, &query);
    reset_parts(&arrays);
    return status == QM_STORED_NONE ? QM_STORED_LOST : status;
}

static bool read_part(const qm_postgres_rows *rows, int row, qm_store_part *out)
{
    *out = (qm_store_part){.number = qm_postgres_integer(rows, row, 0),
                           .epoch = qm_postgres_integer(rows, row, 1),
                           .upper = qm_postgres_real(rows, row, 2)};
    out->size = qm_postgres_size(rows, row, 3);
    out->entries = malloc(out->size > 0 ? out->size : 1);
    if (out->entries && out->size > 0) memcpy(out->entries, qm_postgres_text(rows, row, 3), out->size);
    return out->entries;
}

qm_stored qm_postgres_claim_parts(qm_store *store, const char *job, size_t limit, qm_store_part *out,
                                  size_t *count)
{
    /* Numbers as text: the result is binary, for the entries. */
    qm_postgres_query query = {
        .sql = "WITH top AS (SELECT p.part FROM quadmeshd.job_parts p"
               "   WHERE p.sequence = (SELECT sequence FROM quadmeshd.jobs WHERE id = $1) AND " IS_FREE(
                   "$2") "   ORDER BY p.upper DESC, p.part LIMIT $3::bigint FOR UPDATE OF p SKIP LOCKED),"
                         " taken AS (UPDATE quadmeshd.job_parts p SET node = $2, epoch = p.epoch + 1 FROM top"
                         "   WHERE p.part = top.part RETURNING p.part, p.epoch, p.upper, p.entries)"
                         " SELECT part::text, epoch::text, upper::text, entries FROM taken"
                         " ORDER BY taken.upper DESC, taken.part",
        .is_binary = true};
    char node[QM_NODE_NAME_SIZE + 16];
    qm_postgres_name_node(store, node);
    qm_postgres_add_text(&query, job);
    qm_postgres_add_text(&query, node);
    qm_postgres_add_integer(&query, (int64_t)limit);
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    for (int i = 0; status == QM_STORED && i < rows.count; i++) {
        if (read_part(&rows, i, &out[*count]))
            ++*count;
        else
            status = QM_STORED_NO_MEMORY;
    }
    qm_postgres_free(&rows);
    if (status == QM_STORED) return status;
    qm_store_parts_reset(out, *count);
    *count = 0;
    return status;
}

qm_stored qm_postgres_finish_parts(qm_store *store, const char *job, const qm_store_part *parts, size_t count,
                                   const qm_store_bounds *found, const qm_store_part *rest, size_t rest_count)
{
    /* The lock of the bounds puts finishes of a job in order; that of the parts reads their epochs anew. A job that gets
     * on is not one that ends its nodes: their deaths count from here. */
    qm_postgres_query query = {
        .sql = "WITH bounds AS (SELECT b.sequence FROM quadmeshd.jobs j JOIN quadmeshd.job_bounds b USING "
               "(sequence)"
               "   WHERE j.id = $1 FOR UPDATE OF b),"
               " mine AS (SELECT p.part FROM bounds JOIN quadmeshd.job_parts p USING (sequence)"
               "   JOIN unnest($2::bigint[], $3::int[]) AS a(part, epoch) ON a.part = p.part AND a.epoch = "
               "p.epoch"
               "   FOR UPDATE OF p),"
               " ready AS (SELECT sequence FROM bounds WHERE (SELECT count(*) FROM mine) = "
               "cardinality($2::bigint[])),"
               " gone AS (DELETE FROM quadmeshd.job_parts p USING ready, mine WHERE p.part = mine.part),"
               " raised AS (UPDATE quadmeshd.job_bounds b SET discarded = greatest(b.discarded, $4::float8),"
               "   lower = greatest(b.lower, $5::float8),"
               "   witness = CASE WHEN $5::float8 > b.lower THEN $6::text ELSE b.witness END,"
               "   iterations = b.iterations + $7::bigint, projections = b.projections + $8::bigint"
               "   FROM ready WHERE b.sequence = ready.sequence),"
               " lives AS (UPDATE quadmeshd.job_runs r SET deaths = 0 FROM ready"
               "   WHERE r.sequence = ready.sequence AND r.deaths > 0),"
               " added AS (" INSERT_PARTS("ready", "$9", "$10", "$11", "$12") ")"
                                                                              " SELECT 1 FROM ready"};
    qm_text numbers = {0}, epochs = {0};
    part_arrays arrays = {0};
    for (size_t i = 0; i < count; i++) {
        qm_postgres_write_integer(&numbers, parts[i].number);
        qm_postgres_write_integer(&epochs, parts[i].epoch);
    }
    qm_postgres_add_text(&query, job);
    qm_postgres_add_array(&query, &numbers);
    qm_postgres_add_array(&query, &epochs);
    add_found(&query, found);
    add_parts(&query, &arrays, rest, rest_count);
    qm_stored status = qm_postgres_change_row(store, &query);
    qm_text_reset(&numbers);
    qm_text_reset(&epochs);
    reset_parts(&arrays);
    return status == QM_STORED_NONE || status == QM_STORED_LATE ? QM_STORED_LOST : status;
}

qm_stored qm_postgres_raise_lower(qm_store *store, const char *job, double lower, const char *witness)
{
    qm_postgres_query query = {
        .sql = "UPDATE quadmeshd.job_bounds b SET lower = greatest(b.lower, $2::float8),"
               " witness = CASE WHEN $2::float8 > b.lower THEN $3::text ELSE b.witness END"
               " FROM quadmeshd.jobs j WHERE j.id = $1 AND b.sequence = j.sequence RETURNING 1"};
    qm_postgres_add_text(&query, job);
    qm_postgres_add_real(&query, lower);
    qm_postgres_add_text(&query, witness);
    return qm_postgres_change_row(store, &query);
}

static bool read_bounds(const qm_postgres_rows *rows, int row, void *user)
{
    qm_store_bounds *out = user;
    qm_postgres_read(rows, row, 0, out->engine, sizeof out->engine);
    qm_postgres_read(rows, row, 2, out->witness, sizeof out->witness);
    out->lower = qm_postgres_real(rows, row, 1);
    out->discarded = qm_postgres_real(rows, row, 3);
    out->iterations = (uint64_t)qm_postgres_integer(rows, row, 4);
    out->projections = (uint64_t)qm_postgres_integer(rows, row, 5);
    out->parts = (size_t)qm_postgres_integer(rows, row, 6);
    out->upper = qm_postgres_real(rows, row, 7);
    out->others = qm_postgres_real(rows, row, 8);
    out->nodes = (size_t)qm_postgres_integer(rows, row, 9);
    return true;
}

qm_stored qm_postgres_read_bounds(qm_store *store, const char *job, const qm_store_part *claimed,
                                  size_t count, qm_store_bounds *out)
{
    static const qm_postgres_table table = {sizeof(qm_store_bounds), read_bounds, NULL};
    qm_postgres_query query = {
        .sql = "SELECT b.engine, b.lower, b.witness, b.discarded, b.iterations, b.projections, p.* FROM "
               "quadmeshd.jobs j"
               " JOIN quadmeshd.job_bounds b USING (sequence), LATERAL (SELECT count(*), max(p.upper),"
               "   max(p.upper) FILTER (WHERE p.part <> ALL ($2::bigint[])), count(DISTINCT n.id)"
               "   FROM quadmeshd.job_parts p LEFT JOIN quadmeshd.nodes n ON n.id = p.node AND n.state = 0"
               "   WHERE p.sequence = b.sequence) p WHERE j.id = $1"};
    qm_text numbers = {0};
    for (size_t i = 0; i < count; i++)
        qm_postgres_write_integer(&numbers, claimed[i].number);
    qm_postgres_add_text(&query, job);
    qm_postgres_add_array(&query, &numbers);
    qm_stored status = qm_postgres_find_row(store, &query, &table, out);
    qm_text_reset(&numbers);
    return status;
}

static void reset_job(void *row)
{
    qm_store_job_reset(row);
}

qm_stored qm_postgres_find_split_job(qm_store *store, const char (*except)[QM_ID_SIZE], size_t count,
                                     qm_store_job *out)
{
    static const qm_postgres_table table = {sizeof(qm_store_job), qm_postgres_read_job, reset_job};
    qm_postgres_query query = {
        .sql =
            "SELECT j.id, j.key, j.idempotency_key, j.body, j.created, 1, j.sequence, j.document, j.restarts,"
            "   j.result, 0, NULL, j.labels FROM quadmeshd.job_bounds b JOIN quadmeshd.jobs j USING "
            "(sequence)"
            " WHERE j.id <> ALL ($2::text[]) AND NOT EXISTS"
            "   (SELECT FROM quadmeshd.job_runs r WHERE r.sequence = b.sequence AND r.node = $1)"
            " AND EXISTS (SELECT FROM quadmeshd.job_parts p WHERE p.sequence = b.sequence AND " IS_FREE(
                "$1") ")"
                      " ORDER BY j.sequence LIMIT 1",
        .use = QM_POSTGRES_PULSE};
    char node[QM_NODE_NAME_SIZE + 16];
    qm_text ids = {0};
    qm_postgres_name_node(store, node);
    for (size_t i = 0; i < count; i++)
        qm_postgres_write_text(&ids, except[i]);
    qm_postgres_add_text(&query, node);
    qm_postgres_add_array(&query, &ids);
    qm_stored status = qm_postgres_find_row(store, &query, &table, out);
    qm_text_reset(&ids);
    return status;
}
