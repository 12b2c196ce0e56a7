#include "store_internal.h"

static bool read_row(sqlite3_stmt *statement, void *row)
{
    qm_store_idempotent *out = row;
    return qm_store_read_text(statement, 0, out->id, sizeof out->id) &&
           qm_store_read_text(statement, 1, out->request, sizeof out->request);
}

static const qm_store_table table = {sizeof(qm_store_idempotent), read_row, NULL};

qm_status qm_store_find_idempotent_layout(qm_store *store, const char *key, qm_store_idempotent *out)
{
    return qm_store_find_row_by(store, "SELECT id, request FROM layouts WHERE idempotency_key = ?", key,
                                &table, out);
}

qm_status qm_store_find_idempotent_reconstruction(qm_store *store, const char *key, qm_store_idempotent *out)
{
    return qm_store_find_row_by(store, "SELECT id, request FROM reconstructions WHERE idempotency_key = ?",
                                key, &table, out);
}
