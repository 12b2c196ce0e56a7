#include "stored.h"

#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "database.h"
#include "folder.h"
#include "store/blob.h"

const qm_store_node qm_stored_node = {.name = "one", .version = "test", .workers = 2, .memory = 1 << 30};

qm_store *qm_stored_open_embedded(const char *folder, qm_store_purpose purpose)
{
    char message[QM_MESSAGE_SIZE] = "";
    qm_store *store;
    qm_store_open(folder, purpose, &store, message);
    QM_CHECK(store, "%s", message);
    return store;
}

qm_store *qm_stored_open_node(const char *database, const char *folder)
{
    char message[QM_MESSAGE_SIZE] = "";
    qm_store *store;
    qm_store_open_shared(database, folder, &qm_stored_node, false, &store, message);
    QM_CHECK(store, "%s", message);
    return store;
}

static int set_up(void **state, char *database)
{
    qm_stored_fixture *f = calloc(1, sizeof *f);
    if (!f) return -1;
    *f = (qm_stored_fixture){.folder = qm_folder_make(), .database = database};
    f->store = database ? qm_stored_open_node(database, f->folder)
                        : qm_stored_open_embedded(f->folder, QM_STORE_SERVE);
    *state = f;
    return 0;
}

int qm_stored_set_up_embedded(void **state)
{
    return set_up(state, NULL);
}

int qm_stored_set_up_shared(void **state)
{
    return set_up(state, qm_database_make());
}

int qm_stored_tear_down(void **state)
{
    qm_stored_fixture *f = *state;
    qm_store_close(f->store);
    qm_folder_remove(f->folder);
    if (f->database) qm_database_drop(f->database);
    free(f);
    return 0;
}

bool qm_stored_keep_blob(qm_store *store, const char *text, char hash[QM_HASH_SIZE])
{
    qm_blob_writer *writer;
    return qm_blob_begin(store, 0, &writer) == QM_OK && qm_blob_write(writer, text, strlen(text)) == QM_OK &&
           qm_blob_seal(writer, hash) == QM_OK && qm_blob_keep(writer) == QM_STORED;
}
