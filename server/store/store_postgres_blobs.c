/**
 * store_postgres_blobs.c: the rows of blobs, which say where their bytes are. Objects are named by a generation, new for
 * each upload, so that a slow removal never meets a later upload of the same bytes.
 *
 * An object outside the database is noted in blob_objects before it is put, and leaves that table with the commit of the
 * row that names it. So the database knows of each object that a place may have.
 *
 * A blob that no row names is marked first, and removed when it is still marked after a delay. A row that names a marked
 * blob takes the mark away in its own statement, and foreign keys forbid to remove a blob that a row names.
 */
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "store_postgres.h"

#define REMOVED "256" /* blobs in one statement */
#define TRIES 3       /* to read a blob, of which another upload takes the place meanwhile */

/* Of the cleaner, among nodes: any number that nobody else in the database uses. */
#define LOCK "7019267140411327"

static qm_place *place_of(const qm_store *store)
{
    return store->postgres->place;
}

/** Where the bytes of a blob are. */
typedef struct blob_row {
    char generation[QM_ID_SIZE];
    int64_t size;
} blob_row;

static bool read_row(const qm_postgres_rows *rows, int row, void *out)
{
    blob_row *found = out;
    qm_postgres_read(rows, row, 0, found->generation, sizeof found->generation);
    found->size = qm_postgres_integer(rows, row, 1);
    return true;
}

static const qm_postgres_table blob_rows = {sizeof(blob_row), read_row, NULL};

/* ---- objects that no blob has ---- */

/** Runs a statement about one object. QM_STORED_NONE: it has returned no row. */
static qm_stored change_object(qm_store *store, const char *sql, const char *generation)
{
    qm_postgres_query query = {.sql = sql, .use = QM_POSTGRES_TRANSFERS};
    qm_postgres_add_text(&query, generation);
    return qm_postgres_change_row(store, &query);
}

static qm_stored announce(qm_store *store, const char *generation)
{
    return change_object(store,
                         "INSERT INTO quadmeshd.blob_objects (generation) VALUES ($1)"
                         " ON CONFLICT (generation) DO UPDATE SET since = clock_timestamp() RETURNING 1",
                         generation);
}

static qm_stored remove_object(qm_store *store, const char *generation)
{
    qm_stored status = place_of(store)->kind->remove(place_of(store), generation);
    if (status != QM_STORED) return status;
    status = change_object(store, "DELETE FROM quadmeshd.blob_objects WHERE generation = $1 RETURNING 1",
                           generation);
    return status == QM_STORED_NONE ? QM_STORED : status; /* another node has removed it, too */
}

/* ---- storing ---- */

typedef struct upload {
    qm_store *store;
    qm_place_object object;
    char generation[QM_ID_SIZE];
    char damaged[QM_ID_SIZE]; /* generation that this one is to replace; "" for none */
    char unused[QM_ID_SIZE];  /* the one of them that is to go; "" for none */
} upload;

/** Runs a statement of a transaction; *found receives the first column of its first row, or "". */
static qm_stored run_in(qm_postgres_connection *connection, qm_postgres_query *query, char found[QM_ID_SIZE])
{
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_execute(connection, query, &rows);
    found[0] = '\0';
    if (status == QM_STORED && rows.count > 0) qm_postgres_read(&rows, 0, 0, found, QM_ID_SIZE);
    qm_postgres_free(&rows);
    return status;
}

/** Takes the object off the list of those without a blob. QM_STORED_AWAY: it was given up as too old. */
static qm_stored take_off(qm_postgres_connection *connection, const upload *up)
{
    char found[QM_ID_SIZE];
    qm_postgres_query take = {.sql = "DELETE FROM quadmeshd.blob_objects WHERE generation = $1"
                                     " AND NOT is_going RETURNING generation"};
    qm_postgres_add_text(&take, up->generation);
    qm_stored status = run_in(connection, &take, found);
    if (status != QM_STORED || found[0]) return status;
    /* The transaction was committed before, and its answer was lost. */
    qm_postgres_query look = {
        .sql = "SELECT generation FROM quadmeshd.blobs WHERE generation = $1 AND hash = $2"};
    qm_postgres_add_text(&look, up->generation);
    qm_postgres_add_text(&look, up->object.hash);
    status = run_in(connection, &look, found);
    return status == QM_STORED && !found[0] ? QM_STORED_AWAY : status;
}

