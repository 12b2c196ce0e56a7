/**
 * store_postgres_blobs.c: the bytes of blobs, in chunks. The chunks are named by a generation, new for each upload, so
 * that a slow removal never meets the chunks of a later upload of the same bytes.
 *
 * A blob that no row names is marked first, and removed when it is still marked after a delay. A row that names a marked
 * blob takes the mark away in its own statement, and foreign keys forbid to remove a blob that a row names.
 */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/log.h"
#include "store_postgres.h"

#define CHUNK 1048576 /* bytes; the last one of a blob has fewer */
#define REMOVED "256" /* blobs in one statement */

/* Of the cleaner, among nodes: any number that nobody else in the database uses. */
#define LOCK "7019267140411327"

/* ---- storing ---- */

typedef struct upload {
    const char *hash;
    int file;
    char generation[QM_ID_SIZE];
    uint8_t *bytes; /* of a chunk */
} upload;

/** Reads up to a chunk at an offset; -1 after a fault. */
static ssize_t read_chunk(const upload *up, off_t offset)
{
    size_t size = 0;
    while (size < CHUNK) {
        ssize_t got = pread(up->file, up->bytes + size, CHUNK - size, offset + (off_t)size);
        if (got < 0 && errno == EINTR) continue;
        if (got < 0) qm_log(QM_LOG_ERROR, "a blob cannot be read: %s", strerror(errno));
        if (got < 0) return -1;
        if (got == 0) break;
        size += (size_t)got;
    }
    return (ssize_t)size;
}

static qm_stored run_in(qm_postgres_connection *connection, qm_postgres_query *query, int *row_count)
{
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_execute(connection, query, &rows);
    if (row_count) *row_count = rows.count;
    qm_postgres_free(&rows);
    return status;
}

/** In a transaction. *size is the number of bytes. */
static qm_stored put_chunks(qm_postgres_connection *connection, const upload *up, int64_t *size)
{
    *size = 0;
    for (int n = 0;; n++) {
        ssize_t got = read_chunk(up, (off_t)n * CHUNK);
        if (got <= 0) return got < 0 ? QM_STORED_FAULT : QM_STORED;
        qm_postgres_query query = {.sql = "INSERT INTO quadmeshd.blob_chunks (generation, n, bytes)"
                                          " VALUES ($1, $2::int, $3::bytea)"};
        qm_postgres_add_text(&query, up->generation);
        qm_postgres_add_integer(&query, n);
        qm_postgres_add_bytes(&query, up->bytes, (size_t)got);
        qm_stored status = run_in(connection, &query, NULL);
        if (status != QM_STORED) return status;
        *size += got;
    }
}

/** The row comes after its chunks, as it holds up other uploads of these bytes. */
static qm_stored put_all(qm_postgres_connection *connection, void *user)
{
    upload *up = user;
    int64_t size;
    int row_count;
    qm_id_make('b', up->generation);
    qm_stored status = put_chunks(connection, up, &size);
    if (status != QM_STORED) return status;
    qm_postgres_query row = {
        .sql = "INSERT INTO quadmeshd.blobs (hash, size, generation) VALUES ($1, $2::bigint, $3)"
               " ON CONFLICT (hash) DO UPDATE SET unneeded = NULL RETURNING 1"};
    qm_postgres_add_text(&row, up->hash);
    qm_postgres_add_integer(&row, size);
    qm_postgres_add_text(&row, up->generation);
    status = run_in(connection, &row, &row_count);
    if (status != QM_STORED) return status;
    /* Another node was first: its chunks stay. */
    qm_postgres_query unused = {
        .sql = "DELETE FROM quadmeshd.blob_chunks WHERE generation = $2"
               " AND NOT EXISTS (SELECT FROM quadmeshd.blobs WHERE hash = $1 AND generation = $2)"};
    qm_postgres_add_text(&unused, up->hash);
    qm_postgres_add_text(&unused, up->generation);
    return run_in(connection, &unused, NULL);
}

qm_stored qm_postgres_put_blob(qm_store *store, const char *hash, int file)
{
    /* Durable also when it changes nothing else: the mark of one that was stored before is written again. */
    qm_postgres_query before = {.sql =
                                    "UPDATE quadmeshd.blobs SET unneeded = NULL WHERE hash = $1 RETURNING 1"};
    qm_postgres_add_text(&before, hash);
    qm_stored status = qm_postgres_change_row(store, &before);
    if (status != QM_STORED_NONE) return status;
    upload up = {.hash = hash, .file = file, .bytes = malloc(CHUNK)};
    if (!up.bytes) return QM_STORED_NO_MEMORY;
    status = qm_postgres_transact(store, put_all, &up);
    free(up.bytes);
    return status;
}

/* ---- reading ---- */

static qm_stored write_all(int file, const char *bytes, size_t size)
{
    while (size > 0) {
        ssize_t put = write(file, bytes, size);
        if (put < 0 && errno == EINTR) continue;
        if (put <= 0) {
            qm_log(QM_LOG_ERROR, "a blob cannot be copied to the folder: %s", strerror(errno));
            return errno == ENOSPC || errno == EDQUOT ? QM_STORED_FULL : QM_STORED_FAULT;
        }
        bytes += put;
        size -= (size_t)put;
    }
    return QM_STORED;
}

