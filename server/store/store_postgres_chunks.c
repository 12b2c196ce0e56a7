/**
 * store_postgres_chunks.c: the place of blobs that is the database itself: objects in chunks.
 */
#include <stdio.h>
#include <stdlib.h>

#include "store_postgres.h"

#define CHUNK 1048576 /* bytes; the last one of an object has fewer */

typedef struct database_place {
    qm_place base;
    qm_store *store;
} database_place;

static qm_store *store_of(const qm_place *place)
{
    return ((const database_place *)place)->store;
}

static qm_stored put_chunk(const qm_place_object *object, int64_t n, const uint8_t *bytes, size_t size)
{
    qm_postgres_query query = {.sql = "INSERT INTO quadmeshd.blob_chunks (generation, n, bytes)"
                                      " VALUES ($1, $2::int, $3::bytea)"};
    qm_postgres_rows rows;
    qm_postgres_add_text(&query, object->name);
    qm_postgres_add_integer(&query, n);
    qm_postgres_add_bytes(&query, bytes, size);
    qm_stored status = qm_postgres_execute(object->transaction, &query, &rows);
    qm_postgres_free(&rows);
    return status;
}

static qm_stored put_object(qm_place *place, const qm_place_object *object)
{
    (void)place;
    uint8_t *bytes = malloc(CHUNK);
    if (!bytes) return QM_STORED_NO_MEMORY;
    qm_stored status = QM_STORED;
    for (int64_t n = 0; status == QM_STORED; n++) {
        ssize_t got = qm_place_read(object->file, bytes, CHUNK, (uint64_t)n * CHUNK);
        if (got == 0) break;
        status = got < 0 ? QM_STORED_FAULT : put_chunk(object, n, bytes, (size_t)got);
    }
    free(bytes);
    return status;
}

/** The lengths are told without reading the bytes, which are not compressed. */
static qm_stored look_for(qm_place *place, const char *name, uint64_t size)
{
    qm_postgres_query query = {.sql = "SELECT coalesce(sum(octet_length(bytes)), 0) = $2::bigint"
                                      " FROM quadmeshd.blob_chunks WHERE generation = $1",
                               .use = QM_POSTGRES_TRANSFERS};
    qm_postgres_rows rows;
    qm_postgres_add_text(&query, name);
    qm_postgres_add_integer(&query, (int64_t)size);
    qm_stored status = qm_postgres_run(store_of(place), &query, &rows);
    if (status == QM_STORED && !qm_postgres_bool(&rows, 0, 0)) status = QM_STORED_NONE;
    qm_postgres_free(&rows);
    return status;
}

/** Appends a chunk; adds its size to *done. QM_STORED_NONE: it is not there. */
static qm_stored get_chunk(qm_store *store, const char *name, int file, uint64_t *done)
{
    qm_postgres_query query = {
        .sql = "SELECT bytes FROM quadmeshd.blob_chunks WHERE generation = $1 AND n = $2::int",
        .is_binary = true,
        .use = QM_POSTGRES_TRANSFERS};
    qm_postgres_add_text(&query, name);
    qm_postgres_add_integer(&query, (int64_t)(*done / CHUNK));
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_run(store, &query, &rows);
    size_t size = status == QM_STORED && rows.count > 0 ? qm_postgres_size(&rows, 0, 0) : 0;
    if (status == QM_STORED && size == 0) status = QM_STORED_NONE;
    if (status == QM_STORED) status = qm_place_write(file, qm_postgres_text(&rows, 0, 0), size);
    *done += size;
    qm_postgres_free(&rows);
    return status;
}

static qm_stored get_object(qm_place *place, const char *name, uint64_t size, int file)
{
    qm_stored status = QM_STORED;
    for (uint64_t done = 0; status == QM_STORED && done < size;)
        status = get_chunk(store_of(place), name, file, &done);
    return status;
}

static qm_stored remove_object(qm_place *place, const char *name)
{
    qm_postgres_query query = {.sql = "DELETE FROM quadmeshd.blob_chunks WHERE generation = $1",
                               .use = QM_POSTGRES_TRANSFERS};
    qm_postgres_rows rows;
    qm_postgres_add_text(&query, name);
    qm_stored status = qm_postgres_run(store_of(place), &query, &rows);
    qm_postgres_free(&rows);
    return status;
}

static void close_place(qm_place *place)
{
    free(place);
}

static const qm_place_kind kind = {.name = "database",
                                   .is_transactional = true,
                                   .put = put_object,
                                   .look = look_for,
                                   .get = get_object,
                                   .remove = remove_object,
                                   .close = close_place};

qm_stored qm_postgres_open_chunks(qm_store *store, qm_place **out, char message[QM_MESSAGE_SIZE])
{
    database_place *self = calloc(1, sizeof *self);
    *out = NULL;
    if (!self) {
        snprintf(message, QM_MESSAGE_SIZE, "%s", qm_status_text(QM_E_NO_MEMORY));
        return QM_STORED_NO_MEMORY;
    }
    *self = (database_place){{&kind, message}, store};
    *out = &self->base;
    return QM_STORED;
}