/** Names the object. Of two uploads at once the first one stays, unless it is the damaged one. */
static qm_stored name_object(qm_postgres_connection *connection, upload *up)
{
    char named[QM_ID_SIZE];
    qm_postgres_query row = {
        .sql = "INSERT INTO quadmeshd.blobs AS b (hash, size, generation) VALUES ($1, $2::bigint, $3)"
               " ON CONFLICT (hash) DO UPDATE SET unneeded = NULL,"
               "  size = CASE WHEN b.generation = $4 THEN EXCLUDED.size ELSE b.size END,"
               "  generation = CASE WHEN b.generation = $4 THEN EXCLUDED.generation ELSE b.generation END"
               " RETURNING generation"};
    qm_postgres_add_text(&row, up->object.hash);
    qm_postgres_add_integer(&row, (int64_t)up->object.size);
    qm_postgres_add_text(&row, up->generation);
    qm_postgres_add_text(&row, up->damaged);
    qm_stored status = run_in(connection, &row, named);
    if (status != QM_STORED) return status;
    bool is_named = strcmp(named, up->generation) == 0;
    memcpy(up->unused, is_named ? up->damaged : up->generation, sizeof up->unused);
    if (!up->unused[0]) return QM_STORED;
    qm_postgres_query unused = {
        .sql = "INSERT INTO quadmeshd.blob_objects (generation, is_going) VALUES ($1, true)"
               " ON CONFLICT (generation) DO UPDATE SET is_going = true"};
    qm_postgres_add_text(&unused, up->unused);
    return run_in(connection, &unused, named);
}

/** The row comes after the object, as it holds up other uploads of these bytes. */
static qm_stored put_all(qm_postgres_connection *connection, void *user)
{
    upload *up = user;
    qm_place *place = place_of(up->store);
    qm_stored status;
    up->object.transaction = connection;
    if (place->kind->is_transactional) {
        qm_id_make('b',
                   up->generation); /* the transaction before may have been committed, and its answer lost */
        status = place->kind->put(place, &up->object);
    } else {
        status = take_off(connection, up);
    }
    return status == QM_STORED ? name_object(connection, up) : status;
}

static qm_stored put_object(upload *up)
{
    qm_place *place = place_of(up->store);
    qm_stored status = QM_STORED;
    up->object.name = up->generation;
    if (!place->kind->is_transactional) {
        qm_id_make('b', up->generation);
        status = announce(up->store, up->generation);
        if (status == QM_STORED) status = place->kind->put(place, &up->object);
    }
    if (status == QM_STORED) status = qm_postgres_transact(up->store, put_all, up);
    if (status == QM_STORED && up->unused[0])
        remove_object(up->store, up->unused); /* else the cleaner does */
    return status;
}

/** Finds the row of a blob, which is durable afterwards and has no mark. */
static qm_stored find_needed(qm_store *store, const char *hash, blob_row *out)
{
    qm_postgres_query query = {.sql = "UPDATE quadmeshd.blobs SET unneeded = NULL WHERE hash = $1"
                                      " RETURNING generation, size"};
    qm_postgres_add_text(&query, hash);
    return qm_postgres_find_row(store, &query, &blob_rows, out);
}