/** Writes the chunk after `done` bytes; adds its size. QM_STORED_NONE: it is not there. */
static qm_stored get_chunk(qm_store *store, const char *generation, int file, int64_t *done)
{
    qm_postgres_query query = {
        .sql = "SELECT bytes FROM quadmeshd.blob_chunks WHERE generation = $1 AND n = $2::int",
        .is_binary = true,
        .use = QM_POSTGRES_TRANSFERS};
    qm_postgres_add_text(&query, generation);
    qm_postgres_add_integer(&query, *done / CHUNK);
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    size_t size = status == QM_STORED && rows.count > 0 ? qm_postgres_size(&rows, 0, 0) : 0;
    if (status == QM_STORED && size == 0) status = QM_STORED_NONE;
    if (status == QM_STORED) status = write_all(file, qm_postgres_text(&rows, 0, 0), size);
    *done += (int64_t)size;
    qm_postgres_free(&rows);
    return status;
}

/** Where the bytes of a blob are. */
typedef struct place {
    char generation[QM_ID_SIZE];
    int64_t size;
} place;

static bool read_place(const qm_postgres_rows *rows, int row, void *out)
{
    place *found = out;
    qm_postgres_read(rows, row, 0, found->generation, sizeof found->generation);
    found->size = qm_postgres_integer(rows, row, 1);
    return true;
}

static qm_stored find_place(qm_store *store, const char *hash, place *out)
{
    static const qm_postgres_table places = {sizeof(place), read_place, NULL};
    return qm_postgres_find_row_by(store, "SELECT generation, size FROM quadmeshd.blobs WHERE hash = $1",
                                   hash, &places, out);
}

qm_stored qm_postgres_get_blob(qm_store *store, const char *hash, int file)
{
    place found, now;
    int64_t done = 0;
    qm_stored status = find_place(store, hash, &found);
    while (status == QM_STORED && done < found.size)
        status = get_chunk(store, found.generation, file, &done);
    if (status != QM_STORED_NONE || done == 0) return status;
    /* A chunk is missing: the blob was removed meanwhile, or the database has lost it. */
    status = find_place(store, hash, &now);
    bool is_same = status == QM_STORED && strcmp(now.generation, found.generation) == 0;
    return is_same ? QM_STORED_DAMAGED : status == QM_STORED ? QM_STORED_NONE : status;
}

/* ---- removing ---- */

#define IS_NEEDED                                                                                            \
    "(EXISTS (SELECT FROM quadmeshd.meshes m WHERE m.hash = b.hash)"                                         \
    " OR EXISTS (SELECT FROM quadmeshd.meshes m WHERE m.positions = b.hash)"                                 \
    " OR EXISTS (SELECT FROM quadmeshd.job_arrays a WHERE a.hash = b.hash))"
#define CLEANER "cleaner AS MATERIALIZED (SELECT pg_try_advisory_xact_lock(" LOCK ") AS is_me)"

/** Each statement sees rows that were committed before it: a mark that a row came too late to prevent is taken away
 * before the next removal. */
qm_stored qm_postgres_clean_blobs(qm_store *store, double delay_s)
{
    static const char *const statements[] = {
        "WITH " CLEANER " UPDATE quadmeshd.blobs b SET unneeded = NULL FROM cleaner"
        " WHERE is_me AND unneeded IS NOT NULL AND $1::float8 IS NOT NULL AND " IS_NEEDED,
        "WITH " CLEANER ", old AS (SELECT hash FROM quadmeshd.blobs b, cleaner WHERE is_me"
        "   AND unneeded <= clock_timestamp() - " QM_POSTGRES_SECONDS(
            "$1") " AND NOT " IS_NEEDED "   LIMIT " REMOVED " FOR UPDATE OF b SKIP LOCKED),"
                  " gone AS (DELETE FROM quadmeshd.blobs b USING old WHERE b.hash = old.hash RETURNING "
                  "b.generation)"
                  " DELETE FROM quadmeshd.blob_chunks c USING gone WHERE c.generation = gone.generation",
        "WITH " CLEANER " UPDATE quadmeshd.blobs b SET unneeded = clock_timestamp() FROM cleaner"
        " WHERE is_me AND unneeded IS NULL AND $1::float8 IS NOT NULL AND NOT " IS_NEEDED};
    qm_stored status = QM_STORED;
    for (size_t i = 0; status == QM_STORED && i < sizeof statements / sizeof statements[0]; i++) {
        qm_postgres_query query = {.sql = statements[i]};
        qm_postgres_add_real(&query, delay_s);
        qm_postgres_rows rows;
        status = qm_postgres_run(store, &query, &rows);
        qm_postgres_free(&rows);
        /* A mesh has just named a blob that was to go: nothing was removed this time. */
        if (status == QM_STORED_LATE) status = QM_STORED;
    }
    return status;
}

qm_stored qm_postgres_list_orphans(qm_store *store, const char *after, size_t limit,
                                   char (*hashes)[QM_HASH_SIZE], size_t *count)
{
    qm_postgres_query query = {.sql = "SELECT hash FROM quadmeshd.blobs b WHERE hash > $1 AND NOT " IS_NEEDED
                                      " ORDER BY hash LIMIT $2::bigint"};
    qm_postgres_add_text(&query, after);
    qm_postgres_add_integer(&query, (int64_t)limit);
    qm_postgres_rows rows;
    *count = 0;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    for (int i = 0; i < rows.count; i++)
        qm_postgres_read(&rows, i, 0, hashes[(*count)++], QM_HASH_SIZE);
    qm_postgres_free(&rows);
    return status;
}
