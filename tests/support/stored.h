/**
 * stored.h: a store of either kind for the tests that run on both: embedded, or shared in a database of its own
 * (database.h), with a folder of its own.
 */
#ifndef QM_TEST_STORED_H
#define QM_TEST_STORED_H

#include "base/id.h"
#include "store/store.h"

typedef struct qm_stored_fixture {
    char *folder, *database; /* no database: embedded */
    qm_store *store;
} qm_stored_fixture;

/** For cmocka_unit_test_setup_teardown; the state is a qm_stored_fixture. */
int qm_stored_set_up_embedded(void **state);
int qm_stored_set_up_shared(void **state);
int qm_stored_tear_down(void **state);

/** The node that opens a shared store. */
extern const qm_store_node qm_stored_node;

/** Open a store, for qm_store_close; a fault fails the test. */
qm_store *qm_stored_open_embedded(const char *folder, qm_store_purpose purpose);
qm_store *qm_stored_open_node(const char *database, const char *folder);

/** Stores bytes; false after a fault. */
bool qm_stored_keep_blob(qm_store *store, const char *text, char hash[QM_HASH_SIZE]);

#endif