qm_stored qm_postgres_put_blob(qm_store *store, const char *hash, int file, bool is_repair)
{
    qm_place *place = place_of(store);
    struct stat facts;
    blob_row found;
    if (fstat(file, &facts) != 0) return QM_STORED_FAULT;
    upload up = {.store = store, .object = {.file = file, .size = (uint64_t)facts.st_size, .hash = hash}};
    qm_stored status = find_needed(store, hash, &found);
    if (status == QM_STORED) {
        if (!is_repair) status = place->kind->look(place, found.generation, (uint64_t)found.size);
        if (!is_repair && status != QM_STORED_NONE) return status;
        memcpy(up.damaged, found.generation, sizeof up.damaged);
    } else if (status != QM_STORED_NONE) {
        return status;
    }
    return put_object(&up);
}

/* ---- reading ---- */

qm_stored qm_postgres_get_blob(qm_store *store, const char *hash, int file)
{
    blob_row before = {0}, found;
    for (int i = 0; i < TRIES; i++) {
        qm_stored status = qm_postgres_find_row_by(
            store, "SELECT generation, size FROM quadmeshd.blobs WHERE hash = $1", hash, &blob_rows, &found);
        if (status != QM_STORED) return status;
        if (strcmp(found.generation, before.generation) == 0) return QM_STORED_DAMAGED;
        if (!qm_place_empty(file)) return QM_STORED_FAULT;
        status = place_of(store)->kind->get(place_of(store), found.generation, (uint64_t)found.size, file);
        if (status != QM_STORED_NONE) return status;
        before = found; /* its object is missing: another one has taken its place, or the place has lost it */
    }
    return QM_STORED_AWAY;
}

/* ---- removing ---- */

#define IS_NEEDED                                                                                            \
    "(EXISTS (SELECT FROM quadmeshd.meshes m WHERE m.hash = b.hash)"                                         \
    " OR EXISTS (SELECT FROM quadmeshd.meshes m WHERE m.positions = b.hash)"                                 \
    " OR EXISTS (SELECT FROM quadmeshd.job_arrays a WHERE a.hash = b.hash))"
#define CLEANER "cleaner AS MATERIALIZED (SELECT pg_try_advisory_xact_lock(" LOCK ") AS is_me)"
#define IS_OLD(column) column " <= clock_timestamp() - " QM_POSTGRES_SECONDS("$1")

/** Removes objects that are to go. A place that does not answer gets time until the next call. */
static qm_stored remove_objects(qm_store *store)
{
    qm_postgres_query query = {
        .sql = "SELECT generation FROM quadmeshd.blob_objects WHERE is_going LIMIT " REMOVED};
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    for (int i = 0; status == QM_STORED && i < rows.count; i++)
        status = remove_object(store, qm_postgres_text(&rows, i, 0));
    qm_postgres_free(&rows);
    return status;
}

/** Each statement sees rows that were committed before it: a mark that a row came too late to prevent is taken away
 * before the next removal. */
qm_stored qm_postgres_clean_blobs(qm_store *store, double delay_s)
{
    static const char *const statements[] = {
        "WITH " CLEANER " UPDATE quadmeshd.blobs b SET unneeded = NULL FROM cleaner"
        " WHERE is_me AND unneeded IS NOT NULL AND $1::float8 IS NOT NULL AND " IS_NEEDED,
        "WITH " CLEANER ", old AS (SELECT hash FROM quadmeshd.blobs b, cleaner WHERE is_me"
        "   AND " IS_OLD(
            "unneeded") " AND NOT " IS_NEEDED "   LIMIT " REMOVED " FOR UPDATE OF b SKIP LOCKED),"
                        " gone AS (DELETE FROM quadmeshd.blobs b USING old WHERE b.hash = old.hash"
                        "  RETURNING b.generation)"
                        " INSERT INTO quadmeshd.blob_objects (generation, is_going) SELECT generation, true "
                        "FROM gone",
        "UPDATE quadmeshd.blob_objects SET is_going = true WHERE NOT is_going AND " IS_OLD("since"),
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
    return status == QM_STORED ? remove_objects(store) : status;
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
