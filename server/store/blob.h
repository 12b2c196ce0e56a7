/**
 * blob.h: what the files of blobs and the database of the store know of each other, without either's library.
 */
#ifndef QM_BLOB_H
#define QM_BLOB_H

#include "store.h"

/** Room for every path below the data folder, whose own name is refused when it leaves no such room. */
#define QM_STORE_PATH_SIZE 4096
#define QM_STORE_FOLDER_SIZE (QM_STORE_PATH_SIZE - 128)

/** Of the names of results' arrays, after the id of the job. */
#define QM_RESULT_ENDING ".f64"

/** Makes the data folder and those in it, and puts them on disk. False with words in message. */
bool qm_blob_make_folders(const char *folder, char message[QM_MESSAGE_SIZE]);

/** Removes what was half written. Only for the owner of the folder: others' uploads lie there too. */
void qm_blob_sweep(const char *folder);

/** Removes whole blobs and arrays of results whose row a sudden end has kept from being written, or that were
 * to go with their row. For the start, when nobody else uses the store. */
void qm_blob_sweep_orphans(qm_store *store);

/** Gives a file that the disk has taken the name of a hash, and has the disk take that, too. */
bool qm_blob_put_in_place(const qm_store *store, const char *file, const char *hash);

/** Maps a whole open file for reading. */
qm_status qm_blob_map_file(int file, const uint8_t **bytes, size_t *size);

/** The data folder, without a slash at its end. */
const char *qm_store_folder(const qm_store *store);

/** True when a mesh has this blob, and when that cannot be told. */
bool qm_store_needs_blob(qm_store *store, const char *hash);

/** True when there is a job of this id, and when that cannot be told. */
bool qm_store_has_job(qm_store *store, const char *id);

#endif
