/**
 * space.h: the bytes in a data folder, and the quota on them. Counted are the files of blobs and results,
 * uploads on their way, and the pages of the database that hold something; not its log and its free pages,
 * which are used again, nor lost/.
 */
#ifndef QM_SPACE_H
#define QM_SPACE_H

#include <pthread.h>

#include "store.h"

typedef struct qm_space {
    pthread_mutex_t lock; /* guards files and database; taken last */
    uint64_t files[QM_STORE_FILES_COUNT];
    uint64_t database;
    uint64_t quota; /* 0: none */
} qm_space;

/** Counts the files of a folder, of which no other thread uses anything yet. */
void qm_space_count(qm_store *store);

/** Sets the bytes of the database, after it has changed. */
void qm_space_set_database(qm_store *store, uint64_t size);

/** Claims bytes for a kind of files. QM_E_TOO_LARGE, and nothing is claimed: the quota does not allow it. */
qm_status qm_space_claim(qm_store *store, qm_store_files kind, uint64_t size);
void qm_space_release(qm_store *store, qm_store_files kind, uint64_t size);

/** Counts claimed bytes as another kind. */
void qm_space_move(qm_store *store, qm_store_files from, qm_store_files to, uint64_t size);

/** Bytes of a file; 0 when there is none. */
uint64_t qm_space_size_of(const char *path);

/** Removes a file of a kind, and its bytes from the count. */
void qm_space_unlink(qm_store *store, qm_store_files kind, const char *path);

/** True while what is stored is below the quota: there may be new rows. */
bool qm_space_has_room(qm_store *store);

#endif
