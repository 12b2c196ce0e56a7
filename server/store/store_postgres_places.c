/**
 * store_postgres_places.c: which place the blobs of a store are in. The database has its kind and its id, so that all
 * nodes use the same one.
 */
#include <stdio.h>
#include <string.h>

#include "store_postgres.h"

/* Of those who choose the place: any number that nobody else in the database uses. */
#define LOCK "7019267140411329"

/* A store that has blobs and no row was made when the database was the only place. */
#define PLACE                                                                                                \
    "SELECT kind, id FROM quadmeshd.blob_place UNION ALL"                                                    \
    " SELECT 'database', '' WHERE NOT EXISTS (SELECT FROM quadmeshd.blob_place)"                             \
    "  AND EXISTS (SELECT FROM quadmeshd.blobs)"

typedef struct chosen_place {
    qm_place *place;
    char kind[16], id[QM_ID_SIZE]; /* as the database has it; "" for none */
    char own[QM_ID_SIZE];          /* id of the place that this node is to use */
} chosen_place;

/** Reads the place that the database has, if it has one. */
static void read_place(const qm_postgres_rows *rows, chosen_place *found)
{
    if (rows->count == 0) return;
    qm_postgres_read(rows, 0, 0, found->kind, sizeof found->kind);
    qm_postgres_read(rows, 0, 1, found->id, sizeof found->id);
}

/** Runs a statement without rows, or reads the place that the database has. */
static qm_stored run_in(qm_postgres_connection *connection, qm_postgres_query *query, chosen_place *found)
{
    qm_postgres_rows rows;
    qm_stored status = qm_postgres_execute(connection, query, &rows);
    if (status == QM_STORED && found) read_place(&rows, found);
    qm_postgres_free(&rows);
    return status;
}

/** Finds the place of the store, which is that of its first node. */
static qm_stored choose(qm_postgres_connection *connection, void *user)
{
    chosen_place *chosen = user;
    const qm_place_kind *kind = chosen->place->kind;
    chosen->kind[0] = chosen->id[0] = chosen->own[0] = '\0';
    qm_postgres_query lock = {.sql = "SELECT pg_advisory_xact_lock(" LOCK ")"}, look = {.sql = PLACE};
    qm_stored status = run_in(connection, &lock, NULL);
    if (status == QM_STORED) status = run_in(connection, &look, chosen);
    if (status != QM_STORED) return status;
    bool is_first = !chosen->kind[0];
    if (!is_first && strcmp(chosen->kind, kind->name) != 0) return QM_STORED;
    if (!kind->is_transactional) {
        status = qm_place_identify(chosen->place, is_first, chosen->own);
        if (status == QM_STORED_NONE) status = QM_STORED; /* it is another place than the store's */
    }
    if (status != QM_STORED || !is_first) return status;
    qm_postgres_query note = {.sql = "INSERT INTO quadmeshd.blob_place VALUES ($1, $2)"};
    qm_postgres_add_text(&note, kind->name);
    qm_postgres_add_text(&note, chosen->own);
    snprintf(chosen->kind, sizeof chosen->kind, "%s", kind->name);
    snprintf(chosen->id, sizeof chosen->id, "%s", chosen->own);
    return run_in(connection, &note, NULL);
}

static qm_stored open_place(qm_store *store, qm_place **out, char message[QM_MESSAGE_SIZE])
{
    const qm_store_node *self = &store->postgres->self;
    if (qm_place_is_database(self->blobs)) return qm_postgres_open_chunks(store, out, message);
    return qm_place_open(self->blobs, self->blobs_keys, out, message);
}

/** Compares the place of this process with the store's. */
static qm_stored judge(const chosen_place *chosen, char message[QM_MESSAGE_SIZE])
{
    if (strcmp(chosen->kind, chosen->place->kind->name) != 0) {
        snprintf(message, QM_MESSAGE_SIZE, "blobs: those of this store are of the kind %s, and --blobs is %s",
                 chosen->kind, chosen->place->kind->name);
        return QM_STORED_FAULT;
    }
    if (strcmp(chosen->id, chosen->own) == 0) return QM_STORED;
    snprintf(message, QM_MESSAGE_SIZE,
             "blobs: the place of --blobs %s: is it mounted, and that of this store?",
             chosen->own[0] ? "has the id of another store" : "has no " QM_PLACE_ID);
    return QM_STORED_FAULT;
}

qm_stored qm_postgres_open_place(qm_store *store, char message[QM_MESSAGE_SIZE])
{
    chosen_place chosen = {0};
    qm_stored status = open_place(store, &store->postgres->place, message);
    if (status != QM_STORED) return status;
    chosen.place = store->postgres->place;
    message[0] = '\0';
    status = qm_postgres_transact(store, choose, &chosen);
    chosen.place->message = NULL;
    if (status != QM_STORED) {
        if (!message[0]) snprintf(message, QM_MESSAGE_SIZE, "blobs: their place cannot be made or read");
        return status;
    }
    return judge(&chosen, message);
}

qm_stored qm_postgres_open_place_to_read(qm_store *store, char message[QM_MESSAGE_SIZE])
{
    chosen_place chosen = {0};
    qm_postgres_query look = {.sql = PLACE};
    qm_postgres_rows rows;
    qm_stored status = open_place(store, &store->postgres->place, message);
    if (status != QM_STORED) return status;
    chosen.place = store->postgres->place;
    message[0] = '\0';
    status = qm_postgres_run(store, &look, &rows);
    if (status == QM_STORED) read_place(&rows, &chosen);
    qm_postgres_free(&rows);
    if (!chosen.kind[0]) snprintf(chosen.kind, sizeof chosen.kind, "%s", chosen.place->kind->name);
    if (status == QM_STORED && strcmp(chosen.kind, chosen.place->kind->name) == 0 && chosen.id[0])
        status = qm_place_identify(chosen.place, false, chosen.own);
    if (status == QM_STORED_NONE) status = QM_STORED;
    chosen.place->message = NULL;
    if (status == QM_STORED) return judge(&chosen, message);
    if (!message[0]) snprintf(message, QM_MESSAGE_SIZE, "blobs: their place cannot be read");
    return status;
}
